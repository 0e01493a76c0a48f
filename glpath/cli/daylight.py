"""`glpath daylight`: daylight coefficients of sensors, for each patch of the sky and each position of the sun."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from glpath.cli import completion
from glpath.cli.completion import words
from glpath.cli.daylight_shown import SHOWN, TEXELS, check_shown, saves_shown, texel_request
from glpath.cli.daylight_year import year_request, year_summary
from glpath.cli.help import command_help
from glpath.cli.options import with_options
from glpath.cli.run_request import OF_DAYLIGHT, RunRequest
from glpath.cli.running import workers_of
from glpath.cli.scene import HELP, Parameters, read_scene
from glpath.cli.signals import exit_code, hold, release, result_of
from glpath.cli.typed import typed_command, typed_parameters
from glpath.cli.unattended import done_but, remove_checkpoint
from glpath.cli.values import check_choice, shard_of, vector
from glpath.errors import GlpathError, ImageError, UsageError, collected_warnings
from glpath.io.completed import aside
from glpath.system.files import is_stream
from glpath.system.outputs import Save, check_outputs, rescued, save_all
from glpath.system.reporting import ProgressEvent, reporting
from glpath.system.signals import TERMINATING_TEXT
from glpath.system.terminal import say

if TYPE_CHECKING:
    from glpath.apps.daylight.checkpoint import DaylightCheckpoint
    from glpath.apps.daylight.coefficients import DaylightCoefficients
    from glpath.apps.daylight.compute import DaylightProgress
    from glpath.apps.daylight.receivers import Receiver
    from glpath.apps.daylight.texels import Texels
    from glpath.apps.measure.points import Points
    from glpath.scene import Scene

_POINTS, _SKY, _BOUNCES, _YEAR = "Points", "Sun and sky", "Reflected light", "The year"
_KEPT = "The coefficients are kept in {}."
_RECEIVERS = ("plane", "cylinder", "sphere", TEXELS)


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath daylight city.glb -o dc.npz --points sensors.csv", "145 patches of the sky"),
        ("glpath daylight city.glb -o dc.npz --points sensors.csv --latitude 51.5", "and the suns of the year"),
        ("glpath daylight office.toml -o year.nc --points desk.csv --weather zurich.epw", "a year, hour by hour"),
        everyday="scene out points normal receiver texel_size subdivision latitude max_depth north weather blinds "
        "occupied resume device parameters quiet",
    )
    epilog = (
        "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done but the checkpoint could not be removed, 75 ended by "
        f"a signal ({TERMINATING_TEXT}) with --resume (start it again), 130 interrupted (continue with --resume)."
    )
    texts = {
        "resume": "Keep what is done in FILE.part, and resume from it after an interruption: the same bits.",
        "cluster": "Share the sensors out to N processes here, or to the workers of a Dask scheduler; the same "
        "bits (pip install 'glpath[cluster]').",
    }
    app.command(epilog=epilog, **help)(with_options(daylight, OF_DAYLIGHT, texts=texts))


def daylight(
    context: typer.Context,
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE", help=f"{HELP} Or .npz of coefficients, for a year.", autocompletion=completion.scenes
        ),
    ],
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="Write .npz, the coefficients (`DaylightCoefficients`); with --weather also .nc, the year for "
            "xarray, and .csv, its sums of each sensor; .vtp, sums on sensors for ParaView, and .glb, texels in "
            "false colours (glpath[figures]). May be repeated.",
        ),
    ],
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Sensors of a CSV file: columns x, y, z and nx, ny, nz; - for stdin.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    normal: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Where all face, of a file without normals.", rich_help_panel=_POINTS),
    ] = None,
    receiver: Annotated[
        str,
        typer.Option(
            metavar="|".join(_RECEIVERS),
            help="plane: across the normal, lit on its side. cylinder: the mean around it. sphere: the mean of all "
            "directions. texels: the fronts of all surfaces, in small faces, instead of --points.",
            autocompletion=words(_RECEIVERS),
            rich_help_panel=_POINTS,
        ),
    ] = "plane",
    texel_size: Annotated[
        float | None, typer.Option(metavar="UNITS", help="Of texels, at most.", rich_help_panel=_POINTS)
    ] = None,
    texel_shape: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A shape that texels are of, * for any letters; all. May be repeated.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    show: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What colours a .glb, one of the sums of the year.",
            show_default="irradiation_year; without --weather sky_view_factor",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    subdivision: Annotated[
        int,
        typer.Option(metavar="1|2|4", help="145, 577 or 2,305 patches, and the ground.", rich_help_panel=_SKY),
    ] = 1,
    samples: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Directions into each patch: 1, its centre, or an even number; errors are estimated from 4 on. As "
            "many as 100 million rays allow, 4 to 64.",
            show_default=False,
            rich_help_panel=_SKY,
        ),
    ] = None,
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
        int | None,
        typer.Option(
            metavar="N",
            help="Of the surfaces, about; 2000, or more if their bias is too large.",
            rich_help_panel=_BOUNCES,
        ),
    ] = None,
    gather_rays: Annotated[
        int, typer.Option(metavar="N", help="Of each sensor, for reflected light.", rich_help_panel=_BOUNCES)
    ] = 1024,
    north: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z", help="Default: the sky's, else y where z is up, -z where y is.", rich_help_panel=_SKY
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the directions.", rich_help_panel=_SKY)] = 0,
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="K/N",
            help="The K-th of N parts of the sensors alone, which `glpath merge` puts together with the others.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    geometry_budget: Annotated[
        int,
        typer.Option(
            metavar="MIB",
            help='Of memory for the triangles of shapes of type "stream", whose light is direct.',
            rich_help_panel=_BOUNCES,
        ),
    ] = 256,
    weather: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Weather of the site, .epw or TMY3's .csv, which says the latitude.",
            rich_help_panel=_YEAR,
        ),
    ] = None,
    blinds: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SCENE",
            help="The scene with blinds closed, or its .npz: they close in hours in which the sun is on more than "
            "2 % of the sensors (LM-83). Repeated: each with the blinds of one group of windows closed.",
            rich_help_panel=_YEAR,
        ),
    ] = None,
    occupied: Annotated[
        str, typer.Option(metavar="FROM-TO", help="Hours that count, local standard time.", rich_help_panel=_YEAR)
    ] = "8-18",
    threshold: Annotated[
        float, typer.Option(metavar="LUX", help="Of daylight autonomy.", rich_help_panel=_YEAR)
    ] = 300.0,
    ground: Annotated[
        float, typer.Option(metavar="ALBEDO", help="Of the ground around the scene.", rich_help_panel=_YEAR)
    ] = 0.2,
    hours: Annotated[
        bool, typer.Option("--hours/--no-hours", help="In .nc each hour of each sensor.", rich_help_panel=_YEAR)
    ] = True,
    parameters: Parameters = None,
    *,
    run: RunRequest,
) -> None:
    """Daylight coefficients: the irradiance of each sensor for unit radiance of each patch of the sky and of the
    ground, and for unit irradiance by the sun in each of its positions. Reflected light is included, by a radiosity
    solution that takes all surfaces as diffuse. With --weather, also the light of all hours of a year, daylight
    autonomy, useful daylight, sDA and ASE, irradiation and sun hours.

    Patches are Tregenza's, or Reinhart's subdivisions, in the order of Radiance's reinsrc (MF:1, 2, 4). Sensors may
    lie on surfaces or be free. The scene needs neither camera nor light.
    """
    check_choice("--receiver", receiver, _RECEIVERS)
    from_file = scene.lower().endswith(".npz")
    if from_file and all(each.lower().endswith(".npz") for each in blinds or ()):
        _check_computed(context, scene)
    texels = texel_request(receiver, texel_size, texel_shape, points, normal)
    shown = [path for path in out if path.suffix.lower() in SHOWN]
    check_shown(shown, texels is not None or from_file, show, weather is not None)
    others = [path for path in out if path not in shown]
    for option in typed_parameters(context) if weather is None else ():
        if getattr(option, "rich_help_panel", None) == _YEAR:
            raise UsageError(
                f"{'/'.join([*option.opts, *option.secondary_opts])}: is of a year.", "Give --weather."
            )
    year = year_request(weather, occupied, threshold, ground, hours, others, latitude)
    check_outputs(out, [scene, points, weather, *(blinds or ())])
    saved = next((path for path in out if path.suffix.lower() == ".npz"), out[0])
    options = {
        "subdivision": subdivision,
        "samples": samples,
        "latitude": latitude if year is None else year.weather.latitude,
        "suns": suns,
        "receiver": "plane" if texels else cast("Receiver", receiver),
        "max_depth": max_depth,
        "elements": elements,
        "gather_rays": gather_rays,
        "north": vector("--north", north),
        "seed": seed,
        "shard": shard_of(shard),
        "geometry_budget": geometry_budget,
    }
    if shard is not None and run.cluster is not None:
        raise UsageError("--cluster: makes shards itself; --shard is one of them alone.", "Give one of the two.")
    if shard is not None and year is not None:
        raise UsageError("--shard: a part of the sensors has no sDA.", "Merge the shards, then give --weather.")

    of_texels: Texels | None = None
    checkpoints: list[DaylightCheckpoint] = []
    rescue: dict[str, Save] = {}

    def computed(loaded: Scene, at: Points, beside: Path) -> DaylightCoefficients:
        from glpath.apps.daylight.checkpoint import DaylightCheckpoint
        from glpath.apps.daylight.kept_words import kept_beside

        if run.resume:
            checkpoints.append(held.enter_context(DaylightCheckpoint(kept_beside(beside))))
        try:
            return _computed(loaded, at, options, checkpoints[-1] if checkpoints else None, run)
        except KeyboardInterrupt as stop:
            failed = next((each for each in reversed(checkpoints) if each.failure is not None), None)
            parts = " and ".join(str(each.path) for each in checkpoints if os.path.exists(each.path))
            if parts:
                kept = f"what {'is done' if failed is None else 'could be written'} is in {parts}"
            elif failed is not None:
                kept = "no checkpoint could be written"
            elif run.resume:
                kept = "nothing was done yet"
            else:
                kept = f"nothing is kept{' of the closed blinds' * bool(rescue)}; --resume keeps what is done"
            say(f"glpath: interrupted: {kept}", err=True)
            if run.resume:
                say(f"  to resume: {typed_command(context)}", err=True)
            if failed is not None:
                assert failed.failure is not None, "checked above"
                raise ImageError(failed.failure, failed.rescue) from stop
            raise typer.Exit(exit_code()) from stop

    def source_of(which: str) -> DaylightCoefficients | tuple[Scene, Points]:
        """Return the coefficients of a file, or a scene with its sensors, so that errors come before long work."""
        nonlocal of_texels
        if which.lower().endswith(".npz"):
            from glpath.apps.daylight.coefficients import DaylightCoefficients

            found = DaylightCoefficients.load(which)
            if found.shard is not None:
                raise UsageError(f"{which}: is a shard, a part of the sensors.", "Merge all: `glpath merge`.")
            of_texels = found.texels if of_texels is None else of_texels
            return found
        if points is None and texels is None:
            raise UsageError(
                "daylight: where? No --points.", f"A CSV file of sensors; or the surfaces, --receiver {TEXELS}."
            )
        from glpath.apps.measure.points import Points, check_within
        from glpath.apps.measure.tables import read_points

        with aside("camera", "light"):
            loaded = read_scene(which, parameters)
        check_outputs(out)  # again, because a scene names further files
        if texels is not None:
            # A scene with closed blinds gets the texels of the scene without blinds, so that sensors are the same.
            of_texels = texels.of(loaded) if of_texels is None else of_texels
            return loaded, Points(of_texels.points, of_texels.normals)
        assert points is not None, "asked above"
        at = read_points(points, vector("--normal", normal))
        check_within(at, loaded, f"--points {points}")
        return loaded, at

    def checked(which: str) -> DaylightCoefficients | tuple[Scene, Points] | str:
        """Check a source before long work; return its name, if it can be read again, to free the scene's memory."""
        source = source_of(which)
        return source if is_stream(which) else which

    def coefficients_of(
        source: DaylightCoefficients | tuple[Scene, Points] | str, beside: Path
    ) -> DaylightCoefficients:
        if isinstance(source, str):
            with collected_warnings():  # `checked` has shown them
                source = source_of(source)
        if not isinstance(source, tuple):
            return source
        found = computed(*source, beside)
        if texels is not None:
            assert of_texels is not None, "the scene was read"
            first = 0 if found.shard is None else found.shard.first
            found = replace(found, texels=of_texels[first : first + len(found)])
        rescue[beside.with_suffix(".npz").name] = found.save
        return found

    if points is not None and str(points) == "-" and blinds is not None:
        raise UsageError("--points -: is read once, but --blinds needs the sensors again.", "Give a file.")
    source = source_of(scene)
    if from_file and year is None and not shown:
        raise UsageError(f"{scene}: has coefficients already.", "Give --weather, for a year.")
    closed = [checked(each) for each in blinds or ()]
    # Each checkpoint stays, and stays locked, until all outputs are saved, because a later step may fail.
    with ExitStack() as held:
        found = coefficients_of(source, saved)
        del source
        files: dict[Path, Save] = {path: found.save for path in out if path.suffix.lower() == ".npz"}
        targets = dict(files)
        try:
            lines = list(_summary(found))
            of_year = None
            if year is not None:
                names = [saved.with_suffix(f".blinds{number or ''}.npz") for number in range(len(closed))]
                groups = [coefficients_of(group, name) for group, name in zip(closed, names, strict=True)]
                of_year = year.of(found, groups)
                targets |= {path: year.save_as(of_year) for path in others if path not in targets}
                lines += year_summary(of_year)
            targets |= saves_shown(shown, found, of_year, show)
        except (Exception, KeyboardInterrupt) as failed:  # even a bug of ours must not lose the coefficients
            hold()
            # A cluster's checkpoint has complete shards, but that of one process lacks the reflected light.
            in_shards = run.resume and run.cluster is not None and not any(each.failure for each in checkpoints)
            written, _ = save_all({path: save for path, save in files.items() if save in rescue.values()})
            _keep(failed, {path: files[path] for path in written}, rescue, in_shards)
            raise
        hold()  # coefficients from a file were not computed by `_computed`, but their year or figure was
        written, failure = save_all(targets)  # coefficients first
        if failure is not None:
            _keep(failure, {path: targets[path] for path in written}, rescue)
            raise failure
        faults = [fault for each in checkpoints if (fault := remove_checkpoint(each))]
    if run.talks:
        for line in lines:
            say(line, err=True)
        for path in out:
            say(f"wrote {path}", err=True)
    if faults:
        raise done_but("; ".join(faults))


