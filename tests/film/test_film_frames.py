"""Films as data frames and data sets: the numbers are those of the film."""

from __future__ import annotations

import numpy as np
import pytest

import glpath


def rendered(spp: int) -> glpath.Film:
    return glpath.render(
        "furnace",
        spp=spp,
        resolution=(12, 8),
        crop=(2, 1, 8, 6),
        integrator="path",
        max_depth=2,
        aovs=("depth", "normal", "uv"),
    )


@pytest.mark.filterwarnings("ignore:The behavior of DataFrame concatenation:FutureWarning")  # pandas before 3
def test_what_renders_took_are_rows_that_join() -> None:
    pandas = pytest.importorskip("pandas", reason="needs the extra frames")
    films = [rendered(2), rendered(16)]
    rows = pandas.concat([film.to_pandas() for film in films])
    assert rows.index.tolist() == ["furnace", "furnace"]
    assert rows["path_sets"].tolist() == [2, 16]
    assert rows[["width", "height", "max_depth"]].iloc[0].tolist() == [8, 6, 2]
    assert rows["elapsed_s"].tolist() == [film.metadata.elapsed_s for film in films]
    counts = films[0].metadata.statistics
    assert counts
    for name, value in counts.items():
        if isinstance(value, dict):
            for inner, each in value.items():
                assert rows[f"{name}.{inner}"].iloc[0] == each
        else:
            assert rows[name].iloc[0] == value


def test_a_picture_with_its_aovs_is_a_data_set() -> None:
    pytest.importorskip("xarray", reason="needs the extra frames")
    film = rendered(2)
    data = film.to_xarray()
    assert data["radiance"].dims == ("y", "x", "channel")
    np.testing.assert_array_equal(data["radiance"].sel(channel="green"), film.mean[..., 1])
    np.testing.assert_array_equal(data["depth"], film.aov("depth"))
    np.testing.assert_array_equal(data["normal"].sel(axis="z"), film.aov("normal")[..., 2])
    np.testing.assert_array_equal(data["uv"].sel(coordinate="v"), film.aov("uv")[..., 1])
    # By the pixels of the whole image.
    assert data["x"].values.tolist() == list(range(2, 10))
    assert data["y"].values.tolist() == list(range(1, 7))
    assert data.attrs["path_sets"] == 2
