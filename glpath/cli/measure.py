"""`glpath measure`: irradiance and illuminance at points, in a grid or from a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from glpath.apps.measure.figures import figures
from glpath.cli.completion import words
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
from glpath.cli.values import check_choice, check_spp, numbers, vector
from glpath.errors import UsageError
from glpath.integrators.by_name import AUTO
from glpath.io.completed import aside
from glpath.scene.summary import light_of
from glpath.system.colour import luminance
from glpath.system.files import is_stream
from glpath.system.numerals import real
from glpath.system.outputs import Save, check_outputs, save_all
from glpath.system.reporting import duration
from glpath.system.time_limit import preparing
from glpath.system.units import EFFICACY, conversion

if TYPE_CHECKING:
    from glpath.apps.measure.measured import Measured
    from glpath.film.film import Film
    from glpath.integrators.by_name import Integrator
    from glpath.rendering.points import Irradiance, Receiver
    from glpath.rendering.run_options import RunOptions
    from glpath.scene import Scene

_POINTS = "Points"
_RECEIVERS = ("plane", "cylinder")
# Maximum deviation, in lx, from the 100 lx on open ground that --daylight-factor requires.
_OFF = 2.0
#: Suffixes of files with false colours.
_COLOURED = (".html", ".png", ".glb")
#: Suffixes of files that need a grid of points.
_OF_GRIDS = (".png", ".glb")


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath measure office.toml -o lux.csv --plane z=0.75 --spacing 0.25", "a working plane"),
        ("glpath measure office.toml -o lux.png --plane z=0.75 --noise 0.01", "a false-colour picture"),
        ("glpath measure office.toml -o lux.csv --points points.csv", "points of your own"),
        everyday="scene out plane spacing area margin points normal receiver white_sky maintenance_factor "
        "daylight_factor integrator spp noise time_limit max_depth resume device environment animation variant "
        "parameters",
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
            help="Write .csv, .npz, .vtp, a report .html, or of a plane false colours: a picture .png, the scene "
            "with it .glb (colours by glpath[figures]); - for CSV to stdout; may be repeated.",
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
    daylight_factor: Annotated[
        bool,
        typer.Option(
            "--daylight-factor",
            help="Call the lux per cent of a daylight factor, in the summary, reports, pictures and models. The "
            "sky must make 100 lx on open ground.",
            rich_help_panel=LIGHT_PANEL,
        ),
    ] = False,
    maintenance_factor: Annotated[
        float | None,
        typer.Option(
            metavar="F",
            help="Of all lamps that have none in the scene file, above 0, up to 1: what is left of their light "
            "after years; 1.",
            show_default=False,
            rich_help_panel=LIGHT_PANEL,
        ),
    ] = None,
    integrator: PointIntegrator = AUTO,
    spp: Annotated[
        int | None,
        typer.Option(help="Paths of each point; 256.", show_default=False, rich_help_panel=LIGHT_PANEL),
    ] = None,
    parameters: Parameters = None,
    *,
    run: RunRequest,
    **options: Any,
) -> None:
    """Irradiance and illuminance at points, with standard errors. The summary has the mean, minimum and maximum of
    all points, and the uniformities U0 (minimum / mean) and Ud (minimum / maximum).

    Points may lie on surfaces or be free in space. Each receives light on the side to which its normal points. The
    scene needs no camera, but it needs light of its own, or --white-sky. Illuminance in lx is the luminance
    (0.2126 R + 0.7152 G + 0.0722 B) of the irradiance; for light in watts, it is multiplied by 179 lm/W.
    """
    from glpath.apps.measure.files import check_kind, save
    from glpath.apps.measure.measured import Measured
    from glpath.apps.measure.points import EN_12464, check_within, plane_grid
    from glpath.apps.measure.tables import read_points, save_csv
    from glpath.rendering.points import lit
    from glpath.scene.maintenance import maintained

    for path in out:
        check_kind(path)
    check_choice("--integrator", integrator, POINT_CHOICES)
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
    of_grids = [path for path in out if path.suffix.lower() in _OF_GRIDS]
    if of_grids and plane is None:
        raise UsageError(f"{of_grids[0]}: a picture is of a grid; these points are in none.", "Give --plane.")
    if any(path.suffix.lower() in _COLOURED for path in out):
        from glpath.film.charts import require_matplotlib

        require_matplotlib()
    options = option_values(integrator, options)
    with aside("camera", "light"):
        loaded = read_scene(scene, parameters)
    loaded = maintained(lit(loaded, white_sky, ambient=options.get("ambient")), maintenance_factor)
    if daylight_factor:
        _check_makes_per_cent(loaded, receiver, options.get("ambient"))
    facing = vector("--normal", normal)
    apart = None if spacing is None else _spacing(spacing)
    corners = None if area is None else numbers("--area", area, "A,B,A,B", [4], real)
    with preparing("the points"):
        if plane is not None:
            at = plane_grid(loaded, plane, spacing=apart, area=corners, margin=margin or 0.0, normal=facing)
        else:
            assert points is not None, "asked above"
            at = read_points(points, facing)
        check_within(at, loaded, f"--plane {plane}" if plane is not None else f"--points {points}")
    check_outputs(out, [scene, points])

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
        quantity = "Cylindrical illuminance" if receiver == "cylinder" else "Illuminance"
        measured = Measured(at, found, loaded, *(("Daylight factor", "%") if daylight_factor else (quantity, "lx")))
        saves: dict[Path, Save] = {path: partial(save, measured=measured) for path in out}
        rescue = {"measured.csv": partial(save_csv, at=at, found=found)}

        def lines(written: list[Path]) -> Iterator[str]:
            yield from _summary(found, measured)
            yield f"  {light_of(loaded)}"
            if at.grid is not None:
                yield f"  {at.grid.described(loaded)}"
                if at.grid.coarser_than_en_12464:
                    yield f"  EN 12464-1: {at.grid.beside_en_12464} (--spacing {EN_12464})"
                if any(path.suffix.lower() == ".glb" for path in written):
                    top = f"{max(found.illuminance()):.4g} {measured.unit}"
                    yield f"  colours of the .glb: viridis, from 0 to {top}"
            yield from (f"wrote {path}" for path in written if not is_stream(path))

        outcome.leave(
            lambda: save_all(saves, rescue, "What was measured is kept in {}."),
            lines,
            lambda _: f"what {outcome.film.path_sets} paths of each point found is written",
        )


def _spacing(text: str) -> float | Literal["en12464-1"]:
    """Return the value of --spacing. Raises UsageError unless it is a number or the name of the standard."""
    if text.lower() == "en12464-1":
        return "en12464-1"
    try:
        return real(text)
    except ValueError:
        raise UsageError(f"--spacing {text}: must be a number in scene units, or en12464-1.") from None


def _check_makes_per_cent(scene: Scene, receiver: str, ambient: float | Sequence[float] | None) -> None:
    """Raise UsageError unless the scene's sky alone gives 100 lx on open ground.

    Only then is the illuminance in lx the daylight factor in per cent.

    ambient : ambient radiance that replaces the scene's
    """
    import numpy as np

    from glpath.sky.maps import open_ground

    if receiver != "plane":
        raise UsageError(f"--daylight-factor beside --receiver {receiver}: it is of planes.", "Leave one out.")
    others = {
        "no sky": scene.sky is None,
        "lamps besides its sky": scene.lights or any(shape.emits for shape in scene.shapes),
        "a sun in its sky": getattr(scene.sky, "sun", None) is not None,
        "ambient light": np.any(np.asarray(scene.ambient if ambient is None else ambient) > 0),
    }
    found = next((name for name, present in others.items() if present), None)
    if scene.sky is None or found is not None:
        raise UsageError(
            f"--daylight-factor: {scene.source or scene.name} has {found}; it is of an overcast sky alone.",
            'Give it sky = { type = "cie", cie_type = 1, illuminance = 100 }, and no other light.',
        )
    lux = conversion(scene.unit, "photometric") * float(luminance(open_ground(scene.sky)))
    if abs(lux - 100) > _OFF:
        raise UsageError(
            f"--daylight-factor: the sky makes {lux:.4g} lx on open ground; lux are per cent if it makes 100.",
            'Give it illuminance = 100, as sky = { type = "cie", cie_type = 1, illuminance = 100 }.',
        )


def _summary(found: Irradiance, measured: Measured) -> Iterator[str]:
    import numpy as np

    lux, error = found.illuminance(), found.illuminance_errors()
    made = found.film.metadata
    yield f"{found.count:,} points, {found.film.path_sets:,} paths each, {duration(made.elapsed_s)}"
    spread = found.spread()
    yield f"  {measured.quantity.lower()}: {figures(spread, unit=measured.unit)}"
    lit = lux > 0
    if lit.any() and not lit.all():
        dark = np.count_nonzero(~lit)
        have, them = ("point has", "it") if dark == 1 else ("points have", "them")
        yield f"  {dark:,} {have} no light at all: inside of solids, perhaps. Without {them}:"
        spread = found.spread(lit)
        yield f"  {figures(spread, unit=measured.unit)}"
    elif not lit.any():
        yield "  no light comes to any of the points: they are inside of solids, or in a closed room without a lamp"
    below = np.count_nonzero(lux < 0)
    if below:
        yield f"  {below:,} {'point is' if below == 1 else 'points are'} below 0, which is noise: take more --spp"
    if found.film.path_sets >= 16:
        yield f"  standard error of a point: {float((error**2).mean() ** 0.5):.2g} {measured.unit}"
    yield from bias_lines(found.film)
    wanted = spread.asks_for(found.film.path_sets)
    if wanted is not None:
        plain = spread.minimum.plain / spread.mean.value
        yield (
            f"  noise dominates the minimum or the maximum (U0 of the values as they are would be {plain:.3f}): "
            f"take --spp {wanted} or so"
        )
    if found.unit == "radiometric":
        yield f"  lux are {EFFICACY:g} lm/W times 0.2126 R + 0.7152 G + 0.0722 B of the irradiance in W/m2"
