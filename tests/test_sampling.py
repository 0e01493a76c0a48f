"""Random numbers come from a counter: any path set, in any order, in any process, is the same one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from glpath.buffers.frame import frame_about, tight_frame
from glpath.gl.context import get_context
from glpath.gl.gpu_scene import GpuScene
from glpath.sampling import PathSetSampler, counter_hash, uniform_hemisphere, uniform_sphere
from glpath.scene import scene_from_dict


def numbers(sampler: PathSetSampler, index: int) -> np.ndarray:
    sample = sampler[index]
    return np.concatenate([sample.pixel, sample.light, sample.directions.ravel()])


@pytest.mark.parametrize("sampling", ["sobol", "random"])
def test_a_path_set_is_the_same_whatever_was_asked_for_before(sampling: Any) -> None:
    first, second = PathSetSampler(7, 4, sampling), PathSetSampler(7, 4, sampling)
    indices = [0, 1, 255, 256, 257, 1000, 70000]
    forward = [numbers(first, i) for i in indices]
    backward = [numbers(second, i) for i in reversed(indices)][::-1]
    np.testing.assert_array_equal(forward, backward)
    assert len(np.unique(np.array(forward), axis=0)) == len(indices)


@pytest.mark.parametrize("sampling", ["sobol", "random"])
def test_another_seed_is_other_numbers(sampling: Any) -> None:
    one, two = (numbers(PathSetSampler(seed, 4, sampling), 5) for seed in (1, 2))
    assert not np.any(one == two)


def test_a_deeper_render_repeats_the_numbers_of_a_shallower_one() -> None:
    shallow, deep = PathSetSampler(3, 2)[17], PathSetSampler(3, 9)[17]
    np.testing.assert_array_equal(shallow.light, deep.light)
    np.testing.assert_array_equal(shallow.directions[:1], deep.directions[:1])
    assert len(deep.directions) >= 8


def test_sobol_points_are_stratified_where_it_matters_most() -> None:
    """Of 64 path sets, the first directions fall one into each cell of an 8 x 8 grid, and so do the second."""
    sampler = PathSetSampler(11, 3)
    directions = np.array([sampler[i].directions[:, 0] for i in range(64)])
    for bounce in range(2):
        cells = (directions[:, bounce] * 8).astype(int)
        assert len({tuple(c) for c in cells}) == 64


def test_hemisphere_and_sphere_are_uniform() -> None:
    u = np.random.default_rng(0).random((200_000, 2))
    for make, least, mean_z in ((uniform_hemisphere, 0.0, 0.5), (uniform_sphere, -1.0, 0.0)):
        d = make(u)
        np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, atol=1e-12)
        assert d[:, 2].min() >= least
        np.testing.assert_allclose(d.mean(axis=0), [0, 0, mean_z], atol=6e-3)
        # Archimedes: z is uniform.
        np.testing.assert_allclose(np.histogram(d[:, 2], 8)[0] / len(d), 1 / 8, atol=4e-3)


def test_the_hash_of_a_counter_spreads() -> None:
    values = {counter_hash(0, i, j, k) for i in range(32) for j in range(8) for k in range(4)}
    assert len(values) == 1024
    assert counter_hash(1, 23) != counter_hash(12, 3)


@pytest.mark.parametrize("d", [*np.eye(3), *-np.eye(3), np.array([0.36, -0.48, 0.8])])
def test_frames_are_right_handed_and_the_tight_one_is_no_larger(d: np.ndarray) -> None:
    corners = np.random.default_rng(4).standard_normal((8, 3)) * [4, 1, 0.3]

    def area(u: np.ndarray, v: np.ndarray) -> float:
        return float(np.ptp(corners @ u) * np.ptp(corners @ v))

    for u, v in (frame_about(d), frame_about(d, 0.7), tight_frame(d, corners)):
        np.testing.assert_allclose(np.cross(u, v), d, atol=1e-12)
    assert area(*tight_frame(d, corners)) <= min(area(*frame_about(d, roll)) for roll in (0.0, np.pi / 4))


def test_light_points_are_chosen_by_power_and_lie_uniformly_on_their_emitter() -> None:
    """A weak large lamp, a strong small one, and a two-sided one, of which each side counts."""

    def lamp(x: float, size: float, radiance: float, two_sided: bool = False) -> dict[str, Any]:
        corners = [[x, 0, 0], [x + size, 0, 0], [x + size, 0, -size], [x, 0, -size]]
        return {"type": "quad", "corners": corners, "emission": {"radiance": radiance, "two_sided": two_sided}}

    scene = scene_from_dict(
        {
            "camera": {"type": "perspective", "position": [0, 5, 9], "target": [0, 0, 0], "fov": 40},
            "shapes": [lamp(0, 2, 1), lamp(10, 1, 8), lamp(20, 1, 2, True)],
        }
    )
    emitters = GpuScene(get_context().gl, scene).emitters
    assert emitters is not None
    points = [emitters.sample(u) for u in np.random.default_rng(1).random((20_000, 3))]
    x = np.array([p[0][0] for p in points])
    # Powers: 4 x 1, 1 x 8, and twice 1 x 2.
    np.testing.assert_allclose(
        [np.mean(x < 5), np.mean((x > 5) & (x < 15)), np.mean(x > 15)], [0.25, 0.5, 0.25], atol=0.015
    )
    assert all(p[3] == pytest.approx(0.25 / 4) for p in points[:100] if p[0][0] < 5)
    sides = [p[1][1] for p in points if p[0][0] > 15]
    assert np.mean(sides) == pytest.approx(0.0, abs=0.05)
    on_small = np.array([p[0] for p in points if 5 < p[0][0] < 15]) - [10, 0, -1]
    counts, _, _ = np.histogram2d(on_small[:, 0], on_small[:, 2], bins=4, range=[[0, 1], [0, 1]])
    np.testing.assert_allclose(counts / counts.sum(), 1 / 16, atol=0.012)
    # Unbiased: radiance over density averages to the total of area times radiance, sides counted.
    assert np.mean([p[2][0] / p[3] for p in points]) == pytest.approx(4 + 8 + 4, rel=0.01)
