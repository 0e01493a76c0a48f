"""Node hierarchy, and the world transform of each node, at rest or at a given time.

Source: glTF 2.0, 3.5 (nodes); EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from glpath.io.gltf.accessors import Accessors
from glpath.io.gltf.document import Document
from glpath.io.gltf.limits import MAX_NODE_DEPTH
from glpath.io.gltf.table import Table, Tables
from glpath.io.values import LARGEST
from glpath.scene.model import Float64
from glpath.scene.source_location import SourceLocation

INSTANCING = "EXT_mesh_gpu_instancing"
#: Animated properties of a node: translation, rotation (x, y, z, w), scale and weights.
Pose = Mapping[str, Float64]

_NO_CHILDREN: list[int] = []


@dataclass(frozen=True)
class Nodes:
    """Nodes of a document.

    world : (N, 4, 4) transforms from node to world space
    drawn : indices of the visible nodes of the scene, each once
    """

    tables: Tables
    world: Float64
    drawn: list[int]

    @classmethod
    def of(cls, document: Document, poses: Mapping[int, Pose]) -> Nodes:
        """Compute the transforms of all nodes.

        poses : animated values by node index

        Raises SceneError for nodes that are their own ancestors or have several parents.
        """
        tables = document.all("nodes")
        world = _local_maps(tables, poses)
        children = [
            tables[index].indices("children", tables, "nodes") if "children" in values else _NO_CHILDREN
            for index, values in enumerate(tables.values)
        ]
        parent = _parents(tables, children)
        visited = 0
        level = np.array([index for index in range(len(tables)) if index not in parent], np.int64)
        depth = 0
        while len(level):
            visited += len(level)
            depth += 1
            if depth > MAX_NODE_DEPTH:
                raise tables[int(level[0])].location.error(
                    f"is a child of a child ... more than {MAX_NODE_DEPTH:,} deep.", "Join nodes without meshes."
                )
            if not np.all(np.abs(world[level]) <= LARGEST):
                index = int(level[np.argmin(np.all(np.abs(world[level]) <= LARGEST, axis=(1, 2)))])
                raise tables[index].location.error(
                    f"stands, with its parents, beyond {LARGEST:g} scene units, where 32 bit numbers end.",
                    "Check its matrix, translation and scale.",
                )
            below = [(child, index) for index in level.tolist() for child in children[index]]
            level, above = np.array(below, np.int64).reshape(-1, 2).T
            with np.errstate(over="ignore", invalid="ignore"):
                world[level] = world[above] @ world[level]
        if visited < len(tables):
            index = _on_a_circle(parent, len(tables))
            raise tables[index].location.error(
                "is its own ancestor.", "Remove it from the children of one of its children."
            )
        return cls(tables, world, _drawn(document, tables, children, parent))


def _parents(tables: Tables, children: list[list[int]]) -> dict[int, int]:
    parent: dict[int, int] = {}
    for index, below in enumerate(children):
        for i, child in enumerate(below):
            if child in parent:
                location = tables[index].location.field("children").item(i)
                raise location.error(
                    f"is {child}, which is already a child of nodes[{parent[child]}].",
                    "A node has one parent: copy it, or give its mesh to several nodes.",
                )
            parent[child] = index
    return parent


def _on_a_circle(parent: Mapping[int, int], count: int) -> int:
    """Return the index of a node that is its own ancestor."""
    settled: set[int] = set()
    for start in range(count):
        index, on_path = start, set[int]()
        while index in parent and index not in settled:
            if index in on_path:
                return index
            on_path.add(index)
            index = parent[index]
        settled |= on_path
    raise AssertionError("a node was not reached, but none is on a circle")


def _drawn(document: Document, tables: Tables, children: list[list[int]], parent: Mapping[int, int]) -> list[int]:
    scenes = document.all("scenes")
    chosen = document.root.index("scene", scenes, "scenes")
    if len(scenes):
        scene = scenes[chosen or 0]
        roots = scene.indices("nodes", tables, "nodes")
        if any(root in parent for root in roots):
            # glTF forbids root nodes with parents, but UniGLTF writes many such files. These nodes stay below their
            # parents, and are not drawn a second time.
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
        if "extensions" in tables.values[index]:
            visibility = tables[index].extension("KHR_node_visibility")
            if visibility is not None and not visibility.flag("visible", True):
                continue
        drawn.append(index)
        waiting += reversed(children[index])
    return drawn


def _local_maps(tables: Tables, poses: Mapping[int, Pose]) -> Float64:
    """Return the (N, 4, 4) transforms from each node to its parent's space."""
    count = len(tables)
    parts = {
        "translation": np.zeros((count, 3)),
        "rotation": np.tile([0.0, 0, 0, 1], (count, 1)),
        "scale": np.ones((count, 3)),
    }
    animated = {index for index, pose in poses.items() if pose.keys() & parts.keys()}
    by_matrix = np.array([i for i in tables.having("matrix").tolist() if i not in animated], np.int64)
    for name, values in parts.items():
        rows = np.setdiff1d(tables.having(name), by_matrix, assume_unique=True)
        values[rows] = tables.numbers(name, rows, values.shape[1])
        for index in animated:
            values[index] = poses[index].get(name, values[index])
    flat = np.flatnonzero(~(np.linalg.norm(parts["rotation"], axis=1) > 0))
    location = tables[int(flat[0])].location if len(flat) else tables.location
    maps = trs(parts["translation"], parts["rotation"], parts["scale"], location)
    if len(by_matrix):
        matrices = tables.numbers("matrix", by_matrix, 16).reshape(-1, 4, 4).transpose(0, 2, 1)
        last = np.isclose(matrices[:, 3], [0, 0, 0, 1], atol=1e-5).all(axis=1)
        if not last.all():
            wrong = int(np.argmin(last))
            location = tables[int(by_matrix[wrong])].location
            raise location.field("matrix").error(
                f"has {location.written(matrices[wrong, 3])} as its last row, but must have [0, 0, 0, 1].",
                "Matrices are listed column by column.",
            )
        maps[by_matrix, :3] = matrices[:, :3]
    return maps


