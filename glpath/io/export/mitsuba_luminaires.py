"""Luminaires for Mitsuba 3: projectors whose images hold the intensities of a photometric profile.

The image of Mitsuba's projector is the irradiance of a plane one unit away, divided by pi. That irradiance is the
intensity times the cubed cosine of the angle to the axis. One projector suffices for a profile that ends within 75
degrees of its axis. Other profiles need a projector for each lit face of a surrounding cube, because a projector
cannot emit sideways.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from glpath.io.export.mitsuba_surfaces import Plugin
from glpath.scene.geometry import Float64
from glpath.scene.profile import LightProfile

#: Maximum angle from its axis that one projector covers, degrees.
WIDEST = 75.0
# Number of texels along a side of an image. On a cube face a texel is 0.7 degrees wide, finer than usual
# measurements.
_SIDE = 128


def projectors(
    name: str, profile: LightProfile, axis: Float64, c0: Float64, intensity: Float64
) -> Iterator[Plugin]:
    """Yield the projectors that emit the light of a profile, each with its axes x, y and direction as "axes".

    axis, c0  : (3,) unit, as in `LightProfile.intensity`
    intensity : (3,) factor by which the profile's candela values are multiplied, as `Light.intensity`
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
        # Mitsuba's first column is towards +x and its first row towards +y.
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
    """Return the angle from the axis, in degrees, that contains all light of a profile; 0 for a dark profile."""
    sent = np.flatnonzero(profile.candela.any(axis=0))
    if not len(sent):
        return 0.0
    # There is also light between a lit column and the dark one after it.
    return float(profile.gamma[0] + profile.step * min(int(sent[-1]) + 1, profile.candela.shape[1] - 1))
