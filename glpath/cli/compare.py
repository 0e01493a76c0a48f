"""`glpath diff`: how far one picture is from another, and whether they count as the same."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glpath.cli.help import command_help
from glpath.cli.signals import hold
from glpath.errors import ImageError, UsageError
from glpath.system.terminal import has_no_reader, say, say_json

if TYPE_CHECKING:
    from glpath.compare import Verdict

#: Exit code if the numbers cannot be printed (EX_IOERR of sysexits.h); 1 would mean that the pictures differ.
NOT_PRINTED = 74


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath diff a.png b.png", "the numbers"),
        ("glpath diff a.exr b.exr -o difference.png", "where they differ"),
        ("glpath diff new.npz old.npz --mode stat", "the same but for their noise?"),
    )
    epilog = "Exit codes: 0 done, 1 failed, above --fail or not the same by --mode, 2 wrong usage, "
    epilog += f"{NOT_PRINTED} standard output cannot be written."
    app.command(epilog=epilog, **help)(diff)


def diff(
    image: Annotated[Path, typer.Argument(metavar="A", help=".exr, .npz, .npy, .png, .jpg ...")],
    reference: Annotated[Path, typer.Argument(metavar="B", help="What A is measured against.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Write the difference as a .png: red is too bright, blue too dark."),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Relative difference that gets the full colour; default: the 99th percentile."),
    ] = None,
    mode: Annotated[
        str | None,
        typer.Option(
            metavar="exact|fuzzy|stat|flip", help="Judge as an image test does; exit with 1 if not the same."
        ),
    ] = None,
    stat: Annotated[
        bool, typer.Option("--stat", help="The same as --mode stat: is the difference more than noise?")
    ] = False,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=X",
            help="A limit of the mode; may be repeated. fuzzy: threshold, edge, failpercent. stat: alpha, "
            "tolerance, sees (bias of the whole picture that noise must not hide, 0.05). flip: mean, local, ppd.",
        ),
    ] = None,
    fail: Annotated[
        float | None,
        typer.Option(
            metavar="X", help="Exit with 1 when relMSE is above X; with --failpercent, what makes a pixel differ."
        ),
    ] = None,
    failpercent: Annotated[
        float | None,
        typer.Option(metavar="Y", help="Exit with 1 when more than Y % of the pixels differ by more than --fail."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Compare two pictures of the same size.

    relMSE is mean((A - B)² / (B² + 0.01)). The mean ratio, mean(A) / mean(B), shows energy lost or gained. Radiance
    files are compared by radiance; values of a .png have passed the tone map. Pictures with alpha are compared over
    black or over white, whichever gives the larger difference. --stat needs pictures with a record of their noise:
    films (.npz), or baselines and results of image tests (.exr).
    """
    from glpath import compare
    from glpath.compare.reading import check_sizes
    from glpath.film.image import write_png
    from glpath.system.outputs import check_outputs

    if out is not None:
        if out.suffix.lower() != ".png":
            raise UsageError(f"{out}: the difference is written as .png only.")
        check_outputs([out], [image, reference])
    elif scale is not None:
        raise UsageError(f"--scale {scale:g}: belongs to -o FILE.png.", "Leave it out.")
    if fail is not None and not 0 <= fail < math.inf:
        raise UsageError(f"--fail {fail}: must be a finite number, at least 0.")
    if failpercent is not None:
        if fail is None:
            raise UsageError("--failpercent: says how many pixels, and --fail by how much: give both.")
        if not 0 <= failpercent <= 100:
            raise UsageError(f"--failpercent {failpercent}: must be from 0 to 100.")
    if stat and mode not in (None, "stat"):
        raise UsageError(f"--stat and --mode {mode} contradict each other.", "Give one of them.")
    mode = "stat" if stat else mode
    if limit and mode is None:
        raise UsageError("--limit: belongs to a --mode.")
    limits = compare.read_limits(mode, limit or []) if mode is not None else {}
    check_sizes(image, reference)
    ours, theirs = compare.read_picture(image), compare.read_picture(reference)
    a, b = (side.mean for side in compare.max_difference_pair(ours, theirs))
    verdict = None if mode is None else compare.compare(ours, theirs, mode, **limits)
    measured = {
        "relMSE": compare.relative_mse(a, b),
        "RMSE": math.sqrt(compare.mse(a, b)),
        "max": compare.max_difference(a, b),
        "PSNR": compare.psnr(a, b),
        "mean ratio": compare.mean_ratio(a, b),
    }
    beyond = None
    if fail is not None and failpercent is not None:
        beyond = measured["percent beyond"] = compare.percent_beyond(a, b, fail)
    full_colour: float | None = None
    failure: ImageError | None = None
    hold()
    if out is not None:
        picture, full_colour = compare.difference_image(a, b, scale)
        try:  # written before the numbers are printed, because printing may fail
            write_png(out, picture, {"Software": "glpath", "glpath.scale": repr(full_colour)})
        except ImageError as error:
            failure = error

    def report() -> None:
        if as_json:
            # JSON has neither infinity nor NaN, so null replaces them.
            plain = {key: value if math.isfinite(value) else None for key, value in measured.items()}
            judged = {} if verdict is None else _as_json(verdict, ours.differences_in_making(theirs))
            files = {"image": str(image), "reference": str(reference)}
            say_json({**files, **plain, "scale": full_colour, **judged})
            return
        for key, value in measured.items():
            unit = {"PSNR": " dB", "percent beyond": f" of the pixels differ by more than {fail}"}.get(key, "")
            say(f"{key:<10}  {value:.6g}{unit}")
        if verdict is not None:
            for line in _verdict_lines(verdict, ours.differences_in_making(theirs)):
                say(line)
        if out is not None and failure is None:
            say(f"wrote {out}; full colour is a relative difference of {full_colour:.3g}")

    try:
        report()
    except ImageError as error:
        if not has_no_reader(error):
            say(f"glpath: error: {error}", err=True)
        raise typer.Exit(NOT_PRINTED) from error
    if failure is not None:
        raise failure
    reasons = []
    if verdict is not None and not verdict.passed:
        reasons.append(f"not the same by --mode {mode}")
    if beyond is not None and failpercent is not None and not beyond <= failpercent:
        reasons.append(
            f"{beyond:.6g} % of the pixels differ by more than --fail {fail:g}, {failpercent:g} % allowed"
        )
    if fail is not None and beyond is None and not measured["relMSE"] <= fail:
        reasons.append(f"relMSE {measured['relMSE']:.6g} is above --fail {fail:g}")
    for reason in reasons:
        say(f"glpath: {reason}", err=True)
    if reasons:
        raise typer.Exit(1)


def _verdict_lines(verdict: Verdict, made_otherwise: Sequence[str]) -> list[str]:
    return [
        f"{verdict.mode:<10}  {'the same' if verdict.passed else 'not the same'}: {verdict.summary}",
        *(f"            made otherwise: {text}" for text in made_otherwise),
    ]


def _as_json(verdict: Verdict, made_otherwise: Sequence[str]) -> dict[str, object]:
    return {
        "mode": verdict.mode,
        "same": verdict.passed,
        "summary": verdict.summary,
        "measured": verdict.measured,
        "limits": verdict.limits,
        "made_otherwise": list(made_otherwise),
    }
