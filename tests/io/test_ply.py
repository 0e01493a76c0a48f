"""PLY files of every encoding: positions, polygons, strips, colours, and numbers that are not finite."""

from __future__ import annotations

import struct
import time
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

from glpath import Scene, SceneError, SceneWarning, load_scene
from glpath.scene.model import Mesh
from glpath.system.colour import decode_srgb

# A cube of side 2, fronts outward: its area is 24 and its volume 8.
CORNERS = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
QUADS = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")
CODES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
}
BROWN = (230, 60, 30)


def ply(
    elements: dict[str, tuple[list[str], list[tuple[object, ...]]]], format_name: str = "ascii", header: str = ""
) -> bytes:
    """A file of elements: for each its properties as the header has them, and its rows, with tuples for lists."""
    lines = ["ply", f"format {format_name} 1.0", *header.splitlines()]
    body = b""
    order = "<" if format_name == "binary_little_endian" else ">"
    for name, (properties, rows) in elements.items():
        lines += [f"element {name} {len(rows)}", *(f"property {each}" for each in properties)]
        for row in rows:
            words: list[str] = []
            for each, value in zip(properties, row, strict=True):
                kinds = each.split()[:-1]
                values = [value] if len(kinds) == 1 else [len(value), *value]  # type: ignore[arg-type, misc]
                kinds = [kinds[0]] if len(kinds) == 1 else [kinds[1], *[kinds[2]] * (len(values) - 1)]
                words += [str(each) for each in values]
                if format_name != "ascii":
                    body += struct.pack(order + "".join(CODES[kind] for kind in kinds), *values)
            if format_name == "ascii":
                body += (" ".join(words) + "\n").encode()
    return "\n".join([*lines, "end_header\n"]).encode() + body


def cube(
    *,
    of_vertices: tuple[list[str], tuple[object, ...]] = ([], ()),
    of_faces: tuple[list[str], tuple[object, ...]] = ([], ()),
    format_name: str = "ascii",
) -> bytes:
    """A cube, all of whose vertices and faces have the same further properties."""
    vertices = [(*corner, *of_vertices[1]) for corner in CORNERS]
    faces = [(quad, *of_faces[1]) for quad in QUADS]
    return ply(
        {
            "vertex": (["float x", "float y", "float z", *of_vertices[0]], vertices),
            "face": (["list uchar int vertex_indices", *of_faces[0]], faces),
        },
        format_name,
    )


def load(folder: Path, content: bytes) -> tuple[Scene, list[str]]:
    """The scene, and its warnings but for that of the camera."""
    path = folder / "a.ply"
    path.write_bytes(content)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = load_scene(path)
    assert all(each.category is SceneWarning for each in caught)
    told = [str(each.message).removeprefix(f"{path}: ") for each in caught]
    return scene, [text for text in told if "has no camera" not in text]


def mesh_of(scene: Scene) -> Mesh:
    (shape,) = scene.shapes
    assert isinstance(shape.geometry, Mesh)
    return shape.geometry


def volume(scene: Scene) -> float:
    a, b, c = (scene.triangles[:, i] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def colour(scene: Scene) -> list[float]:
    """sRGB, 0 to 255, of a scene of one colour."""
    (material,) = scene.materials
    assert mesh_of(scene).colours is None
    linear = material.reflectance
    return (255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)).tolist()


# Encodings.


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize("count_type", ["uchar", "int", "ushort"])
@pytest.mark.parametrize("index_type", ["int", "uint", "short", "uchar"])
def test_a_cube_has_its_area_and_volume_in_every_encoding(
    tmp_path: Path, format_name: str, count_type: str, index_type: str
) -> None:
    elements = {
        "vertex": (["float x", "double y", "short z"], [tuple(corner) for corner in CORNERS]),
        "face": (["uchar flags", f"list {count_type} {index_type} vertex_index", "float q"], []),
    }
    elements["face"] = (elements["face"][0], [(7, quad, 0.5) for quad in QUADS])  # type: ignore[assignment]
    scene, told = load(tmp_path, ply(elements, format_name))  # type: ignore[arg-type]
    assert told == []
    assert scene.areas.sum() == pytest.approx(24)
    assert volume(scene) == pytest.approx(8)