def trs(translation: Float64, rotation: Float64, scale: Float64, location: SourceLocation) -> Float64:
    """Return the (N, 4, 4) transforms that scale first, then rotate, then translate.

    translation, scale : (N, 3)
    rotation           : (N, 4) quaternions x y z w of any length but zero
    """
    length = np.linalg.norm(rotation, axis=1, keepdims=True)
    if not np.all(length > 0):
        raise location.field("rotation").wrong(rotation[int(np.argmin(length))], "a unit quaternion [x, y, z, w]")
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
    """Return the (N, 3, 4) transforms from mesh to world space of a node's instances.

    N is 1, or the number of instances that EXT_mesh_gpu_instancing lists.
    """
    extension = table.extension(INSTANCING)
    if extension is None:
        return world[None, :3]
    attributes = extension.table("attributes")
    given: dict[str, Float64] = {}
    for name, width in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3)):
        index = attributes.index(name, accessors.document.all("accessors"), "accessors")
        if index is not None:
            given[name] = accessors.floats(index, (width,), attributes.location.field(name))
    if not given:
        raise attributes.location.error("has none of TRANSLATION, ROTATION and SCALE.", "Export the file anew.")
    count = len(next(iter(given.values())))
    accessors.document.take(4 * 128 * count, attributes.location)
    for name, values in given.items():
        if len(values) != count:
            raise attributes.location.field(name).error(
                f"has {len(values):,} elements, but {next(iter(given))} has {count:,}.", "Export the file anew."
            )
    local = trs(
        given.get("TRANSLATION", np.zeros((count, 3))),
        given.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))),
        given.get("SCALE", np.ones((count, 3))),
        attributes.location,
    )
    with np.errstate(over="ignore", invalid="ignore"):
        placed = world @ local
    if not np.all(np.abs(placed) <= LARGEST):
        raise attributes.location.error(f"reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.")
    return placed[:, :3]
