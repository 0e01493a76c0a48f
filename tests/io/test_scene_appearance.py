"""Materials, textures and lights of a scene file: what is written is in the scene; broken pictures are named."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from glpath.errors import SceneError, SceneWarning
from glpath.film.exr import write_exr
from glpath.io import load_scene, scene_from_dict
from glpath.scene import Scene
from glpath.system.colour import decode_srgb

HEAD = """
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
up = [0.1, 2, 0]
[[shapes]]
type = "sphere"
radius = 1
"""


def scene(text: str, folder: Path, top: str = "") -> Scene:
    (folder / "room.toml").write_text(top + HEAD + text)
    return load_scene(folder / "room.toml")


# --- materials ---


def test_a_material_says_how_it_reflects(tmp_path: Path):
    found = scene(
        """
        [materials]
        plain = {}
        shiny = { type = "phong" }
        full = { type = "phong", specular = [1, 2, 3], exponent = 9, mirror = 0.5, two_sided = false }
        tiled = { texture = "tiles" }
        tinted = { type = "phong", texture = "tiles", reflectance = [1, 0.5, 0] }
        [textures]
        tiles = { type = "checker" }
        """,
        tmp_path,
    )
    by_name = {material.name: material for material in found.materials}
    assert list(by_name) == ["plain", "shiny", "full", "tiled", "tinted", "default"]
    assert by_name["plain"].reflectance.tolist() == [0.5] * 3
    assert by_name["shiny"].specular.tolist() == [0.5] * 3
    full = by_name["full"]
    assert full.specular.tolist() == [1, 2, 3]
    assert (full.exponent, full.two_sided, full.mirror.tolist()) == (9, False, [0.5] * 3)
    # What a texture multiplies is white, or a textured wall would be half as bright as its picture.
    assert by_name["tiled"].reflectance.tolist() == [1] * 3
    assert by_name["tinted"].reflectance.tolist() == [1, 0.5, 0]
    assert found.textures[by_name["tiled"].texture.texture].name == "tiles"


# --- textures ---


def test_a_checker_is_a_picture_of_two_by_two(tmp_path: Path):
    text = (
        '[textures]\na = { type = "checker", colors = [[1, 0, 0], 0.25], scale = [4, 2] }\nb = { type = "checker" }'
    )
    a, b = scene(text, tmp_path).textures
    assert a.image.tolist() == [[[1, 0, 0], [0.25] * 3], [[0.25] * 3, [1, 0, 0]]]
    assert a.image.dtype == np.float32
    assert (a.scale, a.filter, b.scale) == ((4, 2), "nearest", (1, 1))


PICTURE = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)


def textured(file: str, folder: Path, more: str = "") -> Scene:
    return scene(f'[textures]\na = {{ type = "image", file = "{file}"{more} }}', folder)


def test_a_png_is_srgb(tmp_path: Path):
    iio.imwrite(tmp_path / "a.png", PICTURE)
    (texture,) = textured("a.png", tmp_path).textures
    assert texture.image.dtype == np.uint8  # a quarter of what floats take on the device
    assert np.allclose(texture.linear(), decode_srgb(PICTURE / 255))
    assert (texture.scale, texture.filter) == ((1, 1), "linear")
    (other,) = textured("a.png", tmp_path, ', scale = 3, filter = "nearest"').textures
    assert (other.scale, other.filter) == ((3, 3), "nearest")


def test_a_jpeg_is_srgb(tmp_path: Path):
    iio.imwrite(tmp_path / "a.jpeg", np.full((8, 8, 3), 188, np.uint8))
    (texture,) = textured("a.jpeg", tmp_path).textures
    assert np.allclose(texture.linear(), decode_srgb(np.array(188 / 255)), atol=0.01)


def test_an_exr_is_linear_and_clipped_with_a_warning(tmp_path: Path):
    linear = np.linspace(0, 1, 24).reshape(2, 4, 3)
    write_exr(tmp_path / "a.exr", linear)
    assert np.allclose(textured("a.exr", tmp_path).textures[0].image, linear)
    write_exr(tmp_path / "a.exr", 1.5 * linear - 0.1)
    with pytest.warns(
        SceneWarning, match=r"textures.a.file: 9 of 24 values .* down to -0.1 and up to 1.4; they were"
    ):
        clipped = textured("a.exr", tmp_path).textures[0].image
    assert np.allclose(clipped, np.clip(1.5 * linear - 0.1, 0, 1))


def test_what_only_shines_may_be_brighter_than_white(tmp_path: Path):
    write_exr(tmp_path / "a.exr", np.full((2, 2, 3), 7.5))
    text = """
    [materials.lamp]
    emission_texture = "a"
    [textures]
    a = { type = "image", file = "a.exr" }
    """
    assert scene(text, tmp_path).textures[0].image.max() == 7.5
    with pytest.warns(SceneWarning, match="up to 7.5; they were clipped"):
        scene(text.replace("emission_texture", 'texture = "a"\nemission_texture'), tmp_path)


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 4)])
def test_grey_and_transparent_pictures_have_three_channels(tmp_path: Path, shape: tuple[int, ...]):
    iio.imwrite(tmp_path / "a.png", np.full(shape, 255, np.uint8))
    assert textured("a.png", tmp_path).textures[0].linear().tolist() == np.ones((5, 7, 3)).tolist()


def png_header(width: int, height: int) -> bytes:
    """A PNG of that size with no pixels in it."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def whole_png(folder: Path) -> bytes:
    iio.imwrite(folder / "whole.png", PICTURE)
    return (folder / "whole.png").read_bytes()


