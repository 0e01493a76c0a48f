"""Model files as scenes: glTF, OBJ with MTL, PLY, and trimesh's objects, with the materials that they bring."""

from __future__ import annotations

import json
import random
import re
import time
import warnings
from dataclasses import fields
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner

import glpath
from glpath import load_scene
from glpath.cli.main import app
from glpath.errors import SceneError, SceneWarning, UsageError
from glpath.film.exr import write_exr
from glpath.io import scene_cameras, scene_parameters
from glpath.io.completed import aside
from glpath.io.mtl import Library, _Reader
from glpath.io.pictures import Pictures
from glpath.io.values import nearby_files
from glpath.rendering.job import RenderJob, describe
from glpath.scene import Environment, Material, Scene, check_scene
from glpath.scene.camera import framing
from glpath.system.colour import decode_srgb
from tests.support.gltf_files import Gltf
from tests.support.lit_models import CAMERA_AND_LIGHT
from tests.support.models import FACES, MTL, gltf, obj


def quiet(given: object, **parameters: object) -> Scene:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return load_scene(given, parameters)  # type: ignore[arg-type]


def said(path: Path) -> list[str]:
    """The warnings of reading a file."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_scene(path)
    assert all(each.category is SceneWarning for each in caught)
    assert all(each.filename == __file__ for each in caught)  # they point at who loads
    return [str(each.message) for each in caught]


def same(one: Material, other: Material) -> bool:
    """Two materials are alike but for their names."""
    return all(
        np.array_equal(getattr(one, each.name), getattr(other, each.name))
        for each in fields(Material)
        if each.name != "name"
    )


def test_gltf_and_obj_of_one_box_are_one_scene(tmp_path: Path) -> None:
    one, other = quiet(gltf(tmp_path / "box.gltf")), quiet(obj(tmp_path / "box.obj"))
    assert np.array_equal(one.triangles, other.triangles)
    assert np.array_equal(one.triangle_shape, other.triangle_shape)
    assert all(map(same, one.materials, other.materials))
    assert [m.name for m in one.materials] == [m.name for m in other.materials] == ["Paint", "Gold"]
    assert np.array_equal(one.camera.position, other.camera.position)
    pictures = [glpath.render(each.with_camera(resolution=(24, 24)), spp=4).mean for each in (one, other)]
    assert np.array_equal(*pictures)
    assert pictures[0].max() > 0.1


@pytest.mark.parametrize("resolution", [(200, 150), (150, 200), (400, 40), (512, 512)])
@pytest.mark.parametrize("size", [(1, 6, 1), (8, 1, 1), (1, 1, 1)])
def test_the_camera_of_a_model_without_one_sees_everything_at_every_resolution(
    tmp_path: Path, size: tuple[float, float, float], resolution: tuple[int, int]
) -> None:
    path = tmp_path / "box.ply"
    trimesh.creation.box(size).export(path)
    _, scene = describe(quiet(path), resolution=resolution)
    assert scene.camera.resolution == resolution
    at, depth = scene.camera.project(scene.triangles)
    assert (depth > 0).all()
    assert (at >= 0).all()
    assert (at <= resolution).all()
    # It fills the picture in one direction, and stands in its middle there.
    filled = np.ptp(at.reshape(-1, 2), axis=0) / resolution
    tight = int(np.argmax(filled))
    assert filled[tight] == pytest.approx(1 / 1.15, rel=0.01)
    middle = 0.5 * (at.reshape(-1, 2).min(axis=0) + at.reshape(-1, 2).max(axis=0)) / resolution
    assert middle[tight] == pytest.approx(0.5, abs=0.01)


def views(extent: tuple[float, float, float]) -> tuple[float, float]:
    """Degrees from the front to the right, and upwards, from which a box is seen."""
    half = 0.5 * np.array(extent)
    camera = framing(np.array(list(product(*zip(-half, half, strict=True)))), (100, 100))
    x, y, z = -camera.frame()[2]
    return float(np.degrees(np.arctan2(x, z))), float(np.degrees(np.arcsin(y)))


def test_a_model_is_seen_from_the_front_what_is_flat_from_above_what_is_deep_from_its_side() -> None:
    assert views((1, 1, 1)) == pytest.approx((20, 18))
    assert views((1, 9, 1)) == pytest.approx((20, 18))
    assert views((3, 0, 2)) == pytest.approx((20, 40))
    assert views((0, 2, 3)) == pytest.approx((75, 18))
    turned, _ = views((1, 2, 2.5))
    assert 20 < turned < 75


def test_a_camera_of_the_file_may_be_left_out(tmp_path: Path) -> None:
    path = gltf(tmp_path / "box.gltf")
    written = json.loads(path.read_text())
    written["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0}}]
    written["nodes"].append({"camera": 0, "translation": [0, 0, 99]})
    for each in written.get("scenes", []):
        each["nodes"].append(len(written["nodes"]) - 1)
    path.write_text(json.dumps(written))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        own, framed = load_scene(path), load_scene(path, {"camera": "none"})
    assert own.camera.position.tolist() == [0, 0, 99]
    assert framed.camera.position[2] < 9


def test_the_top_and_a_side_of_a_box_are_seen() -> None:
    corners = np.array(list(product((-0.5, 0.5), repeat=3)))
    eye = framing(corners, (100, 100)).position
    assert eye[1] > 0.7
    assert eye[0] > 0.7


def test_a_camera_that_was_chosen_stays_at_another_resolution(tmp_path: Path) -> None:
    path = tmp_path / "box.ply"
    trimesh.creation.box((1, 6, 1)).export(path)
    position = quiet(path).camera.position * 1.001
    chosen = quiet(path).with_camera(position=position)
    assert np.array_equal(chosen.with_camera(resolution=(20, 10)).camera.position, position)


@pytest.mark.parametrize("suffix", [".gltf", ".obj"])
def test_what_a_model_lacks_is_added_and_said_once(tmp_path: Path, suffix: str) -> None:
    path = (gltf if suffix == ".gltf" else obj)(tmp_path / f"box{suffix}")
    (text,) = said(path)
    assert text == (
        f"{path}: has no camera, so one was set that shows everything: position [0.894, 0.797, 2.65], target "
        "[-0.051, -0.101, 0.053], fov 30, for 512 x 512 pixels, and no light, so a studio lights it."
    )
    scene = quiet(path)
    assert (scene.camera.resolution, scene.camera.up.tolist()) == ((512, 512), [0, 1, 0])
    at, depth = scene.camera.project(scene.triangles)
    assert (depth > 0).all()
    assert ((at > 0) & (at < 512)).all()
    assert isinstance(scene.sky, Environment)
    assert scene.sky.assumed
    assert check_scene(scene) == []


def glowing(folder: Path, strength: float, **other: object) -> Path:
    """A triangle that glows by a texture, and one of `other` material."""
    made = Gltf()
    texture = made.texture([[[255, 0, 0], [0, 0, 0]]])
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    made.one_triangle(emissiveFactor=[1, 1, 1], emissiveTexture={"index": texture}, extensions=strong)
    made.one_triangle(**other)
    return made.write(folder)


def test_a_faint_glow_is_not_the_light_by_which_a_model_is_seen(tmp_path: Path) -> None:
    """Khronos' DamagedHelmet is lit by its surroundings in every viewer, and has a few glowing texels."""
    path = glowing(tmp_path, 1.0)
    *_, text = said(path)
    assert "no light but what glows faintly (emission 1 at most; a lamp has more than 1, in glTF by " in text
    assert "KHR_materials_emissive_strength, in MTL by Ke), so a studio lights it" in text
    scene = quiet(path)
    assert scene.sky is not None
    assert scene.shapes[0].emits, "it glows all the same"


def test_what_sends_more_than_white_is_a_lamp_and_gets_no_sky(tmp_path: Path) -> None:
    assert not any("no light" in text for text in said(glowing(tmp_path, 5.0)))
    assert quiet(glowing(tmp_path, 5.0)).sky is None


def test_what_is_unlit_is_seen_without_light_and_lights_nothing(tmp_path: Path) -> None:
    unlit = {"extensions": {"KHR_materials_unlit": {}}}
    path = Gltf().one_triangle(**unlit).write(tmp_path)
    with aside("picture"):
        assert quiet(path).sky is None
    pictured = quiet(path)
    assert not any("no light" in text for text in said(path)), "it needs none"
    assert pictured.background is not None, "else it would stand before black"
    assert pictured.background.ground is not None
    mixed = Gltf().one_triangle(**unlit).one_triangle()
    assert quiet(mixed.write(tmp_path)).sky is not None


