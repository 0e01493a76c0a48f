"""The model of a scene: its digest, meshes with shared vertices, and instances of them."""

from __future__ import annotations

import math
import pickle
import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from glpath.errors import GlpathError, SceneError
from glpath.io import load_scene, scene_from_dict
from glpath.radiosity.picture import picture_of
from glpath.scene import Background, CameraKey, Motion, check_camera, check_scene, path_traceable
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
from glpath.scene.portal import Portal
from glpath.scene.tessellate import unit_sphere
from glpath.sky.sun import Sun
from glpath.system.digest import UNSEEN

CAMERA = {"position": [0, 0, 9], "target": [0, 0, 0]}
QUAD = {"type": "quad", "corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}


def scene(*shapes: dict, **tables: object) -> Scene:
    return scene_from_dict({"camera": CAMERA, "shapes": list(shapes), **tables})


# --- meshes ---


def test_meshes_are_joined_with_the_attributes_that_all_have() -> None:
    corners = np.arange(9.0).reshape(3, 3) ** 2
    first = Mesh(corners, np.array([[0, 1, 2]], np.int32), corners[:, :2], corners)
    second = Mesh(corners + 1, np.array([[2, 1, 0]], np.int32), corners[:, 1:], colours=np.ones((3, 4)))
    joined = Mesh.joined([first, second])
    assert joined.faces.tolist() == [[0, 1, 2], [5, 4, 3]]
    assert joined.faces.dtype == np.int32
    np.testing.assert_array_equal(joined.vertices, np.concatenate([corners, corners + 1]))
    np.testing.assert_array_equal(joined.uv, np.concatenate([corners[:, :2], corners[:, 1:]]))
    assert joined.normals is joined.colours is joined.uv1 is None
    assert Mesh.joined([first]) is first


def test_unused_vertices_are_dropped_with_their_attributes() -> None:
    corners = np.arange(12.0).reshape(4, 3) ** 2
    mesh = Mesh(corners, np.array([[3, 0, 2]], np.int32), corners[:, :2])
    smaller = mesh.without_unused_vertices()
    np.testing.assert_array_equal(smaller.vertices[smaller.faces], corners[mesh.faces])
    np.testing.assert_array_equal(smaller.uv, corners[[0, 2, 3], :2])
    assert smaller.without_unused_vertices() is smaller


# --- the digest ---


@pytest.mark.parametrize("end", [0.0, -0.5])
def test_an_object_that_shrinks_to_nothing_or_mirrors_does_not_spin(end: float) -> None:
    """A key without a rotation of its own has the one before it: here, a quarter turn about z."""
    quarter = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]])
    maps = np.stack([quarter, quarter * [end, end, end, 1], quarter])
    motion = Motion(np.array([0.0, 1.0, 2.0]), maps, np.eye(3, 4)[None])
    for time, size in ((0.5, 0.5 + 0.5 * end), (1.0, end), (1.75, 0.75 + 0.25 * end)):
        np.testing.assert_allclose(motion.map_at(time), quarter * [size, size, size, 1], atol=1e-12)
    start = Motion(motion.times, maps[[1, 0, 0]], motion.placed)
    size = 0.5 + 0.5 * end
    np.testing.assert_allclose(start.map_at(0.5), quarter * [size, size, size, 1], atol=1e-12)


