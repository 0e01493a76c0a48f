"""A gather's bias: block means, their sums in a film's metadata, and what is found of a known bias."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.cli.outcome import bias_lines
from glpath.compare.picture import Picture
from glpath.compare.statistical import stat
from glpath.errors import ContextError, ImageError, SceneWarning
from glpath.film.bias import BIAS_OBSTACLE, BIAS_PROBE, BLOCKS, SURE, bias_of, block_means, summed
from glpath.film.film import Film
from glpath.film.metadata import merged_values
from glpath.jobs.chunks import ChunksFailedError
from glpath.jobs.cluster import Cluster
from glpath.radiosity import RadiosityProgress
from glpath.rendering import factory
from glpath.rendering.bias import BiasCheck
from glpath.rendering.factory import solve_for_gather
from glpath.rendering.interrupts import RenderInterrupted
from glpath.sensors.sensor import PointSensor
from tests.conftest import MakeFilm

GATHER = {"integrator": "gather", "spp": 16, "resolution": (40, 30)}


def test_block_means_are_those_of_the_pixels() -> None:
    picture = np.random.default_rng(1).random((24, 48, 3))
    whole = picture.reshape(BLOCKS, 3, BLOCKS, 6, 3).mean(axis=(1, 3, 4))
    assert np.allclose(block_means(picture), whole)
    ramp = np.broadcast_to((np.arange(10) + 0.5)[None, :, None], (7, 10, 3))
    fine = np.repeat(ramp[0, :, 0], 4).reshape(BLOCKS, 5).mean(axis=1)
    assert np.allclose(block_means(ramp)[0], fine), "a pixel in two blocks counts in both by its parts"


def paired_sets(factor: float, count: int = 32) -> dict[str, object]:
    """Sums of sets whose two engines share most of their noise; the first is brighter by a factor."""
    random = np.random.default_rng(2)
    light = 0.5 + random.random((40, 40, 3))
    pairs = []
    for _ in range(count):
        common = light + 0.3 * random.standard_normal(light.shape)
        own = 0.05 * random.standard_normal((2, *light.shape))
        pairs.append((block_means(factor * common + own[0]), block_means(common + own[1])))
    return summed([pair[0] for pair in pairs], [pair[1] for pair in pairs])


def test_a_known_bias_is_found_and_noise_is_none() -> None:
    right, wrong = bias_of(paired_sets(1.0)), bias_of(paired_sets(1.05))
    assert right is not None
    assert wrong is not None
    assert abs(right.mean) < 4 * right.mean_error < 0.004
    assert right.blocks < 0.01
    assert right.worst_block == 0.0
    assert right.is_small(SURE)
    assert not right.is_large()
    assert wrong.mean == pytest.approx(0.05, abs=4 * wrong.mean_error)
    assert wrong.blocks == pytest.approx(0.05, rel=0.3)
    assert wrong.is_large(SURE)
    assert not wrong.is_small()


def test_one_wrong_block_of_64_is_a_large_bias() -> None:
    probe = paired_sets(1.0)
    probe["difference"][9] += 0.2 * probe["light"][9]
    probe["square"][9] += 32 * (0.2 * probe["light"][9] / 32) ** 2
    bias = bias_of(probe)
    assert bias is not None
    assert bias.worst_block == pytest.approx(0.2, abs=0.05)
    assert bias.is_large(SURE)


def test_a_film_of_a_gather_keeps_its_bias_probe(tmp_path) -> None:
    film = glpath.render("cornell-box-36", **GATHER)
    bias = film.bias()
    assert bias is not None
    # 512 sets of `path` are 0.15 % brighter.
    assert bias.mean == pytest.approx(-0.0015, abs=0.0015)
    assert bias.mean_error < 0.005
    film.save(tmp_path / "a.npz")
    assert Film.load(tmp_path / "a.npz").bias() == bias
    more = glpath.render("cornell-box-36", first_path_set=16, **GATHER)
    assert film.merge(more).bias() == bias, "parts of one render share one probe"


def doubled(solution):
    """The solution of a world that is twice as bright."""
    return replace(solution, elements=2.0 * solution.elements, vertices=2.0 * solution.vertices)


def coarse_solution(scene):
    return glpath.solve_radiosity(scene, method="monte-carlo", patches=200, particles=1 << 15)


def test_a_solution_that_is_wrong_is_a_bias_and_a_warning() -> None:
    """Unbiased paths take it as their guide, and their mean does not move."""
    scene = glpath.load_scene("cornell-box-36")
    with pytest.warns(SceneWarning, match=r"the bias of the gather is \+[1-9]\d"):
        bias = glpath.render(scene, radiosity=doubled(coarse_solution(scene)), **GATHER).bias()
    assert bias is not None
    assert bias.mean > 0.1 > 5 * bias.mean_error
    assert bias.blocks > 0.1


def test_renders_that_resume_a_film_repeat_the_warning_about_its_bias_once() -> None:
    """The film has the measurement, so it is not made again."""
    scene = glpath.load_scene("cornell-box-36")
    options = {**GATHER, "radiosity": doubled(coarse_solution(scene))}
    cluster: Any = Cluster.__new__(Cluster)  # a complete film needs no workers
    film = None
    for further in ({"spp": 8}, {}, {"cluster": cluster}):
        with pytest.warns(SceneWarning) as warned:
            film = glpath.render(scene, film=film, **{**options, **further})
        assert ["the bias of the gather is +" in str(each.message) for each in warned] == [True]
    with pytest.warns(SceneWarning), pytest.raises(glpath.StrictError, match="the bias of the gather") as caught:
        glpath.render(scene, film=film, strict=True, **options)
    assert caught.value.result is film


AUTO = {"spp": 16, "resolution": (128, 96)}


def test_auto_takes_path_where_even_a_refined_solution_is_wrong(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    solve, refinements = factory.solve_for_gather, []

    def wrong(scene, on_progress=None, *, refined=False):
        refinements.append(refined)
        return doubled(solve(scene, on_progress))

    monkeypatch.setattr(factory, "solve_for_gather", wrong)
    film = glpath.render("cornell-box-36", **AUTO)
    assert film.metadata.integrator == "path"
    assert not film.metadata.biased
    assert film.bias() is None
    assert film.rejected_bias().mean > 0.1
    assert refinements == [False, True]
    half = glpath.render("cornell-box-36", **(AUTO | {"spp": 8}))
    half.save(tmp_path / "half.npz")
    resumed = glpath.render("cornell-box-36", film=Film.load(tmp_path / "half.npz"), **AUTO)
    assert np.array_equal(resumed.mean, film.mean)
    assert resumed.rejected_bias() == film.rejected_bias()
    with pytest.raises(glpath.UsageError, match="integrator is path in it, gather is asked for"):
        glpath.render("cornell-box-36", film=half, **AUTO, integrator="gather")


def test_a_bias_measured_after_a_film_was_begun_leaves_it_a_gather(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time limit of the first run may have left no time for the measurement or for another engine."""
    solve = factory.solve_for_gather
    monkeypatch.setattr(factory, "solve_for_gather", lambda *given, **options: doubled(solve(*given, **options)))
    with monkeypatch.context() as without_time:
        without_time.setattr(BiasCheck, "_measured", lambda *_: None)
        without_time.setattr(BiasCheck, "_in_time", lambda *_: None)
        with pytest.warns(SceneWarning, match="left no time to measure the bias"):
            half, whole = (glpath.render("cornell-box-36", **{**AUTO, "spp": spp}) for spp in (8, 16))
    with pytest.warns(SceneWarning, match="the bias of the gather is"):
        film = glpath.render("cornell-box-36", film=half, **AUTO)
    assert film.metadata.integrator == "gather"
    assert film.metadata.biased
    assert np.array_equal(film.mean, whole.mean)


