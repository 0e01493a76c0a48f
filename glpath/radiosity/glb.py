"""A radiosity solution as glTF 2.0: the scene's triangles with their radiance as vertex colours, unlit.

Any glTF viewer shows the baked light. COLOR_0 is linear Rec. 709 [glTF 2.0, 3.9.2]: radiance times 2^exposure, from
0 to 1, so that lamps are white. Fronts and backs are triangles of their own, each shown from its side alone; a side
that is black, such as the back of a one-sided material, is left out, so that one looks into a room from outside.

Cost:     24 bytes a vertex and 12 an element and side.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.files import whole_file
from glpath.radiosity.mesh import lattice
from glpath.scene import Scene
from glpath.scene.model import Camera, Float64

if TYPE_CHECKING:
    from glpath.radiosity.solution import RadiositySolution

#: glTF knows no view of 180 degrees, and needs a near plane.
_NEAR = 1e-3


def write_glb(solution: RadiositySolution, scene: Scene, path: str | Path, exposure: float = 0.0) -> None:
    """Write `scene`, in triangles, as .glb. See `RadiositySolution.to_glb`."""
    import pygltflib as gltf

    path = check_suffix(path)
    if not abs(exposure) <= 100:
        raise UsageError(f"exposure is {exposure}; must be a number of stops from -100 to 100.")
    file = _File()
    primitives_of = [_primitives(file, solution, scene, i, exposure) for i in range(len(scene.shapes))]
    root = gltf.Node(name=scene.name, rotation=_to_y_up(scene.camera.up), children=[])
    nodes: list[object] = [root]
    meshes: list[object] = []
    for shape, primitives in zip(scene.shapes, primitives_of, strict=True):
        if primitives:
            root.children.append(len(nodes))
            nodes.append(gltf.Node(name=shape.name, mesh=len(meshes)))
            meshes.append(gltf.Mesh(name=shape.name, primitives=primitives))
    root.children.append(len(nodes))
    nodes.append(gltf.Node(name="camera", camera=0, matrix=_camera_matrix(scene.camera)))
    low, high = scene.bounds
    document = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator="glpath"),
        scene=0,
        scenes=[gltf.Scene(name=scene.name, nodes=[0])],
        nodes=nodes,
        meshes=meshes,
        cameras=[_camera(scene.camera, float(np.linalg.norm(high - low)))],
        materials=[
            gltf.Material(
                name="baked light",
                pbrMetallicRoughness=gltf.PbrMetallicRoughness(
                    baseColorFactor=[1, 1, 1, 1], metallicFactor=0, roughnessFactor=1
                ),
                extensions={"KHR_materials_unlit": {}},
                alphaMode="OPAQUE",
                alphaCutoff=None,
            )
        ],
        extensionsUsed=["KHR_materials_unlit"],
        accessors=file.accessors,
        bufferViews=file.views,
        buffers=[gltf.Buffer(byteLength=len(file.bytes))],
        extras={"exposure_stops": exposure, "scene_hash": solution.scene_hash, "method": solution.method},
    )
    document.set_binary_blob(bytes(file.bytes))
    with whole_file(path) as temporary:
        temporary.write_bytes(b"".join(document.save_to_bytes()))


def check_suffix(path: str | Path) -> Path:
    """`path`, if a baked scene can be written to a file of that name; else UsageError."""
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise UsageError(f"{path}: a baked scene is written as .glb.", "For example -o baked.glb.")
    return path


class _File:
    """The binary part, as it grows."""

    def __init__(self) -> None:
        self.bytes = bytearray()
        self.accessors: list[object] = []
        self.views: list[object] = []

    def add(self, array: NDArray[np.generic], target: int, bounds: bool = False) -> int:
        """Put an array (N,) uint32 or (N, 3) float32 in; returns the number of its accessor."""
        import pygltflib as gltf

        data = np.ascontiguousarray(array)
        self.views.append(
            gltf.BufferView(buffer=0, byteOffset=len(self.bytes), byteLength=data.nbytes, target=target)
        )
        self.bytes += data.tobytes()
        numbers = data.dtype == np.uint32
        accessor = gltf.Accessor(
            bufferView=len(self.views) - 1,
            componentType=gltf.UNSIGNED_INT if numbers else gltf.FLOAT,
            count=len(data),
            type="SCALAR" if numbers else "VEC3",
        )
        if bounds:
            accessor.min, accessor.max = data.min(axis=0).tolist(), data.max(axis=0).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _primitives(
    file: _File, solution: RadiositySolution, scene: Scene, number: int, exposure: float
) -> list[object]:
    """Of one shape: its fronts and its backs, as far as they aren't black by their nature."""
    import pygltflib as gltf

    shape = scene.shapes[number]
    material = scene.materials[shape.material]
    part = scene.shapes.ranges[number]
    points, faces = _lattices(solution, scene, range(part.start, part.stop))
    first = int(solution.first_vertex[part.start])
    position = file.add(points.astype(np.float32), gltf.ARRAY_BUFFER, bounds=True)
    found = []
    for back in range(2):
        emits = shape.emits and (not back or shape.emission_two_sided)
        reflects = np.any(material.reflectance > 0) and (not back or material.two_sided)
        if not (emits or reflects):
            continue
        irradiance = solution.vertices[:, back, first : first + len(points)].sum(axis=0)
        radiance = material.reflectance * irradiance / np.pi if reflects else np.zeros((len(points), 3))
        if emits:
            radiance = radiance + shape.emission
        colour = np.clip(radiance * 2.0**exposure, 0.0, 1.0).astype(np.float32)
        corners = faces[:, ::-1] if back else faces
        found.append(
            gltf.Primitive(
                attributes=gltf.Attributes(POSITION=position, COLOR_0=file.add(colour, gltf.ARRAY_BUFFER)),
                indices=file.add(corners.astype(np.uint32).ravel(), gltf.ELEMENT_ARRAY_BUFFER),
                material=0,
            )
        )
    return found


