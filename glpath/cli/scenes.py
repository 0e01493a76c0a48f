"""`glpath info`, `validate`, `schema` and `scenes`: contents and faults of scenes."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from glpath.cli import completion
from glpath.cli.help import command_help
from glpath.cli.scene import Parameters, SceneArgument, read_scene
from glpath.cli.scene_options import OF_PICTURES, with_scene_options
from glpath.errors import GlpathError, SceneWarning, UsageError, current_warnings
from glpath.io import (
    parameters_from_options,
    scene_animations,
    scene_cameras,
    scene_parameters,
    scene_schema,
    scene_variants,
    shipped_scenes,
)
from glpath.scene import check_scene
from glpath.scene.source_location import coordinates
from glpath.scene.summary import summarize
from glpath.system.files import write_bytes
from glpath.system.terminal import clean_console, say, say_json
from glpath.system.units import Unit, symbol

# Maximum rows in a table of shapes, materials, textures or lights, because a scene can have thousands.
_SHOWN = 40


def register(app: typer.Typer) -> None:
    """Add the commands of this module to `app`."""
    app.command(
        **command_help(
            ("glpath info model.glb", "what is in it"),
            ("glpath info room --json", "for programs"),
            ("glpath info teapot -D level=4", "of a generated scene"),
        )
    )(with_scene_options(info, OF_PICTURES))
    app.command(
        **command_help(
            ("glpath validate scene.toml", "errors and warnings"),
            ("glpath validate scenes/*.toml --strict", "a warning is an error"),
            ("glpath validate scene.toml --json", "for programs"),
        )
    )(validate)
    app.command(
        **command_help(
            ("glpath schema", "to the terminal"),
            ("glpath schema -o scene.schema.json", "to a file, for an editor"),
            ("glpath schema | less", "to read it"),
        )
    )(schema)
    app.command(
        **command_help(
            ("glpath scenes", "a table"),
            ("glpath scenes --json", "for programs"),
            ("glpath info room", "more of one of them"),
        )
    )(scenes)


def info(
    scene: SceneArgument,
    parameters: Parameters = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Print what is in a scene: shapes, materials, textures, lights, camera, bounds, hash."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        loaded = read_scene(scene, parameters)
    summary = summarize(loaded)
    summary["warnings"][:0] = _scene_warnings(caught)
    summary["cameras"] = list(scene_cameras(scene))
    summary["animations"] = [{"name": each, "seconds": length} for each, length in scene_animations(scene)]
    summary["variants"] = list(scene_variants(scene))
    summary["parameters"] = {
        key: {"default": default, "description": text}
        for key, (default, text) in scene_parameters(scene, parameters_from_options(parameters or ())).items()
    }
    current_warnings().late += summary["warnings"]
    if as_json:
        say_json(summary, indent=2)
        return
    console = clean_console(soft_wrap=True)
    for table in [*_tables(summary), *_parameters(summary)]:
        console.print(table)
    console.print(f"Content, which jobs and radiosity solutions go by: sha256:{summary['content_sha256']}")
    for warning in summary["warnings"]:
        console.print(f"[yellow]warning:[/] {escape(warning)}")


def validate(
    scenes: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENE...", help="Files or names of shipped scenes.", autocompletion=completion.scenes
        ),
    ],
    parameters: Parameters = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Take warnings for errors.")] = False,
) -> None:
    """Check scenes without rendering. Exits with 1 when one has an error."""
    console = clean_console(soft_wrap=True, highlight=False)
    failed = False
    listed = []
    for name in scenes:
        error, found = _examine(name, parameters)
        bad = error is not None or (strict and bool(found))
        failed |= bad
        if as_json:
            listed.append({"scene": name, "ok": not bad, "error": error, "warnings": found})
            continue
        if error is not None:
            console.print(f"[red]error[/]    {escape(error)}")
        for warning in found:
            console.print(f"[yellow]warning[/]  {escape(warning)}")
        if error is None and not found:
            console.print(f"[green]ok[/]       {escape(name)}")
    if as_json:
        say_json(listed, indent=2)
    if failed:
        raise typer.Exit(1)


def schema(
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Write to this file instead of standard output.")
    ] = None,
) -> None:
    """Print the JSON schema of the scene format, for editors that check and complete TOML."""
    text = json.dumps(scene_schema(), indent=2)
    if out is None:
        say(text)
        return
    write_bytes(f"{text}\n".encode(), out)


def scenes(as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False) -> None:
    """List the shipped scenes, and the parameters (-D KEY=VALUE) of generated scenes with their defaults."""
    shipped = shipped_scenes()
    if as_json:
        listed = [
            {
                "name": name,
                "description": description,
                "parameters": {
                    key: {"default": default, "description": text}
                    for key, (default, text) in scene_parameters(name).items()
                },
            }
            for name, description in shipped.items()
        ]
        say_json(listed, indent=2)
        return
    table = Table("scene", "what it shows", box=None, header_style="bold")
    for name, description in shipped.items():
        table.add_row(name, escape(description))
        for key, (default, text) in scene_parameters(name).items():
            table.add_row("", escape(f"  -D {key}={default}: {text}"), style="dim")
    clean_console().print(table)


def _area_in_words(shape: dict[str, Any]) -> str:
    if shape["area"] is None:
        return "-" if shape["triangles"] else "infinite"
    return f"{shape['area']:.6g}"


def _sky_text(sky: dict[str, Any], unit: Unit) -> str:
    if "size" in sky:
        width, height = sky["size"]
        integral = f"{_numbers(sky['integral'])} {symbol(unit, 'irradiance')}"
        return f"map of {width} x {height}, {integral} from all directions"
    return f"{_numbers(sky['horizon'])} up to {_numbers(sky['zenith'])}"


def _view_text(camera: dict[str, Any]) -> str:
    if camera["type"] == "panorama":
        return "360 x 180 degrees, equirectangular"
    if camera["type"] == "orthographic":
        return f"{camera['height']:g} high, by parallel rays"
    return f"{camera['fov']:g} degrees, vertical"


def _shutter_text(summary: dict[str, Any]) -> str:
    opened, closed = summary["camera"]["shutter"]
    moving = [shape["name"] for shape in summary["shapes"] if shape["moves"]]
    moving += ["the camera"] * summary["camera"]["moves"]
    if not moving:
        return ""
    listed = ", ".join(moving[:3]) + (", ..." if len(moving) > 3 else "")
    return f"from {opened:g} to {closed:g} s; what moves: {listed}"


def _tables(summary: dict[str, Any]) -> list[Table]:
    counts = [
        f"{summary[kind]:,} {kind if summary[kind] > 1 else kind[:-1]}"
        for kind in ("triangles", "spheres", "planes")
        if summary[kind]
    ]
    unit: Unit = summary["unit"]
    camera, bounds, sky = summary["camera"], summary["bounds"], summary["sky"]
    overview = _table(f"{summary['name']}: {', '.join(counts)}", "", "")
    overview.show_header = False
    for label, value in {
        "source": summary["source"],
        "hash": f"sha256:{summary['sha256'][:16]}",
        "bounds": f"{coordinates(bounds['min'])} to {coordinates(bounds['max'])}",
        "camera": f"at {coordinates(camera['position'])} to {coordinates(camera['target'])}, "
        f"up {_numbers(camera['up'])}",
        "field of view": _view_text(camera),
        "lens": f"of radius {camera['aperture_radius']:g}, sharp at {camera['focus_distance']:g}"
        if camera["aperture_radius"]
        else "",
        "shutter": _shutter_text(summary),
        "resolution": "{} x {}".format(*camera["resolution"]),
        "light": f"{unit}: {symbol(unit, 'radiance')}, {symbol(unit, 'intensity')}, {symbol(unit, 'irradiance')}",
        "ambient": _numbers(summary["ambient"]) if any(summary["ambient"]) else "",
        "sky": _sky_text(sky, unit) if sky else "",
    }.items():
        if value:
            overview.add_row(label, escape(value))

    shapes = _table("Shapes", "name", "kind", "triangles", "spheres", "area", "material", "emission")
    for shape in _first(summary["shapes"], shapes):
        row = (
            shape["name"],
            shape["kind"],
            f"{shape['triangles']:,}" if shape["triangles"] else "-",
            f"{shape['spheres']:,}" if shape["spheres"] else "-",
            _area_in_words(shape),
            shape["material"],
            _colour(shape["emission"]),
        )
        shapes.add_row(*map(escape, row))

    materials = _table(
        "Materials", "name", "reflectance", "texture", "specular", "exponent", "mirror", "what it is"
    )
    for material in _first(summary["materials"], materials):
        row = (
            material["name"],
            _numbers(material["reflectance"]),
            material["texture"] or "-",
            _colour(material["specular"]),
            f"{material['exponent']:g}" if any(material["specular"]) else "-",
            _colour(material["mirror"]),
            material["described"] or "diffuse",
        )
        materials.add_row(*map(escape, row))

    tables = [overview, shapes, materials]
    if summary["textures"]:
        textures = _table("Textures", "name", "pixels", "repeats per unit", "filter")
        for texture in _first(summary["textures"], textures):
            size, scale = "{} x {}".format(*texture["size"]), "{:g} x {:g}".format(*texture["scale"])
            textures.add_row(escape(texture["name"]), size, scale, texture["filter"])
        tables.append(textures)
    lights = _table("Lights", "name", "kind", f"power ({symbol(unit, 'power')} for metres)", "")
    for light in _first(summary["lights"], lights):
        power = "-" if light["power"] is None else _numbers(light["power"])
        lights.add_row(*map(escape, (light["name"], light["kind"], power, _described(light, unit))))
    return [*tables, lights]


def _first(items: list[dict[str, Any]], table: Table) -> Iterator[dict[str, Any]]:
    """Yield the first `_SHOWN` items, then add a row with the number of the others, if any, to the table."""
    yield from items[:_SHOWN]
    if len(items) > _SHOWN:
        table.add_row(f"... {len(items) - _SHOWN:,} more (--json lists all)")


def _parameters(summary: dict[str, Any]) -> list[Table]:
    """Return a table of the scene's parameters (-D); empty if it has none."""
    if not summary["parameters"]:
        return []
    table = _table("Parameters (-D KEY=VALUE)", "key", "default", "what it is")
    for key, parameter in summary["parameters"].items():
        default = "" if parameter["default"] is None else str(parameter["default"])
        table.add_row(escape(key), escape(default), escape(parameter["description"]))
    if summary["cameras"]:
        listed = ", ".join(f"{index} {name}" for index, name in enumerate(summary["cameras"]))
        table.add_row("", "", escape(f"cameras: {listed}"))
    if summary["animations"]:
        every = enumerate(summary["animations"])
        listed = ", ".join(f"{index} {each['name']} ({each['seconds']:.3g} s)" for index, each in every)
        table.add_row("", "", escape(f"animations: {listed}"))
    if summary["variants"]:
        listed = ", ".join(f"{index} {name}" for index, name in enumerate(summary["variants"]))
        table.add_row("", "", escape(f"variants: {listed}"))
    return [table]