def everything() -> Scene:
    """A scene in which every field has something in it."""
    corners = np.arange(9.0).reshape(3, 3) ** 2
    uv = np.arange(6.0).reshape(3, 2)
    mesh = Mesh(corners, np.array([[0, 1, 2]], np.int32), uv, np.eye(3), uv + 7.0, np.arange(12.0).reshape(3, 4))
    position, up = np.array([0.0, 0, 9]), np.array([0.0, 1, 0])
    camera = Camera(position, np.zeros(3), up, 40.0, (8, 6), focus_distance=3.0)
    motion = Motion(np.array([0.0, 1.0]), np.arange(24.0).reshape(2, 3, 4), np.arange(12.0).reshape(1, 3, 4))
    slots = {name: TextureSlot(i % 2, 1) for i, name in enumerate(SLOTS)}
    return Scene(
        name="all",
        camera=replace(camera, motion=(CameraKey(1.0, np.ones(3), np.zeros(3), np.array([0.0, 1, 0])),)),
        shapes=Shapes(
            [
                Shape("t", mesh, 0, np.stack([np.eye(3, 4), 2 * np.eye(3, 4)]), motion=motion),
                Shape("s", "sphere", 1, np.arange(12.0).reshape(1, 3, 4)),
                Shape("p", "plane", 1, np.arange(12.0).reshape(1, 3, 4), np.ones(3), True, maintenance_factor=0.5),
            ]
        ),
        materials=(
            Material("m", np.full(3, 0.5)),
            Material("n", np.full(3, 0.25), roughness=0.5, metal_index=np.ones((2, 3)), **slots),
        ),
        source="here",
        textures=(
            Texture("x", np.ones((2, 2, 3), np.float32)),
            Texture("y", np.ones((1, 2, 4), np.uint8), srgb=True),
        ),
        lights=(
            Light(
                "l",
                "point",
                np.ones(3),
                profile=LightProfile(np.arange(6.0).reshape(2, 3)),
                maintenance_factor=0.5,
            ),
        ),
        ambient=np.ones(3),
        sky=Sky(np.ones(3), np.zeros(3)),
        portals=(Portal(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])),),
        background=Background(np.ones(3), ground=np.zeros(3)),
        exposure=1.0,
        centred_by=np.array([1.0, 2.0, 3.0]),
        animation_times=(0.0, 1.0),
    )


def unchecked(value: Any, name: str, changed: Any) -> Any:
    """Return a dataclass with a field replaced, without the checks of its constructor."""
    made = object.__new__(type(value))
    changed = Shapes(changed) if name == "shapes" else changed
    vars(made).update({each.name: getattr(value, each.name) for each in fields(value)} | {name: changed})
    return made


def mutations(value: Any, declared: Any = None) -> Iterator[tuple[str, Any]]:
    """Everything that differs from `value` in one place, with the path of that place: by what it is declared as."""
    options = [each for each in (get_args(declared) or ()) if get_origin(declared) is not tuple]
    for option in options:
        if option is type(None) and value is not None:
            yield "", None
        elif get_origin(option) is Literal:
            options.extend(get_args(option))
        elif isinstance(option, str) and option != value:
            yield "", option
    if isinstance(value, Portal):  # a corner alone cannot be moved: it is a rectangle
        yield ".Portal.corners", Portal(value.corners + 1.0)
    elif is_dataclass(value):
        hints = get_type_hints(type(value))
        for each in fields(value):
            for path, changed in mutations(getattr(value, each.name), hints[each.name]):
                yield f".{type(value).__name__}.{each.name}{path}", unchecked(value, each.name, changed)
    elif isinstance(value, np.ndarray):
        for index in np.ndindex(value.shape):
            changed = value.astype(float)
            changed[index] += 0.25 if value.dtype.kind == "f" else 1
            yield str(list(index)), changed.astype(value.dtype)
    elif isinstance(value, tuple):
        for i, each in enumerate(value):
            for path, changed in mutations(each):
                yield f"[{i}]{path}", (*value[:i], changed, *value[i + 1 :])
        if value and is_dataclass(value[0]):
            yield " less one", value[:-1]
    elif isinstance(value, bool):
        yield "", not value
    elif isinstance(value, int | float):
        yield "", value + 1
    elif isinstance(value, str) and not options:
        yield "", value + "x"


