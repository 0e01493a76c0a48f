"""Damaged files: clear errors, well-formed results, bounded memory; what the format allows is read."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from glpath import load_scene, read_image
from glpath.cli.main import app
from glpath.errors import ImageError, SceneError, SceneWarning
from glpath.film.film import Film
from glpath.io.load import scene_from_dict
from glpath.io.obj import Part, read_obj
from glpath.scene.model import Mesh, Scene
from glpath.system.vectors import unit_normals
from tests.conftest import MakeFilm
from tests.support.damaged import bomb
from tests.support.repository import TESTS

PROGRAM = TESTS / "support" / "damaged.py"


def attacked(*arguments: int) -> dict[str, object]:
    command = [sys.executable, str(PROGRAM), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_no_damaged_file_brings_a_traceback_or_fills_the_memory() -> None:
    found = attacked(1, 16)
    assert (found["wrong"], found["first"]) == (0, [])
    assert found["error"] > 120
    assert found["files"] > 110


@pytest.mark.evidence
def test_none_of_thousands_does() -> None:
    found = attacked(2)
    assert (found["wrong"], found["first"]) == (0, [])
    assert found["files"] > 3000


def test_a_bomb_is_refused_by_its_header(tmp_path: Path) -> None:
    """9 MB in the file that found this, and 8.9 GiB in memory."""
    path = tmp_path / "bomb.npz"
    path.write_bytes(bomb((300 << 17,), "<f8", 300))
    assert path.stat().st_size < 2_000_000
    with pytest.raises(ImageError, match=r"bomb.npz: cannot be read as .npz: .* unfold to 0.315 GB"):
        read_image(path)


def changed_film(film: Film, path: Path, **arrays: object) -> Path:
    film.save(path)
    np.savez(path, **dict(np.load(path)) | arrays)
    return path


@pytest.mark.parametrize(
    "ranges",
    [[[0, 20], [10, 22]], [[0, 16], [16, 32]], [[0, 33]], [[-1, 31]], [[16, 32], [0, 16]], [[8, 40]], [[0, 32.0]]],
)
def test_ranges_must_be_disjoint_and_what_the_batches_count(
    make_film: MakeFilm, tmp_path: Path, ranges: list[list[float]]
) -> None:
    path = changed_film(make_film([(0, 32)]), tmp_path / "a.npz", ranges=np.array(ranges))
    with pytest.raises(ImageError, match=r"a.npz: cannot be read as a film: (its ranges of path sets|`ranges`)"):
        Film.load(path)


@pytest.mark.parametrize("ranges", [[(0, 7)], [(3, 21), (64, 131)], [(0, 1), (2, 3), (1000, 1100)]])
def test_a_film_of_any_ranges_is_read(make_film: MakeFilm, tmp_path: Path, ranges: list[tuple[int, int]]) -> None:
    film = make_film(ranges)
    film.save(tmp_path / "a.npz")
    assert Film.load(tmp_path / "a.npz").ranges == tuple(ranges)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_no_picture(make_film: MakeFilm, tmp_path: Path, value: float) -> None:
    film = make_film([(0, 32)])
    sums = film.radiance_sums[film.batch_counts > 0]
    sums[0, 1, 2, 0] = value
    path = changed_film(film, tmp_path / "a.npz", radiance_sums=sums)
    for attempt in (Film.load, read_image):
        with pytest.raises(ImageError, match="NaN or infinite"):
            attempt(path)
    np.save(tmp_path / "a.npy", np.full((2, 3, 3), value))
    with pytest.raises(ImageError, match=r"a.npy: cannot be read as .npy: 6 of its 6 pixels are NaN or infinite"):
        read_image(tmp_path / "a.npy")


# OBJ: what the format allows.

PLAIN = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/1\n"

SPELLINGS = {
    "comments after statements": PLAIN.replace("3/3\n", "3/3 # the first one\n").replace(
        "v 0 0 0", "v 0 0 0 #\u00f6"
    ),
    "tabs": PLAIN.replace(" ", "\t"),
    "indentation and blanks": PLAIN.replace("v ", "   v    ").replace("f ", " \tf  ").replace("\n", "  \n"),
    "continued lines": PLAIN.replace("2/2 ", "\\\n  2/2 \\\n ").replace("v 2 ", "v \\\n2 "),
    "a comment that ends in a backslash": "# C:\\meshes\\\n" + PLAIN,
    "ends of lines of DOS": PLAIN.replace("\n", "\r\n"),
    "ends of lines of old Macs": PLAIN.replace("\n", "\r"),
    "no last end of line": PLAIN.rstrip(),
    "indices backwards": PLAIN.replace("f 1/1 2/2 3/3", "f -4/-3 -3/-2 -2/-1"),
    "backwards, with more vertices behind": PLAIN.replace("f 1/1 2/2 3/3\n", "f -4/-3 -3/-2 -2/-1\nv 9 9 9\n"),
    "weights": PLAIN.replace("0\nv ", "0 1.0\nv "),
    "names in Latin-1": "o gr\u00f6\u00dfe\x85v 9 9 9\n" + PLAIN,
    "other statements": "g a b\ns off\nvp 0 0\n" + PLAIN + "l 1 2\np 1\n",
}


def plate(path: Path) -> Scene:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return load_scene(path)


def check_plate(scene: Scene) -> None:
    assert scene.areas.sum() == pytest.approx(2.0)
    assert np.allclose(scene.normals, [0, 0, 1])
    assert np.ptp(scene.triangles.reshape(-1, 3), axis=0).tolist() == [2, 1, 0]
    assert scene.shapes[0].geometry.uv is not None


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_obj_is_read_however_it_is_spelt(tmp_path: Path, spelling: str) -> None:
    (tmp_path / "plate.obj").write_bytes(SPELLINGS[spelling].encode("latin-1"))
    check_plate(plate(tmp_path / "plate.obj"))


@pytest.mark.parametrize(("corner", "has_uv"), [("{0}/", False), ("{0}//", False), ("{0}/{0}/", True)])
def test_a_slash_after_a_corner_adds_no_index(corner: str, has_uv: bool) -> None:
    face = " ".join(corner.format(number) for number in (3, 1, 2))
    text = f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nvn 0 1 0\nvn 1 0 0\nf {face}\n"
    (part,) = read_obj(text.encode(), "a.obj").parts
    assert part.positions[part.faces[0]].tolist() == [[0, 1, 0], [0, 0, 0], [1, 0, 0]]
    assert part.normals is None
    assert (None if part.uv is None else part.uv[part.faces[0]].tolist()) == (
        [[0, 1], [0, 0], [1, 0]] if has_uv else None
    )


# The quads of a box, outwards. Vertices are in the order of product((-x, x), (-y, y), (-z, z)).
BOX = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]


def box(*groups: str) -> Part:
    """The part of an OBJ box of half sizes 1, 2 and 3, with an s statement before the quads across each axis."""
    rows = [f"v {x} {y} {z}" for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)]
    for axis, group in enumerate(groups):
        rows += [f"s {group}", *(f"f {' '.join(map(str, face))}" for face in BOX[2 * axis : 2 * axis + 2])]
    (part,) = read_obj("\n".join(rows).encode(), "a.obj", smooth=True).parts
    return part


def test_a_smoothing_group_has_the_mean_normals_of_its_faces_by_area() -> None:
    """Faces across x, y and z have areas of 24, 12 and 8."""
    part = box("1", "1", "1")
    assert len(part.positions) == 8
    assert part.normals is not None
    expected = np.sign(part.positions) * [6, 3, 2] / 7
    assert unit_normals(part.normals) == pytest.approx(expected)


def test_smoothing_groups_do_not_mix_and_off_is_flat() -> None:
    part = box("1", "2", "off")
    assert part.normals is not None
    corners = part.normals[part.faces].reshape(3, 4, 3, 3)  # axis, triangle, corner, component
    assert np.abs(corners).round(12).tolist() == [[[[1, 0, 0]] * 3] * 4, [[[0, 1, 0]] * 3] * 4, [[[0] * 3] * 3] * 4]
    assert box("off", "0", "OFF").normals is None


def test_normals_of_a_file_stay_in_a_smoothing_group() -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 1 2 3\ns 1\nf 1//1 2//1 3//1\n"
    (part,) = read_obj(text.encode(), "a.obj", smooth=True).parts
    assert part.normals is not None
    assert part.normals.tolist() == [[1, 2, 3]] * 3


MIXED = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.5\nvn 0 0.6 0.8\nusemtl a\nf 1/1/1 2/1/1 3/1/1\nusemtl b\nf 3 2 1\n"


def test_a_mesh_keeps_uv_and_normals_of_the_faces_that_have_them(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(MIXED)
    description = {
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
        "shapes": [{"type": "mesh", "file": "a.obj", "material": "floor"}],
        "textures": {"tiles": {"type": "checker"}},
        "materials": {"floor": {"texture": "tiles"}},
    }
    with pytest.warns(SceneWarning) as caught:
        scene = scene_from_dict(description, folder=tmp_path)
    mesh = scene.shapes[0].geometry
    assert isinstance(mesh, Mesh)
    assert mesh.uv is not None
    assert mesh.uv[mesh.faces].tolist() == [[[0.25, 0.5]] * 3, [[0, 1]] * 3]
    assert mesh.normals is not None
    assert mesh.normals[mesh.faces].tolist() == [[[0, 0.6, 0.8]] * 3, [[0, 0, 0]] * 3]
    assert sum("without texture coordinates: each shows one" in str(each.message) for each in caught) == 1


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252", "shift-jis"]
)
def test_obj_is_read_in_every_encoding(tmp_path: Path, encoding: str) -> None:
    name = {"shift-jis": "\u6905\u5b50", "utf-16": "\u6905\u5b50"}.get(encoding, "St\u00fchle")
    mark = {"utf-16-be": "\ufeff"}.get(encoding, "")
    (tmp_path / "plate.obj").write_bytes((mark + f"# {name}\no {name}\n" + PLAIN).encode(encoding))
    check_plate(plate(tmp_path / "plate.obj"))


def test_an_obj_that_numbers_texture_coordinates_it_has_not_is_read_without(tmp_path: Path) -> None:
    lines = [line for line in PLAIN.splitlines() if not line.startswith("vt")]
    (tmp_path / "plate.obj").write_text("\n".join(lines))
    scene = plate(tmp_path / "plate.obj")
    assert scene.areas.sum() == pytest.approx(2.0)
    assert scene.shapes[0].geometry.uv is None


@pytest.mark.parametrize(
    ("face", "message"),
    [
        ("f \\\n1/1 \\\n2/9 3/1", "line 8 names texture coordinate 9, but the file has 3"),
        ("f 1/1 2/2 -5/1", "line 8 names vertex -5, but the file has 4 vertices above it (1 to 4)"),
        ("f 0 -1 -2", "line 8 names vertex 0, but the file has 4 vertices (1 to 4)"),
        ("l 0 1", "line 8 names vertex 0, but the file has 4 vertices (1 to 4)"),
        ("f / -1 -2", 'line 8 has the corner "/", but indices are whole numbers'),
    ],
)
def test_an_index_that_names_nothing_is_an_error_with_its_line(tmp_path: Path, face: str, message: str) -> None:
    (tmp_path / "plate.obj").write_text(PLAIN.replace("f 1/1 2/2 3/3", face))
    with pytest.raises(SceneError) as error:
        plate(tmp_path / "plate.obj")
    assert message in str(error.value)


@pytest.mark.parametrize("statement", ["f -1 -2 -3", "f -1/ -2/ -3/", "f -1/-1 -2/-2 -3/-3", "l -1 -2"])
def test_a_negative_index_above_all_vertices_is_an_error_with_its_line(tmp_path: Path, statement: str) -> None:
    (tmp_path / "plate.obj").write_text(f"{statement}\n{PLAIN}")
    with pytest.raises(SceneError, match="line 1 names vertex -1, but the file has 0 vertices above it"):
        plate(tmp_path / "plate.obj")


# One number that is not finite takes away its normal, vertex or facet, not the model.

DAMAGED = {
    "vn": ("vn {0} 0 0\nvn 0 0 1\n" + PLAIN.replace("f 1/1 2/2 3/3", "f 1/1/1 2/2/2 3/3/2"), 2.0, "normals that"),
    "vt": (PLAIN.replace("vt 1 1", "vt 1 {0}"), 2.0, "texture coordinates that"),
    "unused v": (PLAIN + "v 9 {0} 9\n", 2.0, "vertices that"),
    "used v": (PLAIN.replace("v 2 0 0", "v 2 {0} 0"), 1.0, "faces with such a vertex"),
    "colour of v": ("v 0 0 0 1 {0} 1\nv 2 0 0 1 1 1\nv 2 1 0 1 1 1\nf 1 2 3\n", 1.0, "colours that"),
}


@pytest.mark.parametrize(
    "number", ["nan", "-nan", "-nan(ind)", "NaN(snan)", "1.#QNAN", "-1.#IND00", "inf", "-1.#INF"]
)
@pytest.mark.parametrize("kind", DAMAGED)
def test_one_number_of_an_obj_that_is_not_finite_takes_away_one_thing(
    tmp_path: Path, kind: str, number: str
) -> None:
    text, area, name = DAMAGED[kind]
    (tmp_path / "plate.obj").write_text(text.format(number))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = load_scene(tmp_path / "plate.obj")
    assert scene.areas.sum() == pytest.approx(area)
    assert np.isfinite(scene.triangles).all()
    (warning,) = [str(each.message) for each in caught if "left out" in str(each.message)]
    assert f"{name}" in warning
    assert "(1)" in warning


def test_a_word_that_is_no_number_is_named(tmp_path: Path) -> None:
    (tmp_path / "plate.obj").write_text(PLAIN.replace("v 2 0 0", "v 2 0,5 0"))
    with pytest.raises(SceneError, match=r'line 2 has "0,5", which is not a number'):
        plate(tmp_path / "plate.obj")


SOLID = "solid a\nfacet\nouter loop\n{0}endloop\nendfacet\nendsolid\n"
#: Files with a word where a number belongs, and its line.
WORDS = {
    "v.obj": (PLAIN.replace("v 2 0 0", "v 2 {0} 0"), 2),
    "vt.obj": (PLAIN.replace("vt 1 0", "vt {0} 0"), 6),
    "f.obj": (PLAIN.replace("f 1/1 3/3", "f {0} 3/3"), 9),
    "backwards.obj": (PLAIN.replace("f 1/1 3/3", "f {0} -1"), 9),
    "v.off": ("OFF\n3 1 0\n0 0 0\n{0} 0 0\n0 1 0\n3 0 1 2\n", 4),
    "counts.off": ("OFF\n{0} 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", 2),
    "f.off": ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 {0} 2\n", 6),
    "a.ply": (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n{0} 0 0\n0 1 0\n3 0 1 2\n",
        11,
    ),
    "a.stl": (
        "solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex {0} 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n",
        5,
    ),
    "a.xml": (
        '<scene version="3.0.0">\n<shape type="sphere"><float name="radius" value="{0}"/></shape></scene>',
        2,
    ),
}


@pytest.mark.parametrize("word", ["1_0", "\u0661\u0660", "ten"])
@pytest.mark.parametrize("name", WORDS)
def test_numbers_are_of_plain_digits_in_every_format(tmp_path: Path, name: str, word: str) -> None:
    """Python's own `float` and `int` read 1_0, and digits of other scripts, as 10."""
    text, line = WORDS[name]
    (tmp_path / name).write_text(text.format(word), "utf-8")
    with pytest.raises(SceneError, match=f"line {line}") as error:
        load_scene(tmp_path / name)
    assert name in str(error.value)
    assert word in str(error.value)


