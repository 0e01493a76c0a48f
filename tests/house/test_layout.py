"""Tests mirror the package: those of glpath/io/gltf are in tests/io/gltf, and so on."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import slow_tests
from tests.support.repository import ROOT, TESTS

#: Of no room: the repository, whole pictures, the witnesses against each other, a project of its own.
OTHERS = {"house", "pictures", "reference", "example_project"}


def has_room(file: Path) -> bool:
    """Whether a room of the code is named as the folder of the test, given from tests/ on."""
    folder = file.parent
    if folder == Path() or str(folder) in OTHERS:
        return str(folder) in OTHERS
    room = ROOT / folder if folder.parts[0] == "benchmarks" else ROOT / "glpath" / folder
    return (room / "__init__.py").exists()


def test_every_test_is_in_a_folder_named_as_its_room():
    files = [path.relative_to(TESTS) for path in TESTS.rglob("test_*.py")]
    assert len(files) > 100
    assert [str(file) for file in sorted(files) if not has_room(file)] == []


@pytest.mark.parametrize(
    "file",
    ["test_loose.py", "obj/test_a.py", "gl/gltf/test_a.py", "benchmarks/io/test_a.py", "house/io/test_a.py"],
)
def test_a_misplaced_one_is_found(file: str):
    assert not has_room(Path(file))


@pytest.mark.parametrize("file", ["io/gltf/test_a.py", "benchmarks/peers/test_a.py", "pictures/test_a.py"])
def test_one_in_its_room_is_not(file: str):
    assert has_room(Path(file))


def test_each_slow_test_is_there():
    named = {line.split("[")[0] for line in slow_tests()}
    assert len(named) > 100
    texts = {file: (TESTS / file).read_text() for file in {line.split("::")[0] for line in named}}
    missing = [line for line in sorted(named) if f"def {line.split('::')[-1]}(" not in texts[line.split("::")[0]]]
    assert missing == []
