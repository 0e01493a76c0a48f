"""Results as data frames of pandas and data sets of xarray, imported on demand: `glpath[frames]`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from glpath.errors import GlpathError

#: Extra of glpath that installs each package.
_EXTRAS = {"pandas": "frames", "xarray": "frames", "pyvista": "mesh"}


def package(name: str) -> Any:
    """Import an optional module. Raises GlpathError with the install command if it is missing."""
    try:
        return import_module(name)
    except ImportError as error:
        raise GlpathError(
            f"{name} cannot be imported ({error}); this result is of its type.",
            f'pip install "glpath[{_EXTRAS[name]}]"; the same numbers are arrays of numpy without it.',
        ) from error


def data_frame(columns: Mapping[str, Any], index: str, labels: Any = None, attributes: Any = None) -> Any:
    """Return a `pandas.DataFrame`.

    columns    : columns by name, all of one length
    index      : name of the index
    labels     : labels of the rows; None: row numbers
    attributes : values for the whole table, `DataFrame.attrs`
    """
    pandas = package("pandas")
    frame = pandas.DataFrame(dict(columns), index=labels)
    frame.index.name = index
    frame.attrs.update(attributes or {})
    return frame


def data_set(variables: Mapping[str, Any], coordinates: Mapping[str, Any], attributes: Mapping[str, Any]) -> Any:
    """Return an `xarray.Dataset`; variables and coordinates are pairs (dimensions, values) by name."""
    return package("xarray").Dataset(dict(variables), dict(coordinates), dict(attributes))
