"""`glpath export`: a scene for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glpath.cli.help import command_help
from glpath.cli.scene import Parameters, SceneArgument, read_scene, seen
from glpath.cli.scene_options import OF_SHAPES, with_scene_options
from glpath.cli.values import resolution as read_resolution
from glpath.io.export import MAX_DEPTH, SPP, check_export, exported, is_for_mitsuba
from glpath.system.files import check_outputs, is_stream
from glpath.system.terminal import say

_FOR_MITSUBA = "With -o FILE.xml"


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath export room -o room.glb", "for any glTF viewer"),
        ("glpath export room -o room.xml", "for Mitsuba 3"),
        ("glpath export room -o room.xml --resolution 640x480 --spp 64", "with settings of its own"),
    )
    app.command(**help)(with_scene_options(export, OF_SHAPES))


def export(
    scene: SceneArgument,
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            help="Write .xml, with a folder of meshes and images beside it, or .glb; may be repeated.",
        ),
    ],
    parameters: Parameters = None,
    resolution: Annotated[str | None, typer.Option(metavar="WxH", help="Instead of the scene's.")] = None,
    max_depth: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help=f"Vertices of a path, as of `glpath render`: {MAX_DEPTH}, all bounces, by default.",
            show_default=False,
            rich_help_panel=_FOR_MITSUBA,
        ),
    ] = None,
    spp: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help=f"Samples per pixel: {SPP} by default.",
            show_default=False,
            rich_help_panel=_FOR_MITSUBA,
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Only errors and warnings.")] = False,
) -> None:
    """Write a scene for other programs: Mitsuba 3 (.xml) or any that reads glTF 2.0 (.glb).

    Warnings name what the format cannot store, and what replaces it.
    """
    # --max-depth and --spp apply to .xml outputs only. Without such an output, they are passed to `check_export`,
    # which rejects them.
    for_mitsuba = {path: is_for_mitsuba(path) for path in out}
    settings = {
        path: (max_depth, spp) if known or not any(for_mitsuba.values()) else (None, None)
        for path, known in for_mitsuba.items()
    }
    for path in out:
        check_export(path, *settings[path])
    size = None if resolution is None else read_resolution(resolution)
    loaded = seen(read_scene(scene, parameters), size, {})
    check_outputs(out, [scene])
    for path in sorted(out, key=is_stream):  # pipes last, because writing to a pipe may block
        exported(loaded, path, *settings[path])
        if not quiet:
            say(f"wrote {path}", err=True)
