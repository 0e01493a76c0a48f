"""Scenes made in Python: dictionaries with arrays, trimesh's meshes and scenes, files of a mesh alone."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
import trimesh

import glpath
from glpath import io
from glpath.errors import GlpathError, SceneError, SceneWarning, UsageError
from glpath.io import load_scene
from glpath.scene.sight import sees_anything
from glpath.system.arguments import short_repr

CAMERA = {"position": [0, 0, 9], "target": [0, 0, 0]}
LAMP = {"type": "sphere", "radius": 0.1, "center": [0, 5, 0], "emission": {"radiance": 3}}
VERTICES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
NET = [[[x, y, 0] for x in range(4)] for y in range(4)]


def test_a_dictionary_with_arrays_is_what_the_file_with_numbers_is(tmp_path: Path):
    (tmp_path / "plate.toml").write_text(
        """
        [camera]
        position = [0, 0, 9]
        target = [0, 0, 0]
        [[shapes]]
        type = "mesh"
        vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        faces = [[0, 1, 2, 3]]
        uv = [[0, 0], [1, 0], [1, 1], [0, 1]]
        emission = { radiance = 2 }
        """
    )
    shape = {"type": "mesh", "vertices": VERTICES, "uv": VERTICES[:, :2], "emission": {"radiance": 2}}
    expected = load_scene(tmp_path / "plate.toml")
    for faces in (FACES, FACES.astype(np.uint8), np.array([[0, 1, 2, 3]])):
        assert load_scene({"camera": CAMERA, "shapes": [{**shape, "faces": faces}]}).digest() == expected.digest()
    lists = {**shape, "vertices": VERTICES.tolist(), "uv": VERTICES[:, :2].tolist(), "faces": [[0, 1, 2, 3]]}
    assert load_scene({"camera": CAMERA, "shapes": [lists]}).digest() == expected.digest()


def test_the_scene_has_its_own_copy_of_an_array():
    vertices = VERTICES.astype(np.float64)
    made = load_scene({"camera": CAMERA, "shapes": [{"vertices": vertices, "faces": FACES}, LAMP]})
    vertices[0] = 7
    assert made.triangles[0, 0].tolist() == [0, 0, 0]


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no such vertex": (
        {"faces": np.array([[0, 1, 2], [0, 2, 4]])},
        r'scene\["shapes"\]\[1\]\["faces"\]\[1\] names vertex 4, but the mesh has 4 vertices \(0 to 3\)',
    ),
    "a negative vertex": ({"faces": np.array([[0, 1, -1]])}, r'\["faces"\]\[0\] names vertex -1'),
    "faces of two": (
        {"faces": FACES[:, :2]},
        r'scene\["shapes"\]\[1\]\["faces"\] is an array of shape \(2, 2\) and type int64, but must be whole '
        r"numbers of shape \(n, 3\) or \(n, 4\)",
    ),
    "faces that are no whole numbers": ({"faces": FACES * 1.0}, r"type float64, but must be whole numbers"),
    "no faces": ({"faces": FACES[:0]}, r"shape \(0, 3\).* at least 1"),
    "flat vertices": ({"vertices": VERTICES[:, :2]}, r'\["vertices"\] is an array of shape \(4, 2\)'),
    "a NaN": (
        {"vertices": np.where(VERTICES > 0, np.nan, 0)},
        r'\["vertices"\]\[1\]\[0\] is nan, but must be a finite number',
    ),
    "too few uv": ({"uv": VERTICES[:3, :2]}, r'\["uv"\] has 3 pairs, but the mesh has 4 vertices'),
    "two meshes": ({"mesh": trimesh.creation.box()}, r"has mesh and vertices and faces, but a mesh is one of them"),
    "a scene as a mesh": (
        {"vertices": None, "faces": None, "mesh": trimesh.Scene()},
        r'\["mesh"\] is a Scene, but must be a trimesh.Trimesh.\n.*load_scene',
    ),
    "an unknown field": ({"colour": 3}, r'scene\["shapes"\]\[1\]\["colour"\] is not a field of the type "mesh"'),
    "an unknown material": ({"material": "red"}, r'scene\["shapes"\]\[1\]\["material"\] names the material "red"'),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named_as_python_writes_it(case: str):
    change, expected = WRONG[case]
    shape = {"type": "mesh", "vertices": VERTICES, "faces": FACES, **change}
    shape = {key: value for key, value in shape.items() if value is not None}
    with pytest.raises(SceneError, match=expected):
        load_scene({"camera": CAMERA, "shapes": [LAMP, shape]})


def test_a_mesh_of_trimesh_has_a_camera_and_light_made_for_it_and_says_so():
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3)
    ball.apply_translation([10, 20, -30])
    with pytest.warns(SceneWarning, match=r"no camera.* position .* and no light, so a studio lights it"):
        made = load_scene(ball)
    assert np.array_equal(made.triangles, ball.triangles)
    assert sees_anything(made)
    # Everything is in the picture, and fills at least half of its height.
    right, up, forward = made.camera.frame()
    at = made.triangles.reshape(-1, 3) - made.camera.position
    high = np.abs(at @ up / (at @ forward)) / np.tan(np.radians(made.camera.fov / 2))
    wide = np.abs(at @ right / (at @ forward)) / np.tan(np.radians(made.camera.fov / 2))
    assert 0.5 < high.max() < 1
    assert 0.5 < wide.max() < 1


@pytest.mark.parametrize("resolution", [(64, 16), (16, 64)])
def test_everything_is_in_a_wide_and_in_a_tall_picture(resolution: tuple[int, int]):
    box = {"type": "box", "min": [-2, 0, 0], "max": [2, 3, 1]}
    with pytest.warns(SceneWarning, match="no camera"):
        made = load_scene({"film": {"resolution": resolution}, "shapes": [box, LAMP], "name": "wide"})
    assert (made.name, made.camera.resolution) == ("wide", resolution)
    at = made.triangles.reshape(-1, 3) - made.camera.position
    right, up, forward = made.camera.frame()
    tangent = np.tan(np.radians(made.camera.fov / 2))
    assert (np.abs(at @ up) < tangent * (at @ forward)).all()
    assert (np.abs(at @ right) < tangent * resolution[0] / resolution[1] * (at @ forward)).all()


def test_light_that_is_there_is_left_alone():
    shape = {"vertices": VERTICES, "faces": FACES}
    for light in (
        {"shapes": [shape, LAMP]},
        {"shapes": [shape], "sky": {"zenith": 0.5}},
        {"shapes": [shape], "lights": [{"type": "point", "position": [0, 0, 1], "intensity": 1}]},
    ):
        made = load_scene({"camera": CAMERA, **light})
        assert (made.sky is None) == ("sky" not in light)


def test_a_scene_of_trimesh_keeps_transforms_instances_colours_and_camera():
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 51, 255])
    )
    ball = trimesh.creation.icosphere(subdivisions=1)
    ball.visual.face_colors = [255, 188, 0, 255]
    world = trimesh.Scene()
    world.add_geometry(box, node_name="left", transform=trimesh.transformations.translation_matrix([-2, 0, 0]))
    world.add_geometry(box, node_name="right", geom_name="again", transform=np.diag([-1.0, 1, 1, 1]))
    world.add_geometry(ball, node_name="ball")
    world.camera = trimesh.scene.Camera(resolution=(40, 30), fov=(60, 47))
    world.camera_transform = trimesh.transformations.translation_matrix([1, 2, 30])
    with pytest.warns(SceneWarning, match=r"^scene: has no light, so a studio lights it"):
        made = load_scene(world)
    assert np.allclose(
        np.sort(made.triangles.reshape(-1, 9), axis=0), np.sort(world.to_mesh().triangles.reshape(-1, 9), axis=0)
    )
    by_name = dict(zip([s.name for s in made.shapes], made.shapes, strict=True))
    assert set(by_name) == {"left", "right", "ball"}
    assert made.materials[by_name["left"].material].reflectance.tolist() == [1, 0, 0.2]
    assert np.allclose(made.materials[by_name["ball"].material].reflectance, [1, 0.5, 0], atol=0.005)
    volume = sum(np.sum(np.cross(t[:, 0], t[:, 1]) * t[:, 2]) / 6 for t in [made.triangles])
    assert volume == pytest.approx(2 + ball.volume)  # fronts outward, of the mirrored one as well
    assert made.camera.position.tolist() == [1, 2, 30]
    assert np.allclose(made.camera.frame(), [[1, 0, 0], [0, 1, 0], [0, 0, -1]])
    assert (made.camera.resolution, made.camera.fov) == ((40, 30), 47)


@pytest.mark.parametrize("fov", [(60, 60), (60, 45), (20, 90)])
def test_a_camera_of_trimesh_keeps_both_fields_of_view(fov: tuple[float, float]):
    camera = trimesh.scene.Camera(resolution=(640, 480), fov=fov)
    world = trimesh.Scene(trimesh.creation.box(), camera=camera, camera_transform=np.eye(4))
    with pytest.warns(SceneWarning, match="has no light"):
        made = load_scene(world).camera
    (fx, _, cx), (_, fy, cy), _ = camera.K
    assert made.focal_lengths == pytest.approx((fx, fy))
    assert made.centre == pytest.approx((cx, cy))


@pytest.mark.filterwarnings("ignore:.*has no light")
def test_square_pixels_of_trimesh_are_square():
    """A pixel is square if both angles of view have one focal length: tan(fov / 2) = size / (2 focal)."""
    for focal in (90.0, 225.0, 360.0, 630.0, 900.0):
        fov = np.degrees(2 * np.arctan(np.array([640, 480]) / (2 * focal)))
        camera = trimesh.scene.Camera(resolution=(640, 480), fov=fov)
        world = trimesh.Scene(trimesh.creation.box(), camera=camera, camera_transform=np.eye(4))
        assert load_scene(world).camera.pixel_aspect == 1


def test_instances_in_a_scene_of_trimesh_are_instances_here():
    world = trimesh.Scene(trimesh.creation.icosphere(subdivisions=3))
    (name,) = world.geometry
    for x in range(1, 4):
        world.graph.update(
            frame_to=f"n{x}", geometry=name, matrix=trimesh.transformations.translation_matrix([3 * x, 0, 0])
        )
    with pytest.warns(SceneWarning):
        made = load_scene(world)
    assert len(made.shapes) == 4
    assert len(made.shapes.meshes) == 1


GROUND = {"type": "quad", "corners": [[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]]}
BOX_ABOVE = {"type": "box", "min": [-1, -1, 0], "max": [1, 1, 2]}


def _as_toml(value: Any) -> str:
    """Return a value as an inline value of TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_as_toml(each)}" for key, each in value.items()) + "}"
    return json.dumps(value)


