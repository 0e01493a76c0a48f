"""`python -m benchmarks bench`: measure glpath, and compare it with other programs if they are installed."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmarks.verdict import Report
from glpath.cli import completion
from glpath.cli.completion import words
from glpath.cli.scene import HELP, read_scene, seen
from glpath.cli.signals import result_of
from glpath.cli.values import resolution as read_resolution
from glpath.errors import GlpathError, UsageError
from glpath.system.files import check_writable, write_bytes
from glpath.system.outputs import save_all
from glpath.system.terminal import clean_console, say

if TYPE_CHECKING:
    from rich.console import Console

    from glpath.scene import Scene

# Text of each bench for the help, and the options that it takes besides --json.
BENCHES: dict[str, tuple[str, tuple[str, ...]]] = {
    "path-buffer": (
        "path tracing: milliseconds by stage, and Mitsuba 3 at equal error",
        ("--scene", "--resolution", "--seeds", "--reference"),
    ),
    "path-sets": (
        "a path set of each engine: milliseconds, and those of all threads",
        ("--rounds", "--scale"),
    ),
    "gather": (
        "light of all bounces from radiosity: time to an error, beside path tracing and Mitsuba 3",
        ("--scene", "--resolution", "--seeds", "--reference", "--scale"),
    ),
    "denoise": (
        "time to an error with Open Image Denoise: the gather and path tracing, beside Mitsuba 3 with the same",
        ("--scene", "--resolution", "--seeds", "--reference", "--target"),
    ),
    "textures": (
        "a path set of 100,000 triangles with textures and smooth normals, beside the same plain",
        ("--rounds", "--scale"),
    ),
    "materials": (
        "a room with textures, glass and metal: time to an error, beside Mitsuba 3 with its own materials",
        ("--seeds", "--scale"),
    ),
    "luminaires": (
        "an office under 200 luminaires with profiles: time to an error, beside Mitsuba 3",
        ("--seeds", "--scale"),
    ),
    "defaults": (
        "pictures without options: seconds of the whole process and the error, beside Cycles with its own",
        ("--rounds", "--scale"),
    ),
    "t-buffer": (
        "what the eye sees of 1e3 to 1e6 objects, beside Embree, and frames with kept shadow-buffers",
        ("--rounds", "--scale"),
    ),
    "shaft": (
        "visibility for radiosity: shafts beside a ray caster and Embree, and the cost of growth",
        ("--rounds", "--scale"),
    ),
    "shaft-options": (
        "shafts: what each enhancement of the paper, and of its future work, is worth",
        ("--rounds", "--scale"),
    ),
    "viewfactors": (
        "view factors: closed forms, closed rooms beside pyviewfactor, and a city of 22,800 facets",
        ("--rounds", "--scale"),
    ),
    "measure": (
        "irradiance at points: a closed form, and the office beside Radiance's rtrace at equal error",
        ("--scale",),
    ),
    "parallel-rays": (
        "what points see along shared directions: seconds of a ray and of a scan, by points and triangles",
        ("--scale",),
    ),
    "daylight": (
        "a year of daylight in an office, beside Radiance, and the sky and suns of a city's million sensors",
        ("--rounds", "--scale"),
    ),
    "cie171": (
        "irradiance at points beside exact values of CIE 171:2006, test cases 5.2 to 5.14",
        ("--scale",),
    ),
    "height-field": (
        "sky view factors and sun hours: a million points of 20 million triangles, beside Embree's rays",
        ("--scale",),
    ),
    "streamed-field": (
        "the same field as a stream: what a million points see of 145 patches in 256 MiB, and the law of its time",
        ("--scale",),
    ),
    "lightmap": (
        "lightmaps of the room at 512 and 1024 texels: time to an error, beside Cycles' bake",
        ("--scale",),
    ),
    "leaky-rooms": (
        "bias of the defaults in rooms whose light passes narrow gaps, beside unbiased paths and Mitsuba 3",
        ("--parts", "--scale"),
    ),
    "jobs": (
        "one render by 1, 2 and 4 worker processes: speed-up, cost of merging",
        ("--rounds", "--scale"),
    ),
    "standard-scenes": (
        "scenes of a folder in Mitsuba's format, by glpath and by Mitsuba itself, at equal error",
        ("--folder", "--seeds", "--scale"),
    ),
    "image-tests": (
        "one project of image tests beside pytest-mpl: what each finds, and seconds of a run",
        ("--rounds",),
    ),
    "start-up": ("a small picture from the shell, the whole process, beside Mitsuba 3", ("--rounds",)),
    "footprint": (
        "packages of the core, and how long the commands' help and the pytest plugin load",
        ("--rounds",),
    ),
}


def bench(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help=", ".join(BENCHES), autocompletion=words(BENCHES))
    ] = None,
    list_all: Annotated[bool, typer.Option("--list", help="Name all benches.")] = False,
    scene: Annotated[
        str | None,
        typer.Option(
            "--scene",
            metavar="SCENE",
            help=f"path-buffer, gather, denoise: {HELP[0].lower()}{HELP[1:-1]}; diffuse, lit by shapes that emit; "
            "cornell-box-36.",
            autocompletion=completion.scenes,
        ),
    ] = None,
    resolution: Annotated[
        str | None, typer.Option(metavar="WxH", help="path-buffer, gather, denoise: instead of the scene's.")
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="path-buffer, gather, denoise, materials, luminaires, standard-scenes: independent renders to "
            "take errors over; 3.",
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="path-buffer, gather, denoise: a converged picture, to take errors against."
        ),
    ] = None,
    target: Annotated[
        float | None, typer.Option(metavar="E", help="denoise: the error to come to, a relMSE; 5e-4.")
    ] = None,
    rounds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="path-sets, defaults, t-buffer, textures, shafts, viewfactors, daylight, jobs, image-tests, "
            "start-up, footprint: turns of each program, of which the median counts; 7.",
        ),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="path-sets, gather, materials, luminaires, defaults, t-buffer, textures, shafts, viewfactors, "
            "measure, cie171, lightmap, leaky-rooms, jobs, parallel-rays, daylight, height-field, streamed-field, "
            "standard-scenes: below 1, less work; 1.",
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="standard-scenes: where the scenes are, such as Bitterli's collection."),
    ] = None,
    parts: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="leaky-rooms: of pictures, lookups, solution, lightmap, probes; all."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON; - for stdout.")
    ] = None,
) -> None:
    """Measure how fast an engine is.

    Times on shared machines drift, so compare ratios to other programs, which are measured in the same run. They
    need the reference extra (pip install -e '.[reference]'). A claim that does not hold is reported, and is no
    failure. Programs with different results are a failure (exit code 1).
    """
    if list_all:
        for key, (what, _) in BENCHES.items():
            say(f"{key:<14} {what}")
        return
    if name not in BENCHES:
        raise UsageError(
            f"bench: {'no name' if name is None else repr(name)}; allowed are {', '.join(BENCHES)}",
            "`python -m benchmarks bench --list` says what they measure.",
        )
    given = {
        "--scene": scene,
        "--resolution": resolution,
        "--seeds": seeds,
        "--reference": reference,
        "--target": target,
        "--rounds": rounds,
        "--scale": scale,
        "--folder": folder,
        "--parts": parts,
    }
    allowed = BENCHES[name][1]
    for option, value in given.items():
        if value is not None and option not in allowed:
            raise UsageError(f"{option} does not apply to bench {name}; allowed are {', '.join(allowed)}, --json")
    for option, number in (("--seeds", seeds), ("--rounds", rounds)):
        if number is not None and number < 1:
            raise UsageError(f"{option} {number}: must be at least 1")
    if scale is not None and not (math.isfinite(scale) and 0 < scale <= 1):
        raise UsageError(f"--scale {scale:g}: must be above 0 and at most 1")
    if "--folder" in allowed and folder is None:
        raise UsageError(f"bench {name}: needs a folder of scenes", "Give it one: --folder DIR.")
    if target is not None and not (math.isfinite(target) and target > 0):
        raise UsageError(f"--target {target:g}: must be above 0")
    if output is not None:
        check_writable(output)
    measured = None
    if scene is not None or resolution is not None:
        size = None if resolution is None else read_resolution(resolution)
        measured = seen(read_scene(scene or "cornell-box-36", []), size, {})
    if name == "leaky-rooms":
        report = result_of(lambda: _leaky_rooms(parts, scale or 1.0))
    else:
        report = result_of(
            lambda: _measure(name, measured, seeds or 3, reference, rounds or 7, scale or 1.0, target, folder)
        )
    _show(report, output)
    if report.faults:
        raise GlpathError(
            f"bench {name}: the programs disagree, so that their times compare nothing:\n"
            + "\n".join(report.faults),
            "One of them is wrong, unless a small --scale left them too few samples or pixels to tell.",
        )


def _leaky_rooms(parts: str | None, scale: float) -> Report:
    from benchmarks.benches.leaky_rooms import PARTS, bench_leaky_rooms

    chosen = PARTS if parts is None else tuple(part.strip() for part in parts.split(","))
    return bench_leaky_rooms(chosen, scale, partial(say, err=True))


def _measure(
    name: str,
    scene: Scene | None,
    seeds: int,
    reference: Path | None,
    rounds: int,
    scale: float,
    target: float | None,
    folder: Path | None,
) -> Report:
    def progress(text: str) -> None:
        say(text, err=True)

    if name == "gather":
        from benchmarks.benches.gather import bench_gather

        return bench_gather(seeds, reference, scale, scene, progress)
    if name == "denoise":
        from benchmarks.benches.denoise import TARGET, bench_denoise

        return bench_denoise(seeds, reference, scene, progress, target=target or TARGET)
    if name == "path-sets":
        from benchmarks.benches.path_sets import bench_path_sets

        return bench_path_sets(scale, rounds, progress)
    if name == "luminaires":
        from benchmarks.benches.luminaires import bench_luminaires

        return bench_luminaires(seeds, scale, progress)
    if name == "materials":
        from benchmarks.benches.materials import bench_materials

        return bench_materials(seeds, scale, progress)
    if name == "defaults":
        from benchmarks.benches.defaults import bench_defaults

        return bench_defaults(rounds, scale, progress)
    if name == "t-buffer":
        from benchmarks.benches.t_buffer import bench_t_buffer

        return bench_t_buffer(scale, rounds, progress)
    if name == "textures":
        from benchmarks.benches.textures import bench_textures

        return bench_textures(scale, rounds, progress)
    if name == "shaft":
        from benchmarks.benches.shaft import bench_shaft

        return bench_shaft(scale, rounds, progress)
    if name == "shaft-options":
        from benchmarks.benches.shaft import bench_shaft_options

        return bench_shaft_options(scale, rounds, progress)
    if name == "viewfactors":
        from benchmarks.benches.view_factors import bench_view_factors

        return bench_view_factors(scale, rounds, progress)
    if name == "measure":
        from benchmarks.benches.measure import bench_measure

        return bench_measure(scale, progress)
    if name == "parallel-rays":
        from benchmarks.benches.parallel_rays import bench_parallel_rays

        return bench_parallel_rays(scale, progress)
    if name == "daylight":
        from benchmarks.benches.daylight import bench_daylight

        return bench_daylight(rounds, scale, progress)
    if name == "cie171":
        from benchmarks.benches.cie171 import bench_cie171

        return bench_cie171(scale, progress)
    if name == "height-field":
        from benchmarks.benches.height_field import bench_height_field

        return bench_height_field(scale, progress)
    if name == "streamed-field":
        from benchmarks.benches.streamed_field import bench_streamed_field

        return bench_streamed_field(scale, progress)
    if name == "lightmap":
        from benchmarks.benches.lightmap import bench_lightmap

        return bench_lightmap(scale, progress)
    if name == "jobs":
        from benchmarks.benches.jobs import bench_jobs

        return bench_jobs(scale, rounds, progress)
    if name == "standard-scenes" and folder is not None:
        from benchmarks.benches.standard_scenes import bench_standard_scenes

        return bench_standard_scenes(folder, seeds, scale, progress)
    if name == "image-tests":
        from benchmarks.benches.image_tests import bench_image_tests

        return bench_image_tests(rounds, progress)
    if name == "start-up":
        from benchmarks.benches.start_up import bench_start_up

        return bench_start_up(rounds, progress)
    if name == "footprint":
        from benchmarks.benches.footprint import bench_footprint

        return bench_footprint(rounds, progress)
    from benchmarks.benches.path_buffer import bench_path_buffer

    return bench_path_buffer(seeds, reference, scene, progress)


def _show(report: Report, output: Path | None) -> None:
    """Print a report as tables, and write it as JSON if `output` is given."""

    failure = None
    if output is not None:
        save = partial(write_bytes, report.as_json().encode())
        _, failure = save_all({output: save}, {f"{report.name}.json": save}, "Kept in {}.")
    if str(output) == "-":
        if failure is not None:
            raise failure
        return
    console = clean_console(soft_wrap=True, highlight=False, markup=False)
    if not console.is_terminal:
        console.width = 200  # wide enough that no table is cut off
    _print(console, report.measured, report.rows)
    if report.holds is not None:
        console.print(report.verdict)
    for note in report.notes:
        console.print(note)
    console.print(", ".join(f"{k} {v}" for k, v in {**report.machine, **report.versions}.items()))
    if failure is not None:
        raise failure


def _print(console: Console, measured: dict[str, float], rows: list[dict[str, object]]) -> None:
    from rich.table import Table

    table = Table("measured", "", box=None)
    for key, value in measured.items():
        table.add_row(key, f"{value:.4g}")
    console.print(table)
    if rows:
        columns = list(dict.fromkeys(name for row in rows for name, of in row.items() if not isinstance(of, list)))
        table = Table(*columns, box=None)
        for row in rows:
            values = [row.get(name, "") for name in columns]
            table.add_row(*(f"{v:.3g}" if isinstance(v, float) else str(v) for v in values))
        console.print(table)


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("bench")(bench)