def _described(light: dict[str, Any], unit: Unit) -> str:
    """Return the properties that distinguish a light from others, as text."""
    if light["kind"] == "shape":
        return "both sides" if light["two_sided"] else "front"
    words = [f"at {coordinates(light['position'])}"] if "position" in light else []
    if "direction" in light:
        words.append(f"towards {_numbers(light['direction'])}")
    if "cone" in light:
        words.append("cone {:g} to {:g} degrees".format(*light["cone"]))
    if "profile" in light:
        return ", ".join([*words, f"{_numbers(light['intensity'])} {symbol(unit, 'power')} per lm of its profile"])
    bound = light["kind"] != "directional" and light["falloff"] == "quadratic"
    return ", ".join(
        [*words, f"{_numbers(light['intensity'])} {symbol(unit, 'intensity' if bound else 'irradiance')}"]
    )


def _colour(values: list[float]) -> str:
    return _numbers(values) if any(values) else "-"


def _table(title: str, *columns: str) -> Table:
    return Table(
        *columns, title=escape(title), title_justify="left", title_style="bold", header_style="dim", box=None
    )


def _numbers(values: list[float]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"


def _examine(name: str, parameters: list[str] | None) -> tuple[str | None, list[str]]:
    """Return the error and the warnings of one scene, each prefixed with the scene's name."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        try:
            found = [f"{name}: {text}" for text in check_scene(read_scene(name, parameters))]
        except UsageError:
            raise
        except GlpathError as problem:
            return str(problem), []
    return None, _scene_warnings(caught) + found


def _scene_warnings(caught: Sequence[warnings.WarningMessage]) -> list[str]:
    return [str(each.message) for each in caught if issubclass(each.category, SceneWarning)]