def _file_of(data: dict[str, Any], folder: Path) -> Path:
    path = folder / "scene.toml"
    lists = {key: f"[{', '.join(map(_as_toml, each))}]" for key, each in data.items() if isinstance(each, list)}
    texts = {key: lists.get(key) or _as_toml(each) for key, each in data.items()}
    path.write_text("".join(f"{key} = {text}\n" for key, text in texts.items()))
    return path


@pytest.mark.filterwarnings("ignore:.*has no camera")
@pytest.mark.parametrize("sky", [{}, {"sky": {"zenith": [0, 0, 1], "horizon": [1, 0, 0], "up": [1, 0, 0]}}])
def test_a_dictionary_without_a_camera_has_the_up_axis_of_the_file(sky: dict[str, Any], tmp_path: Path):
    data = {"ambient": 1, **sky, "shapes": [GROUND, BOX_ABOVE]}
    made = load_scene(data)
    assert made.digest() == load_scene(_file_of(data, tmp_path)).digest()
    assert made.camera.up.tolist() == ([1, 0, 0] if sky else [0, 0, 1])


def test_the_warning_of_a_guessed_up_axis_names_what_python_writes():
    with pytest.warns(SceneWarning, match=re.escape("; with_camera(up=[0, 1, 0]) if y is up)")):
        load_scene({"ambient": 1, "shapes": [GROUND, BOX_ABOVE]})


