"""`glpath export`: what is in the files, what other programs make of them, and what is told of the rest."""

from __future__ import annotations

import os
import warnings
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import glpath
from glpath.errors import ImageError, SceneError, SceneWarning, UsageError
from glpath.film.image import read_image
from glpath.integrators.path_settings import PathSettings
from glpath.io.export import MAX_DEPTH
from glpath.io.export.geometry import Notes, in_triangles, near_plane
from glpath.io.export.mitsuba import described
from glpath.io.gltf.load import Model, read_gltf
from glpath.io.library import shipped_scenes
from glpath.scene.background import Background
from glpath.scene.material import SLOTS
from glpath.scene.model import (
    Camera,
    Environment,
    Light,
    LightProfile,
    Material,
    Mesh,
    Scene,
    Shape,
    Shapes,
    Sky,
    Texture,
    TextureSlot,
)
from glpath.scene.tessellate import box_mesh, unit_sphere
from tests.support.command_line import run
from tests.support.gltf_files import ReadGlb
from tests.support.gltf_validator import judged

ROTATED = np.array([[0.0, -2.0, 0.0, 3.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]])
MIRRORED = np.array([[-1.0, 0.0, 0.0, -3.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
SHEARED = np.array([[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 0.0, 3.0], [0.0, 0.0, 1.0, 0.0]])


def moved(*maps: Any, by: float = 0.0) -> Any:
    """(N, 3, 4): the maps, and then along all three axes."""
    return np.stack(maps) + np.array([0.0, 0.0, 0.0, by])


def quietly(scene: Any, path: Path, **options: Any) -> list[str]:
    """Exports, and returns the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        glpath.export(scene, path, **options)
    return [str(each.message) for each in caught]


def textures() -> tuple[Texture, ...]:
    rng = np.random.default_rng(3)
    colours = rng.integers(0, 256, (4, 8, 4), np.uint8)
    bump = np.full((2, 2, 3), (160, 128, 230), np.uint8)
    return (
        Texture("colours", colours, srgb=True, wrap=("clamp", "mirror")),
        Texture("data", rng.integers(0, 256, (4, 4, 3), np.uint8), filter="nearest"),
        Texture("bump", bump),
        Texture("bright", rng.uniform(0, 3, (3, 5, 3)).astype(np.float32), (2.0, 3.0)),
    )


def every_material() -> tuple[Material, ...]:
    gold = np.array([1.0, 0.8, 0.4])
    turned = np.array([[0.0, -1.0, 0.25], [1.0, 0.0, 0.5]])
    return (
        Material("white", np.full(3, 0.7)),
        Material("one-sided", np.full(3, 0.6), two_sided=False),
        Material("phong", np.full(3, 0.4), specular=np.full(3, 4.0), exponent=40.0),
        Material("mirror", np.zeros(3), mirror=np.full(3, 0.9)),
        Material("half-mirror", np.full(3, 0.4), mirror=np.full(3, 0.5)),
        Material("gold", gold, roughness=0.3, metallic=1.0),
        Material(
            "brushed",
            gold,
            roughness=0.3,
            metallic=1.0,
            anisotropy=0.6,
            anisotropy_angle=30.0,
            anisotropy_texture=TextureSlot(1),
            normal_texture=TextureSlot(2),
        ),
        Material(
            "plastic",
            gold,
            roughness=0.4,
            ior=1.7,
            specular_weight=0.8,
            specular_colour=gold,
            specular_texture=TextureSlot(1),
            specular_colour_texture=TextureSlot(0),
        ),
        Material(
            "car",
            gold,
            roughness=0.5,
            metallic=0.5,
            clearcoat=0.8,
            clearcoat_roughness=0.1,
            clearcoat_texture=TextureSlot(1),
            clearcoat_roughness_texture=TextureSlot(1),
            clearcoat_normal_texture=TextureSlot(2),
            clearcoat_normal_scale=0.7,
            normal_texture=TextureSlot(2),
        ),
        Material("pane", gold, roughness=0.0, transmission=1.0),
        Material(
            "glass",
            np.ones(3),
            two_sided=False,
            roughness=0.1,
            transmission=1.0,
            thin=False,
            ior=1.33,
            attenuation=np.arange(3.0),
        ),
        Material("unlit", np.zeros(3), unlit=True, roughness=1.0),
        Material("veil", np.full(3, 0.7), roughness=1.0, alpha="blend", opacity=0.5, texture=TextureSlot(0)),
        Material("leaf", np.ones(3), roughness=1.0, alpha="mask", cutoff=0.3, texture=TextureSlot(0, 1, turned)),
        Material(
            "textured",
            np.ones(3),
            roughness=0.9,
            metallic=0.8,
            texture=TextureSlot(0),
            surface_texture=TextureSlot(1),
            normal_texture=TextureSlot(2),
            normal_scale=0.5,
            emission_texture=TextureSlot(3),
            transmission=0.5,
            transmission_texture=TextureSlot(1),
        ),
        Material("paper", gold / 3, texture=TextureSlot(0), normal_texture=TextureSlot(2), normal_scale=0.5),
        Material(
            "velvet",
            gold,
            roughness=0.9,
            sheen=gold,
            sheen_roughness=0.6,
            sheen_texture=TextureSlot(0),
            sheen_roughness_texture=TextureSlot(0),
        ),
        Material(
            "bubble",
            gold,
            roughness=0.2,
            iridescence=0.7,
            iridescence_ior=1.4,
            iridescence_thickness=500.0,
            iridescence_thickness_min=200.0,
            iridescence_texture=TextureSlot(1),
            iridescence_thickness_texture=TextureSlot(1),
        ),
        Material(
            "lampshade",
            gold,
            roughness=0.8,
            diffuse_transmission=0.6,
            diffuse_transmission_colour=gold,
            diffuse_transmission_texture=TextureSlot(0),
            diffuse_transmission_colour_texture=TextureSlot(0),
        ),
        Material(
            "lacquer",
            gold,
            roughness=0.6,
            clearcoat=1.0,
            clearcoat_roughness=0.2,
            clearcoat_normal_texture=TextureSlot(2),
        ),
        Material("satin", gold, roughness=0.4, metallic=1.0, anisotropy=0.5),
        Material("varnish", gold, two_sided=False, roughness=0.0, layering="plastic", specular_colour=gold),
        Material("enamel", gold, two_sided=False, roughness=0.4, layering="plastic", specular_weight=0.5),
    )


def everything(shape: Mesh | None = None) -> Scene:
    """A scene of all that the model knows: materials, textures, maps, lights, planes, a sky."""
    box = shape or box_mesh((0, 0, 0), (1, 1, 1))
    box = replace(box, uv1=None if box.uv is None else box.uv * 0.5)
    coloured = replace(box, colours=np.random.default_rng(1).uniform(0, 1, (len(box.vertices), 4)))
    shapes = []
    for i, material in enumerate(every_material()):
        at = np.array([[[1.0, 0, 0, 2.0 * (i % 5)], [0, 1, 0, 2.0 * (i // 5)], [0, 0, 1, 0]]])
        emission = np.array([4.0, 2.0, 1.0]) if material.name in ("textured", "unlit") else np.zeros(3)
        mesh = coloured if material.name == "white" else box
        two_sided = material.name == "textured"
        shapes.append(Shape(material.name, mesh, i, at, emission, two_sided))
    shapes.append(Shape("instances", box, 0, moved(ROTATED, MIRRORED, SHEARED, by=20.0)))
    shapes.append(Shape("ball", "sphere", 0, moved(np.eye(3, 4), by=-3.0), subdivisions=1))
    shapes.append(Shape("ground", "plane", 14, np.array([[[1.0, 0, 0, 0], [0, 0, 1, -2], [0, -1, 0, 0]]])))
    shapes.append(Shape("lamp", box, 0, np.eye(3, 4)[None] * 0.1, np.full(3, 50.0), True))
    lights = (
        Light("bulb", "point", np.array([1.0, 2.0, 3.0]), np.array([0, 5.0, 0])),
        Light("old", "point", np.full(3, 0.1), np.array([0, 5.0, 0]), falloff="none"),
        Light("torch", "spot", np.full(3, 9.0), np.array([0, 5.0, 0]), np.array([0.0, -0.6, 0.8]), (20.0, 30.0)),
        Light("sun", "directional", np.full(3, 2.0), direction=np.array([0.0, -1.0, 0.0])),
    )
    camera = Camera(np.array([4.0, 3, 15]), np.array([4.0, 2, 0]), np.array([0.0, 1, 0]), 40.0, (64, 48))
    return Scene(
        "everything",
        camera,
        Shapes(shapes),
        every_material(),
        textures=textures(),
        lights=lights,
        ambient=np.full(3, 0.1),
        sky=Sky(np.array([0.2, 0.3, 0.5]), np.full(3, 0.6)),
    )


# Mitsuba's XML


def files_of(xml: Path) -> list[str]:
    tree = ElementTree.parse(xml)
    return [each.attrib["value"] for each in tree.iter("string") if each.attrib["name"] == "filename"]


def test_the_xml_has_what_the_scene_has(tmp_path: Path) -> None:
    assert quietly("cornell-box-36", tmp_path / "box.xml", max_depth=3, spp=8) == []
    root = ElementTree.parse(tmp_path / "box.xml").getroot()
    scene = glpath.load_scene("cornell-box-36")
    assert len(root.findall("shape")) == len(scene.shapes)
    assert root.find("integrator/integer[@name='max_depth']").attrib["value"] == "4"
    assert root.find("sensor/sampler/integer").attrib["value"] == "8"
    assert len(root.findall("shape/emitter")) == 1
    assert sorted(files_of(tmp_path / "box.xml")) == sorted(
        f"box_files/{p.name}" for p in (tmp_path / "box_files").iterdir()
    )
    import trimesh

    area = sum(trimesh.load(tmp_path / file).area for file in files_of(tmp_path / "box.xml"))
    assert area == pytest.approx(scene.areas.sum(), rel=1e-6)


def test_the_default_depth_is_that_of_render() -> None:
    assert PathSettings.max_depth == MAX_DEPTH


def test_a_mesh_that_stands_in_several_places_is_one_file(tmp_path: Path) -> None:
    box = box_mesh((0, 0, 0), (1, 1, 1))
    scene = glpath.load_scene("cornell-box-36")
    many = Shape("many", box, 0, np.concatenate([moved(ROTATED), moved(ROTATED, MIRRORED, by=1.0)]))
    scene = replace(scene, shapes=Shapes((*scene.shapes, many)))
    quietly(scene, tmp_path / "a.xml")
    root = ElementTree.parse(tmp_path / "a.xml").getroot()
    assert len(root.findall("shape[@type='instance']")) == 3
    assert len(root.findall("shape[@type='shapegroup']")) == 2  # one of them turned, for the mirrored one
    flat = described(scene, 3, instances=False).plugins
    assert len(flat["many"]["mesh"].faces) == 36


def test_a_texture_is_a_png_as_it_is_and_an_exr_where_it_is_more(tmp_path: Path) -> None:
    texts = quietly(everything(), tmp_path / "a.xml")
    written = {Path(name).name.rsplit("-", 1)[0]: tmp_path / name for name in files_of(tmp_path / "a.xml")}
    assert written["bright"].suffix == ".exr"
    found = read_image(written["bright"])
    np.testing.assert_allclose(found, textures()[3].image * [4, 2, 1], rtol=1e-6)
    pngs = [name for name in files_of(tmp_path / "a.xml") if name.endswith(".png")]
    assert pngs
    said = "\n".join(texts)
    for words in (
        "endless planes",
        "ambient light is left out",
        '"torch": between',
        '"old": it falls off',
        '"phong"',
    ):
        assert words in said
    assert len(texts) == len(set(texts))


def test_a_scene_of_only_an_endless_plane_has_a_near_plane_in_mitsuba() -> None:
    """Mitsuba refuses a near plane at 0."""
    plane = {"type": "plane", "point": [0, 0, 0], "normal": [0, 1, 0], "emission": {"radiance": 1}}
    scene = glpath.load_scene({"camera": {"position": [0, 1, 4], "target": [0, 0, 0]}, "shapes": [plane]})
    sensor = described(scene, 2).plugins["sensor"]
    assert 0 < sensor["near_clip"] < 1 < sensor["far_clip"]


@pytest.mark.parametrize("lamp", [False, True])
def test_a_transparent_background_is_read_back_from_the_xml(lamp: bool, tmp_path: Path) -> None:
    """Mitsuba's `hide_emitters` hides the sky, and area lights as well; alpha needs pixels of format rgba."""
    emission = {"emission": {"radiance": 1}} if lamp else {}
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0]},
            "sky": {"zenith": 1, "horizon": 1},
            "shapes": [{"type": "box", "min": [0, 0, 0], "max": [1, 1, 1]} | emission],
        },
        {"background": "transparent"},
    )
    notes = quietly(scene, tmp_path / "a.xml")
    film = ElementTree.parse(tmp_path / "a.xml").find("sensor/film/string[@name='pixel_format']")
    assert film is not None
    assert film.attrib["value"] == "rgba"
    assert any("the camera does not see shapes that emit" in note for note in notes) is lamp
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        background = glpath.load_scene(tmp_path / "a.xml").background
    assert background is not None
    assert background.transparent