def test_numbers_of_an_mtl_are_of_plain_digits(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1_0 0 0\nNs nan\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl red\n" + PLAIN)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_scene(tmp_path / "a.obj")
    told = " ".join(str(each.message) for each in caught)
    assert '"kd 1_0" of "red", which is not a finite number' in told
    assert '"ns nan" of "red", which is not a finite number' in told


def test_numbers_of_a_file_of_a_spectrum_are_of_plain_digits(tmp_path: Path) -> None:
    (tmp_path / "a.spd").write_text("# nm, value\n400 0.5\n\n5_00 0.6\n")
    spectrum = '<spectrum name="reflectance" filename="a.spd"/>'
    (tmp_path / "a.xml").write_text(
        f'<scene version="3.0.0">\n<shape type="sphere"><bsdf type="diffuse">{spectrum}</bsdf></shape></scene>'
    )
    with pytest.raises(SceneError, match=r"a\.xml: line 2, .*line 4 of .*a\.spd has no pair of numbers"):
        load_scene(tmp_path / "a.xml")


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("a.obj", PLAIN.replace("v 2 0 0", "v 2 0"), "line 2 has 2 numbers, but a vertex has at least 3"),
        ("a.obj", PLAIN.replace("f 1/1 2/2", "f 1.5 2/2"), 'line 8 has the corner "1.5"'),
        (
            "a.stl",
            "solid a\nfacet\nouter loop\n"
            + "vertex 0 0\nvertex 1 0\nvertex 0 1\n"
            + "endloop\nendfacet\nendsolid\n",
            "line 4 has 2 numbers, but a vertex has 3",
        ),
    ],
)
def test_lines_with_too_few_numbers_are_named(tmp_path: Path, name: str, text: str, found: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / name)
    assert found in str(error.value)


