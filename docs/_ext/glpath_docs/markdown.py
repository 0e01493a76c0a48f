"""Pieces of Markdown that the pages from the code are made of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def code(text: object) -> str:
    """Text as code, in a paragraph or in a cell of a table."""
    shown = str(text).replace("\n", " ")
    fence = "``" if "`" in shown else "`"
    return f"{fence}{shown}{fence}"


def cell(text: object) -> str:
    """Text as a cell of a table: one line, without bars of its own."""
    return " ".join(str(text).split()).replace("|", "\\|")


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table with these heads."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cell(each) for each in line)} |" for line in lines) + "\n"


def block(kind: str, text: str) -> str:
    """A block of code."""
    return f"```{kind}\n{text.rstrip()}\n```\n"


def directive(name: str, argument: str = "", body: str = "", **options: str) -> str:
    """A directive of MyST, with colons, as its body may have blocks of code."""
    lines = [f":::{{{name}}} {argument}".rstrip(), *(f":{key}: {value}" for key, value in options.items())]
    if body:
        lines += ["", body.rstrip()] if options else [body.rstrip()]
    return "\n".join([*lines, ":::"]) + "\n"


def toctree(*pages: str, caption: str = "") -> str:
    """A hidden list of pages."""
    options = {"hidden": "", **({"caption": caption} if caption else {})}
    lines = [f":{key}: {value}".rstrip() for key, value in options.items()]
    return "\n".join(["```{toctree}", *lines, "", *pages, "```"]) + "\n"
