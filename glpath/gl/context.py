"""The OpenGL context: one per process, made when first asked for, on the best device there is.

In order: EGL on a hardware device, EGL on a software device (Mesa's llvmpipe), OSMesa. None needs a display. Which
device, in order: the arguments of `get_context`, the environment (GLPATH_BACKEND = auto | egl | osmesa,
GLPATH_DEVICE = the index that `glpath devices` shows), the order above. glcontext's own variables
(GLCONTEXT_DEVICE_INDEX and others) are not looked at, as they would beat an explicit choice.

One per process, because GL names its objects by small numbers that mean other objects in another context: an object
of the first, collected while the second is current, deletes the second's object of the same number, and moderngl
does not guard against it. Who needs two devices starts two processes. No display is ever terminated (eglTerminate):
EGL shares one per device with everybody in the process.

Whoever asks may have each device tried in a process of its own first, as a broken driver can end the process that
asks it: renders do so in the kernel of a notebook.

Costs:    about 20 ms on llvmpipe, up to a second on a hardware device, a Python start more where that is tried
          first; nothing when cached.
Poor at:  threads (a context belongs to one at a time, see `Context.leave`) and fork (see `Context.check`).
Source:   EGL_EXT_device_enumeration, EGL_EXT_platform_device, EGL_MESA_device_software.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import moderngl
from glcontext import egl

from glpath.errors import ContextError
from glpath.gl.osmesa import OSMesaLoader, load_osmesa
from glpath.gl.program import forget_programs

REQUIRED_VERSION = 430
BACKENDS = ("auto", "egl", "osmesa")

# Sonames, as the names without a number belong to development packages. libegl1 alone brings no libGL.so.1, and
# needs none: the functions can be had from libEGL itself.
EGL_LIBRARY = "libEGL.so.1"
GL_LIBRARIES = ("libGL.so.1", "libOpenGL.so.0", EGL_LIBRARY)

INSTALL = "Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri; `glpath doctor` says what is missing."

_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software", "lavapipe")
_PROBE_SECONDS = 60

_EGL_EXTENSIONS = 0x3055
_EGL_DRM_DEVICE_FILE = 0x3233


@dataclass(frozen=True)
class DeviceInfo:
    """A device that renders, as its driver names itself.

    backend      : egl or osmesa
    index        : number among the devices of the backend, what `device=` takes
    renderer     : GL_RENDERER
    vendor       : GL_VENDOR
    gl_version   : GL_VERSION, in which most drivers name their own version too
    version_code : 450 for OpenGL 4.5
    hardware     : False where the CPU does the work
    """

    backend: str
    index: int
    renderer: str
    vendor: str
    gl_version: str
    version_code: int
    hardware: bool

    @property
    def driver(self) -> str:
        """Name and version of the driver: `Mesa 22.3.6`, `NVIDIA 550.54`."""
        words = [w for w in self.gl_version.replace("(Core Profile)", "").split()[1:] if w]
        return " ".join(words) or self.vendor

    def __str__(self) -> str:
        version = f"{self.version_code // 100}.{self.version_code // 10 % 10}"
        kind = "hardware" if self.hardware else "software"
        return f"{self.renderer}, OpenGL {version}, {self.driver}, {self.backend} device {self.index}, {kind}"


@dataclass
class Context:
    """The process's moderngl context and what is known of its device.

    gl   : the moderngl context, with gc_mode "auto": a collected object frees what it had on the GPU
    info : the device
    pid  : the process that made it
    """

    gl: moderngl.Context
    info: DeviceInfo
    pid: int
    _loader: Any = field(repr=False)
    _thread: int | None = field(default_factory=threading.get_ident, repr=False)

    def check(self) -> None:
        """Refuse use after a fork and from a second thread.

        The driver's threads, locks and connection to the device do not survive a fork; the calls would hang or
        crash. From another thread they would reach no context at all.

        Raises
        ------
        ContextError : saying what to do instead
        """
        if os.getpid() != self.pid:
            raise ContextError(
                f"OpenGL context made in process {self.pid}, used in its fork {os.getpid()}",
                'Start the child with spawn (multiprocessing.get_context("spawn")), '
                "or create the context after the fork.",
            )
        if self._thread is not None and self._thread != threading.get_ident():
            raise ContextError(
                f"OpenGL context in use by thread {self._thread}, used in thread {threading.get_ident()}",
                "Render in one thread, or call Context.leave() in the first before the second goes on.",
            )

    def use(self) -> None:
        """Make the context current in this thread; call it before a render, as others may have changed it."""
        self.check()
        self._loader.__enter__()
        self._thread = threading.get_ident()

    def leave(self) -> None:
        """Let go of it in this thread, so that another thread may `use` it."""
        self.check()
        self._loader.__exit__(None, None, None)
        self._thread = None

    def function(self, name: str, *arguments: type) -> Callable[..., None]:
        """A GL function that moderngl does not reach, without a result, by the ctypes types of its arguments."""
        return ctypes.CFUNCTYPE(None, *arguments)(self._loader.load_opengl_function(name))

    def _release(self) -> None:
        # Destroying the context frees all it holds. From here on its Python objects must not touch GL any more:
        # their numbers may be another context's.
        self.gl.gc_mode = None  # type: ignore[assignment]
        self._loader.__exit__(None, None, None)
        self.gl.release()


_lock = threading.RLock()
_context: Context | None = None


def get_context(
    backend: str = "auto", device: int | None = None, require_gpu: bool = False, *, probe_first: bool = False
) -> Context:
    """The context of this process, made at the first call, current in the calling thread.

    Parameters
    ----------
    backend     : auto, egl or osmesa; auto takes GLPATH_BACKEND, or else what is best
    device      : index of the EGL device, as `glpath devices` lists them; None takes GLPATH_DEVICE, or the best
    require_gpu : refuse a software renderer instead of falling back to it
    probe_first : try each device in a process of its own before this one; where this process must not end

    Raises
    ------
    ContextError : no such backend or device, no OpenGL 4.3, software where a GPU is required, another device than
                   the one this process renders on already, a forked process, a second thread
    """
    global _context
    with _lock:
        if _context is None:
            _context = _create(*_chosen(backend, device), require_gpu, probe_first)
        else:
            _context.check()
            _refuse_another(_context.info, backend, device)
            if require_gpu and not _context.info.hardware:
                raise _no_gpu([str(_context.info)])
        _context.use()
        return _context


def release_context() -> None:
    """Destroy the process's context, so that the next `get_context` may take another device.

    Everything made in it is gone with it. Objects that are still referred to must not be used or released by hand
    any more: their numbers may name objects of the next context.
    """
    global _context
    with _lock:
        if _context is not None:
            _context.check()
            forget_programs(_context.gl)
            _context._release()
            _context = None


def _forget_after_fork() -> None:
    # A child that ends, or collects an object of its parent's, must not call into the dead driver.
    global _lock
    _lock = threading.RLock()
    if _context is not None:
        _context.gl.gc_mode = None  # type: ignore[assignment]


os.register_at_fork(after_in_child=_forget_after_fork)


def _refuse_another(info: DeviceInfo, backend: str, device: int | None) -> None:
    if backend == "auto" and device is None:
        return
    backend, device = _chosen(backend, device)
    if backend != info.backend or device not in (None, info.index):
        asked = backend if device is None else f"{backend} device {device}"
        raise ContextError(
            f"{asked}: this process renders on {info.backend} device {info.index} already ({info.renderer})",
            "A process has one OpenGL context: start another process for another device,\n"
            "or end this one with glpath.gl.context.release_context() when all its renders are done.",
        )


def _chosen(backend: str, device: int | None) -> tuple[str, int | None]:
    """Backend and device after the environment has been asked; a device number always means EGL or OSMesa."""
    source = "backend"
    if backend == "auto" and device is None:
        backend, source = os.environ.get("GLPATH_BACKEND") or "auto", "GLPATH_BACKEND"
    if backend not in BACKENDS:
        raise ContextError(f"{source}: no backend is named {backend!r}; allowed are {', '.join(BACKENDS)}")
    text = os.environ.get("GLPATH_DEVICE")
    # The variable counts EGL's devices; OSMesa has but one.
    if device is None and text and backend != "osmesa":
        try:
            device = int(text)
        except ValueError:
            raise ContextError(
                f"GLPATH_DEVICE: {text!r} is not a device number", "`glpath devices` lists them."
            ) from None
    if device is not None and backend == "auto":
        backend = "egl"
    return backend, device


def _create(backend: str, device: int | None, require_gpu: bool, probe_first: bool) -> Context:
    """The first candidate that works: hardware, then software, then OSMesa."""
    failures: list[str] = []
    candidates: list[_Candidate] = []
    if backend != "osmesa":
        try:
            candidates += egl_candidates()
        except ContextError as error:
            failures.append(error.message)
    if backend == "osmesa" or (backend == "auto" and not require_gpu):
        candidates.append(_Candidate("osmesa", 0, software=True))
    if device is not None:
        candidates = _only(device, backend, candidates, failures)

    demoted = []
    for candidate in candidates:
        if candidate.software:
            continue
        context = _attempt(candidate, failures, probe_first)
        if context is None:
            continue
        if context.info.hardware:
            return context
        # A graphics card without its driver is handed out as llvmpipe: no better than the software devices.
        context._release()
        demoted.append(candidate)
        failures.append(str(context.info))
    software = demoted + [candidate for candidate in candidates if candidate.software]
    if require_gpu:
        raise _no_gpu(failures + [f"{c.backend} device {c.index} (software)" for c in software if c not in demoted])
    for candidate in software:
        context = _attempt(candidate, failures, probe_first)
        if context is not None:
            return context
    raise _none_works(failures)


def _only(device: int, backend: str, candidates: list[_Candidate], failures: list[str]) -> list[_Candidate]:
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


def _no_gpu(found: list[str]) -> ContextError:
    return ContextError(
        "a GPU is required, but there is no hardware device that renders; found: "
        + ("; ".join(found) or "nothing"),
        "Install the graphics driver with its EGL library, and see that this user may open /dev/dri/renderD*\n"
        "(`glpath doctor` looks); or render in software: leave out --require-gpu.",
    )


@dataclass(frozen=True)
class _Candidate:
    """A device before anything was created on it.

    software : what the device says of itself; its renderer's name may tell more
    node     : its file, /dev/dri/..., where it has one
    """

    backend: str
    index: int
    software: bool
    node: str = ""


def egl_candidates() -> list[_Candidate]:
    """EGL's devices, hardware or not. No display is opened for it.

    Raises
    ------
    ContextError : no libEGL, one that cannot enumerate devices, or not one device
    """
    try:
        library = ctypes.CDLL(EGL_LIBRARY)
    except OSError as error:
        raise ContextError(f"egl: {EGL_LIBRARY} cannot be loaded ({error})", INSTALL) from None
    library.eglGetProcAddress.restype = ctypes.c_void_p
    library.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    query_devices = library.eglGetProcAddress(b"eglQueryDevicesEXT")
    query_string = library.eglGetProcAddress(b"eglQueryDeviceStringEXT")
    if not query_devices or not query_string:
        raise ContextError(f"egl: {EGL_LIBRARY} has no EGL_EXT_device_enumeration", INSTALL)
    pointers = ctypes.POINTER(ctypes.c_void_p)
    devices_of = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, pointers, ctypes.POINTER(ctypes.c_int))(
        query_devices
    )
    string_of = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_void_p, ctypes.c_int)(query_string)

    count = ctypes.c_int(0)
    devices_of(0, None, ctypes.byref(count))
    if count.value < 1:
        raise ContextError(f"egl: {EGL_LIBRARY} knows no device, as no driver (ICD) is installed for it", INSTALL)
    devices = (ctypes.c_void_p * count.value)()
    devices_of(count.value, devices, ctypes.byref(count))
    found = []
    for index, device in enumerate(devices[: count.value]):
        extensions = (string_of(device, _EGL_EXTENSIONS) or b"").decode(errors="replace").split()
        node = string_of(device, _EGL_DRM_DEVICE_FILE) if "EGL_EXT_device_drm" in extensions else b""
        software = "EGL_MESA_device_software" in extensions
        found.append(_Candidate("egl", index, software, (node or b"").decode(errors="replace")))
    return found


def _attempt(candidate: _Candidate, failures: list[str], probe_first: bool) -> Context | None:
    if probe_first:
        probe = _finish_probe(candidate, _start_probe(candidate))
        if probe.info is None:
            failures.append(probe.error)
            return None
    try:
        return _open(candidate)
    except ContextError as error:
        failures.append(error.message)
        return None


def _open(candidate: _Candidate) -> Context:
    """A context on this device, current, or a ContextError that names it."""
    place = f"{candidate.backend} device {candidate.index}"
    loader: Any = OSMesaLoader() if candidate.backend == "osmesa" else _egl_loader(candidate.index, place)
    try:
        gl = moderngl.create_context(standalone=True, require=REQUIRED_VERSION, context=loader)
    except Exception as error:  # moderngl raises bare Exception, ValueError and its own
        loader.__exit__(None, None, None)
        loader.release()
        raise ContextError(f"{place}: {error}", INSTALL) from error
    gl.gc_mode = "auto"
    names = gl.info
    gl.clear_errors()  # asking for all limits asks some drivers too much
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
    return Context(gl, info, os.getpid(), loader)


def _egl_loader(index: int, place: str) -> Any:
    """glcontext's EGL context; asked directly, as its wrapper lets its environment variables win."""
    gl_library = next(name for name in GL_LIBRARIES if _loads(name) or name == EGL_LIBRARY)
    settings = {"mode": "standalone", "libgl": gl_library, "libegl": EGL_LIBRARY, "device_index": index}
    try:
        return egl.create_context(glversion=REQUIRED_VERSION, **settings)
    except Exception as error:  # glcontext raises bare Exception
        reason = error
    if "eglCreateContext" not in str(reason):
        raise ContextError(f"{place}: {reason}", INSTALL) from reason
    try:
        older = egl.create_context(glversion=330, **settings)
    except Exception:
        raise ContextError(f"{place}: {reason}", INSTALL) from reason
    older.__exit__(None, None, None)
    older.release()
    raise ContextError(
        f"{place}: its driver has OpenGL 3.3 or a little more, but 4.3 is needed ({reason})",
        "Use a newer driver or another device (`glpath devices`).",
    ) from reason


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


