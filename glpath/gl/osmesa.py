"""OSMesa: OpenGL that draws into main memory, without EGL, a display or a device file.

It is the last resort for a machine without EGL. glcontext has no loader for it; this module has one, in the form
that `moderngl.create_context(context=...)` takes (`load_opengl_function`, `__enter__`, `__exit__`, `release`).

Needs:    libOSMesa.so.8 (Debian 12: libosmesa6). Mesa 25.1 dropped the library; newer distributions lack it.
Poor at:  everything in comparison with EGL: it is the same llvmpipe, but harder to install.
Source:   the Mesa 22.3 header GL/osmesa.h, with the constants below.
"""

from __future__ import annotations

import ctypes

from glpath.errors import ContextError

OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")

_FORMAT, _RGBA = 0x22, 0x1908
_DEPTH_BITS = 0x30
_PROFILE, _CORE_PROFILE = 0x33, 0x34
_MAJOR_VERSION, _MINOR_VERSION = 0x36, 0x37
_UNSIGNED_BYTE = 0x1401

# Versions to request, from the highest: Mesa gives exactly the requested version, never a newer one.
_VERSIONS = ((4, 6), (4, 5), (4, 4), (4, 3))

# Size of OSMesa's own framebuffer, which is never drawn to, but required to make a context current.
_SIDE = 4


def load_osmesa() -> ctypes.CDLL | None:
    """Return the library, or None if the machine has none."""
    for name in OSMESA_LIBRARIES:
        try:
            library = ctypes.CDLL(name)
            library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
            library.OSMesaCreateContextAttribs.argtypes = [ctypes.POINTER(ctypes.c_int), ctypes.c_void_p]
            library.OSMesaMakeCurrent.restype = ctypes.c_ubyte
            library.OSMesaMakeCurrent.argtypes = [
                ctypes.c_void_p,
                ctypes.c_void_p,
                ctypes.c_uint,
                ctypes.c_int,
                ctypes.c_int,
            ]
            library.OSMesaGetProcAddress.restype = ctypes.c_void_p
            library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
            library.OSMesaDestroyContext.restype = None
            library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        except (OSError, AttributeError):  # absent, or a Mesa before 12 without the attribute list
            continue
        return library
    return None


class OSMesaLoader:
    """Core-profile OSMesa context, current after creation, with moderngl's loader interface.

    Raises
    ------
    ContextError : the library is missing, or has no OpenGL 4.3
    """

    def __init__(self) -> None:
        library = load_osmesa()
        if library is None:
            raise ContextError(
                f"osmesa: none of {', '.join(OSMESA_LIBRARIES)} can be loaded",
                "Debian 12: apt-get install libosmesa6. Elsewhere use EGL: apt-get install libegl1 libgl1-mesa-dri",
            )
        self._library = library
        self._context: int | None = None
        for major, minor in _VERSIONS:
            attributes = [_FORMAT, _RGBA, _DEPTH_BITS, 24, _PROFILE, _CORE_PROFILE]
            attributes += [_MAJOR_VERSION, major, _MINOR_VERSION, minor, 0]
            self._context = library.OSMesaCreateContextAttribs((ctypes.c_int * len(attributes))(*attributes), None)
            if self._context:
                break
        if not self._context:
            raise ContextError(
                "osmesa: the library offers no OpenGL 4.3 core profile",
                "Mesa 20.3 or newer with llvmpipe is needed; or use EGL: apt-get install libegl1 libgl1-mesa-dri",
            )
        self._pixels = ctypes.create_string_buffer(_SIDE * _SIDE * 4)
        if not self._make_current():
            self.release()
            raise ContextError("osmesa: OSMesaMakeCurrent failed on a fresh context")

    def _make_current(self) -> bool:
        pixels = ctypes.cast(self._pixels, ctypes.c_void_p)
        return bool(self._library.OSMesaMakeCurrent(self._context, pixels, _UNSIGNED_BYTE, _SIDE, _SIDE))

    def load_opengl_function(self, name: str) -> int:
        """Return the address of a GL function, 0 if it does not exist."""
        return int(self._library.OSMesaGetProcAddress(name.encode()) or 0)

    def __enter__(self) -> OSMesaLoader:
        if self._context and not self._make_current():
            raise ContextError("osmesa: OSMesaMakeCurrent failed")
        return self

    def __exit__(self, *exception: object) -> None:
        self._library.OSMesaMakeCurrent(None, None, _UNSIGNED_BYTE, 0, 0)

    def release(self) -> None:
        """Destroy the context and all its objects; a second call does nothing."""
        if self._context:
            self._library.OSMesaDestroyContext(self._context)
            self._context = None
