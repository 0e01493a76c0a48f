"""What "auto" is: chosen by the scene and the options alone, stored in the job, and taken by every call."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.settings import DEEPEST, IntegratorSettings
from glpath.integrators.whitted_settings import TBufferSettings
from glpath.rendering import RenderJob, choice
from glpath.rendering.choice import for_measuring
from glpath.scene import Scene
from glpath.scene.emitted import emitted_radiance
from glpath.sensors.sensor import PointSensor
from tests.support.terrain import Hills

BOX = "cornell-box-36"
LAMP = {
    "type": "quad",
    "corners": [[-1, 3, -1], [1, 3, -1], [1, 3, 1], [-1, 3, 1]],
    "emission": {"radiance": 10},
    "material": "grey",
}
FLOOR = {
    "type": "quad",
    "corners": [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]],
    "name": "floor",
    "material": "grey",
}
#: Of pictures that are no thumbnails.
SMALLEST = (97, 96)
SHINY = {"type": "phong", "reflectance": 0.5, "specular": 0.2, "exponent": 20}
POINT = {"type": "point", "position": [0, 2, 0], "intensity": 1}
#: Paths of all bounces: guided where the scene can be solved.
GATHERED = GatherSettings(or_path=True)
UNGUIDED, GUIDED = (PathSettings(guide=guide, roulette=4) for guide in ("cosine", "solution"))


def scene(*shapes: dict[str, Any], material: dict[str, Any] | None = None, **more: Any) -> Scene:
    return glpath.load_scene(
        {
            "camera": {"position": [0, 2, 6], "target": [0, 1, 0], "fov": 45},
            "film": {"resolution": [128, 128]},
            "materials": {"grey": material or {"reflectance": 0.5}},
            "shapes": [*(shapes or (LAMP, FLOOR))],
            **more,
        }
    )


def of(scene: Any, **options: Any) -> IntegratorSettings:
    return RenderJob.of(scene, **options).integrator


@pytest.mark.parametrize("shipped", ["cornell-box", BOX, "room"])
def test_a_scene_that_can_be_solved_is_gathered(shipped: str) -> None:
    job = RenderJob.of(shipped)
    assert job.integrator == GATHERED
    assert job.path_sets == (0, GatherSettings.default_spp) == (0, 64)


@pytest.mark.parametrize(
    ("shapes", "more"),
    [
        ((LAMP, FLOOR), {"material": SHINY}),
        ((FLOOR,), {"sky": {"zenith": 0, "horizon": 0}}),
        ((FLOOR,), {"material": {"reflectance": 0}, "lights": [POINT]}),
    ],
    ids=["specular", "dark", "black"],
)
@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
def test_other_scenes_are_path_traced(shapes: tuple[dict[str, Any], ...], more: dict[str, Any]) -> None:
    assert of(scene(*shapes, **more)) == UNGUIDED
    assert of(scene()) == GATHERED, "the same but for that"


@pytest.mark.parametrize(("camera", "free"), [([0, 2, 6], True), ([0, 1, 0], False)])
def test_what_stands_free_under_a_sky_is_path_traced_without_a_solution(camera: list[float], free: bool) -> None:
    """What the camera is in has light of many bounces, for which a solution pays."""
    walls = {**FLOOR, "corners": [[-2, 3, -2], [2, 3, -2], [2, 0, -2], [-2, 0, -2]], "name": "wall"}
    seen = scene(FLOOR, walls, sky={"zenith": 1.0}, camera={"position": camera, "target": [0, 1, -1], "fov": 45})
    assert isinstance(of(seen), PathSettings) == free
    moving = {"position": [0, 2, 6] if not free else [0, 1, 0], "motion": [{"time": 0, "position": camera}]}
    seen = scene(FLOOR, walls, sky={"zenith": 1.0}, camera={**moving, "target": [0, 1, -1]})
    assert isinstance(of(seen), PathSettings) == free
    lit = scene(FLOOR, LAMP, sky={"zenith": 1.0})
    assert isinstance(of(lit), GatherSettings)


@pytest.mark.parametrize(("emission", "free"), [(0.05, True), (20.0, False)])
def test_what_glows_faintly_under_a_sky_stands_free_all_the_same(emission: float, free: bool) -> None:
    """A helmet with diodes on it: a solution took ten times as long as the picture."""
    screen = {**LAMP, "emission": {"radiance": emission}}
    seen = scene(FLOOR, screen, sky={"zenith": 1.0}, camera={"position": [0, 2, 6], "target": [0, 1, 0], "fov": 45})
    assert isinstance(of(seen), PathSettings) == free


def test_the_light_of_a_plate_on_the_box_around_it() -> None:
    """A plate of 1 x 1 of radiance 3 in a box of 2 x 2 x 2: a 24th of the radiance, both ways twice as much."""
    crossing = {**FLOOR, "corners": [[-1, -1, -1], [1, -1, -1], [1, 1, 1], [-1, 1, 1]]}
    plate = {**LAMP, "corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}
    seen = scene(crossing, {**plate, "emission": {"radiance": 3.0}})
    assert emitted_radiance(seen) == pytest.approx(3 / 24)
    both = scene(crossing, {**plate, "emission": {"radiance": 3.0, "two_sided": True}})
    assert emitted_radiance(both) == pytest.approx(6 / 24)
    assert emitted_radiance(seen, lambda shape: False) == 0


def test_what_moves_while_the_shutter_is_open_is_path_traced() -> None:
    motion = [{"time": 0.0}, {"time": 1.0, "transform": [{"translate": [1, 0, 0]}]}]
    moving = scene(LAMP, {**FLOOR, "motion": motion})
    assert of(moving) == GATHERED
    assert of(moving, camera={"shutter": (0.0, 1.0)}) == GUIDED  # by the solution of one moment


def test_a_scene_of_too_many_triangles_is_path_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    box = scene()
    monkeypatch.setattr(choice, "MAX_TRIANGLES", 4)
    assert of(box) == GATHERED
    monkeypatch.setattr(choice, "MAX_TRIANGLES", 3)
    # The solver and its libraries are not imported for it.
    monkeypatch.setitem(sys.modules, "glpath.radiosity.solvers.checks", None)
    assert of(box) == UNGUIDED


def test_a_scene_is_not_solved_to_see_whether_it_can_be_where_that_decides_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def costly(scene: Scene) -> bool:
        raise AssertionError("nobody asked")

    monkeypatch.setattr(choice, "_solvable", costly)
    assert of(BOX, max_depth=3) == PathSettings(max_depth=3, guide="cosine")
    assert of(BOX, integrator="gather") == GatherSettings()
    assert of(BOX, integrator="path-buffer") == PathBufferSettings(roulette=4)
    assert of(BOX, integrator="path", guide="cosine") == UNGUIDED


def test_ambient_light_stands_for_bounces_that_are_not_traced() -> None:
    lit = scene(ambient=0.1)
    assert of(lit) == PathSettings(max_depth=5, guide="cosine")
    assert of(lit, integrator="path-buffer") == PathBufferSettings(max_depth=5)
    assert of(lit, max_depth=DEEPEST) == GUIDED
    assert of(BOX, ambient=0.1) == replace(GUIDED, ambient=(0.1,) * 3)


def test_streams_and_planes_have_the_one_engine_that_knows_them() -> None:
    streamed = scene(LAMP, {"type": "stream", "stream": Hills(1, 2), "material": "grey"})
    assert of(streamed) == PathBufferSettings(roulette=4)
    plane = {"type": "plane", "point": [0, -1, 0], "normal": [0, 1, 0], "material": "grey"}
    both = scene(LAMP, {"type": "stream", "stream": Hills(1, 2), "material": "grey"}, plane)
    assert of(both) == TBufferSettings()
    assert of("three-spheres") == TBufferSettings()
    assert of("three-spheres", shadows="cube") == TBufferSettings(shadows="cube")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"max_depth": 3}, PathSettings(max_depth=3, guide="cosine")),
        ({"roulette": 2}, PathSettings(roulette=2, guide="solution")),
        ({"lookup_depth": 3}, GatherSettings(lookup_depth=3)),
        (
            {"cast": "path-buffer", "light_resolution": 64},
            GatherSettings(cast="path-buffer", light_resolution=64),
        ),
        ({"directions": "sphere"}, PathBufferSettings(directions="sphere", roulette=4)),
        ({"directions": "sphere", "max_depth": 2}, PathBufferSettings(directions="sphere", max_depth=2)),
        ({"bounce_lod": 0.5}, PathBufferSettings(bounce_lod=0.5, roulette=4)),
        ({"shadows": "cube"}, TBufferSettings(shadows="cube")),
        ({"count_tests": True}, TBufferSettings(count_tests=True)),
        ({"count_tests": False}, GATHERED),
        (
            {"seed": 3, "guide": "cosine", "aovs": "depth"},
            replace(GATHERED, seed=3, guide="cosine", aovs=("depth",)),
        ),
    ],
)
def test_an_option_that_one_integrator_has_chooses_it(options: Any, expected: IntegratorSettings) -> None:
    assert of(BOX, **options) == expected


@pytest.mark.parametrize(("resolution", "expected"), [((96, 96), UNGUIDED), (SMALLEST, GATHERED)])
def test_a_thumbnail_is_there_before_a_solver_is_loaded(
    resolution: tuple[int, int], expected: IntegratorSettings
) -> None:
    assert of(BOX, resolution=resolution) == expected
    assert of(BOX, resolution=(512, 512), crop=(0, 0, 8, 8)) == GATHERED, "a part of a picture"
    assert of(BOX, resolution=resolution, lookup_depth=3) == GatherSettings(lookup_depth=3)


def test_an_option_of_the_gather_is_the_gathers_where_it_cannot_be_had() -> None:
    """The error is that of what was asked for, and not of an integrator that nobody named."""
    assert of(scene(ambient=0.1), lookup_depth=3) == GatherSettings(lookup_depth=3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"lookup_depth": 3, "max_depth": 4},
            'lookup_depth: 3 with the integrator "path"; it is an option of "gather"',
        ),
        (
            {"branches": 3, "cast": "path-buffer"},
            'branches: 3 with cast "path-buffer"; it is an option of cast "bvh"',
        ),
        ({"max_depht": 3}, "max_depht: no option has this name"),
    ],
)
def test_options_that_no_integrator_has_together_are_an_error(options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.UsageError) as caught:
        of(BOX, **options)
    assert words in caught.value.message


def test_paths_of_all_bounces_are_guided_where_the_scene_can_be_solved() -> None:
    assert of(BOX, integrator="path") == GUIDED
    assert of(BOX, integrator=PathSettings(seed=4)) == replace(GUIDED, seed=4)
    assert of(BOX, integrator="path", roulette=9) == replace(GUIDED, roulette=9)
    assert of(BOX, integrator="path", max_depth=999) == PathSettings(max_depth=999, guide="cosine")
    assert of(BOX, integrator="path", max_depth=3, guide="solution") == PathSettings(max_depth=3, guide="solution")
    assert of(scene(material=SHINY), integrator="path") == UNGUIDED


def test_points_are_lit_by_what_is_chosen_likewise() -> None:
    sensor = PointSensor.of(np.zeros((1, 1, 3)), np.array([[[0.0, 1.0, 0.0]]]))
    assert of(BOX, sensor=sensor) == GATHERED
    assert of(BOX, sensor=sensor, max_depth=2) == PathSettings(max_depth=2, guide="cosine")


@pytest.mark.parametrize("options", [{}, {"integrator": "path"}, {"max_depth": 2}])
def test_a_job_and_its_film_have_what_was_chosen(options: dict[str, Any]) -> None:
    size: dict[str, Any] = {"spp": 1, "resolution": SMALLEST}
    job = RenderJob.of(BOX, **options, **size)
    assert RenderJob.from_json(job.to_json()) == job
    chosen = job.integrator
    by_name = RenderJob.of(BOX, **options | {"integrator": chosen.integrator}, **size)
    # A gather that is asked for by its name is never replaced by paths.
    named = replace(chosen, or_path=False) if isinstance(chosen, GatherSettings) else chosen
    assert by_name == replace(job, integrator=named)
    film = glpath.render(BOX, **options, **size)
    assert film.metadata.integrator == chosen.integrator
    assert film.metadata.max_depth == (2 if options == {"max_depth": 2} else None)
    assert film.metadata.settings.get("guide") == (None if options == {"max_depth": 2} else "solution")


def test_the_choice_is_the_same_whatever_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes = [BOX, "three-spheres", scene(ambient=0.1)]
    jobs = [RenderJob.of(scene) for scene in scenes]
    for package in ("pyoidn", "xatlas", "imageio_ffmpeg"):
        monkeypatch.setitem(sys.modules, package, None)
    assert [RenderJob.of(scene) for scene in scenes] == jobs


def test_frames_are_of_the_integrator_that_is_chosen_for_the_first() -> None:
    size: dict[str, Any] = {"spp": 1, "resolution": SMALLEST}
    for shipped, chosen in ((BOX, "gather"), ("three-spheres", "t-buffer")):
        (film,) = glpath.render_frames(shipped, [{}], **size)
        assert film.metadata.integrator == chosen


def test_what_is_measured_has_no_bias_by_default() -> None:
    streamed = scene(LAMP, {"type": "stream", "stream": Hills(1, 2), "material": "grey"})
    box = glpath.load_scene(BOX)
    assert for_measuring({}, box) == "path"
    assert for_measuring({}, streamed) == "path-buffer"
    assert for_measuring({"guide": None, "max_depth": 3}, streamed) == "path-buffer"
    assert for_measuring({"directions": "sphere"}, box) == "path-buffer"
    assert for_measuring({"lookup_depth": 2}, box) == "gather"
    assert for_measuring({"cast": "path-buffer"}, streamed) == "gather"
