"""Animations: the pose of all nodes at a given time.

All chosen animations run at once. Each keeps its first value before its first key and its last value after its last
key. If two of them animate the same property of a node, the later one wins.

Source: glTF 2.0, 3.11 and appendix C (interpolation).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from glpath.errors import UsageError
from glpath.io.gltf.accessors import Accessors
from glpath.io.gltf.document import Document
from glpath.io.gltf.table import Table
from glpath.io.values import LARGEST
from glpath.scene.model import Float64
from glpath.system.time_limit import check_time

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3, "weights": 1}
# Number of evenly spaced samples while the shutter is open. Between samples, a rotation takes the shorter arc, so a
# node must rotate by less than 180 degrees from one sample to the next.
_EVEN_TIMES = 17
# Maximum number of keyframe times that are added to the evenly spaced samples.
_MAX_KEYS = 64
_PATHS = {name: name for name in _WIDTHS}
_INTERPOLATIONS = {name: name for name in ("LINEAR", "STEP", "CUBICSPLINE")}


def poses_at(
    document: Document, accessors: Accessors, time: float | None, chosen: Sequence[tuple[int, Table]]
) -> dict[int, dict[str, Float64]]:
    """Return the animated values of nodes by node index; empty if `time`, in seconds, is None.

    chosen : animations that run, with their indices
    """
    animations = document.all("animations")
    poses: dict[int, dict[str, Float64]] = {}
    if time is None:
        if len(animations):
            document.notes.add(
                f"Animations ({len(animations)}): the model is shown at rest, or at a time in seconds."
            )
        return poses
    if not np.isfinite(time):
        raise UsageError(f"time is {time}; must be a finite number of seconds.")
    if not len(animations):
        document.notes.add("The time that was asked for: the file has no animations.")
    moved: dict[tuple[int, str], int] = {}
    target_counts: dict[int, int] = {}  # by mesh index
    for number, animation in chosen:
        samplers = animation.tables("samplers")
        for channel in animation.tables("channels"):
            check_time()
            target = channel.table("target")
            if target.text("path") == "pointer":
                continue  # `_check_extensions` has added a note on KHR_animation_pointer
            node = target.index("node", document.all("nodes"), "nodes")
            path = target.choice("path", _PATHS, "")
            if node is None or not path:
                continue
            if path != "weights" and "matrix" in document.all("nodes")[node]:
                document.notes.add("Animations of nodes that have a matrix: such a node does not move.")
                continue
            if moved.setdefault((node, path), number) != number:
                document.notes.add("Animations of a node that another animation moves as well: the later one does.")
            sampler = samplers[channel.required_index("sampler", samplers, "samplers")]
            width = _WIDTHS[path] if path != "weights" else _target_count(document, node, target_counts)
            value = _value(sampler, path, width, accessors, time)
            if value is not None:
                poses.setdefault(node, {})[path] = value
    return poses


def shutter_times(
    chosen: Sequence[tuple[int, Table]], accessors: Accessors, opened: float, closed: float
) -> Float64:
    """Return (K,) sample times of the nodes: evenly spaced times plus keyframes.

    Motion between the samples is nearly linear. At most `_MAX_KEYS` keyframes are used.
    """
    keys: dict[int, Float64] = {}  # by accessor, because samplers often share their times
    after, before = max(opened, _in_single_precision(opened)), min(closed, _in_single_precision(closed))
    every = accessors.document.all("accessors")
    for _, animation in chosen:
        for sampler in animation.tables("samplers"):
            number, at = sampler.required_index("input", every, "accessors"), sampler.location.field("input")
            if number not in keys:
                times = accessors.floats(number, (1,), at)[:, 0]
                keys[number] = times[(times > after) & (times < before)][:_MAX_KEYS]
    inside = np.unique(np.concatenate([np.zeros(0), *keys.values()]))[:_MAX_KEYS]
    return np.union1d(np.linspace(opened, closed, _EVEN_TIMES), inside)


def _in_single_precision(time: float) -> float:
    """Return a time rounded to float32, as key times are in files, so that 0.1 s equals a key at 0.1 s."""
    return float(np.float32(np.clip(time, -LARGEST, LARGEST)))


def _target_count(document: Document, node: int, counts: dict[int, int]) -> int:
    """Return the maximum number of morph targets of a primitive of a node's mesh; 0 if the node has no mesh.

    counts : cache of the numbers by mesh index
    """
    meshes = document.all("meshes")
    mesh = document.all("nodes")[node].index("mesh", meshes, "meshes")
    if mesh is None:
        return 0
    if mesh not in counts:
        counts[mesh] = max((len(each.tables("targets")) for each in meshes[mesh].tables("primitives")), default=0)
    return counts[mesh]


def _value(sampler: Table, path: str, width: int, accessors: Accessors, time: float) -> Float64 | None:
    """Return the (k,) value of a sampler at a time; None if it has no keys.

    width : maximum k. Further weights have no morph target, and are not interpolated
    """
    every = accessors.document.all("accessors")
    at = sampler.location.field("input")
    times = accessors.keys(sampler.required_index("input", every, "accessors"), at)
    if not len(times):
        return None
    location = sampler.location.field("output")
    values = accessors.floats(sampler.required_index("output", every, "accessors"), (_WIDTHS[path],), location)
    interpolation = sampler.choice("interpolation", _INTERPOLATIONS, "LINEAR")
    parts = 3 if interpolation == "CUBICSPLINE" else 1
    each, rest = divmod(len(values), parts * len(times))
    if rest or not each or (path != "weights" and each != 1):
        raise location.error(
            f"has {len(values):,} values for {len(times):,} keys of {interpolation}, which does not divide.",
            "Export the file anew.",
        )
    keys = values.reshape(len(times), parts, -1)[:, :, :width]
    accessors.document.take(keys[0, 0].nbytes, location)
    right = int(np.searchsorted(times, max(time, _in_single_precision(time)), side="right"))
    if right in (0, len(times)) or interpolation == "STEP":
        found = keys[max(right - 1, 0), 1 if parts == 3 else 0]
        return _unit(found) if path == "rotation" else found
    before, after = keys[right - 1], keys[right]
    step = times[right] - times[right - 1]
    t = max((time - times[right - 1]) / step, 0.0)  # a key that is reached may be stored as slightly later
    if interpolation == "LINEAR":
        if path == "rotation":
            return slerp(_unit(before[0]), _unit(after[0]), t)
        return np.asarray((1 - t) * before[0] + t * after[0])
    # Hermite basis. A key holds its in-tangent, its value and its out-tangent, in this order.
    found = (
        (2 * t**3 - 3 * t**2 + 1) * before[1]
        + step * (t**3 - 2 * t**2 + t) * before[2]
        + (3 * t**2 - 2 * t**3) * after[1]
        + step * (t**3 - t**2) * after[0]
    )
    return _unit(found) if path == "rotation" else np.asarray(found)


def slerp(a: Float64, b: Float64, t: float) -> Float64:
    """Return the (4,) spherical interpolation between two unit quaternions on the shorter arc [Shoemake 1985]."""
    cosine = float(a @ b)
    b, cosine = (b, cosine) if cosine >= 0 else (-b, -cosine)
    if cosine > 1 - 1e-12:
        return _unit((1 - t) * a + t * b)
    angle = np.arccos(cosine)
    return np.asarray((np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle))


def _unit(quaternion: Float64) -> Float64:
    """Return the quaternion with length 1. A zero quaternion is returned unchanged; `nodes.trs` rejects it."""
    length = np.linalg.norm(quaternion)
    return np.asarray(quaternion / length if length > 0 else quaternion)
