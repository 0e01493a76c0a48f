"""Shader files: includes are flattened once, and an error names the file and line it is in."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import glpath.gl.program as program
from glpath.errors import ShaderError
from glpath.gl.conditions import Conditions
from glpath.gl.context import get_context
from tests.support.repository import TESTS

pytest_plugins = ["pytester"]

INCLUDED = re.compile(r'^#include "(.+)"$', re.MULTILINE)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(program, "shader_folder", lambda: tmp_path)
    (tmp_path / "a.vert").write_text("void main() { gl_Position = vec4(0.0); }\n")
    return tmp_path


def load(fragment: str, **generated: str) -> program.Program:
    return program.load_program(get_context().gl, vertex="a.vert", fragment=fragment, generated=generated)


def test_an_include_is_taken_once_however_often_it_is_asked_for(folder: Path) -> None:
    (folder / "c.glsl").write_text("const float C = 0.5;\n")
    (folder / "b.glsl").write_text('#include "c.glsl"\nfloat b() { return C; }\n')
    text = '#include "c.glsl"\n#include "b.glsl"\nout vec4 o;\nvoid main() { o = vec4(b() + C); }\n'
    (folder / "a.frag").write_text(text)
    load("a.frag")
    assert program.Source("a.frag", {}, {}).text.count("const float C") == 1


def test_an_error_in_an_included_file_names_that_file_and_its_line(folder: Path) -> None:
    (folder / "b.glsl").write_text("\n\nfloat b() { return wrong; }\n")
    (folder / "a.frag").write_text('#include "b.glsl"\nout vec4 o;\nvoid main() { o = vec4(b()); }\n')
    with pytest.raises(ShaderError, match=r"shaders/b\.glsl:3"):
        load("a.frag")


def test_an_error_behind_an_include_names_the_line_of_the_including_file(folder: Path) -> None:
    (folder / "b.glsl").write_text("float b() {\n return 1.0;\n}\n")
    (folder / "a.frag").write_text('#include "b.glsl"\nout vec4 o;\nvoid main() { o = wrong; }\n')
    with pytest.raises(ShaderError, match=r"shaders/a\.frag:3"):
        load("a.frag")


def test_a_missing_include_names_who_asked_for_it(folder: Path) -> None:
    (folder / "a.frag").write_text('\n#include "nowhere.glsl"\n')
    with pytest.raises(ShaderError, match=r"shaders/a\.frag:2: no shader file nowhere\.glsl"):
        load("a.frag")


def test_text_from_python_stands_where_the_shader_asks_for_it(folder: Path) -> None:
    (folder / "a.frag").write_text("#include <LAYOUT>\nout vec4 o;\nvoid main() { o = vec4(SIX); }\n")
    load("a.frag", LAYOUT="const int SIX = 6;")
    with pytest.raises(ShaderError, match="nothing generated is named LAYOUT"):
        load("a.frag")


def shader_files() -> list[Path]:
    found = [path for path in program.shader_folder().rglob("*") if path.is_file()]
    assert len(found) > 50
    return found


def test_every_shader_file_says_what_it_is_in_its_first_line() -> None:
    for path in shader_files():
        assert path.read_text().startswith(f"// {path.name}: "), path


def test_a_draw_without_a_value_for_a_uniform_is_refused(folder: Path) -> None:
    """It would be 0, or what another draw with the same program left there."""
    (folder / "a.frag").write_text("uniform float a, b;\nout vec4 o;\nvoid main() { o = vec4(a + b); }\n")
    drawn = load("a.frag")
    drawn.set({"a": 1.0, "b": 2.0, "of another pass": 3.0})
    with pytest.raises(AssertionError, match=r"no value for the uniforms \['b'\]"):
        drawn.set({"a": 1.0})


def test_a_test_that_leaves_a_gl_error_behind_fails(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("""
        from glpath.gl.context import get_context

        def test_an_enum_that_does_not_exist():
            get_context().gl.enable_direct(1)

        def test_nothing():
            pass
    """)
    (pytester.path / "conftest.py").write_text((TESTS / "conftest.py").read_text())
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=2, errors=1)
    result.stdout.fnmatch_lines("*the test left GL_INVALID_ENUM behind*")


def included_in(name: str) -> set[str]:
    text = (program.shader_folder() / name).read_text()
    return {name}.union(*(included_in(other) for other in INCLUDED.findall(text)))


def test_no_vertex_shader_reads_a_storage_buffer() -> None:
    """OpenGL 4.3 promises none: GL_MAX_VERTEX_SHADER_STORAGE_BLOCKS may be 0."""
    stages = [str(path.relative_to(program.shader_folder())) for path in program.shader_folder().rglob("*.vert")]
    assert len(stages) > 5
    for stage in stages:
        for name in included_in(stage):
            text = (program.shader_folder() / name).read_text()
            assert not re.search(r"^\s*(layout\(.*\))?[\w ]*\bbuffer\b", text, re.MULTILINE), f"{stage}: {name}"


def test_no_uniform_is_an_array_of_any_length() -> None:
    """A thousand components are all that OpenGL promises a stage; what grows with a scene belongs in a texture."""
    # at most 2, 64, 56, 8, 8, 16, 24, 48
    bounded = (
        r"VIEWS|LIGHT_SAMPLES|BRANCHES \* BOUNCES|SUBSAMPLES|PARTS|GROUND_LIGHTS|"
        r"(3 \* )?LAMP_RECTANGLES|3 \* PORTALS"
    )
    for path in shader_files():
        unbounded = rf"^uniform [^;]*\[(?!\d+\]|({bounded})\])"
        assert not re.search(unbounded, path.read_text(), re.MULTILINE), path.name


@pytest.mark.parametrize(
    ("defined", "lines", "kept"),
    [
        ({"A"}, "#ifdef A;1;#else;0;#endif;1", "101"),
        (set(), "#ifdef A // why;0;#else;1;#endif", "01"),
        (set(), "#ifndef A;1;#define A 3;#endif;#ifdef A;1;#endif", "11"),
        ({"B"}, "#if defined(A) || defined(B);1;#endif", "1"),
        ({"B"}, "#if defined(A) && defined(B);0;#elif defined(B);1;#elif defined(B);0;#else;0;#endif", "0100"),
        ({"B"}, "#if !defined(A) && defined(B);1;#else;0;#endif", "10"),
        (set(), "#if VIEWS > 1;1;#else;1;#endif", "11"),  # may be: what VIEWS is the preprocessor will say
        (set(), "#ifdef A;#ifdef B;0;#else;0;#endif;0;#endif;1", "0001"),
    ],
)
def test_lines_that_an_ifdef_takes_away_are_known(defined: set[str], lines: str, kept: str) -> None:
    conditions, found = Conditions(defined), ""
    for line in lines.split(";"):
        conditions.follow(line)
        if not line.startswith("#"):
            found += str(int(conditions.kept))
    assert found == kept.replace(" ", "")


def test_an_include_that_an_ifdef_takes_away_needs_nothing(folder: Path) -> None:
    (folder / "b.glsl").write_text("#include <NOT_GIVEN>\nfloat b() { return 2.0; }\n")
    (folder / "a.frag").write_text(
        '#ifdef HAS_SKY\n#include "b.glsl"\n#else\nfloat b() { return 3.0; }\n#endif\n'
        "out vec4 o;\nvoid main() { o = vec4(b()); }\n"
    )
    program.load_program(get_context().gl, vertex="a.vert", fragment="a.frag")
    with pytest.raises(ShaderError, match="NOT_GIVEN"):
        program.load_program(get_context().gl, vertex="a.vert", fragment="a.frag", defines={"HAS_SKY": 1})
