"""Contribution of horizons in one azimuth to sky view factors."""

from __future__ import annotations

import math

from glpath.system.kernels import kernel


@kernel
def add_sky(tangents, normals, direction, weight, sums):  # type: ignore[no-untyped-def]
    """Add the light of a white sky of radiance 1 / pi from a sector of azimuths.

    tangents  : (N,) tangents of the horizon angles
    normals   : (N, 3) unit normals, x east, y north, z up; or (1, 3) for all
    direction : x and y of a unit vector to the middle of the sector
    weight    : width of the sector, radians
    sums      : (N,) sums; the whole sky gives 1 on a horizontal surface

    The integral of max(0, n . w) sin t over the zenith angle t, from 0 to the horizon's, is exact. If a is the
    component of the normal n along the azimuth, it is nz sin^2 t / 2 + a (t - sin t cos t) / 2 [Dozier & Frew 1990,
    eq. 7].
    """
    scale = weight / math.pi
    for i in range(len(tangents)):
        tangent = float(tangents[i])
        k = i if len(normals) > 1 else 0
        nx, ny, nz = float(normals[k, 0]), float(normals[k, 1]), float(normals[k, 2])
        along = nx * direction[0] + ny * direction[1]
        if along == 0.0 and nz > 0.0:
            sums[i] += scale * 0.5 * nz / (1.0 + tangent * tangent)
            continue
        # In the vertical plane of this azimuth, the surface faces zenith angles within 90 degrees of `facing`, the
        # zenith angle of the normal's projection.
        facing = math.atan2(along, nz)
        last = min(math.atan2(1.0, tangent), facing + 0.5 * math.pi)
        first = max(0.0, facing - 0.5 * math.pi)
        if last > first:
            s, c = math.sin(last), math.cos(last)
            s0, c0 = math.sin(first), math.cos(first)
            sums[i] += scale * 0.5 * (nz * (s * s - s0 * s0) + along * (last - first - s * c + s0 * c0))
