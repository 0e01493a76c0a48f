"""What a scene file says never reaches the terminal as anything but text to be read.

The witness is the real process: its bytes, through pipes and through a pseudo-terminal.
"""

from __future__ import annotations

import ast
import io
import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

import glpath
from glpath.system.reporting import ProgressEvent, reporting
from glpath.system.terminal import clean, clean_console, say_json

# A title, a cleared screen, colours, a bell, a line over the line, text backwards, invisible text, and C1's CSI.
HOSTILE = "a\x1b]0;owned\x07b\x1b[2Jc\x1b[35;45md\re\u202ef\u200bg\u2066h\x9b5mi\x08j\ufeffk"
SHOWN = clean(HOSTILE)
#: Characters that a terminal obeys or that hide text, but for the end of a line.
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")

SCENE = """
name = NAME
[camera]
position = [0, 1, 4]
target = [0, 1, 0]
[textures.NAME]
type = "checker"
[materials.NAME]
type = "phong"
reflectance = 0.5
specular = 0
mirror = 0.5
texture = NAME
[[shapes]]
type = "sphere"
name = NAME
radius = 1
material = NAME
[[shapes]]
type = "quad"
name = "leer é 日本"
corners = [[-9, -1, 9], [9, -1, 9], [9, -1, -9], [-9, -1, -9]]
[[lights]]
type = "point"
name = NAME
position = [0, 3, 2]
intensity = 20
"""


def written(folder: Path) -> dict[str, Path]:
    """Scenes that load, that name what is not there, that are no TOML: all with the name in their file names."""
    name = json.dumps(HOSTILE)
    stem = HOSTILE.replace("/", "")
    good = folder / f"{stem}.toml"
    good.write_text(SCENE.replace("NAME", name), encoding="utf-8")
    lacking = folder / f"lacking {stem}.toml"
    lacking.write_text(
        SCENE.replace("NAME", name) + f'[[shapes]]\ntype = "sphere"\nradius = 1\nmaterial = "x{name[1:]}'
    )
    unknown = folder / f"unknown {stem}.toml"
    unknown.write_text(SCENE.replace("NAME", name) + f"[{name}]\n{name} = 1\n")
    broken = folder / f"broken {stem}.toml"
    broken.write_text(f'name = "{HOSTILE}"\n', encoding="utf-8")
    degenerate = folder / f"degenerate {stem}.toml"
    degenerate.write_text(
        SCENE.replace("NAME", name)
        + f'[[shapes]]\ntype = "mesh"\nname = {name}\nvertices = [[0,0,0],[1,0,0],[0,1,0],[2,0,0]]\n'
        "faces = [[0,1,2],[0,1,3]]\n"
    )
    picture = folder / f"{stem}.png"
    picture.write_text("no picture")
    return {
        "good": good, "lacking": lacking, "unknown": unknown, "broken": broken, "degenerate": degenerate,
        "picture": picture, "absent": folder / f"absent {stem}.png",
    }  # fmt: skip


COMMANDS = {
    "info": ["info", "good"],
    "info --json": ["info", "good", "--json"],
    "info of what is broken": ["info", "broken"],
    "validate": ["validate", "good", "lacking", "unknown", "broken", "degenerate"],
    "render": ["render", "good", "-o", "{folder}/x.png", "--resolution", "24x18", "--spp", "2"],
    "render of what is broken": ["render", "broken", "-o", "{folder}/x.png"],
    "render to nowhere": ["render", "cornell-box", "-o", "absent", "-o", "{folder}/\x1b[2J\u202e.jpg"],
    "radiosity": ["radiosity", "good", "-o", "{folder}/x.npz", "--patches", "20"],
    "diff": ["diff", "picture", "absent"],
    "scenes": ["scenes"],
    "an option that is not there": ["info", "--\x1b[2J\u202e"],
    "a number that is none": ["render", "good", "-o", "x.png", "--spp", "\x1b[2J\u202e"],
    "no such command": ["\x1b[2J\u202e"],
}


def arguments(name: str, folder: Path) -> list[str]:
    files = written(folder)
    given = [str(files.get(word, word)).replace("{folder}", str(folder)) for word in COMMANDS[name]]
    return [sys.executable, "-m", "glpath", *given]


