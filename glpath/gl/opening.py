"""Creation of a context on the best available device or on a requested one; `context` keeps it for the process.

Order:    EGL on a hardware device, EGL on a software device (Mesa's llvmpipe), OSMesa. None needs a display.
          glcontext's own variables (GLCONTEXT_DEVICE_INDEX and others) are ignored, because they would override an
          explicit choice.
Source:   EGL 1.5, 3.7.3; EGL_EXT_platform_device.
"""

from __future__ import annotations

import ctypes
import json
import os
import threading
from dataclasses import asdict, dataclass
from typing import Any

import moderngl

from glpath.errors import ContextError, argument
from glpath.gl.devices import (
    EGL_LIBRARY,
    GL_LIBRARIES,
    INSTALL,
    REQUIRED_VERSION,
    Candidate,
    DeviceInfo,
    egl_candidates,
    finish_probe,
    library_loads,
    start_probe,
)
from glpath.gl.fences import asks_for_one_thread
from glpath.gl.memory import NamingContext
from glpath.gl.osmesa import OSMesaLoader

_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software", "lavapipe")

_EGL_OPENGL_API = 0x30A2


class CollectingContext(NamingContext):
    """Context of moderngl whose objects free their device memory when Python collects them.

    Python may collect them in any thread. In the thread where the context is current they are deleted at once. In
    another thread the calls would reach no context, so the objects wait in `objects`, and the next thread with the
    context deletes them.

    holder : identifier of the thread where the context is current
    """

    holder: int | None
    # Kept here, because modules may be gone when the last objects are deleted.
    _this_thread = staticmethod(threading.get_ident)

    @property  # type: ignore[override]  # its declared type lacks None
    def gc_mode(self) -> str | None:
        if self._gc_mode is None:
            return None
        return "auto" if self.holder == self._this_thread() else "context_gc"

    @gc_mode.setter
    def gc_mode(self, mode: str | None) -> None:
        self._gc_mode = mode


@dataclass
class Opened:
    """Opened device with its context, which is not current in any thread.

    loader : context manager that makes the context current in this thread and releases it at the end
    """

    gl: CollectingContext
    info: DeviceInfo
    loader: Any

    def destroy(self) -> None:
        """Free the context's resources.

        Its Python objects no longer call GL, because another context may reuse their numbers.
        """
        self.gl.gc_mode = None
        self.loader.__exit__(None, None, None)
        self.gl.release()


def open_best(backend: str, device: int | None, require_gpu: bool, probe_first: bool) -> Opened:
    """Return the first candidate that works: hardware, then software, then OSMesa."""
    if asks_for_one_thread(os.environ.get("LP_NUM_THREADS")):
        os.environ["LP_NUM_THREADS"] = "0"  # read by the driver when it is loaded
    failures: list[str] = []
    candidates: list[Candidate] = []
    if backend != "osmesa":
        try:
            candidates += egl_candidates()
        except ContextError as error:
            failures.append(error.message)
    if backend == "osmesa" or (backend == "auto" and not require_gpu):
        candidates.append(Candidate("osmesa", 0, software=True))
    if device is not None:
        candidates = _only(device, backend, candidates, failures)

    demoted = []
    for candidate in candidates:
        if candidate.software:
            continue
        opened = _attempt(candidate, failures, probe_first)
        if opened is None:
            continue
        if opened.info.hardware:
            return opened
        # EGL serves a graphics card without its driver by llvmpipe, which is no better than the software devices.
        opened.destroy()
        demoted.append(candidate)
        failures.append(str(opened.info))
    software = demoted + [candidate for candidate in candidates if candidate.software]
    if require_gpu:
        raise no_gpu(failures + [f"{c.backend} device {c.index} (software)" for c in software if c not in demoted])
    for candidate in software:
        opened = _attempt(candidate, failures, probe_first)
        if opened is not None:
            return opened
    raise _none_works(failures)


def _only(device: int, backend: str, candidates: list[Candidate], failures: list[str]) -> list[Candidate]:
    chosen = [c for c in candidates if c.index == device and c.backend == backend]
    if not chosen:
        if failures:
            raise _none_works(failures)
        allowed = ", ".join(str(c.index) for c in candidates if c.backend == backend) or "none"
        raise ContextError(
            f"{backend} device {device}: there is no such device; this machine has: {allowed}",
            "`glpath devices` lists them with their names.",
        )
    return chosen


def _none_works(failures: list[str]) -> ContextError:
    text = failures[0] if len(failures) == 1 else "no OpenGL context:" + "".join(f"\n  {f}" for f in failures)
    return ContextError(text, INSTALL)


