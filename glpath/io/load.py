"""Read a scene file or a dictionary as a `Scene`.

tomllib parses the TOML, msgspec converts it to typed data, and `build` makes the scene. This module rewords errors
of msgspec in terms of the scene format. A reworded error has the location, such as `file: shapes[3].material`, the
value found, the values allowed, and the description of the field as the remedy.
"""

from __future__ import annotations

import errno
import functools
import operator
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np
from msgspec import inspect

from glpath.errors import SceneError
from glpath.io.build import Supplied, build
from glpath.io.completed import NO_CAMERA, completed, is_aside
from glpath.io.convert import convert
from glpath.io.description import AnyLight, AnyMaterial, AnyShape, SceneFile, Sky
from glpath.io.description.camera import AnyCamera, Film
from glpath.io.meshes import MESH_KEYS, is_kind, mesh_of_table
from glpath.io.other_files import meant_by
from glpath.io.streams import Chunks
from glpath.io.up_axis import Up
from glpath.io.values import CHECK_PERMISSIONS, LARGEST
from glpath.scene.camera import framing
from glpath.scene.model import Float64, Mesh, Scene
from glpath.scene.source_location import PythonLocation, SourceLocation, shown
from glpath.system.arguments import checked, short_repr
from glpath.system.files import MAX_TEXT_BYTES, absence_of, is_denied, read_bytes, reason_of
from glpath.system.suggestions import similar_names
from glpath.system.time_limit import check_time

_WORDS = {"float": "a number", "int": "a whole number", "str": "a text in quotes", "bool": "true or false"}
_WORDS |= {"array": "a list", "object": "a table"}
_DEEPEST = 100
# Maximum number of letters of the faulty line that a syntax error shows.
_SHOWN = 120
# Pattern of a dotted key with more than 16 parts, `a.a.a...`. Such a key is rejected, because tomllib takes time
# quadratic in the number of parts of a key and of its header. Possessive quantifiers keep the search linear.
_DEEP_KEY = re.compile(
    r"""(?:^|[{,])[ \t]*+(?:\[{1,2}+[ \t]*+)?+"""
    r"""(?:(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){16}""",
    re.MULTILINE,
)
_LIGHT = ("emission", "emissive", "emission_color", "emissive_color", "radiance", "ke", "light")
# Tables that occur once in a scene file, and their types.
_TABLES = {"film": (Film,), "camera": get_args(AnyCamera), "sky": (Sky,)}
_RELATIONS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}


#: Remedy in the error for a scene file that is too large.
TOO_LARGE = "Put its geometry into models, such as .glb or .ply, and name them in [[assets]]."


def read_scene_file(path: Path, later: float = 0.0, up: Up = "guess") -> Scene:
    """Return the scene of a TOML file. Raises SceneError. A SceneWarning reports triangles without area.

    later : seconds that are added to the shutter times of the file
    up    : up axis for a file without a camera; "guess" uses `up` of the sky if set, else `evidence_for_z`
    """
    location = SourceLocation(str(path))
    # Unlike Path.is_file, os.path.isfile returns False if the name is too long. Pipes are allowed, because <(...)
    # in bash makes one.
    if not (os.path.isfile(path) or (os.path.exists(path) and path.is_fifo())):
        raise location.error(
            "is a folder, not a scene file." if os.path.isdir(path) else f"{absence_of(path, 'no such file')}.",
            _other_files(path),
        )
    try:
        content = read_bytes(path, MAX_TEXT_BYTES)
    except OSError as error:
        remedy = TOO_LARGE if error.errno == errno.EFBIG else ""
        remedy = CHECK_PERMISSIONS if isinstance(error, PermissionError) else remedy
        raise location.error(f"cannot be read: {reason_of(error)}.", remedy) from error
    return scene_from_toml(content, location, path.parent, path.stem, later, up)


