"""One number for all that changes the picture of a scene, made from the fields of its dataclasses.

A new field is in it the day it is declared; what changes no picture is listed here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import fields, is_dataclass

import numpy as np

#: Fields that change no picture, by the dataclass that has them.
UNSEEN = {
    "Scene": {"name", "source", "exposure", "unit", "centred_by"},
    "Shape": {"name", "kind", "maintenance_factor"},
    "Material": {"name"},
    "Texture": {"name"},
    "Light": {"name", "maintenance_factor"},
    "Sky": {"assumed"},
    "Environment": {"assumed", "solar"},
}

#: Fields that came later, by the dataclass that has them: at their defaults they are left out, so that scenes that
#: do without have the digest that they had.
LATER = {
    "Camera": {
        *("projection", "height", "aperture_radius", "focus_distance", "shutter", "motion"),
        *("principal_point", "pixel_aspect"),
    },
    "Shape": {"motion"},
    "Scene": {"portals", "background"},
    "Material": {"slab", "distribution", "layering", "metal_index"},
}

_Update = Callable[[bytes], None]


def digest_of(*values: object) -> str:
    """SHA-256 (hex) of dataclasses, tuples, arrays, numbers, texts and None, as far as a picture rests on them.

    The same for equal values, whether or not they are one object; numbers count as float64, arrays by their values
    as int64 or float64, bytes as bytes. What has an attribute `digest` that is a text counts by that, so that it
    can be kept.
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
        kind = type(value).__name__
        update(f"dataclass {kind} ".encode())
        for field in fields(value):
            own = getattr(value, field.name)
            is_default = not isinstance(own, np.ndarray) and own == field.default
            absent = field.name in LATER.get(kind, ()) and is_default
            if field.name not in UNSEEN.get(kind, ()) and not absent:
                update(f"field {field.name} ".encode())
                _add(own, update)
    elif isinstance(value, str):
        update(f"text {len(value)} {value}".encode())
    elif isinstance(value, tuple):
        update(f"tuple {len(value)} ".encode())
        for each in value:
            _add(each, update)
    elif isinstance(value, np.ndarray):
        kept = value.dtype == np.uint8  # pictures are large
        array = value if kept else value.astype("<f8" if value.dtype.kind == "f" else "<i8", copy=False)
        update(f"array {array.dtype} {array.shape} ".encode())
        update(np.ascontiguousarray(array).tobytes())
    elif isinstance(value, bool | int | float | np.generic):
        update(b"number" + np.array(value, "<f8").tobytes())
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")
