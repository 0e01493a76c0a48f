"""Types of the JSON that commands write for programs: `--stats` of a render, and lines of `--progress json`.

Their descriptions appear in the reference, so they are written for users.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypedDict

from msgspec import Meta

from glpath.film.choices import INTERRUPTED_RULE, RULES

Window = Annotated[
    tuple[int, int, int, int],
    Meta(description="x, y, width and height in pixels of the whole image; y from the top"),
]
PathSets = Annotated[int, Meta(description="path sets of the film: samples per pixel")]
RelativeError = Annotated[
    float | None, Meta(description="estimate of the relative error of the picture; null where it cannot be known")
]
ErrorBound = Annotated[
    float | None,
    Meta(description="with 95 % confidence the relative error is below this; of a render that measured it"),
]
StopRule = Annotated[
    str,
    Meta(description=f"what ended the render: {', '.join((*RULES, INTERRUPTED_RULE))}; empty of an unfinished one"),
]
Files = Annotated[list[str], Meta(description="the files that were written")]
Bias = Annotated[dict[str, float] | None, Meta(description="bias of a gather, as `Film.bias` has it; else null")]
Seconds = Annotated[float, Meta(description="seconds since the render began, those of a resumed film included")]
Device = Annotated[str, Meta(description="name of the device")]


class MemoryRecord(TypedDict):
    """Memory use of a render, in bytes."""

    peak_resident_bytes: Annotated[int, Meta(description="the most that the process had in memory")]
    film_bytes: Annotated[int, Meta(description="size of the film's arrays")]


class CheckpointRecord(TypedDict):
    """The checkpoint of a render."""

    path: Annotated[str, Meta(description="its file")]
    written: Annotated[int, Meta(description="how often it was written")]
    failure: Annotated[str | None, Meta(description="why the last one could not be written; null where it was")]


class RenderStats(TypedDict):
    """JSON object that `glpath render --stats FILE` writes."""

    scene: Annotated[str, Meta(description="name of the scene")]
    scene_hash: Annotated[str, Meta(description="SHA-256 of the scene's content")]
    integrator: Annotated[str, Meta(description="the integrator that rendered, where `auto` was asked for as well")]
    settings: Annotated[dict[str, Any], Meta(description="all that decides the image besides scene and window")]
    window: Window
    path_sets: PathSets
    path_sets_before: Annotated[int, Meta(description="of these, path sets of the film that was resumed")]
    ranges: Annotated[
        tuple[tuple[int, int], ...],
        Meta(description="the numbers of the path sets, as half-open ranges [start, stop]"),
    ]
    stop_rule: StopRule
    relative_error: RelativeError
    error_bound: ErrorBound
    bias: Bias
    elapsed_s: Seconds
    stage_ms: Annotated[dict[str, float], Meta(description="milliseconds of the device by stage, of all path sets")]
    counts: Annotated[Mapping[str, Any], Meta(description="what the engine counted, by name")]
    memory: MemoryRecord
    device: Device
    versions: Annotated[Mapping[str, str], Meta(description="of glpath and of what it renders with")]
    checkpoint: Annotated[CheckpointRecord | None, Meta(description="null without `--checkpoint` and `--resume`")]
    files: Files


class ProgressRecord(TypedDict):
    """A line of `glpath render --progress json`, on standard error."""

    event: Literal["progress"]
    stage: Annotated[str, Meta(description='what is being done, such as "compiling shaders" or "rendering"')]
    done: Annotated[int, Meta(description="path sets that are done")]
    total: Annotated[int, Meta(description="path sets that were asked for")]
    left_s: Annotated[float | None, Meta(description="estimate of the seconds that are left; null at first")]
    error: RelativeError
    renderer: Device
    elapsed_s: Seconds


class EndRecord(TypedDict):
    """The last line of `glpath render --progress json`, on standard error."""

    event: Literal["done", "interrupted"]
    path_sets: PathSets
    elapsed_s: Seconds
    error: RelativeError
    stop_rule: StopRule
    error_bound: ErrorBound
    bias: Bias
    renderer: Device
    statistics: Annotated[Mapping[str, Any], Meta(description="what the engine counted, by name")]
    files: Files
