"""`glpath diff`: how far one picture is from another."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from glpath.errors import UsageError


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    app.command(epilog="Exit codes: 0 done, 1 failed or above --fail, 2 wrong usage.")(diff)


def diff(
    image: Annotated[Path, typer.Argument(metavar="A", help=".exr, .npz, .npy or .png.")],
    reference: Annotated[Path, typer.Argument(metavar="B", help="What A is measured against.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Write the difference as a .png: red is too bright, blue too dark."),
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Relative difference that gets the full colour; 99 % of pixels by itself.")
    ] = None,
    fail: Annotated[float | None, typer.Option(metavar="X", help="Exit with 1 when relMSE is above X.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Compare two pictures of one size.

    relMSE is mean((A - B)² / (B² + 0.01)); the mean ratio, mean(A) / mean(B), shows energy lost or gained. Radiance
    files compare radiance; a .png has been through the tone map.
    """
    from glpath import compare
    from glpath.image import check_writable, read_image, write_png

    if out is not None:
        if out.suffix.lower() != ".png":
            raise UsageError(f"{out}: the difference is written as .png only.")
        check_writable(out)
    if fail is not None and not fail >= 0:
        raise UsageError(f"--fail {fail}: must be at least 0.")
    a, b = read_image(image), read_image(reference)
    measured = {
        "relMSE": compare.relative_mse(a, b),
        "RMSE": math.sqrt(compare.mse(a, b)),
        "max": compare.max_difference(a, b),
        "PSNR": compare.psnr(a, b),
        "mean ratio": compare.mean_ratio(a, b),
    }
    full_colour = None
    if out is not None:
        picture, full_colour = compare.difference_image(a, b, scale)
        write_png(out, picture, {"Software": "glpath", "glpath.scale": repr(full_colour)})
    if as_json:
        # JSON has neither infinity nor NaN.
        plain = {key: value if math.isfinite(value) else None for key, value in measured.items()}
        typer.echo(json.dumps({"image": str(image), "reference": str(reference), **plain, "scale": full_colour}))
    else:
        for key, value in measured.items():
            unit = " dB" if key == "PSNR" else ""
            typer.echo(f"{key:<10}  {value:.6g}{unit}")
        if out is not None:
            typer.echo(f"wrote {out}; full colour is a relative difference of {full_colour:.3g}")
    if fail is not None and measured["relMSE"] > fail:
        typer.echo(f"glpath: relMSE {measured['relMSE']:.6g} is above --fail {fail:g}", err=True)
        raise typer.Exit(1)
