"""The pages of docs/explanation: files that they name are there, and so are the names in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.repository import ROOT

PAGES = sorted((ROOT / "docs" / "explanation").glob("*.md"))

_FILE = r"(?:glpath|shaders|benchmarks|tests|scenes|\.ci)/[\w./-]*"
#: `name` in `file`
_NAMED = re.compile(rf"`(\w+)` in `({_FILE})`")


def files(text: str) -> Iterator[str]:
    """All files and folders of the repository that a page names."""
    yield from re.findall(rf"`({_FILE})`", text)


def missing(text: str, folder: Path) -> list[str]:
    """What a page names and the repository has not; links go from the folder of the page."""
    found = [f"{file}: no such file" for file in files(text) if not (ROOT / file).exists()]
    for name, file in _NAMED.findall(text):
        if (ROOT / file).is_file() and not re.search(rf"\b{name}\b", (ROOT / file).read_text("utf-8")):
            found.append(f"{file}: has no {name}")
    for target in re.findall(r"\]\(([^)#]+)", text):
        if ":" not in target and not (folder / target).exists():
            found.append(f"{target}: no such page")
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_names_is_there(page: Path) -> None:
    assert missing(page.read_text("utf-8"), page.parent) == []


def test_what_is_not_there_is_found() -> None:
    text = (
        "`leave` in `shaders/path/path_rays.glsl`, `nobody` in `glpath/errors.py`, `glpath/none.py`, [a](none.md)"
    )
    assert missing(text, ROOT / "docs" / "explanation") == [
        "glpath/none.py: no such file",
        "glpath/errors.py: has no nobody",
        "none.md: no such page",
    ]


@pytest.mark.parametrize(
    ("paper", "tables", "figures"), [("path-buffer", 6, 13), ("t-buffer", 0, 18), ("shaft-culling", 1, 4)]
)
def test_a_paper_has_its_page_with_its_tables_and_figures(paper: str, tables: int, figures: int) -> None:
    text = (ROOT / "docs" / "explanation" / f"{paper}.md").read_text("utf-8")
    for word, count in (("table", tables), ("figure", figures)):
        named: set[int] = set()
        for numbers in re.findall(rf"{word}s? (\d+(?:(?: to | and |, )\d+)*)", text, re.IGNORECASE):
            for begin, end in re.findall(r"(\d+)(?: to (\d+))?", numbers):
                named |= set(range(int(begin), int(end or begin) + 1))
        assert set(range(1, count + 1)) <= named, word