@pytest.mark.parametrize(
    ("part", "told"),
    [
        ({"sky": {"zenith": [0, 0, 1], "horizon": [1, 0, 0]}}, "up.* is missing"),
        (
            {"lights": [{"type": "point", "position": [0, 0, 3], "profile": "lamp.ies"}]},
            r'\["direction"\] is missing',
        ),
        ({"shapes": ({"type": "patches", "net": NET, "pixels": 2},)}, "is of a camera's picture"),
    ],
)
def test_a_dictionary_without_a_camera_needs_what_the_file_needs(part: dict[str, Any], told: str):
    with pytest.raises(SceneError, match=told + ".*has no camera"):
        load_scene({"shapes": [GROUND], **part})


@pytest.mark.filterwarnings("ignore:.*has no camera")
@pytest.mark.parametrize("call", [{}, {"camera": {**CAMERA, "up": [0, 1, 0]}}], ids=["alone", "replaced"])
def test_the_error_of_a_missing_up_axis_has_the_python_that_mends_it(call: dict[str, Any]):
    scene = {"shapes": [GROUND], "sky": {"zenith": [0, 0, 1], "horizon": [1, 0, 0]}}
    with pytest.raises(SceneError, match="and the dictionary has no camera") as error:
        glpath.render(scene, spp=1, **call)
    remedy = str(error.value).partition("For example ")[2]
    assert ("The camera that replaces the scene's does not set it." in remedy) is bool(call)
    exec(remedy.partition(", with")[0], {"scene": scene})
    assert load_scene(scene).sky.up.tolist() == [0, 0, 1]


