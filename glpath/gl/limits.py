"""Limits of a device and the values that rendering needs; `glpath doctor` compares them.

OpenGL 4.3 guarantees all values that `LIMITS` needs, so a device with less does not support OpenGL 4.3. A test
compares these values with what the shader programs use.
"""

from __future__ import annotations

import ctypes
from typing import NamedTuple

from glpath.gl import llvmpipe
from glpath.gl.context import Context


class Limit(NamedTuple):
    """Limit of a device.

    number : the limit's GL enum, for glGetIntegerv
    needed : minimum value for rendering
    use    : purpose of the limit
    """

    number: int
    needed: int
    use: str


LIMITS = {
    "GL_MAX_TEXTURE_SIZE": Limit(0x0D33, 4096, "rows of a scene's tables; larger pictures are rendered in tiles"),
    "GL_MAX_DRAW_BUFFERS": Limit(0x8824, 3, "the state of a path"),
    "GL_MAX_COLOR_ATTACHMENTS": Limit(0x8CDF, 3, "the same"),
    "GL_MAX_CLIP_DISTANCES": Limit(0x0D32, 4, "the sides of a hemicube"),
    "GL_MAX_TEXTURE_IMAGE_UNITS": Limit(0x8872, 14, "textures of a fragment shader"),
    "GL_MAX_VERTEX_TEXTURE_IMAGE_UNITS": Limit(0x8B4C, 4, "of a vertex shader"),
    "GL_MAX_COMPUTE_TEXTURE_IMAGE_UNITS": Limit(0x91BC, 13, "of a compute shader"),
    "GL_MAX_COMPUTE_IMAGE_UNIFORMS": Limit(0x91BD, 2, "the sums that it writes"),
    "GL_MAX_FRAGMENT_UNIFORM_COMPONENTS": Limit(0x8B49, 1024, "random numbers of a path set and the camera"),
    "GL_MAX_SHADER_STORAGE_BUFFER_BINDINGS": Limit(0x90DD, 7, "small primitives of a T-buffer"),
    "GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS": Limit(0x90DA, 2, "the same"),
    "GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS": Limit(0x90DB, 5, "the same"),
    "GL_MAX_SHADER_STORAGE_BLOCK_SIZE": Limit(0x90DE, 1 << 24, "4 bytes a pixel of a tile, or 8 a primitive"),
    "GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS": Limit(0x90EB, 256, "a list of large primitives"),
}
#: Further limits if texels.glsl reads textures as images, as it does for llvmpipe.
IMAGE_LIMITS = {
    "GL_MAX_IMAGE_UNITS": Limit(0x8F38, 14, "textures read as images"),
    "GL_MAX_FRAGMENT_IMAGE_UNIFORMS": Limit(0x90CE, 14, "the same"),
}


class Found(NamedTuple):
    """Value of a limit on a device, and the value that rendering needs."""

    value: int
    needed: int
    use: str

    @property
    def enough(self) -> bool:
        return self.value >= self.needed


def device_limits(context: Context) -> dict[str, Found]:
    """Return each limit that rendering needs, with its value on the device, by GL name."""
    with context:
        get = context.function("glGetIntegerv", ctypes.c_uint, ctypes.POINTER(ctypes.c_int))
        found = {}
        for name, limit in (LIMITS | (IMAGE_LIMITS if llvmpipe.is_spoken(context.gl) else {})).items():
            value = ctypes.c_int(0)
            get(limit.number, ctypes.byref(value))
            found[name] = Found(value.value, limit.needed, limit.use)
        info = context.gl.info
        groups, point = int(info["GL_MAX_COMPUTE_WORK_GROUP_COUNT"][0]), int(info["GL_POINT_SIZE_RANGE"][1])
        found["GL_MAX_COMPUTE_WORK_GROUP_COUNT"] = Found(groups, 1 << 15, "small primitives of a T-buffer")
        found["GL_POINT_SIZE_RANGE"] = Found(point, 1, "spheres; larger points are quicker, up to 32")
        context.gl.clear_errors()
    return found