def test_the_digest_changes_with_every_field_but_those_that_change_no_picture():
    """By introspection: a field that somebody adds is looked at, and so is each that is said to change nothing."""
    whole = everything()
    seen = {whole.digest(): "the scene itself"}
    reached = set()
    sky = Environment(np.ones((2, 2, 3), np.float32), north=np.array([0.0, 0.0, -1.0]))
    mapped = replace(whole, sky=sky)
    of_map = ((f".Scene.sky{path}", replace(whole, sky=sky)) for path, sky in mutations(mapped.sky))
    sun = Sun(np.array([0.0, 1.0, 0.0]), np.ones(3))
    of_sun = [
        (f".Scene.sky.Environment.sun.Sun.{name}", replace(sun, **{name: value}))
        for name, value in (
            ("direction", np.array([1.0, 0, 0])),
            ("irradiance", np.full(3, 2.0)),
            ("diameter", 1.0),
        )
    ]
    suns = [
        (path, replace(whole, sky=replace(mapped.sky, sun=each)))
        for path, each in ((".Scene.sky.Environment.sun", sun), *of_sun)
    ]
    for path, changed in (*mutations(whole), ("the map.Scene.sky", mapped), *of_map, *suns):
        names = re.findall(r"\.([A-Z]\w*)\.(\w+)", path)
        reached.update(names)
        digest = changed.digest()
        if names[-1][1] in UNSEEN.get(names[-1][0], ()):
            assert digest == (mapped if path.startswith(".Scene.sky.Env") else whole).digest(), path
        else:
            assert digest not in seen, f"{path} has the digest of {seen[digest]}"
            seen[digest] = path
    kinds = (
        *(Scene, Camera, CameraKey, Shape, Motion, Mesh, Material, Texture, TextureSlot),
        *(Light, LightProfile, Sky, Environment, Sun, Background, Portal),
    )
    assert reached == {(kind.__name__, each.name) for kind in kinds for each in fields(kind)}


def test_the_digest_is_of_values_and_not_of_objects():
    whole = everything()
    mesh = whole.shapes[0].geometry
    copied = replace(mesh, vertices=mesh.vertices.copy(), faces=mesh.faces.astype(np.int64))
    again = replace(whole, shapes=(replace(whole.shapes[0], geometry=copied), *whole.shapes[1:]))
    assert again.digest() == whole.digest()


def test_a_camera_of_lists_is_that_of_arrays():
    whole = scene(QUAD)
    lists = whole.with_camera(position=[0, 1, 9], resolution=[8, 6], shutter=[0, 1])
    arrays = whole.with_camera(position=np.array([0.0, 1, 9]), resolution=(8, 6), shutter=(0.0, 1.0))
    assert lists.digest() == arrays.digest() != whole.digest()


def test_the_digest_without_the_camera_is_that_of_every_view():
    whole = everything()
    moved = whole.with_camera(fov=20.0)
    assert moved.digest() != whole.digest()
    assert moved.digest(camera=False) == whole.digest(camera=False)


def test_moving_a_value_from_one_array_to_the_next_changes_the_digest():
    one = load_scene("furnace", {"shape": "sphere"})
    other = replace(one, shapes=[replace(one.shapes[0], geometry="plane")])
    assert one.digest() != other.digest()


# --- meshes and instances ---


@pytest.mark.parametrize("name", ["cornell-box", "office", "room", "furnace", "stacked"])
def test_the_pool_of_vertices_has_the_same_triangles_with_shared_vertices(name: str):
    s = load_scene(name, {"kind": "triangle"} if name == "stacked" else None).shapes
    assert np.array_equal(s.vertices[s.faces], s.triangles)
    assert s.faces.dtype == np.int32
    assert len(s.faces) == s.total("triangle") == len(s.triangles)
    assert len(s.vertex_uv) == len(s.vertex_normals) == len(s.vertices)
    assert np.array_equal(s.vertex_uv[s.faces], s.triangle_uv)
    assert len(np.unique(s.faces)) == len(s.vertices)