def test_backgrounds_that_mitsuba_lacks_are_reported() -> None:
    scene = glpath.load_scene("furnace")
    for ground, text in ((None, "the background is left out"), (np.zeros(3), "the background and its shadow are")):
        notes = described(replace(scene, background=Background(np.ones(3), ground=ground)), 2).differences
        assert any(text in note for note in notes)
    assert not any("background" in text for text in described(scene, 2).differences)


WIDE = {"type": "quad", "corners": [[-1e4, 0, 1e4], [1e4, 0, 1e4], [1e4, 0, -1e4], [-1e4, 0, -1e4]]}
ENDLESS = {"type": "plane", "point": [0, 0, 0], "normal": [0, 1, 0]}


@pytest.mark.parametrize(
    ("ground", "box", "camera"),
    [
        (WIDE, [[-0.5, 1, -2], [0.5, 2, -1]], {}),
        (WIDE, [[-0.5, 1, -2], [0.5, 2, -1]], {"type": "orthographic", "height": 2}),
        (WIDE, [[-0.5, 1, -2], [0.5, 2, -1]], {"type": "panorama"}),
        (ENDLESS, [[-1e4, 0, -1e4], [1e4, 2e4, -1e3]], {"target": [0, -2, -1]}),
    ],
)
def test_near_planes_hide_nothing_in_a_wide_scene(ground: Any, box: Any, camera: Any, tmp_path: Path) -> None:
    """What is nearest in view, the box or the ground below the camera, is more than 0.9 in front of the camera."""
    view = {"position": [0, 1.7, 0], "target": [0, 1.7, -1]} | camera
    shapes = [ground, {"type": "box", "min": box[0], "max": box[1]}]
    scene = glpath.load_scene({"camera": view, "sky": {"zenith": 1, "horizon": 1}, "shapes": shapes})
    assert 0 < described(scene, 2).plugins["sensor"]["near_clip"] < 0.9
    quietly(scene, tmp_path / "a.glb")
    made = ReadGlb.of(tmp_path / "a.glb").json["cameras"][0]
    assert 0 <= made[made["type"]]["znear"] < 0.9


