"""Faces of files, and polygons with holes, as triangles: the area is that of the rings, each point covered once."""

from __future__ import annotations

import time
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from glpath import load_scene
from glpath.errors import SceneWarning
from glpath.io.completed import aside
from glpath.io.polygons import limited_polygons, polygon_normal, split_polygons, triangulated
from glpath.scene.model import Mesh


def turned(points: np.ndarray, seed: int) -> np.ndarray:
    """Points of a plane (N, 2), somewhere in space."""
    frame = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    frame *= np.linalg.det(frame)
    return np.column_stack([points, np.zeros(len(points))]) @ frame.T + [3, -2, 5]


def areas(vertices: np.ndarray, faces: np.ndarray, normal: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a) @ normal


@pytest.mark.parametrize("seed", range(8))
def test_stars_with_holes_keep_their_area_and_side(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 17))
    star = rng.uniform(2, 5, 17)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    square = np.array([[-0.4, -0.3], [0.5, -0.3], [0.5, 0.4], [-0.4, 0.4]])
    boundary, hole = turned(star, seed), turned(square[:: rng.choice([1, -1])], seed)
    vertices, faces, missing = triangulated(boundary, [hole])
    normal = polygon_normal(boundary)
    size = np.linalg.norm(normal)
    found = areas(vertices, faces, normal / size)
    assert found.min() > 0
    assert found.sum() == pytest.approx(0.5 * size - 0.63)
    assert missing == pytest.approx(0, abs=1e-9)


def test_holes_may_touch_the_edge_and_each_other() -> None:
    wall = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]])
    door = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 2], [0, 0, 2.0]])
    window = np.array([[1, 0, 1], [3, 0, 1], [3, 0, 2], [1, 0, 2.0]])
    vertices, faces, missing = triangulated(wall, [door, window])
    found = areas(vertices, faces, np.array([0, -1, 0.0]))
    assert found.sum() == pytest.approx(12 - 2 - 2)
    assert missing == pytest.approx(0)
    middles = vertices[faces].mean(axis=1)
    assert not ((middles[:, 0] < 1) & (middles[:, 2] < 2)).any()


def test_a_hole_that_leaves_the_polygon_is_missed() -> None:
    wall = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]])
    window = np.array([[3, 0, 1], [5, 0, 1], [5, 0, 2], [3, 0, 2.0]])
    assert abs(triangulated(wall, [window])[2]) > 0.5


def test_a_line_has_no_triangles() -> None:
    vertices, faces, missing = triangulated(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]))
    assert len(vertices) == len(faces) == missing == 0


def star(corners: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(corners) / corners
    radius = np.where(np.arange(corners) % 2 == 0, 2.0, 0.65)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


L = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2.0]])
#: Outlines in a plane, and their areas by the shoelace formula.
OUTLINES = {
    "l": (L, 3.0),
    "star": (star(200), 4.0833987),
    "arrow": (np.array([[0, 0], [2, 1], [0, 2], [1, 1.0]]), 1.0),
    "convex": (star(200)[::2], 200 * np.sin(2 * np.pi / 100)),
    "corner in the middle of an edge": (np.array([[0, 0], [1, 0], [2, 0], [2, 1], [0, 1.0]]), 2.0),
}


def written(folder: Path, suffix: str, points: np.ndarray) -> Path:
    """A file with one face that has all the points as corners, in order."""
    path, numbers = folder / f"a.{suffix}", range(len(points))
    rows = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    face = f"{len(points)} {' '.join(map(str, numbers))}\n"
    match suffix:
        case "obj":
            text = (
                "".join(f"v {row}\n" for row in rows.splitlines()) + f"f {' '.join(str(i + 1) for i in numbers)}\n"
            )
        case "off":
            text = f"OFF\n{len(points)} 1 0\n{rows}{face}"
        case "ply":
            text = (
                f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty double x\nproperty double y\n"
                f"property double z\nelement face 1\nproperty list int int vertex_indices\nend_header\n{rows}{face}"
            )
        case _:
            text = f'[[shapes]]\ntype = "mesh"\nvertices = {points.tolist()}\nfaces = [{list(numbers)}]\n'
    path.write_text(text)
    return path


@pytest.mark.parametrize("suffix", ["obj", "off", "toml"])
@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("first", [0, 1, 3])
def test_a_face_of_a_file_has_the_area_of_its_outline(
    tmp_path: Path, outline: str, suffix: str, first: int
) -> None:
    points, area = OUTLINES[outline]
    corners = turned(np.roll(points, -first, axis=0), 3)
    with aside("camera", "light"):
        scene = load_scene(written(tmp_path, suffix, corners))
    assert scene.areas.sum() == pytest.approx(area, rel=1e-6)
    side = polygon_normal(corners)
    assert (scene.normals @ side > 0).all()


