"""A time limit ends what comes before the first path set: what may be left out is, and the film says so."""

from __future__ import annotations

import pydoc
import re
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.apps.lightmap.lightmap import Bake
from glpath.apps.probes import ProbeGrid
from glpath.cli.run_request import RunRequest
from glpath.cli.unattended import checkpointed
from glpath.io.completed import uniform_sky
from glpath.rendering import loop
from glpath.rendering.factory import UNGUIDED
from glpath.rendering.run_options import RunOptions
from glpath.system.time_limit import check_time, limited, preparing, seconds_left
from tests.conftest import MakeFilm
from tests.support.clock import Clock
from tests.support.objects import scene_of

BOX = "cornell-box-36"
#: More pixels than a thumbnail, so that "auto" is the gather.
SIZE: dict[str, Any] = {"resolution": (120, 100), "seed": 7}


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """A clock that stands still, and reports of every stage, however fast the machine is."""
    monkeypatch.setattr("glpath.rendering.loop._STEP_SECONDS", 0.0)
    monkeypatch.setattr("glpath.radiosity.solvers.solve._REPORT_INTERVAL", 0.0)
    return Clock(monkeypatch)


def at(clock: Clock, stage: str, seconds: float) -> Callable[[glpath.Progress], None]:
    """Move the clock on when a stage begins."""

    def report(progress: glpath.Progress) -> None:
        if progress.stage.startswith(stage):
            clock.ahead = max(clock.ahead, seconds)

    return report


def test_auto_is_paths_without_guides_if_there_is_no_time_for_a_solution(clock: Clock) -> None:
    film = glpath.render(BOX, time_limit=10.0, spp=8, on_progress=at(clock, "solving radiosity", 6.0), **SIZE)
    m = film.metadata
    assert (m.integrator, m.biased, m.stop_rule) == ("path", False, "spp")
    assert m.statistics[UNGUIDED] == 1
    by_cosine = glpath.render(BOX, integrator="path", guide="cosine", spp=8, **SIZE)
    assert np.array_equal(film.radiance_sums, by_cosine.radiance_sums)


def test_a_film_that_began_without_guides_resumes_without_them(clock: Clock) -> None:
    begun = glpath.render(BOX, time_limit=10.0, spp=8, on_progress=at(clock, "solving radiosity", 6.0), **SIZE)
    film = glpath.render(BOX, spp=16, film=begun, **SIZE)
    whole = glpath.render(BOX, integrator="path", guide="cosine", spp=16, **SIZE)
    assert np.array_equal(film.radiance_sums, whole.radiance_sums)


@pytest.fixture
def batch_by_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    """One thread, so that a solution of four batches of particles has four steps."""
    monkeypatch.setattr("glpath.radiosity.solvers.monte_carlo.core_count", lambda: 1)


@pytest.mark.usefixtures("batch_by_batch")
@pytest.mark.parametrize("integrator", ["auto", "path"])
def test_a_solution_that_is_cut_short_guides_paths(clock: Clock, integrator: Any) -> None:
    """Guides of any solution leave paths unbiased; a gather that looked it up would have its noise as a bias."""
    film = glpath.render(
        BOX,
        integrator=integrator,
        time_limit=10.0,
        spp=8,
        on_progress=at(clock, "solving radiosity: particles", 6.0),
        **SIZE,
    )
    m = film.metadata
    assert (m.integrator, m.settings["guide"], m.biased) == ("path", "solution", False)
    assert UNGUIDED not in m.statistics


@pytest.mark.usefixtures("batch_by_batch")
def test_a_gather_that_was_asked_for_warns_of_a_solution_that_is_cut_short(clock: Clock) -> None:
    with pytest.warns(glpath.SceneWarning, match=r"cut the radiosity solution short, after [\d,]+ particles"):
        film = glpath.render(
            BOX,
            integrator="gather",
            time_limit=10.0,
            spp=4,
            on_progress=at(clock, "solving radiosity: particles", 6.0),
            **SIZE,
        )
    assert film.metadata.integrator == "gather"


def test_a_gather_whose_bias_there_is_no_time_to_measure_says_so(clock: Clock) -> None:
    with pytest.warns(glpath.SceneWarning, match="left no time to measure the bias"):
        film = glpath.render(BOX, time_limit=10.0, on_progress=at(clock, "measuring", 10.5), **SIZE)
    assert (film.path_sets, film.metadata.stop_rule) == (1, "time limit")
    assert film.bias() is None