def test_instances_stand_where_their_maps_put_them_and_normals_stay_perpendicular():
    """Against a mesh that was moved by hand, with a map that shears and mirrors."""
    rng = np.random.default_rng(5)
    ball = unit_sphere(2)
    maps = np.eye(3, 4) + 0.3 * rng.normal(size=(3, 3, 4))
    maps[1, :, 0] *= -1  # one that mirrors
    assert (np.sign(np.linalg.det(maps[:, :, :3])) == [1, -1, 1]).all()
    shapes = Shapes([Shape("balls", ball, 0, maps), Shape("one", ball, 0)])
    expected = [ball.vertices @ m[:, :3].T + m[:, 3] for m in maps]
    assert np.allclose(shapes.vertices, np.concatenate([*expected, ball.vertices]), atol=1e-12)
    assert shapes.meshes == (ball,)
    assert shapes.ranges == (slice(0, 960), slice(960, 1280))
    assert np.allclose(np.linalg.norm(shapes.vertex_normals, axis=1), 1)
    # The normal of an ellipsoid is the gradient of |unit point|², and on the side where the corners run around it.
    for m, normals in zip(maps, shapes.vertex_normals[: 3 * len(ball.vertices)].reshape(3, -1, 3), strict=True):
        gradient = ball.vertices @ np.linalg.inv(m[:, :3])
        gradient *= np.sign(np.linalg.det(m[:, :3])) / np.linalg.norm(gradient, axis=1, keepdims=True)
        assert np.allclose(normals, gradient, atol=1e-9)
    corners = shapes.triangles
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("tj,tkj->tk", flat, shapes.vertex_normals[shapes.faces]) > 0).all()


def test_pieces_of_one_array_are_derived_without_a_copy_and_others_in_order():
    balls = np.random.default_rng(3).normal(size=(5, 3, 4))
    one_by_one = Shapes([Shape(str(i), "sphere", 0, balls[i][None]) for i in range(5)])
    assert np.array_equal(one_by_one.spheres, balls)
    assert np.shares_memory(one_by_one.spheres, balls)
    mixed = Shapes([one_by_one[3], one_by_one[1], Shape("two", "sphere", 0, balls[[0, 2]]), one_by_one[4]])
    assert np.array_equal(mixed.spheres, balls[[3, 1, 0, 2, 4]])
    assert np.array_equal(Shapes([one_by_one[1], one_by_one[1]]).spheres, balls[[1, 1]])


def test_welding_joins_what_is_equal_to_the_last_bit_and_nothing_else():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1 + 1e-15, 0]]], float)
    mesh = Mesh.of_triangles(corners)
    assert len(mesh.vertices) == 6
    welded = mesh.welded()
    assert len(welded.vertices) == 5  # (1, 0, 0) twice; (0, 1, 0) and its neighbour stay two
    assert np.array_equal(welded.vertices[welded.faces], corners)
    apart = Mesh.of_triangles(corners, [[[0, 0], [1, 0], [0, 1]], [[0.5, 0], [1, 1], [0, 1]]]).welded()
    assert len(apart.vertices) == 6  # (1, 0, 0) has two places in the texture


def test_a_box_shares_vertices_where_the_texture_coordinates_allow_it():
    box = scene({"type": "box", "min": [0, 0, 0], "max": [1, 2, 3]}).shapes[0].geometry
    assert (len(box.vertices), len(box.faces)) == (20, 12)  # some agree in uv across an edge


def test_shapes_of_one_file_are_instances_of_one_mesh(tmp_path: Path):
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 9 9 9\nf 1 2 3\n")
    shapes = [
        {"type": "mesh", "file": str(tmp_path / "t.obj"), "transform": [{"translate": [0, 0, z]}]} for z in (0, 1)
    ]
    turned = [{"type": "mesh", "file": str(tmp_path / "t.obj"), "flip_normals": True}]
    loaded = scene_from_dict({"camera": CAMERA, "shapes": shapes + turned})
    assert [len(mesh.vertices) for mesh in loaded.shapes.meshes] == [3, 3]  # the stray vertex is gone
    assert loaded.shapes[0].geometry is loaded.shapes[1].geometry
    assert loaded.triangles[:2, :, 2].tolist() == [[0] * 3, [1] * 3]
    assert np.allclose(loaded.normals[:, 2], [1, 1, -1])


NORMALS = {
    "t.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 0 1 1\nf 1//1 2//2 3//1\n",
    "t.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "property float nx\nproperty float ny\nproperty float nz\nelement face 1\n"
    "property list uchar int vertex_indices\n"
    "end_header\n0 0 0 0 0 2\n1 0 0 0 1 1\n0 1 0 0 0 2\n3 0 1 2\n",
}


