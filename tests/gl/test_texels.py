"""Both ways of reading texels, llvmpipe's and that of graphics cards, give the same bits: gl/texels.glsl."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from glpath.errors import ShaderError
from glpath.gl.context import get_context
from glpath.gl.program import load_program
from tests.support.repository import ROOT

#: Of every engine, and every structure of the papers.
NAMES = (
    "path-cornell-box-36-crop",
    "gather-cornell-box-36",
    "t-buffer-three-spheres",
    "t-buffer-three-spheres-cube",
    "classic-three-spheres-sphere",
    "t-buffer-stacked-triangles",
    "path-environment",
    "path-buffer-environment",
    "t-buffer-environment",
)

HASHES = """
import json, sys
from tests.support.hashed_films import film_hash, film_of
print(json.dumps({name: film_hash(film_of(name)) for name in sys.argv[1:]}))
"""


def hashes_with(texels: str) -> dict[str, str]:
    """Of the films, in a process of its own, as programs are compiled once in a process."""
    result = subprocess.run(
        [sys.executable, "-c", HASHES, *NAMES],
        cwd=ROOT,
        env={**os.environ, "GLPATH_TEXELS": texels},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
    return dict(json.loads(result.stdout.splitlines()[-1]))


def test_films_have_the_same_bits_both_ways() -> None:
    if get_context().info.hardware:
        pytest.skip("llvmpipe's way needs more image units than graphics cards have")
    assert hashes_with("fetch") == hashes_with("image")


def test_a_way_that_does_not_exist_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GLPATH_TEXELS", "guess")
    with pytest.raises(ShaderError, match="GLPATH_TEXELS: there is no 'guess'; allowed are auto, image, fetch"):
        load_program(get_context().gl, vertex="gl/fullscreen.vert", fragment="shadow/point_shadow_cells.frag")
