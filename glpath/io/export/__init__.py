"""Export of scenes to files for other programs: `export`."""

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
from glpath.system.arguments import checked
from glpath.system.files import is_stream

#: Default maximum depth. It stands for all bounces, the default of `glpath.render`, so that Mitsuba computes the
#: same light. Mitsuba ends long paths by Russian roulette.
MAX_DEPTH = 1000
SPP = 64
_MITSUBA, _GLTF = ".xml", ".glb"


@checked
def export(
    scene: AnyScene,
    path: str | Path,
    *,
    parameters: Mapping[str, object] | None = None,
    max_depth: int | None = None,
    spp: int | None = None,
) -> None:
    """Write a scene to a file for other programs.

    The triangles are those that path tracing renders, spheres included; lengths are in scene units. Light in .glb
    is in cd, lx and cd m^-2, with 179 lumens per watt. Light in .xml has the same values as in the scene, whether
    these are radiometric or photometric. Features that the format lacks are approximated or left out, with a
    SceneWarning.

    scene      : a scene in any form that `glpath.load_scene` takes
    path       : .xml for Mitsuba 3, with a folder NAME_files beside it for meshes (PLY) and images (PNG, EXR).
                 Camera, box filter, resolution and depth are set so that `mitsuba NAME.xml` renders the same image
                 as glpath. .glb for any program that reads glTF 2.0: metallic-roughness materials with the Khronos
                 extensions that they need, lights, the camera. The axis nearest to the camera's up is turned to y
    parameters : parameters of a generated scene
    max_depth  : for .xml: maximum number of path vertices as in `glpath.render`; 1 is direct light only. The
                 default, 1000, stands for all bounces
    spp        : for .xml: samples per pixel; 64 by default

    Raises UsageError for another suffix or a number out of range. Raises SceneError for a scene that cannot be read
    or turned into triangles, and ImageError if a file cannot be written. A file is written whole or not at all.

    >>> export("cornell-box-36", "box.glb")
    >>> export("cornell-box-36", "box.xml", max_depth=3, spp=256)
    """
    check_export(path, max_depth, spp)
    exported(load_scene(scene, parameters), path, max_depth, spp)


def exported(scene: Scene, path: str | Path, max_depth: int | None, spp: int | None) -> None:
    """Write a scene whose parameters have been checked; see `export`."""
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
    """Return True if the file suffix is that of Mitsuba scenes."""
    return Path(path).suffix.lower() == _MITSUBA


def check_export(path: str | Path, max_depth: int | None, spp: int | None) -> None:
    """Raise UsageError for an unknown file format, or for numbers that the format cannot store."""
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
