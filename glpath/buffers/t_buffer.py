"""What the eye sees, as (object, t) for every pixel: by the classical algorithm, and by the T-buffer [TB II].

Both shoot the ray through every pixel with the same routines (`shaders/object_intersect.glsl`), so they hold the same
bits; they differ in which rays they shoot.
"""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.gpu_objects import GpuObjects
from glpath.gl.passes import Pass
from glpath.gl.program import load_program

Uniforms = Mapping[str, object]


class ClassicEye:
    """Primary rays of the classical algorithm: every ray against every primitive [TB I].

    Parameters
    ----------
    size        : (width, height) of the window, pixels
    count_tests : count intersection tests, exactly; slower

    Attributes
    ----------
    texture : RG32F, row 0 at the bottom: number of the nearest primitive + 1, 0 for none; its t, scene units

    Cost:     pixels x primitives.
    Poor at:  many primitives.
    """

    def __init__(
        self, gl: moderngl.Context, objects: GpuObjects, size: tuple[int, int], *, count_tests: bool = False
    ) -> None:
        self.gl = gl
        self.objects = objects
        self.size = size
        self.texture = gl.texture(size, 2, dtype="f4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._tests = gl.buffer(data=bytes(4 * size[0] * size[1])) if count_tests else None
        self._buffers = {0: self._tests} if self._tests else {}
        self._defines = objects.defines | ({"COUNT_TESTS": 1} if count_tests else {})
        program = load_program(
            gl,
            vertex="fullscreen.vert",
            fragment="classic_eye.frag",
            generated=objects.generated,
            defines=self._defines,
        )
        self._pass = Pass(
            "primary rays",
            gl,
            program,
            gl.framebuffer([self.texture]),
            textures=objects.textures,
            buffers=self._buffers,
        )

    def fill(self, eye: Uniforms) -> None:
        """Find what every ray meets first; `eye` comes from `gl.eye.eye_uniforms`."""
        self._pass.run(self.objects.uniforms | dict(eye))

    def read(self) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """(h, w) int32 primitive, -1 for none, and (h, w) float32 t, inf for none; row 0 at the top."""
        width, height = self.size
        found = np.frombuffer(self.texture.read(), np.float32).reshape(height, width, 2)[::-1]
        primitive = found[..., 0].astype(np.int32) - 1
        return primitive, np.where(primitive < 0, np.float32(np.inf), found[..., 1])

    def take_tests(self) -> int:
        """Intersection tests since the last call; a pair of ray and primitive is one."""
        if self._tests is None:
            return 0
        count = int(np.frombuffer(self._tests.read(), np.uint32).sum(dtype=np.uint64))
        self._tests.write(bytes(self._tests.size))
        return count
