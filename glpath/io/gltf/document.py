"""glTF file: JSON and buffers of a .gltf or .glb, and access to the files that it names.

msgspec decodes the JSON to plain values. Each value is checked when it is read (`Table`), so that an error names
its location.

Source: Khronos Group, glTF 2.0 specification, 3.6 (buffers, URIs), 4 (the GLB container).
"""

from __future__ import annotations

import base64
import binascii
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import msgspec
from numpy.typing import NDArray

from glpath.io.convert import decode_json
from glpath.io.gltf import compression, limits
from glpath.io.gltf.material_extensions import LAYERS, UNUSED_MATERIALS
from glpath.io.gltf.table import Table, Tables, printable
from glpath.io.named_files import NamedFiles, UnusableError, named_file
from glpath.io.values import nearby_files
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.files import absence_of, read_bytes, reason_of
from glpath.system.npz import UnfoldedPictures
from glpath.system.suggestions import listed_names

SUFFIXES = (".gltf", ".glb")
#: Extensions that are read.
KNOWN_EXTENSIONS = (
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    *LAYERS,
)
#: Extensions that are ignored, with a description of what the image then lacks. Files that require them are still
#: read.
UNUSED_EXTENSIONS = {
    "KHR_animation_pointer": "animations of other things than nodes",
    **UNUSED_MATERIALS,
}
# Extensions that change nothing in an image, so files that require them are read without a note.
_WITHOUT_EFFECT = ("EXT_instance_features", "EXT_mesh_features", "EXT_structural_metadata", "KHR_xmp_json_ld")
# URI scheme. It has at least two letters, because a single letter is a Windows drive.
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):")
_JSON, _BIN = 0x4E4F534A, 0x004E4942


@dataclass
class Notes:
    """Notes on unused contents of the file, without duplicates, in the order found."""

    texts: dict[str, None] = field(default_factory=dict)

    def add(self, text: str) -> None:
        self.texts[text] = None