def run(command: list[str], terminal: bool, folder: Path) -> str:
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "400"}
    if not terminal:
        done = subprocess.run(command, capture_output=True, timeout=120, cwd=folder, env=environment, check=False)
        return (done.stdout + done.stderr).decode()
    ours, theirs = pty.openpty()
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=folder, env=environment)
    os.close(theirs)
    parts = []
    while True:
        try:
            part = os.read(ours, 1 << 16)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        parts.append(part)
    process.wait(60)
    os.close(ours)
    return b"".join(parts).decode().replace("\r\n", "\n")


@pytest.mark.parametrize("name", COMMANDS)
def test_no_command_hands_on_what_a_terminal_obeys(name: str, tmp_path: Path) -> None:
    text = run(arguments(name, tmp_path), False, tmp_path)
    assert len(text) > 20
    assert "Traceback" not in text, text
    assert OBEYED.findall(text) == []


@pytest.mark.parametrize("name", ["info", "validate", "render of what is broken", "no such command"])
def test_on_a_terminal_the_only_sequences_are_our_colours(name: str, tmp_path: Path) -> None:
    text = run(arguments(name, tmp_path), True, tmp_path)
    assert "\x1b[35;45m" not in text
    assert OBEYED.findall(re.sub(r"\x1b\[[0-9;]*m", "", text)) == []
    assert len(text) > 20


def test_names_are_shown_with_escapes_and_ordinary_unicode_stays(tmp_path: Path) -> None:
    text = run(arguments("info", tmp_path), False, tmp_path)
    assert text.count(SHOWN) >= 5  # of the scene, its texture, material, shape and light
    assert "leer é 日本" in text
    stored = json.loads(run(arguments("info --json", tmp_path), False, tmp_path))
    assert stored["shapes"][0]["name"] == HOSTILE  # JSON has escapes of its own, and loses nothing


def test_what_is_cleaned_and_what_stays() -> None:
    assert clean("\x1b[31m\u202e\u200d\x07\r\x7f\x9b\u2028") == (r"\x1b[31mU+202EU+200D\x07\x0d\x7f\x9bU+2028")
    assert clean("\udcff") == r"\xff"  # a byte of a file name
    for text in ("plain", "two\nlines\tand a tab", "é ß 日本語 עברית العربية", "a\u0301 \u00a0 \u3000 🎨 \ue000"):
        assert clean(text) == text


def test_json_keeps_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    say_json({"é\u202e": [HOSTILE, "\ud800"]})
    text = capsys.readouterr().out
    assert OBEYED.search(text) is None
    assert "é" in text
    assert json.loads(text) == {"é\u202e": [HOSTILE, "\ud800"]}


def test_a_table_measures_what_it_shows() -> None:
    from rich.table import Table

    stream = io.StringIO()
    table = Table("name", "number", box=None)
    table.add_row(HOSTILE, "1")
    table.add_row("short", "2")
    clean_console(stream, width=200).print(table)
    _, first, second = stream.getvalue().splitlines()
    assert first.index("1", len(SHOWN)) == second.index("2")


def test_nothing_in_the_command_line_prints_by_itself() -> None:
    """All text leaves through `glpath.system.terminal`."""
    folder = Path(glpath.__file__).parent
    for file in [*(folder / "cli").glob("*.py"), folder / "rendering" / "progress.py"]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert called not in ("typer.echo", "typer.secho", "click.echo", "Console", "rich.print"), file
                if called == "print":
                    assert ast.unparse(node.args[0]).startswith(("clean(", "json.dumps(event)")), file


def test_the_end_of_a_stage_is_told_once() -> None:
    stream = io.StringIO()
    with reporting("lines", stream, lambda event: event) as report:
        assert report is not None
        for done in (3, 10, 10, 10, 10):
            report(ProgressEvent("rows", 1.0, done, 10, {}, line=f"{done} of 10 rows"))
    assert stream.getvalue().splitlines() == ["3 of 10 rows after 1.0 s", "10 of 10 rows after 1.0 s"]


def test_the_end_of_a_stage_is_one_json_object() -> None:
    stream = io.StringIO()
    with reporting("json", stream, lambda event: event) as report:
        assert report is not None
        for done in (3, 10, 10, 10):
            report(ProgressEvent("rows", 1.0, done, 10, {"done": done}))
    assert [json.loads(line)["done"] for line in stream.getvalue().splitlines()] == [3, 10]
