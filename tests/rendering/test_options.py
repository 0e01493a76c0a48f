"""An option is written once, in its integrator's settings: whoever shows, checks or stores it has it from there."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
import pytest
import typer
from msgspec import Meta
from typer.main import get_command
from typer.testing import CliRunner

import glpath
from glpath.cli import render as render_cli
from glpath.cli.main import app
from glpath.cli.run_request import OF_DAYLIGHT, OF_FILMS, OF_MATRICES, OF_RENDERS, OF_SOLVERS
from glpath.cli.scene import seen
from glpath.cli.signals import signals_wait_for_results
from glpath.cli.typed import as_option
from glpath.errors import argument, notation
from glpath.integrators.by_name import INTEGRATORS, IntegratorKeywords
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.whitted_settings import TBufferSettings
from glpath.rendering import RenderJob
from glpath.rendering.calls import render
from glpath.rendering.job import with_overrides
from glpath.rendering.options import annotation_of, checked, options, settings_of, with_options
from glpath.rendering.points import lit
from glpath.rendering.run_options import RunKeywords, RunOptions
from glpath.sensors.sensor import CameraSensor
from glpath.system.vectors import vector

BOX = "cornell-box-36"


@dataclass(frozen=True)
class Foggy(PathSettings):
    """The path tracer with two options more."""

    fog: Annotated[float, Meta(ge=0, le=2, description="how thick the fog is, per scene unit")] = 0.25
    weather: Annotated[Literal["calm", "storm"], Meta(description="what blows it about")] = "calm"


@pytest.fixture
def foggy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(INTEGRATORS, "path", Foggy)


@pytest.mark.usefixtures("foggy")
def test_a_new_option_is_a_parameter_and_a_line_of_the_help() -> None:
    @with_options()
    def call(scene: str, **options: Any) -> None:
        """Do it.

        {options}
        """

    parameter = inspect.signature(call).parameters["fog"]
    assert (parameter.kind, parameter.default) == (inspect.Parameter.KEYWORD_ONLY, None)
    assert parameter.annotation == float | None
    assert inspect.signature(call).parameters["weather"].annotation == Literal["calm", "storm"] | None
    text = inspect.getdoc(call)
    assert text is not None
    after = text.split('Of "path" only:')[1]
    assert "\nfog            : how thick the fog is, per scene unit; default 0.25" in after
    assert '\nweather        : what blows it about; default "calm"' in after


@pytest.mark.usefixtures("foggy")
def test_a_new_option_is_on_the_command_line(tmp_path: Any) -> None:
    app = typer.Typer()
    app.callback()(lambda: None)
    render_cli.register(app)
    shown = CliRunner().invoke(app, ["render", "--help-all"], env={"COLUMNS": "200"}).output
    assert "How thick the fog is, per scene unit; default 0.25." in shown
    assert "calm|storm" in shown
    for arguments, message in (
        (["--fog", "3"], "--fog 3.0: must be at most 2"),
        (["--weather", "mild"], "--weather mild: there is no such choice. Allowed: calm, storm."),
    ):
        result = CliRunner().invoke(app, ["render", BOX, "-o", str(tmp_path / "a.png"), *arguments])
        assert isinstance(result.exception, glpath.UsageError)
        assert message in str(result.exception)
    out = tmp_path / "a.npz"
    given = ["--fog", "0.5", "--spp", "1", "--max-depth", "1", "--resolution", "8x8", "-q"]
    with signals_wait_for_results():
        result = CliRunner().invoke(app, ["render", BOX, "-o", str(out), *given])
    assert result.exit_code == 0, result.output
    assert glpath.Film.load(out).metadata.settings["fog"] == 0.5


@pytest.mark.usefixtures("foggy")
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"fog": -1}, "fog: -1 where a number from 0 to 2 is needed"),
        ({"fog": "thick"}, "fog: 'thick' where a finite number is needed"),
        ({"weather": "mild"}, "weather: 'mild'; allowed are calm, storm"),
        (
            {"fog": 1.0, "integrator": "classic"},
            'fog: 1.0 with the integrator "classic"; it is an option of "path"',
        ),
    ],
)
def test_a_new_option_is_checked(given: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.UsageError) as caught:
        glpath.render(BOX, **given)
    assert words in str(caught.value)


@pytest.mark.usefixtures("foggy")
def test_a_new_option_is_in_a_film_and_in_a_job() -> None:
    film = glpath.render(BOX, fog=1, spp=1, max_depth=1, resolution=(8, 8))
    assert film.metadata.settings["fog"] == 1
    other = glpath.render(BOX, spp=1, first_path_set=1, max_depth=1, resolution=(8, 8))
    with pytest.raises(glpath.UsageError, match="settings"):
        film.merge(other)
    job = RenderJob.of(BOX, fog=1, weather="storm")
    assert RenderJob.from_json(job.to_json()) == job
    assert (job.integrator.fog, job.integrator.weather) == (1.0, "storm")  # type: ignore[attr-defined]


def test_every_option_is_a_parameter_of_the_renders() -> None:
    for function in (glpath.render, glpath.render_frames, RenderJob.of):
        parameters = inspect.signature(function).parameters
        assert set(options()) <= set(parameters)
        assert not any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters.values())
        assert all(parameters[name].default is None for name in ("max_depth", "sampling", "shadows", "radiosity"))
        assert parameters["seed"].default == 0
        assert parameters["count_tests"].default is False


def test_defaults_that_differ_are_all_said() -> None:
    text = " ".join((inspect.getdoc(render) or "").split())
    assert 'default 256 of "path" and "path-buffer", 64 of "gather", 16 of "classic" and "t-buffer"' in text
    assert 'default "classic" of "classic", "bvh" of "t-buffer"' in text
    assert 'where the scene can be solved soon, else "cosine" of "path", "solution" of "gather"' in text
    assert "lookup_depth   : the vertex at which the solution is looked up" in (inspect.getdoc(render) or "")


def test_an_integrator_is_a_name_or_its_settings() -> None:
    given = {"max_depth": 2, "seed": 3, "directions": "sphere"}
    by_name = glpath.render(BOX, integrator="path-buffer", **given, spp=2, resolution=(8, 8))
    settings = PathBufferSettings(max_depth=2, seed=3, directions="sphere")
    by_settings = glpath.render(BOX, integrator=settings, spp=2, resolution=(8, 8))
    assert (by_name.radiance_sums == by_settings.radiance_sums).all()
    assert by_name.metadata.settings == by_settings.metadata.settings
    assert settings_of(settings, {"seed": 0}) == PathBufferSettings(max_depth=2, directions="sphere")


def test_settings_are_checked_also_where_they_come_as_an_instance() -> None:
    for settings, words in (
        (PathSettings(max_depth=0), "max_depth: 0 where a whole number from 1 to 1000"),
        (GatherSettings(lookup_depth=1), "lookup_depth: 1 where a whole number from 2"),
        (GatherSettings(light_resolution=2.5), "light_resolution: 2.5"),  # type: ignore[arg-type]
        (TBufferSettings(shadow_filter=99), "shadow_filter: 99"),
        (TBufferSettings(count_tests="yes"), "count_tests: 'yes' where True or False"),  # type: ignore[arg-type]
    ):
        with pytest.raises(glpath.UsageError) as caught:
            glpath.render(BOX, integrator=settings)
        assert words in str(caught.value)


def test_light_resolution_is_even_as_it_is_declared(tmp_path: Path) -> None:
    """The sides of the hemicube are half as high as its top, which has no middle texel if the number is even."""
    text = RenderJob.of(BOX, integrator="path-buffer", light_resolution=64).to_json()
    assert '"light_resolution": 64' in text
    for call in (
        lambda: settings_of("path-buffer", {"light_resolution": 65}),
        lambda: RenderJob.from_json(text.replace('"light_resolution": 64', '"light_resolution": 65')),
    ):
        with pytest.raises(glpath.UsageError, match="light_resolution: 65 where a multiple of 2 from 16 to 4096"):
            call()
    typed = ["--integrator", "path-buffer", "--light-resolution", "65", "-o", str(tmp_path / "a.png")]
    result = CliRunner().invoke(app, ["render", BOX, *typed])
    assert result.exit_code == 2
    assert "--light-resolution 65: must be a multiple of 2" in result.output


def test_values_become_those_of_the_type() -> None:
    settings = checked(PathBufferSettings(ambient=0.5, cell_share=2))  # type: ignore[arg-type]
    assert isinstance(settings, PathBufferSettings)
    assert settings.ambient == (0.5, 0.5, 0.5)


def test_an_array_of_another_size_is_refused_before_it_is_copied() -> None:
    endless = np.broadcast_to(0.5, (1 << 50,))  # a copy takes 8 PiB
    for value in (endless, np.zeros((3, 1)), [0.1, 0.2]):
        with pytest.raises(glpath.UsageError, match=r"ambient: .* where 3 finite numbers are needed"):
            checked(PathBufferSettings(ambient=value))  # type: ignore[arg-type]
    with pytest.raises(glpath.UsageError, match=r"ambient: .* where 3 finite numbers are needed"):
        lit(glpath.load_scene(BOX), False, ambient=endless)
    with pytest.raises(glpath.SceneError, match=r"Scene.ambient: .* three finite numbers"):
        vector("Scene.ambient", endless)


def test_an_option_that_there_is_not_is_named_with_the_nearest() -> None:
    with pytest.raises(glpath.UsageError, match="Did you mean shadow_filter"):
        glpath.render(BOX, integrator="t-buffer", shadow_filtre=2)


@pytest.mark.parametrize(
    ("integrator", "given", "owners", "remedy"),
    [
        (
            "gather",
            {"max_depth": 4},
            '"path", "path-buffer", "classic" and "t-buffer"',
            "lookup_depth says at which",
        ),
        ("gather", {"roulette": 4}, '"path" and "path-buffer"', "A gather has light of all bounces"),
        ("gather", {"ambient": 0.5}, '"path" and "path-buffer"', "none is left to assume"),
        ("gather", {"directions": "pair"}, '"path-buffer"', 'cast="path-buffer"'),
        ("path", {"lookup_depth": 3}, '"gather"', "max_depth says how long paths are"),
        ("path", {"directions": "pair"}, '"path-buffer"', 'integrator="path-buffer"'),
        ("path", {"light_resolution": 64}, '"path-buffer" and "gather"', 'integrator="path-buffer"'),
        ("path", {"geometry_budget": 64}, '"path-buffer", "gather" and "t-buffer"', "which streams them"),
        ("path", {"bounce_lod": 0.5}, '"path-buffer"', 'integrator="path-buffer"'),
        ("path", {"cast": "bvh"}, '"gather"', 'take integrator="gather"'),
        ("path", {"shadows": "cube"}, '"classic" and "t-buffer"', 'take integrator="classic" or "t-buffer"'),
        ("path-buffer", {"guide": "solution"}, '"path" and "gather"', 'integrator="path"'),
        ("path-buffer", {"lookup_depth": 3}, '"gather"', "max_depth says how long paths are"),
        ("path-buffer", {"branches": 2}, '"gather"', 'take integrator="gather"'),
        ("t-buffer", {"lookup_depth": 3}, '"gather"', "max_depth says how long paths are"),
        ("t-buffer", {"directions": "pair"}, '"path-buffer"', 'take integrator="path-buffer"'),
    ],
)
def test_an_option_at_the_wrong_engine_is_named_with_the_right_one(
    integrator: Any, given: dict[str, Any], owners: str, remedy: str, tmp_path: Path
) -> None:
    ((name, value),) = given.items()
    with pytest.raises(glpath.UsageError) as error:
        glpath.render(BOX, integrator=integrator, **given)
    found = f'{name}: {value!r} with the integrator "{integrator}"; it is an option of {owners}'
    assert error.value.message == found
    assert remedy in error.value.remedy
    typed = ["--" + name.replace("_", "-"), str(value)]
    result = CliRunner().invoke(
        app, ["render", BOX, "-o", str(tmp_path / "a.png"), "--integrator", integrator, *typed]
    )
    assert result.exit_code == 2
    assert "it is an option of" in result.output


def test_an_engine_is_chosen_by_its_true_name() -> None:
    assert tuple(INTEGRATORS) == ("path", "path-buffer", "gather", "classic", "t-buffer")
    assert PathBufferSettings().directions == GatherSettings(cast="path-buffer").directions == "pair"
    shown = CliRunner().invoke(app, ["render", "--help-all"], env={"COLUMNS": "200"}).output
    assert "auto|path|path-buffer|gather|classic|t-buffer" in shown
    assert "bvh|path-buffer" in shown
    assert "pair|lattice|hemisphere|sphere" in shown
    for command in ("lightmap", "measure"):
        help_of = CliRunner().invoke(app, [command, "--help-all"], env={"COLUMNS": "200"}).output
        assert "path|path-buffer|gather" in help_of
    with pytest.raises(glpath.UsageError, match="allowed are auto, path, path-buffer, gather, classic, t-buffer"):
        glpath.render(BOX, integrator="scans")  # type: ignore[arg-type]


def test_who_casts_rays_is_what_the_stages_say() -> None:
    """No engine is named after a structure that it does not use."""
    scans = {"scan positions", "scan scene", "shadow-buffer"}
    size: dict[str, Any] = {"spp": 2, "resolution": (8, 8), "timings": True}
    for engine, by_scans in (
        ({"integrator": "path", "max_depth": 2}, False),
        ({"integrator": "path-buffer", "max_depth": 2}, True),
        ({"integrator": "gather"}, False),
        ({"integrator": "gather", "cast": "path-buffer"}, True),
    ):
        film = glpath.render(BOX, **engine, **size)
        stages = set(film.metadata.statistics["stage_ms"])
        assert (scans <= stages) is by_scans
        assert ("paths" in stages) is not by_scans
        assert ("paths_lost" in film.metadata.statistics) is by_scans
        assert film.metadata.integrator == engine["integrator"]


def test_what_decides_nothing_is_not_recorded() -> None:
    """A film would not merge for the sake of it."""
    of_scans = {"directions", "light_resolution", "cell_share", "cosine_roulette"}
    assert set(PathBufferSettings().recorded()) - set(PathSettings().recorded()) == of_scans
    by_bvh, by_scans = set(GatherSettings().recorded()), set(GatherSettings(cast="path-buffer").recorded())
    assert by_scans - by_bvh == of_scans
    assert by_bvh - by_scans == {"guide", "branches"}


@pytest.mark.parametrize(
    ("call", "name", "meant"),
    [
        (glpath.render, "spq", "spp"),
        (glpath.render, "width", "resolution=(width, height)"),
        (glpath.render, "samples", "spp"),
        (glpath.render, "progres", "progress"),
        (RenderJob.of, "spq", "spp"),
        (glpath.lightmap, "texel", "texels"),
        (glpath.irradiance, "recever", "receiver"),
    ],
)
def test_a_name_that_is_no_option_is_answered_with_the_one_that_was_meant(call: Any, name: str, meant: str) -> None:
    points = ([[0, 0, 0]], [0, 1, 0]) if call is glpath.irradiance else ()
    with pytest.raises(glpath.UsageError) as error:
        call(BOX, *points, **{name: 3})
    assert error.value.remedy == f"Did you mean {meant}?"
    listed = error.value.message.split("allowed are ")[1].split(", ")
    parameters = inspect.signature(call).parameters.values()
    assert set(listed) == {p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}


def test_keywords_for_type_checkers_are_the_options() -> None:
    of_integrators = get_type_hints(IntegratorKeywords)
    assert of_integrators == {o.name: annotation_of(o) for o in options().values()}
    assert RunKeywords.__annotations__.keys() == RunOptions.__annotations__.keys()
    for field in fields(RunOptions):
        assert RunKeywords.__annotations__[field.name].__forward_arg__ == field.type


def test_workers_get_what_holds_for_a_part_of_a_render() -> None:
    device: dict[str, Any] = {"backend": "egl", "device": 1, "require_gpu": True, "threads": 3, "timings": True}
    asked = RunOptions(**device, noise=0.1, time_limit=9.0, on_step=print, on_progress=print, progress="bar")
    assert asked.for_workers() == RunOptions(**device)


MISSPELT = """
from glpath.rendering.calls import render, render_frames
render("cornell-box", spp=3, max_depth=2, time_limit=1.0, progress="lines")
render("cornell-box", spq=3)
render("cornell-box", max_deph=3)
render("cornell-box", time_limit="soon")
render_frames("cornell-box", [], nois=0.1)
"""


def test_a_misspelt_option_fails_a_type_check(tmp_path: Path) -> None:
    program, package = tmp_path / "program.py", Path(glpath.__file__).parent
    program.write_text(MISSPELT.lstrip())
    # What declares options, and no more: all of the package takes a minute.
    settings = ("by_name", "gather_settings", "path_settings", "settings", "whitted_settings")
    needed = [f"rendering/{name}" for name in ("calls", "options", "run_options")]
    needed += [f"integrators/{name}" for name in settings]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file=", "--follow-imports=skip", "--ignore-missing-imports",
         f"--cache-dir={tmp_path}", str(program), *(str(package / f"{name}.py") for name in needed)],
        capture_output=True, text=True, cwd=package.parent, timeout=120,
    )  # fmt: skip
    errors = dict(re.findall(r"program\.py:(\d+): error: (.*?)  \[", done.stdout))
    assert list(errors) == ["3", "4", "5", "6"], done.stdout + done.stderr
    assert errors["3"] == 'Unexpected keyword argument "spq" for "render"'
    assert errors["6"] == 'Unexpected keyword argument "nois" for "render_frames"; did you mean "noise"?'


def test_every_command_has_an_option_once_and_heeds_it() -> None:
    offered = {}
    for name, command in get_command(app).commands.items():  # type: ignore[attr-defined]
        typed = [word for parameter in command.params for word in parameter.opts if word.startswith("--")]
        assert len(typed) == len(set(typed)), name
        offered[name] = {parameter.name for parameter in command.params} & set(OF_RENDERS)
    assert offered["render"] == set(OF_RENDERS)
    assert offered["measure"] == offered["lightmap"] == offered["probes"] == set(OF_FILMS)
    assert offered["radiosity"] == set(OF_SOLVERS) >= {"checkpoint", "resume", "hang_limit", "progress", "quiet"}
    assert offered["daylight"] == set(OF_DAYLIGHT) >= {"resume", "device", "progress", "quiet"}
    assert offered["viewfactors"] == set(OF_MATRICES) >= {"resume", "progress", "quiet"}
    assert not {"device", "cluster", "noise"} & set(OF_SOLVERS)


def test_a_camera_is_given_whole_or_by_what_changes() -> None:
    scene = glpath.load_scene(BOX)
    camera = glpath.load_scene(BOX).with_camera(resolution=(8, 6), fov=20.0).camera
    assert repr(scene.with_camera(camera).camera) == repr(camera)
    assert scene.with_camera(camera, fov=30.0).camera.fov == 30
    film = glpath.render(scene, camera=camera, spp=1, max_depth=1)
    same = glpath.render(scene.with_camera(camera), spp=1, max_depth=1)
    assert (film.radiance_sums == same.radiance_sums).all()
    with pytest.raises(glpath.UsageError, match=r"where a Camera or None is needed(?s:.*)with_camera\(position="):
        scene.with_camera({"fov": 20})
    with pytest.raises(glpath.UsageError, match=r"no field is named 'width'; allowed are position.*resolution"):
        scene.with_camera(width=256)
    with pytest.raises(glpath.UsageError, match=r"camera: 3 where a dictionary whose keys are text or a Camera"):
        glpath.render(scene, camera=3)


def test_a_warning_is_of_the_line_that_called(tmp_path: Path) -> None:
    model = tmp_path / "dark.obj"
    model.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nf 1 2 3\nf 1 2 4\n")
    one = {"spp": 1, "max_depth": 1, "resolution": (4, 4)}
    calls: tuple[Callable[[], object], ...] = (
        lambda: glpath.load_scene(model),
        lambda: glpath.render(model, **one),
        lambda: RenderJob.of(model, **one),
        lambda: list(glpath.render_frames(model, [{}], integrator="path", **one)),
        lambda: glpath.render(BOX, camera={"position": (0, 0, 1e5), "target": (0, 0, 2e5)}, **one),
        lambda: glpath.export(model, tmp_path / "dark.glb"),
    )
    for call in calls:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            call()
        told = [warning for warning in caught if issubclass(warning.category, glpath.SceneWarning)]
        assert told
        assert [(w.filename, w.lineno) for w in told] == [(__file__, call.__code__.co_firstlineno)] * len(told)


def test_errors_name_arguments_as_the_user_writes_them() -> None:
    """What a library's error names can be typed where the error is read."""
    with pytest.raises(glpath.SceneError) as error:
        glpath.render("three-spheres", integrator="path", spp=1)
    assert 'Render it with integrator="classic" or "t-buffer"' in error.value.remedy
    shown = CliRunner().invoke(app, ["render", "three-spheres", "--integrator", "path", "-o", "a.png"])
    assert shown.exit_code == 1
    assert "Render it with --integrator classic or t-buffer" in shown.output
    for name, values, in_python, typed in (
        ("require_gpu", [True], "require_gpu=True", "--require-gpu"),
        ("hours", [False], "hours=False", "--no-hours"),
        ("area", [(0, 0.5, 4.0, 1e-20)], "area=(0, 0.5, 4, 1e-20)", "--area 0,0.5,4,1e-20"),
        ("aovs", [("albedo", "normal")], 'aovs=("albedo", "normal")', "--aov albedo --aov normal"),
        ("aovs", [("albedo",)], 'aovs=("albedo",)', "--aov albedo"),
        ("max_depth", [4], "max_depth=4", "--max-depth 4"),
        ("integrator", ["path", "gather"], 'integrator="path" or "gather"', "--integrator path or gather"),
    ):
        assert argument(name, *values) == in_python
        with notation(as_option):
            assert argument(name, *values) == typed


