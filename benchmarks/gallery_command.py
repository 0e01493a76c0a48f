"""`python -m benchmarks gallery`: makes the pictures of the documentation's gallery and measures their times.

Each picture's command runs as typed, in a separate process. The picture is stored as a small WebP in the
repository. The times go into one result file, from which the page is made.
"""

from __future__ import annotations

import json
import math
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.verdict import Report, machine
from glpath.errors import GlpathError, UsageError
from glpath.system.files import write_bytes
from glpath.system.terminal import say
from glpath.system.versions import versions

IMAGES = Path("docs/images/gallery")
RESULT = Path("benchmarks/results/gallery.json")
#: Largest size of all pictures together in bytes, because every checkout contains them.
MAX_BYTES = 1_000_000
_QUALITY = 90


@dataclass(frozen=True)
class Picture:
    """One picture of the gallery.

    name    : name of its file, without suffix
    title   : title of its section
    about   : description of the picture, also for readers who cannot see it
    command : command that makes it and writes NAME.png
    """

    name: str
    title: str
    about: str
    command: str


#: Pictures in the order of the page.
PICTURES = (
    Picture(
        "cornell-box",
        "Light of all bounces",
        "The Cornell box: red and green light from the walls on two white blocks",
        "glpath render cornell-box --resolution 360x360 -o cornell-box.png",
    ),
    Picture(
        "room",
        "A furnished room",
        "A living room with beams, books and a fireplace, by lamplight",
        "glpath render room --resolution 480x360 -o room.png",
    ),
    Picture(
        "parlour",
        "Textures, glass and brass",
        "A parlour by daylight: wallpaper, a carpet, brass frames and a glass bottle",
        "glpath render parlour --resolution 480x360 -o parlour.png",
    ),
    Picture(
        "lens",
        "A lens",
        "The parlour through a large aperture: near and far things are blurred",
        "glpath render parlour --resolution 480x360 --camera-aperture-radius 0.04 -o lens.png",
    ),
    Picture(
        "office",
        "An office",
        "Desks and chairs below rows of lamps",
        "glpath render office --resolution 480x360 -o office.png",
    ),
    Picture(
        "lux",
        "Illuminance on desks",
        "A plan of the office in false colours, with a scale in lux",
        "glpath measure office --plane y=0.85 -o lux.png",
    ),
    Picture(
        "path-buffer",
        "By the path-buffer",
        "The Cornell box by the path-buffer, not denoised: some noise is left",
        "glpath render cornell-box --integrator path-buffer --no-denoise --spp 64 --resolution 256x256 "
        "-o path-buffer.png",
    ),
    Picture(
        "three-spheres",
        "By the T-buffer",
        "Three spheres with mirrors and sharp shadows",
        "glpath render three-spheres --integrator t-buffer --resolution 480x360 -o three-spheres.png",
    ),
    Picture(
        "teapot",
        "Patches",
        "The Utah teapot, which consists of Bézier patches",
        "glpath render teapot --resolution 480x360 -o teapot.png",
    ),
    Picture(
        "terrain",
        "Displacement",
        "Hills: a B-spline surface that a texture displaces",
        "glpath render terrain --resolution 480x360 -o terrain.png",
    ),
)


def gallery(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Some of them; all by default.")
    ] = None,
    images: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the pictures go.")] = IMAGES,
    result: Annotated[Path, typer.Option(metavar="FILE", help="Where the times go.")] = RESULT,
) -> None:
    """Render the gallery's pictures and write how long each took.

    If only some are named, the times of the others in the file stay.
    """
    known = [picture.name for picture in PICTURES]
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise UsageError(f"gallery: no picture is named {unknown[0]!r}; allowed are {', '.join(known)}")
    chosen = [picture for picture in PICTURES if not names or picture.name in names]
    rows = kept_rows(result) if names else {}
    for picture in chosen:
        rows[picture.name] = made(picture, images)
        say(f"{picture.name}: {rows[picture.name]['wall_s']:.1f} s", err=True)
    write_bytes(report([rows[name] for name in known if name in rows]).as_json().encode(), result)


def kept_rows(result: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of the stored result by name; empty if there is none."""
    if not result.is_file():
        return {}
    return {row["name"]: row for row in json.loads(result.read_text("utf-8"))["rows"]}


def made(picture: Picture, images: Path) -> dict[str, Any]:
    """Run a picture's command, store the picture, and return its row. Raises GlpathError if the command fails."""
    from PIL import Image

    program, *arguments = shlex.split(picture.command)
    assert program == "glpath"
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "glpath", *arguments], cwd=folder, capture_output=True, text=True, check=False
        )
        wall = time.perf_counter() - start
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise GlpathError(f"gallery: {picture.command} failed:\n{done.stderr.strip()}")
        images.mkdir(parents=True, exist_ok=True)
        with Image.open(Path(folder, f"{picture.name}.png")) as image:
            size = image.size
            image.convert("RGB").save(images / f"{picture.name}.webp", quality=_QUALITY, method=6)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "name": picture.name,
        "command": picture.command,
        "width": size[0],
        "height": size[1],
        "wall_s": wall,
        "processor_s": processor,
    }


def report(rows: Sequence[dict[str, Any]]) -> Report:
    """Return the result of all pictures."""
    from glpath.gl.context import get_context

    return Report(
        "gallery",
        "pictures of the documentation, each by the command that stands below it",
        {"pictures": float(len(rows)), "processor_s": math.fsum(row["processor_s"] for row in rows)},
        None,
        list(rows),
        machine(get_context().info.renderer),
        versions("glpath", "moderngl", "numpy", "numba", "pyoidn"),
    )


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("gallery")(gallery)
