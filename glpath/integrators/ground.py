"""Ground that catches a model's shadow: see `glpath.scene.background`.

Where the ground is visible, a ray is cast with a density proportional to the light from its direction. The fraction
of unoccluded rays is then the fraction of the light that remains, without noise if nothing occludes it.

Cost:     a ray for each path that hits the ground and no shape.
Poor at:  light from emitters of the model itself, which the ground does not show.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from glpath.gl.variants import defined
from glpath.sampling.points import counter_hash
from glpath.scene import Background, Environment, Scene, Sky

Float64 = NDArray[np.float64]

# Number of ray directions in a path set; each pixel takes a random one.
_DIRECTIONS = 16
# Steps of the three-dimensional sequence over path sets: inverse powers of the root of x^4 = x + 1 [Roberts 2018].
_SET_STEP = np.array([0.8191725134, 0.6710436067, 0.5497004779])
# Steps of the three-dimensional sequence over the directions of a set: fractional parts of square roots.
_DIRECTION_STEP = np.sqrt([2.0, 3.0, 5.0]) % 1.0
# Height, in texels, of the environment map that stands for a sky without an image.
_HEIGHT = 32
# Width, in texels, of the environment map that stands for a sky without an image.
_WIDTH = 64


class Ground:
    """Ground of a scene, in engines that cast rays.

    uniforms, defines : constant inputs of path_rays.glsl
    """

    def __init__(self, background: Background, sky: Sky | Environment, seed: int) -> None:
        assert background.ground is not None, "made for a ground"
        up = background.up
        self._light = _light_from_above(sky, up)
        self._first = np.array([counter_hash(seed, axis, 0, 12) for axis in range(3)]) / 2.0**32
        self.uniforms = {"ground": (*up.tolist(), float(up @ background.ground))}
        self.defines = {**defined(HAS_GROUND=True), "GROUND_LIGHTS": _DIRECTIONS}

    @classmethod
    def of(cls, scene: Scene, seed: int) -> Ground | None:
        """Create the ground, or return None if the scene has no ground or no light on it."""
        background, sky = scene.background, scene.sky
        if background is None or background.ground is None or sky is None or not sky.mean_integral > 0:
            return None
        return cls(background, sky, seed)

    def of_set(self, index: int) -> dict[str, object]:
        """Return the uniforms of a path set: its ray directions towards the light."""
        numbers = np.arange(_DIRECTIONS)[:, None] * _DIRECTION_STEP
        u = (self._first + index * _SET_STEP + numbers) % 1.0
        return {"ground_lights": self._light.directions(u).astype(np.float32).tobytes()}


def _light_from_above(sky: Sky | Environment, up: Float64) -> Environment:
    """Return the sky with radiance times the cosine at the ground, proportional to its irradiance there."""
    height, width = (_HEIGHT, _WIDTH) if isinstance(sky, Sky) else sky.image.shape[:2]
    empty = Environment(np.zeros((height, width, 3), np.float32), up)
    theta = (np.arange(height) + 0.5)[:, None] * (np.pi / height)
    phi = (0.5 - (np.arange(width) + 0.5) / width)[None, :] * (2 * np.pi)
    local = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + np.zeros_like(phi)], axis=2
    )
    sun = None if isinstance(sky, Sky) else sky.sun
    of_map = sky if isinstance(sky, Sky) else replace(sky, sun=None)
    light = of_map.radiance(local @ empty.frame) * np.maximum(np.cos(theta), 0.0)[..., None]
    if sun is not None:
        sun = replace(sun, irradiance=sun.irradiance * max(float(sun.direction @ up), 0.0))
    # Rows below the horizon are 0, because the filter tent of a nonzero row would extend above it.
    return Environment(light.astype(np.float32), up, sun=sun)
