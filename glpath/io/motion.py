"""Motion keys of cameras and shapes in a scene file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import UnsetType

from glpath.io import description, transform
from glpath.io.values import LARGEST
from glpath.scene.camera import CameraKey
from glpath.scene.model import Float64
from glpath.scene.motion import Motion
from glpath.scene.source_location import SourceLocation


def camera_keys(given: description.View) -> tuple[CameraKey, ...]:
    """Return the motion keys of a camera; `check_camera` checks them."""

    def of(key: description.CameraKey, name: str) -> Float64:
        own = getattr(key, name)
        return np.array(getattr(given, name) if isinstance(own, UnsetType) else own, np.float64)

    return tuple(
        CameraKey(float(key.time), of(key, "position"), of(key, "target"), of(key, "up")) for key in given.motion
    )


def motion_of(keys: Sequence[description.Key], placed: Float64, location: SourceLocation) -> Motion | None:
    """Return the motion of an object whose own transforms are `placed` (N, 3, 4); None if there are no keys.

    location : location of the list of keys

    Raises SceneError for keys whose times do not ascend, that mirror, or that lead beyond `LARGEST`.
    """
    if not keys:
        return None
    maps = []
    for index, key in enumerate(keys):
        here = location.item(index)
        if index and not key.time > keys[index - 1].time:
            raise here.field("time").wrong(
                key.time, f"above {keys[index - 1].time:g}, the key before", "Sort them."
            )
        matrix = transform.world_from_shape(key.transform, here.field("transform"))
        if transform.mirrors(matrix):
            raise here.field("transform").error(
                "mirrors, which nothing that moves can do.", "Put the mirror into the shape's own transform."
            )
        if not np.all(np.abs(matrix) <= LARGEST):
            raise here.field("transform").error(f"reaches beyond {LARGEST:g} scene units.", "Check its numbers.")
        maps.append(matrix[:3])
    return Motion(np.array([key.time for key in keys], np.float64), np.array(maps), placed)
