"""Small scenes of Mitsuba that ask for much: each is read in linear time, or refused with its line and a remedy."""

from __future__ import annotations

import struct
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import glpath
from glpath.errors import SceneError
from glpath.film.image import encode_png
from glpath.io.export.geometry import UniqueNames
from glpath.io.export.mitsuba_surfaces import Names
from glpath.io.mitsuba.document import Document, read_document
from glpath.io.mitsuba.load import _hides_emitters
from glpath.io.mitsuba.plugin import EQUAL_ENERGY, Plugin
from glpath.io.mitsuba.spectra import colour_of_spectrum
from glpath.io.mitsuba.textures import Look, _baked, _bent
from glpath.scene.model import Scene
from glpath.system.files import read_bytes

pytestmark = pytest.mark.filterwarnings("ignore::glpath.SceneWarning")


def write(folder: Path, *parts: str) -> Path:
    path = folder / "a.xml"
    path.write_text(f'<scene version="3.0.0">{"".join(parts)}</scene>', "utf-8")
    return path


def load(folder: Path, *parts: str) -> Scene:
    return glpath.load_scene(write(folder, *parts))


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    start = time.process_time()
    yield
    assert time.process_time() - start < seconds


def hiding_integrators(levels: int) -> str:
    """Integrators of which each has ten references to the next."""
    rows = []
    for i in range(levels):
        reference = f'<ref id="i{i + 1}"/>'
        rows.append(f'<integrator type="aov" id="i{i}">{reference * 10}</integrator>')
    last = f'<integrator type="path" id="i{levels}"><boolean name="hide_emitters" value="true"/></integrator>'
    return "".join(rows) + last


def test_an_integrator_with_many_references_to_it_is_read_once(tmp_path: Path) -> None:
    """If it were read for each of them, there would be a million."""
    document = read_document(write(tmp_path, hiding_integrators(6)), {})
    first = document.root.children[0]
    with at_most(0.5):
        assert _hides_emitters(Plugin(first, document), {})


def test_a_scene_has_a_maximum_number_of_plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """100 spheres count 2 each, with the reference, and their material counts 3 for each of them."""
    sphere = '<shape type="sphere"><ref id="m"/></shape>'
    material = '<bsdf type="plastic" id="m"><float name="int_ior" value="2"/><float name="ext_ior" value="1"/>'
    material += "</bsdf>"
    monkeypatch.setattr("glpath.io.mitsuba.document._MAX_PLUGINS", 500)
    assert len(load(tmp_path, material, sphere * 100).shapes) == 100
    with pytest.raises(SceneError, match="more than 500 plugins and parameters"):
        load(tmp_path, material, sphere * 101)


def test_steps_of_transforms_count_as_plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sphere, its material and its texture count 2 each, the transform 1, and its steps 100."""
    steps = '<scale value="1"/>' * 100
    texture = (
        f'<texture type="checkerboard" name="reflectance"><transform name="to_uv">{steps}</transform></texture>'
    )
    shape = f'<shape type="sphere"><bsdf type="diffuse">{texture}</bsdf></shape>'
    monkeypatch.setattr("glpath.io.mitsuba.document._MAX_PLUGINS", 107)
    assert len(load(tmp_path, shape).shapes) == 1
    monkeypatch.setattr("glpath.io.mitsuba.document._MAX_PLUGINS", 106)
    with pytest.raises(SceneError, match="more than 106 plugins and parameters"):
        load(tmp_path, shape)


def test_a_spectrum_is_read_once_for_all_its_uses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reflectance of 0.5 at all wavelengths is grey, and light of 0.5 is EQUAL_ENERGY / 2."""
    (tmp_path / "s.spd").write_text("360 0.5\n830 0.5\n")
    calls = []

    def count(*spectrum: object, light: bool) -> object:
        calls.append(light)
        return colour_of_spectrum(*spectrum, light=light)  # type: ignore[arg-type]

    monkeypatch.setattr("glpath.io.mitsuba.plugin.colour_of_spectrum", count)
    numbers = '<string name="wavelengths" value="360 830"/><string name="values" value="0.5 0.5"/>'
    uses = [
        '<spectrum name="reflectance" filename="s.spd"/>',
        '<spectrum name="reflectance" filename="./s.spd"/>',
        '<ref id="pairs" name="reflectance"/>',
        '<ref id="plugin" name="reflectance"/>',
    ]
    lamp = '<emitter type="area"><spectrum name="radiance" filename="s.spd"/></emitter>'
    scene = load(
        tmp_path,
        '<spectrum id="pairs" value="360:0.5, 830:0.5"/>',
        f'<spectrum id="plugin" type="irregular">{numbers}</spectrum>',
        *(f'<shape type="sphere"><bsdf type="diffuse">{use}</bsdf>{lamp}</shape>' for use in uses * 3),
    )
    assert sorted(calls) == [False, False, False, True]
    assert len(scene.shapes) == 12
    for shape in scene.shapes:
        np.testing.assert_allclose(scene.materials[shape.material].reflectance, 0.5, rtol=1e-4)
        np.testing.assert_allclose(shape.emission, EQUAL_ENERGY / 2, rtol=1e-3)


