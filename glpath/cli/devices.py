"""`glpath devices` and `glpath doctor`: list devices that render, and diagnose what is missing.

Both work without moderngl or EGL, because they have to report that these are missing.
"""

from __future__ import annotations

import importlib.metadata
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from glpath.cli.help import command_help
from glpath.errors import ContextError, ShaderError
from glpath.gl.devices import (
    EGL_LIBRARY,
    GL_LIBRARIES,
    REQUIRED_VERSION,
    DeviceProbe,
    library_loads,
    list_devices,
)
from glpath.gl.fences import asks_for_one_thread
from glpath.gl.osmesa import load_osmesa
from glpath.system.machine import core_count
from glpath.system.numerals import unsigned
from glpath.system.terminal import clean_console, say, say_json

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def register(app: typer.Typer) -> None:
    """Add the commands `devices` and `doctor` to the command line."""
    of_devices = command_help(
        ("glpath devices", "a table"),
        ("glpath devices --json", "for programs"),
        ("glpath render cornell-box -o a.png --device 1", "takes the one with that number"),
    )
    of_doctor = command_help(
        ("glpath doctor", "what is missing, and how to get it"),
        ("glpath doctor --warm", "compile now what is compiled at first use"),
        ("glpath doctor --json", "for programs"),
    )
    app.command(**of_devices)(devices)
    app.command(**of_doctor)(doctor)


def devices(as_json: Json = False) -> None:
    """List every device that can render, and the one that is taken by default (auto).

    Each device is tried in a process of its own. GLPATH_BACKEND and GLPATH_DEVICE change what auto takes.
    Exit code 0 when one renders, 1 when none does.
    """
    probes = list_devices()
    if as_json:
        say_json([_as_plain(p) for p in probes], indent=2)
    else:
        _print(_device_table(probes))
    if not any(p.auto for p in probes):
        raise typer.Exit(1)


def _as_plain(probe: DeviceProbe) -> dict[str, Any]:
    plain = asdict(probe)
    if probe.info:
        plain["info"]["driver"] = probe.info.driver
    return plain


def _device_table(probes: list[DeviceProbe]) -> Table:
    table = Table("auto", "backend", "device", "renderer", "OpenGL", "driver", "kind")
    for p in probes:
        taken = "→" if p.auto else ""
        if p.info:
            version = f"{p.info.version_code // 100}.{p.info.version_code // 10 % 10}"
            kind = "hardware" if p.info.hardware else "software"
            table.add_row(taken, p.backend, str(p.index), p.info.renderer, version, p.info.driver, kind)
        else:
            table.add_row(taken, p.backend, str(p.index), p.error, "-", "-", "fails")
    return table


def _print(table: Table) -> None:
    for column in table.columns:
        column.overflow = "fold"  # not cut off, because names of renderers may differ only at the end
    clean_console(markup=False, highlight=False).print(table)


@dataclass(frozen=True)
class Finding:
    """One line in the report of `glpath doctor`.

    status : "ok", "missing" (rendering is impossible without it) or "note" (rendering works, but worse)
    found  : text on what the check found
    remedy : command to type, or advice; empty if nothing is wrong
    """

    check: str
    status: str
    found: str
    remedy: str = ""


def doctor(
    as_json: Json = False,
    warm: Annotated[
        bool, typer.Option("--warm", help="Then compile all kernels and shaders, for the runs to come.")
    ] = False,
) -> None:
    """Say what rendering needs on this machine, what is missing, and the package that brings it.

    Exit code 0 when rendering is possible, 1 otherwise.
    """
    findings = examine()
    possible = all(f.status != "missing" for f in findings)
    if as_json:
        say_json({"possible": possible, "findings": [asdict(f) for f in findings]}, indent=2)
    else:
        table = Table("", "check", "found", "remedy")
        for f in findings:
            table.add_row(f.status, f.check, f.found, f.remedy)
        _print(table)
        say("Rendering is possible here." if possible else "Rendering is not possible here.")
    if not possible:
        raise typer.Exit(1)
    if warm:
        from glpath.cli.warm import compile_all

        compile_all()


