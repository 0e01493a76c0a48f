"""Strict: warnings are errors, at once before rendering, and after the result is written."""

from __future__ import annotations

import json
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext, suppress
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import PIL.Image
import pytest
import typer.main

import glpath
from glpath.apps.measure.files import save_glb
from glpath.cli.commands import COMMANDS
from glpath.cli.main import app
from glpath.errors import (
    SceneError,
    SceneWarning,
    StrictError,
    current_warnings,
    warn,
    warning_filter,
    warning_scope,
)
from glpath.film.film import Film
from glpath.integrators.by_name import PathSettings
from glpath.io.pictures import Pictures
from glpath.io.text import parse_numbers
from glpath.jobs import worker
from glpath.rendering import RenderJob
from glpath.rendering.choice import _solvable
from glpath.rendering.factory import plan_of
from glpath.rendering.run_options import RunOptions
from glpath.rendering.session import remarks_of
from glpath.sky.sun_position import sun_positions
from tests.conftest import MakeFilm
from tests.support.command_line import run

SMALL = {"resolution": (8, 8), "spp": 1, "max_depth": 1}
SMALL_ARGUMENTS = ("--resolution", "8x8", "--spp", 1, "--max-depth", 1)
NO_CAMERA = "has no camera, so one was set"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model without a camera and without light, which each reader warns of."""
    path = tmp_path / "model.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return path


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> str:
    """A warning about each film that is done."""
    text = "the film is odd"
    monkeypatch.setattr("glpath.rendering.session.remarks_of", lambda plan, film: [text])
    return text


def test_warning_before_rendering_ends_the_command_before_it_renders(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    result = run("render", model, "-o", out, *SMALL_ARGUMENTS, "--strict")
    assert (result.exit_code, out.exists()) == (1, False), result.output
    assert f"glpath: error: {model}: {NO_CAMERA}" in result.stderr
    assert "strict takes this warning for an error" in result.stderr
    result = run("render", model, "-o", out, *SMALL_ARGUMENTS)
    assert (result.exit_code, out.exists()) == (0, True), result.output


def test_warning_after_rendering_leaves_the_picture(late: str, tmp_path: Path) -> None:
    out = tmp_path / "a.npz"
    result = run("render", "cornell-box-36", "-o", out, *SMALL_ARGUMENTS, "--strict")
    assert (result.exit_code, Film.load(out).path_sets) == (1, 1), result.output
    assert f"glpath: warning: {late}" in result.stderr
    assert f"glpath: error: {late}" in result.stderr
    assert run("render", "cornell-box-36", "-o", out, *SMALL_ARGUMENTS).exit_code == 0


def test_strict_command_without_warnings_ends_with_0(tmp_path: Path) -> None:
    result = run("render", "cornell-box-36", "-o", tmp_path / "a.png", *SMALL_ARGUMENTS, "--strict")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_the_option(command: str) -> None:
    group: Any = typer.main.get_group(app)
    (option,) = [param for param in group.commands[command].params if param.name == "strict"]
    assert option.opts == ["--strict"]


# Each command that warns of its input, and the arguments after the model.
BEFORE = {
    "info": (),
    "validate": (),
    "radiosity": ("-o", "s.npz"),
    "measure": ("-o", "m.csv", "--plane", "z=0.1", "--spacing", 0.5),
    "viewfactors": ("-o", "F.npz"),
    "export": ("-o", "e.xml"),
}


@pytest.mark.parametrize("command", BEFORE)
def test_other_commands_are_strict_about_their_input(
    command: str, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(model.parent)
    model.write_text(model.read_text() + "v nan 0 0\n")
    result = run(command, model, *BEFORE[command], "--strict")
    assert result.exit_code == 1, result.output
    assert [path.name for path in model.parent.iterdir()] == [model.name]


def test_warning_about_a_result_of_another_command_leaves_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points of terrain that lie below its ground get no value."""
    monkeypatch.chdir(tmp_path)
    np.save("flat.npy", np.zeros((9, 9)))
    Path("points.csv").write_text("x,y,z\n4,-4,1\n5,-4,-8\n")
    asked = ("horizon", "flat.npy", "-o", "svf.csv", "--points", "points.csv", "--azimuths", 8)
    result = run(*asked, "--strict")
    assert result.exit_code == 1, result.output
    assert "below ground" in result.stderr
    assert len(Path("svf.csv").read_text().splitlines()) == 3
    assert run(*asked).exit_code == 0


