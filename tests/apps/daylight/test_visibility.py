"""Points of streamed triangles see what they see of the same triangles in memory, in one pass over the stream."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.benches.parallel_rays import neighbouring
from glpath.apps.daylight import kept_words
from glpath.apps.daylight.compute import DaylightProgress, daylight_coefficients
from glpath.apps.daylight.visibility import visible
from glpath.errors import ImageError, SceneError, SceneWarning, UsageError
from glpath.gl import stream_parts
from glpath.gl.streamed_rays import meets
from tests.gl.test_streams import SKY, corners, in_memory, scene_of
from tests.support.terrain import Hills

DIRECTIONS = neighbouring(40) @ np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
PANE = {
    "type": "quad",
    "corners": [[-1, 1.5, -1], [1, 1.5, -1], [1, 1.5, 1], [-1, 1.5, 1]],
    "material": "glass",
}
GLASS = {"type": "principled", "reflectance": 1, "roughness": 0, "transmission": 1, "thin": True}


class Counted(Hills):
    """Hills that know how often their chunks were read."""

    reads = 0

    def chunk(self, index: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        self.reads += 1
        return super().chunk(index)


def points_of(hills: Hills, each: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """In the middles of triangles, and their normals."""
    triangles = corners(hills)[::each]
    return triangles.mean(axis=1), np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def both(hills: Hills, **more: Any) -> tuple[Any, Any]:
    """The hills as a stream and in memory."""
    memory = {"type": "mesh", **in_memory(corners(hills))}
    return scene_of({"type": "stream", "stream": hills}, **more), scene_of(memory, **more)


@pytest.mark.parametrize("many", [0, 10**6], ids=["compiled", "interpreted"])
@pytest.mark.parametrize("receiver", ["plane", "sphere"])
def test_points_of_a_stream_see_what_they_see_of_the_same_in_memory(
    monkeypatch: pytest.MonkeyPatch, many: int, receiver: Any
) -> None:
    monkeypatch.setattr(stream_parts, "_MANY", many)
    hills = Counted(4, 12)
    points, normals = points_of(hills, 9)
    scenes = both(hills, **SKY)
    hills.reads = 0
    streamed, rays = (
        np.stack(list(visible(scene, points, normals, DIRECTIONS, receiver=receiver, geometry_budget=1)))
        for scene in scenes
    )
    assert 0.2 < rays.mean() < 0.99
    assert hills.reads == len(hills)  # all directions in one pass, in three parts
    # The same rays meet the same corners. None lies on an edge, where the trees' boxes could make a difference.
    assert np.array_equal(streamed, rays)


def test_a_stream_alone_is_a_scene() -> None:
    hills = Hills(2, 12)
    points, normals = points_of(hills, 5)
    scene = {"camera": {"position": [0, 3, 6], "target": [0, 0, 0]}, **SKY}
    alone = {**scene, "shapes": [{"type": "stream", "stream": hills}]}
    memory = {**scene, "shapes": [{"type": "mesh", **in_memory(corners(hills))}]}
    streamed, rays = (np.stack(list(visible(each, points, normals, DIRECTIONS))) for each in (alone, memory))
    assert 0.3 < rays.mean() < 0.99
    assert np.array_equal(streamed, rays)


def test_streamed_hills_stand_behind_glass_that_is_in_memory() -> None:
    hills = Hills(2, 8)
    points, normals = points_of(hills, 7)
    shapes = {"materials": {"grass": {"reflectance": 0.5}, "clay": {"reflectance": 0.3}, "glass": GLASS}}
    streamed, rays = (
        daylight_coefficients({**scene, "shapes": [PANE, hill]}, points, normals, samples=2, max_depth=1)
        for scene, hill in (
            (
                {"camera": {"position": [0, 3, 6], "target": [0, 0, 0]}, **shapes},
                {"type": "stream", "stream": hills},
            ),
            (
                {"camera": {"position": [0, 3, 6], "target": [0, 0, 0]}, **shapes},
                {"type": "mesh", **in_memory(corners(hills))},
            ),
        )
    )
    assert rays.shares is not None
    assert streamed.shares is not None
    assert np.count_nonzero((rays.shares > 0) & (rays.shares < 1)) > 0
    assert np.array_equal(streamed.words, rays.words)
    assert np.array_equal(streamed.shares, rays.shares)


def test_a_pass_that_is_interrupted_resumes_with_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_words, "_PASS_SECONDS", 0.0)
    hills, part = Counted(4, 12), tmp_path / "part"
    points, normals = points_of(hills, 9)
    scene = scene_of({"type": "stream", "stream": hills}, **SKY)
    whole = daylight_coefficients(scene, points, normals, samples=2, max_depth=1)

    def stop(progress: DaylightProgress) -> None:
        assert (progress.stage, progress.total) in (("stream", 16), ("building the BVH", 322))
        if progress.stage == "stream" and progress.done > 10:
            raise KeyboardInterrupt

    given: dict[str, Any] = {"samples": 2, "max_depth": 1, "resume": part}
    with pytest.raises(KeyboardInterrupt):
        daylight_coefficients(scene, points, normals, **given, geometry_budget=1, on_progress=stop)
    with pytest.raises(ImageError, match="other sensors"):
        daylight_coefficients(scene, points[:9], normals[:9], **given)
    hills.reads = 0
    # With another budget, too: parts are not what is kept.
    again = daylight_coefficients(scene, points, normals, **given)
    assert hills.reads == 16 - 15
    assert not part.exists()
    assert np.array_equal(again.words, whole.words)


def test_a_stream_has_direct_light_alone_and_chunks_within_the_budget() -> None:
    scene = scene_of({"type": "stream", "stream": Hills(1, 64)}, **SKY)
    point: Any = ([[0.0, 2.0, 0.0]], [0.0, 1.0, 0.0])
    with pytest.warns(SceneWarning, match="direct light alone"):
        assert daylight_coefficients(scene, *point, samples=1).indirect is None
    with pytest.raises(SceneError, match="max_depth is 3"):
        daylight_coefficients(scene, *point, max_depth=3)
    with pytest.raises(UsageError, match=r"1 MiB, but 8 are needed for a chunk of 8,192 triangles"):
        daylight_coefficients(scene, *point, max_depth=1, geometry_budget=1)


def test_rays_that_meet_a_box_are_those_that_a_fine_march_finds_in_it() -> None:
    rng = np.random.default_rng(3)
    directions = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(200, 3))])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    steps = np.linspace(0.0, 6.0, 6001)[:, None, None] * directions
    for lower, upper in (([0.5, -0.3, -1.0], [1.5, 0.4, 0.2]), ([-1, -1, -1], [1, 1, 1]), ([-2, 1, 1], [-1, 2, 3])):
        low, high = np.array(lower, float), np.array(upper, float)
        marched = ((steps >= low) & (steps <= high)).all(axis=2).any(axis=0)
        found = meets(low, high, directions)
        assert not np.any(marched & ~found)
        # A march may step over a corner, but not over one that is cut a thousandth deep.
        assert not np.any(meets(low + 1e-3, high - 1e-3, directions) & ~marched)