@pytest.mark.parametrize("centre", [[0, 0, 0], [0, -100, 0]], ids=["dome", "ground"])
def test_spheres_around_or_below_the_camera_leave_the_near_plane_where_it_is(centre: list[float]) -> None:
    """Nothing in view is nearer than about 2: the dome is 100 away, and the ground is seen at an angle from 1.5."""
    ball = {"type": "sphere", "center": centre, "radius": 100}
    camera = {"position": [0, 1.5, 0], "target": [0, 1, -4]}
    scene = glpath.load_scene({"camera": camera, "sky": {"zenith": 1}, "shapes": [ball]})
    assert near_plane(scene, 0.3) == 0.3


def test_cameras_of_a_scene_without_size_have_the_depths_that_gltf_demands(tmp_path: Path) -> None:
    """glTF 2.0, camera.perspective: znear > 0; camera.orthographic: zfar > znear."""
    scene = replace(glpath.load_scene("furnace"), shapes=Shapes([]))
    for projection in ("perspective", "orthographic"):
        quietly(replace(scene, camera=replace(scene.camera, projection=projection)), tmp_path / "a.glb")
        made = ReadGlb.of(tmp_path / "a.glb").json["cameras"][0][projection]
        assert made.get("zfar", np.inf) > made["znear"] >= 0
        assert projection == "orthographic" or made["znear"] > 0


