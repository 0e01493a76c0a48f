"""Values of options that need no conversion, taken as they are.

Typer, from 0.29 on, converts the value of each parameter by pydantic, those that nobody typed too: an import and
some sixty adapters, a tenth of a second of each command. Most are None, or have their type already.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_origin


def spare_conversions(command: Any) -> None:
    """Have a command's parameters ask typer for a conversion only where a value needs one."""
    get_params = command.get_params

    def sparing(context: Any) -> Any:
        # At each look, since typer adds its own for help and completion late.
        found = get_params(context)
        for parameter in found:
            convert = getattr(parameter, "get_runtime_param", None)
            # An older typer converts by functions of its own.
            if convert is not None and "get_runtime_param" not in vars(parameter):
                parameter.get_runtime_param = _SparingConversion(convert).itself
        return found

    command.get_params = sparing


class _SparingConversion:
    """What typer calls for a conversion; it makes typer's own at the first value that needs one."""

    def __init__(self, convert: Callable[[], Any]) -> None:
        self._convert = convert

    def itself(self) -> _SparingConversion:
        return self

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        several = param.multiple or param.nargs == -1
        if value is None:
            return () if several else None
        of, info = param.type_descriptor.annotation, param.type_descriptor.parameter_info
        if info.parser is None and get_origin(of) in (None, list):
            values = list(value) if get_origin(of) is list and isinstance(value, list | tuple) else [value]
            kind = get_args(of)[0] if get_origin(of) is list else of
            if all(_is_plain(each, kind) for each in values):
                plain = [Path(each) if kind is Path else each for each in values]
                return plain if get_origin(of) is list else plain[0]
        return self._convert().coerce(value, param=param, ctx=ctx)


def _is_plain(value: Any, kind: Any) -> bool:
    """Whether typer would only hand it on, or make a path of it."""
    if kind is Path:
        # Typer refuses files that exist and cannot be read.
        return isinstance(value, str) and (os.access(value, os.R_OK) or not os.path.exists(value))
    return kind in (str, int, float) and type(value) is kind