def examine() -> list[Finding]:
    """Return the findings of all checks. A check runs after the checks whose results it needs.

    A library that a single backend needs counts as missing only if no backend works.
    """
    threads = os.environ.get("LP_NUM_THREADS")  # read now, because creating a context may set the variable
    try:
        probes, wrong = list_devices(), ""
    except ContextError as error:
        probes, wrong = [], str(error)
    renders = any(p.auto for p in probes)
    checks: list[Callable[[], Iterator[Finding]]] = [
        _system,
        _python,
        _packages,
        _shaders,
        lambda: _libraries(renders),
        lambda: _context(probes, wrong),
        lambda: _limits() if renders else iter(()),
        lambda: _threads(threads),
        _shader_cache,
        _kernel_cache,
        _gpu_access,
    ]
    return [finding for check in checks for finding in check()]


def _system() -> Iterator[Finding]:
    system: str = sys.platform
    if system != "linux":
        text = f"{system}: glpath renders by EGL or OSMesa on Linux, and was not tried here"
        remedy = "view factors, radiosity, diff, info, validate and the pytest plugin need no OpenGL"
        yield Finding("system", "note", text, remedy)


def _python() -> Iterator[Finding]:
    version = ".".join(map(str, sys.version_info[:3]))
    good = sys.version_info >= (3, 11)
    yield Finding("Python", "ok" if good else "missing", version, "" if good else "Python 3.11 or newer")


# Patterns for the name, the minimum version and the upper limit in a requirement such as `numba<0.69,>=0.61`.
_NAME, _MINIMUM, _LIMIT = (re.compile(text) for text in (r"[\w.-]+", r">=\s*([\d.]+)", r"<\s*([\d.]+)"))
_OTHER_SYSTEM = re.compile(r"""sys_platform\s*(==|!=)\s*["'](\w+)["']""")


def _is_of_another_system(requirement: str) -> bool:
    marker = _OTHER_SYSTEM.search(requirement)
    return marker is not None and (marker[1] == "==") != (marker[2] == sys.platform)


def _packages() -> Iterator[Finding]:
    """Yield one finding on all packages that glpath requires, without those that only its extras require."""
    try:
        required = importlib.metadata.requires("glpath") or []
    except importlib.metadata.PackageNotFoundError:
        yield Finding("packages", "note", "glpath itself is not installed", "pip install .")
        return
    found, lacking, installed = [], [], []
    for requirement in required:
        if "extra ==" in requirement or _is_of_another_system(requirement):
            continue
        named = _NAME.match(requirement)
        assert named is not None, f"a requirement without a name: {requirement}"
        name, wanted = named[0], requirement.partition(";")[0].strip()
        minimum, limit = (bound[1] if bound else "" for bound in (_MINIMUM.search(wanted), _LIMIT.search(wanted)))
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            lacking.append((f"{name} is not installed", wanted))
            continue
        except KeyError:  # from Python 3.12 on; Python 3.11 returns None
            version = None
        if version is None:
            lacking.append((f"{name} has damaged metadata; remove its folder .dist-info", wanted))
            continue
        if _release(version) < _release(minimum or "0"):
            lacking.append((f"{name} {version} (needed: {minimum})", wanted))
        elif limit and _release(version) >= _release(limit):
            lacking.append((f"{name} {version} (needed: below {limit})", wanted))
        else:
            installed.append(name)
        found.append(f"{name} {version} (>= {minimum or 0})")
    lacking += [(text, name) for name, text in _not_importable(installed).items()]
    if lacking:
        remedy = "pip install " + " ".join(f'"{what}"' for _, what in lacking)
        yield Finding("packages", "missing", "; ".join(text for text, _ in lacking), remedy)
    else:
        yield Finding("packages", "ok", ", ".join(found))


_IMPORT = """
import importlib, sys
for name in sys.argv[1:]:
    print(name, end="\\t", flush=True)
    try:
        importlib.import_module(name)
        print(flush=True)
    except BaseException as error:
        print(" ".join(f"{type(error).__name__}: {error}".split()), flush=True)
"""


