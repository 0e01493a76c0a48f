"""Integrators by the names that users give, and all their options as keyword arguments."""

from __future__ import annotations

from typing import Literal

from glpath.integrators.gather_settings import GatherKeywords, GatherSettings
from glpath.integrators.path_settings import PathBufferKeywords, PathBufferSettings, PathSettings
from glpath.integrators.settings import IntegratorSettings, SharedKeywords
from glpath.integrators.whitted_settings import ClassicSettings, TBufferSettings, WhittedKeywords

Integrator = Literal["auto", "path", "path-buffer", "gather", "classic", "t-buffer"]

#: Name for the automatic choice of an integrator, see `glpath.rendering.choice`.
AUTO: Integrator = "auto"

#: Settings of each integrator. A new integrator needs a line here, and one in `glpath.rendering.factory.PLANS`.
INTEGRATORS: dict[str, type[IntegratorSettings]] = {
    settings.integrator: settings
    for settings in (PathSettings, PathBufferSettings, GatherSettings, ClassicSettings, TBufferSettings)
}


class IntegratorKeywords(SharedKeywords, PathBufferKeywords, GatherKeywords, WhittedKeywords, total=False):
    """Options of all integrators as keyword arguments, for type checkers; None means not given."""
