"""Depth textures of 32-bit floats, which distinguish all floats in [0, 1].

moderngl offers only depth textures of 24-bit fixed point (GL_DEPTH_COMPONENT24). Distances stored in those would
need a scale, and near ones would become equal.
"""

from __future__ import annotations

import ctypes

import moderngl

from glpath.gl.context import context_of

_TEXTURE_2D = 0x0DE1
_DEPTH_COMPONENT = 0x1902
_FLOAT = 0x1406
_DEPTH_COMPONENT32F = 0x8CAC

#: Factor from distance to depth: a power of two, so the mantissa is kept; distances from 1e-19 to 1e19 give normal
#: floats below 1.
DISTANCE_TO_DEPTH = 2.0**-64


def float_depth_texture(gl: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    """Create a depth texture with format GL_DEPTH_COMPONENT32F, for a framebuffer's depth attachment."""
    texture = gl.depth_texture(size)
    texture.use(0)
    define = context_of(gl).function(
        "glTexImage2D",
        ctypes.c_uint,  # target
        ctypes.c_int,  # level
        ctypes.c_int,  # internal format
        ctypes.c_int,  # width
        ctypes.c_int,  # height
        ctypes.c_int,  # border
        ctypes.c_uint,  # format
        ctypes.c_uint,  # type
        ctypes.c_void_p,
    )
    define(_TEXTURE_2D, 0, _DEPTH_COMPONENT32F, *size, 0, _DEPTH_COMPONENT, _FLOAT, None)
    return texture
