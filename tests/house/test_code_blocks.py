"""Every block of code of the README and of the documentation runs, or is in a list of those that cannot, with why.

`make test` reads each block: commands have these options, Python compiles and names what there is, scenes load.
`make evidence` runs all blocks of a page, one after the other, in a folder with the files that pages name.
"""

from __future__ import annotations

import ast
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer

import glpath
from glpath.cli.main import app
from glpath.errors import GlpathError
from tests.support.code_blocks import (
    ELSEWHERE,
    LINES_NOT_RUN,
    NOT_RUN,
    PAGES,
    PROSE,
    Block,
    blocks_of,
    write_films,
    write_models,
)
from tests.support.repository import ROOT
from tests.support.small_command import smaller

BLOCKS = [block for page in PAGES for block in blocks_of(page)]
READ = [block for block in BLOCKS if block.kind not in PROSE and block.runs]
GROUP: Any = typer.main.get_command(app)


def of_kind(kind: str) -> list[Any]:
    return [pytest.param(block, id=str(block)) for block in READ if block.kind == kind]


def test_every_language_is_one_that_a_test_reads_or_a_list_names() -> None:
    assert {block.kind for block in READ} <= {"sh", "python", "toml", "xml", "json"}


@pytest.mark.parametrize("entry", [*ELSEWHERE, *NOT_RUN], ids=lambda entry: " ".join(entry))
def test_no_entry_of_the_lists_is_stale(entry: tuple[str, str]) -> None:
    kind, phrase = entry
    assert any(block.kind == kind and phrase in block.text for block in BLOCKS)
    if entry in ELSEWHERE:
        assert (ROOT / ELSEWHERE[entry]).is_file()


@pytest.mark.parametrize("block", of_kind("sh"))
def test_commands_have_these_options(block: Block) -> None:
    for line in block.commands():
        for words in programs(line):
            if words[0] != "glpath" or words[1] == "--help":
                continue
            command = GROUP.commands[words[1]]
            known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
            for word in words[2:]:
                option = word.partition("=")[0]
                if option.startswith("-") and len(option) > 1 and not re.match(r"-[\d.]", option):
                    assert option in {*known, "--help", "--help-all", "-h"}, f"{block}: {line}"


def programs(line: str) -> list[list[str]]:
    """The programs that a line calls, with their arguments."""
    words = shlex.split(line)
    ends = [i for i, word in enumerate(words) if word in ("|", "&", "&&", "||", ";")]
    parts = [words[a + 1 : b] for a, b in zip([-1, *ends], [*ends, len(words)], strict=True)]
    return [part for part in parts if part]


@pytest.mark.parametrize("block", of_kind("python"))
def test_python_compiles_and_names_what_there_is(block: Block) -> None:
    tree = ast.parse(block.text, str(block))
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "glpath":
            assert hasattr(glpath, node.attr), f"{block}: glpath.{node.attr}"


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    write_models(folder)
    return folder


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")  # of files that stand in for a reader's
@pytest.mark.parametrize("block", of_kind("toml"))
def test_scenes_load(block: Block, models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part of a scene gets what it lacks."""
    monkeypatch.chdir(models)
    described = tomllib.loads(block.text)
    text = block.text if "camera" in described else f"{block.text}\n{CAMERA}"
    Path("scene.toml").write_text(text)
    try:
        glpath.load_scene("scene.toml")
    except GlpathError as error:
        pytest.fail(f"{block}: {error}")


@pytest.mark.parametrize("block", of_kind("xml"))
def test_mitsuba_scenes_load(block: Block, tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(block.text)
    glpath.load_scene(tmp_path / "scene.xml")


CAMERA = "[camera]\nposition = [0, 1, 9]\ntarget = [0, 0, 0]\n"


@pytest.mark.parametrize("block", of_kind("json"))
def test_json_is_json(block: Block) -> None:
    json.loads(block.text)


# ---- what runs ---------------------------------------------------------------------------------------------------

WHOLE = [page for page in PAGES if any(block.kind in ("sh", "python") for block in blocks_of(page) if block.runs)]


@pytest.mark.evidence
@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
@pytest.mark.parametrize("page", WHOLE, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_blocks_of_a_page_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the shell with few pixels and samples, those of Python as they are, in order."""
    monkeypatch.chdir(tmp_path)
    write_models(tmp_path)
    write_films(tmp_path)
    blocks = [block for block in blocks_of(page) if block.runs]
    write_scenes(blocks)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks:
        if block.kind == "python":
            exec(compile(block.text, str(block), "exec"), namespace)
        elif block.kind == "sh":
            run_lines(block, tmp_path)


def write_scenes(blocks: list[Block]) -> None:
    """Scene files that commands of a page name: the page's own scenes, in order."""
    text = "\n".join(block.text for block in blocks if block.kind in ("sh", "python"))
    for kind in ("toml", "xml"):
        names = [name for name in dict.fromkeys(re.findall(rf"[\w-]+\.{kind}", text)) if not Path(name).exists()]
        scenes = [block.text for block in blocks if block.kind == kind]
        for name, scene in zip(names, scenes + scenes[-1:] * len(names), strict=False):
            whole = scene if kind == "xml" or "[camera]" in scene else f"{scene}\n{CAMERA}"
            Path(name).write_text(whole)


def run_lines(block: Block, folder: Path) -> None:
    """The lines that a test can run, by a shell in which `glpath` computes little."""
    shims = folder / "bin"
    shims.mkdir(exist_ok=True)
    shim = shims / "glpath"
    shim.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m tests.support.small_command "$@"\n')
    shim.chmod(0o755)
    lines = list(block.commands())
    environment = {
        **os.environ,
        "PATH": os.pathsep.join([str(shims), str(Path(sys.executable).parent), os.environ["PATH"]]),
        "PYTHONPATH": str(ROOT),
    }
    done = subprocess.run(
        ["sh", "-e", "-c", "\n".join(lines)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, f"{block}:\n{done.stdout}{done.stderr}"


# ---- the tools of this test --------------------------------------------------------------------------------------


def test_comments_and_what_no_test_runs_are_left_out() -> None:
    text = (
        "pip install glpath   # first\nglpath render a.glb \\\n  -o a.png   # a picture\n\n# a remark\n"
        "glpath render a.glb -o a.exr --cluster tls://somewhere:8786\n"
    )
    block = Block(ROOT / "README.md", 1, "sh", text)
    assert [" ".join(line.split()) for line in block.commands()] == ["glpath render a.glb -o a.png"]
    assert all(LINES_NOT_RUN.values())


def test_small_commands_keep_what_they_are_about() -> None:
    given = shlex.split("render room -o a.png --noise 0.01 -D level=64 --integrator gather")
    assert smaller(given) == shlex.split(
        "render room -o a.png -D level=4 --integrator gather --resolution 24x16 --spp 16"
    )
    assert smaller(["render", "--help"]) == ["render", "--help"]
    assert smaller(["info", "room"]) == ["info", "room"]