@pytest.mark.parametrize("format_name", FORMATS)
def test_polygons_of_different_sizes_and_lists_in_all_places_are_read(tmp_path: Path, format_name: str) -> None:
    """A prism over a hexagon of side 1 and height 1: area 2 x 2.598 + 6."""
    ring = [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3]
    vertices = [(x, y, z, (1,) * i) for i, (x, y, z) in enumerate((*p, z) for z in (0.0, 1.0) for p in ring)]
    sides = [(i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6) for i in range(6)]
    triangles = [face for side in sides[:3] for face in (side[:3], (side[0], side[2], side[3]))]
    faces = [(5, 4, 3, 2, 1, 0), (6, 7, 8, 9, 10, 11), *sides[3:], *triangles]
    elements = {
        "camera": (["list uchar double pose", "int id"], [((0.5,) * 3, 4), ((), 5)]),
        "vertex": (["double x", "double y", "double z", "list uchar uchar tags"], vertices),
        "face": (
            ["list uchar float weights", "list uchar int vertex_indices", "uchar last"],
            [((0.5,) * (i % 3), face, 9) for i, face in enumerate(faces)],
        ),
    }
    scene, told = load(tmp_path, ply(elements, format_name))  # type: ignore[arg-type]
    assert told == []
    assert scene.areas.sum() == pytest.approx(2 * 1.5 * np.sqrt(3) + 6)
    assert volume(scene) == pytest.approx(1.5 * np.sqrt(3))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("format_name", FORMATS)
def test_headers_end_their_lines_as_every_system_does(tmp_path: Path, end: str, format_name: str) -> None:
    header, _, body = cube(format_name=format_name).partition(b"end_header\n")
    written = header.replace(b"\n", end.encode()) + b"end_header" + end.encode() + body
    scene, told = load(tmp_path, written)
    assert told == []
    assert volume(scene) == pytest.approx(8)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_file_of_trimesh_is_what_trimesh_wrote(tmp_path: Path, encoding: str) -> None:
    ball = trimesh.creation.icosphere(3, 1.5)
    scene, _ = load(tmp_path, ball.export(file_type="ply", encoding=encoding))
    assert np.allclose(scene.triangles, ball.triangles, atol=1e-6)


def test_normals_and_texture_coordinates_belong_to_their_vertices(tmp_path: Path) -> None:
    names = ["float nx", "float ny", "float nz", "float s", "float t"]
    content = cube(of_vertices=(names, (0, 3, 4, 0.25, 0.75)))
    mesh = mesh_of(load(tmp_path, content)[0])
    assert mesh.normals is not None
    assert mesh.uv is not None
    assert np.allclose(mesh.normals, [0, 0.6, 0.8])
    assert np.allclose(mesh.uv, [0.25, 0.75])


def test_texture_coordinates_of_corners_are_those_of_meshlab(tmp_path: Path) -> None:
    corners = [(0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0)] * 6
    content = ply(
        {
            "vertex": (["float x", "float y", "float z"], list(CORNERS)),
            "face": (
                ["list uchar int vertex_indices", "list uchar float texcoord"],
                list(zip(QUADS, corners, strict=True)),
            ),
        },
        "binary_little_endian",
    )
    mesh = mesh_of(load(tmp_path, content)[0])
    assert mesh.uv is not None
    lookup = {quad: dict(zip(quad, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True)) for quad in QUADS}
    for face in mesh.faces:
        numbers = [CORNERS.index(tuple(mesh.vertices[v])) for v in face]
        (quad,) = (quad for quad in QUADS if set(numbers) <= set(quad))
        assert [tuple(mesh.uv[v]) for v in face] == [lookup[quad][number] for number in numbers]


# Strips.


@pytest.mark.parametrize("format_name", FORMATS)
def test_strips_are_triangles_whose_fronts_are_outside(tmp_path: Path, format_name: str) -> None:
    """The sides of a cube are a strip that ends where it began; -1 divides, and so does the next list."""
    sides = (4, 0, 5, 1, 6, 2, 7, 3, 4, 0)
    strips = [((*sides, -1, 1, 0, 2, 3),), ((4, 5, 7, 6),)]
    content = ply(
        {
            "vertex": (["float x", "float y", "float z"], list(CORNERS)),
            "tristrips": (["list int int vertex_indices"], strips),
        },
        format_name,
    )
    scene, told = load(tmp_path, content)
    assert told == []
    assert len(scene.triangles) == 12
    assert scene.areas.sum() == pytest.approx(24)
    assert volume(scene) == pytest.approx(8)


