"""A room with a window under a sky: light that comes in through a small opening, by every method alike.

Paths are the witness.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rooms import cuboid, part, room
from scipy.spatial.transform import Rotation

import glpath
from glpath.radiosity.mesh.mesh import Elements, occluder_of_triangle
from glpath.radiosity.mesh.sides import Sides, open_points
from glpath.radiosity.shafts.occluders import Occluders
from glpath.scene import Scene, load_scene, path_traceable

SKY = 10.0


def boxes(t: float) -> list[tuple[list[float], list[float], str]]:
    """Corners and materials of walls of thickness t: 4 x 3 x 5 inside, a window of 2 x 1.2 in the wall at z = 2.5."""
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
    shapes: list[dict[str, Any]] = [
        {"type": "box", "min": a, "max": b, "material": m} for a, b, m in boxes(wall)
    ]
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


@pytest.mark.parametrize("ground", [0.0, 40.0])
def test_the_gather_of_a_windowed_room_has_the_light_of_paths(ground: float) -> None:
    """Few particles and few rays meet the window: 1 to 2 % of the light is missing where that is left to chance."""
    scene = windowed_room(ground)
    paths = glpath.render(scene, max_depth=1000, roulette=4, spp=2048)
    gathered = [glpath.render(scene, integrator="gather", spp=256, seed=seed) for seed in range(2)]
    mean = np.mean([film.mean.mean() for film in gathered])
    assert mean == pytest.approx(paths.mean.mean(), rel=0.01 if ground else 0.006)


@pytest.mark.parametrize("wall", [0.2, 0.8])
@pytest.mark.parametrize("turned", [False, True])
def test_a_wall_is_open_where_no_other_wall_stands_against_it(wall: float, turned: bool) -> None:
    """Boxes that touch have faces in one plane, and rays met either: a wall of 12 had 14.4 open, and was too dark."""
    turn = Rotation.from_rotvec([0.2, 0.5, -0.3]).as_matrix() if turned else np.eye(3)
    corners = [cuboid(a, b) @ turn.T for a, b, _ in boxes(wall)]
    scene = path_traceable(room(*(part(c.astype(np.float32).astype(float)) for c in corners)))
    elements = Elements.of_lattices(np.full(len(scene.triangles), 8))
    sides = Sides.of(scene, elements)
    occluders = Occluders.of_scene(scene)
    solid = occluders.solid[occluder_of_triangle(occluders.parallelogram)]
    _, share = open_points(scene, solid, elements, sides, 4)
    areas = share * (scene.areas[elements.triangle] / 64)[sides.element]
    shape = scene.triangle_shape[elements.triangle[sides.element]]
    outer = 4.0 + 2 * wall
    # By shape: inner and outer faces, and the ends that are not against another box.
    floor = 20.0 + outer * (5.0 + 2 * wall) + 2 * wall * (outer + 5.0 + 2 * wall)
    back = 12.0 + outer * 3.0 + 2 * wall * 3.0
    side = 15.0 + 15.0
    found = np.bincount(shape, areas)
    assert found[[0, 1, 2, 3, 4]] == pytest.approx([floor, floor, back, side, side], rel=0.005)
