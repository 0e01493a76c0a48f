"""`python -m benchmarks walks`: runs the documentation as six readers would, each in an empty folder.

The wheel is built as by `make wheel`, and each walk creates the environment and installs what the pages name. Home
folders are empty, so that shaders and kernels are compiled. Only pip keeps its cache and its settings.
"""

from __future__ import annotations

import json
import math
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.verdict import Condition, Report, judge, machine
from benchmarks.walks import LAMP, MAX_MINUTES, ROOT, WALKS, Walk, file_of, lines_of
from glpath.errors import GlpathError, UsageError
from glpath.system.files import write_bytes
from glpath.system.terminal import say

RESULT = Path("benchmarks/results/walks.json")
_SECONDS = 1800
_PACKAGES = ("glpath", "moderngl", "numpy", "numba")
_INSTALLERS = ("apt-get ", "python3 -m venv ", "pip ")


def walks(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Some of them; all by default.")
    ] = None,
    result: Annotated[Path, typer.Option(metavar="FILE", help="Where the result goes.")] = RESULT,
    system: Annotated[
        bool, typer.Option("--system", help="Run apt-get too: of a machine that may be changed.")
    ] = False,
) -> None:
    """Follow the documentation as six readers would, and write how long each takes to a result.

    If only some are named, the rows of the others in the file stay.
    """
    known = {walk.name: walk for walk in WALKS}
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise UsageError(f"walks: no walk is named {unknown[0]!r}; allowed are {', '.join(known)}")
    rows = kept_rows(result) if names else {}
    with tempfile.TemporaryDirectory() as folder:
        wheels = built_wheel(Path(folder))
        for name in names or known:
            rows[name] = walked(known[name], Path(folder) / name.replace(" ", "-"), wheels, system)
            row = rows[name]
            say(f"{name}: {row['reading_min']:.1f} min to read, {row['run_s']:.0f} s to run", err=True)
            # Write after each walk, so that a failure loses no other row.
            write_bytes(report([rows[name] for name in known if name in rows]).as_json().encode(), result)


def kept_rows(result: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of the stored result by name; empty if there is none."""
    if not result.is_file():
        return {}
    return {row["name"]: row for row in json.loads(result.read_text("utf-8"))["rows"]}


def built_wheel(folder: Path) -> Path:
    """Build the wheel of this checkout; return its folder `dist`. Raises GlpathError if that fails."""
    command = [sys.executable, "-m", "pip", "-q", "wheel", "--no-deps", "-w", str(folder / "dist"), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_SECONDS)
    if done.returncode:
        raise GlpathError(f"walks: the wheel is not built:\n{done.stdout}{done.stderr}".rstrip())
    return folder / "dist"


def walked(walk: Walk, folder: Path, wheels: Path, system: bool = False) -> dict[str, Any]:
    """Run all commands of a walk's pages, and return its row. Raises GlpathError if a command fails."""
    (folder / "home").mkdir(parents=True)
    shutil.copytree(wheels, folder / "dist")
    bring(walk.brought, folder)
    environment = environment_of(folder)
    spent = dict.fromkeys(("install_s", "run_s", "processor_s"), 0.0)
    commands = 0
    for reading in walk.readings:
        for command in prepared(list(reading.blocks()), folder, system):
            installs = command.startswith(_INSTALLERS)
            home = {} if installs else {"HOME": str(folder / "home")}
            start, before = time.perf_counter(), processor_s()
            run_line(f"{walk.name}: {reading.page}", command, folder, {**environment, **home})
            spent["install_s" if installs else "run_s"] += time.perf_counter() - start
            spent["processor_s"] += processor_s() - before
            commands += 1
    if not (folder / walk.result).exists():
        raise GlpathError(f"walks: {walk.name} ends without {walk.result}")
    return {
        "name": walk.name,
        "reader": walk.reader,
        "versions": installed(folder / ".venv" / "bin" / "python"),
        "pages": ", ".join(Path(reading.page).name for reading in walk.readings),
        "lines": walk.lines,
        "words": walk.words,
        "reading_min": walk.reading_min,
        "commands": commands,
        **spent,
        "result": walk.result,
    }


def installed(python: Path) -> dict[str, str]:
    """Return the versions of an environment's Python and of its rendering packages."""
    code = "; ".join(
        (
            "import json, platform",
            "from importlib.metadata import version",
            f"found = {{name: version(name) for name in {_PACKAGES}}}",
            "print(json.dumps({'Python': platform.python_version(), **found}))",
        )
    )
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
    found: dict[str, str] = json.loads(done.stdout)
    return found


def processor_s() -> float:
    """Return the processor seconds of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def bring(names: Sequence[str], folder: Path) -> None:
    """Write the files that a reader already has: a model, a lamp, a notebook of the checkout."""
    import trimesh

    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".ies":
            path.write_text(LAMP)
        elif path.suffix == ".ipynb":
            shutil.copy(ROOT / name, path)
        else:
            trimesh.creation.box([6, 3, 4]).export(path)


def environment_of(folder: Path) -> dict[str, str]:
    """Return this process's environment, with the walk's Python environment first in the path."""
    left_out = ("PYTHONPATH", "PYTHONHOME", "CI", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "MESA_SHADER_CACHE_DIR")
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    path = os.pathsep.join([str(folder / ".venv" / "bin"), kept.get("PATH", os.defpath)])
    return {**kept, "PATH": path, "VIRTUAL_ENV": str(folder / ".venv")}


def prepared(blocks: Sequence[tuple[str, str, str]], folder: Path, system: bool = False) -> list[str]:
    """Return the commands of blocks, in order, after writing the scenes and tests that they need.

    system : include commands that install packages of the system
    """
    commands = []
    for kind, text, before in blocks:
        if kind == "sh":
            commands += list(lines_of(text, system))
        elif kind in ("toml", "python"):
            name = file_of(kind, text, before)
            if name == "walk.py":
                name = f"walk-{len(commands)}.py"
                commands.append(f"python {name}")
            (folder / name).write_text(text)
    return commands


def run_line(where: str, command: str, folder: Path, environment: Mapping[str, str]) -> None:
    """Run a command in a shell. Raises GlpathError with its output if it fails."""
    done = subprocess.run(
        ["sh", "-e", "-c", command],
        cwd=folder,
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=_SECONDS,
    )
    if done.returncode:
        raise GlpathError(f"walks: {where}: {command} failed:\n{done.stdout}{done.stderr}".rstrip())


def report(rows: Sequence[dict[str, Any]]) -> Report:
    """Return the result of the walks."""
    from glpath.gl.context import get_context

    measured = {
        "walks": float(len(rows)),
        "longest_reading_min": max(row["reading_min"] for row in rows),
        "processor_s": math.fsum(row["processor_s"] for row in rows),
    }
    rule = (Condition("longest_reading_min", "<=", float(MAX_MINUTES)),)
    claim, holds = judge("from the README's first line to a result in five minutes of reading", rule, measured)
    found = machine(get_context().info.renderer)
    return Report("walks", claim, measured, holds, list(rows), found, rows[-1]["versions"])


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("walks")(walks)
