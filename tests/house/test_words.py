"""The words of the house: `.ci/words.py` finds those that are not used. `make lint` asks it of all files."""

import importlib.util

import pytest

from tests.support.repository import ROOT

SCRIPT = ROOT / ".ci" / "words.py"
spec = importlib.util.spec_from_file_location("words", SCRIPT)
assert spec is not None
assert spec.loader is not None
words = importlib.util.module_from_spec(spec)
spec.loader.exec_module(words)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("MOST_RAYS = 4\n", [(1, "most")]),
        ("def f(hitPlace): ...\n", [(1, "place")]),
        ("x = 1  # the way to the light\n", [(1, "way")]),
        ('"""One.\n\nA path\ngoes on.\n"""\n', [(4, "goes on")]),
        ('raise ValueError(f"no place for {name}")\n', [(1, "place")]),
        ('key = "least_t"\n', [(1, "least")]),
        ("# at least one, at most two, of most scenes\nalways = away = 1\n", []),
        ("# sorted in place, in the last place\n", []),
        ("# in place of it\n", [(1, "place")]),
    ],
)
def test_python(text: str, expected: list[tuple[int, str]]):
    assert [(each.line, each.word) for each in words.in_python(text)] == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("float least = 0.0;\n", [(1, "least")]),
        ("float x;\nbool met;  // of a ray\n", [(2, "met")]),
        ("// at least one: the light point\n", [(1, "light point")]),
        ("#ifdef LAMP_EDGES\n", [(1, "lamp_edges")]),
        ("vec3 away = -wi;  // metal at a minimum\n", []),
    ],
)
def test_glsl(text: str, expected: list[tuple[int, str]]):
    assert [(each.line, each.word) for each in words.in_glsl(text)] == expected


def test_every_word_has_another_to_use():
    tables = (words.WORDS, words.IDENTIFIERS, words.PHRASES, words.IN_DOCUMENTS)
    assert all(instead for table in tables for instead in table.values())
