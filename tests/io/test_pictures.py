"""Pictures that models name wrongly: found in another case or folder; if they are missing, a warning."""

from __future__ import annotations

import json
import os
import struct
import time
import tracemalloc
import warnings
import zlib
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image

from glpath import load_scene
from glpath.errors import SceneError, TimeLimitError
from glpath.io.completed import aside
from glpath.io.named_files import NamedFiles, UnusableError
from glpath.io.pictures import Pictures, pixels_of
from glpath.scene.model import Scene
from glpath.system.colour import decode_srgb
from glpath.system.time_limit import limited, named_work

BROWN = (120, 80, 40)
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
UV = np.array([[0, 0], [1, 0], [0, 1]], "<f4")


def obj(folder: Path, name: str) -> Path:
    (folder / "a.obj").write_text(
        "mtllib A.MTL\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    )
    (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {name}\n")
    return folder / "a.obj"


def gltf(folder: Path, name: str, **material: object) -> Path:
    (folder / "a.bin").write_bytes(TRIANGLE.tobytes() + UV.tobytes())
    pbr = {"baseColorTexture": {"index": 0}, "metallicFactor": 0}
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": pbr, **material}],
        "textures": [{"source": 0}],
        "images": [{"uri": name}],
        "buffers": [{"uri": "a.bin", "byteLength": 60}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 24},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [0, 0, 0],
                "max": [1, 1, 0],
            },
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
    }
    (folder / "a.gltf").write_text(json.dumps(document))
    return folder / "a.gltf"


def ply(folder: Path, name: str) -> Path:
    (folder / "a.ply").write_text(
        f"ply\nformat ascii 1.0\ncomment TextureFile {name}\nelement vertex 3\nproperty float x\n"
        "property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    )
    return folder / "a.ply"


def mitsuba(folder: Path, name: str) -> Path:
    texture = f'<texture name="reflectance" type="bitmap"><string name="filename" value="{name}"/></texture>'
    shape = f'<shape type="rectangle"><bsdf type="diffuse">{texture}</bsdf></shape>'
    (folder / "a.xml").write_text(f'<scene version="3.0.0"><sensor type="perspective"/>{shape}</scene>')
    return folder / "a.xml"


FORMATS = {"obj": obj, "gltf": gltf, "ply": ply, "mitsuba": mitsuba}
# Of Mitsuba's format grey stands in for a picture that is missing, and less of Pillow's formats is read.
MODELS = ("obj", "gltf", "ply")


def read(path: Path) -> tuple[Scene, list[str]]:
    with warnings.catch_warnings(record=True) as caught, aside("camera", "light"):
        warnings.simplefilter("always")
        scene = load_scene(path)
    return scene, [str(each.message) for each in caught]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    ("stored", "name", "is_moved"),
    [
        ("wood.png", "wood.png", False),
        ("wood.png", "Wood.PNG", False),
        ("Tex/wood.png", "tex/Wood.png", False),
        ("tex/wood.png", "tex\\wood.png", False),
        ("wood.png", "tex/wood.png", True),
        ("wood.png", "/home/somebody/tex/wood.png", True),
        ("wood.png", "C:\\models\\tex\\Wood.png", True),
        ("wood.png", "../textures/wood.png", True),
        ("maps/wood.png", "wood.png", True),
        ("my wood.png", "my wood.png", False),
        ("50% oak.png", "50% oak.png", False),
        ("50% oak.png", "C:\\models\\50% Oak.png", True),
    ],
)
def test_a_picture_is_found_in_another_case_or_folder(
    tmp_path: Path, form: str, stored: str, name: str, is_moved: bool
) -> None:
    (tmp_path / stored).parent.mkdir(exist_ok=True)
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / stored)
    scene, messages = read(FORMATS[form](tmp_path, quote(name) if form == "gltf" else name))
    assert [texture.image[0, 0, :3].tolist() for texture in scene.textures] == [list(BROWN)]
    words = f'(1): for "{name}" {stored} is read.'
    assert [message.partition("folder of the model ")[2] for message in messages] == [words] * is_moved


