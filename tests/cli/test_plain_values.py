"""Values of options that typer need not convert are what it would make of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from typer.main import get_group
from typer.testing import CliRunner

from glpath.cli.plain_values import spare_conversions

CALLS: tuple[tuple[str, ...], ...] = (
    (),
    ("-o", "a.png"),
    ("-o", "a.png", "-o", "b.exr", "--word", "x", "--several", "p", "--several", "q"),
    ("scene", "--count", "3", "--share", "0.5", "--flag"),
    ("--count", "x"),
    ("--count", "0"),
    ("--share", "nothing"),
    ("--file", "unreadable", "scene"),
    ("scene", "too many"),
)


def _program(found: dict[str, Any]) -> typer.Typer:
    app = typer.Typer(add_completion=False)

    @app.command()
    def command(
        scene: Annotated[str | None, typer.Argument()] = None,
        out: Annotated[list[Path] | None, typer.Option("-o")] = None,
        file: Path | None = None,
        word: str = "default",
        several: Annotated[list[str] | None, typer.Option()] = None,
        count: Annotated[int, typer.Option(min=1)] = 2,
        share: float = 0.25,
        flag: bool = False,
    ) -> None:
        found.update({name: value for name, value in locals().items() if name != "found"})

    app.callback()(lambda: None)
    return app


def _called(arguments: tuple[str, ...], sparing: bool) -> tuple[int, str, dict[str, Any]]:
    found: dict[str, Any] = {}
    group = get_group(_program(found))
    if sparing:
        spare_conversions(group)
        spare_conversions(group.commands["command"])
    # Not the runner's typer.Typer, of which it would make the group itself.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.testing._get_command", lambda app: group)
        done = CliRunner().invoke(typer.Typer(), ["command", *arguments])
    return done.exit_code, done.output, found


@pytest.mark.parametrize("arguments", CALLS, ids=" ".join)
def test_a_command_gets_what_typer_would_have_given_it(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("b.exr").touch()
    Path("unreadable").touch(0)
    ours, theirs = _called(arguments, sparing=True), _called(arguments, sparing=False)
    assert ours == theirs
    assert {name: type(value) for name, value in ours[2].items()} == {
        name: type(value) for name, value in theirs[2].items()
    }


def test_a_command_whose_values_are_plain_imports_no_pydantic(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom glpath.cli.main import run\n"
        "sys.argv = ['glpath', 'export', 'cornell-box', '-o', 'box.glb', '--quiet']\n"
        "try:\n    run()\nexcept SystemExit as end:\n    print(end.code, 'pydantic' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.splitlines()[-1:] == ["0 False"], done.stdout + done.stderr
