"""The hierarchy of nodes, and where each of them stands in the world, at rest or at a time.

Source: glTF 2.0, 3.5 (nodes); EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from glpath.scene.formats.gltf.accessors import Accessors
from glpath.scene.formats.gltf.document import Document
from glpath.scene.formats.gltf.table import Table
from glpath.scene.formats.values import LARGEST
from glpath.scene.model import Float64
from glpath.scene.place import Place

#: What an animation says of a node: translation, rotation (x, y, z, w), scale and weights.
Pose = Mapping[str, Float64]


@dataclass(frozen=True)
class Nodes:
    """The nodes of a document.

    world : (4, 4) of each node, world from node
    drawn : numbers of the nodes of the scene that are to be seen, each once
    """

    tables: list[Table]
    world: list[Float64]
    drawn: list[int]

    @classmethod
    def of(cls, document: Document, poses: Mapping[int, Pose]) -> Nodes:
        """Raises SceneError for nodes that are their own ancestors, or have several parents.

        poses : what is animated, by the number of the node
        """
        tables = list(document.all("nodes"))
        children = [table.indices("children", tables, "nodes") for table in tables]
        parent: dict[int, int] = {}
        for index, below in enumerate(children):
            for i, child in enumerate(below):
                if child in parent:
                    raise (
                        tables[index]
                        .place.field("children")
                        .item(i)
                        .error(
                            f"is {child}, which is already a child of nodes[{parent[child]}].",
                            "A node has one parent: copy it, or give its mesh to several nodes.",
                        )
                    )
                parent[child] = index
        world: list[Float64] = [np.eye(4)] * len(tables)
        waiting = [index for index in reversed(range(len(tables))) if index not in parent]
        visited = 0
        while waiting:
            index = waiting.pop()
            visited += 1
            local = _local(tables[index], poses.get(index, {}))
            with np.errstate(over="ignore", invalid="ignore"):
                world[index] = local if index not in parent else world[parent[index]] @ local
            if not np.all(np.abs(world[index]) <= LARGEST):
                raise tables[index].place.error(
                    f"stands, with its parents, beyond {LARGEST:g} scene units, where 32 bit numbers end.",
                    "Check its matrix, translation and scale.",
                )
            waiting += reversed(children[index])
        if visited < len(tables):
            index = _on_a_circle(parent, len(tables))
            raise tables[index].place.error(
                "is its own ancestor.", "Remove it from the children of one of its children."
            )
        return cls(tables, world, _drawn(document, tables, children, parent))


def _on_a_circle(parent: Mapping[int, int], count: int) -> int:
    """The number of a node that is its own ancestor."""
    settled: set[int] = set()
    for start in range(count):
        index, on_the_way = start, set[int]()
        while index in parent and index not in settled:
            if index in on_the_way:
                return index
            on_the_way.add(index)
            index = parent[index]
        settled |= on_the_way
    raise AssertionError("a node was not reached, but none is on a circle")


def _drawn(
    document: Document, tables: list[Table], children: list[list[int]], parent: Mapping[int, int]
) -> list[int]:
    scenes = document.all("scenes")
    chosen = document.root.index("scene", scenes, "scenes")
    if len(scenes):
        scene = scenes[chosen or 0]
        roots = scene.indices("nodes", tables, "nodes")
        if any(root in parent for root in roots):
            # Not allowed, and yet much that UniGLTF wrote is so, with a parent that does nothing.
            document.notes.add(
                "Scenes' lists of nodes that have parents: such a node is drawn once, below its own."
            )
        if len(scenes) > 1:
            document.notes.add(
                f"{len(scenes) - 1} of its {len(scenes)} scenes: only scenes[{chosen or 0}] is shown."
            )
    else:
        roots = [index for index in range(len(tables)) if index not in parent]
    drawn: list[int] = []
    seen: set[int] = set()
    waiting = list(reversed(roots))
    while waiting:
        index = waiting.pop()
        if index in seen:
            continue
        seen.add(index)
        visibility = tables[index].extension("KHR_node_visibility")
        if visibility is not None and not visibility.flag("visible", True):
            continue
        drawn.append(index)
        waiting += reversed(children[index])
    return drawn


def _local(table: Table, pose: Pose) -> Float64:
    """(4, 4) parent from node."""
    if "matrix" in table and not (pose.keys() & {"translation", "rotation", "scale"}):
        matrix = table.numbers("matrix", np.eye(4).ravel().tolist()).reshape(4, 4).T
        if not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-5):
            raise table.place.field("matrix").error(
                f"has {table.place.written(matrix[3])} as its last row, but must have [0, 0, 0, 1].",
                "Matrices are listed column by column.",
            )
        return np.concatenate([matrix[:3], np.eye(4)[3:]])
    translation = pose.get("translation", table.numbers("translation", [0, 0, 0]))
    rotation = pose.get("rotation", table.numbers("rotation", [0, 0, 0, 1]))
    scale = pose.get("scale", table.numbers("scale", [1, 1, 1]))
    return np.asarray(trs(translation[None], rotation[None], scale[None], table.place)[0])


def trs(translation: Float64, rotation: Float64, scale: Float64, place: Place) -> Float64:
    """(N, 4, 4) that scale (N, 3), then rotate by quaternions x y z w (N, 4), then translate (N, 3)."""
    length = np.linalg.norm(rotation, axis=1, keepdims=True)
    if not np.all(length > 0):
        raise place.field("rotation").wrong(rotation[int(np.argmin(length))], "a unit quaternion [x, y, z, w]")
    x, y, z, w = (rotation / length).T
    matrices = np.zeros((len(translation), 4, 4))
    matrices[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    matrices[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    matrices[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    matrices[:, :3, :3] *= scale[:, None]
    matrices[:, :3, 3] = translation
    matrices[:, 3, 3] = 1.0
    return matrices


def instances(table: Table, world: Float64, accessors: Accessors) -> Float64:
    """(N, 3, 4) world from mesh: one for a node, and as many as EXT_mesh_gpu_instancing lists."""
    extension = table.extension("EXT_mesh_gpu_instancing")
    if extension is None:
        return world[None, :3]
    attributes = extension.table("attributes")
    given: dict[str, Float64] = {}
    for name, width in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3)):
        index = attributes.index(name, accessors.document.all("accessors"), "accessors")
        if index is not None:
            given[name] = accessors.floats(index, (width,), attributes.place.field(name))
    if not given:
        raise attributes.place.error("has none of TRANSLATION, ROTATION and SCALE.", "Export the file anew.")
    count = len(next(iter(given.values())))
    accessors.document.take(4 * 128 * count, attributes.place)
    for name, values in given.items():
        if len(values) != count:
            raise attributes.place.field(name).error(
                f"has {len(values):,} elements, but {next(iter(given))} has {count:,}.", "Export the file anew."
            )
    local = trs(
        given.get("TRANSLATION", np.zeros((count, 3))),
        given.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))),
        given.get("SCALE", np.ones((count, 3))),
        attributes.place,
    )
    with np.errstate(over="ignore", invalid="ignore"):
        placed = world @ local
    if not np.all(np.abs(placed) <= LARGEST):
        raise attributes.place.error(f"reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.")
    return placed[:, :3]
