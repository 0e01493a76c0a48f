"""`glpath measure`: irradiance and illuminance at points, in a grid or from a table."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from glpath.cli.completion import words
from glpath.cli.help import command_help
from glpath.cli.options import option_values, with_options
from glpath.cli.point_options import LIGHT_PANEL, POINT_INTEGRATORS, POINT_OPTIONS, PointIntegrator, WhiteSky
from glpath.cli.run_request import EXIT_CODES, OF_FILMS, RunRequest
from glpath.cli.running import outcome_of
from glpath.cli.scene import Parameters, SceneArgument, light_of, read_scene
from glpath.cli.scene_options import OF_LIGHT, with_scene_options
from glpath.cli.unattended import checkpointed
from glpath.cli.values import check_choice, check_spp, vector
from glpath.errors import UsageError
from glpath.film.units import EFFICACY
from glpath.io.completed import aside
from glpath.system.files import Save, check_writable, is_stream, save_all
from glpath.system.reporting import duration

if TYPE_CHECKING:
    from glpath.cli.point_files import Points
    from glpath.film.film import Film
    from glpath.integrators.by_name import Integrator
    from glpath.rendering.points import Irradiance, Receiver
    from glpath.rendering.run_options import RunOptions
    from glpath.rendering.uniformity import Estimate, Spread

_POINTS = "Points"
_RECEIVERS = ("plane", "cylinder")


def register(app: typer.Typer) -> None:
    """Put the command on the main program."""
    help = command_help(
        ("glpath measure office.toml -o lux.csv --plane z=0.75 --spacing 0.25", "a working plane"),
        ("glpath measure office.toml -o lux.png --plane z=0.75 --noise 0.01", "a false-colour picture"),
        ("glpath measure office.toml -o lux.csv --points points.csv", "points of your own"),
        everyday="scene out plane spacing area margin points normal receiver white_sky integrator spp noise "
        "time_limit max_depth resume device environment animation variant parameters",
    )
    app.command(epilog=f"{EXIT_CODES}.", **help)(
        with_options(with_scene_options(measure, OF_LIGHT), OF_FILMS, POINT_OPTIONS, integrators=POINT_INTEGRATORS)
    )


def measure(
    scene: SceneArgument,
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="Write .csv, .npz, or of a plane a false-colour .png (glpath[figures]); - for CSV to stdout; may "
            "be repeated.",
        ),
    ],
    plane: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS=HEIGHT",
            help="A grid in the plane across an axis, which faces along it: y=0.75; -y=2.4 faces along -y.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    spacing: Annotated[
        str | None,
        typer.Option(
            metavar="UNITS|en12464-1",
            help="Of the grid, from point to point, or as that standard has it for so large an area, units being "
            "metres; default: a 32nd of its longer side.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    area: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,A,B",
            help="Two corners of the grid along the other two axes, in the order x, y, z; default: the scene's.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(
            metavar="UNITS",
            help="How much of the area is left out along its edges; EN 12464-1 has 0.5 m along walls.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Points of a CSV file: columns x, y, z and nx, ny, nz; - for stdin. Or honeybee's sensors: "
            "FILE.hbjson#GRID.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    normal: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Where all points face, of a file without normals or of a grid: along the floor for the light on "
            "what stands upright.",
            rich_help_panel=_POINTS,
        ),
    ] = None,
    receiver: Annotated[
        str,
        typer.Option(
            metavar="|".join(_RECEIVERS),
            help="plane: light on a surface across the normal. cylinder: on one around it, the mean over all "
            "directions that are upright to it: cylindrical illuminance, of faces.",
            autocompletion=words(_RECEIVERS),
            rich_help_panel=_POINTS,
        ),
    ] = "plane",
    white_sky: WhiteSky = False,
    integrator: PointIntegrator = "path",
    spp: Annotated[
        int | None,
        typer.Option(help="Paths of each point; 256.", show_default=False, rich_help_panel=LIGHT_PANEL),
    ] = None,
    parameters: Parameters = None,
    *,
    run: RunRequest,
    **options: Any,
) -> None:
    """Irradiance and illuminance at points, with standard errors; of all also mean, minimum, maximum, and the
    uniformities U0 (minimum over mean) and Ud (minimum over maximum).

    Points may lie on surfaces or be free; each has the light of the side that its normal leaves. The scene needs no
    camera, but light of its own, or --white-sky. Lux are the luminance (0.2126 R + 0.7152 G + 0.0722 B) of the
    irradiance; of light in watts times 179 lm/W.
    """
    from glpath.cli.point_files import check_kind, check_within, grid_of, read_points, save_csv, save_npz
    from glpath.rendering.points import lit

    for path in out:
        check_kind(path)
    check_choice("--integrator", integrator, POINT_INTEGRATORS)
    check_choice("--receiver", receiver, _RECEIVERS)
    if (plane is None) == (points is None):
        raise UsageError(
            "measure: where? Neither --plane nor --points."
            if plane is None
            else "measure: --plane beside --points.",
            "Give one of them.",
        )
    for option, value in (("--spacing", spacing), ("--area", area), ("--margin", margin)):
        if value is not None and plane is None:
            raise UsageError(f"{option}: belongs to --plane.", "Leave it out.")
    check_spp(spp)
    pictures = [path for path in out if path.suffix.lower() == ".png"]
    if pictures and plane is None:
        raise UsageError(f"{pictures[0]}: a picture is of a grid; these points are in none.", "Give --plane.")
    if pictures:
        from glpath.film.charts import require_matplotlib

        require_matplotlib()
    options = option_values(integrator, options)
    with aside("camera", "light"):
        loaded = read_scene(scene, parameters)
    loaded = lit(loaded, white_sky, ambient=options.get("ambient"))
    if plane is not None:
        at = grid_of(plane, spacing, area, loaded, margin=margin or 0.0, normal=vector("--normal", normal))
    else:
        assert points is not None, "asked above"
        at = read_points(points, vector("--normal", normal))
    check_within(at, loaded, f"--plane {plane}" if plane is not None else f"--points {points}")
    for path in out:
        check_writable(path)

    def start(run: RunOptions) -> Film:
        from glpath.rendering.points import irradiance

        return irradiance(
            loaded,
            at.points,
            at.normals,
            receiver=cast("Receiver", receiver),
            integrator=cast("Integrator", integrator),
            spp=spp,
            **options,
            **vars(run),
        ).film

    with checkpointed(out, run, films=False) as (checkpoint, begun):
        outcome = outcome_of(start, run, checkpoint, begun)
        from glpath.rendering.points import Irradiance

        found = Irradiance(outcome.film, len(at.points))
        saves: dict[Path, Save] = {}
        for path in out:
            save: Any = save_npz if path.suffix.lower() == ".npz" else save_csv
            more: dict[str, Any] = {}
            if path in pictures:
                title = "Cylindrical illuminance" if receiver == "cylinder" else "Illuminance"
                save, more = _save_picture, {"title": f"{title} in {loaded.name}"}
            saves[path] = partial(save, at=at, found=found, **more)
        rescue = {"measured.csv": partial(save_csv, at=at, found=found)}

        def lines(written: list[Path]) -> Iterator[str]:
            yield from _summary(found)
            yield f"  {light_of(loaded)}"
            if at.grid is not None:
                yield f"  {at.grid.described(loaded)}"
            yield from (f"wrote {path}" for path in written if not is_stream(path))

        outcome.leave(
            lambda: save_all(saves, rescue, "What was measured is kept in {}."),
            lines,
            lambda _: f"what {outcome.film.path_sets} paths of each point found is written",
        )


def _summary(found: Irradiance) -> Iterator[str]:
    import numpy as np

    lux, error = found.illuminance(), found.illuminance_errors()
    made = found.film.metadata
    yield f"{found.count:,} points, {found.film.path_sets:,} paths each, {duration(made.elapsed_s)}"
    spread = found.spread()
    yield f"  illuminance: {_figures(spread)}"
    lit = lux > 0
    if lit.any() and not lit.all():
        dark = np.count_nonzero(~lit)
        have, them = ("point has", "it") if dark == 1 else ("points have", "them")
        yield f"  {dark:,} {have} no light at all: inside of solids, perhaps. Without {them}:"
        spread = found.spread(lit)
        yield f"  {_figures(spread)}"
    elif not lit.any():
        yield "  no light comes to any of the points: they are inside of solids, or in a closed room without a lamp"
    if found.film.path_sets >= 16:
        yield f"  standard error of a point: {float((error**2).mean() ** 0.5):.2g} lx"
    wanted = spread.asks_for(found.film.path_sets)
    if wanted is not None:
        plain = spread.minimum.plain / spread.mean.value
        yield (
            f"  noise dominates the minimum or the maximum (U0 of the values as they are would be {plain:.3f}): "
            f"take --spp {wanted} or so"
        )
    if found.unit == "radiometric":
        yield f"  of W/m2 by {EFFICACY:g} lm/W and the luminance 0.2126 R + 0.7152 G + 0.0722 B"


def _figures(spread: Spread, digits: int = 4) -> str:
    """What is asked of a grid, with standard errors: U0 is its minimum over its mean, Ud over its maximum."""
    mean, minimum, maximum = (
        _with_error(x, f"{x.value:.{digits}g}", unit)
        for x, unit in ((spread.mean, " lx"), (spread.minimum, ""), (spread.maximum, ""))
    )
    text = f"mean {mean}, minimum {minimum}, maximum {maximum}"
    if not spread.mean.value > 0:
        return text
    u0, ud = (_with_error(x, f"{x.value:.3f}") for x in (spread.u0, spread.ud))
    return f"{text}; U0 {u0}, Ud {ud}"


def _with_error(of: Estimate, value: str, unit: str = "") -> str:
    """Two digits of the error; none where it is not known, or beyond what is shown."""
    if not of.error > 1e-4 * abs(of.value):
        return f"{value}{unit}"
    return f"{value} ± {of.error:.2g}{unit}"


def _save_picture(path: Path, at: Points, found: Irradiance, title: str) -> None:
    import numpy as np

    from glpath.cli.point_files import AXES
    from glpath.film.charts import field
    from glpath.film.image import encode_png
    from glpath.system.files import write_bytes

    grid = at.grid
    assert grid is not None, "asked for before"
    lux = found.illuminance()
    lit = lux > 0
    dark = int(np.count_nonzero(~lit))
    inside = f"Without {dark:,} that have no light at all (grey): " if 0 < dark < len(lux) else ""
    spread = found.spread(lit if lit.any() else None)
    a, b = (f"{step:.3g}" for step in grid.step)
    page = field(
        f"{title}, {AXES[grid.axis]} = {grid.height:g}",
        f"{grid.shape[1]} x {grid.shape[0]} points, {a if a == b else f'{a} x {b}'} apart, "
        f"{found.film.path_sets:,} paths each. {inside}{_figures(spread, 3)}.",
        np.where(lit, lux, np.nan if lit.any() else 0.0).reshape(grid.shape),
        grid.extent,
        (AXES[grid.across[0]], AXES[grid.across[1]]),
        "lux",
    )
    write_bytes(encode_png(page), path)
