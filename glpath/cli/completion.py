"""Shell completion (`glpath --install-completion`) of scenes, of an option's choices and of scene parameters."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

import typer

Completions = list[tuple[str, str]]


def words(allowed: Iterable[str]) -> Callable[[str], list[str]]:
    """Return a completion callback that lists the allowed words that start with the typed text."""
    known = list(allowed)

    def complete(incomplete: str) -> list[str]:
        return [word for word in known if word.startswith(incomplete)]

    return complete


def scenes(incomplete: str) -> Completions:
    """Return names of shipped scenes with their titles, then scene files and folders."""
    from glpath.io import shipped_scenes
    from glpath.io.library import SCENE_SUFFIXES

    found = [(name, text) for name, text in shipped_scenes().items() if name.startswith(incomplete)]
    folder, start = os.path.split(incomplete)
    try:
        entries = sorted(Path(folder or ".").iterdir())
    except OSError:
        entries = []
    for entry in entries:
        if entry.name.startswith(start) and (start.startswith(".") or not entry.name.startswith(".")):
            path = os.path.join(folder, entry.name)
            if os.path.isdir(entry):
                found.append((path + os.sep, "folder"))
            elif entry.suffix.lower() in SCENE_SUFFIXES:
                found.append((path, "file"))
    return found


def parameters(ctx: typer.Context, incomplete: str) -> Completions:
    """Return KEY= for each parameter of the scenes that are typed already; if none is, of all generated scenes."""
    from glpath.io import scene_parameters
    from glpath.io.library import GENERATED

    given = ctx.params.get("scene") or ctx.params.get("scenes")
    named = [given] if isinstance(given, str) else list(given or GENERATED)
    found = {
        f"{key}=": description if default is None else f"{description} (default {default})"
        for name in named
        for key, (default, description) in scene_parameters(name).items()
    }
    return [(key, text) for key, text in found.items() if key.startswith(incomplete)]
