"""What is there before anything renders: the packages are those that are declared, and little is loaded."""

from __future__ import annotations

import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmarks.benches.footprint import bench_footprint, core_sizes
from tests.support.repository import ROOT


def test_the_core_has_what_is_declared_and_no_extra() -> None:
    sizes = core_sizes()
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    wanted = [each for each in map(Requirement, declared) if each.marker is None or each.marker.evaluate()]
    assert {canonicalize_name(each.name) for each in wanted} <= set(sizes)
    assert {"matplotlib", "pyoidn", "pytest", "sphinx", "pygltflib", "glpath"}.isdisjoint(sizes)
    assert sizes["numpy"] > 10e6


def test_help_and_the_plugin_cost_little() -> None:
    """Thrice the bench's marks, as other processes of the tests share the caches of the processor."""
    report = bench_footprint(rounds=3)
    measured = report.measured
    assert measured["help_ms"] < 900
    assert measured["render_help_ms"] < 1200
    assert measured["plugin_ms"] < 15
    assert measured["plugin_modules"] < 20
    assert sum(row["megabytes"] for row in report.rows) == pytest.approx(measured["megabytes"])