def test_the_camera_and_the_lights_of_a_file_are_used(tmp_path: Path) -> None:
    path = gltf(tmp_path / "a.gltf", **CAMERA_AND_LIGHT)
    assert said(path) == []
    scene = load_scene(path)
    assert (scene.camera.resolution, scene.sky) == ((512, 256), None)
    assert scene.camera.position.tolist() == [0, 0, 5]
    (lamp,) = scene.lights
    assert (lamp.kind, lamp.position.tolist(), lamp.intensity.tolist()) == ("point", [0, 3, 0], [6, 3, 1.5])


@pytest.mark.parametrize("camera", ["Tall", "1", 1])
def test_parameters_choose_camera_time_and_light(tmp_path: Path, camera: object) -> None:
    path = gltf(tmp_path / "a.gltf", **CAMERA_AND_LIGHT)
    scene = load_scene(path, {"camera": camera, "light_factor": "0.5"})
    assert scene.camera.resolution == (256, 512)
    assert scene.lights[0].intensity.tolist() == [3, 1.5, 0.75]
    assert scene_cameras(str(path)) == ("Wide", "Tall")
    assert {key: default for key, (default, _) in scene_parameters(str(path)).items()} == {
        "camera": "first",
        "time": "rest",
        "shutter": 0.0,
        "animation": "first",
        "variant": "none",
        "unit": "photometric",
        "light_factor": 1.0,
        "backs": "absent",
    }
    job = RenderJob.of(path, parameters={"camera": camera}, spp=1)
    assert RenderJob.from_json(job.to_json()) == job
    assert job.scene.load().camera.position.tolist() == [1, 0, 5]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"kamera": 1},
            "a.gltf: has no parameter `kamera`. Allowed: camera=first, time=rest, shutter=0.0, animation=first, "
            "variant=none, light_factor=1.0, unit=photometric, backs=absent.",
        ),
        ({"time": -1}, "a.gltf: time is -1, but must be seconds into the file's animations, from 0, or rest."),
        ({"light_factor": "bright"}, 'light_factor is "bright", but must be a number from 0'),
        ({"camera": "Narrow"}, 'camera "Narrow" was asked for, but the file has 0 "Wide", 1 "Tall"'),
        ({"time": "inf"}, "time is inf"),
    ],
)
def test_wrong_parameters_say_what_is_allowed(tmp_path: Path, given: dict[str, object], message: str) -> None:
    path = gltf(tmp_path / "a.gltf", **CAMERA_AND_LIGHT)
    with pytest.raises((SceneError, UsageError)) as error:
        load_scene(path, given)
    assert message in str(error.value)


def test_a_mesh_file_has_no_time(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"has no parameter `time`. Allowed: up=guess."):
        quiet(obj(tmp_path / "box.obj"), time=1)


def test_a_model_without_triangles_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"empty.gltf: has no triangles"):
        load_scene(gltf(tmp_path / "empty.gltf", nodes=[{}]))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("normals.obj", "vn 0 0 1\n", "has no triangles"),
        ("cut.ply", "ply\nformat", "cannot be read as PLY: "),
        ("wide.obj", "v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", "reaches beyond 1e+15 scene units"),
    ],
)
def test_an_error_about_a_mesh_file_by_itself_names_it_once(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / name)
    assert str(error.value).startswith(f"{tmp_path / name}: {message}")
    assert str(error.value).count(name) == 1


def test_where_no_file_of_a_kind_lies_the_kind_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").touch()
    assert nearby_files("Files", tmp_path / "wood.png", {".png"}) == f"Files in {tmp_path}: none of .png."


def test_what_trimesh_reads_is_what_is_read_here(tmp_path: Path) -> None:
    path = gltf(tmp_path / "box.gltf")
    ours, through = quiet(path), quiet(trimesh.load_scene(path))
    assert len(through.materials) == 2
    assert through.triangles.sum(axis=0) == pytest.approx(ours.triangles.sum(axis=0), abs=1e-6)
    assert sorted(m.name for m in through.materials) == ["Gold", "Paint"]
    by_name = {material.name: material for material in ours.materials}
    for material in through.materials:
        one, other = material, by_name[material.name]
        assert np.allclose(one.reflectance, other.reflectance, atol=1 / 255)  # which it keeps in 8 bits
        assert (one.roughness, one.metallic, one.two_sided) == (other.roughness, other.metallic, other.two_sided)


# MTL.


def surfaces(folder: Path, mtl: str, uv: bool = False) -> Scene:
    return quiet(obj(folder / "box.obj", mtl, uv))


def test_phong_becomes_microfacets(tmp_path: Path) -> None:
    paint, gold = surfaces(
        tmp_path,
        "newmtl Paint\nKd 0.5\nKs 0.5\nNs 98\nillum 2\nnewmtl Gold\nKd 0 0 0\nKs 0.9 0.7 0.3\nNs 18",
    ).materials
    assert paint.roughness == pytest.approx((2 / 100) ** 0.25)  # alpha = sqrt(2 / (n + 2)), its square
    assert np.allclose(paint.dielectric[0], 0.04)  # 0.5 is a dielectric of index 1.5
    assert (gold.metallic, gold.reflectance.tolist()) == (1, [0.9, 0.7, 0.3])
    plain, mirror = surfaces(
        tmp_path,
        "newmtl Paint\nKd 0.5\nKs 1 1 1\nNs 9\nillum 1\nnewmtl Gold\nKd 0.1\nKs 0.6 0.6 0.6\nNs 999\nillum 3",
    ).materials
    assert plain.roughness is None
    assert plain.reflectance.tolist() == [0.5] * 3
    assert np.allclose(mirror.dielectric[0], 0.6)


@pytest.mark.parametrize(
    ("gloss", "is_metal"),
    [
        ("Ks 0.5 0.5 0.5\nillum 2", False),  # black plastic and lamps of Blender
        ("Ks 0.5019608 0.5019608 0.5019608", False),  # 128 of 255
        ("Ks 0.1 0.1 0.1", False),
        ("Ks 0.5 0.5 0.5\nillum 3", True),
        ("Ks 0.9 0.9 0.9", True),
        ("Ks 0.4 0.3 0.1", True),
    ],
)
def test_black_paint_is_metal_only_if_no_dielectric_reflects_so(tmp_path: Path, gloss: str, is_metal: bool) -> None:
    """Dielectrics reflect without colour, and as Ks of 0.5 is an index of 1.5, most reflect no more than that."""
    (paint, _) = surfaces(tmp_path, f"newmtl Paint\nNs 250\nKd 0 0 0\n{gloss}\nnewmtl Gold\nKd 1 1 1").materials
    specular = [float(word) for word in gloss.split()[1:4]]
    assert paint.metallic == is_metal
    assert np.allclose(paint.reflectance, specular if is_metal else 0.0)
    if not is_metal:
        assert np.allclose(paint.dielectric[0], 0.04 * specular[0] / 0.5)


@pytest.mark.parametrize(
    ("written", "opacity", "note"),
    [
        ("Tr 1", 1.0, "Tr of 1"),
        ("Tr 0.25", 0.75, ""),
        ("d 0\nTr 1", 1.0, "d of 0"),
        ("d 0", 1.0, "d of 0"),
        ("d 0.000", 1.0, "d of 0"),
        ("d -1", 1.0, "d of 0"),
        ("d 0.5", 0.5, ""),
    ],
)
def test_a_material_of_mtl_is_never_invisible(tmp_path: Path, written: str, opacity: float, note: str) -> None:
    """MeshLab and others write opacity as Tr, and some write transparency as d: their models were invisible."""
    path = obj(tmp_path / "box.obj", f"newmtl Paint\nKd 1 1 1\n{written}\nnewmtl Gold\nKd 1 1 1")
    assert quiet(path).materials[0].opacity == opacity
    told = [text for text in said(path) if "by which a surface would not be there: it is opaque" in text]
    assert len(told) == bool(note)
    assert all(note in text for text in told)


def test_glass_of_mtl_may_let_all_light_through(tmp_path: Path) -> None:
    (glass, _) = surfaces(tmp_path, "newmtl Paint\nillum 7\nNi 1.5\nd 0\nnewmtl Gold\nKd 1 1 1").materials
    assert (glass.transmission, glass.opacity) == (1.0, 1.0)


