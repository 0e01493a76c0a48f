"""Files that are small and unfold to much, or refer to themselves: one clear error, in bounded time and memory."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import time
import tracemalloc
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import glpath
from glpath.apps.measure.tables import read_points
from glpath.apps.terrain.reading import load_height_field
from glpath.apps.view_factors.result import FORMAT as VIEW_FACTORS_FORMAT
from glpath.apps.view_factors.result import ViewFactors
from glpath.errors import GlpathError, ImageError
from glpath.film.film import Film
from glpath.film.image import read_environment
from glpath.io.mitsuba.document import read_document
from glpath.io.named_files import NamedFiles, UnusableError
from glpath.io.weather import read_weather
from glpath.radiosity.solution import FORMAT as SOLUTION_FORMAT
from glpath.rendering import RenderJob
from glpath.system.digest import digest_of
from tests.support import honeybee_model

SCENE = '<scene version="3.0.0">{}<shape type="rectangle"/></scene>'
# Prints the error of a file, and the memory that it took beyond the imports.
MEASURED = """
import resource, sys, warnings
import glpath, glpath.io
warnings.simplefilter("ignore")
limit = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 + (1 << 30)
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
try:
    glpath.load_scene(sys.argv[1])
except glpath.GlpathError as error:
    print("error:", error)
else:
    print("read")
"""


def outcome(path: Path) -> str:
    """The error of a file, or "read", within 1 GiB and a minute of processor time."""
    done = subprocess.run([sys.executable, "-c", MEASURED, str(path)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.strip()


def defaults(folder: Path) -> str:
    """Each value is ten times the one before."""
    rows = [f'<default name="a0" value="{"x" * 100}"/>']
    rows += [f'<default name="a{i}" value="{f"$a{i - 1}," * 10}"/>' for i in range(1, 12)]
    return SCENE.format("".join(rows))


def fan(folder: Path) -> str:
    """Each file includes the next one eight times."""
    for i in range(14):
        (folder / f"i{i}.xml").write_text(SCENE.format(f'<include filename="i{i + 1}.xml"/>' * 8))
    (folder / "i14.xml").write_text(SCENE.format(""))
    return SCENE.format('<include filename="i0.xml"/>')


def nested_includes(folder: Path) -> str:
    """Elements in each other, some in each of several files."""
    for i in range(14):
        inner = f'<include filename="n{i + 1}.xml"/>'
        (folder / f"n{i}.xml").write_text(SCENE.format('<bsdf type="twosided">' * 80 + inner + "</bsdf>" * 80))
    return SCENE.format('<include filename="n0.xml"/>')


def to_itself(folder: Path) -> str:
    return SCENE.format('<bsdf type="twosided" id="a"><ref id="a"/></bsdf><shape type="cube"><ref id="a"/></shape>')


def to_each_other(folder: Path) -> str:
    rows = [f'<bsdf type="mask" id="{a}"><ref id="{b}"/></bsdf>' for a, b in ("ab", "ba")]
    return SCENE.format("".join(rows) + '<shape type="cube"><ref id="a"/></shape>')


def chain(folder: Path) -> str:
    rows = [f'<bsdf type="mask" id="b{i}"><ref id="b{i + 1}"/></bsdf>' for i in range(5000)]
    last = '<bsdf type="diffuse" id="b5000"/><shape type="cube"><ref id="b0"/></shape>'
    return SCENE.format("".join(rows) + last)


def elements(folder: Path) -> str:
    return SCENE.format("<a/>" * 600_000)


XML: list[tuple[Callable[[Path], str], str]] = [
    (defaults, "more than 4,194,304 letters in all"),
    (fan, "after 1,024 files"),
    (nested_includes, "in more than 100 elements"),
    (to_itself, "in more than 16 plugins by references"),
    (to_each_other, "in more than 16 plugins by references"),
    (chain, "in more than 16 plugins by references"),
    (elements, "the element after 524,288 others"),
]


@pytest.mark.parametrize(("text", "words"), XML, ids=lambda each: getattr(each, "__name__", ""))
def test_a_mitsuba_scene_that_grows_or_goes_in_circles_is_refused(
    text: Callable[[Path], str], words: str, tmp_path: Path
) -> None:
    (tmp_path / "a.xml").write_text(text(tmp_path))
    assert words in outcome(tmp_path / "a.xml")


@pytest.mark.parametrize("encoding", ["nope", "shift_jis", "utf-16", "idna", "hex", "rot13", "utf-7", "\u00b2"])
@pytest.mark.parametrize("version", ["3.0.0", "\u00b2", "9" * 5000, "1_0", ""])
def test_encodings_and_versions_of_xml_that_are_not_read_are_errors(
    encoding: str, version: str, tmp_path: Path
) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?>' + SCENE.format("").replace("3.0.0", version)
    (tmp_path / "a.xml").write_text(text, "utf-8")
    with pytest.raises(glpath.SceneError, match=r"a\.xml: line 1"):
        glpath.load_scene(tmp_path / "a.xml")
    (tmp_path / "a.xml").write_text(SCENE.format("").replace("3.0.0", version), "utf-8")
    if version != "3.0.0":
        with pytest.raises(glpath.SceneError, match="has the version"):
            glpath.load_scene(tmp_path / "a.xml")


def serialized(vertices: int, faces: int, data: bytes, flags: int = 0x1000) -> bytes:
    """A file of one mesh, in version 4 of the format."""
    pack = zlib.compressobj(9)
    packed = pack.compress(struct.pack("<I", flags) + b"a\0" + struct.pack("<QQ", vertices, faces))
    packed += pack.compress(data) + pack.flush()
    return struct.pack("<HH", 0x041C, 4) + packed + struct.pack("<QI", 0, 1)


def png_bomb(side: int) -> bytes:
    """A black PNG of one bit a pixel, which is packed to a thousandth of its bits."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(bytes((1 + side // 8) * side), 9)
    head = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def textured_toml(names: list[str]) -> str:
    rows = ["[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n[sky]\nzenith = [1, 1, 1]\nhorizon = [1, 1, 1]\n"]
    for i, name in enumerate(names):
        rows.append(f'[textures.t{i}]\ntype = "image"\nfile = "{name}"\n[materials.m{i}]\ntexture = "t{i}"\n')
        rows.append(f'[[shapes]]\ntype = "sphere"\nradius = 1\nmaterial = "m{i}"\n')
    return "".join(rows)


