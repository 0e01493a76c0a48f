"""Versions of the programs that take part in a picture or a measurement."""

from __future__ import annotations

import importlib.metadata
from functools import cache


def versions(*packages: str) -> dict[str, str]:
    """Name and version of each installed package; those that are absent are left out."""
    found = {package: _version(package) for package in packages}
    return {package: version for package, version in found.items() if version is not None}


@cache
def _version(package: str) -> str | None:
    """Looked up once in a process, as a look through all that is installed takes milliseconds."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
