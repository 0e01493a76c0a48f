"""Assembly of a scene from an XML file of Mitsuba."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import msgspec

from glpath.errors import warn
from glpath.io.completed import NO_CAMERA, completed
from glpath.io.convert import convert
from glpath.io.mitsuba.camera import Clips, camera_of, clipping_notes
from glpath.io.mitsuba.document import read_document
from glpath.io.mitsuba.lights import Emitters
from glpath.io.mitsuba.plugin import Plugin
from glpath.io.mitsuba.shapes import Reader
from glpath.io.mitsuba.surfaces import BsdfReader
from glpath.io.mitsuba.textures import Textures
from glpath.io.up_axis import Up
from glpath.scene.background import Background
from glpath.scene.camera_check import check_camera
from glpath.scene.model import Scene, Shapes
from glpath.scene.source_location import SourceLocation

# Skipped tags: definitions, which are read through references, and render settings, which are options of
# `glpath render` instead.
_ASIDE = ("bsdf", "texture", "medium", "integrator", "film", "sampler", "rfilter", "spectrum")


def read_mitsuba(path: Path, parameters: Mapping[str, object] | None = None) -> Scene:
    """Read the scene of an XML file of Mitsuba; see `glpath.io.mitsuba`.

    parameters : values that replace the file's `<default>`s. `up`, if the file has no parameter of that name, is
                 the up axis for the camera that replaces a missing sensor

    Raises SceneError, with the line, for unsupported contents. Warns of differences from Mitsuba, and of the camera
    or light that replaces a missing one.
    """
    location = SourceLocation(str(path))
    given = dict(parameters or {})
    document = read_document(path, given, others=("up",))
    up: Up = "guess"
    if "up" in given and "up" not in document.defaults:
        up = _up(given["up"], location.field("up"))
    textures = Textures()
    surfaces = BsdfReader(textures)
    reader, emitters, camera, clips = Reader(surfaces, textures), Emitters(), None, Clips()
    hides_emitters = ignores_media = False
    for child in document.root.children:
        element = document.resolved(child)
        if element.tag == "shape":
            reader.add(Plugin(element, document))
        elif element.tag == "emitter" and element.attributes.get("type") == "area" and element.attributes.get("id"):
            continue  # a definition to which shapes refer
        elif element.tag == "emitter":
            emitters.add(Plugin(element, document))
        elif element.tag == "sensor" and camera is None:
            camera, clips = camera_of(Plugin(element, document))
        elif element.tag == "sensor":
            emitters.notes["of several sensors the first is taken"] = None
        elif element.tag == "integrator":
            integrator = Plugin(element, document)
            ignores_media = integrator.kind == "path"
            hides_emitters = _hides_emitters(integrator, {})
        elif element.tag not in _ASIDE:
            allowed = ", ".join(("shape", "emitter", "sensor", *_ASIDE))
            raise element.location.error(f"is an element of a scene that is not read. Allowed: {allowed}.")
    reader.finish()
    if not reader.shapes:
        raise location.error("has no shapes, so there is nothing to see.", 'Add a <shape type="sphere"/>.')
    if hides_emitters and any(shape.emits for shape in reader.shapes):
        emitters.notes["`hide_emitters` is not read: the camera sees the area lights"] = None
    if ignores_media and any(material.attenuation.any() for material in surfaces.materials):
        surfaces.notes["Mitsuba's `path` leaves out media, which absorb light here"] = None
    for note in (*surfaces.notes, *emitters.notes, *reader.notes):
        warn(f"{path}: {note}.")
    for text in textures.files.notes():
        warn(f"{path}: not used: {text}")
    scene = Scene(
        name=path.stem,
        camera=NO_CAMERA if camera is None else camera,
        shapes=Shapes(reader.shapes),
        materials=tuple(surfaces.materials),
        source=str(path),
        textures=tuple(textures.textures),
        lights=tuple(emitters.lights),
        sky=emitters.sky,
        background=Background(transparent=True) if hides_emitters and emitters.sky is not None else None,
    )
    if camera is not None:
        check_camera(scene.camera, location)
        for note in clipping_notes(clips, scene):
            warn(f"{path}: {note}.")
        if up != "guess":
            raise location.field("up").error(
                "is for files without a camera, but this one has a sensor.", "Turn its camera by its `to_world`."
            )
    return replace(completed(scene, has_camera=camera is not None, up=up), source=str(path))


def _up(value: object, location: SourceLocation) -> Up:
    try:
        found: Up = convert(value, Up, strict=False)
    except msgspec.ValidationError as error:
        raise location.wrong(value, "one of: x, y, z, -x, -y, -z, guess") from error
    return found


def _hides_emitters(integrator: Plugin, results: dict[int, bool]) -> bool:
    """Return True if an integrator, or one inside it, hides emitters from the camera.

    results : results by the id of the element, because many `<ref>`s may refer to one integrator
    """
    key = id(integrator.element)
    if key not in results:
        inside = [_hides_emitters(each, results) for each in integrator.nested("integrator")]
        results[key] = integrator.flag("hide_emitters", False) or any(inside)
    return results[key]
