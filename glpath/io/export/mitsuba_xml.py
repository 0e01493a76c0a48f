"""Writer of scenes for Mitsuba 3 as XML, with a folder of meshes (PLY) and images (PNG, EXR) beside it.

The XML is written last, and the names of the other files contain digests of their contents. So an XML, even an
overwritten one, never refers to files of another export.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from glpath.errors import ImageError
from glpath.film.exr import write_exr
from glpath.film.image import encode_png
from glpath.io.export.mitsuba import MitsubaScene
from glpath.io.export.mitsuba_surfaces import Plugin
from glpath.scene.geometry import Mesh
from glpath.scene.source_location import shown
from glpath.system.files import replacing_links, whole_file, write_bytes

# Version of the format, which Mitsuba 3 reads without conversion.
_VERSION = "3.0.0"
_TAGS = {
    "bsdf": "diffuse twosided conductor roughconductor plastic roughplastic principled dielectric roughdielectric "
    "thindielectric blendbsdf normalmap mask",
    "emitter": "area point spot projector directional constant envmap",
    "texture": "bitmap mesh_attribute",
    "shape": "ply shapegroup instance",
    "integrator": "path volpath",
    "sampler": "independent multijitter",
    "sensor": "perspective orthographic thinlens",
    "film": "hdrfilm",
    "rfilter": "box",
    "medium": "homogeneous",
}
_TAG_OF = {plugin: tag for tag, plugins in _TAGS.items() for plugin in plugins.split()}
_DIGITS = 8


def files_folder(path: Path) -> Path:
    """Return the folder of the meshes and images that an XML file names: room_files for room.xml."""
    return path.with_name(f"{path.stem}_files")


def write_xml(translated: MitsubaScene, path: Path) -> None:
    """Write the XML to `path`, and its meshes and images to the folder `files_folder(path)`.

    Raises ImageError, also for a name that is not UTF-8 or that holds $, because the XML names the folder.
    """
    if "$" in path.name:
        raise ImageError(f"{path}: its name holds $, which begins a parameter in Mitsuba's XML.", "Choose another.")
    try:
        path.name.encode()
    except UnicodeEncodeError as error:
        raise ImageError(f"{path}: its name is not UTF-8 text, as names in XML are.", "Choose another.") from error
    folder = files_folder(path)
    if folder.is_symlink():
        raise ImageError(
            f"{folder}: is a symbolic link; the files of {path.name} need a folder of their own.",
            "Remove the link, or choose another name for the .xml.",
        )
    writer = _Writer(folder)
    scene = ElementTree.Element("scene", version=_VERSION)
    if any(translated.origin):
        scene.append(ElementTree.Comment(f" All is relative to {shown(translated.origin)}. "))
    with replacing_links():
        for name, value in translated.plugins.items():
            if name != "type":
                writer.put(scene, name, value, identified=True)
    ElementTree.indent(scene)
    text = ElementTree.tostring(scene, encoding="unicode", xml_declaration=False)
    write_bytes(f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'.encode(), path)


class _Writer:
    """Writer of XML elements for plugins, and of the files that they name."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def put(self, parent: ElementTree.Element, name: str, value: Any, *, identified: bool = False) -> None:
        """Add a parameter or a plugin to an element. identified: True if others refer to it by its name."""
        if isinstance(value, np.ndarray):
            transform = ElementTree.SubElement(parent, "transform", name=name)
            ElementTree.SubElement(transform, "matrix", value=_numbers(value.ravel()))
        elif not isinstance(value, dict):
            ElementTree.SubElement(parent, _kind(value), name=name, value=_text(value))
        elif value["type"] == "rgb":
            ElementTree.SubElement(parent, "rgb", name=name, value=_numbers(value["value"]))
        elif value["type"] == "ref":
            ElementTree.SubElement(parent, "ref", name=name, id=value["id"])
        else:
            plugin = dict(self._as_files(value))
            kind = plugin.pop("type")
            label = {"id" if identified else "name": name}
            element = ElementTree.SubElement(parent, _TAG_OF[kind], {"type": kind, **label})
            for key, each in plugin.items():
                self.put(element, key, each)

    def _as_files(self, plugin: Plugin) -> Iterator[tuple[str, Any]]:
        """Yield the plugin's items, with file names instead of meshes and images."""
        for key, value in plugin.items():
            if key == "type" and value == "mesh":
                yield key, "ply"
            elif key == "mesh":
                yield "filename", self._file(plugin["name"], ".ply", ply(value))
            elif key == "image":
                yield "filename", self._image(plugin["name"], value)
            elif key != "name" or plugin["type"] == "mesh_attribute":
                yield key, value

    def _image(self, name: str, image: Any) -> str:
        if image.dtype == np.uint8:
            return self._file(name, ".png", encode_png(image))
        stem = _stem(name, image.tobytes() + str(image.shape).encode())
        write_exr(self._folder / f"{stem}.exr", np.broadcast_to(image, (*image.shape[:2], 3)))
        return f"{self._folder.name}/{stem}.exr"

    def _file(self, name: str, suffix: str, content: bytes) -> str:
        file = f"{_stem(name, content)}{suffix}"
        with whole_file(self._folder / file) as temporary:
            temporary.write_bytes(content)
        return f"{self._folder.name}/{file}"


def ply(mesh: Mesh) -> bytes:
    """Return triangles as binary PLY in single precision, the precision of Mitsuba."""
    columns = {"xyz": mesh.vertices, "normal": mesh.normals, "uv": mesh.uv, "rgb": mesh.colours}
    letters = {"xyz": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "uv": ("u", "v"), "rgb": ("r", "g", "b")}
    names = [letter for key, values in columns.items() if values is not None for letter in letters[key]]
    parts = [values[:, : len(letters[key])] for key, values in columns.items() if values is not None]
    faces = np.empty(len(mesh.faces), [("corners", "u1"), ("vertices", "<i4", 3)])
    faces["corners"], faces["vertices"] = 3, mesh.faces
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(mesh.vertices)}",
        *(f"property float {name}" for name in names),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(lines).encode() + np.concatenate(parts, axis=1).astype("<f4").tobytes() + faces.tobytes()


def _stem(name: str, content: bytes) -> str:
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:80] or "unnamed"
    return f"{plain}-{hashlib.sha256(content).hexdigest()[:_DIGITS]}"


def _kind(value: object) -> str:
    return {bool: "boolean", int: "integer", float: "float", str: "string"}.get(type(value), "point")


def _text(value: Any) -> str:
    if isinstance(value, list):
        return _numbers(value)
    return str(value).lower() if isinstance(value, bool) else value if isinstance(value, str) else repr(value)


def _numbers(values: Any) -> str:
    return " ".join(repr(float(v)) for v in values)