@dataclass(frozen=True)
class DeviceProbe:
    """One line of `glpath devices`.

    info  : what renders there, None where nothing does
    error : why not, empty where it does
    auto  : this is the one that `get_context()` takes, the environment considered
    """

    backend: str
    index: int
    node: str
    info: DeviceInfo | None
    error: str
    auto: bool = False


def list_devices() -> list[DeviceProbe]:
    """Every device of the machine, each tried in a process of its own, as a broken driver can kill its process.

    Cost: a Python start for each device, at the same time. Makes no context in this process.

    Raises
    ------
    ContextError : GLPATH_BACKEND or GLPATH_DEVICE says what does not exist; never for a device that fails
    """
    backend, device = _chosen("auto", None)
    probes: list[DeviceProbe] = []
    candidates: list[_Candidate] = []
    try:
        candidates += egl_candidates()
    except ContextError as error:
        probes.append(DeviceProbe("egl", 0, "", None, error.message))
    if load_osmesa() is not None:
        candidates.append(_Candidate("osmesa", 0, software=True))
    running = [(candidate, _start_probe(candidate)) for candidate in candidates]
    probes += [_finish_probe(candidate, process) for candidate, process in running]

    able = [p for p in probes if p.info and backend in ("auto", p.backend) and device in (None, p.index)]
    taken = min(able, key=lambda p: (p.backend == "osmesa", not (p.info and p.info.hardware)), default=None)
    return [replace(p, auto=True) if p is taken else p for p in probes]


