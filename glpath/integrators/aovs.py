"""AOVs: properties of the visible surfaces, summed over the path sets as radiance is.

AOVs use the same eye rays as the image, so edges are as soft in them as in the image. All sums are integers, in
units of a quantum, so they are exact in any order. The CPU counts the visible shapes, because their number is not
limited.

Cost:     a draw over the pixels for each path set. Albedo and normal, or depth and position, or ids, add some 3 %
          of processor time to a set of `cornell-box-36`; all AOVs with direct light add 14 %. Nothing if no AOV is
          requested.
Poor at:  mirrors and clear glass: position and ids are those of the mirror or glass, not of the surface seen in it.
          Albedo and normal are those of the surface seen in it if rays are cast (`path`, `gather`). Otherwise they
          are the mirror's own, and a denoiser blurs the reflection.
Source:   Open Image Denoise, documentation of the RT filter: albedo and normal, along delta paths.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.film.aovs import AOV_KINDS, GROUPS, ID_AOVS, SHAPES, add_aov
from glpath.gl.constants import HITS_SHIFT
from glpath.gl.device_scene import DeviceScene
from glpath.gl.lights import background_uniforms, sky_uniforms
from glpath.gl.passes import Pass
from glpath.gl.ping_pong import InTurn, PingPong
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.ray_bvh import RayBvh
from glpath.gl.sums import PixelSums
from glpath.integrators.settings import IntegratorSettings

Uniforms = dict[str, object]

# Sums of albedo and normals are integers; this is the number of quanta per unit.
_QUANTA = 1 << 20
# Maximum number of path sets that a 32-bit word can sum. Values are at most 2, because normal coordinates are
# stored plus 1 (`shaders/film/aov.glsl`).
_MAX_PATH_SETS = (1 << 11) - 1
# Bits of a position's coordinate: float precision plus the range that infinite planes need beyond the scene.
_POSITION_BITS = 36
#: Maximum distance of recorded positions from the world's origin, as a multiple of the scene's greatest distance.
FARTHEST = 1024
# Largest texture coordinate that is summed, enough for a tiled floor; larger ones are clamped.
_UV_EXTENT = 2.0**12
# Number of path sets whose shapes are collected on the device before they are read back together.
_SETS_READ = 8


def light_aovs(
    settings: IntegratorSettings, sums: PixelSums, dropped: NDArray[np.integer[Any]]
) -> dict[str, NDArray[np.float64]]:
    """Return the sums "dropped" and "direct" for `Film.add`, if AOVs need them. Call it after radiance was taken.

    dropped : (h, w) number of samples that were not finite
    """
    found = {"dropped": dropped[..., None].astype(np.float64)} if "samples" in settings.aovs else {}
    direct = sums.take_direct()
    return found if direct is None else {**found, "direct": direct}


@dataclass(frozen=True)
class Seen:
    """First hit of every pixel of a window.

    buffer  : (w, h) uint, the primitive's number + 1, 0 for none; with two components, the second has the bits of
              its t
    defines : defines of the sensor, see `gl.camera.camera_defines`
    hit_records : records of streamed triangles, by the name in GLSL, if the scene has streamed triangles
    bvh     : BVH for the albedo and normal of surfaces behind mirrors and clear glass; None to use their own
    """

    scene: DeviceScene
    buffer: moderngl.Texture
    defines: Mapping[str, object]
    hit_records: Mapping[str, moderngl.Texture] = field(default_factory=dict)
    bvh: RayBvh | None = None


class EyeAovs:
    """AOVs of surfaces in one window of the image.

    names : subset of `film.aovs.AOVS`
    """

    def __init__(self, names: Iterable[str], seen: Seen) -> None:
        scene, gl = seen.scene, seen.scene.gl
        self._gl, self._names, self._size = gl, set(names), seen.buffer.size
        groups = {name: group for name, group in GROUPS.items() if not self._names.isdisjoint(group.aovs)}
        sums = [name for group in groups.values() for name in group.sums]
        # The extent depends only on the scene, so that films by several cameras, and crops, have the same quantum.
        extent = FARTHEST * (float(np.linalg.norm(scene.centre)) + scene.radius)
        self._position_quanta = 2.0 ** min(_POSITION_BITS - int(np.ceil(np.log2(extent))), 120)
        self._uniforms = {
            **scene.uniforms,
            **sky_uniforms(scene.scene.sky),
            **background_uniforms(scene.scene),
            "position_quanta": self._position_quanta,
            "position_extent": 2.0**_POSITION_BITS / self._position_quanta,
            "uv_quanta": 2.0**_POSITION_BITS / _UV_EXTENT,
            "uv_extent": _UV_EXTENT,
        }
        components = {name: 1 if name == "sum_nearest" else 4 for name in sums}
        self._sums = PingPong(*({name: self._texture(n) for name, n in components.items()} for _ in range(2)))
        textures = {**scene.textures, "eye_buffer": seen.buffer, **seen.hit_records}
        self._pass: InTurn[Pass] | None = None
        if groups:
            # Output locations of each group's one or two sums. Both are defines, because a layout in GLSL 4.30
            # cannot contain an addition.
            outputs = {name: sums.index(group.sums[0]) for name, group in groups.items()}
            outputs |= {f"{name}_1": outputs[name] + 1 for name, group in groups.items() if len(group.sums) > 1}
            parts = ProgramParts.of(scene)
            if seen.bvh is not None:
                parts.add(seen.bvh)
                parts.defines["FOLLOWS_MIRRORS"] = 1
                self._uniforms |= parts.uniforms
                textures |= parts.textures
            defines = {**parts.defines, **seen.defines, "AOV_QUANTA": float(_QUANTA), **outputs}
            program = load_program(
                gl,
                vertex="gl/fullscreen.vert",
                fragment="film/aov.frag" if seen.buffer.components == 1 else "film/aov_primitives.frag",
                generated=parts.generated,
                defines=defines,
            )
            self._pass = self._sums.each(
                lambda read, write: Pass(
                    "AOVs", gl, program, gl.framebuffer([*write.values()]), textures={**textures, **read}
                )
            )
        self._shapes: list[moderngl.Texture] = []
        if not self._names.isdisjoint(ID_AOVS):
            self._make_shape_passes(seen, textures)
        self._path_sets = 0
        self._unread = 0  # number of path sets whose shapes are still on the device
        self._aov_sums: dict[str, NDArray[np.float64]] = {}
        self._shape_sets: list[NDArray[np.uint32]] = []
        self._begin()
        self._empty()

    @classmethod
    def of(cls, names: Iterable[str], seen: Seen) -> EyeAovs | None:
        """Create the AOVs, or return None if none of the names is an AOV of surfaces."""
        surfaces = {name for group in GROUPS.values() for name in group.aovs} | set(ID_AOVS)
        asked = surfaces.intersection(names)
        return cls(asked, seen) if asked else None

    def add(self, eye: Uniforms) -> None:
        """Add a path set, after its eye buffer was filled."""
        if self._pass is not None:
            if self._path_sets == _MAX_PATH_SETS:
                self._collect()
            self._pass.now.run(self._uniforms | eye)
            self._sums.swap()
        self._path_sets += 1
        if self._shapes:
            if self._unread == _SETS_READ:
                self._read_shapes()
            self._shape_passes[self._unread].run(self._uniforms)
            self._unread += 1

    def take(self) -> dict[str, NDArray[np.float64] | NDArray[np.uint32]]:
        """Return the sums for `Film.add`, over the path sets since the last call."""
        self._collect()
        found: dict[str, NDArray[np.float64] | NDArray[np.uint32]] = {
            name: sums for name, sums in self._aov_sums.items() if name in self._names
        }
        if self._shapes:
            self._read_shapes()
            found[SHAPES] = np.stack(self._shape_sets, axis=2) if self._shape_sets else self._no_shapes()
        self._begin()
        return found

    def _begin(self) -> None:
        height, width = self._size[::-1]
        self._aov_sums = {
            name: np.zeros((height, width, AOV_KINDS[name].numbers))
            for group in GROUPS.values()
            for name in group.aovs
            if name in self._names
        }
        self._shape_sets = []

    def _collect(self) -> None:
        """Move the sums from the device to the sums on the CPU: add them there, and clear them on the device."""
        sums = {name: self._read(texture) for name, texture in self._sums.read.items()}
        if "sum_first" in sums:
            first, second = (sums[name].astype(np.float64) for name in ("sum_first", "sum_second"))
            # Normals are stored plus 1. This offset is subtracted only for finite samples; others are not in the
            # sum.
            normal = np.concatenate([first[..., 3:], second[..., :2]], axis=2) / _QUANTA
            self._add("albedo", first[..., :3] / _QUANTA)
            self._add("normal", normal - (self._path_sets - second[..., 3:]))
        if "sum_low" in sums:
            words, hits = _joined(sums["sum_low"], sums["sum_high"])
            position = words / self._position_quanta
            self._add("position", np.concatenate([position[..., :3], hits], axis=2))
            self._add("depth", np.concatenate([position[..., 3:], hits], axis=2))
        if "sum_uv_low" in sums:
            uv, hits = _joined(sums["sum_uv_low"], sums["sum_uv_high"])
            self._add("uv", np.concatenate([uv[..., :2] * _UV_EXTENT / 2.0**_POSITION_BITS, hits], axis=2))
        if "sum_nearest" in sums:
            self._add("depth_min", sums["sum_nearest"].astype(np.float64))
        self._empty()

    def _add(self, name: str, sums: NDArray[np.float64]) -> None:
        if name in self._aov_sums:
            add_aov(name, self._aov_sums[name], sums)

    def _empty(self) -> None:
        for texture in self._sums.read.values():
            texture.write(bytes(4 * texture.components * self._size[0] * self._size[1]))
        self._path_sets = 0

    def _make_shape_passes(self, seen: Seen, textures: dict[str, moderngl.Texture]) -> None:
        program = load_program(
            self._gl,
            vertex="gl/fullscreen.vert",
            fragment="film/shapes_seen.frag",
            generated=seen.scene.generated,
            defines={**seen.scene.defines, "EYE_FORMAT": ("r32ui", "rg32ui")[seen.buffer.components - 1]},
        )
        self._shapes = [self._texture(1) for _ in range(_SETS_READ)]
        self._shape_passes = [
            Pass("shapes seen", self._gl, program, self._gl.framebuffer([texture]), textures=textures)
            for texture in self._shapes
        ]

    def _read_shapes(self) -> None:
        self._shape_sets += [self._read(texture)[..., 0] for texture in self._shapes[: self._unread]]
        self._unread = 0

    def _no_shapes(self) -> NDArray[np.uint32]:
        return np.zeros((*self._size[::-1], 0), np.uint32)

    def _texture(self, components: int) -> moderngl.Texture:
        texture = self._gl.texture(self._size, components, dtype="u4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture

    def _read(self, texture: moderngl.Texture) -> NDArray[np.uint32]:
        width, height = self._size
        return np.frombuffer(texture.read(), np.uint32).reshape(height, width, -1)[::-1]


def _joined(low: NDArray[np.uint32], high: NDArray[np.uint32]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return integer sums (h, w, 4) of low and high words, and the number of hits (h, w, 1); see `add_exactly`."""
    hits = (high[..., 3:] >> HITS_SHIFT).astype(np.float64)
    last = (high[..., 3:] & ((1 << HITS_SHIFT) - 1)).astype(np.int64)
    # The high words of the first three numbers are signed. The last number is unsigned and shares its word with the
    # hits.
    upper = np.concatenate([high[..., :3].view(np.int32), last], axis=2)
    return (upper << 32) + low.astype(np.int64), hits