def test_glass_light_and_opacity_of_mtl(tmp_path: Path) -> None:
    scene = surfaces(
        tmp_path, "newmtl Paint\nillum 7\nNi 1.33\nTf 0.5 0.75 1\nnewmtl Gold\nKd 1 1 1\nd 0.25\nKe 1 2 3"
    )
    glass, film = scene.materials
    assert (glass.transmission, glass.thin, glass.ior, glass.roughness) == (1, False, 1.33, 0)
    assert glass.reflectance.tolist() == [0.5, 0.75, 1]
    assert (film.opacity, film.alpha) == (0.25, "blend")
    assert scene.shapes[1].emission.tolist() == [1, 2, 3]
    assert scene.sky is None


@pytest.mark.parametrize("illum", [4, 9])
@pytest.mark.parametrize(
    ("written", "is_glass"),
    [
        ("Tf 1 1 1\nNi 1", False),  # as Maya writes opaque paint
        ("d 1\nTf 1 1 1", False),
        ("Tf 0 0 0", False),
        ("d 0.2\nTf 0.9 0.9 1", True),
        ("Tf 0.9 0.9 1", True),
    ],
)
def test_illumination_models_4_and_9_are_glass_only_if_light_gets_through(
    tmp_path: Path, illum: int, written: str, is_glass: bool
) -> None:
    paint = surfaces(
        tmp_path, f"newmtl Paint\nKd 0.5 0.2 0.1\nillum {illum}\n{written}\nnewmtl Gold\nKd 1 1 1"
    ).materials[0]
    assert (paint.transmission > 0) == is_glass
    if not is_glass:
        assert paint.reflectance.tolist() == [0.5, 0.2, 0.1]
        assert paint.opacity == 1


BLENDER_GLOSS = "Ns 250\nKa 1 1 1\nKs 0.5 0.5 0.5\nKe 0 0 0\nNi 1.5\n"


@pytest.mark.parametrize("illum", [6, 9])
@pytest.mark.parametrize("gloss", [BLENDER_GLOSS, "Pr 0.3\nPm 1\n"])
@pytest.mark.parametrize("density", ["d 0.5", "d 0.5\nTf 1 1 1"])
def test_a_surface_with_alpha_of_blender_keeps_its_colour_and_gloss(
    tmp_path: Path, illum: int, gloss: str, density: str
) -> None:
    """Blender writes illum 6 or 9 if alpha is below 1, and its importer reads Kd and d alone."""
    written = f"Kd 0.8 0 0\n{gloss}{density}\n"
    paint, plain = surfaces(
        tmp_path, f"newmtl Paint\n{written}illum {illum}\nnewmtl Gold\n{written}illum 2"
    ).materials
    assert same(paint, plain)
    assert paint.reflectance.tolist() == [0.8, 0, 0]
    assert (paint.opacity, paint.alpha) == (0.5, "blend")


@pytest.mark.parametrize(("illum", "thin"), [(4, True), (6, False), (7, False), (9, True)])
@pytest.mark.parametrize("passes", ["Ni 1.5", "Ni 1.5\nTf 1 1 1"])
def test_glass_of_density_0_is_clear(tmp_path: Path, illum: int, thin: bool, passes: str) -> None:
    """The MTL specification: illum 4, 6, 7 and 9 are glass or refraction, and d 0 is fully transparent."""
    glass = surfaces(tmp_path, f"newmtl Paint\nKd 1 1 1\nillum {illum}\nd 0\n{passes}\nnewmtl Gold").materials[0]
    assert (glass.transmission, glass.thin, glass.ior, glass.opacity) == (1, thin, 1.5, 1)


@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_glass_of_blender_has_the_colour_and_roughness_of_its_surface(tmp_path: Path, opacity: float) -> None:
    """Blender's importer takes the mean of Tf as the weight of transmission, over Kd, Pr and Ni."""
    pbr = "Ni 1.45\nPr 0.25\nPm 0\nPs 0\nPc 0\nPcr 0.03\naniso 0\nanisor 0\n"
    written = f"Kd 0.8 1 0.9\nKs 0.5 0.5 0.5\nTf 1 1 1\nd {opacity}\nillum {2 if opacity == 1 else 9}\n"
    glass, paint = surfaces(tmp_path, f"newmtl Paint\n{written}{pbr}newmtl Gold\n{written}").materials
    assert (glass.transmission, glass.thin, glass.ior, glass.roughness) == (1, False, 1.45, 0.25)
    assert (glass.reflectance.tolist(), glass.opacity) == ([0.8, 1, 0.9], opacity)
    assert paint.transmission == 0  # without Pr and Pm as 3ds Max writes it


def test_thin_glass_has_the_colour_of_its_paint(tmp_path: Path) -> None:
    red, grey = surfaces(
        tmp_path, "newmtl Paint\nillum 4\nKd 0.8 0.1 0.1\nd 0.2\nnewmtl Gold\nillum 4\nKd 0.5 0.5 0.5\nd 0.2"
    ).materials
    assert (red.transmission, red.thin, red.reflectance.tolist()) == (0.8, True, [0.8, 0.1, 0.1])
    assert (grey.transmission, grey.thin, grey.reflectance.tolist()) == (0.8, True, [1, 1, 1])


def test_transparent_paint_of_maya_is_blended(tmp_path: Path) -> None:
    """Maya writes 1 - transparency as Tf, without d, and Ni 1.00."""
    mtl = "newmtl Paint\nillum 4\nKd 0.50 0.00 0.00\nKa 0.00 0.00 0.00\nTf 0.90 0.90 0.90\nNi 1.00\n"
    paint, plain = surfaces(tmp_path, f"{mtl}newmtl Gold\nKd 0.5 0 0\nd 0.9").materials
    assert same(paint, plain)
    assert (paint.reflectance.tolist(), paint.opacity) == ([0.5, 0, 0], pytest.approx(0.9))


