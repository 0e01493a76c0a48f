"""What llvmpipe gets rewritten is what the shader says: the same values, and no program falls back unnoticed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath.gl.program as program
from glpath.gl import llvmpipe
from glpath.gl.context import get_context
from glpath.gl.passes import Pass
from tests.support.hashed_films import FILMS, film_of

UNIFORMS = """// a.frag: every kind of uniform, in a branch.
struct Fields {
    float part;  // a field may be called as a uniform is
    int i;
};
uniform int i;
uniform float part;  // not i
uniform uint u;
uniform ivec3 v;
uniform vec2 many[VIEWS];
uniform float by_its_own_name[3];
uniform bool b;
layout(location = 0) out vec4 o;
void main()
{
    o = vec4(0.0);
    Fields fields = Fields(part, i);
    if (gl_FragCoord.x < 3.0 && b) {
        o = vec4(float(fields.i) + fields.part, float(u - 4000000000u), float(v.z) + many[1].y, by_its_own_name[2]);
    }
}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "gl").mkdir()
    (tmp_path / "gl/fullscreen.vert").write_text((program.shader_folder() / "gl/fullscreen.vert").read_text())
    monkeypatch.setattr(program, "shader_folder", lambda: tmp_path)
    return tmp_path


def drawn_with(drawn: program.Program) -> NDArray[np.float32]:
    """(4, 4, 4) what a pass over 4 x 4 texels leaves."""
    gl = get_context().gl
    target = gl.framebuffer([gl.texture((4, 4), 4, dtype="f4")])
    drawing = Pass("test", gl, drawn, target)
    drawing.run(dict(drawn._values))
    return np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(4, 4, 4)


@pytest.mark.parametrize("texels", ["image", "fetch"])
def test_uniforms_have_their_values_however_they_come(
    folder: Path, monkeypatch: pytest.MonkeyPatch, texels: str
) -> None:
    monkeypatch.setenv("GLPATH_TEXELS", texels)
    gl = get_context().gl
    (folder / "a.frag").write_text(UNIFORMS)
    drawn = program.load_program(gl, vertex="gl/fullscreen.vert", fragment="a.frag", defines={"VIEWS": 2})
    drawn.set(
        {
            "i": -7,
            "part": 0.25,
            "u": 4000000003,
            "v": (1, 2, -(2**24)),
            "many": [(0.0, 0.0), (0.0, 1.0)],
            "by_its_own_name": [0.0, 0.0, 9.5],
            "b": True,
        }
    )
    assert drawn_with(drawn)[2, 1].tolist() == [-6.75, 3.0, 1.0 - 2.0**24, 9.5]


def test_what_is_more_than_inputs_may_be_stays_a_uniform(folder: Path) -> None:
    """Handed on, these would end the process: the driver overruns its stack."""
    names = [f"a{i}" for i in range(80)]
    lines = [f"uniform vec4 {name};" for name in names]
    body = " + ".join(f"{name} * {i + 1}.0" for i, name in enumerate(names))
    (folder / "a.frag").write_text("\n".join([*lines, "out vec4 o;", f"void main() {{ o = {body}; }}"]))
    drawn = program.load_program(get_context().gl, vertex="gl/fullscreen.vert", fragment="a.frag")
    drawn.set({name: (float(i == 79), 0.0, 0.0, 0.0) for i, name in enumerate(names)})
    assert drawn_with(drawn)[0, 0, 0] == 80.0


@pytest.mark.skipif(not llvmpipe.is_spoken(get_context().gl), reason="another driver, whose uniforms stay uniforms")
@pytest.mark.parametrize(
    "names",
    [["path-mixed", "t-buffer-mixed"], pytest.param(list(FILMS), marks=pytest.mark.evidence)],
    ids=["two films", "all films"],
)
def test_all_uniforms_of_ours_are_handed_on(names: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is not would only be slower, and nobody would know."""
    handed, left = [], []

    class Watched(llvmpipe.HandedOn):
        def fragment(self, line: str) -> str:
            made = super().fragment(line)
            uniform = llvmpipe._UNIFORM.match(line)
            if self._found and self._conditions.kept and uniform and not uniform["array"] and made == line:
                left.append(line)
            return made

        def vertex(self, text: str) -> str:
            handed.append(self._left)
            return super().vertex(text)

    monkeypatch.setattr(llvmpipe, "HandedOn", Watched)
    for name in names:
        film_of(name, spp=1)
    assert len(handed) > len(names)
    assert not left
