"""Options of a pytest run for the fixture, each on the command line and in the ini-file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import pytest

from glpath.system.numerals import unsigned


class Option:
    """Option --glpath-NAME, and glpath_NAME in the ini-file, with "_" for "-"."""

    # Not a dataclass, because creating one takes a millisecond of every pytest run on the machine.
    def __init__(self, name: str, help: str, choices: tuple[str, ...] = (), metavar: str | None = None) -> None:
        self.name, self.help, self.choices, self.metavar = name, help, choices, metavar


OPTIONS = (
    Option(
        "update",
        "Which baselines to write: those that are missing (the default, but none where CI is set), those that fail "
        "as well, or all.",
        ("none", "missing", "failed", "all"),
    ),
    Option(
        "unused",
        "What to do about baselines that no test asks for, of files whose tests all ran: report (the default), "
        "fail, or delete.",
        ("report", "fail", "delete"),
    ),
    Option(
        "mode",
        "How pictures are compared where a test does not say. By default: stat for path-traced films, else fuzzy.",
        metavar="MODE",
    ),
    Option(
        "limits",
        "Limits of the modes where a test does not say, such as 'fuzzy.threshold=4 stat.sees=0.02'.",
        metavar="LIMITS",
    ),
    Option(
        "baseline-path",
        "Where baselines are; a relative one is beside each test file. Default: baseline. Write folders with a =, "
        "as pytest takes one that stands alone for a folder of tests.",
        metavar="DIR",
    ),
    Option(
        "results-path",
        "Where pictures of failures and the report go. Default: glpath-results in pytest's rootdir.",
        metavar="DIR",
    ),
    Option(
        "platform",
        "Baselines of each platform apart, in a folder below that of the baselines: its name, or auto for that of "
        "sys.platform (linux, darwin, win32).",
        metavar="NAME",
    ),
    Option(
        "new-path",
        "Where the pictures of missing baselines and of those that differ go as new baselines, with the folders "
        "that baselines have in pytest's rootdir: what CI keeps, to be copied over the checkout.",
        metavar="DIR",
    ),
    Option(
        "keep",
        "Which pictures are kept, and shown in the report: those of failures (the default), or all.",
        ("failures", "all"),
    ),
    Option(
        "style",
        "matplotlib's style while tests make figures, where a marker does not say.",
        metavar="STYLE",
    ),
    Option(
        "backend",
        "matplotlib's backend while tests make figures, where a marker does not say.",
        metavar="BACKEND",
    ),
    Option(
        "report",
        "Write a report also when nothing fails, for people or for programs. Default: html, after a failure.",
        ("html", "json"),
    ),
    Option(
        "device",
        "What renders scenes: a number of `glpath devices`, gpu (fail rather than render in software), egl or "
        "osmesa.",
        metavar="DEVICE",
    ),
)


def add_options(parser: pytest.Parser) -> None:
    """Register every option with pytest."""
    group = parser.getgroup("glpath", "image tests by glpath; in the ini-file as glpath_update ...")
    for option in OPTIONS:
        kind = {"choices": option.choices} if option.choices else {"metavar": option.metavar}
        group.addoption(f"--glpath-{option.name}", help=option.help, **kind)
        parser.addini(_ini(option.name), option.help, default="")


def chosen(config: pytest.Config, name: str) -> str | None:
    """Return the value from the command line, otherwise from the ini-file, otherwise None."""
    given = config.getoption(f"--glpath-{name}") or config.getini(_ini(name)).strip()
    return str(given) if given else None


def is_from_command_line(config: pytest.Config, name: str) -> bool:
    """Return True if the option is on the command line, which overrides the ini-file."""
    return bool(config.getoption(f"--glpath-{name}"))


def _ini(name: str) -> str:
    return f"glpath_{name.replace('-', '_')}"


class Settings:
    """Options of a pytest run.

    update : "none", "missing", "failed" or "all"; default "missing", or "none" if CI is set
    keep   : "failures" or "all"
    mode   : mode for tests that give none; None: chosen by the image
    limits : texts for `glpath.compare.read_limits`, by mode
    device : options of `glpath.render`
    style, backend : style and backend of matplotlib; None: unchanged
    """

    def __init__(
        self,
        update: str,
        keep: str,
        mode: str | None,
        limits: Mapping[str, tuple[str, ...]],
        device: Mapping[str, Any],
        style: str | None,
        backend: str | None,
    ) -> None:
        self.update, self.keep, self.mode = update, keep, mode
        self.limits, self.device = limits, device
        self.style, self.backend = style, backend

    @classmethod
    def of(cls, config: pytest.Config) -> Settings:
        """Return the settings of a run. Raises pytest.UsageError for an invalid value."""
        for option in OPTIONS:
            value = chosen(config, option.name)
            if option.choices and value not in (None, *option.choices):
                allowed = ", ".join(option.choices)
                raise pytest.UsageError(f"{_ini(option.name)} = {value}: expected one of {allowed}.")
        by_itself = "none" if _is_ci() else "missing"
        return cls(
            chosen(config, "update") or by_itself,
            chosen(config, "keep") or "failures",
            chosen(config, "mode"),
            _limits(chosen(config, "limits") or ""),
            _device(chosen(config, "device")),
            chosen(config, "style"),
            chosen(config, "backend"),
        )


def _is_ci() -> bool:
    """Return True if CI is set, as in every known service, except CI=false and CI=0."""
    return os.environ.get("CI", "").lower() not in ("", "0", "false", "no")


def _limits(text: str) -> dict[str, tuple[str, ...]]:
    """Return limits such as "fuzzy.threshold=4 stat.sees=0.02" by mode."""
    found: dict[str, tuple[str, ...]] = {}
    for entry in text.replace(",", " ").split():
        mode, dot, limit = entry.partition(".")
        if not dot or "=" not in limit:
            raise pytest.UsageError(
                f"glpath_limits: found {entry}, expected MODE.NAME=X, such as fuzzy.threshold=4."
            )
        found[mode] = (*found.get(mode, ()), limit)
    return found


def _device(text: str | None) -> dict[str, Any]:
    if text is None:
        return {}
    if (number := unsigned(text)) is not None:
        return {"device": number}
    if text == "gpu":
        return {"require_gpu": True}
    if text in ("egl", "osmesa"):
        return {"backend": text}
    raise pytest.UsageError(f"--glpath-device {text}: expected a number of `glpath devices`, gpu, egl or osmesa.")
