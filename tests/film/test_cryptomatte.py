"""Mattes by name: the specification's hashes, counts beside plain loops, and files as other programs read them."""

from __future__ import annotations

import json
import os
import subprocess
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import glpath
from benchmarks.peers import other_python
from glpath.errors import GlpathError, ImageError
from glpath.film.cryptomatte import ShapeCounts, cryptomatte, hash_id, murmur3_32
from glpath.film.exr import read_exr_channels
from glpath.film.film import Film
from glpath.film.image import read_image

#: Out of Psyop's cryptomatte_utilities_tests.py, the reference implementation's own.
PUBLISHED = {
    "hello": 6.0705627102400005616e-17,
    "cube": -4.08461912519e15,
    "sphere": 2.79018604383e15,
    "plane": 3.66557617593e-11,
    "\u0440\u0430\u0432\u043d\u0438\u043d\u0430": -1.3192631212399999468e-25,  # plane, in Bulgarian
    "m\u00e4dchen": 6.2361298211599995797e25,
}


@pytest.mark.parametrize(("name", "number"), PUBLISHED.items(), ids=ascii)
def test_ids_are_those_that_the_reference_implementation_publishes(name: str, number: float) -> None:
    assert hash_id(name) == np.float32(number)


@pytest.mark.parametrize(
    ("data", "seed", "expected"),
    [
        (b"", 0, 0),
        (b"", 1, 0x514E28B7),
        (b"", 0xFFFFFFFF, 0x81F16F39),
        (b"\xff\xff\xff\xff", 0, 0x76293B50),
        (b"\x21\x43\x65\x87", 0, 0xF55B516B),
        (b"\x21\x43\x65\x87", 0x5082EDEE, 0x2362F9DE),
        (b"\x21\x43\x65", 0, 0x7E4A8634),
        (b"\x21\x43", 0, 0xA0F7B07A),
        (b"\x21", 0, 0x72661CF4),
        (b"\x00\x00\x00\x00", 0, 0x2362F9DE),
        (b"Hello, world!", 0x9747B28C, 0x24884CBA),
        (b"The quick brown fox jumps over the lazy dog", 0x9747B28C, 0x2FA826CD),
    ],
)
def test_the_hash_is_murmurs(data: bytes, seed: int, expected: int) -> None:
    """Vectors that are passed on with MurmurHash3_x86_32."""
    assert murmur3_32(data, seed) == expected


def test_ids_are_finite_whatever_the_hash_is() -> None:
    ids = np.array([hash_id(f"object {i}") for i in range(3000)])
    exponents = ids.view(np.uint32) >> 23 & 255
    assert exponents.min() >= 1
    assert exponents.max() <= 254
    raw = np.array([murmur3_32(f"object {i}".encode()) >> 23 & 255 for i in range(3000)])
    assert {0, 255} & set(raw.tolist())  # there were such


SHAPES = 9


def drawn(seed: int, samples: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, SHAPES + 1, (3, 5, samples)).astype(np.uint32)


def test_counts_are_those_of_a_plain_loop() -> None:
    shapes = drawn(0, 24)
    names = ["a", "b", "a", "c", "d", "e", "f", "g", "h"]
    counts = ShapeCounts.of(shapes)
    assert np.array_equal(counts.hits(), (shapes > 0).sum(axis=2))
    matte = cryptomatte("object", counts, names, 24, ranks=3)
    for y in range(3):
        for x in range(5):
            met = Counter(names[number - 1] for number in shapes[y, x] if number)
            ranked = sorted(met.items(), key=lambda item: (-item[1], names.index(item[0])))[:3]
            assert [(float(i), c) for i, c in zip(matte.ids[y, x], matte.coverage[y, x], strict=True) if c] == [
                (float(hash_id(name)), count / 24) for name, count in ranked
            ]
    whole = cryptomatte("object", counts, names, 24, ranks=9)
    assert np.allclose(whole.coverage.sum(axis=2), counts.hits() / 24, rtol=0, atol=1e-12)
    assert np.array_equal(whole.matte("a"), ((shapes == 1) | (shapes == 3)).sum(axis=2) / 24)
    assert np.all(matte.coverage.sum(axis=2) <= whole.coverage.sum(axis=2))


def test_counts_add_up_to_the_same_in_any_order() -> None:
    parts = [drawn(seed, n) for seed, n in enumerate((1, 8, 3, 8))]
    counts = [ShapeCounts.of(part) for part in parts]
    whole = ShapeCounts.of(np.concatenate(parts, axis=2))
    assert counts[0] + counts[1] + counts[2] + counts[3] == whole
    assert counts[3] + (counts[1] + counts[0]) + counts[2] == whole
    empty = ShapeCounts.empty((3, 5))
    assert empty + whole == whole + empty == whole
    assert empty + empty == ShapeCounts.of(np.zeros((3, 5, 4), np.uint32)) == empty != whole
    assert cryptomatte("object", empty, ["a"], 1).coverage.max() == 0


