"""Options of a render, derived from the fields of the integrators' settings (`glpath.integrators.by_name`).

Each field becomes a parameter of `render`, with a line in its docstring (`with_options`) and a check of its value
(`settings_of`). `glpath.cli.options` makes the command line option from the field. Options of a run (`run_options`)
are added.
"""

from __future__ import annotations

import functools
import inspect
import textwrap
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from msgspec import Meta

from glpath.errors import UsageError, argument, warning_scope
from glpath.integrators.by_name import INTEGRATORS, Integrator, IntegratorKeywords
from glpath.integrators.gather_settings import Solution
from glpath.integrators.settings import IntegratorSettings, Rgb
from glpath.rendering import run_options
from glpath.rendering.run_options import RunKeywords, RunOptions
from glpath.system.arguments import check_count, check_word, is_numbers, short_repr
from glpath.system.arguments import checked as checked_arguments
from glpath.system.suggestions import similar_names
from glpath.system.time_limit import limited

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Function = TypeVar("Function", bound=Callable[..., Any])


class RenderKeywords(IntegratorKeywords, RunKeywords, total=False):
    """Keyword arguments of a render, for type checkers."""


#: Word that stands for all words of an option that takes several.
ALL = "all"

_WIDTH = 110

#: Our names for options of other programs, to suggest where a search for similar spelling would not find them.
_ELSEWHERE = {
    "width": "resolution=(width, height)",
    "height": "resolution=(width, height)",
    "size": "resolution=(width, height)",
    "film_size": "resolution=(width, height)",
    "samples": "spp",
    "sample_count": "spp",
    "path_sets": "spp",
    "depth": "max_depth",
    "path_length": "max_depth",
    "bounces": "max_depth",
    "max_bounces": "max_depth",
    "rr_depth": "roulette",
    "engine": "integrator",
    "method": "integrator",
    "region": "crop",
    "environment": "parameters={'environment': ...}",
    "environment_rotation": "parameters={'environment_rotation': ...}",
    "environment_exposure": "parameters={'environment_exposure': ...}",
    "background": "parameters={'background': ...}",
    "fov": "camera={'fov': ...}",
    "position": "camera={'position': ...}",
    "target": "camera={'target': ...}",
    "up": "camera={'up': ...}",
    "timeout": "time_limit",
    "gpu": "require_gpu",
    "verbose": "progress",
    "callback": "on_progress",
}


@dataclass(frozen=True)
class Setting:
    """Field of an integrator's settings.

    type     : type without None and metadata
    optional : True if None is allowed
    meta     : bounds and description; None if the setting is not an option
    """

    name: str
    type: Any
    optional: bool
    default: Any
    meta: Meta | None

    @property
    def words(self) -> tuple[str, ...]:
        """Words to choose from, if the type is a Literal or a tuple of it; () for other types."""
        chosen = get_args(self.type)[0] if self.several else self.type
        return get_args(chosen) if get_origin(chosen) is Literal else ()

    @property
    def several(self) -> bool:
        """True if several words may be chosen; "all" chooses all."""
        return get_origin(self.type) is tuple and get_args(self.type)[1:] == (...,)

    @property
    def given_words(self) -> tuple[str, ...]:
        """Words that a caller may give: `words`, and "all" if several may be chosen."""
        return (*self.words, ALL) if self.several else self.words


@dataclass(frozen=True)
class Option:
    """Parameter of `render`, with the settings of that name by integrator."""

    name: str
    settings: Mapping[str, Setting]

    @property
    def first(self) -> Setting:
        """Setting of the first integrator that has the option; all have the same type."""
        return next(iter(self.settings.values()))

    @property
    def default(self) -> Any:
        """Default that all integrators share; None if they have different defaults.

        Also None if an integrator lacks the option, except for flags (bool), where only the others are compared.
        """
        common = [s.default for s in self.settings.values()]
        everywhere = len(common) == len(INTEGRATORS) or self.first.type is bool
        return common[0] if everywhere and all(value == common[0] for value in common) else None

    @property
    def description(self) -> str:
        """Description with the defaults, for `help(render)` and `glpath render --help`."""
        texts: dict[tuple[str, object], list[str]] = {}
        for owner, setting in self.settings.items():
            assert setting.meta is not None
            texts.setdefault((setting.meta.description or "", setting.default), []).append(owner)
        if len({text for text, _ in texts}) == 1:
            text = next(iter(texts))[0]
            defaults = [
                shown + (f" of {_quoted(owners, 'and')}" if len(texts) > 1 else "")
                for (_, value), owners in texts.items()
                if not isinstance(value, bool) and value != () and (shown := self._shown(value))
            ]
            return text + (f"; default {', '.join(defaults)}" if defaults else "")
        parts = [
            (f"of {_quoted(owners, 'and')}, " if i else "") + f"{text}; default {_shown(value)}"
            for i, ((text, value), owners) in enumerate(texts.items())
        ]
        return ". ".join(part[0].upper() + part[1:] if i else part for i, part in enumerate(parts))

    def _shown(self, value: Any) -> str:
        """Return the text of a default; for None, the text in the setting's `extra`, or ""."""
        meta = self.first.meta
        return _shown(value) if value is not None else str(((meta and meta.extra) or {}).get("unset", ""))


