"""A binary glTF 2.0 file as it grows: arrays and images in one buffer, a root that turns up to y, a camera.

What scenes and baked scenes have in common.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.film.image import encode_png
from glpath.io.export import gltf_json
from glpath.scene.camera import Camera
from glpath.scene.geometry import Float64
from glpath.scene.model import Scene
from glpath.system.files import whole_file

#: glTF needs a near plane: so far before the camera, as a share of the scene's diagonal.
_NEAR = 1e-3
#: And of parallel rays a far one.
_FAR = 1e3
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Glb:
    """The file of a scene, with its camera: `Scene.centred`, its origin being the translation of the root node, as
    vertices have 32 bits.

    bounds : the scene's
    textures, samplers, images, materials : to be added to
    """

    def __init__(self, scene: Scene) -> None:
        self.name = scene.name
        self.textures: list[gltf_json.Texture] = []
        self.samplers: list[gltf_json.Sampler] = []
        self.images: list[gltf_json.Image] = []
        self.materials: list[gltf_json.Material] = []
        self.extensions: dict[str, Any] = {}
        self._meshes: list[gltf_json.Mesh] = []
        self._bytes = bytearray()
        self._accessors: list[gltf_json.Accessor] = []
        self._views: list[gltf_json.BufferView] = []
        self._used: set[str] = set()
        rotation = _to_y_up(scene.camera.up)
        root = gltf_json.Node(name=scene.name, rotation=rotation)
        if scene.origin.any():
            root.translation = [float(x) for x in _matrix(rotation) @ scene.origin]
        self._nodes: list[gltf_json.Node] = [root]
        self.bounds = scene.bounds
        self._camera = _camera(scene.camera, float(np.linalg.norm(self.bounds[1] - self.bounds[0])))
        self.add_node("camera", _camera_matrix(scene.camera), camera=0)

    def use(self, extension: str) -> str:
        """The name of an extension, which the file then says that it uses."""
        self._used.add(extension)
        return extension

    def add_array(self, array: NDArray[np.generic], *, indices: bool = False, bounds: bool = False) -> int:
        """Put numbers of vertices (N,) uint32, or values of vertices (N, 2 to 4) float32, in.

        Returns the number of the accessor.
        """
        data = np.ascontiguousarray(array)
        target = gltf_json.ELEMENT_ARRAY_BUFFER if indices else gltf_json.ARRAY_BUFFER
        accessor = gltf_json.Accessor(
            buffer_view=self._add(data.tobytes(), target),
            component_type=gltf_json.UNSIGNED_INT if indices else gltf_json.FLOAT,
            count=len(data),
            type=_TYPES[1 if data.ndim == 1 else data.shape[1]],
        )
        if bounds:
            accessor.min, accessor.max = data.min(axis=0).tolist(), data.max(axis=0).tolist()
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def add_image(self, name: str, image: NDArray[np.uint8]) -> int:
        """Put (h, w, 3) or (h, w, 4) in, row 0 at the top; returns its number."""
        self.images.append(
            gltf_json.Image(name=name, mime_type="image/png", buffer_view=self._add(encode_png(image), None))
        )
        return len(self.images) - 1

    def add_mesh(self, name: str, primitives: list[gltf_json.Primitive]) -> int:
        """Returns its number."""
        self._meshes.append(gltf_json.Mesh(name=name, primitives=primitives))
        return len(self._meshes) - 1

    def add_node(self, name: str, world_from_node: Float64 | None = None, **fields: Any) -> None:
        """A child of the root; the map is (3, 4), the identity without it."""
        if world_from_node is not None:
            matrix = np.eye(4)
            matrix[:3] = world_from_node
            fields["matrix"] = [float(x) for x in matrix.T.ravel()]
        self._nodes[0].children.append(len(self._nodes))
        self._nodes.append(gltf_json.Node(name=name, **fields))

    def save(self, path: Path, **extras: Any) -> None:
        """Write the file, whole or not at all. extras: what it says of itself. Raises ImageError."""
        document = gltf_json.Document(
            asset=gltf_json.Asset(version="2.0", generator="glpath"),
            scene=0,
            scenes=[gltf_json.Scene(name=self.name, nodes=[0])],
            nodes=self._nodes,
            meshes=self._meshes,
            cameras=[self._camera],
            materials=self.materials,
            textures=self.textures,
            samplers=self.samplers,
            images=self.images,
            accessors=self._accessors,
            buffer_views=self._views,
            buffers=[gltf_json.Buffer(byte_length=len(self._bytes))] if self._bytes else [],
            extensions=self.extensions,
            extensions_used=sorted(self._used),
            extras=extras,
        )
        with whole_file(path) as temporary:
            gltf_json.write_glb(document, self._bytes, temporary)

    def _add(self, content: bytes, target: int | None) -> int:
        self._views.append(
            gltf_json.BufferView(buffer=0, byte_offset=len(self._bytes), byte_length=len(content), target=target)
        )
        self._bytes += content + bytes(-len(content) % 4)  # arrays begin at multiples of their numbers' size
        return len(self._views) - 1


def _to_y_up(up: Float64) -> list[float]:
    """The rotation, x y z w, that takes the axis nearest to `up` to +y, as glTF has it."""
    axis = int(np.argmax(np.abs(up)))
    half = math.sqrt(0.5)
    if axis == 1:
        return [0.0, 0.0, 0.0, 1.0] if up[1] > 0 else [1.0, 0.0, 0.0, 0.0]
    sign = 1.0 if up[axis] > 0 else -1.0
    return [0.0, 0.0, sign * half, half] if axis == 0 else [-sign * half, 0.0, 0.0, half]


def y_up_from(up: Float64) -> Float64:
    """(3, 3): the rotation by quarter turns that takes the axis nearest to `up` to +y."""
    return _matrix(_to_y_up(up))


def _matrix(rotation: list[float]) -> Float64:
    """(3, 3) of a rotation x y z w by quarter turns, exact."""
    axis, w = np.array(rotation[:3]), rotation[3]
    across = 2.0 * np.cross(axis, np.eye(3))
    return np.asarray(np.rint(np.eye(3) + w * across + np.cross(axis, across)).T)


def _camera(camera: Camera, size: float) -> gltf_json.Camera:
    width, height = camera.resolution
    if camera.projection == "orthographic":
        wide, high = camera.extent
        parallel = gltf_json.Orthographic(xmag=wide, ymag=high, znear=0.0, zfar=_FAR * size)
        return gltf_json.Camera(name="camera", type="orthographic", orthographic=parallel)
    fov = 90.0 if camera.projection == "panorama" else camera.fov
    view = gltf_json.Perspective(
        yfov=math.radians(fov), aspect_ratio=width * camera.pixel_aspect / height, znear=_NEAR * size
    )
    return gltf_json.Camera(name="camera", type="perspective", perspective=view)


def _camera_matrix(camera: Camera) -> Float64:
    """(3, 4): world from camera, which looks along -z."""
    right, up, forward = camera.frame()
    return np.stack([right, up, -forward, camera.position], axis=1)
