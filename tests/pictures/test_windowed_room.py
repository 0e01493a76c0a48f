"""A room with a window under a sky: light that comes in through a small opening, by every method alike.

Paths are the witness.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import glpath
from glpath.film.film import Film
from glpath.film.noise import standard_error
from glpath.io import load_scene
from glpath.radiosity.form_factors.lights import DirectLight
from glpath.radiosity.mesh.mesh import Elements, occluder_of_triangle
from glpath.radiosity.mesh.sides import Sides, Solids
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.solvers.solve import solve_radiosity
from glpath.scene import Scene, path_traceable
from glpath.scene.model import Float64
from tests.support.rooms import cuboid, part, room

SKY = 10.0


def boxes(t: float) -> list[tuple[list[float], list[float], str]]:
    """Corners and materials of walls of thickness t: 4 x 3 x 5 inside, a window of 2 x 1.2 in that at z = 2.5."""
    x, y, z = 2.0, 3.0, 2.5
    window = (-1.0, 1.0, 1.0, 2.2)
    return [
        ([-x - t, -t, -z - t], [x + t, 0, z + t], "floor"),
        ([-x - t, y, -z - t], [x + t, y + t, z + t], "wall"),
        ([-x - t, 0, -z - t], [x + t, y, -z], "wall"),
        ([-x - t, 0, -z], [-x, y, z], "wall"),
        ([x, 0, -z], [x + t, y, z], "wall"),
        ([-x - t, 0, z], [window[0], y, z + t], "wall"),
        ([window[1], 0, z], [x + t, y, z + t], "wall"),
        ([window[0], 0, z], [window[1], window[2], z + t], "wall"),
        ([window[0], window[3], z], [window[1], y, z + t], "wall"),
    ]


def windowed_room(ground: float = 0.0, wall: float = 0.2) -> Scene:
    """A room of such boxes under a sky, on a ground of half this size."""
    shapes: list[dict[str, Any]] = [{"type": "box", "min": a, "max": b, "material": m} for a, b, m in boxes(wall)]
    if ground:
        g, low = ground, -wall - 0.01
        corners = [[-g, low, g], [g, low, g], [g, low, -g], [-g, low, -g]]
        shapes.append({"type": "quad", "corners": corners, "material": "ground"})
    return load_scene(
        {
            "camera": {"position": [0, 1.5, -2.3], "target": [0, 1.2, 2], "fov": 80},
            "film": {"resolution": [48, 48]},
            "materials": {
                "wall": {"reflectance": 0.7},
                "floor": {"reflectance": 0.4},
                "ground": {"reflectance": 0.2},
            },
            "shapes": shapes,
            "sky": {"zenith": SKY, "horizon": SKY},
        }
    )


def noise_of_mean(film: Film) -> float:
    """The standard error of a picture's mean radiance by its path sets."""
    return float(standard_error(film.radiance_sums.mean(axis=(1, 2, 3)), film.batch_counts))


@pytest.mark.parametrize("ground", [pytest.param(0.0, marks=pytest.mark.evidence), 40.0])
def test_the_gather_of_a_windowed_room_has_the_light_of_paths(ground: float) -> None:
    """Few particles and few rays meet the window: 1 to 2 % of the light is missing where that is left to chance."""
    scene = windowed_room(ground)
    paths = glpath.render(scene, max_depth=1000, roulette=4, spp=2048)
    gathered = glpath.render(scene, integrator="gather", spp=512)
    noise = np.hypot(noise_of_mean(paths), noise_of_mean(gathered))
    found, true = gathered.mean.mean(), paths.mean.mean()
    assert noise < 0.0025 * true
    assert abs(found - true) < 0.005 * true + 2 * noise


@pytest.mark.evidence
@pytest.mark.parametrize(("ground", "wall"), [(0.0, 0.8), (40.0, 0.2)])
def test_solutions_of_a_windowed_room_are_right_in_the_mean_and_say_how_far_each_is_off(
    ground: float, wall: float
) -> None:
    scene = windowed_room(ground, wall)
    paths = glpath.render(scene, max_depth=1000, roulette=4, spp=2048)
    true, means, told = paths.mean.mean(), [], []
    for seed in range(6):
        solution = solve_radiosity(
            scene, method="monte-carlo", patches=500, particles=1 << 18, for_camera=True, seed=seed
        )
        film = glpath.render(scene, integrator="gather", radiosity=solution, spp=256, seed=seed)
        means.append(film.mean.mean())
        told.append(np.hypot(solution.statistics["view_error"], noise_of_mean(film)))
    spread = float(np.std(means, ddof=1))
    assert abs(np.mean(means) - true) < 0.005 * true + 2 * np.hypot(spread / 6**0.5, noise_of_mean(paths))
    # A few particles that carry much are rare, and so in few errors.
    assert 0.4 * spread < np.sqrt(np.mean(np.square(told))) < 2.5 * spread


