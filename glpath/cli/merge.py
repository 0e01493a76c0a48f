"""`glpath merge`: films of ranges of path sets, rendered anywhere, as one film; and shards of daylight."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glpath.cli.help import command_help
from glpath.cli.options import with_options
from glpath.cli.picture import DenoiseOption, ExposureOption, Picture, TonemapOption
from glpath.cli.run_request import RunRequest
from glpath.errors import UsageError
from glpath.film.aovs import guides_denoiser
from glpath.system.files import check_writable, save_all
from glpath.system.reporting import percent
from glpath.system.terminal import say


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath merge a.npz b.npz -o all.npz", "one film of two shards"),
        ("glpath merge shard-*.npz -o room.png -o room.exr --exposure 1", "and its pictures"),
        ("glpath merge dc-1.npz dc-2.npz -o dc.npz", "daylight coefficients of two shards"),
    )
    epilog = "Exit codes: 0 done, 1 failed, 2 wrong usage, or films that do not belong together."
    app.command(epilog=epilog, **help)(with_options(merge, ("quiet",)))


def merge(
    films: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILM...",
            help=".npz of `glpath render`, each with path sets of its own; or of `glpath daylight --shard`.",
        ),
    ],
    out: Annotated[
        list[Path],
        typer.Option("-o", "--out", help="Write .png, .exr (radiance) or .npz (a film again); may be repeated."),
    ],
    exposure: ExposureOption = None,
    tonemap: TonemapOption = "srgb",
    denoise: DenoiseOption = None,
    *,
    run: RunRequest,
) -> None:
    """Add up films of one render: every path set counts the same, and once.

    A shard is what `glpath render SCENE --sample-range A:B -o a.npz` or a part of a job writes. In any order they
    are bit-identical to an uninterrupted render, where they come from one kind of device. A file that is named
    twice, or a copy of one, counts once. Shards that share path sets, and those of another scene or setting, are
    refused. So it is with shards of `glpath daylight --shard K/N`, each of which has sensors of its own.
    """
    from glpath.daylight.merging import is_coefficients
    from glpath.film.film import check_suffix
    from glpath.jobs.shards import merge_shards

    for path in out:
        check_suffix(path)
        check_writable(path)
    if films and is_coefficients(films[0]):
        _merge_coefficients(films, out, run, pictured=exposure is not None or denoise is not None)
        return
    picture = Picture.of_options(exposure, tonemap, denoise)
    film, repeated = merge_shards(films)
    picture = picture.of_film(film.metadata.noisy and guides_denoiser(film.metadata.aovs), out)
    saves = picture.saves(film, out, film.exposure_stops(picture.exposure))
    written, failure = save_all(saves, {"film.npz": film.save}, "The film is kept in {}.")
    if not run.quiet:
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


def _merge_coefficients(shards: list[Path], out: list[Path], run: RunRequest, pictured: bool) -> None:
    from glpath.daylight.merging import merge_coefficients

    wrong = next((path for path in out if path.suffix.lower() != ".npz"), None)
    if wrong is not None or pictured:
        what = f"{wrong}: daylight coefficients are" if wrong is not None else "merge: daylight coefficients are"
        raise UsageError(f"{what} no picture.", "Write .npz, without --exposure and --denoise.")
    found, repeated = merge_coefficients(shards)
    written, failure = save_all(
        {path: found.save for path in out}, {"daylight.npz": found.save}, "The coefficients are kept in {}."
    )
    if not run.quiet:
        for path in repeated:
            say(f"{path}: is there already, and counts once", err=True)
        of = "" if found.shard is None else f" of {found.shard.total:,}, from number {found.shard.first}"
        say(f"{len(found):,} sensors{of} of {len(shards) - len(repeated)} shards", err=True)
        for path in written:
            say(f"wrote {path}", err=True)
    if failure is not None:
        raise failure