#: These are typed at a prompt by everybody: other programs' options.
_OTHER_PROGRAMS = re.compile(r"`glpath measure|pip install|dask|scheduler|toktx|pytest|var\(--")


def test_no_error_of_the_library_speaks_of_options_of_the_command_line() -> None:
    root = Path(glpath.__file__).parent
    faces = {"cli", "bench", "benchmarks", "figures", "experiments"}
    found = []
    for file in sorted(root.rglob("*.py")):
        if file.relative_to(root).parts[0] in faces or file.name == "watchdog.py":  # which only commands start
            continue
        tree = ast.parse(file.read_text("utf-8"))
        texts = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}  # docstrings
        texts |= {
            id(node)
            for part in ast.walk(tree)
            if isinstance(part, ast.keyword) and part.arg == "extra"
            for node in ast.walk(part)
        }
        found += [
            f"{file.relative_to(root)}:{node.lineno}: {node.value}"
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in texts
            and re.search(r"(?<![\w-])--[a-z]", node.value)
            and not _OTHER_PROGRAMS.search(node.value)
        ]
    assert found == []


TWO_BALLS = {
    "camera": {"position": [0, 0, 9], "target": [0, 0, 0], "fov": 40},
    "film": {"resolution": [60, 40]},
    "shapes": [
        {"type": "sphere", "name": "red ball", "center": [-4, 1, 0], "radius": 0.5},
        {"type": "sphere", "name": "blue ball", "center": [3, 0, -2], "radius": 1.5},
    ],
    "sky": {"zenith": 1},
}


