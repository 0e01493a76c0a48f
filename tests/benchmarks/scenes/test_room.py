"""The furnished room: as many triangles as the paper's, and surfaces fit for radiosity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

import glpath
from benchmarks.scenes.room import ROOM
from benchmarks.scenes.room import room as made
from benchmarks.scenes.solids import arc, block, cushion, lines, moved, skin, turned
from glpath.errors import SceneError
from glpath.io import load_scene
from glpath.scene import Scene, Shape, check_scene, path_traceable


@pytest.fixture(scope="module")
def room() -> Scene:
    return load_scene("room")


def of_shape(scene: Scene, shape: Shape) -> np.ndarray:
    """Its triangles (T, 3, 3)."""
    return scene.triangles[scene.shapes.ranges[scene.shapes.index(shape)]]


def bottom(scene: Scene, name: str) -> float:
    """The lowest point of all shapes of the model whose names begin so, metres."""
    parts = [of_shape(scene, s) for s in scene.shapes if s.name.startswith(f"room/{name}-")]
    return float(np.concatenate(parts)[..., 1].min())


def test_it_has_as_many_triangles_as_the_papers_room(room: Scene):
    assert len(room.triangles) == 14920
    assert path_traceable(room) is room
    assert all(not m.two_sided and m.reflectance.max() < 0.9 for m in room.materials)
    assert sum(s.emits for s in room.shapes) >= 3
    assert check_scene(room) == []


def test_no_triangle_is_degenerate(room: Scene):
    edges = np.linalg.norm(np.roll(room.triangles, -1, axis=1) - room.triangles, axis=2)
    height = 2 * room.areas / edges.max(axis=1)
    assert height.min() > 1e-3  # a millimetre
    assert edges.max() < 2.2
    assert room.bounds[0][[0, 1]] == pytest.approx([0, 0])
    assert room.bounds[1] == pytest.approx(ROOM)


def test_furniture_stands_on_the_floor_and_things_on_furniture(room: Scene):
    for name in (
        "sofa",
        "armchair",
        "table",
        "chair-0",
        "chair-1",
        "chair-2",
        "torchere",
        "side-table",
        "bookcase",
    ):
        assert bottom(room, name) == pytest.approx(0, abs=1e-7), name
    rug = next(of_shape(room, s) for s in room.shapes if s.name == "room/rug-blue")[0, 0, 1]
    assert bottom(room, "coffee-table") == pytest.approx(rug)
    for thing, support in (("table-lamp", "side-table"), ("tall", "table"), ("clock", "mantel"), ("jar", "mantel")):
        parts = [s for s in room.shapes if s.name.removesuffix("-top").removesuffix("-body") == f"room/{support}"]
        tops = [of_shape(room, s)[:, :, 1].max() for s in parts]
        assert bottom(room, thing) == pytest.approx(max(tops)), thing


def nearest(triangles: np.ndarray, origins: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) the triangle that each ray meets first, -1 for none, and (N,) its distance [Möller, Trumbore 1997]."""
    a, e1, e2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(e1, e2)
    found, distance = np.full(len(ways), -1), np.full(len(ways), np.inf)
    for i, (origin, way) in enumerate(zip(origins, ways, strict=True)):
        facing = normal @ way
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.cross(a - origin, way)
            t = np.sum((a - origin) * normal, axis=1) / facing
            u, v = np.sum(e2 * across, axis=1) / facing, -np.sum(e1 * across, axis=1) / facing
        hit = (facing != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
        t = np.where(hit, t, np.inf)
        found[i] = np.argmin(t) if hit.any() else -1
        distance[i] = t.min()
    return found, distance


def test_nobody_in_the_room_sees_a_back_or_out_of_it(room: Scene):
    rng = np.random.default_rng(5)
    # Light on its way: from the eye, and from the fronts that are thus seen, twice.
    ways = rng.normal(size=(700, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.broadcast_to(room.camera.position, ways.shape)
    for bounce in range(3):
        which, distance = nearest(room.triangles, origins, ways)
        assert (which >= 0).all(), f"a hole is seen after {bounce} bounces"
        facing = np.sum(room.normals[which] * ways, axis=1)
        shapes = {room.shapes[room.triangle_shape[w]].name for w in which[facing > 0]}
        assert not shapes, f"backs are seen after {bounce} bounces"
        normals = room.normals[which]
        origins = origins + distance[:, None] * ways + 1e-5 * normals
        ways = normals + 0.999 * on_sphere(rng, len(ways))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)


def on_sphere(rng: np.random.Generator, count: int) -> np.ndarray:
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_no_two_surfaces_coincide(room: Scene):
    corners, normals = room.triangles, room.normals
    first = np.take_along_axis(normals, np.argmax(np.abs(normals) > 0.3, axis=1)[:, None], axis=1)
    way = normals * np.sign(first)
    planes = np.column_stack([way, np.sum(way * corners[:, 0], axis=1)])
    # Seven points within each triangle: its middle, and others towards corners and edges.
    weights = np.array([[1, 1, 1], [8, 1, 1], [1, 8, 1], [1, 1, 8], [1, 6, 6], [6, 1, 6], [6, 6, 1]], float)
    points = np.einsum("ki,nij->nkj", weights / weights.sum(axis=1, keepdims=True), corners)
    near = cKDTree(planes).query_pairs(1e-4, output_type="ndarray")
    near = np.concatenate([near, near[:, ::-1]])
    low, high = corners.min(axis=1) - 1e-4, corners.max(axis=1) + 1e-4
    near = near[((low[near[:, 0]] <= high[near[:, 1]]) & (low[near[:, 1]] <= high[near[:, 0]])).all(axis=1)]
    a, b = near.T
    edges = np.roll(corners[a], -1, axis=1) - corners[a]
    inside = np.ones((len(a), len(weights)), bool)
    for k in range(3):
        side = np.einsum("nkj,nj->nk", np.cross(edges[:, None, k], points[b] - corners[a, None, k]), normals[a])
        inside &= side > 1e-9
    both = {(room.shapes[room.triangle_shape[x]].name, room.shapes[room.triangle_shape[y]].name)
            for x, y in near[inside.any(axis=1)]}  # fmt: skip
    assert not both


def test_detail_divides_finer_and_keeps_the_shape(room: Scene):
    coarse, fine = made(0.25), made(4.0)
    assert len(coarse.triangles) < 0.7 * len(room.triangles)
    assert len(fine.triangles) == 34696  # as its docstring says
    for other in (coarse, fine):
        assert [f"room/{s.name}" for s in other.shapes] == [s.name for s in room.shapes]
        assert other.areas.sum() == pytest.approx(room.areas.sum(), rel=0.02)
        assert other.areas.min() > 0
        assert other.bounds[1] == pytest.approx(ROOM)
    with pytest.raises(SceneError, match="detail"):
        load_scene("room", {"detail": 4})  # what ships is a file


def test_paths_that_share_directions_lose_few_rays(room: Scene):
    film = glpath.render(room.with_camera(resolution=(64, 64)), spp=8, max_depth=3, integrator="path-buffer")
    statistics = film.metadata.statistics
    assert statistics["paths_lost"] < 0.2 * statistics["paths_cast"]
    assert statistics["dropped_samples"] == 0
    assert film.mean.mean() > 0.05
    assert (film.mean.max(axis=2) > 0).mean() > 0.99


# The solids that it is made of


def volume(corners: np.ndarray) -> float:
    """Of a closed surface, fronts outward: the sum of the tetrahedra to the origin."""
    return float(np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])) / 6)


