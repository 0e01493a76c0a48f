"""`glpath radiosity`: a radiosity solution, or glTF with its light as vertex colours."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from glpath.cli.completion import words
from glpath.cli.help import command_help
from glpath.cli.options import with_options
from glpath.cli.run_request import OF_SOLVERS, RunRequest
from glpath.cli.scene import Parameters, SceneArgument, read_scene
from glpath.cli.scene_options import OF_LIGHT, with_scene_options
from glpath.cli.signals import (
    RESUME_LATER,
    arrived,
    by_scheduler,
    exit_code,
    forget,
    interrupted,
    release,
    result_of,
)
from glpath.cli.typed import typed_parameters
from glpath.cli.unattended import SOLVING, check_absent, done_but, left_in, remove_checkpoint, watched
from glpath.errors import GlpathError, ImageError, TimeLimitError, UsageError, warn
from glpath.film.choices import TIME_LIMIT
from glpath.io.completed import aside
from glpath.scene.summary import light_of
from glpath.system.files import check_writable
from glpath.system.outputs import check_outputs, check_separate, save_all
from glpath.system.reporting import ProgressEvent, duration, percent, reporting
from glpath.system.signals import TERMINATING_TEXT
from glpath.system.terminal import say
from glpath.system.time_limit import count_earlier, without_limit

if TYPE_CHECKING:
    from glpath.radiosity import RadiosityProgress, RadiositySolution
    from glpath.radiosity.form_factors.form_factor import Kind
    from glpath.radiosity.shafts.options import ShaftOptions
    from glpath.radiosity.solvers.checkpoint import SolverCheckpoint
    from glpath.radiosity.solvers.checks import Method
    from glpath.scene import Scene

_MESH, _SOLVER = "Mesh", "Solver"
_RESCUE = "The solution is kept in {}; --radiosity of render and radiosity takes it."

Patches = Annotated[
    int | None,
    typer.Option(help="About so many patches, which shoot; by default 1000.", rich_help_panel=_MESH),
]
Size = Annotated[
    float | None,
    typer.Option(help="Instead: the longest edge of a patch, scene units.", rich_help_panel=_MESH),
]
MethodOption = Annotated[
    str,
    typer.Option(
        metavar="progressive|matrix|monte-carlo",
        help="See above.",
        rich_help_panel=_SOLVER,
        autocompletion=words(("progressive", "matrix", "monte-carlo")),
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    codes = "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done but the checkpoint could not be removed, "
    codes += "130 interrupted (what there is, is written)."
    later = (
        f" 75: ended by a signal ({TERMINATING_TEXT}) with its checkpoint written; start it again with --resume."
    )
    later += " 134: ended by --hang-limit."
    help = command_help(
        ("glpath radiosity room -o room.npz", "a solution, for render --radiosity"),
        ("glpath radiosity room -o room.glb", "the scene with its light as vertex colours"),
        ("glpath radiosity office -o office.npz --method monte-carlo --patches 20000", "many elements"),
        everyday="scene out method patches size splits adaptive unshot particles seed radiosity exposure check "
        "checkpoint resume environment animation variant parameters quiet",
    )
    app.command(epilog=codes + later, **help)(with_options(with_scene_options(radiosity, OF_LIGHT), OF_SOLVERS))


def radiosity(
    context: typer.Context,
    scene: SceneArgument,
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            metavar="FILE.npz|.glb",
            help="Several allowed. The solution, for --radiosity; or the scene with its light as vertex colours, "
            "for any glTF viewer.",
        ),
    ],
    method: MethodOption = "progressive",
    patches: Patches = None,
    size: Size = None,
    splits: Annotated[
        int, typer.Option(help="Split patches in four so many times, for elements.", rich_help_panel=_MESH)
    ] = 0,
    adaptive: Annotated[
        int | None,
        typer.Option(
            help="So many times, split elements where the radiosity changes fast; by default 6 by monte-carlo, 2 "
            "where progressive writes a .glb, else 0.",
            rich_help_panel=_MESH,
        ),
    ] = None,
    threshold: Annotated[
        float,
        typer.Option(help="Fast: by this share of the scene's mean in an element.", rich_help_panel=_MESH),
    ] = 0.25,
    unshot: Annotated[
        float, typer.Option(help="End when this share of the energy is unshot.", rich_help_panel=_SOLVER)
    ] = 0.001,
    max_steps: Annotated[
        int, typer.Option(help="Or when so many patches shot.", rich_help_panel=_SOLVER)
    ] = 1_000_000,
    overshoot: Annotated[
        bool,
        typer.Option("--overshoot", help="Patches shoot some of what is to come, too.", rich_help_panel=_SOLVER),
    ] = False,
    ambient: Annotated[
        bool,
        typer.Option("--ambient", help="Add the unshot energy, spread evenly.", rich_help_panel=_SOLVER),
    ] = False,
    form_factors: Annotated[
        str,
        typer.Option(metavar="polygon|disc", help="Exact but for shadows; or Wallace's.", rich_help_panel=_SOLVER),
    ] = "polygon",
    emitter_samples: Annotated[
        int, typer.Option(metavar="1|4|9|16|25", help="The most of an emitter.", rich_help_panel=_SOLVER)
    ] = 25,
    receiver_points: Annotated[
        int, typer.Option(metavar="1|4|9|...", help="Per element.", rich_help_panel=_SOLVER)
    ] = 4,
    shaft: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="How shafts find occluders, which changes the time alone: strategy='ratio open', "
            "order='largest first', clump=8 and others (docs/explanation/shaft-culling.md has all, and when each "
            "pays); paper is Haines and Wallace's own. Several allowed. Not of monte-carlo.",
            rich_help_panel=_SOLVER,
        ),
    ] = None,
    particles: Annotated[int, typer.Option(help="Of monte-carlo.", rich_help_panel=_SOLVER)] = 1_000_000,
    seed: Annotated[int, typer.Option(help="Of monte-carlo.", rich_help_panel=_SOLVER)] = 0,
    radiosity: Annotated[
        Path | None,
        typer.Option(metavar="FILE.npz", help="A solution to write as .glb, instead of solving."),
    ] = None,
    exposure: Annotated[float, typer.Option(metavar="STOPS", help="Brightness of a .glb: 1 doubles it.")] = 0.0,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Afterwards, estimate what the elements do to the picture that the scene's camera gathers.",
        ),
    ] = False,
    parameters: Parameters = None,
    *,
    run: RunRequest,
) -> None:
    """Solve the light between a scene's diffuse surfaces; `glpath render --integrator gather` shows it.

    The method progressive shoots from the patch with the most unshot energy first. matrix computes all form factors
    at once, for small scenes. monte-carlo shoots particles, for many elements. Ctrl-C ends the solver, and the
    solution so far is written. SIGTERM, SIGHUP, SIGUSR1 and similar signals do the same; with --checkpoint or
    --resume, they write only the checkpoint.

    Colours of a .glb are radiance times 2^STOPS, linear, at most 1; its material is unlit (KHR_materials_unlit).
    """
    for path in out:
        _check_suffix(path)
    baked = any(_is_glb(path) for path in out)
    if not abs(exposure) <= 100:
        raise UsageError(f"--exposure {exposure}: must be a number of stops from -100 to 100.")
    if exposure and not baked:
        raise UsageError(f"--exposure {exposure}: a .npz holds the light itself.", "Write a .glb, or leave it out.")
    if radiosity is not None:
        _check_solved(context, radiosity)
    with nullcontext() if check else aside("camera"):
        loaded = read_scene(scene, parameters)
    check_outputs(out, [scene, radiosity])
    checkpoint = _checkpoint(out, run)
    if adaptive is None and baked and method == "progressive":
        adaptive = 2
    options: dict[str, Any] = {
        "method": cast("Method", method), "patches": patches, "size": size, "splits": splits,
        "adaptive": adaptive, "threshold": threshold, "unshot": unshot, "max_steps": max_steps,
        "overshoot": overshoot, "ambient": ambient, "form_factors": cast("Kind", form_factors),
        "emitter_samples": emitter_samples, "receiver_points": receiver_points, "particles": particles,
        "seed": seed, "time_limit": run.seconds, "checkpoint": checkpoint, "shafts": _shafts(shaft),
    }  # fmt: skip
    with checkpoint or nullcontext():
        if checkpoint is not None and not run.resume:
            check_absent(checkpoint.path)
        with watched(run.silence, left_in(checkpoint.path if checkpoint is not None else None), SOLVING):
            solution: RadiositySolution | None
            if radiosity is not None:
                solution, complete = result_of(lambda: _loaded(radiosity, loaded)), True
            else:
                solution, complete = _solve(loaded, options, run.mode)
                if checkpoint is not None:
                    count_earlier(checkpoint.elapsed_s)
        if checkpoint is not None and by_scheduler() and not complete:
            if checkpoint.failure is not None:
                raise ImageError(checkpoint.failure, checkpoint.rescue)
            say(f"glpath: ended by a signal: --resume continues from {checkpoint.path}", err=True)
            raise typer.Exit(RESUME_LATER)
        if solution is not None:
            with without_limit():
                _save(solution, loaded, out, exposure)
        if checkpoint is not None and by_scheduler() and not check:
            forget()  # nothing is left to resume
        _end(solution, out, loaded, not run.talks, solved=radiosity is None)
        if check and solution is not None:
            from glpath.rendering import element_error

            release()  # signals may end the check, because the solution is saved
            try:
                with watched(run.silence, f"The solution is in {', '.join(map(str, out))}."):
                    found = result_of(lambda: element_error(loaded, solution))
            except TimeLimitError:
                warn("--check: left out, because --time-limit is over.", late=True)
            except GlpathError:  # such as a black picture; the solution is complete and saved
                if checkpoint is not None:
                    remove_checkpoint(checkpoint)
                raise
            else:
                say(json.dumps(found.recorded()) if run.progress == "json" else str(found), err=True)
        if checkpoint is not None and (fault := remove_checkpoint(checkpoint)):
            raise done_but(fault)


def _checkpoint(out: Sequence[Path], run: RunRequest) -> SolverCheckpoint | None:
    """Return the checkpoint of --checkpoint or --resume; None without these options.

    Raises GlpathError if the checkpoint cannot be written, or has the path of an output.
    """
    from glpath.jobs.checkpoint import checkpoint_path
    from glpath.radiosity.solvers.checkpoint import SolverCheckpoint

    if not run.keeps:
        return None
    path = checkpoint_path(out, films=False)
    check_writable(path)
    check_separate("--checkpoint", path, out)
    return SolverCheckpoint(path, *run.interval)


def _solve(scene: Scene, options: dict[str, Any], mode: str) -> tuple[RadiositySolution | None, bool]:
    """Return the solution, and True if it is complete.

    After an interruption the solution is partial, or None if nothing was solved.
    """
    from glpath.radiosity import RadiosityInterrupted, solve_radiosity

    try:
        with reporting(mode, sys.stderr, _event) as report:
            return result_of(lambda: solve_radiosity(scene, **options, on_progress=report)), True
    except RadiosityInterrupted as stop:
        interrupted()
        return stop.solution, False


def _shafts(words: list[str] | None) -> ShaftOptions | None:
    if not words:
        return None
    from glpath.radiosity.shafts.options import ShaftOptions

    return ShaftOptions.of_words(words)


def _is_glb(path: Path) -> bool:
    return path.suffix.lower() == ".glb"


def _check_suffix(path: Path) -> None:
    """Raise UsageError unless the output is .npz or .glb."""
    if not _is_glb(path) and path.suffix.lower() != ".npz":
        raise UsageError(
            f"{path}: a radiosity solution is written as .npz, or as .glb with vertex colours.",
            "For example -o solution.npz -o lit.glb.",
        )


def _check_solved(context: typer.Context, solution: Path) -> None:
    """Raise UsageError for options of the solver, because --radiosity names a solution that is already solved."""
    for option in typed_parameters(context):
        says_how = getattr(option, "rich_help_panel", None) in (_MESH, _SOLVER)
        if says_how or option.name in ("checkpoint", "resume", "time_limit"):
            raise UsageError(
                f"--radiosity and {option.opts[0]} contradict each other: {solution} is solved already.",
                "Leave one of them out.",
            )


def _loaded(path: Path, scene: Scene) -> RadiositySolution:
    from glpath.radiosity import RadiositySolution

    return RadiositySolution.load(path, scene)


def _save(solution: RadiositySolution, scene: Scene, out: list[Path], exposure: float) -> None:
    def save_to(path: Path) -> None:
        if _is_glb(path):
            solution.to_glb(scene, path, exposure=exposure)
        else:
            solution.save(path)

    _, failure = save_all(dict.fromkeys(out, save_to), {"solution.npz": solution.save}, _RESCUE)
    if failure is not None:
        raise failure


def _end(solution: RadiositySolution | None, out: list[Path], scene: Scene, quiet: bool, *, solved: bool) -> None:
    """Print what was solved and written. If a signal interrupted the command, exit with the code of that signal."""
    names = ", ".join(map(str, out))
    if solution is not None and not quiet:
        for line in (*_summary(solution), f"  {light_of(scene)}") if solved else ():
            say(line, err=True)
        say(f"wrote {names}", err=True)
    if arrived():
        left = (
            "nothing was solved yet; nothing is written" if solution is None else f"what was solved is in {names}"
        )
        say(f"glpath: interrupted: {left}", err=True)
        raise typer.Exit(exit_code())


def _summary(solution: RadiositySolution) -> Iterator[str]:
    s = solution.statistics
    ended = ", ended by the time limit" if s["stop_rule"] == TIME_LIMIT else ""
    yield (
        f"{s['elements']:,} elements in {s['patches']:,} patches, {solution.method}, "
        f"{duration(s['elapsed_s'])}{ended}"
    )
    if "steps" in s:
        yield f"  {s['steps']:,} steps, {percent(s['unshot'])} of the energy unshot"
    if "rays" in s:
        empty = s["empty_shafts"] / max(s["shafts"], 1)
        yield f"  {s['rays']:,} rays through {s['shafts']:,} shafts, {percent(empty)} of which were empty"
    if "particles" in s:
        error = "" if s["error_of_mean"] is None else f", error of the mean {percent(s['error_of_mean'])}"
        yield f"  {s['particles']:,} particles, {s['hits']:,} hits{error}"


def _event(progress: RadiosityProgress) -> ProgressEvent:
    what = "particles" if progress.stage == "particles" else "steps"
    unshot = progress.unshot
    share = "" if unshot is None or what == "particles" else f", {percent(unshot)} unshot"
    detail = f"{progress.steps:,} {what}{share}, {progress.elements:,} elements"
    return ProgressEvent(
        stage=progress.stage,
        elapsed_s=progress.elapsed_s,
        done=0 if unshot is None else 1 - unshot,
        total=None if unshot is None else 1 - progress.until,
        detail=detail,
        line=f"{progress.stage}: {detail}",
        values={"steps": progress.steps, "unshot": unshot, "until": progress.until, "elements": progress.elements},
    )
