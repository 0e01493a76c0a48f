"""The claims of TB's figures: they hold of the engines, and of no wrong one.

Times are made up from the counted tests where they have a part in the verdict: those of small frames on a busy
machine say nothing. What a figure does with real ones is in `test_t_buffer_figures`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.figures import t_buffer_curves, t_buffer_pictures, whitted_frame
from benchmarks.figures.catalogue import FIGURES
from benchmarks.figures.sphere_rays import SphereRays
from benchmarks.figures.t_buffer_curves import fit, quadratic_share
from benchmarks.figures.whitted_frame import WhittedFrame
from glpath.buffers.shadow_buffer import SphereShadowBuffer
from glpath.buffers.t_buffer import ClassicEye
from glpath.integrators import whitted
from tests.conftest import Spoil
from tests.reference import numpy_ray_tracer

SCALE = {9: 0.2, 10: 0.2, 11: 0.3, 12: 0.2, 13: 0.1, 14: 0.1, 15: 0.1, 16: 0.1, 17: 0.1, 18: 0.6}
Patch = Callable[[pytest.MonkeyPatch, Spoil], None]


def verdict(number: int) -> bool | None:
    report = FIGURES[f"t-buffer-{number}"][0](SCALE[number], lambda _: None).report
    print(report.claim, report.measured)
    return report.holds


def clock(overhead: float = 1e-3, test: float = 2e-7) -> Callable[[WhittedFrame], float]:
    """Seconds of a frame that takes so long for each test, and before the first."""

    def seconds(frame: WhittedFrame) -> float:
        return overhead + test * sum(frame.tests().values())

    return seconds


def undrawn(*_, **__) -> np.ndarray:
    """A page that nobody will look at."""
    return np.zeros((1, 1, 3), np.uint8)


@pytest.fixture(autouse=True)
def times_go_with_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WhittedFrame, "seconds", clock())
    monkeypatch.setattr(t_buffer_pictures, "pictures", undrawn)
    monkeypatch.setattr(t_buffer_curves, "plot", undrawn)
    monkeypatch.setattr(t_buffer_curves, "COUNTS", (10, 1000, 6000))
    monkeypatch.setattr(t_buffer_curves, "RESOLUTIONS", (200, 500, 1000, 1500, 2000))


@pytest.mark.parametrize("number", SCALE)
def test_a_claim_holds_of_the_engines(number: int) -> None:
    assert verdict(number) is True


def shader(file: str, text: str, other: str) -> Patch:
    return lambda _, spoil: spoil(file, text, other)


def attribute(target: object, name: str, value: object) -> Patch:
    return lambda monkeypatch, _: monkeypatch.setattr(target, name, value)


def coarse(gl, objects, rows, columns, lights):
    """A shadow-buffer that has few entries, whatever it was asked for."""
    return SphereShadowBuffer(gl, objects, 30, 60, lights)


FARTHEST = shader(
    "t_buffer/t_buffer.frag", "gl_FragDepth = t * DEPTH_SCALE;", "gl_FragDepth = 1.0 - t * DEPTH_SCALE;"
)
NARROW = shader(
    "t_buffer/t_buffer.vert", "own_pixels = ivec4(begin, end);", "own_pixels = ivec4(begin + 1, end - 1);"
)
UNCOUNTED = shader("t_buffer/t_buffer.frag", "atomicAdd(tests_of_pixel[pixel.y * eye_size.x + pixel.x], 1u);", "")
CLASSIC_UNCOUNTED = shader("t_buffer/classic_eye.frag", "+= tests;", "+= tests / 2u;")
NO_T_BUFFER = attribute(whitted, "TBuffer", lambda *given, records, **more: ClassicEye(*given, **more))
NO_SHADOW_RAYS = shader(
    "t_buffer/whitted.frag", "if (reaches && shadow_ray_blocked(at, light, wi, ray.tmax)) visible = 0.0;", ""
)
NO_REFLECTION = shader("t_buffer/whitted.frag", "weight *= share;", "weight *= 0.0;")
ALL_LIT = shader(
    "shadow/point_shadow.glsl", "return seen.w == 0u || shape_of(int(seen.w) - 1) != object;", "return false;"
)
ALL_DARK = shader(
    "shadow/point_shadow.glsl", "return seen.w == 0u || shape_of(int(seen.w) - 1) != object;", "return true;"
)
SHADOWS_OF_THE_FARTHEST = shader(
    "shadow/point_shadow_fill.frag", "gl_FragDepth = t * DEPTH_SCALE;", "gl_FragDepth = 1.0 - t * DEPTH_SCALE;"
)
COARSE = attribute(whitted, "SphereShadowBuffer", coarse)


@pytest.mark.parametrize(
    ("number", "wrong"),
    [
        pytest.param(9, FARTHEST, id="9: keeps the farthest object"),
        pytest.param(9, NARROW, id="9: leaves out the outlines"),
        pytest.param(9, NO_T_BUFFER, id="9: shoots every ray at every object"),
        pytest.param(10, FARTHEST, id="10: keeps the farthest object"),
        pytest.param(10, NO_REFLECTION, id="10: no reflections"),
        pytest.param(11, ALL_LIT, id="11: a shadow-buffer without shadows"),
        pytest.param(11, ALL_DARK, id="11: a shadow-buffer without light"),
        pytest.param(11, SHADOWS_OF_THE_FARTHEST, id="11: the shadow-buffer keeps the farthest object"),
        pytest.param(12, FARTHEST, id="12: keeps the farthest object"),
        pytest.param(12, NARROW, id="12: leaves out the outlines"),
        pytest.param(13, NO_T_BUFFER, id="13: shoots every ray at every object"),
        pytest.param(13, NARROW, id="13: leaves out rays that meet"),
        pytest.param(13, UNCOUNTED, id="13: does not count its tests"),
        pytest.param(13, CLASSIC_UNCOUNTED, id="13: counts half of the classical tests"),
        pytest.param(13, FARTHEST, id="13: keeps the farthest object"),
        pytest.param(14, NO_T_BUFFER, id="14: shoots every ray at every object"),
        pytest.param(14, UNCOUNTED, id="14: does not count its tests"),
        pytest.param(14, CLASSIC_UNCOUNTED, id="14: counts half of the classical tests"),
        pytest.param(14, NO_SHADOW_RAYS, id="14: no shadow rays, whose tests make the gain saturate"),
        pytest.param(15, ALL_LIT, id="15: a shadow-buffer without shadows"),
        pytest.param(15, NO_T_BUFFER, id="15: shoots every ray at every object"),
        pytest.param(15, UNCOUNTED, id="15: does not count its tests"),
        pytest.param(16, COARSE, id="16: a finer shadow-buffer is not finer"),
        pytest.param(16, ALL_LIT, id="16: a shadow-buffer without shadows"),
        pytest.param(17, COARSE, id="17: a finer shadow-buffer is not finer"),
        pytest.param(18, COARSE, id="18: a finer shadow-buffer is not finer"),
        pytest.param(18, ALL_LIT, id="18: a shadow-buffer without shadows"),
        pytest.param(18, SHADOWS_OF_THE_FARTHEST, id="18: the shadow-buffer keeps the farthest object"),
    ],
)
def test_no_claim_holds_of_a_wrong_engine(number: int, wrong: Patch, monkeypatch, spoil: Spoil) -> None:
    wrong(monkeypatch, spoil)
    assert verdict(number) is False


@pytest.mark.parametrize(
    ("number", "seconds"),
    [
        pytest.param(13, lambda frame: 1e-3, id="13: as fast as the classical algorithm"),
        pytest.param(14, lambda frame: 1e-3, id="14: a gain that does not grow"),
        pytest.param(
            14,
            lambda frame: clock(0.0)(frame) if frame._settings.primary == "classic" else 1e-3,
            id="14: a gain that does not saturate",
        ),
        pytest.param(
            15, lambda frame: 1e-6 * len(frame._objects.scene.spheres), id="15: the cost grows with the objects"
        ),
        pytest.param(16, lambda frame: 1e-3 + 1e-9 * frame.tests()["primary"], id="16: entries cost nothing"),
        pytest.param(
            17, lambda frame: 1e-3 * frame._settings.shadow_resolution, id="17: time in proportion to the rows"
        ),
        pytest.param(
            17, lambda frame: 1e-6 * frame._settings.shadow_resolution**3, id="17: time in proportion to their cube"
        ),
        pytest.param(
            17, lambda frame: np.sqrt(frame._settings.shadow_resolution), id="17: time as the root of the rows"
        ),
    ],
)
def test_no_claim_holds_of_another_cost(number: int, seconds, monkeypatch) -> None:
    monkeypatch.setattr(WhittedFrame, "seconds", seconds)
    assert verdict(number) is False


@pytest.mark.parametrize("shown", [3, 100])
def test_figure_12_wants_as_many_objects_as_it_says(shown: int, monkeypatch) -> None:
    monkeypatch.setattr(t_buffer_pictures, "stacked", lambda objects, size: whitted_frame.stacked(shown, size))
    assert verdict(12) is False


# The independent count


@pytest.mark.parametrize("objects", [3, 50])
def test_the_count_in_numpy_is_that_of_every_ray_against_every_sphere(objects: int) -> None:
    scene = whitted_frame.stacked(objects, (40, 30))
    found = SphereRays.of(scene)
    origins, directions = numpy_ray_tracer.camera_rays(scene)
    all_t = numpy_ray_tracer.all_hits(scene, origins, directions, 0.0)
    assert found.hits == np.isfinite(all_t).sum()
    assert found.primary_tests == all_t.size
    nearest, t = numpy_ray_tracer.nearest(scene, origins, directions)
    assert np.array_equal(found.nearest.ravel(), nearest)
    position = origins + np.where(nearest >= 0, t, 0)[:, None] * directions
    to_light = scene.lights[0].position - position
    normal = position - scene.spheres[nearest, :, 3]
    lit = (nearest >= 0) & (np.sum(normal * to_light, axis=1) > 0)
    assert found.shadow_rays == lit.sum()
    at = numpy_ray_tracer.all_hits(scene, position[lit], to_light[lit], 0.0) < 1
    at[np.arange(lit.sum()), nearest[lit]] = False
    tests = np.where(at.any(axis=1), at.argmax(axis=1) + 1, objects)
    assert found.shadow_tests == pytest.approx(tests.sum())
    assert found.shadowed == pytest.approx(at.any(axis=1).sum())


def test_the_shaders_count_as_numpy_does() -> None:
    scene = whitted_frame.stacked(50, (40, 30))
    found, classic = SphereRays.of(scene), WhittedFrame(scene, whitted_frame.CLASSIC)
    assert classic.tests()["primary"] == found.primary_tests
    # Rounding decides at outlines which sphere is met.
    assert classic.tests()["shadow"] == pytest.approx(found.shadow_tests, rel=0.01)
    assert np.array_equal(classic.nearest(), found.nearest)


def test_what_a_quadratic_owes_to_the_square() -> None:
    x = np.arange(200.0, 2001.0, 200.0)
    line, square, cube = (quadratic_share(x, fit(x, 5 + x**power, 2)[0]) for power in (1, 2, 3))
    assert (line, square) == (pytest.approx(0, abs=1e-6), pytest.approx(1))
    assert cube > 1.6