def test_python_call_raises_before_it_renders(model: Path) -> None:
    with pytest.raises(StrictError, match=NO_CAMERA) as caught:
        glpath.render(model, **SMALL, strict=True)
    assert caught.value.result is None


def test_python_call_hands_the_film_on(late: str) -> None:
    with pytest.warns(SceneWarning, match=late), pytest.raises(StrictError, match=late) as caught:
        glpath.render("cornell-box-36", **SMALL, strict=True)
    assert caught.value.result.path_sets == 1
    with pytest.warns(SceneWarning, match=late):
        assert glpath.render("cornell-box-36", **SMALL).path_sets == 1


def test_strict_frames_leave_the_caller_as_it_was(model: Path) -> None:
    frames = glpath.render_frames("cornell-box-36", [{}, {}], **SMALL, strict=True)
    assert next(frames).path_sets == 1
    assert not current_warnings().strict
    assert [film.path_sets for film in frames] == [1]
    with pytest.raises(StrictError, match=NO_CAMERA):
        next(iter(glpath.render_frames(model, [{}], **SMALL, strict=True)))


def test_strict_frames_and_views_hand_on_what_their_warnings_are_about(late: str) -> None:
    with pytest.warns(SceneWarning, match=late), pytest.raises(StrictError, match=late) as caught:
        next(iter(glpath.render_frames("cornell-box-36", [{}], **SMALL, strict=True)))
    assert caught.value.result.path_sets == 1
    K = [[6.0, 0.0, 4.0], [0.0, 6.0, 4.0], [0.0, 0.0, 1.0]]
    options = {name: value for name, value in SMALL.items() if name != "resolution"}
    with pytest.warns(SceneWarning, match=late), pytest.raises(StrictError, match=late) as caught:
        glpath.render_views("cornell-box-36", np.eye(4), K, **options, strict=True)
    assert len(caught.value.result) == 1


@pytest.mark.filterwarnings("error::glpath.errors.SceneWarning")
def test_filter_that_raises_warnings_leaves_the_results_they_are_about(late: str) -> None:
    with pytest.raises(SceneWarning, match=late) as caught:
        glpath.render("cornell-box-36", **SMALL)
    assert caught.value.result.path_sets == 1
    with pytest.raises(SceneWarning, match=late) as caught:
        next(iter(glpath.render_frames("cornell-box-36", [{}], **SMALL)))
    assert caught.value.result.path_sets == 1
    K = [[6.0, 0.0, 4.0], [0.0, 6.0, 4.0], [0.0, 0.0, 1.0]]
    with pytest.raises(SceneWarning, match=late) as caught:
        glpath.render_views("cornell-box-36", [np.eye(4)] * 2, K, spp=1, max_depth=1)
    assert len(caught.value.result) == 2
    assert current_warnings().raised == []


@pytest.mark.filterwarnings("error::glpath.errors.SceneWarning")
def test_transparent_jpeg_is_written_before_its_warning_is_raised(make_film: MakeFilm, tmp_path: Path) -> None:
    film = make_film([], transparent=True, aovs=("depth",), exposure=0.0)
    film.add(0, 1, np.ones((4, 6, 3)), {"depth": np.ones((4, 6, 2))})
    with pytest.raises(SceneWarning, match="a JPEG has no alpha channel"):
        film.save(tmp_path / "a.jpg")
    assert (tmp_path / "a.jpg").read_bytes()[:2] == b"\xff\xd8"  # start of image, ISO/IEC 10918-1


