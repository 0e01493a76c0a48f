"""Render job: scene, integrator, sensor and path sets as plain data, which can be split and written as JSON.

    job = RenderJob.of("cornell-box", spp=1024)
    parts = job.split(4)                     # on four machines, say, each from its own file
    films = [run(part) for part in parts]    # merged, they equal run(job) if all devices are of one kind

A job identifies its scene by its source and by the SHA-256 of its content, so a changed file gives an error instead
of another image. The job contains the whole camera.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Unpack

import msgspec
from msgspec import Meta

from glpath.errors import SceneError, UsageError, warning_scope
from glpath.film.aovs import AOVS
from glpath.film.batches import BLOCK
from glpath.integrators.by_name import AUTO, INTEGRATORS, IntegratorKeywords
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene, load_scene, shipped_scenes
from glpath.io.completed import aside, camera_replaced
from glpath.io.convert import decode_json
from glpath.rendering.choice import chosen
from glpath.rendering.options import (
    checked,
    numbers,
    settings_fields,
    settings_of,
    whole_numbers,
    with_options,
)
from glpath.sampling import MAX_FIRST_PATH_SET, MAX_SPP
from glpath.scene import Camera, Scene, check_camera
from glpath.scene.camera import framed, with_changes, without_motion
from glpath.scene.choices import PROJECTIONS, Projection
from glpath.scene.geometry import Shapes
from glpath.scene.source_location import SourceLocation
from glpath.sensors.sensor import CameraSensor, PointSensor, Sensor, SensorKey
from glpath.system.arguments import check_count, check_word, short_repr
from glpath.system.arguments import checked as checked_arguments
from glpath.system.files import MAX_TEXT_BYTES, absolute_path, read_bytes, whole_file
from glpath.system.suggestions import listed_names, name_fits, similar_names
from glpath.system.time_limit import preparing

Window = tuple[int, int, int, int]

_FORMAT = "glpath.job"
_VERSION = 1


@dataclass(frozen=True)
class SceneSource:
    """Source of a scene, and the digest of its content.

    kind       : "file", "shipped", or "memory" for a scene made in Python, which must be passed to `run`
    name       : path of the file, name of the shipped scene, or name of the scene in memory
    parameters : parameters of a generated shipped scene, or of a glTF file
    sha256     : digest of geometry, materials and lights, `Scene.digest(camera=False)`
    """

    kind: Literal["file", "shipped", "memory"]
    name: str
    sha256: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: AnyScene, loaded: Scene, parameters: Mapping[str, object] | None) -> SceneSource:
        """Return the source of the scene `loaded`, which `load_scene` has loaded from `scene`."""
        digest = loaded.digest(camera=False)
        if isinstance(scene, str) and scene in shipped_scenes():
            return cls("shipped", scene, digest, dict(parameters or {}))
        if isinstance(scene, str | Path):
            # Absolute, because workers may run in another folder.
            return cls("file", absolute_path(scene), digest, dict(parameters or {}))
        return cls("memory", loaded.name, digest)

    def load(self, given: Scene | None = None) -> Scene:
        """Return the scene `given`; if it is None, load the scene from its source.

        Raises SceneError if the content differs from the digest, and UsageError if a scene in memory is not given.
        """
        if given is None and self.kind == "memory":
            raise UsageError(
                f"job: its scene {self.name!r} was made in memory, and a job holds no geometry.",
                "Pass it: run(job, scene=scene); or make the job from a scene file.",
            )
        loaded = given if given is not None else load_scene(self._address, self.parameters or None)
        found = loaded.digest(camera=False)
        if found != self.sha256:
            raise SceneError(
                f"{self.name}: its content has SHA-256 {found}, but the job was made for {self.sha256}.",
                "Bring back the scene that the job was made for, or make the job again.",
            )
        return loaded

    @property
    def _address(self) -> str | Path:
        return Path(self.name) if self.kind == "file" else self.name


@dataclass(frozen=True)
class RenderJob:
    """Description of one render; equal jobs give equal films on one device.

    scene      : source of the scene, and its digest
    integrator : integrator with its options, an instance from `glpath.integrators.by_name`
    sensor     : sensor on which paths start: the pixels of a camera, or points
    window     : (x, y, width, height) of the rendered pixels in the whole image, y from the top
    path_sets  : (start, stop), half-open range of path sets; a path set is one path per pixel
    strict     : True to raise warnings as errors in each run, see `RunOptions.strict`
    """

    scene: SceneSource
    integrator: IntegratorSettings
    sensor: Sensor
    window: Window
    path_sets: tuple[int, int]
    strict: bool = False

    @classmethod
    @with_options(run=False)
    def of(
        cls,
        scene: AnyScene,
        *,
        integrator: str | IntegratorSettings = AUTO,
        spp: int | None = None,
        first_path_set: int = 0,
        resolution: tuple[int, int] | None = None,
        crop: tuple[int, int, int, int] | None = None,
        camera: Mapping[str, Any] | Camera | None = None,
        parameters: Mapping[str, object] | None = None,
        sensor: PointSensor | None = None,
        strict: bool = False,
        **options: Unpack[IntegratorKeywords],
    ) -> RenderJob:
        """Return the job that `glpath.render` would run with these arguments. Options of a run are not accepted.

        sensor : points on which paths start, instead of the scene's camera
        strict : True to raise warnings as errors, now and in each run of the job

        {options}

        The scene is loaded for its digest and its camera. Raises the errors that `glpath.render` raises before
        rendering.
        """
        with warning_scope(strict):
            job, _ = describe(
                scene,
                integrator=integrator,
                spp=spp,
                first_path_set=first_path_set,
                resolution=resolution,
                crop=crop,
                camera=camera,
                parameters=parameters,
                sensor=sensor,
                **options,
            )
        return replace(job, strict=strict)

    @property
    def spp(self) -> int:
        """Number of path sets."""
        return self.path_sets[1] - self.path_sets[0]

    @checked_arguments
    def seen(self, scene: Scene | None = None) -> Scene:
        """Return the scene, loaded if it is not given, with its camera replaced by that of the job's sensor.

        Raises the errors of `SceneSource.load`, and UsageError if the job has no points for its sensor.
        """
        with _needing(self.sensor):
            loaded = self.scene.load(scene)
        return self.sensor.seen(loaded)

    def split(self, count: int) -> list[RenderJob]:
        """Split the path sets into at most `count` jobs, whose films merge into this job's film, bit for bit.

        The parts end where blocks of 8 path sets end, because points of a Sobol sequence are stratified within a
        block. Therefore a job of few path sets has fewer parts. Raises UsageError for a count below 1.
        """
        check_count("split", count, 1, MAX_SPP)
        start, stop = self.path_sets
        first, last = start // BLOCK, -(-stop // BLOCK)
        count = min(count, last - first)
        edges = [first + (last - first) * i // count for i in range(count + 1)]
        cuts = [start, *(BLOCK * edge for edge in edges[1:-1]), stop]
        return [replace(self, path_sets=ends) for ends in pairwise(cuts)]

    def to_json(self) -> str:
        """Return the job as JSON for `from_json`. Raises UsageError for a radiosity solution in memory."""
        settings = {}
        for name in settings_fields(type(self.integrator)):
            value = getattr(self.integrator, name)
            if not isinstance(value, str | int | float | tuple | Path | None):
                raise UsageError(
                    f"{name}: a job's JSON cannot hold a solution in memory.",
                    "Save it, and give the path of its file.",
                )
            settings[name] = absolute_path(value) if isinstance(value, Path) else value
        return json.dumps(
            {
                "format": _FORMAT,
                "version": _VERSION,
                "scene": asdict(self.scene),
                "integrator": {"name": self.integrator.integrator, **settings},
                "sensor": self.sensor.as_json(),
                "window": self.window,
                "path_sets": self.path_sets,
                "strict": self.strict,
            },
            indent=2,
        )

    @classmethod
    @checked_arguments
    def from_json(cls, text: str, location: str = "job") -> RenderJob:
        """Return the job that `to_json` wrote as `text`; `location` names the text in errors. Raises UsageError."""
        try:
            data: JobFile = decode_json(text, JobFile)
        except (msgspec.DecodeError, RecursionError) as error:
            raise UsageError(f"{location}: is not a render job: {error}.", "RenderJob.save writes one.") from error
        if data.format != _FORMAT or data.version != _VERSION:
            raise UsageError(
                f"{location}: {data.format} of version {data.version}; this version of glpath reads {_FORMAT} of "
                f"version {_VERSION}.",
                "Write it anew: RenderJob.save.",
            )
        given = dict(data.integrator)
        try:
            integrator = given.pop("name", None)
            check_word("integrator name", integrator, tuple(INTEGRATORS))
            kind = INTEGRATORS[integrator]
            for name in given:
                check_word(f"setting of {integrator}", name, tuple(settings_fields(kind)))
            sensor = _sensor_of(data.sensor, location)
            window = window_of(sensor.resolution, data.window, "window")
            start, stop = data.path_sets
            check_count("path_sets, the first", start, 0, MAX_FIRST_PATH_SET)
            check_count("path_sets, how many", stop - start, 1, MAX_SPP)
            settings = checked(kind(**given))
            check_sensor(settings, sensor)
        except UsageError as error:
            raise UsageError(f"{location}: {error.message}", error.remedy) from error
        return cls(data.scene, settings, sensor, window, data.path_sets, data.strict)

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write the JSON to a file atomically. Raises ImageError if it cannot be written."""
        with whole_file(path) as part:
            part.write_text(self.to_json() + "\n", "utf-8")

    @classmethod
    @checked_arguments
    def load(cls, path: str | Path) -> RenderJob:
        """Read a file that `save` wrote. Raises UsageError."""
        try:
            text = read_bytes(path, MAX_TEXT_BYTES).decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
            raise UsageError(f"{path}: cannot be read as a render job: {reason}.") from error
        return cls.from_json(text, str(path))


