"""Plain English in the documentation: `python .ci/prose.py [FILE ...]` lists what is not, as file:line: message.

Three rules: the words of `.ci/words.py`, sentences of at most 25 words, at most two numbers in a sentence.

Markdown is read by markdown-it, notebooks by their Markdown cells. A code span is one word, and `256 x 256` is one
number. Numbers of code, tables, versions, years, figures and standards do not count. Headings and tables have words
and no sentences. Pages that are not yet clean stand in `NOT_YET`, which only becomes shorter: a clean one has to be
taken off.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / ".ci"))

from words import IN_DOCUMENTS, PHRASES, in_prose  # noqa: E402

#: What is read.
READ = ("README.md", "CHANGELOG.md", "docs/**/*.md", "notebooks/*.ipynb")
#: Pages that are not yet clean.
NOT_YET: frozenset[str] = frozenset()

MAX_WORDS = 25
MAX_NUMBERS = 2

#: Fences of MyST whose content is prose.
_PROSE_FENCES = ("note", "tip", "hint", "important", "warning", "caution", "seealso", "admonition", "dropdown")
_CODE = "\N{OBJECT REPLACEMENT CHARACTER}"  # a code span: one word, without a number
_ABBREVIATIONS = (
    "e.g.",
    "i.e.",
    "etc.",
    "al.",
    "cf.",
    "vs.",
    "fig.",
    "figs.",
    "p.",
    "pp.",
    "approx.",
    "no.",
    "rec.",
)
#: Words whose number is a name: figure 7, issue 12, version 3.
_NAMED_BY_NUMBER = re.compile(
    r"(?:fig(?:ure|\.)s?|figures|tables?|sections?|equations?|appendix|chapters?|pages?|pp?\.|steps?|versions?"
    r"|issues?|rows?|notebooks?|scenes?|codes?|status|levels?|types?|rec\.)$",
    re.IGNORECASE,
)
_NUMBER = re.compile(
    r"(?<![\w.,:/^-])[-+~]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?"
    r"(?:(?: x |x|:)\d+(?:,\d{3})*)*"  # 256 x 256 and 16:9
    r"(?![A-Za-z]|,?[-/]?\.?\d|-[a-z])"
)
_AND = re.compile(r"(?:,|,? (?:to|and|or)|-)\s*$")


class Finding(NamedTuple):
    where: str
    message: str


class Block(NamedTuple):
    """A paragraph, heading, item or cell of a table."""

    line: int
    text: str
    sentences: bool


def _line_of(inline: Token) -> int:
    return inline.map[0] + 1 if inline.map else 1


def _text(inline: Token) -> str:
    """Without targets of links and HTML, code spans as one word, lines as they are."""
    parts = []
    for child in inline.children or ():
        if child.type in ("text", "html_inline"):
            # A role of MyST, {ref}`name`, is its code span.
            parts.append(re.sub(r"\{[\w:-]+\}$", "", child.content) if child.type == "text" else "")
        elif child.type == "code_inline":
            parts.append(_CODE)
        elif child.type in ("softbreak", "hardbreak"):
            parts.append("\n")
        elif child.type == "image":
            parts.append(f"{child.content}.")  # its alternative text
    return "".join(parts)


def blocks(text: str, line: int = 1) -> Iterator[Block]:
    """All that is prose in Markdown that begins at a line."""
    front = re.match(r"---\n.*?\n---\n", text, re.DOTALL)
    if front:
        text, line = text[front.end() :], line + front[0].count("\n")
    opened: list[str] = []
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        if token.nesting == 1:
            opened.append(token.type)
        elif token.nesting == -1:
            opened.pop()
        elif token.type == "inline":
            sentences = not {"heading_open", "table_open"} & set(opened)
            yield Block(line + _line_of(token) - 1, _text(token), sentences)
        elif token.type == "fence" and token.info.strip().lstrip("{").split("}")[0] in _PROSE_FENCES:
            yield from blocks(token.content, line + _line_of(token))


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """Of a block, each with the number of lines before it."""
    begin = 0
    for match in re.finditer(r"[.!?][\"')\]]*(?=\s|$)", text):
        word = text[: match.end()].split()[-1].lstrip("([\"'")
        if word.lower() in _ABBREVIATIONS or re.fullmatch(r"[A-Z]\.", word):
            continue
        yield text.count("\n", 0, begin + _blank(text[begin:])), text[begin : match.end()].strip()
        begin = match.end()
    if text[begin:].strip():
        yield text.count("\n", 0, begin + _blank(text[begin:])), text[begin:].strip()


def _blank(text: str) -> int:
    return len(text) - len(text.lstrip())


def word_count(sentence: str) -> int:
    return sum(any(c.isalnum() or c == _CODE for c in word) for word in sentence.split())


def numbers(sentence: str) -> list[str]:
    """Those that a reader has to keep in mind."""
    found, last, last_is_name = [], 0, False
    for match in _NUMBER.finditer(sentence):
        before = sentence[: match.start()].split()
        previous, first = (before[-1].strip("([,;:"), len(before) == 1) if before else ("", True)
        between = sentence[last : match.start()]
        # The first word of a sentence is a name where it has a second capital, as OpenGL.
        names = _NAMED_BY_NUMBER.search(previous) or re.match(r"\w*[A-Z]" if first else "[A-Z]", previous[first:])
        names = bool(names) or (last_is_name and _AND.fullmatch(between) is not None)  # figures 9, 10 and 12
        last, last_is_name = match.end(), names
        year = re.fullmatch(r"(19|20)\d\d", match[0])
        date = re.match(r"\d{4}-\d\d-\d\d", sentence[match.start() :])
        if not (names or year or date):
            found.append(match[0])
    return found


def findings_of(name: str, text: str, line: int = 1) -> Iterator[Finding]:
    """Of a page, or of a cell of a notebook."""
    for block in blocks(text, line):
        for each in in_prose(block.text, block.line, PHRASES | IN_DOCUMENTS):
            yield Finding(f"{name}:{each.line}", f"{each.word!r}: use {each.instead}")
        if not block.sentences:
            continue
        for before, sentence in sentences(block.text):
            where, begin = f"{name}:{block.line + before}", " ".join(sentence.replace(_CODE, "`...`").split())[:50]
            if (count := word_count(sentence)) > MAX_WORDS:
                yield Finding(where, f"{count} words, of {MAX_WORDS}: {begin!r} ...: two sentences, or a list")
            if len(found := numbers(sentence)) > MAX_NUMBERS:
                yield Finding(where, f"numbers {', '.join(found)}, of {MAX_NUMBERS}: {begin!r} ...: a table")


def findings_in(path: Path) -> Iterator[Finding]:
    """Of a file."""
    name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        yield from findings_of(name, text)
        return
    for number, cell in enumerate(json.loads(text)["cells"], 1):
        if cell["cell_type"] == "markdown":
            yield from findings_of(f"{name}:cell {number}", "".join(cell["source"]))


def pages() -> list[Path]:
    """All that are read."""
    return sorted(path for pattern in READ for path in ROOT.glob(pattern))


def findings() -> Iterator[Finding]:
    """Of all pages; a page of `NOT_YET` is one if it is clean, or not there."""
    for path in pages():
        name = path.relative_to(ROOT).as_posix()
        if name not in NOT_YET:
            yield from findings_in(path)
        elif not any(findings_in(path)):
            yield Finding(f"{name}:1", "is clean: take it off NOT_YET in .ci/prose.py")
    for name in sorted(NOT_YET - {path.relative_to(ROOT).as_posix() for path in pages()}):
        yield Finding(f"{name}:1", "is not there: take it off NOT_YET in .ci/prose.py")


def main(files: Sequence[str]) -> int:
    found = [each for file in files for each in findings_in(Path(file).resolve())] if files else list(findings())
    for each in found:
        print(f"{each.where}: {each.message}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