def test_one_mtllib_statement_may_name_several_files(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl A\nKd 0.1 0.2 0.3\n")
    (tmp_path / "b.mtl").write_text("newmtl B\nKd 0.4 0.5 0.6\n")
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl b.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl A\nf 1 2 3\nusemtl B\nf 3 2 1\n")
    assert [m.reflectance.tolist() for m in quiet(path).materials] == [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"


def square(folder: Path, mtl: str, *, names: tuple[str, ...] = ("m",), library: str = "a.mtl") -> Path:
    """An OBJ of a square for each name of a material; bytes of the names are those of Latin-1."""
    (folder / "a.mtl").write_bytes(mtl.encode("latin-1"))
    faces = "".join(f"usemtl {name}\n{FACE}" for name in names)
    (folder / "a.obj").write_bytes(f"mtllib {library}\n{SQUARE}{faces}".encode("latin-1"))
    return folder / "a.obj"


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("Material #25", "Material #26"),
        ("#FF0000", "#0000FF"),
        ("Part # 5", "Part # 6"),
        ("1.#IND", "1.#INF"),
        ("\x95\x5c", "\x83\x5c"),  # two letters of Shift-JIS, whose second byte is a backslash
        ("C:\\paint\\", "C:\\gold\\"),
    ],
)
def test_names_of_materials_are_as_they_are_written(tmp_path: Path, first: str, second: str) -> None:
    mtl = f"newmtl {first}\nKd 1 0 0\nnewmtl {second}\nKd 0 0 1\n"
    path = square(tmp_path, mtl, names=(first, second))
    assert len(said(path)) == 1  # of the camera
    assert [m.reflectance.tolist() for m in quiet(path).materials] == [[1, 0, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    ("defined", "used"), [("red # my", "red"), ("red", "red # my"), ("red", "red #my"), ("red #2", "red")]
)
def test_a_comment_behind_a_name_is_one_if_it_has_blanks_around_it(tmp_path: Path, defined: str, used: str) -> None:
    path = square(tmp_path, f"newmtl {defined}\nKd 1 0 0\n", names=(used,))
    is_known = " # " in defined + used
    assert quiet(path).materials[0].reflectance.tolist() == ([1, 0, 0] if is_known else [0.5] * 3)
    assert len(said(path)) == (1 if is_known else 2)


def test_a_material_is_built_once_for_all_names_with_comments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requested: list[str] = []
    monkeypatch.setattr(Pictures, "picture", lambda _, name: requested.append(name))
    names = ("m", *(f"m # {i}" for i in range(20)))
    mtl = f"newmtl m\nKd 1 0 0\nmap_Kd x.png\nmap_d {'-t 1 ' * 300_000}y.png\n"
    path = square(tmp_path, mtl, names=names)
    materials = quiet(path).materials
    assert [material.name for material in materials] == list(names)
    assert all(material.reflectance.tolist() == [1, 0, 0] for material in materials)
    assert requested == ["x.png"]
    requested.clear()
    assert sum("Textures in statements of more than 1,048,576 letters" in each for each in said(path)) == 1


def test_statements_go_on_behind_a_backslash(tmp_path: Path) -> None:
    mtl = "newmtl m\nKd 1 \\ # red\n0 0\nmap_Kd -s 2 \\\n2 2 wood.png\n"
    Image.new("RGB", (2, 2)).save(tmp_path / "wood.png")
    (material,) = quiet(square(tmp_path, mtl)).materials
    assert material.reflectance.tolist() == [1, 0, 0]
    assert material.texture is not None
    assert material.texture.uv_transform.tolist() == [[2, 0, 0], [0, 2, 0]]


@pytest.mark.parametrize(
    "name",
    [
        "wood #2.png",
        "a  b.png",
        '"wood.png"',
        '"my wood.png"',
        "'wood.png'",
        "wood.png # brown",
        '"C:\\x\\wood.png"',
    ],
)
def test_names_of_textures_are_as_they_are_written_or_in_quotes(tmp_path: Path, name: str) -> None:
    stored = name.partition(" # ")[0].strip("\"'").rpartition("\\")[2]
    Image.new("RGB", (2, 2), (9, 8, 7)).save(tmp_path / stored)
    path = square(tmp_path, f"newmtl m\nmap_Kd {name}\n", library='"a.mtl"')
    assert [texture.image[0, 0].tolist() for texture in quiet(path).textures] == [[9, 8, 7]]
    assert len(said(path)) == 1 + ("C:" in name)


def test_options_of_a_texture_may_follow_its_name(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (128, 128, 255)).save(tmp_path / "a  b.png")
    options = "-s 2 3 1 -clamp on"
    (behind,) = quiet(square(tmp_path, f"newmtl m\nmap_Kd a  b.png {options}\nbump a  b.png -bm 0.5\n")).materials
    (before,) = quiet(square(tmp_path, f"newmtl m\nmap_Kd {options} a  b.png\nbump -bm 0.5 a  b.png\n")).materials
    for material in (behind, before):
        assert material.texture is not None
        assert material.texture.uv_transform.tolist() == [[2, 0, 0], [0, 3, 0]]
        assert material.normal_scale == 0.5


@pytest.mark.parametrize(
    ("statement", "note"),
    [
        ("map_Kd -mm 0.25 0.5 a.png", "The option -mm of textures."),
        ("map_Kd -mm 0 1 a.png", ""),
        ("map_Kd -mm 0.0 1.0 a.png", ""),
        ("map_Kd -t 0.1 a.png", "The option -t of textures."),
        ("map_Kd -t 0 0 0 a.png", ""),
        ("map_Kd -boost 2 a.png", "The option -boost of textures."),
        ("map_Kd -boost 0 a.png", ""),
        ("map_Kd a.png -cc on", "The option -cc of textures."),
        ("map_Kd -cc off a.png", ""),
        ("map_Ps a.png", "Textures of map_ps."),
        ("map_aniso a.png", "Textures of map_aniso."),
        ("map_disp a.png", "Textures of disp."),
        ("map_opacity a.png", "Textures of map_opacity."),
        ("map_refl a.png", "Textures of map_refl."),
        ("map_aat on", ""),
        ("norm a.png\nmap_Bump b.png", "Textures of map_bump beside norm."),
        ("norm a.png\nmap_Bump a.png", ""),
        ("map_Bump a.png", "Maps of heights (map_Bump); normal maps are used."),
    ],
)
def test_statements_of_mtl_without_effect_are_noted_if_they_ask_for_one(
    tmp_path: Path, statement: str, note: str
) -> None:
    for name in "ab":
        Image.new("RGB", (2, 2), (9, 8, 7)).save(tmp_path / f"{name}.png")
    path = square(tmp_path, f"newmtl m\n{statement}\n")
    assert [text.partition("not used: ")[2] for text in said(path)][:-1] == [note] * bool(note)


@pytest.mark.parametrize(
    ("gloss", "roughness", "weight"), [("", 1.0, 0.0), ("Ks 0.5\nNs 98", 0.02**0.25, 1.0), ("Pr 0.25", 0.25, 1.0)]
)
def test_layers_of_mtl_lie_over_every_kind_of_gloss(
    tmp_path: Path, gloss: str, roughness: float, weight: float
) -> None:
    layers = "Ps 0.5\nPc 0.25\nPcr 0.125\naniso 0.75\nanisor 0.25"
    (material,) = quiet(square(tmp_path, f"newmtl m\nKd 0.5 0.25 0.125\n{gloss}\n{layers}\n")).materials
    assert material.sheen.tolist() == [0.5] * 3
    assert (material.clearcoat, material.clearcoat_roughness) == (0.25, 0.125)
    assert (material.anisotropy, material.anisotropy_angle) == (0.75, 90)
    assert material.roughness == pytest.approx(roughness)
    assert material.specular_weight == weight
    assert material.reflectance.tolist() == [0.5, 0.25, 0.125]


def exr(path: Path, *pixel: float) -> None:
    """Write an EXR of 2 x 2 equal pixels, with alpha if `pixel` has four numbers."""
    image = np.full((2, 2, len(pixel)), pixel)
    write_exr(path, image[..., :3], alpha=image[..., 3] if len(pixel) > 3 else None)


def test_values_of_float_pictures_that_are_no_colours_have_no_curve(tmp_path: Path) -> None:
    exr(tmp_path / "n.exr", 0.5, 0.5, 1.0)
    exr(tmp_path / "half.exr", 0.5, 0.5, 0.5)
    exr(tmp_path / "clear.exr", 0.0, 0.0, 0.0, 0.25)
    mtl = "newmtl m\nPr 1\nnorm n.exr\nmap_Pr half.exr\nmap_d clear.exr\n"
    scene = quiet(square(tmp_path, mtl))
    (material,) = scene.materials
    for slot, channel, level in (
        (material.normal_texture, 0, 128), (material.surface_texture, 1, 128), (material.texture, 3, 64),
    ):  # fmt: skip
        assert slot is not None
        assert scene.textures[slot.texture].image[0, 0, channel] == level


def test_colours_of_float_pictures_are_clipped_and_their_light_is_not(tmp_path: Path) -> None:
    exr(tmp_path / "a.exr", 2.0, 0.5, -1.0)
    path = square(tmp_path, "newmtl m\nmap_Kd a.exr\nKe 1 1 1\nmap_Ke a.exr\n")
    scene = quiet(path)
    (material,) = scene.materials
    assert material.texture is not None
    assert scene.textures[material.texture.texture].image[0, 0].tolist() == [1, 0.5, 0]
    assert material.emission_texture is not None
    assert scene.textures[material.emission_texture.texture].image[0, 0].tolist() == [2, 0.5, 0]
    assert any('Colours of "a.exr" below 0 or above 1: they are clipped.' in text for text in said(path))


def test_a_map_of_normals_named_as_a_bump_map_is_used(tmp_path: Path) -> None:
    normals = np.random.default_rng(0).normal((0, 0, 1), 0.2, (8, 8, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    Image.fromarray(np.uint8(normals * 127.5 + 128)).save(tmp_path / "n.png")
    (material,) = quiet(square(tmp_path, "newmtl m\nmap_Bump n.png\n")).materials
    assert material.normal_texture is not None


def test_many_options_of_a_texture_are_read_in_linear_time(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (9, 8, 7)).save(tmp_path / "a.png")
    library = Library(tmp_path)
    reader = _Reader(library, "m", {"map_kd": ["-texres", "1", "-o", "1"] * 25_000 + ["-s", "2", "a.png"]})
    start = time.process_time()
    read = reader._map("map_kd")
    assert time.process_time() - start < 1
    assert read is not None
    assert read.matrix.tolist() == [[2, 0, 1], [0, 1, 0]]


def test_unknown_channels_of_a_picture_make_one_texture(tmp_path: Path) -> None:
    """A word that names no channel is the mean of the colours, which is 7 of (5, 8, 9), rounded."""
    Image.new("RGB", (4, 4), (5, 8, 9)).save(tmp_path / "a.png")
    names = tuple(f"m{i}" for i in range(20))
    mtl = "".join(
        f"newmtl {name}\nmap_Kd a.png\nmap_Pr -imfchan {name} a.png\nmap_d -imfchan {name} ./a.png\n"
        for name in names
    )
    scene = quiet(square(tmp_path, mtl + "newmtl g\nmap_Pr -imfchan g a.png\n", names=(*names, "g")))
    found = [texture.image[0, 0].tolist() for texture in scene.textures]
    assert found == [[255, 7, 255], [5, 8, 9, 7], [255, 8, 255]]


@pytest.mark.parametrize("levels", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (254, 255, 255), (255, 255, 255)])
def test_the_mean_of_colours_is_rounded_to_the_nearest_level(levels: tuple[int, int, int], tmp_path: Path) -> None:
    Image.new("RGB", (1, 1), levels).save(tmp_path / "a.png")
    (texture,) = quiet(square(tmp_path, "newmtl m\nmap_Pr a.png\n")).textures
    assert texture.image[0, 0, 1] == round(sum(levels) / 3)


def test_textures_that_are_composed_of_two_pictures_are_limited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of 16 pairs of pictures is a texture of its own. Three are within the limit."""
    names = []
    mtl = []
    for i in range(4):
        Image.new("RGB", (16, 16)).save(tmp_path / f"a{i}.png")
        for j in range(4):
            names.append(f"m{i}{j}")
            mtl.append(f"newmtl m{i}{j}\nmap_Kd a{i}.png\nmap_d a{j}.png\n")
    monkeypatch.setattr("glpath.system.npz._DERIVED", 3 * 4 * 16 * 16)
    monkeypatch.setattr("glpath.system.npz._DERIVED_RATIO", 1)
    path = square(tmp_path, "".join(mtl), names=tuple(names))
    assert len(quiet(path).textures) == 3
    assert any("would be computed from" in text for text in said(path))


@pytest.mark.parametrize(("colour", "texture"), [("Kd", "map_Kd"), ("Ke", "map_Ke")])
def test_black_beside_a_texture_is_white(tmp_path: Path, colour: str, texture: str) -> None:
    """Maya writes Kd 0 0 0 there, and three.js takes it for 1."""
    Image.new("RGB", (2, 2), (9, 8, 7)).save(tmp_path / "wood.png")
    path = square(tmp_path, f"newmtl m\n{colour} 0 0 0\n{texture} wood.png\n")
    scene = quiet(path)
    found = scene.materials[0].reflectance if colour == "Kd" else scene.shapes[0].emission
    assert found.tolist() == [1, 1, 1]
    assert any(f"{colour} of 0 beside {texture}" in text for text in said(path))


def test_colours_of_mtl_up_to_255_are_divided_in_the_whole_file(tmp_path: Path) -> None:
    mtl = "newmtl a\nKd 204 102 51\nKs 51 51 51\nnewmtl b\nKd 1 0 0\nKs 0 0 0\nKe 255 0 0\n"
    path = square(tmp_path, mtl, names=("a", "b"))
    scene = quiet(path)
    assert scene.materials[0].reflectance == pytest.approx([0.8, 0.4, 0.2])
    assert scene.materials[0].specular_colour == pytest.approx([0.4] * 3)  # twice Ks, see `phong`
    assert scene.materials[1].reflectance == pytest.approx([1 / 255, 0, 0])
    assert scene.shapes[1].emission.tolist() == [1, 0, 0]
    assert any("white is taken to be 255" in text for text in said(path))


def test_a_colour_above_1_among_fractions_is_not_of_255(tmp_path: Path) -> None:
    path = square(tmp_path, "newmtl a\nKd 3 3 3\nnewmtl b\nKd 0.5 1 0\n", names=("a", "b"))
    assert [m.reflectance.tolist() for m in quiet(path).materials] == [[1, 1, 1], [0.5, 1, 0]]


def test_a_texture_of_ambient_light_alone_is_told(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2)).save(tmp_path / "wood.png")
    assert "Textures of map_ka." in said(square(tmp_path, "newmtl m\nmap_Ka wood.png\n"))[0]
    assert len(said(square(tmp_path, "newmtl m\nmap_Ka wood.png\nmap_Kd wood.png\n"))) == 1


def polypainted(rows: str) -> str:
    vertices = "".join(f"v {x} {y} 0\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return f"#File exported by Pixologic ZBrush\n#MRGB Block\n{vertices}{rows}f 1 2 3 4\n"


def test_polypaint_of_zbrush_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(polypainted("#MRGB ffff0000ff00ff00\n#MRGB 000000ffff808080\n"))
    colours = quiet(path).shapes[0].geometry.colours
    rgb = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [128, 128, 128]]) / 255
    assert colours[:, :3] == pytest.approx(decode_srgb(rgb))
    assert len(said(path)) == 1
    path.write_text(polypainted("#MRGB ffff0000ff00ff00\n"))
    assert any("left out: colours in #MRGB (2)" in text for text in said(path))


def test_what_an_obj_has_beside_faces_is_counted_in_one_warning(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    other = "l 1 2 3\np 1\np 2\ncurv 0 1 1 2\nusemap a\nusemap off\n"
    path.write_text(f"{SQUARE}{FACE}{other}" + 2 * "surf 0 1 0 1 1 2 3 4\n")
    words = (
        "left out: curves (1), surfaces (2), texture maps of usemap (1), lines beside faces (2), "
        "points beside faces or lines (2)."
    )
    assert sum(words in text for text in said(path)) == 1


def test_the_old_word_of_faces_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(f"{SQUARE}fo 1 2 3\nf 1 3 4\n")
    assert quiet(path).areas.sum() == pytest.approx(1)


def test_a_material_that_is_not_defined_leaves_the_colours_of_vertices(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nusemtl m\nf 1 2 3\n")
    (text, _) = said(path)
    assert text.endswith('not used: The material "m", which no file defines.')
    assert [m.reflectance.tolist() for m in quiet(path).materials] == [[1, 0, 0]]


@pytest.mark.parametrize(
    "row",
    ["0.9 0.1 0.2", "0.9 0.1 0.2 1.0", "0.9 0.1 0.2 0.5", "1.0 0.9 0.1 0.2"],
    ids=["rgb", "rgb1", "rgba", "weight"],
)
def test_colours_of_obj_vertices_follow_the_position_or_its_weight(tmp_path: Path, row: str) -> None:
    path = tmp_path / "a.obj"
    path.write_text("".join(f"v {x} {y} 0 {row}\n" for x, y in ((0, 0), (1, 0), (1, 1))) + "f 1 2 3\n")
    scene = quiet(path)
    found = scene.materials[scene.shapes[0].material].reflectance
    assert found == pytest.approx(decode_srgb(np.array([0.9, 0.1, 0.2])))


@pytest.mark.parametrize("mode", ["LA", "RGBA"])
def test_a_mask_is_the_same_with_and_without_an_opaque_alpha(tmp_path: Path, mode: str) -> None:
    mask = Image.fromarray(np.arange(0, 256, 64, dtype=np.uint8).reshape(2, 2))
    mask.save(tmp_path / "a.png")
    mask.convert(mode).save(tmp_path / "b.png")
    scene = quiet(square(tmp_path, "newmtl m\nmap_d a.png\nnewmtl n\nmap_d b.png\n", names=("m", "n")))
    assert [texture.image[..., 3].tolist() for texture in scene.textures] == [[[0, 64], [128, 192]]] * 2


@pytest.mark.parametrize("mtl", ["map_Kd a.png\nmap_d a.png", "map_d b.png"])
def test_colours_beside_an_opaque_alpha_are_no_mask(tmp_path: Path, mtl: str) -> None:
    """Exporters name the picture of map_Kd again as map_d, for its alpha."""
    Image.new("RGBA", (2, 2), (90, 90, 90)).save(tmp_path / "a.png")
    Image.new("RGBA", (2, 2), (90, 80, 70)).save(tmp_path / "b.png")
    (texture,) = quiet(square(tmp_path, f"newmtl m\n{mtl}\n")).textures
    assert (texture.image[..., 3] == 255).all()


def test_maps_of_roughness_and_metal_replace_the_numbers_beside_them(tmp_path: Path) -> None:
    """Blender writes the number of an input, which its texture overrides, beside the texture."""
    Image.new("L", (2, 2), 100).save(tmp_path / "a.png")
    maps = "map_Pr a.png\nmap_Pm a.png"
    path = square(tmp_path, f"newmtl m\n{maps}\nPr 0\nPm 0\nnewmtl n\n{maps}\n", names=("m", "n"))
    assert [(material.roughness, material.metallic) for material in quiet(path).materials] == [(1, 1)] * 2
    assert [text.partition("not used: ")[2] for text in said(path)][:-1] == [
        "Pr beside map_Pr, which replaces it.",
        "Pm beside map_Pm, which replaces it.",
    ]


def test_textures_of_mtl(tmp_path: Path) -> None:
    colours = np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5
    Image.fromarray(colours).save(tmp_path / "wood and oak.png")
    Image.fromarray(colours[..., 0]).save(tmp_path / "grey.png")
    Image.fromarray(colours[::2, ::2, 1]).save(tmp_path / "small.png")
    mtl = (
        "newmtl Paint\nmap_Kd -s 2 3 1 -o 0.5 0.25 -clamp on wood and oak.png\nnorm -bm 0.5 wood and oak.png\n"
        "newmtl Gold\nPr 1\nmap_Pr grey.png\nmap_Pm small.png\nKd 1 1 1\nmap_d grey.png\nbump grey.png\n"
    )
    path = obj(tmp_path / "box.obj", mtl, uv=True)
    scene = quiet(path)
    paint, gold = scene.materials
    assert paint.texture is not None
    assert paint.texture.uv_transform.tolist() == [[2, 0, 0.5], [0, 3, 0.25]]
    wood = scene.textures[paint.texture.texture]
    assert (wood.name, wood.srgb, wood.wrap) == ("wood and oak.png", True, ("clamp", "clamp"))
    assert np.array_equal(wood.image, colours)
    assert (paint.normal_scale, paint.reflectance.tolist()) == (0.5, [1, 1, 1])
    assert paint.normal_texture is not None
    assert not scene.textures[paint.normal_texture.texture].srgb
    assert gold.surface_texture is not None
    assert gold.texture is not None
    channels = scene.textures[gold.surface_texture.texture].image
    assert np.array_equal(channels[..., 1], colours[..., 0])
    assert np.array_equal(scene.textures[gold.texture.texture].image[..., 3], colours[..., 0])
    assert (gold.roughness, gold.metallic, gold.alpha, gold.normal_texture) == (1, 1, "blend", None)
    assert scene.shapes[0].geometry.uv is not None
    assert [text.partition(": ")[2] for text in said(path)][:-1] == [
        "not used: Maps of heights (map_Bump); normal maps are used."
    ]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("gone.png", "which does not exist"),
        ("../outside.png", "which is outside the folder of the model"),
        ("/etc/passwd", "which is outside the folder of the model"),
        ("C:\\textures\\a.png", "which is outside the folder of the model"),
        ("link.png", "which is outside the folder of the model"),
        ("prose.png", "which cannot be read: UnidentifiedImageError"),
        ("wide.png", "of 17,000 x 10 pixels, more than 16,384 a side"),
        ("bomb.png", "which cannot be read: DecompressionBombError: "),
    ],
)
def test_a_texture_that_cannot_be_had_is_told_and_the_colour_stands_alone(
    tmp_path: Path, name: str, why: str
) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    Image.new("RGB", (2, 2)).save(tmp_path / "outside.png")
    (folder / "link.png").symlink_to(tmp_path / "outside.png")
    (folder / "prose.png").write_text("no picture")
    Image.new("1", (17000, 10)).save(folder / "wide.png")
    Image.new("1", (20000, 20000)).save(folder / "bomb.png")
    mtl = f"newmtl Paint\nKd 0.5 0.25 0.125\nmap_Kd {name}\nnewmtl Gold\nmap_Kd {name}\n"
    path = obj(folder / "box.obj", mtl, uv=True)
    first, last = said(path)
    assert first.startswith(f'{path}: not used: The texture "{name}", {why}')
    assert "no camera" in last
    assert quiet(path).materials[0].reflectance.tolist() == [0.5, 0.25, 0.125]
    assert quiet(path).textures == ()


def test_materials_that_are_missing_are_told(tmp_path: Path) -> None:
    path = obj(tmp_path / "box.obj", "newmtl Paint\nKd 1 0 0\n")
    assert said(path)[0] == f'{path}: not used: The material "Gold", which no file defines.'
    (tmp_path / "box.mtl").unlink()
    assert said(path)[0] == f'{path}: not used: The materials of "box.mtl", which does not exist.'
    assert [m.reflectance.tolist() for m in quiet(path).materials] == [[0.5] * 3]


# Colours.

PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property float s
property float t
element face 2
property list uchar int vertex_indices
end_header
0 0 0 255 0 0 0 0
1 0 0 128 255 0 1 0
1 1 0 0 0 255 1 1
0 1 0 64 64 64 0 1
3 0 1 2
3 0 2 3
"""


def test_colours_of_a_ply_are_decoded_and_multiply_white(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(PLY)
    (text,) = said(path)
    assert "no camera" in text
    scene = quiet(path)
    (material,) = scene.materials
    assert (material.reflectance.tolist(), material.alpha) == ([1, 1, 1], "opaque")
    colours = scene.shapes[0].geometry.colours
    assert np.allclose(colours[1], [*decode_srgb(np.array([128, 255, 0]) / 255), 1])
    assert check_scene(scene) == []


def test_a_texture_of_a_ply_goes_before_its_colours(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "a.png")
    path = tmp_path / "a.ply"
    path.write_text(PLY.replace("element vertex", "comment TextureFile a.png\nelement vertex"))
    assert "Colours" in said(path)[0]
    scene = quiet(path)
    assert scene.materials[0].texture is not None
    assert scene.shapes[0].geometry.colours is None
    assert scene.shapes[0].geometry.uv is not None


@pytest.mark.parametrize("is_missing", [False, True], ids=["no coordinates", "no picture"])
def test_colours_of_a_ply_stand_in_for_a_texture_that_cannot_be_used(tmp_path: Path, is_missing: bool) -> None:
    if not is_missing:
        Image.new("RGB", (2, 2)).save(tmp_path / "a.png")
    plain, textured = tmp_path / "a.ply", tmp_path / "b.ply"
    text = PLY if is_missing else PLY.replace("property float s", "property float a")
    plain.write_text(text)
    textured.write_text(text.replace("element vertex", "comment TextureFile a.png\nelement vertex"))
    found, expected = (quiet(path).shapes[0].geometry.colours for path in (textured, plain))
    assert found is not None
    assert np.array_equal(found, expected)
    notes = [text.partition("not used: ")[2] for text in said(textured)][:-1]
    assert len(notes) == 1
    assert "exture" in notes[0]


def test_colours_of_faces_and_colours_that_are_one(tmp_path: Path) -> None:
    ball = trimesh.creation.box()
    ball.visual.face_colors = [[255, 0, 0, 255]] * 6 + [[0, 0, 255, 128]] * 6
    path = tmp_path / "a.ply"
    ball.export(path)
    scene = quiet(path)
    colours = scene.shapes[0].geometry.colours
    assert np.array_equal(colours[scene.shapes[0].geometry.faces[0]], [[1, 0, 0, 1]] * 3)
    assert scene.materials[0].alpha == "blend"
    ball.visual.face_colors = [255, 0, 0, 255]
    ball.export(path)
    scene = quiet(path)
    assert scene.shapes[0].geometry.colours is None
    assert scene.materials[0].reflectance.tolist() == [1, 0, 0]


def test_faces_without_texture_coordinates_show_the_first_texel(tmp_path: Path) -> None:
    Image.new("RGB", (8, 4)).save(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text("newmtl A\nmap_Kd a.png\n")
    path = tmp_path / "a.obj"
    square = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl A\n"
    path.write_text(f"{square}f 1/1 2/2 3/3\nf 1 3 4\n")
    note = "Textures of faces without texture coordinates: each shows one of its texels."
    assert f"{path}: not used: {note}" in said(path)
    scene = quiet(path)
    assert scene.materials[0].texture is not None
    np.testing.assert_array_equal(scene.triangle_uv, [[(0, 0), (1, 0), (1, 1)], [(0, 1)] * 3])


def test_colours_of_an_obj(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nf 1 2 3\n")
    assert quiet(path).shapes[0].geometry.colours.tolist() == [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]]


@pytest.mark.parametrize("white", [255, 65535])
def test_colours_of_an_obj_beyond_one_are_of_the_white_that_their_maximum_tells(tmp_path: Path, white: int) -> None:
    rgb = (0.9, 0.25, 0.125)
    row = " ".join(f"{white * each:g}" for each in rgb)
    path = tmp_path / "a.obj"
    path.write_text("".join(f"v {x} {y} 0 {row}\n" for x, y in ((0, 0), (1, 0), (1, 1))) + "f 1 2 3\n")
    (material,) = quiet(path).materials
    assert material.reflectance == pytest.approx(decode_srgb(np.array(rgb)), abs=5e-3)
    assert ["white is taken to be" in text for text in said(path)] == [True, False]


# Colours of binary STL: 5 bits each. A square of two facets.


def coloured_stl(words: tuple[int, int], header: bytes = b"") -> bytes:
    corners = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], "<f4")
    facets = [bytes(12) + c.tobytes() + w.to_bytes(2, "little") for c, w in zip(corners, words, strict=True)]
    return header.ljust(80, b" ") + (2).to_bytes(4, "little") + b"".join(facets)


def word(red: int, green: int, blue: int, flag: int) -> int:
    """With red in the highest bits, as VisCAM has it; Magics swaps red and blue."""
    return flag << 15 | red << 10 | green << 5 | blue


@pytest.mark.parametrize(
    ("header", "words", "expected"),
    [
        (b"VisCAM", (word(31, 0, 0, 1), word(0, 16, 31, 1)), [(255, 0, 0), (0, 131.6, 255)]),
        (b"VisCAM", (word(31, 0, 0, 1), word(0, 16, 31, 0)), [(255, 0, 0), None]),
        (b"x COLOR=\x40\x80\xff\xff", (word(31, 0, 0, 0), word(0, 16, 31, 0)), [(0, 0, 255), (255, 131.6, 0)]),
        (b"x COLOR=\x40\x80\xff\xff", (word(31, 0, 0, 0), word(0, 16, 31, 1)), [(0, 0, 255), (64, 128, 255)]),
    ],
)
def test_facets_of_stl_have_the_colours_of_viscam_and_of_magics(
    tmp_path: Path, header: bytes, words: tuple[int, int], expected: list[tuple[float, ...] | None]
) -> None:
    """https://en.wikipedia.org/wiki/STL_(file_format)#Color"""
    path = tmp_path / "a.stl"
    path.write_bytes(coloured_stl(words, header))
    assert len(said(path)) == 1  # of the camera
    mesh = quiet(path).shapes[0].geometry
    linear = [np.full(3, 0.5) if rgb is None else decode_srgb(np.array(rgb) / 255) for rgb in expected]
    assert np.allclose(
        mesh.colours[mesh.faces][:, :, :3], np.repeat(np.array(linear)[:, None], 3, axis=1), atol=1e-3
    )


@pytest.mark.parametrize("words", [(0, 0), (word(0, 0, 0, 1), word(9, 9, 9, 1))])
def test_an_stl_of_magics_may_have_one_colour_for_all(tmp_path: Path, words: tuple[int, int]) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(coloured_stl(words, b"COLOR=\x40\x80\xff\xff"))
    assert quiet(path).materials[0].reflectance == pytest.approx(decode_srgb(np.array([64, 128, 255]) / 255))


def test_words_of_stl_that_are_no_colours_are_not_taken_for_such(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(coloured_stl((50, 12)))
    assert quiet(path).materials[0].reflectance.tolist() == [0.5] * 3


@pytest.mark.parametrize(
    ("words", "is_coloured"),
    [((0x1234, 0x9ABC), False), ((word(31, 0, 0, 1), 0), True), ((word(31, 0, 0, 1), word(0, 31, 0, 1)), True)],
)
def test_words_of_stl_are_colours_if_those_without_the_mark_are_zero(
    tmp_path: Path, words: tuple[int, int], is_coloured: bool
) -> None:
    """VxElements stores other numbers there."""
    path = tmp_path / "a.stl"
    path.write_bytes(coloured_stl(words, b"VxElements"))
    assert (quiet(path).shapes[0].geometry.colours is not None) == is_coloured
    assert any("not taken for colours" in text for text in said(path)) != is_coloured


def test_colours_of_an_stl_are_not_used_for_bare_geometry(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(coloured_stl((word(31, 0, 0, 1),) * 2))
    (tmp_path / "room.toml").write_text(
        "camera = { position = [0.5, 0.5, 5], target = [0.5, 0.5, 0] }\nsky = { zenith = 1, horizon = 1 }\n"
        '[[shapes]]\ntype = "mesh"\nfile = "a.stl"\n'
    )
    (text,) = said(tmp_path / "room.toml")
    assert "face colours in it are not used" in text


# Nothing is opaque.


def invisible(folder: Path, kind: str) -> Path:
    """A model whose alpha is 0 everywhere by a cause that the format allows."""
    clear = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}}
    if kind == "glTF blend":
        return Gltf().one_triangle(alphaMode="BLEND", **clear).write(folder)
    if kind == "glTF mask":
        return Gltf().one_triangle(alphaMode="MASK", alphaCutoff=1.5).write(folder)
    if kind == "glTF texture":
        made = Gltf()
        texture = {"baseColorTexture": {"index": made.texture([[[255, 0, 0, 0], [9, 9, 9, 1]]])}}
        return made.one_triangle(alphaMode="BLEND", pbrMetallicRoughness=texture).write(folder)
    if kind == "map_d":
        Image.new("L", (2, 2)).save(folder / "a.png")
        return obj(folder / "a.obj", "newmtl Paint\nmap_d a.png\nnewmtl Gold\nmap_d a.png\n", uv=True)
    if kind == "d":
        return obj(folder / "a.obj", "newmtl Paint\nd 0.001\nnewmtl Gold\nd 0.002\n")
    assert kind == "PLY"
    path = folder / "a.ply"
    alpha = PLY.replace("property float s", "property uchar alpha\nproperty float s")
    path.write_text("".join(re.sub(r"^(\S+ \S+ 0 \d+ \d+ \d+)", r"\1 1", line) for line in alpha.splitlines(True)))
    return path


@pytest.mark.parametrize("kind", ["glTF blend", "glTF mask", "glTF texture", "map_d", "d", "PLY"])
def test_a_model_in_which_nothing_is_opaque_is_told(tmp_path: Path, kind: str) -> None:
    found = check_scene(quiet(invisible(tmp_path, kind)))
    assert [text.startswith("Nothing in the scene is opaque") for text in found] == [True]


def test_a_model_with_one_thing_that_is_seen_needs_no_such_warning(tmp_path: Path) -> None:
    clear = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}, "alphaMode": "BLEND"}
    faint = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.2]}, "alphaMode": "BLEND"}
    path = Gltf().one_triangle(**clear).one_triangle(**faint).write(tmp_path)
    assert check_scene(quiet(path)) == []


