"""Model files: shapes with their own materials and textures, and lights and cameras if the format has them.

A model becomes a scene (`scene_of_model`) or a part of one (`assets`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from glpath.errors import UsageError, warn
from glpath.io.completed import NO_CAMERA, RESOLUTION, completed
from glpath.io.gltf import Model, ModelCamera, read_gltf
from glpath.io.gltf.accessors import Accessors
from glpath.io.gltf.choices import animation_lengths, animation_names, variant_names
from glpath.io.gltf.document import SUFFIXES as GLTF_FORMATS
from glpath.io.gltf.document import read_document
from glpath.io.gltf.lights import camera_of
from glpath.io.gltf.load import OpenFile
from glpath.io.gltf.nodes import Nodes
from glpath.io.mesh_models import read_mesh_model
from glpath.io.meshes import FORMATS as MESH_FORMATS
from glpath.io.up_axis import LYING, Up
from glpath.scene.camera_check import check_camera
from glpath.scene.model import Camera, Scene, Shapes
from glpath.scene.source_location import SourceLocation
from glpath.system.numerals import unsigned
from glpath.system.units import Unit

#: Suffixes of files that are read as models.
FORMATS = (*GLTF_FORMATS, *MESH_FORMATS)


def read_gltf_as_asked(
    path: Path,
    *,
    camera: Annotated[
        int | str,
        Meta(
            description="name or number, from 0, of one of the file's cameras, or first, or none to see all of it"
        ),
    ] = "first",
    time: Annotated[
        Annotated[float, Meta(ge=0)] | Literal["rest"],
        Meta(description="seconds into the file's animations, from 0, or rest"),
    ] = "rest",
    shutter: Annotated[float, Meta(ge=0, description="seconds, from time on, for which the shutter is open")] = 0.0,
    animation: Annotated[
        str,
        Meta(description="name or number, from 0, of the one of the file's animations that runs, or first, or all"),
    ] = "first",
    variant: Annotated[
        str, Meta(description="name or number, from 0, of one of the file's variants of materials, or none")
    ] = "none",
    light_factor: Annotated[
        float,
        Meta(
            ge=0,
            description="a number from 0, the factor of punctual lights; 1/683, 0.00146, for Blender's",
        ),
    ] = 1.0,
    unit: Annotated[
        Unit,
        Meta(description="photometric (cd, lx, cd/m2) or radiometric, what the file's numbers of light are"),
    ] = "photometric",
    backs: Annotated[
        Literal["absent", "black"],
        Meta(description="absent, as in viewers, or black: of materials that are not doubleSided"),
    ] = "absent",
) -> Model:
    """Return the model of a .gltf or .glb with the parameters that users give; see `load_scene`."""
    wanted: int | str | None = None if camera in ("first", "none") else camera
    if isinstance(wanted, str) and (number := unsigned(wanted)) is not None:
        wanted = number
    if animation != "first" and time == "rest":
        time = 0.0
    if shutter and time == "rest":
        raise UsageError(f"shutter is {shutter:g}, but the model is at rest.", "Say when it opens: -D time=0.")
    model = read_gltf(
        path,
        time=None if time == "rest" else time,
        shutter=shutter,
        camera=wanted,
        animation=None if animation == "first" else animation,
        variant=None if variant == "none" else variant,
        light_factor=light_factor,
        unit=unit,
        backs=backs,
    )
    return replace(model, camera=None) if camera == "none" else model


def read_mesh_model_as_asked(path: Path, *, up: Up = "guess") -> Scene:
    """Return the scene of a file of `MESH_FORMATS` with the parameters that users give; see `load_scene`."""
    return scene_of_model(read_mesh_model(path, SourceLocation(str(path))), up=up)


def read_model(
    path: Path,
    location: SourceLocation,
    time: float | None = None,
    shutter: float = 0.0,
    open_files: dict[Path, OpenFile] | None = None,
) -> Model:
    """Return the model of a file of `FORMATS` that is named at `location`. Raises SceneError.

    time, shutter, open_files : see `read_gltf`
    """
    if path.suffix.lower() in GLTF_FORMATS:
        return read_gltf(path, time=time, shutter=shutter, open_files=open_files)
    return read_mesh_model(path, location)


def gltf_cameras(path: Path) -> tuple[str, ...]:
    """Return the names of the cameras, in the order in which the parameter `camera` counts. Raises SceneError."""
    document = read_document(path)
    nodes = Nodes.of(document, {})
    found = (camera_of(document, nodes.tables[index], nodes.world[index]) for index in nodes.drawn)
    return tuple(camera.name for camera in found if camera is not None)


def gltf_animations(path: Path) -> tuple[tuple[str, float], ...]:
    """Return the name and the length in seconds of each animation. Raises SceneError."""
    document = read_document(path)
    return tuple(zip(animation_names(document), animation_lengths(document, Accessors(document)), strict=True))


def gltf_variants(path: Path) -> tuple[str, ...]:
    """Return the names of the material variants. Raises SceneError."""
    return variant_names(read_document(path))


def scene_of_model(model: Model, up: Up = "y") -> Scene:
    """Return a model as a scene, with missing parts added.

    up : up axis of a model without a camera, or "guess"

    Raises SceneError; warns of added parts and of parts that are not used.
    """
    location = SourceLocation(model.source)
    if not model.shapes:
        raise location.error("has no triangles, so there is nothing to see.", "Export the file with its meshes.")
    for note in model.notes:
        warn(f"{model.source}: not used: {note}")
    scene = Scene(
        name=model.name,
        camera=replace(NO_CAMERA if model.camera is None else _camera(model.camera), shutter=model.shutter),
        shapes=Shapes(model.shapes),
        materials=model.materials,
        source=model.source,
        textures=model.textures,
        lights=model.lights,
        sky=model.sky,
        unit=model.unit or "radiometric",
        animation_times=model.shutter if model.animated else None,
    )
    if model.camera is not None:
        check_camera(scene.camera, location)
    lying = Path(model.source).suffix.lower() in LYING
    return completed(scene, has_camera=model.camera is not None, glow_is_light=False, up=up, lying=lying)


def _camera(given: ModelCamera) -> Camera:
    """Return the camera with a resolution: the longer side of `RESOLUTION`, and the other side from the aspect."""
    longest = max(RESOLUTION)
    aspect = given.aspect or 1.0
    width, height = (longest, longest / aspect) if aspect >= 1 else (longest * aspect, longest)
    size = max(1, round(width)), max(1, round(height))
    return Camera(
        given.position,
        given.target,
        np.asarray(given.up),
        given.fov,
        size,
        projection=given.projection,
        height=given.height,
        motion=given.motion,
    )
