"""Scenes that render but hardly as meant are warned of, and others are not; `glpath validate` tells both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from glpath.cli import scenes
from glpath.errors import SceneError
from glpath.io import load_scene, scene_from_dict
from glpath.scene import Camera, CameraKey, Scene, check, check_camera, check_scene, model, path_traceable, sight
from glpath.scene.model import Material, Shape, Shapes
from glpath.scene.sight import sees_anything, sees_triangles

CAMERA = Camera(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 40.0, (64, 48))


def scene(**changes: object) -> Scene:
    """A glowing ball before the camera."""
    ball = {"type": "sphere", "radius": 1, "subdivisions": 1, "emission": {"radiance": 1}, **changes}
    ball = {key: value for key, value in ball.items() if value is not None}
    return scene_from_dict(
        {
            "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
            "materials": {"mirror": {"reflectance": 1}, "black": {"reflectance": 0}},
            "shapes": [ball],
        }
    )


def test_a_good_scene_has_no_warnings():
    assert check_scene(scene()) == []
    assert check_scene(scene(material="black")) == []  # a light need not reflect


def test_a_scene_without_light_is_warned_of():
    (warning,) = check_scene(scene(emission={"radiance": 0}))
    assert "No shape emits light" in warning
    assert "emission" in warning


def test_a_camera_that_sees_nothing_is_warned_of():
    (warning,) = check_scene(scene().with_camera(target=np.array([0.0, 0, 10])))
    assert "sees nothing" in warning
    assert "[0, 0, 5]" in warning


def test_a_camera_is_checked_where_it_is_when_the_shutter_opens():
    for base, key in (([0, 0, 0.5], [0, 0, 5]), ([0, 0, 5], [0, 0, 0.5]), ([0, 0, 5], [0, 0, 1])):
        keys = (CameraKey(0.0, np.array(key, float), np.zeros(3), CAMERA.up),)
        moving = replace(scene(), camera=replace(CAMERA, position=base, motion=keys))
        assert check_scene(moving) == check_scene(replace(scene(), camera=replace(CAMERA, position=key)))


def test_a_camera_on_a_surface_is_warned_of():
    box = scene(type="box", min=[-1, -1, -1], max=[1, 1, 1], radius=None, subdivisions=None)
    corner = box.triangles[7, 1]
    (warning,) = check_scene(box.with_camera(position=corner))
    assert 'exactly on a surface, of the shape "box-0"' in warning
    middle = box.triangles[7].mean(axis=0)
    assert len(check_scene(box.with_camera(position=middle))) == 1
    assert check_scene(box.with_camera(position=1.01 * middle)) == []


def test_a_surface_that_reflects_everything_is_warned_of():
    (warning,) = check_scene(scene(material="mirror"))
    assert '"mirror" reflects all light' in warning


GROUND = {"type": "plane", "name": "ground", "point": [0, -2, 0], "normal": [0, 1, 0]}
BALL = {"type": "sphere", "name": "ball", "radius": 1}
BOX = {"type": "box", "name": "box", "min": [-1, -1, -1], "max": [1, 1, 1]}
LAMP = {"type": "point", "name": "lamp", "position": [3, 5, 3], "intensity": 9}


def warnings_of(*shapes: dict, eye: tuple = (0, 0, 5), target: tuple = (0, 0, 0), **tables: object) -> list[str]:
    camera = {"position": eye, "target": target, "up": [0.1, 1, 0.2]}
    return check_scene(scene_from_dict({"camera": camera, "shapes": list(shapes), "lights": [LAMP], **tables}))


def test_a_scene_of_exact_shapes_under_a_lamp_has_no_warnings():
    assert warnings_of(BALL, GROUND) == []
    assert warnings_of(BOX, GROUND) == []
    assert warnings_of(GROUND) == []


def test_any_light_will_do():
    sun = {"type": "directional", "direction": [0, -1, 0], "irradiance": 1}
    assert warnings_of(BALL, lights=[sun]) == []
    assert warnings_of(BALL, lights=[], ambient=0.1) == []
    assert warnings_of({**BALL, "emission": {"radiance": 1}}, lights=[]) == []
    for dark in ([], [{**LAMP, "intensity": 0}]):
        assert warnings_of(BALL, lights=dark, sky={"zenith": 1}) == []
        (warning,) = warnings_of(BALL, lights=dark)
        assert "No shape emits light, and there is no other light: the picture will be black." in warning
        assert "[[lights]]" in warning


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("shape", [BALL, BOX], ids=["sphere", "box"])
@pytest.mark.parametrize("spot", [False, True])
def test_a_light_inside_a_closed_shape_is_warned_of(shape: dict, flip: bool, spot: bool):
    inside = {**LAMP, "position": [0.3, 0.4, 0.5]}
    if spot:
        inside |= {"type": "spot", "target": [0, 0, 0]}
    turned = {**shape, "flip_normals": flip, "transform": [{"rotate": {"axis": [1, 2, 3], "angle": 30}}]}
    (warning,) = warnings_of(turned, GROUND, lights=[LAMP, inside])
    assert f'The light "lamp" stands inside the shape "{shape["name"]}", which keeps it from everything' in warning
    # Who is inside as well sees it shine.
    assert warnings_of(turned, GROUND, eye=(0.2, 0.1, 0), target=(0.3, 0.3, 0), lights=[inside]) == []


def test_many_lights_inside_many_shapes_are_tested_for_a_limited_time(monkeypatch: pytest.MonkeyPatch):
    boxes = [{**BOX, "name": f"box-{i}", "min": [-1 - 0.01 * i] * 3, "max": [1 + 0.01 * i] * 3} for i in range(10)]
    lamps = [{**LAMP, "name": f"lamp-{i}", "position": [0.01 * i, 0, 0]} for i in range(20)]
    found = warnings_of(*boxes, GROUND, lights=lamps)
    assert len(found) == 20
    assert 'The light "lamp-0" stands inside the shape "box-0" (and 9 more shapes), which keeps' in found[0]
    tests: list[int] = []
    winding_number = sight.winding_number
    monkeypatch.setattr(sight, "winding_number", lambda *given: (tests.append(1), winding_number(*given))[1])
    monkeypatch.setattr(check, "_MAX_COST", 25_000)
    assert len(warnings_of(*boxes, GROUND, lights=lamps)) == 3
    assert len(tests) == 3 * len(boxes)
    # The camera is inside, too. The other lights might be in any of the boxes, so there is no warning.
    assert warnings_of(*boxes, eye=(0.5, 0.5, 0.5), lights=lamps) == []


def test_a_light_beside_a_closed_shape_is_outside_of_it():
    # In the box around the sphere and around the turned box, but not in them.
    beside = {**LAMP, "position": [0.8, 0.8, 0.8]}
    assert warnings_of(BALL, lights=[beside]) == []
    turned = {**BOX, "transform": [{"rotate": {"axis": [0, 0, 1], "angle": 45}}]}
    assert warnings_of(turned, lights=[{**LAMP, "position": [1.2, 1.2, 0]}]) == []
    open_box = {"type": "quad", "corners": [[-1, -1, -1], [1, -1, -1], [1, 1, 1], [-1, 1, 1]]}
    assert warnings_of(open_box, lights=[{**LAMP, "position": [0, 0, 0.01]}]) == []


def test_of_many_triangles_none_is_overlooked(monkeypatch: pytest.MonkeyPatch):
    """They are looked at some at a time: here five of the twelve of a box."""
    monkeypatch.setattr(sight, "_CHUNK", 5)
    monkeypatch.setattr(model, "_CHUNK", 5)
    (warning,) = warnings_of(BOX, GROUND, lights=[LAMP, {**LAMP, "position": [0.3, 0.4, 0.5]}])
    assert "stands inside the shape" in warning
    box = scene(type="box", min=[-1, -1, -1], max=[1, 1, 1], radius=None, subdivisions=None)
    assert box.areas.tolist() == [2.0] * 12
    for number in (0, 4, 5, 11):
        (warning,) = check_scene(box.with_camera(position=box.triangles[number].mean(axis=0)))
        assert "exactly on a surface" in warning
        behind = np.full((12, 3, 3), [0.0, 0, 9])
        assert not sees_triangles(CAMERA, behind)
        behind[number] = [0, 0, 0], [1, 0, 0], [0, 1, 0]
        assert sees_triangles(CAMERA, behind)


def test_a_light_below_the_ground_is_warned_of():
    (warning,) = warnings_of(BALL, GROUND, lights=[{**LAMP, "position": [0, -3, 0]}])
    assert 'The light "lamp" and the camera are on different sides of the plane "ground"' in warning


def test_points_have_no_camera_that_a_plane_could_separate_from_a_light():
    camera = {"position": (0, 0, 5), "target": (0, 0, 0)}
    lights = [{**LAMP, "position": [0, -3, 0]}]
    described = {"camera": camera, "shapes": [BALL, GROUND], "lights": lights}
    assert check_scene(scene_from_dict(described), seen=False) == []


@pytest.mark.parametrize("two_sided", [False, True])
def test_a_camera_inside_of_a_mesh_with_one_side_is_warned_of(two_sided: bool):
    found = scene(type="box", min=[-1, -1, -1], max=[1, 1, 1], radius=None, subdivisions=None)
    found = replace(found, materials=tuple(replace(each, two_sided=two_sided) for each in found.materials))
    warnings = check_scene(found.with_camera(position=[0.3, 0.2, 0], target=[0, 0, 0]))
    assert any("whose material has one side, and sees its black back" in each for each in warnings) != two_sided
    assert check_scene(found.with_camera(position=[3, 2, 1], target=[0, 0, 0])) == []


def test_a_camera_inside_a_sphere_is_warned_of():
    inside = {"eye": (0.3, 0, 0), "target": (0, 0, 0)}
    (warning,) = warnings_of(BALL, **inside)
    assert 'The camera stands inside the sphere "ball" and sees nothing but its inside' in warning
    assert "flip_normals" in warning
    long = {**BALL, "transform": [{"scale": [1, 1, 4]}]}
    (warning,) = warnings_of(long, eye=(0, 0, 3.9))
    assert 'inside the sphere "ball"' in warning
    assert warnings_of(long, eye=(0, 0, 4.1)) == []
    # Rooms.
    assert warnings_of({**BALL, "flip_normals": True}, **inside) == []
    assert warnings_of({**BALL, "emission": {"radiance": 1, "two_sided": True}}, **inside) == []
    assert warnings_of(BOX, **inside) == []


@pytest.mark.parametrize(("shape", "eye"), [(BALL, (0.6, 0, 0.8)), (GROUND, (3, -2, 5))])
def test_a_camera_on_an_exact_surface_is_warned_of(shape: dict, eye: tuple):
    (warning,) = warnings_of(shape, eye=eye, target=(9, 9, 9))
    assert f'stands exactly on a surface, of the shape "{shape["name"]}"' in warning
    above = (1.001 * np.array(eye)).tolist() if shape is BALL else (3, -1.99, 5)
    assert warnings_of(shape, eye=above, target=(0, -0.5, 0)) == []


def test_a_material_that_gives_more_than_it_gets_is_warned_of():
    shiny = {"type": "phong", "reflectance": 0.7, "mirror": 0.5}
    (warning,) = warnings_of({**BALL, "material": "m"}, materials={"m": shiny})
    assert '"m" reflects more light than it receives: reflectance and mirror add up to 1.2' in warning
    # A dark texture makes room for the mirror; a white one does not.
    for brightest, count in ((0.5, 0), (0.9, 1)):
        textures = {"t": {"type": "checker", "colors": [0.1, brightest]}}
        textured = {**shiny, "texture": "t"}
        assert len(warnings_of({**BALL, "material": "m"}, materials={"m": textured}, textures=textures)) == count
    plain = {"texture": "t"}  # reflectance 1 times the texture
    assert warnings_of({**BALL, "material": "m"}, materials={"m": plain}, textures=textures) == []


# Spheres against the view of CAMERA: centre, radii along the axes.
SPHERES = {
    "in the middle": ((0, 0, 0), (1, 1, 1), True),
    "behind the camera": ((0, 0, 7), (1, 1, 1), False),
    "around the camera": ((0, 0, 7), (3, 3, 3), True),
    "reaching into view from above": ((0, 3, 0), (1.3, 1.3, 1.3), True),
    "staying above": ((0, 3, 0), (1.1, 1.1, 1.1), False),
    "reaching into a corner of view": ((3, 2.5, 0), (0.8, 0.8, 0.8), True),
    "passing a corner of view by": ((3, 2.5, 0), (0.6, 0.6, 0.6), False),
    "a disc across the view": ((0, 0, 0), (9, 9, 0.01), True),
    "a needle from behind": ((0, 0, 9), (0.01, 0.01, 4.5), True),
    "a needle that ends behind": ((0, 0, 9), (0.01, 0.01, 3.9), False),
    "a tall needle beside": ((4, 0, 0), (0.5, 9, 0.5), False),
}


@pytest.mark.parametrize("case", SPHERES)
@pytest.mark.parametrize("mirror", [1, -1])
def test_the_pyramid_of_view_meets_a_sphere_or_it_does_not(case: str, mirror: int):
    centre, radii, seen = SPHERES[case]
    steps = [{"scale": [mirror * radii[0], *radii[1:]]}, {"translate": centre}]
    shape = {**BALL, "transform": steps}
    data = {"camera": {"position": [0, 0, 5], "target": [0, 0, 0]}, "shapes": [shape]}
    assert sees_anything(replace(scene_from_dict(data), camera=CAMERA)) is seen


@settings(deadline=None, max_examples=80)
@given(
    st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(-6, 12)),
    st.tuples(st.floats(0.1, 4), st.floats(0.1, 4), st.floats(0.1, 4)),
    st.floats(0, 180),
)
def test_an_ellipsoid_is_in_view_where_a_fine_mesh_of_it_is(centre: tuple, radii: tuple, angle: float):
    steps = [{"scale": radii}, {"rotate": {"axis": [1, 2, 3], "angle": angle}}, {"translate": centre}]
    data = {
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
        "shapes": [{**BALL, "transform": steps, "subdivisions": 3}],
    }
    exact = replace(scene_from_dict(data), camera=CAMERA)

    def seen(factor: float) -> bool:
        matrix = exact.spheres * [factor, factor, factor, 1]
        ball = replace(exact.shapes[0], world_from_object=matrix)
        return sees_triangles(CAMERA, path_traceable(replace(exact, shapes=(ball,)), centred=False).triangles)

    larger, smaller = seen(1.02), seen(1.0)
    # The mesh lies inside; a little larger it lies outside.
    if smaller:
        assert sees_anything(exact)
    if not larger:
        assert not sees_anything(exact)


@pytest.mark.parametrize(
    ("normal", "point", "seen"),
    [
        ([0, 1, 0], [0, -2, 0], True),  # a ground
        ([0, -1, 0], [0, -2, 0], True),  # its back
        ([0, 0, 1], [0, 0, 0], True),  # a wall ahead
        ([0, 0, 1], [0, 0, 6], False),  # a wall behind
        ([1, 0, 0.1], [9, 0, 0], True),  # a wall beside, seen far away
        ([1, 0, 1], [0, 0, 6], False),  # behind, parallel to nothing in view
        ([1, 0, 0.3], [0, 0, 6], True),
    ],
)
def test_a_plane_is_in_view_when_a_ray_meets_it(normal: list, point: list, seen: bool):
    data = {
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0]},
        "shapes": [{"type": "plane", "normal": normal, "point": point}],
    }
    assert sees_anything(replace(scene_from_dict(data), camera=CAMERA)) is seen


# Triangles against the view of CAMERA, whose pyramid is 64 : 48 and opens 40 degrees upwards.
VIEWS = {
    "in the middle": ([[-0.1, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], True),
    "behind the camera": ([[-1, 0, 6], [1, 0, 6], [0, 1, 6]], False),
    "just before the eye": ([[-1e-6, 0, 4.999], [1e-6, 0, 4.999], [0, 1e-6, 4.999]], True),
    "so large that all corners are outside": ([[-100, -100, 0], [100, -100, 0], [0, 200, 0]], True),
    "large, from behind to before the camera": ([[0, -50, 100], [0, -50, -100], [0, 100, -100]], True),
    "a needle across the picture": ([[-50, 0, 0], [50, 0, 0], [50, 1e-3, 0]], True),
    "passing a corner of the picture by": ([[5.2, 0, 0], [5.2, 5.2, 0], [0, 5.2, 0]], False),
    "cutting a corner of the picture": ([[3.2, 0, 0], [3.2, 3.2, 0], [0, 3.2, 0]], True),
    "above": ([[-1, 3, 0], [1, 3, 0], [0, 4, 0]], False),
    "around the eye, beside the view": ([[-9, 5, 9], [9, 5, 9], [0, 5, 4]], False),
}


@pytest.mark.parametrize("case", VIEWS)
def test_the_pyramid_of_view_meets_a_triangle_or_it_does_not(case: str):
    corners, seen = VIEWS[case]
    assert sees_triangles(CAMERA, np.array([corners], float)) is seen


coordinate = st.floats(-8, 8).map(lambda x: round(x, 2))
point = st.tuples(coordinate, coordinate, coordinate)


@settings(deadline=None)
@given(st.tuples(point, point, point))
def test_a_triangle_of_which_a_point_is_in_view_is_seen(corners: tuple):
    triangle = np.array(corners)
    a, b = np.meshgrid(np.linspace(0, 1, 20), np.linspace(0, 1, 20))
    inside = (a + b) <= 1
    weights = np.stack([a[inside], b[inside], 1 - a[inside] - b[inside]], axis=1)
    right, up, forward = CAMERA.frame()
    x, y, z = ((weights @ triangle - CAMERA.position) @ axis for axis in (right, up, forward))
    half = np.tan(np.radians(20))
    visible = bool(np.any((np.abs(y) < half * z) & (np.abs(x) < half * z * 64 / 48)))
    if visible:
        assert sees_triangles(CAMERA, triangle[None])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"up": np.array([0.0, 0, 3])}, "camera.up is [0, 0, 3], parallel to the view"),
        ({"target": np.array([0.0, 0, 5])}, "camera.target is the same point"),
        ({"position": np.array([0.0, np.nan, 5])}, "camera.position is [0, nan, 5]"),
        ({"fov": 200.0}, "camera.fov is 200"),
        ({"resolution": (0, 4)}, "film.resolution is [0, 4]"),
    ],
)
def test_a_camera_changed_by_hand_is_checked_like_that_of_a_file(change: dict, message: str):
    check_camera(CAMERA, "room")
    with pytest.raises(SceneError) as error:
        check_camera(replace(CAMERA, **change), "room")
    assert str(error.value).startswith("room: ")
    assert message in str(error.value)


# --- the commands ---


def run(*arguments: str, code: int = 0) -> str:
    app = typer.Typer()
    scenes.register(app)
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == code, result.output
    return result.stdout


def test_validate_reports_every_file(tmp_path: Path):
    bad, dark = tmp_path / "bad.toml", tmp_path / "dark.toml"
    camera = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n"
    bad.write_text(camera + "[lamps]")
    dark.write_text(
        camera + '[[shapes]]\ntype = "mesh"\n'
        "vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 2, 0]]\nfaces = [[0, 1, 2], [0, 2, 3]]\n"
    )
    output = run("validate", str(bad), str(dark), "cornell-box", code=1)
    assert f"{bad}: lamps is not a field" in output
    assert f"{dark}: No shape emits light" in output
    assert f'{dark}: shapes[0] ("mesh-0"): dropped 1 of 2 triangles' in output
    assert output.splitlines()[-1].split() == ["ok", "cornell-box"]
    run("validate", str(dark))
    run("validate", "--strict", str(dark), code=1)


def test_validate_takes_parameters():
    assert "reflects all light" in run("validate", "furnace", "-D", "reflectance=1", "-D", "shape=sphere")
    assert "reflectance is" in run("validate", "furnace", "-D", "reflectance=2", code=1)


def test_what_validate_and_render_warn_of_is_the_same():
    assert load_scene("furnace", {"reflectance": 1}).materials[0].reflectance.tolist() == [1, 1, 1]
    assert check_scene(load_scene("furnace", {"reflectance": 1}))[0] in run(
        "validate", "furnace", "-D", "reflectance=1"
    )


def test_parts_in_view_before_a_plane_are_those_that_rays_find():
    rng = np.random.default_rng(7)
    rays = np.stack(np.meshgrid(*[np.linspace(-1, 1, 201)] * 2), axis=-1).reshape(-1, 2) * np.tan(np.radians(20))
    rays = np.column_stack([rays, -np.ones(len(rays))])
    found = []
    for _ in range(200):
        corners = rng.normal(size=(3, 3)) * [2, 2, 3] + [0, 0, 2]
        (triangle,) = (
            scene_from_dict(
                {
                    "camera": {"position": [0, 0, 5], "target": [0, 0, 0], "fov": 40},
                    "film": {"resolution": [8, 8]},
                    "shapes": [{"type": "mesh", "vertices": corners, "faces": [[0, 1, 2]]}],
                    "sky": {"zenith": 1.0},
                }
            ),
        )
        a, b, c = triangle.triangles[0] - triangle.camera.position
        normal = np.cross(b - a, c - a)
        with np.errstate(divide="ignore"):
            depth = (normal @ a) / (rays @ normal)
        points = depth[:, None] * rays
        within = np.all([np.cross(q - p, points - p) @ normal >= 0 for p, q in ((a, b), (b, c), (c, a))], axis=0)
        nearest = depth[within & (depth > 0)].min(initial=np.inf)
        if np.isfinite(nearest):
            found.append(nearest)
            assert sight.sees_nearer(triangle, 1.001 * nearest)
            assert not sight.sees_nearer(triangle, 0.8 * nearest)
        else:
            assert not sight.sees_anything(triangle) or depth[within].size == 0
    assert len(found) > 40


def test_spheres_in_view_before_a_plane_are_those_that_rays_find():
    """Rays meet an ellipsoid at the roots of a quadratic equation. Backs count, also around the camera."""
    rng = np.random.default_rng(8)
    rays = np.stack(np.meshgrid(*[np.linspace(-1, 1, 101)] * 2), axis=-1).reshape(-1, 2) * np.tan(np.radians(20))
    rays = np.column_stack([rays, -np.ones(len(rays))])
    camera = Camera(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 40.0, (8, 8))
    found, within = 0, 0
    for radius in np.repeat([0.1, 0.5, 2.0, 10.0], 50) * rng.uniform(0.5, 1.5, 200):
        matrix = radius * np.eye(3) * [1.0, 0.5, 2.0]
        centre = np.maximum(1, radius / 2) * rng.normal(size=3) * [2, 2, 3] + [0, 0, 2]
        ball = Shape("ball", "sphere", 0, np.column_stack([matrix, centre])[None])
        scene = Scene("ball", camera, Shapes([ball]), (Material("grey", np.full(3, 0.5)),))
        origin, directions = np.linalg.solve(matrix, camera.position - centre), np.linalg.solve(matrix, rays.T).T
        a, b, c = (directions**2).sum(axis=1), directions @ origin, origin @ origin - 1
        with np.errstate(invalid="ignore"):
            depths = (-b + np.sqrt(b * b - a * c) * [[-1], [1]]) / a
        nearest = depths[depths > 0].min(initial=np.inf)
        if np.isfinite(nearest):
            found, within = found + 1, within + (c < 0)
            assert sight.sees_nearer(scene, 1.001 * nearest)
            assert not sight.sees_nearer(scene, 0.9 * nearest)
    assert found > 40
    assert within > 5


def test_shapes_around_a_point_are_counted_once_not_once_per_shape(monkeypatch: pytest.MonkeyPatch):
    box = {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 1]}
    boxes = scene_from_dict(
        {"camera": {"position": [0, 0, 5], "target": [0, 0, 0]}, "shapes": [box] * 40, "ambient": 1}
    )
    calls = []
    are_many = sight._are_many
    monkeypatch.setattr(sight, "_are_many", lambda scene: calls.append(scene) or are_many(scene))
    assert sight.enclosing(boxes, np.zeros(3)).tolist() == [1] * 40
    assert len(calls) == 1
    assert sight.enclosing_spheres(boxes, np.zeros(3)).tolist() == [0] * 40
