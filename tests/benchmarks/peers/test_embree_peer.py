"""Embree as a peer: it sees what a slow, obvious loop sees."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from benchmarks.peers import embree as peer
from glpath.errors import GlpathError
from glpath.scene.model import Camera

CAMERA = Camera(np.array([0.3, -4.0, 0.8]), np.zeros(3), np.array([0.0, 0.0, 1.0]), 42.0, (32, 24))

pytestmark = pytest.mark.evidence  # needs the reference extra


@pytest.fixture(scope="module")
def rays():
    return peer.camera_rays(CAMERA)


def nearest_spheres(origins, directions, centres, radii):
    """Numbers and t by the quadratic formula, for each ray and sphere, in float64."""
    m = origins[:, None].astype(float) - centres
    b = np.einsum("rnk,rk->rn", m, directions.astype(float))
    with np.errstate(invalid="ignore"):
        t = -b - np.sqrt(b * b - (np.einsum("rnk,rnk->rn", m, m) - radii**2))
    t = np.where(np.isnan(t) | (t <= 0), np.inf, t)
    return np.where(np.isfinite(t.min(1)), t.argmin(1), -1), t.min(1)


def nearest_triangles(origins, directions, triangles):
    """Numbers and t by Cramer's rule [Moller-Trumbore 1997], for each ray and triangle, in float64."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    d = directions[:, None].astype(float)
    p = np.cross(d, v)
    det = np.einsum("rnk,nk->rn", p, u)
    s = origins[:, None] - a
    beta = np.einsum("rnk,rnk->rn", s, p) / det
    q = np.cross(s, u)
    gamma = np.einsum("rnk,rnk->rn", np.broadcast_to(d, q.shape), q) / det
    t = np.einsum("nk,rnk->rn", v, q) / det
    t = np.where((beta >= 0) & (gamma >= 0) & (beta + gamma <= 1) & (t > 0), t, np.inf)
    return np.where(np.isfinite(t.min(1)), t.argmin(1), -1), t.min(1)


def agree(found, expected):
    """Rays that graze an edge may fall to either side; no other may differ."""
    numbers, t = found
    same = numbers == expected[0]
    assert same.mean() > 0.995
    hit = same & (numbers >= 0)
    assert hit.mean() > 0.2
    np.testing.assert_allclose(t[hit], expected[1][hit], rtol=2e-4)
    assert np.all(np.isinf(t[numbers < 0]))


@pytest.mark.parametrize("method", ["single", "packets"])
@pytest.mark.parametrize("threads", [1, 3])
def test_spheres_are_exact(rays, method, threads):
    random = np.random.default_rng(1)
    centres, radii = random.uniform(-1, 1, (50, 3)), random.uniform(0.1, 0.3, 50)
    with peer.EmbreeScene.of_spheres(centres, radii) as scene:
        found = scene.nearest(*rays, method=method, threads=threads)
    agree(found, nearest_spheres(*rays, centres, radii))


@pytest.mark.parametrize("method", ["single", "packets"])
def test_triangles_are_seen_from_both_sides(rays, method):
    triangles = np.random.default_rng(2).uniform(-1, 1, (40, 3, 3))
    with peer.EmbreeScene.of_triangles(triangles) as scene:
        found = scene.nearest(*rays, method=method)
    agree(found, nearest_triangles(*rays, triangles))


def test_embreex_and_the_library_in_its_wheel_are_the_same_embree(rays):
    triangles = np.random.default_rng(3).uniform(-1, 1, (40, 3, 3))
    with peer.EmbreeScene.of_triangles(triangles) as scene:
        ours = scene.nearest(*rays, method="single")[0]
    assert np.array_equal(peer.embreex_triangles(triangles)(*rays), ours)


def test_rays_go_through_the_centres_of_pixels_from_the_top_left(rays):
    origins, directions = rays
    right, up, forward = CAMERA.frame()
    assert np.array_equal(origins[5], CAMERA.position.astype(np.float32))
    slope = np.tan(np.radians(21.0))
    first = directions[0] / (directions[0] @ forward)
    np.testing.assert_allclose(first @ up, slope * 23 / 24, rtol=1e-5)
    np.testing.assert_allclose(first @ right, -slope * 31 / 24, rtol=1e-5)
    assert directions[1] @ right > directions[0] @ right
    assert directions[32] @ up < directions[0] @ up


def test_without_embreex_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex", None)
    with pytest.raises(GlpathError, match=r"pip install 'glpath\[reference\]'"):
        peer.load_embreex()
