"""A film's provenance, as its files carry it: validated when read, and merged."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from types import UnionType
from typing import Any, Literal

from glpath.errors import UsageError
from glpath.film.aovs import AOVS, ID_AOVS, sums_of
from glpath.film.bias import BIAS_PROBE, REJECTED_GATHER, check_probe
from glpath.film.image import check_exposure
from glpath.film.units import UNITS, Unit

# Types of the metadata's fields in a file.
_METADATA_TYPES: dict[str, type | UnionType] = {
    "scene scene_hash integrator device stop_rule unit": str,
    "seed": int,
    "max_depth": int | None,
    "elapsed_s": int | float,
    "noisy biased transparent": bool,
    "settings versions statistics": dict,
    "error_bound solution_error": int | float | None,
}
# Fields that must be equal to merge, in the words of a message; settings each by name.
_DECIDES = {
    "scene_hash": "scene",
    "integrator": "integrator",
    "seed": "seed",
    "max_depth": "max_depth",
    "settings": "settings",
    "full_resolution": "resolution",
    "window": "crop",
    "aovs": "aovs",
    "position_origin": "position_origin",
    "unit": "unit",
}
# Kinds of counts of shapes.
_NAMES = ("shape_names", "material_names", "shape_materials")
# Sides of an image, pixels; far beyond what can be rendered.
_MAX_SIDE = 1 << 20


@dataclass(frozen=True)
class FilmMetadata:
    """A film's provenance. Films merge when all that decides the image is equal.

    scene           : name of the scene, for people
    scene_hash      : `Scene.digest()`, with geometry, materials, lights and camera in it
    integrator      : for example "path-buffer"
    seed, max_depth : of the random numbers; vertices of a path, as in the paper, None where there is
                      light of all bounces
    settings        : all else that decides the image (sampling, directions, ambient, ...), as JSON has values
    unit            : of its radiance: "radiometric" (W sr^-1 m^-2) or "photometric" (cd m^-2); "" in older files
    exposure        : stops that the scene asks for in 8-bit pictures; None: `image.auto_exposure` decides
    transparent     : pictures have an alpha channel, from the sum of "depth": see `Film.alpha`
    noisy           : whether another seed is another image, so that comparisons have to look at the noise
    full_resolution : (width, height) of the whole image, pixels
    window          : (x, y, width, height) of the crop that the film holds, pixels, y from the top
    device          : the renderer's name; several, joined by " + ", after merging
    versions        : name and version of the programs that took part
    elapsed_s       : seconds from the call, or from the start of the command's process, to the last path set;
                      summed over runs that resumed it and over what was merged
    statistics      : counts, summed when merging: `paths_cast`; of scans of the path-buffer `paths_lost` (to the
                      roulette of a cell); `paths_cut` (at a length that chance should have ended before);
                      `dropped_samples` (NaN or infinite, counted as 0); `stage_ms`, milliseconds by stage;
                      `radiosity_s`, of a gather, the seconds until it had its radiosity solution; `bias_probe`,
                      of a gather, sums of its difference to unbiased paths, see `glpath.film.bias`;
                      `rejected_gather`, the same of a gather whose bias was too large, so that "path" rendered
                      the film
    aovs            : names out of AOVS that the film holds as well
    shape_names     : of the scene's shapes, where the film has "object_id" or "material_id"; else empty
    material_names  : of its materials, likewise
    shape_materials : the material of each shape, likewise
    position_origin : what the sums of "position" are relative to, in the coordinates of the scene, of one far from
                      the origin; None: to that
    stop_rule       : what ended the render: "spp", "time limit", "noise", "clean", "interrupted"; "" of unfinished
                      and of merged films
    error_bound     : `Film.error_bound`, or of "clean" `Film.denoised_noise`, where that was compared with what was
                      asked for, last; None without
    biased          : whether the engine's pictures have a bias, as a gather's: see `Film.bias`
    solution_error  : of a gather, the standard error of the picture's mean radiance that comes from its radiosity
                      solution, in the film's unit: the same in all of the picture, whatever the path sets. None
                      where it is not known: of a solution that was given, and of what no camera sees
    """

    scene: str
    scene_hash: str
    integrator: str
    seed: int
    max_depth: int | None
    settings: Mapping[str, Any]
    full_resolution: tuple[int, int]
    window: tuple[int, int, int, int]
    device: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    elapsed_s: float = 0.0
    noisy: bool = True
    exposure: float | None = None
    transparent: bool = False
    unit: Unit | Literal[""] = ""
    statistics: Mapping[str, Any] = field(default_factory=dict)
    aovs: tuple[str, ...] = ()
    stop_rule: str = ""
    error_bound: float | None = None
    solution_error: float | None = None
    biased: bool = False
    shape_names: tuple[str, ...] = ()
    material_names: tuple[str, ...] = ()
    shape_materials: tuple[int, ...] = ()
    position_origin: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        # As JSON has it from the beginning (a tuple is a list), so that a film read from a file still merges.
        for name in ("settings", "versions", "statistics"):
            object.__setattr__(self, name, json.loads(json.dumps(dict(getattr(self, name)))))
        object.__setattr__(self, "full_resolution", tuple(self.full_resolution))
        object.__setattr__(self, "window", tuple(self.window))
        for name in ("aovs", *_NAMES):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if self.position_origin is not None:
            object.__setattr__(self, "position_origin", tuple(self.position_origin))

    @property
    def aov_sums(self) -> dict[str, int]:
        """The sums that the AOVs are made of, and how many numbers of each a pixel has."""
        return sums_of(self.aovs)

    @property
    def counts_shapes(self) -> bool:
        """Whether the AOVs need counts of the shapes that samples have hit."""
        return not set(ID_AOVS).isdisjoint(self.aovs)

    def as_strings(self) -> dict[str, str]:
        """Every field as text, under names that a file's header can have: glpath.scene, glpath.seed, ...

        But for the names of shapes and materials, which may be many, and are in a Cryptomatte's manifest.
        """
        plain = {
            key: value if isinstance(value, str) else json.dumps(value)
            for key, value in asdict(self).items()
            if key not in _NAMES and not (key in ("position_origin", "solution_error") and value is None)
        }
        return {f"glpath.{key}": value for key, value in plain.items()}


def metadata_of(text: str) -> FilmMetadata:
    """The metadata of a film's file, as JSON. Raises ValueError where a field is missing or of another type."""
    stored = json.loads(text, parse_constant=_refuse)
    known = {f.name for f in fields(FilmMetadata)}
    metadata = FilmMetadata(**{key: value for key, value in stored.items() if key in known})
    for names, kinds in _METADATA_TYPES.items():
        for name in names.split():
            if not isinstance(getattr(metadata, name), kinds):
                raise ValueError(f"{name} in its metadata is {shown(getattr(metadata, name))}")
    if metadata.aovs != tuple(name for name in AOVS if name in metadata.aovs):
        raise ValueError(f"its AOVs are {shown(metadata.aovs)}, expected some of {', '.join(AOVS)}")
    if metadata.transparent and "depth" not in metadata.aovs:
        raise ValueError("it is transparent, but has no AOV depth, which alpha is made from")
    try:
        check_exposure(metadata.exposure)
    except UsageError as error:
        raise ValueError(error.message) from error
    if metadata.unit not in ("", *UNITS):
        raise ValueError(f"its unit is {shown(metadata.unit)}, expected one of {', '.join(UNITS)}")
    for name in ("error_bound", "solution_error"):
        value = getattr(metadata, name)
        if value is not None and not 0 <= value < 1e300:
            raise ValueError(f"{name} in its metadata is {shown(value)}, expected a number from 0 on")
    texts = all(isinstance(version, str) for version in metadata.versions.values())
    if not (texts and _plain_values(metadata.statistics) and _plain_values(metadata.elapsed_s)):
        raise ValueError("its statistics or versions are of no type that adds up")
    for name in (BIAS_PROBE, REJECTED_GATHER):
        if name in metadata.statistics:
            check_probe(metadata.statistics[name])
    _check_names(metadata)
    origin = metadata.position_origin
    if origin is not None and not (len(origin) == 3 and all(isinstance(x, int | float) for x in origin)):
        raise ValueError(f"its position_origin is {shown(origin)}")
    sizes = (*metadata.full_resolution, *metadata.window)
    if [len(metadata.full_resolution), len(metadata.window)] != [2, 4] or not all(type(n) is int for n in sizes):
        raise ValueError(f"its resolution and window are {shown(sizes)}")
    (width, height), (x, y, w, h) = metadata.full_resolution, metadata.window
    if not (0 <= x < x + w <= width <= _MAX_SIDE and 0 <= y < y + h <= height <= _MAX_SIDE):
        raise ValueError(f"its window {metadata.window} is not within its resolution {metadata.full_resolution}")
    return metadata


