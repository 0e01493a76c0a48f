"""`bench measure`: what it measures without its peer, and that Radiance finds the same light."""

from __future__ import annotations

import numpy as np
import pytest

import glpath
from benchmarks.benches import measure
from benchmarks.benches.measure import bench_measure, office_grid
from benchmarks.peers import other_python
from benchmarks.peers import radiance as radiance_peer
from glpath.errors import GlpathError
from glpath.system.colour import luminance


@pytest.mark.evidence
def test_a_small_bench_without_radiance_measures_and_claims_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str, interpreter: str) -> tuple[str, str]:
        raise GlpathError(f"{name} is not installed for {interpreter}; it is needed only as a peer.")

    monkeypatch.setattr(other_python, "find_package", nothing)
    report = bench_measure(0.05)
    assert report.holds is None
    assert report.faults == []
    assert report.measured["lamp_off"] < 0.01
    assert 0 < report.measured["reference_error"] < 0.2
    assert {row["program"] for row in report.rows} == {"path", "gather"}
    assert any(note.startswith("without rtrace") for note in report.notes)


def test_it_is_judged_by_what_radiance_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is a tenth too bright is a fault; a slow one that agrees is beaten."""
    monkeypatch.setattr(radiance_peer, "version", lambda: "5")
    monkeypatch.setattr(measure, "lamp_off", lambda: 0.001)

    # Both benches measure the same by ours: it is done once.
    kept: dict[object, glpath.Irradiance] = {}
    alone = measure.irradiance

    def once(scene, points, normals, **options):
        key = (len(points), *sorted(options.items()))
        return kept[key] if key in kept else kept.setdefault(key, alone(scene, points, normals, **options))

    monkeypatch.setattr(measure, "irradiance", once)
    found: list[np.ndarray] = []

    def played(factor: float, seconds: float) -> None:
        def answer(scene, points, normals, settings):
            if not found:  # it is asked for the same points each time
                found.append(glpath.irradiance(scene, points, normals, spp=256, seed=7).values)
            assert found[0].shape[:-1] == points.shape[:-1]
            return seconds, factor * found[0]

        monkeypatch.setattr(radiance_peer, "irradiance", answer)

    played(1.0, 1e6)
    report = bench_measure(0.05)
    assert report.faults == []
    assert report.holds
    assert report.measured["vs_radiance"] > 1
    played(1.1, 1e6)
    report = bench_measure(0.05)
    assert report.holds is False
    assert "radiance_off" in report.faults[0]


@pytest.mark.evidence
def test_radiance_finds_the_same_irradiance_in_the_office() -> None:
    try:
        radiance_peer.version()
    except GlpathError as error:
        pytest.skip(str(error))
    scene, points, normals = office_grid(6)
    settings = f"{measure._DIRECT} {measure._ALONE.format(1024, 1 / 1024, 0)}"
    _, theirs = radiance_peer.irradiance(scene, points, normals, settings)
    ours = glpath.irradiance(scene, points, normals, spp=4096)
    assert luminance(ours.values).mean() == pytest.approx(luminance(theirs).mean(), rel=0.02)
    off = luminance(ours.values) - luminance(theirs)
    assert np.sqrt(np.mean(off**2)) < 0.03 * luminance(theirs).mean()
