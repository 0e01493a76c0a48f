"""Points that see out along shared directions: against every triangle asked in numpy, against scans and Embree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.benches.parallel_rays import neighbouring
from benchmarks.scenes.city import City
from glpath.buffers.path_buffer import PathBuffer
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.parallel_rays import ParallelRays, along_z_curve
from glpath.gl.ray_bvh import RayBvh
from glpath.io import scene_from_dict
from glpath.scene import Scene
from tests.reference.numpy_path_tracer import nearest_hits

Float64 = NDArray[np.float64]
GLASS = {"type": "principled", "reflectance": 1, "roughness": 0, "transmission": 1, "thin": True}
UP = np.array([0.0, 0.0, 1.0])


def bits(scene: Scene, points: Float64, normals: Float64, directions: Float64) -> NDArray[np.bool_]:
    """(D, N)"""
    gl = get_context().gl
    device = DeviceScene(gl, scene)
    with ParallelRays(gl, device, RayBvh(gl, device), points, normals) as rays:
        words = np.stack([each.word for each in rays.see_out(directions)])
    found = words[:, None] >> np.arange(32, dtype=np.uint32)[None, :, None] & np.uint32(1)
    return found.reshape(-1, len(points))[: len(directions)].astype(np.bool_)


def test_points_see_what_asking_every_triangle_finds() -> None:
    city = City.of(300)
    points = city.points(150) + 1e-4 * UP
    directions = neighbouring(45)
    found = bits(city.scene, points, np.broadcast_to(UP, points.shape), directions)
    expected = np.stack(
        [nearest_hits(city.triangles, points, np.broadcast_to(d, points.shape))[0] < 0 for d in directions]
    )
    assert 0.2 < expected.mean() < 0.8
    # 6,750 rays, of which none passes an edge as near as rounding.
    assert np.count_nonzero(found != expected) == 0


def test_directions_behind_a_point_are_not_cast_but_where_it_has_no_plane() -> None:
    city = City.of(10)
    above = np.array([[0.0, 0.0, 9.0]])
    directions = np.array([[0.0, 0.0, 1.0], [0.05, 0.0, -0.9987], [0.999, 0.0, -0.0447]])
    assert bits(city.scene, above, UP[None], directions)[:, 0].tolist() == [True, False, False]
    assert bits(city.scene, above, np.zeros((1, 3)), directions)[:, 0].tolist() == [True, False, True]


@pytest.mark.parametrize("count", [1, 5, 70_000])
def test_every_number_of_points_keeps_their_order(count: int) -> None:
    """Over several squares, too: a wall hides the east from points west of it."""
    wall = np.array([[[0.0, -9, 0], [0, 9, 0], [0, 9, 9]], [[0.0, -9, 0], [0, 9, 9], [0, -9, 9]]])
    scene = scene_from_dict(
        {
            "camera": {"position": [0, 0, 9], "target": [0, 0, 0]},
            "shapes": [{"type": "mesh", "vertices": wall.reshape(-1, 3), "faces": np.arange(6).reshape(2, 3)}],
            "sky": {"zenith": 1.0, "horizon": 1.0},
        }
    )
    points = np.random.default_rng(1).uniform([-1, -1, 0.1], [1, 1, 1], (count, 3))
    found = bits(scene, points, np.zeros((count, 3)), np.array([[1.0, 0, 0], [-1.0, 0, 0]]))
    assert np.array_equal(found[0], points[:, 0] > 0)
    assert np.array_equal(found[1], points[:, 0] < 0)


def test_scans_find_the_same() -> None:
    city = City.of(2_000)
    points = city.points(3_000) + 1e-4 * UP
    directions = neighbouring(4)
    found = bits(city.scene, points, np.broadcast_to(UP, points.shape), directions)
    gl = get_context().gl
    buffer = PathBuffer(gl, DeviceScene(gl, city.scene), (64, 48), occlusion=True)
    blocked = np.stack([buffer.blocked(points, d) for d in directions])
    # Edges are a little wider for rays.
    assert np.count_nonzero(found == blocked) <= 6


def test_embree_finds_the_same() -> None:
    pytest.importorskip("embreex")
    from benchmarks.peers.embree import embreex_triangles

    city = City.of(2_000)
    points = city.points(500) + 1e-4 * UP
    directions = neighbouring(16)
    found = bits(city.scene, points, np.broadcast_to(UP, points.shape), directions)
    nearest = embreex_triangles(city.triangles)
    expected = np.stack(
        [nearest(points.astype(np.float32), np.tile(d, (500, 1)).astype(np.float32)) < 0 for d in directions]
    )
    assert np.count_nonzero(found != expected) <= 4


def test_thin_glass_lets_its_share_through() -> None:
    pane = [[0.5, -9, -9], [0.5, 9, -9], [0.5, 9, 9], [0.5, -9, 9]]
    scene = scene_from_dict(
        {
            "camera": {"position": [0, 0, 9], "target": [0, 0, 0]},
            "materials": {"glass": GLASS},
            "shapes": [{"type": "quad", "corners": pane, "material": "glass"}],
            "sky": {"zenith": 1.0, "horizon": 1.0},
        }
    )
    gl = get_context().gl
    device = DeviceScene(gl, scene)
    directions = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    with ParallelRays(gl, device, RayBvh(gl, device), np.zeros((3, 3)), np.zeros((3, 3))) as rays:
        assert rays.transmits
        seen = next(iter(rays.see_out(directions)))
    assert seen.share is not None
    assert seen.word.tolist() == [3, 3, 3]
    assert np.allclose(seen.share[:2], [[0.96], [1.0]], atol=2e-3)


def test_a_z_curve_visits_neighbours_one_after_the_other() -> None:
    points = np.random.default_rng(0).random((4096, 3))
    order = along_z_curve(points)
    assert sorted(order.tolist()) == list(range(4096))
    step = np.linalg.norm(np.diff(points[order], axis=0), axis=1).mean()
    assert step < 0.2 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