def test_a_spectrum_that_refers_to_itself_is_refused(tmp_path: Path) -> None:
    spectrum = '<spectrum type="srgb" id="a"><ref id="a" name="color"/></spectrum>'
    surface = '<bsdf type="diffuse"><ref id="a" name="reflectance"/></bsdf>'
    with pytest.raises(SceneError, match="in more than 16 plugins by references"):
        load(tmp_path, spectrum, f'<shape type="cube">{surface}</shape>')


@pytest.mark.parametrize("names", [UniqueNames, Names])
def test_many_equal_names_are_numbered_in_linear_time(names: Callable[[], UniqueNames | Names]) -> None:
    made = names()
    assert [made.of(each) for each in ("a", "a-3", "a", "a", "a-3")] == ["a", "a-3", "a-2", "a-4", "a-3-2"]
    with at_most(0.5):
        found = [made.of("sphere") for _ in range(10_000)]
    assert found == ["sphere", *(f"sphere-{number}" for number in range(2, 10_001))]


def test_shapes_and_materials_without_ids_are_numbered_in_order(tmp_path: Path) -> None:
    scene = load(tmp_path, '<shape type="cube"><bsdf type="diffuse"/></shape>' * 3)
    assert [shape.name for shape in scene.shapes] == ["cube", "cube-2", "cube-3"]
    assert [material.name for material in scene.materials] == ["cube", "cube-2", "cube-3"]


def test_many_nested_plugins_are_found_in_linear_time(tmp_path: Path) -> None:
    shapes = '<shape type="cube"/>' * 10_000
    document = read_document(write(tmp_path, f'<shape type="shapegroup" id="g">{shapes}</shape>'), {})
    group = Plugin(document.root.children[0], document)
    with at_most(0.5):
        assert len(group.nested("shape")) == 10_000
    group.check_all_read()


INSTANCE = '<shape type="instance"><ref id="g"/><transform name="to_world"><translate x="{}"/></transform></shape>'
GROUP = (
    '<shape type="shapegroup" id="g"><shape type="cube"/>'
    '<shape type="sphere"><point name="center" x="2"/></shape></shape>'
)


def test_instances_of_all_shapes_of_a_group_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.io.mitsuba.shapes._MAX_INSTANCES", 6)
    instances = "".join(INSTANCE.format(x) for x in range(3))
    cube, sphere = load(tmp_path, GROUP, instances).shapes
    np.testing.assert_array_equal(cube.world_from_object[:, :, 3], [[x, 0, 0] for x in range(3)])
    np.testing.assert_array_equal(sphere.world_from_object[:, :, 3], [[x + 2, 0, 0] for x in range(3)])
    with pytest.raises(SceneError, match="brings the scene to 8 instances of shapes, but it may have 6"):
        load(tmp_path, GROUP, instances, INSTANCE.format(3))


SERIALIZED = (
    '<shape type="serialized"><string name="filename" value="a.serialized"/>'
    '<integer name="shape_index" value="{}"/></shape>'
)


