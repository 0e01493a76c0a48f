"""Radiosity solution on the device, looked up at a point of a triangle [PB A.4].

Each triangle of the scene has its own lattice of elements, see `glpath.radiosity.mesh.lattice`. The lattice
coordinates of a point are an affine map of its position, so a look-up costs the same for every mesh. It reads three
texels of the triangle, one of the element and three of its corners.

Cost:     48 bytes a triangle, 112 bytes an element, or 144 with the values for guides.
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
        "RANGE": "n; number of its first element; 0; 0",
    },
    "element": {
        "MIN_DISTANCE": "of a ray that looks its front up, scene units; of one that looks its back up; 0; 0"
    },
    "radiosity": {
        "FIRST": "irradiance, W m^-2, at the first corner of an element's front or back in turns; how much "
        "of the direct light is in it",
        "SECOND": "the same at the second corner",
        "THIRD": "the same at the third corner",
    },
    "all_light": {"IRRADIANCE": "of an element's front or back, with all light in it; 0. Only for guides"},
}
# Element indices are stored as floats, which are exact up to this number.
_MAX_ELEMENTS = 1 << 24


def radiosity_glsl() -> str:
    """Return the layout as GLSL, for `#include <RADIOSITY>`."""
    return store_glsl("radiosity", FLOATS, LAYOUT)


class Values(Protocol):
    """Values of a radiosity solution to be looked up; see `glpath.radiosity.lookup.LookupTable`.

    corners      : (2, E, 3, 4) irradiance at the corners of the elements' fronts and backs, W m^-2, triangle after
                   triangle; the fourth channel is the included fraction of direct light, 0 to 1
    all_light    : (2, E, 3) irradiance of elements, including all direct light
    min_distance : (2, E) minimum length of a path that looks up an element's front or back, scene units
    """

    @property
    def corners(self) -> Float64: ...

    @property
    def all_light(self) -> Float64: ...

    @property
    def min_distance(self) -> Float64: ...


class DeviceRadiosity:
    """Texture with the irradiance of a radiosity solution.

    Parameters
    ----------
    corners   : (T, 3, 3) corners of the scene's triangles, world space
    divisions : (T,) number of segments of each triangle's edges
    leaf      : (E,) index of the solver's element that contains each element
    table     : see `Values`
    reflectance  : (2, T, 3) reflectance of the triangles' fronts and backs
    all_light    : True to include the irradiance with all light, for guides
    volume       : irradiance on streamed triangles; None if the scene has none

    Attributes
    ----------
    divisions, leaf : as given
    has_all_light : True if the texture contains the irradiance with all light, for guides
    textures, uniforms, defines, generated : inputs of programs that include radiosity.glsl
    max_radiance : maximum reflected radiance

    Raises SceneError if the solution has more elements than the device holds.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        corners: Float64,
        divisions: NDArray[np.int32],
        leaf: NDArray[np.int64],
        table: Values,
        reflectance: Float64,
        *,
        all_light: bool = False,
        volume: Volume | None = None,
    ) -> None:
        count, elements = len(corners), divisions.astype(np.int64) ** 2
        total = int(elements.sum())
        limit = int(gl.info["GL_MAX_TEXTURE_SIZE"]) * WIDTH - 3 * count
        max_elements = max(0, min(_MAX_ELEMENTS, limit // (9 if all_light else 7)))
        if total > max_elements:
            raise SceneError(
                f"radiosity: the solution has {total:,} elements; this device looks up at most {max_elements:,}",
                "Solve the scene on a coarser mesh.",
            )
        lattice = np.zeros((count, 3, 4))
        lattice[:, :2] = _lattice_rows(corners, divisions)
        lattice[:, 2, 0] = divisions
        first = np.cumsum(elements) - elements
        lattice[:, 2, 1] = first
        light = table.corners[..., :3].max(axis=2)
        max_of_triangle = np.maximum.reduceat(light, first, axis=1) if count else np.zeros((2, 0, 3))
        self.max_radiance = float((reflectance * max_of_triangle).max(initial=0.0)) / np.pi
        distance = np.zeros((total, 1, 4))
        distance[:, 0, :2] = table.min_distance.T
        guiding = np.zeros((2 * total if all_light else 0, 1, 4))
        if all_light:
            guiding[:, 0, :3] = table.all_light.swapaxes(0, 1).reshape(-1, 3)
        tables = {
            "lattice": lattice,
            "element": distance,
            "radiosity": table.corners.swapaxes(0, 1).reshape(-1, 3, 4),
            "all_light": guiding,
        }
        texture, self.uniforms = make_store(gl, FLOATS, LAYOUT, tables, "radiosity")
        self.divisions, self.leaf, self.has_all_light = divisions, leaf, all_light
        self.textures = {"radiosity": texture}
        self.defines: dict[str, object] = {}
        self.generated = {"RADIOSITY": radiosity_glsl()}
        if volume is not None:
            of_streams = DeviceIrradianceVolume(gl, volume)
            self.textures |= of_streams.textures
            self.uniforms |= of_streams.uniforms
            self.generated |= of_streams.generated


def _lattice_rows(corners: Float64, divisions: NDArray[np.int32]) -> Float64:
    """Return (T, 2, 4): gradient and offset of the lattice coordinates of triangles (T, 3, 3)."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    square = np.einsum("ti,ti->t", normal, normal)
    # Each barycentric coordinate is 1 at its own corner and 0 along the opposite edge.
    gradient = np.stack([np.cross(e2, normal), np.cross(normal, e1)], axis=1)
    gradient *= (divisions / square)[:, None, None]
    offset = -np.einsum("tki,ti->tk", gradient, corners[:, 0])
    return np.concatenate([gradient, offset[..., None]], axis=2)