def _check_computed(context: typer.Context, coefficients: str) -> None:
    """Raise UsageError for options of the computation, because the file `coefficients` has its result."""
    unused = []
    for option in typed_parameters(context):
        computes = getattr(option, "rich_help_panel", None) in (_POINTS, _SKY, _BOUNCES) and option.name != "show"
        if computes or option.name == "parameters":
            unused.append(option.opts[0])
    if unused:
        raise UsageError(
            f"{', '.join(unused)}: not used, because {coefficients} has coefficients already.",
            "Leave the options out, or name the scene to compute its coefficients.",
        )


def _keep(
    failed: BaseException, saved: Mapping[Path, Save], computed: Mapping[str, Save], in_shards: bool = False
) -> None:
    """Save computed coefficients after a later step has failed, and add the names of their files to the error.

    saved    : functions that have written outputs, by path
    computed : functions that write all computed coefficients, by file name. Those that are in no written output go
               into a temporary folder
    in_shards : True if a checkpoint has them as shards for the next command, so that no temporary folder is needed
    """
    written = [path for path, save in saved.items() if save in computed.values()]
    notes = [_KEPT.format(", ".join(map(str, written)))] if written else []
    others = {name: save for name, save in computed.items() if save not in saved.values()}
    if others and not in_shards:
        notes.append(rescued(others, _KEPT))
    if isinstance(failed, GlpathError):
        failed.remedy = "\n".join(filter(None, [failed.remedy, *notes]))
    else:
        for note in notes:
            say(f"glpath: {note}", err=True)


