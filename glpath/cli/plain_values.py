"""Shortcut for option values that need no conversion by Typer.

Since version 0.29, Typer converts the value of each parameter, even a default, with pydantic. To import pydantic
and to build about sixty adapters takes each command 0.1 s. Most values are None or have their final type already.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_origin

import typer

from glpath.errors import shortened
from glpath.system.numerals import real, whole


def spare_conversions(command: Any) -> None:
    """Let a command's parameters call Typer's conversion only for values that need it."""
    get_params = command.get_params

    def sparing(context: Any) -> Any:
        # Repeated at each lookup, because Typer adds its own parameters for help and completion late.
        found = get_params(context)
        for parameter in found:
            convert = getattr(parameter, "get_runtime_param", None)
            # Older versions of Typer lack this method; they convert without pydantic.
            if convert is not None and "get_runtime_param" not in vars(parameter):
                parameter.get_runtime_param = _SparingConversion(convert).itself
        return found

    command.get_params = sparing


class _SparingConversion:
    """Conversion that calls Typer's own converter only for values that need it."""

    def __init__(self, convert: Callable[[], Any]) -> None:
        self._convert = convert

    def itself(self) -> _SparingConversion:
        return self

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        several = param.multiple or param.nargs == -1
        if value is None:
            return () if several else None
        of, info = param.type_descriptor.annotation, param.type_descriptor.parameter_info
        _check_digits(value, get_args(of)[0] if get_origin(of) is list else of, param, ctx)
        if info.parser is None and get_origin(of) in (None, list):
            values = list(value) if get_origin(of) is list and isinstance(value, list | tuple) else [value]
            kind = get_args(of)[0] if get_origin(of) is list else of
            if all(_is_plain(each, kind) for each in values):
                plain = [Path(each) if kind is Path else each for each in values]
                return plain if get_origin(of) is list else plain[0]
        return self._convert().coerce(value, param=param, ctx=ctx)


def _check_digits(value: Any, kind: Any, param: Any, ctx: Any) -> None:
    """Raise BadParameter for non-ASCII digits, underscores or too many digits, which Typer accepts in a number."""
    read = whole if kind is int else real if kind is float else None
    if read is None:
        return
    for each in value if isinstance(value, list | tuple) else (value,):
        if isinstance(each, str) and not _is_read(read, each) and _is_read(kind, each):
            text = f"{shortened(each)!r} is not a valid {'whole number' if kind is int else 'number'}."
            raise typer.BadParameter(text, ctx=ctx, param=param)


def _is_read(read: Callable[[str], object], text: str) -> bool:
    try:
        read(text)
    except ValueError:
        return False
    return True


def _is_plain(value: Any, kind: Any) -> bool:
    """Return True if Typer would return the value unchanged or only wrap it in a Path."""
    if kind is Path:
        # An existing file that cannot be read is left to Typer, which reports it.
        return isinstance(value, str) and (os.access(value, os.R_OK) or not os.path.exists(value))
    return kind in (str, int, float) and type(value) is kind
