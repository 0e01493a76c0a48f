"""Materials whose back is not there: for eyes, for bounces and for rays to lights, in every engine."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.io.gltf import read_gltf
from glpath.io.gltf.primitives import is_solid
from glpath.scene.model import Float64, Mesh, Scene
from glpath.scene.tessellate import box_mesh
from tests.support.gltf_files import Gltf

ENGINES: dict[str, dict[str, Any]] = {
    "path": {},
    "path-buffer": {"integrator": "path-buffer"},
    "t-buffer": {"integrator": "t-buffer"},
    "classic": {"integrator": "classic"},
    "t-buffer without shadow-buffers": {"integrator": "t-buffer", "shadows": "rays"},
}


def pane_before_a_wall(towards: str, light: str = "sky", culled: bool = True, side: float = 3.0) -> Scene:
    """A white wall behind a red square, whose front looks towards the eye or the wall. Seen along -z."""
    s = side
    corners = [[-s, -s, 1], [s, -s, 1], [s, s, 1], [-s, s, 1]]
    given: dict[str, Any] = {
        "camera": {"position": [0, 0, 6], "target": [0, 0, 0], "fov": 20},
        "film": {"resolution": [16, 16]},
        "materials": {
            "wall": {"reflectance": 0.5},
            "red": {"reflectance": [0.5, 0, 0], "two_sided": False, "culled": culled},
        },
        "shapes": [
            {"type": "quad", "corners": [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], "material": "wall"},
            {
                "type": "quad",
                "corners": corners if towards == "eye" else corners[::-1],
                "material": "red",
            },
        ],
    }
    if light == "sky":
        given["sky"] = {"zenith": 1.0, "horizon": 1.0}
    elif light == "point":
        given["lights"] = [{"type": "point", "position": [2, 0, 5], "intensity": 100}]
    elif light == "lamp":
        square = [[1, -1, 5], [1, 1, 5], [3, 1, 5], [3, -1, 5]]
        given["shapes"].append({"type": "quad", "corners": square, "emission": {"radiance": 9}})
    return glpath.load_scene(given)


def seen(scene: Scene, **options: Any) -> Float64:
    options = {"spp": 64, **options}
    return np.asarray(glpath.render(scene, **options).mean.mean(axis=(0, 1)))


@pytest.mark.parametrize("engine", ENGINES)
def test_an_eye_sees_through_a_back_and_not_through_a_front(engine: str) -> None:
    front = seen(pane_before_a_wall("eye", "point"), **ENGINES[engine])
    assert front[1] == 0 < front[0]
    for culled in (True, False):
        scene = pane_before_a_wall("wall", "point", culled=culled)
        shines = replace(scene.shapes[0], emission=np.ones(3))
        found = seen(replace(scene, shapes=[shines, scene.shapes[1]]), max_depth=1, **ENGINES[engine])
        np.testing.assert_allclose(found, 1.0 if culled else 0.0, rtol=1e-5)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("light", ["point", "lamp"])
def test_a_wall_is_lit_through_what_it_sees_as_its_eye_does(engine: str, light: str) -> None:
    """From the wall, a pane that looks at the eye is seen from behind: light comes through it, not the other."""
    if light == "lamp" and engine not in ("path", "path-buffer"):
        pytest.skip("lit by its lights alone")
    bare = pane_before_a_wall("eye", light)
    bare = replace(bare, shapes=[shape for i, shape in enumerate(bare.shapes) if i != 1])
    options = {"max_depth": 1, **ENGINES[engine]}
    lit = seen(bare, **options)
    # Of a small pane the eye sees the wall beside it, and through its back.
    towards_wall, towards_eye = (
        seen(pane_before_a_wall(towards, light, side=0.5), **options) for towards in ("wall", "eye")
    )
    assert towards_wall[1] < 0.8 * lit[1]  # its front, as the wall sees it, throws a shadow
    beside = seen(pane_before_a_wall("eye", light, side=0.5, culled=False), **options)
    assert towards_eye[1] > 1.1 * beside[1]  # and so does a black back, but not one that is not there


@pytest.mark.parametrize("engine", ["path", "path-buffer"])
def test_bounces_pass_backs(engine: str) -> None:
    """A box of inward walls, seen from outside in a furnace: within, all is as if the near wall were not there."""
    inner = {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 1], "material": "red"}
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 0, 9], "target": [0, 0, 0], "fov": 10},
            "film": {"resolution": [8, 8]},
            "materials": {"red": {"reflectance": 0.0, "two_sided": False, "culled": True}},
            "shapes": [inner],
            "sky": {"zenith": 1.0, "horizon": 1.0},
        }
    )
    mesh = scene.shapes[0].geometry
    assert not isinstance(mesh, str)
    turned = replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]), normals=None)
    inward = replace(scene, shapes=[replace(scene.shapes[0], geometry=turned)])
    lamp = replace(inward, shapes=[replace(inward.shapes[0], emission=np.array([2.0, 2, 2]))])
    np.testing.assert_allclose(seen(lamp, max_depth=3, **ENGINES[engine]), 2.0, rtol=1e-5)  # the far wall


def test_paths_and_scans_agree_where_light_goes_one_way() -> None:
    scene = pane_before_a_wall("eye", "lamp", side=0.5)
    own, shared = (seen(scene, spp=2048, max_depth=4, **ENGINES[name]) for name in ("path", "path-buffer"))
    np.testing.assert_allclose(own, shared, rtol=0.02)


def doll_house() -> Scene:
    """A lit room of walls that are there from within alone, seen from outside, on a floor."""
    shell = {"type": "box", "min": [-1, 0, -1], "max": [1, 2, 1], "material": "wall"}
    floor = {"type": "quad", "corners": [[-4, -0.01, 4], [4, -0.01, 4], [4, -0.01, -4], [-4, -0.01, -4]]}
    lamp = {"type": "box", "min": [-0.3, 1.2, -0.3], "max": [0.3, 1.5, 0.3], "emission": {"radiance": 5}}
    scene = glpath.load_scene(
        {
            "camera": {"position": [4, 5, 7], "target": [0, 0.7, 0], "fov": 40},
            "film": {"resolution": [32, 24]},
            "materials": {"wall": {"reflectance": [0.5, 0.4, 0.2], "two_sided": False, "culled": True}},
            "shapes": [shell, floor | {"material": "wall"}, lamp | {"material": "wall"}],
        }
    )
    mesh = scene.shapes[0].geometry
    assert isinstance(mesh, Mesh)
    turned = replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]), normals=None)
    return replace(scene, shapes=[replace(scene.shapes[0], geometry=turned), *scene.shapes[1:]])


def test_a_gather_knows_a_room_without_backs() -> None:
    """Inside and on the floor around it, to which the lamp shines through the walls."""
    scene = doll_house()
    paths = glpath.render(scene, spp=512, max_depth=24, guide="cosine", aovs=("object_id",))
    room, floor = (paths.aov("object_id") == number for number in (1, 2))
    solution = glpath.solve_radiosity(scene, method="monte-carlo", patches=300, particles=1 << 17)
    found = glpath.render(scene, integrator="gather", radiosity=solution, spp=256).mean
    assert found[room].mean() == pytest.approx(paths.mean[room].mean(), rel=0.04)
    assert found[floor].mean() == pytest.approx(paths.mean[floor].mean(), rel=0.04)


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
def test_files_of_viewers_have_no_backs_unless_asked(tmp_path: Path) -> None:
    file = Gltf()
    file.one_triangle(doubleSided=False)
    path = file.write(tmp_path)
    assert glpath.load_scene(path).materials[0].culled
    kept = glpath.load_scene(path, {"backs": "black"}).materials[0]
    assert not kept.culled
    assert not kept.two_sided
    with DeviceScene(get_context().gl, glpath.load_scene(path, {"backs": "black"})) as device:
        assert not {"HAS_ALPHA", "HAS_CULLING"} & device.defines.keys()


def closed_box(folder: Path, name: str, pbr: dict[str, Any], faces: int = 6, eye: float = 4.0, **also: Any) -> Path:
    """A cube of side 2 around the origin, its fronts outward, with the alpha of `also` in its vertices if given.

    faces : so many of its six faces are of the material; the others are of an opaque one of the same mesh
    eye   : z of the camera
    """
    file = Gltf()
    alpha = also.pop("vertex_alpha", None)
    cube = box_mesh((-1, -1, -1), (1, 1, 1))
    corners, uv, triangles = cube.vertices, cube.uv, cube.faces.reshape(6, 6)
    assert uv is not None
    colours = {} if alpha is None else {"COLOR_0": np.tile([1, 1, 1, alpha], (len(corners), 1))}
    image = np.full((8, 8, 4), 255, np.uint8)
    image[:, 4:, 3] = 0
    pbr = {"metallicFactor": 0, "roughnessFactor": 1} | pbr
    if pbr.pop("holes", False):
        pbr["baseColorTexture"] = {"index": file.texture(image, magFilter=9728)}
    material = file.add("materials", pbrMetallicRoughness=pbr, **also)
    opaque = file.add("materials", pbrMetallicRoughness={"metallicFactor": 0}, doubleSided=also["doubleSided"])
    mesh = file.mesh(corners, triangles[:faces].ravel(), TEXCOORD_0=uv, material=material, **colours)
    if faces < 6:
        other = file.mesh(corners, triangles[faces:].ravel(), TEXCOORD_0=uv, material=opaque)
        file.json["meshes"][mesh]["primitives"] += file.json["meshes"].pop(other)["primitives"]
    file.node(mesh=mesh)
    camera = file.add("cameras", type="perspective", perspective={"yfov": 0.7, "znear": 0.1, "aspectRatio": 1.0})
    file.node(camera=camera, translation=[0, 0, eye])
    return file.write(folder, name)


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
@pytest.mark.parametrize(
    ("eye", "given"),
    [
        (4.0, {"pbr": {"holes": True}, "alphaMode": "MASK"}),
        (4.0, {"pbr": {"holes": True}, "alphaMode": "BLEND"}),
        (4.0, {"pbr": {"baseColorFactor": [0.8, 0.6, 0.4, 0.3]}, "alphaMode": "BLEND"}),
        (4.0, {"pbr": {}, "alphaMode": "BLEND", "vertex_alpha": 0.4}),
        (4.0, {"pbr": {"holes": True}, "alphaMode": "MASK", "faces": 4}),
        (0.5, {"pbr": {"holes": True}, "alphaMode": "MASK"}),
        (4.0, {"pbr": {}, "faces": 4, "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}),
    ],
    ids=["mask", "blend", "factor", "vertices", "two materials", "eye inside", "glass and paint"],
)
def test_far_walls_of_a_closed_mesh_that_lets_light_through_are_lit_as_with_two_sides(
    eye: float, given: dict[str, Any], tmp_path: Path
) -> None:
    """Viewers show nothing there: glass keeps the two sides that it always has, in both files."""
    found = []
    for two_sided in (False, True):
        path = closed_box(tmp_path, f"{two_sided}.gltf", eye=eye, doubleSided=two_sided, **given)
        scene = glpath.load_scene(path)
        assert not any(scene.materials[shape.material].culled for shape in scene.shapes)
        found.append(glpath.render(scene, spp=16, resolution=(24, 24)).mean)
    assert found[0][8:16, 8:16].min() > 0
    np.testing.assert_allclose(found[0], found[1], rtol=1e-4, atol=1e-5)


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
@pytest.mark.parametrize(
    ("eye", "given", "culled"),
    [
        (4.0, {"pbr": {}, "alphaMode": "BLEND"}, False),
        (4.0, {"pbr": {"holes": True}, "alphaMode": "OPAQUE"}, False),
        (4.0, {"pbr": {"baseColorFactor": [1, 1, 1, 0.6]}, "alphaMode": "MASK"}, False),
        (0.5, {"pbr": {}}, True),
    ],
    ids=["blend of alpha 1", "opaque", "mask of alpha above its cutoff", "eye inside"],
)
def test_backs_of_a_closed_opaque_mesh_are_absent_only_if_the_eye_is_inside(
    eye: float, given: dict[str, Any], culled: bool, tmp_path: Path
) -> None:
    (material,) = glpath.load_scene(closed_box(tmp_path, "a.gltf", eye=eye, doubleSided=False, **given)).materials
    assert (material.two_sided, material.culled) == (False, culled)


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
def test_a_mesh_is_examined_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A box that lets light through and an opaque one, of one mesh. The latter is asked about for both rules."""
    examined: list[int] = []

    def counted(mesh: Mesh) -> bool:
        examined.append(len(mesh.faces))
        return is_solid(mesh)

    monkeypatch.setattr("glpath.io.gltf.load.is_solid", counted)
    path = closed_box(tmp_path, "a.gltf", {"holes": True}, alphaMode="MASK", doubleSided=False)
    file = json.loads(path.read_text())
    primitives = file["meshes"][0]["primitives"]
    primitives.append({**primitives[0], "material": 1})
    path.write_text(json.dumps(file))
    materials = glpath.load_scene(path).materials
    assert [(material.two_sided, material.culled) for material in materials] == [(True, False), (False, False)]
    assert sorted(examined) == [12, 24]


def test_an_open_mesh_of_the_same_material_keeps_its_absent_backs(tmp_path: Path) -> None:
    path = closed_box(tmp_path, "a.gltf", {"holes": True}, alphaMode="MASK", doubleSided=False)
    file = json.loads(path.read_text())
    file["meshes"].append({"primitives": [{**file["meshes"][0]["primitives"][0]}]})
    file["accessors"].append({**file["accessors"][1], "count": 30})  # without one of the sides
    file["meshes"][1]["primitives"][0]["indices"] = len(file["accessors"]) - 1
    file["nodes"].append({"mesh": 1, "translation": [5, 0, 0]})
    path.write_text(json.dumps(file))
    model = read_gltf(path)
    sides = [(model.materials[s.material].two_sided, model.materials[s.material].culled) for s in model.shapes]
    assert sides == [(True, False), (False, True)]


def test_what_has_a_back_cannot_be_culled() -> None:
    with pytest.raises(glpath.SceneError, match="culled"):
        glpath.load_scene(
            {
                "camera": {"position": [0, 0, 6], "target": [0, 0, 0]},
                "materials": {"m": {"reflectance": 0.5, "culled": True}},
                "shapes": [{"type": "sphere", "radius": 1, "material": "m"}],
            }
        )