@functools.cache
def settings_fields(kind: type[IntegratorSettings]) -> Mapping[str, Setting]:
    """Return the fields of an integrator's settings by name; cached, because each render asks for them often."""
    hints = get_type_hints(kind, include_extras=True)
    found = {}
    for field in fields(kind):
        declared, meta = hints[field.name], None
        if get_origin(declared) is Annotated:
            meta = next((m for m in declared.__metadata__ if isinstance(m, Meta)), None)
            declared = declared.__origin__
        optional = False
        if get_origin(declared) in (Union, types.UnionType):
            members = [m for m in get_args(declared) if m is not type(None)]
            optional = len(members) < len(get_args(declared))
            declared = members[0] if len(members) == 1 else Union[tuple(members)]  # noqa: UP007
        found[field.name] = Setting(field.name, declared, optional, field.default, meta)
    return types.MappingProxyType(found)


def options() -> dict[str, Option]:
    """Return all options of all integrators by name; options that all integrators have come first."""
    by_name: dict[str, dict[str, Setting]] = {}
    for integrator, kind in INTEGRATORS.items():
        for name, setting in settings_fields(kind).items():
            if setting.meta is not None:
                by_name.setdefault(name, {})[integrator] = setting
    found = {name: Option(name, settings) for name, settings in by_name.items()}
    return dict(sorted(found.items(), key=lambda item: len(item[1].settings) < len(INTEGRATORS)))


def settings_of(integrator: str | IntegratorSettings, given: Mapping[str, Any]) -> IntegratorSettings:
    """Return the settings of an integrator, given by name or as an instance, with the options in `given`.

    given : options by name; None if not given

    Raises UsageError for values out of range, and for options that this integrator does not have.
    """
    known = options()
    if isinstance(integrator, IntegratorSettings):
        name, base = integrator.integrator, integrator
    else:
        check_word("integrator", integrator, get_args(Integrator))
        name, base = integrator, INTEGRATORS[integrator]()
    # A flag of another integrator that is False is ignored.
    others_flags = [o.name for o in known.values() if o.default is False and name not in o.settings]
    given = {k: v for k, v in given.items() if v is not None and not (v is False and k in others_flags)}
    for option, value in given.items():
        check_name(option, known)
        if name not in known[option].settings:
            found = str(value) if isinstance(value, Path) else short_repr(value)
            remedy = base.remedies.get(option)
            raise UsageError(
                f'{option}: {found} with the integrator "{name}"; it is an option of '
                f"{_quoted(known[option].settings, 'and')}",
                remedy() if remedy else f"Leave it out, or take {argument('integrator', *known[option].settings)}.",
            )
    base.check_together(given)
    return checked(replace(base, **given))


def checked(settings: IntegratorSettings) -> IntegratorSettings:
    """Return the settings with each value converted to its type. Raises UsageError for values out of bounds."""
    return replace(
        settings,
        **{
            name: _checked(setting, getattr(settings, name))
            for name, setting in settings_fields(type(settings)).items()
        },
    )