@pytest.mark.parametrize(
    ("stored", "written"),
    [
        ("Ko\u0308ln.png", "K\u00f6ln.png".encode()),
        ("K\u00f6ln.png", "Ko\u0308ln.png".encode()),
        ("\u767d.png", "\u767d.png".encode("gbk")),
        ("\u8868.png", "\u8868.png".encode("cp932")),
        (os.fsdecode("\u767d.png".encode("gbk")), "\u767d.png".encode("gbk")),
    ],
    ids=["NFD for NFC", "NFC for NFD", "GBK", "Shift-JIS with a backslash", "bytes"],
)
def test_a_picture_is_found_by_its_name_in_another_encoding(tmp_path: Path, stored: str, written: bytes) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / "wood.png")
    (tmp_path / "wood.png").rename(tmp_path / stored)
    path = obj(tmp_path, "wood.png")
    (tmp_path / "a.mtl").write_bytes(b"newmtl m\nmap_Kd " + written + b"\n")
    scene, messages = read(path)
    assert [texture.image[0, 0, :3].tolist() for texture in scene.textures] == [list(BROWN)]
    assert messages == []


@pytest.mark.parametrize("form", MODELS)
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("gone.png", "which does not exist"),
        ("../gone.png", "which is outside the folder of the model"),
        ("../secret.png", "which is outside the folder of the model"),
        ("C:\\dir\\gone.png", "which is outside the folder of the model"),
        ("/home/somebody/gone.png", "which is outside the folder of the model"),
        ("x" * 400 + ".png", "which does not exist"),
    ],
)
def test_a_missing_picture_is_a_warning(tmp_path: Path, form: str, name: str, reason: str) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / "secret.png")
    (tmp_path / "model").mkdir()
    scene, messages = read(FORMATS[form](tmp_path / "model", name))
    shown = name if len(name) < 100 else "x" * 120 + " ..."
    assert scene.textures == ()
    assert [message.partition("not used: ")[2] for message in messages] == [f'The texture "{shown}", {reason}.']


@pytest.mark.parametrize("name", ["gone.png", "../gone.png", "C:\\dir\\gone.png", "x" * 400 + ".png"])
def test_grey_stands_in_for_a_missing_picture_of_mitsuba(tmp_path: Path, name: str) -> None:
    scene, messages = read(mitsuba(tmp_path, name))
    assert [f"{name}, which does not exist: grey" in message for message in messages][:1] == [True]
    assert decode_srgb(scene.textures[0].image[0, 0] / 255) == pytest.approx([0.5] * 3, abs=0.005)


def test_missing_pictures_are_one_warning(tmp_path: Path) -> None:
    obj(tmp_path, "a.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\nmap_Ke b.png\n")
    _, messages = read(tmp_path / "a.obj")
    words = '2 textures, each of which does not exist: "a.png", "b.png".'
    assert [message.partition("not used: ")[2] for message in messages] == [words]
    path = mitsuba(tmp_path, "a.png")
    shape = path.read_text().partition("<shape")[2].partition("</scene>")[0]
    path.write_text(path.read_text().replace("</scene>", f"<shape{shape.replace('a.png', 'b.png')}</scene>"))
    _, messages = read(path)
    assert ["2 pictures that do not exist" in message for message in messages].count(True) == 1


@pytest.mark.parametrize("form", FORMATS)
def test_of_several_pictures_that_nearest_to_the_name_is_read(tmp_path: Path, form: str) -> None:
    for folder, colour in (("a", (1, 2, 3)), ("b", BROWN), ("c", (4, 5, 6))):
        (tmp_path / folder).mkdir()
        Image.new("RGB", (2, 2), colour).save(tmp_path / folder / "wood.png")
    scene, messages = read(FORMATS[form](tmp_path, "/home/somebody/B/wood.png"))
    assert scene.textures[0].image[0, 0, :3].tolist() == list(BROWN)
    words = 'for "/home/somebody/B/wood.png" b/wood.png is read (one of 3 files of that name).'
    assert sum(words in message for message in messages) == 1
    scene, messages = read(FORMATS[form](tmp_path, "wood.png"))
    assert scene.textures[0].image[0, 0, :3].tolist() == [1, 2, 3]
    words = 'for "wood.png" a/wood.png is read (one of 3 files of that name).'
    assert sum(words in message for message in messages) == 1


@pytest.mark.parametrize("name", ["Banan(1).png", "nan(1).png", "nan(1)", "x 1.#INF.png"])
def test_a_name_is_not_taken_for_a_number(tmp_path: Path, name: str) -> None:
    """C libraries write nan(1) and 1.#INF for numbers, which are then read as such."""
    _, messages = read(obj(tmp_path, name))
    assert [message.partition("not used: ")[2] for message in messages] == [
        f'The texture "{name}", which does not exist.'
    ]


def test_a_name_in_a_gltf_is_decoded(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / "Holz \u00e4.png")
    scene, messages = read(gltf(tmp_path, "Holz%20%C3%A4.png"))
    assert scene.textures[0].image[0, 0, :3].tolist() == list(BROWN)
    assert messages == []