def test_corners_of_a_concave_face_keep_their_texture_coordinates_and_normals(tmp_path: Path) -> None:
    lines = [f"v {x} {y} 0\nvt {x / 2} {y / 2}\nvn 0 0 1\n" for x, y in L.tolist()]
    numbers = " ".join(f"{i}/{i}/{i}" for i in range(1, 7))
    (tmp_path / "a.obj").write_text("".join(lines) + f"f {numbers}\n")
    with aside("camera", "light"):
        mesh = load_scene(tmp_path / "a.obj").shapes[0].geometry
    assert isinstance(mesh, Mesh)
    assert np.allclose(mesh.uv, mesh.vertices[:, :2] / 2)
    assert np.allclose(mesh.normals, [0, 0, 1])


def test_a_saddle_is_split_from_its_first_corner_to_its_third() -> None:
    saddle = np.array([[0, 0, 0], [1, 0, 1], [1, 1, 0], [0, 1, 1.0]])
    split = split_polygons(saddle, np.arange(4), np.array([4]))
    assert split.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert split.crossing == 0


def test_faces_that_cross_themselves_are_counted_in_one_warning(tmp_path: Path) -> None:
    bow = "v 0 0 0\nv 2 1 0\nv 2 0 0\nv 0 1.5 0\n"
    (tmp_path / "a.obj").write_text(bow + "f 1 2 3 4\nf 4 3 2 1\nf 1 2 3\n")
    with (
        pytest.warns(SceneWarning, match=r"outlines of faces that cross themselves: 2\."),
        aside("camera", "light"),
    ):
        load_scene(tmp_path / "a.obj")


#: Outlines that cross themselves.
CROSSING = {
    "bow-tie of area 0": [(0, 0), (1, 1), (1, 0), (0, 1)],
    "bow-tie": [(0, 0), (2, 1), (2, 0), (0, 1.5)],
    "figure of eight of area 0": [(0, 0), (1, 1), (2, 0), (2, 1), (1, 0), (0, 1)],
    "figure of eight": [(0, 0), (1, 0.2), (3, 1), (3, 0), (1, 0.8), (0, 1)],
    "pentagram": [(np.cos(0.8 * np.pi * i), np.sin(0.8 * np.pi * i)) for i in range(5)],
    "spiral": [(0, 0), *((np.cos(np.radians(100 * i)), np.sin(np.radians(100 * i))) for i in range(5))],
}


def has_crossing_edges(ring: np.ndarray) -> bool:
    """Compare each two edges: the ends of each lie on both sides of the other."""

    def side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> float:
        return float(np.sign((b - a)[0] * (point - a)[1] - (b - a)[1] * (point - a)[0]))

    edges = list(zip(ring, np.roll(ring, -1, axis=0), strict=True))
    return any(
        side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
        for (a, b), (c, d) in combinations(edges, 2)
    )


@pytest.mark.parametrize("outline", CROSSING)
@pytest.mark.parametrize("first", range(4))
def test_an_outline_that_crosses_itself_is_counted_from_every_corner(outline: str, first: int) -> None:
    points = np.roll(np.array(CROSSING[outline], np.float64), -first, axis=0)
    assert has_crossing_edges(points)
    for ring in (points, points[::-1]):
        corners = turned(ring, 5)
        assert split_polygons(corners, np.arange(len(ring)), np.array([len(ring)])).crossing == 1


@pytest.mark.parametrize("seed", range(20))
def test_only_outlines_that_cross_themselves_are_counted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(50):
        ring = rng.uniform(size=(rng.integers(4, 7), 2))
        split = split_polygons(turned(ring, seed), np.arange(len(ring)), np.array([len(ring)]))
        assert split.crossing == has_crossing_edges(ring)


@pytest.mark.parametrize(
    "points",
    [
        [(0.1 * i, 0.3 * i) for i in range(4)],
        [(0.1 * i, 0.3 * i) for i in (0, 1, 2, 3, 1.5)],
        [(1, 1)] * 4,
        [(0, 0), (1, 0), (0, 1), (0, 1)],
        [(0, 0), (1, 0), (1, 1), (0.5, 1), (0.5, 1.5), (0.5, 1), (0, 1)],
        [(0, 0), (1, 0), (1, 1), (0.5, 1), (0.5, 0.5), (0.5, 1), (0, 1)],
        [(0, 0), (3, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)],
    ],
    ids=["line of 4", "line of 5", "point", "corner twice", "spike", "cut", "hole with a bridge"],
)
def test_outlines_that_only_touch_themselves_are_not_counted(points: list[tuple[float, float]]) -> None:
    ring = turned(np.array(points, np.float64), 5)
    assert split_polygons(ring, np.arange(len(ring)), np.array([len(ring)])).crossing == 0


