"""A weathered helmet of 70,000 triangles with four 2048 x 2048 textures, similar to an artist's model.

It is one closed shell of metal and paint, with a visor that glows along its rim: base colour, metal and roughness,
normals and emission. There are no lights and no sky, because a viewer adds its own. Units are metres; y is up, and
the visor faces +z.

Source: proportions and maps follow DamagedHelmet, https://github.com/KhronosGroup/glTF-Sample-Assets, but all data
        is made here. There is no occlusion map, because path tracing computes occlusion.
"""

from __future__ import annotations

import numpy as np

from benchmarks.scenes.patterns import UInt8, noise, normals
from glpath.scene.model import Camera, Float64, Material, Mesh, Scene, Shape, Shapes, Texture, TextureSlot
from glpath.system.colour import encode_srgb

#: Side of the textures, in pixels.
SIDE = 2048
#: Number of quads around and from pole to pole: 70,000 triangles.
COLUMNS, ROWS = 250, 141
_RADIUS = 0.9


def helmet(side: int = SIDE, columns: int = COLUMNS, rows: int = ROWS) -> Scene:
    """Return the helmet with side x side textures and columns x rows quads: 2 columns (rows - 1) triangles."""
    shell = Shape("shell", _shell(columns, rows), 0, emission=np.ones(3))
    material = Material(
        "weathered",
        np.ones(3),
        two_sided=False,
        roughness=1.0,
        metallic=1.0,
        texture=TextureSlot(0),
        surface_texture=TextureSlot(1),
        normal_texture=TextureSlot(2),
        emission_texture=TextureSlot(3),
    )
    camera = Camera(np.array([1.6, 0.7, 2.6]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0, (512, 512))
    return Scene(
        name="helmet",
        camera=camera,
        shapes=Shapes([shell]),
        materials=(material,),
        textures=_textures(side),
        source="helmet",
        unit="photometric",
    )


def _shell(columns: int, rows: int) -> Mesh:
    """Return a sphere with crest, ears, dents and a recessed visor; vertices on the seam u = 0 = 1 occur twice."""
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows)
    radius = _RADIUS * (1 + 0.10 * _crest(u, v) - 0.07 * _visor(u, v) + 0.12 * _ears(u, v) - 0.03 * _dents(u, v))
    theta, phi = np.pi * (1 - v), 2 * np.pi * u
    at = np.stack([-np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1)
    vertices = (radius[..., None] * at * [1.0, 1.1, 1.05]).reshape(-1, 3)
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    # Omit the triangles without area at the poles, where a row's vertices coincide.
    below, above = np.stack([a, b, c], axis=-1)[1:], np.stack([a, c, d], axis=-1)[:-1]
    faces = np.concatenate([below.reshape(-1, 3), above.reshape(-1, 3)])
    return Mesh(
        vertices,
        faces.astype(np.int32),
        normals=_smooth(vertices, faces, columns + 1),
        uv=np.stack([u, v], axis=-1).reshape(-1, 2),
    )


def _smooth(vertices: Float64, faces: np.ndarray[tuple[int, int], np.dtype[np.int64]], row: int) -> Float64:
    """Return (V, 3) unit normals of vertices in rows; the vertices of the first and of the last row coincide."""
    corners = vertices[faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    found = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(found, faces[:, k], crossed)
    grid = found.reshape(-1, row, 3)
    grid[:, 0] = grid[:, -1] = grid[:, 0] + grid[:, -1]
    grid[0] = grid[0].sum(axis=0)
    grid[-1] = grid[-1].sum(axis=0)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


# Parts of the shell, 0 to 1, by texture coordinates: u goes around from the back, v from chin to crown.


def _step(x: Float64) -> Float64:
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -60, 60))))


def _visor(u: Float64, v: Float64) -> Float64:
    return np.asarray(_step(120 * (1 - np.hypot((u - 0.5) / 0.17, (v - 0.52) / 0.13)) * 0.15))


def _crest(u: Float64, v: Float64) -> Float64:
    across = np.sin(2 * np.pi * u) * np.sin(np.pi * v)
    return np.asarray(np.exp(-((across / 0.10) ** 2)) * _step(40 * (v - 0.66)))


def _ears(u: Float64, v: Float64) -> Float64:
    beside = np.minimum(
        np.hypot((u - 0.25) / 0.07, (v - 0.5) / 0.12), np.hypot((u - 0.75) / 0.07, (v - 0.5) / 0.12)
    )
    return np.asarray(_step(14 * (1 - beside)))


def _dents(u: Float64, v: Float64) -> Float64:
    return np.asarray(np.sin(np.pi * v) ** 2 * np.sin(18 * np.pi * u) * np.sin(13 * np.pi * v))


def _textures(side: int) -> tuple[Texture, ...]:
    rng = np.random.default_rng(7)
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, 1 - (np.arange(side) + 0.5) / side)
    coarse, fine, dust = noise(rng, side, 1.4), noise(rng, side, 0.7), noise(rng, side, 1.0)
    visor, ears = _visor(u, v), _ears(u, v)
    worn = _step(6 * (coarse - 0.9)) * (1 - visor)
    panel = np.minimum(np.abs((8 * u) % 1 - 0.5), np.abs((5 * v) % 1 - 0.5))
    seam = np.exp(-((panel / 0.008) ** 2)) * (1 - visor)
    bare = np.maximum(worn, ears)[..., None]
    colour = np.array([0.16, 0.20, 0.13]) * (1 - bare) + np.array([0.62, 0.58, 0.52]) * bare
    colour = colour * (1 - visor[..., None]) + np.array([0.02, 0.02, 0.03]) * visor[..., None]
    colour *= ((1 + 0.06 * fine + 0.10 * np.clip(dust, -1, 1)) * (1 - 0.7 * seam))[..., None]
    rough = np.clip(0.55 + 0.10 * fine - 0.25 * bare[..., 0] - 0.45 * visor, 0.05, 1)
    surface = np.stack([np.zeros_like(rough), rough, np.clip(bare[..., 0] * (1 - visor), 0, 1)], axis=-1)
    height = 0.5 * coarse + 0.12 * fine * (1 - visor) - 6 * seam - 2 * worn
    rim = np.exp(-(((visor - 0.5) / 0.12) ** 2)) * (0.75 + 0.25 * np.sign(np.sin(60 * np.pi * u)))
    glow = np.array([0.15, 0.65, 1.0]) * rim[..., None]
    return (
        Texture("colour", _bytes(encode_srgb(np.clip(colour, 0, 1))), srgb=True),
        Texture("metal-roughness", _bytes(surface)),
        Texture("normals", normals(height)),
        Texture("emission", _bytes(encode_srgb(np.clip(glow, 0, 1))), srgb=True),
    )


def _bytes(values: Float64) -> UInt8:
    return np.asarray(np.round(255 * values), np.uint8)