class CameraFile(msgspec.Struct, forbid_unknown_fields=True, tag="camera"):
    """Camera sensor in a job file, with lengths in scene units, angles in degrees and times in seconds."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float
    resolution: tuple[Annotated[int, Meta(ge=1)], Annotated[int, Meta(ge=1)]]
    projection: Projection = "perspective"
    height: float = 1.0
    aperture_radius: float = 0.0
    focus_distance: float | None = None
    shutter: tuple[float, float] = (0.0, 0.0)
    motion: tuple[SensorKey, ...] = ()
    principal_point: tuple[float, float] = (0.5, 0.5)
    pixel_aspect: float = 1.0


class PointsFile(msgspec.Struct, forbid_unknown_fields=True, tag="points"):
    """Sensor of points in a job file: their number and SHA-256 only. `run` gets the points themselves."""

    resolution: tuple[Annotated[int, Meta(ge=1)], Annotated[int, Meta(ge=1)]]
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
    count: Annotated[int, Meta(ge=1)]
    middle: tuple[float, float, float]
    tables: Annotated[int, Meta(ge=1)] = 1
    smooth: bool = False
    shutter: tuple[float, float] = (0.0, 0.0)
    independent: bool = False


class JobFile(msgspec.Struct, forbid_unknown_fields=True):
    """Structure of a job file; fields of the integrator are checked separately."""

    format: str
    version: int
    scene: SceneSource
    integrator: dict[str, Any]
    sensor: CameraFile | PointsFile
    window: Window
    path_sets: tuple[int, int]
    strict: bool = False


def describe(
    scene: AnyScene,
    *,
    integrator: str | IntegratorSettings = AUTO,
    spp: int | None = None,
    first_path_set: int = 0,
    resolution: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    camera: Mapping[str, Any] | Camera | None = None,
    parameters: Mapping[str, object] | None = None,
    sensor: PointSensor | None = None,
    **options: Unpack[IntegratorKeywords],
) -> tuple[RenderJob, Scene]:
    """Return the job for these arguments of `render`, and the loaded scene with its camera. Raises GlpathError.

    sensor : points on which paths start, instead of the scene's camera

    `glpath.rendering.choice` resolves the integrator "auto".
    """
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    if integrator != AUTO:
        settings_of(integrator, given)  # checked before the scene is loaded, which may take long
    if spp is not None:
        check_count("spp", spp, 1, MAX_SPP)
    check_count("first_path_set", first_path_set, 0, MAX_FIRST_PATH_SET)
    with _needing(sensor), camera_replaced(camera):
        loaded = load_scene(scene, parameters)
    starts: Sensor
    if sensor is None:
        loaded = with_overrides(loaded, resolution, camera)
        starts = CameraSensor.of(loaded.camera)
        settings = with_alpha(chosen(integrator, given, loaded, math.prod(starts.resolution)), loaded)
    else:
        if resolution is not None or camera is not None:
            name = "camera" if resolution is None else "resolution"
            raise UsageError(f"{name}: has no meaning for a sensor of points.")
        settings = chosen(integrator, given, loaded)
        check_sensor(settings, sensor)
        loaded, starts = sensor.seen(loaded), sensor
    spp = settings.default_spp if spp is None else spp
    window = window_of(starts.resolution, crop)
    with preparing():
        source = SceneSource.of(scene, loaded, parameters)
    path_sets = (int(first_path_set), int(first_path_set) + int(spp))
    return RenderJob(source, settings, starts, window, path_sets), loaded


def with_alpha(settings: IntegratorSettings, scene: Scene) -> IntegratorSettings:
    """Return the settings with the AOV depth, from which alpha is computed, if the background is transparent."""
    if scene.background is None or not scene.background.transparent:
        return settings
    aovs = {*settings.aovs, "depth"}
    return replace(settings, aovs=tuple(name for name in AOVS if name in aovs))


def _needing(sensor: Sensor | None) -> AbstractContextManager[None]:
    """Return the context in which the scene for a sensor is loaded.

    For points, a missing camera gives no warning, and missing light is replaced by a white sky instead of a studio.
    """
    return aside("camera", "picture") if isinstance(sensor, PointSensor) else nullcontext()


def check_sensor(settings: IntegratorSettings, sensor: Sensor) -> None:
    """Raise UsageError if the integrator does not support the sensor."""
    if isinstance(sensor, PointSensor):
        settings.check_points()


def _sensor_of(data: CameraFile | PointsFile, location: str) -> Sensor:
    given = msgspec.structs.asdict(data)
    if isinstance(data, PointsFile):
        return PointSensor(**given)
    sensor = CameraSensor(**given)
    check_camera(sensor.camera, location)
    return sensor


#: Number of components of each camera field that may be replaced.
_CAMERA_NUMBERS = {
    "position": 3,
    "target": 3,
    "up": 3,
    "fov": 1,
    "height": 1,
    "aperture_radius": 1,
    "focus_distance": 1,
    "shutter": 2,
    "principal_point": 2,
    "pixel_aspect": 1,
}
# Projection to which a camera field belongs, for fields of one projection. `check_camera` checks `aperture_radius`,
# because the value 0 turns the scene's lens off for all projections.
_PROJECTION_OF: dict[str, Projection] = {
    "fov": "perspective",
    "focus_distance": "perspective",
    "height": "orthographic",
}


def with_overrides(
    scene: Scene,
    resolution: tuple[int, int] | None,
    camera: Mapping[str, Any] | Camera | None,
    location: SourceLocation | None = None,
) -> Scene:
    """Return the scene with its camera, or fields of its camera, replaced.

    location : location of the camera for errors; None for the source of the scene

    Raises UsageError, and SceneError for an impossible camera.
    """
    changes: dict[str, Any] = {}
    source = location or scene.source or scene.name
    if isinstance(camera, Camera):
        check_camera(camera, source)
        scene, camera = scene.with_camera(camera), {"type": camera.projection}
    elif not isinstance(camera, Mapping | None):
        raise UsageError(
            f"camera: {short_repr(camera)} where a Camera, or a dictionary of what to replace of it, is needed"
        )
    for name, value in (camera or {}).items():
        if name == "look_at":
            continue
        if name == "type":
            check_word("camera type", value, PROJECTIONS)
            changes["projection"] = value
            continue
        if name not in _CAMERA_NUMBERS:
            allowed = ", ".join(["look_at", "type", *_CAMERA_NUMBERS])
            raise UsageError(f"camera: no field is named {short_repr(name)}; allowed are {allowed}")
        count = _CAMERA_NUMBERS[name]
        found = numbers(f"camera {name}", value, count)
        changes[name] = found if count == 3 else tuple(map(float, found)) if count == 2 else float(found[0])
    if resolution is not None:
        width, height = whole_numbers("resolution", resolution, 2)
        changes["resolution"] = (width, height)
    if changes:
        check_camera(with_changes(scene.camera, changes), source)  # before `Scene`, whose errors have no location
        _check_projection(scene.camera, changes, "look_at" in (camera or {}) and "position" not in changes, source)
    changed = scene.with_camera(**changes) if changes else scene
    if (looked_at := (camera or {}).get("look_at")) is not None:
        changed = _looking_at(changed, looked_at, changes)
    return changed


def _check_projection(
    camera: Camera, changes: Mapping[str, Any], is_framed: bool, source: str | SourceLocation
) -> None:
    """Raise SceneError for fields of another projection, and for a projection that lacks its field.

    camera    : camera before the changes
    is_framed : True if the height of an orthographic camera is computed later
    """
    projection = changes.get("projection", camera.projection)
    location = (SourceLocation(source) if isinstance(source, str) else source).field("camera")
    for name in changes:
        if _PROJECTION_OF.get(name, projection) != projection:
            raise location.field(name).error(
                f"is given, but a camera of type {projection} has none.", "Leave it out, or choose another type."
            )
    new = projection == "orthographic" != camera.projection
    if new and not is_framed and "height" not in changes:
        height = location.field("height")
        raise height.error(
            "is missing: it is the height of the whole image of an orthographic camera, in scene units.",
            f"For example {height.setting(2)}.",
        )


def _looking_at(scene: Scene, name: Any, changes: Mapping[str, Any]) -> Scene:
    """Return the scene with its camera moved so that the named shapes fill the image.

    The camera keeps its direction. If `changes` has a position, the camera stays there and is turned instead.

    name    : name of shapes, with or without the part before the last slash; * matches any letters
    changes : replaced fields of the camera

    Raises UsageError.
    """
    if "target" in changes:
        raise UsageError("camera look_at beside a target: both give the direction.", "Leave one out.")
    shapes = [
        s for s in scene.shapes if any(name_fits(each, str(name)) for each in (s.name, s.name.rpartition("/")[2]))
    ]
    if not shapes:
        names = list(dict.fromkeys(shape.name for shape in scene.shapes))
        near = similar_names(str(name), names, 1, 0.4)
        remedy = f'Did you mean "{near[0]}"?' if near else f"Its shapes are {listed_names(names)}."
        source = scene.source or scene.name
        raise UsageError(f'camera look_at: no shape of {source} has the name "{name}".', remedy)
    opened = scene.camera.shutter[0]
    points = replace(scene.at(opened), shapes=Shapes(shapes)).framed_points
    if "position" in changes:
        return scene.with_camera(target=0.5 * (points.min(axis=0) + points.max(axis=0)))
    if scene.camera.projection == "panorama":
        raise UsageError("camera look_at: a panorama looks all around.", "Give it a position.")
    return scene.with_camera(framed(without_motion(scene.camera), points))


def window_of(resolution: tuple[int, int], crop: tuple[int, int, int, int] | None, name: str = "crop") -> Window:
    """Return the window to render: the whole image or the crop. Raises UsageError for a crop outside the image."""
    width, height = resolution
    if crop is None:
        return 0, 0, width, height
    x, y, w, h = whole_numbers(name, crop, 4)
    if w < 1 or h < 1 or x < 0 or y < 0 or x + w > width or y + h > height:
        raise UsageError(
            f"{name}: {w} x {h} pixels from ({x}, {y}) of an image of {width} x {height}",
            f"The {name} is x, y, width, height in pixels, from the top left, and lies inside the image.",
        )
    return x, y, w, h
