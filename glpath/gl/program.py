"""Shader programs from files: includes flattened, errors that name the right file and line.

Shaders lie in `shaders/` (beside the package in a checkout, inside it when installed). `.vert`, `.frag` and
`.comp` are whole programs; `.glsl` is included by a line `#include "name.glsl"`, each file once. What Python
and GLSL share (layouts, constants) is declared in Python and handed over as text, which stands where the file
says `#include <NAME>` for NAME in the `generated` mapping.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from weakref import WeakKeyDictionary

import moderngl

from glpath.errors import ShaderError

TEXELS = ("auto", "image", "fetch")
GLSL_VERSION = "#version 430 core"

_IMAGE_2D, _UNSIGNED_INT_IMAGE_2D = 0x904D, 0x9063

_INCLUDE = re.compile(r'^\s*#include\s+(?:"(?P<file>[^"]+)"|<(?P<generated>[^>]+)>)\s*$')
# See shaders/texels.glsl.
_TEXELS = re.compile(r"^\s*(?:UINT_)?TEXELS\(\w+, (?P<name>\w+)\);")
_IMAGE = "_as_image"
_LOCATION = re.compile(r"^(?P<file>\d+)[:(](?P<line>\d+)", re.MULTILINE)


def shader_folder() -> Path:
    """Where the shader files are: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "shaders", package.parent / "shaders"):
        if folder.is_dir():
            return folder
    raise ShaderError(
        f"{package}: the shaders of glpath are missing; looked in {package / 'shaders'}",
        "Install glpath again: pip install --force-reinstall glpath",
    )


# By context, and by the whole text of the stages. Compiling takes longer than many a render of a test suite.
_compiled: WeakKeyDictionary[moderngl.Context, dict[tuple[str, ...], Program]] = WeakKeyDictionary()


def forget_programs(gl: moderngl.Context) -> None:
    """Let go of all programs of a context, which would keep it alive."""
    _compiled.pop(gl, None)


class Source:
    """One flattened shader and the table that leads its lines back to files."""

    def __init__(self, name: str, generated: Mapping[str, str], defines: Mapping[str, object]) -> None:
        self.name = name
        self.files: list[str] = []
        self._generated = generated
        self._defines = defines
        self._seen: set[str] = set()
        head = "".join(f"#define {key} {value}\n" for key, value in defines.items())
        self.text = f"{GLSL_VERSION}\n{head}{self._flatten(name, '')}"

    def _flatten(self, name: str, included_from: str) -> str:
        path = shader_folder() / name
        if not path.is_file():
            place = f"{included_from}: " if included_from else ""
            raise ShaderError(f"{place}no shader file {name} in {shader_folder()}")
        self._seen.add(name)
        return self._lines(name, path.read_text())

    def _lines(self, name: str, text: str) -> str:
        number = len(self.files)
        self.files.append(name)
        out = [f"#line 1 {number}"]
        for i, line in enumerate(text.splitlines(), start=1):
            match = _INCLUDE.match(line)
            texels = _TEXELS.match(line)
            if texels and "TEXELS_ARE_IMAGES" in self._defines:
                # One name cannot be an image in the fragment shader and a sampler in the vertex shader of a
                # program.
                out.append(f"#define {texels['name']} {texels['name']}{_IMAGE}")
            if not match:
                out.append(line)
                continue
            if match["generated"]:
                key = match["generated"]
                if key not in self._generated:
                    raise ShaderError(f"shaders/{name}:{i}: nothing generated is named {key}")
                if key not in self._seen:
                    self._seen.add(key)
                    out.append(self._lines(f"<{key}>", self._generated[key]))
            elif match["file"] not in self._seen:
                out.append(self._flatten(match["file"], f"shaders/{name}:{i}"))
            out.append(f"#line {i + 1} {number}")
        return "\n".join(out) + "\n"

    def explain(self, log: str) -> str:
        """The driver's log with file numbers replaced by file names."""

        def named(match: re.Match[str]) -> str:
            number = int(match["file"])
            if number >= len(self.files):
                return match[0]
            return f"shaders/{self.files[number]}:{match['line']}"

        return _LOCATION.sub(named, log)