def test_dropped_samples_are_warned_of(make_film: MakeFilm) -> None:
    plan = plan_of(PathSettings())
    (text,) = remarks_of(plan, make_film([(0, 32)], statistics={"dropped_samples": 3}))
    assert "3 samples were NaN or infinite" in text
    assert remarks_of(plan, make_film([(0, 32)])) == []


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_transparent_picture_is_written_whatever_its_format_leaves_out(suffix: str, tmp_path: Path) -> None:
    out = tmp_path / f"a{suffix}"
    asked = ("render", "cornell-box-36", "-o", out, *SMALL_ARGUMENTS, "--background", "transparent", "--strict")
    result = run(*asked)
    assert (result.exit_code, out.exists()) == (int(suffix == ".jpg"), True), result.output


def test_strict_keeps_a_model_of_points_that_its_format_knows_in_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.apps.measure.files.write_gltf", lambda *_, **__: ["odd"])
    monkeypatch.setattr("glpath.apps.measure.files._facets", lambda _: None)
    with pytest.warns(SceneWarning, match="odd"), warning_scope(strict=True) as scope:
        save_glb(tmp_path / "a.glb", SimpleNamespace(scene=None))  # type: ignore[arg-type]
    assert scope.late == [f"{tmp_path / 'a.glb'}: odd."]


def test_job_file_is_strict_whoever_runs_it(late: str, tmp_path: Path) -> None:
    path, out = tmp_path / "job.json", tmp_path / "a.npz"
    job = RenderJob.of("cornell-box-36", **SMALL, strict=True)
    job.save(path)
    assert json.loads(path.read_text())["strict"] is True
    assert RenderJob.load(path) == job
    assert all(part.strict for part in RenderJob.of("cornell-box-36", spp=32, strict=True).split(2))
    result = run("render", "--job", path, "-o", out)
    assert (result.exit_code, Film.load(out).path_sets) == (1, 1), result.output
    with pytest.warns(SceneWarning, match=late), pytest.raises(StrictError, match=late):
        glpath.rendering.run(job)


def test_job_file_is_strict_by_an_option(late: str, tmp_path: Path) -> None:
    path, out = tmp_path / "job.json", tmp_path / "a.npz"
    RenderJob.of("cornell-box-36", **SMALL).save(path)
    assert json.loads(path.read_text())["strict"] is False
    assert run("render", "--job", path, "-o", out, "--strict").exit_code == 1
    assert run("render", "--job", path, "-o", out).exit_code == 0


def test_strict_job_is_described_without_warnings(model: Path) -> None:
    with pytest.raises(StrictError, match=NO_CAMERA):
        RenderJob.of(model, **SMALL, strict=True)


