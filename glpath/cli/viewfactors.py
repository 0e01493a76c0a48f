"""`glpath viewfactors`: matrix of view factors between the faces of a scene or a mesh."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glpath.cli.completion import words
from glpath.cli.help import command_help
from glpath.cli.options import with_options
from glpath.cli.run_request import OF_MATRICES, RunRequest
from glpath.cli.scene import Parameters, SceneArgument, read_scene
from glpath.cli.signals import exit_code, result_of
from glpath.cli.typed import typed_command
from glpath.cli.unattended import done_but, remove_checkpoint
from glpath.cli.values import check_choice
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.system.files import check_writable, is_stream, short_name
from glpath.system.outputs import check_outputs, rescued, save_all
from glpath.system.reporting import ProgressEvent, duration, reporting
from glpath.system.signals import TERMINATING_TEXT
from glpath.system.terminal import say

if TYPE_CHECKING:
    from glpath.apps.view_factors.compute import ViewFactorCheckpoint, ViewFactorProgress
    from glpath.apps.view_factors.result import ViewFactors
    from glpath.scene import Scene

_GROUPS = ("faces", "planar", "shapes")
_PROPERTIES = ("reciprocity", "closure")


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath viewfactors street.stl -o F.npz", "from every face to every other, and to the sky"),
        ("glpath viewfactors room.obj -o F.csv --groups shapes", "between the shapes"),
        ("glpath viewfactors city.stl -o F.npz --error 1e-2 --resume", "coarse; resumes where it stopped"),
    )
    epilog = (
        "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done, but the checkpoint was not removed, 75 ended by a "
        f"signal ({TERMINATING_TEXT}) with --resume (start it again), 130 interrupted (continue with --resume)."
    )
    texts = {
        "resume": "Keep rows that are done in FILE.part (of the first), and resume from them after an interruption."
    }
    app.command(epilog=epilog, **help)(with_options(viewfactors, OF_MATRICES, texts=texts))


def viewfactors(
    context: typer.Context,
    scene: SceneArgument,
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="Where the matrix goes: .npz (scipy), .csv, .idf (EnergyPlus, --groups shapes), or uDALES's "
            "vfsparse.inp.001, vf.nc.inp.001, svf.inp.001 and facetarea.inp.001; may be repeated.",
        ),
    ],
    groups: Annotated[
        str,
        typer.Option(
            metavar="|".join(_GROUPS),
            help="A row for each face, for each plane's faces that share edges, or for each shape.",
            autocompletion=words(_GROUPS),
        ),
    ] = "faces",
    enforce: Annotated[
        str | None,
        typer.Option(
            metavar="LIST", help="reciprocity, closure, or both with a comma: made exact by least squares."
        ),
    ] = None,
    error: Annotated[
        float,
        typer.Option(metavar="E", help="Wanted of a row's sum, 1e-7 to 0.1; of a single factor F, E sqrt(F)."),
    ] = 1e-3,
    flip: Annotated[
        bool, typer.Option("--flip", help="The fronts are the other sides: the inside of a model.")
    ] = False,
    parameters: Parameters = None,
    *,
    run: RunRequest,
) -> None:
    """The matrix of view factors between the fronts of faces, with everything that hides them from each other.

    Row i, column j is the fraction of the energy from face i that arrives at face j. If the sum of a row is below
    1, the rest goes past all faces to the sky, or arrives at backs of faces, which is reported. Two faces that
    nothing occludes from each other have closed forms; others have exact visibility from sample points.
    """
    from glpath.apps.view_factors.faces import geometry_alone
    from glpath.apps.view_factors.formats import check_names, file_kind
    from glpath.io.meshes import FORMATS

    for path in out:
        if file_kind(path) == "idf" and groups == "faces":
            check_names((), path.stem, path)
    check_choice("--groups", groups, _GROUPS)
    wanted = [] if enforce is None else enforce.split(",")
    for word in wanted:
        check_choice("--enforce", word, _PROPERTIES)
    if not 1e-7 <= error <= 0.1:
        raise UsageError(f"--error {error:g}: must be from 1e-7 to 0.1.")
    if run.resume and is_stream(out[0]):
        raise UsageError(f"--resume: {out[0]} is no file that a second one could stand beside.", "Name a file.")
    file = Path(scene)
    faces: Path | Scene = file
    # Row i must be face i, but a scene drops triangles without area. So mesh files are not read as scenes.
    if parameters or groups == "shapes" or file.suffix.lower() not in FORMATS:
        with geometry_alone():
            faces = read_scene(scene, parameters)
    check_outputs(out, [scene])
    checkpoint = _checkpoint(out[0]) if run.resume else None

    def compute() -> ViewFactors:
        from glpath.apps.view_factors.compute import view_factors

        with reporting(run.mode, sys.stderr, _event) as report:
            return view_factors(faces, groups=groups, error=error, flip=flip, resume=checkpoint, on_progress=report)

    # The checkpoint stays, and stays locked, until all outputs are saved, because a later step may fail.
    with checkpoint or nullcontext():
        try:
            found = result_of(compute)
        except KeyboardInterrupt as stop:
            if checkpoint is not None and checkpoint.failure is not None:
                raise ImageError(checkpoint.failure, checkpoint.rescue) from stop
            say(f"glpath: interrupted: {_kept(checkpoint)}", err=True)
            if checkpoint is not None:
                say(f"  to resume: {typed_command(context)}", err=True)
            raise typer.Exit(exit_code()) from stop
        rescue, kept = {"viewfactors.npz": found.save}, "The matrix is kept in {}."
        if wanted:
            try:
                found = found.enforced(reciprocity="reciprocity" in wanted, closure="closure" in wanted)
            except Exception as failed:  # any error, even a bug of ours, must not lose the matrix
                where = rescued(rescue, kept)
                if isinstance(failed, GlpathError):
                    failed.remedy = f"{failed.remedy}\n{where}"
                else:
                    say(f"glpath: {where}", err=True)
                raise
        _, failure = save_all(dict.fromkeys(out, found.save), rescue, kept)
        if failure is not None:
            raise failure
        fault = remove_checkpoint(checkpoint) if checkpoint is not None else ""
    if run.talks:
        for line in _summary(found):
            say(line, err=True)
        for path in out:
            say(f"wrote {path}", err=True)
    if fault:
        raise done_but(fault)


def _checkpoint(out: Path) -> ViewFactorCheckpoint:
    """Return the checkpoint of --resume, which is beside the first output."""
    from glpath.apps.view_factors.compute import ViewFactorCheckpoint

    path = out.with_name(short_name("", out.name, ".part"))
    check_writable(path)
    return ViewFactorCheckpoint(path)


def _kept(checkpoint: ViewFactorCheckpoint | None) -> str:
    if checkpoint is None:
        return "nothing is kept; --resume keeps the rows that are done"
    return f"the rows that are done are in {checkpoint.path}" if checkpoint.found() else "no row was done yet"


def _summary(found: ViewFactors) -> Iterator[str]:
    s = found.statistics
    rows = "groups" if found.names else "faces"
    yield f"{len(found):,} {rows}, {found.matrix.nnz:,} factors, {duration(s['elapsed_s'])}"
    yield (
        f"  pairs of facets: {s['free_pairs']:,} seen whole, {s['partial_pairs']:,} in part; "
        f"{s['hidden_pairs'] + s['hidden_branches']:,} pairs and branches hidden by one occluder"
    )
    import numpy as np

    sums = found.row_sums
    yield f"  row sums {sums.min():.6f} to {sums.max():.6f}, sky {found.sky.min():.6f} to {found.sky.max():.6f}"
    if s["rows_that_see_backs"]:
        yield (
            f"  backs of faces: seen by {s['rows_that_see_backs']:,} {rows}, {100 * s['backs_max']:.3g} % of a "
            f"row at most, {100 * s['backs']:.3g} % of all; neither in the matrix nor in the sky"
        )
    yield f"  error of a row's sum: {np.median(found.error):.1e} in the median, {found.error.max():.1e} at most"
    if missed := s["rows_beyond_error"]:
        share = 100 * missed / len(found)
        yield f"  {missed:,} of {len(found):,} rows ({share:.2g} %) miss the error of {s['error']:g} that is wanted"
    if "reciprocity" not in s.get("enforced", ()):
        yield "  reciprocity: exact but for rounding, as each pair is computed once"
    if "enforced" in s:
        before, after = s["before"], s["after"]
        for name in s["enforced"]:
            yield f"  {name}: off by {before[name]:.1e} at most, {after[name]:.1e} now"
    if s["crowded_pairs"]:
        yield f"  {s['crowded_pairs']:,} pairs had more occluders than are looked at: their factors are too large"


def _event(progress: ViewFactorProgress) -> ProgressEvent:
    memory = f", {progress.bytes / 1e6:,.0f} MB in the end" if progress.bytes else ""
    rows = f"{progress.done:,} of {progress.total:,} rows, {progress.factors:,} factors{memory}"
    return ProgressEvent(
        stage=progress.stage,
        elapsed_s=progress.elapsed_s,
        done=progress.done,
        total=progress.total or None,
        detail=rows if progress.total else "",
        line=rows if progress.total else "",
        values={
            "done": progress.done,
            "total": progress.total,
            "factors": progress.factors,
            "bytes": progress.bytes,
        },
    )