def test_a_camera_looks_at_a_shape_by_its_name() -> None:
    scene = glpath.load_scene(TWO_BALLS)
    for name, centre in (("red ball", [-4, 1, 0]), ("blue*", [3, 0, -2])):
        camera = with_overrides(scene, (90, 30), {"look_at": name}).camera
        assert camera.resolution == (90, 30)
        at, _ = camera.project([centre])
        assert at[0] == pytest.approx([45, 15], abs=0.5)
        assert np.allclose(camera.frame(), scene.camera.frame()), "it does not turn"
    camera = with_overrides(scene, None, {"look_at": "red ball", "position": [1, 2, 3]}).camera
    assert (camera.position.tolist(), camera.target.tolist()) == ([1, 2, 3], [-4, 1, 0])


def test_an_override_of_a_moving_camera_starts_where_it_is_when_the_shutter_opens() -> None:
    keys = [{"time": 0, "position": [0, 0, 10]}, {"time": 1, "position": [0, 0, 20], "target": [2, 0, 0]}]
    moving, still = (
        glpath.load_scene({**TWO_BALLS, "camera": {**TWO_BALLS["camera"], **fields}})
        for fields in (
            {"motion": keys, "shutter": [0.5, 1]},
            {"position": [0, 0, 15], "target": [1, 0, 0], "shutter": [0.5, 1]},
        )
    )
    for changes in ({"target": [1, 1, 0]}, {"up": [1, 1, 0]}, {"look_at": "red ball"}):
        found, expected = (CameraSensor.of(with_overrides(each, None, changes).camera) for each in (moving, still))
        assert found == expected
        assert found.shutter == (0.5, 1.0), "what moves is blurred"
    found = with_overrides(moving, None, {"up": [1, 1, 0], "shutter": [0, 1]}).camera
    assert found.position.tolist() == [0, 0, 10]


