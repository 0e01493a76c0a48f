"""Plain English: `.ci/prose.py` finds what is not plain. `make lint` asks it of all pages."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

from tests.support.repository import ROOT

SCRIPT = ROOT / ".ci" / "prose.py"
spec = importlib.util.spec_from_file_location("prose", SCRIPT)
assert spec is not None
assert spec.loader is not None
prose = importlib.util.module_from_spec(spec)
spec.loader.exec_module(prose)

LONG = " ".join(["word"] * 25)


def found(text: str) -> list[str]:
    """file:line of each finding, and how its message begins."""
    return [f"{each.where} {' '.join(each.message.split()[:2])}" for each in prose.findings_of("a.md", text)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"{LONG}.\n", []),
        (f"One.\n\n{LONG} more.\n", ["a.md:3 26 words,"]),
        (f"A sentence\nbefore. {LONG}\nmore. And one.\n", ["a.md:2 26 words,"]),
        (f"- an item\n- {LONG} more\n", ["a.md:2 26 words,"]),
        (f"{LONG}, e.g. this.\n", ["a.md:1 27 words,"]),
        (f"{LONG}: `a b c d`.\n", ["a.md:1 26 words,"]),
        (f"# {LONG} more\n", []),
        (f"| {LONG} more |\n|---|\n| {LONG} more |\n", []),
        (f"```\n{LONG} more\n```\n", []),
        (f"```{{note}}\nShort.\n{LONG} more\n```\n", ["a.md:3 26 words,"]),
        (f"[{LONG}](a/target/of/some/length/more.md)\n", []),
        (f"---\ntitle: {LONG} more\n---\n\n{LONG} more\n", ["a.md:5 26 words,"]),
    ],
)
def test_long_sentences(text: str, expected: list[str]):
    assert found(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("From 3 to 5.5 ms.", ["3", "5.5"]),
        ("It takes 1,024 sets of 256 x 256 pixels, 3 %.", ["1,024", "256 x 256", "3"]),
        ("The error is 1e-3, then 2.5e-4.", ["1e-3", "2.5e-4"]),
        ("OpenGL 4.3, Mesa 22.3 and Python 3.11 on an H100.", []),
        ("See figure 7, table 3 and Walter 1995, or ISO 15469, LM-63 and CIE 171:2006.", []),
        ("Figures 9 to 18, 16 and 17.", []),
        ("A 16-bit box of 4 children since 2026-11-25.", ["4"]),
        ("Of 3 paths 2 end.", ["3", "2"]),
    ],
)
def test_numbers_to_keep_in_mind(text: str, expected: list[str]):
    assert prose.numbers(text) == expected


def test_numbers_of_a_sentence_and_of_a_table():
    assert found("It has 1, 2 and 3.\n\n| 1, 2, 3 and 4 |\n|---|\n") == ["a.md:1 numbers 1,"]
    assert found("It has 1 and 2. It has 3 and 4. It has `5, 6, 7`.\n") == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("In this\nplace.\n", ["a.md:2 'place': use"]),
        ("| the way |\n|---|\n", ["a.md:1 'way': use"]),
        ("# It goes on\n", ["a.md:1 'goes on':"]),
        ("A figure\nbeside\nMitsuba.\n", ["a.md:2 'beside mitsuba':"]),
        ("`place` and ![the way](places.png)\n", ["a.md:1 'way': use"]),
        ("![all](place.png) and [this](ways.md)\n", []),
    ],
)
def test_words(text: str, expected: list[str]):
    assert found(text) == expected


def test_notebooks_are_read_by_their_cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    cells = [
        {"cell_type": "code", "source": ["place = 1\n"]},
        {"cell_type": "markdown", "source": ["One.\n", "\n", "The place."]},
    ]
    (tmp_path / "a.ipynb").write_text(json.dumps({"cells": cells}))
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    assert [each.where for each in prose.findings_in(tmp_path / "a.ipynb")] == ["a.ipynb:cell 2:3"]


def test_the_list_of_pages_that_are_not_clean_becomes_shorter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "a.md").write_text("Clean.\n")
    (tmp_path / "docs" / "b.md").write_text("No way.\n")
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    monkeypatch.setattr(prose, "NOT_YET", frozenset({"docs/a.md", "docs/b.md", "docs/c.md"}))
    assert [(each.where, each.message.partition(":")[0]) for each in prose.findings()] == [
        ("docs/a.md:1", "is clean"),
        ("docs/c.md:1", "is not there"),
    ]