@dataclass
class Document:
    """Open glTF file.

    root     : root object of the JSON
    folder   : folder at which relative paths start and which they must not leave
    binary   : BIN chunk of a .glb
    stored   : number of bytes of the file, and of the files read so far that it names, each counted once
    files    : named files that were found elsewhere, and images that are not used
    unfolded : sizes of the images that were decoded
    decoded  : number of bytes that were decoded
    images   : decoded images by index
    """

    root: Table
    location: SourceLocation
    folder: Path
    binary: bytes | None
    stored: int = 0
    notes: Notes = field(default_factory=Notes)
    files: NamedFiles = field(default_factory=NamedFiles)
    unfolded: UnfoldedPictures = field(default_factory=UnfoldedPictures)
    decoded: int = 0
    images: dict[int, NDArray[Any]] = field(default_factory=dict)
    _buffers: dict[int, bytes] = field(default_factory=dict)
    _contents: dict[str, bytes] = field(default_factory=dict)  # by real path
    _counted: set[str] = field(default_factory=set)  # real paths of the files in `stored`
    _views: dict[int, memoryview] = field(default_factory=dict)
    _lists: dict[str, Tables] = field(default_factory=dict)

    def all(self, name: str) -> Tables:
        """Return the list in field `name` of the root object, such as "nodes" or "meshes"."""
        if name not in self._lists:
            self._lists[name] = self.root.tables(name)
        return self._lists[name]

    def allowed(self, low: int, per_byte: int, high: int) -> int:
        """Return the limit for this file: `per_byte` times its bytes, at least `low` and at most `high`."""
        return min(max(low, per_byte * self.stored), high)

    def take(self, size: int, location: SourceLocation) -> None:
        """Count bytes that are about to be decoded. Raises SceneError if the total exceeds the limits."""
        self.decoded += size
        allowed = self.allowed(limits.ALWAYS_DECODED_BYTES, limits.MAX_DECODED_RATIO, limits.MAX_DECODED_BYTES)
        if self.decoded > allowed:
            raise location.error(
                f"needs {size:,} bytes of memory, with what came before {self.decoded:,}, but files of "
                f"{self.stored:,} bytes may unfold to {allowed:,}.",
                "Simplify the model, or split it into several files.",
            )

    def buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            self._buffers[index] = self._read_buffer(index)
        return self._buffers[index]

    def _read_buffer(self, index: int) -> bytes:
        table = self.all("buffers")[index]
        length = table.required("byteLength", 1, limits.MAX_FILE_BYTES)
        uri = table.text("uri")
        if uri is not None:
            data = self.resolve(uri, table.location.field("uri"))
        elif index == 0 and self.binary is not None:
            data = self.binary
        else:
            raise table.location.error(
                "has no `uri`, and the file has no binary chunk for it.",
                "A .glb holds one buffer, the first; every other one names a file or holds its data.",
            )
        if len(data) < length:
            raise table.location.field("byteLength").error(
                f"is {length:,}, but the data has {len(data):,} bytes.",
                "The file is cut off, or was written wrongly.",
            )
        return data

    def view(self, index: int) -> memoryview:
        """Return the bytes of a buffer view, decompressed if necessary."""
        if index not in self._views:
            self._views[index] = self._read_view(self.all("bufferViews")[index])
        return self._views[index]

    def _read_view(self, table: Table) -> memoryview:
        for name in compression.MESHOPT:
            packed = table.extension(name)
            if packed is not None:
                fallback = self._fallback(table)
                if fallback is not None:
                    return fallback
                self.take(packed.required("count") * packed.required("byteStride", 1, 256), packed.location)
                return compression.meshopt(packed, self._slice(packed), name)
        return self._slice(table)

    def _fallback(self, table: Table) -> memoryview | None:
        """Return the uncompressed bytes of a compressed view; None if the file does not have them."""
        buffers = self.all("buffers")
        index = table.required_index("buffer", buffers, "buffers")
        buffer = buffers[index]
        fallback = any(buffer.extension(name) is not None for name in compression.MESHOPT)
        if "uri" not in buffer and (fallback or index > 0 or self.binary is None):
            return None
        return self._slice(table)

    def _slice(self, table: Table) -> memoryview:
        index = table.required_index("buffer", self.all("buffers"), "buffers")
        data = self.buffer(index)
        offset, length = table.integer("byteOffset", 0), table.required("byteLength", 1)
        if offset + length > len(data):
            raise table.location.error(
                f"reaches from byte {offset:,} to {offset + length:,}, but buffers[{index}] has {len(data):,}.",
                "The file is cut off, or was written wrongly.",
            )
        return memoryview(data)[offset : offset + length]

    def resolve(self, uri: str, location: SourceLocation, *, is_picture: bool = False) -> bytes:
        """Return the bytes of a URI: data, or a file in the folder of the model. Raises SceneError.

        is_picture : True if a file of the same base name in another folder may replace a missing one
        """
        if uri[:5].lower() == "data:":
            return _data(uri, location)
        name = _file_name(uri, location)
        try:
            path = self.files.find(self.folder, name) if is_picture else named_file(self.folder, name)
        except UnusableError as error:
            near = nearby_files("Files", self.folder / Path(name).name, {Path(name).suffix.lower()})
            raise location.error(f"names {shown(name)}, {error}.", near) from error
        if not is_picture and path != self.folder / name.replace("\\", "/"):
            self.notes.add(f"The case of letters in {shown(name)}: {path.name} is read.")
        real = os.path.realpath(path)
        content = self._contents.get(real)
        if content is None:
            content = read_file(path, location)
        if real not in self._counted:
            self._counted.add(real)
            self.stored += len(content)
        if not is_picture:  # a picture's bytes are not needed once it is decoded
            self._contents[real] = content
        return content

    def lacks_picture(self, uri: str, location: SourceLocation) -> bool:
        """Return True if a URI's file cannot be used, and note it in `files`. Raises SceneError for a wrong URI."""
        if uri[:5].lower() == "data:":
            return False
        name = _file_name(uri, location)
        try:
            self.files.find(self.folder, name)
        except UnusableError as error:
            self.files.unusable[name] = str(error)
            return True
        return False


def _file_name(uri: str, location: SourceLocation) -> str:
    """Return the file name in a URI. Raises SceneError for a URL, and for a name that is not UTF-8."""
    if scheme := _SCHEME.match(uri):
        raise location.error(
            f"is a URL of the scheme {scheme[1]}, but must be data: or the name of a file beside the model.",
            "Nothing is fetched from elsewhere: put the file into the model's folder.",
        )
    try:
        return unquote_to_bytes(uri).decode("utf-8")
    except UnicodeError as error:
        raise location.wrong(uri, "a file name in UTF-8") from error


def read_document(path: Path) -> Document:
    """Open a .gltf or .glb. Raises SceneError if it is missing or broken, or requires an unknown extension."""
    location = SourceLocation(str(path))
    if not os.path.isfile(path):
        raise location.error(f"{absence_of(path)}.", nearby_files("Models", path, SUFFIXES))
    content = read_file(path, location)
    text, binary = _chunks(content, location) if content[:4] == b"glTF" else (content, None)
    root = Table(_decoded(text, location), location)
    document = Document(root, location, path.parent, binary, len(content))
    _check_version(root)
    _check_extensions(document)
    for name, max_count in (("nodes", limits.MAX_NODES), ("accessors", limits.MAX_ACCESSORS)):
        if len(document.all(name)) > max_count:
            raise location.field(name).error(
                f"has {len(document.all(name)):,} entries; at most {max_count:,} are read."
            )
    return document


