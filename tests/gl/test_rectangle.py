"""Directions towards a rectangle, drawn by the shader: uniform in its solid angle, of the density it says."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import glpath.gl.program as program
from glpath.gl.context import get_context
from glpath.scene.model import Float64
from tests.support.repository import TESTS

# A corner, two edges, and where they are seen from.
BEHIND = ((-1, -1, 0), (2, 0, 0), (0, 2, 0), (0, 0, -1))
SEEN: dict[str, tuple[Any, Any, Any, Any]] = {
    "straight above": ((-1, -1, 0), (2, 0, 0), (0, 2, 0), (0, 0, 1)),
    "beside": ((1, 2, 0), (2, 0, 0), (0, 1, 0), (0, 0, 1.5)),
    "close": ((-1, -1, 0), (2, 0, 0), (0, 3, 0), (0.3, 0.2, 0.01)),
    "past its edge": ((-1, -1, 0), (2, 0, 0), (0, 2, 0), (1.5, 0.2, 0.05)),
    "long and narrow": ((-5, 0.3, 0), (10, 0, 0), (0, 0.1, 0), (0, 0, 0.5)),
    "turned": ((1, 1, 1), (0.6, 0.8, 0), (-0.8, 0.6, 0), (1, 2, 2)),
    "small": ((0.5, 0.5, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 2)),
    "just above the limit": ((0, 0, 0), (0.11, 0, 0), (0, 0.11, 0), (0, 0, 1)),
}


@pytest.fixture(scope="module")
def probe(tmp_path_factory: pytest.TempPathFactory) -> Iterator[program.Program]:
    folder = tmp_path_factory.mktemp("shaders")
    shutil.copytree(program.shader_folder(), folder, dirs_exist_ok=True)
    shutil.copy(TESTS / "reference" / "rectangle_probe.comp", folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(program, "shader_folder", lambda: folder)
        yield program.load_program(get_context().gl, compute="rectangle_probe.comp")


def drawn(probe: program.Program, seen: str, u: Float64) -> tuple[Float64, Float64, Float64, Float64]:
    """(N, 3) directions towards a rectangle and (N,) their densities; the same of directions all around."""
    gl = get_context().gl
    for name, value in zip(("corner", "across", "up", "from"), SEEN.get(seen, BEHIND), strict=True):
        probe.gl[name] = tuple(map(float, value))  # type: ignore[index]
    numbers, found = gl.buffer(u.astype(np.float32).tobytes()), gl.buffer(reserve=32 * len(u))
    numbers.bind_to_storage_buffer(0)
    found.bind_to_storage_buffer(1)
    probe.gl.run(group_x=-(-len(u) // 64))  # type: ignore[union-attr]
    gl.memory_barrier()
    rows = np.frombuffer(found.read(), np.float32).reshape(-1, 2, 4).astype(np.float64)
    for buffer in (numbers, found):
        buffer.release()
    return rows[:, 0, :3], rows[:, 0, 3], rows[:, 1, :3], rows[:, 1, 3]


def solid_angle(seen: str) -> float:
    """By two triangles [Van Oosterom & Strackee 1983]."""
    a, x, y, o = (np.asarray(each, float) for each in SEEN[seen])
    corners = np.array([a, a + x, a + x + y, a + y]) - o
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    total = 0.0
    for i, j, k in ((0, 1, 2), (0, 2, 3)):
        p, q, r = corners[i], corners[j], corners[k]
        total += 2 * np.arctan2(abs(p @ np.cross(q, r)), 1 + p @ q + q @ r + r @ p)
    return total


def numbers(count: int) -> Float64:
    return np.random.default_rng(5).random((count, 2))


@pytest.mark.parametrize("seen", SEEN)
def test_directions_meet_the_rectangle_with_the_density_that_is_said(probe: Any, seen: str) -> None:
    directions, pdf, _, _ = drawn(probe, seen, numbers(20000))
    a, x, y, o = (np.asarray(each, float) for each in SEEN[seen])
    n = np.cross(x, y) / np.linalg.norm(np.cross(x, y))
    t = ((a - o) @ n) / (directions @ n)
    at = o + t[:, None] * directions - a
    u, v = at @ x / (x @ x), at @ y / (y @ y)
    assert np.all(t > 0)
    assert min(u.min(), v.min()) > -1e-4
    assert max(u.max(), v.max()) < 1 + 1e-4
    angle = solid_angle(seen)
    inside = pdf > 0  # rounding leaves few outside
    assert inside.mean() > 0.999
    if angle > 0.01:
        np.testing.assert_allclose(pdf[inside], 1 / angle, rtol=2e-4)
    else:
        area = np.linalg.norm(np.cross(x, y))
        np.testing.assert_allclose(pdf[inside], (t**2 / (area * np.abs(directions @ n)))[inside], rtol=1e-3)
    # The mean of 1 / pdf is the solid angle: nothing of it is left out.
    assert (1 / pdf[inside]).mean() == pytest.approx(angle, rel=5e-3)


@pytest.mark.parametrize("seen", SEEN)
def test_points_are_as_dense_as_the_density_has_it(probe: Any, seen: str) -> None:
    """Chi-square over cells of the rectangle, whose solid angles are known by fine steps."""
    n_cells, fine, count = 6, 60, 40000
    directions, _, _, _ = drawn(probe, seen, numbers(count))
    a, x, y, o = (np.asarray(each, float) for each in SEEN[seen])
    n = np.cross(x, y) / np.linalg.norm(np.cross(x, y))
    at = o + (((a - o) @ n) / (directions @ n))[:, None] * directions - a
    cell = [np.clip((at @ e / (e @ e) * n_cells).astype(int), 0, n_cells - 1) for e in (x, y)]
    found = np.zeros((n_cells, n_cells))
    np.add.at(found, tuple(cell), 1)
    s = (np.arange(n_cells * fine) + 0.5) / (n_cells * fine)
    p = a + s[:, None, None] * x + s[None, :, None] * y - o
    r = np.linalg.norm(p, axis=-1)
    weight = np.abs(p @ n) / r**3 if solid_angle(seen) > 0.01 else np.ones(r.shape)
    expected = weight.reshape(n_cells, fine, n_cells, fine).sum(axis=(1, 3))
    expected *= count / expected.sum()
    known = expected > 5
    statistic = float(((found - expected)[known] ** 2 / expected[known]).sum())
    assert statistic < chi2.ppf(1 - 1e-4, known.sum() - 1)


@pytest.mark.parametrize("seen", ["straight above", "beside", "past its edge", "turned"])
def test_the_density_integrates_to_one(probe: Any, seen: str) -> None:
    _, _, _, pdf = drawn(probe, seen, numbers(1 << 18))
    error = 4 * np.pi * pdf.std() / np.sqrt(len(pdf))
    assert 4 * np.pi * pdf.mean() == pytest.approx(1.0, abs=4 * error)


def test_nothing_is_seen_from_behind(probe: Any) -> None:
    _, _, _, pdf = drawn(probe, "behind", numbers(4096))
    assert pdf.max() == 0.0