def scene_from_toml(
    content: bytes, location: SourceLocation, folder: Path, name: str, later: float = 0.0, up: Up = "guess"
) -> Scene:
    """Return the scene of a scene file's content. Raises SceneError.

    location : location of the whole file, for errors
    folder   : base folder of relative paths
    name     : name of the scene if the file does not set one
    later    : seconds that are added to the shutter times of the file
    up       : up axis for a file without a camera, see `read_scene_file`
    """
    try:
        # Convert line ends to "\n", as text mode does.
        text = content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise location.error(
            f"is not UTF-8 text (byte {error.start}).", "Is it a scene file? Scenes are TOML text."
        ) from error
    try:
        if _DEEP_KEY.search(text):
            raise RecursionError  # because tomllib would take minutes
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(error, text, location) from error
    except RecursionError as error:
        raise _too_deep(location) from error
    except ValueError as error:  # from an integer of thousands of digits
        raise location.error(f"cannot be read: {error}.", "A number needs no more than 17 digits.") from error
    if "camera" not in data:
        check_no_camera_is_needed(data, location)
        camera = {"position": NO_CAMERA.position, "target": NO_CAMERA.target}
        scene = scene_of({**data, "camera": camera}, location, folder, name, later)
        if is_aside("camera"):
            return replace(scene, camera=framing(scene.framed_points, scene.camera.resolution))
        return completed(scene, has_camera=False, up=up_without_camera(data, scene, up))
    if up != "guess":
        raise location.field("up").error(
            "is for files without a camera, but this one has a [camera].", "Turn its camera by `up` in [camera]."
        )
    return scene_of(data, location, folder, name, later)


def check_no_camera_is_needed(data: Mapping[str, Any], location: SourceLocation) -> None:
    """Raise SceneError if a scene's data without a camera has fields that depend on the camera or on its `up`."""

    owner = "dictionary" if isinstance(location, PythonLocation) else "file"

    def needs(field: SourceLocation, what: str, example: list[int]) -> SceneError:
        late = " The camera that replaces the scene's does not set it." if is_aside("view") else ""
        return field.error(
            f"is missing: {what} goes by the camera's `up` without it, and the {owner} has no camera.",
            f"For example {field.setting(example)}, with z up.{late}",
        )

    lights, sky, shapes = data.get("lights"), data.get("sky"), data.get("shapes")
    for index, each in enumerate(shapes if isinstance(shapes, list | tuple) else ()):
        if isinstance(each, Mapping) and "pixels" in each:
            here = location.field("shapes").item(index).field("pixels")
            raise here.error(f"is of a camera's picture, but the {owner} has no camera.", "Give it a camera.")
    for index, each in enumerate(lights if isinstance(lights, list | tuple) else ()):
        if isinstance(each, Mapping) and "profile" in each and "direction" not in each:
            here = location.field("lights").item(index).field("direction")
            raise needs(here, "where the profile's gamma is 0", [0, 0, -1])
    if isinstance(sky, Mapping) and "up" not in sky and not {"file", "horizon", "type"}.isdisjoint(sky):
        raise needs(location.field("sky").field("up"), "where the zenith is", [0, 0, 1])


def up_without_camera(data: Mapping[str, Any], scene: Scene, up: Up = "guess") -> Up | Float64:
    """Return the up axis of a scene whose data has no camera: for "guess", `up` of the sky if the data sets it."""
    sky = data.get("sky")
    of_sky = up == "guess" and isinstance(sky, Mapping) and "up" in sky and scene.sky is not None
    return scene.sky.up if of_sky and scene.sky is not None else up


@checked
def scene_from_dict(
    data: Mapping[str, Any], *, source: str = "scene", folder: str | Path | None = None, name: str | None = None
) -> Scene:
    """Return the scene that a dictionary of the scene format describes; numpy arrays may replace lists.

    Parameters
    ----------
    data   : dictionary as `tomllib` makes it from a scene file
    source : name of the scene in errors and in `Scene.source`
    folder : base folder of relative paths of mesh files; the current folder by default
    name   : name of the scene if `data` does not set one; `source` by default
    """
    return scene_of(data, SourceLocation(source), Path(folder or ""), name or source)