def write_serialized(path: Path, meshes: int, same_start: bool) -> None:
    """Meshes of one triangle; with `same_start`, one mesh that stands for all."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    stream = struct.pack("<I", 0x1000) + b"a\0" + struct.pack("<QQ", 3, 1)
    stream += corners.tobytes() + np.arange(3, dtype="<u4").tobytes()
    packed = struct.pack("<HH", 0x041C, 4) + zlib.compress(stream)
    starts = [0 if same_start else number * len(packed) for number in range(meshes)]
    content = packed * (1 if same_start else meshes)
    path.write_bytes(content + struct.pack(f"<{meshes}QI", *starts, meshes))


def test_name_of_a_serialized_mesh_that_has_no_end_is_an_error(tmp_path: Path) -> None:
    packed = struct.pack("<HH", 0x041C, 4) + zlib.compress(struct.pack("<I", 0x1000) + b"a" * 5000)
    (tmp_path / "a.serialized").write_bytes(packed + struct.pack("<QI", 0, 1))
    with pytest.raises(SceneError, match=r"the name of a mesh has more than 4,075 bytes, or no end"):
        load(tmp_path, SERIALIZED.format(0))


@pytest.mark.parametrize("same_start", [True, False])
def test_a_serialized_file_of_many_meshes_is_read_once(
    same_start: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = []

    def read_and_count(path: Path, *limits: int) -> bytes:
        paths.append(path)
        return read_bytes(path, *limits)

    monkeypatch.setattr("glpath.io.mitsuba.meshes.read_bytes", read_and_count)
    write_serialized(tmp_path / "a.serialized", 5, same_start)
    scene = load(tmp_path, *map(SERIALIZED.format, range(5)))
    assert scene.areas.sum() == pytest.approx(5 * 0.5)
    assert paths == [tmp_path / "a.serialized"]


def test_serialized_meshes_of_a_scene_unfold_to_a_maximum_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mesh has 70 bytes: 22 of its head, 36 of its vertices and 12 of its face."""
    write_serialized(tmp_path / "a.serialized", 5, same_start=True)
    stored = (tmp_path / "a.serialized").stat().st_size
    monkeypatch.setattr("glpath.io.mitsuba.meshes._SERIALIZED_TOTAL", 4 * 70)
    monkeypatch.setattr("glpath.io.mitsuba.meshes._SERIALIZED_RATIO", 1)
    load(tmp_path, *map(SERIALIZED.format, range(4)))
    with pytest.raises(SceneError, match=f"with the meshes before it, {stored} bytes unfold to 350, more than 1 t"):
        load(tmp_path, *map(SERIALIZED.format, range(5)))


def test_a_serialized_mesh_is_unpacked_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.io.mitsuba.meshes._SERIALIZED_PIECE", 7)
    monkeypatch.setattr("glpath.io.mitsuba.meshes._SERIALIZED_HEAD", 25)
    write_serialized(tmp_path / "a.serialized", 2, same_start=False)
    assert load(tmp_path, SERIALIZED.format(1)).areas.sum() == pytest.approx(0.5)


@pytest.mark.parametrize("length", ["5.0.0mm", ".mm", "mm", "0mm", f"{'9' * 400}mm", f"0.{'0' * 400}1mm", "5 cm"])
def test_a_focal_length_that_is_none_is_refused(length: str, tmp_path: Path) -> None:
    camera = f'<sensor type="perspective"><string name="focal_length" value="{length}"/></sensor>'
    with pytest.raises(SceneError, match=r"line 1, .*must be a length from 0\.001mm to 1,000,000mm"):
        load(tmp_path, camera, '<shape type="cube"/>')


@pytest.mark.parametrize(("length", "focal"), [("50mm", 50.0), ("50.mm", 50.0), (" .5 mm ", 0.5)])
def test_a_focal_length_is_of_the_diagonal_of_a_frame(length: str, focal: float, tmp_path: Path) -> None:
    film = '<film type="hdrfilm"><integer name="width" value="36"/><integer name="height" value="24"/></film>'
    camera = f'<sensor type="perspective"><string name="focal_length" value="{length}"/>{film}</sensor>'
    scene = load(tmp_path, camera, '<shape type="cube"/>')
    assert np.tan(np.radians(scene.camera.fov / 2)) == pytest.approx(12.0 / focal)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("hour", "1e12", "is 1e.12, but must be between 0 and 24"),
        ("minute", "-1", "is -1, but must be between 0 and 60"),
        ("second", "61", "is 61, but must be between 0 and 60"),
        ("year", "3000000000", "is 3000000000, but must be between 1678 and 2261"),
        ("year", "2924", "is 2924, but must be between 1678 and 2261"),
        ("year", "1", "is 1, but must be between 1678 and 2261"),
        ("month", "3000000000", "has a date that does not exist"),
    ],
)
def test_a_time_of_a_sunsky_that_is_none_is_refused(name: str, value: str, words: str, tmp_path: Path) -> None:
    light = f'<emitter type="sunsky"><float name="{name}" value="{value}"/></emitter>'
    with pytest.raises(SceneError, match=words):
        load(tmp_path, light, '<shape type="cube"/>')


def alpha(name: str = "a.png") -> str:
    texture = f'<texture name="alpha" type="bitmap"><string name="filename" value="{name}"/></texture>'
    return f'<shape type="cube"><bsdf type="roughconductor">{texture}</bsdf></shape>'


def bumpy(scale: float = 1.0) -> str:
    texture = '<texture type="bitmap"><string name="filename" value="a.png"/></texture>'
    inner = f'<bsdf type="diffuse"/>{texture}<float name="scale" value="{scale}"/>'
    return f'<shape type="cube"><bsdf type="bumpmap">{inner}</bsdf></shape>'


def masked(surface: str = '<bsdf type="diffuse"/>') -> str:
    texture = '<texture name="opacity" type="bitmap"><string name="filename" value="a.png"/></texture>'
    return f'<shape type="cube"><bsdf type="mask">{texture}{surface}</bsdf></shape>'