def test_a_bias_that_cannot_be_measured_is_not_the_limit_s_fault(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.rendering.factory._Gathering.bias_probe", lambda *_: None)  # as of streams
    with warnings.catch_warnings():
        warnings.simplefilter("error", glpath.SceneWarning)
        film = glpath.render(BOX, integrator="gather", time_limit=1e6, spp=2, **SIZE)
    assert film.bias() is None


def test_a_limit_that_ends_before_the_first_path_set_is_an_error(clock: Clock) -> None:
    with pytest.raises(glpath.TimeLimitError, match="time_limit=10: over while"):
        glpath.render(
            BOX, integrator="gather", time_limit=10.0, on_progress=at(clock, "solving radiosity", 12.0), **SIZE
        )


@pytest.mark.parametrize("by_cluster", [False, True])
def test_a_film_whose_resumption_has_no_time_stays_as_it_was(clock: Clock, by_cluster: bool) -> None:
    cluster = None
    if by_cluster:
        pytest.importorskip("distributed")
        from glpath.jobs.cluster import Cluster

        cluster = Cluster.__new__(Cluster)  # which needs no workers yet
    begun = glpath.render(BOX, integrator="gather", spp=8, **SIZE)
    sums = begun.radiance_sums.copy()
    film = glpath.render(
        BOX,
        integrator="gather",
        time_limit=100.0,
        film=begun,
        on_progress=at(clock, "solving radiosity", 102.0),
        cluster=cluster,
        **SIZE,
    )
    assert (film.path_sets, film.metadata.stop_rule) == (8, "time limit")
    assert np.array_equal(film.radiance_sums, sums)


def test_the_time_of_what_a_film_was_made_in_counts(clock: Clock) -> None:
    begun = glpath.render(BOX, integrator="path", guide="cosine", spp=8, **SIZE)
    limit = begun.metadata.elapsed_s + 5.0
    film = glpath.render(
        BOX, integrator="path", guide="cosine", time_limit=limit, film=begun, on_progress=at_end(clock, 5.1), **SIZE
    )
    assert film.metadata.stop_rule == "time limit"
    assert 8 < film.path_sets <= 16


def at_end(clock: Clock, seconds: float) -> Callable[[glpath.Progress], None]:
    def report(progress: glpath.Progress) -> None:
        clock.ahead = seconds

    return report


def test_a_look_that_denoises_is_not_begun_when_it_would_end_after_the_limit(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[int] = []

    def slowly(film: glpath.Film, *, exposure: float | None = None) -> float:
        looks.append(film.path_sets)
        clock.ahead += 3.0
        return 1.0

    monkeypatch.setattr(glpath.Film, "denoised_noise", slowly)
    monkeypatch.setattr("glpath.rendering.loop.time", clock.module)
    film = glpath.render(
        BOX,
        integrator="path",
        guide="cosine",
        time_limit=7.0,
        clean=0.01,
        aovs=("albedo", "normal"),
        spp=64,
        **SIZE,
    )
    assert looks == [16, 24]
    assert film.metadata.stop_rule == "spp"


@pytest.mark.parametrize(("limit", "looks"), [(0.19, []), (0.21, [16])])
def test_first_look_is_not_begun_if_it_would_end_after_the_limit(
    limit: float, looks: list[int], clock: Clock, monkeypatch: pytest.MonkeyPatch, make_film: MakeFilm
) -> None:
    """Denoising 256 x 256 pixels takes one core 0.2 s."""
    found: list[int] = []
    monkeypatch.setattr(glpath.Film, "denoised_noise", lambda film: found.append(film.path_sets))
    monkeypatch.setattr(loop, "core_count", lambda: 1)
    film = make_film([(0, 8)])
    film.metadata = replace(film.metadata, window=(0, 0, 256, 256))
    with limited(limit):
        of_render = loop.Clock(film, 64, "", RunOptions(clean=0.01))
        assert of_render.ended(at_block=True) == ""  # a block without a look leaves the estimate as it is
        of_render.film = make_film([(0, 16)])
        assert of_render.ended(at_block=True) == ""
    assert found == looks


def test_render_in_on_step_leaves_the_limit_of_the_outer_render(clock: Clock) -> None:
    options: dict[str, Any] = {"integrator": "path", "guide": "cosine", "spp": 1, "resolution": (8, 8)}
    left = []

    def on_step(film: glpath.Film) -> None:
        glpath.render(BOX, **options)
        left.append(seconds_left())

    glpath.render(BOX, time_limit=10.0, on_step=on_step, **options)
    assert left == [pytest.approx(10.0)]


def test_lightmap_is_made_of_its_film_without_a_limit(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    def film(bake: Bake, options: RunOptions) -> None:
        clock.ahead = 9.0

    def lightmap(bake: Bake, film: None) -> float:
        check_time("compiling kernels")
        return seconds_left()

    monkeypatch.setattr(Bake, "of", lambda *_, **__: Bake(None, None, None, False))  # type: ignore[arg-type]
    monkeypatch.setattr(Bake, "film", film)
    monkeypatch.setattr(Bake, "lightmap", lightmap)
    assert glpath.lightmap(BOX, time_limit=1.0) == float("inf")


def test_each_frame_has_the_limit_to_itself(clock: Clock) -> None:
    cameras = [{"position": (x, 1.0, 3.2)} for x in (0.0, 0.1)]
    options = {**SIZE, "integrator": "path", "guide": "cosine", "spp": 2}
    films = []
    for film in glpath.render_frames(BOX, cameras, time_limit=5.0, **options):
        films.append(film)
        clock.ahead += 100.0
    assert [film.metadata.stop_rule for film in films] == ["spp", "spp"]


def test_reading_of_a_frame_counts_towards_its_time_limit(clock: Clock) -> None:
    def frames() -> Iterator[glpath.Scene]:
        clock.ahead = 6.1
        check_time("reading frame 0")
        raise AssertionError("the limit ends the reading")
        yield

    with pytest.raises(glpath.TimeLimitError, match="time_limit=5: over while reading frame 0"):
        next(glpath.render_frames(BOX, frames(), time_limit=5.0, integrator="path", spp=1))


def test_reading_of_the_scene_of_frames_has_the_time_limit(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    def describe(*_: object, **__: object) -> None:
        clock.ahead = 6.1
        check_time("reading the scene")
        raise AssertionError("the limit ends the reading")

    monkeypatch.setattr("glpath.rendering.calls.describe", describe)
    with pytest.raises(glpath.TimeLimitError, match="time_limit=5: over while reading the scene"):
        next(glpath.render_frames(BOX, [{}], time_limit=5.0))


def test_each_view_has_the_limit_to_itself(clock: Clock) -> None:
    def report(progress: glpath.Progress) -> None:
        clock.ahead += 3.0 * (progress.done == progress.total)

    K = [[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]]
    poses = np.stack([np.eye(4)] * 3)
    poses[:, 2, 3] = 3.9
    options: dict[str, Any] = {"integrator": "path", "guide": "cosine", "spp": 2}
    views = glpath.render_views(BOX, poses, K, time_limit=5.0, on_progress=report, **options)
    assert [film.metadata.stop_rule for film in views.films] == ["spp"] * 3


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        ("5", ": '5' where a number or None is needed"),
        (0, "=0: must be a finite number of seconds above 0."),
        (-1.0, "=-1: must be a finite number of seconds above 0."),
        (float("nan"), "=nan: must be a finite number of seconds above 0."),
        (float("inf"), "=inf: must be a finite number of seconds above 0."),
        (True, ": True where a number or None is needed"),
        (10**400, ": an integer of 401 digits where integers have at most 64 bits"),
        ([5.0], ": [5.0] where a number or None is needed"),
    ],
    ids=["text", "0", "-1", "nan", "inf", "True", "401 digits", "list"],
)
def test_a_limit_that_is_no_time_is_refused_by_every_call(seconds: Any, words: str) -> None:
    match = re.escape(f"time_limit{words}")
    K, origin, up = [[9.0, 0.0, 8.0], [0.0, 9.0, 8.0], [0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], [0.0, 1.0, 0.0]
    calls: list[Callable[[], object]] = [
        lambda: glpath.render(BOX, time_limit=seconds),
        lambda: list(glpath.render_frames(BOX, [{}], time_limit=seconds)),
        lambda: glpath.render_views(BOX, np.eye(4), K, time_limit=seconds),
        lambda: glpath.irradiance(BOX, origin, up, time_limit=seconds),
        lambda: glpath.lightmap(BOX, time_limit=seconds),
        lambda: glpath.probes(BOX, (2, 2, 2), time_limit=seconds),
        lambda: glpath.solve_radiosity(BOX, time_limit=seconds),
    ]
    for call in calls:
        with pytest.raises(glpath.UsageError, match=match):
            call()
    with pytest.raises(glpath.UsageError, match="time_limit"):
        RunOptions(time_limit=seconds)


def test_a_limit_may_be_a_number_of_numpy(clock: Clock) -> None:
    film = glpath.render(BOX, integrator="path", guide="cosine", spp=1, time_limit=np.float32(5), **SIZE)
    assert film.metadata.stop_rule == "spp"


def test_seconds_of_a_film_count_from_the_call_with_a_limit_and_without(clock: Clock) -> None:
    def seconds_of(time_limit: float | None) -> float:
        clock.ahead -= 1000.0  # so that calls seem to have begun long ago
        options: dict[str, Any] = {**SIZE, "integrator": "path", "guide": "cosine", "spp": 1}
        return glpath.render(BOX, time_limit=time_limit, **options).metadata.elapsed_s

    assert seconds_of(None) > 1000
    assert seconds_of(1e6) > 1000


def test_no_warning_comes_of_a_limit_that_is_far(clock: Clock) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", glpath.SceneWarning)
        film = glpath.render(BOX, time_limit=1e6, spp=4, **SIZE)
    assert film.metadata.integrator == "gather"


def test_preparation_of_a_resumed_bake_and_of_resumed_probes_is_exempt(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the limit would end them with an error, and the film could not be returned."""

    def prepare(*_: object, **__: object) -> None:
        check_time("building the BVH")
        raise ArithmeticError

    monkeypatch.setattr("glpath.apps.lightmap.surfaces.AtlasSurfaces.of", prepare)
    monkeypatch.setattr("glpath.apps.probes.path_traceable", prepare)
    scene = glpath.load_scene(BOX)
    for resumes, error in ((True, ArithmeticError), (False, glpath.TimeLimitError)):
        with limited(1.0, resumes=resumes):
            clock.ahead += 9.0
            with pytest.raises(error):
                Bake.of(scene, size=16, uv="keep", denoise=False)
            with pytest.raises(error):
                ProbeGrid.of(scene)


@pytest.mark.parametrize("path_sets", [0, 2])
def test_preparation_of_a_command_is_exempt_if_its_checkpoint_has_path_sets(
    path_sets: int, clock: Clock, tmp_path: Path, make_film: MakeFilm
) -> None:
    make_film([(0, path_sets)] if path_sets else []).save(tmp_path / "a.npz")
    request = RunRequest(resume=True)
    with limited(1.0), checkpointed([tmp_path / "a.npz"], request):
        clock.ahead = 9.0
        with nullcontext() if path_sets else pytest.raises(glpath.TimeLimitError), preparing():
            check_time("building the BVH")


def test_cylinders_whose_preparation_takes_longer_than_the_limit_are_refused_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("glpath.rendering.points._SECONDS_PER_DIRECTION", 1.0)
    with pytest.raises(glpath.TimeLimitError, match="preparing the points would take about 32 s"):
        glpath.irradiance("cornell-box", [[0.0, 0, 0]], [0.0, 1, 0], receiver="cylinder", time_limit=20.0)


@pytest.mark.parametrize(
    "solve",
    [
        lambda scene, limit: glpath.solve_radiosity(scene, method="monte-carlo", time_limit=limit),
        lambda scene, limit: glpath.solve_radiosity(scene, method="progressive", time_limit=limit),
        lambda scene, limit: glpath.probes(scene, (10, 10, 10), spp=1, time_limit=limit),
    ],
    ids=["monte-carlo", "progressive", "probes"],
)
def test_a_time_limit_ends_rays_that_are_tested_with_many_triangles(
    solve: Callable[[glpath.Scene, float | None], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part of the rays took minutes, and time was checked only after each part."""
    one, many = (np.tile([[0.0, 0, 0], [1, 0, 0], [0, 1, 0.1]], (count, 1)) for count in (1, 12_000))
    solve(scene_of(triangles=one, sky=uniform_sky()), None)  # compiles the kernels
    scene = scene_of(triangles=many, sky=uniform_sky())
    monkeypatch.setattr("glpath.system.time_limit.GRACE", 0.4)
    begin = time.perf_counter()
    with pytest.raises(glpath.TimeLimitError, match="over while"):
        solve(scene, 0.1)
    assert time.perf_counter() - begin < 3.0


@pytest.mark.parametrize(
    "step",
    ["glpath.rendering.points.unit_normals", "glpath.sensors.sensor._table"],
)
def test_a_time_limit_ends_each_step_of_preparing_points(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    work = pydoc.locate(step)
    assert callable(work)

    def slow(*arguments: Any) -> Any:
        clock.ahead = 9.0
        return work(*arguments)

    monkeypatch.setattr(step, slow)
    with pytest.raises(glpath.TimeLimitError, match="over while preparing the points"):
        glpath.irradiance("cornell-box", [[0.0, 0, 0]], [0.0, 1, 0], spp=1, time_limit=2.0)