def test_quads_in_zigzag_order_are_counted_in_one_warning(tmp_path: Path) -> None:
    path = written(tmp_path, "off", turned(np.array(CROSSING["bow-tie of area 0"], np.float64), 5))
    with (
        pytest.warns(SceneWarning, match=r"outlines of faces that cross themselves: 1\."),
        aside("camera", "light"),
    ):
        load_scene(path)


def test_a_polygon_of_area_0_that_crosses_itself_lacks_what_it_encloses() -> None:
    bow = turned(np.array(CROSSING["bow-tie of area 0"], np.float64), 5)
    assert triangulated(bow)[2] < -1e-3


def test_polygons_keep_their_order_and_triangles_their_polygon() -> None:
    points = np.concatenate([np.column_stack([L, np.zeros(6)]) + [0, 0, i] for i in range(3)])  # noqa: RUF005
    faces = [[0, 1, 2], [6, 7, 8, 9, 10, 11], [0, 1, 2, 3, 4, 5], [12, 13, 14, 17], [1, 2, 3]]
    corners = np.concatenate([np.array(face) for face in faces])
    split = split_polygons(points, corners, np.array([len(face) for face in faces]))
    assert split.polygons.tolist() == [0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 4]
    assert all(set(corners[t]) <= set(faces[p]) for t, p in zip(split.triangles, split.polygons, strict=True))


@pytest.mark.parametrize("holes", [0, 1, 300])
def test_a_ragged_face_of_thousands_of_corners_is_split_within_a_second(holes: int) -> None:
    rng = np.random.default_rng(4)
    angle = 2 * np.pi * np.arange(8000) / 8000
    radius = rng.uniform(1, 3, 8000)
    boundary = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(8000)])
    square = np.array([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0]])
    inner = [square + [0.04 * (i % 18) - 0.36, 0.04 * (i // 18) - 0.36, 0] for i in range(holes)]  # noqa: RUF005
    start = time.process_time()
    vertices, faces, missing = triangulated(boundary, inner)
    assert time.process_time() - start < 2  # bands took 25 s for 8,000 corners
    x, y = boundary[:, 0], boundary[:, 1]
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) - holes * 0.02**2
    assert areas(vertices, faces, np.array([0, 0, 1.0])).sum() == pytest.approx(area)
    assert missing == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("crosses", [True, False])
def test_the_cost_of_large_polygons_of_a_mesh_is_limited(crosses: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A polygon of 100 corners that crosses itself costs sixteen times as much as one that does not."""
    turn = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    star = np.where(np.arange(100) % 2, 1, 0.5)[:, None] * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    ring = np.random.default_rng(0).random((100, 3)) * [1, 1, 0] if crosses else star
    corners, sizes = np.tile(np.arange(100), 3), np.full(3, 100)
    monkeypatch.setattr("glpath.io.polygons._STEP_COST", 100**2)
    monkeypatch.setattr("glpath.io.polygons._MAX_EAR_COST", 3 * 100**2 * (16 if crosses else 1))
    split = split_polygons(ring, corners, sizes)
    assert split.crossing == (3 if crosses else 0)
    assert np.array_equal(np.unique(split.polygons), [0, 1, 2])
    monkeypatch.setattr("glpath.io.polygons._MAX_EAR_COST", 3 * 100**2 * (16 if crosses else 1) - 1)
    with pytest.raises(ValueError, match=r"polygons of up to 100 corners, .* take too long to split"):
        split_polygons(ring, corners, sizes)


def test_polygons_of_several_meshes_share_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second of two equal meshes exceeds the limit within the context, and not outside of it."""
    ring = np.random.default_rng(0).random((100, 3)) * [1, 1, 0]
    corners, sizes = np.arange(100), np.full(1, 100)
    monkeypatch.setattr("glpath.io.polygons._MAX_EAR_COST", 20 * 100**2)
    split_polygons(ring, corners, sizes)
    split_polygons(ring, corners, sizes)
    with limited_polygons():
        split_polygons(ring, corners, sizes)
        with pytest.raises(ValueError, match="take too long to split"):
            split_polygons(ring, corners, sizes)


def test_the_number_of_outlines_that_are_compared_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """The figure has a small loop, whose area is too small to be missed."""
    loop = [[0, 5, 0], [0.01, 4.99, 0], [0.01, 5, 0], [0, 4.99, 0]]
    ring = np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [5, 1, 0], [0, 9, 0], *loop])
    corners, sizes = np.tile(np.arange(9), 4), np.full(4, 9)
    found = split_polygons(ring, corners, sizes)
    monkeypatch.setattr("glpath.io.polygons._MAX_COMPARISONS", 2 * 9**2)
    limited = split_polygons(ring, corners, sizes)
    assert (found.crossing, limited.crossing) == (4, 2)
    assert np.array_equal(found.triangles, limited.triangles)
