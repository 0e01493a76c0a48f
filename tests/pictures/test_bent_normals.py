"""Metal whose normal map sends reflections below the surface: the normal is bent, with no step and no loss."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.scene import Scene
from glpath.scene.model import Camera, Float64, Material, Mesh, Shape, Shapes, Sky

DISC = 25  # rings and sectors of a flat disc whose normals are those of a half ball


def half_ball(material: Material, sky: Sky, pixels: int = 96, tilt: float = 0.0) -> Scene:
    """A flat disc of radius 1 in the plane z = 0 with the vertex normals of half a ball, seen from above."""
    r, phi = np.meshgrid(np.linspace(0, 1, DISC), np.linspace(0, 2 * np.pi, 4 * DISC), indexing="ij")
    x, y = r * np.cos(phi), r * np.sin(phi)
    positions = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - r**2, 1e-4))], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    i = np.arange(DISC * 4 * DISC).reshape(DISC, 4 * DISC)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    corners = positions[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    mesh = Mesh(positions, faces[area > 1e-12], normals=normals)
    turn = np.radians(tilt)
    eye = 6 * np.array([np.sin(turn), 0.0, np.cos(turn)])
    camera = Camera(eye, np.zeros(3), np.array([0.0, 1, 0]), 20.0, (pixels, pixels))
    return Scene("half ball", camera, Shapes([Shape("disc", mesh, 0)]), (material,), sky=sky)


def metal(roughness: float) -> Material:
    return Material("metal", np.ones(3), roughness=roughness, metallic=1.0)


MIRRORS = {
    "mirror": Material("mirror", np.zeros(3), mirror=np.ones(3)),
    "smooth": metal(0.0),
    "rough": metal(0.3),
}
ENGINES: list[dict[str, Any]] = [
    {"integrator": "path"},
    {"integrator": "path-buffer"},
    {"integrator": "t-buffer"},
]


def along_a_radius(film: glpath.Film) -> Float64:
    """(n,) radiance from the middle to the edge of the disc, the mean over a few rows."""
    size = film.mean.shape[0]
    row = film.mean[size // 2 - 1 : size // 2 + 1, size // 2 :, 1].mean(axis=0)
    return np.asarray(row[: round(0.92 * size / 2)])


@pytest.mark.parametrize("name", ["mirror", "smooth"])
@pytest.mark.parametrize("options", [ENGINES[0], ENGINES[2]], ids=["path", "t-buffer"])
def test_no_ring_where_the_reflection_meets_the_surface(name: str, options: dict[str, Any]) -> None:
    """Of a sky that grows from the horizon to the zenith: the mirror direction goes down with the radius, until it
    is that just above the surface and stays there. It never jumps back to the zenith."""
    up = np.array([0.0, 0.0, 1.0])
    sky = Sky(zenith=np.ones(3), horizon=np.zeros(3), up=up)
    found = along_a_radius(glpath.render(half_ball(MIRRORS[name], sky), spp=16, max_depth=3, **options))
    assert found[0] > 0.9
    steps = np.diff(found)
    assert steps.max() < 0.02
    assert steps.min() > -0.15
    assert found[-3:].max() < 0.1


@pytest.mark.parametrize("tilt", [0.0, 50.0])
@pytest.mark.parametrize("name", ["mirror", "smooth"])
@pytest.mark.parametrize("options", [ENGINES[0], ENGINES[2]], ids=["path", "t-buffer"])
def test_a_mapped_mirror_vanishes_in_a_furnace(name: str, tilt: float, options: dict[str, Any]) -> None:
    sky = Sky(zenith=np.ones(3), horizon=np.ones(3), up=np.array([0.0, 0.0, 1.0]))
    film = glpath.render(half_ball(MIRRORS[name], sky, 32, tilt), spp=8, max_depth=3, **options)
    np.testing.assert_allclose(film.mean, 1.0, atol=2e-3)


def test_rough_metal_has_no_ring_and_is_alike_by_any_rays() -> None:
    """Where the normal leans over, part of the lobe is below the surface and lost, the more the farther out."""
    sky = Sky(zenith=np.ones(3), horizon=np.ones(3), up=np.array([0.0, 0.0, 1.0]))
    own, shared = (
        glpath.render(half_ball(metal(0.5), sky, side), spp=512, max_depth=2, **options)
        for side, options in zip((48, 24), ENGINES[:2], strict=True)
    )
    found = along_a_radius(own)
    assert np.abs(np.diff(found)).max() < 0.12
    assert found.min() > 0.35
    assert shared.mean.mean() == pytest.approx(own.mean.mean(), rel=0.01)
