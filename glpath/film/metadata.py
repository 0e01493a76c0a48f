"""Provenance of a film, as stored in its files: checks when it is read, and merging with that of another film."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, TypeGuard

import msgspec

from glpath.errors import UsageError
from glpath.film.aovs import AOVS, ID_AOVS, sums_of
from glpath.film.bias import BIAS_PROBE, REJECTED_GATHER, check_probe
from glpath.system.colour import check_exposure
from glpath.system.units import Unit

# Statistics that are a single count or time, and statistics that map names to counts or times.
_COUNTS = ("paths_cast", "paths_lost", "paths_cut", "dropped_samples", "radiosity_s")
_COUNTS_BY_NAME = ("stage_ms", "intersection_tests")
# Fields that must be equal in films to be merged, with their names in messages. Settings are compared one by one.
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
# Fields with the names of shapes and materials, and the material of each shape. Files' headers leave them out.
_NAMES = ("shape_names", "material_names", "shape_materials")
# Maximum side of an image in pixels, beyond any possible render.
_MAX_SIDE = 1 << 20


@dataclass(frozen=True)
class FilmMetadata:
    """Provenance of a film. Films can be merged if all fields are equal that determine the image.

    scene           : name of the scene, for display
    scene_hash      : `Scene.digest()`, which includes geometry, materials, lights and camera
    integrator      : name of the integrator, for example "path-buffer"
    seed, max_depth : seed of the random numbers; maximum number of path vertices, as in the paper, or None for
                      light of all bounces
    settings        : all other settings that determine the image (sampling, directions, ambient, ...), as JSON
                      values
    unit            : unit of the film's radiance: "radiometric" (W sr^-1 m^-2) or "photometric" (cd m^-2); "" in
                      older files
    exposure        : stops of the scene for 8-bit images; None: `image.auto_exposure` decides
    transparent     : True if images have an alpha channel, from the sum of "depth": see `Film.alpha`
    noisy           : True if another seed gives another image, so that comparisons must account for noise
    full_resolution : (width, height) of the whole image, pixels
    window          : (x, y, width, height) of the film's crop, pixels, y from the top
    pixel_aspect    : width of the camera's pixels divided by their height; 1 in older files
    device          : name of the renderer; several, joined by " + ", after merging
    versions        : names and versions of the programs involved
    elapsed_s       : seconds from the call, or from the start of the command's process, to the last path set;
                      summed over resumed runs and merged films
    statistics      : counts that are summed when films are merged. `paths_cast`; for scans of the path-buffer
                      `paths_lost` (to the roulette of a cell); `paths_cut` (at a length that random termination
                      should have prevented); `dropped_samples` (NaN or infinite, counted as 0); `stage_ms`,
                      milliseconds by stage; `radiosity_s`, for a gather, seconds until it had its radiosity
                      solution; `bias_probe`, for a gather, sums of its difference from unbiased paths, see
                      `glpath.film.bias`; `rejected_gather`, the same for a gather whose bias was too large, so that
                      "path" rendered the film; `bias_obstacle`, a text that explains why the bias of a gather
                      could not be measured
    aovs            : names from AOVS of the film's AOVs
    shape_names     : names of the scene's shapes if the film has "object_id" or "material_id"; otherwise empty
    material_names  : names of the scene's materials, in the same films as `shape_names`
    shape_materials : material index of each shape, in the same films as `shape_names`
    position_origin : origin of the sums of "position" in scene coordinates, for a scene far from the origin; None:
                      zero
    stop_rule       : reason why the render ended: "spp", "time limit", "noise", "clean", "interrupted"; "" for
                      unfinished and merged films
    error_bound     : last value that was compared with a requested limit: `Film.error_bound`, or
                      `Film.denoised_noise` for "clean"; None if nothing was compared
    biased          : True if the engine's images have a bias, as those of a gather: see `Film.bias`
    solution_error  : for a gather, standard error of the image's mean radiance that is caused by its radiosity
                      solution, in the film's unit. It is the same in the whole image for any number of path sets.
                      None if it is not known: for a given solution, and for a solution without a camera
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
    pixel_aspect: float = 1.0

    def __post_init__(self) -> None:
        # Converted to JSON values (a tuple becomes a list), so that they equal those of a film that is read from a
        # file. Merging compares them.
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
        """Names of the sums from which the AOVs are made, with each sum's number of values per pixel."""
        return sums_of(self.aovs)

    @property
    def counts_shapes(self) -> bool:
        """True if the AOVs need counts of the shapes that samples have hit."""
        return not set(ID_AOVS).isdisjoint(self.aovs)

    def as_strings(self) -> dict[str, str]:
        """Return every field as text, under names for a file's header: glpath.scene, glpath.seed, ...

        A usual pixel aspect and unknown values are left out. So are names of shapes and materials, because they may
        be many, and are in a Cryptomatte's manifest.
        """
        plain = {
            key: value if isinstance(value, str) else json.dumps(value)
            for key, value in asdict(self).items()
            if key not in _NAMES and not (key in ("position_origin", "solution_error") and value is None)
            if (key, value) != ("pixel_aspect", 1.0)
        }
        return {f"glpath.{key}": value for key, value in plain.items()}