def _not_importable(packages: list[str]) -> dict[str, str]:
    """Return the texts of import errors by package; packages without an error are left out.

    Imports run in a separate process, because a broken library may kill the process that imports it.
    """
    modules = {module.lower(): module for module in importlib.metadata.packages_distributions()}
    names = {modules[name.lower()]: name for name in packages if name.lower() in modules}
    done = subprocess.run(
        [sys.executable, "-P", "-c", _IMPORT, *names],  # -P: without modules of the current folder
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    tried = [line.partition("\t") for line in done.stdout.splitlines() if "\t" in line]
    failed = {names[module]: f"{module} cannot be imported ({why})" for module, _, why in tried if why}
    if done.returncode and tried:
        module = tried[-1][0]
        failed[names[module]] = f"{module} cannot be imported (it ends the process with {done.returncode})"
    return failed


def _release(version: str) -> tuple[int, ...]:
    """Return the leading numbers of a version, such as (1, 2) for "1.2rc3"."""
    return tuple(int(number) for number in re.findall(r"\d+", re.match(r"[\d.]*", version)[0]))  # type: ignore[index]


def _shaders() -> Iterator[Finding]:
    try:
        from glpath.gl.program import shader_folder
    except ImportError:  # `_packages` reports the missing package
        return
    try:
        yield Finding("shaders", "ok", str(shader_folder()))
    except ShaderError as error:
        yield Finding("shaders", "missing", error.message, error.remedy)


def _libraries(renders: bool) -> Iterator[Finding]:
    lacking = "note" if renders else "missing"
    if library_loads(EGL_LIBRARY):
        functions = next((name for name in GL_LIBRARIES if library_loads(name)), "")
        yield Finding("libEGL", "ok", f"{EGL_LIBRARY}, functions from {functions}")
    else:
        yield Finding("libEGL", lacking, f"{EGL_LIBRARY} cannot be loaded", "apt-get install libegl1")
    drivers = _drivers()
    if drivers:
        yield Finding("EGL driver", "ok", ", ".join(drivers))
    else:
        yield Finding("EGL driver", lacking, "neither Mesa's nor a vendor's", "apt-get install libgl1-mesa-dri")
    if load_osmesa() is not None:
        yield Finding("libOSMesa", "ok", "the last resort, can be loaded")
    else:
        yield Finding("libOSMesa", "ok", "absent; only needed where EGL fails (Debian 12: libosmesa6)")


def _drivers() -> list[str]:
    """Return the names of the installed EGL drivers: Mesa's software rasterizer, and vendors' drivers."""
    folders = [Path(f) for f in os.environ.get("LIBGL_DRIVERS_PATH", "").split(":") if f]
    folders += [*Path("/usr/lib").glob("*-linux-gnu*/dri"), Path("/usr/lib/dri"), Path("/usr/lib64/dri")]
    # Mesa before 24.2 has a file for each driver; later versions have all drivers in libgallium.
    mesa = [f for folder in folders for f in _files_in(folder, "swrast_dri.so")]
    mesa += [f for folder in folders for f in _files_in(folder.parent, "libgallium-*.so")]
    found = [f"Mesa ({mesa[0]})"] if mesa and library_loads("libEGL_mesa.so.0") else []
    return found + [name for name in ("libEGL_nvidia.so.0",) if library_loads(name)]


def _files_in(folder: Path, pattern: str) -> list[Path]:
    """Return the files of a folder that match a pattern; an empty list if the folder cannot be read."""
    try:
        return list(folder.glob(pattern))
    except OSError:
        return []


def _context(probes: list[DeviceProbe], wrong: str) -> Iterator[Finding]:
    name = f"OpenGL {REQUIRED_VERSION // 100}.{REQUIRED_VERSION // 10 % 10}"
    if wrong:
        yield Finding(name, "missing", wrong, "unset GLPATH_BACKEND GLPATH_DEVICE")
        return
    taken = next((p for p in probes if p.auto), None)
    for p in probes:
        if p.info:
            yield Finding(name, "ok", str(p.info) + (", taken by auto" if p is taken else ""))
        else:
            status = "note" if taken else "missing"
            yield Finding(name, status, p.error)
    if not taken:
        packages = "apt-get install libegl1 libgl1-mesa-dri"
        remedy = packages if sys.platform == "linux" else "Linux, or a container of it"
        chosen = [f"{k}={os.environ[k]}" for k in ("GLPATH_BACKEND", "GLPATH_DEVICE") if os.environ.get(k)]
        if chosen:
            remedy = "unset GLPATH_BACKEND GLPATH_DEVICE, or " + remedy
        yield Finding(name, "missing", " ".join(["no device can be taken", *chosen]), remedy)


def _limits() -> Iterator[Finding]:
    from glpath.gl.context import open_context
    from glpath.gl.limits import device_limits

    # A context is opened in this process only after a probe has shown that the driver does not kill the process.
    try:
        limits = device_limits(open_context())
    except ContextError as error:
        yield Finding("limits", "missing", error.message, error.remedy)
        return
    low = [
        f"{name} {limit.value} (needed: {limit.needed}, for {limit.use})"
        for name, limit in limits.items()
        if not limit.enough
    ]
    if low:
        yield Finding("limits", "missing", "; ".join(low), "a newer driver or another device (`glpath devices`)")
    else:
        plain = ((name.removeprefix("GL_").removeprefix("MAX_"), limit) for name, limit in limits.items())
        text = ", ".join(f"{name.lower().replace('_', ' ')} {limit.value}/{limit.needed}" for name, limit in plain)
        yield Finding("limits", "ok", f"found/needed: {text}")


def _threads(chosen: str | None) -> Iterator[Finding]:
    cores = core_count()
    text = f"{cores} cores, LP_NUM_THREADS " + (
        f"= {chosen}" if chosen is not None else "not set: llvmpipe uses all"
    )
    if asks_for_one_thread(chosen):
        text += "; taken as 0, which is as quick: with one thread llvmpipe may free what that still uses"
    count = None if chosen is None else unsigned(chosen.strip())
    if count is not None and count < cores:
        yield Finding("threads", "note", text, "unset LP_NUM_THREADS")
    else:
        yield Finding("threads", "ok", text)


def _shader_cache() -> Iterator[Finding]:
    if os.environ.get("MESA_SHADER_CACHE_DISABLE", "").lower() in ("1", "true", "yes"):
        remedy = "unset MESA_SHADER_CACHE_DISABLE"
        yield Finding("shader cache", "note", "switched off: shaders are compiled anew at each start", remedy)
        return
    home = os.environ.get("XDG_CACHE_HOME") or str(Path(os.environ.get("HOME") or "/") / ".cache")
    folder = Path(os.environ.get("MESA_SHADER_CACHE_DIR") or home)
    existing = folder
    while not os.path.exists(existing) and existing != existing.parent:
        existing = existing.parent
    if os.access(existing, os.W_OK | os.X_OK):
        yield Finding("shader cache", "ok", str(folder))
    else:
        text = f"{existing} is not writable: shaders are compiled anew at each start"
        yield Finding("shader cache", "note", text, "export MESA_SHADER_CACHE_DIR=/a/writable/folder")


def _kernel_cache() -> Iterator[Finding]:
    try:
        from glpath.accel import bvh
        from glpath.system import kernels
    except Exception:  # `_packages` reports the package that cannot be imported
        return
    folder = kernels.cache_folder(bvh._build)
    if folder is not None:
        yield Finding("kernel cache", "ok", str(folder))
    else:
        text = "no folder can be written to by this user alone: kernels of radiosity are compiled at each start"
        yield Finding("kernel cache", "note", text, "export NUMBA_CACHE_DIR=/a/writable/folder")


def _gpu_access() -> Iterator[Finding]:
    nodes = sorted(Path("/dev/dri").glob("renderD*")) if os.path.isdir("/dev/dri") else []
    closed = [n for n in nodes if not os.access(n, os.R_OK | os.W_OK)]
    if closed:
        text = ", ".join(str(n) for n in closed) + " may not be opened by this user"
        yield Finding("/dev/dri", "note", text, "usermod -aG render $USER, then log in again")
    elif nodes:
        yield Finding("/dev/dri", "ok", ", ".join(str(n) for n in nodes))
    else:
        yield Finding("/dev/dri", "ok", "no graphics card shown to this system; software rendering")
    if os.path.exists("/dev/nvidiactl") and not library_loads("libEGL_nvidia.so.0"):
        remedy = "install the driver's EGL library (libnvidia-gl); in a container NVIDIA_DRIVER_CAPABILITIES=all"
        yield Finding("NVIDIA", "note", "a card, but no libEGL_nvidia.so.0 to draw with", remedy)
