"""What a sample may be: everything else is dropped and counted, and no pixel is spoilt by it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import glpath.gl.program as program
from glpath.gl.context import get_context
from glpath.gl.passes import Pass
from glpath.gl.sums import PixelSums

SAMPLES = [0.75, 0.0, -0.0, -1e-13, -0.25, -1e30, np.nan, np.inf, -np.inf, 1e30]


def test_negative_and_infinite_samples_are_dropped_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shaders = tmp_path / "shaders"
    shutil.copytree(program.shader_folder(), shaders)
    (shaders / "a.frag").write_text("""
        #include "film/accumulate.glsl"
        uniform sampler2D samples;
        void main()
        {
            ivec2 pixel = ivec2(gl_FragCoord.xy);
            accumulate(pixel, vec4(0.5, texelFetch(samples, pixel, 0).r, 0.25, 3.0));
        }
    """)
    monkeypatch.setattr(program, "shader_folder", lambda: shaders)
    gl = get_context().gl
    size = (len(SAMPLES), 1)
    sums = PixelSums(gl, size, 1.0)
    samples = gl.texture(size, 1, data=np.array(SAMPLES, np.float32).tobytes(), dtype="f4")
    drawn = program.load_program(gl, vertex="gl/fullscreen.vert", fragment="a.frag")
    add = sums.sets.each(
        lambda read, write: Pass("add", gl, drawn, write.target, textures={**read.textures, "samples": samples})
    )
    for _ in range(2):
        add.now.run({"quanta": sums.quanta})
        sums.path_set_added()
    taken = sums.take()
    # What rounds to nothing is nothing, whatever its sign.
    good = np.array([True] * 4 + [False] * 6)
    np.testing.assert_array_equal(taken.radiance[0, good], 2 * np.array([[0.5, s, 0.25] for s in (0.75, 0, 0, 0)]))
    np.testing.assert_array_equal(taken.radiance[0, ~good], 0.0)
    np.testing.assert_array_equal(taken.high[0] >> 20, np.where(good, 0, 2))
    np.testing.assert_array_equal(taken.low[0], 6)