# trimesh's objects.


def test_materials_of_trimesh_in_python() -> None:
    picture = Image.fromarray(np.arange(12, dtype=np.uint8).reshape(2, 2, 3))
    box = trimesh.creation.box()
    uv = np.zeros((len(box.vertices), 2))
    pbr = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[255, 255, 255, 128],
        baseColorTexture=picture,
        metallicFactor=0.0,
        roughnessFactor=0.25,
        emissiveFactor=[0.25, 0.5, 1],  # trimesh 4 takes no more than 1
        alphaMode="BLEND",
        normalTexture=picture,
    )
    box.visual = trimesh.visual.TextureVisuals(uv=uv, material=pbr)
    phong = trimesh.creation.box()
    phong.visual = trimesh.visual.TextureVisuals(
        uv=uv,
        material=trimesh.visual.material.SimpleMaterial(image=picture, specular=[188, 188, 188], glossiness=98.0),
    )
    lamp = trimesh.scene.lighting.SpotLight(name="spot", color=[255, 0, 0], intensity=4.0)
    world = trimesh.Scene({"box": box, "again": phong})
    world.graph.update("spot", matrix=trimesh.transformations.translation_matrix([0, 0, 9]))
    world.lights = [lamp]
    scene = quiet(world)
    by_name = {shape.name: shape for shape in scene.shapes}
    one, other = (scene.materials[by_name[name].material] for name in ("box", "again"))
    assert (one.roughness, one.metallic, one.alpha, one.two_sided) == (0.25, 0, "blend", True)
    assert one.opacity == pytest.approx(128 / 255)
    assert set(one.slots) == {"texture", "normal_texture"}
    assert by_name["box"].emission.tolist() == [0.25, 0.5, 1]
    assert other.roughness == pytest.approx((2 / 100) ** 0.25)
    assert other.texture is not None
    assert one.texture is not None
    assert other.texture.texture == one.texture.texture  # one picture, kept once
    assert np.array_equal(scene.textures[0].image, np.asarray(picture))
    (spot,) = scene.lights
    assert (spot.kind, spot.direction.tolist(), spot.intensity.tolist()) == ("spot", [0, 0, -1], [4, 0, 0])
    assert spot.position.tolist() == [0, 0, 9]


