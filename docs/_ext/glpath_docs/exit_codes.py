"""Exit codes of the commands, from what each says of its own in its help."""

from __future__ import annotations

import re
from typing import Any

import typer

from glpath.cli.commands import COMMANDS
from glpath.cli.main import app
from glpath_docs.commands import plain
from glpath_docs.markdown import code, table

_BEGIN = "Exit codes: "
_CODE = re.compile(r"(?:^|[,.] )(\d+):? ")


def pages() -> dict[str, str]:
    """The page of exit codes, by path."""
    group: Any = typer.main.get_command(app)
    common = codes_of(group.epilog.partition(";")[0])
    rows: dict[tuple[int, str], list[str]] = {}
    for name in COMMANDS:
        command = group.commands[name]
        own = codes_of(plain(command.epilog)) if command.epilog else common
        for number, meaning in own.items():
            rows.setdefault((number, meaning), []).append(f"[{code(name)}](commands/{name}.md)")
    shown = [
        (code(number), meaning, _listed(names))
        for (number, meaning), names in sorted(rows.items(), key=lambda r: r[0][0])
    ]
    text = [
        "# Exit codes\n",
        "A command prints an error as one block on standard error. A traceback is a bug in glpath.\n",
        table(("code", "meaning", "commands"), shown),
        "Code 75 is `EX_TEMPFAIL`: a scheduler may start the same command again, and it resumes.\n",
    ]
    return {"reference/exit-codes.md": "\n".join(text)}


def _listed(names: list[str]) -> str:
    if len(names) == len(COMMANDS):
        return "all"
    return "all others" if len(names) > 0.8 * len(COMMANDS) else ", ".join(names)


def codes_of(epilog: str) -> dict[int, str]:
    """The codes of a text such as "Exit codes: 0 done, 1 failed."."""
    _, _, said = epilog.partition(_BEGIN)
    parts = _CODE.split(said.strip().rstrip("."))
    return {
        int(number): meaning.strip().rstrip(".") for number, meaning in zip(parts[1::2], parts[2::2], strict=True)
    }