def scene_of(
    data: Mapping[str, Any],
    location: SourceLocation,
    folder: Path,
    name: str,
    later: float = 0.0,
    supplied: Supplied | None = None,
) -> Scene:
    """Return the scene that a dictionary of the scene format describes. Raises SceneError.

    location : location of the whole dictionary, for errors
    folder   : base folder of relative paths
    name     : name of the scene if `data` does not set one
    later    : seconds that are added to the shutter times
    supplied : materials and camera that replace those of the dictionary
    """
    data, meshes = _without_meshes(data, location)
    try:
        plain = _plain(data)
    except RecursionError as error:
        raise _too_deep(location) from error
    keys = _unusable(plain)
    if keys is not None:
        number, here = functools.reduce(operator.getitem, keys, plain), _at_keys(location, keys)
        raise here.wrong(number, f"a finite number between -{LARGEST:g} and {LARGEST:g}")
    _name_default_types(plain)
    try:
        file = convert(plain, SceneFile)
    except msgspec.ValidationError as error:
        raise _explained(error, SceneFile, plain, location) from error
    opened, closed = file.camera.shutter
    file.camera.shutter = (opened + later, closed + later)
    return build(file, location, folder, name, meshes, supplied or Supplied())


def _without_meshes(
    data: Mapping[str, Any], location: SourceLocation
) -> tuple[Mapping[str, Any], dict[int, Mesh | Chunks]]:
    """Return `data` without streams and in-memory meshes, and a dictionary of these by shape index.

    They are taken out because msgspec reads only lists. A million faces as lists need a minute and a gigabyte.
    """
    if not isinstance(data.get("shapes"), list | tuple):
        return data, {}
    known: dict[int, Mesh] = {}  # meshes of trimesh by id(), so that instances share a mesh
    meshes: dict[int, Mesh | Chunks] = {}
    shapes = []
    for index, shape in enumerate(data["shapes"]):
        check_time()
        here = location.field("shapes").item(index)
        if isinstance(shape, Mapping) and is_kind(shape, "stream") and "stream" in shape:
            meshes[index] = shape["stream"]
            shapes.append({key: value for key, value in shape.items() if key != "stream"} | {"type": "stream"})
            continue
        found = mesh_of_table(shape, here, known) if isinstance(shape, Mapping) else None
        if found is not None:
            meshes[index] = found
            shape = {key: value for key, value in shape.items() if key not in MESH_KEYS} | {"type": "mesh"}
        shapes.append(shape)
    return {**data, "shapes": shapes}, meshes


