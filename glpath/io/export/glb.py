"""Builder of a binary glTF 2.0 file: arrays and images in one buffer, a root node with y up, a camera.

Exported scenes and baked scenes are written with this builder.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.film.image import encode_png
from glpath.io.export import gltf_json
from glpath.io.export.geometry import near_plane, scene_size
from glpath.scene.camera import Camera
from glpath.scene.geometry import Float64
from glpath.scene.model import Scene
from glpath.system.files import whole_file

#: Distance of the near plane, which glTF requires, as a fraction of the scene's size; less if it hid a shape.
_NEAR = 1e-3
#: Distance of the far plane of an orthographic camera, as a multiple of the scene's size.
_FAR = 1e3
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Glb:
    """glTF file of a scene and its camera.

    Coordinates are relative to the scene's origin (`Scene.centred`), because vertices are 32-bit floats. The origin
    becomes the translation of the root node.

    bounds : bounding box of the scene
    textures, samplers, images, materials : lists that callers append to
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
        self._camera = _camera(scene)
        self.add_node("camera", _camera_matrix(scene.camera), camera=0)

    def use(self, extension: str) -> str:
        """Return the name of an extension and list it as used."""
        self._used.add(extension)
        return extension

    def add_array(self, array: NDArray[np.generic], *, indices: bool = False, bounds: bool = False) -> int:
        """Add an array: vertex indices (N,) uint32, or vertex values (N, 2 to 4) float32.

        Returns the index of the accessor.
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
        """Add an image (h, w, 3) or (h, w, 4), row 0 at the top; return its index."""
        self.images.append(
            gltf_json.Image(name=name, mime_type="image/png", buffer_view=self._add(encode_png(image), None))
        )
        return len(self.images) - 1

    def add_mesh(self, name: str, primitives: list[gltf_json.Primitive]) -> int:
        """Add a mesh; return its index."""
        self._meshes.append(gltf_json.Mesh(name=name, primitives=primitives))
        return len(self._meshes) - 1

    def add_node(self, name: str, world_from_node: Float64 | None = None, **fields: Any) -> None:
        """Add a child of the root; the transform is (3, 4), by default the identity."""
        if world_from_node is not None:
            matrix = np.eye(4)
            matrix[:3] = world_from_node
            fields["matrix"] = [float(x) for x in matrix.T.ravel()]
        self._nodes[0].children.append(len(self._nodes))
        self._nodes.append(gltf_json.Node(name=name, **fields))

    def save(self, path: Path, **extras: Any) -> None:
        """Write the file, whole or not at all. extras: description stored in the file. Raises ImageError."""
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
        # Padded, because the next array must begin at a multiple of the size of its numbers.
        self._bytes += content + bytes(-len(content) % 4)
        return len(self._views) - 1


def _to_y_up(up: Float64) -> list[float]:
    """Return the rotation x y z w that takes the axis nearest to `up` to +y, as glTF demands."""
    axis = int(np.argmax(np.abs(up)))
    half = math.sqrt(0.5)
    if axis == 1:
        return [0.0, 0.0, 0.0, 1.0] if up[1] > 0 else [1.0, 0.0, 0.0, 0.0]
    sign = 1.0 if up[axis] > 0 else -1.0
    return [0.0, 0.0, sign * half, half] if axis == 0 else [-sign * half, 0.0, 0.0, half]


def y_up_from(up: Float64) -> Float64:
    """Return the (3, 3) rotation by quarter turns that takes the axis nearest to `up` to +y."""
    return _matrix(_to_y_up(up))


def _matrix(rotation: list[float]) -> Float64:
    """Return the exact (3, 3) matrix of a rotation x y z w by quarter turns."""
    axis, w = np.array(rotation[:3]), rotation[3]
    across = 2.0 * np.cross(axis, np.eye(3))
    return np.asarray(np.rint(np.eye(3) + w * across + np.cross(axis, across)).T)


def _camera(scene: Scene) -> gltf_json.Camera:
    camera, size = scene.camera, scene_size(scene)
    width, height = camera.resolution
    if camera.projection == "orthographic":
        wide, high = camera.extent
        parallel = gltf_json.Orthographic(xmag=wide, ymag=high, znear=0.0, zfar=_FAR * size)
        return gltf_json.Camera(name="camera", type="orthographic", orthographic=parallel)
    fov = 90.0 if camera.projection == "panorama" else camera.fov
    near = near_plane(scene, _NEAR * size)
    view = gltf_json.Perspective(
        yfov=math.radians(fov), aspect_ratio=width * camera.pixel_aspect / height, znear=near
    )
    return gltf_json.Camera(name="camera", type="perspective", perspective=view)


def _camera_matrix(camera: Camera) -> Float64:
    """Return the (3, 4) transform from camera to world space; the camera looks along -z."""
    right, up, forward = camera.frame()
    return np.stack([right, up, -forward, camera.position], axis=1)
