"""A page of each command, from the program itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer

from glpath.cli.commands import COMMANDS
from glpath.cli.help import EXAMPLE
from glpath.cli.main import app
from glpath_docs.markdown import block, code, directive, table

#: Of a help record's end: "[default: auto; required]".
_REMARK = re.compile(r"\s*\[((?:default: |required|env var: |[\w.-]+<=?x).*)\]$", re.DOTALL)
_FOLDER = "reference/commands"


def pages() -> dict[str, str]:
    """By path: a page of each command, and the list of them."""
    group = typer.main.get_command(app)
    with typer.Context(typer.main.get_command(app), info_name="glpath") as above:
        found = {f"{_FOLDER}/{name}.md": page(name, group.commands[name], above) for name in COMMANDS}  # type: ignore[attr-defined]
    return {f"{_FOLDER}/index.md": _index(), **found}


def _index() -> str:
    text = [
        "# Commands\n",
        "Each command prints its everyday options by `--help`, and all of them by `--help-all`.\n",
    ]
    for group in dict.fromkeys(part.group for part in COMMANDS.values()):
        rows = [
            (f"[{code(f'glpath {name}')}]({name}.md)", part.about)
            for name, part in COMMANDS.items()
            if part.group == group
        ]
        text += [f"## {group}\n", table(("command", "what it gives"), rows)]
    return "\n".join(text)


def page(name: str, command: Any, above: Any) -> str:
    """What `glpath NAME --help-all` prints, with anchors."""
    first, *rest = [plain(each) for each in (command.help or "").split("\n\n")]
    prose = [each for each in rest if not each.startswith(EXAMPLE)]
    with type(above)(command, info_name=name, parent=above) as context:
        usage = " ".join([f"glpath {name}", *command.collect_usage_pieces(context)])
        params = [each for each in command.get_params(context) if not getattr(each, "hidden", False)]
        records = [(each, record(each, context)) for each in params]
    text = [f"# glpath {name}\n", first + "\n", block("text", usage)]
    if examples := getattr(command, "examples", ()):
        text += ["## Examples\n", block("sh", "\n".join(f"{line}  # {what}" for line, what in examples))]
    text += [as_markdown(each) + "\n" for each in prose]
    if command.epilog:
        text.append(as_markdown(plain(command.epilog)) + "\n")
    arguments = [made for each, made in records if each.param_type_name == "argument"]
    options = [(each, made) for each, made in records if each.param_type_name == "option"]
    if arguments:
        text += ["## Arguments\n", *(f"{code(term)}\n: {help_of(about)}\n" for term, about in arguments)]
    everyday: frozenset[str] = getattr(command, "everyday", frozenset())
    if everyday:
        rows = [
            (", ".join(map(code, [*each.opts, *each.secondary_opts])), help_of(about))
            for each, (_, about) in options
            if each.name in everyday or each.required
        ]
        text += ["## Everyday options\n", table(("option", "what it does"), rows)]
    text += ["## All options\n" if everyday else "## Options\n", directive("program", f"glpath {name}")]
    panels = list(dict.fromkeys(getattr(each, "rich_help_panel", None) or "" for each, _ in options))
    for panel in sorted(panels, key=lambda each: not each):
        if panel or len(panels) > 1:
            text.append(f"### {panel or 'Other'}\n")
        of_panel = [made for each, made in options if (getattr(each, "rich_help_panel", None) or "") == panel]
        text += [directive("option", term.replace(" / ", ", "), help_of(about)) for term, about in of_panel]
    return "\n".join(text)


def record(parameter: Any, context: Any) -> tuple[str, str]:
    """The name with its value, and what it does, with its default."""
    term, about = parameter.get_help_record(context) or (parameter.make_metavar(context), parameter.help or "")
    return plain(term).replace("<list[Path]>", "FILE").replace("<Path>", "FILE"), plain(about)


def help_of(about: str) -> str:
    """What an option does as Markdown: its default, and whether it must be given, as a sentence."""
    remarks = _REMARK.search(about)
    text = about[: remarks.start()] if remarks else about
    said = [] if remarks is None else list(_sentences(remarks[1]))
    return " ".join([as_markdown(text), *said])


def _sentences(remarks: str) -> Iterator[str]:
    for remark in remarks.split("; "):
        if remark.startswith("default: "):
            yield f"Default: {code(remark.removeprefix('default: '))}."
        elif remark == "required":
            yield "Required."
        else:
            yield f"Range: {code(remark)}."


def plain(text: str) -> str:
    """Help as it is written, without the escapes that Rich takes away."""
    return text.replace("\\[", "[")


def as_markdown(text: str) -> str:
    """Prose of a help: options become code, and outside of code asterisks and angle brackets mean themselves."""
    parts = re.split(r"(`[^`]*`)", re.sub(r"(?<![`\w-])--[a-z][a-z-]*\w", r"`\g<0>`", text))
    return "".join(part if part.startswith("`") else re.sub(r"([*<>_$])", r"\\\1", part) for part in parts)
