"""Versions of the packages that contribute to an image or a measurement."""

from __future__ import annotations

import importlib.metadata
from functools import cache


def versions(*packages: str) -> dict[str, str]:
    """Return the version of each installed package by name; missing packages are left out."""
    found = {package: _version(package) for package in packages}
    return {package: version for package, version in found.items() if version is not None}


@cache
def _version(package: str) -> str | None:
    """Return the version of a package or None; cached, because a search takes milliseconds."""
    try:
        return importlib.metadata.version(package)
    except (importlib.metadata.PackageNotFoundError, KeyError):  # KeyError for damaged metadata
        return None