def test_a_vertex_twice_in_a_strip_only_continues_it_elsewhere(tmp_path: Path) -> None:
    vertices = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (5, 0, 0), (6, 0, 0), (5, 1, 0)]
    strip = (0, 1, 2, 2, 3, 3, 3, 4, 5)
    content = ply(
        {
            "vertex": (["float x", "float y", "float z"], vertices),  # type: ignore[dict-item]
            "tristrips": (["list int int vertex_indices"], [(strip,)]),
        }
    )
    scene, told = load(tmp_path, content)
    assert told == []
    assert scene.areas.sum() == pytest.approx(1.0)
    assert np.allclose(scene.normals, [0, 0, 1])


# Colours.


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize(
    ("kind", "stored", "expected", "guessed"),
    [
        ("uchar", BROWN, BROWN, False),
        ("ushort", (40000, 12000, 5000), (155.6, 46.7, 19.5), False),
        ("float", (230 / 255, 60 / 255, 30 / 255), BROWN, False),
        ("double", (1.0, 0.5, 0.25), (255, 127.5, 63.75), False),
        ("float", BROWN, BROWN, True),
        ("float", (255, 12.5, 0), (255, 12.5, 0), True),
        ("int", BROWN, BROWN, True),
        ("uint", BROWN, BROWN, True),
        ("float", (40000, 12000, 5000), (155.6, 46.7, 19.5), True),
        ("uint", (2**32 - 1, 2**31, 0), (255, 127.5, 0), True),
    ],
)
def test_colours_are_read_by_their_type_and_their_maximum(
    tmp_path: Path,
    format_name: str,
    kind: str,
    stored: tuple[float, ...],
    expected: tuple[float, ...],
    guessed: bool,
) -> None:
    names = [f"{kind} red", f"{kind} green", f"{kind} blue"]
    scene, told = load(tmp_path, cube(of_vertices=(names, stored), format_name=format_name))
    assert colour(scene) == pytest.approx(expected, abs=0.06)
    assert ["white is taken to be" in text for text in told] == [True] * guessed


@pytest.mark.parametrize(
    "names",
    [
        ("r", "g", "b"),
        ("Red", "Green", "Blue"),
        ("RED", "GREEN", "BLUE"),
        ("diffuse_red", "diffuse_green", "diffuse_blue"),
        ("color_red", "color_green", "color_blue"),
        ("colour_r", "colour_g", "colour_b"),
        ("color_0", "color_1", "color_2"),
    ],
)
@pytest.mark.parametrize("of", ["of_vertices", "of_faces"])
def test_colours_have_many_names(tmp_path: Path, names: tuple[str, ...], of: str) -> None:
    content = cube(**{of: ([f"uchar {name}" for name in names], BROWN)})  # type: ignore[arg-type]
    scene, told = load(tmp_path, content)
    assert told == []
    assert colour(scene) == pytest.approx(BROWN, abs=0.01)


@pytest.mark.parametrize("sizes", [3, 4, 6])
def test_colours_of_faces_cover_all_of_a_polygon(tmp_path: Path, sizes: int) -> None:
    """Two polygons, red and blue, beside each other: half of the area has each colour."""
    angles = 2 * np.pi * np.arange(sizes) / sizes
    vertices = [(np.cos(a) + x, np.sin(a), 0.0) for x in (0.0, 3.0) for a in angles]
    faces = [(tuple(range(sizes)), 255, 0, 0), (tuple(range(sizes, 2 * sizes)), 0, 0, 255)]
    content = ply(
        {
            "vertex": (["float x", "float y", "float z"], vertices),
            "face": (["list uchar int vertex_indices", "uchar red", "uchar green", "uchar blue"], faces),
        }
    )
    scene, told = load(tmp_path, content)
    assert told == []
    mesh = mesh_of(scene)
    assert mesh.colours is not None
    of_triangles = mesh.colours[mesh.faces]
    assert np.array_equal(of_triangles, np.repeat(of_triangles[:, :1], 3, axis=1))
    for rgb, left in (((1, 0, 0), True), ((0, 0, 1), False)):
        chosen = (of_triangles[:, 0, :3] == rgb).all(axis=1)
        assert np.array_equal(chosen, (scene.triangles[:, :, 0].mean(axis=1) < 1.5) == left)
        assert scene.areas[chosen].sum() == pytest.approx(0.5 * sizes * np.sin(2 * np.pi / sizes), rel=1e-6)