def no_gpu(found: list[str]) -> ContextError:
    return ContextError(
        "a GPU is required, but there is no hardware device that renders; found: "
        + ("; ".join(found) or "nothing"),
        "Install the graphics driver with its EGL library, and see that this user may open /dev/dri/renderD*\n"
        f"(`glpath doctor` looks); or render in software: leave out {argument('require_gpu', True)}.",
    )


def _attempt(candidate: Candidate, failures: list[str], probe_first: bool) -> Opened | None:
    if probe_first:
        probe = finish_probe(candidate, start_probe(candidate))
        if probe.info is None:
            failures.append(probe.error)
            return None
    try:
        return open_device(candidate)
    except ContextError as error:
        failures.append(error.message)
        return None


def open_device(candidate: Candidate) -> Opened:
    """Create a context on this device, not current in any thread. Raises ContextError that names the device."""
    name = f"{candidate.backend} device {candidate.index}"
    loader: Any = OSMesaLoader() if candidate.backend == "osmesa" else _EGLLoader(candidate.index, name)
    try:
        gl = moderngl.create_context(standalone=True, require=REQUIRED_VERSION, context=loader)
    except Exception as error:  # moderngl raises bare Exception, ValueError and its own
        loader.__exit__(None, None, None)
        loader.release()
        raise ContextError(f"{name}: {error}", INSTALL) from error
    gl.__class__ = CollectingContext
    assert isinstance(gl, CollectingContext)
    gl.holder = None
    gl.gc_mode = "auto"
    names = gl.info
    gl.clear_errors()  # reading all limits gives errors on some drivers
    loader.__exit__(None, None, None)
    renderer = str(names["GL_RENDERER"])
    by_name = any(word in renderer.lower() for word in _SOFTWARE_RENDERERS)
    info = DeviceInfo(
        backend=candidate.backend,
        index=candidate.index,
        renderer=renderer,
        vendor=str(names["GL_VENDOR"]),
        gl_version=str(names["GL_VERSION"]),
        version_code=int(gl.version_code),
        hardware=not (candidate.software or by_name),
    )
    return Opened(gl, info, loader)


class _EGLLoader:
    """EGL context of glcontext, current after creation; raises ContextError if it cannot be made current."""

    def __init__(self, index: int, name: str) -> None:
        self._name = name
        self._loader = _egl_context(index, name)
        library = ctypes.CDLL(EGL_LIBRARY)
        self._bind_api, self._current, self._error = (
            library.eglBindAPI,
            library.eglGetCurrentContext,
            library.eglGetError,
        )
        self._current.restype = ctypes.c_void_p
        self._handle = self._current()

    def load_opengl_function(self, name: str) -> int:
        """Return the address of a GL function, 0 if it does not exist."""
        return int(self._loader.load_opengl_function(name))

    def __enter__(self) -> _EGLLoader:
        self._bind_api(_EGL_OPENGL_API)  # each thread has its own API, initially OpenGL ES
        self._loader.__enter__()
        if self._handle is not None and self._current() != self._handle:
            raise ContextError(f"{self._name}: cannot be made current in this thread (EGL {self._error():#x})")
        return self

    def __exit__(self, *exception: object) -> None:
        self._loader.__exit__(*exception)

    def release(self) -> None:
        """Destroy the context and all its objects."""
        self._handle = None
        self._loader.release()


def _egl_context(index: int, name: str) -> Any:
    """Create glcontext's EGL context directly, because its wrapper gives environment variables precedence."""
    from glcontext import egl  # late, because it exists only on Linux

    gl_library = next(name for name in GL_LIBRARIES if library_loads(name) or name == EGL_LIBRARY)
    settings = {"mode": "standalone", "libgl": gl_library, "libegl": EGL_LIBRARY, "device_index": index}
    try:
        return egl.create_context(glversion=REQUIRED_VERSION, **settings)
    except Exception as error:  # glcontext raises bare Exception
        reason = error
    if "eglCreateContext" not in str(reason):
        raise ContextError(f"{name}: {reason}", INSTALL) from reason
    try:
        older = egl.create_context(glversion=330, **settings)
    except Exception:
        raise ContextError(f"{name}: {reason}", INSTALL) from reason
    older.__exit__(None, None, None)
    older.release()
    raise ContextError(
        f"{name}: its driver has OpenGL 3.3 or a little more, but 4.3 is needed ({reason})",
        "Use a newer driver or another device (`glpath devices`).",
    ) from reason


def probed(backend: str, index: int, software: str) -> None:
    """Print one line of JSON about one device; runs in a child process of `list_devices`."""
    try:
        answer: dict[str, Any] = {"info": asdict(open_device(Candidate(backend, index, bool(software))).info)}
    except ContextError as error:
        answer = {"error": error.message}
    print("\n" + json.dumps(answer), flush=True)
