"""Packages of npm; `make evidence` installs them into .venv/lib/node_modules, if npm is installed.

Otherwise NODE_PATH=FOLDER/node_modules names a folder of them, or they are in the folder where tests run.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path


def folders() -> list[Path]:
    """Return the folders to search for packages, in order."""
    named = [Path(each) for each in os.environ.get("NODE_PATH", "").split(os.pathsep) if each]
    return [*named, Path(sys.prefix, "lib", "node_modules"), Path("node_modules").absolute()]


def package(name: str) -> Path | None:
    """Return the folder of a package; None if it is not installed."""
    return next((folder / name for folder in folders() if (folder / name / "package.json").is_file()), None)