def _lattices(solution: RadiositySolution, scene: Scene, triangles: range) -> tuple[Float64, NDArray[np.int64]]:
    """Vertices (V, 3) of some triangles' lattices and their elements (E, 3)."""
    points, faces, first = [], [], 0
    for t in triangles:
        n = int(solution.divisions[t])
        corners = scene.triangles[t]
        b = lattice.vertex_barycentrics(n)
        points.append(corners[0] + b @ (corners[1:] - corners[0]))
        faces.append(first + lattice.element_vertices(n))
        first += len(b)
    return np.concatenate(points), np.concatenate(faces)


def _to_y_up(up: Float64) -> list[float]:
    """The rotation, x y z w, that takes the axis nearest to `up` to +y, as glTF has it."""
    axis = int(np.argmax(np.abs(up)))
    half = math.sqrt(0.5)
    if axis == 1:
        return [0.0, 0.0, 0.0, 1.0] if up[1] > 0 else [1.0, 0.0, 0.0, 0.0]
    sign = 1.0 if up[axis] > 0 else -1.0
    return [0.0, 0.0, sign * half, half] if axis == 0 else [-sign * half, 0.0, 0.0, half]


def _camera(camera: Camera, size: float) -> object:
    import pygltflib as gltf

    width, height = camera.resolution
    view = gltf.Perspective(yfov=math.radians(camera.fov), aspectRatio=width / height, znear=_NEAR * size)
    return gltf.Camera(name="camera", type="perspective", perspective=view)


def _camera_matrix(camera: Camera) -> list[float]:
    """World from camera, column after column; glTF's camera looks along -z."""
    right, up, forward = camera.frame()
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, up, -forward, camera.position], axis=1)
    return [float(x) for x in matrix.T.ravel()]
