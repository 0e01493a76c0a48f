"""`glpath export`: a scene for other programs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from glpath.cli.help import command_help
from glpath.cli.scene import Parameters, SceneArgument, read_scene, seen
from glpath.cli.scene_options import OF_SHAPES, with_scene_options
from glpath.cli.signals import result_of
from glpath.cli.values import resolution as read_resolution
from glpath.io.export import MAX_DEPTH, SPP, check_export, exported, is_for_mitsuba
from glpath.io.export.mitsuba_xml import files_folder
from glpath.system.files import check_writable
from glpath.system.outputs import check_outputs, save_all
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
        path: {"max_depth": max_depth, "spp": spp}
        if known or not any(for_mitsuba.values())
        else {"max_depth": None, "spp": None}
        for path, known in for_mitsuba.items()
    }
    for path in out:
        check_export(path, **settings[path])
    size = None if resolution is None else read_resolution(resolution)
    loaded = result_of(lambda: seen(read_scene(scene, parameters), size, {}))
    check_outputs(out, [scene])
    for path in out:
        if for_mitsuba[path]:
            check_writable(files_folder(path) / "mesh.ply")
    written, failure = save_all({path: partial(exported, loaded, **settings[path]) for path in out})
    if not quiet:
        for path in written:
            say(f"wrote {path}", err=True)
    if failure is not None:
        raise failure
