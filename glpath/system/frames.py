"""Results as data frames of pandas and data sets of xarray, imported when they are asked for: `glpath[frames]`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from glpath.errors import GlpathError

#: Of each package the extra that brings it.
_EXTRAS = {"pandas": "frames", "xarray": "frames", "pyvista": "mesh"}


def package(name: str) -> Any:
    """A module that is optional. Raises GlpathError with the line to type where it is missing."""
    try:
        return import_module(name)
    except ImportError as error:
        raise GlpathError(
            f"{name} cannot be imported ({error}); this result is of its type.",
            f'pip install "glpath[{_EXTRAS[name]}]"; the same numbers are arrays of numpy without it.',
        ) from error


def data_frame(columns: Mapping[str, Any], index: str, labels: Any = None, attributes: Any = None) -> Any:
    """A `pandas.DataFrame`.

    columns    : by name, all of one length
    index      : its name
    labels     : of the rows; their numbers without
    attributes : what goes for all of it, `DataFrame.attrs`
    """
    pandas = package("pandas")
    frame = pandas.DataFrame(dict(columns), index=labels)
    frame.index.name = index
    frame.attrs.update(attributes or {})
    return frame


def data_set(variables: Mapping[str, Any], coordinates: Mapping[str, Any], attributes: Mapping[str, Any]) -> Any:
    """An `xarray.Dataset`. variables, coordinates: by name, as it takes them: (dimensions, values)."""
    return package("xarray").Dataset(dict(variables), dict(coordinates), dict(attributes))
