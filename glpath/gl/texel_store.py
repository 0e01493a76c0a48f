"""Tables in textures that shaders read texel by texel: sections of equal entries, floats or unsigned integers.

Textures are used instead of storage buffers, because Mesa's llvmpipe fetches texels with vector gathers, but loads
from buffers lane by lane. Also, GL 4.3 does not guarantee storage buffers to a vertex shader. A layout is declared
once, in Python, and handed to GLSL as text: constants, and one fetch function for each section.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError

#: Number of texels in a row.
WIDTH = 4096
_SHIFT = WIDTH.bit_length() - 1
# Number of rows of a store that are written at once (16 MiB).
_ROWS = 256
# Number of texels of a table that are requested at once.
_TEXELS = 1 << 16

#: Contents of an entry's texels, in order, by section: {"sphere": {"BALL": "centre; radius"}}.
Layout = Mapping[str, Mapping[str, str]]


class Rows(Protocol):
    """Table of a section: an array, or an object that computes ranges of its entries on request."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, which: slice, /) -> NDArray[Any]: ...


class Kind(NamedTuple):
    """Type of a texel's four components."""

    dtype: type[np.generic]
    gl: str  # moderngl's name of the component type
    declare: str  # GLSL macro that declares the texture, see shaders/gl/texels.glsl
    vector: str


FLOATS = Kind(np.float32, "f4", "TEXELS(rgba32f, {})", "vec4")
# Texels of four bytes, whose components are multiples of 1/255.
BYTES = Kind(np.uint8, "f1", "TEXELS(rgba8, {})", "vec4")
UINTS = Kind(np.uint32, "u4", "UINT_TEXELS(rgba32ui, {})", "uvec4")


def store_glsl(name: str, kind: Kind, layout: Layout) -> str:
    """Return GLSL for the store `name`.

    A section "sphere" gets constants SPHERE_... and a function sphere_texel(number, which).
    """
    lines = ['#include "gl/texels.glsl"', kind.declare.format(name) + ";"]
    for section, texels in layout.items():
        lines.append(f"uniform int {section}_base;")
        lines += [
            f"const int {section.upper()}_{texel} = {i};  // {what}"
            for i, (texel, what) in enumerate(texels.items())
        ]
        lines += [
            f"{kind.vector} {section}_texel(int number, int which)",
            "{",
            f"    int i = {section}_base + number * {len(texels)} + which;",
            f"    return texel({name}, ivec2(i & {WIDTH - 1}, i >> {_SHIFT}));",
            "}",
        ]
    return "\n".join(lines) + "\n"


class StoreRows:
    """Copy of a store's texels on the CPU, for changes: rows that change are written again as a whole."""

    def __init__(self, texture: moderngl.Texture, kind: Kind) -> None:
        self._texture = texture
        self._rows = np.frombuffer(texture.read(), kind.dtype).reshape(texture.height, texture.width, 4).copy()
        self._changed = np.zeros(texture.height, np.bool_)

    def put(self, numbers: NDArray[np.integer[Any]], texels: NDArray[Any]) -> None:
        """Store texels (n, ..., 1 to 4) from texel indices (n,) on, with 0 for missing components.

        `write` sends them to the device.
        """
        flat = self._rows.reshape(-1, 4)
        values = texels.reshape(len(numbers), -1)
        flat[numbers, : values.shape[1]] = values
        flat[numbers, values.shape[1] :] = 0
        self._changed[numbers // self._texture.width] = True

    def write(self) -> None:
        """Write the changed rows to the device."""
        rows = np.flatnonzero(self._changed)
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if len(part):
                area = (0, int(part[0]), self._texture.width, len(part))
                self._texture.write(self._rows[part[0] : part[-1] + 1].tobytes(), viewport=area)
        self._changed[:] = False


def make_store(
    gl: moderngl.Context, kind: Kind, layout: Layout, tables: Mapping[str, Rows], source: str
) -> tuple[moderngl.Texture, dict[str, object]]:
    """Create a texture of the sections' tables, each (n, texels, 4), and uniforms with each section's first texel.

    Raises SceneError, which names the `source`, if the tables exceed the device's limit.
    """
    assert set(tables) == set(layout), f"tables {sorted(tables)} for the layout {sorted(layout)}"
    bases: dict[str, object] = {}
    total = 0
    for section in layout:
        shape = tables[section].shape
        assert shape[1:] == (len(layout[section]), 4), f"{section}: a table of {shape}"
        bases[f"{section}_base"] = total
        total += shape[0] * shape[1]
    limit = int(gl.info["GL_MAX_TEXTURE_SIZE"]) * WIDTH
    if total > limit:
        largest = max(layout, key=lambda section: tables[section].shape[0] * len(layout[section]))
        raise SceneError(
            f"{source}: {total:,} texels of scene data, most of them for {tables[largest].shape[0]:,} entries of "
            f'"{largest}"; this device holds at most {limit:,}',
            "Simplify the meshes, or render on a device with a larger texture limit.",
        )
    # A single row is only as wide as needed, because most scenes are small.
    width = min(WIDTH, max(1, total))
    height = max(1, -(-total // width))
    texture = gl.texture((width, height), 4, dtype=kind.gl)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    # Write some rows at a time, because a store may have gigabytes.
    rows = np.zeros((min(height, _ROWS), width, 4), kind.dtype)
    flat, filled, row = rows.reshape(-1, 4), 0, 0
    for section, texels in layout.items():
        table, step = tables[section], _TEXELS // len(texels)
        for start in range(0, table.shape[0], step):
            part = table[start : start + step].reshape(-1, 4)
            while len(part):
                taken = min(len(part), len(flat) - filled)
                flat[filled : filled + taken] = part[:taken]
                part, filled = part[taken:], filled + taken
                if filled == len(flat):
                    texture.write(rows, viewport=(0, row, width, len(rows)))
                    row, filled = row + len(rows), 0
    if row < height:
        flat[filled:] = 0
        texture.write(rows[: height - row], viewport=(0, row, width, height - row))
    return texture, bases
