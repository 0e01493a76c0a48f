"""Rewrites shaders for Mesa's llvmpipe (22.3): the same numbers, fetched more cheaply.

- It calls a function of some 180 instructions for a texelFetch, and puts a third as many in place for an imageLoad;
  `shaders/gl/texels.glsl` is the GLSL of that.
- It fetches a uniform lane by lane, some 30 instructions a component: in a fragment shader everywhere, in others
  within a branch or a loop, as the first lane may be idle there. A flat input of a fragment shader costs one or
  two, and so does what a compute shader has fetched at its start.

The functions here rewrite shaders line by line; `program` has them do so where this dialect is spoken.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping

import moderngl

from glpath.errors import ShaderError
from glpath.gl.conditions import Conditions

TEXELS = ("auto", "image", "fetch")
#: The vertex shader of passes over all texels: the outputs of its three vertices cost nothing.
FULLSCREEN = "gl/fullscreen.vert"

_IMAGE = "_as_image"
#: The uniform, where the name is that of what the shader reads instead. No macro: fields may have such a name too.
_GIVEN = "_given"
_TEXELS = re.compile(r"^\s*(?:UINT_)?TEXELS\(\w+, (?P<name>\w+)\);")
_UNIFORM = re.compile(
    r"^\s*uniform (?P<type>float|u?int|[iu]?vec[234]) (?P<name>\w+)(?P<array>\[(?P<size>\w+)\])?;"
)


def is_spoken(gl: moderngl.Context) -> bool:
    """By the renderer, or as GLPATH_TEXELS says, so that tests run both."""
    chosen = os.environ.get("GLPATH_TEXELS") or "auto"
    if chosen not in TEXELS:
        raise ShaderError(
            f"GLPATH_TEXELS: there is no {chosen!r}; allowed are {', '.join(TEXELS)}", "unset GLPATH_TEXELS"
        )
    renderer = str(gl.info["GL_RENDERER"])
    return chosen == "image" or (chosen == "auto" and renderer.startswith("llvmpipe"))


def uniform_name(name: str) -> str:
    """The name in the shader's file of a uniform as the driver calls it."""
    return name.removesuffix(_IMAGE).removesuffix(_GIVEN)


def image_texels(line: str) -> str:
    """Texels as images; one name cannot be an image in a fragment shader and a sampler in the vertex shader."""
    texels = _TEXELS.match(line)
    return f"#define {texels['name']} {texels['name']}{_IMAGE}\n{line}" if texels else line


def fetch_at_start(line: str) -> str:
    """A uniform as a global variable with its value: fetched before any branch.

    The maximum changes no value; a plain copy would be fetched where it is used.
    """
    uniform = _UNIFORM.match(line)
    if not uniform or uniform["array"] or "u" in uniform["type"]:
        return line
    name, kind = uniform["name"], uniform["type"]
    lowest = "-2147483647" if kind.startswith("i") else "-3e38"
    rest = line[uniform.end() :]
    return f"uniform {kind} {name}{_GIVEN};\n{kind} {name} = max({name}{_GIVEN}, {lowest});{rest}"


class HandedOn:
    """Uniforms of a fragment shader, handed on by the vertex shader as flat inputs.

    Rewrites the lines of the fragment shader and keeps what it found for `vertex`, which rewrites the text of the
    other. Arrays are handed on where `defines` knows their size. What goes beyond `components`, as many as inputs
    may have, stays a uniform: the driver does not refuse more, but overruns its stack. What an #ifdef takes away
    does not count.
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
        # The vertex shader need not know the name of the size.
        size = int(str(self._defines[uniform["size"]])) if uniform["array"] else 0
        array = f"[{size}]" if size else ""
        # An element of an array has a location of its own.
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
