"""Shards of daylight coefficients: together the bits of one computation, and what is refused."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compute import daylight_coefficients
from glpath.apps.daylight.merging import merge_coefficients
from glpath.errors import ImageError, UsageError
from glpath.io import scene_from_dict
from tests.apps.daylight.test_bounces import VIEW, box, scene

# Few elements are enough here.
pytestmark = pytest.mark.filterwarnings("ignore:.*bias of the reflected light")

AT = np.random.default_rng(5).uniform([-0.9, -0.9, 0.1], [0.9, 0.9, 1.5], (11, 3))
UP = [0.0, 0.0, 1.0]
QUICK: dict[str, Any] = {"samples": 4, "elements": 60, "gather_rays": 256, "latitude": 40.0, "suns": 20}
# Half of the light passes a veil above the box, at random.
VEIL = {
    "type": "quad",
    "corners": [[-2, -2, 2.5], [2, -2, 2.5], [2, 2, 2.5], [-2, 2, 2.5]],
    "material": "veil",
}


def veiled() -> Any:
    walls = [{"type": "quad", "corners": corners} for corners in box(1)]
    veil = {"reflectance": 0.5, "opacity": 0.5, "alpha": "blend"}
    return scene_from_dict({"camera": VIEW, "shapes": [*walls, VEIL], "materials": {"veil": veil}})


def shards_of(folder: Path, of: Any, count: int, **more: Any) -> list[Path]:
    paths = [folder / f"{k}-of-{count}.npz" for k in range(1, count + 1)]
    for k, path in enumerate(paths, start=1):
        daylight_coefficients(of, AT, UP, **(QUICK | more), shard=(k, count)).save(path)
    return paths


def assert_same(one: DaylightCoefficients, other: DaylightCoefficients) -> None:
    for name in ("points", "normals", "words", "directions"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert np.array_equal(one.sky(), other.sky())
    assert np.array_equal(one.sun(), other.sun())
    assert np.array_equal(one.standard_errors, other.standard_errors)


@pytest.mark.parametrize("depth", [1, None], ids=["direct", "reflected"])
def test_shards_in_any_order_have_the_bits_of_one_computation(tmp_path: Path, depth: int | None) -> None:
    of = veiled()
    whole = daylight_coefficients(of, AT, UP, **QUICK, max_depth=depth)
    parts = shards_of(tmp_path, of, 3, max_depth=depth)
    copy = tmp_path / "copy.npz"
    shutil.copy(parts[1], copy)
    merged, repeated = merge_coefficients([parts[2], parts[0], parts[1], copy, parts[0]])
    assert repeated == [copy, parts[0]]
    assert merged.shard is None
    assert_same(merged, whole)


def test_neighbours_are_a_larger_shard_that_is_merged_again(tmp_path: Path) -> None:
    of = scene(0.5, *box(1))
    parts = shards_of(tmp_path, of, 3, max_depth=1)
    two, _ = merge_coefficients(parts[1:])
    assert two.shard is not None
    assert (two.shard.first, two.shard.total, len(two)) == (3, 11, 8)
    two.save(tmp_path / "two.npz")
    merged, _ = merge_coefficients([tmp_path / "two.npz", parts[0]])
    assert_same(merged, daylight_coefficients(of, AT, UP, **QUICK, max_depth=1))


def test_what_is_not_of_one_computation_is_refused(tmp_path: Path) -> None:
    of = scene(0.5, *box(1))
    parts = shards_of(tmp_path, of, 3, max_depth=1)
    with pytest.raises(UsageError, match="sensors 3 to 6, between"):
        merge_coefficients([parts[0], parts[2]])
    with pytest.raises(UsageError, match="has sensors 0 to 2"):
        merge_coefficients([*parts, *shards_of(tmp_path, of, 2, max_depth=1)])
    (tmp_path / "other").mkdir()
    other = shards_of(tmp_path / "other", of, 3, max_depth=1, samples=2)
    with pytest.raises(UsageError, match="samples is 2, not 4"):
        merge_coefficients([parts[0], other[1]])
    other = shards_of(tmp_path / "other", scene(0.4, *box(1)), 3, max_depth=1)
    with pytest.raises(UsageError, match="another scene, other sensors or settings"):
        merge_coefficients([parts[0], other[1]])
    whole = tmp_path / "whole.npz"
    daylight_coefficients(of, AT, UP, **QUICK, max_depth=1).save(whole)
    with pytest.raises(UsageError, match="is no shard"):
        merge_coefficients([whole])
    (tmp_path / "torn.npz").write_bytes(parts[0].read_bytes()[:99])
    with pytest.raises(ImageError, match=r"torn\.npz"):
        merge_coefficients([parts[0], tmp_path / "torn.npz"])
    (tmp_path / "loop.npz").symlink_to("loop.npz")
    with pytest.raises(ImageError, match=r"loop\.npz: cannot be read .*symbolic links"):
        merge_coefficients([parts[0], tmp_path / "loop.npz"])
    with pytest.raises(UsageError, match="no shard is named"):
        merge_coefficients([])


@pytest.mark.parametrize("wrong", [(0, 2), (3, 2), (1, 12), "1/2", (1.0, 2), (1, 2, 3)])
def test_a_shard_that_is_none_is_refused(wrong: Any) -> None:
    with pytest.raises(UsageError, match="shard"):
        daylight_coefficients(scene(0.5, *box(1)), AT, UP, **QUICK, max_depth=1, shard=wrong)
