"""Coarse view of a baked scene from its camera, by look-ups of texels. It determines the exposure.

Cost:     nine rays through a BVH for each of some ten thousand pixels, without paths. Streamed triangles are read
          once.
Poor at:  mirrors and highlights, which get the brightness of a diffuse surface of the same reflectance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.radiosity.shafts.rays import rays_of
from glpath.rendering.sides import cast
from glpath.scene.appearance import Appearance
from glpath.scene.model import Float64

if TYPE_CHECKING:
    pass

Int64 = NDArray[np.int64]

#: Number of pixels along the longer side of the view.
_LONGEST = 128
#: Maximum number of clear surfaces that a ray passes.
_PANES = 4
#: Number of rays along each side of a pixel, whose value is the mean of all its rays. At the edge of an unlit
#: surface, that surface contributes zeros to the mean, as in a picture.
_RAYS_PER_SIDE = 3


def seen_by_camera(surfaces: AtlasSurfaces, irradiance: NDArray[np.float32]) -> Float64:
    """Return (h, w, 3) radiance of the camera's view, W sr^-1 m^-2, linear Rec. 709.

    A pixel is the mean of several rays. It is NaN if one of them meets streamed triangles, which have no texels.

    irradiance : (P, h, w, 3) light of the pages, zero at texels whose rendered light is zero
    """
    scene = surfaces.scene
    camera = scene.camera.at()
    width, height = camera.resolution
    over = _LONGEST / max(width, height)
    width, height = (max(round(over * side), 1) for side in (width, height))
    camera = replace(camera, resolution=(_RAYS_PER_SIDE * width, _RAYS_PER_SIDE * height))
    directions = camera.rays().reshape(-1, 3)
    origins = camera.origins().reshape(-1, 3)
    found = np.zeros(directions.shape)
    rays, look = rays_of(scene), Appearance(scene)
    transmittance = look.side_transmittance()
    clear = np.array([scene.materials[shape.material].clear for shape in scene.shapes]) > 0.5
    left, own = np.arange(len(directions)), np.full(len(directions), -1)
    streamed = surfaces.streamed
    remaining = np.full(len(directions), np.inf)  # distance from the ray's origin to streamed triangles
    if streamed is not None:
        remaining = streamed.cast(origins, directions).distance
        streamed.forget()
    for _ in range(_PANES + 1):
        hit, back, distance = cast(scene, rays, origins[left], directions[left], own[left])
        behind = distance > remaining[left]
        found[left[behind]] = np.nan
        left, hit, back, distance = left[~behind], hit[~behind], back[~behind], distance[~behind]
        away = left[hit < 0]
        if scene.sky is not None:
            found[away] = scene.sky.radiance(directions[away])
        any_hit = hit >= 0
        left, hit, back, distance = left[any_hit], hit[any_hit], back[any_hit], distance[any_hit]
        origins[left] += distance[:, None] * directions[left]
        remaining[left] -= distance
        own[left] = hit
        through = clear[scene.triangle_shape[hit]]
        some = ~through
        b = _barycentric(scene.triangles[hit[some]], origins[left[some]])
        light = _looked_up(surfaces, irradiance, hit[some], back[some], b)
        shape = scene.triangle_shape[hit[some]]
        twice = np.array([s.emission_two_sided for s in scene.shapes])[shape]
        emission = look.emission(hit[some], b) * ((back[some] == 0) | twice)[:, None]
        sent = scene.side_reflectance[back[some], hit[some]] * light
        if transmittance.any():
            on_back = _looked_up(surfaces, irradiance, hit[some], 1 - back[some], b)
            sent += transmittance[1 - back[some], hit[some]] * on_back
        found[left[some]] = sent / np.pi + emission
        left = left[through]
        if not len(left):
            break
    pixels = found.reshape(height, _RAYS_PER_SIDE, width, _RAYS_PER_SIDE, 3)
    return np.asarray(pixels.mean(axis=(1, 3)))


def _looked_up(
    surfaces: AtlasSurfaces, irradiance: NDArray[np.float32], triangle: Int64, side: Int64, b: Float64
) -> Float64:
    """Return irradiance (N, 3) at barycentric coordinates (N, 2); zero on sides that have no texels."""
    atlas = surfaces.atlas
    face_of = np.full((len(surfaces.scene.triangles), 2), -1)
    face_of[atlas.triangle, atlas.side] = np.arange(len(atlas.triangle))
    face = face_of[triangle, side]
    uv = atlas.uv[face]
    at = uv[:, 0] + np.einsum("nc,ncx->nx", b, uv[:, 1:] - uv[:, :1])
    column, row = np.clip(np.floor(at).astype(np.int64), 0, np.array(atlas.size) - 1).T
    texel = atlas.page[face], row, column
    light = irradiance[texel].astype(np.float64)
    light[face < 0] = 0.0
    return np.asarray(light)


def _barycentric(triangles: Float64, points: Float64) -> Float64:
    """Return barycentric coordinates b1, b2 (N, 2) of points (N, 3) in the planes of triangles (N, 3, 3)."""
    e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = points - triangles[:, 0]
    d11, d12, d22 = (np.einsum("ij,ij->i", x, y) for x, y in ((e1, e1), (e1, e2), (e2, e2)))
    p1, p2 = np.einsum("ij,ij->i", p, e1), np.einsum("ij,ij->i", p, e2)
    over = 1.0 / np.maximum(d11 * d22 - d12 * d12, np.finfo(float).tiny)
    made = np.stack([(d22 * p1 - d12 * p2) * over, (d11 * p2 - d12 * p1) * over], axis=1)
    return np.asarray(np.clip(made, 0.0, 1.0))
