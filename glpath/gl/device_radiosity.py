"""A radiosity solution on the device, looked up at a point of a triangle [PB A.4].

Each triangle of the scene has its own lattice of elements, see `glpath.radiosity.mesh.lattice`. A point's position
in it is an affine map, so that a lookup costs the same whatever the mesh: three texels of the triangle, and one of
its element or three of the vertices around.

Cost:     48 bytes a triangle, 80 bytes an element or vertex, 112 with all light.
"""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.gl.device_irradiance_volume import DeviceIrradianceVolume, Volume
from glpath.gl.texel_store import FLOATS, WIDTH, make_store, store_glsl
from glpath.scene.model import Float64

#: Layout of the texture: for each section, the RGBA float32 texels of an entry, in order.
LAYOUT: dict[str, dict[str, str]] = {
    "lattice": {
        "X": "of a triangle: dot(X.xyz, position) + X.w is the lattice coordinate x, from 0 to n",
        "Y": "the same for y",
        "RANGE": "n; number of the first of its values; 0; number of its first element",
    },
    "element": {
        "LOOKUP": "distance from which on its front and its back may be looked up, scene units; whether values are "
        "not interpolated there, 1 or 0"
    },
    "element_value": {
        "IRRADIANCE": "W m^-2; front and back of an element in turns; how much of direct light is in it"
    },
    "radiosity": {
        "IRRADIANCE": "W m^-2; front and back of an element or vertex in turns; how much of direct light is in it"
    },
    "all_light": {"IRRADIANCE": "the same, where it is asked for, with all light in it"},
}
# A float holds the number of a value.
_MAX_ROWS = 1 << 24


def radiosity_glsl() -> str:
    """The layout as GLSL."""
    return store_glsl("radiosity", FLOATS, LAYOUT)


class Values(Protocol):
    """The table to look up.

    values       : (2, N, 3) irradiance, W m^-2, front and back, of the elements or of the vertices, triangle after
                   triangle
    direct_share : (N,) how much of the direct light is in them, 0 to 1
    starts       : (T,) number of each triangle's first value
    all_light    : as `values`, with all light
    min_distance : (2, E) from which on the elements' fronts and backs may be looked up, scene units
    constant     : (2, E) bool, `elements` are looked up there instead of values between vertices
    elements     : (2, E, 3) irradiance of elements, W m^-2
    element_share : (E,) how much of the direct light is in `elements`, 0 to 1
    """

    @property
    def values(self) -> Float64: ...

    @property
    def direct_share(self) -> Float64: ...

    @property
    def starts(self) -> NDArray[np.int64]: ...

    @property
    def all_light(self) -> Float64: ...

    @property
    def min_distance(self) -> Float64: ...

    @property
    def constant(self) -> NDArray[np.bool_]: ...

    @property
    def elements(self) -> Float64: ...

    @property
    def element_share(self) -> Float64: ...


class DeviceRadiosity:
    """Irradiance in a texture.

    Parameters
    ----------
    corners   : (T, 3, 3) of the scene's triangles, world space
    divisions : (T,) n of each triangle
    table     : see `Values`
    reflectance  : (2, T, 3) of the triangles' fronts and backs
    interpolated : are its values those of the vertices?
    all_light    : the values with all light as well, for programs with ALL_LIGHT
    volume       : what is looked up on streamed triangles, of a scene that has such

    Attributes
    ----------
    divisions : (T,) n of each triangle
    has_all_light : was it given?
    textures, uniforms, defines, generated : for programs that include radiosity.glsl
    max_radiance : the greatest radiance that is reflected

    Raises SceneError for more values than the device holds.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        corners: Float64,
        divisions: NDArray[np.int32],
        table: Values,
        reflectance: Float64,
        *,
        interpolated: bool,
        all_light: bool = False,
        volume: Volume | None = None,
    ) -> None:
        values, direct_share, starts = table.values, table.direct_share, table.starts
        count, given = len(corners), values.shape[1]
        assert divisions.shape == starts.shape == (count,), f"{divisions.shape} divisions of {count} triangles"
        limit = int(gl.info["GL_MAX_TEXTURE_SIZE"]) * WIDTH - 3 * count
        max_rows = max(0, min(_MAX_ROWS, limit // (7 if all_light else 5)))
        elements = divisions.astype(np.int64) ** 2
        # In a fine lattice these are twice as many as its vertices, and guides have their numbers.
        numbered = int(elements.sum()) if all_light else 0
        found = max(given, numbered)
        if found > max_rows:
            what = "vertices" if interpolated and given >= numbered else "elements"
            raise SceneError(
                f"radiosity: the solution has {found:,} {what}; this device looks up at most {max_rows:,}",
                "Solve the scene on a coarser mesh" + (', or take guide "cosine".' if numbered else "."),
            )
        lattice = np.zeros((count, 3, 4))
        lattice[:, :2] = _lattice_rows(corners, divisions)
        lattice[:, 2, 0] = divisions
        lattice[:, 2, 1] = starts
        lattice[:, 2, 3] = np.cumsum(elements) - elements
        irradiance = _sides_in_turns(values, direct_share)
        everything = _sides_in_turns(table.all_light, np.ones(given)) if all_light else np.zeros((0, 1, 4))
        max_of_triangle = np.maximum.reduceat(values, starts, axis=1) if count else np.zeros((2, 0, 3))
        self.max_radiance = float((reflectance * max_of_triangle).max(initial=0.0)) / np.pi
        lookup = np.zeros((table.min_distance.shape[1], 1, 4))
        lookup[:, 0, :2], lookup[:, 0, 2:] = table.min_distance.T, table.constant.T
        of_elements = _sides_in_turns(table.elements, table.element_share) if interpolated else lookup[:0]
        tables = {
            "lattice": lattice,
            "element": lookup,
            "element_value": of_elements,
            "radiosity": irradiance,
            "all_light": everything,
        }
        texture, self.uniforms = make_store(gl, FLOATS, LAYOUT, tables, "radiosity")
        self.divisions, self.has_all_light = divisions, all_light
        self.textures = {"radiosity": texture}
        self.defines: dict[str, object] = {"INTERPOLATED": 1} if interpolated else {}
        self.generated = {"RADIOSITY": radiosity_glsl()}
        if volume is not None:
            of_streams = DeviceIrradianceVolume(gl, volume)
            self.textures |= of_streams.textures
            self.uniforms |= of_streams.uniforms
            self.generated |= of_streams.generated


def _sides_in_turns(values: Float64, direct_share: Float64) -> Float64:
    """Return (2 N, 1, 4) texels that alternate fronts and backs: rgb is irradiance, alpha the direct share."""
    rows = np.empty((2 * len(direct_share), 1, 4))
    rows[:, 0, :3] = values.swapaxes(0, 1).reshape(-1, 3)
    rows[:, 0, 3] = np.repeat(direct_share, 2)
    return rows


def _lattice_rows(corners: Float64, divisions: NDArray[np.int32]) -> Float64:
    """(T, 2, 4): gradient and offset of the lattice coordinates of triangles (T, 3, 3)."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    square = np.einsum("ti,ti->t", normal, normal)
    # The barycentric coordinates are 1 at their own corner and 0 along the edge opposite.
    gradient = np.stack([np.cross(e2, normal), np.cross(normal, e1)], axis=1)
    gradient *= (divisions / square)[:, None, None]
    offset = -np.einsum("tki,ti->tk", gradient, corners[:, 0])
    return np.concatenate([gradient, offset[..., None]], axis=2)