def test_a_buffer_is_read_from_its_own_path_alone(tmp_path: Path) -> None:
    """Positions of another file would make a model that nobody wrote."""
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / "wood.png")
    path = gltf(tmp_path, "wood.png")
    (tmp_path / "a.bin").rename(tmp_path / "A.BIN")
    scene, messages = read(path)
    assert scene.areas.sum() == 0.5
    assert [message.partition("not used: ")[2] for message in messages] == [
        'The case of letters in "a.bin": A.BIN is read.'
    ]
    (tmp_path / "old").mkdir()
    (tmp_path / "A.BIN").rename(tmp_path / "old" / "a.bin")
    with pytest.raises(SceneError, match=r'buffers\[0\]\.uri names "a\.bin", which does not exist'):
        read(path)
    path.write_text(path.read_text().replace("a.bin", "y" * 400))
    with pytest.raises(SceneError, match=r"buffers\[0\]\.uri names .*, which does not exist"):
        read(path)


def test_a_surface_does_not_glow_for_a_missing_map_of_its_light(tmp_path: Path) -> None:
    path = gltf(tmp_path, "gone.png", emissiveFactor=[1, 1, 1], emissiveTexture={"index": 0})
    scene, _ = read(path)
    assert not scene.shapes[0].emission.any()


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("suffix", ["bmp", "gif", "tif", "png", "webp"])
def test_formats_of_pillow_are_read(tmp_path: Path, form: str, suffix: str) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / f"wood.{suffix}", lossless=True)
    scene, messages = read(FORMATS[form](tmp_path, f"wood.{suffix}"))
    assert [texture.image[0, 0, :3].tolist() for texture in scene.textures] == [list(BROWN)]
    assert messages == []


# What one texel of each becomes: bytes of sRGB, of which others know that they are one colour, or linear floats.
PIXELS: dict[str, tuple[Image.Image, dict[str, object], list[float]]] = {
    "float.tif": (Image.fromarray(np.full((2, 2), 0.5, np.float32)), {}, [0.5, 0.5, 0.5]),
    "grey16.tif": (Image.fromarray(np.full((2, 2), 0x8040, np.uint16)), {}, [128, 128, 128]),
    "grey16.png": (Image.fromarray(np.full((2, 2), 0x8040, np.uint16)), {}, [128, 128, 128]),
    "hole16.png": (
        Image.fromarray(np.full((2, 2), 0x8040, np.uint16)),
        {"transparency": 0x8040},
        [128, 128, 128, 0],
    ),
    "bit.png": (Image.new("1", (2, 2), 1), {}, [255, 255, 255]),
    "bit.tif": (Image.new("1", (2, 2), 1), {}, [255, 255, 255]),
    "palette.png": (Image.new("RGB", (2, 2), BROWN).quantize(), {"transparency": bytes([77])}, [*BROWN, 77]),
    "palette.gif": (Image.new("RGB", (2, 2), BROWN).quantize(), {}, [*BROWN]),
    "grey.png": (Image.new("LA", (2, 2), (128, 77)), {}, [128, 128, 128, 77]),
    "grey.tif": (Image.new("LA", (2, 2), (128, 77)), {}, [128, 128, 128, 77]),
    "print.tif": (Image.new("RGB", (2, 2), BROWN).convert("CMYK"), {}, [*BROWN]),
    "print.jpg": (Image.new("RGB", (2, 2), BROWN).convert("CMYK"), {"quality": 100}, [*BROWN]),
}


@pytest.mark.parametrize("name", PIXELS)
def test_a_picture_of_any_pixels_has_its_colours(tmp_path: Path, name: str) -> None:
    image, options, expected = PIXELS[name]
    image.save(tmp_path / name, **options)
    texel = Pictures(tmp_path).read(name)[0, 0]
    assert texel.tolist() == expected
    assert texel.dtype == (np.float32 if name.startswith("float") else np.uint8)


def test_lab_tiff_is_opaque(tmp_path: Path) -> None:
    Image.new("LAB", (1, 1), (128, 128, 128)).save(tmp_path / "a.tif")
    luminance = ((100 * 128 / 255 + 16) / 116) ** 3  # CIE 1976
    grey = 255 * (1.055 * luminance ** (1 / 2.4) - 0.055)  # IEC 61966-2-1
    assert Pictures(tmp_path).read("a.tif")[0, 0].tolist() == pytest.approx([grey] * 3, abs=1)


