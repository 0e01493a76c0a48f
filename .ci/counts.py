"""Count what makes the code easy or hard to own, as JSON: `python .ci/counts.py [ROOT]`.

Run it in two checkouts to compare them. Options of the command line, public names and modules of a render are
counted by importing glpath, so the environment must have it.
"""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

#: Modules with fewer lines than this are short.
SHORT = 100
_CONDITIONAL = re.compile(r"^\s*#\s*(if|ifdef|ifndef|elif)\b", re.MULTILINE)

# Runs in the checkout: the options of all commands, the public names, and the modules whose functions one render of
# the box calls, by package.
_IMPORTED = """
import json, sys, threading, collections
import glpath
from glpath.cli.commands import COMMANDS
from glpath.cli.main import app
import typer
options = set()
def visit(command):
    for each in getattr(command, "commands", {}).values() if hasattr(command, "commands") else ():
        visit(each)
    for parameter in command.params:
        options.update(name for name in parameter.opts if name.startswith("--"))
command = typer.main.get_command(app)
with command.make_context("glpath", [], resilient_parsing=True) as context:
    for name in command.list_commands(context):
        visit(command.get_command(context, name))
called = set()
def record(frame, event, argument):
    if event == "call":
        called.add(frame.f_code.co_filename)
threading.setprofile(record)
sys.setprofile(record)
glpath.render("cornell-box", spp=1, resolution=(16, 16))
sys.setprofile(None)
threading.setprofile(None)
parts = [name.partition("/glpath/")[2].split("/") for name in called if "/glpath/" in name and name.endswith(".py")]
passed = collections.Counter(part[0] if len(part) > 1 else "glpath" for part in parts)
print(json.dumps({
    "public_names": len(glpath.__all__),
    "options": len(options),
    "modules_of_a_render": dict(sorted(passed.items())),
}))
"""


def modules_of(root: Path) -> dict[str, Path]:
    """Return the modules of the package by dotted name."""
    found = {}
    for path in sorted((root / "glpath").rglob("*.py")):
        found[".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")] = path
    return found


def imports_of(modules: dict[str, Path]) -> dict[str, set[str]]:
    """Return the modules that each module imports anywhere, also in functions and for types only."""
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        found: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found.update(each.name for each in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                for each in node.names:
                    inner = f"{node.module}.{each.name}"
                    found.add(inner if inner in modules else node.module)
        graph[name] = {each for each in found if each in modules and each != name}
    return graph


def cycles_of(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of modules that import each other, directly or through others (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in graph[name]:
            if other not in index:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == index[name]:
            part = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(part) > 1:
                found.append(sorted(part))

    sys.setrecursionlimit(10_000)
    for name in graph:
        if name not in index:
            visit(name)
    return found


def counts_of(root: Path) -> dict[str, Any]:
    """Return all counts of a checkout."""
    modules = modules_of(root)
    graph = imports_of(modules)
    importers: dict[str, set[str]] = defaultdict(set)
    for name, others in graph.items():
        for other in others:
            importers[other].add(name)
    lines = {name: path.read_text().count("\n") for name, path in modules.items()}
    classes = Counter(
        node.name
        for path in modules.values()
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    shaders = [path.read_text() for path in sorted((root / "shaders").rglob("*")) if path.is_file()]
    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(each["layers"] for each in contracts if each["type"] == "layers")
    done = subprocess.run(
        [sys.executable, "-c", _IMPORTED], cwd=root, capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    return {
        "lines": sum(lines.values()),
        "modules": len(modules),
        "packages": len({name.split(".")[1] for name in modules if name.count(".") > 1}),
        "layers": len(layers),
        "cycles": cycles_of(graph),
        "short_modules_with_one_importer": sorted(
            name
            for name, path in modules.items()
            if lines[name] < SHORT and path.name != "__init__.py" and len(importers[name]) == 1
        ),
        "classes_of_equal_name": sum(count for count in classes.values() if count > 1),
        "lines_of_shaders": sum(text.count("\n") for text in shaders),
        "conditionals_in_shaders": sum(len(_CONDITIONAL.findall(text)) for text in shaders),
        **json.loads(done.stdout.splitlines()[-1]),
    }


if __name__ == "__main__":
    where = Path(sys.argv[1] if len(sys.argv) > 1 else ".").resolve()
    print(json.dumps(counts_of(where), indent=2))
