"""Embree as a peer: the nearest primitive of every ray and its t, for checks and timing.

Embree comes with the package embreex (the `reference` extra), and can be called in two ways:

- `embreex` itself: only triangles, ray by ray, on one thread, because it holds Python's lock.
- the library in its wheel, through its C interface: also spheres (exact ones of Embree, not tessellated), one
  ray or eight coherent rays at a time, on all cores. numba compiles the loop over rays. This is Embree's fastest
  way for primary rays.

Poor at:  ellipsoids, which Embree does not have; planes.
Source:   Wald et al. 2014, Embree: a kernel framework for efficient CPU ray tracing; embree.org's rtcore_ray.h.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError
from glpath.scene.model import Camera
from glpath.system.machine import core_count

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Hits = tuple[Int32, Float32]
Method = Literal["single", "packets"]

REMEDY = "pip install 'glpath[reference]'"

# Constants of rtcore_geometry.h, rtcore_buffer.h and rtcore_common.h of Embree 4.
_TRIANGLES, _SPHERES = 0, 50
_INDICES, _VERTICES = 0, 1
_UINT3, _FLOAT3, _FLOAT4 = 0x5003, 0x9003, 0x9004
_COHERENT, _ALL_FEATURES = 1 << 16, 0xFFFFFFFF
_POINTS_SUPPORTED = 101

# Offsets in RTCRayHit, in words of 4 bytes; a packet of 8 rays has each word 8 times. Two instances follow the
# geometry.
_STRIDE = 24
_ORIGIN, _NEAR, _DIRECTION, _TIME, _FAR, _MASK, _PRIMITIVE, _GEOMETRY = 0, 3, 4, 7, 8, 9, 17, 18
PACKET = 8


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = [
        ("flags", ctypes.c_uint),
        ("features", ctypes.c_uint),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("intersect", ctypes.c_void_p),
    ]


def load_embreex() -> Any:
    """Return the package embreex. Raises GlpathError if it cannot be imported."""
    try:
        import embreex
        import embreex.mesh_construction
        import embreex.rtcore_scene
    except ImportError as error:
        raise GlpathError(
            f"embreex cannot be imported ({error}); it is needed only as a peer and a reference.", REMEDY
        ) from error
    return embreex


@cache
def _library() -> Any:
    """Return the library of Embree 4 in embreex, with the types of the functions used here."""
    package = Path(load_embreex().__file__).parent
    found = sorted(package.parent.glob("embreex.libs/libembree4*")) + sorted(package.glob("**/libembree4*"))
    if not found:
        raise GlpathError(f"{package}: no libembree4 beside it; another version of embreex?", REMEDY)
    library = ctypes.CDLL(str(found[0]))
    pointer, number, size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
    for name, result, arguments in (
        ("rtcNewDevice", pointer, [ctypes.c_char_p]),
        ("rtcReleaseDevice", None, [pointer]),
        ("rtcGetDeviceProperty", ctypes.c_ssize_t, [pointer, ctypes.c_int]),
        ("rtcGetDeviceError", ctypes.c_int, [pointer]),
        ("rtcNewScene", pointer, [pointer]),
        ("rtcCommitScene", None, [pointer]),
        ("rtcReleaseScene", None, [pointer]),
        ("rtcNewGeometry", pointer, [pointer, ctypes.c_int]),
        (
            "rtcSetNewGeometryBuffer",
            pointer,
            [pointer, ctypes.c_int, number, ctypes.c_int, size, size],
        ),
        ("rtcCommitGeometry", None, [pointer]),
        ("rtcAttachGeometry", number, [pointer, pointer]),
        ("rtcReleaseGeometry", None, [pointer]),
        ("rtcIntersect1", None, [pointer] * 3),
        ("rtcIntersect8", None, [pointer] * 4),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def camera_rays(camera: Camera) -> tuple[Float32, Float32]:
    """Return origins and unit directions (H * W, 3) float32, C-contiguous, through pixels' centres, row 0 first."""
    width, height = camera.resolution
    origins = np.broadcast_to(camera.position, (width * height, 3))
    return np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(camera.rays().reshape(-1, 3), np.float32)


