"""Files that glpath reads, by the suffixes that the code knows, and writes, as each command says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import typer

from glpath.apps.terrain.reading import CLOUD_SUFFIXES, FIELD_SUFFIXES
from glpath.cli.commands import COMMANDS
from glpath.cli.main import app
from glpath.compare import SUFFIXES as COMPARED
from glpath.film.image import READABLE
from glpath.io import photometry
from glpath.io.gltf.document import KNOWN_EXTENSIONS, UNUSED_EXTENSIONS
from glpath.io.library import SCENE_SUFFIXES
from glpath.io.lights import MAPS
from glpath.io.materials import FORMATS as TEXTURES
from glpath.io.other_files import KINDS
from glpath_docs.commands import help_of, record
from glpath_docs.markdown import code, table


def pages() -> dict[str, str]:
    """The page of formats, by path."""
    text = [
        "# File formats\n",
        "## Read\n",
        table(
            ("what", "files"),
            [
                ("scenes and models", _listed(SCENE_SUFFIXES)),
                ("textures", _listed(TEXTURES)),
                ("environment maps", _listed(MAPS)),
                ("profiles of lamps", _listed(photometry.SUFFIXES)),
                ("height fields, by `glpath horizon`", _listed(FIELD_SUFFIXES)),
                ("clouds of points, by `glpath horizon`", _listed(CLOUD_SUFFIXES)),
                ("pictures, by `glpath.read_image`", _listed(READABLE)),
                ("pictures to compare, by `glpath diff`", _listed(COMPARED)),
            ],
        ),
        "## Written\n",
        table(("command", "files"), _written()),
        "## Extensions of glTF\n",
        "These are used, or nothing is lost without them:\n",
        ", ".join(code(each) for each in sorted(KNOWN_EXTENSIONS)) + "\n",
        "Of these a part of the look is lost, with a warning:\n",
        table(
            ("extension", "what is lost"), [(code(name), lost) for name, lost in sorted(UNUSED_EXTENSIONS.items())]
        ),
        "## No scenes, and what to do with them\n",
        table(
            ("file", "what it is", "what to do"),
            [(code(suffix), what, remedy.format("FILE")) for suffix, (what, remedy) in KINDS.items()],
        ),
    ]
    return {"reference/file-formats.md": "\n".join(text)}


def _listed(suffixes: Sequence[str]) -> str:
    return ", ".join(map(code, suffixes))


def _written() -> list[tuple[str, str]]:
    group: Any = typer.main.get_command(app)
    rows = []
    with typer.Context(group, info_name="glpath") as context:
        for name in COMMANDS:
            for parameter in group.commands[name].params:
                if parameter.name in ("out", "output"):
                    _, about = record(parameter, context)
                    rows.append((f"[{code(f'glpath {name}')}](commands/{name}.md)", help_of(about)))
    return rows
