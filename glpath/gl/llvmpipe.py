"""Rewriting of shaders for Mesa's llvmpipe (22.3): the same values, fetched more cheaply.

- llvmpipe calls a function of some 180 instructions for a texelFetch, but inlines a third as many for an imageLoad;
  `shaders/gl/texels.glsl` selects between both.
- It fetches a uniform lane by lane, with some 30 instructions a component. Fragment shaders do this everywhere.
  Other shaders do it within a branch or a loop, because the first lane may be idle there. A flat input of a
  fragment shader costs one or two instructions, and so does a value that a compute shader fetches at its start.

The functions here rewrite shaders line by line; `program` calls them if the driver needs this dialect.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping

import moderngl

from glpath.errors import ShaderError
from glpath.gl.conditions import Conditions
from glpath.system.arguments import short_repr

TEXELS = ("auto", "image", "fetch")
#: Vertex shader of passes over all texels. Its outputs cost nothing, because it runs for three vertices only.
FULLSCREEN = "gl/fullscreen.vert"

_IMAGE = "_as_image"
#: Suffix of a uniform if the shader uses its plain name for a variable with its value. A macro cannot rename the
#: uniform, because struct fields may have the same name.
_GIVEN = "_given"
_TEXELS = re.compile(r"^\s*(?:UINT_)?TEXELS\(\w+, (?P<name>\w+)\);")
_UNIFORM = re.compile(
    r"^\s*uniform (?P<type>float|u?int|[iu]?vec[234]) (?P<name>\w+)(?P<array>\[(?P<size>\w+)\])?;"
)


def is_spoken(gl: moderngl.Context) -> bool:
    """Return True if shaders are rewritten: by the renderer's name, or by GLPATH_TEXELS (for tests)."""
    chosen = os.environ.get("GLPATH_TEXELS") or "auto"
    if chosen not in TEXELS:
        raise ShaderError(
            f"GLPATH_TEXELS: there is no {short_repr(chosen)}; allowed are {', '.join(TEXELS)}",
            "unset GLPATH_TEXELS",
        )
    renderer = str(gl.info["GL_RENDERER"])
    return chosen == "image" or (chosen == "auto" and renderer.startswith("llvmpipe"))


def uniform_name(name: str) -> str:
    """Return the name that a uniform has in the shader's file, from the name that the driver reports."""
    return name.removesuffix(_IMAGE).removesuffix(_GIVEN)


def image_texels(line: str) -> str:
    """Return a line, after a macro that renames the texels that the line declares, because they become images.

    A name must not be an image in the fragment shader and a sampler in the vertex shader.
    """
    texels = _TEXELS.match(line)
    return f"#define {texels['name']} {texels['name']}{_IMAGE}\n{line}" if texels else line


def fetch_at_start(line: str) -> str:
    """Return a uniform's declaration with a global variable that holds its value, fetched before any branch.

    max() changes no value. It keeps llvmpipe from fetching the uniform at each use, as it would for a plain copy.
    """
    uniform = _UNIFORM.match(line)
    if not uniform or uniform["array"] or "u" in uniform["type"]:
        return line
    name, kind = uniform["name"], uniform["type"]
    lowest = "-2147483647" if kind.startswith("i") else "-3e38"
    rest = line[uniform.end() :]
    return f"uniform {kind} {name}{_GIVEN};\n{kind} {name} = max({name}{_GIVEN}, {lowest});{rest}"


class HandedOn:
    """Uniforms of a fragment shader that the vertex shader passes on as flat inputs.

    Rewrites the lines of the fragment shader and keeps the uniforms for `vertex`, which rewrites the text of the
    vertex shader. Arrays are passed on if `defines` contains their size. At most `components` are passed on, the
    limit for inputs, because the driver does not refuse more, but overruns its stack. The rest stay uniforms. Lines
    that an #ifdef removes do not count.
    """

    def __init__(self, defines: Mapping[str, object], components: int) -> None:
        self._defines = defines
        self._left = components
        self._found: dict[str, tuple[str, str]] = {}
        self._conditions = Conditions(defines)

    def fragment(self, line: str) -> str:
        self._conditions.follow(line)
        uniform = _UNIFORM.match(line) if self._conditions.kept else None
        if not uniform or (uniform["array"] and uniform["size"] not in self._defines):
            return line
        name, kind = uniform["name"], uniform["type"]
        # The vertex shader may lack the name of the size, so its value is written.
        size = int(str(self._defines[uniform["size"]])) if uniform["array"] else 0
        array = f"[{size}]" if size else ""
        # Each array element occupies a location of four components.
        needed = 4 * size if size else _components(kind)
        if needed > self._left:
            return line
        self._left -= needed
        self._found[name] = (kind, array)
        return f"flat in {kind} {name}{array};{line[uniform.end() :]}"

    def vertex(self, text: str) -> str:
        outputs = [
            f"uniform {kind} {name}{_GIVEN}{array};\nflat out {kind} {name}{array};"
            for name, (kind, array) in self._found.items()
        ]
        copies = [f"    {name} = {name}{_GIVEN};" for name in self._found]
        return "\n".join(
            [
                text.replace("void main()", "void shade()"),
                *outputs,
                "void main()",
                "{",
                "    shade();",
                *copies,
                "}",
            ]
        )


def _components(kind: str) -> int:
    return int(kind[-1]) if kind[-1].isdigit() else 1
