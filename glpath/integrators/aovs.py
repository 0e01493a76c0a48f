"""AOVs: what the eye sees of the surfaces themselves, summed over the path sets as radiance is.

They come from the same eye rays, so that an edge is as soft in them as in the picture.

Cost:     a draw over the pixels for each AOV and path set: both add 8 % to a set of `cornell-box-36`, 3 % to one of
          `room`. Nothing where none is asked for.
Poor at:  mirrors and glass, which show what others are; engines that trace paths refuse them.
Source:   Open Image Denoise, documentation of the RT filter: albedo and normal of the first hit.
"""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.constants import DROPPED_SHIFT
from glpath.gl.device_scene import DeviceScene
from glpath.gl.lights import sky_uniforms
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.sums import PixelSums

Uniforms = dict[str, object]

# What is summed of each is at most this: coordinates of a normal are 1 more than they are (`shaders/aov.frag`).
_MOST = {"albedo": 1.0, "normal": 2.0}


class EyeAovs:
    """The AOVs of one window of the image.

    names      : out of `film_metadata.AOVS`
    size       : (width, height) of the window, pixels
    eye_buffer : the triangle that every pixel sees + 1, 0 for none
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        names: Sequence[str],
        size: tuple[int, int],
        eye_buffer: moderngl.Texture,
    ) -> None:
        self._uniforms = {**scene.uniforms, **sky_uniforms(scene.scene.sky)}
        self._sums = {name: PixelSums(gl, size, _MOST[name]) for name in names}
        self._passes: dict[str, list[Pass]] = {}
        for name, sums in self._sums.items():
            program = load_program(
                gl,
                vertex="fullscreen.vert",
                fragment="aov.frag",
                generated=scene.generated,
                defines={**scene.defines, name.upper(): 1},
            )
            textures = {**scene.textures, "eye_buffer": eye_buffer}
            self._passes[name] = [
                Pass(name, gl, program, sums.targets[1 - i], textures=textures | sums.textures[i]) for i in range(2)
            ]
        self._sum = 0  # which of the two sets of sums holds the present ones
        self._path_sets = 0

    def add(self, eye: Uniforms) -> None:
        """One more path set, whose eye buffer is filled."""
        for name, passes in self._passes.items():
            passes[self._sum].run(self._uniforms | eye | {"quanta": self._sums[name].quanta})
        self._sum = 1 - self._sum
        self._path_sets += 1

    def take(self) -> dict[str, NDArray[np.float64]]:
        """(h, w, 3) sums by name over the path sets since the last call, in multiples of one power of two."""
        taken = {name: sums.take(self._sum) for name, sums in self._sums.items()}
        found = {name: sums.radiance for name, sums in taken.items()}
        if "normal" in found:
            # What was not finite is not in the sum, so the 1 isn't either.
            found["normal"] -= (self._path_sets - (taken["normal"].high >> DROPPED_SHIFT).astype(float))[..., None]
        self._path_sets = 0
        return found
