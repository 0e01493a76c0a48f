"""`glpath daylight`: what each patch of the sky and each position of the sun give to sensors."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from glpath.cli.completion import words
from glpath.cli.help import command_help
from glpath.cli.options import with_options
from glpath.cli.run_request import OF_DAYLIGHT, RunRequest
from glpath.cli.scene import Parameters, SceneArgument, read_scene
from glpath.cli.signals import exit_code, result_of
from glpath.cli.values import check_choice, vector
from glpath.errors import UsageError
from glpath.io.completed import aside
from glpath.system.files import check_writable, is_stream, save_all
from glpath.system.reporting import ProgressEvent, reporting
from glpath.system.terminal import say

if TYPE_CHECKING:
    from glpath.daylight.coefficients import DaylightCoefficients
    from glpath.daylight.compute import DaylightProgress
    from glpath.daylight.receivers import Receiver

_POINTS, _SKY, _BOUNCES = "Points", "Sun and sky", "Reflected light"
_RECEIVERS = ("plane", "cylinder", "sphere")


def register(app: typer.Typer) -> None:
    """Put the command on the main program."""
    help = command_help(
        ("glpath daylight city.glb -o dc.npz --points sensors.csv", "145 patches of the sky"),
        ("glpath daylight city.glb -o dc.npz --points sensors.csv --latitude 51.5", "and the suns of the year"),
        ("glpath daylight office.toml -o dc.npz --points desk.csv --subdivision 4 --resume", "2,305 patches"),
        everyday="scene out points normal receiver subdivision samples latitude suns max_depth north resume device "
        "parameters quiet",
    )
    epilog = (
        "Exit codes: 0 done, 1 failed, 2 wrong usage, 75 ended by SIGTERM or SIGUSR1 with --resume (start it "
        "again), 130 interrupted (continue with --resume)."
    )
    texts = {"resume": "Keep what is done in FILE.part, and resume from it after an interruption: the same bits."}
    app.command(epilog=epilog, **help)(with_options(daylight, OF_DAYLIGHT, texts=texts))


def daylight(
    scene: SceneArgument,
    out: Annotated[
        Path,
        typer.Option("-o", "--out", metavar="FILE", help="Where they go, .npz (`DaylightCoefficients`)."),
    ],
    points: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            help="Sensors of a CSV file: columns x, y, z and nx, ny, nz; - for stdin.",
            rich_help_panel=_POINTS,
        ),
    ],
    normal: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Where all face, of a file without normals.", rich_help_panel=_POINTS),
    ] = None,
    receiver: Annotated[
        str,
        typer.Option(
            metavar="|".join(_RECEIVERS),
            help="plane: across the normal, lit on its side. cylinder: the mean around it. sphere: the mean of all "
            "directions.",
            autocompletion=words(_RECEIVERS),
            rich_help_panel=_POINTS,
        ),
    ] = "plane",
    subdivision: Annotated[
        int,
        typer.Option(metavar="1|2|4", help="145, 577 or 2,305 patches, and the ground.", rich_help_panel=_SKY),
    ] = 1,
    samples: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Directions into each patch: 1, its centre, or an even number; errors are estimated from 4 on.",
            rich_help_panel=_SKY,
        ),
    ] = 4,
    latitude: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES", help="For positions of the sun, positive in the north; none.", rich_help_panel=_SKY
        ),
    ] = None,
    suns: Annotated[
        int, typer.Option(metavar="N", help="Positions of the sun at most.", rich_help_panel=_SKY)
    ] = 600,
    max_depth: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Surfaces that light meets, the sensor among them, at most: 1 is direct light; all.",
            rich_help_panel=_BOUNCES,
        ),
    ] = None,
    elements: Annotated[
        int, typer.Option(metavar="N", help="Of the surfaces, about.", rich_help_panel=_BOUNCES)
    ] = 2000,
    gather_rays: Annotated[
        int, typer.Option(metavar="N", help="Of each sensor, for reflected light.", rich_help_panel=_BOUNCES)
    ] = 1024,
    north: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Default: y where z is up, -z where y is up.", rich_help_panel=_SKY),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the directions.", rich_help_panel=_SKY)] = 0,
    parameters: Parameters = None,
    *,
    run: RunRequest,
) -> None:
    """Daylight coefficients: the irradiance of each sensor for unit radiance of each patch of the sky and of the
    ground, and for unit irradiance by the sun in each of its positions. With all reflections, by a solution to
    which all surfaces are diffuse.

    Patches are Tregenza's, or Reinhart's subdivisions, in the order of Radiance's reinsrc (MF:1, 2, 4). Sensors may
    lie on surfaces or be free. The scene needs neither camera nor light.
    """
    from glpath.cli.point_files import check_within, read_points

    check_choice("--receiver", receiver, _RECEIVERS)
    if out.suffix.lower() != ".npz" or is_stream(out):
        raise UsageError(f"{out}: daylight coefficients are written as .npz.", "Name the file dc.npz, say.")
    with aside("camera", "light"):
        loaded = read_scene(scene, parameters)
    at = read_points(points, vector("--normal", normal))
    check_within(at, loaded, f"--points {points}")
    check_writable(out)
    from glpath.daylight.kept_words import kept_beside

    part = kept_beside(out) if run.resume else None

    def compute() -> DaylightCoefficients:
        from glpath.daylight.compute import daylight_coefficients

        with reporting(run.mode, sys.stderr, _event) as report:
            return daylight_coefficients(
                loaded,
                at.points,
                at.normals,
                subdivision=subdivision,
                samples=samples,
                latitude=latitude,
                suns=suns,
                receiver=cast("Receiver", receiver),
                max_depth=max_depth,
                elements=elements,
                gather_rays=gather_rays,
                north=vector("--north", north),
                seed=seed,
                resume=part,
                on_progress=report,
                backend=run.backend,
                device=run.device,
                require_gpu=run.require_gpu,
            )

    try:
        found = result_of(compute)
    except KeyboardInterrupt as stop:
        kept = f"what is done is in {part}" if part else "nothing is kept; --resume keeps what is done"
        say(f"glpath: interrupted: {kept}", err=True)
        if part is not None:
            say(f"  to resume: {shlex.join(sys.argv)}", err=True)
        raise typer.Exit(exit_code()) from stop
    _, failure = save_all({out: found.save}, {"daylight.npz": found.save}, "The coefficients are kept in {}.")
    if failure is not None:
        raise failure
    if run.talks:
        for line in _summary(found):
            say(line, err=True)
        say(f"wrote {out}", err=True)


def _summary(found: DaylightCoefficients) -> Iterator[str]:
    import numpy as np

    yield (
        f"{len(found):,} sensors, {len(found.patches) - 1:,} patches of the sky and the ground, "
        f"{len(found.suns):,} positions of the sun, {len(found.directions):,} directions"
    )
    view = found.sky_view
    yield f"  sky view factor: mean {view.mean():.4f}, minimum {view.min():.4f}, maximum {view.max():.4f}"
    error = found.standard_errors
    if np.isfinite(error).all():
        relative = error / np.maximum(found.sky_sums, 1e-30)
        lit = found.sky_sums > 0
        if lit.any():
            yield f"  standard error of a row's sum: {100 * np.median(relative[lit]):.2g} % in the median"
    if found.indirect is None:
        yield "  direct light alone"
    else:
        direct = np.concatenate([found.direct_sky(slice(a, a + 1024)).sum(1) for a in range(0, len(found), 1024)])
        share = 1.0 - direct.sum() / max(float(found.sky_sums.sum()), 1e-30)
        yield f"  {100 * share:.0f} % of the light under a uniform sky is reflected"
    if found.dark:
        yield f"  {found.dark:,} sensors see nothing at all: inside of solids, or below the ground"


def _event(progress: DaylightProgress) -> ProgressEvent:
    rays = progress.done * progress.sensors
    speed = f", {rays / progress.elapsed_s / 1e6:,.3g} million rays/s" if progress.elapsed_s > 0 and rays else ""
    text = (
        f"{progress.done:,} of {progress.total:,} directions{speed}" if progress.stage == "rays" else progress.stage
    )
    return ProgressEvent(
        stage=progress.stage,
        elapsed_s=progress.elapsed_s,
        done=progress.done,
        total=progress.total or None,
        detail=text,
        line=text,
        values={"done": progress.done, "total": progress.total, "sensors": progress.sensors},
    )
