"""The walks of readers: what they read is short, and what they run is on the pages that they read."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

import glpath
from benchmarks import walks_command
from benchmarks.walks import MAX_MINUTES, WALKS, Reading, Walk, file_of, lines_of, words_of
from glpath import GlpathError
from glpath_docs.reading import reading_table

named = pytest.mark.parametrize("walk", WALKS, ids=lambda walk: walk.name)


@named
def test_a_walk_begins_at_the_readme_and_is_read_in_five_minutes(walk: Walk) -> None:
    assert walk.readings[0].page == "README.md"
    assert walk.reading_min <= MAX_MINUTES, f"{walk.words} words"


@named
def test_a_page_is_linked_where_the_reader_is(walk: Walk) -> None:
    for before, reading in zip(walk.readings, walk.readings[1:], strict=False):
        read = "".join(each.text for each in (walk.readings[0], before))
        assert f"{Path(reading.page).name})" in read, reading.page


@named
def test_what_a_walk_runs_installs_and_makes_the_result(walk: Walk) -> None:
    blocks = [block for reading in walk.readings for block in reading.blocks()]
    commands = [line for kind, text, _ in blocks if kind == "sh" for line in lines_of(text)]
    assert commands[0].startswith("python3 -m venv .venv ")
    assert commands[1].startswith("pip install ")
    assert any(not command.startswith(("python3 ", "pip ")) for command in commands)
    assert not any(command.startswith(("apt-get", "make", "jupyter lab")) for command in commands)
    for name in walk.brought:
        assert any(name in text for _, text, _ in blocks), name


def test_the_table_of_the_documentation_has_every_walk() -> None:
    lines = reading_table().splitlines()[2:]
    assert [line.split(" | ")[0].strip("| ") for line in lines] == [walk.name for walk in WALKS]
    for line, walk in zip(lines, WALKS, strict=True):
        assert f"| {walk.lines} | {walk.words} | {walk.reading_min:.1f} |" in line


def test_a_section_that_is_not_there_is_an_error() -> None:
    with pytest.raises(LookupError, match="no section 'Nowhere'"):
        _ = Reading("README.md", "Nowhere", ()).text
    with pytest.raises(LookupError, match="before the end of 'Which command'"):
        list(Reading("README.md", "Which command", ("Links",)).blocks())


def test_words_are_those_that_are_shown() -> None:
    assert words_of("# A b\n\n| c | `d e` |\n|---|---|\n| [f g](docs/h.md) | ![i](j.png) |\n") == 8
    assert words_of("```sh\nglpath render a.glb -o a.png  # it\n```\n") == 6


def test_lines_are_commands_without_comments() -> None:
    text = (
        'apt-get install a    # b\npip install "glpath[bake]"\n# c\n'
        "glpath render a \\\n  -o b  # d\njupyter lab a.ipynb\n"
    )
    found = [" ".join(line.split()) for line in lines_of(text)]
    assert found == ['pip install "glpath[bake]"', "glpath render a -o b", "jupyter execute a.ipynb"]
    assert next(lines_of(text, system=True)) == "apt-get install -y a"
    assert list(lines_of("#!/bin/bash\n#SBATCH --array=0-15\nglpath render a -o b\n")) == []


def test_blocks_go_into_the_files_that_the_text_names() -> None:
    assert file_of("toml", "", "`a.toml` and then `room.toml` joins:") == "room.toml"
    assert file_of("python", "def test_a():\n    pass\n", "") == "test_walk.py"
    assert file_of("python", "import glpath\n", "") == "walk.py"


def test_blocks_become_files_and_commands(tmp_path: Path) -> None:
    blocks = [
        ("python", "print(1)\n", ""),
        ("sh", "glpath render a -o b\n", ""),
        ("toml", "a = 1\n", "`c.toml`"),
        ("js", "let a", ""),
        ("python", "def test_a(): ...\n", ""),
    ]
    assert walks_command.prepared(blocks, tmp_path) == ["python walk-0.py", "glpath render a -o b"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.toml", "test_walk.py", "walk-0.py"]


def test_a_command_that_fails_says_where(tmp_path: Path) -> None:
    walks_command.run_line("a", "true", tmp_path, {"PATH": "/bin:/usr/bin"})
    with pytest.raises(GlpathError, match=r"a: echo no; exit 3 failed:\nno"):
        walks_command.run_line("a", "echo no; exit 3", tmp_path, {"PATH": "/bin:/usr/bin"})


def test_a_walk_has_an_environment_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PYTHONPATH", "CI"):
        monkeypatch.setenv(name, "1")
    found = walks_command.environment_of(tmp_path)
    assert not {"PYTHONPATH", "CI"} & set(found)
    assert found["PATH"].startswith(str(tmp_path / ".venv" / "bin") + os.pathsep)


def test_versions_are_those_of_the_environment() -> None:
    found = walks_command.installed(Path(sys.executable))
    assert found["Python"] == sys.version.split()[0]
    assert found["glpath"] == glpath.__version__


@pytest.mark.evidence
@pytest.mark.release
def test_all_walks_end_with_their_results(tmp_path: Path) -> None:
    walks_command.walks(None, tmp_path / "walks.json")
    found = json.loads((tmp_path / "walks.json").read_text("utf-8"))
    assert [row["name"] for row in found["rows"]] == [walk.name for walk in WALKS]
    assert found["holds"] is True
    assert found["versions"] == found["rows"][-1]["versions"]
