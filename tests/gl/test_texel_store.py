"""A store holds its tables one after the other, however few rows are written at a time."""

from __future__ import annotations

import numpy as np
import pytest

from glpath.errors import SceneError
from glpath.gl import texel_store
from glpath.gl.context import get_context
from glpath.gl.texel_store import FLOATS, UINTS, WIDTH, make_store

LAYOUT = {"triple": {"A": "", "B": "", "C": ""}, "none": {"A": ""}, "single": {"A": ""}}


@pytest.mark.parametrize("rows", [1, 2, 256])
@pytest.mark.parametrize("count", [5, 3 * WIDTH + 7])
def test_tables_lie_one_after_the_other(rows: int, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(texel_store, "_ROWS", rows)
    monkeypatch.setattr(texel_store, "_TEXELS", 1000)
    random = np.random.default_rng(1)
    sizes = {"triple": count, "none": 0, "single": 2 * count}
    tables = {name: random.integers(1 << 32, size=(sizes[name], len(LAYOUT[name]), 4)) for name in LAYOUT}
    texture, bases = make_store(get_context().gl, UINTS, LAYOUT, tables, "test")
    assert bases == {"triple_base": 0, "none_base": 3 * count, "single_base": 3 * count}
    texels = np.frombuffer(texture.read(), np.uint32).reshape(-1, 4)
    wanted = np.concatenate([tables[name].reshape(-1, 4) for name in LAYOUT])
    np.testing.assert_array_equal(texels[: len(wanted)], wanted)
    assert not texels[len(wanted) :].any()
    assert texture.width == min(WIDTH, 5 * count)


def test_a_store_of_nothing_has_a_texel() -> None:
    texture, _ = make_store(get_context().gl, FLOATS, {"none": {"A": ""}}, {"none": np.zeros((0, 1, 4))}, "test")
    assert texture.size == (1, 1)


def test_more_than_the_device_holds_is_refused() -> None:
    class Endless:
        shape = (1 << 40, 1, 4)

        def __getitem__(self, which: slice) -> np.ndarray:
            raise AssertionError("asked for")

    with pytest.raises(SceneError, match=r'room\.toml: 1,099,511,627,776 texels .* entries of "all"'):
        make_store(get_context().gl, FLOATS, {"all": {"A": ""}}, {"all": Endless()}, "room.toml")
