"""Irradiance volume on the device, for programs that look up the irradiance of streamed triangles."""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.texel_store import FLOATS, Rows, make_store, store_glsl
from glpath.scene.model import Float64

_SIDES = ("front", "back")
_AXES = ("x", "-x", "y", "-y", "z", "-z")
#: Contents of an entry's RGBA float32 texels, in order, by section.
LAYOUT: dict[str, dict[str, str]] = {
    "volume_cells": {"ROWS": "of four cells, numbers of `volume`"},
    "volume": {
        f"{side}_{axis.replace('-', 'minus_')}".upper(): f"of a {side}, toward {axis}: irradiance W m^-2, linear "
        "Rec. 709; how much of the direct light is in it"
        for side in _SIDES
        for axis in _AXES
    },
}


class Volume(Protocol):
    """Irradiance volume to be looked up; see `glpath.radiosity.irradiance_volume`.

    lower, cell, size : lower corner (3,), scene units; side of a cell; number of cells (3,) along x, y, z
    rows   : (z, y, x) int32, index of each cell's row in `values`
    values : (R, 2, 6, 4) float32, irradiance of fronts and backs along six axes
    """

    @property
    def lower(self) -> Float64: ...

    @property
    def cell(self) -> float: ...

    @property
    def size(self) -> NDArray[np.int64]: ...

    @property
    def rows(self) -> NDArray[np.int32]: ...

    @property
    def values(self) -> NDArray[np.float32]: ...


class DeviceIrradianceVolume:
    """Texture with the table of an irradiance volume.

    textures, uniforms, generated : inputs of programs that include irradiance_volume.glsl
    """

    def __init__(self, gl: moderngl.Context, volume: Volume) -> None:
        cells = volume.rows.ravel()
        rows = np.zeros((-(-len(cells) // 4), 1, 4))
        rows.reshape(-1)[: len(cells)] = cells
        tables: dict[str, Rows] = {
            "volume_cells": rows,
            "volume": volume.values.reshape(-1, len(LAYOUT["volume"]), 4),
        }
        texture, bases = make_store(gl, FLOATS, LAYOUT, tables, "radiosity")
        self.textures = {"irradiance_volume": texture}
        self.uniforms: dict[str, object] = {
            **bases,
            "volume_lower": tuple(volume.lower),
            "volume_cell": volume.cell,
            "volume_size": tuple(int(n) for n in volume.size),
        }
        self.generated = {"IRRADIANCE_VOLUME": store_glsl("irradiance_volume", FLOATS, LAYOUT)}
