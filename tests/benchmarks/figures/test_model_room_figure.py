"""`figure model-room`: what it measures, on a small box in place of the room."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from benchmarks.figures import model_room
from glpath.io import load_scene
from glpath.io.export.mitsuba import described
from glpath.scene import Scene
from tests.support.figure_reports import holds_by_its_rule


def test_errors_leave_the_worst_pixels_out_once_and_once_not() -> None:
    reference = np.ones((20, 50, 3))
    image = reference.copy()
    image[3, 4] = 100.0  # a firefly
    row = model_room._row("path", image, reference, 8, 1.5)
    assert row["relmse"] > 1
    assert row["relmse_without_worst"] == 0
    assert (row["program"], row["samples"], row["processor_seconds"]) == ("path", 8, 1.5)
    assert row["mean"] == pytest.approx(1 + 99 / 1000)


def test_as_many_samples_as_fit_are_taken() -> None:
    asked = []

    def make(count: int) -> np.ndarray:
        asked.append(count)
        total = 0
        for i in range(40_000 * count):
            total += i
        return np.full((1, 1, 3), float(total > 0))

    _, taken = model_room._timed(lambda: make(8))
    image, count, seconds = model_room._within(4 * taken, make)
    assert image.shape == (1, 1, 3)
    assert 12 <= count <= 96
    assert seconds > 0
    assert asked[-2:] == [count, count]


def test_mitsuba_has_every_surface_of_the_room_as_it_is() -> None:
    """A base under microfacets is another in Mitsuba, and made its picture of the room 2.5 % lighter."""
    room = load_scene("parlour")
    assert any("its base under microfacets" in text for text in described(room, 12).differences)
    alike = model_room.comparable(room)
    # Mitsuba inverts the relief of some walls, which does not change how much they reflect.
    assert [text for text in described(alike, 12).differences if "inverted along green" not in text] == []
    assert {m.name for m in alike.materials if m.has_lobes and m.metallic == 1} == {
        "parlour/gilt",
        "parlour/brass",
        "parlour/mirror",
    }
    before, after = ({name for m in scene.materials for name in m.slots} for scene in (room, alike))
    assert before == after


@pytest.mark.evidence
@pytest.mark.skipif(find_spec("mitsuba") is None, reason="needs the extra reference")
def test_in_a_box_all_mean_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def small(folder: Path, width: int) -> Scene:
        return load_scene("cornell-box-36").with_camera(resolution=(width, 3 * width // 4))

    monkeypatch.setattr(model_room, "_as_model", small)
    report = model_room.model_room(0.05, lambda _: None).report
    assert [row["program"] for row in report.rows] == ["gather", "path tracing", "Mitsuba 3"]
    for row in report.rows:
        assert row["mean"] == pytest.approx(1, abs=0.1)
        assert 0 < row["relmse_without_worst"] <= row["relmse"] * 1.01
    assert report.measured["references_apart"] < 0.05
    seconds = [row["processor_seconds"] for row in report.rows]
    assert max(seconds) < 5 * min(seconds)
    assert report.holds is holds_by_its_rule(
        {"claim": report.claim, "measured": report.measured, "holds": report.holds}
    )