def test_an_obj_takes_a_time_that_grows_with_its_size_and_not_with_its_materials() -> None:
    """Four times the materials, of two triangles each, took ten times as long."""

    def seconds(materials: int) -> float:
        rows = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvn 0 0 1\n" * materials
        faces = (
            f"usemtl m{i}\nf {3 * i + 1}//{i + 1} {3 * i + 2}//1 {3 * i + 3}//1\n" * 2 for i in range(materials)
        )
        content = (rows + "".join(faces)).encode()
        start = time.process_time()
        assert len(read_obj(content, "a.obj").parts) == materials
        return time.process_time() - start

    assert min(seconds(16_000) for _ in range(2)) < 8 * min(seconds(4_000) for _ in range(2))


def test_corners_without_a_normal_have_that_of_their_face(tmp_path: Path) -> None:
    (tmp_path / "plate.obj").write_text("vn 1 0 0\n" + PLAIN.replace("f 1/1 2/2 3/3", "f 1/1/1 2/2/1 3/3/1"))
    mesh = plate(tmp_path / "plate.obj").shapes[0].geometry
    assert isinstance(mesh, Mesh)
    assert sorted(map(tuple, mesh.normals.tolist())) == [(0, 0, 0)] * 3 + [(1, 0, 0)] * 3


