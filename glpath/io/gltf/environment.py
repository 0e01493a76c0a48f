"""Environment map from the cube map of a file's scene.

Only the sharpest mipmap level is read. The other levels and the irradiance coefficients hold the same light,
prefiltered for rasterizers. Path tracing integrates the light itself.

Source: EXT_lights_image_based. The extension shows faces as seen from inside the cube, not mirrored. They are
OpenGL's faces, each flipped left to right.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.gltf.document import Document
from glpath.io.gltf.images import read_image
from glpath.io.gltf.table import Table
from glpath.scene.model import Float64
from glpath.sky.sky import Environment
from glpath.system.colour import decode_srgb

NAME = "EXT_lights_image_based"

# Bytes of memory for a pixel of a face while the faces are converted.
_FACE_PIXEL = 16
# Maximum number of rows of the environment map.
_MAX_HEIGHT = 1024
# Three axes of each face in the order +x -x +y -y +z -z: from the cube's centre through the face's centre, then to
# the right and down as seen from inside.
_FACES = np.array([
    [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    [[-1, 0, 0], [0, 0, -1], [0, -1, 0]],
    [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
    [[0, 0, 1], [-1, 0, 0], [0, -1, 0]],
    [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
], np.float64)  # fmt: skip


def environment_of(document: Document) -> Environment | None:
    """Return the environment of the file's scene, y up; None if it has no environment. Raises SceneError."""
    scenes, chosen = document.all("scenes"), document.root.integer("scene", 0)
    extension = scenes[chosen].extension(NAME) if chosen < len(scenes) else None
    if extension is None:
        return None
    every = (document.root.extension(NAME) or Table({}, document.location)).tables("lights")
    light = every[extension.required_index("light", every, "lights")]
    faces = _faces(document, light)
    height = min(2 * faces.shape[1], _MAX_HEIGHT)
    empty = Environment(np.zeros((height, 2 * height, 3), np.float32))
    turn = _rotation(light.numbers("rotation", (0.0, 0.0, 0.0, 1.0)), light)
    image = np.stack([_seen(faces, row @ turn) for row in _directions(empty)])
    return Environment(image.astype(np.float32), scale=light.number("intensity", 1.0, 0.0))


def _faces(document: Document, light: Table) -> NDArray[np.float32]:
    """Return the six faces (6, n, n, 3) of the sharpest level, linear, in the order of `_FACES`."""
    location, images = light.location.field("specularImages"), document.all("images")
    levels = light.values.get("specularImages")
    if not isinstance(levels, list) or not levels:
        raise location.wrong(levels, "a list of the levels of a cube map, six images each")
    numbers = Table({"faces": levels[0]}, location.item(0)).indices("faces", images, "images")
    if len(numbers) != 6:
        raise location.item(0).error(f"has {len(numbers)} images, but a cube has 6 faces.", "Export the file anew.")
    pictures = {number: read_image(document, number) for number in numbers}
    sizes = {picture.shape[:2] for picture in pictures.values()}
    height, width = next(iter(sizes))
    if len(sizes) > 1 or height != width:
        raise location.item(0).error(
            "has images of several sizes, or that are not square, but the faces of a cube are squares of one size.",
            "Export the file anew.",
        )
    document.take(_FACE_PIXEL * 6 * height * width, location.item(0))
    faces = np.empty((6, height, width, 3), np.float32)
    for face, number in zip(faces, numbers, strict=True):
        face[:] = _linear(pictures[number])
    return faces


def _linear(stored: NDArray[Any]) -> NDArray[np.float32]:
    """Return (n, n, 3) linear values.

    An image with four channels is RGBD: its colour is divided by the fourth channel, so values can exceed 1.
    """
    full = np.iinfo(stored.dtype).max
    light: NDArray[np.float32] = decode_srgb(np.arange(full + 1) / full).astype(np.float32)[stored[..., :3]]
    if stored.shape[2] == 4:
        light /= np.maximum(stored[..., 3:] / np.float32(full), np.float32(1 / 255))
    return light


def _rotation(quaternion: Float64, light: Table) -> Float64:
    """Return the (3, 3) rotation R from light to world; a vector v becomes R v."""
    length = np.linalg.norm(quaternion)
    if not length > 0:
        raise light.location.field("rotation").wrong(quaternion, "a quaternion of a length above 0")
    x, y, z, w = quaternion / length
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def _directions(environment: Environment) -> Float64:
    """Return the (h, w, 3) unit directions through the texel centres of an environment map."""
    height, width = environment.image.shape[:2]
    theta = (np.arange(height) + 0.5)[:, None] * (np.pi / height)
    phi = (0.5 - (np.arange(width) + 0.5) / width)[None, :] * (2 * np.pi)
    level = np.sin(theta)
    local = np.stack([level * np.cos(phi), level * np.sin(phi), np.cos(theta) + np.zeros_like(phi)], axis=2)
    return np.asarray(local @ environment.frame)


def _seen(faces: NDArray[np.float32], directions: Float64) -> Float64:
    """Return the (N, 3) values of cube faces (6, n, n, 3) in directions (N, 3), bilinear within each face."""
    size = faces.shape[1]
    along = directions @ _FACES[:, 0].T
    face = np.argmax(along, axis=1)
    ahead = np.take_along_axis(along, face[:, None], axis=1)
    at = np.einsum("nij,nj->ni", _FACES[face, 1:], directions) / ahead
    column, row = np.clip((0.5 * at + 0.5) * size - 0.5, 0.0, size - 1.0).T
    left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    right, bottom = np.minimum(left + 1, size - 1), np.minimum(top + 1, size - 1)
    across, down = (column - left)[:, None], (row - top)[:, None]
    upper = faces[face, top, left] * (1 - across) + faces[face, top, right] * across
    lower = faces[face, bottom, left] * (1 - across) + faces[face, bottom, right] * across
    return np.asarray(upper * (1 - down) + lower * down)
