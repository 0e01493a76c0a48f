"""The scene format: what a file says stands in the scene, and what is wrong in it is said with its place."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from glpath.errors import SceneError, SceneWarning
from glpath.io import load_scene, scene_from_dict, scene_schema
from tests.support.repository import ROOT

HEAD = """
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
"""
SPHERE = HEAD + '[[shapes]]\ntype = "sphere"\nradius = 1\nsubdivisions = 0\n'
PLANE = 'type = "plane"\npoint = [0, 0, 0]\nnormal = [0, 1, 0]\n'
QUAD = "corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]\n"


def shape(text: str) -> str:
    """A scene file with one shape before it, so that `text` is shapes[1]."""
    return SPHERE + "[[shapes]]\n" + text


def mesh(text: str) -> str:
    return shape('type = "mesh"\n' + text)


def camera(text: str) -> str:
    return SPHERE.replace("position = [0, 0, 5]\ntarget = [0, 0, 0]", text)


# What is written, and what the message must contain: the place, what was found, what is allowed, the remedy.
WRONG: dict[str, tuple[str, list[str]]] = {
    "syntax": (HEAD + "up = [0, 1,\nfov = 3", ["line 6, column 1", "not valid TOML", "fov = 3\n", "^"]),
    "syntax at the end": (HEAD + "up = [0, 1,", ["line 5", "not valid TOML"]),
    "no camera, and a sky that goes by its up": (
        '[sky]\ntype = 3\n[[shapes]]\ntype = "sphere"\nradius = 1',
        ["sky.up is missing", "the file has no camera"],
    ),
    "no shapes": (HEAD, ["has no shapes", "at least one", "[[shapes]]"]),
    "unknown table": (SPHERE + "[lamps]", ["lamps is not a field of a scene file", "Allowed: name, description"]),
    "unknown field": (
        shape('type = "sphere"\nradios = 1'),
        ["shapes[1].radios is not a field", '"sphere"', "Allowed: type, name", "Did you mean `radius`?"],
    ),
    "unknown camera field": (camera("position = [0, 0, 5]\ntaget = [0, 0, 0]"), ["camera.taget", "`target`?"]),
    "field of the film in the camera": (
        camera("position = [0, 0, 5]\ntarget = [0, 0, 0]\nresolution = [64, 64]"),
        ["camera.resolution is not a field", "`resolution` is a field of [film]."],
    ),
    "field of the camera in the film": (SPHERE + "[film]\nfov = 30", ["film.fov", "`fov` is a field of [camera]."]),
    "missing field": (shape('type = "quad"'), ["shapes[1] lacks the field `corners`", "counter-clockwise"]),
    "missing type": (
        shape("radius = 1"),
        ["shapes[1] lacks the field `type`", "box, mesh, patches, plane, quad, sphere, stream"],
    ),
    "unknown type": (
        shape('type = "spere"'),
        [
            'shapes[1].type is "spere"',
            "must be one of: box, mesh, patches, plane, quad, sphere, stream",
            'Did you mean "sphere"?',
        ],
    ),
    "unknown camera type": (
        camera('type = "fisheye"\n'),
        ['camera.type is "fisheye"', "one of: orthographic, panorama, perspective"],
    ),
    "text for a number": (
        shape('type = "sphere"\nradius = "big"'),
        ['shapes[1].radius is "big"', "must be a number", "Radius in scene units"],
    ),
    "number for a text": (SPHERE + "material = 3", ["shapes[0].material is 3", "must be a text", "default"]),
    "number for a table": (SPHERE + "emission = 3", ["shapes[0].emission is 3", "must be a table", "radiance = "]),
    "fraction for a count": (
        shape('type = "sphere"\nradius = 1\nsubdivisions = 1.5'),
        ["is 1.5", "a whole number"],
    ),
    "list for shapes": (HEAD + "[shapes]\nx = 1", ["shapes is {x = 1}", "must be a list"]),
    "two numbers for a vector": (
        camera("position = [0, 0]\ntarget = [0, 0, 0]"),
        ["camera.position is [0, 0]", "a list of 2", "must be a list of 3 numbers", "Where the eye is"],
    ),
    "text in a vector": (camera('position = [0, "a", 5]\ntarget = [0, 0, 0]'), ["camera.position[1]", "a number"]),
    "two numbers for a colour": (
        SPHERE + "[materials.a]\nreflectance = [0.5, 0.5]",
        ["materials.a.reflectance is [0.5, 0.5]", "a list of 3 numbers", "linear Rec. 709"],
    ),
    "unknown field of a material": (SPHERE + "[materials.a]\n[materials.b]\nreflektance = 1", ["materials.b.refl"]),
    "a material with a strange name": (
        SPHERE + '[materials."a b"]\nreflectance = 2',
        ['materials."a b".reflectance'],
    ),
    "nan": (camera("position = [0, nan, 5]\ntarget = [0, 0, 0]"), ["camera.position[1] is nan", "finite number"]),
    "infinity": (SPHERE + "emission = { radiance = inf }", ["shapes[0].emission.radiance is inf", "finite number"]),
    "beyond 32 bits": (
        mesh("vertices = [[0, 0, 1e30]]\nfaces = []"),
        ["shapes[1].vertices[0][2] is 1e+30", "1e+15"],
    ),
    "beyond 32 bits by a transform": (
        SPHERE + "transform = [{ scale = 1e9 }, { scale = 1e9 }]",
        ["shapes[0] reaches beyond 1e+15"],
    ),
    "unknown material": (
        SPHERE + 'material = "wite"\n[materials.white]',
        ['shapes[0].material names the material "wite"', "defines white", 'Did you mean "white"?'],
    ),
    "no materials": (SPHERE + 'material = "white"', ["no materials", "[materials.white]"]),
    "reflectance above one": (
        SPHERE + "[materials.a]\nreflectance = [1, 1.5, 0]",
        ["materials.a.reflectance is [1, 1.5, 0]", "between 0 and 1", "emission"],
    ),
    "negative reflectance": (SPHERE + "[materials.a]\nreflectance = -1", ["materials.a.reflectance is -1"]),
    "negative radiance": (
        SPHERE + "emission = { radiance = [1, -1, 0] }",
        ["shapes[0].emission.radiance is [1, -1, 0]", "0 or more"],
    ),
    "radius zero": (shape('type = "sphere"\nradius = 0'), ["shapes[1].radius is 0", "a number above 0"]),
    "too many triangles": (shape('type = "sphere"\nradius = 1\nsubdivisions = 20'), ["is 20", "of at most 8"]),
    "fov zero": (camera("position = [0, 0, 5]\ntarget = [0, 0, 0]\nfov = 0"), ["camera.fov is 0", "above 0"]),
    "fov 180": (camera("position = [0, 0, 5]\ntarget = [0, 0, 0]\nfov = 180"), ["camera.fov is 180", "below 180"]),
    "resolution zero": (SPHERE + "[film]\nresolution = [0, 5]", ["film.resolution[0] is 0", "at least 1"]),
    "resolution absurd": (
        SPHERE + "[film]\nresolution = [5, 99999]",
        ["film.resolution[1] is 99999", "at most 32768"],
    ),
    "too many pixels": (SPHERE + "[film]\nresolution = [32768, 32768]", ["film.resolution is [32768, 32768]"]),
    "camera at its target": (
        camera("position = [1, 1, 1]\ntarget = [1, 1, 1]"),
        ["camera.target is the same point"],
    ),
    "up along the view": (
        camera("position = [0, 5, 0]\ntarget = [0, 0, 0]"),
        ["camera.up is [0, 1, 0], parallel to the view", "such as up = [1, 0, 0]"],
    ),
    "no up": (
        camera("position = [0, 0, 5]\ntarget = [0, 0, 0]\nup = [0, 0, 0]"),
        ["camera.up is [0, 0, 0]", "zero"],
    ),
    "quad out of plane": (
        shape('type = "quad"\n' + QUAD.replace("[0, 1, 0]", "[0, 1, 0.5]")),
        ["shapes[1].corners is not planar", "distance of 0.", "as a mesh"],
    ),
    "quad with a dent": (
        shape('type = "quad"\n' + QUAD.replace("[1, 1, 0]", "[0.2, 0.2, 0]")),
        ["shapes[1].corners is not convex", "corner 2"],
    ),
    "quad crosswise": (
        shape('type = "quad"\ncorners = [[0, 0, 0], [1, 1, 0], [2, 0, 0], [0, 1, 0]]'),
        ["shapes[1].corners has no area", "crosswise", "around the outline"],
    ),
    "quad of no area": (
        shape('type = "quad"\ncorners = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]'),
        ["shapes[1].corners has no area"],
    ),
    "box inside out": (
        shape('type = "box"\nmin = [0, 2, 0]\nmax = [1, 1, 1]'),
        ["shapes[1].min[1] is 2", "below max[1], which is 1", "Exchange"],
    ),
    "box of two minds": (
        shape('type = "box"\nmin = [0, 0, 0]\nsize = [1, 1, 1]'),
        ["shapes[1] has min, size, but"],
    ),
    "box of no size": (shape('type = "box"\ncenter = [0, 0, 0]\nsize = [1, 0, 1]'), ["shapes[1].size[1] is 0"]),
    "singular matrix": (
        SPHERE + "transform = [{ matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]] }]",
        ["shapes[0].transform[0].matrix is singular", "must be invertible"],
    ),
    "row-vector matrix": (
        SPHERE + "transform = [{ matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 0, 0, 1]] }]",
        ["shapes[0].transform[0].matrix[3] is [5, 0, 0, 1]", "[0, 0, 0, 1]", "last column"],
    ),
    "scale zero": (SPHERE + "transform = [{ scale = [1, 0, 1] }]", ["transform[0].scale is [1, 0, 1]", "flatten"]),
    "scales whose product is zero": (
        shape(PLANE + "transform = [{ scale = 1e-200 }, { scale = 1e-200 }]"),
        ["shapes[1].transform flattens the shape", "stretch by [0, 0, 0]", "above 1e-30"],
    ),
    "steps whose product is flat": (
        shape(PLANE + "transform = [{ scale = [1e-9, 1, 1] }, { scale = [1e-9, 1, 1] }]"),
        ["shapes[1].transform flattens the shape", "above 1e-15 of the largest"],
    ),
    "a motion to nothing": (
        SPHERE + "motion = [{ time = 0 }, { time = 1, transform = [{ scale = 1e-20 }, { scale = 1e-20 }] }]",
        ["shapes[0].motion[1].transform flattens the shape"],
    ),
    "rotation about nothing": (
        SPHERE + "transform = [{ scale = 2 }, { rotate = { axis = [0, 0, 0], angle = 30 } }]",
        ["shapes[0].transform[1].rotate.axis is [0, 0, 0]", "any length but zero"],
    ),
    "rotation without an angle": (
        SPHERE + "transform = [{ rotate = { axis = [0, 0, 1] } }]",
        ["`angle`", "degrees"],
    ),
    "two steps in one": (
        SPHERE + "transform = [{ scale = 2, translate = [0, 1, 0] }]",
        ["shapes[0].transform[0] has translate and scale", "one table per step"],
    ),
    "a step of nothing": (SPHERE + "transform = [{}]", ["shapes[0].transform[0] has nothing"]),
    "unknown step": (SPHERE + "transform = [{ move = [0, 1, 0] }]", ["shapes[0].transform[0].move", "translate"]),
    "face beyond the vertices": (
        mesh("vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\nfaces = [[0, 1, 2], [1, 2, 3]]"),
        ["shapes[1].faces[1] names vertex 3, but the mesh has 3 vertices (0 to 2)", "OBJ files count from 1"],
    ),
    "face of two vertices": (
        mesh("vertices = [[0, 0, 0]]\nfaces = [[0, 0]]"),
        ["shapes[1].faces[0]", "at least 3"],
    ),
    "mesh without vertices": (mesh("vertices = []\nfaces = [[0, 1, 2]]"), ["shapes[1].vertices is empty"]),
    "mesh of nothing": (mesh(""), ["shapes[1] has no geometry", "`vertices` and `faces`, or `file`"]),
    "mesh of two minds": (mesh('vertices = [[0, 0, 0]]\nfile = "a.obj"'), ["shapes[1] has vertices and file"]),
    "mesh without area": (
        mesh("vertices = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]\nfaces = [[0, 1, 2]]"),
        ['shapes[1] ("mesh-1") has 1 triangles, none of which has an area'],
    ),
    "too few texture coordinates": (
        mesh("vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\nfaces = [[0, 1, 2]]\nuv = [[0, 0]]"),
        ["shapes[1].uv has 1 pairs, but the mesh has 3 vertices"],
    ),
    "texture coordinates of a file": (mesh('file = "a.obj"\nuv = [[0, 0]]'), ["shapes[1] has uv and file"]),
    "plane without normal": (shape('type = "plane"'), ["shapes[1] lacks the field `normal`", "out of the front"]),
    "plane with a normal of no length": (
        shape('type = "plane"\nnormal = [0, 0, 0]'),
        ["shapes[1].normal is [0, 0, 0]", "any length but zero", "normal = [0, 1, 0]"],
    ),
    "plane with u along its normal": (
        shape('type = "plane"\nnormal = [0, 2, 0]\nu = [0, 1, 0]'),
        ["shapes[1].u is [0, 1, 0]", "not along its normal [0, 2, 0]"],
    ),
    "plane beyond 32 bits": (
        shape(
            'type = "plane"\nnormal = [0, 1, 0]\ntransform = [{ scale = 1e9 }, { translate = [1e15, 9e14, 0] },'
            " { scale = 2 }]"
        ),
        ["shapes[1] reaches beyond 1e+15"],
    ),
    "sphere too small for 32 bits": (
        shape('type = "sphere"\nradius = 1e-20'),
        ["shapes[1] is only 1e-20 scene units thick", "1e-15", "smaller unit"],
    ),
    "sphere flattened by its transform": (
        SPHERE + "transform = [{ scale = [1, 1e-9, 1] }, { scale = [1e-7, 1e-9, 1e-7] }]",
        ["shapes[0] is only 1e-18 scene units thick"],
    ),
    "negative radius": (shape('type = "sphere"\nradius = -2'), ["shapes[1].radius is -2", "a number above 0"]),
    "unknown type of material": (
        SPHERE + '[materials.a]\ntype = "fong"',
        ['materials.a.type is "fong"', "one of: diffuse, glazing, phong", 'Did you mean "phong"?'],
    ),
    "mirror of a diffuse material": (
        SPHERE + '[materials.a]\ntype = "diffuse"\nmirror = 0.5',
        ["materials.a.mirror is not a field", 'the type "diffuse"'],
    ),
    "mirror above one": (
        SPHERE + '[materials.a]\ntype = "phong"\nmirror = [0, 0, 1.5]',
        ["materials.a.mirror is [0, 0, 1.5]", "between 0 and 1"],
    ),
    "negative highlight": (
        SPHERE + '[materials.a]\ntype = "phong"\nspecular = -1',
        ["materials.a.specular is -1", "0 or more"],
    ),
    "exponent zero": (
        SPHERE + '[materials.b]\n[materials.a]\ntype = "phong"\nexponent = 0',
        ["materials.a.exponent is 0", "a number above 0", "Phong's exponent"],
    ),
    "unknown texture": (
        SPHERE + '[materials.a]\ntexture = "tile"\n[textures]\ntiles = { type = "checker" }',
        ['materials.a.texture names the texture "tile"', "defines tiles", 'Did you mean "tiles"?'],
    ),
    "no textures": (
        SPHERE + '[materials.a]\ntexture = "tiles"',
        ["but the file defines no textures", "[textures.tiles]"],
    ),
    "texture without a type": (
        SPHERE + "[textures.a]\nscale = 2",
        ["textures.a lacks the field `type`", "type is one of: checker, image"],
    ),
    "texture of another type": (
        SPHERE + '[textures.a]\ntype = "marble"',
        ['textures.a.type is "marble"', "one of: checker, image"],
    ),
    "checker of three colours": (
        SPHERE + '[textures.a]\ntype = "checker"\ncolors = [0, 1, 0]',
        ["textures.a.colors is [0, 1, 0], a list of 3", "Two colours"],
    ),
    "checker brighter than light": (
        SPHERE + '[textures.a]\ntype = "checker"\ncolors = [0, [1, 2, 1]]',
        ["textures.a.colors[1] is [1, 2, 1]", "between 0 and 1"],
    ),
    "texture of no scale": (
        SPHERE + '[textures.a]\ntype = "checker"\nscale = [1, 0]',
        ["textures.a.scale is [1, 0]", "above 0"],
    ),
    "unknown filter": (
        SPHERE + '[textures.a]\ntype = "image"\nfile = "a.png"\nfilter = "linaer"',
        ['textures.a.filter is "linaer"', "one of: linear, nearest", 'Did you mean "linear"?'],
    ),
    "missing picture": (
        SPHERE + '[textures.a]\ntype = "image"\nfile = "wood.png"',
        ["textures.a.file names the picture", "wood.png, which does not exist", "Pictures in ", "woods.png"],
    ),
    "picture of another format": (
        SPHERE + '[textures.a]\ntype = "image"\nfile = "wood.gif"',
        ["textures.a.file names ", "wood.gif, but", ".png, .jpg, .jpeg, .exr"],
    ),
    "light without a type": (
        SPHERE + "[[lights]]\nposition = [0, 9, 0]\nintensity = 1",
        ["lights[0] lacks the field `type`", "type is one of: directional, point, spot"],
    ),
    "light of another type": (SPHERE + '[[lights]]\ntype = "area"', ['lights[0].type is "area"', "point, spot"]),
    "light without intensity": (
        SPHERE + '[[lights]]\ntype = "point"\nposition = [0, 9, 0]',
        ["lights[0] lacks the field `intensity`", "W sr^-1"],
    ),
    "negative intensity": (
        SPHERE + '[[lights]]\ntype = "point"\nposition = [0, 9, 0]\nintensity = [1, 1, -1]',
        ["lights[0].intensity is [1, 1, -1]", "0 or more", "cannot be negative"],
    ),
    "negative irradiance": (
        SPHERE + '[[lights]]\ntype = "directional"\ndirection = [0, -1, 0]\nirradiance = -2',
        ["lights[0].irradiance is -2", "0 or more"],
    ),
    "light that goes nowhere": (
        SPHERE + '[[lights]]\ntype = "directional"\ndirection = [0, 0, 0]\nirradiance = 2',
        ["lights[0].direction is [0, 0, 0]", "any length but zero", "direction = [0, -1, 0]"],
    ),
    "spot at its target": (
        SPHERE + '[[lights]]\ntype = "spot"\nposition = [1, 2, 3]\ntarget = [1, 2, 3]\nintensity = 1',
        ["lights[0].target is the same point as position"],
    ),
    "unknown falloff": (
        SPHERE + '[[lights]]\ntype = "point"\nposition = [0, 9, 0]\nintensity = 1\nfalloff = "linear"',
        ['lights[0].falloff is "linear"', "one of: none, quadratic"],
    ),
    "cone of one angle": (
        SPHERE + '[[lights]]\ntype = "spot"\nposition = [0, 9, 0]\ntarget = [0, 0, 0]\nintensity = 1\ncone = [3]',
        ["lights[0].cone is [3], a list of 1", "a list of 2 numbers", "half angles"],
    ),
    **{
        f"cone {cone}": (
            SPHERE + '[[lights]]\ntype = "spot"\nposition = [0, 9, 0]\ntarget = [0, 0, 0]\nintensity = 1\n'
            f"cone = {cone}",
            [f"lights[0].cone is {cone}", "from 0 to 180", "cone = [30, 40]"],
        )
        for cone in ("[40, 30]", "[-1, 30]", "[30, 181]", "[0, 0]")
    },
    "negative ambient light": ("ambient = -1\n" + SPHERE, ["ambient is -1", "0 or more"]),
    "sky without a zenith": (SPHERE + "[sky]\nhorizon = 1", ["sky has horizon, but a sky is", "file = "]),
    "negative sky": (SPHERE + "[sky]\nzenith = 1\nhorizon = [0, 0, -1]", ["sky.horizon is [0, 0, -1]"]),
    "sky without an up": (SPHERE + "[sky]\nzenith = 1\nup = [0, 0, 0]", ["sky.up is [0, 0, 0]", "any length"]),
    "missing mesh file": (
        mesh('file = "bunny.obj"'),
        ["shapes[1].file names the mesh file", "bunny.obj, which does not exist", "other.obj"],
    ),
    "mesh file of another format": (mesh('file = "bunny.fbx"'), ["shapes[1].file is", ".obj, .ply, .stl"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_in_a_file_is_said_with_its_place_and_remedy(tmp_path: Path, case: str):
    text, expected = WRONG[case]
    path = tmp_path / "room.toml"
    path.write_text(text)
    (tmp_path / "other.obj").write_text("v 0 0 0\n")
    (tmp_path / "woods.png").write_bytes(b"")
    with pytest.raises(SceneError) as error:
        load_scene(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    for part in expected:
        assert part in message


BROKEN_MESHES = {
    "empty.obj": ("", "has no triangles"),
    "points.obj": ("v 0 0 0\nv 1 0 0\n", "has no triangles"),
    "prose.obj": ("v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", 'line 1 has "zero", which is not a number'),
    "beyond.obj": (
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
        "line 4 names vertex 9, but the file has 3 vertices (1 to 3)",
    ),
    "from_zero.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "count from 1"),
    "nan.obj": ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "has no triangles"),
    "cut.ply": ("ply\nformat", "cannot be read as PLY"),
    "beyond.ply": (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
        "face 0 names vertex 7, but the mesh has 3 vertices (0 to 2)",
    ),
    # Of whose points, too few as they are, trimesh says that the file has an unexpected length.
    "points.ply": (
        "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n",
        "names {folder}/points.ply, which has no triangles.\n",
    ),
    "empty.stl": ("", "cannot be read as STL: it has 0 bytes"),
}


@pytest.mark.filterwarnings("ignore:.*left out")
@pytest.mark.parametrize("name", BROKEN_MESHES)
def test_a_broken_mesh_file_is_named_with_what_is_broken(tmp_path: Path, name: str):
    content, expected = BROKEN_MESHES[name]
    (tmp_path / name).write_text(content)
    (tmp_path / "room.toml").write_text(mesh(f'file = "{name}"'))
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / "room.toml")
    assert expected.replace("{folder}", str(tmp_path)) in str(error.value)
    assert str(tmp_path / name) in str(error.value)


OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1\n"
STL = (
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n"
    "vertex 1 0 0\nvertex 1 1 0\nendloop\nendfacet\nendsolid a\n"
)
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n"
)


@pytest.mark.parametrize(("suffix", "content", "area"), [("obj", OBJ, 1.0), ("stl", STL, 0.5), ("ply", PLY, 0.5)])
def test_a_mesh_file_lies_beside_the_scene_file(tmp_path: Path, suffix: str, content: str, area: float):
    (tmp_path / f"plate.{suffix}").write_text(content)
    (tmp_path / "room.toml").write_text(HEAD + f'[[shapes]]\ntype = "mesh"\nfile = "plate.{suffix}"\n')
    scene = load_scene(tmp_path / "room.toml")
    assert scene.areas.sum() == pytest.approx(area)
    assert np.allclose(scene.normals, [0, 0, 1])


def test_a_file_says_what_stands_in_the_scene(tmp_path: Path):
    (tmp_path / "room.toml").write_text(
        """
        description = "one of each"
        [camera]
        type = "perspective"
        position = [1, 2, 3]
        target = [0, 0, 0]
        up = [0, 0, 1]
        fov = 50
        [film]
        resolution = [320, 200]
        [materials]
        red = { type = "diffuse", reflectance = [0.6, 0.1, 0.05] }
        grey = { reflectance = 0.3, two_sided = false }
        [[shapes]]
        type = "quad"
        name = "lamp"
        corners = [[0, 0, 3], [0, 1, 3], [1, 1, 3], [1, 0, 3]]
        emission = { radiance = 7, two_sided = true }
        [[shapes]]
        type = "box"
        center = [0, 0, 0]
        size = [1, 2, 3]
        material = "red"
        [[shapes]]
        type = "mesh"
        vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        faces = [[0, 1, 2, 3]]
        material = "grey"
        transform = [{ rotate = { axis = [1, 0, 0], angle = 90 } }, { translate = [0, 0, 1] }]
        """
    )
    scene = load_scene(tmp_path / "room.toml")
    assert scene.name == "room"
    assert scene.camera.resolution == (320, 200)
    assert scene.camera.fov == 50
    assert scene.camera.up.tolist() == [0, 0, 1]
    assert [
        (s.name, s.kind, part.start, s.count) for s, part in zip(scene.shapes, scene.shapes.ranges, strict=True)
    ] == [
        ("lamp", "quad", 0, 2),
        ("box-1", "box", 2, 12),
        ("mesh-2", "mesh", 14, 2),
    ]
    lamp, box, plate = scene.shapes
    assert scene.materials[lamp.material].reflectance.tolist() == [
        0.5,
        0.5,
        0.5,
    ]  # no material named: the grey default
    assert scene.materials[box.material].name == "red"
    assert not scene.materials[plate.material].two_sided
    assert lamp.emission.tolist() == [7, 7, 7]
    assert lamp.emission_two_sided
    assert np.allclose(scene.normals[:2], [0, 0, -1])
    assert np.allclose(scene.normals[14:], [0, -1, 0])
    assert scene.triangles.dtype == np.float64
    assert scene.triangles.flags.c_contiguous


def test_triangles_without_area_are_dropped_with_a_warning():
    data = {
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
        "shapes": [
            {
                "type": "mesh",
                "name": "plate",
                "vertices": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 2, 0], [2, 2, 1e-12]],
                "faces": [[0, 1, 2], [0, 2, 3], [1, 1, 2], [0, 3, 4]],
            }
        ],
    }
    with pytest.warns(
        SceneWarning, match=r'shapes\[0\] \("plate"\): dropped 3 of 4 triangles.*: 1, 2, 3 \(counted'
    ):
        scene = scene_from_dict(data)
    assert scene.shapes[0].count == len(scene.triangles) == 1


def test_a_dictionary_may_hold_numpy_arrays():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    scene = scene_from_dict(
        {
            "camera": {"position": np.array([0, 0, 5]), "target": np.zeros(3), "fov": np.float32(30)},
            "shapes": [{"type": "mesh", "vertices": vertices, "faces": np.array([[0, 1, 2]])}],
        }
    )
    assert scene.triangles.tolist() == [vertices.tolist()]


@pytest.mark.parametrize("name", ["missing.toml", "no/folder.toml", "."])
def test_a_scene_file_that_is_none_is_named(tmp_path: Path, name: str):
    with pytest.raises(SceneError, match=r"no such file|is a folder"):
        load_scene(tmp_path / name)


def test_a_binary_file_is_no_scene(tmp_path: Path):
    (tmp_path / "picture.toml").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(SceneError, match="not UTF-8 text"):
        load_scene(tmp_path / "picture.toml")


def test_the_schema_describes_every_field():
    schema = scene_schema()
    json.dumps(schema)
    assert {"SceneFile", "Camera", "Film", "Diffuse", "Quad", "Box", "Sphere", "Mesh"} <= set(schema["$defs"])
    for name, table in schema["$defs"].items():
        for field, declared in table["properties"].items():
            assert field == "type" or declared.get("description"), f"{name}.{field} has no description"
    every = ["Phong", "Plane", "Checker", "Image", "PointLight", "SpotLight", "DirectionalLight", "Sky"]
    assert set(every) <= set(schema["$defs"])
    assert "type" not in schema["$defs"]["Diffuse"]["required"]  # the only type with a default
    assert "type" in schema["$defs"]["Phong"]["required"]
    colour = schema["$defs"]["Diffuse"]["properties"]["reflectance"]["anyOf"]
    assert [each.get("maximum", each.get("items", {}).get("maximum")) for each in colour] == [1, 1]


def test_the_schema_requires_what_the_loader_requires(tmp_path: Path):
    tables = scene_schema()["$defs"]
    path = tmp_path / "ball.toml"
    path.write_text('[sky]\nzenith = 1\nup = [0, 1, 0]\n[[shapes]]\ntype = "sphere"\nradius = 1\n')
    with pytest.warns(SceneWarning, match="has no camera"):
        load_scene(path)
    assert tables["SceneFile"].get("required", []) == []
    assert "reflectance" not in tables["Glazing"]["properties"], "test_wrong_panes_are_refused"
    assert tables["Camera"]["required"] == ["position", "target"]


@pytest.mark.parametrize("kind", ["Diffuse", "Phong", "Principled", "Glazing"])
def test_the_schema_limits_colours_as_the_loader_does(kind: str):
    fields = scene_schema()["$defs"][kind]["properties"]
    base = {"transmittance": 0.5} if kind == "Glazing" else {}
    colours = {name: each["anyOf"][0] for name, each in fields.items() if "anyOf" in each}
    assert ("transmittance" if kind == "Glazing" else "reflectance") in colours
    for name, limits in colours.items():
        for value, allowed in ((-0.5, False), (1.5, "maximum" not in limits)):
            material = {"type": kind.lower(), **base, name: value}
            with nullcontext() if allowed else pytest.raises(SceneError, match=name):
                load_scene(
                    {
                        "camera": {"position": [0, 0, 4], "target": [0, 0, 0]},
                        "materials": {"m": material},
                        "shapes": [{"type": "sphere", "radius": 1, "material": "m", "emission": {"radiance": 1}}],
                    }
                )
        assert limits["minimum"] == 0


def test_a_good_scene_loads_without_a_warning(tmp_path: Path):
    (tmp_path / "room.toml").write_text(SPHERE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(load_scene(str(tmp_path / "room.toml")).spheres) == 1


def test_a_scene_may_say_its_exposure_which_is_no_part_of_its_content(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(SPHERE)
    plain = load_scene(path)
    assert plain.exposure is None
    path.write_text(SPHERE + "[film]\nexposure = -1.5")
    assert load_scene(path).exposure == -1.5
    assert load_scene(path).digest() == plain.digest()
    path.write_text(SPHERE + "[film]\nexposure = 200")
    with pytest.raises(SceneError, match=r"film.exposure is 200.*at most 100"):
        load_scene(path)


BASE = '[camera]\nposition = [0, 0, 4]\ntarget = [0, 0, 0]\n[[shapes]]\ntype = "sphere"\nradius = 1\n'


@pytest.mark.parametrize("depth", [102, 900, 100_000])
@pytest.mark.parametrize(
    "text",
    [
        lambda n: "name = " + "[" * n + "]" * n + "\n" + BASE,
        lambda n: "x = " + "{a=" * n + "1" + "}" * n + "\n" + BASE,
        lambda n: ".".join("a" * n) + " = 1\n" + BASE,
        lambda n: BASE + "[a" + '."a b"' * n + "]\n",
    ],
    ids=["lists", "tables", "a key", "a header"],
)
def test_what_is_nested_too_deep_is_an_error_with_a_place(
    text: Callable[[int], str], depth: int, tmp_path: Path
) -> None:
    file = tmp_path / "deep.toml"
    file.write_text(text(depth))
    with pytest.raises(SceneError, match=r"deep\.toml: .* a hundred deep"):
        load_scene(file)


def test_keys_have_at_most_16_parts(tmp_path: Path) -> None:
    """tomllib takes time quadratic in the parts of a header and of the keys below it."""
    file = tmp_path / "keys.toml"
    for parts, message in ((16, "a is not a field of a scene file"), (17, "a key of more than 16 parts")):
        key = ".".join("a" * parts)
        for text in (f"{key} = 1\n{BASE}", f"{BASE}[{key}]\n", f"x = {{ {key} = 1 }}\n{BASE}"):
            file.write_text(text)
            with pytest.raises(SceneError, match=message.replace("a is", "[ax] is")):
                load_scene(file)


def test_a_dictionary_that_is_nested_too_deep_is_an_error() -> None:
    deep: list[object] = []
    for _ in range(5000):
        deep = [deep]
    with pytest.raises(SceneError, match="a hundred deep"):
        load_scene({"camera": deep, "shapes": []})


@pytest.mark.parametrize(
    "text",
    [
        BASE + f'[[shapes]]\ntype = "mesh"\nfile = "{"a" * 5000}.obj"\n',
        BASE + f'[textures.t]\ntype = "image"\nfile = "{"a" * 5000}.png"\n',
        BASE + f'[textures.t]\ntype = "image"\nfile = "{"a/" * 5000}b.png"\n',
        BASE + '[textures.t]\ntype = "image"\nfile = "b\\u0000.png"\n',
    ],
    ids=["mesh", "picture", "folders", "a zero byte"],
)
def test_names_that_no_file_can_have_are_errors(text: str, tmp_path: Path) -> None:
    file = tmp_path / "names.toml"
    file.write_text(text)
    with pytest.raises(SceneError, match="does not exist"):
        load_scene(file)
    for name in ("a" * 5000, "a" * 5000 + ".toml", "a/" * 5000, "zero\0byte.toml"):
        with pytest.raises(SceneError):
            load_scene(name)


def test_a_byte_order_mark_begins_a_scene_file(tmp_path: Path) -> None:
    text = (ROOT / "scenes" / "cornell-box.toml").read_text(encoding="utf-8")
    (tmp_path / "a.toml").write_text("\ufeff" + text, encoding="utf-8")
    assert load_scene(tmp_path / "a.toml").shapes