def test_a_float_tiff_is_linear(tmp_path: Path) -> None:
    Image.fromarray(np.full((2, 2), 0.5, np.float32)).save(tmp_path / "float.tif")
    for path in (obj(tmp_path, "float.tif"), mitsuba(tmp_path, "float.tif")):
        scene, _ = read(path)
        assert scene.textures[0].linear()[0, 0].tolist() == [0.5, 0.5, 0.5]
    with pytest.raises(SceneError, match="its pixels are floats"):
        read(gltf(tmp_path, "float.tif"))


WHITE_IS_ZERO = {262: 0}
WIDE = {
    "whole numbers of 32 bits": (np.full((2, 2), 0x40408080, np.int32), {}, "numbers of 32 bits for which it"),
    "white is 0": (np.full((2, 2), 0x2020, np.uint16), WHITE_IS_ZERO, "numbers of 16 bits for which 0 is white"),
    "NaN": (np.full((2, 2), np.nan, np.float32), {}, "pixels are NaN or infinite"),
}


@pytest.mark.parametrize("kind", WIDE)
def test_pixels_of_which_white_is_not_known_are_refused(tmp_path: Path, kind: str) -> None:
    """They were read as black, or as white."""
    pixels, tags, words = WIDE[kind]
    Image.fromarray(pixels).save(tmp_path / "wide.tif", tiffinfo=tags)
    scene, messages = read(obj(tmp_path, "wide.tif"))
    assert scene.textures == ()
    assert [words in message for message in messages] == [True]
    with pytest.raises(SceneError, match=words):
        read(gltf(tmp_path, "wide.tif"))


def test_a_mesh_of_no_vertices_is_left_out(tmp_path: Path) -> None:
    path = gltf(tmp_path, "wood.png")
    document = json.loads(path.read_text())
    document["accessors"].append({"componentType": 5126, "count": 0, "type": "VEC3"})
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 2}})
    path.write_text(json.dumps(document))
    scene, _ = read(path)
    assert scene.areas.sum() == 0.5