def test_names_that_are_not_ascii_do_not_matter_in_ply_and_stl(tmp_path: Path) -> None:
    from tests.support.damaged import PLY_HEAD

    rows = "0 0 0\n2 0 0\n2 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"
    head = PLY_HEAD.format("ascii").replace("element vertex", "comment St\u00fchle\nelement vertex")
    (tmp_path / "a.ply").write_bytes((head + rows).encode("latin-1"))
    facets = [
        np.array(f, "<f4").tobytes() for f in ([[0, 0, 0], [2, 0, 0], [2, 1, 0]], [[0, 0, 0], [2, 1, 0], [0, 1, 0]])
    ]
    body = np.uint32(2).tobytes() + b"".join(bytes(12) + f + bytes(2) for f in facets)
    (tmp_path / "a.stl").write_bytes("St\u00fchle".encode("latin-1").ljust(80, b"\xff") + body)
    for name in ("a.ply", "a.stl"):
        assert plate(tmp_path / name).areas.sum() == pytest.approx(2.0)


# What is dropped is said.

COLOURED = PLAIN.replace("0\nv", "0 1 0.5 0\nv")
RGB = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
VERTEX = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\n"
COLOURED_PLY = VERTEX + RGB + FACE + "end_header\n0 0 0 9 8 7\n1 0 0 9 8 7\n1 1 0 1 2 3\n3 0 1 2\n"
DROPPED = {
    "colours.obj": (COLOURED, "vertex colours in it are not used"),
    "materials.obj": ("mtllib a.mtl\n" + PLAIN.replace("f", "usemtl red\nf", 1), "materials in it are not used"),
    "both.obj": ("mtllib a.mtl\n" + COLOURED, "materials and vertex colours in it are not used"),
    "colours.ply": (COLOURED_PLY, "vertex colours in it are not used"),
    "faces.ply": (
        f"{VERTEX}{FACE}{RGB}end_header\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2 9 8 7\n",
        "face colours in it are not used",
    ),
    "texture.ply": (
        COLOURED_PLY.replace("element vertex", "comment TextureFile a.png\nelement vertex"),
        "a texture",
    ),
}


