"""Means of textures over triangles, by no more look-ups than they need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.scenes.helmet import helmet
from glpath.scene import appearance
from glpath.scene.appearance import Appearance
from glpath.scene.material import Wrap
from glpath.scene.model import Scene, Texture


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A helmet that glows in two spots, one of them across the seam of its texture coordinates."""
    made = helmet(side=64, columns=40, rows=21)
    glow = np.zeros((64, 64, 3), np.uint8)
    glow[20:24, 30:33, 1], glow[40:44, 63, 2] = 200, 90
    textures = (*made.textures[:3], replace(made.textures[3], image=glow))
    return replace(made, textures=textures)


@pytest.fixture
def looked_up(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """How many points of textures were looked up."""
    count = 0
    look = appearance.texture_at

    def counting(texture: Texture, uv: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal count
        count += len(uv)
        return look(texture, uv)

    monkeypatch.setattr(appearance, "texture_at", counting)
    return lambda: count


def _by_every_point(scene: Scene) -> NDArray[np.float64]:
    """(T, 3) mean emission of points as dense everywhere."""
    points = appearance._middles(4)[:, 1:]
    triangle = np.repeat(np.arange(len(scene.triangles)), len(points))
    values = Appearance(scene).emission(triangle, np.tile(points, (len(scene.triangles), 1)))
    return np.asarray(values.reshape(len(scene.triangles), len(points), 3).mean(axis=1))


def test_a_black_emission_texture_is_looked_up_where_it_glows_alone(
    scene: Scene, looked_up: Callable[[], int]
) -> None:
    found = Appearance(scene).mean_emission()
    triangles = len(scene.triangles)
    assert looked_up() < 4 * triangles, "one point of each, and 16 of few"
    expected = _by_every_point(scene)
    assert 0 < np.count_nonzero(expected.any(axis=1)) < triangles // 10
    assert np.array_equal(found > 0, expected > 0)
    assert np.allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("filtered", ["linear", "nearest"])
def test_no_glow_is_missed(wrap: Wrap, filtered: Literal["linear", "nearest"]) -> None:
    rng = np.random.default_rng(1)
    image = np.zeros((48, 32, 3), np.uint8)
    image[rng.integers(0, 48, 40), rng.integers(0, 32, 40)] = 255
    texture = Texture("spots", image, (1.1, 0.9), filtered, wrap=(wrap, wrap))
    corners = rng.uniform(-0.2, 1.2, (800, 1, 2)) + rng.uniform(-0.02, 0.02, (800, 3, 2))
    points = appearance._middles(8)
    uv = np.einsum("kc,pcx->pkx", points, corners)
    glows = appearance.texture_at(texture, uv.reshape(-1, 2)).reshape(800, 64, 4)[..., :3].any(axis=(1, 2))
    marked = appearance._not_black(texture, corners)
    assert marked[glows].all()
    assert 0.02 < glows.mean() < marked.mean() < 0.8


def test_slots_with_the_same_coordinates_count_their_texels_once(scene: Scene) -> None:
    one = Appearance(scene)
    asked: list[int] = []
    one.slot_uv = lambda slot, triangle, b: asked.append(slot.texture) or Appearance.slot_uv(one, slot, triangle, b)  # type: ignore[method-assign, func-returns-value]
    every = np.arange(len(scene.triangles))
    corners = np.broadcast_to(appearance.WHOLE, (len(every), 3, 2))
    parts = one._parts_of(every, corners)
    assert len(asked) == 1, "four slots, but one look at the corners"
    larger = replace(scene.textures[2], image=np.zeros((1024, 1024, 3), np.uint8))
    finer = Appearance(replace(scene, textures=(*scene.textures[:2], larger, scene.textures[3])))
    assert (finer._parts_of(every, corners) > parts).all()


@pytest.mark.parametrize("srgb", [False, True])
@pytest.mark.parametrize("channels", [3, 4])
def test_the_brightest_texel_of_bytes_is_found_without_decoding_all(
    srgb: bool, channels: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = np.random.default_rng(channels).integers(0, 250, (9, 7, channels), np.uint8)
    texture = Texture("x", image, srgb=srgb)
    expected = texture.linear()[..., :3].max(axis=(0, 1)).astype(np.float64)
    monkeypatch.setattr(Texture, "linear", lambda self: pytest.fail("all texels are decoded"))
    assert np.array_equal(texture.max, expected)
