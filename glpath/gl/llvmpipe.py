"""Rewriting of shaders for Mesa's llvmpipe (22.3), so that they fetch the same values at a lower cost.

- For a texelFetch, llvmpipe calls a function of some 180 instructions. For an imageLoad, it inlines a third as
  many. So textures are read as images (`shaders/gl/texels.glsl`).
- Fragment shaders fetch a uniform lane by lane, with some 30 instructions a component. A flat input costs one or
  two instructions, so the vertex shader passes on uniforms as flat inputs.
- Other shaders fetch a uniform lane by lane only in a branch or loop, because the first lane may be idle there. So
  compute shaders fetch each uniform once, at their start, for one or two instructions.

The functions here rewrite shaders line by line; `glpath.gl.program` calls them if `is_spoken` is True.
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
#: Suffix of the name of a rewritten uniform. Its name without the suffix becomes a variable with the same value. A
#: macro cannot rename the uniform, because struct fields may have the same name.
_GIVEN = "_given"
_TEXELS = re.compile(r"^\s*(?:UINT_)?TEXELS\(\w+, (?P<name>\w+)\);")
_UNIFORM = re.compile(
    r"^\s*uniform (?P<type>float|u?int|[iu]?vec[234]) (?P<name>\w+)(?P<array>\[(?P<size>\w+)\])?;"
)


def is_spoken(gl: moderngl.Context) -> bool:
    """Return True if shaders must be rewritten, because the renderer is llvmpipe or GLPATH_TEXELS is "image".

    GLPATH_TEXELS is for tests; the value "fetch" prevents rewriting. Raises ShaderError for another value.
    """
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
    """Return a line that declares a texture, preceded by a macro that renames the texture; other lines unchanged.

    The texture becomes an image in this shader. The vertex shader may declare the same texture as a sampler, and a
    program cannot have both under one name.
    """
    texels = _TEXELS.match(line)
    return f"#define {texels['name']} {texels['name']}{_IMAGE}\n{line}" if texels else line


def fetch_at_start(line: str) -> str:
    """Return a uniform's declaration, followed by a variable that fetches the uniform before any branch.

    Lines without a uniform are returned unchanged, and so are arrays and unsigned types. The variable is a max() of
    the uniform and a very low number, which changes no value. For a plain copy, llvmpipe would fetch the uniform
    again at each use.
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

    `fragment` rewrites lines of the fragment shader and records the uniforms. `vertex` then rewrites the vertex
    shader. Lines that an #ifdef removes are ignored.

    defines    : preprocessor names with values; an array is passed on only if its size is one of these names
    components : maximum number of components to pass on; further uniforms stay uniforms. It is the device's limit
                 for inputs, because the driver does not reject more, but overruns its stack
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
        # The size is written as a number, because the vertex shader may not define its name.
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
