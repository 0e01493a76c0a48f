"""Emitter silhouette antialiasing: each path set samples the pixels at an emitter's edge at several points.

An emitter is a hundred times as bright as the surfaces that it lights. Without antialiasing, each path set samples
the edge at one position, the same in all pixels. In a denoised image, this causes most of the remaining error.
Eight more rays for these few pixels cost very little. Illumination by emitters is not affected.

Cost:     five views of the scene for each window, and a draw of the edge pixels for each set.
Poor at:  emitters narrower than a pixel; some pixels at their edges are not found and are sampled normally.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.device_scene import DeviceScene
from glpath.gl.lights import background_uniforms, sky_uniforms
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.ray_bvh import RayBvh
from glpath.gl.variants import defined
from glpath.sampling import Sampling
from glpath.sampling.points import pixel_samples

#: Number of samples of an edge pixel in each path set, a power of two.
SUBSAMPLES = 8
# Positions in a pixel at which edges are searched, x to the right and y down. An edge through a pixel has some of
# the pixel's corners on one side and some on the other. All path sets use the same positions, so that the samples
# of a set do not influence the search. The positions are in the pixel itself, so that an image in tiles is
# bit-identical to the whole image.
_SEARCH = ((0.5, 0.5), (-0.05, -0.05), (1.05, -0.05), (-0.05, 1.05), (1.05, 1.05))


class EmitterSilhouettes:
    """Light of emitters' silhouettes in one window of the image.

    size     : (width, height) of the window, pixels
    textures : textures for programs that include emitter_silhouettes.glsl
    eye_defines : see `gl.camera.camera_defines`
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        size: tuple[int, int],
        bvh: RayBvh,
        seed: int,
        sampling: Sampling,
        eye_defines: Mapping[str, object],
    ) -> None:
        self._seed, self._sampling = seed, sampling
        self._uniforms = {
            **scene.uniforms,
            **sky_uniforms(scene.scene.sky),
            **background_uniforms(scene.scene),
            **bvh.uniforms,
        }
        emits = np.array([shape.emits for shape in scene.scene.shapes], bool)
        self._shines = np.append(emits[scene.scene.triangle_shape], False)  # the last entry is for no hit
        # Edge pixels are packed side by side, in a square as small as possible, because a device shades pixels in
        # squares.
        self._max_across = -(-math.isqrt(size[0] * size[1]) // 8) * 8 + 8
        square = (self._max_across,) * 2
        self.textures = {
            "lamp_texel": gl.texture(size, 1, dtype="u4"),
            "lamp_light": gl.texture(square, 4, dtype="f4"),
        }
        self._pixels = gl.texture(square, 1, dtype="u4")
        for texture in (*self.textures.values(), self._pixels):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._pass = Pass(
            "emitter silhouettes",
            gl,
            load_program(
                gl,
                vertex="gl/fullscreen.vert",
                fragment="lights/emitter_silhouettes.frag",
                generated={**scene.generated, **bvh.generated},
                defines={
                    **scene.defines,
                    **bvh.defines,
                    **eye_defines,
                    **defined(HAS_SKY=scene.scene.sky is not None),
                    "SUBSAMPLES": SUBSAMPLES,
                },
            ),
            gl.framebuffer([self.textures["lamp_light"]]),
            textures={**scene.textures, **bvh.textures, "lamp_pixels": self._pixels} | self.textures,
        )

    @staticmethod
    def are_in(scene: DeviceScene) -> bool:
        """Return True if any triangle emits."""
        return any(shape.emits and shape.primitive == "triangle" for shape in scene.scene.shapes)

    def find(self, seen_from: Callable[[NDArray[np.float64]], NDArray[np.int64]]) -> None:
        """Find the edge pixels of another window or sensor.

        seen_from : function from a position in the pixels to the index of each pixel's visible triangle, (h, w), -1
                    for none
        """
        # Triangles of instances have numbers beyond the table. They do not emit, so they take its last entry.
        shines = [self._shines[np.minimum(seen_from(np.array(at)), len(self._shines) - 1)] for at in _SEARCH]
        edges = np.any(shines, axis=0) & ~np.all(shines, axis=0)
        y, x = np.nonzero(edges[::-1])
        across = min(-(-math.isqrt(len(x)) // 8) * 8 + 8, self._max_across)
        row, column = np.divmod(np.arange(len(x)), across)
        where = np.zeros(edges.shape, np.uint32)
        where[y, x] = _packed(column, row)
        self.textures["lamp_texel"].write(where.tobytes())
        pixels = np.zeros((self._max_across,) * 2, np.uint32)
        pixels[row, column] = _packed(x, y)
        self._pixels.write(pixels.tobytes())
        self._pass.area = (0, 0, across, int(row.max(initial=-1)) + 1)

    def see(self, index: int, sample: NDArray[np.float64], eye: Mapping[str, object]) -> None:
        """Sample the edge pixels for a path set. sample: position in the pixels for which `eye` was computed."""
        if self._pass.area is None or not self._pass.area[3]:
            return
        if self._sampling == "random":
            subsamples = np.random.default_rng((self._seed, index)).random((SUBSAMPLES, 2))
        else:
            subsamples = pixel_samples(self._seed, SUBSAMPLES * index, SUBSAMPLES)
        beside = (subsamples - sample) * (1.0, -1.0)
        self._pass.run({**self._uniforms, **eye, "subsamples": beside.astype("f4").tobytes()})


def _packed(x: NDArray[np.int64], y: NDArray[np.int64]) -> NDArray[np.uint32]:
    """Return texel positions in the format of emitter_silhouettes.glsl; 0 is none."""
    return (x | y << 16).astype(np.uint32) + np.uint32(1)