def test_a_mesh_of_trimesh_with_several_materials_is_an_error(tmp_path: Path) -> None:
    merged = trimesh.load(gltf(tmp_path / "a.gltf"), merge_primitives=True)
    with pytest.raises(SceneError, match=r"\[\"mesh\"\] has 2 materials.*\n.*merge_primitives=False"):
        quiet(merged)


@pytest.mark.parametrize("faces", [10, 12], ids=["open", "closed"])
@pytest.mark.parametrize("double_sided", [False, True])
@pytest.mark.parametrize("alpha", ["OPAQUE", "BLEND"])
def test_backs_are_the_same_through_trimesh(tmp_path: Path, faces: int, double_sided: bool, alpha: str) -> None:
    box = trimesh.creation.box()
    box.update_faces(np.arange(12) < faces)
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[255, 255, 255, 128], doubleSided=double_sided, alphaMode=alpha
    )
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    box.export(tmp_path / "a.glb")
    ((direct,), (through,)) = (quiet(each).materials for each in (tmp_path / "a.glb", box))
    assert (through.two_sided, through.culled) == (direct.two_sided, direct.culled)
    assert direct.culled == (faces == 10 and not double_sided)


def test_meshes_of_one_material_keep_their_own_backs() -> None:
    material = trimesh.visual.material.PBRMaterial()
    box, lid = trimesh.creation.box(), trimesh.creation.box()
    lid.update_faces(np.arange(12) < 2)
    for each in (box, lid):
        each.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(each.vertices), 2)), material=material)
    scene = quiet(trimesh.Scene({"box": box, "lid": lid}))
    culled = {shape.name: scene.materials[shape.material].culled for shape in scene.shapes}
    assert culled == {"box": False, "lid": True}


