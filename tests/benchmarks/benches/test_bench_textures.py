"""`bench textures`: its scenes are one scene, and its verdict goes by what was measured."""

from __future__ import annotations

import numpy as np
import pytest

import glpath
from benchmarks.benches import textures
from glpath.compare import relative_mse


def test_the_scenes_differ_in_how_they_are_shaded_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    plain, both = (textures.scene_of(kind, fineness=2, side=32) for kind in ("plain", "both"))
    np.testing.assert_array_equal(plain.triangles, both.triangles)
    assert len(textures.scene_of("plain").triangle_shape) >= 100_000
    assert not np.any(plain.shapes.vertex_normals)
    assert np.any(both.shapes.vertex_normals)
    a, b = (glpath.render(scene, spp=64, max_depth=3).mean for scene in (plain, both))
    assert a.mean() == pytest.approx(b.mean(), rel=0.02)
    assert 1e-4 < relative_mse(a, b) < 0.2


def test_the_verdict_is_that_of_the_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(textures, "FINENESS", 2)
    scene_of = textures.scene_of
    monkeypatch.setattr(textures, "scene_of", lambda kind, side: scene_of(kind, 2, side))
    report = textures.bench_textures(0.02, 1)
    assert not report.faults
    assert [row["scene"] for row in report.rows] == ["plain", "smooth", "textured", "both"]
    assert report.holds == (report.measured["both"] <= 1.3)
    assert all(report.measured[f"{kind}_ms"] > 0 for kind in ("plain", "smooth", "textured", "both"))
