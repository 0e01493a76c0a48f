"""What is imported is declared: somebody else's dependency may be gone with its next version."""

from __future__ import annotations

import ast
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.repository import ROOT

# Imported for us by others: trimesh reads what is not UTF-8 with the one, imageio reads PNGs with the other.
FOR_LIBRARIES = {"charset-normalizer", "pillow"}


def imported(folder: Path) -> set[str]:
    """Top-level modules that are imported anywhere in a folder's code, but the standard library's."""
    names = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module.partition(".")[0])
    return names - sys.stdlib_module_names - {"glpath"}


def declared() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    texts = [
        *project["dependencies"],
        *(each for extra in project["optional-dependencies"].values() for each in extra),
    ]
    return {canonicalize_name(Requirement(text).name) for text in texts}


def test_every_import_is_declared() -> None:
    homes = packages_distributions()
    missing = {
        name: homes.get(name)
        for name in imported(ROOT / "glpath")
        if not {canonicalize_name(home) for home in homes.get(name, [name])} & declared()
    }
    assert missing == {}


def test_what_libraries_import_for_us_is_declared() -> None:
    assert declared() >= FOR_LIBRARIES