def test_a_gather_states_the_error_of_its_solution() -> None:
    """More path sets lower the noise; what the solution has wrong stays, and is stated."""
    scene = windowed_room(40.0)
    many = glpath.render(scene, integrator="gather", spp=64, resolution=(16, 16))
    assert many.metadata.solution_error is not None
    assert many.metadata.solution_error > 0
    own = many.solution_error()
    assert own is not None
    noise = np.sqrt(np.mean(many.variance_of_mean() / (many.mean**2 + 0.01)))
    assert many.relative_error() == pytest.approx(np.hypot(noise, own))
    assert own == pytest.approx(many.metadata.solution_error / many.mean.mean(), rel=0.5)
    # Nobody knows that of a solution that is given, and paths have none.
    solution = solve_radiosity(scene, method="monte-carlo", patches=100, particles=1)
    given = glpath.render(scene, integrator="gather", radiosity=solution, spp=16, resolution=(16, 16))
    assert given.solution_error() is None
    assert glpath.render(scene, spp=1, resolution=(16, 16)).solution_error() is None


def test_rays_to_the_sky_are_aimed_at_a_window() -> None:
    """64 rays from a point by the cosine left single elements off by a fifth; many rays are the witness."""
    scene = path_traceable(windowed_room())
    elements = Elements.of_lattices(np.full(len(scene.triangles), 2))
    sides, points, areas = open_sides(scene, elements)
    inside = np.all(np.abs(points.mean(axis=1) - [0.0, 1.5, 0.0]) < np.array([2.0, 1.5, 2.5]) + 1e-6, axis=1)
    light = DirectLight(scene)
    triangle = elements.triangle[sides.element]
    number = np.repeat(np.arange(len(sides)), 4)
    found = light.of_sides(sides, triangle, points.reshape(-1, 3), number, 4)[:, 0]
    some = np.flatnonzero(inside & (areas > 0))
    of = np.repeat(some, 4)
    at, random = points[some].reshape(-1, 3), np.random.default_rng(1)
    true = light.estimate(at, sides.normal[of], triangle[of], random, 48 * 48)[:, 0].reshape(-1, 4).mean(axis=1)
    assert found[some] @ areas[some] == pytest.approx(true @ areas[some], rel=0.015)
    off = found[some] - true
    assert np.sqrt(np.mean(off**2)) < 0.1 * true.mean()


def open_sides(scene: Scene, elements: Elements) -> tuple[Sides, Float64, Float64]:
    """Sides of elements, points on what of each is not buried, and how large that is."""
    sides = Sides.of(scene, elements)
    occluders = Occluders.of_scene(scene)
    solid = occluders.solid[occluder_of_triangle(occluders.parallelogram)]
    points, share = Solids.of(scene, solid).open_points(elements, sides, 4)
    return sides, points, share * (scene.areas[elements.triangle] / elements.n**2)[sides.element]


@pytest.mark.parametrize("wall", [0.2, 0.8])
@pytest.mark.parametrize("turned", [False, True])
def test_a_wall_is_open_where_no_other_wall_stands_against_it(wall: float, turned: bool) -> None:
    """Boxes that touch have faces in one plane, and rays met either: a wall of 12 had 14.4 open; too dark."""
    turn = Rotation.from_rotvec([0.2, 0.5, -0.3]).as_matrix() if turned else np.eye(3)
    corners = [cuboid(a, b) @ turn.T for a, b, _ in boxes(wall)]
    scene = path_traceable(room(*(part(c.astype(np.float32).astype(float)) for c in corners)))
    elements = Elements.of_lattices(np.full(len(scene.triangles), 8))
    sides, _, areas = open_sides(scene, elements)
    shape = scene.triangle_shape[elements.triangle[sides.element]]
    outer = 4.0 + 2 * wall
    # By shape: inner and outer faces, and the ends that are not against another box.
    floor = 20.0 + outer * (5.0 + 2 * wall) + 2 * wall * (outer + 5.0 + 2 * wall)
    back = 12.0 + outer * 3.0 + 2 * wall * 3.0
    side = 15.0 + 15.0
    found = np.bincount(shape, areas)
    assert found[[0, 1, 2, 3, 4]] == pytest.approx([floor, floor, back, side, side], rel=0.005)
