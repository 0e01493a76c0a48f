"""`glpath horizon`: sky view factors, sun hours and direct irradiation of terrain."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glpath.apps.measure.tables import table_lines
from glpath.cli.completion import words
from glpath.cli.help import command_help
from glpath.cli.signals import result_of
from glpath.cli.values import check_choice
from glpath.errors import UsageError, warn
from glpath.system.numerals import real, whole
from glpath.system.outputs import Save, check_outputs, save_all
from glpath.system.reporting import MODES, duration, reporting
from glpath.system.suggestions import listed_names, similar_names
from glpath.system.terminal import say

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from glpath.apps.terrain.horizon import Horizon

_QUANTITIES = ("sky-view-factor", "sun-hours", "irradiation")
_SURFACES = ("horizontal", "slope")
_TITLES = {
    "sky-view-factor": ("Sky view factor", ""),
    "sun-hours": ("Sun hours", "h"),
    "irradiation": ("Direct irradiation", ""),
}
_RECEIVERS, _SUNS = "Receivers", "Suns"
# Effect of a missing optional column of a table.
_WITHOUT = {"hours": "each sun counts as 1 hour", "z": "the points lie on the surface"}


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath horizon dem.tif -o svf.tif", "sky view factors, with the file's georeference"),
        ("glpath horizon dem.tif -o hours.tif --suns suns.csv --quantity sun-hours", "hours of sun"),
        ("glpath horizon dem.tif -o roofs.csv --points roofs.laz", "at points of a cloud"),
    )
    app.command(**help)(horizon)


def horizon(
    field: Annotated[
        Path, typer.Argument(help="A height field: .tif (glpath[terrain]), .asc, .npy or .npz.", show_default=False)
    ],
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="Write .tif, .npy, .npz or a false-colour .png (glpath[figures]); of points .csv, .npy or .npz; "
            "may be repeated.",
        ),
    ],
    quantity: Annotated[
        str,
        typer.Option(
            metavar="|".join(_QUANTITIES),
            help="The share of an even sky's light, hours of sun, or the direct sunlight.",
            autocompletion=words(_QUANTITIES),
        ),
    ] = "sky-view-factor",
    azimuths: Annotated[
        int | None, typer.Option(metavar="N", help="Directions of sky view factors, 8 to 720; 64.")
    ] = None,
    suns: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Suns of a CSV file: columns azimuth and altitude in degrees, and hours or energy (W h m-2 across "
            "the sun's direction).",
            rich_help_panel=_SUNS,
        ),
    ] = None,
    surface: Annotated[
        str,
        typer.Option(
            metavar="|".join(_SURFACES),
            help="Receivers are horizontal, or face as the terrain there.",
            autocompletion=words(_SURFACES),
            rich_help_panel=_RECEIVERS,
        ),
    ] = "horizontal",
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Receivers instead of the samples: .csv with columns x, y and z, .las or .laz (glpath[terrain]).",
            rich_help_panel=_RECEIVERS,
        ),
    ] = None,
    classes: Annotated[
        str | None,
        typer.Option(
            metavar="N,N",
            help="Of a LAS file the points of these classes: 2 is ground, 6 buildings.",
            rich_help_panel=_RECEIVERS,
        ),
    ] = None,
    height: Annotated[
        float,
        typer.Option(metavar="UNITS", help="Of the samples' receivers above ground.", rich_help_panel=_RECEIVERS),
    ] = 0.0,
    spacing: Annotated[
        float | None,
        typer.Option(metavar="UNITS", help="Between the samples of a .npy, in the unit of its heights; 1."),
    ] = None,
    holes: Annotated[
        bool,
        typer.Option("--holes", help="Heights may be missing: such samples shadow nothing, and get no result."),
    ] = False,
    progress: Annotated[
        str,
        typer.Option(metavar="|".join(MODES), help="How progress is reported.", autocompletion=words(MODES)),
    ] = "auto",
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Only errors and warnings.")] = False,
) -> None:
    """Sky view factors, sun hours or direct irradiation of terrain, at the samples of a height field or at points.

    Results are exact for the surface of triangles between the samples. Sky view factors are for a uniform sky above
    the horizon; they do not include light from the ground.
    """
    import time

    from glpath.apps.terrain.horizon import AZIMUTHS
    from glpath.apps.terrain.horizon import horizon as horizon_of
    from glpath.apps.terrain.reading import load_height_field
    from glpath.apps.terrain.saving import check_kind

    check_choice("--quantity", quantity, _QUANTITIES)
    check_choice("--surface", surface, _SURFACES)
    check_choice("--progress", progress, MODES)
    for path in out:
        check_kind(path, points is not None, () if points is not None else (".png",))
    check_outputs(out, [field, points, suns])
    if any(path.suffix.lower() == ".png" for path in out):
        from glpath.film.charts import require_matplotlib

        require_matplotlib()
    sun_table = _suns(suns, quantity)
    if azimuths is not None and quantity != "sky-view-factor":
        raise UsageError(f"--azimuths: have no part in --quantity {quantity}.", "Leave them out.")
    if classes is not None and (points is None or points.suffix.lower() not in (".las", ".laz")):
        raise UsageError("--classes: belongs to --points FILE.las or FILE.laz.", "Leave it out.")
    terrain = load_height_field(field, spacing=spacing, holes=holes)
    at = None if points is None else _points(points, classes)
    began = time.perf_counter()

    def compute() -> tuple[Horizon, NDArray[Any]]:
        with reporting("none" if quiet else progress, sys.stderr, lambda event: event) as report:
            found = horizon_of(
                terrain,
                at,
                None if surface == "horizontal" else "surface",
                height=height,
                azimuths=AZIMUTHS if azimuths is None else azimuths,
                on_progress=report,
            )
            if quantity == "sky-view-factor":
                return found, found.sky_view_factor()
            if quantity == "sun-hours":
                return found, found.sun_hours(*sun_table)
            return found, found.direct_irradiation(*sun_table)

    found, values = result_of(compute)
    saves: dict[Path, Save] = {
        path: partial(_save_picture, found=found, values=values, quantity=quantity)
        if path.suffix.lower() == ".png"
        else partial(found.save, values=values)
        for path in out
    }
    _, failure = save_all(
        saves, {"horizon.npz": partial(found.save, values=values)}, "What was computed is kept in {}."
    )
    if failure is not None:
        raise failure
    if not quiet:
        say(f"{_summary(found, values, quantity)}, {duration(time.perf_counter() - began)}", err=True)
        for path in out:
            say(f"wrote {path}", err=True)


def _summary(found: Horizon, values: NDArray[Any], quantity: str) -> str:
    import numpy as np

    there = values[np.isfinite(values)]
    what = "samples" if found.points is None else "points"
    if not len(there):
        return f"{values.size:,} {what}, none of which has a value"
    name, unit = _TITLES[quantity]
    low, mean, high = (f"{float(each):.4g}" for each in (there.min(), there.mean(dtype=np.float64), there.max()))
    return f"{len(there):,} {what}: {name.lower()} {low} to {high}{' ' if unit else ''}{unit}, mean {mean}"


def _suns(path: Path | None, quantity: str) -> tuple[NDArray[Any], ...]:
    """Return azimuths, altitudes and weights from the file of --suns. Raises UsageError."""
    if quantity == "sky-view-factor":
        if path is not None:
            raise UsageError(
                "--suns: have no part in sky view factors.", "Say --quantity sun-hours or irradiation."
            )
        return ()
    if path is None:
        raise UsageError(f"--quantity {quantity}: needs suns.", "Give a table of them: --suns FILE.csv.")
    import numpy as np

    if quantity == "irradiation":
        table = _table(path, "--suns", ("azimuth", "altitude", "energy"), ())
        return table["azimuth"], table["altitude"], table["energy"]
    table = _table(path, "--suns", ("azimuth", "altitude"), ("hours",))
    hours = table.get("hours", np.ones(len(table["azimuth"])))
    return table["azimuth"], table["altitude"], hours


def _points(path: Path, classes: str | None) -> NDArray[Any]:
    from glpath.apps.terrain.reading import CLOUD_SUFFIXES, load_point_cloud

    if path.suffix.lower() in CLOUD_SUFFIXES:
        try:
            wanted = () if classes is None else tuple(whole(each) for each in classes.split(","))
        except ValueError:
            raise UsageError(f"--classes {classes}: expected whole numbers with commas, such as 2,6.") from None
        return load_point_cloud(path, wanted)
    if path.suffix.lower() != ".csv":
        raise UsageError(f"--points {path}: no such points are read.", "Files end in .csv, .las or .laz.")
    import numpy as np

    table = _table(path, "--points", ("x", "y"), ("z",))
    return np.column_stack([table[name] for name in ("x", "y", "z") if name in table])


def _table(path: Path, option: str, needed: tuple[str, ...], optional: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Return columns (N,) of a CSV file, by their names in its first line. Raises UsageError.

    If an optional column is missing, other columns may be misspelt names of it, so there is a warning.

    option : command line option of the file, for messages
    needed : names of columns that must exist; `optional` columns are returned if they exist
    """
    import numpy as np

    from glpath.system.files import read_bytes, reason_of

    try:
        text = read_bytes(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{option} {path}: cannot be read: {reason_of(error)}.") from error
    rows = table_lines(text, path)
    names = [cell.lower() for cell in rows[0][1]] if rows else []
    columns, wrong = (*needed, *optional), ""
    others = [name for name in names if name and name not in columns]
    for name in columns:
        near = [] if name in names else similar_names(name, others, 1, 0.75)
        if names.count(name) > 1:
            wrong = f"has two columns {name}"
        elif name in needed and name not in names:
            wrong = f"has no column {name}"
        if wrong:
            break
    if wrong or len(rows) < 2:
        meant = f"Is {near[0]} meant? " if near else ""
        raise UsageError(
            f"{option} {path}: {wrong or 'has no line below its names'}.",
            f"{meant}Columns: {','.join(columns)}.",
        )
    for name in optional:
        if others and name not in names:
            unread = listed_names(others)
            warn(f"{option} {path}: has no column {name}, so {_WITHOUT[name]}. Columns without use: {unread}.")
    found: dict[str, NDArray[Any]] = {}
    for name in (each for each in columns if each in names):
        column = names.index(name)
        values = np.empty(len(rows) - 1)
        for i, (line, row) in enumerate(rows[1:]):
            try:
                values[i] = real(row[column])
            except (ValueError, IndexError):
                cell = row[column] if column < len(row) else ""
                raise UsageError(f"{option} {path}, line {line}: {name} is {cell!r}, which is no number.") from None
        found[name] = values
    return found


def _save_picture(path: Path, found: Horizon, values: NDArray[Any], quantity: str) -> None:
    import numpy as np

    from glpath.film.charts import field
    from glpath.film.image import encode_png
    from glpath.system.files import write_bytes

    terrain = found.field
    # Draw only every step-th sample along each side, at most 1024, because a page cannot show more.
    step = max(1, -(-max(values.shape) // 1024))
    x, y = terrain.coordinates()
    dx, dy = terrain.spacing
    extent = (float(x[0] - dx / 2), float(x[-1] + dx / 2), float(y[-1] - dy / 2), float(y[0] + dy / 2))
    title, unit = _TITLES[quantity]
    size = f"{terrain.shape[1]:,} x {terrain.shape[0]:,} samples, {dx:g} x {dy:g} apart."
    shown = np.asarray(values, np.float64)[::step, ::step][::-1]
    page = field(title, _summary(found, values, quantity) + f". {size}", shown, extent, ("x", "y"), unit)
    write_bytes(encode_png(page), path)
