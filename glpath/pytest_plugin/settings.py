"""The options of one pytest run, as the fixture needs them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pytest


@dataclass(frozen=True)
class Settings:
    """The options of one pytest run.

    update : "none", "missing", "failed" or "all"; explicit, or "missing", and "none" where CI is set
    device : options of `glpath.render`
    """

    update: str
    device: Mapping[str, Any]

    @classmethod
    def of(cls, config: pytest.Config) -> Settings:
        """Raises pytest.UsageError for a device that cannot be."""
        by_itself = "none" if _is_ci() else "missing"
        device = _device(config.getoption("--glpath-device"))
        return cls(config.getoption("--glpath-update") or by_itself, device)


def _is_ci() -> bool:
    """Whether CI is set, as every known service does; CI=false and CI=0 say no."""
    return os.environ.get("CI", "").lower() not in ("", "0", "false", "no")


def _device(text: str | None) -> dict[str, Any]:
    if text is None:
        return {}
    if text.isdecimal():
        return {"device": int(text)}
    if text == "gpu":
        return {"require_gpu": True}
    if text in ("egl", "osmesa"):
        return {"backend": text}
    raise pytest.UsageError(f"--glpath-device {text}: expected a number of `glpath devices`, gpu, egl or osmesa.")