def test_what_is_dropped_of_trimesh_is_said():
    ball = trimesh.creation.icosphere(subdivisions=0)
    ball.visual.vertex_colors = np.arange(48).reshape(12, 4)
    with pytest.warns(SceneWarning) as said:
        load_scene(ball)
    assert len(said) == 1  # of the camera and the sky: colours are kept
    world = trimesh.Scene([trimesh.creation.box(), trimesh.load_path(np.array([[0, 0, 0], [1, 1, 1.0]]))])
    with pytest.warns(SceneWarning) as said:
        assert len(load_scene(world).shapes) == 1
    assert "dropped Path3D" in str(said[0].message)


@pytest.mark.filterwarnings("ignore:.*has no camera")
def test_normals_of_trimesh_that_are_not_finite_are_counted():
    box = trimesh.creation.box()
    normals = np.array(box.vertex_normals)
    normals[3, 0] = np.nan
    made = trimesh.Trimesh(box.vertices, box.faces, vertex_normals=normals, process=False)
    with pytest.warns(SceneWarning, match=r"left out: normals that are not finite \(1\)\."):
        scene = load_scene(made)
    assert np.isfinite(scene.shapes[0].geometry.normals).all()


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".STL"])
def test_a_file_of_a_mesh_is_a_scene(tmp_path: Path, suffix: str):
    path = tmp_path / f"torus{suffix}"
    trimesh.creation.torus(2, 0.5).export(path, file_type=suffix[1:].lower())
    with pytest.warns(SceneWarning, match=r"torus.*: has no camera.*no light"):
        made = load_scene(str(path))
    assert made.name == "torus"
    assert made.bounds[1][0] == pytest.approx(2.5, rel=1e-3)
    assert sees_anything(made)
    with pytest.raises(SceneError, match=r"gone.*does not exist"):
        load_scene(tmp_path / f"gone{suffix}")


def test_a_scene_grows_shape_by_shape():
    box = load_scene("cornell-box-36")
    before = len(box.shapes)
    lid = trimesh.creation.box()
    grown = box.add({"type": "sphere", "radius": 0.1}, material={"reflectance": [0.2, 0.4, 0.8]})
    above = [{"translate": [0, 3, 0]}]
    grown = grown.add(lid, material=box.materials[1].name, name="lid", transform=above).add(lid)
    ball, top, plain = grown.shapes[before:]
    assert [ball.name, top.name, plain.name] == [f"sphere-{before}", "lid", f"mesh-{before + 2}"]
    assert grown.materials[ball.material].reflectance.tolist() == [0.2, 0.4, 0.8]
    assert top.material == 1
    assert grown.materials[plain.material].reflectance.tolist() == [0.5, 0.5, 0.5]
    assert np.array_equal(grown.triangles[:36], box.triangles)
    assert grown.triangles[36:48].mean(axis=(0, 1)).tolist() == pytest.approx([0, 3, 0])
    assert len(box.shapes) == before
    with pytest.raises(UsageError, match=r'material = "blau", but the scene has '):
        box.add(lid, material="blau")
    with pytest.raises(SceneError, match=r'shape\["shapes"\]\[0\]\["radius"\] is "big"'):
        box.add({"type": "sphere", "radius": "big"})