def textured_xml(names: list[str]) -> str:
    bitmap = '<texture type="bitmap" name="reflectance"><string name="filename" value="{}"/></texture>'
    shape = '<shape type="sphere"><bsdf type="diffuse">{}</bsdf></shape>'
    return SCENE.format("".join(shape.format(bitmap.format(name)) for name in names))


@pytest.fixture
def small_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits of memory that two pictures of 512 x 512 pixels exceed, instead of two of 8192 x 8192."""
    monkeypatch.setattr("glpath.system.npz._UNFOLDED", 4 * 512 * 512)


@pytest.mark.usefixtures("small_limit")
@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
@pytest.mark.parametrize(
    ("scene", "suffix"), [(textured_toml, "png"), (textured_xml, "png"), (textured_xml, "gif")]
)
def test_pictures_that_unfold_to_much_together_are_refused(
    scene: Callable[[list[str]], str], suffix: str, tmp_path: Path
) -> None:
    names = [f"t{i}.{suffix}" for i in range(3)]
    for name in names:
        if suffix == "png":
            (tmp_path / name).write_bytes(png_bomb(512))
        else:
            PIL.Image.new("P", (512, 512)).save(tmp_path / name)
    path = tmp_path / ("a.toml" if scene is textured_toml else "a.xml")
    path.write_text(scene(names[:1]))
    glpath.load_scene(path)
    path.write_text(scene(names))
    with pytest.raises(glpath.SceneError, match=r"t1\..* unfold to .* no more than 256 times"):
        glpath.load_scene(path)


@pytest.mark.usefixtures("small_limit")
def test_pictures_of_an_obj_that_unfold_to_much_together_are_left_out(tmp_path: Path) -> None:
    """The first is used, and a picture of noise after those that are left out is, too."""
    rows, materials = ["mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"], []
    for i in range(4):
        (tmp_path / f"t{i}.png").write_bytes(png_bomb(512))
        rows.append(f"usemtl m{i}\nf 1/1 2/2 3/3\n")
        materials.append(f"newmtl m{i}\nKd 0.5 0.5 0.5\nmap_Kd t{i}.png\n")
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    PIL.Image.fromarray(noise).save(tmp_path / "t3.png")
    (tmp_path / "a.obj").write_text("".join(rows))
    (tmp_path / "a.mtl").write_text("".join(materials))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = glpath.load_scene(tmp_path / "a.obj")
    assert any("unfold to" in str(each.message) for each in caught)
    assert [texture.image.shape[0] for texture in scene.textures] == [512, 64]


def test_a_picture_with_much_detail_may_be_large(tmp_path: Path, small_limit: None) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (512, 512, 3), np.uint8)
    for i in range(3):
        PIL.Image.fromarray(noise).save(tmp_path / f"t{i}.png")
    (tmp_path / "a.toml").write_text(textured_toml([f"t{i}.png" for i in range(3)]))
    with warnings.catch_warnings(record=True):
        assert len(glpath.load_scene(tmp_path / "a.toml").textures) == 3


def test_a_large_environment_is_read_and_hashed_with_one_copy(tmp_path: Path) -> None:
    """The file has a third of the bytes of its floats."""
    width, height = 4096, 1024
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    (tmp_path / "e.hdr").write_bytes(head + bytes([7, 7, 7, 128]) * (width * height))
    tracemalloc.start()
    image = read_environment(tmp_path / "e.hdr")
    digest_of(image)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert image.shape == (height, width, 3)
    assert np.all(image == image[0, 0, 0])
    assert peak < 1.6 * image.nbytes


def test_an_environment_of_repeated_pixels_does_not_unfold_without_limit(tmp_path: Path) -> None:
    """A pixel (1, 1, 1, n) repeats the one before: four bytes are 255 pixels."""
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4096 +X 8192\n"
    line = bytes([9, 9, 9, 128]) + b"".join(bytes([1, 1, 1, n]) for n in (255, 31))  # 1 + 255 + 31 * 256 pixels
    (tmp_path / "e.hdr").write_bytes(head + line * 4096)
    with pytest.raises(ImageError, match="no more than 64 times"):
        read_environment(tmp_path / "e.hdr")


def scene_with(folder: Path, content: bytes) -> Path:
    (folder / "a.serialized").write_bytes(content)
    shape = '<shape type="serialized"><string name="filename" value="a.serialized"/></shape>'
    (folder / "a.xml").write_text(f'<scene version="3.0.0">{shape}</scene>')
    return folder / "a.xml"


@pytest.mark.parametrize("counts", [(2**62, 1), (3, 2**62), (2**40, 2**40), (2**25, 2**25), (2**64 - 1, 2**64 - 1)])
def test_a_serialized_mesh_does_not_unfold_to_more_than_its_file_can_hold(
    counts: tuple[int, int], tmp_path: Path
) -> None:
    """The fourth file holds 315 MB of zeros in 0.3 MB."""
    found = outcome(
        scene_with(tmp_path, serialized(*counts, bytes(300 << 20) if counts[0] == 2**25 else bytes(64)))
    )
    assert "more than 32 times" in found


def test_a_serialized_mesh_of_many_equal_rows_is_read(tmp_path: Path) -> None:
    """A flat lattice is packed to a ninth."""
    steps = np.arange(40, dtype="<f4")
    x, y = np.meshgrid(steps, steps)
    corner = (np.arange(39)[:, None] * 40 + np.arange(39)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, 41], corner[:, None] + [0, 41, 40]]).astype("<u4")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).astype("<f4")
    content = serialized(1600, len(faces), points.tobytes() + faces.tobytes())
    with pytest.warns(glpath.SceneWarning):
        scene = glpath.load_scene(scene_with(tmp_path, content))
    assert scene.areas.sum() == pytest.approx(39**2)


def test_a_long_file_name_in_a_scene_is_an_error(tmp_path: Path) -> None:
    name = "a" * 400
    shape = '<shape type="{}"><string name="filename" value="{}"/></shape>'
    for text in (
        SCENE.format(f'<include filename="{name}.xml"/>'),
        SCENE.format(f'<path value="{name}"/>'),
        *(SCENE.format(shape.format(kind, f"{name}.{kind}")) for kind in ("obj", "ply", "serialized")),
    ):
        (tmp_path / "a.xml").write_text(text)
        with pytest.raises(GlpathError, match="aaaa"):
            glpath.load_scene(tmp_path / "a.xml")


def honeybee(folder: Path, **changes: object) -> Path:
    model = honeybee_model.two_rooms()
    for key, value in changes.items():
        model[key] = value
    return honeybee_model.write(model, folder / "a.hbjson")


def test_a_face_of_honeybee_with_a_huge_index_is_an_error(tmp_path: Path) -> None:
    corners = [[0, 0, 0], [1, 0, 0], [1, 0, 1]]
    geometry = {"type": "Mesh3D", "vertices": corners, "faces": [[0, 1, 2**40]]}
    mesh = {"type": "ShadeMesh", "identifier": "s", "geometry": geometry, "properties": {"radiance": {}}}
    with pytest.raises(glpath.SceneError, match='of "s" cannot be read'):
        glpath.load_scene(honeybee(tmp_path, shade_meshes=[mesh]))


@pytest.mark.parametrize("given", ["oops", 1, ["a"]])
def test_a_set_of_modifiers_that_is_no_table_is_an_error(given: object, tmp_path: Path) -> None:
    sets = [{"identifier": "s", "wall_set": given}]
    radiance = {"type": "ModelRadianceProperties", "modifier_sets": sets}
    properties = {"type": "ModelProperties", "radiance": radiance}
    with pytest.raises(glpath.SceneError, match=r"wall_set"):
        glpath.load_scene(honeybee(tmp_path, properties=properties))


@pytest.mark.parametrize("number", ["0x" + "f" * 4000, "0b1" + "0" * 20_000])
@pytest.mark.parametrize("line", ["fov = {}", 'name = "a"\n[film]\nresolution = [{}, 8]'])
def test_an_integer_of_thousands_of_digits_is_an_error(number: str, line: str, tmp_path: Path) -> None:
    """Python refuses to write integers of more than 4300 digits in decimal."""
    (tmp_path / "a.toml").write_text(line.format(number))
    with pytest.raises(glpath.SceneError, match=r"a\.toml: .* is 0x"):
        glpath.load_scene(tmp_path / "a.toml")


@pytest.mark.parametrize("sizes", [(5e-324, 5e-324), (60, 5e-324), (5e-324, 60)])
def test_a_view_of_honeybee_without_a_size_is_an_error(sizes: tuple[float, float], tmp_path: Path) -> None:
    """The ratio of two sizes whose tangents are zero is not a number."""
    model = honeybee_model.two_rooms()
    view = model["properties"]["radiance"]["views"][0]
    view["h_size"], view["v_size"] = sizes
    with pytest.raises(glpath.SceneError, match=r"at least 0\.001 and less than 180 degrees"):
        glpath.load_scene(honeybee_model.write(model, tmp_path / "a.hbjson"))


@pytest.mark.parametrize("name", ["b" * 20_000, "material-x12345"])
@pytest.mark.parametrize("letters", ["ba" * 10_000, "material-number-"])
def test_an_error_about_an_unknown_name_is_quick_and_short(name: str, letters: str, tmp_path: Path) -> None:
    rows = [f'<bsdf type="diffuse" id="{letters}{i:06}"/>' for i in range(30 if len(letters) > 99 else 20_000)]
    shape = f'<shape type="cube"><ref id="{name}"/></shape>'
    (tmp_path / "a.xml").write_text(SCENE.format("".join(rows) + shape))
    start = time.process_time()
    with pytest.raises(glpath.SceneError, match=r"\.\.\. \([0-9,]+ more\)") as caught:
        glpath.load_scene(tmp_path / "a.xml")
    assert time.process_time() - start < 5
    assert len(str(caught.value)) < 4000


def test_a_syntax_error_shows_a_part_of_a_long_line(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("name = [" + "1, " * 100_000 + "x]")
    with pytest.raises(glpath.SceneError, match=r"column \d+ is not valid TOML") as caught:
        glpath.load_scene(tmp_path / "a.toml")
    last, caret = str(caught.value).splitlines()[-2:]
    assert len(last) < 150
    assert last[caret.index("^")] == "x"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f'<default name="{"a" * 1000}" value="1"/>', "of 1,000 letters, but 256 are the most"),
        (f'<default name="a" value="${"a" * 400_000}"/>', "of 400,000 letters, but 256 are the most"),
        (
            f'<default name="b" value="{"b" * 200}"/><default name="$b$b" value="1"/>',
            "the parameter .* of 400 letters, but 256 are the most",
        ),
        (f'<bsdf type="\U0001f600{"x" * 20_000}"/>', "line 1 names the type .* of 20,001 letters, but 256 are"),
        (f"<{'x' * 20_000}/>", "line 1 names the tag .* of 20,000 letters, but 256 are"),
        ('<path value="."/>' * 1025, "the <path> after 1,024 others"),
    ],
)
def test_long_names_and_many_paths_of_mitsuba_are_errors(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(SCENE.format(text))
    with pytest.raises(glpath.SceneError, match=words):
        glpath.load_scene(tmp_path / "a.xml")


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
def test_many_parameters_of_mitsuba_are_read_in_linear_time(tmp_path: Path) -> None:
    rows = [f'<default name="q{i}" value="$q0"/>' for i in range(1, 20_000)]
    (tmp_path / "a.xml").write_text(SCENE.format('<default name="q0" value="0"/>' + "".join(rows)))
    start = time.process_time()
    glpath.load_scene(tmp_path / "a.xml")
    assert time.process_time() - start < 5


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
def test_a_folder_that_many_paths_name_is_searched_once(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    names = [".", "sub", "./sub", "sub/../sub", str(tmp_path / "sub")]
    (tmp_path / "a.xml").write_text(SCENE.format("".join(f'<path value="{name}"/>' for name in names)))
    (child,) = read_document(tmp_path / "a.xml", {}).root.children
    assert [folder.name for folder in child.searched.folders] == ["sub", tmp_path.name]


def test_a_polygon_of_very_many_corners_is_an_error(tmp_path: Path) -> None:
    """Its ears take quadratic time in the worst case."""
    count = 20_000
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = 1 + 0.5 * (np.arange(count) % 2)
    points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    rows = "".join(f"v {x} {y} 0\n" for x, y in points)
    (tmp_path / "a.obj").write_text(rows + "f " + " ".join(map(str, range(1, count + 1))) + "\n")
    with pytest.raises(glpath.SceneError, match=r"a\.obj: .*20,000 corners, but 16,384 are the most"):
        glpath.load_scene(tmp_path / "a.obj")


def test_a_scene_of_very_many_bytes_is_refused_with_a_remedy(tmp_path: Path) -> None:
    """Its text alone would take half a minute."""
    (tmp_path / "a.toml").write_bytes(b"\n" * (200 << 20))
    with pytest.raises(glpath.SceneError, match=r"more than the 8,388,608 bytes(.|\n)*\[\[assets\]\]"):
        glpath.load_scene(tmp_path / "a.toml")
    (tmp_path / "job.json").write_bytes(b" " * (9 << 20))
    with pytest.raises(glpath.UsageError, match=r"job\.json: cannot be read as a render job: it has .* bytes"):
        RenderJob.load(tmp_path / "job.json")


def test_a_file_that_is_no_spectrum_or_scene_is_not_quoted(tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("hidden:x:0:0\n")
    spectrum = '<bsdf type="diffuse"><spectrum name="reflectance" filename="secret.txt"/></bsdf>'
    for text in ('<include filename="secret.txt"/>', f'<shape type="cube">{spectrum}</shape>'):
        (tmp_path / "a.xml").write_text(SCENE.format(text))
        with pytest.raises(glpath.SceneError, match=r"secret\.txt") as caught:
            glpath.load_scene(tmp_path / "a.xml")
        assert "hidden" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".epw", ".csv"])
def test_weather_of_very_many_rows_is_refused_before_its_table_is_made(suffix: str, tmp_path: Path) -> None:
    (tmp_path / f"a{suffix}").write_text("LOCATION,A,B,C,D,1,0,0,0,0\n" + "1\n" * 8_000_000)
    with pytest.raises(glpath.SceneError, match=r"has 8,000,001 lines, but a weather file has at most 527,140"):
        read_weather(tmp_path / f"a{suffix}")


def test_an_ascii_grid_is_parsed_to_its_last_height(tmp_path: Path) -> None:
    header = "ncols {}\nnrows 2\ncellsize 1\n"
    (tmp_path / "a.asc").write_text(header.format(2) + "11 " * 5_000_000)
    tracemalloc.start()
    with pytest.raises(glpath.SceneError, match="has more than 4 heights where 2 x 2 are announced"):
        load_height_field(tmp_path / "a.asc")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5 * 15_000_000
    (tmp_path / "a.asc").write_text(header.format(10**18) + "11 " * 5_000_000)
    with pytest.raises(glpath.SceneError, match=r"do not fit in 15,000,0\d\d bytes"):
        load_height_field(tmp_path / "a.asc")


@pytest.mark.parametrize("text", ["1," * 1_000_000, "a," * 1_000_000 + "\n1,2,3\n", "a," * 30_000 + "\n1,2\n"])
def test_a_table_of_points_with_very_many_columns_is_refused_briefly(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(glpath.UsageError, match=r"a\.csv, line 1: ") as caught:
        read_points(tmp_path / "a.csv", None)
    assert len(str(caught.value)) < 600


def test_a_mesh_file_of_very_many_parts_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.io.obj.MAX_PARTS", 100)
    monkeypatch.setattr("glpath.io.stl.MAX_PARTS", 100)
    rows = "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(101))
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + rows)
    with pytest.raises(glpath.SceneError, match=r"a\.obj: line 204 .* a material after 100 others"):
        glpath.load_scene(tmp_path / "a.obj")
    facet = "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet\n"
    (tmp_path / "a.stl").write_text(f"solid a\n{facet}endsolid a\n" * 101)
    with pytest.raises(glpath.SceneError, match=r"a\.stl: .* more than 100 solids"):
        glpath.load_scene(tmp_path / "a.stl")


@pytest.mark.parametrize("names", [lambda i: f"mtllib none{i}.mtl\n", lambda i: f"none{i}.mtl "])
def test_few_of_very_many_missing_libraries_are_looked_for(names: Callable[[int], str], tmp_path: Path) -> None:
    listed = "".join(map(names, range(20_000)))
    rows = listed if listed.startswith("mtllib") else f"mtllib {listed}\n"
    (tmp_path / "a.obj").write_text(rows + "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    start = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        glpath.load_scene(tmp_path / "a.obj")
    assert time.process_time() - start < 5
    assert sum("Material libraries after the first 100" in str(each.message) for each in caught) == 1
    assert len(caught) < 110


def test_folders_are_listed_once_for_many_missing_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for i in range(5):
        (tmp_path / f"folder{i}").mkdir()
    (tmp_path / "folder3" / "Tile.PNG").touch()
    listed = Counter[str]()
    for name in ("listdir", "scandir"):
        real = getattr(os, name)

        def list_and_count(path: Path, name: str = name, real: Callable[[Path], object] = real) -> object:
            listed[f"{name} {path}"] += 1
            return real(path)

        monkeypatch.setattr(os, name, list_and_count)
    files = NamedFiles()
    for i in range(20):
        with pytest.raises(UnusableError, match="which does not exist"):
            files.find(tmp_path, f"a/b/missing-{i}\u00e9.png")
    assert files.find(tmp_path, "C:/textures/tile.png") == tmp_path / "folder3" / "Tile.PNG"
    assert len(listed) >= 7
    assert max(listed.values()) == 1


_PLY = (
    "ply\nformat ascii 1.0\n{}element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 {}\n3 0 1 2\n"
)
_STL = "solid a\n{}facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 {}\nendloop\nendfacet"
_OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 {}\n{}f 1 2 3\n"
_NAN, _BLANKS, _CONTINUED = "nan(" + "+nan(" * 20_000, " " * 20_000, "\\\n" * 20_000
_LONG_LINES = {
    "a.obj": (
        _OBJ.format(0, _CONTINUED),
        _OBJ.format(0, f"map_{'a' * 20_000} \\\n{_CONTINUED}"),
        _OBJ.format(0, f"#MRGB {'0' * 20_001}\n"),
        _OBJ.format(_NAN, ""),
        _OBJ.format(_BLANKS, f"{_BLANKS}g{_BLANKS}"),
    ),
    "a.mtl": (_CONTINUED, f"newmtl a\nmap_Kd {' -o 1 1 1' * 3000}", f"newmtl a\nmap_Kd a -o {'1' * 20_000}x"),
    "a.off": (f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 {_NAN}\n3 0 1 2\n", f"OFF\n{_CONTINUED}3 1 0\n"),
    "a.stl": (
        _STL.format("", _NAN),
        _STL.format(_CONTINUED, 0),
        _STL.format(f"solid facet{_BLANKS}\n" + "solid facet " * 2000, 0),
        _STL.format("solid facet" + "\n" * 20_000, 0),
    ),
    "a.ply": (
        _PLY.format("", _NAN),
        _PLY.format(f"comment TextureFile{_BLANKS}\n", 0),
        _PLY.format(f"comment {'TextureFile ' * 2000}\n", 0),
        _PLY.format(f"comment\n{_BLANKS}end_header{_BLANKS}x\n", 0),
    ),
    "a.toml": (
        f"{_BLANKS}x=1",
        f"[[{_BLANKS}x",
        f"x={{{'a.' * 20_000}a=1}}",
        r'"\"".' * 20_000 + "a=1",
        "[" + r'"\"".' * 3000 + "a]\n" + "".join(f"a{i}=1\n" for i in range(8000)),
        r'{"\"' * 20_000,
        f'"{_BLANKS}{_BLANKS}',
        "[" * 20_000,
        f"{'x' * 20_000} {_BLANKS}",
    ),
    "a.ies": (f"IESNA:LM-63-2002\n{_BLANKS}TILT={_BLANKS}x\n", f"IESNA91\nTILT=NONE\n{'1,' * 20_000}x"),
    "a.xml": (
        SCENE.format(f'<sensor type="perspective"><string name="focal_length" value="{_BLANKS}1"/></sensor>'),
    ),
}


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
@pytest.mark.parametrize(
    ("name", "text"),
    [(name, text) for name, texts in _LONG_LINES.items() for text in texts],
    ids=lambda each: each[:9],
)
def test_a_line_of_one_long_pattern_is_read_in_linear_time(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    scene = tmp_path / name
    if name == "a.mtl":
        scene = tmp_path / "a.obj"
        scene.write_text("mtllib a.mtl\nusemtl a\n" + _OBJ.format(0, ""))
    elif name == "a.ies":
        scene = tmp_path / "a.toml"
        scene.write_text('[[lights]]\ntype = "point"\nposition = [0, 0, 0]\nprofile = "a.ies"\n')
    begun = time.process_time()
    with suppress(GlpathError):
        glpath.load_scene(scene)
    assert time.process_time() - begun < 1.5


def write_npz(path: Path, method: int, **arrays: object) -> Path:
    """Write an .npz file whose arrays are compressed by a method of `zipfile`."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.save(file, np.asarray(values))
    return path


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_arrays_in_slow_compression_are_refused_before_they_are_unpacked(
    method: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_npz(tmp_path / "a.npz", method, radiance=np.ones((2, 2, 3)), film_format=1)
    monkeypatch.setattr(zipfile.ZipFile, "open", None)
    for read in (glpath.read_image, Film.load):
        with pytest.raises(ImageError, match=r"is compressed by (bzip2|lzma), expected deflate, or no compression"):
            read(path)


def test_arrays_that_unfold_to_much_are_refused_before_they_are_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_npz(tmp_path / "a.npz", zipfile.ZIP_DEFLATED, radiance=np.ones((64, 64, 3)))
    assert glpath.read_image(path).shape == (64, 64, 3)
    monkeypatch.setattr("glpath.system.npz._UNFOLDED", 1 << 10)
    monkeypatch.setattr(zipfile.ZipFile, "open", None)
    with pytest.raises(ImageError, match="unfold to"):
        glpath.read_image(path)


JSON_TEXTS: dict[str, tuple[Callable[[Path], object], dict[str, object]]] = {
    "metadata": (Film.load, {}),
    "made_by": (glpath.RadiositySolution.load, {"radiosity_format": SOLUTION_FORMAT}),
    "statistics": (
        ViewFactors.load,
        {
            "glpath_view_factors": VIEW_FACTORS_FORMAT,
            "shape": [1, 1],
            "data": [0.0],
            "indices": [0],
            "indptr": [0, 1],
            "areas": [1.0],
            "error": [0.0],
            "backs": [0.0],
            "backs_error": [0.0],
            "names": np.zeros(0, np.str_),
        },
    ),
}


@pytest.mark.parametrize("name", JSON_TEXTS)
@pytest.mark.parametrize(("json", "kind"), [("[]", "a list"), ("3", "a number"), ("null", "null")])
def test_json_text_that_is_no_object_is_named(name: str, json: str, kind: str, tmp_path: Path) -> None:
    read, others = JSON_TEXTS[name]
    path = write_npz(tmp_path / "a.npz", zipfile.ZIP_DEFLATED, **others, **{name: json})
    with pytest.raises(ImageError, match=f"its {name} is {kind}, expected an object"):
        read(path)


@pytest.mark.parametrize("name", JSON_TEXTS)
def test_compressed_json_text_has_a_maximum_length(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.system.npz.MAX_TEXT_BYTES", 1000)
    read, others = JSON_TEXTS[name]
    text = "[" + "[]," * 3000 + "[]]"
    path = write_npz(tmp_path / "a.npz", zipfile.ZIP_DEFLATED, **others, **{name: text})
    with pytest.raises(
        ImageError, match=rf"`{name}` is a compressed text of 9,\d+ letters, expected 1,000 at most"
    ):
        read(path)
    path = write_npz(tmp_path / "a.npz", zipfile.ZIP_STORED, **others, **{name: text})
    with pytest.raises(ImageError, match=f"its {name} is a list"):
        read(path)
