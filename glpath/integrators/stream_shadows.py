"""Occlusion of the ray tracer's shadow rays by streamed triangles: a bit for each ray of each pixel [TB VI].

A shadow ray needs all triangles, but only part of a stream is in memory. So before pixels are shaded, their rays
are tested against part after part of the stream, and occluded rays are recorded. Shading tests the same rays
against the resident triangles. Lights with shadow-buffers need no rays.

Cost:     a ray for each part, pixel and light that is still unoccluded; 8 bytes for each pixel and 32 lights.
Poor at:  budgets that cannot cache all parts: each path set reads the stream and builds its BVHs.
"""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from glpath.errors import UsageError
from glpath.gl.clear import clear_integers
from glpath.gl.device_bvh import bvh_glsl, occluders_glsl
from glpath.gl.device_scene import DeviceScene
from glpath.gl.owner import Owner
from glpath.gl.passes import Pass
from glpath.gl.ping_pong import PingPong
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.stream_occluders import StreamOccluders

_WORD = 32


class StreamShadows(Owner):
    """Occlusion bits of a window's pixels.

    objects   : scene with a stream
    occluders : triangles of the stream; they reserve their part of the budget here
    size      : (columns, rows) of the window
    rays      : number of rays from each pixel
    parts     : program parts for shading the pixels
    tests     : buffer for the count of intersection tests; None to count nothing

    defines, uniforms : inputs of programs that include stream_shadows.glsl, like `textures` after `find`
    """

    def __init__(
        self,
        objects: DeviceScene,
        occluders: StreamOccluders,
        size: tuple[int, int],
        rays: int,
        parts: ProgramParts,
        tests: moderngl.Buffer | None = None,
    ) -> None:
        gl, stream = objects.gl, objects.stream
        assert stream is not None, "who streams"
        self._gl, self._occluders = gl, occluders
        words = max(1, -(-rays // _WORD))
        columns, texels = _pictures(size, words, int(gl.info["GL_MAX_TEXTURE_SIZE"]))
        pair = [stream.bits(texels) for _ in range(2)]
        self._words = PingPong(*((texture, gl.framebuffer([texture])) for texture in pair))
        occluders.take_share(stream)
        self.defines: dict[str, object] = {"STREAM_SHADOWS": 1}
        self.uniforms: dict[str, object] = {"stream_shadow_columns": columns}
        self._program = load_program(
            gl,
            vertex="gl/fullscreen.vert",
            fragment="t_buffer/stream_shadows.frag",
            generated={**objects.generated, "BVH": bvh_glsl(), "OCCLUDERS": occluders_glsl()},
            # Streamed triangles are opaque.
            defines={k: v for k, v in parts.defines.items() if k != "HAS_ALPHA"} | self.defines,
        )
        self._textures = parts.textures
        self._buffers = {0: tests} if tests is not None else {}

    @property
    def textures(self) -> dict[str, moderngl.Texture]:
        return {"stream_shadows": self._words.read[0]}

    def find(self, uniforms: Mapping[str, object]) -> None:
        """Find the occluded rays. The uniforms are those of the shading pass."""
        texture, target = self._words.read
        clear_integers(target, (0, 0, *texture.size))
        for part in self._occluders:
            ask = Pass(
                "shadow rays of streamed triangles",
                self._gl,
                self._program,
                self._words.write[1],
                textures={**self._textures, **part.textures, **self.textures},
                buffers=self._buffers,
            )
            ask.run({**uniforms, **self.uniforms, **part.uniforms})
            self._words.swap()
            # `finish` frees the part before the next, and keeps the device's watchdog from counting all parts as
            # one task.
            self._gl.finish()
            del ask, part


def _pictures(size: tuple[int, int], words: int, limit: int) -> tuple[int, tuple[int, int]]:
    """Return how many of `words` images lie side by side in one texture, and the texture's (columns, rows)."""
    columns = min(words, limit // size[0])
    texels = (columns * size[0], -(-words // columns) * size[1])
    if texels[1] > limit:
        raise UsageError(
            f"{_WORD * words} shadow rays of each of {size[0]} x {size[1]} pixels: a texture of {texels[0]} x "
            f"{texels[1]} texels, of which this device allows {limit} x {limit}.",
            "Render fewer pixels at once (crop), or the scene with fewer lights.",
        )
    return columns, texels
