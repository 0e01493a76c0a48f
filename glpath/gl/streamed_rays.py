"""Visibility from points along common directions out of a scene that is read part by part, never all at once.

A ray is occluded if any part occludes it, so parts may come in any order, and each only once: all directions from
all points are tested while it is loaded. Occluded rays are not cast again. A direction is also skipped for a square
of points if all its rays miss the part's box.

Cost:     the BVH of each part once, half a microsecond a triangle on two cores; a ray of `ParallelRays` for each
          point, direction and part that it may hit. 16 bytes a point on the device.
Poor at:  parts that contain one another, so that their boxes do not separate them.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.device_scene import DeviceScene
from glpath.gl.owner import Owner
from glpath.gl.parallel_rays import WORD, along_z_curve, texel_table, z_curve_texels
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.ray_bvh import PartBvh

Float64 = NDArray[np.float64]

# Number of points along a square's side, few enough for small boxes.
_SQUARE = 64
# Maximum number of words in one draw, one word for each point and 32 directions.
_POINTS_A_DRAW = 1 << 17
# Padding of boxes against rounding, as a fraction of the scene's extent.
_MARGIN = 1e-5
# Defines that do not apply to streamed triangles, which are opaque.
_NOT_STREAMED = ("HAS_ALPHA", "HAS_INSTANCES", "HAS_THIN_DIELECTRICS", "HAS_VARYING_THIN_DIELECTRICS")


class StreamedRays(Owner):
    """Points on the device, with rays through parts of a streamed scene.

    gl        : the context
    scene     : the part of the scene that is not streamed
    positions : (N, 3), in the space of the device's scene, already offset from the surfaces
    extent    : maximum absolute coordinate of the points and all triangles
    """

    def __init__(self, gl: moderngl.Context, scene: DeviceScene, positions: Float64, extent: float) -> None:
        self._gl, self._scene = gl, scene
        self._margin = _MARGIN * extent
        self._words = max(1, min(_POINTS_A_DRAW // _SQUARE**2, gl.info["GL_MAX_TEXTURE_SIZE"] // _SQUARE))
        self._texels = across = z_curve_texels(_SQUARE)
        rows = _SQUARE * self._words
        self._directions = texel_table(gl, (WORD, self._words), "f4", 4)
        self._asked = texel_table(gl, (_SQUARE, rows), "u4", 1)
        self._seen = texel_table(gl, (_SQUARE, rows), "u4", 1)
        self._target = gl.framebuffer([self._seen])
        order = along_z_curve(positions)
        self._squares: list[tuple[NDArray[np.intp], moderngl.Texture]] = []
        boxes = []
        for first in range(0, len(positions), _SQUARE**2):
            which = order[first : first + _SQUARE**2]
            texels = np.zeros((_SQUARE**2, 4), np.float32)
            texels[across[: len(which)], :3] = positions[which]
            texture = texel_table(gl, (_SQUARE, _SQUARE), "f4", 4)
            texture.write(texels.tobytes())
            self._squares.append((which, texture))
            boxes.append((positions[which].min(axis=0), positions[which].max(axis=0)))
        self._boxes = np.array(boxes).reshape(-1, 2, 3)

    def narrow(
        self,
        part: PartBvh,
        lower: Float64,
        upper: Float64,
        directions: Float64,
        words: NDArray[np.uint32],
    ) -> None:
        """Clear the bits of words (ceil(D / 32), N) whose rays hit a part of the scene.

        lower, upper : (3,) corners of the box around the part
        directions   : (D, 3) unit
        """
        scene = self._scene
        program = load_program(
            self._gl,
            vertex="gl/fullscreen.vert",
            fragment="daylight/parallel_rays.frag",
            generated={**scene.generated, **part.generated},
            defines={k: v for k, v in scene.defines.items() if k not in _NOT_STREAMED}
            | part.defines
            | {"ASKED": 1},
        )
        textures = {
            **scene.textures,
            **part.textures,
            "shared_directions": self._directions,
            "asked_words": self._asked,
        }
        uniforms = {**scene.uniforms, **part.uniforms, "square": _SQUARE}
        toward = np.zeros((len(words) * WORD, 4), np.float32)
        toward[: len(directions), :3] = directions
        for (which, positions), (low, high) in zip(self._squares, self._boxes, strict=True):
            toward[: len(directions), 3] = meets(
                lower - high - self._margin, upper - low + self._margin, directions
            )
            by_word = toward.reshape(len(words), WORD, 4)
            asking = np.flatnonzero(by_word[:, :, 3].any(axis=1))
            if not len(asking):
                continue
            asked = words[np.ix_(asking, which)]
            open_ = asked.any(axis=1)
            asking, asked = asking[open_], asked[open_]
            rays = Pass(
                "parallel rays",
                self._gl,
                program,
                self._target,
                textures={**textures, "point_positions": positions},
            )
            for first in range(0, len(asking), self._words):
                some = slice(first, first + self._words)
                words[np.ix_(asking[some], which)] = self._drawn(rays, uniforms, by_word[asking[some]], asked[some])

    def _drawn(
        self, rays: Pass, uniforms: dict[str, object], toward: NDArray[np.float32], asked: NDArray[np.uint32]
    ) -> NDArray[np.uint32]:
        """Return the (W, n) words `asked` with the bits of occluded rays cleared."""
        count, texels = len(asked), _SQUARE**2
        where = self._texels[: asked.shape[1]]
        table = np.zeros((count, texels), np.uint32)
        table[:, where] = asked
        self._directions.write(np.ascontiguousarray(toward), viewport=(0, 0, WORD, count))
        self._asked.write(table, viewport=(0, 0, _SQUARE, _SQUARE * count))
        rays.area = (0, 0, _SQUARE, _SQUARE * count)
        rays.run(uniforms)
        seen = np.frombuffer(self._seen.read(), np.uint32)[: count * texels]
        return seen.reshape(count, texels)[:, where]


def meets(lower: Float64, upper: Float64, directions: Float64) -> NDArray[np.bool_]:
    """Return (D,) bool: True if the ray from the origin along a direction (D, 3) hits the box.

    lower, upper : (3,) corners of the box
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = lower / directions, upper / directions
    # A ray parallel to the planes of an axis lies between them either everywhere or nowhere.
    within = (lower <= 0) & (upper >= 0)
    still = directions == 0
    near, far = np.minimum(near, far), np.maximum(near, far)
    near = np.where(still, np.where(within, -np.inf, np.inf), near)
    far = np.where(still, np.where(within, np.inf, -np.inf), far)
    return np.asarray(np.maximum(near.max(axis=1), 0.0) <= far.min(axis=1))
