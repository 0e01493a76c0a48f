"""Choices that a file leaves to the user: the animations that run, and the variant of its materials.

Source: glTF 2.0, 3.11; KHR_materials_variants.
"""

from __future__ import annotations

from collections.abc import Sequence

from glpath.errors import UsageError
from glpath.io.gltf.accessors import Accessors
from glpath.io.gltf.document import Document
from glpath.io.gltf.table import Table, Tables
from glpath.scene.source_location import shown
from glpath.system.numerals import unsigned
from glpath.system.suggestions import listed_names, similar_names

_VARIANTS = "KHR_materials_variants"
#: Name that chooses all animations at once, because some exporters write one animation per object.
ALL = "all"


def animation_names(document: Document) -> tuple[str, ...]:
    """Return the name of each animation, in order."""
    return tuple(each.name(f"animation-{i}") for i, each in enumerate(document.all("animations")))


def animation_lengths(document: Document, accessors: Accessors) -> tuple[float, ...]:
    """Return the length of each animation: the time of its last key in seconds."""
    every = document.all("accessors")
    ends: dict[int, float] = {}  # by accessor, because samplers often share their times
    lengths = []
    for animation in document.all("animations"):
        last = 0.0
        for sampler in animation.tables("samplers"):
            number, at = sampler.required_index("input", every, "accessors"), sampler.location.field("input")
            if number not in ends:
                ends[number] = float(accessors.floats(number, (1,), at).max(initial=0.0))
            last = max(last, ends[number])
        lengths.append(last)
    return tuple(lengths)


def chosen_animations(document: Document, wanted: str | None) -> list[tuple[int, Table]]:
    """Return the animations that run, with their indices. Raises UsageError.

    wanted : None: the first animation; `ALL`: all; otherwise the name or index of one
    """
    every = list(enumerate(document.all("animations")))
    if wanted is None:
        return every[:1]
    if wanted == ALL:
        return every
    return [every[_number(wanted, animation_names(document), "animation", document)]]


def variant_names(document: Document) -> tuple[str, ...]:
    """Return the name of each material variant, in order."""
    return tuple(each.name(f"variant-{i}") for i, each in enumerate(_variants(document)))


def chosen_variant(document: Document, wanted: str | None) -> int | None:
    """Return the index of the material variant with this name or index; None if `wanted` is None.

    None stands for the primitives' own materials. Raises UsageError.
    """
    return None if wanted is None else _number(wanted, variant_names(document), "variant", document)


def material_of(primitive: Table, variant: int | None, document: Document) -> int | None:
    """Return the material index of a primitive: the variant's if it has one, otherwise the primitive's own."""
    materials = document.all("materials")
    mapped = primitive.extension(_VARIANTS) if variant is not None else None
    if mapped is not None:
        for mapping in mapped.tables("mappings"):
            if variant in mapping.indices("variants", _variants(document), "variants"):
                return mapping.required_index("material", materials, "materials")
    return primitive.index("material", materials, "materials")


def _variants(document: Document) -> Tables | list[Table]:
    extension = document.root.extension(_VARIANTS)
    return [] if extension is None else extension.tables("variants")


def _number(wanted: str, names: Sequence[str], what: str, document: Document) -> int:
    if wanted in names:
        return names.index(wanted)
    number = unsigned(wanted)
    if number is not None and number < len(names):
        return number
    listed = listed_names(f"{i} {shown(name)}" for i, name in enumerate(names)) or "none"
    near = similar_names(wanted, names, 1, 0.4)
    raise UsageError(
        f"{document.location} {what} {shown(wanted)} was asked for, but its {what}s are: {listed}.",
        f"Did you mean {shown(near[0])}?" if near else f"`glpath info` lists the {what}s.",
    )
