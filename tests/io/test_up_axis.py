"""The up axis of files whose format does not fix it: guessed with evidence, said, and chosen by the user."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import glpath
from glpath.cli.main import app
from glpath.io.library import scene_parameters
from glpath.io.up_axis import evidence_for_z
from glpath.scene.camera import framing, upright_from_world
from glpath.scene.model import Float64, Scene, Shapes
from tests.support.gltf_files import Gltf

pytestmark = pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
UP = {"y": [0, 1, 0], "z": [0, 0, 1]}
#: Turns what has z up to have y up.
TO_Y = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])


def city(ground: str = "front") -> trimesh.Trimesh:
    """Forty houses with z up, on a ground that shows its front or its back, or on none."""
    rng = np.random.default_rng(1)
    parts = []
    for _ in range(40):
        size = rng.uniform([10, 10, 10], [30, 30, 60])
        house = trimesh.creation.box(size)
        house.apply_translation([*rng.uniform(-200, 200, 2), size[2] / 2])
        parts.append(house)
    corners = np.array([[-250, -250, 0], [250, -250, 0], [250, 250, 0], [-250, 250, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    if ground != "none":
        faces = faces if ground == "front" else faces[:, ::-1]
        parts.append(trimesh.Trimesh(corners, faces, process=False))
    return trimesh.util.concatenate(parts)


def terrain() -> trimesh.Trimesh:
    x, y = np.meshgrid(np.linspace(0, 100, 60), np.linspace(0, 80, 50))
    z = 5 * np.sin(x / 9) * np.cos(y / 11)
    first = np.arange(49 * 60).reshape(49, 60)[:, :-1].ravel()
    faces = [np.stack([first, first + 1, first + 61], 1), np.stack([first, first + 61, first + 60], 1)]
    return trimesh.Trimesh(np.stack([x, y, z], -1).reshape(-1, 3), np.concatenate(faces), process=False)


def pawn() -> trimesh.Trimesh:
    return trimesh.creation.revolve([[0, 0], [8, 0], [8, 2], [3, 6], [3, 14], [5, 16], [0, 22]], sections=40)


def loaded(path: Path, **parameters: object) -> tuple[Scene, str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = glpath.load_scene(path, parameters)
    return scene, "\n".join(str(each.message) for each in caught)


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize(
    ("thing", "suffixes", "evidence"),
    [
        (city(), "obj ply stl off", "a ground at z = 0 lies below all else"),
        (city("back"), "obj ply stl off", "a ground at z = 0 lies below all else"),
        (city("none"), "ply stl", "high along z, but"),
        (terrain(), "obj ply stl off", "its surface faces z nearly everywhere"),
        (pawn(), "ply stl", "it stands on a flat base at z = 0"),
    ],
    ids=["city", "ground from below", "houses", "terrain", "pawn"],
)
def test_what_has_z_up_is_seen_so_and_what_has_y_up_stays(
    up: str, thing: trimesh.Trimesh, suffixes: str, evidence: str, tmp_path: Path
) -> None:
    for suffix in suffixes.split():
        path = tmp_path / f"thing.{suffix}"
        (thing if up == "z" else thing.copy().apply_transform(TO_Y)).export(path)
        scene, said = loaded(path)
        assert scene.camera.up.tolist() == UP[up], suffix
        assert scene.sky is not None
        assert scene.sky.up.tolist() == UP[up], "the studio stands as the camera does"
        assert said.count("no camera") == 1
        assert (f"with z up (a guess, as {evidence}" in said or (up == "z" and evidence in said)) == (up == "z")
        assert ("-D up=y if y is up" in said) == (up == "z")


@pytest.mark.parametrize(
    "thing",
    [
        trimesh.creation.box([1, 1, 1]),
        trimesh.creation.box([4, 6, 1]),  # a screen, or a print that lies
        trimesh.creation.box([100, 60, 30]),
        trimesh.creation.icosphere(),
        trimesh.creation.capsule(height=3, radius=1),
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False),
    ],
    ids=["cube", "panel", "block", "ball", "capsule", "square"],
)
@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off"])
def test_without_evidence_y_is_up(thing: trimesh.Trimesh, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"thing.{suffix}"
    thing.export(path)
    scene, said = loaded(path)
    assert scene.camera.up.tolist() == UP["y"]
    assert "a guess" not in said


@pytest.mark.parametrize("axis", ["x", "y", "z", "-x", "-y", "-z"])
def test_the_axis_that_was_asked_for_is_up_and_the_picture_is_the_same(axis: str, tmp_path: Path) -> None:
    """A thing that is turned to have an axis up is seen as it is with y up: the camera turns with it."""
    turn = upright_from_world({"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}[axis[-1]] * np.array(1))
    if axis[0] == "-":
        turn = upright_from_world(-np.array({"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}[axis[-1]]))
    upright = pawn().apply_transform(TO_Y)
    turned = upright.copy()
    turned.vertices = upright.vertices @ turn
    for name, thing in (("a", upright), ("b", turned)):
        thing.export(tmp_path / f"{name}.ply")
    expected, _ = loaded(tmp_path / "a.ply", up="y")
    scene, said = loaded(tmp_path / "b.ply", up=axis)
    assert "a guess" not in said
    np.testing.assert_allclose(turn @ scene.camera.position, expected.camera.position, rtol=1e-4, atol=1e-4)
    at, _ = scene.camera.project(scene.triangles)
    np.testing.assert_allclose(at, expected.camera.project(expected.triangles)[0], atol=0.05)
    assert scene.background is not None
    assert expected.background is not None
    assert scene.background.ground is not None
    assert expected.background.ground is not None
    below = scene.background.up @ scene.background.ground
    assert below == pytest.approx(expected.background.up @ expected.background.ground, abs=1e-4)


def test_evidence_takes_one_pass_over_the_triangles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    city().export(tmp_path / "a.ply")
    scene, _ = loaded(tmp_path / "a.ply", up="y")
    passes: list[int] = []
    triangles_of = Shapes.triangles_of

    def counted(shapes: Shapes, index: int) -> Iterator[Float64]:
        passes.append(index)
        return triangles_of(shapes, index)

    monkeypatch.setattr(Shapes, "triangles_of", counted)
    assert evidence_for_z(scene, lying=True) == "a ground at z = 0 lies below all else"
    assert passes == list(range(len(scene.shapes)))


@pytest.mark.parametrize("value", ["w", "+z", "0,0,1"])
def test_an_axis_that_is_none_is_an_error_that_lists_them(value: str, tmp_path: Path) -> None:
    pawn().export(tmp_path / "a.ply")
    (tmp_path / "a.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    for name in ("a.ply", "a.xml"):
        with pytest.raises(glpath.SceneError, match=r"up is .*must be .*x, y, z, -x, -y(,| or) -z"):
            glpath.load_scene(tmp_path / name, {"up": value})


def test_gltf_has_y_up_by_its_specification(tmp_path: Path) -> None:
    whole = city()
    file = Gltf()
    file.node(mesh=file.mesh(whole.vertices, whole.faces.ravel()))
    path = file.write(tmp_path)
    scene, said = loaded(path)
    assert scene.camera.up.tolist() == UP["y"]
    assert "a guess" not in said
    with pytest.raises(glpath.SceneError, match="no parameter `up`"):
        glpath.load_scene(path, {"up": "z"})


CITY_XML = """<scene version="3.0.0">
  {before}
  <shape type="ply"><string name="filename" value="city.ply"/></shape>
