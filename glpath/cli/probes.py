"""`glpath probes`: light probes in a grid, for programs that light moving objects."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from glpath.cli.help import command_help
from glpath.cli.options import option_values, with_options
from glpath.cli.outcome import bias_lines
from glpath.cli.point_options import (
    LIGHT_PANEL,
    POINT_CHOICES,
    POINT_INTEGRATORS,
    POINT_OPTIONS,
    PointIntegrator,
    WhiteSky,
)
from glpath.cli.run_request import EXIT_CODES, OF_FILMS, RunRequest
from glpath.cli.running import outcome_of
from glpath.cli.scene import Parameters, SceneArgument, read_scene
from glpath.cli.scene_options import OF_LIGHT, with_scene_options
from glpath.cli.unattended import checkpointed
from glpath.cli.values import check_choice, check_spp, numbers
from glpath.errors import UsageError
from glpath.integrators.by_name import AUTO
from glpath.io.completed import aside
from glpath.scene.summary import light_of
from glpath.system.numerals import real, whole
from glpath.system.outputs import check_outputs, save_all
from glpath.system.reporting import duration

if TYPE_CHECKING:
    from glpath.apps.probes import Probes
    from glpath.film.film import Film
    from glpath.integrators.by_name import Integrator
    from glpath.rendering.run_options import RunOptions

_GRID = "Grid"


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath probes office -o probes.json --grid 8x4x8", "256 probes all over the scene"),
        ("glpath probes room.glb -o probes.json --grid 4x2x4 --bounds 0,0,0,4,3,4", "in a box"),
        ("glpath probes room -o probes.json --noise 0.02", "until they are clean"),
        everyday="scene out grid bounds white_sky integrator spp noise time_limit max_depth resume seed device "
        "environment animation variant parameters quiet",
    )
    app.command(epilog=f"{EXIT_CODES}.", **help)(
        with_options(with_scene_options(probes, OF_LIGHT), OF_FILMS, POINT_OPTIONS, integrators=POINT_INTEGRATORS)
    )


def probes(
    scene: SceneArgument,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE.json", help="Where the probes go.")],
    grid: Annotated[
        str,
        typer.Option(
            metavar="NxNxN",
            help="How many probes along x, y and z, at the centres of equal cells.",
            rich_help_panel=_GRID,
        ),
    ] = "8x4x8",
    bounds: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,X,Y,Z",
            help="Lower and upper corner of the grid's box; by default the scene's.",
            rich_help_panel=_GRID,
        ),
    ] = None,
    white_sky: WhiteSky = False,
    integrator: PointIntegrator = AUTO,
    spp: Annotated[
        int | None,
        typer.Option(
            help="Paths for each of a probe's 50 normals; 256.", show_default=False, rich_help_panel=LIGHT_PANEL
        ),
    ] = None,
    parameters: Parameters = None,
    *,
    run: RunRequest,
    **options: Any,
) -> None:
    """Light probes in a grid: the light from all around, in second-order spherical harmonics.

    The JSON holds 27 numbers per probe, in the order of SphericalHarmonics3.fromArray of three.js. Probes inside
    solids get the mean of their valid neighbours, and the summary has their number. The scene needs no camera, but
    it needs light of its own, or --white-sky.
    """
    from glpath.apps.probes import ProbeGrid, Probes
    from glpath.rendering.below_stream import budget_for
    from glpath.rendering.points import lit

    if out.suffix.lower() != ".json":
        raise UsageError(f"{out}: probes are written as .json.", "Give a name that ends so.")
    check_choice("--integrator", integrator, POINT_CHOICES)
    counts = numbers("--grid", grid.lower(), "NxNxN", [3], whole, "x")
    corners = None if bounds is None else numbers("--bounds", bounds, "X,Y,Z,X,Y,Z", [6], real)
    check_spp(spp)
    options = option_values(integrator, options)
    with aside("camera", "light", "picture"):
        loaded = read_scene(scene, parameters)
    loaded = lit(loaded, white_sky, ambient=options.get("ambient"))
    check_outputs([out], [scene])

    def start(run: RunOptions) -> Film:
        from glpath.rendering.points import irradiance

        return irradiance(
            loaded,
            points,
            normals,
            integrator=cast("Integrator", integrator),
            spp=spp,
            **options,
            **vars(run),
        ).film

    with checkpointed([out], run, films=False) as (checkpoint, begun):
        budget = budget_for(loaded, integrator, options)
        where = ProbeGrid.of(loaded, counts, corners and (corners[:3], corners[3:]), budget)
        points, normals = where.receivers()
        outcome = outcome_of(start, run, checkpoint, begun)
        found = Probes(where, outcome.film)

        def lines(written: list[Path]) -> Iterator[str]:
            yield from _summary(found)
            yield f"  {light_of(loaded)}"
            yield from (f"wrote {path}" for path in written)

        outcome.leave(
            lambda: save_all({out: found.save}, {"probes.json": found.save}, "The probes are kept in {}."),
            lines,
            lambda _: f"what {outcome.film.path_sets} paths for each normal found is written",
            lambda: {"probes": len(where.valid), "repaired": found.repaired},
        )


def _summary(found: Probes) -> Iterator[str]:
    x, y, z = found.grid.counts
    film = found.film
    yield (
        f"{x} x {y} x {z} probes, {film.path_sets:,} paths for each of 50 normals, "
        f"{duration(film.metadata.elapsed_s)}"
    )
    yield from bias_lines(film)
    if found.repaired:
        probes = "1 probe" if found.repaired == 1 else f"{found.repaired} probes"
        yield f"  {probes} inside solids: repaired by the mean of valid neighbours"