MATERIALS = {
    "veil": {"reflectance": 0.5, "alpha": "blend", "opacity": 0.25},
    "brushed": {"type": "principled", "metallic": 1, "anisotropy": 0.8},
    "tiles": {"texture": "checker"},
    "shining": {"emission_texture": "checker"},
    "clear": {"alpha": "blend", "opacity": 0},
}
FLUX_LAMP = {"type": "sphere", "radius": 1, "emission": {"flux": 10}}
TRIANGLE = {"type": "mesh", "vertices": VERTICES[:3].tolist(), "faces": [[0, 1, 2]]}


def _around(*shapes: dict[str, Any]) -> dict[str, Any]:
    ground = {"type": "box", "min": [-9, -9, -9], "max": [9, -8, 9]}
    return {
        "camera": {"position": [0, 0, 90], "target": [0, 0, 0]},
        "ambient": 1,
        "textures": {"checker": {"type": "checker"}},
        "materials": MATERIALS,
        "shapes": [ground, *shapes],
    }


@pytest.mark.parametrize(
    ("shape", "material"),
    [
        (FLUX_LAMP, "veil"),
        (TRIANGLE, "brushed"),
        (TRIANGLE, "tiles"),
        ({"type": "patches", "net": NET, "pixels": 2}, "veil"),
    ],
)
def test_an_added_shape_is_the_one_of_the_scenes_dictionary(shape: dict[str, Any], material: str):
    expected = load_scene(_around({**shape, "material": material}))
    assert load_scene(_around()).add(shape, material=material).digest() == expected.digest()


class _Stream:
    def __len__(self) -> int:
        return 1

    def chunk(self, index: int) -> Any:
        return VERTICES[None, :3]


@pytest.mark.parametrize(
    ("shape", "material", "told"),
    [
        (FLUX_LAMP, "shining", "a material with an emission_texture"),
        (FLUX_LAMP, "clear", "whose opacity is 0"),
        ({"stream": _Stream()}, "tiles", "triangles have no texture coordinates"),
        ({"stream": _Stream()}, "veil", "lets light through"),
    ],
)
def test_an_added_shape_is_refused_as_in_the_scenes_dictionary(shape: dict[str, Any], material: str, told: str):
    with pytest.raises(SceneError, match=told):
        load_scene(_around({**shape, "material": material}))
    with pytest.raises(SceneError, match=told):
        load_scene(_around()).add(shape, material=material)


def test_flux_of_a_transparent_trimesh_is_divided_by_its_opacity():
    box = trimesh.creation.box()
    look = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 255, 255, 64], alphaMode="BLEND")
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=look)
    made = load_scene({"camera": CAMERA, "shapes": [{"mesh": box, "emission": {"flux": 10}}]})
    assert made.shapes[0].emission == pytest.approx([10 / (np.pi * 6 * 64 / 255)] * 3)


def test_two_sided_emission_of_a_trimesh_overrides_its_culled_backs():
    """A one-sided square of 1 that emits from both sides has area 2; its twin without emission stays culled."""
    square = trimesh.Trimesh(VERTICES, FACES, process=False)
    look = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 255, 255, 255])
    square.visual = trimesh.visual.TextureVisuals(uv=VERTICES[:, :2], material=look)
    lamp = {"mesh": square, "emission": {"flux": 10, "two_sided": True}}
    made = load_scene({"camera": CAMERA, "shapes": [lamp, {"mesh": square}]})
    assert made.shapes[0].emission == pytest.approx([10 / (np.pi * 2)] * 3)
    assert [(m.two_sided, m.culled) for m in made.materials] == [(True, False), (False, True)]
    added = load_scene({"camera": CAMERA, "shapes": [LAMP]}).add(square, emission=lamp["emission"])
    assert added.shapes[1].emission_two_sided


