"""What Khronos's validator says of a file."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.support import npm

VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1]))).then(
    report => console.log(JSON.stringify(report.issues.messages.filter(each => each.severity < 2))));
"""

#: Tangents of normal maps and brushes are those that every reader makes by the same rule (MikkTSpace).
ALLOWED = {"MESH_PRIMITIVE_GENERATED_TANGENT_SPACE"}


def judged(path: Path) -> list[Any]:
    """Errors and warnings of the Khronos validator, but for what is ALLOWED."""
    if shutil.which("node") is None:
        pytest.skip("needs node")
    if npm.package("gltf-validator") is None:
        pytest.skip("needs npm's gltf-validator: NODE_PATH=FOLDER/node_modules, or install it here")
    environment = os.environ | {"NODE_PATH": os.pathsep.join(map(str, npm.folders()))}
    done = subprocess.run(
        ["node", "-e", VALIDATE, str(path)], env=environment, capture_output=True, text=True, check=True
    )
    found: list[Any] = [each for each in json.loads(done.stdout) if each["code"] not in ALLOWED]
    return found