def _start_probe(candidate: _Candidate) -> subprocess.Popen[str]:
    code = "import sys; from glpath.gl.context import _probe; _probe(sys.argv[1], int(sys.argv[2]), sys.argv[3])"
    package = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")]))
    return subprocess.Popen(
        [sys.executable, "-c", code, candidate.backend, str(candidate.index), "software" * candidate.software],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )


def _probe(backend: str, index: int, software: str) -> None:
    """The child of `list_devices`: one line of JSON about one device."""
    try:
        answer: dict[str, Any] = {"info": asdict(_open(_Candidate(backend, index, bool(software))).info)}
    except ContextError as error:
        answer = {"error": error.message}
    print("\n" + json.dumps(answer), flush=True)


def _finish_probe(candidate: _Candidate, process: subprocess.Popen[str]) -> DeviceProbe:
    info, error, place = None, "", f"{candidate.backend} device {candidate.index}"
    try:
        output, log = process.communicate(timeout=_PROBE_SECONDS)
        answer = json.loads(output.splitlines()[-1]) if process.returncode == 0 else {}
        info = DeviceInfo(**answer["info"]) if "info" in answer else None
        error = answer.get("error", "")
        if not answer:
            how = f"exit code {process.returncode}"
            if process.returncode < 0:
                how = f"signal {signal.Signals(-process.returncode).name}"
            last = (log.strip().splitlines() or [""])[-1]
            error = f"{place}: its driver ended the process that tried it ({how}) {last}".strip()
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        error = f"{place}: no answer in {_PROBE_SECONDS} s"
    except (ValueError, IndexError) as problem:
        error = f"{place}: an answer that cannot be read ({problem})"
    return DeviceProbe(candidate.backend, candidate.index, candidate.node, info, error)
