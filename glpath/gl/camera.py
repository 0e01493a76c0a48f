"""Uniforms and defines of a camera, for `shaders/camera/camera.glsl`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from glpath.sampling.points import concentric_disk
from glpath.scene.model import Camera, Float64

CENTRE = (0.5, 0.5)
# Distance from the scene beyond which a camera counts as distant, in scene radii. 32-bit floats there resolve 1e-6
# of the radius.
_DISTANT = 16.0


def camera_defines(camera: Camera, own_lens: bool = False) -> dict[str, object]:
    """Return the defines of the camera's kind for programs that include camera.glsl; a pinhole needs none.

    own_lens : True if each pixel has its own lens point (`lens_uniforms`); False if all rays of a path set pass
               through one lens point, as through a shifted pinhole
    """
    defines: dict[str, object] = {}
    if camera.projection != "perspective":
        defines[f"EYE_{camera.projection.upper()}"] = 1
    if own_lens and camera.aperture_radius > 0:
        defines["EYE_LENS"] = 1
    return defines


def eye_uniforms(
    camera: Camera,
    window: tuple[int, int, int, int] | None = None,
    pixel: tuple[float, float] = CENTRE,
    lens: ArrayLike | None = None,
    ahead: float = 0.0,
) -> dict[str, object]:
    """Return the uniforms for rays through a window of the image.

    window : (x, y, width, height) in pixels of the whole image, y from the top; None: the whole image
    pixel  : position in each pixel, x to the right and y down, each in [0, 1)
    lens   : (2,) in [0, 1), the lens point that all rays pass through; None: the lens centre
    ahead  : distance by which the rays start ahead of the eye, along the view direction; see `ahead_of`. Must be 0
             for a panorama and for rays that all start at one point
    """
    width, height = camera.resolution
    x, y, w, h = window or (0, 0, width, height)
    right, up, forward = camera.frame()
    position = np.asarray(camera.position, np.float64)
    centre = np.array(eye_centre(camera, pixel))
    focal = np.array(camera.focal_lengths)
    if lens is not None and camera.aperture_radius > 0:
        # Points in focus stay at their image position: the lens point acts as a pinhole with a shifted image.
        beside = camera.aperture_radius * concentric_disk(np.asarray(lens, np.float64))
        position = position + beside[0] * right + beside[1] * up
        centre = centre + focal / camera.focus * beside
    return {
        "eye_position": tuple(position + ahead * forward),
        "eye_ahead": ahead,
        "eye_right": tuple(right),
        "eye_up": tuple(up),
        "eye_forward": tuple(forward),
        "eye_focal": (float(focal[0]), float(focal[1])),
        "eye_angle": (2.0 * np.pi / width, np.pi / height),
        "eye_centre": (float(centre[0]), float(centre[1])),
        "eye_corner": (x, height - y - h),
        "eye_size": (w, h),
    }


def ahead_of(camera: Camera, centre: Float64, radius: float) -> float:
    """Return the distance ahead of a camera at which rays start if objects are in a sphere; 0 for a near camera.

    A hit has the rounding error of its distance from the ray's start. From a distant start, in 32 bits, this error
    is more than scans of the path-buffer tolerate.

    centre, radius : sphere that contains the objects, scene units
    """
    to_centre = centre - camera.position
    if camera.projection == "panorama" or not np.linalg.norm(to_centre) > _DISTANT * radius:
        return 0.0
    return max(0.0, float(to_centre @ camera.frame()[2]) - 2.0 * radius)


def eye_centre(camera: Camera, pixel: tuple[float, float]) -> tuple[float, float]:
    """Return the uniform `eye_centre`, which depends on the position in each pixel."""
    across, down = camera.centre
    return across + 0.5 - pixel[0], camera.resolution[1] - down - 0.5 + pixel[1]


def of_every_second(eye: dict[str, Any], offset: tuple[int, int], size: tuple[int, int]) -> dict[str, Any]:
    """Return the uniforms for rays through every second pixel of a window, across and up.

    eye    : uniforms for all pixels of the window
    offset : offset of the first pixel, to the right and up
    size   : number of selected pixels, across and up
    """
    centre = tuple(
        (of_image - corner - first + 0.5) / 2.0
        for of_image, corner, first in zip(eye["eye_centre"], eye["eye_corner"], offset, strict=True)
    )
    across, up = eye["eye_angle"]
    return eye | {
        "eye_focal": tuple(focal / 2.0 for focal in eye["eye_focal"]),
        "eye_angle": (2.0 * across, 2.0 * up),
        "eye_centre": centre,
        "eye_corner": (0, 0),
        "eye_size": size,
    }


def lens_uniforms(camera: Camera, lens: ArrayLike, seed: int) -> dict[str, object]:
    """Return the uniforms for rays that each have their own lens point.

    lens : (2,) in [0, 1), lens point of the path set; each pixel shifts it by numbers derived from the 32-bit seed
    """
    u, v = (int(x * 2.0**32) for x in np.asarray(lens, np.float64))
    return {"lens_point": (u, v), "lens_seed": seed, "lens": (camera.aperture_radius, 1.0 / camera.focus)}


def view_volume(camera: Camera, eye: dict[str, Any]) -> tuple[Float64, Float64]:
    """Return normals (P, 3) and offsets (P,) of the planes of a window's view volume.

    Points inside have normal . x > offset for all planes.

    eye : uniforms of the window. The volume is one pixel wider on each side than the window, for device rounding.
    """
    right, up, forward, position = (
        np.array(eye[name], np.float64) for name in ("eye_right", "eye_up", "eye_forward", "eye_position")
    )
    position = position - eye["eye_ahead"] * forward
    parallel = camera.projection == "orthographic"
    normals, offsets = [forward], [forward @ position]
    for axis, along in enumerate((right, up)):
        first = eye["eye_corner"][axis] + 0.5 - eye["eye_centre"][axis]
        focal = eye["eye_focal"][axis]
        low, high = (first - 1.5) / focal, (first + eye["eye_size"][axis] + 0.5) / focal
        both = [along, -along] if parallel else [along - low * forward, high * forward - along]
        normals += both
        offsets += [
            side @ position + (shift if parallel else 0.0) for side, shift in zip(both, (low, -high), strict=True)
        ]
    return np.array(normals), np.array(offsets)