@pytest.mark.parametrize("turn", [np.eye(2, 3), np.diag([-2.0, 3.0, 1.0])[:2], np.eye(3)[[1, 0]] * [1, -1, 1]])
@pytest.mark.parametrize("mirrored", [False, True])
def test_green_of_a_normal_map_is_along_n_cross_u_in_mitsuba(mirrored: bool, turn: Any) -> None:
    """By glTF it is along v of the lookup; here of a square in x and y with u along x, v along y or against it."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float64)
    uv = corners * [1, -1] if mirrored else corners
    mesh = Mesh(np.pad(corners, ((0, 0), (0, 1))), np.array([(0, 1, 2), (0, 2, 3)], np.int32), uv=uv)
    stored = np.array([0.6, 0.8, 0.9], np.float32)
    material = Material("it", np.full(3, 0.5), two_sided=False, normal_texture=TextureSlot(0, 0, turn))
    camera = Camera(np.array([0.0, 0, 4]), np.zeros(3), np.array([0.0, 1, 0]), 40.0, (8, 8))
    scene = Scene(
        "a", camera, Shapes([Shape("it", mesh, 0)]), (material,), textures=(Texture("t", stored[None, None]),)
    )
    made = described(scene, 2).plugins["it"]["normalmap"]["image"][0, 0]
    lookup = np.linalg.inv(turn[:, :2]) * np.array(
        [[1.0], [-1.0 if mirrored else 1.0]]
    )  # columns are x, y of its axes
    t, b = (axis / np.linalg.norm(axis) for axis in lookup.T)
    x, y = (stored[:2] - 0.5) @ np.stack([t, b])
    expected = np.array([x, y, stored[2] - 0.5])  # n is z and u is x, so n x u is y
    np.testing.assert_allclose(
        (made - 0.5) / np.linalg.norm(made - 0.5), expected / np.linalg.norm(expected), atol=1e-6
    )


# Mitsuba itself


def mitsuba() -> Any:
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    from benchmarks.peers import mitsuba as mitsuba_peer

    return mitsuba_peer


def pictures(scene: Scene, xml: Path, instances: bool = False) -> tuple[Any, Any]:
    """By the files and from memory."""
    peer = mitsuba()
    mi = peer.load_mitsuba()
    quietly(scene, xml, max_depth=4, spp=16)
    in_memory = peer.in_memory(described(scene, 4, spp=16, instances=instances))
    return peer.render_peer(mi.load_file(str(xml)), 16), peer.render_peer(in_memory, 16)


@pytest.mark.evidence
@pytest.mark.parametrize("name", shipped_scenes())
def test_mitsuba_makes_of_the_files_what_it_makes_of_the_scene(name: str, tmp_path: Path) -> None:
    scene = glpath.load_scene(name).with_camera(resolution=(96, 96))
    by_file, by_memory = pictures(scene, tmp_path / "a.xml")
    # Several lights are in another order, so that the noise is another.
    lamps = len(scene.lights) + sum(shape.emits for shape in scene.shapes) + (scene.sky is not None)
    assert by_file.mean() == pytest.approx(by_memory.mean(), rel=1e-5 if lamps == 1 else 2e-2)
    if lamps == 1:
        assert np.median(np.abs(by_file - by_memory)) < 1e-6


@pytest.mark.evidence
def test_mitsuba_reads_every_material_light_and_map(tmp_path: Path) -> None:
    by_file, by_memory = pictures(everything(), tmp_path / "a.xml")
    assert np.isfinite(by_file).all()
    assert by_file.mean() == pytest.approx(by_memory.mean(), rel=2e-2)
    assert np.median(np.abs(by_file - by_memory)) < 0.05 * by_file.mean()  # noise


@pytest.mark.evidence
def test_instances_in_mitsuba_are_the_triangles_that_they_make(tmp_path: Path) -> None:
    ball = replace(unit_sphere(2), normals=None)
    scene = glpath.load_scene("cornell-box-36").with_camera(resolution=(64, 64))
    maps = moved(0.2 * np.eye(3, 4), 0.1 * MIRRORED, by=0.3)
    one_sided = Material("one-sided", np.full(3, 0.6), two_sided=False)
    shapes = Shapes((*scene.shapes, Shape("balls", ball, len(scene.materials), maps)))
    scene = replace(scene, shapes=shapes, materials=(*scene.materials, one_sided))
    by_file, by_memory = pictures(scene, tmp_path / "a.xml")
    assert by_file.mean() == pytest.approx(by_memory.mean(), rel=1e-3)
    assert np.median(np.abs(by_file - by_memory)) < 1e-4


@pytest.mark.evidence
def test_what_is_half_there_shines_by_half_in_mitsuba_too(tmp_path: Path) -> None:
    """A veil of radiance 1 over a wall of radiance 0.4; the half that is not there shows the wall."""
    data = {"camera": {"position": [0, 0, 3], "target": [0, 0, 0], "fov": 20}, "film": {"resolution": [8, 8]}}
    corners = np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]])
    wall: dict[str, Any] = {"type": "quad", "corners": corners - [0, 0, 1], "emission": {"radiance": 0.4}}
    veil: dict[str, Any] = {"type": "quad", "corners": corners, "material": "veil", "emission": {"radiance": 1.0}}
    for alpha, opacity, expected in (("blend", 0.5, 0.7), ("mask", 0.6, 1.0), ("mask", 0.3, 0.4)):
        it = {"type": "principled", "reflectance": 0, "specular": 0, "alpha": alpha, "opacity": opacity}
        scene = glpath.load_scene(data | {"shapes": [wall, veil], "materials": {"veil": it}})
        assert quietly(scene, tmp_path / "a.xml") == []
        by_file, _ = pictures(scene, tmp_path / "a.xml")
        assert by_file.mean() == pytest.approx(expected, abs=0.05)
        assert glpath.render(scene, spp=64).mean.mean() == pytest.approx(expected, abs=0.05)
    materials = tuple(replace(m, texture=TextureSlot(0)) if m.name == "veil" else m for m in scene.materials)
    image = np.full((2, 2, 4), 128, np.uint8)
    leafy = replace(scene, materials=materials, textures=(Texture("leaf", image),))
    assert any("whatever its alpha" in text for text in quietly(leafy, tmp_path / "a.xml"))


def test_a_pane_reflects_as_much_as_its_weight_says() -> None:
    """By a two-sided sheet's 2 F / (1 + F) at normal incidence; nothing of it where it reflects nothing."""
    scene = glpath.load_scene("furnace")
    for weight, reflected in ((1.0, 0.04), (0.5, 0.02), (0.0, 0.0)):
        pane = Material("pane", np.ones(3), roughness=0.0, transmission=1.0, specular_weight=weight)
        made = described(replace(scene, materials=(pane,) * len(scene.materials)), 4)
        index = made.plugins["pane"]["int_ior"]
        once = ((index - 1.0) / (index + 1.0)) ** 2
        assert 2.0 * once / (1.0 + once) == pytest.approx(reflected, abs=1e-12)
        assert any("its thin dielectric reflects" in text for text in made.differences) is (weight > 0)