def _checked(setting: Setting, value: Any) -> Any:
    """Return a value converted to the setting's type. Raises UsageError for invalid values."""
    name, low, high, factor = setting.name, None, None, None
    if setting.meta is not None:
        low, high, factor = setting.meta.ge, setting.meta.le, setting.meta.multiple_of
    if value is None and setting.optional:
        return None
    if setting.several:
        given = (value,) if isinstance(value, str) else value
        if not isinstance(given, tuple | list):
            raise UsageError(
                f"{name}: {short_repr(value)} where some of {', '.join(setting.given_words)} are needed"
            )
        for word in given:
            check_word(name, word, setting.given_words)
        return tuple(word for word in setting.words if word in given or ALL in given)
    if setting.words:
        check_word(name, value, setting.words)
        return value
    if setting.type is bool:
        import numpy as np

        if not isinstance(value, bool | np.bool_):
            raise UsageError(f"{name}: {short_repr(value)} where True or False is needed")
        return bool(value)
    if setting.type is int:
        check_count(name, value, 0 if low is None else int(low), 2**63 if high is None else int(high))
        if factor is not None and value % factor:
            raise UsageError(f"{name}: {value} where a multiple of {factor} {_bounds(low, high)} is needed")
        return int(value)
    if setting.type == Rgb:
        return colour(name, value)
    if setting.type is float:
        number = float(numbers(name, value, 1)[0])
        if not (low is None or number >= low) or not (high is None or number <= high):
            raise UsageError(f"{name}: {short_repr(value)} where a number {_bounds(low, high)} is needed")
        return number
    if Path in get_args(setting.type):
        return _file_or_solution(name, value)
    raise AssertionError(f"{name}: values of {setting.type} are not checked")


def _file_or_solution(name: str, value: Any) -> Path | Solution:
    if isinstance(value, str | Path):
        return Path(value)
    from glpath.radiosity.solution import RadiositySolution  # late, because the import is slow

    if not isinstance(value, RadiositySolution):
        raise UsageError(
            f"{name}: {short_repr(value)} where a RadiositySolution or the file of one is needed",
            "glpath.solve_radiosity makes one; without it, the scene is solved before it is rendered.",
        )
    return value


def check_name(name: str, known: typing.Collection[str]) -> None:
    """Raise UsageError unless `name` is a parameter; the error lists all, and the probably intended one."""
    if name in known:
        return
    meant = _ELSEWHERE.get(name, "")
    if meant.partition("=")[0] not in known:
        meant = next(iter(similar_names(name, known, 1)), "")
    raise UsageError(
        f"{name}: no option has this name; allowed are {', '.join(known)}",
        f"Did you mean {meant}?" if meant else "",
    )


def numbers(name: str, value: Any, count: int) -> NDArray[np.float64]:
    """Return `count` finite numbers up to 1e15. Raises UsageError with the option's name for other values."""
    import numpy as np

    from glpath.system.vectors import LARGEST

    try:
        given = np.asarray(value)
    except Exception:  # an object may raise any error when numpy converts it
        given = np.array("")
    fits = given.ndim <= 1 and given.size == count and is_numbers(given)
    found = np.atleast_1d(given.astype(np.float64)) if fits else np.empty(0)
    if not fits or not np.all(np.abs(found) <= LARGEST):
        limit = f" up to {LARGEST:g}" if np.isfinite(found).all() and len(found) else ""
        needed = f"a finite number{limit} is" if count == 1 else f"{count} finite numbers{limit} are"
        raise UsageError(f"{name}: {short_repr(value)} where {needed} needed")
    return found


def whole_numbers(name: str, value: Any, count: int) -> list[int]:
    """Return `count` whole numbers of pixels. Raises UsageError with the option's name for other values."""
    found = numbers(name, value, count)
    if any(found != found.round()):
        raise UsageError(f"{name}: {short_repr(value)} where {count} whole numbers of pixels are needed")
    return [int(n) for n in found]


def colour(name: str, value: float | Sequence[float]) -> Rgb:
    """Return a nonnegative radiance from one number or three. Raises UsageError with the option's name."""
    r, g, b = numbers(name, [value] * 3 if isinstance(value, int | float) else value, 3)
    if min(r, g, b) < 0:
        raise UsageError(f"{name}: {short_repr(value)} where radiance, one or three numbers >= 0, is needed")
    return float(r), float(g), float(b)


# Signatures and docstrings of Python functions.


