"""Messages in the command line's notation: Python arguments as options, and the command as it was typed.

Errors and warnings are worded for Python, `integrator="path"`; a user of the command line types --integrator path.
"""

from __future__ import annotations

import re
import shlex
from typing import Any

# Key of the typed words in the data that a command's context shares with the contexts above it.
_WORDS = "glpath.words"

# Names of command options that are not options of integrators.
_OF_COMMANDS = (
    *("integrator", "crop", "resolution", "device", "require_gpu", "hours", "time_limit"),
    *("size", "texels", "uv", "materials", "white_sky", "maintenance_factor"),
    *("plane", "spacing", "area", "margin", "normal"),
)

# Argument NAME=VALUE. The value is a quoted word, several joined by ", " or " or ", a tuple, a boolean or a number.
_ARGUMENT = re.compile(
    r"""\b([a-z_]+)=("[^"]*"(?:(?:, | or )"[^"]*")*|\([^()]*\)|(?:True|False)\b|[+-]?[\d.]+(?:e[+-]?\d+)?\b)"""
)


def as_typed(text: str) -> str:
    """Replace Python arguments in `text` by command-line options: require_gpu=True by --require-gpu."""
    return _ARGUMENT.sub(_option, text)


def remember_words(context: Any, words: list[str]) -> None:
    """Store the typed words of a program in its context, for `typed_words`."""
    context.meta[_WORDS] = words


def typed_words(context: Any) -> list[str]:
    """Return the words after the program's name as they were typed."""
    words: list[str] = context.meta[_WORDS]
    return words


def typed_command(context: Any) -> str:
    """Return the command as it was typed, quoted for a shell, such as "glpath daylight a.glb -o 'a b.npz'"."""
    return shlex.join(["glpath", *typed_words(context)])


def typed_parameters(context: Any) -> list[Any]:
    """Return the parameters of the command that were typed, and not left at their defaults."""
    sources = [(each, context.get_parameter_source(each.name or "")) for each in context.command.params]
    # The source is compared by name, because Typer may bundle its own copy of Click.
    return [each for each, source in sources if source is not None and source.name == "COMMANDLINE"]


def _option(argument: re.Match[str]) -> str:
    from glpath.cli.options import flag, flag_of
    from glpath.rendering.options import options

    (name, value), known = argument.groups(), options()
    if name not in known and name not in _OF_COMMANDS:
        return argument[0]
    typed = flag_of(known[name]) if name in known else flag(name)
    if value == "True":
        return typed
    if value == "False":
        return typed.replace("--", "--no-", 1)
    words = re.sub(r"""["'()]""", "", value).rstrip(",")
    if name in known and known[name].first.several:
        return " ".join(f"{typed} {word}" for word in words.split(", "))
    return f"{typed} {words.replace(', ', ',') if value.startswith('(') else words}"
