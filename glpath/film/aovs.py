"""AOVs ("arbitrary output variables"): what a film may hold beside radiance, declared once.

Help texts, EXR layers, the film's sums and the shaders' defines are made from `AOV_KINDS` and `GROUPS`.
`Film.aov` gives one. Of the surface that the eye sees first, mirrors and glass too:

"albedo"      : (H, W, 3) float64, diffuse reflectance, plus emission or the sky's radiance, cut at 1:
                linear Rec. 709, 0 to 1. By `path` and `gather`, of what a mirror or clear glass shows, times
                its share of the light, or a denoiser would blur that
"normal"      : (H, W, 3) float64, to shade with, in the world's frame, on the side that is seen; unit
                before averaging, 0 for the sky. Of what mirrors and clear glass show, likewise
"depth"       : (H, W) float64, scene units along the camera's view, not along the ray: the mean of the
                samples that meet a surface, 1e10 where none does. A surface beyond 1024 times the scene's
                own extent (of an endless plane) counts as so far
"depth_min"   : (H, W) float64, the same of the nearest surface that a sample meets, no mean: at an edge
                `depth` is between two surfaces. Other renderers call it the filter "closest", or "zmin"
"position"    : (H, W, 3) float64, in the world: the mean of these samples, 0 where there are none. Of a
                scene far from the origin an .exr has them relative to its header's `position_origin`
"uv"          : (H, W, 2) float64, the first texture coordinates, v upwards: the mean of the samples that
                meet a surface, 0 where there are none. At a seam of a texture the mean is of unrelated values
"object_id"   : (H, W) int64, the number, from 1, of the shape that most samples meet, in the scene's order:
                one whole number a pixel, for masks; 0 where there is none. An .exr has the Cryptomatte of
                objects with it, see `cryptomatte`
"material_id" : the same of materials

Of the light that arrives at the eye, (H, W, 3) float64, W sr^-1 m^-2, linear Rec. 709:

"direct"      : emission and sky that are seen, and light reflected by one surface
"indirect"    : all else, ambient light too. Both together are `mean`

"samples"     : (H, W) int64, path sets, less the samples that were dropped as not finite and count as black
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


Aov = Literal[
    "albedo",
    "normal",
    "depth",
    "depth_min",
    "position",
    "uv",
    "object_id",
    "material_id",
    "direct",
    "indirect",
    "samples",
]
AOVS: tuple[Aov, ...] = get_args(Aov)
#: Those that a denoiser uses.
DENOISER_AOVS: tuple[Aov, ...] = ("albedo", "normal")


def guides_denoiser(aovs: Collection[str]) -> bool:
    """Whether a denoiser has all of these AOVs to go by."""
    return set(DENOISER_AOVS) <= set(aovs)


def with_guides(aovs: Collection[str]) -> tuple[Aov, ...]:
    """Return the AOVs together with those that guide a denoiser, in the order of `AOVS`, as film files need it."""
    return tuple(name for name in AOVS if name in aovs or name in DENOISER_AOVS)


#: Those made from counts of the shapes that samples have hit.
ID_AOVS: tuple[Aov, ...] = ("object_id", "material_id")

#: A depth where no surface is hit; OpenEXR's readers know it.
FAR = 1e10
_INFINITY = 0x7F800000
#: The counts of shapes, by the same name as of a sum.
SHAPES = "shapes"


@dataclass(frozen=True)
class AovKind:
    """numbers : how many the film sums for each pixel; 0 of one that is made from another's sums
    letters : the channels of its layer in an EXR: what Nuke, Blender and Natron know
    over    : what the sum is divided by: "samples", or "hits", those that hit a surface, whose number is summed as
              well, behind the others
    empty   : the value of a pixel that no sample's surface is seen in, of a mean over hits
    note    : what help adds to the name
    """

    numbers: int = 0
    letters: str = "RGB"
    over: Literal["samples", "hits", ""] = "samples"
    empty: float = 0.0
    note: str = ""


AOV_KINDS: dict[str, AovKind] = {
    "albedo": AovKind(3),
    "normal": AovKind(3, "XYZ"),
    "depth": AovKind(2, "Z", "hits", FAR),
    "depth_min": AovKind(1, "Z", "", note="of the nearest surface, no mean"),
    "position": AovKind(4, "XYZ", "hits"),
    "uv": AovKind(3, "XY", "hits", note="texture coordinates"),
    "object_id": AovKind(letters="X", note="one number per pixel, with their Cryptomatte"),
    "material_id": AovKind(letters="X", note="likewise"),
    "direct": AovKind(3, note="light reflected by one surface"),
    "indirect": AovKind(note="all other light"),
    "samples": AovKind(letters="X", note="how many"),
}

#: Which other sum an AOV is made from, and how many numbers that has.
_MADE_FROM: dict[str, tuple[str, int]] = {"indirect": ("direct", 3), "samples": ("dropped", 1)}


@dataclass(frozen=True)
class Group:
    """AOVs that a shader sums together.

    aovs    : their names
    sums    : the names of the sums in shaders/film/aov.glsl, one output each
    meaning : for the table of variants
    """

    aovs: tuple[Aov, ...]
    sums: tuple[str, ...]
    meaning: str


#: By the define that adds them to the shader.
GROUPS: dict[str, Group] = {
    "AOV_SURFACE": Group(("albedo", "normal"), ("sum_first", "sum_second"), "albedo and normal"),
    "AOV_POSITION": Group(("depth", "position"), ("sum_low", "sum_high"), "depth and position"),
    "AOV_UV": Group(("uv",), ("sum_uv_low", "sum_uv_high"), "texture coordinates"),
    "AOV_NEAREST": Group(("depth_min",), ("sum_nearest",), "the nearest depth"),
}


def sums_of(aovs: Iterable[str]) -> dict[str, int]:
    """The sums that AOVs are made of, and how many numbers of each a pixel has."""
    found: dict[str, int] = {}
    for name in aovs:
        if name in _MADE_FROM:
            found.update([_MADE_FROM[name]])
        elif AOV_KINDS[name].numbers:
            found[name] = AOV_KINDS[name].numbers
    return found


def add_aov(name: str, held: NDArray[np.float64], more: NDArray[np.float64]) -> None:
    """Add what further path sets have of one of the AOVs' sums to what is held, in place."""
    import numpy as np

    # "depth_min" is held as the bits of infinity less its own, 0 where nothing was hit: the greatest is kept.
    (np.maximum if name == "depth_min" else np.add)(held, more, out=held)


def min_depths(held: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depths by what a film holds of "depth_min"; infinite where nothing was hit."""
    import numpy as np

    bits = np.uint32(_INFINITY) - np.clip(held, 0, _INFINITY).astype(np.uint32)
    return bits.view(np.float32).astype(np.float64)


def described() -> str:
    """The names with their notes, for help."""
    return ", ".join(f"{name} ({kind.note})" if kind.note else name for name, kind in AOV_KINDS.items())
