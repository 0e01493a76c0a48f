"""Environment variables that glpath reads or sets."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from glpath.gl.devices import BACKENDS
from glpath.gl.llvmpipe import TEXELS
from glpath_docs.markdown import code, table

#: Variables that only glpath defines: allowed values and effect, by name. A test checks that this table and the
#: next contain exactly the variables that the code accesses.
GLPATH = {
    "GLPATH_BACKEND": (", ".join(map(code, BACKENDS)), "how OpenGL is opened, where `--backend` does not say it"),
    "GLPATH_DEVICE": ("a number", "a device of `glpath devices`, where `--device` does not say it"),
    "GLPATH_TRUST_FILES": ("`1`", "reading files has no limits of processor time and memory"),
    "GLPATH_TEXELS": (
        ", ".join(map(code, TEXELS)),
        "how shaders read textures: as graphics cards or as llvmpipe do best",
    ),
}
#: Variables of other programs that the code of glpath accesses: allowed values and effect, by name.
OTHERS = {
    "LP_NUM_THREADS": (
        "a number",
        "threads of llvmpipe; `--threads` sets it. glpath makes 1 to 0, which is one thread as well",
    ),
    "OIDN_NUM_THREADS": ("a number", "threads of the denoiser; `--threads` sets it"),
    "NUMBA_NUM_THREADS": (
        "a number from 1",
        "threads of compiled kernels; any other value ends a command with an error",
    ),
    "NUMBA_CACHE_DIR": (
        "a folder",
        "where compiled kernels are kept instead of the package's folder. Kernels are code that is run: name a "
        "folder of your own, which nobody else can write to",
    ),
    "NUMBA_CACHE_LOCATOR_CLASSES": ("names of classes", "numba's choice of that folder"),
    "PYTHONSAFEPATH": (
        "`1`, or empty",
        "commands and `Cluster` set it to `1` for their processes, so that they import no modules of the current "
        "folder",
    ),
    "COLUMNS": ("a number from 1 to 9999", "width of tables and of help; any other value is ignored"),
    "TERMINAL_WIDTH": ("a number from 1 to 9999", "width of help; any other value is ignored"),
    "CI": ("anything but `0`, `false`, `no`", "image tests fail for a missing baseline, and write none"),
    "PYTHONPATH": ("folders", "passed on to the processes that try each device"),
    "LIBGL_DRIVERS_PATH": ("folders", "where `glpath doctor` looks for Mesa's drivers first"),
    "MESA_SHADER_CACHE_DISABLE": (
        "`1`, `true` or `yes`",
        "`glpath doctor` reports that shaders are compiled in each process",
    ),
    "MESA_SHADER_CACHE_DIR": ("a folder", "where Mesa keeps compiled shaders; `glpath doctor` checks it"),
    "XDG_CACHE_HOME": ("a folder", "where Mesa keeps them without the variable before"),
    "HOME": ("a folder", "where Mesa keeps them without either, in `.cache`"),
    "MPLBACKEND": ("the name of a backend", "ignored by commands; in Python, matplotlib uses it"),
    "_GLPATH_COMPLETE": ("`complete_bash` ...", "what a shell asks for when it completes a command"),
    "COMP_WORDS": ("words", "the command that bash completes"),
    "COMP_CWORD": ("a number", "the word that bash completes"),
}
#: Variables that only libraries read, but that are useful to users of glpath.
OF_LIBRARIES = {
    "NUMBA_DISABLE_JIT": ("`1`", "kernels run as Python, for a debugger"),
    "GALLIUM_OVERRIDE_CPU_CAPS": ("`nosse` ...", "which of the CPU's instructions llvmpipe uses"),
}


def pages() -> dict[str, str]:
    """Return the text of the page of environment variables, by its path in the documentation."""
    rows = [
        (code(name), values, meaning)
        for each in (GLPATH, OTHERS, OF_LIBRARIES)
        for name, (values, meaning) in each.items()
    ]
    text = [
        "# Environment variables\n",
        "An option of the command line wins over a variable.\n",
        table(("variable", "values", "what it does"), rows),
    ]
    return {"reference/environment.md": "\n".join(text)}


def read_by(source: str, file: str = "code") -> Iterator[str]:
    """Yield the names of the environment variables that Python code reads or sets.

    file : name of the file, for the error

    Raises ValueError if the code computes a name, because the name is then not in the source.
    """
    if "environ" not in source and "getenv" not in source:
        return
    tree = ast.parse(source)
    loops = {
        target.target.id: [str(each.value) for each in target.iter.elts if isinstance(each, ast.Constant)]
        for target in ast.walk(tree)
        if isinstance(target, ast.comprehension | ast.For)
        and isinstance(target.target, ast.Name)
        and isinstance(target.iter, ast.Tuple | ast.List)
    }
    for node in ast.walk(tree):
        key = _key(node)
        if key is None:
            continue
        if isinstance(key, ast.Constant) and isinstance(key.value, str):
            yield key.value
        elif isinstance(key, ast.Name) and loops.get(key.id):
            yield from loops[key.id]
        else:
            raise ValueError(f"{file}:{node.lineno}: looks up {ast.unparse(key)}, whose name is not in sight")  # type: ignore[attr-defined]


def _key(node: ast.AST) -> ast.expr | None:
    """Return the expression of the variable's name if a node accesses the environment; otherwise None."""
    if isinstance(node, ast.Subscript) and _is_environment(node.value):
        return node.slice
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
        of_environment = _is_environment(node.func.value) and node.func.attr in ("get", "pop", "setdefault")
        if of_environment or ast.unparse(node.func) == "os.getenv":
            return node.args[0]
    return None


def _is_environment(node: ast.expr) -> bool:
    return ast.unparse(node) in ("os.environ", "environ")


def of_package(folder: Path) -> dict[str, list[str]]:
    """Return, by variable name, the files of a package that read or set the variable."""
    found: dict[str, list[str]] = {}
    for path in sorted(folder.rglob("*.py")):
        for name in read_by(path.read_text("utf-8"), str(path)):
            found.setdefault(name, []).append(path.relative_to(folder).as_posix())
    return found
