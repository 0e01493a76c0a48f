"""Luminaires for Mitsuba 3: projectors whose images have what a profile sends.

Mitsuba's projector has the irradiance of a plane one unit away, over pi: the intensity times the cosine's cube. One
projector holds a profile that ends at 75 degrees from its axis or before. Others have one for each face of a cube
about them that gets light, as a projector cannot see to the side.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from glpath.io.export.mitsuba_surfaces import Plugin
from glpath.scene.geometry import Float64
from glpath.scene.profile import LightProfile

#: Degrees from its axis that one projector holds.
WIDEST = 75.0
# Texels along a side of an image: 0.7 degrees each of a face of the cube, finer than luminaires are measured.
_SIDE = 128


def projectors(
    name: str, profile: LightProfile, axis: Float64, c0: Float64, intensity: Float64
) -> Iterator[Plugin]:
    """What sends the light of a profile, each with the axes of its own: x, y and its own direction, as "axes".

    axis, c0  : (3,) unit, as in `LightProfile.intensity`
    intensity : (3,) of one candela
    """
    across = np.cross(axis, c0)
    last = _last_angle(profile)
    if last <= WIDEST:
        faces, half = [(c0, across, axis)], max(last, 1.0)
    else:
        half = 45.0
        faces = [(c0, across, axis), (c0, -across, -axis)]
        faces += [(axis, np.cross(side, axis), side) for side in (c0, -c0, across, -across)]
    for x, y, z in faces:
        sideways = np.tan(np.radians(half)) * (1.0 - (np.arange(_SIDE) + 0.5) * (2.0 / _SIDE))
        # Mitsuba's first column is towards x and its first row towards y.
        towards = z + sideways[None, :, None] * x + sideways[:, None, None] * y
        cosine = 1.0 / np.linalg.norm(towards, axis=2)
        candela = profile.intensity((towards * cosine[..., None]).reshape(-1, 3), axis, c0).reshape(_SIDE, _SIDE)
        if not candela.any():
            continue
        image = (candela * cosine**3 / np.pi)[..., None] * intensity
        yield {
            "type": "projector",
            "fov": 2.0 * half,
            "irradiance": {"type": "bitmap", "image": image.astype(np.float32), "name": name, "wrap_mode": "clamp"},
            "axes": (x, y, z),
        }


def _last_angle(profile: LightProfile) -> float:
    """Degrees from the axis within which all of its light is; 0 where there is none."""
    sent = np.flatnonzero(profile.candela.any(axis=0))
    if not len(sent):
        return 0.0
    # Between a column with light and a dark one there is some, too.
    return float(profile.gamma[0] + profile.step * min(int(sent[-1]) + 1, profile.candela.shape[1] - 1))
