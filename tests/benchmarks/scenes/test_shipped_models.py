"""The models that ship as .glb are what their programs make, and show what these show."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import glpath
from benchmarks.__main__ import app
from benchmarks.scenes.parlour import parlour
from benchmarks.scenes.room import room
from glpath.io import load_scene
from glpath.scene import Scene
from glpath.scene.material import Material
from glpath.system.files import shipped_folder
from tests.support.command_line import run

MADE: dict[str, Callable[[], Scene]] = {"room": room, "parlour": parlour}
SCENES = shipped_folder("scenes")
assert SCENES is not None

#: The last bits of sines are another processor's own. 1e-6 m is two steps of 32 bits at 7 m.
SAME = 1e-6


@pytest.fixture(scope="module", params=MADE)
def both(request: pytest.FixtureRequest) -> tuple[Scene, Scene]:
    """What a program makes, and what ships."""
    return MADE[request.param](), load_scene(request.param)


def corners(scene: Scene, values: np.ndarray) -> np.ndarray:
    return values[scene.shapes.faces]


def test_it_has_the_very_triangles_in_their_order(both: tuple[Scene, Scene]) -> None:
    made, shipped = both
    assert [f"{made.name}/{shape.name}" for shape in made.shapes] == [shape.name for shape in shipped.shapes]
    assert [shape.count for shape in made.shapes] == [shape.count for shape in shipped.shapes]
    np.testing.assert_allclose(shipped.triangles, made.triangles, rtol=0, atol=SAME)
    for name in ("vertex_normals", "vertex_uv"):
        ours, theirs = (corners(scene, getattr(scene.shapes, name)) for scene in both)
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=4 * SAME, err_msg=name)
    for shape, other in zip(made.shapes, shipped.shapes, strict=True):
        for key in ("uv", "normals"):
            assert (getattr(shape.geometry, key) is None) == (getattr(other.geometry, key) is None), shape.name


def test_it_has_the_very_materials_lamps_and_camera(both: tuple[Scene, Scene]) -> None:
    made, shipped = both
    for shape, other in zip(made.shapes, shipped.shapes, strict=True):
        # In 32 bits, as the device has it: the file has candela, which are watts again.
        np.testing.assert_array_equal(other.emission.astype(np.float32), shape.emission.astype(np.float32))
        assert not shape.emits or other.emission_two_sided == shape.emission_two_sided
        material, found = made.materials[shape.material], shipped.materials[other.material]
        assert found.name.removeprefix(f"{made.name}/").partition(" (")[0] == material.name
        for each in fields(Material):
            value, back = getattr(material, each.name), getattr(found, each.name)
            if each.name == "two_sided" and not material.thin:
                continue  # the back of solid glass is its inside, whatever it says
            if each.name.endswith("texture"):
                same_texture(made, value, shipped, back)
            elif each.name != "name":
                if each.name == "attenuation":  # by way of a colour in the file
                    value, back = value.astype(np.float32), back.astype(np.float32)
                np.testing.assert_array_equal(back, value, f"{material.name}: {each.name}")
    for each in fields(made.camera):
        np.testing.assert_array_equal(getattr(shipped.camera, each.name), getattr(made.camera, each.name))
    assert (shipped.unit, shipped.lights, shipped.sky) == (made.unit, made.lights, made.sky)


def same_texture(made: Scene, slot: object, shipped: Scene, other: object) -> None:
    if slot is None:
        assert other is None
        return
    np.testing.assert_array_equal(other.uv_transform, slot.uv_transform)
    a, b = made.textures[slot.texture], shipped.textures[other.texture]
    assert (a.name, a.srgb, a.filter, a.wrap, a.scale) == (b.name, b.srgb, b.filter, b.wrap, b.scale)
    assert np.abs(a.image.astype(int) - b.image).max() <= 1


def test_films_are_the_same_to_rounding() -> None:
    """Of the room, whose program has coordinates of 32 bits too: the bits, where the triangles have the same."""
    made, shipped = room(), load_scene("room")
    options = {"spp": 4, "max_depth": 3, "resolution": (24, 18)}
    first, second = (glpath.render(scene, **options).radiance_sums for scene in (made, shipped))
    if np.array_equal(made.triangles, shipped.triangles):
        np.testing.assert_array_equal(second, first)
    assert second.mean() == pytest.approx(first.mean(), rel=0.02)


def test_the_command_makes_the_file_that_ships_and_finer_ones(tmp_path: Path) -> None:
    runner = CliRunner()
    path = tmp_path / "room.glb"
    done = runner.invoke(app, ["scene", "room", "-o", str(path)])
    assert done.exit_code == 0, done.output
    shutil.copy(SCENES / "room.toml", tmp_path)
    again, shipped = load_scene(tmp_path / "room.toml"), load_scene("room")
    np.testing.assert_allclose(again.triangles, shipped.triangles, rtol=0, atol=SAME)
    assert runner.invoke(app, ["scene", "room", "--detail", "0.25", "-o", str(path)]).exit_code == 0
    assert len(load_scene(tmp_path / "room.toml").triangles) < 0.7 * len(shipped.triangles)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rom"], "allowed are helmet, parlour, room"),
        ([], "allowed are helmet, parlour, room"),
        (["parlour", "--detail", "2"], "--detail does not apply to parlour"),
        (["room", "--detail", "0.1"], "must be from 0.25 to 16"),
        (["room", "--detail", "nan"], "must be from 0.25 to 16"),
        (["room", "-o", "room.obj"], "is written as .glb"),
    ],
)
def test_what_the_command_cannot_do_it_says(arguments: list[str], message: str) -> None:
    result = CliRunner().invoke(app, ["scene", *arguments])
    assert result.exit_code == 2
    assert message in result.output


@pytest.mark.parametrize("name", MADE)
def test_a_shipped_model_opens_without_its_scene_file(name: str) -> None:
    """By its path, as any model: in candela, with its own camera and no warning."""
    model, scene = load_scene(SCENES / f"{name}.glb"), load_scene(name)
    assert model.unit == "photometric"
    np.testing.assert_allclose(model.camera.position, scene.camera.position, atol=1e-6)
    assert model.camera.fov == pytest.approx(scene.camera.fov)
    for shape, other in zip(scene.shapes, model.shapes, strict=True):
        np.testing.assert_allclose(other.emission, 179 * shape.emission, rtol=1e-12)


def test_a_film_of_the_room_goes_on_only_with_the_same_room(tmp_path: Path) -> None:
    """It is known by its content, wherever the files are: a model that was exchanged is another scene."""
    for file in ("room.toml", "room.glb"):
        shutil.copy(SCENES / file, tmp_path)
    options = ["--resolution", "16x16", "--max-depth", "1", "--quiet"]
    film = tmp_path / "film.npz"
    assert run("render", "room", "--spp", "1", "-o", str(film), *options).exit_code == 0
    copy = str(tmp_path / "room.toml")
    done = run("render", copy, "--spp", "2", "--resume", "-o", str(film), *options)
    assert done.exit_code == 0, done.output
    glpath.export(room(0.25), tmp_path / "room.glb")
    done = run("render", copy, "--spp", "3", "--resume", "-o", str(film), *options)
    assert done.exit_code != 0
    assert "scene" in done.output
