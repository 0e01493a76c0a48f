"""Translation of errors and warnings to the command line's notation.

Messages are worded for Python, `integrator="path"`; a user of the command line types --integrator path.
"""

from __future__ import annotations

import re

# Names of command options that are not options of integrators.
_OF_COMMANDS = (
    *("integrator", "crop", "resolution", "device", "require_gpu", "hours", "time_limit"),
    *("size", "texels", "uv", "materials", "white_sky", "maintenance_factor"),
)

# Argument NAME=VALUE. The value is a quoted word, several joined by ", " or " or ", a tuple, a boolean or a number.
_ARGUMENT = re.compile(r"""\b([a-z_]+)=("[^"]*"(?:(?:, | or )"[^"]*")*|\([^()]*\)|(?:True|False)\b|[\d.]+\b)""")


def as_typed(text: str) -> str:
    """Replace Python arguments in `text` by command-line options: require_gpu=True by --require-gpu."""
    return _ARGUMENT.sub(_option, text)


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