@pytest.mark.parametrize("transmittance", [0.6, [0.82, 0.5, 0.2]])
def test_glazing_transmits_in_mitsuba_what_its_maker_gives(transmittance: Any) -> None:
    """Mitsuba's thin dielectric reflects 2 F / (1 + F), and transmits the rest, times its factors.

    The reflectance is the sum over all orders of reflections between the two faces.
    """
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0]},
            "materials": {"window": {"type": "glazing", "transmittance": transmittance}},
            "shapes": [{"type": "box", "min": [0, 0, 0], "max": [1, 1, 1], "material": "window"}],
            "sky": {"zenith": 1, "horizon": 1},
        }
    )
    made, inside = described(scene, 4).plugins["window"], scene.materials[0].reflectance
    once = ((made["int_ior"] - 1.0) / (made["int_ior"] + 1.0)) ** 2
    clear = 1.0 - 2.0 * once / (1.0 + once)
    needed = np.broadcast_to(transmittance, 3)
    assert clear * np.array(made["specular_transmittance"]["value"]) == pytest.approx(needed)
    orders = [(1.0 - once) ** 2 * once ** (2 * k + 1) * inside ** (2 * k + 2) for k in range(9)]
    assert (1.0 - clear) * np.array(made["specular_reflectance"]["value"]) == pytest.approx(once + sum(orders))


def test_coloured_vertices_of_a_metal_have_one_scale_in_mitsuba() -> None:
    """Mitsuba's `scale` of a mesh attribute is a number; an array would be written as a transform."""
    gold = Material("gold", np.ones(3), roughness=0.3, metallic=1.0, metal_index=(np.full(3, 0.2), np.full(3, 3.0)))
    box = box_mesh((0, 0, 0), (1, 1, 1))
    shape = Shape("box", replace(box, colours=np.ones((len(box.vertices), 4))), 0)
    scene = replace(glpath.load_scene("furnace"), shapes=Shapes([shape]), materials=(gold,))
    reflectance = described(scene, 4).plugins["gold"]["bsdf"]["specular_reflectance"]
    assert type(reflectance["scale"]) is float


def test_a_dielectric_that_reflects_like_a_metal_is_told_of(tmp_path: Path) -> None:
    white = Material("glazed", np.ones(3), roughness=1.0, specular_colour=np.full(3, 25.0))
    scene = replace(glpath.load_scene("furnace"), materials=(white,) * len(glpath.load_scene("furnace").materials))
    assert any("reflects 0.08, not 1," in text for text in quietly(scene, tmp_path / "a.xml"))


@pytest.mark.evidence
@pytest.mark.parametrize(
    "kind",
    [
        "point",
        "spot",
        "luminaire",
        "bulb",
        "directional",
        "sky",
        "environment",
        "sun",
        "plain sky",
        "smooth",
        "textured",
    ],
)
def test_lights_and_textures_are_mitsubas(kind: str, tmp_path: Path) -> None:
    """The mean of the picture within 1 %, and half of its squares of 8 x 8 pixels within 1 %."""
    peer = mitsuba()
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 2, 5], "target": [0, 0.6, 0], "fov": 45},
            "film": {"resolution": [64, 64]},
            "shapes": [
                {"type": "quad", "corners": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]], "name": "floor"},
                {
                    "type": "sphere",
                    "radius": 0.7,
                    "center": [0, 0.7, 0],
                    "subdivisions": 4 if kind == "smooth" else 3,
                },
            ],
            "sky": {"zenith": 1.0},
        }
    )
    if kind != "smooth":
        scene, _ = in_triangles(scene, Notes()), None
        flat = Shapes(replace(s, geometry=replace(s.geometry, normals=None)) for s in scene.shapes)
        scene = replace(scene, shapes=flat)
    lamp = Light("lamp", "point", np.array([30.0, 20, 10]), np.array([2.0, 4.0, 3.0]))
    aim = -lamp.position / np.linalg.norm(lamp.position)
    if kind in ("point", "spot", "directional"):
        cone = (25.0, 25.0)
        intensity = lamp.intensity / (20 if kind == "directional" else 1)
        light = replace(lamp, kind=kind, direction=aim, cone=cone, intensity=intensity)
        scene = replace(scene, sky=None, lights=(light,))
    elif kind in ("luminaire", "bulb"):
        # One that lights a cone, and one that lights all around it; both without symmetry.
        last = 60.0 if kind == "luminaire" else 180.0
        candela = np.random.default_rng(0).uniform(0.5, 2.0, (8, 13))
        lamp = replace(lamp, position=np.array([0.4, 3.0, 0.8]), intensity=np.array([4.0, 3.0, 2.0]))
        light = replace(lamp, direction=np.array([0.0, -1.0, 0.0]), profile=LightProfile(candela, (0.0, last)))
        scene = replace(scene, sky=None, lights=(light,))
    elif kind == "sky":
        scene = replace(scene, sky=Sky(np.array([0.2, 0.5, 2.0]), np.array([1.0, 0.5, 0.1])))
    elif kind == "environment":
        image = np.random.default_rng(0).uniform(0, 2, (4, 8, 3)).astype(np.float32)
        scene = replace(scene, sky=Environment(image, np.array([0.2, 1.0, 0.1]), 30.0))
    elif kind == "sun":
        image = np.full((32, 64, 3), [0.2, 0.4, 1.0], np.float32)
        image[6, 50] = 2e3
        scene = replace(scene, sky=Environment(image, scale=0.5))
    elif kind == "textured":
        image = np.random.default_rng(0).uniform(0, 1, (3, 4, 3)).astype(np.float32)
        texture = Texture("checks", image, (2.0, 3.0), "nearest")
        checked = Material("checked", np.full(3, 0.8), texture=TextureSlot(0))
        floor = replace(scene.shapes[0], material=len(scene.materials))
        scene = replace(
            scene,
            textures=(texture,),
            materials=(*scene.materials, checked),
            shapes=Shapes((floor, *scene.shapes[1:])),
        )
    quietly(scene, tmp_path / "a.xml", max_depth=3)
    mi = peer.load_mitsuba()
    theirs = peer.render_peer(mi.load_file(str(tmp_path / "a.xml")), 256)
    ours = glpath.render(scene, spp=256, max_depth=3).mean
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)
    a, b = (image.reshape(8, 8, 8, 8, 3).mean(axis=(1, 3)) for image in (ours, theirs))
    assert np.median(np.abs(a - b) / (b + 1e-2)) < 0.01


