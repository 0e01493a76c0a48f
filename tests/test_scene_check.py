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
from glpath.scene import Camera, Scene, check_camera, check_scene, load_scene, scene_from_dict
from glpath.scene.check import sees_triangles

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
