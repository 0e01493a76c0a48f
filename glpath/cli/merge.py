"""`glpath merge`: films of ranges of path sets, rendered anywhere, as one film or picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glpath.cli.completion import words
from glpath.cli.options import QuietOption
from glpath.cli.values import check_choice
from glpath.cli.values import exposure as read_exposure
from glpath.denoise import require_denoiser
from glpath.files import Save, check_writable, save_all
from glpath.image import TONEMAPS
from glpath.progress import percent
from glpath.terminal import say


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(epilog="Exit codes: 0 done, 1 failed, 2 wrong usage, or films that do not belong together.")(merge)


def merge(
    films: Annotated[
        list[Path],
        typer.Argument(metavar="FILM...", help=".npz of `glpath render`, each with path sets of its own."),
    ],
    out: Annotated[
        list[Path],
        typer.Option("-o", "--out", help="Write .png, .exr (radiance) or .npz (a film again); may be repeated."),
    ],
    exposure: Annotated[
        str | None, typer.Option(metavar="STOPS|auto", help="Brightness of a .png, as of render.")
    ] = None,
    tonemap: Annotated[
        str,
        typer.Option(metavar="|".join(TONEMAPS), help="Tone curve of a .png.", autocompletion=words(TONEMAPS)),
    ] = "srgb",
    denoise: Annotated[
        bool, typer.Option("--denoise", help="Denoise .png and .exr; of films with the AOVs albedo and normal.")
    ] = False,
    quiet: QuietOption = False,
) -> None:
    """Add up films of one render: every path set counts the same, and once.

    A shard is what `glpath render SCENE --sample-range A:B -o a.npz` or a part of a job writes. In any order they
    have the bits of a render in one go, where they come from one kind of device. A file that is named twice, or a
    copy of one, counts once; shards that share path sets, and those of another scene or setting, are refused.
    """
    from glpath.film import check_suffix
    from glpath.jobs.shards import merge_shards

    for path in out:
        check_suffix(path)
        check_writable(path)
    check_choice("--tonemap", tonemap, tuple(TONEMAPS))
    stops = read_exposure(exposure)
    if denoise:
        require_denoiser()
    film, repeated = merge_shards(films)
    stops = film.exposure_stops(stops)
    saves: dict[Path, Save] = {
        path: lambda at: film.save(at, exposure=stops, tonemap=tonemap, denoise=denoise) for path in out
    }
    written, failure = save_all(saves, {"film.npz": film.save}, "The film is kept in {}.")
    if not quiet:
        for path in repeated:
            say(f"{path}: is there already, and counts once", err=True)
        error = film.relative_error()
        noise = "" if error is None else f", error about {percent(error)}"
        ranges = ", ".join(f"{start}:{stop}" for start, stop in film.ranges)
        say(f"{film.path_sets} path sets ({ranges}) of {len(films) - len(repeated)} films{noise}", err=True)
        for path in written:
            say(f"wrote {path}", err=True)
    if failure is not None:
        raise failure