#: A ground, two boxes of one name and one of another, and the sky; names that JSON must escape, or write as UTF-8.
SCENE: dict[str, object] = {
    "camera": {"position": [0, 2, 5], "target": [0, 0.4, 0], "fov": 40},
    "materials": {"earth": {"reflectance": [0.4, 0.3, 0.2]}, 'so "called"': {"reflectance": [0.2, 0.5, 0.8]}},
    "film": {"resolution": [48, 32]},
    "sky": {"zenith": 1, "horizon": 1},
    "shapes": [
        {
            "type": "quad",
            "name": "ground",
            "corners": [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]],
            "material": "earth",
        },
        {"type": "box", "name": "kiste", "min": [-1, 0, -0.4], "max": [-0.4, 0.8, 0.2], "material": 'so "called"'},
        {"type": "box", "name": "kiste", "min": [0.4, 0, -0.4], "max": [1, 0.8, 0.2], "material": 'so "called"'},
        {
            "type": "box",
            "name": "m\u00e4dchen",
            "min": [-0.2, 0, 0.3],
            "max": [0.2, 0.5, 0.7],
            "material": 'so "called"',
        },
    ],
}


@pytest.fixture(scope="module")
def film() -> Film:
    return glpath.render(SCENE, spp=32, max_depth=1, aovs=("object_id", "material_id"))


def test_coverage_is_the_share_of_the_samples(film: Film) -> None:
    objects, materials = film.cryptomatte("object"), film.cryptomatte("material")
    assert objects.manifest.keys() == {"ground", "kiste", "m\u00e4dchen"}
    assert materials.manifest.keys() == {"earth", 'so "called"'}
    total = objects.coverage.sum(axis=2)
    assert np.array_equal(total, materials.coverage.sum(axis=2))
    assert total.max() == 1
    assert total.min() == 0  # the sky has no name
    assert np.array_equal(total[film.aov("object_id") == 0], np.zeros(np.sum(film.aov("object_id") == 0)))
    assert np.array_equal(objects.matte("ground"), materials.matte("earth"))
    blue = materials.matte('so "called"')
    assert np.array_equal(blue, objects.matte("kiste", "m\u00e4dchen"))
    # Both boxes of one name are one matte, though ids tell them apart.
    assert {2, 3} <= set(np.unique(film.aov("object_id")[objects.matte("kiste") == 1]))
    assert set(np.unique(film.aov("material_id"))) == {0, 1, 2}
    assert np.all(np.diff(objects.coverage, axis=2) <= 0)


def test_a_file_has_what_the_specification_asks_for(film: Film, tmp_path: Path) -> None:
    film.save(tmp_path / "a.exr")
    _, header = read_exr_channels(tmp_path / "a.exr")
    keys = {text: key.split("/")[1] for key, text in header.items() if key.endswith("/name")}
    assert keys.keys() == {"CryptoObject", "CryptoMaterial"}
    for name, key in keys.items():
        assert len(key) == 7
        assert header[f"cryptomatte/{key}/hash"] == "MurmurHash3_32"
        assert header[f"cryptomatte/{key}/conversion"] == "uint32_to_float32"
        manifest = json.loads(header[f"cryptomatte/{key}/manifest"])
        assert manifest == film.cryptomatte("object" if name == "CryptoObject" else "material").manifest
        for text, digits in manifest.items():
            assert np.uint32(int(digits, 16)).view(np.float32) == hash_id(text)
    assert "glpath.shape_names" not in header


def test_a_film_in_a_file_still_has_its_names(film: Film, tmp_path: Path) -> None:
    film.save(tmp_path / "a.npz")
    again = Film.load(tmp_path / "a.npz")
    assert again.shape_counts == film.shape_counts
    assert again.cryptomatte("object").manifest == film.cryptomatte("object").manifest
    assert again.metadata == film.metadata
    more = glpath.render(SCENE, spp=8, first_path_set=32, max_depth=1, aovs=("object_id", "material_id"))
    assert again.merge(more).shape_counts == film.merge(more).shape_counts