class EmbreeScene:
    """Spheres or triangles in Embree, ready to trace. Use it by `with`, because it owns Embree's memory.

    Primitives are numbered as in the arrays. Create it with `of_spheres` or `of_triangles`.
    """

    def __init__(self, kind: int, buffers: list[tuple[int, int, NDArray[Any]]]) -> None:
        self._library = _library()
        self._device = self._library.rtcNewDevice(None)
        if not self._library.rtcGetDeviceProperty(self._device, _POINTS_SUPPORTED):
            self._library.rtcReleaseDevice(self._device)
            raise GlpathError("this build of Embree has no spheres.", REMEDY)
        self._scene = self._library.rtcNewScene(self._device)
        geometry = self._library.rtcNewGeometry(self._device, kind)
        for use, form, data in buffers:
            stride = data.itemsize * data.shape[1]
            # Copy to Embree's memory: a shared buffer would need padding and would have to outlive the scene.
            place = self._library.rtcSetNewGeometryBuffer(geometry, use, 0, form, stride, len(data))
            ctypes.memmove(place, np.ascontiguousarray(data).ctypes.data, stride * len(data))
        self._library.rtcCommitGeometry(geometry)
        self._library.rtcAttachGeometry(self._scene, geometry)
        self._library.rtcReleaseGeometry(geometry)
        self._library.rtcCommitScene(self._scene)
        problem = self._library.rtcGetDeviceError(self._device)
        assert problem == 0, f"Embree's error {problem} while building"

    @classmethod
    def of_spheres(cls, centres: NDArray[np.floating[Any]], radii: NDArray[np.floating[Any]]) -> EmbreeScene:
        """Build from centres (N, 3) and radii (N,) in scene units."""
        return cls(_SPHERES, [(_VERTICES, _FLOAT4, np.column_stack([centres, radii]).astype(np.float32))])

    @classmethod
    def of_triangles(cls, triangles: NDArray[np.floating[Any]]) -> EmbreeScene:
        """Build from triangles' corners (N, 3, 3) in scene units."""
        corners = np.zeros((3 * len(triangles), 4), np.float32)
        corners[:, :3] = triangles.reshape(-1, 3)
        indices = np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3)
        return cls(_TRIANGLES, [(_VERTICES, _FLOAT3, corners), (_INDICES, _UINT3, indices)])

    def __enter__(self) -> EmbreeScene:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._library.rtcReleaseScene(self._scene)
        self._library.rtcReleaseDevice(self._device)

    def nearest(
        self, origins: Float32, directions: Float32, *, method: Method = "packets", threads: int | None = None
    ) -> Hits:
        """Return each ray's nearest primitive, (R,) int32, -1 if there is none, and t, (R,) float32.

        origins, directions : (R, 3) float32, C-contiguous
        method              : "packets" of 8 coherent rays, for R divisible by 8, or "single" rays
        threads             : number of threads; by default one for each core
        """
        rays = len(origins)
        assert method == "single" or rays % PACKET == 0, f"{rays} rays are no whole number of packets"
        loop, arguments = _loop(method), _Arguments(_COHERENT, _ALL_FEATURES, None, None, None)
        numbers, distances = np.empty(rays, np.int32), np.empty(rays, np.float32)
        count = threads or core_count()
        # Give each thread several parts, because rays that see more of the scene take longer.
        edges = np.linspace(0, rays // PACKET, (1 if count == 1 else 8 * count) + 1).astype(int) * PACKET
        edges[-1] = rays

        def trace(i: int) -> None:
            part = slice(edges[i], edges[i + 1])
            record = _aligned(_STRIDE * PACKET)
            loop(
                self._scene,
                ctypes.addressof(arguments),
                record,
                origins[part],
                directions[part],
                numbers[part],
                distances[part],
            )

        with ThreadPoolExecutor(count) as pool:
            list(pool.map(trace, range(len(edges) - 1)))
        return numbers, distances


def embreex_triangles(triangles: NDArray[np.floating[Any]]) -> Callable[[Float32, Float32], Int32]:
    """Return a function by embreex itself from origins and directions (R, 3) to primitives (R,), -1 for none.

    The scene is built before it returns.
    """
    embreex = load_embreex()
    scene = embreex.rtcore_scene.EmbreeScene()
    embreex.mesh_construction.TriangleMesh(scene, np.ascontiguousarray(triangles, np.float32))
    ray = np.zeros((1, 3), np.float32)
    scene.run(ray, ray + np.float32(1))  # the first call builds
    return lambda origins, directions: np.asarray(scene.run(origins, directions))


def _aligned(words: int) -> Float32:
    """Return float32 words at a multiple of 64 bytes, which Embree's vector loads need."""
    memory = np.zeros(words + 16, np.float32)
    skip = -memory.ctypes.data % 64 // 4
    return memory[skip : skip + words]


@cache
def _loop(method: Method) -> Callable[..., None]:
    """Compile the loop over rays; like embreex, it writes the record, calls Embree, and reads the answer."""
    import numba

    one, eight = _library().rtcIntersect1, _library().rtcIntersect8
    lanes = _aligned(PACKET)
    lanes.view(np.int32)[:] = -1  # all lanes are active
    lane_address = lanes.ctypes.data
    _keep.append(lanes)

    @numba.njit(nogil=True)
    def single(scene, arguments, record, origins, directions, numbers, distances):  # type: ignore[no-untyped-def]
        words = record.view(np.int32)
        for i in range(len(origins)):
            for k in range(3):
                record[_ORIGIN + k] = origins[i, k]
                record[_DIRECTION + k] = directions[i, k]
            record[_NEAR], record[_TIME], record[_FAR] = 0.0, 0.0, np.inf
            words[_MASK], words[_PRIMITIVE], words[_GEOMETRY] = -1, -1, -1
            words[_GEOMETRY + 1] = words[_GEOMETRY + 2] = -1
            one(scene, record.ctypes.data, arguments)
            numbers[i] = words[_PRIMITIVE]
            distances[i] = record[_FAR]

    @numba.njit(nogil=True)
    def packets(scene, arguments, record, origins, directions, numbers, distances):  # type: ignore[no-untyped-def]
        words = record.view(np.int32)
        for first in range(0, len(origins), PACKET):
            for i in range(PACKET):
                for k in range(3):
                    record[(_ORIGIN + k) * PACKET + i] = origins[first + i, k]
                    record[(_DIRECTION + k) * PACKET + i] = directions[first + i, k]
                record[_NEAR * PACKET + i] = record[_TIME * PACKET + i] = 0.0
                record[_FAR * PACKET + i] = np.inf
                words[_MASK * PACKET + i] = words[_PRIMITIVE * PACKET + i] = -1
                for k in range(3):
                    words[(_GEOMETRY + k) * PACKET + i] = -1
            eight(lane_address, scene, record.ctypes.data, arguments)
            for i in range(PACKET):
                numbers[first + i] = words[_PRIMITIVE * PACKET + i]
                distances[first + i] = record[_FAR * PACKET + i]

    return single if method == "single" else packets


# Arrays whose addresses are part of compiled code.
_keep: list[NDArray[Any]] = []
