"""`glpath merge`: combine films of several ranges of path sets, or shards of daylight coefficients, into one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glpath.cli.help import command_help
from glpath.cli.options import with_options
from glpath.cli.picture import NO_DENOISER, TONEMAP, DenoiseOption, ExposureOption, Picture, TonemapOption
from glpath.cli.run_request import RunRequest
from glpath.cli.signals import result_of
from glpath.errors import UsageError, warn
from glpath.film.aovs import guides_denoiser
from glpath.system.outputs import check_outputs, save_all
from glpath.system.reporting import percent
from glpath.system.terminal import say

if TYPE_CHECKING:
    from glpath.film.film import Film
    from glpath.film.metadata import FilmMetadata

# Remedy in messages about films without the AOVs that the denoiser needs.
_HOW_TO_GUIDE = "Render shards without --no-denoise; a job made in Python has to ask for these AOVs."


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
        typer.Option(
            "-o", "--out", help="Write .png, .jpg, .exr (radiance) or .npz (a film again); may be repeated."
        ),
    ],
    exposure: ExposureOption = None,
    tonemap: TonemapOption = TONEMAP,
    denoise: DenoiseOption = None,
    *,
    run: RunRequest,
) -> None:
    """Add up films of one render: every path set has the same weight and counts once.

    A shard is a film that `glpath render SCENE --sample-range A:B -o a.npz` or a part of a job has written. Shards
    from devices of one kind give the picture and the layers of an uninterrupted render, bit for bit, in any order.
    A file that is named twice counts once, and so does a copy of a file. Shards that share path sets are refused,
    and so are shards of another scene or setting. The same holds for shards of `glpath daylight --shard K/N`, each
    of which has sensors of its own.
    """
    from glpath.apps.daylight.merging import is_coefficients
    from glpath.film.film import check_suffix
    from glpath.jobs.shards import UnguidedShardError, merge_shards

    for path in out:
        check_suffix(path)
    check_outputs(out, films)
    if films and is_coefficients(films[0]):
        _merge_coefficients(films, out, run, pictured=(exposure, tonemap, denoise) != (None, TONEMAP, None))
        return
    picture = Picture.of_options(exposure, tonemap, denoise, out)
    try:
        film, repeated = result_of(lambda: merge_shards(films))
    except UnguidedShardError as unguided:
        unguided.remedy = _HOW_TO_GUIDE
        raise
    _check_denoisable(film.metadata, films[0], out, picture.denoise)
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
        for line in _notes(film, picture):
            say(f"  {line}", err=True)
        for path in written:
            say(f"wrote {path}", err=True)
    if failure is not None:
        raise failure


def _check_denoisable(metadata: FilmMetadata, first: Path, out: list[Path], denoise: bool | None) -> None:
    """Raise UsageError if --denoise is impossible. Warn if a picture stays noisy that `glpath render` denoises.

    metadata : metadata of the merged film
    first    : first of the merged files; all of them have the same AOVs
    denoise  : value of --denoise; None: denoise if possible
    """
    from glpath.jobs.shards import WITHOUT_GUIDES

    if not metadata.noisy:
        if denoise:
            raise UsageError(
                f"--denoise: {first} is by {metadata.integrator}, which has no noise for a denoiser to remove.",
                "Leave --denoise out.",
            )
        return
    pictures = [path for path in out if path.suffix.lower() != ".npz"]
    if guides_denoiser(metadata.aovs) or denoise is False or not pictures:
        return
    if denoise:
        raise UsageError(f"--denoise: {first} {WITHOUT_GUIDES}.", _HOW_TO_GUIDE)
    warn(
        f"{pictures[0]}: is not denoised, because {first} {WITHOUT_GUIDES}. {_HOW_TO_GUIDE} "
        "With --no-denoise, `merge` does not warn."
    )


def _notes(film: Film, picture: Picture) -> Iterator[str]:
    """Yield notes for the user: missing path sets, different devices or versions, and if pictures are denoised."""
    gaps = [f"{start}:{stop}" for (_, start), (stop, _) in pairwise(film.ranges)]
    if gaps:
        yield f"no film holds path sets {', '.join(gaps)}"
    versions = film.metadata.versions
    origins = {
        "devices": film.metadata.device,
        "drivers": versions.get("driver", ""),
        "versions of glpath": versions.get("glpath", ""),
    }
    for name, origin in origins.items():
        if " + " in origin:
            yield f"rendered by several {name} ({origin}): the last bits may differ from those of one render"
    if picture.denoise:
        yield "denoised by Open Image Denoise"
    elif picture.missing:
        yield NO_DENOISER


def _merge_coefficients(shards: list[Path], out: list[Path], run: RunRequest, pictured: bool) -> None:
    from glpath.apps.daylight.merging import merge_coefficients

    wrong = next((path for path in out if path.suffix.lower() != ".npz"), None)
    if wrong is not None or pictured:
        what = f"{wrong}: daylight coefficients are" if wrong is not None else "merge: daylight coefficients are"
        raise UsageError(f"{what} no picture.", "Write .npz, without --exposure, --tonemap and --denoise.")
    found, repeated = result_of(lambda: merge_coefficients(shards))
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
