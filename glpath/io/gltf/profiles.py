"""Photometric profiles of a document: EXT_lights_ies.

In the node's own frame, gamma = 0 is along -z and C = 0 along +x; C grows from x towards y.

Source: EXT_lights_ies.
"""

from __future__ import annotations

from glpath.io.gltf.document import Document
from glpath.io.gltf.table import Table
from glpath.io.ies import parse_ies
from glpath.io.photometry import MAX_BYTES
from glpath.scene.profile import LightProfile

NAME = "EXT_lights_ies"


class Profiles:
    """Profiles of a document, each read once when a lamp refers to it."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._found: dict[int, LightProfile] = {}

    def of(self, extension: Table) -> LightProfile:
        """Return the profile that a node's extension names. Raises SceneError."""
        root = self._document.root.extension(NAME)
        every = (root or Table({}, self._document.location)).tables("lights")
        index = extension.required_index("light", every, "lights")
        if index not in self._found:
            self._found[index] = self._read(every[index])
        return self._found[index]

    def _read(self, table: Table) -> LightProfile:
        uri = table.text("uri")
        if uri is not None:
            location = table.location.field("uri")
            data, name = self._document.resolve(uri, location), "data" if uri[:5].lower() == "data:" else uri
        else:
            location = table.location.field("bufferView")
            views = self._document.all("bufferViews")
            number = table.required_index("bufferView", views, "buffer views")
            data, name = bytes(self._document.view(number)), f"bufferViews[{number}]"
        if len(data) > MAX_BYTES:
            raise location.error(f"has {len(data):,} bytes; a photometric file has at most {MAX_BYTES:,}.")
        profile = parse_ies(data, name, location)
        self._document.take(profile.candela.nbytes, location)
        return profile