def test_what_mitsuba_has_no_counterpart_for_is_no_reference() -> None:
    peer = mitsuba()
    scene = glpath.load_scene("stacked")
    with pytest.raises(SceneError, match=r"(?s)no counterpart in Mitsuba: ambient light is left out"):
        peer.to_mitsuba(scene, 1)


LEFT_OUT = {
    "velvet": "its sheen is left out",
    "bubble": "the thin film over it is left out",
    "lampshade": "the light that its diffuse base lets through is left out",
    "car": "the clearcoat is that of Mitsuba's principled surface",
    "gold": "Mitsuba loses what its microfacets scatter more than once",
    "plastic": "textures of its layers, anisotropy and dielectric are left out",
}


def test_what_mitsuba_loses_is_said_of_each_material(tmp_path: Path) -> None:
    notes = quietly(everything(), tmp_path / "a.xml")
    for material, text in LEFT_OUT.items():
        assert any(text in note and f'"{material}"' in note for note in notes), (material, text)


# glTF


def close(found: Any, expected: Any, off: float = 1e-5) -> None:
    np.testing.assert_allclose(found, expected, rtol=off, atol=off)


def read_back(scene: Scene, tmp_path: Path) -> Model:
    quietly(scene, tmp_path / "a.glb")
    return read_gltf(tmp_path / "a.glb")


@pytest.mark.parametrize("name", ["cornell-box-36", "furnace", "room", "office"])
def test_a_shipped_scene_is_read_back_as_it_was(name: str, tmp_path: Path) -> None:
    scene = glpath.load_scene(name)
    model = read_back(scene, tmp_path)
    shapes = Shapes(model.shapes)
    # One shape for each mesh and material; triangles stay the same.
    order = np.lexsort(np.round(shapes.triangles.reshape(-1, 9), 4).T)
    expected = np.lexsort(np.round(scene.triangles.reshape(-1, 9), 4).T)
    close(shapes.triangles[order].sum(axis=(0, 1)), scene.triangles[expected].sum(axis=(0, 1)), 1e-4)
    assert len(shapes.triangles) == len(scene.triangles)
    close(
        np.sort(glpath.scene.model._area_vectors(shapes.triangles), axis=0),
        np.sort(glpath.scene.model._area_vectors(scene.triangles), axis=0),
        1e-4,
    )
    _, up, forward = scene.camera.frame()
    close(model.camera.position, scene.camera.position)
    close(model.camera.target - model.camera.position, forward)
    close(model.camera.up, up)
    assert model.camera.fov == pytest.approx(scene.camera.fov)
    by_name = {material.name: material for material in scene.materials}
    for shape in model.shapes:
        material = model.materials[shape.material]
        assert material.roughness is None
        np.testing.assert_array_equal(material.reflectance, by_name[material.name.partition(" (")[0]].reflectance)
    emitted = sum(float(s.emission.sum()) * len(s.geometry.faces) for s in model.shapes)
    assert emitted == pytest.approx(179 * sum(float(s.emission.sum()) * s.count for s in scene.shapes))


def test_every_material_is_read_back_as_it_was(tmp_path: Path) -> None:
    scene = everything()
    model = read_back(scene, tmp_path)
    found = {shape.name: model.materials[shape.material] for shape in model.shapes}
    same = ("white", "one-sided", "gold", "brushed", "plastic", "car", "pane", "glass", "veil", "leaf", "textured")
    same += ("paper", "velvet", "bubble", "lampshade", "lacquer", "satin")
    other = {"name", "specular", "exponent", "mirror", "unlit", "cutoff", *SLOTS}
    kept = [each.name for each in fields(Material) if each.name not in other]
    expected = {material.name: material for material in scene.materials}
    for name in same:
        for key in kept:
            wanted = getattr(expected[name], key)
            if wanted is None or isinstance(wanted, str):
                assert getattr(found[name], key) == wanted
            else:
                close(getattr(found[name], key), wanted)
        assert found[name].slots.keys() == expected[name].slots.keys()
        for key, slot in found[name].slots.items():
            was = expected[name].slots[key]
            scale = np.array(scene.textures[was.texture].scale)[:, None]
            assert slot.uv_set == was.uv_set
            close(slot.uv_transform, was.uv_transform * scale)
    assert found["leaf"].cutoff == 0.3
    assert found["unlit"].unlit
    close(found["mirror"].reflectance, 0.9)
    f0, f90 = found["half-mirror"].dielectric
    close(f0, 0.5)
    assert f90 == 0.5
    close(found["half-mirror"].reflectance * (1 - f90), 0.4)
    f0, _ = found["phong"].dielectric
    close(f0, 2 * 4.0 / 41.0)
    assert found["phong"].roughness == pytest.approx((2 / 42) ** 0.25)
    shapes = {shape.name: shape for shape in model.shapes}
    close(
        model.textures[found["textured"].emission_texture.texture].linear().max()
        * shapes["textured"].emission.max(),
        179 * 4 * textures()[3].image.max(),
        0.02,
    )
    colours = model.textures[found["veil"].texture.texture]
    np.testing.assert_array_equal(colours.image, textures()[0].image)
    assert (colours.wrap, colours.srgb) == (("clamp", "mirror"), True)
    assert model.textures[found["textured"].surface_texture.texture].filter == "nearest"


