"""Command line options, made from the options declared in `run_request` and from the settings of integrators."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from copy import copy
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import typer

from glpath.cli.completion import words
from glpath.cli.run_request import RunRequest, declared
from glpath.cli.values import check_choice, colour
from glpath.errors import UsageError
from glpath.integrators.by_name import INTEGRATORS
from glpath.integrators.settings import Rgb
from glpath.rendering.options import Option, options
from glpath.system.files import record_input
from glpath.system.time_limit import limited

#: Help panel of the options that all integrators have.
FOR_ALL = "Sampling"


def with_options(
    function: Callable[..., Any],
    run: Collection[str],
    only: Collection[str] | None = None,
    *,
    integrators: Collection[str] = tuple(INTEGRATORS),
    texts: Mapping[str, str] = MappingProxyType({}),
) -> Callable[..., Any]:
    """Return a command that has command line options instead of two parameters of `function`.

    The values of a run's options are passed to `function` as `run`, a `RunRequest`. Those of integrators' options
    are passed as `**options`, if `function` has that parameter.

    run         : names of the options of a run
    only        : names of the integrator options; None: all
    integrators : integrators of the command; options that only other integrators have are left out
    texts       : help texts that replace those of a run's options, by option name
    """
    signature = inspect.signature(function, eval_str=True)
    explicit = [p for p in signature.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
    of_run = []
    for name in run:
        annotation, default = declared(name)
        if name in texts:
            option = copy(annotation.__metadata__[0])
            option.help = texts[name]
            annotation = Annotated[annotation.__origin__, option]
        of_run.append(_parameter(name, default, annotation))
    of_integrators = [
        _parameter(
            option.name, False if option.first.type is bool else option.default, _annotation(option, integrators)
        )
        for option in (_options_of(integrators) if len(explicit) < len(signature.parameters) else ())
        if only is None or option.name in only
    ]

    @functools.wraps(function)
    def command(**values: Any) -> Any:
        request = RunRequest(**{name: values.pop(name) for name in run})
        request.begin()
        with limited(request.seconds):
            return function(**values, run=request)

    typed = [p for p in explicit if p.name != "run"]
    parameters = [*typed, *of_run, *of_integrators]
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return command


def _parameter(name: str, default: Any, annotation: Any) -> inspect.Parameter:
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def _options_of(integrators: Collection[str]) -> Iterator[Option]:
    """Yield each option that one of these integrators has, without the settings of other integrators."""
    for option in options().values():
        settings = {owner: setting for owner, setting in option.settings.items() if owner in integrators}
        if settings:
            yield Option(option.name, settings)


def option_values(integrator: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Convert values of the command line to keyword arguments of `render`. Raises UsageError naming the option."""
    known = options()
    return {name: _value(known[name], integrator, value) for name, value in given.items()}


def flag(name: str) -> str:
    """Return the option as typed, such as --gather-rays for gather_rays."""
    return "--" + name.replace("_", "-")


def _extra(option: Option) -> dict[str, Any]:
    meta = option.first.meta
    return (meta.extra if meta else None) or {}


def flag_of(option: Option) -> str:
    given: str = _extra(option).get("flag", flag(option.name))
    return given


def _annotation(option: Option, integrators: Collection[str]) -> Any:
    setting = option.first
    kind: Any = setting.type
    metavar = _extra(option).get("metavar")
    if setting.several:
        kind, metavar = list[str], "|".join(setting.given_words)
    elif setting.words:
        kind, metavar = str, "|".join(setting.words)
    elif kind == Rgb:
        kind, metavar = str, "R,G,B"
    elif kind is not bool and kind not in (int, float):
        kind = Path
    description = option.description
    return Annotated[
        kind if kind is bool or option.default is not None else kind | None,
        typer.Option(
            flag_of(option),
            metavar=metavar or (None if kind is bool else "N"),
            help=description[0].upper() + description[1:] + ("; may be repeated." if setting.several else "."),
            show_default=False,
            rich_help_panel=_panel(option, integrators),
            autocompletion=words(setting.given_words) if setting.words else None,
        ),
    ]


def _panel(option: Option, integrators: Collection[str]) -> str:
    *others, last = option.settings
    if len(option.settings) == len(integrators):
        return FOR_ALL
    return f"With --integrator {', '.join(others)} or {last}" if others else f"With --integrator {last}"


def _value(option: Option, integrator: str, value: Any) -> Any:
    if value is None or value == []:
        return None
    # An option that only another integrator has is not an error here: `render` reports it.
    setting = option.settings.get(integrator, option.first)
    if setting.words:
        for word in value if setting.several else (value,):
            check_choice(flag_of(option), word, setting.given_words)
    elif setting.type == Rgb:
        return colour(flag(option.name), value)
    elif isinstance(value, Path):
        record_input(value)
    elif setting.type in (int, float) and setting.meta is not None:
        low, high = setting.meta.ge, setting.meta.le
        if low is not None and value < low:
            raise UsageError(f"{flag(option.name)} {value}: must be at least {low}.")
        if high is not None and value > high:
            raise UsageError(f"{flag(option.name)} {value}: must be at most {high}.")
        if setting.meta.multiple_of is not None and value % setting.meta.multiple_of:
            raise UsageError(f"{flag(option.name)} {value}: must be a multiple of {setting.meta.multiple_of}.")
    return value
