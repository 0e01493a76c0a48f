"""What the structure of the code is, in numbers: `python .ci/house.py [--json FILE] [--wheel]`.

modules, lines       : of the package, without benchmarks; `code` has no blank lines, comments and docstrings
loose                : modules at the package's top besides __init__, __main__ and errors
circles              : groups of modules that import each other, deferred imports counted, type checking's not
longest_function     : lines; kernels and command-line callbacks too
most_parameters      : without command-line callbacks and public calls
longest_shader_function, shaders : lines; files of shaders
render_files         : files of rendering, integrators, buffers, gl and film that run in a second render of a scene
words                : occurrences of words that the house does not use, in names and in prose (words.py)
wheel_kib            : size of the wheel, with --wheel
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import words

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "glpath"
RENDER_ROOMS = ("rendering", "integrators", "buffers", "gl", "film")


def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def line_kinds(text: str) -> tuple[int, int]:
    """Lines of code, and of comments and docstrings."""
    tree = ast.parse(text)
    prose: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                prose.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT and lines[token.start[0] - 1].lstrip().startswith("#"):
            prose.add(token.start[0])
    blank = {i for i, line in enumerate(lines, 1) if not line.strip()}
    return len(lines) - len(prose | blank), len(prose - blank)


def imports(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """The package's modules that a module imports, anywhere but under TYPE_CHECKING."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.Import):
            found.update(each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.update(f"{node.module}.{each.name}" for each in node.names)
            found.add(node.module)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text()))
    targets = {each if each in known else each.rpartition(".")[0] for each in found}
    # A package's __init__ that is named only on the way to a module below it.
    longer = {each for each in found if each in known}
    return {t for t in targets & known.keys() if t != name and not any(o.startswith(t + ".") for o in longer)}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected groups of more than one [Tarjan 1972]."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(v: str) -> None:
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in graph[v]:
            if w not in index:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in stack:
                low[v] = min(low[v], index[w])
        if low[v] == index[v]:
            group = []
            while True:
                group.append(stack.pop())
                if group[-1] == v:
                    break
            if len(group) > 1:
                found.append(sorted(group))

    sys.setrecursionlimit(10_000)
    for v in graph:
        if v not in index:
            visit(v)
    return found


def functions(text: str) -> Iterator[tuple[str, int, int, bool]]:
    """Name, lines, parameters, and whether the parameters do not count."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            a = node.args
            names = [each.arg for each in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
            count = len([each for each in names if each not in ("self", "cls")])
            decorators = " ".join(ast.unparse(each) for each in node.decorator_list)
            annotated = any("typer." in ast.unparse(each.annotation) for each in a.args if each.annotation)
            public_call = len(a.kwonlyargs) > 4 and not node.name.startswith("_")
            free = annotated or public_call or "with_options" in decorators
            yield node.name, (node.end_lineno or 0) - node.lineno + 1, count, free


def shader_functions(text: str) -> Iterator[tuple[str, int]]:
    """Name and lines of the functions of a shader."""
    lines = text.splitlines()
    for start, line in enumerate(lines):
        if (m := re.match(r"^\w[\w ]*\b(\w+)\(.*", line)) and not line.rstrip().endswith(";"):
            for end in range(start, len(lines)):
                if lines[end].startswith("}") or (end == start and "}" in line):
                    yield m[1], end - start + 1
                    break


RENDER = """
import os, sys, glpath
scene = glpath.load_scene("cornell-box-36")
options = {"spp": 1, "resolution": (32, 32), "max_depth": 2}
glpath.render(scene, **options)
root, files = os.path.dirname(glpath.__file__) + os.sep, set()
def seen(frame, event, argument):
    if frame.f_code.co_filename.startswith(root):
        files.add(frame.f_code.co_filename[len(root):])
sys.setprofile(seen)
glpath.render(scene, **options)
sys.setprofile(None)
print("\\n".join(sorted(files)))
"""


def measured(with_wheel: bool) -> dict[str, Any]:
    known = modules()
    texts = {name: path.read_text() for name, path in known.items()}
    kinds = [line_kinds(text) for text in texts.values()]
    graph = {name: imports(name, path, known) for name, path in known.items()}
    every = [(f"{name}.{f}", *rest) for name, text in texts.items() for f, *rest in functions(text)]
    shaders = sorted(p for p in (ROOT / "shaders").rglob("*.*"))
    in_shaders = [(f"{p.name}:{f}", n) for p in shaders for f, n in shader_functions(p.read_text())]
    ran = subprocess.run([sys.executable, "-c", RENDER], capture_output=True, text=True, cwd=ROOT, check=True)
    files = ran.stdout.split()
    rooms = [f for f in files if f.split(os.sep)[0].removesuffix(".py").split("_")[0] in RENDER_ROOMS]
    found = circles(graph)
    result: dict[str, Any] = {
        "modules": len(known),
        "lines": sum(len(text.splitlines()) for text in texts.values()),
        "code": sum(k[0] for k in kinds),
        "text": sum(k[1] for k in kinds),
        "loose": len([p for p in PACKAGE.glob("*.py") if p.stem not in ("__init__", "__main__", "errors")]),
        "circles": [len(group) for group in found],
        "longest_function": list(max(((n, lines) for n, lines, *_ in every), key=lambda e: e[1])),
        "most_parameters": list(max(((n, count) for n, _, count, free in every if not free), key=lambda e: e[1])),
        "functions_above_8_parameters": len([1 for *_, count, free in every if not free and count > 8]),
        "shaders": len(shaders),
        "longest_shader_function": list(max(in_shaders, key=lambda e: e[1])),
        "shader_functions_above_60_lines": len([1 for _, n in in_shaders if n > 60]),
        "render_files": len(rooms),
        "render_files_all": len(files),
        "words": words.counts(),
    }
    if with_wheel:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(["sh", ".ci/setup", "--wheel", folder], cwd=ROOT, check=True, capture_output=True)
            result["wheel_kib"] = sum(p.stat().st_size for p in Path(folder).glob("*.whl")) // 1024
    return result


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--json", type=Path, help="also write the numbers here")
    options.add_argument("--wheel", action="store_true", help="build the wheel, too")
    given = options.parse_args()
    numbers = measured(given.wheel)
    for key, value in numbers.items():
        print(f"{key:<32} {value}")
    if given.json:
        given.json.write_text(json.dumps(numbers, indent=2) + "\n")
