"""Conversion of a film to an xarray data set, and of its render statistics to a pandas row (`glpath[frames]`)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from glpath.film.film_errors import FilmErrors
from glpath.system.frames import data_frame, data_set

# Name and labels of the last dimension of AOVs with 3 or 2 values per pixel.
_AXES = {3: ("channel", ("red", "green", "blue")), 2: ("coordinate", ("u", "v"))}
_VECTORS = ("normal", "position")


def stats_frame(film: FilmErrors) -> Any:
    """Return a `pandas.DataFrame` of one row: see `Film.to_pandas`."""
    labels = [film.metadata.scene]
    return data_frame({name: [value] for name, value in _stats(film).items()}, "scene", labels)


def film_data_set(film: FilmErrors) -> Any:
    """Return an `xarray.Dataset`: see `Film.to_xarray`."""
    x, y, width, height = film.metadata.window
    variables: dict[str, Any] = {"radiance": (("y", "x", "channel"), film.mean)}
    for name in film.metadata.aovs:
        values = film.aov(name)
        if values.ndim == 2:
            variables[name] = (("y", "x"), values)
        elif name in _VECTORS:
            variables[name] = (("y", "x", "axis"), values)
        else:
            variables[name] = (("y", "x", _AXES[values.shape[2]][0]), values)
    coordinates: dict[str, Any] = {
        "x": range(x, x + width),
        "y": range(y, y + height),
        "axis": ["x", "y", "z"],
        **{name: list(labels) for name, labels in _AXES.values()},
    }
    used = {each for dimensions, _ in variables.values() for each in dimensions}
    # NetCDF and zarr store only numbers and texts.
    attributes = {
        name: value if isinstance(value, str) else float(value)
        for name, value in _stats(film).items()
        if value is not None
    }
    coordinates = {name: values for name, values in coordinates.items() if name in used}
    return data_set(variables, coordinates, {"scene": film.metadata.scene, **attributes})


def _stats(film: FilmErrors) -> dict[str, Any]:
    """Return a film's statistics as a mapping from names to numbers, texts or None."""
    m = film.metadata
    return {
        "integrator": m.integrator,
        "seed": m.seed,
        "max_depth": m.max_depth,
        "path_sets": film.path_sets,
        "width": m.window[2],
        "height": m.window[3],
        "elapsed_s": m.elapsed_s,
        "relative_error": film.relative_error(),
        "stop_rule": m.stop_rule,
        "error_bound": m.error_bound,
        "unit": m.unit,
        "device": m.device,
        "scene_hash": m.scene_hash,
        **dict(_flat(m.statistics)),
    }


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (name, value) pairs: an entry of a nested table has a dotted name, and a list becomes JSON text."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value if isinstance(value, int | float | str) else json.dumps(value)
