"""The API reference from the docstrings, by pdoc: `python .ci/docs.py out/docs`. A warning is an error.

Docstrings are written to be read in an editor: what a parameter is stands beside its name, in columns. Here the
columns become lists, which is all that pdoc's own formats do not know.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import pkgutil
import re
import sys
import typing
import warnings
from pathlib import Path

# A name or several, a space, a colon: prose has no space there.
ROW = re.compile(r"^(?P<indent> *)(?P<name>[\w.*\"][^:`]{0,70}?) +: (?P<text>\S.*)$")
REMARK = re.compile(r"^(?P<name>Costs?|Poor at|Limits|Sources?|Raises|Warns|Units|Frame): +(?P<text>\S.*)$")
HEADING = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)

# Faces and workshops: what they do is said by --help and docs/.
LEFT_OUT = (
    "glpath.__main__",
    "glpath.cli",
    "glpath.system.kernels",
)


def markdown(docstring: str) -> str:
    """A docstring of this package as Markdown."""
    lines = HEADING.sub(r"###### \1\n", docstring).splitlines()
    out: list[str] = []
    at = 0
    while at < len(lines):
        line = lines[at]
        at += 1
        found = ROW.match(line) or REMARK.match(line)
        if found is not None:
            indent = len(found.groupdict().get("indent") or "")
            text = [found["text"]]
            while at < len(lines) and lines[at].startswith(" " * (indent + 2)) and not ROW.match(lines[at]):
                text.append(lines[at].strip())
                at += 1
            bullet = " " * indent + "- " if ROW.match(line) else ""
            if out and out[-1] and not (bullet and out[-1].lstrip().startswith("- **")):
                out.append("")
            out.append(f"{bullet}**{found['name']}**: {' '.join(text)}")
        elif line.startswith(">>>"):
            out += ["```python", line]
            while at < len(lines) and lines[at].strip():
                out.append(lines[at])
                at += 1
            out.append("```")
        else:
            if line and out and out[-1].lstrip().startswith("- **"):
                out.append("")
            out.append(line)
    return "\n".join(out)


def documented() -> list[str]:
    """The modules that are documented, the package first."""
    package = importlib.import_module("glpath")
    names = ["glpath", *(m.name for m in pkgutil.walk_packages(package.__path__, "glpath."))]
    hidden = re.compile("|".join(rf"{re.escape(name)}(\.|$)" for name in LEFT_OUT))
    return [name for name in names if not hidden.match(name) and "._" not in name]


def resolve_constructors(names: list[str]) -> None:
    """Give the constructors of data types types in place of names, which pdoc would look for in another module."""
    for name in names:
        for value in vars(importlib.import_module(name)).values():
            if not isinstance(value, type) or not value.__module__.startswith("glpath."):
                continue
            constructor = value.__new__ if hasattr(value, "_fields") else value.__init__
            if dataclasses.is_dataclass(value) or hasattr(value, "_fields"):
                with contextlib.suppress(NameError):  # of what is imported for types only, which pdoc knows
                    constructor.__annotations__ = typing.get_type_hints(value)


def main(folder: Path) -> None:
    import pdoc
    import pdoc.docstrings
    import pdoc.extract
    import pdoc.render

    warnings.simplefilter("error")
    pdoc.docstrings.convert = lambda docstring, docformat, source_file: markdown(docstring)
    version = importlib.import_module("glpath").__version__
    pdoc.render.configure(docformat="markdown", footer_text=f"glpath {version}", show_source=True)
    resolve_constructors(documented())
    # pdoc adds what lies below a package, unless the package says what is public in it.
    specs: list[str] = []
    covered: set[str] = set()
    for name in documented():
        if name not in covered:
            specs.append(name)
            covered.update(pdoc.extract.walk_specs([name]))
    pdoc.pdoc(*specs, output_directory=folder)
    print(f"{folder / 'index.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
