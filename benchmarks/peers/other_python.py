"""Finds programs whose packages conflict with glpath's, in this Python or in another one.

Blender's module needs numpy below 2 and one version of Python, so it usually needs a separate virtual environment:

    python3.11 -m venv peers && peers/bin/pip install bpy pyradiance pyviewfactor
    GLPATH_PEERS_PYTHON=peers/bin/python python -m benchmarks bench gather
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache

from glpath.errors import GlpathError

PYTHON = "GLPATH_PEERS_PYTHON"

_FIND = """
import importlib.metadata, importlib.util, json, sys
spec = importlib.util.find_spec(sys.argv[1])
print(json.dumps(spec and [spec.submodule_search_locations[0], importlib.metadata.version(sys.argv[1])]))
"""


def python() -> str:
    """Return the interpreter in which other programs are searched."""
    return os.environ.get(PYTHON) or sys.executable


@cache
def find_package(name: str, interpreter: str) -> tuple[str, str]:
    """Find folder and version of an interpreter's package without importing it. Raises GlpathError if missing."""
    try:
        done = subprocess.run(
            [interpreter, "-c", _FIND, name], stdin=subprocess.DEVNULL, capture_output=True, timeout=60, check=True
        )
        found = json.loads(done.stdout)
    except (OSError, subprocess.SubprocessError, ValueError) as error:
        raise GlpathError(f"{PYTHON} {interpreter}: does not run as a Python ({error}).", "Name one.") from error
    if found is None:
        raise GlpathError(
            f"{name} is not installed for {interpreter}; it is needed only as a peer.",
            f"pip install glpath[peers], or name a Python that has it: {PYTHON}=/path/to/bin/python",
        )
    folder, version = found
    return folder, version
