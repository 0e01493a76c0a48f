"""Errors for allocations that exceed the device's memory. They name size and caller, unlike OpenGL's own error."""

from __future__ import annotations

import sys
from typing import Any

import moderngl
import numpy as np

from glpath.errors import ContextError, UsageError, argument
from glpath.system.arguments import short_repr


def out_of_memory_remedy() -> str:
    """Return the remedy for a device that lacks memory for an image."""
    parts = argument("crop", (0, 0, 960, 540))
    return (
        f"Render the image in parts, such as {parts}, whose .exr have their window in the whole, or fewer pixels;\n"
        "take smaller textures or shadow-buffers, or another device."
    )


#: Classes of moderngl by their names in annotations, for `checked`.
MODERNGL = {"moderngl.Context": moderngl.Context, "moderngl.Texture": moderngl.Texture}

# Size in bytes below which allocations are not checked, because they practically never fail.
_WORTH_ASKING = 1 << 20


class NamingContext(moderngl.Context):
    """Context of moderngl that raises ContextError if the device has no memory for a buffer or texture."""

    def buffer(self, *data: Any, **how: Any) -> moderngl.Buffer:
        made = super().buffer(*data, **how)
        self._check(made.size, "a buffer")
        return made

    def texture(self, size: Any, components: int, *data: Any, **how: Any) -> moderngl.Texture:
        self._check_size(size, self.info["GL_MAX_TEXTURE_SIZE"])
        made = super().texture(size, components, *data, **how)
        self._check(_texels(size, components, how), f"a texture of {_shape(size)}")
        return made

    def texture_array(self, size: Any, components: int, *data: Any, **how: Any) -> moderngl.TextureArray:
        self._check_size(size, self.info["GL_MAX_TEXTURE_SIZE"])
        made = super().texture_array(size, components, *data, **how)
        self._check(_texels(size, components, how), f"a texture of {_shape(size)}")
        return made

    def _check_size(self, size: Any, limit: int) -> None:
        """Raise ContextError for a texture that is wider or higher than `limit`; moderngl ends the process then."""
        if not all(0 <= length <= limit for length in size[:2]):
            asks = sys._getframe(2).f_code.co_qualname
            raise ContextError(
                f"a texture of {_shape(size)} texels in {asks}; this device allows up to {limit} x {limit}.",
                out_of_memory_remedy(),
            )

    def _check(self, size: int, what: str) -> None:
        if size < _WORTH_ASKING or (error := self.error) == "GL_NO_ERROR":
            return
        asks = sys._getframe(2).f_code.co_qualname
        raise ContextError(
            f"{self.info['GL_RENDERER']}: {error} for {what}, {size / 2**20:,.0f} MiB, in {asks}.",
            out_of_memory_remedy(),
        )


def check_texture_size(gl: moderngl.Context, name: str, size: Any) -> None:
    """Raise UsageError with the argument's name unless `size` is (columns, rows) of a texture that can be made.

    size : sequence, which `checked` ensures
    """
    limit = int(gl.info["GL_MAX_TEXTURE_SIZE"])
    whole = all(isinstance(each, int | np.integer) and 1 <= each <= limit for each in size)
    if not whole or len(size) != 2:
        raise UsageError(
            f"{name}: {short_repr(size)} where two whole numbers from 1 to {limit} are needed",
            f"This device's textures have at most {limit} x {limit} texels.",
        )


def _texels(size: Any, components: int, how: dict[str, Any]) -> int:
    kinds = {"f1": 1, "f2": 2, "f4": 4, "i1": 1, "i2": 2, "i4": 4, "u1": 1, "u2": 2, "u4": 4, "nu1": 1, "nu2": 2}
    each = kinds.get(how.get("dtype", "f1"), 4)
    return int(np.prod(np.asarray(size, np.int64))) * components * each


def _shape(size: Any) -> str:
    return " x ".join(str(n) for n in size)