def read_file(path: Path, location: SourceLocation) -> bytes:
    """Return the bytes of a file. Raises SceneError if there are too many or the file cannot be read."""
    try:
        return read_bytes(path, limits.MAX_FILE_BYTES)
    except OSError as error:
        raise location.error(f"cannot be read: {reason_of(error)}.") from error


def _chunks(content: bytes, location: SourceLocation) -> tuple[bytes, bytes | None]:
    broken = "The file is cut off, or was written wrongly."
    if len(content) < 20:
        raise location.error(f"is a .glb of {len(content)} bytes, less than its header has.", broken)
    version, length = (int.from_bytes(content[at : at + 4], "little") for at in (4, 8))
    if version != 2:
        raise location.error(
            f"is a .glb of version {version}, but version 2 is read.", "Convert it, e.g. by opening it in Blender."
        )
    if length > len(content):
        raise location.error(f"says that it has {length:,} bytes, but has {len(content):,}.", broken)
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = (int.from_bytes(content[i : i + 4], "little") for i in (at, at + 4))
        if at + 8 + size > length:
            raise location.error(
                f"has a chunk at byte {at:,} that says it has {size:,} bytes, but {length - at - 8:,} are left.",
                broken,
            )
        if not found and kind != _JSON:
            raise location.error("is a .glb whose first chunk is not JSON.", broken)
        found.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    if _JSON not in found:
        raise location.error("is a .glb without JSON.", broken)
    return found[_JSON], found.get(_BIN)


def _decoded(text: bytes, location: SourceLocation) -> dict[str, Any]:
    """Return the JSON as plain values. Raises SceneError if it has too many values or too many levels."""
    values = text.count(b",") + text.count(b"[") + text.count(b"{")
    if values > limits.MAX_JSON_VALUES:
        raise location.error(
            f"holds JSON of more than {limits.MAX_JSON_VALUES:,} values.", "Put large data into buffers."
        )
    if text[:3] == b"\xef\xbb\xbf":
        text = text[3:]
    deep = f"holds JSON nested more than {limits.MAX_JSON_DEPTH} deep."
    try:
        root: dict[str, Any] = decode_json(text.rstrip(b"\0"), dict[str, Any])
    except RecursionError:
        raise location.error(deep) from None
    except (msgspec.DecodeError, UnicodeError) as error:
        raise location.error(
            f"cannot be read as glTF: {error}.", "It is neither JSON nor a .glb, or is cut off."
        ) from error
    level: list[Any] = [root]
    for _ in range(limits.MAX_JSON_DEPTH):
        inside = [value.values() if isinstance(value, dict) else value for value in level]
        level = [child for values in inside for child in values if isinstance(child, dict | list)]
        if not level:
            return root
    raise location.error(deep)


def _check_version(root: Table) -> None:
    asset = root.table("asset")
    version, min_version = str(asset.values.get("version", "")), asset.text("minVersion") or "2.0"
    if not version.startswith("2.") or not min_version.startswith("2.0"):
        needed = version if not version.startswith("2.") else min_version
        raise asset.location.field("version").error(
            f"is {needed!r}, but glTF 2.0 is read.", "Convert the file, e.g. by opening it in Blender."
        )


def _check_extensions(document: Document) -> None:
    root = document.root
    required, used = root.texts("extensionsRequired"), root.texts("extensionsUsed")
    readable = {*KNOWN_EXTENSIONS, *UNUSED_EXTENSIONS, *_WITHOUT_EFFECT}
    unknown = [name for name in required if name not in readable]
    if unknown:
        raise root.location.field("extensionsRequired").error(
            f"names {listed_names(map(printable, unknown))}, not known here.",
            "Export the file without it. Known: " + ", ".join(sorted(KNOWN_EXTENSIONS)) + ".",
        )
    names = dict.fromkeys([*used, *required])
    others = sorted(printable(name) for name in names if name not in readable)
    if others:
        document.notes.add(f"The extension{'s' * (len(others) > 1)} {listed_names(others)}.")
    for name in names:
        if name in UNUSED_EXTENSIONS:
            document.notes.add(f"{UNUSED_EXTENSIONS[name][0].upper()}{UNUSED_EXTENSIONS[name][1:]} ({name}).")


def _data(uri: str, location: SourceLocation) -> bytes:
    head, comma, body = uri[5:].partition(",")
    if not comma:
        raise location.error("is a data: URI without data.", "The file is cut off, or was written wrongly.")
    try:
        if not head.lower().endswith(";base64"):
            return unquote_to_bytes(body)
        content = b"".join((unquote_to_bytes(body) if "%" in body else body.encode("ascii")).split())
        return base64.b64decode(content + b"=" * (-len(content) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise location.error(f"is a data: URI that is not base64: {error}.") from error