def scene_of(folder: Path, name: str) -> Path:
    (folder / name).write_text(DROPPED[name][0])
    shape = f'[[shapes]]\ntype = "mesh"\nfile = "{name}"\nemission = {{ radiance = 1 }}\n'
    turned = shape + "flip_normals = true\ntransform = [{ translate = [0, 0, 1] }]\n"
    head = "camera = { position = [0.5, 0.5, 5], target = [0.5, 0.5, 0] }\n"
    (folder / "scene.toml").write_text(head + shape + turned)
    return folder / "scene.toml"


@pytest.mark.parametrize("name", DROPPED)
def test_what_a_mesh_file_holds_and_is_not_used_is_said_once(tmp_path: Path, name: str) -> None:
    scene = scene_of(tmp_path, name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_scene(scene)
    (warning,) = caught
    assert issubclass(warning.category, SceneWarning)
    assert str(warning.message).startswith(f"{tmp_path / name}: {DROPPED[name][1]}")


def test_a_mesh_without_colours_brings_no_warning(tmp_path: Path) -> None:
    (tmp_path / "plate.obj").write_text(PLAIN)
    with pytest.warns(SceneWarning, match="no camera") as caught:
        load_scene(tmp_path / "plate.obj")
    assert len(caught) == 1


def test_the_command_line_says_what_is_dropped(tmp_path: Path) -> None:
    scene, text = str(scene_of(tmp_path, "both.obj")), "materials and vertex colours in it are not used"
    validated = CliRunner().invoke(app, ["validate", scene])
    assert (validated.exit_code, validated.output.count(text)) == (0, 1)
    assert CliRunner().invoke(app, ["validate", "--strict", scene]).exit_code == 1
    told = CliRunner().invoke(app, ["info", scene])
    assert (told.exit_code, told.output.count(text)) == (0, 1)
    listed = json.loads(CliRunner().invoke(app, ["info", "--json", scene]).stdout)
    assert [text in warning for warning in listed["warnings"]] == [True]


def test_the_same_warning_of_many_shapes_is_one_with_a_count() -> None:
    flat = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2], [0, 1, 1]]}
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_scene({"camera": camera, "shapes": [{**flat, "emission": {"radiance": 1}}] * 204})
    (warning,) = caught
    assert str(warning.message).startswith("204 triangles without area were dropped in 204 locations: ")
    assert str(warning.message).count(": 1") == 4
    assert warning.filename == __file__


def test_what_is_left_out_of_many_files_is_one_warning_for_each_cause(tmp_path: Path) -> None:
    shapes = []
    for number in range(6):
        nan = "nan" if number else "1"
        text = PLAIN.replace("f 1/1 2/2 3/3", "f 1/1/1 2/2/1 3/3/1") + f"vn {nan} 0 1\nv 9 nan 9\n"
        (tmp_path / f"{number}.obj").write_text(text)
        shapes.append({"type": "mesh", "file": str(tmp_path / f"{number}.obj"), "emission": {"radiance": 1}})
    camera = {"position": [0, 0, 5], "target": [0, 0, 0]}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_scene({"camera": camera, "shapes": shapes})
    told = sorted(str(each.message) for each in caught)
    assert [text.partition(": ")[0] for text in told] == [
        "5 normals that are not finite are left out in 5 locations",
        "6 vertices that are not finite are left out in 6 locations",
    ]