@pytest.mark.parametrize("mtl", ["Kd 0.8 0.4 0.2", "Kd 0.4 0.4 0.4", "Kd 0.8 0.6 0.2\nKs 0.4 0.4 0.4\nNs 98"])
def test_colours_of_an_obj_are_the_same_through_trimesh(tmp_path: Path, mtl: str) -> None:
    path = square(tmp_path, f"newmtl m\n{mtl}\n")
    ((direct,), (through,)) = (quiet(each).materials for each in (path, trimesh.load(path, force="mesh")))
    assert through.reflectance == pytest.approx(direct.reflectance)
    assert through.roughness == direct.roughness
    assert through.specular_colour == pytest.approx(direct.specular_colour)


def test_a_mesh_of_trimesh_brings_its_textures_into_a_scene_that_has_some() -> None:
    box = trimesh.creation.box()
    material = trimesh.visual.material.SimpleMaterial(image=Image.new("RGB", (2, 2)))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    grown = load_scene("three-spheres").add(box)
    assert len(load_scene("three-spheres").textures) > 0
    slot = grown.materials[grown.shapes[-1].material].texture
    assert slot is not None
    assert slot.texture == len(grown.textures) - 1


@pytest.mark.filterwarnings("ignore:.*has no camera")
def test_damaged_texture_of_trimesh_is_left_out_as_that_of_the_file(tmp_path: Path) -> None:
    path = square(tmp_path, "newmtl m\nKd 0.8 0.4 0.2\nmap_Kd a.png\n")
    picture = tmp_path / "a.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)).save(picture)
    picture.write_bytes(picture.read_bytes()[:4000])
    mesh = trimesh.load(path)  # Pillow reads the pixels later
    with (
        mesh.visual.material.image,
        pytest.warns(SceneWarning, match="A texture, which cannot be read: OSError: image file is truncated"),
    ):
        through = load_scene(mesh)
    assert through.textures == ()
    assert same(through.materials[0], quiet(path).materials[0])
    mesh.visual.material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.open(picture))
    with mesh.visual.material.baseColorTexture, pytest.warns(SceneWarning, match="truncated"):
        assert load_scene("furnace").add(mesh).textures == ()


