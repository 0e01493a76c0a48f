"""AOVs ("arbitrary output variables"): outputs of a film besides radiance, declared once.

Help texts, EXR layers, the film's sums and the shaders' defines are generated from `AOV_KINDS` and `GROUPS`.
`Film.aov` returns one of them. The first group describes the first visible surface. Mirrors and glass are visible
surfaces, too, except in "albedo" and "normal" as stated there:

"albedo"      : (H, W, 3) float64, diffuse reflectance, plus emission or the sky's radiance, clipped to 1; linear
                Rec. 709, 0 to 1. With `path` and `gather`, mirrors and clear glass have the albedo of the surface
                that they show, times their fraction of the light; otherwise a denoiser would blur it
"normal"      : (H, W, 3) float64, shading normal in the world's frame, on the visible side. Unit length before
                averaging, 0 for the sky. Mirrors and clear glass have the normal of the surface that they show
"depth"       : (H, W) float64, scene units along the camera's view, not along the ray. Mean of the samples that hit
                a surface, 1e10 if none does. Surfaces farther than 1024 times the scene's extent (of an infinite
                plane) count as at that distance
"depth_min"   : (H, W) float64, depth of the nearest surface hit by a sample, not a mean, because at an edge `depth`
                is between two surfaces. Other renderers call it the filter "closest", or "zmin"
"position"    : (H, W, 3) float64, world position. Mean of the samples that hit a surface, 0 if none does. For a
                scene far from the origin, an .exr stores it relative to `position_origin` in its header
"uv"          : (H, W, 2) float64, first texture coordinates, v upwards. Mean of the samples that hit a surface, 0
                if none does. At a texture seam it averages unrelated values. Coordinates beyond -4,096 and 4,096
                are clamped to these
"object_id"   : (H, W) int64, number of the shape that most samples hit, from 1, in the scene's order, for masks; 0
                if there is none. An .exr also has the Cryptomatte of objects, see `cryptomatte`
"material_id" : (H, W) int64, as "object_id", for materials

These describe the light that arrives at the eye, (H, W, 3) float64, W sr^-1 m^-2, linear Rec. 709:

"direct"      : visible emission and sky, and light reflected by one surface
"indirect"    : all other light, including ambient light. The sum of both is `mean`

"samples"     : (H, W) int64, number of path sets, without samples that were dropped as not finite, which count as
                black
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
#: AOVs that guide the denoiser, see `glpath.film.denoise`.
DENOISER_AOVS: tuple[Aov, ...] = ("albedo", "normal")


def guides_denoiser(aovs: Collection[str]) -> bool:
    """Return True if `aovs` contains every AOV that guides a denoiser."""
    return set(DENOISER_AOVS) <= set(aovs)


def with_guides(aovs: Collection[str]) -> tuple[Aov, ...]:
    """Return `aovs` and the AOVs that guide a denoiser, in the order of `AOVS`, which film files require."""
    return tuple(name for name in AOVS if name in aovs or name in DENOISER_AOVS)


#: AOVs computed from the film's counts: how many samples of each pixel hit each shape.
ID_AOVS: tuple[Aov, ...] = ("object_id", "material_id")

#: Depth, in scene units, of a pixel whose samples hit no surface. Programs that read OpenEXR recognize this value.
FAR = 1e10
_INFINITY = 0x7F800000
#: Key, in the mapping of AOV sums that `Film.add` takes, of the shape hit by each sample.
SHAPES = "shapes"


@dataclass(frozen=True)
class AovKind:
    """Declaration of an AOV.

    numbers : number of values that the film sums for each pixel; 0 for an AOV made from other sums
    letters : suffixes of the AOV's channels in an EXR, named as Nuke, Blender and Natron expect
    over    : divisor of the sum: "samples" is the number of samples; "hits" is the number of samples that hit a
              surface, summed as the last value; "" is no division
    empty   : value of a pixel without hits, if `over` is "hits"
    note    : text that help adds to the name
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

#: AOVs computed from sums of another name: that name, and the sums' number of values per pixel.
_MADE_FROM: dict[str, tuple[str, int]] = {"indirect": ("direct", 3), "samples": ("dropped", 1)}


@dataclass(frozen=True)
class Group:
    """AOVs that a shader sums together.

    aovs    : names of these AOVs
    sums    : names of the sums in shaders/film/aov.glsl; each is one output of the shader
    meaning : description in the table of shader variants
    """

    aovs: tuple[Aov, ...]
    sums: tuple[str, ...]
    meaning: str


#: Groups of AOVs by the preprocessor define that adds a group's sums to the shader.
GROUPS: dict[str, Group] = {
    "AOV_SURFACE": Group(("albedo", "normal"), ("sum_first", "sum_second"), "albedo and normal"),
    "AOV_POSITION": Group(("depth", "position"), ("sum_low", "sum_high"), "depth and position"),
    "AOV_UV": Group(("uv",), ("sum_uv_low", "sum_uv_high"), "texture coordinates"),
    "AOV_NEAREST": Group(("depth_min",), ("sum_nearest",), "the nearest depth"),
}


def sums_of(aovs: Iterable[str]) -> dict[str, int]:
    """Return the names of the sums needed to compute AOVs, each with its number of values per pixel."""
    found: dict[str, int] = {}
    for name in aovs:
        if name in _MADE_FROM:
            found.update([_MADE_FROM[name]])
        elif AOV_KINDS[name].numbers:
            found[name] = AOV_KINDS[name].numbers
    return found


def add_aov(name: str, held: NDArray[np.float64], more: NDArray[np.float64]) -> None:
    """Add `more`, an AOV's sum over further path sets, to `held`, the sum so far, in place."""
    import numpy as np

    # "depth_min" is stored as an integer: the float32 bits of infinity minus those of the depth; 0 without hits. So
    # the nearest depth is the maximum.
    (np.maximum if name == "depth_min" else np.add)(held, more, out=held)


def min_depths(held: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depths that the stored values of "depth_min" encode (see `add_aov`); infinite without hits."""
    import numpy as np

    bits = np.uint32(_INFINITY) - np.clip(held, 0, _INFINITY).astype(np.uint32)
    return bits.view(np.float32).astype(np.float64)


def described() -> str:
    """Return the names of all AOVs with their notes, for help texts."""
    return ", ".join(f"{name} ({kind.note})" if kind.note else name for name, kind in AOV_KINDS.items())
