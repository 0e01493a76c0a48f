"""Programs that want versions of packages which glpath's neighbours do not: found in this Python or in another one.

Blender's module wants numpy below 2 and one version of Python, so that who has other packages keeps it in a virtual
environment of its own:

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
    """The interpreter that is asked for other programs."""
    return os.environ.get(PYTHON) or sys.executable


@cache
def find_package(name: str, interpreter: str) -> tuple[str, str]:
    """Folder and version of a package of an interpreter, without importing it. GlpathError where there is none."""
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
