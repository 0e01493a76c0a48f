"""The kernels that a solution needs, so that their number is known before the first is compiled."""

from __future__ import annotations

from typing import Any

from glpath.accel import bvh
from glpath.radiosity.form_factors import form_factor, lights
from glpath.radiosity.shafts import casting, occluders, points, search
from glpath.radiosity.solvers import particles, progressive

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


def kernels_of(method: str, direct_light: bool) -> tuple[Any, ...]:
    """The kernels of a method; direct_light: with punctual lights or a sky."""
    return (*_ALWAYS, *_OF_METHOD[method], *((lights._free,) if direct_light else ()))