@pytest.mark.filterwarnings("ignore:.*has no camera")
@pytest.mark.parametrize("size", [(0, 4), (4, 0)])
def test_texture_of_trimesh_without_pixels_is_left_out(size: tuple[int, int]) -> None:
    box = trimesh.creation.box()
    material = trimesh.visual.material.SimpleMaterial(image=Image.new("RGB", size))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    with pytest.warns(SceneWarning, match=f"cannot be read: it has {size[0]} x {size[1]} pixels"):
        assert load_scene(box).textures == ()


def test_texture_of_trimesh_that_is_an_array_is_refused() -> None:
    box = trimesh.creation.box()
    material = trimesh.visual.material.SimpleMaterial(image=np.zeros((2, 2, 3), np.uint8))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    with pytest.raises(SceneError, match=r'"mesh"\] has a texture of type ndarray, but must have a PIL.Image'):
        quiet(box)


@pytest.mark.parametrize("shape", [(), (8,), (8, 2), (7, 3)])
def test_vertex_colours_of_trimesh_that_are_no_rows_of_three_or_four_are_left_out(shape: tuple[int, ...]) -> None:
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.SimpleMaterial())
    box.visual.vertex_attributes["color"] = np.zeros(shape)
    assert quiet(box).shapes[0].geometry.colours is None


# The command line.


def test_the_command_line_renders_models(tmp_path: Path) -> None:
    for path in (gltf(tmp_path / "box.gltf"), obj(tmp_path / "box.obj")):
        out = tmp_path / f"{path.name}.png"
        command = ["render", str(path), "-o", str(out), "--spp", "2", "--resolution", "24x16"]
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 0, done.output
        assert done.output.count("has no camera") == 1
        with Image.open(out) as picture:
            assert picture.size == (24, 16)
            assert np.ptp(np.asarray(picture)) > 50


def test_info_lists_parameters_and_cameras(tmp_path: Path) -> None:
    path = gltf(tmp_path / "a.gltf", **CAMERA_AND_LIGHT)
    told = CliRunner().invoke(app, ["info", str(path), "-D", "camera=1"])
    assert told.exit_code == 0, told.output
    assert "cameras: 0 Wide, 1 Tall" in told.output
    assert "light_factor" in told.output
    assert "256 x 512" in told.output
    assert CliRunner().invoke(app, ["validate", str(path)]).output.startswith("ok")


# Strangers' files.


@pytest.mark.parametrize("seed", range(3))
def test_a_damaged_mtl_never_keeps_the_model_from_being_read(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    Image.new("RGB", (2, 2)).save(tmp_path / "a.png")
    whole = (
        MTL + "map_Kd -s 2 2 -o 1 1 a.png\nmap_d a.png\nKe 1 1 1\nillum 7\nd 0.5\nTf 1 1 1\nKs 1 1 1\n"
    ).encode()
    path = obj(tmp_path / "box.obj", uv=True)
    for _ in range(60):
        damaged = bytearray(whole[: draw.randrange(len(whole))] if draw.random() < 0.3 else whole)
        for _ in range(draw.randrange(8) if damaged else 0):
            damaged[draw.randrange(len(damaged))] = draw.randrange(256)
        (tmp_path / "box.mtl").write_bytes(damaged)
        scene = quiet(path)
        assert len(scene.triangles) == len(FACES)
        for material in scene.materials:
            assert ((material.reflectance >= 0) & (material.reflectance <= 1)).all()
            assert 0 <= material.opacity <= 1
            assert material.ior >= 1
        assert all(np.isfinite(shape.emission).all() for shape in scene.shapes)