_PARALLEL = {"type": "orthographic", "height": 2}


@pytest.mark.parametrize(
    ("before", "changes", "field"),
    [
        ({}, {"height": 8}, "height"),
        ({}, {"type": "orthographic"}, "height"),
        ({}, {"type": "orthographic", "look_at": "red ball", "position": [1, 2, 3]}, "height"),
        ({}, {**_PARALLEL, "fov": 20}, "fov"),
        ({}, {**_PARALLEL, "focus_distance": 2}, "focus_distance"),
        ({}, {"type": "panorama", "fov": 20}, "fov"),
        ({}, {"type": "panorama", "height": 3}, "height"),
        ({}, {"type": "panorama", "focus_distance": 2}, "focus_distance"),
        (_PARALLEL, {"fov": 20}, "fov"),
        ({}, {"fov": 20, "focus_distance": 2}, None),
        ({}, _PARALLEL, None),
        ({}, {"type": "orthographic", "look_at": "red ball"}, None),
        (_PARALLEL, {"type": "orthographic", "up": [1, 0, 0]}, None),
        (_PARALLEL, {"height": 3}, None),
        (_PARALLEL, {"type": "perspective"}, None),
        ({"aperture_radius": 0.1}, {"type": "panorama", "aperture_radius": 0}, None),
    ],
)
def test_an_override_takes_the_fields_that_a_scene_file_takes(
    before: dict[str, Any], changes: dict[str, Any], field: str | None
) -> None:
    view = {"position": [0, 0, 9], "target": [0, 0, 0]}
    scene = glpath.load_scene({**TWO_BALLS, "camera": {**view, **before}})
    if field is None:
        with_overrides(scene, None, changes)
        return
    with pytest.raises(glpath.SceneError, match=rf"camera\.{field} is "):
        with_overrides(scene, None, changes)
    named = {name: value for name, value in changes.items() if name != "look_at"}
    with pytest.raises(glpath.SceneError, match=field):
        glpath.load_scene({**TWO_BALLS, "camera": {**view, **before, **named}})


def test_options_of_the_camera_are_named_where_its_type_has_none() -> None:
    scene = glpath.load_scene(TWO_BALLS)
    for changes, message in (
        ({"height": 8.0}, "^--camera-height is given, but a camera of type perspective has none"),
        ({"type": "orthographic"}, r"^--camera-height is missing(?s:.*)For example --camera-height 2\."),
    ):
        with pytest.raises(glpath.UsageError, match=message):
            seen(scene, None, changes)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"look_at": "red bal"}, r'no shape of .* has the name "red bal"\.\n  Did you mean "red ball"'),
        ({"look_at": "xyz"}, "Its shapes are red ball, blue ball"),
        ({"look_at": "red ball", "target": [0, 0, 0]}, "beside a target"),
        ({"look_at": "red ball", "type": "panorama"}, "a panorama looks all around"),
    ],
)
def test_what_a_camera_cannot_look_at_is_explained(camera: dict[str, Any], message: str) -> None:
    with pytest.raises(glpath.UsageError, match=message):
        with_overrides(glpath.load_scene(TWO_BALLS), None, camera)