def test_white_vertices_do_not_hide_the_colours_of_faces(tmp_path: Path) -> None:
    names = ["uchar red", "uchar green", "uchar blue"]
    scene, told = load(tmp_path, cube(of_vertices=(names, (255, 255, 255)), of_faces=(names, BROWN)))
    assert colour(scene) == pytest.approx(BROWN, abs=0.01)
    assert told == ["not used: Colours of vertices, beside those of faces."]


def test_colours_that_are_not_understood_are_named(tmp_path: Path) -> None:
    _, told = load(tmp_path, cube(of_vertices=(["uchar red", "uchar green", "uint rgb"], (1, 2, 3))))
    assert told == ["not used: Colours in the properties red, green, rgb."]


@pytest.mark.parametrize("rest", [[], ["uchar alpha"]])
def test_fractions_in_a_column_of_bytes_are_fractions(tmp_path: Path, rest: list[str]) -> None:
    names = ["uchar red", "uchar green", "uchar blue", *rest]
    scene, told = load(tmp_path, cube(of_vertices=(names, (1.0, 0.5, 0.25, *[0.75] * len(rest)))))
    assert colour(scene) == pytest.approx((255, 127.5, 63.75), abs=0.01)
    assert scene.materials[0].opacity == pytest.approx(0.75 if rest else 1)
    assert told == ["its colours red, green, blue: they are fractions, although the header declares whole numbers."]


def test_intensity_edges_and_elements_of_other_kinds_are_told(tmp_path: Path) -> None:
    vertices = [(*corner, 7) for corner in CORNERS]
    content = ply(
        {
            "vertex": (["float x", "float y", "float z", "uchar intensity"], vertices),
            "face": (["list uchar int vertex_indices"], [(quad,) for quad in QUADS]),
            "edge": (["int vertex1", "int vertex2"], [(0, 1), (1, 2)]),
            "material": (["uchar diffuse_red", "uchar diffuse_green", "uchar diffuse_blue"], [BROWN]),
        }
    )
    assert sorted(load(tmp_path, content)[1]) == [
        "left out: edges beside faces (2).",
        "not used: Colours in the properties intensity.",
        "not used: Elements of other kinds: material (1).",
    ]


# Alpha.


@pytest.mark.parametrize(
    ("kind", "alpha", "opacity"), [("uchar", 51, 0.2), ("float", 0.2, 0.2), ("float", 51, 0.2)]
)
def test_alpha_is_opacity(tmp_path: Path, kind: str, alpha: float, opacity: float) -> None:
    names = ["uchar red", "uchar green", "uchar blue", f"{kind} alpha"]
    scene, _ = load(tmp_path, cube(of_vertices=(names, (*BROWN, alpha))))
    assert scene.materials[0].opacity == pytest.approx(opacity, rel=1e-6)
    assert scene.materials[0].alpha == "blend"


@pytest.mark.parametrize("of", ["of_vertices", "of_faces"])
@pytest.mark.parametrize("kind", ["uchar", "float"])
def test_a_model_of_alpha_0_is_opaque_and_says_so_once(tmp_path: Path, of: str, kind: str) -> None:
    names = ["uchar red", "uchar green", "uchar blue", f"{kind} alpha"]
    scene, told = load(tmp_path, cube(**{of: (names, (*BROWN, 0))}))  # type: ignore[arg-type]
    assert told == ["alpha is 0 everywhere, by which nothing could be seen: it is taken for opaque."]
    assert (scene.materials[0].opacity, scene.materials[0].alpha) == (1.0, "opaque")
    assert colour(scene) == pytest.approx(BROWN, abs=0.01)


# Numbers that are not finite.

NANS = ("nan", "-nan", "NaN", "-nan(ind)", "nan(snan)", "1.#QNAN", "-1.#IND", "inf", "-inf", "1.#INF", "1e999")


