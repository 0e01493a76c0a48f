"""Packages of npm: `make evidence` puts them into .venv/lib/node_modules, where npm is there.

Else NODE_PATH=FOLDER/node_modules names a folder of them, or they are installed in the folder where tests run.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path


def folders() -> list[Path]:
    """Where packages are looked for, the first first."""
    named = [Path(each) for each in os.environ.get("NODE_PATH", "").split(os.pathsep) if each]
    return [*named, Path(sys.prefix, "lib", "node_modules"), Path("node_modules").absolute()]


def package(name: str) -> Path | None:
    """Where a package is; None where it is not."""
    return next((folder / name for folder in folders() if (folder / name / "package.json").is_file()), None)
