"""OpenGL devices that EGL and OSMesa offer, and a test of each device in a separate process.

The arguments of `get_context` select a device, or else the environment variables: GLPATH_BACKEND = auto | egl |
osmesa, GLPATH_DEVICE = index in the list of `glpath devices`. If neither does, hardware devices of EGL precede
software devices of EGL, and these precede OSMesa.

Source:   EGL_EXT_device_enumeration, EGL_EXT_device_drm, EGL_MESA_device_software.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from glpath.errors import ContextError
from glpath.gl.osmesa import load_osmesa
from glpath.system.arguments import short_repr
from glpath.system.numerals import whole

BACKENDS = ("auto", "egl", "osmesa")
#: Minimum OpenGL version, where 430 is version 4.3.
REQUIRED_VERSION = 430

# Sonames, because names without a version number belong to development packages. The package libegl1 contains no
# libGL.so.1 and needs none, because libEGL itself offers the GL functions.
EGL_LIBRARY = "libEGL.so.1"
GL_LIBRARIES = ("libGL.so.1", "libOpenGL.so.0", EGL_LIBRARY)

INSTALL = "Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri; `glpath doctor` says what is missing."

_PROBE_SECONDS = 60

_EGL_EXTENSIONS = 0x3055
_EGL_DRM_DEVICE_FILE = 0x3233


@dataclass(frozen=True)
class DeviceInfo:
    """Description of a rendering device, from its driver.

    backend      : egl or osmesa
    index        : number among the devices of the backend, the value for `device=`
    renderer     : GL_RENDERER
    vendor       : GL_VENDOR
    gl_version   : GL_VERSION, in which most drivers include their own version
    version_code : 450 for OpenGL 4.5
    hardware     : False if the CPU renders
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
        """Name and version of the driver, such as `Mesa 22.3.6` or `NVIDIA 550.54`."""
        words = [w for w in self.gl_version.replace("(Core Profile)", "").split()[1:] if w]
        return " ".join(words) or self.vendor

    def __str__(self) -> str:
        version = f"{self.version_code // 100}.{self.version_code // 10 % 10}"
        kind = "hardware" if self.hardware else "software"
        return f"{self.renderer}, OpenGL {version}, {self.driver}, {self.backend} device {self.index}, {kind}"


def chosen(backend: str, device: int | None) -> tuple[str, int | None]:
    """Return the backend and the device index that the arguments or the environment select.

    The index is None if nothing selects a device. A device index without a backend implies EGL. Raises ContextError
    for an invalid backend or GLPATH_DEVICE.
    """
    source = "backend"
    if backend == "auto" and device is None:
        backend, source = os.environ.get("GLPATH_BACKEND") or "auto", "GLPATH_BACKEND"
    if backend not in BACKENDS:
        raise ContextError(
            f"{source}: no backend is named {short_repr(backend)}; allowed are {', '.join(BACKENDS)}"
        )
    text = os.environ.get("GLPATH_DEVICE")
    # The variable refers to EGL's devices; OSMesa has only one.
    if device is None and text and backend != "osmesa":
        try:
            device = whole(text)
        except ValueError:
            raise ContextError(
                f"GLPATH_DEVICE: {short_repr(text)} is not a device number", "`glpath devices` lists them."
            ) from None
    if device is not None and backend == "auto":
        backend = "egl"
    return backend, device


@dataclass(frozen=True)
class Candidate:
    """Device on which no context has been created yet.

    software : True if EGL lists the device as software. False is not certain, because only the renderer's name
               reveals some software devices
    node     : device file, /dev/dri/...; empty if the device has none
    """

    backend: str
    index: int
    software: bool
    node: str = ""


def library_loads(name: str) -> bool:
    """Return True if this machine can load the shared library with this soname."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def egl_candidates() -> list[Candidate]:
    """Return the hardware and software devices of EGL, without opening a display.

    Raises
    ------
    ContextError : if libEGL is missing, cannot enumerate devices, or finds no device
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
        found.append(Candidate("egl", index, software, (node or b"").decode(errors="replace")))
    return found


@dataclass(frozen=True)
class DeviceProbe:
    """Result of trying a device, shown as one line of `glpath devices`.

    info  : description of the device; None if the device cannot render
    error : reason why the device cannot render; empty if it can
    auto  : True for the device that `get_context()` takes in the current environment
    """

    backend: str
    index: int
    node: str
    info: DeviceInfo | None
    error: str
    auto: bool = False


def list_devices() -> list[DeviceProbe]:
    """Try every device of the machine and return the results.

    Each device is tried in a separate process, because a broken driver can kill the process. All processes run at
    the same time. No context is created in this process.

    Cost: one Python start per device.

    Raises
    ------
    ContextError : if GLPATH_BACKEND or GLPATH_DEVICE has an invalid value; not for a device that fails
    """
    backend, device = chosen("auto", None)
    probes: list[DeviceProbe] = []
    candidates: list[Candidate] = []
    try:
        candidates += egl_candidates()
    except ContextError as error:
        probes.append(DeviceProbe("egl", 0, "", None, error.message))
    if load_osmesa() is not None:
        candidates.append(Candidate("osmesa", 0, software=True))
    running = [(candidate, start_probe(candidate)) for candidate in candidates]
    probes += [finish_probe(candidate, process) for candidate, process in running]

    able = [p for p in probes if p.info and backend in ("auto", p.backend) and device in (None, p.index)]
    selected = min(able, key=lambda p: (p.backend == "osmesa", not (p.info and p.info.hardware)), default=None)
    return [replace(p, auto=True) if p is selected else p for p in probes]


def start_probe(candidate: Candidate) -> subprocess.Popen[str]:
    code = "import sys; from glpath.gl.opening import probed; probed(sys.argv[1], int(sys.argv[2]), sys.argv[3])"
    package = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")]))
    return subprocess.Popen(
        # -P keeps modules of the current folder from being imported.
        [
            sys.executable,
            "-P",
            "-c",
            code,
            candidate.backend,
            str(candidate.index),
            "software" * candidate.software,
        ],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )


def finish_probe(candidate: Candidate, process: subprocess.Popen[str]) -> DeviceProbe:
    info, error, name = None, "", f"{candidate.backend} device {candidate.index}"
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
            error = f"{name}: its driver ended the process that tried it ({how}) {last}".strip()
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        error = f"{name}: no answer in {_PROBE_SECONDS} s"
    except (ValueError, IndexError) as problem:
        error = f"{name}: an answer that cannot be read ({problem})"
    return DeviceProbe(candidate.backend, candidate.index, candidate.node, info, error)