@pytest.mark.parametrize("written", NANS)
def test_a_vertex_without_a_position_takes_its_faces_along(tmp_path: Path, written: str) -> None:
    content = cube().replace(b"\n-1 -1 -1\n", f"\n-1 {written} -1\n".encode())
    scene, told = load(tmp_path, content)
    assert scene.areas.sum() == pytest.approx(12)
    assert told == ["left out: vertices that are not finite (1), faces with such a vertex (3)."]


@pytest.mark.parametrize("format_name", FORMATS)
def test_an_unused_vertex_without_a_position_takes_nothing_along(tmp_path: Path, format_name: str) -> None:
    nan = float("nan")
    content = ply(
        {
            "vertex": (["float x", "float y", "float z"], [*CORNERS, (nan, nan, nan)]),
            "face": (["list uchar int vertex_indices"], [(quad,) for quad in QUADS]),
        },
        format_name,
    )
    scene, told = load(tmp_path, content)
    assert volume(scene) == pytest.approx(8)
    assert scene.bounds == (pytest.approx([-1, -1, -1]), pytest.approx([1, 1, 1]))
    assert told == ["left out: vertices that are not finite (1)."]


def test_a_normal_that_is_not_finite_is_that_of_the_face(tmp_path: Path) -> None:
    content = cube(of_vertices=(["float nx", "float ny", "float nz"], (0, 0, 1)))
    content = content.replace(b"-1 -1 -1 0 0 1\n", b"-1 -1 -1 nan nan nan\n")
    scene, told = load(tmp_path, content)
    mesh = mesh_of(scene)
    assert mesh.normals is not None
    assert mesh.normals[0].tolist() == [0, 0, 0]  # by which the face's own is meant
    assert np.array_equal(mesh.normals[1:], [[0, 0, 1]] * 7)
    assert told == ["left out: normals that are not finite (1)."]


def test_texture_coordinates_and_colours_that_are_not_finite_are_counted(tmp_path: Path) -> None:
    names = ["float u", "float v", "float red", "float green", "float blue"]
    content = cube(of_vertices=(names, (0.5, 0.5, 0.25, 0.5, 1.0)))
    content = content.replace(b"-1 -1 -1 0.5 0.5 0.25", b"-1 -1 -1 nan 0.5 nan")
    scene, told = load(tmp_path, content)
    mesh = mesh_of(scene)
    assert mesh.colours is not None
    assert np.isfinite(mesh.colours).all()
    assert np.allclose(mesh.colours[1, :3], decode_srgb(np.array([0.25, 0.5, 1.0])))
    assert told == ["left out: texture coordinates that are not finite (1), colours that are not finite (1)."]


def test_an_alpha_that_is_not_finite_is_counted(tmp_path: Path) -> None:
    names = ["float red", "float green", "float blue", "float alpha"]
    content = cube(of_vertices=(names, (0.25, 0.5, 1.0, 1.0)))
    content = content.replace(b"-1 -1 -1 0.25 0.5 1.0 1.0", b"-1 -1 -1 0.25 0.5 1.0 nan")
    _, told = load(tmp_path, content)
    assert told == ["left out: colours that are not finite (1)."]


