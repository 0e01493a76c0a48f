"""Runs the validator of Khronos on a file."""

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

#: Messages to ignore: every reader makes tangents of normal maps and brushes by the same rule (MikkTSpace).
ALLOWED = {"MESH_PRIMITIVE_GENERATED_TANGENT_SPACE"}


def judged(path: Path) -> list[Any]:
    """Return the validator's errors and warnings, except those in ALLOWED."""
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
