"""Checks before `solve_radiosity` starts to work: options, scenes, and meshes larger than the memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np

from glpath.errors import UsageError, argument
from glpath.lights.lighting import Lighting
from glpath.radiosity.form_factors.form_factor import KINDS
from glpath.radiosity.memory import require_memory
from glpath.radiosity.mesh.mesh import Elements, Int64
from glpath.radiosity.mesh.sides import Sides
from glpath.radiosity.solvers import matrix
from glpath.scene import Scene
from glpath.scene.source_location import SourceLocation
from glpath.system.arguments import check_count, check_word

Method = Literal["progressive", "matrix", "monte-carlo"]
METHODS: tuple[Method, ...] = get_args(Method)
#: Memory of a solver per element in bytes, measured and rounded up.
_BYTES_PER_ELEMENT = 1800
#: Further memory per receiver point in bytes, measured and rounded up.
_BYTES_PER_POINT = 400
_SAMPLES = (1, 4, 9, 16, 25)
# Options that are whole numbers, with minimum and maximum.
_COUNTS = {
    "patches": (1, 2**53),
    "splits": (0, 20),
    "adaptive": (0, 20),
    "max_steps": (1, 2**53),
    "particles": (1, 2**53),
    "emitter_samples": (1, max(_SAMPLES)),
    "receiver_points": (1, 1024),
    "seed": (0, 2**63 - 1),
}


def check_options(options: Mapping[str, Any]) -> None:
    """Raise UsageError for options of `solve_radiosity` that are out of range or contradict each other."""
    o = options
    check_word("method", o["method"], METHODS)
    check_word("form_factors", o["form_factors"], KINDS)
    for name, (low, high) in _COUNTS.items():
        if o[name] is not None:
            check_count(name, o[name], low, high)
    if o["emitter_samples"] not in _SAMPLES:
        raise UsageError(f"emitter_samples: {o['emitter_samples']}; allowed are {', '.join(map(str, _SAMPLES))}")
    if math.isqrt(o["receiver_points"]) ** 2 != o["receiver_points"]:
        raise UsageError(f"receiver_points: {o['receiver_points']}; allowed are 1, 4, 9, 16, ..., 1024")
    if o["patches"] is not None and o["size"] is not None:
        raise UsageError("solve_radiosity: patches and size contradict each other.", "Give one of them.")
    for name, above, max_value in (("size", 0.0, math.inf), ("threshold", 0.0, math.inf), ("unshot", 0.0, 1.0)):
        value = o[name]
        if value is not None and not above < value < max_value:
            bound = f" and below {max_value:g}" if max_value < math.inf else ""
            raise UsageError(f"{name}: {value} where a finite number above {above:g}{bound} is needed")
    if o["adaptive"] and o["method"] == "matrix":
        raise UsageError(
            'solve_radiosity: adaptive subdivision is for methods "progressive" and "monte-carlo", not "matrix".',
            "Leave it out, or take finer elements with splits.",
        )


def check_solvable(scene: Scene) -> None:
    """Raise SceneError for a triangulated scene that has no solution."""
    location = SourceLocation(scene.source or scene.name)
    if Lighting.of(scene).dark:
        raise location.error(
            "has no shape with an emission, no other light and no sky, so that there is no light to distribute.",
            "Give a shape an emission, e.g. emission = { radiance = [10, 10, 10] }, or add [[lights]] or a [sky].",
        )
    if not len(Sides.of(scene, Elements.of_lattices(np.ones(len(scene.triangles), np.int64)))):
        raise location.error(
            "has no shape that reflects, so that there is nothing to solve.",
            "Give a material a reflectance above 0.",
        )
    for index in sorted({shape.material for shape in scene.shapes}):
        material = scene.materials[index]
        here = location.field("materials").field(material.name)
        if np.any(material.specular > 0):
            raise here.field("specular").wrong(
                material.specular,
                "0 for radiosity, which knows diffuse reflection alone",
                f"Render the scene with {argument('integrator', 'path')} and {argument('guide', 'cosine')}, or "
                "leave the highlight out.",
            )
        reflectance = scene.mean_reflectance(material)
        if np.any(reflectance >= 1):
            raise (
                here.field("reflectance").wrong(
                    reflectance,
                    "below 1 for radiosity",
                    "Between surfaces that reflect all light it never dies out: 0.9 is very white.",
                )
            )
    tiny = scene.areas <= np.finfo(float).tiny
    longest = np.abs(scene.triangles - scene.triangles[:, :1]).max(axis=(1, 2))
    flat = np.flatnonzero(tiny | (scene.areas <= 1e-14 * longest**2))
    if len(flat):
        number = int(scene.triangle_shape[flat[0]])
        shape = scene.shapes[number]
        raise location.error(
            f'has {len(flat)} triangles without area, the first in the shape "{shape.name}": number '
            f"{flat[0] - scene.shapes.ranges[number].start} of its {shape.count}.",
            "Their corners coincide or lie on one line: leave them out.",
        )
    if not np.isfinite(scene.triangles).all():
        raise location.error("has corners that are not finite.")


def check_memory(scene: Scene, divisions: Int64, size: float, splits: int, points: int, method: Method) -> float:
    """Return the solver's memory per element, bytes. Raises UsageError if the mesh needs more than is available."""
    ones = Sides.of(scene, Elements.of_lattices(np.ones(len(scene.triangles), np.int64)))
    sides = np.bincount(ones.element, minlength=len(scene.triangles)).astype(float)
    squares = divisions.astype(float) ** 2
    patches, elements = squares.sum(), squares.sum() * 4.0**splits
    receivers = float((sides * squares).sum()) * 4.0**splits
    need = elements * _BYTES_PER_ELEMENT + receivers * points * _BYTES_PER_POINT
    if method == "matrix":
        need += matrix.matrix_bytes(int(receivers), int((sides * squares).sum()))
    what = f"solve_radiosity: {patches:,.0f} patches of at most {size:.3g} and {elements:,.0f} elements"
    remedy = "Take fewer patches, a larger size, or fewer splits."
    if method == "matrix":
        remedy += ' Method "progressive" needs no matrix.'
    require_memory(need, what, remedy)
    return float(need / max(elements, 1.0))