def metadata_of(stored: Mapping[str, Any]) -> FilmMetadata:
    """Return metadata from the JSON object of a film's file.

    Raises ValueError if a field is missing or has a wrong type.
    """
    try:
        metadata = msgspec.convert(stored, FilmMetadata)
    except msgspec.ValidationError as error:
        raise ValueError(f"its metadata are wrong: {error}") from error
    if metadata.aovs != tuple(name for name in AOVS if name in metadata.aovs):
        raise ValueError(f"its AOVs are {shown(metadata.aovs)}, expected some of {', '.join(AOVS)}")
    if metadata.transparent and "depth" not in metadata.aovs:
        raise ValueError("it is transparent, but has no AOV depth, which alpha is made from")
    try:
        check_exposure(metadata.exposure)
    except UsageError as error:
        raise ValueError(error.message) from error
    for name in ("elapsed_s", "error_bound", "solution_error"):
        value = getattr(metadata, name)
        if value is not None and not _is_count(value):
            raise ValueError(f"{name} in its metadata is {shown(value)}, expected a number from 0 on")
    if not _plain_values(metadata.statistics):
        raise ValueError("its statistics are of no type that adds up")
    _check_counts(metadata.statistics)
    for name in (BIAS_PROBE, REJECTED_GATHER):
        if name in metadata.statistics:
            check_probe(metadata.statistics[name])
    if not (_is_number(metadata.pixel_aspect) and metadata.pixel_aspect > 0):
        raise ValueError(
            f"pixel_aspect in its metadata is {shown(metadata.pixel_aspect)}, expected a number above 0"
        )
    _check_names(metadata)
    origin = metadata.position_origin
    if origin is not None and not all(map(_is_number, origin)):
        raise ValueError(f"its position_origin is {shown(origin)}")
    (width, height), (x, y, w, h) = metadata.full_resolution, metadata.window
    if not (0 <= x < x + w <= width <= _MAX_SIDE and 0 <= y < y + h <= height <= _MAX_SIDE):
        raise ValueError(f"its window {metadata.window} is not within its resolution {metadata.full_resolution}")
    return metadata


def _check_counts(statistics: Mapping[str, Any]) -> None:
    """Raise ValueError if a count or a time in the statistics is negative or no number."""
    for name in (*_COUNTS, *_COUNTS_BY_NAME):
        value = statistics.get(name, {} if name in _COUNTS_BY_NAME else 0)
        by_name = value if name in _COUNTS_BY_NAME else {name: value}
        if not isinstance(by_name, Mapping) or not all(map(_is_count, by_name.values())):
            raise ValueError(f"{name} in its statistics is {shown(value)}, expected numbers from 0 on")


def _is_number(value: object) -> TypeGuard[float]:
    """Return True for a finite number, which JSON's true and false are not."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _is_count(value: object) -> bool:
    return _is_number(value) and value >= 0


def _check_names(metadata: FilmMetadata) -> None:
    """Raise ValueError if the names of shapes and materials are inconsistent."""
    shapes, materials, of = metadata.shape_names, metadata.material_names, metadata.shape_materials
    if len(shapes) != len(of):
        raise ValueError("its names of shapes and materials are not as many texts")
    if not all(0 <= number < len(materials) for number in of):
        raise ValueError(f"its shapes are of materials {shown(of[:20])}, of which it names {len(materials)}")


def _plain_values(value: object) -> bool:
    """Return True if a value consists of texts, finite numbers, lists of finite numbers, and mappings of these."""
    if isinstance(value, Mapping):
        return all(map(_plain_values, value.values()))
    if isinstance(value, list):
        return all(isinstance(one, int | float) and abs(one) < 1e300 for one in value)
    return isinstance(value, str) or (isinstance(value, int | float) and abs(value) < 1e300)


def joined(ours: str, theirs: str) -> str:
    """Return the union of two sets of names; each text has its names joined by " + "."""
    return " + ".join(sorted({*ours.split(" + "), *theirs.split(" + ")} - {""}))


def merged_values(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> dict[str, Any]:
    """Return merged values: numbers and lists of numbers are added, mappings merged, differing texts joined."""
    merged = dict(ours)
    for key, value in theirs.items():
        # All parts of a render have the same bias probe, so equal probes are not added.
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
    """Return the fields that prevent merging: (name, our value, their value), as texts.

    The list is empty if films of both can be merged.
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
    """Return a value as text for a message, cut to 200 characters."""
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 200 else text[:197] + "..."
