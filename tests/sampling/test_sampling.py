"""Random numbers come from a counter: any path set, in any order, in any process, is the same one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from glpath.buffers.frame import frame_about, tight_frame
from glpath.sampling.points import PathSetSampler, counter_hash, lattice_point, uniform_hemisphere, uniform_sphere
from glpath.sampling.sobol import DIMENSIONS, sobol_points


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
    assert not np.any(sampler[5].directions == PathSetSampler(11, 3, lattice=True)[5].directions[0, 0])
    directions = np.array([sampler[i].directions[:, 0] for i in range(64)])
    for bounce in range(2):
        cells = (directions[:, bounce] * 8).astype(int)
        assert len({tuple(c) for c in cells}) == 64


def shortest(points: np.ndarray) -> float:
    """The least distance of two points on the torus, over that in the hexagonal lattice of as many."""
    difference = (points[1:] - points[0] + 0.5) % 1.0 - 0.5
    return float(np.linalg.norm(difference, axis=1).min() / np.sqrt(2 / np.sqrt(3) / len(points)))


def test_any_power_of_two_of_the_lattice_is_a_good_lattice() -> None:
    """As far apart as a lattice's points can be, but for three tenths, wherever it begins."""
    for k in range(3, 15):
        for start in (0, 3 << k):
            points = np.array([lattice_point(5, start + i) for i in range(1 << k)])
            assert shortest(points) > 0.7, (k, start)
            cells = {tuple(cell) for cell in np.round((points - points[0]) % 1.0 * (1 << k)).astype(int)}
            generated = {tuple(cell) for cell in np.outer(np.arange(1 << k), [1, 17939]) % (1 << k)}
            assert {(x % (1 << k), y % (1 << k)) for x, y in cells} == generated


def test_the_lattice_does_not_repeat_and_is_shifted_by_the_seed() -> None:
    points = np.array([lattice_point(5, i) for i in range(1 << 16)])
    assert len(np.unique(points[:, 0])) == len(np.unique(points[:, 1])) == 1 << 16
    shift = {tuple((lattice_point(6, i) - points[i]) % 1.0) for i in range(64)}
    assert len(shift) == 1
    assert (0.0, 0.0) not in shift


def test_sobol_points_are_scipys() -> None:
    for start in (0, 256, 1 << 20):
        theirs = qmc.Sobol(DIMENSIONS, scramble=False, bits=32)
        if start:
            theirs.fast_forward(start)
        points = (theirs.random(256) * 2.0**32).astype(np.uint64)
        np.testing.assert_array_equal(sobol_points(start, 256, DIMENSIONS), points)


def test_bounces_beyond_the_sequence_are_stratified_and_have_an_order_of_their_own() -> None:
    sampler = PathSetSampler(4, 30)
    points = np.array([sampler[i].directions for i in range(64)])
    assert points.shape == (64, 29, 2, 2)
    for bounce in (14, 20, 28):
        for way in range(2):
            assert len({tuple(cell) for cell in (points[:, bounce, way] * 8).astype(int)}) == 64
    columns = points[:, 14:].reshape(64, -1).T
    correlation = np.corrcoef(columns) - np.eye(len(columns))
    assert np.abs(correlation).max() < 0.7  # 0.46 of as many random numbers
    shallow = PathSetSampler(4, 15)
    np.testing.assert_array_equal(points[5, :14], shallow[5].directions[:14])


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
