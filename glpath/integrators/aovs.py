"""AOVs: what the eye sees of the surfaces themselves, summed over the path sets as radiance is.

They come from the same eye rays, so that an edge is as soft in them as in the picture.

Cost:     a draw over the pixels for each path set: it adds 5 % to a set of `cornell-box-36`, 2 % to one of `room`.
          Nothing where none is asked for.
Poor at:  mirrors and glass, which show what others are: they have their own colour and normal here.
Source:   Open Image Denoise, documentation of the RT filter: albedo and normal of the first hit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.device_scene import DeviceScene
from glpath.gl.lights import sky_uniforms
from glpath.gl.passes import Pass
from glpath.gl.program import load_program

Uniforms = dict[str, object]

_SUMS = ("sum_first", "sum_second")
# A word of the sums holds those of so many path sets, of numbers up to 2: coordinates of a normal are 1 more than
# they are (`shaders/aov.frag`).
_QUANTA, _MOST_PATH_SETS = 1 << 20, (1 << 11) - 1


class EyeAovs:
    """The AOVs of one window of the image.

    names      : out of `film_metadata.AOVS`
    size       : (width, height) of the window, pixels
    eye_buffer : the triangle that every pixel sees + 1, 0 for none
    eye_defines : see `gl.camera.camera_defines`
    met        : records of streamed triangles, by the name in GLSL, where the scene has such
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        names: Sequence[str],
        size: tuple[int, int],
        eye_buffer: moderngl.Texture,
        eye_defines: Mapping[str, object],
        met: Mapping[str, moderngl.Texture] | None = None,
    ) -> None:
        self._names, self._size = names, size
        self._uniforms = {**scene.uniforms, **sky_uniforms(scene.scene.sky)}
        self._textures = [[gl.texture(size, 4, dtype="u4") for _ in _SUMS] for _ in range(2)]
        for texture in self._textures[0] + self._textures[1]:
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        program = load_program(
            gl,
            vertex="fullscreen.vert",
            fragment="aov.frag",
            generated=scene.generated,
            defines={**scene.defines, **eye_defines, "AOV_QUANTA": float(_QUANTA)},
        )
        seen = {**scene.textures, "eye_buffer": eye_buffer, **(met or {})}
        self._passes = [
            Pass(
                "AOVs",
                gl,
                program,
                gl.framebuffer(self._textures[1 - i]),
                textures=seen | dict(zip(_SUMS, self._textures[i], strict=True)),
            )
            for i in range(2)
        ]
        self._sum = 0  # which of the two sets of sums holds the present ones
        self._path_sets = 0
        self._taken = np.zeros((*size[::-1], 6))
        self._empty()

    def add(self, eye: Uniforms) -> None:
        """One more path set, whose eye buffer is filled."""
        if self._path_sets == _MOST_PATH_SETS:
            self._collect()
        self._passes[self._sum].run(self._uniforms | eye)
        self._sum = 1 - self._sum
        self._path_sets += 1

    def take(self) -> dict[str, NDArray[np.float64]]:
        """(h, w, 3) sums by name over the path sets since the last call, in multiples of one power of two."""
        self._collect()
        found = {"albedo": self._taken[..., :3], "normal": self._taken[..., 3:]}
        self._taken = np.zeros_like(self._taken)
        return {name: found[name] for name in self._names}

    def _collect(self) -> None:
        """Add what the device has to what was taken, and begin anew there."""
        width, height = self._size
        first, second = (
            np.frombuffer(texture.read(), np.uint32).reshape(height, width, 4)[::-1].astype(np.float64)
            for texture in self._textures[self._sum]
        )
        self._taken += np.concatenate([first, second[..., :2]], axis=2) / _QUANTA
        # What was not finite is not in the sum, so the 1 isn't either.
        self._taken[..., 3:] -= self._path_sets - second[..., 3:]
        self._empty()

    def _empty(self) -> None:
        for texture in self._textures[self._sum]:
            texture.write(bytes(16 * self._size[0] * self._size[1]))
        self._path_sets = 0
