"""Digest of everything that changes the image of a scene, computed from the fields of the scene's dataclasses.

A new field is included automatically. Fields that do not change the image are listed in `UNSEEN`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np

from glpath.system.time_limit import check_time

#: Fields that do not change the image, by dataclass name.
UNSEEN = {
    "Scene": {"name", "source", "exposure", "unit", "centred_by", "animation_times"},
    "Shape": {"name", "kind", "maintenance_factor"},
    "Material": {"name"},
    "Texture": {"name"},
    "Light": {"name", "maintenance_factor"},
    "Sky": {"assumed"},
    "Environment": {"assumed", "solar", "north"},
}

#: Fields that a later version added, by dataclass name. A field with its default value is left out of the digest,
#: so that older scenes keep their digest.
LATER = {
    "Camera": {
        *("projection", "height", "aperture_radius", "focus_distance", "shutter", "motion"),
        *("principal_point", "pixel_aspect"),
    },
    "Shape": {"motion", "keeps_flux"},
    "Scene": {"portals", "background"},
    "Material": {"slab", "distribution", "layering", "metal_index"},
}

_Update = Callable[[bytes], None]
# Number of values of an array that are converted and hashed at once.
_BLOCK = 1 << 20


def digest_of(*values: object) -> str:
    """Return the SHA-256 (hex) of dataclasses, tuples, arrays, numbers, texts and None, without fields of `UNSEEN`.

    Equal values have equal digests, even if they are different objects. Numbers are read as float64, arrays as
    int64 or float64, and uint8 arrays as bytes. An object with a text attribute `digest` is represented by that
    text, so that the digest can be cached.
    """
    h = hashlib.sha256()
    for value in values:
        _add(value, h.update)
    return h.hexdigest()


def _add(value: object, update: _Update) -> None:
    known = getattr(value, "digest", None)
    if isinstance(known, str):
        update(b"digest" + known.encode())
    elif value is None:
        update(b"none")
    elif is_dataclass(value):
        kind: Any = type(value)
        update(f"dataclass {kind.__name__} ".encode())
        for name, prefix, is_later, default in _hashed_fields(kind):
            own = getattr(value, name)
            if not is_later or isinstance(own, np.ndarray) or own != default:
                update(prefix)
                _add(own, update)
    elif isinstance(value, str):
        update(f"text {len(value)} {value}".encode())
    elif isinstance(value, tuple):
        update(f"tuple {len(value)} ".encode())
        for each in value:
            check_time()
            _add(each, update)
    elif isinstance(value, np.ndarray):
        kept = value.dtype == np.uint8  # images are hashed without conversion, because they are large
        dtype = value.dtype if kept else np.dtype("<f8" if value.dtype.kind == "f" else "<i8")
        update(f"array {_dtype_name(dtype)} {value.shape} ".encode())
        flat = np.ascontiguousarray(value).reshape(-1)
        for start in range(0, len(flat), _BLOCK):  # in blocks, because a converted copy may be large
            update(flat[start : start + _BLOCK].astype(dtype, copy=False).tobytes())
    elif isinstance(value, bool | int | float | np.generic):
        update(b"number" + np.array(value, "<f8").tobytes())
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")


@cache
def _hashed_fields(kind: type[Any]) -> tuple[tuple[str, bytes, bool, object], ...]:
    """Return name, prefix in the digest, membership in `LATER`, and default value of each field that is hashed."""
    later, unseen = LATER.get(kind.__name__, ()), UNSEEN.get(kind.__name__, ())
    return tuple(
        (field.name, f"field {field.name} ".encode(), field.name in later, field.default)
        for field in fields(kind)
        if field.name not in unseen
    )


@cache
def _dtype_name(dtype: np.dtype[Any]) -> str:
    return str(dtype)