class Program:
    """A linked program whose samplers and images have fixed units, in the order of their names.

    gl       : the moderngl program or compute shader
    samplers : name -> texture unit
    images   : name -> image unit, see texels.glsl
    """

    def __init__(self, gl: moderngl.Program | moderngl.ComputeShader, label: str) -> None:
        self.gl = gl
        self.label = label
        self.samplers: dict[str, int] = {}
        self.images: dict[str, int] = {}
        self._uniforms: dict[str, moderngl.Uniform] = {}
        self._values: dict[str, object] = {}
        for name in sorted(gl):
            member = gl[name]
            if not isinstance(member, moderngl.Uniform):
                continue
            if member.gl_type in (_IMAGE_2D, _UNSIGNED_INT_IMAGE_2D):  # type: ignore[attr-defined]
                unit = self.images[name.removesuffix(_IMAGE)] = len(self.images)
                # moderngl can set the unit of an image of floats only; it is the same call.
                member.gl_type, member.fmt = _IMAGE_2D, "1i"  # type: ignore[attr-defined]
                member.value = unit
                continue
            # GL_SAMPLER_2D, GL_SAMPLER_2D_ARRAY, GL_INT_SAMPLER_2D, GL_UNSIGNED_INT_SAMPLER_2D
            if member.gl_type in (0x8B5E, 0x8DC1, 0x8DCA, 0x8DD2):  # type: ignore[attr-defined]
                self.samplers[name] = len(self.samplers)
                member.value = self.samplers[name]
            else:
                self._uniforms[name] = member

    def set(self, uniforms: Mapping[str, object]) -> None:
        """Set those of the given uniforms that this program uses: numbers, or tuples for vectors.

        All that it uses must be given, as a family of passes shares one mapping and programs are shared too: what
        is not there would be 0, or whatever the draw before had.
        """
        missing = self._uniforms.keys() - uniforms.keys()
        assert not missing, f"{self.label}: no value for the uniforms {sorted(missing)}"
        for name, value in uniforms.items():
            uniform = self._uniforms.get(name)
            # Most stay as they were from set to set, and a call into GL costs more than a comparison.
            if uniform is None or self._values.get(name) == value:
                continue
            uniform.value = value
            self._values[name] = value


def texels_are_images(gl: moderngl.Context) -> bool:
    """Which of the two ways of texels.glsl: by the renderer, or as GLPATH_TEXELS says, so that tests run both."""
    chosen = os.environ.get("GLPATH_TEXELS") or "auto"
    if chosen not in TEXELS:
        raise ShaderError(
            f"GLPATH_TEXELS: there is no {chosen!r}; allowed are {', '.join(TEXELS)}", "unset GLPATH_TEXELS"
        )
    renderer = str(gl.info["GL_RENDERER"])
    return chosen == "image" or (chosen == "auto" and renderer.startswith("llvmpipe"))


def load_program(
    gl: moderngl.Context,
    *,
    vertex: str = "",
    fragment: str = "",
    compute: str = "",
    generated: Mapping[str, str] | None = None,
    defines: Mapping[str, object] | None = None,
) -> Program:
    """Compile and link shader files (names relative to the shader folder).

    Parameters
    ----------
    vertex, fragment : file names of a drawing program; or `compute` alone
    generated        : text for `#include <NAME>`: layouts declared in Python
    defines          : name -> value, put as #define lines before everything

    A program is compiled once in a context; later calls for the same one share it.

    Raises
    ------
    ShaderError : with the driver's log, in which each place is a file and line of the shader folder
    """
    stages = {"vertex_shader": vertex, "fragment_shader": fragment, "compute_shader": compute}
    fetch_defines = {"TEXELS_ARE_IMAGES": 1} if texels_are_images(gl) else {}
    sources = {
        k: Source(v, generated or {}, dict(defines or {}) | (fetch_defines if k != "vertex_shader" else {}))
        for k, v in stages.items()
        if v
    }
    label = "+".join(s.name for s in sources.values())
    compiled = _compiled.setdefault(gl, {})
    key = tuple(s.text for s in sources.values())
    if key in compiled:
        return compiled[key]
    try:
        if compute:
            program = Program(gl.compute_shader(sources["compute_shader"].text), label)
        else:
            program = Program(
                gl.program(
                    vertex_shader=sources["vertex_shader"].text, fragment_shader=sources["fragment_shader"].text
                ),
                label,
            )
    except moderngl.Error as error:
        log = str(error)
        # moderngl heads its message with the stage that failed; the file numbers are that stage's own.
        failed = next((s for k, s in sources.items() if k in log.lower()), None)
        text = failed.explain(log) if failed else log
        raise ShaderError(f"{label}: the driver refuses the shader\n{text.strip()}") from None
    compiled[key] = program
    return program
