"""What a renderer must give where the answer is known.

Depth counts as in the path-buffer paper: 1 is direct light only. Lengths in scene units, radiance in
W sr^-1 m^-2, irradiance in W m^-2. Everything is grey: one channel at a time.

Howell is J. R. Howell, A Catalog of Radiation Heat Transfer Configuration Factors, by its section numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]


def furnace_radiance(emission: float, reflectance: float, depth: int, ambient: float = 0.0) -> float:
    """Radiance anywhere in a closed box whose whole inside emits and reflects alike.

    Le (1 + rho + ... + rho^depth): each further vertex adds one more reflection, and depth 1 is Le + rho Le.
    `ambient` stands for the reflected radiance beyond the last vertex (PB A.2) and comes in as rho^depth ambient;
    ambient = rho Le / (1 - rho) makes the sum Le / (1 - rho), the value of infinite depth.
    """
    return emission * sum(reflectance**i for i in range(depth + 1)) + reflectance**depth * ambient


def polygon_irradiance(
    point: ArrayLike, normal: ArrayLike, corners: ArrayLike, radiance: float = 1.0
) -> float | Float64:
    """Irradiance at a point (3,), or at points (..., 3), from a polygon of uniform radiance, by Lambert's formula.

    E = L / 2 sum_i theta_i (v_i+1 x v_i) / |v_i+1 x v_i| . n, with v_i the directions to the corners and theta_i
    the angle between neighbours. Lambert 1760, Photometria; Arvo 1994, The irradiance Jacobian for partially
    occluded polyhedral sources, eq. 2.

    normal  : (3,) unit, of all points
    corners : (N, 3), counter-clockwise seen from the side that emits; all must be above the points' horizons.
    A point behind the polygon gets 0.
    """
    v = np.asarray(corners, np.float64) - np.asarray(point, np.float64)[..., None, :]
    n = np.asarray(normal, np.float64)
    if np.any(v @ n < -1e-9 * np.linalg.norm(v, axis=-1)):
        raise ValueError("Lambert's formula needs the whole polygon above the horizon of the point")
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    following = np.roll(v, -1, axis=-2)
    across = np.cross(following, v)
    sine = np.linalg.norm(across, axis=-1)
    theta = np.arctan2(sine, np.sum(v * following, axis=-1))
    total = np.sum(theta / np.where(sine > 0, sine, 1) * (across @ n), axis=-1)
    return np.maximum(0.0, 0.5 * radiance * total)


def reflected_radiance(irradiance: float, reflectance: float) -> float:
    """Radiance that a Lambertian surface sends everywhere: rho E / pi."""
    return reflectance * irradiance / np.pi


def corner_form_factor(a: float, b: float, c: float) -> float:
    """From a small plane element to a parallel a x b rectangle at distance c, one corner above it (Howell B-3).

    The irradiance of the element is pi L times this. Four of them make a rectangle above any point inside it.
    """
    A, B = a / c, b / c
    p, q = np.sqrt(1 + A * A), np.sqrt(1 + B * B)
    return float((A / p * np.arctan(B / p) + B / q * np.arctan(A / q)) / (2 * np.pi))


def facing_rectangles_form_factor(a: float, b: float, c: float) -> float:
    """From one a x b rectangle to another, parallel and directly opposite at distance c (Howell C-11)."""
    X, Y = a / c, b / c
    p, q = np.sqrt(1 + X * X), np.sqrt(1 + Y * Y)
    total = (
        0.5 * np.log((1 + X * X) * (1 + Y * Y) / (1 + X * X + Y * Y))
        + X * q * np.arctan(X / q)
        + Y * p * np.arctan(Y / p)
        - X * np.arctan(X)
        - Y * np.arctan(Y)
    )
    return float(2 / (np.pi * X * Y) * total)


def facing_plates_radiance(
    a: float,
    b: float,
    gap: float,
    emission: tuple[float, float],
    reflectance: tuple[float, float],
    depth: int,
    point: tuple[float, float] = (0.0, 0.0),
    nodes: int = 24,
) -> tuple[float, float]:
    """Radiance of the two plates at `point`, seen from between them, after `depth` reflections.

    The plates are a x b rectangles centred on the z axis, one at z = 0 facing up, one at z = gap facing down,
    each emitting uniformly on the side that faces the other. What one plate reflects is rho / pi times the
    irradiance from the other:

        Lr_i = rho_i / pi  integral over plate j of  (Le_j + Lr_j) gap^2 / r^4 dA

    The direct term is Lambert's formula, exact. The reflected one is iterated depth - 1 times with Gauss-Legendre
    quadrature, `nodes` by `nodes` on each plate (Nystrom's method): for plates no wider than four gaps, 24 nodes
    are right to 1e-8.

    point   : (x, y), the same on both plates
    returns : radiance of the lower plate and of the upper plate
    """
    x, weight = np.polynomial.legendre.leggauss(nodes)
    places = np.stack(np.meshgrid(x * a / 2, x * b / 2, indexing="ij"), axis=-1).reshape(-1, 2)
    dA = np.outer(weight * a / 2, weight * b / 2).ravel()
    # The point asked for goes last: it receives, and with no area it gives nothing.
    places = np.vstack([places, point])
    dA = np.append(dA, 0.0)
    r2 = gap**2 + np.sum((places[:, None] - places[None]) ** 2, axis=-1)
    gathers = gap**2 / r2**2 * dA / np.pi
    corners = [(-a / 2, -b / 2, gap), (-a / 2, b / 2, gap), (a / 2, b / 2, gap), (a / 2, -b / 2, gap)]
    direct = np.array([polygon_irradiance((*p, 0.0), (0, 0, 1), corners) / np.pi for p in places])

    reflected = [np.zeros(len(places)), np.zeros(len(places))]
    for _ in range(depth):
        reflected = [reflectance[i] * (emission[1 - i] * direct + gathers @ reflected[1 - i]) for i in (0, 1)]
    return float(emission[0] + reflected[0][-1]), float(emission[1] + reflected[1][-1])


def infinite_plates_radiance(
    emission: tuple[float, float], reflectance: tuple[float, float], depth: int
) -> tuple[float, float]:
    """Two infinite facing plates: every ray from one meets the other, so L_i = Le_i + rho_i L_j, `depth` times."""
    L = emission
    for _ in range(depth):
        L = (emission[0] + reflectance[0] * L[1], emission[1] + reflectance[1] * L[0])
    return L


def perpendicular_rectangles_form_factor(width: float, height: float, length: float) -> float:
    """From a width x length rectangle to a height x length one, at a right angle along the edge `length` (C-14)."""
    W, H = width / length, height / length
    w, h, s = W * W, H * H, W * W + H * H
    logarithm = (
        np.log((1 + w) * (1 + h) / (1 + s))
        + w * np.log(w * (1 + s) / ((1 + w) * s))
        + h * np.log(h * (1 + s) / ((1 + h) * s))
    )
    root = np.sqrt(s)
    total = W * np.arctan(1 / W) + H * np.arctan(1 / H) - root * np.arctan(1 / root) + 0.25 * logarithm
    return float(total / (np.pi * W))


def tilted_rectangles_form_factor(width: float, height: float, length: float, angle: float) -> float:
    """As `perpendicular_rectangles_form_factor`, with `angle` radians between the two, 0 < angle < pi (C-16).

    What is left of Howell's formula as an integral is done by Gauss-Legendre quadrature, right to 1e-10.
    """
    A, B = height / length, width / length
    sin, cos, sin2, cos2 = np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle)
    C = A * A + B * B - 2 * A * B * cos
    D = np.sqrt(1 + A * A * sin * sin)
    x, weight = np.polynomial.legendre.leggauss(64)
    z = 0.5 * B * (x + 1)
    root = np.sqrt(1 + z * z * sin * sin)
    integral = 0.5 * B * np.sum(weight * root * (np.arctan(z * cos / root) + np.arctan((A - z * cos) / root)))
    total = (
        -sin2
        / 4
        * (
            A * B * sin
            + (np.pi / 2 - angle) * (A * A + B * B)
            + B * B * np.arctan((A - B * cos) / (B * sin))
            + A * A * np.arctan((B - A * cos) / (A * sin))
        )
    )
    total += (
        sin
        * sin
        / 4
        * (
            (2 / (sin * sin) - 1) * np.log((1 + A * A) * (1 + B * B) / (1 + C))
            + B * B * np.log(B * B * (1 + C) / (C * (1 + B * B)))
            + A * A * np.log(A * A * (1 + A * A) ** cos2 / (C * (1 + C) ** cos2))
        )
    )
    total += B * np.arctan(1 / B) + A * np.arctan(1 / A) - np.sqrt(C) * np.arctan(1 / np.sqrt(C))
    total += sin * sin2 / 2 * A * D * (np.arctan(A * cos / D) + np.arctan((B - A * cos) / D))
    return float((total + cos * integral) / (np.pi * B))