def _computed(
    scene: Scene, at: Points, options: dict[str, Any], checkpoint: DaylightCheckpoint | None, run: RunRequest
) -> DaylightCoefficients:
    """Return the daylight coefficients. Once they exist, signals wait until all outputs are saved.

    Raises KeyboardInterrupt if a signal ends the computation.
    """

    def compute() -> DaylightCoefficients:
        from glpath.apps.daylight.compute import daylight_coefficients

        with workers_of(run.cluster) as workers, reporting(run.mode, sys.stderr, _event) as report:
            return daylight_coefficients(
                scene,
                at.points,
                at.normals,
                **options,
                resume=checkpoint,
                cluster=workers,
                on_progress=report,
                backend=run.backend,
                device=run.device,
                require_gpu=run.require_gpu,
            )

    release()  # let signals end the command again that have waited since an earlier computation
    return result_of(compute)


def _summary(found: DaylightCoefficients) -> Iterator[str]:
    import numpy as np

    yield (
        f"{len(found):,} sensors, {len(found.patches) - 1:,} patches of the sky and the ground, "
        f"{len(found.suns):,} positions of the sun, {len(found.directions):,} directions"
    )
    view, weights = found.sky_view, found.sensor_weights
    mean = np.average(view, weights=weights)
    yield f"  sky view factor: mean {mean:.4f}, minimum {view.min():.4f}, maximum {view.max():.4f}"
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
        share = 1.0 - weights @ direct / max(float(weights @ found.sky_sums), 1e-30)
        yield f"  {100 * share:.0f} % of the light under a uniform sky is reflected"
        if found.indirect.bias is not None:
            yield f"  bias of the reflected light: {found.indirect.bias}"
    if found.dark:
        yield f"  {found.dark:,} sensors see nothing at all: inside of solids, or below the ground"


def _event(progress: DaylightProgress) -> ProgressEvent:
    rays = progress.done * progress.sensors
    speed = f", {rays / progress.elapsed_s / 1e6:,.3g} million rays/s" if progress.elapsed_s > 0 and rays else ""
    of = f"{progress.done:,} of {progress.total:,}"
    texts = {"rays": f"{of} directions{speed}", "stream": f"{of} chunks of the stream", "shards": f"{of} shards"}
    text = texts.get(progress.stage, progress.stage)
    return ProgressEvent(
        stage=progress.stage,
        elapsed_s=progress.elapsed_s,
        done=progress.done,
        total=progress.total or None,
        detail=text,
        line=text,
        values={"done": progress.done, "total": progress.total, "sensors": progress.sensors},
    )