@pytest.mark.parametrize("name", NORMALS)
def test_the_normals_of_a_file_are_kept_and_none_are_made_up(tmp_path: Path, name: str):
    (tmp_path / name).write_text(NORMALS[name])
    shape = {"type": "mesh", "file": str(tmp_path / name)}
    s = scene_from_dict({"camera": CAMERA, "shapes": [shape, {**shape, "flip_normals": True}]}).shapes
    root = np.sqrt(0.5)
    expected = np.array([[0, 0, 1], [0, root, root], [0, 0, 1]])
    assert np.allclose(s.vertex_normals[s.faces[0]], expected)
    assert np.allclose(s.vertex_normals[s.faces[1]], -expected[::-1])
    (tmp_path / "plain.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    plain = {"type": "mesh", "file": str(tmp_path / "plain.obj")}
    assert scene_from_dict({"camera": CAMERA, "shapes": [plain]}).shapes[0].geometry.normals is None


def test_a_texture_on_a_mesh_without_coordinates_is_an_error_where_nobody_can_make_them_up():
    one = scene(QUAD)
    mesh = Mesh.of_triangles(one.triangles)
    with pytest.raises(SceneError, match=r'the shape "quad-0" has the material "default" with a texture.*\n.*`uv`'):
        replace(
            one,
            shapes=[replace(one.shapes[0], geometry=mesh)],
            materials=[replace(one.materials[0], texture=TextureSlot(0))],
            textures=(
                Texture("x", np.ones((2, 2, 3), np.float32)),
                Texture("y", np.ones((1, 2, 4), np.uint8), srgb=True),
            ),
        )


def test_what_is_derived_stays_with_the_shapes_and_cannot_be_written_to():
    one = load_scene("cornell-box")
    assert one.with_camera(fov=20.0).triangles is one.triangles
    with pytest.raises(ValueError, match="read-only"):
        one.triangles[0] = 0
    assert pickle.loads(pickle.dumps(one)).digest() == one.digest()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("name", None),
        ("source", 5),
        ("camera", "x"),
        ("camera", None),
        ("ambient", 1.0),
        ("ambient", [math.nan] * 3),
        ("sky", "x"),
        ("background", "x"),
        ("exposure", "x"),
        ("centred_by", 1),
        ("unit", "bogus"),
        ("shapes", None),
        ("shapes", [1]),
        ("materials", None),
        ("materials", ()),
        ("textures", "x"),
        ("lights", [None]),
        ("portals", 5),
    ],
)
def test_a_scene_refuses_fields_of_other_types(name: str, value: Any) -> None:
    with pytest.raises(GlpathError, match=name.rstrip("s")):
        replace(load_scene("cornell-box-36"), **{name: value})


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: scene.add(None),
        lambda scene: scene.add([1]),
        lambda scene: Environment("x"),
        lambda scene: Environment(np.ones((2, 4, 3)), up=[0, 1]),
        lambda scene: Portal("x"),
        lambda scene: Sky([math.nan] * 3, None),
        lambda scene: Sky([math.nan] * 3, [1, 1, 1]),
        lambda scene: Sky([1, 1], [1, 1, 1]),
        lambda scene: Light("a", "point", None),
        lambda scene: Background(radiance="x"),
        lambda scene: Motion("x", None, None),
        lambda scene: Texture("a", None),
        lambda scene: check_scene(None),
        lambda scene: check_camera(None, "a"),
        lambda scene: path_traceable("cornell-box"),
        lambda scene: picture_of("cornell-box-36", scene),
    ],
)
def test_wrong_arguments_of_scene_objects_are_refused(call: Callable[[Any], object]) -> None:
    with pytest.raises(GlpathError):
        call(load_scene("cornell-box-36"))


PROFILE = LightProfile(np.arange(6.0).reshape(2, 3))