def _check_names(metadata: FilmMetadata) -> None:
    """Raise ValueError for names that are not those of shapes and their materials."""
    shapes, materials, of = metadata.shape_names, metadata.material_names, metadata.shape_materials
    if not all(isinstance(name, str) for name in (*shapes, *materials)) or len(shapes) != len(of):
        raise ValueError("its names of shapes and materials are not as many texts")
    if not all(type(number) is int and 0 <= number < len(materials) for number in of):
        raise ValueError(f"its shapes are of materials {shown(of[:20])}, of which it names {len(materials)}")


def _refuse(constant: str) -> None:
    raise ValueError(f"its metadata hold {constant}")


def _plain_values(value: object) -> bool:
    """Whether all of it is texts, numbers that can be added, and mappings and lists of these."""
    if isinstance(value, Mapping):
        return all(map(_plain_values, value.values()))
    if isinstance(value, list):
        return all(isinstance(one, int | float) and abs(one) < 1e300 for one in value)
    return isinstance(value, str) or (isinstance(value, int | float) and abs(value) < 1e300)


def joined(ours: str, theirs: str) -> str:
    """Names that are joined by " + ", each once."""
    return " + ".join(sorted({*ours.split(" + "), *theirs.split(" + ")} - {""}))


def merged_values(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers are added, also those of lists; texts that differ are both named, mappings go down a level."""
    merged = dict(ours)
    for key, value in theirs.items():
        # Parts of a render have the same probes.
        if key not in ours or (key in (BIAS_PROBE, REJECTED_GATHER) and value == ours[key]):
            merged[key] = value
        elif isinstance(value, Mapping) and isinstance(ours[key], Mapping):
            merged[key] = merged_values(ours[key], value)
        elif isinstance(value, int | float) and isinstance(ours[key], int | float):
            merged[key] = ours[key] + value
        elif isinstance(value, list) and isinstance(ours[key], list) and len(value) == len(ours[key]):
            merged[key] = [mine + other for mine, other in zip(ours[key], value, strict=True)]
        elif value == ours[key]:
            merged[key] = value
        else:
            merged[key] = joined(str(ours[key]), str(value))
    return merged


def differences(ours: FilmMetadata, theirs: FilmMetadata) -> list[tuple[str, str, str]]:
    """All that decides the image and is not the same: what it is, ours and theirs, as texts for a message.

    Empty where films of both merge.
    """
    found = []
    for name, word in _DECIDES.items():
        mine, other = getattr(ours, name), getattr(theirs, name)
        if name == "settings":
            keys = sorted({*mine, *other})
            pairs = {f"settings.{key}": (mine.get(key, "absent"), other.get(key, "absent")) for key in keys}
        else:
            pairs = {word: (mine, other)} if name != "unit" or (mine and other) else {}
        found += [(key, shown(a), shown(b)) for key, (a, b) in pairs.items() if a != b]
    return found


def shown(value: object) -> str:
    """A value for a message, cut short when long."""
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."
