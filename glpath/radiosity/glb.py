"""Write a radiosity solution as glTF 2.0: the scene's triangles with their radiance as vertex colours, unlit.

Any glTF viewer shows the baked light. COLOR_0 is linear Rec. 709 [glTF 2.0, 3.9.2]: radiance times 2^exposure,
clipped to 0 to 1, so that lamps are white. Fronts and backs are separate triangles, each visible from its own side
only. A black side, such as the back of a one-sided material, is left out, so that a room can be viewed from
outside.

Cost:     24 to 36 bytes per vertex, and 12 bytes per side of an element.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.io.export import gltf_json
from glpath.io.export.geometry import behind
from glpath.io.export.glb import Glb
from glpath.radiosity.mesh import lattice
from glpath.scene import Scene
from glpath.scene.appearance import Appearance
from glpath.scene.model import Float64


@dataclass(frozen=True)
class VertexLight:
    """Light at the vertices of the lattices that divide triangles into elements.

    divisions    : (T,) parts along each edge of each triangle
    vertices     : (L, 2, V, 3) irradiance of L kinds of light on fronts and backs of the vertices, W m^-2
    first_vertex : (T,) index of the first vertex of each triangle
    """

    divisions: NDArray[np.integer]
    vertices: NDArray[np.floating]
    first_vertex: NDArray[np.integer]


def write_glb(light: VertexLight, scene: Scene, path: str | Path, exposure: float = 0.0, **extras: str) -> None:
    """Write the triangulated `scene` with its light as .glb. See `RadiositySolution.to_glb`.

    extras : texts to store with the exposure
    """
    path = check_suffix(path)
    if not abs(exposure) <= 100:
        raise UsageError(f"exposure is {exposure}; must be a number of stops from -100 to 100.")
    file = Glb(scene)
    file.materials.append(
        gltf_json.Material(
            name="baked light",
            pbr_metallic_roughness=gltf_json.PbrMetallicRoughness(metallic_factor=0.0),
            extensions={file.use("KHR_materials_unlit"): {}},
        )
    )
    for number, shape in enumerate(scene.shapes):
        primitives = _primitives(file, light, scene, number, exposure)
        if primitives:
            file.add_node(shape.name, mesh=file.add_mesh(shape.name, primitives))
    file.save(path, exposure_stops=exposure, **extras)


def check_suffix(path: str | Path) -> Path:
    """Return `path` as a Path. Raises UsageError unless its suffix is .glb."""
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise UsageError(f"{path}: a baked scene is written as .glb.", "For example -o baked.glb.")
    return path


def _primitives(
    file: Glb, light: VertexLight, scene: Scene, number: int, exposure: float
) -> list[gltf_json.Primitive]:
    """Return the primitives of one shape: fronts and backs, without sides whose material is black."""
    shape = scene.shapes[number]
    material = scene.materials[shape.material]
    part = scene.shapes.ranges[number]
    points, faces, triangle, b = _lattices(light, scene, range(part.start, part.stop))
    appearance = Appearance(scene)
    reflectance, emission = appearance.reflectance(triangle, b), appearance.emission(triangle, b)
    first = int(light.first_vertex[part.start])
    position = file.add_array(points.astype(np.float32), bounds=True)
    found: list[gltf_json.Primitive] = []
    for back in range(2):
        emits = shape.emits and (not back or shape.emission_two_sided)
        reflects = np.any(material.reflectance > 0) and (not back or material.two_sided)
        if not (emits or reflects):
            continue
        irradiance = light.vertices[:, back, first : first + len(points)].sum(axis=0)
        radiance = reflectance * irradiance / np.pi if reflects else np.zeros((len(points), 3))
        if emits:
            radiance = radiance + emission
        colour = np.clip(radiance * 2.0**exposure, 0.0, 1.0).astype(np.float32)
        if found:  # if the front has triangles too, those of the back lie slightly behind them
            behind_it = points - behind(scene) * scene.normals[triangle]
            position = file.add_array(behind_it.astype(np.float32), bounds=True)
        corners = faces[:, ::-1] if back else faces
        found.append(
            gltf_json.Primitive(
                attributes={"POSITION": position, "COLOR_0": file.add_array(colour)},
                indices=file.add_array(corners.astype(np.uint32).ravel(), indices=True),
                material=0,
            )
        )
    return found


def _lattices(
    light: VertexLight, scene: Scene, triangles: range
) -> tuple[Float64, NDArray[np.int64], NDArray[np.int64], Float64]:
    """Return vertices (V, 3) and elements (E, 3), as vertex indices, of some triangles' lattices.

    Return also the triangle (V,) of each vertex, and the vertex's barycentric coordinates in it (V, 2).
    """
    points, faces, barycentric, first = [], [], [], 0
    for t in triangles:
        n = int(light.divisions[t])
        corners = scene.triangles[t]
        b = lattice.vertex_barycentrics(n)
        barycentric.append(b)
        points.append(corners[0] + b @ (corners[1:] - corners[0]))
        faces.append(first + lattice.element_vertices(n))
        first += len(b)
    triangle = np.repeat(np.array(triangles, np.int64), [len(b) for b in barycentric])
    return np.concatenate(points), np.concatenate(faces), triangle, np.concatenate(barycentric)