def _plain(value: Any, depth: int = 0) -> Any:
    """Return `value` with numpy arrays, tuples, sets and ranges as lists, and with keys that are text.

    Raises RecursionError if it is nested too deeply.
    """
    if depth > _DEEPEST:
        raise RecursionError
    check_time()
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {_key(key): _plain(item, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset | range):
        return [_plain(item, depth + 1) for item in value]
    return value


def _key(key: object) -> str:
    try:
        return str(key) if isinstance(key, str | int | float) else short_repr(key)
    except Exception:  # `__str__` of a subclass may raise any error
        return short_repr(key)


def _at_keys(location: SourceLocation, keys: Sequence[str | int]) -> SourceLocation:
    for key in keys:
        location = location.item(key) if isinstance(key, int) else location.field(key)
    return location


def _unusable(value: Any) -> list[str | int] | None:
    """Return the keys that lead to the first number that is NaN, infinite or too large; None if all are usable."""
    if isinstance(value, float | int):
        return None if abs(value) <= LARGEST else []
    check_time()
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        rest = _unusable(item)
        if rest is not None:
            return [key, *rest]
    return None


def _keys_of_text(value: Any, text: str) -> list[str | int] | None:
    """Return the keys that lead to a text, which is a value or a key of a dictionary; None if it is absent."""
    if isinstance(value, str):
        return [] if value == text else None
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        rest = [] if key == text else _keys_of_text(item, text)
        if rest is not None:
            return [key, *rest]
    return None


def _name_default_types(data: Any) -> None:
    """Set missing types of materials to "diffuse", of the camera to "perspective"; msgspec has no such defaults."""
    camera = data.get("camera")
    if isinstance(camera, dict):
        camera.setdefault("type", "perspective")
    materials = data.get("materials")
    for material in materials.values() if isinstance(materials, dict) else ():
        if isinstance(material, dict):
            material.setdefault("type", "diffuse")


def _too_deep(location: SourceLocation) -> SceneError:
    return location.error(
        "has tables or lists in each other, a hundred deep or more, or a key of more than 16 parts; a scene needs "
        "five.",
        "`glpath schema` prints the format.",
    )


def _syntax_error(error: tomllib.TOMLDecodeError, text: str, location: SourceLocation) -> SceneError:
    found = re.search(r"^(.*?) \(at (?:line (\d+), column (\d+)|end of document)\)$", str(error))
    if not found:
        return location.error(f"is not valid TOML: {error}.")
    lines = text.splitlines() or [""]
    number = int(found[2] or len(lines))
    column = int(found[3] or len(lines[-1]) + 1)
    line = lines[min(number, len(lines)) - 1]
    first = max(0, column - _SHOWN)
    format_note = ""
    if not location.source.lower().endswith(".toml"):
        where = "A file with another suffix" if os.path.isfile(location.source) else "What comes from a pipe"
        format_note = f"\n{where} is read as a scene file. Save a model in a file with its suffix."
    return SourceLocation(location.source, f"line {number}, column {column}").error(
        f"is not valid TOML: {found[1]}.",
        f"{line[first : first + _SHOWN]}\n{' ' * (column - 1 - first)}^{format_note}",
    )


def _other_files(path: Path) -> str:
    if not os.path.isdir(path.parent):
        return CHECK_PERMISSIONS if is_denied(path) else f"There is no folder {path.parent} either."
    others = [file.name for file in path.parent.glob("*.toml")]
    nearest = similar_names(path.name, others, 8, 0) or sorted(others)[:8] or ["none"]
    return f"Scene files in {path.parent}: {', '.join(nearest)}. `glpath scenes` lists the shipped ones."


# --- Rewording of msgspec's errors in terms of the scene format ---


def _explained(error: msgspec.ValidationError, kind: Any, data: Any, location: SourceLocation) -> SceneError:
    """Return the SceneError for a failed conversion of `data` at `location` to the type `kind`."""
    if isinstance(error.__cause__, UnicodeEncodeError):
        location = _at_keys(location, _keys_of_text(data, error.__cause__.object) or [])
        return location.error(
            "has text with a lone surrogate, which UTF-8 cannot encode.", "Decode the text from bytes as UTF-8."
        )
    text, _, path = str(error).partition(" - at `$")
    keys = re.findall(r"\.(\w+)|\[(\d+|\.\.\.)\]", path)
    declared: Any = inspect.type_info(kind)
    owner, description = declared, ""
    for name, index in keys:
        if index == "...":  # msgspec names the table, but not the entry that fails
            return _first_bad_entry(declared, data, location)
        if name:
            owner = _meant(declared, data)
            declared = _field_type(owner, name)
            description = _description(declared) or description
            data, location = data.get(name) if isinstance(data, dict) else None, location.field(name)
        else:
            declared = getattr(_meant(declared, data), "item_type", None)
            data, location = data[int(index)], location.item(int(index))
    return _in_words(text, _meant(declared, data), owner, data, description, location)


def _in_words(
    text: str, declared: Any, owner: Any, data: Any, description: str, location: SourceLocation
) -> SceneError:
    if found := re.fullmatch(r"Object contains unknown field `(.*)`", text):
        allowed = _field_names(declared)
        return location.field(found[1]).error(
            f"is not a field of {_title(declared)}. Allowed: {', '.join(allowed)}.",
            _instead_of(found[1], declared, allowed),
        )
    if found := re.fullmatch(r"Object missing required field `(.*)`", text):
        missing = found[1]
        about = _description(_field_type(declared, missing))
        if missing == "type":
            about = f"type is one of: {', '.join(_tags(declared))}."
        return location.error(f"lacks the field `{missing}`, which must be there.", about)
    if re.fullmatch(r"Invalid (enum )?value .*", text):
        is_choice = isinstance(declared, inspect.LiteralType)
        tags = [str(each) for each in declared.values] if is_choice else _tags(owner)
        near = similar_names(str(data), tags, 1)
        return location.wrong(data, f"one of: {', '.join(tags)}", f"Did you mean {shown(near[0])}?" if near else "")
    if found := re.fullmatch(r"Expected `([\w |]+)`(?: of length)?(?: ([<>]=?) (\S+)| (\d+))?(?:, got .*)?", text):
        kinds, relation, limit, length = found.groups()
        allowed_text = " or ".join(_WORDS.get(word, word) for word in kinds.split(" | "))
        if length:
            allowed_text = f"a list of {length} {'numbers' if length in '234' else 'values'}"
            return location.error(
                f"is {shown(data)}, a list of {len(data)}, but must be {allowed_text}.", description
            )
        if relation:
            number = f"{float(limit):g}"
            allowed_text += f" {'with a length ' if kinds == 'array' else ''}{_RELATIONS[relation]} {number}"
        return location.wrong(data, allowed_text, description)
    return location.error(f"cannot be used: {text}.", description)


def _instead_of(name: str, declared: Any, allowed: Sequence[str]) -> str:
    """Return the remedy for an unknown field: its name in this format, or the type or table that has the field."""
    if name.lower() in _LIGHT and "reflectance" in allowed:
        return "Light is of shapes: emission = { radiance = [r, g, b] } in a [[shapes]] table."
    if meant := meant_by(name, allowed):
        return f"Did you mean `{meant}`?"
    for union in (AnyMaterial, AnyShape, AnyLight):
        if declared.cls not in get_args(union):
            continue
        for other in map(inspect.type_info, get_args(union)):
            fields = _field_names(other)
            there = name if name in fields else meant_by(name, fields)
            if there:
                return f"`{there}` is a field of the type {shown(other.tag)}."  # type: ignore[attr-defined]
    for table, kinds in _TABLES.items():
        known = {field for kind in kinds for field in _field_names(inspect.type_info(kind))}
        if name in known and declared.cls in (SceneFile, *chain(*_TABLES.values())):
            return f"`{name}` is a field of [{table}]."
    near = similar_names(name, allowed, 1)
    return f"Did you mean `{near[0]}`?" if near else "Remove it, or see `glpath schema` for the format."


def _first_bad_entry(table: Any, data: Any, location: SourceLocation) -> SceneError:
    """Return the SceneError for the first entry of a table, such as `materials`, that fails to convert."""
    each = _meant(table, data).value_type
    kind = str if isinstance(each, inspect.StrType) else functools.reduce(operator.or_, (m.cls for m in each.types))
    for name, value in data.items():
        try:
            convert(value, kind)
        except msgspec.ValidationError as error:
            return _explained(error, kind, value, location.field(name))
    raise AssertionError("msgspec refused a table of which it takes every value")


def _meant(declared: Any, data: Any) -> Any:
    """Return the declared type without its metadata; for a union, the member that `data` was intended for."""
    while isinstance(declared, inspect.Metadata):
        declared = declared.type
    if not isinstance(declared, inspect.UnionType):
        return declared
    members = [_meant(member, data) for member in declared.types]
    if isinstance(data, list):
        return next((member for member in members if isinstance(member, inspect.ListType)), declared)
    structs = [member for member in members if isinstance(member, inspect.StructType)]
    tag = data.get("type") if isinstance(data, dict) else None
    tag = tag if isinstance(tag, str) else None
    return next((member for member in structs if len(structs) == 1 or member.tag == tag), declared)


def _field_type(owner: Any, name: str) -> Any:
    return next((field.type for field in getattr(owner, "fields", ()) if field.encode_name == name), owner)


def _field_names(declared: Any) -> list[str]:
    names = [field.encode_name for field in getattr(declared, "fields", ())]
    return ["type", *names] if getattr(declared, "tag_field", None) else names


def _tags(declared: Any) -> list[str]:
    declared = _meant(declared, None)
    members = declared.types if isinstance(declared, inspect.UnionType) else (declared,)
    return sorted(str(member.tag) for member in members if isinstance(member, inspect.StructType))


def _title(declared: Any) -> str:
    tag = getattr(declared, "tag", None)
    return (
        f"the type {shown(tag)}" if tag else {"SceneFile": "a scene file"}.get(declared.cls.__name__, "this table")
    )


def _description(declared: Any) -> str:
    while isinstance(declared, inspect.Metadata):
        about = (declared.extra_json_schema or {}).get("description")
        if about:
            return str(about)
        declared = declared.type
    if isinstance(declared, inspect.UnionType):
        return next((about for member in declared.types if (about := _description(member))), "")
    return ""
