"""Form factors by the hemicube against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from glpath.buffers.hemicube_form_factor import HemicubeFormFactors, atlas_form_factors, scene_of_elements
from glpath.errors import UsageError
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.io import load_scene, scene_from_dict
from glpath.radiosity import Occluders, Visibility
from glpath.radiosity.form_factors.form_factor import FormFactors
from glpath.radiosity.mesh.mesh import Mesh, divisions_of_size, surfaces
from glpath.radiosity.mesh.sides import Sides
from glpath.scene import Scene
from tests.reference.closed_forms import facing_rectangles_form_factor, polygon_irradiance

Float64 = NDArray[np.float64]


def quads(*corners: Any) -> Scene:
    return scene_from_dict(
        {
            "camera": {"position": [0, 0, 5], "target": [0, 0, 0], "fov": 40},
            "shapes": [{"type": "quad", "corners": c, "emission": {"radiance": 1.0}} for c in corners],
        }
    )


def engine(scene: Scene, resolution: int = 256) -> HemicubeFormFactors:
    gl = get_context().gl
    return HemicubeFormFactors(gl, DeviceScene(gl, scene), resolution)


UP = np.array([0.0, 1.0, 0.0])
FLOOR = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], float)


@pytest.mark.parametrize("resolution", [2, 64])
def test_the_texels_of_a_hemicube_sum_to_one(resolution: int) -> None:
    factors = atlas_form_factors(resolution)
    assert factors.shape == (3 * resolution // 2, 2 * resolution)
    assert factors.sum() == pytest.approx(1.0, rel=1e-12)
    assert factors.min() > 0


def test_small_texels_are_the_papers_delta_form_factors() -> None:
    R = 128
    factors = atlas_form_factors(R)
    centre = (2 * np.arange(R) + 1) / R - 1
    x, y = np.meshgrid(centre, centre)
    area = (2 / R) ** 2
    np.testing.assert_allclose(factors[:R, :R], area / (np.pi * (x**2 + y**2 + 1) ** 2), rtol=1e-3)
    z = (2 * np.arange(R // 2) + 1) / R
    across, up = np.meshgrid(centre, z)
    side = up * area / (np.pi * (across**2 + up**2 + 1) ** 2)
    for rows, columns in ((0, R), (R // 2, R), (R, 0), (R, R)):  # the four sides, see shaders/shadow/hemicube.glsl
        np.testing.assert_allclose(factors[rows : rows + R // 2, columns : columns + R], side, rtol=1e-3)


def test_parallel_rectangles_are_howells_c_11() -> None:
    """1.5 x 1 at distance 0.7, within half a per cent at 256 texels and 64 points a triangle."""
    a, b, c = 1.5, 1.0, 0.7
    lower = np.array([[-a / 2, 0, b / 2], [a / 2, 0, b / 2], [a / 2, 0, -b / 2], [-a / 2, 0, -b / 2]])
    scene = quads(lower, (lower + np.array([0, c, 0]))[::-1])
    factors = engine(scene).from_triangles(scene.triangles[:2], samples=64)
    assert factors.sum(axis=1).mean() == pytest.approx(facing_rectangles_form_factor(a, b, c), rel=5e-3)
    assert np.all(factors[:, :2] == 0.0)


@pytest.mark.parametrize("degrees", [90.0, 60.0, 135.0])
def test_rectangles_at_an_angle_are_lamberts_formula(degrees: float) -> None:
    """Hinged at an edge (Howell C-14 where perpendicular), but a tenth apart: over points of the lower one."""
    angle = np.radians(degrees)
    along = np.array([0.0, np.sin(angle), np.cos(angle)])
    foot = np.array([[-1, 0, -1.1], [1, 0, -1.1]])
    wall = np.stack([foot[0], foot[1], foot[1] + 1.5 * along, foot[0] + 1.5 * along])
    scene = quads(FLOOR, wall)
    g, weight = np.polynomial.legendre.leggauss(12)
    points = np.array([[x, 0, z] for x in g for z in g])
    rows = engine(scene).rows(points, np.broadcast_to([0.0, 1.0, 0.0], points.shape))
    # The floor passes through the eye of each hemicube; nothing of it is seen.
    assert np.all(rows[:, :2] == 0.0)
    found = rows[:, 2:].sum(axis=1)
    truth = np.array([polygon_irradiance(p, (0, 1, 0), wall) for p in points]) / np.pi
    w = np.outer(weight, weight).ravel() / 4
    assert found @ w == pytest.approx(truth @ w, rel=1e-3)
    np.testing.assert_allclose(found, truth, atol=3e-3 * truth.max())


def test_what_stands_between_hides() -> None:
    lamp, shade = (FLOOR + UP * 2)[::-1], (0.4 * FLOOR + UP)[::-1]
    factors = engine(quads(lamp, shade)).rows([0, 0, 0], [0, 1, 0])[0]
    corners = [tuple(c) for c in 0.8 * FLOOR + UP * 2][::-1]  # the shade's shadow on the lamp
    hidden = polygon_irradiance((0, 0, 0), (0, 1, 0), corners) / np.pi
    whole = polygon_irradiance((0, 0, 0), (0, 1, 0), [tuple(c) for c in lamp]) / np.pi
    assert factors[2:].sum() == pytest.approx(hidden, rel=5e-3)
    assert factors[:2].sum() == pytest.approx(whole - hidden, rel=5e-3)


def test_rows_of_a_closed_room_sum_to_one_and_are_reciprocal() -> None:
    room = load_scene("furnace", {"subdivisions": 1})
    factors = engine(room).from_triangles(room.triangles, samples=16)
    np.testing.assert_allclose(factors.sum(axis=1), 1.0, atol=1e-3)
    exchange = room.areas[:, None] * factors
    seen = np.maximum(exchange, exchange.T) > 2e-3 * room.areas.sum()
    # Neighbours at an edge, whose form factor changes fast between the points, are the worst.
    assert np.abs(exchange / np.where(seen, exchange.T, 1.0) - 1.0)[seen].max() < 0.12
    assert np.abs(exchange - exchange.T).sum() / exchange.sum() < 0.02


def test_elements_stand_in_the_order_of_the_solution() -> None:
    from glpath.radiosity.mesh import lattice

    scene = load_scene("cornell-box-36")
    divisions = np.random.default_rng(1).integers(1, 4, len(scene.triangles)).astype(np.int32)
    fine = scene_of_elements(scene, divisions)
    first = lattice.starts(lattice.element_count(divisions))
    for t, n in enumerate(divisions):
        own = slice(int(first[t]), int(first[t + 1]))
        np.testing.assert_allclose(fine.areas[own], scene.areas[t] / n**2)
        assert {scene.triangle_shape[t]} == set(fine.triangle_shape[own].tolist())
        # The middle of element (i, j) below the diagonal lies at (i + 1/3, j + 1/3) of n.
        corner, edges = scene.triangles[t][0], scene.triangles[t][1:] - scene.triangles[t][0]
        last = lattice.element_index(n, 0, n - 1, 0)
        middle = corner + np.array([1 / 3, n - 2 / 3]) / n @ edges
        np.testing.assert_allclose(fine.triangles[own][int(last)].mean(axis=0), middle, atol=1e-12)


@pytest.mark.parametrize("resolution", [0, 7])
def test_a_hemicube_of_half_a_texel_is_refused(resolution: int) -> None:
    with pytest.raises(UsageError, match="even number"):
        engine(quads(FLOOR), resolution)


def test_samples_are_a_square_number() -> None:
    with pytest.raises(UsageError, match="5 samples"):
        engine(quads(FLOOR)).from_triangles(quads(FLOOR).triangles, samples=5)


@pytest.mark.parametrize(("kind", "most"), [("polygon", 0.02), ("disc", 0.05)])
def test_hemicubes_and_cast_rays_agree(kind: Any, most: float) -> None:
    """Between all elements of a box with blocks in it: 0.5 % for half of those above 0.01, 5 % for 95 in 100."""
    scene = load_scene("cornell-box-36")
    surface = surfaces(scene)
    divisions = divisions_of_size(scene, surface, 1.0)
    mesh = Mesh.uniform(scene, divisions, surface)
    sides = Sides.of(scene, mesh.patches)
    by_rays = FormFactors(
        scene, Visibility(Occluders.of_scene(scene), threads=1), mesh.patches, sides, kind=kind, together=16
    )
    at = by_rays.receivers(mesh.elements, sides)
    count = len(mesh.elements)
    cast = np.zeros((len(sides), count))
    for batch, (columns, _) in zip(
        by_rays.batches, by_rays.of_batches(range(len(by_rays.batches)), at), strict=True
    ):
        np.add.at(cast.T, sides.element[batch], columns)
    elements = scene_of_elements(scene, divisions.astype(np.int32))
    counted = engine(elements).from_triangles(
        elements.triangles[sides.element], np.where(sides.back, -1.0, 1.0), samples=4
    )
    # Points that lie in a solid, and the lamp's black back before the ceiling, are left out of the one engine.
    names = np.array([scene.shapes[shape].name for shape in elements.triangle_shape])
    compared = (at.open > 0.999)[:, None] & ~((names == "ceiling")[sides.element][:, None] & (names == "light"))
    difference = np.abs(counted - cast)
    share = (difference / np.maximum(cast, 1e-9))[compared & (cast > 0.01)]
    assert np.median(share) < 0.005
    assert np.quantile(share, 0.95) < 0.05
    assert difference[compared].sum() < 0.03 * cast[compared].sum()
    assert difference[compared].max() < most
