"""`bench viewfactors`: what it measures, without its peer."""

from __future__ import annotations

import pytest

from benchmarks.benches.view_factors import bench_view_factors
from benchmarks.peers import other_python
from glpath.errors import GlpathError


def test_a_small_bench_without_pyviewfactor_measures_and_claims_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str, interpreter: str) -> tuple[str, str]:
        raise GlpathError(f"{name} is not installed for {interpreter}; it is needed only as a peer.")

    monkeypatch.setattr(other_python, "find_package", nothing)
    said: list[str] = []
    report = bench_view_factors(0.1, 1, said.append)
    assert report.holds is None
    assert report.faults == []
    assert report.measured["closed_forms_off"] < 0.005
    assert report.measured["closure_error_most"] < 1e-3
    assert report.measured["city_facets"] == 57 * 4
    assert {row["faces"] for row in report.rows if "faces" in row} == {96}
    assert any("228 of 228 rows after" in line for line in said)  # of the city, which takes longest
    assert any(note.startswith("without pyviewfactor") for note in report.notes)
