"""Work before the first path set checks the time limit between its parts, also for a large mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.apps.lightmap.atlas import _parts
from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.errors import TimeLimitError
from glpath.gl.ray_bvh import _items
from glpath.radiosity.mesh.mesh import size_for_count, surfaces
from glpath.radiosity.solvers.checks import check_solvable
from glpath.rendering.choice import chosen
from glpath.rendering.solids import Closed
from glpath.scene import Scene
from glpath.scene.patches import Patches, diced
from glpath.scene.pieces import pieces
from glpath.system.time_limit import limited, named_work
from tests.support.check_gaps import check_gaps, grid
from tests.support.clock import Clock

#: Largest fraction of the time of a part that may pass between two checks.
LARGEST_GAP = 0.7


def scene_of(side: int) -> Scene:
    vertices, faces = grid(side)
    return glpath.load_scene(
        {
            "camera": {"position": [0, 3, 4], "target": [0, 0, 0], "fov": 45},
            "materials": {"a": {"reflectance": 0.5}},
            "sky": {"zenith": [1, 1, 1], "horizon": [1, 1, 1]},
            "shapes": [{"type": "mesh", "material": "a", "vertices": vertices, "faces": faces}],
        }
    )


def size_of_elements(scene: Scene) -> None:
    size_for_count(scene, np.arange(len(scene.triangles)), 1000, by_size=True)


def divide(level: int) -> None:
    net = np.stack([*np.meshgrid(*2 * [np.arange(6.0)], indexing="ij"), np.zeros((6, 6))], axis=-1)
    patches = Patches.bspline(net)
    diced(patches, patches.levels(level), lambda uv: np.sin(uv[:, 0]))


PARTS: dict[str, Callable[[Scene], Any]] = {
    "pieces": lambda scene: pieces(scene.triangles),
    "closed surfaces": Closed.of,
    "patches of the atlas": lambda scene: _parts(scene, np.ones((len(scene.triangles), 2))),
    "smooth surfaces": surfaces,
    "reflecting sides": check_solvable,
    "divided patches": lambda scene: divide(int(np.sqrt(len(scene.triangles) / 8))),
    "size of elements": size_of_elements,
    "items of the BVH": lambda scene: _items(scene.triangles),
}


@pytest.mark.parametrize("part", PARTS)
def test_work_on_a_large_mesh_checks_the_time_limit_between_its_parts(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    PARTS[part](scene_of(2))  # imports modules
    scene = scene_of(224)
    scene.triangles.sum()
    with named_work("a test"), check_gaps(monkeypatch) as gaps:
        PARTS[part](scene)
    assert max(gaps) < LARGEST_GAP * sum(gaps)


def test_pieces_are_numbered_in_the_order_of_their_lowest_corners() -> None:
    corners = np.random.default_rng(3).integers(0, 40, (300, 3, 3)).astype(np.float64)
    _, which = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    found = pieces(corners)
    first = [which.reshape(-1, 3)[found == number].min() for number in range(found.max() + 1)]
    assert first == sorted(first)


@pytest.mark.parametrize(
    ("call", "work"),
    [
        (lambda scene: AtlasSurfaces.of(scene, size=64), "finding the sides that get texels"),
        (lambda scene: glpath.solve_radiosity(scene, patches=8), "meshing the scene for its radiosity"),
        (lambda scene: chosen("auto", {}, scene), "preparing the scene"),
    ],
)
def test_preparation_that_exceeds_the_limit_is_named(
    call: Callable[[Scene], Any], work: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, clock = scene_of(2), Clock(monkeypatch)
    with limited(1.0):
        clock.ahead = 2.5
        with pytest.raises(TimeLimitError, match=f"time_limit=1: over while {work}, before"):
            call(scene)