</scene>"""
SENSOR = '<sensor type="perspective"><float name="fov" value="40"/></sensor>'


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_city_of_mitsubas_without_a_sensor_stands(up: str, tmp_path: Path) -> None:
    """As those of Sionna, which Blender exports with z up."""
    (city() if up == "z" else city().apply_transform(TO_Y)).export(tmp_path / "city.ply")
    path = tmp_path / "city.xml"
    path.write_text(CITY_XML.format(before=""))
    assert loaded(path)[0].camera.up.tolist() == UP[up]
    assert loaded(path, up="y")[0].camera.up.tolist() == UP["y"]
    assert "up" in scene_parameters(str(path))


def test_a_file_of_mitsubas_with_a_camera_or_a_parameter_up_keeps_them(tmp_path: Path) -> None:
    city().export(tmp_path / "city.ply")
    path = tmp_path / "city.xml"
    path.write_text(CITY_XML.format(before=SENSOR))
    assert scene_parameters(str(path)) == {}
    with pytest.raises(glpath.SceneError, match=r"(?s)up is for files without a camera.*`to_world`"):
        glpath.load_scene(path, {"up": "z"})
    path.write_text(CITY_XML.format(before='<default name="up" value="3"/>'))
    assert scene_parameters(str(path))["up"] == ("3", "as the file has it")
    assert glpath.load_scene(path, {"up": "7"}).camera.up.tolist() == UP["z"]


def test_camera_up_reframes_the_camera_that_was_set(tmp_path: Path) -> None:
    """As if the axis had been asked for, in Python and by the command."""
    pawn().apply_transform(TO_Y).export(tmp_path / "a.obj")
    expected, _ = loaded(tmp_path / "a.obj", up="z")
    scene, _ = loaded(tmp_path / "a.obj")
    turned = scene.with_camera(up=(0, 0, 1))
    np.testing.assert_allclose(turned.camera.position, expected.camera.position)
    assert turned.digest() == expected.digest(), "the studio and the ground have turned, too"
    assert turned.with_camera(resolution=(40, 20)).camera.up.tolist() == UP["z"]
    stands = scene.with_camera(up=(0, 0, 1), position=(1, 2, 30))
    assert stands.camera.position.tolist() == [1, 2, 30]
    slanted = scene.with_camera(up=(0, 1, 1)).camera
    at, depth = slanted.project(scene.triangles)
    assert (depth > 0).all()
    assert ((at > 0) & (at < 512)).all()
    own = scene.with_camera(position=(1, 2, 30))
    assert own.with_camera(up=(0, 0, 1)).camera.position.tolist() == [1, 2, 30], "one of its own stays"


def test_framing_turns_with_up() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3)) * [3, 1, 2]
    straight = framing(points, (64, 48))
    for up in ([0, 0, 2.5], [1, 0, 0], [0, -1, 0], [1, 2, 3]):
        turn = upright_from_world(up)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1)
        np.testing.assert_allclose(turn @ up / np.linalg.norm(up), [0, 1, 0], atol=1e-12)
        found = framing(points @ turn, (64, 48), up)
        np.testing.assert_allclose(found.project(points @ turn)[0], straight.project(points)[0], atol=1e-9)


@pytest.mark.parametrize("option", ["--camera-position=0,0,30", "--camera-up=0,0,1", "--camera-target=0,1,0"])
def test_a_warning_names_no_camera_that_is_not_used(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    city().export("a.obj")
    lines = [
        CliRunner().invoke(app, ["render", "a.obj", "-o", "a.png", "--resolution", "8x8", "--spp", "1", *more])
        for more in ([], [option])
    ]
    assert [line.exit_code for line in lines] == [0, 0], lines[1].output
    assert "one was set" in lines[0].stderr
    assert "one was set" not in lines[1].stderr
    assert "no light, so a studio lights it" in lines[1].stderr


def asset(folder: Path, up: str, **other: str) -> dict[str, object]:
    pawn().export(folder / "pawn.ply")
    return {
        "camera": {"position": [0, 5, 50], "target": [0, 5, 0]},
        "sky": {"zenith": 1.0, "horizon": 1.0},
        "assets": [{"file": str(folder / "pawn.ply"), "up": up, **other}],
    }


def test_an_asset_is_turned_to_have_y_up(tmp_path: Path) -> None:
    lower, upper = glpath.load_scene(asset(tmp_path, "z")).bounds
    np.testing.assert_allclose([lower, upper], [[-8, 0, -8], [8, 22, 8]], atol=1e-5)
    (tmp_path / "a.gltf").write_text("{}")
    with pytest.raises(glpath.SceneError, match=r"(?s)up.{0,2} is for formats.*glTF, which has y up"):
        glpath.load_scene({**asset(tmp_path, "z"), "assets": [{"file": str(tmp_path / "a.gltf"), "up": "z"}]})


ROOM = """
[[shapes]]
type = "quad"
corners = {corners}
[[shapes]]
type = "sphere"
radius = 1
center = {centre}
[[lights]]
type = "point"
position = [1, 2, 30]
intensity = 100
{more}
"""
FLOOR = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]


def test_a_scene_file_without_a_camera_gets_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path("room.toml")
    path.write_text(ROOM.format(corners=FLOOR, centre=[0, 0, 1], more="[film]\nresolution = [30, 20]"))
    scene, said = loaded(path)
    assert said.count("no camera") == 1
    assert scene.camera.resolution == (30, 20)
    assert scene.sky is None, "it has light"
    at, depth = scene.camera.project(scene.triangles)
    assert (depth > 0).all()
    assert ((at > 0) & (at < [30, 20])).all()
    assert loaded(path, up="z")[0].camera.up.tolist() == UP["z"]
    done = CliRunner().invoke(app, ["render", "room.toml", "-o", "a.png", "--spp", "1"])
    assert done.exit_code == 0, done.output
    assert Path("a.png").exists()


def test_a_scene_file_without_a_camera_has_the_up_of_its_sky(tmp_path: Path) -> None:
    path = tmp_path / "room.toml"
    path.write_text(
        ROOM.format(corners=FLOOR, centre=[0, 0, 1], more="[sky]\nzenith = 1.0\nhorizon = 1.0\nup = [0, 0, 1]")
    )
    assert loaded(path)[0].camera.up.tolist() == UP["z"]
    path.write_text(
        "camera = { position = [0, 1, 4], target = [0, 0, 0] }\n"
        + ROOM.format(corners=FLOOR, centre=[0, 0, 1], more="")
    )
    with pytest.raises(glpath.SceneError, match=r"(?s)up is for files without a camera.*`up` in"):
        glpath.load_scene(path, {"up": "z"})


def room(window: bool = False) -> trimesh.Trimesh:
    """4 x 3 x 6, y up, its fronts inwards, a table in it; with a window, a sixth of a wall is open."""
    walls = trimesh.creation.box([4, 3, 6])
    walls.invert()
    if window:
        walls = walls.subdivide().subdivide()
        walls.update_faces(np.arange(len(walls.faces)) >= 5)
    table = trimesh.creation.box([1, 1, 1])
    table.apply_translation([0, -1, 0])
    return trimesh.util.concatenate([walls, table])


@pytest.mark.parametrize("window", [False, True])
def test_a_room_whose_fronts_face_inwards_is_seen_from_inside(window: bool, tmp_path: Path) -> None:
    path = tmp_path / "room.ply"
    room(window).export(path)
    scene, said = loaded(path, up="y")
    assert "one was set inside, as its walls face inwards: position" in said
    assert (np.abs(scene.camera.position) < [2, 1.5, 3]).all()
    assert (scene.camera.target - scene.camera.position) @ (0 - scene.camera.position) > 0
    assert loaded(path, up="z")[0].camera.up.tolist() == UP["z"]
    assert (np.abs(loaded(path, up="z")[0].camera.position) < [2, 1.5, 3]).all()


def test_a_body_and_an_open_shell_are_seen_from_outside(tmp_path: Path) -> None:
    solid = trimesh.creation.box([4, 3, 6])
    thick = solid.copy()
    inner = trimesh.creation.box([3.8, 2.8, 5.8])
    inner.invert()
    half = inner.copy()
    half.update_faces(half.triangles_center[:, 1] < 1)
    half.update_faces(half.triangles_center[:, 2] < 2)
    for thing in (solid, trimesh.util.concatenate([thick, inner]), half):
        thing.export(tmp_path / "thing.ply")
        scene, _ = loaded(tmp_path / "thing.ply", up="y")
        assert scene.camera.position[2] > 3