def test_a_light_has_perpendicular_unit_vectors() -> None:
    long, slanting = np.array([0, 0, -5.0]), np.array([0, 3.0, 4])
    lamp = Light("lamp", "point", np.ones(3), direction=long, profile=PROFILE, c0=slanting)
    np.testing.assert_allclose([lamp.direction, lamp.c0], [[0, 0, -1], [0, 1, 0]], atol=1e-15)
    sun = Light("sun", "directional", np.ones(3), direction=np.array([3.0, 0, -4]))
    np.testing.assert_allclose(sun.direction, [0.6, 0, -0.8], atol=1e-15)
    unit = np.array([0.48, 0.6, -0.64])
    assert Light("sun", "directional", np.ones(3), direction=unit).direction is unit
    assert Light("bulb", "point", np.ones(3), direction=np.zeros(3)).kind == "point"


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "spot", "direction": np.zeros(3)}, "direction"),
        ({"kind": "directional", "direction": np.zeros(3)}, "direction"),
        ({"kind": "point", "profile": PROFILE, "direction": np.zeros(3)}, "direction"),
        ({"kind": "point", "profile": PROFILE, "c0": np.zeros(3)}, "c0"),
        ({"kind": "point", "profile": PROFILE, "c0": np.array([0, 0, 2.0])}, "c0: .* along direction"),
        ({"kind": "spot", "cone": (0.0, 0.0)}, "cone: .* above 0"),
    ],
)
def test_a_light_without_a_direction_or_a_cone_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=f"light 'lamp': {message}"):
        Light("lamp", intensity=np.ones(3), **fields)


@pytest.mark.parametrize("name", ["ior", "iridescence_ior"])
def test_an_index_of_refraction_is_at_least_1(name: str) -> None:
    assert getattr(Material("m", np.ones(3), **{name: 1.0}), name) == 1
    with pytest.raises(SceneError, match=f"{name}: 0.4, but must be from 1 to"):
        Material("m", np.ones(3), **{name: 0.4})


COLOURS = [np.full(3, math.nan), -np.ones(3), np.full(3, 1e308), np.ones(4), np.ones(3, complex), 1.0, "abc", None]


@pytest.mark.parametrize("value", COLOURS, ids=str)
@pytest.mark.parametrize(("tuple_name", "field"), [("shapes", "emission"), ("materials", "reflectance")])
def test_a_replaced_colour_that_is_none_is_refused(tuple_name: str, field: str, value: Any) -> None:
    first = getattr(load_scene("cornell-box-36"), tuple_name)[0]
    with pytest.raises(GlpathError, match=field):
        replace(first, **{field: value})


@pytest.mark.parametrize(
    ("name", "value"), [("geometry", None), ("material", 0.5), ("motion", 1), ("world_from_object", np.eye(3, 4))]
)
def test_a_shape_refuses_fields_of_other_types(name: str, value: Any) -> None:
    with pytest.raises(GlpathError, match=name):
        replace(load_scene("cornell-box-36").shapes[0], **{name: value})


def test_a_shape_and_a_material_accept_lists() -> None:
    one = load_scene("cornell-box-36")
    for _ in range(2):  # the second shape of the same types takes a shorter path
        made = replace(one.shapes[0], emission=[1, 2, 3], material=np.int64(1))
        assert made.emission.dtype == np.float64
        assert type(made.material) is int
    assert replace(one.materials[0], reflectance=[0, 1, 0]).reflectance.dtype == np.float64


@pytest.mark.parametrize(
    "change",
    [
        {"fov": math.nan},
        {"position": [math.nan] * 3},
        {"position": [1e308] * 3},
        {"resolution": (math.nan, math.nan)},
        {"resolution": (math.inf, 2)},
        {"resolution": (0, 4)},
        {"resolution": (1.5, 2)},
        {"resolution": (Fraction(1, 2), 4)},
        {"projection": "\ud800"},
        {"shutter": (64, 0)},
        {"focus_distance": -1},
    ],
    ids=ascii,
)
def test_a_scene_refuses_a_camera_without_a_view(change: dict[str, Any]) -> None:
    one = load_scene("cornell-box-36")
    with pytest.raises(SceneError, match=f"{one.source}: .*{next(iter(change)).replace('projection', 'type')} is "):
        one.with_camera(**change)
    with pytest.raises(SceneError):
        replace(one, camera=replace(one.camera, **change))


def test_a_sky_accepts_lists() -> None:
    assert Sky([1, 1, 1], [0, 0, 0]).radiance([[0, 1, 0]]).tolist() == [[1, 1, 1]]