def test_everything_that_takes_a_scene_takes_these():
    data = {"camera": CAMERA, "film": {"resolution": [8, 6]}, "shapes": [{"mesh": trimesh.creation.box()}, LAMP]}
    assert glpath.render(data, spp=1).mean.shape == (6, 8, 3)
    assert glpath.solve_radiosity(data, patches=20).scene_hash


def test_trimesh_is_not_imported_for_who_has_none_of_it():
    code = (
        "import sys, numpy as np, glpath\n"
        "v = np.eye(3)\n"
        "lamp = {'type': 'sphere', 'radius': 1, 'emission': {'radiance': 1}}\n"
        "camera = {'position': [0, 0, 9], 'target': [0, 0, 0]}\n"
        "glpath.load_scene({'camera': camera, 'shapes': [{'vertices': v, 'faces': np.array([[0, 1, 2]])}, lamp]})\n"
        "assert 'trimesh' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_the_first_scenes_may_be_loaded_by_many_threads_at_once():
    """msgspec's first conversion to a type crashes under threads, in 8 of 8 runs; ours waits."""
    code = (
        "import threading, glpath\n"
        "from concurrent.futures import ThreadPoolExecutor\n"
        "glpath.load_scene\n"
        "barrier = threading.Barrier(8)\n"
        "def load(_):\n"
        "    barrier.wait(); return glpath.load_scene('cornell-box-36').digest()\n"
        "with ThreadPoolExecutor(8) as pool:\n"  # an exception in a thread of one's own would leave the exit code 0
        "    assert len(set(pool.map(load, range(8)))) == 1"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


@pytest.mark.parametrize("value", [range(3), {1, 2}, object(), b"x", 1j], ids=lambda value: type(value).__name__)
@pytest.mark.parametrize("key", ["camera", "shapes", "materials", "name"])
def test_objects_without_a_form_in_files_are_errors_of_the_scene(key: str, value: Any) -> None:
    scene: dict[str, Any] = {"camera": CAMERA, "shapes": [LAMP], key: value}
    with pytest.raises(GlpathError, match=key):
        load_scene(scene)


_BALL = {"type": "sphere", "center": [0, 0, 0], "radius": 1.0}
_CAMERA = {"position": [0, 0, 5], "target": [0, 0, 0]}


@pytest.mark.parametrize(
    "scene",
    [
        {"camera": _CAMERA, "shapes": [_BALL | {"type": np.array(["sphere", "box"])}]},
        {"camera": _CAMERA, "shapes": [_BALL | {"type": pandas.NA}]},
        {"camera": _CAMERA, "shapes": [_BALL | {"material": "m"}], "materials": {"m": {"type": pandas.NA}}},
        {"camera": np.longdouble(1.5), "shapes": [_BALL]},
        {"camera": pandas.Categorical(["a"]), "shapes": [_BALL]},
        {"camera": _CAMERA, "shapes": [_BALL | {"emission": np.longdouble(1.5)}]},
    ],
)
def test_objects_whose_comparison_fails_are_errors_of_the_scene(scene: dict[str, Any]) -> None:
    with pytest.raises(SceneError):
        load_scene(scene)


def test_a_range_is_a_list() -> None:
    ball = {"type": "sphere", "center": range(3), "radius": 1}
    assert load_scene({"camera": CAMERA, "shapes": [ball, LAMP]}).spheres[0, :, 3].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("function", "value"),
    [
        (io.scene_animations, None),
        (io.scene_cameras, None),
        (io.scene_variants, 5),
        (io.scene_parameters, None),
        (io.parameters_from_options, None),
        (io.parameters_from_options, [5]),
        (io.scene_from_dict, []),
        (io.scene_from_dict, None),
    ],
)
def test_functions_for_scenes_refuse_other_types(function: Any, value: Any) -> None:
    with pytest.raises(GlpathError, match=re.escape(short_repr(value))):
        function(value)
