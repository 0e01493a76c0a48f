"""Arguments in the notation of the command line, and the command as it was typed."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import Any

# Key of the typed words in the data that a command's context shares with the contexts above it.
_WORDS = "glpath.words"


def as_option(name: str, values: Sequence[object]) -> str:
    """Return an argument in the notation of the command line, such as --integrator path; see `errors.argument`."""
    from glpath.cli.options import flag, flag_of
    from glpath.rendering.options import options

    known = options()
    typed = flag_of(known[name]) if name in known else flag(name)
    if values[0] is True:
        return typed
    if values[0] is False:
        return typed.replace("--", "--no-", 1)
    if name in known and known[name].first.several and isinstance(values[0], tuple | list):
        return " ".join(f"{typed} {each}" for each in values[0])
    return f"{typed} {' or '.join(map(_word, values))}"


def _word(value: object) -> str:
    if isinstance(value, tuple | list):
        return ",".join(map(_word, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


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
