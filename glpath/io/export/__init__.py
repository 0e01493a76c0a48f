"""Scenes for other programs, as files: `export`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from glpath.errors import UsageError, warn
from glpath.io.export.gltf import write_gltf
from glpath.io.export.mitsuba import described
from glpath.io.export.mitsuba_xml import write_xml
from glpath.io.from_python import AnyScene
from glpath.io.library import load_scene
from glpath.scene.model import Scene
from glpath.system.files import is_stream

#: `glpath.render`'s default, all bounces: the XML asks Mitsuba for the same light, which ends paths by roulette.
MAX_DEPTH = 1000
SPP = 64
_MITSUBA, _GLTF = ".xml", ".glb"


def export(
    scene: AnyScene,
    path: str | Path,
    *,
    parameters: Mapping[str, object] | None = None,
    max_depth: int | None = None,
    spp: int | None = None,
) -> None:
    """Write a scene for other programs, to compare with them or to move there.

    The triangles are those that path tracing renders, spheres included; lengths are in scene units. Light is in cd,
    lx and cd m^-2 in .glb, watts being 179 lumens; in .xml its numbers are those of the scene, of either unit. What
    the format does not know is approximated or left out, with a SceneWarning.

    scene      : as `glpath.load_scene` takes it
    path       : .xml for Mitsuba 3, with a folder NAME_files beside it of meshes (PLY) and images (PNG, EXR);
                 camera, box filter, resolution and depth are set so that `mitsuba NAME.xml` makes the picture that
                 glpath does. .glb for any program that reads glTF 2.0: materials of metal and roughness with the
                 Khronos extensions that they need, lights, the camera; the axis nearest to the camera's up is
                 turned to y
    parameters : of a generated scene
    max_depth  : of .xml: vertices of a path as in `glpath.render`, 1 is direct light only; by
                 default 1000, all bounces
    spp        : of .xml: samples per pixel; 64 by default

    Raises UsageError for another suffix or a number out of range, SceneError for a scene that cannot be read or
    made triangles of, and ImageError where a file cannot be written. A file appears whole or not at all.

    >>> export("cornell-box-36", "box.glb")
    >>> export("cornell-box-36", "box.xml", max_depth=3, spp=256)
    """
    check_export(path, max_depth, spp)
    exported(load_scene(scene, parameters), path, max_depth, spp)


def exported(scene: Scene, path: str | Path, max_depth: int | None, spp: int | None) -> None:
    """`export` of what has been checked."""
    path = Path(path)
    if is_for_mitsuba(path):
        translated = described(scene, max_depth or MAX_DEPTH, spp=spp or SPP)
        write_xml(translated, path)
        differences = translated.differences
    else:
        differences = write_gltf(scene, path)
    for text in differences:
        warn(f"{path}: {text}.", late=True)


def is_for_mitsuba(path: str | Path) -> bool:
    """By its suffix."""
    return Path(path).suffix.lower() == _MITSUBA


def check_export(path: str | Path, max_depth: int | None, spp: int | None) -> None:
    """Raise UsageError for an unknown file format, and for numbers that the format does not hold."""
    suffix = Path(path).suffix.lower()
    if suffix not in (_MITSUBA, _GLTF):
        raise UsageError(
            f"{path}: a scene is exported as {_MITSUBA} (Mitsuba 3) or {_GLTF} (glTF 2.0).",
            "For example -o scene.glb.",
        )
    if suffix == _MITSUBA and is_stream(path):
        raise UsageError(f"{path}: an {_MITSUBA} has files beside it, so it cannot be written into a pipe.")
    for name, value in (("max_depth", max_depth), ("spp", spp)):
        if value is None:
            continue
        if suffix == _GLTF:
            raise UsageError(f"{path}: glTF has no field for {name}.", f"Leave it out, or write {_MITSUBA}.")
        if not isinstance(value, int) or value < 1:
            raise UsageError(f"{name} is {value}; must be a whole number, at least 1.")
