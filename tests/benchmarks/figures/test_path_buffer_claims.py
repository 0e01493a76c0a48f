"""The claims of PB's figures: they hold of the engines, as small as still tells, and of no wrong one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.figures import path_buffer_box, path_buffer_room, path_pictures
from benchmarks.figures.catalogue import FIGURES
from benchmarks.references import stored as references
from glpath.radiosity import solve_radiosity
from glpath.rendering import render
from tests.conftest import Spoil

SCALE = {5: 0.016, 6: 0.016, 7: 0.016, 8: 0.016, 9: 0.03, 11: 0.004, 13: 0.03}
Patch = Callable[[pytest.MonkeyPatch, Spoil], None]


def verdict(number: int, scale: float | None = None) -> bool | None:
    make = FIGURES[f"path-buffer-{number}"][0]
    report = make(SCALE[number] if scale is None else scale, lambda _: None).report
    print(report.claim, report.measured)
    return report.holds


@pytest.fixture(autouse=True)
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_pictures, "pictures", lambda *_: np.zeros((1, 1, 3), np.uint8))


# The room takes its time.
ROOM = [pytest.param(number, marks=pytest.mark.evidence) for number in (11, 13)]


@pytest.mark.parametrize("number", [*(number for number in SCALE if number < 10), *ROOM])
def test_a_claim_holds_of_the_engines(number: int) -> None:
    assert verdict(number) is True


def shader(file: str, text: str, other: str) -> Patch:
    return lambda _, spoil: spoil(file, text, other)


def renderer(**other: object) -> Patch:
    """Renders with other options than it was asked for; a function makes one of what was asked."""

    def rendered(scene, **options):
        for name, value in other.items():
            options[name] = value(options[name]) if callable(value) else value
        return render(scene, **options)

    return lambda monkeypatch, _: monkeypatch.setattr(path_pictures, "render", rendered)


def solver(change: Callable = lambda solution: solution, **other: object) -> Patch:
    """Solves with other options, or makes something else of the solution."""

    def solved(scene, **options):
        return change(solve_radiosity(scene, **(options | other)))

    return lambda monkeypatch, _: monkeypatch.setattr(path_pictures, "solve_radiosity", solved)


def scaled(direct: float, indirect: float) -> Callable:
    """Makes a solution of which the two parts are that many times as bright."""
    parts = np.array([direct, indirect])[:, None, None, None]
    return lambda found: replace(found, elements=parts * found.elements, vertices=parts * found.vertices)


NO_Z0 = shader("path_buffer/scan_cell.glsl", "greaterThan(t, vec4(min_t))", "greaterThan(abs(t), vec4(0.0))")
BRIGHT = shader("lights/light_sample.glsl", "found.light = l.radiance *", "found.light = 2.0 * l.radiance *")
NO_SHADOWS = shader(
    "lights/direct.glsl",
    "    vec3 w = position - light_position;\n    vec3 p",
    "    return false;\n    vec3 w = position - light_position;\n    vec3 p",
)
BLACK_LOOK_UP = shader("path/path_gather.frag", "dot(v.n, v.wo)) * found.rgb / PI", "dot(v.n, v.wo)) * 0.0")
BRIGHT_LOOK_UP = shader(
    "path/path_gather.frag",
    "dot(v.n, v.wo)) * found.rgb / PI",
    "dot(v.n, v.wo)) * found.rgb",
)
ONE_BOUNCE_LESS, ONE_MORE = (
    renderer(max_depth=lambda depth: max(depth - 1, 1)),
    renderer(max_depth=lambda depth: depth + 1),
)


def shown_as_it_is(monkeypatch: pytest.MonkeyPatch, _: Spoil) -> None:
    """A gather that is none: the solution itself."""

    def gathered(say, what, hits, path_sets, solution):
        radiance = hits.radiance(solution, "constant")
        return path_pictures.Picture(radiance, path_pictures.mean_of(hits, radiance), path_sets, 1.0)

    for module in (path_buffer_box, path_buffer_room):
        monkeypatch.setattr(module, "gathered", gathered)


WRONG = [
    pytest.param(5, BRIGHT, id="5: the light is twice as bright"),
    pytest.param(5, NO_SHADOWS, id="5: no shadows"),
    pytest.param(5, ONE_MORE, id="5: a bounce more"),
    pytest.param(6, NO_Z0, id="6: no test against z0"),
    pytest.param(6, BRIGHT, id="6: the light is twice as bright"),
    pytest.param(6, NO_SHADOWS, id="6: no shadows"),
    pytest.param(6, ONE_BOUNCE_LESS, id="6: a bounce less"),
    pytest.param(6, ONE_MORE, id="6: a bounce more"),
    pytest.param(7, NO_Z0, id="7: no test against z0"),
    pytest.param(7, BRIGHT, id="7: the light is twice as bright"),
    pytest.param(7, ONE_BOUNCE_LESS, id="7: a bounce less"),
    pytest.param(7, ONE_MORE, id="7: a bounce more"),
    pytest.param(8, solver(scaled(2, 2)), id="8: the light is twice as bright"),
    pytest.param(8, solver(scaled(1, 0)), id="8: no indirect light"),
    pytest.param(8, solver(patches=2000), id="8: the mesh is not coarse"),
    pytest.param(9, shown_as_it_is, id="9: no gather"),
    pytest.param(9, BLACK_LOOK_UP, id="9: the solution is not looked up"),
    pytest.param(9, BRIGHT_LOOK_UP, id="9: the solution is looked up without 1 / pi"),
    pytest.param(9, NO_Z0, id="9: no test against z0"),
    pytest.param(11, solver(scaled(2, 2)), id="11: the light is twice as bright", marks=pytest.mark.evidence),
    pytest.param(11, solver(scaled(1, 0)), id="11: no indirect light", marks=pytest.mark.evidence),
    pytest.param(11, solver(seed=0), id="11: no noise", marks=pytest.mark.evidence),
    pytest.param(13, BRIGHT, id="13: the light is twice as bright", marks=pytest.mark.evidence),
    pytest.param(13, NO_SHADOWS, id="13: no shadows", marks=pytest.mark.evidence),
    pytest.param(13, BLACK_LOOK_UP, id="13: the solution is not looked up", marks=pytest.mark.evidence),
]


@pytest.mark.parametrize(("number", "wrong"), WRONG)
def test_no_claim_holds_of_a_wrong_engine(number: int, wrong: Patch, monkeypatch, spoil: Spoil) -> None:
    wrong(monkeypatch, spoil)
    assert verdict(number) is False


# Figure 12 has to be large, to show what is behind a post.


@pytest.mark.evidence
def test_the_claim_of_figure_12_holds(monkeypatch) -> None:
    assert verdict(12, 0.1) is True


@pytest.mark.evidence
@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(shown_as_it_is, id="no gather"),
        pytest.param(NO_Z0, id="no test against z0"),
    ],
)
def test_the_claim_of_figure_12_does_not_hold_of_a_wrong_gather(wrong: Patch, monkeypatch, spoil: Spoil) -> None:
    wrong(monkeypatch, spoil)
    assert verdict(12, 0.1) is False


# What pictures are held against


def test_a_picture_as_small_as_a_reference_is_the_mean_of_its_pixels() -> None:
    image = np.arange(8 * 8 * 3, dtype=float).reshape(8, 8, 3)
    small, same = references.at_one_size(image, np.zeros((4, 4, 3)))
    assert same.shape == small.shape == (4, 4, 3)
    assert np.array_equal(small[1, 2], image[2:4, 4:6].mean(axis=(0, 1)))


def test_a_reference_that_is_missing_is_named() -> None:
    assert references.find_reference("cornell-box-36", 17) is None
    with pytest.raises(references.GlpathError, match="cornell-box-36-depth17"):
        references.stored_reference("cornell-box-36", 17)