def test_warnings_of_a_worker_reach_the_process_that_asks(
    make_film: MakeFilm, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = make_film([(0, 8)])

    def render(job: Any, scene: Any, options: RunOptions) -> Film:
        assert options.strict
        options.on_step(film)  # type: ignore[misc]
        warn("odd on the worker")
        warn("odd on the worker")
        with ThreadPoolExecutor(1) as client:  # a client in the process of its worker
            client.submit(warn, "odd on the client").result()
        return film

    options = RunOptions(strict=True).for_workers()
    job = RenderJob.of("cornell-box-36", **SMALL)
    monkeypatch.setattr(worker, "Session", lambda *_, **__: SimpleNamespace(render=render, close=lambda: None))
    worker.hold(worker.Shared("token", job, None, None, options, worker.this_version()))  # type: ignore[arg-type]
    try:
        with pytest.warns(SceneWarning, match="odd on the client"):
            part = worker.render_part("token", (0, 8))
        assert part.warnings == ("odd on the worker",)
    finally:
        worker.let_go("token")


def test_warning_that_a_filter_ignores_is_no_error() -> None:
    with warnings.catch_warnings(), warning_scope(strict=True) as scope:
        warnings.filterwarnings("ignore", "expected")
        warn("expected here")
        warn("expected here", late=True)
        with pytest.raises(StrictError):
            warn("another")
    assert scope.late == []


@pytest.mark.parametrize(
    "entry",
    [
        {"message": "expec"},
        {"message": "another"},
        {"category": SceneWarning},
        {"category": DeprecationWarning},
        {"module": __name__},
        {"module": "another"},
        {"category": SceneWarning, "lineno": 1},
    ],
    ids=str,
)
def test_strict_ignores_warnings_by_the_rules_of_python(entry: dict[str, Any]) -> None:
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", **entry)
        warn("expected")
        with warning_scope(strict=True), nullcontext() if not shown else pytest.raises(StrictError):
            warn("expected")


@pytest.mark.parametrize("category", [Warning, UserWarning])
def test_strict_raises_although_a_filter_ignores_all_warnings(category: type[Warning]) -> None:
    with warnings.catch_warnings(), warning_scope(strict=True):
        warnings.simplefilter("ignore", category)
        with pytest.raises(StrictError):
            warn("no light")


def test_warning_filters_of_two_threads_end_in_any_order() -> None:
    before = list(warnings.filters)
    with ThreadPoolExecutor(1) as first, ThreadPoolExecutor(1) as second:
        contexts = [warning_filter("ignore"), warning_filter("error")]
        for thread, context in zip((first, second), contexts, strict=True):
            thread.submit(context.__enter__).result()
        first.submit(warnings.warn, "ignored", stacklevel=1).result()
        with pytest.warns(UserWarning, match="third"):
            warnings.warn("of a third thread", stacklevel=1)
        for thread, context in zip((first, second), contexts, strict=True):
            thread.submit(context.__exit__, None, None, None).result()
    assert list(warnings.filters) == before


def test_warning_filter_ends_although_another_thread_restores_it() -> None:
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        others = warnings.catch_warnings()
        with warning_filter("ignore"):
            others.__enter__()
        others.__exit__()
        warnings.warn("shown", stacklevel=1)
    assert len(shown) == 1


class _Warning(SceneWarning, DeprecationWarning, PIL.Image.DecompressionBombWarning):
    """Warning of all categories that a reader hides or raises."""


READERS: dict[str, Callable[[Path], object]] = {
    "numpy.fromstring": lambda _: parse_numbers("1 2"),
    "glpath.io.pictures.pixels_of": lambda picture: Pictures(picture.parent).read(picture.name),
    "imageio.v3.imread": glpath.read_image,
    "rasterio.open": lambda picture: glpath.load_height_field(picture.with_suffix(".tif")),
    "pvlib.solarposition.get_solarposition": lambda _: sun_positions(np.array(["2020-06-21T12"], "M8[s]"), 0, 0),
    "glpath.rendering.choice.path_traceable": lambda _: _solvable(glpath.load_scene("cornell-box-36")),
}


@pytest.mark.parametrize("name", READERS)
def test_readers_leave_warnings_of_other_threads_alone(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While a reader runs its library, another thread gives a warning."""
    pytest.importorskip(name.partition(".")[0])
    PIL.Image.new("RGB", (1, 1)).save(tmp_path / "a.png")
    PIL.Image.new("F", (1, 1)).save(tmp_path / "a.tif")
    module, _, function = name.rpartition(".")
    original, calls = getattr(import_module(module), function), []

    def run_beside_a_warning(*arguments: Any, **options: Any) -> Any:
        with ThreadPoolExecutor(1) as other:
            calls.append(other.submit(warnings.warn, "of another thread", _Warning).exception())
        return original(*arguments, **options)

    monkeypatch.setattr(name, run_beside_a_warning)
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        with suppress(SceneError):  # the height field has no georeference
            READERS[name](tmp_path / "a.png")
    assert calls
    assert calls == [None] * [each.category for each in shown].count(_Warning)


def test_strict_call_leaves_other_threads_alone() -> None:
    found = []
    with warning_scope(strict=True):
        thread = threading.Thread(target=lambda: found.append(current_warnings().strict))
        thread.start()
        thread.join()
    assert found == [False]


def test_strict_call_within_a_call_that_is_not_strict_raises_by_itself() -> None:
    """As from `on_step`; within a command, the error waits until the command has saved its result."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with warning_scope(strict=False) as outer:
            with warning_scope(strict=True) as inner, pytest.warns(SceneWarning):
                warn("late", late=True)
            with pytest.raises(StrictError) as caught:
                inner.raise_late("inner")
        outer.raise_late("outer")
    assert (caught.value.result, outer.strict) == ("inner", False)
    with warning_scope(strict=False, of_command=True) as command, warning_scope(strict=True):
        pass
    assert command.strict
