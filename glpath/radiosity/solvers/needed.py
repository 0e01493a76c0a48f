"""Kernels that a solution needs, so that their number is known before the first is compiled."""

from __future__ import annotations

from typing import Any

from glpath.accel import bvh
from glpath.lights.lighting import Lighting
from glpath.radiosity import lookup
from glpath.radiosity.form_factors import form_factor, lights
from glpath.radiosity.mesh import sides
from glpath.radiosity.shafts import casting, occluders, points, search
from glpath.radiosity.solvers import particles, progressive
from glpath.scene import Scene
from glpath.system.kernels import waiting

_ALWAYS = (occluders._parallelograms, bvh._build)
_FORM_FACTORS = (
    points._groups, form_factor._tiers, search._upwards, search.find_emitter_list, casting.cast_groups,
    form_factor._factors,
)  # fmt: skip
_OF_METHOD: dict[str, tuple[Any, ...]] = {
    "progressive": (*_FORM_FACTORS, progressive._energy, progressive._shoot),
    "matrix": _FORM_FACTORS,
    "monte-carlo": (particles.shoot_batch,),
}


def kernels_of(scene: Scene, lighting: Lighting, method: str, near_lamps: bool) -> tuple[Any, ...]:
    """Return the kernels of a method.

    near_lamps : True if the solver computes how near elements are to emitting shapes
    """
    needed = [*_ALWAYS, *_OF_METHOD[method]]
    if lighting.punctual or lighting.sky is not None:
        needed.append(lights._free)
    if near_lamps and lighting.sides:
        needed.append(lookup._closest)
    # The test for closed surfaces takes long in a large scene, so a kernel that is already compiled is not tested.
    if waiting([sides._in_the_open]) and sides.has_solids(scene):
        needed.append(sides._in_the_open)
    return tuple(needed)