@pytest.mark.parametrize(
    ("name", "spoilt"),
    [
        ("shape_keys", lambda keys: keys[::-1]),
        ("shape_keys", lambda keys: keys + (48 * 32 << 32)),
        ("shape_keys", lambda keys: keys + 4),
        ("shape_keys", lambda keys: keys.astype(np.float64)),
        ("shape_counts", lambda counts: 0 * counts),
        ("shape_counts", lambda counts: counts + 32),
        ("shape_counts", lambda counts: counts[1:]),
        ("shape_counts", None),
        ("metadata", lambda text: np.array(str(text).replace('"shape_materials": [0', '"shape_materials": [7'))),
        ("metadata", lambda text: np.array(str(text).replace('"shape_materials": [0', '"shape_materials": [-1'))),
        ("metadata", lambda text: np.array(str(text).replace('"shape_names": [', '"shape_names": [3, '))),
        ("metadata", lambda text: np.array(str(text).replace('"shape_names": ["ground", ', '"shape_names": ['))),
    ],
)
def test_counts_that_cannot_be_are_refused(film: Film, name: str, spoilt, tmp_path: Path) -> None:
    film.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as stored:
        arrays = dict(stored)
    before = arrays.pop(name)
    if spoilt is not None:
        arrays[name] = spoilt(before)
        assert arrays[name].tobytes() != before.tobytes()
    np.savez(tmp_path / "b.npz", **arrays)
    with pytest.raises(ImageError):
        Film.load(tmp_path / "b.npz")


@pytest.mark.evidence
def test_mitsuba_reads_the_file(tmp_path: Path) -> None:
    """Another program's reader: names of channels, and the values of some."""
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    from benchmarks.peers import mitsuba as mitsuba_peer

    mi = mitsuba_peer.load_mitsuba()
    film = glpath.render(SCENE, spp=4, max_depth=2, aovs="all")
    film.save(tmp_path / "a.exr")
    bitmap = mi.Bitmap(str(tmp_path / "a.exr"))
    channels = dict(
        zip([field.name for field in bitmap.struct_()], np.moveaxis(np.array(bitmap), 2, 0), strict=True)
    )
    stored, _ = read_exr_channels(tmp_path / "a.exr")
    assert channels.keys() == stored.keys()
    for name, pixels in channels.items():
        assert np.array_equal(pixels, stored[name]), name
    assert np.array_equal(channels["depth.Z"], film.aov("depth").astype(np.float32))
    assert np.array_equal(channels["CryptoObject00.R"], film.cryptomatte("object").ids[..., 0])


#: The matte of each name by Blender's Cryptomatte node, and how its Image node reads the passes of a file.
BLENDER = """
import sys
import bpy
path, folder, width, height, *names = sys.argv[1:]
image = bpy.data.images.load(path)
scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y = int(width), int(height)
scene.render.resolution_percentage = 100
scene.render.engine, scene.cycles.samples = "CYCLES", 1
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
tree = bpy.data.node_groups.new("tree", "CompositorNodeTree")
scene.compositing_node_group = tree
tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
end, picture = tree.nodes.new("NodeGroupOutput"), tree.nodes.new("CompositorNodeImage")
picture.image = image
matte = tree.nodes.new("CompositorNodeCryptomatteV2")
matte.source, matte.image = "IMAGE", image
matte.layer_name = "CryptoObject"

def write(socket, name):
    tree.links.new(socket, end.inputs[0])
    scene.render.filepath = folder + "/" + name + ".exr"
    bpy.ops.render.render(write_still=True)

for i, name in enumerate(names):
    matte.matte_id = name
    write(matte.outputs["Matte"], str(i))
for name in ("depth", "position", "normal", "object_id", "indirect"):
    write(picture.outputs[name], name)
"""


@pytest.mark.evidence
def test_blenders_compositor_finds_layers_and_mattes_by_their_names(film: Film, tmp_path: Path) -> None:
    try:
        other_python.find_package("bpy", other_python.python())
    except GlpathError as error:
        pytest.skip(str(error))
    film = glpath.render(SCENE, spp=16, max_depth=2, aovs="all")
    film.save(tmp_path / "a.exr")
    matte = film.cryptomatte("object")
    height, width = film.mean.shape[:2]
    script = [other_python.python(), "-c", BLENDER, str(tmp_path / "a.exr"), str(tmp_path), str(width), str(height)]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    subprocess.run([*script, *matte.manifest], check=True, capture_output=True, timeout=300, env=environment)
    for i, name in enumerate(matte.manifest):
        found = read_image(tmp_path / f"{i}.exr")[..., 0]
        assert np.array_equal(found, matte.matte(name).astype(np.float32)), name
        assert found.max() == 1
    for name in ("depth", "position", "normal", "object_id", "indirect"):
        found, wanted = read_image(tmp_path / f"{name}.exr"), film.aov(name).astype(np.float32)
        assert np.array_equal(found[..., : 3 if wanted.ndim == 3 else 1].reshape(wanted.shape), wanted), name
