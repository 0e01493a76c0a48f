"""Help that helps: commands in groups, three examples each, and no more options than a day needs."""

from __future__ import annotations

import re
import shlex
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from glpath.cli.help import MAX_EVERYDAY
from glpath.cli.main import app

COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
WIDE = {"COLUMNS": "200"}


def shown(*arguments: str) -> str:
    result = CliRunner().invoke(app, [*arguments], env=WIDE)
    assert result.exit_code == 0, result.output
    return result.output


def options_in(text: str) -> set[str]:
    return set(re.findall(r"^│ \*?\s*(--[a-z-]+|-D)", text, re.MULTILINE)) - {"--help"}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_shows_three_examples_and_the_options_of_every_day(name: str) -> None:
    command, text = COMMANDS[name], shown(name, "--help")
    assert len(command.examples) == 3
    assert all(typed in text and what in text for typed, what in command.examples)
    assert text.index(command.examples[0][0]) < text.index("╭")
    assert len(options_in(text)) <= MAX_EVERYDAY
    assert command.everyday <= {param.name for param in command.params}
    assert "<bool>" not in text


@pytest.mark.parametrize("name", ["render", "lightmap", "probes", "measure", "radiosity"])
def test_what_surrounds_and_moves_a_model_is_shown_every_day(name: str) -> None:
    wanted = {"--environment", "--animation", "--variant"} | ({"--background"} if name == "render" else set())
    assert wanted <= options_in(shown(name, "--help"))


@pytest.mark.parametrize("name", COMMANDS)
def test_help_all_shows_every_option(name: str) -> None:
    few, every = shown(name, "--help"), shown(name, "--help-all")
    options = {
        param.opts[0] for param in COMMANDS[name].params if param.param_type_name == "option" and not param.hidden
    }
    assert len(options_in(every)) == len(options)
    rare = len(options_in(every)) - len(options_in(few))
    assert (f"{rare} more options: glpath {name} --help-all" in few) == (rare > 0)
    assert "more options" not in every
    assert options_in(shown(name, "--help")) == options_in(few)  # and it hides them again


@pytest.mark.parametrize("name", COMMANDS)
def test_the_examples_are_commands_that_there_are(name: str) -> None:
    for typed, _ in COMMANDS[name].examples:
        words = shlex.split(typed.split("|")[0])
        assert words[:1] == ["glpath"]
        known = {opt for param in COMMANDS[words[1]].params for opt in (*param.opts, *param.secondary_opts)}
        assert [word for word in words[2:] if word.startswith("-") and word not in known] == []


def test_commands_are_in_groups() -> None:
    text = shown("--help")
    assert "─ Commands ─" not in text
    for group, command in {"Pictures": "render", "Light in numbers": "measure", "Scenes": "info"}.items():
        assert text.index(f"─ {group}") < text.index(f"│ {command} ")
    assert "<bool>" not in text


def test_a_misspelt_option_or_command_is_answered_with_the_nearest() -> None:
    for arguments, nearest in ((["render", "box", "--sppp", "3"], "--spp"), (["rendr"], "render")):
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2
        assert nearest in result.stderr


def test_render_shows_what_its_guides_use_and_the_file_that_resume_reads() -> None:
    text = shown("render", "--help")
    assert {"--checkpoint", "--resume", "--turntable", "--frames", "--clean", "--look-at"} <= options_in(text)
    words = " ".join(re.sub(r"[│╭╮╰╯─]", " ", text).split())
    assert "Resume from the checkpoint, a.checkpoint.npz beside a.png" in words