def with_options(*, integrators: bool = True, run: bool = True) -> Callable[[Function], Function]:
    """Return a decorator that replaces the last parameter of a function, **options, by keyword parameters.

    integrators, run : True to add the options of all integrators, and those of a run

    The decorated function raises UsageError for any other name, with all allowed names, and checks its arguments as
    `checked_arguments` does. In its docstring, {options}
    and {run_options} are replaced by a row for each option, and {default_spp} by the default of spp.
    """

    def decorated(function: Function) -> Function:
        signature = inspect.signature(function)
        explicit = [p for p in signature.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
        of_run = [(f.name, f.default, f.type) for f in fields(RunOptions)] if run else []
        of_all = [(o.name, o.default, annotation_of(o)) for o in options().values()] if integrators else []
        further = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for name, default, annotation in (*of_run, *of_all)
        ]
        named = [p.name for p in explicit if p.kind is inspect.Parameter.KEYWORD_ONLY] + [o[0] for o in of_run]

        @functools.wraps(function)
        def call(*given: Any, **by_name: Any) -> Any:
            for name in by_name.keys() - signature.parameters.keys():
                check_name(name, [*named, *(options() if integrators else ())])
            with limited(by_name.get("time_limit"), resumes=by_name.get("film") is not None):
                return with_late_warnings(
                    lambda: function(*given, **by_name), strict=run and bool(by_name.get("strict"))
                )

        call.__signature__ = signature.replace(parameters=[*explicit, *further])  # type: ignore[attr-defined]
        text = inspect.cleandoc(function.__doc__ or "")
        for placeholder, rows in (
            ("{options}", options_text),
            ("{run_options}", run_options_text),
            ("{default_spp}", default_spp_text),
        ):
            text = text.replace(placeholder, rows())
        call.__doc__ = text
        return checked_arguments(typing.cast("Function", call), vars(run_options))

    return decorated


def with_late_warnings(compute: Callable[[], Any], strict: bool) -> Any:
    """Return the result of `compute`, after raising the warnings about the result; see `WarningScope.raise_late`.

    strict : True to raise StrictError for a warning; see `RunOptions.strict`
    """
    with warning_scope(strict) as scope:
        result = compute()
        if inspect.isgenerator(result):
            return _each_with_late_warnings(result, strict)
    scope.raise_late(result)
    return result


def _each_with_late_warnings(results: Iterator[Any], strict: bool) -> Iterator[Any]:
    end = object()
    while True:
        with warning_scope(strict) as scope:
            result = next(results, end)
        scope.raise_late(result)
        if result is end:
            return
        yield result


def run_options_text() -> str:
    """Return the docstring rows that describe each option of a run."""
    return inspect.cleandoc(RunOptions.__doc__ or "").partition("\n\n")[2]


def annotation_of(option: Option) -> Any:
    """Return the annotation of an option's parameter, which accepts more types than the settings' field."""
    kind: Any = option.first.type
    if kind == Rgb:
        kind = float | kind
    elif option.first.several or Path in get_args(kind):
        kind = str | kind
    return kind if option.default is not None else kind | None


def options_text() -> str:
    """Return the docstring rows that describe each option, grouped by the integrators that have it."""
    groups: dict[tuple[str, ...], list[Option]] = {}
    for option in options().values():
        groups.setdefault(tuple(option.settings), []).append(option)
    parts = []
    for owners, members in groups.items():
        head = [] if len(owners) == len(INTEGRATORS) else [f"Of {_quoted(owners, 'and')} only:\n"]
        parts.append("\n".join(head + [_row(option.name, option.description) for option in members]))
    return "\n\n".join(parts)


def default_spp_text() -> str:
    """Return the text with the default of `spp` for each integrator."""
    by_count: dict[int, list[str]] = {}
    for name, kind in INTEGRATORS.items():
        by_count.setdefault(kind.default_spp, []).append(name)
    return ", ".join(f"{count} of {_quoted(names, 'and')}" for count, names in by_count.items())


def _row(name: str, text: str) -> str:
    return textwrap.fill(
        text, _WIDTH, initial_indent=f"{name:<14} : ", subsequent_indent=" " * 17, break_long_words=False
    )


def _quoted(names: typing.Iterable[str], conjunction: str) -> str:
    *others, last = [f'"{name}"' for name in names]
    return f"{', '.join(others)} {conjunction} {last}" if others else last


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:g}" if len(set(value)) == 1 else ", ".join(f"{v:g}" for v in value)
    return f'"{value}"' if isinstance(value, str) else str(value)


def _bounds(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return f"up to {high:g}" if low is None else f"from {low:g}"
    return f"from {low:g} to {high:g}"
