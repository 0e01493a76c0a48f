"""`glpath info`, `validate`, `schema` and `scenes`: what a scene holds and what is wrong with it."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from glpath.errors import GlpathError, SceneWarning
from glpath.scene import Scene, check_scene, load_scene, parameters_from_options, scene_schema, shipped_scenes

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A TOML file or the name of a shipped scene.")]
Parameters = Annotated[
    list[str] | None,
    typer.Option("-D", metavar="KEY=VALUE", help="A parameter of a generated scene; may be repeated."),
]


def register(app: typer.Typer) -> None:
    """Add the commands of this module to `app`."""
    for command in (info, validate, schema, scenes):
        app.command()(command)


def info(
    scene: SceneArgument,
    parameters: Parameters = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Print what is in a scene: shapes, materials, lights, camera, bounds, hash."""
    summary = summarize(load_scene(scene, parameters_from_options(parameters or [])))
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False))
        return
    console = Console(soft_wrap=True)
    for table in _tables(summary):
        console.print(table)
    for warning in summary["warnings"]:
        console.print(f"[yellow]warning:[/] {escape(warning)}")


def validate(
    scenes: Annotated[list[str], typer.Argument(metavar="SCENE...", help="TOML files or names of shipped scenes.")],
    parameters: Parameters = None,
    strict: Annotated[bool, typer.Option("--strict", help="Take warnings for errors.")] = False,
) -> None:
    """Check scenes without rendering. Exits with 1 when one has an error."""
    console = Console(soft_wrap=True, highlight=False)
    values = parameters_from_options(parameters or [])
    failed = False
    for name in scenes:
        error, found = _examine(name, values)
        failed |= error is not None or (strict and bool(found))
        if error is not None:
            console.print(f"[red]error[/]    {escape(error)}")
        for warning in found:
            console.print(f"[yellow]warning[/]  {escape(warning)}")
        if error is None and not found:
            console.print(f"[green]ok[/]       {escape(name)}")
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
        typer.echo(text)
        return
    try:
        out.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise GlpathError(f"{out}: cannot be written: {error.strerror}.", "Choose another file for -o.") from error


def scenes() -> None:
    """List the shipped scenes."""
    table = Table("scene", "what it shows", box=None, header_style="bold")
    for name, description in shipped_scenes().items():
        table.add_row(name, escape(description))
    Console().print(table)


def summarize(scene: Scene) -> dict[str, Any]:
    """What `glpath info` tells, as JSON-able data.

    Power is radiant flux, pi * area * radiance for each side that emits, W where the scene unit is a metre.
    """
    areas = scene.areas
    lower, upper = scene.bounds
    camera = scene.camera
    shapes, lights = [], []
    for shape in scene.shapes:
        area = float(areas[shape.first : shape.first + shape.count].sum())
        shapes.append(
            {
                "name": shape.name,
                "kind": shape.kind,
                "triangles": shape.count,
                "area": area,
                "material": scene.materials[shape.material].name,
                "emission": shape.emission.tolist(),
            }
        )
        if shape.emits:
            sides = 2 if shape.emission_two_sided else 1
            power = (np.pi * area * sides * shape.emission).tolist()
            lights.append({"name": shape.name, "power": power, "two_sided": shape.emission_two_sided})
    return {
        "name": scene.name,
        "source": scene.source,
        "sha256": scene.digest(),
        "triangles": len(scene.triangles),
        "bounds": {"min": lower.tolist(), "max": upper.tolist()},
        "camera": {
            "position": camera.position.tolist(),
            "target": camera.target.tolist(),
            "up": camera.up.tolist(),
            "fov": camera.fov,
            "resolution": list(camera.resolution),
        },
        "shapes": shapes,
        "materials": [
            {"name": m.name, "reflectance": m.reflectance.tolist(), "two_sided": m.two_sided}
            for m in scene.materials
        ],
        "lights": lights,
        "warnings": check_scene(scene),
    }


def _tables(summary: dict[str, Any]) -> list[Table]:
    camera, bounds = summary["camera"], summary["bounds"]
    overview = _table(f"{summary['name']}: {summary['triangles']:,} triangles", "", "")
    overview.show_header = False
    for label, value in {
        "source": summary["source"],
        "hash": f"sha256:{summary['sha256'][:16]}",
        "bounds": f"{_numbers(bounds['min'])} to {_numbers(bounds['max'])}",
        "camera": f"at {_numbers(camera['position'])} to {_numbers(camera['target'])}, up {_numbers(camera['up'])}",
        "field of view": f"{camera['fov']:g} degrees, vertical",
        "resolution": "{} x {}".format(*camera["resolution"]),
    }.items():
        overview.add_row(label, escape(value))

    shapes = _table("Shapes", "name", "kind", "triangles", "area", "material", "emission")
    for shape in summary["shapes"]:
        emission = _numbers(shape["emission"]) if any(shape["emission"]) else "-"
        row = (
            shape["name"],
            shape["kind"],
            f"{shape['triangles']:,}",
            f"{shape['area']:.6g}",
            shape["material"],
            emission,
        )
        shapes.add_row(*map(escape, row))

    materials = _table("Materials", "name", "reflectance", "sides")
    for material in summary["materials"]:
        sides = "both" if material["two_sided"] else "front"
        materials.add_row(escape(material["name"]), escape(_numbers(material["reflectance"])), sides)

    lights = _table("Lights", "name", "power (W for metres)", "sides")
    for light in summary["lights"]:
        lights.add_row(
            escape(light["name"]), escape(_numbers(light["power"])), "both" if light["two_sided"] else "front"
        )
    return [overview, shapes, materials, lights]


def _table(title: str, *columns: str) -> Table:
    return Table(
        *columns, title=escape(title), title_justify="left", title_style="bold", header_style="dim", box=None
    )


def _numbers(values: list[float]) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"


def _examine(name: str, parameters: dict[str, str]) -> tuple[str | None, list[str]]:
    """The error and the warnings of one scene, each with the scene's name in front."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        try:
            found = [f"{name}: {text}" for text in check_scene(load_scene(name, parameters))]
        except GlpathError as problem:
            return str(problem), []
    dropped = [str(each.message) for each in caught if issubclass(each.category, SceneWarning)]
    return None, dropped + found