def metal() -> str:
    texture = '<texture name="{}" type="bitmap"><string name="filename" value="a.png"/></texture>'
    both = texture.format("roughness") + texture.format("metallic")
    return f'<shape type="cube"><bsdf type="principled">{both}</bsdf></shape>'


def stretched() -> str:
    texture = '<texture name="alpha_u" type="bitmap"><string name="filename" value="a.png"/></texture>'
    return f'<shape type="cube"><bsdf type="roughconductor">{texture}</bsdf></shape>'


SURFACES = {"alpha": alpha, "bump": bumpy, "mask": masked, "metal": metal, "stretched": stretched}


@pytest.mark.parametrize("name", SURFACES)
def test_surfaces_of_one_picture_share_what_is_computed_from_it(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(encode_png(np.full((4, 4, 3), 99, np.uint8)))
    once = load(tmp_path, SURFACES[name]()).textures
    many = load(tmp_path, SURFACES[name]() * 20).textures
    assert len(once) == len(many)


@pytest.mark.parametrize("name", SURFACES)
def test_a_large_plain_picture_is_refused_before_floats_are_computed_from_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limits are scaled down by 2**16, from 512 MB and 8192 x 8192 pixels."""
    (tmp_path / "a.png").write_bytes(encode_png(np.zeros((32, 32, 3), np.uint8)))
    monkeypatch.setattr("glpath.system.npz._DERIVED", 512 << 4)
    monkeypatch.setattr("glpath.system.npz._DERIVED_RATIO", 1)
    monkeypatch.setattr("glpath.io.mitsuba.textures._MAX_INTERPOLATED", 1)
    with pytest.raises(
        SceneError, match=r"line 1, .* a picture that cannot be used, because images of .* would be computed"
    ):
        load(tmp_path, SURFACES[name]())


def test_bumps_of_many_scales_count_against_the_limit_of_computed_floats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.png").write_bytes(encode_png(np.zeros((16, 16, 3), np.uint8)))
    monkeypatch.setattr("glpath.system.npz._DERIVED", 3 * 16 * 16 * 12)
    monkeypatch.setattr("glpath.system.npz._DERIVED_RATIO", 1)
    load(tmp_path, *map(bumpy, (1, 2, 3)))
    with pytest.raises(SceneError, match="would be computed from"):
        load(tmp_path, *map(bumpy, (1, 2, 3, 4)))


def test_strips_of_an_image_are_converted_as_the_whole_is(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.random.default_rng(0).integers(0, 256, (37, 11, 3), np.uint8)
    look = Look("a", image, True, "nearest")
    whole = _baked(look, np.sqrt).image, _bent(look, 0.3, (2.0, 3.0)).image
    monkeypatch.setattr("glpath.io.mitsuba.textures._STRIP_TEXELS", 50)
    assert len(list(look.strips())) == 10
    np.testing.assert_array_equal(_baked(look, np.sqrt).image, whole[0])
    np.testing.assert_array_equal(_bent(look, 0.3, (2.0, 3.0)).image, whole[1])


def test_a_slope_of_heights_is_a_tilted_normal() -> None:
    """Heights that grow by one per texel along u tilt the normal by 45 degrees if a texel is one unit long."""
    heights = np.repeat(np.arange(8, dtype=np.float32)[None, :, None], 3, axis=2) / 8
    normals = 2.0 * _bent(Look("a", np.tile(heights, (4, 1, 1)), False), 8.0, (8.0, 4.0)).image - 1.0
    np.testing.assert_allclose(normals[:, 1:-1], np.broadcast_to([-(0.5**0.5), 0, 0.5**0.5], (4, 6, 3)), atol=1e-6)


def searching(folder: Path, monkeypatch: pytest.MonkeyPatch, limit: int) -> Document:
    for name in ("one", "two"):
        (folder / name).mkdir()
    (folder / "two" / "b.ply").touch()
    monkeypatch.setattr("glpath.io.mitsuba.document._MAX_LOOKUPS", limit)
    paths = '<path value="one"/><path value="two"/>'
    return read_document(write(folder, paths, '<shape type="cube"/>'), {})


def test_each_file_of_a_scene_is_looked_for_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four paths: that of the file, the scene's, and two by <path>s."""
    (element,) = searching(tmp_path, monkeypatch, 8).root.children
    for _ in range(10):
        assert element.file("b.ply") == tmp_path / "two" / "b.ply"
        assert element.file("c.ply") == tmp_path / "c.ply"
    words = r'line 1, <shape .*names "d.ply", but .* looked for at 8 paths already, in 3 folders'
    with pytest.raises(SceneError, match=words):
        element.file("d.ply")
