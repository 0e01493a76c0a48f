"""Photometric files of luminaires: IES LM-63 (.ies) and EULUMDAT (.ldt)."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from glpath.io.eulumdat import parse_eulumdat
from glpath.io.ies import parse_ies
from glpath.io.values import nearby_files
from glpath.scene.profile import LightProfile
from glpath.scene.source_location import SourceLocation
from glpath.system.files import absence_of, read_bytes, reason_of

#: Name and parser of each format, by suffix.
FORMATS: dict[str, tuple[str, Callable[[bytes, Path | str, SourceLocation], LightProfile]]] = {
    ".ies": ("IES LM-63", parse_ies),
    ".ldt": ("EULUMDAT", parse_eulumdat),
}
SUFFIXES = tuple(FORMATS)
#: Maximum size of a photometric file in bytes.
MAX_BYTES = 16 << 20


def read_profile(path: Path, location: SourceLocation) -> LightProfile:
    """Return the profile of a file that a scene names at `location`. Raises and warns as the parser does."""
    if path.suffix.lower() not in SUFFIXES:
        raise location.error(f"names {path}, but a photometric file is one that ends in {' or '.join(SUFFIXES)}.")
    if not os.path.isfile(path):
        raise location.error(
            f"names the file {path}, which {absence_of(path)}.",
            nearby_files("Photometric files", path, SUFFIXES),
        )
    try:
        data = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise location.error(f"names {path}, which cannot be read: {reason_of(error)}.") from error
    return FORMATS[path.suffix.lower()][1](data, path, location)
