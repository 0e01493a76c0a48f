"""Checks of colours, directions, file names and numbers of scenes and meshes that types cannot express."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from glpath.errors import SceneError, warn_at
from glpath.scene.model import Float64
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.files import is_denied, reason_of
from glpath.system.suggestions import listed_names, similar_names
from glpath.system.vectors import LARGEST as LARGEST

#: Remedy in errors for files that may not be read.
CHECK_PERMISSIONS = "Check the permissions of the file and of its folders."
#: Minimum size of a scene in scene units. Its square times 1e-7 is still a normal 32-bit number.
SMALLEST = 1e-15
#: Maximum number of materials or solids of a mesh file, each of which becomes a shape.
MAX_PARTS = 1 << 14


def as_float64(stored: ArrayLike) -> Float64:
    """Return numbers of a file as float64, without numpy's warnings of signalling NaNs.

    Readers treat signalling NaNs as any other NaN.
    """
    with np.errstate(invalid="ignore"):
        return np.array(stored, np.float64)


def rgb(value: ArrayLike) -> Float64:
    """Return three numbers, or one number for grey, as (3,) float64."""
    return np.array(np.broadcast_to(np.asarray(value, np.float64), 3))


def light(value: ArrayLike, location: SourceLocation) -> Float64:
    """Return a radiance, intensity or irradiance as (3,) float64. Raises SceneError if it is negative."""
    colour = rgb(value)
    if np.any(colour < 0):
        raise location.wrong(value, "0 or more", "Light cannot be negative.")
    return colour


def share(value: ArrayLike, location: SourceLocation, remedy: str) -> Float64:
    """Return a colour as (3,) float64 in [0, 1]. Raises SceneError with `remedy` if it is outside."""
    colour = rgb(value)
    if np.any((colour < 0) | (colour > 1)):
        raise location.wrong(value, "between 0 and 1", remedy)
    return colour


def unit(vector: ArrayLike, location: SourceLocation, example: str) -> Float64:
    """Return the (3,) float64 unit vector along `vector`. Raises SceneError with an example if it is zero."""
    direction = np.asarray(vector, np.float64)
    length = np.linalg.norm(direction)
    if not length > 0:
        raise location.wrong(direction, "a vector of any length but zero", f"For example {example}.")
    return np.asarray(direction / length)


def unknown(kind: str, name: str, known: Sequence[str], location: SourceLocation, define: str) -> SceneError:
    """Return the error for `name`, which is not a known name of a material or texture (`kind`, singular)."""
    near = similar_names(name, known, 1)
    listed = listed_names(known) or f"no {kind}s"
    return location.error(
        f"names the {kind} {shown(name)}, but the file defines {listed}.",
        f'Did you mean "{near[0]}"?' if near else f"Define it: [{kind}s.{name}] with {define}.",
    )


def nearby_files(kind: str, path: Path, formats: Collection[str]) -> str:
    """Return a sentence that lists files in the folder of a missing file, most similar names first.

    kind    : first word of the sentence
    formats : suffixes of the files to list
    """
    if not os.path.isdir(path.parent):
        if is_denied(path):
            return CHECK_PERMISSIONS
        return f"There is no folder {path.parent} either. A relative path starts at the folder of the scene file."
    try:
        others = [file.name for file in path.parent.iterdir() if file.suffix.lower() in formats]
    except OSError as error:
        return f"The folder {path.parent} cannot be listed: {reason_of(error)}."
    nearest = similar_names(path.name, others, 8, 0) or sorted(others)[:8]
    kinds = ", ".join(filter(None, formats))
    return f"{kind} in {path.parent}: {', '.join(nearest) or ('none of ' + kinds if kinds else 'none')}."


def finite_rows(values: Float64, name: str, left_out: dict[str, int]) -> Float64:
    """Return rows (N, k) with zeros for rows that are not finite; `left_out` gets their count under `name`."""
    broken = ~np.asarray(np.isfinite(values).all(axis=1))
    if not broken.any():
        return values
    left_out[f"{name} that are not finite"] = int(np.count_nonzero(broken))
    return np.where(broken[:, None], 0.0, values)


def warn_of_left_out(source: str, counts: Mapping[str, int]) -> None:
    """Warn once of all parts left out of a file; `counts` has names such as "normals that are not finite".

    Several files of a scene share one warning for each name.
    """
    listed = [f"{name} ({count:,})" for name, count in counts.items() if count]
    causes = {f"{name} are left out": count for name, count in counts.items() if count}
    if listed:
        warn_at(source, causes, f"{source}: left out: {', '.join(listed)}.")


def no_such_vertex(location: SourceLocation, vertex: int, count: int) -> SceneError:
    """Return the error for a face with a vertex that is not one of `count`."""
    return location.error(
        f"names vertex {vertex}, but the mesh has {count} vertices (0 to {count - 1}).",
        "Face indices count from 0; OBJ files count from 1.",
    )