def test_auto_refines_a_solution_that_is_wrong(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    solve = factory.solve_for_gather

    def wrong_at_first(scene, on_progress=None, *, refined=False):
        found = solve(scene, on_progress)
        return found if refined else doubled(found)

    monkeypatch.setattr(factory, "solve_for_gather", wrong_at_first)
    film = glpath.render("cornell-box-36", **AUTO)
    assert film.metadata.integrator == "gather"
    assert film.metadata.settings["refined"] is True
    assert film.bias().is_small()
    half = glpath.render("cornell-box-36", **(AUTO | {"spp": 8}))
    half.save(tmp_path / "half.npz")
    resumed = glpath.render("cornell-box-36", film=Film.load(tmp_path / "half.npz"), **AUTO)
    assert np.array_equal(resumed.mean, film.mean)


@pytest.mark.parametrize("side", [(160, 120), (640, 480)])
def test_the_bias_does_not_depend_on_the_resolution(side) -> None:
    found = glpath.render("cornell-box-36", **(GATHER | {"spp": 1, "resolution": side})).bias()
    assert found.mean_error < 0.005
    assert abs(found.mean) < 0.005


def test_the_bias_of_light_at_points_is_measured() -> None:
    points, normals = np.array([[0.0, 0.5, 0.9], [-0.5, 0.3, 0.7]]), np.array([0.0, 1.0, 0.0])
    scene = glpath.load_scene("cornell-box-36")
    right = glpath.irradiance(scene, points, normals, integrator="gather", spp=16).film.bias()
    assert abs(right.mean) < 0.01
    with pytest.warns(SceneWarning, match="the bias of the gather"):
        wrong = glpath.irradiance(
            scene, points, normals, integrator="gather", radiosity=doubled(coarse_solution(scene)), spp=16
        )
    assert wrong.film.bias().mean > 0.05


def test_a_reduced_sensor_has_the_same_points() -> None:
    random = np.random.default_rng(3)
    positions, valid = random.random((2, 10, 30, 3)).astype(np.float32), random.random((10, 30)) < 0.7
    normals = np.broadcast_to(np.float32([0, 0, 1]), positions.shape)
    sensor = PointSensor.of(positions, normals, valid).reduced(32)
    assert sensor.resolution == (32, 16)
    known = {tuple(row) for row in np.hstack([*positions[:, valid]]).tolist()}
    rows = sensor.points.positions.reshape(2, -1, 3)
    assert {tuple(row) for row in np.hstack([*rows]).tolist()} == known, "each valid one, and pairs of tables kept"
    # One block of 8 x 8 has points that are neighbours in their order.
    first = sensor.points.positions[0, :2, :4].reshape(-1, 3)
    order = [positions[0][valid].tolist().index(row) for row in first.tolist()]
    assert max(order) - min(order) < 8


@pytest.mark.parametrize(
    "options", [{"integrator": "path", "max_depth": 3}, {"integrator": "path-buffer", "max_depth": 2}]
)
def test_an_engine_without_bias_has_no_probe(options) -> None:
    assert glpath.render("cornell-box-36", **{**GATHER, **options}).bias() is None


@pytest.mark.parametrize("options", [{"crop": (0, 0, 20, 30)}, {"cast": "path-buffer"}, {"spp": 1}])
def test_the_bias_of_crops_scans_and_single_sets_is_measured(options) -> None:
    bias = glpath.render("cornell-box-36", **{**GATHER, **options}).bias()
    assert bias is not None
    assert bias.is_small()


def test_lists_of_statistics_add_up() -> None:
    assert merged_values({"a": [1, 2.5]}, {"a": [3, 4]}) == {"a": [4, 6.5]}


@pytest.mark.parametrize(
    "wrong", [3, {"sets": 1}, {"sets": 2, "light": [1.0], "difference": [1.0], "square": [1.0]}]
)
def test_a_file_with_another_description_is_refused(tmp_path, wrong) -> None:
    film = glpath.render("cornell-box-36", **GATHER)
    object.__setattr__(film.metadata, "statistics", {BIAS_PROBE: wrong})
    film.save(tmp_path / "a.npz")
    with pytest.raises(ImageError, match="its bias probe"):
        Film.load(tmp_path / "a.npz")


def test_a_comparison_by_noise_names_the_bias_of_a_gather() -> None:
    """Two engines may differ by it alone; a failed comparison says how much that is."""
    scene = glpath.load_scene("cornell-box-36")
    with pytest.warns(SceneWarning, match="the bias of the gather"):
        film = glpath.render(scene, radiosity=doubled(coarse_solution(scene)), **{**GATHER, "spp": 64})
    gathered = Picture.of_film(film)
    traced = Picture.of_film(glpath.render(scene, **{**GATHER, "spp": 64, "integrator": "path"}))
    verdict = stat(gathered, traced)
    assert not verdict.passed
    assert "the picture, of a gather, has a bias of" in verdict.summary
    assert "has a bias" not in stat(traced, traced).summary


def test_an_interrupt_while_the_bias_is_measured_ends_the_render(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.rendering.bias.block_means", lambda _: signal.raise_signal(signal.SIGINT))
    with pytest.raises(glpath.rendering.RenderInterrupted) as caught:
        glpath.render("cornell-box-36", **GATHER)
    assert caught.value.film.path_sets == 0


def test_an_interrupt_while_a_rejected_gather_is_solved_again_ends_the_render(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stages: list[str] = []

    def solve(scene: object, report: Callable[[RadiosityProgress], None], **options: object) -> None:
        if not options:
            return solve_for_gather(scene, report)
        signal.raise_signal(signal.SIGINT)
        for steps in range(3):
            stages.append("particles")
            report(RadiosityProgress("particles", steps, 0.5, 0.0, 36, 1.0))
        raise AssertionError("the signal ends it")

    monkeypatch.setattr("glpath.rendering.factory.solve_for_gather", solve)
    monkeypatch.setattr("glpath.film.bias.Bias.is_small", lambda *_: False)
    with pytest.raises(glpath.rendering.RenderInterrupted):
        glpath.render("cornell-box-36", **AUTO)
    assert stages == ["particles"]


def test_where_there_is_no_room_for_the_probe_the_bias_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise ContextError("no room")

    monkeypatch.setattr("glpath.rendering.bias.block_means", full)
    text = "not enough memory to measure the bias of the gather"
    with pytest.warns(SceneWarning, match=text), pytest.raises(glpath.StrictError, match=text) as caught:
        glpath.render("cornell-box-36", **GATHER, strict=True)
    film = caught.value.result
    assert film.path_sets == 16
    assert film.bias() is None
    assert film.metadata.integrator == "gather"
    with pytest.warns(SceneWarning, match=text):
        glpath.render("cornell-box-36", **GATHER, film=film)
    # What "auto" cannot measure, it does not take; and a film that was begun so is resumed.
    half = glpath.render("cornell-box-36", **(AUTO | {"spp": 8}))
    assert half.metadata.integrator == "path"
    assert glpath.render("cornell-box-36", film=half, **AUTO).path_sets == 16


def _no_room(*_: object) -> None:
    raise ContextError("no room")


UNMEASURED = "not enough memory to measure the bias of the gather"
CALLS: dict[str, Callable[..., Any]] = {
    "render": lambda **options: glpath.render("cornell-box-36", **GATHER, **options),
    "frames": lambda **options: list(glpath.render_frames("cornell-box-36", [{}], **GATHER, **options)),
    "views": lambda **options: glpath.render_views(
        "cornell-box-36", [np.eye(4)], [[30.0, 0, 16], [0, 30, 16], [0, 0, 1]], integrator="gather", **options
    ),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
@pytest.mark.parametrize("strict", [False, True], ids=["", "strict"])
def test_an_interrupted_film_has_the_warning_about_its_bias(
    call: Callable[..., Any], strict: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.rendering.bias.block_means", _no_room)
    films: list[Film] = []

    def stop(film: Film) -> None:
        films.append(film)
        signal.raise_signal(signal.SIGINT)

    with (
        pytest.warns(SceneWarning, match=UNMEASURED),
        pytest.raises(glpath.RenderInterrupted) as caught,
    ):
        call(on_step=stop, strict=strict)
    assert caught.value.film is films[0]
    assert caught.value.film.path_sets > 0


@pytest.mark.parametrize("failure", ["interrupt", "chunks"])
def test_a_film_that_a_cluster_does_not_finish_has_the_warning_about_its_bias(
    failure: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.rendering.bias.block_means", _no_room)
    with pytest.warns(SceneWarning, match=UNMEASURED):
        film = glpath.render("cornell-box-36", **GATHER)
    error = RenderInterrupted(film) if failure == "interrupt" else ChunksFailedError("no worker", "", film)

    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr("glpath.jobs.cluster._Render.run", fail)
    cluster: Any = Cluster.__new__(Cluster)  # no path set reaches its workers
    with pytest.warns(SceneWarning, match=UNMEASURED), pytest.raises(type(error)) as caught:
        glpath.render("cornell-box-36", film=film, cluster=cluster, strict=True, **(GATHER | {"spp": 32}))
    assert caught.value is error


def test_the_summary_says_why_a_bias_was_not_measured(make_film: MakeFilm) -> None:
    film = make_film([(0, 8)], statistics={BIAS_OBSTACLE: f"there was {UNMEASURED}"})
    assert [*bias_lines(film)] == [f"  there was {UNMEASURED}; --integrator path has none"]
    assert [*bias_lines(make_film([(0, 8)]))] == []