BROKEN = {
    "empty.png": (lambda folder: b"", "cannot be read as .png"),
    "text.png": (lambda folder: b"no picture at all", "cannot be read as .png"),
    "text.jpg": (lambda folder: b"no picture at all", "cannot be read as .jpg"),
    "text.exr": (lambda folder: b"no picture at all", "cannot be read as .exr"),
    "cut.png": (lambda folder: whole_png(folder)[:90], "cannot be read as .png"),
    "other.jpg": (whole_png, "cannot be read as .jpg"),
    "wide.png": (lambda folder: png_header(16385, 1), "of 16,385 x 1 pixels, but a texture has at most 16,384"),
    "high.png": (lambda folder: png_header(1, 20000), "of 1 x 20,000 pixels, but"),
    "large.png": (lambda folder: png_header(16384, 16384), "16,384 x 16,384 pixels, but"),
    "bomb.png": (lambda folder: png_header(2**31 - 1, 2**31 - 1), "2,147,483,647 x 2,147,483,647 pixels"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_picture_that_is_broken_or_huge_is_named(tmp_path: Path, name: str):
    make, expected = BROKEN[name]
    (tmp_path / name).write_bytes(make(tmp_path))
    with pytest.raises(SceneError) as error:
        textured(name, tmp_path)
    message = str(error.value)
    assert message.startswith(f"{tmp_path / 'room.toml'}: textures.a.file names ")
    assert str(tmp_path / name) in message
    assert expected in message
    if "pixels" in expected:
        assert "16,384 pixels a side and 67,108,864 in all" in message


def test_a_picture_with_holes_is_named(tmp_path: Path):
    write_exr(tmp_path / "a.exr", np.full((2, 2, 3), np.nan))
    with pytest.raises(SceneError, match=r"a.exr: cannot be read as .exr: 4 of its 4 pixels are NaN or infinite"):
        textured("a.exr", tmp_path)


def test_a_folder_is_no_picture(tmp_path: Path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(SceneError, match=r"a.png, which is not a file"):
        textured("a.png", tmp_path)


MAPS = """
[materials.leaf]
texture = "leaf"
alpha = "mask"
cutoff = 0.3
opacity = 0.9
normal_texture = "bumps"
normal_scale = 2
emission_texture = "glow"
[textures]
leaf = { type = "image", file = "leaf.png", wrap = "clamp" }
bumps = { type = "image", file = "bumps.png" }
glow = { type = "image", file = "bumps.png", wrap = "mirror" }
"""


def test_a_material_names_its_maps_and_its_alpha(tmp_path: Path):
    stored = np.random.default_rng(1).integers(0, 256, (5, 7, 4), np.uint8)
    iio.imwrite(tmp_path / "leaf.png", stored)
    iio.imwrite(tmp_path / "bumps.png", PICTURE)
    found = scene(MAPS, tmp_path)
    leaf = next(m for m in found.materials if m.name == "leaf")
    assert (leaf.alpha, leaf.cutoff, leaf.opacity, leaf.normal_scale) == ("mask", 0.3, 0.9, 2)
    named = {name: found.textures[slot.texture] for name, slot in leaf.slots.items()}
    assert {k: t.name for k, t in named.items()} == {
        "texture": "leaf",
        "normal_texture": "bumps",
        "emission_texture": "glow",
    }
    assert named["texture"].wrap == ("clamp", "clamp")
    assert np.array_equal(named["texture"].image, stored)
    # What is no colour is as it is stored; the same file as a colour is sRGB.
    assert np.allclose(named["normal_texture"].linear(), PICTURE / 255, atol=1e-6)
    assert np.allclose(named["emission_texture"].linear(), decode_srgb(PICTURE / 255))


@pytest.mark.parametrize(
    ("was", "becomes", "message"),
    [
        ('"mask"', '"hole"', r"materials.leaf.alpha"),
        ("cutoff = 0.3", "cutoff = 2", r"materials.leaf.cutoff"),
        ('"clamp"', '"border"', r"textures.leaf.wrap"),
        ('normal_texture = "bumps"', 'normal_texture = "bump"', r"materials.leaf.normal_texture"),
        ('emission_texture = "glow"', 'emission_texture = "bumps"', r"textures.bumps is used both"),
    ],
)
def test_a_wrong_map_is_named(tmp_path: Path, was: str, becomes: str, message: str):
    iio.imwrite(tmp_path / "leaf.png", PICTURE)
    iio.imwrite(tmp_path / "bumps.png", PICTURE)
    with pytest.raises(SceneError, match=message):
        scene(MAPS.replace(was, becomes), tmp_path)


# --- light ---


def test_lights_have_a_place_a_way_and_a_strength(tmp_path: Path):
    point, spot, sun = scene(
        """
        [[lights]]
        type = "point"
        name = "lamp"
        position = [1, 2, 3]
        intensity = [4, 5, 6]
        [[lights]]
        type = "spot"
        position = [0, 0, 4]
        target = [0, 3, 0]
        intensity = 7
        cone = [10, 20]
        falloff = "none"
        [[lights]]
        type = "directional"
        direction = [0, -2, 0]
        irradiance = 8
        """,
        tmp_path,
    ).lights
    assert (point.name, point.kind, point.falloff) == ("lamp", "point", "quadratic")
    assert point.position.tolist() == [1, 2, 3]
    assert point.intensity.tolist() == [4, 5, 6]
    assert (spot.name, spot.kind, spot.falloff, spot.cone) == ("spot-1", "spot", "none", (10, 20))
    assert np.allclose(spot.direction, [0, 0.6, -0.8])
    assert spot.intensity.tolist() == [7, 7, 7]
    assert (sun.name, sun.kind) == ("directional-2", "directional")
    assert sun.direction.tolist() == [0, -1, 0]
    assert sun.intensity.tolist() == [8, 8, 8]


def test_ambient_light_and_the_sky_may_be_grey_or_coloured(tmp_path: Path):
    found = scene("[sky]\nzenith = [0, 0, 1]", tmp_path, top="ambient = 0.25\n")
    assert found.ambient.tolist() == [0.25] * 3
    assert found.sky is not None
    assert found.sky.zenith.tolist() == found.sky.horizon.tolist() == [0, 0, 1]
    assert np.allclose(found.sky.up, np.array([0.1, 2, 0]) / np.hypot(0.1, 2))  # the camera's
    found = scene("[sky]\nzenith = 0\nhorizon = 2\nup = [0, 0, 5]", tmp_path)
    assert found.ambient.tolist() == [0] * 3
    assert found.sky is not None
    assert (found.sky.horizon.tolist(), found.sky.up.tolist()) == ([2] * 3, [0, 0, 1])


def test_without_any_of_it_a_scene_is_as_before():
    data = {"camera": {"position": [0, 0, 5], "target": [0, 0, 0]}, "shapes": [{"type": "sphere", "radius": 1.0}]}
    plain = scene_from_dict(data)
    assert (plain.textures, plain.lights, plain.sky) == ((), (), None)
    assert not plain.ambient.any()