@pytest.mark.parametrize("name", ["Wood.BMP", "tex/wood.bmp", "/home/somebody/wood.bmp"])
def test_mitsuba_finds_pictures_as_models_do(tmp_path: Path, name: str) -> None:
    Image.new("RGB", (2, 2), BROWN).save(tmp_path / "wood.bmp")
    scene, _ = read(mitsuba(tmp_path, name))
    assert scene.textures[0].image[0, 0, :3].tolist() == list(BROWN)


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA", "LA", "CMYK"])
def test_pixels_are_converted_in_strips_without_copies_of_the_picture(
    mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (600, 500, 4), np.uint8)
    image = Image.fromarray(noise).convert("RGB").convert(mode) if mode != "RGBA" else Image.fromarray(noise)
    if mode == "P":
        image.info["transparency"] = 3
    alpha = "A" in mode or mode == "P"
    expected = np.asarray(image.convert("RGBA" if alpha else "RGB"))
    monkeypatch.setattr("glpath.io.pictures._STRIP_PIXELS", 10_000)
    tracemalloc.start()
    found = pixels_of(image)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.array_equal(found, expected)
    assert peak < 1.3 * found.nbytes


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
@pytest.mark.parametrize("form", ["obj", "gltf"])
def test_webp_pictures_count_the_copies_that_their_decoder_holds(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Image.new("RGB", (512, 512)).save(tmp_path / "a.webp", lossless=True)
    path = obj(tmp_path, "a.webp") if form == "obj" else gltf(tmp_path, "a.webp")
    monkeypatch.setattr("glpath.system.npz._UNFOLDED", 16 * 512 * 512)
    load_scene(path)
    monkeypatch.setattr("glpath.system.npz._UNFOLDED", 16 * 512 * 512 - 1)
    with pytest.raises(SceneError, match="unfold to") if form == "gltf" else pytest.warns(match="unfold to"):
        load_scene(path)


def webp_of(side: int) -> bytes:
    """The start of a WebP file whose header says that it is `side` pixels wide and high."""
    head = b"VP8X" + (10).to_bytes(4, "little") + bytes(4) + (side - 1).to_bytes(3, "little") * 2
    return b"RIFF" + (len(head) + 4).to_bytes(4, "little") + b"WEBP" + head


@pytest.mark.parametrize(("side", "words"), [(16_384, "of 16,384 x 16,384 pixels"), (8192, "unfold to 1.07 GB")])
def test_the_size_of_a_webp_picture_is_checked_before_pillow_opens_it(
    side: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pillow's decoder allocates all pixels when it opens a file."""
    monkeypatch.setattr(Image, "open", None)
    (tmp_path / "a.webp").write_bytes(webp_of(side))
    with pytest.raises(UnusableError, match=words):
        Pictures(tmp_path).read("a.webp")


def test_missing_files_are_searched_for_up_to_a_maximum(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two missing files cost as much as all searches; then a file is found by its exact name alone."""
    monkeypatch.setattr("glpath.io.named_files._MAX_SEARCHES", 20)
    for name in ("a.png", "b.png", "c.png", "d.png"):
        (tmp_path / name).touch()
    files = NamedFiles()
    for name, stored in (("x.png", "a.png"), ("y.png", "b.png")):
        assert files.find(tmp_path, f"elsewhere/{stored}") == tmp_path / stored
        with pytest.raises(UnusableError, match="which does not exist"):
            files.find(tmp_path, name)
    with pytest.raises(UnusableError, match="which is not where it is named"):
        files.find(tmp_path, "elsewhere/c.png")
    assert files.find(tmp_path, "d.png") == tmp_path / "d.png"
    assert any("after many files that are not where they are named" in text for text in files.notes())


def test_a_link_to_the_outside_is_not_followed_after_many_searches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.io.named_files._MAX_SEARCHES", 0)
    (tmp_path / "model").mkdir()
    (tmp_path / "a.png").touch()
    (tmp_path / "model" / "a.png").symlink_to(tmp_path / "a.png")
    with pytest.raises(UnusableError):
        NamedFiles().find(tmp_path / "model", "a.png")


def test_very_many_missing_files_are_reported_in_linear_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.io.named_files._MAX_SEARCHES", 500)
    files = NamedFiles()
    start = time.process_time()
    for number in range(5000):
        with suppress(UnusableError):
            files.find(tmp_path, f"a/b/{number}.png")
        files.unusable[f"{number}.png"] = f"which has the number {number}"
    assert len(files.notes()) == 5001
    assert time.process_time() - start < 0.6


def test_a_search_for_files_ends_at_the_time_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.0)
    with pytest.raises(TimeLimitError), limited(1e-9), named_work("reading a model"):
        NamedFiles().find(tmp_path, "a.png")


def tiled_tiff(side: int, tile: int) -> bytes:
    """TIFF of (side, side) RGB pixels in one compressed tile, almost all of which is missing."""
    data = zlib.compress(bytes(3 * tile * min(tile, 64)))
    tags = [(256, side), (257, side), (258, 0), (259, 8), (262, 2), (277, 3), (284, 1), (322, tile), (323, tile)]
    start = 10 + 12 * (len(tags) + 2) + 4
    tags = [*tags, (324, start + 8), (325, len(data))]
    entries = [struct.pack("<HHLL", tag, 4, 1, value) for tag, value in tags]
    entries[2] = struct.pack("<HHLL", 258, 3, 3, start)
    head = b"II*\0" + struct.pack("<LH", 8, len(tags)) + b"".join(entries) + struct.pack("<L", 0)
    return head + struct.pack("<4H", 8, 8, 8, 0) + data


def run_length_bmp(width: int, height: int) -> bytes:
    """BMP whose rows are a pixel and the end of the line."""
    rows = b"\1\1\0\0" * height + b"\0\1"
    head = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 1, len(rows), 0, 0, 256, 256)
    start = 14 + len(head) + 1024
    return b"BM" + struct.pack("<IHHI", start + len(rows), 0, 0, start) + head + bytes(1024) + rows


@pytest.mark.parametrize(
    ("name", "data", "shape", "words"),
    [
        ("a.tif", tiled_tiff(64, 64), (64, 64, 3), ""),
        ("a.tif", tiled_tiff(16, 16384), None, "tiles of 16,384 x 16,384 pixels are larger than"),
        ("a.bmp", run_length_bmp(64, 32), (32, 64, 3), ""),
        ("a.bmp", run_length_bmp(4096, 2048), None, "a BMP of run lengths with 8,388,608 pixels"),
    ],
)
def test_a_picture_that_is_small_but_slow_to_decode_is_not_read(
    name: str, data: bytes, shape: tuple[int, ...] | None, words: str, tmp_path: Path
) -> None:
    """Pillow allocates a tile of a TIFF as a whole, and decodes run lengths in Python."""
    (tmp_path / name).write_bytes(data)
    pictures = Pictures(tmp_path, NamedFiles())
    if shape is not None:
        assert pictures.read(name).shape == shape
        return
    with pytest.raises(UnusableError, match=words):
        pictures.read(name)
