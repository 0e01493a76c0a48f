"""Tables of numbers from `benchmarks/results/*.json`: the directive `results`.

    ```{results} gather-box-256 gather-room-128
    scene: name
    by the gather, s: gather_s .2f
    by Mitsuba, s: mitsuba_s .1f
    ```

A row is a file. A line is a column: its title and the key of `measured`, or `name`, `holds` or `claim`, with a
format; a key with blanks is in quotes. With `:rows:` the rows are the objects of the key `rows` of one file. Below
the table stands what was measured, on which machine and by which versions. What is missing is an error: no number
of the documentation is typed by hand.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

from glpath_docs.markdown import table

_ON = "Measured on "
RESULTS = Path(__file__).resolve().parents[3] / "benchmarks" / "results"
_COLUMN = re.compile(r"(?P<title>.+):\s+(?:\"(?P<quoted>[^\"]+)\"|(?P<key>\S+))(?:\s+(?P<format>\S+))?")


class MissingResultError(ExtensionError):
    """A table asks for a number that nobody has measured, or that is no longer stored."""


@dataclass(frozen=True)
class Column:
    """One column of a table.

    title : what stands above it
    key   : of `measured`, or of a row
    spec  : how a number is written, as `format` takes it; "" for text
    """

    title: str
    key: str
    spec: str

    def of(self, record: Mapping[str, Any], place: str) -> str:
        """The cell of a record."""
        if self.key not in record:
            known = ", ".join(sorted(record))
            raise MissingResultError(f"{place}: has no {self.key!r}. It has: {known}")
        value = record[self.key]
        if value is None:  # what a bench could not measure, such as the time to an error that is not reached
            return "\u2013"
        if isinstance(value, bool):
            return "yes" if value else "no"
        return format(value, self.spec) if self.spec else str(value)


def columns_of(lines: Sequence[str]) -> list[Column]:
    """The columns of a directive."""
    found = [(line, _COLUMN.fullmatch(line.strip())) for line in lines if line.strip()]
    wrong = [line for line, match in found if match is None]
    if wrong or not found:
        raise MissingResultError(
            f"results: the column {(wrong or [''])[0]!r}, but each line is `title: key [format]`"
        )
    return [Column(m["title"], m["quoted"] or m["key"], m["format"] or "") for _, m in found if m is not None]


def result(name: str, folder: Path = RESULTS) -> dict[str, Any]:
    """A stored result. Raises MissingResultError."""
    path = folder / f"{name}.json"
    try:
        found = json.loads(path.read_text("utf-8"))
    except FileNotFoundError as error:
        raise MissingResultError(
            f"{path.name}: is not in {folder.name}/; `make bench BENCH={name}` makes it"
        ) from error
    if not isinstance(found, dict):
        raise MissingResultError(f"{path.name}: is not one object")
    return found


def records(name: str, found: Mapping[str, Any], rows: bool) -> list[dict[str, Any]]:
    """The rows of a result: its own, or one of all that was measured."""
    if not rows:
        return [
            {
                "name": name,
                "holds": found.get("holds"),
                "claim": found.get("claim"),
                "cpu": (found.get("machine") or {}).get("cpu"),
                **found.get("measured", {}),
            }
        ]
    made = found.get("rows")
    if not isinstance(made, list) or not made:
        raise MissingResultError(f"{name}.json: has no rows")
    return made


def results_table(names: Sequence[str], columns: Sequence[Column], rows: bool, folder: Path = RESULTS) -> str:
    """The table and its source, as Markdown."""
    found = {name: result(name, folder) for name in names}
    body = [
        [column.of(record, f"{name}.json") for column in columns]
        for name, each in found.items()
        for record in records(name, each, rows)
    ]
    sources = "; and on ".join(dict.fromkeys(source(each).removeprefix(_ON) for each in found.values()))
    return f"{table([column.title for column in columns], body)}\n{_ON}{sources}.\n"


def source(found: Mapping[str, Any]) -> str:
    """On what a result was measured, by which versions and when."""
    machine, versions = found.get("machine") or {}, found.get("versions") or {}
    cpu, renderer = machine.get("cpu"), machine.get("renderer")
    cores = f"{machine['cores']} cores of " if "cores" in machine else ""
    parts = [f"{cores}{cpu}" if cpu else "", renderer or "", *(f"{key} {value}" for key, value in versions.items())]
    said = ", ".join(part for part in parts if part)
    if not said:
        raise MissingResultError(f"{found.get('name', 'a result')}: does not say on which machine it was measured")
    return f"{_ON}{said}" + (f", {found['date']}" if "date" in found else "")


class Results(SphinxDirective):
    """```{results} NAME ...``` with columns as lines, and `:rows:`."""

    required_arguments = 1
    final_argument_whitespace = True
    has_content = True
    option_spec: ClassVar[Any] = {"rows": directives.flag}

    def run(self) -> list[nodes.Node]:
        names = self.arguments[0].split()
        for name in names:
            self.env.note_dependency(str(RESULTS / f"{name}.json"))
        text = results_table(names, columns_of(list(self.content)), "rows" in self.options)
        made = self.parse_text_to_nodes(text)
        for each in made:
            if isinstance(each, nodes.table):
                each["classes"].append("numbers")
        return made


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("results", Results)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