def test_black_backs_beside_a_culled_material_stay_black(tmp_path: Path) -> None:
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32))
    black, culled = (
        Material(name, np.ones(3), two_sided=False, culled=name == "culled") for name in ("black", "culled")
    )
    shapes = [Shape(m.name, mesh, i, np.eye(3, 4)[None]) for i, m in enumerate((black, culled))]
    scene = replace(glpath.load_scene("furnace"), shapes=Shapes(shapes), materials=(black, culled))
    found = {material.name: material.culled for material in read_back(scene, tmp_path).materials}
    assert found == {"black": False, "culled": True}


@pytest.mark.parametrize("integrator", ["path", "path-buffer"])
def test_a_diffuse_scene_is_the_same_film_as_a_glb(integrator: str, tmp_path: Path) -> None:
    """Of coordinates that 32 bits hold: nothing between the scene and its file may change a bit of the light."""
    texture = Texture("squares", textures()[0].image[..., :3], srgb=True, filter="nearest")
    materials = (
        Material("paper", np.array([0.9, 0.1, 1 / 3]), texture=TextureSlot(0), normal_texture=TextureSlot(1)),
        Material("white", np.full(3, 0.7), two_sided=False),
    )
    scene = Scene(
        "box",
        Camera(np.array([0.5, 2.0, 4.0]), np.array([0.5, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 60.0, (24, 16)),
        Shapes(
            [
                Shape("floor", box_mesh((-2, -1, -2), (3, 0, 2)), 0),
                Shape("box", box_mesh((0, 0, 0), (1, 1, 1)), 1),
                Shape("lamp", box_mesh((0, 3, 0), (1, 3.5, 1)), 1, emission=np.array([9.1, 5.3, 2.7])),
            ]
        ),
        materials,
        textures=(texture, textures()[2]),
        unit="photometric",
    )
    assert quietly(scene, tmp_path / "a.glb") == []
    back = glpath.load_scene(tmp_path / "a.glb").with_camera(scene.camera)
    first, second = (
        glpath.render(each, spp=4, max_depth=4, integrator=integrator).radiance_sums for each in (scene, back)
    )
    assert first.mean() > 0
    np.testing.assert_array_equal(second, first)


def test_lights_and_vertices_are_read_back_as_they_were(tmp_path: Path) -> None:
    scene = everything()
    model = read_back(scene, tmp_path)
    lights = {light.name: light for light in model.lights}
    for light in scene.lights:
        back = lights[light.name]
        assert back.kind == light.kind
        if light.falloff == "quadratic":
            close(back.intensity, 179 * light.intensity)
        if light.kind != "directional":
            close(back.position, light.position)
        if light.kind != "point":
            close(back.direction, light.direction)
    close(lights["torch"].cone, (20.0, 30.0), 1e-3)
    close(model.shapes[0].geometry.colours, scene.shapes[0].geometry.colours)
    close(model.shapes[0].geometry.uv, scene.shapes[0].geometry.uv)
    close(model.shapes[0].geometry.uv1, scene.shapes[0].geometry.uv1)
    # Rotated, mirrored and sheared: the same places and the same fronts.
    number = [shape.name for shape in scene.shapes].index("instances")
    wanted = scene.triangles[scene.shapes.ranges[number]]
    found = np.concatenate(
        [Shapes((s,)).triangles for s in model.shapes if s.name.startswith("instances")] or [np.zeros((0, 3, 3))]
    )
    if len(found) != len(wanted):  # those that share a mesh with another shape are under its name
        found = Shapes(model.shapes).triangles

    def volumes(triangles: Any) -> list[float]:
        return sorted(np.round(np.linalg.det(triangles - [20.0, 20, 20]), 3).tolist())

    all_found = volumes(found)
    for volume in volumes(wanted):
        assert any(abs(volume - other) < 2e-3 for other in all_found)


def test_only_emission_scales_a_float_texture_above_one(tmp_path: Path) -> None:
    """A base colour of glTF is at most 1, and 0.5 in it stays 0.5; a factor scales emission back."""
    image = np.full((1, 2, 3), 0.5, np.float32)
    image[0, 1] = 4.0
    both = Material("both", np.ones(3), roughness=1.0, texture=TextureSlot(0), emission_texture=TextureSlot(0))
    box = box_mesh((0, 0, 0), (1, 1, 1))
    box = replace(box, uv=np.zeros((len(box.vertices), 2)))
    scene = replace(
        glpath.load_scene("furnace"),
        shapes=Shapes([Shape("box", box, 0, emission=np.ones(3))]),
        materials=(both,),
        textures=(Texture("bright", image),),
        unit="photometric",
    )
    notes = quietly(scene, tmp_path / "a.glb")
    assert any('texture "bright": its values above 1 are 1' in note for note in notes)
    model = read_gltf(tmp_path / "a.glb")
    (material,) = model.materials
    base, emitted = (
        model.textures[slot.texture].linear() for slot in (material.texture, material.emission_texture)
    )
    close(base[0, :, 0], [0.5, 1.0], 5e-3)
    (shape,) = model.shapes
    close(emitted[0, :, 0] * shape.emission[0], [0.5, 4.0], 2e-2)


def test_a_file_is_turned_until_y_is_up(tmp_path: Path) -> None:
    scene = glpath.load_scene("cornell-box-36").with_camera(up=np.array([0.0, 0.1, 1.0]))
    document = _exported(scene, tmp_path)
    assert document["nodes"][0]["rotation"] == pytest.approx([-(0.5**0.5), 0, 0, 0.5**0.5])


def _exported(scene: Any, tmp_path: Path) -> dict[str, Any]:
    quietly(scene, tmp_path / "a.glb")
    return ReadGlb.of(tmp_path / "a.glb").json


def test_shapes_of_one_mesh_share_it(tmp_path: Path) -> None:
    scene = glpath.load_scene("stacked", {"objects": 30})
    document = _exported(scene, tmp_path)
    assert len(document["meshes"]) == len(scene.materials)  # one for each material
    assert len(document["accessors"]) == 3
    assert len(document["nodes"]) == 30 + 3  # root, camera and light


def test_extensions_are_named_where_they_are_used(tmp_path: Path) -> None:
    metal = replace(glpath.load_scene("cornell-box-36"), materials=(Material("m", np.ones(3), roughness=1.0),) * 3)
    document = _exported(metal, tmp_path)
    assert document["extensionsUsed"] == ["KHR_materials_emissive_strength"]
    document = _exported(everything(), tmp_path)
    assert document["extensionsUsed"] == sorted(
        ["KHR_lights_punctual", "KHR_texture_transform"]
        + [f"KHR_materials_{name}" for name in (
            "anisotropy", "clearcoat", "diffuse_transmission", "emissive_strength", "ior", "iridescence", "sheen",
            "specular", "transmission", "unlit", "volume",
        )]
    )  # fmt: skip


@pytest.mark.evidence
@pytest.mark.parametrize("name", shipped_scenes())
def test_the_validator_finds_nothing_in_a_shipped_scene(name: str, tmp_path: Path) -> None:
    quietly(name, tmp_path / "a.glb")
    assert judged(tmp_path / "a.glb") == []


@pytest.mark.evidence
def test_the_validator_finds_nothing_in_all_that_there_is(tmp_path: Path) -> None:
    quietly(everything(), tmp_path / "a.glb")
    assert judged(tmp_path / "a.glb") == []


@pytest.mark.evidence
def test_the_validator_finds_nothing_in_a_baked_scene(tmp_path: Path) -> None:
    scene = glpath.load_scene("cornell-box")
    glpath.solve_radiosity(scene, patches=60).to_glb(scene, tmp_path / "a.glb")
    assert judged(tmp_path / "a.glb") == []


# The command, and what goes wrong


def test_the_command_writes_both(tmp_path: Path) -> None:
    done = run(
        "export", "furnace", "-D", "subdivisions=1", "-o", tmp_path / "new" / "a.xml", "-o", tmp_path / "a.glb",
        "--resolution", "20x10", "--spp", 4, "--max-depth", 2,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert f"wrote {tmp_path / 'a.glb'}" in done.stderr
    assert "warning" in done.stderr  # glTF has no lamps of one side
    root = ElementTree.parse(tmp_path / "new" / "a.xml").getroot()
    assert root.find("sensor/film/integer[@name='width']").attrib["value"] == "20"
    assert read_gltf(tmp_path / "a.glb").camera.aspect == 2.0


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["-o", "a.obj"], 2, "a.obj: a scene is exported as .xml (Mitsuba 3) or .glb (glTF 2.0)"),
        (["-o", "-"], 2, "-: a scene is exported as"),
        (["-o", "a.glb", "--spp", "4"], 2, "glTF has no field for spp"),
        (["-o", "a.xml", "--spp", "0"], 2, "spp is 0; must be a whole number, at least 1"),
        (["-o", "a.xml", "--resolution", "3"], 2, "--resolution 3"),
        (["-o", "a.xml", "-D", "radius=3"], 1, "has no parameter `radius`"),
        (["-o", "folder.glb"], 1, "is a folder"),
        ([], 2, "-o"),
    ],
)
def test_mistakes_are_explained_and_nothing_is_written(
    arguments: list[str], code: int, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.glb").mkdir()
    done = run("export", "furnace", *arguments)
    assert (done.exit_code, message in done.output) == (code, True), done.output
    assert [path.name for path in tmp_path.iterdir()] == ["folder.glb"]


def test_xml_whose_name_is_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(glpath.GlpathError, match="its name is not UTF-8 text"):
        glpath.export("cornell-box-36", tmp_path / "a\udcff.xml")
    assert not list(tmp_path.iterdir())


def test_xml_whose_name_has_a_parameter_of_mitsuba_is_refused(tmp_path: Path) -> None:
    """Mitsuba replaces $NAME in all attributes, and the XML names the folder of its files."""
    with pytest.raises(glpath.GlpathError, match=r"holds \$"):
        glpath.export("cornell-box", tmp_path / "a$b.xml")
    assert not list(tmp_path.iterdir())


def test_an_xml_is_not_written_into_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.xml")
    with pytest.raises(UsageError, match="pipe"):
        glpath.export("furnace", tmp_path / "a.xml")


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The XML comes last, so that it never names a mesh that is not there."""
    quietly("cornell-box-36", tmp_path / "a.xml")
    before = (tmp_path / "a.xml").read_bytes()
    names = files_of(tmp_path / "a.xml")

    def refused(*_: object) -> bytes:
        raise ImageError("full")

    monkeypatch.setattr("glpath.io.export.mitsuba_xml.ply", refused)
    with pytest.raises(ImageError):
        quietly("room", tmp_path / "a.xml")
    assert (tmp_path / "a.xml").read_bytes() == before
    assert all((tmp_path / name).is_file() for name in names)
