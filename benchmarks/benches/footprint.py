"""Cost of glpath before it renders: the packages of its core, and the load time of its entry points.

Times are processor times, medians of runs that take turns, after one run that compiles bytecode. They include the
start of Python, except for the plugin's, for which pytest is loaded first.

measured:
    packages, megabytes        : packages that `pip install glpath` installs without extras, and the size of their
                                 files
    numba_megabytes            : size of numba and llvmlite, included above
    python_ms                  : start of an empty Python
    help_ms, render_help_ms    : `glpath --help`, `glpath render --help`
    plugin_ms, plugin_modules  : load time of the pytest plugin's entry point, and number of modules that it loads
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from importlib.metadata import Distribution, PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmarks.timing import in_turns
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.errors import GlpathError
from glpath.system.machine import core_count
from glpath.system.versions import versions

RULE = (
    Condition("help_ms", "<=", 300.0),
    Condition("render_help_ms", "<=", 400.0),
    Condition("plugin_ms", "<=", 5.0),
)
_PLUGIN = """
import sys, time
import pytest
before, started = len(sys.modules), time.process_time()
import glpath.apps.image_tests
print(time.process_time() - started, len(sys.modules) - before)
"""


def bench_footprint(rounds: int = 7, progress: Callable[[str], None] = lambda text: None) -> Report:
    """Count and time. Raises GlpathError if a process fails."""
    progress("files of the core")
    sizes = core_sizes()
    commands = {
        "python": ["-c", "pass"],
        "glpath --help": ["-m", "glpath", "--help"],
        "glpath render --help": ["-m", "glpath", "render", "--help"],
    }
    for arguments in commands.values():
        _run(arguments)
    plugin_cost()
    progress(f"{rounds} turns")
    contestants: dict[str, Callable[[], float]] = {
        name: partial(_processor_s, arguments) for name, arguments in commands.items()
    }
    seconds = in_turns(contestants | {"plugin": lambda: plugin_cost()[0]}, rounds)
    measured = {
        "packages": float(len(sizes)),
        "megabytes": sum(sizes.values()) / 1e6,
        "numba_megabytes": sum(sizes.get(name, 0) for name in ("numba", "llvmlite")) / 1e6,
        "python_ms": 1e3 * seconds["python"],
        "help_ms": 1e3 * seconds["glpath --help"],
        "render_help_ms": 1e3 * seconds["glpath render --help"],
        "plugin_ms": 1e3 * seconds["plugin"],
        "plugin_modules": float(plugin_cost()[1]),
    }
    claim, holds = judge("help and the pytest plugin cost little where they are not used", RULE, measured)
    largest = sorted(sizes.items(), key=lambda each: -each[1])
    return Report(
        "footprint",
        claim,
        measured,
        holds,
        rows=[{"package": name, "megabytes": size / 1e6} for name, size in largest],
        machine=machine("none"),
        versions=versions("glpath", "numpy", "numba", "typer", "pytest"),
        notes=_busy(),
    )


def _busy() -> list[str]:
    """Return a note if other work was running, because shared caches then also increase processor time."""
    waiting = os.getloadavg()[0]
    return [f"the machine was busy: load average {waiting:.0f}"] if waiting > core_count() + 1 else []


def core_sizes() -> dict[str, int]:
    """Return the size in bytes of each package that glpath needs without extras, by name, without glpath itself."""
    found: dict[str, int] = {}
    waiting = _needs(_installed("glpath"))
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        package = _installed(name)
        files = [package.locate_file(file) for file in package.files or ()]
        found[name] = sum(os.path.getsize(str(file)) for file in files if os.path.isfile(str(file)))
        waiting += _needs(package)
    return found


def _installed(name: str) -> Distribution:
    try:
        return distribution(name)
    except PackageNotFoundError as error:
        raise GlpathError(f"bench footprint: {name} is not installed.", "Install glpath by pip.") from error


def _needs(package: Distribution) -> list[str]:
    wanted = [Requirement(text) for text in package.requires or ()]
    return [
        canonicalize_name(each.name)
        for each in wanted
        if each.marker is None or each.marker.evaluate({"extra": ""})
    ]


def plugin_cost() -> tuple[float, int]:
    """Return the processor seconds that importing the pytest plugin adds, and the number of loaded modules."""
    seconds, modules = _run(["-c", _PLUGIN]).stdout.split()
    return float(seconds), int(modules)


def _processor_s(arguments: list[str]) -> float:
    """Return the user and system time of one process, seconds."""
    before = os.times()
    _run(arguments)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def _run(arguments: list[str]) -> subprocess.CompletedProcess[bytes]:
    # Container images set this variable, with which each process would compile all modules again.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        [sys.executable, *arguments], stdin=subprocess.DEVNULL, capture_output=True, check=False, env=environment
    )
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines() or ["no word"]
        raise GlpathError(f"bench footprint: python {' '.join(arguments)} failed: {said[-1]}")
    return done