def is_closed(corners: np.ndarray) -> bool:
    """Whether every edge is run through as often forwards as backwards."""
    points, which = np.unique(corners.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    faces = which.reshape(-1, 3)
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    count = np.zeros((len(points),) * 2, int)
    np.add.at(count, (edges[:, 0], edges[:, 1]), 1)
    return bool((count == count.T).all())


def test_solids_are_closed_with_their_fronts_outward():
    box = block((-1, 0, 2), (1, 3, 4), 0.7)
    assert is_closed(box)
    assert volume(box) == pytest.approx(2 * 3 * 2)
    cone = turned([(0, 0), (1, 0), (0, 2)], 360)
    assert is_closed(cone)
    assert volume(cone) == pytest.approx(np.pi * 2 / 3, rel=1e-3)
    pillow = cushion((1, 0.5, 0.8), 0.1, 4, 0.3)
    assert is_closed(pillow)
    assert 0.9 * 0.4 < volume(pillow) < 0.4
    assert volume(cushion((1, 0.5, 0.8), 0.1, 4, 0.3, crown=0.05)) > volume(pillow)
    assert not is_closed(block((0, 0, 0), (1, 1, 1), without="-y"))
    turned_box = moved(box, (1, 2, 3), turn=30, lean=20, roll=10)
    assert volume(turned_box) == pytest.approx(volume(box))


def test_a_turn_is_counterclockwise_seen_against_its_axis():
    x = np.array([[[1.0, 0, 0]] * 3])
    assert moved(x, turn=90)[0, 0] == pytest.approx([0, 0, -1], abs=1e-12)
    assert moved(x, roll=90)[0, 0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert moved(np.array([[[0, 1.0, 0]] * 3]), lean=90)[0, 0] == pytest.approx([0, 0, 1], abs=1e-12)


def test_lines_meet_the_cuts_and_leave_no_part_too_long():
    found = lines(0, 2, 0.3, [0.5, 0.5 + 1e-12, 1.9, -1, 3])
    assert {0.0, 0.5, 1.9, 2.0} <= set(found)
    assert (np.diff(found) > 0.05).all()
    assert (np.diff(found) <= 0.3 + 1e-9).all()


def test_an_arc_bows_to_the_outside():
    points = np.array(arc((1, 0), (1, 2), 0.1, 4))
    assert points[[0, -1]] == pytest.approx(np.array([[1, 0], [1, 2]]))
    assert points[2] == pytest.approx([1.2, 1])
    ring = skin([[(1, 0, 0), (0, 0, -1), (-1, 0, 0), (0, 0, 1)], [(0, 1, 0)] * 4])
    assert len(ring) == 4  # a pyramid without its ground