@pytest.mark.parametrize("format_name", FORMATS)
def test_points_without_a_position_are_left_out_of_a_cloud(tmp_path: Path, format_name: str) -> None:
    nan = float("nan")
    points = [(0, 0, 0, 255, 0, 0), (nan, nan, nan, 9, 9, 9), (1, 0, 0, 0, 255, 0), (0, 1, 0, 0, 0, 255)]
    names = ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"]
    scene, told = load(tmp_path, ply({"vertex": (names, points)}, format_name))  # type: ignore[dict-item]
    mesh = mesh_of(scene)
    assert len(mesh.faces) == 3 * 80
    assert mesh.colours is not None
    for centre, rgb in (((0, 0, 0), (1, 0, 0)), ((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (0, 0, 1))):
        near = np.linalg.norm(mesh.vertices - centre, axis=1) < 0.1
        assert np.allclose(mesh.colours[near, :3], rgb)
    assert "left out: points that are not finite (1)." in told
    assert len(told) == 2


# Errors.

HEAD = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE = b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
BODY = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
BINARY = HEAD.replace(b"ascii", b"binary_little_endian")


@pytest.mark.filterwarnings("ignore:.*(left out|behind the last)")
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", 'does not begin with "ply"'),
        (b"obj\n", 'does not begin with "ply"'),
        (HEAD, "has no end_header"),
        (HEAD.replace(b"format ascii 1.0\n", b"") + FACE + BODY, "no line for the format"),
        (HEAD.replace(b"ascii", b"utf8") + FACE + BODY, 'line 2 of its header is "format utf8 1.0", but must be'),
        (HEAD.replace(b"float x", b"quad x") + FACE + BODY, 'line 4 of its header is "property quad x"'),
        (
            HEAD.replace(b"vertex 3", b"vertex three") + FACE + BODY,
            'line 3 of its header is "element vertex three"',
        ),
        (HEAD.replace(b"float x", b"float q") + FACE + BODY, "no vertices with the properties x, y and z"),
        (HEAD.replace(b"vertex 3", b"point 3") + FACE + BODY, "no vertices with the properties x, y and z"),
        (
            HEAD.replace(b"vertex 3", b"vertex 9") + FACE + BODY,
            "announces 9 rows of the element vertex, but the file",
        ),
        (HEAD + FACE.replace(b"face 1", b"face 4") + BODY, "announces 4 rows of the element face, but the file"),
        (HEAD + FACE + BODY.replace(b"1 0 0", b"1 O 0"), 'line 11 has "O", which is not a number'),
        (HEAD + FACE + BODY.replace(b"3 0 1 2", b"3 0 1 7"), "face 0 names vertex 7, but the mesh has 3 vertices"),
        (HEAD + FACE + BODY.replace(b"3 0 1 2", b"3 0 1 -2"), "face 0 names vertex -2, but the mesh has 3"),
        (HEAD + FACE + BODY.replace(b"3 0 1 2", b"3 0 1 0.5"), "names vertex 0.5, which is not a whole number"),
        (HEAD + FACE + BODY.replace(b"3 0 1 2", b"-3 0 1 2"), "list whose length is not 0 or more"),
        (HEAD + FACE + BODY.replace(b"3 0 1 2", b"nan 0 1 2"), "list whose length is not 0 or more"),
        (HEAD + FACE.replace(b"list uchar int", b"int") + BODY, "no property list with the name vertex_indices"),
        (HEAD + FACE + BODY.replace(b"3 0 1 2", b"2 0 1"), "has no triangles"),
        (HEAD + FACE + b"nan 0 0\n" * 3 + b"3 0 1 2\n", "has no triangles"),
        (BINARY.replace(b"vertex 3", b"vertex 4000000000") + FACE + bytes(36), "announces 4,000,000,000 rows"),
        (BINARY + FACE.replace(b"face 1", b"face 4000000000") + bytes(36), "announces 4,000,000,000 rows"),
        (
            BINARY + FACE + bytes(36) + b"\x03\0\0\0\0",
            "announces 1 rows of the element face, but the file ends after 0",
        ),
        (
            BINARY + FACE.replace(b"uchar", b"uint") + bytes(36) + b"\xff\xff\xff\x7f" + bytes(12),
            "announces 1 rows of the element face, but the file ends after 0",
        ),
    ],
)
def test_a_broken_file_is_an_error_that_names_the_place(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / "a.ply")
    assert message in str(error.value)
    assert str(error.value).count("a.ply") == 1


def test_counts_that_the_file_cannot_hold_take_no_memory_and_no_time(tmp_path: Path) -> None:
    lists = b"element face 1000000000000\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_bytes(BINARY + lists + bytes(1000))
    tracemalloc.start()
    before = time.perf_counter()
    with pytest.raises(SceneError, match="announces"):
        load_scene(tmp_path / "a.ply")
    assert time.perf_counter() - before < 5
    assert tracemalloc.get_traced_memory()[1] < 2**26
    tracemalloc.stop()


def test_data_behind_the_last_element_are_counted(tmp_path: Path) -> None:
    assert load(tmp_path, cube() + b"1 2 3\n")[1] == [
        "3 numbers behind the last element are not read, as the header announces no more."
    ]
    assert load(tmp_path, cube(format_name="binary_big_endian") + b"abc")[1] == [
        "3 bytes behind the last element are not read, as the header announces no more."
    ]
    assert load(tmp_path, cube(format_name="binary_big_endian") + b"\n")[1] == []
    assert load(tmp_path, cube() + b"\x1a")[1] == []  # as old programs end text
