"""A page of HTML with pairs of pictures of models, without options: by glpath and by <model-viewer>.

If <model-viewer> cannot read a format, trimesh writes the model as .glb for it. Timing alone needs no viewer.
"""

from __future__ import annotations

import io
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks.peers.model_viewer import Shown, shown_by_model_viewer
from glpath.io.gltf.document import SUFFIXES
from glpath.io.models import FORMATS

Say = Callable[[str], None]

# Layout of the sheet: side of a picture and gap between pictures in pixels, and pairs per row.
_SIDE, _GAP, _PAIRS = 160, 4, 4

_PAGE = """<!doctype html><meta charset="utf-8"><title>Default look</title>
<style>
body {{ font-family: sans-serif; margin: 2em }} td {{ padding: 0.3em; vertical-align: top }}
img {{ background: white; border: 1px solid #ccc }} pre {{ white-space: pre-wrap; max-width: 60em }}
</style>
<h1>Models without an option</h1>
<p>Left <code>glpath render MODEL -o PNG</code>, right &lt;model-viewer&gt; without an attribute. Seconds are of the
whole process for the one, and of loading and drawing, without the browser's start, for the other.</p>
<table>{rows}</table>
"""


@dataclass(frozen=True)
class Rendered:
    """A picture by `glpath render`, the text that the command printed, and the seconds of the whole process."""

    png: bytes
    seconds: float
    printed: str
    processor_seconds: float = 0.0


def models_in(folder: Path) -> list[Path]:
    """Return the models directly in a folder, sorted by name; else Khronos' samples in its folder Models."""
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in FORMATS and path.is_file())
    return found or sorted(folder.glob("Models/*/glTF/*.gltf"))


def render_models(models: Sequence[Path], output: Path, side: int, say: Say) -> list[Rendered]:
    """Render the models without options, one after the other, into a folder."""
    output.mkdir(parents=True, exist_ok=True)
    found = []
    for path in models:
        found.append(_rendered(path, side))
        (output / f"{path.name}.glpath.png").write_bytes(found[-1].png)
        say(f"{path.name}: {found[-1].seconds:.1f} s, {found[-1].processor_seconds:.1f} s of processors")
    return found


def write_page(models: Sequence[Path], ours: Sequence[Rendered], output: Path, side: int) -> Path:
    """Write index.html, sheet.jpg and the viewer's pictures into the folder that has glpath's."""
    with tempfile.TemporaryDirectory() as folder:
        theirs = shown_by_model_viewer([_as_gltf(path, Path(folder)) for path in models], side)
    rows = []
    for path, mine, other in zip(models, ours, theirs, strict=True):
        (output / f"{path.name}.viewer.png").write_bytes(other.png)
        rows.append(_row(path.name, mine, other))
    _sheet([(mine.png, other.png) for mine, other in zip(ours, theirs, strict=True)]).save(
        output / "sheet.jpg", quality=88
    )
    page = output / "index.html"
    page.write_text(_PAGE.format(rows="\n".join(rows)), encoding="utf-8")
    return page


def _rendered(path: Path, side: int) -> Rendered:
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder, "a.png")
        command = [sys.executable, "-m", "glpath", "render", str(path), "-o", str(picture)]
        size = [] if side == 512 else ["--resolution", f"{side}x{side}"]
        before, start = _processor_seconds(), time.perf_counter()
        done = subprocess.run([*command, *size], stdin=subprocess.DEVNULL, capture_output=True)
        seconds, processor = time.perf_counter() - start, _processor_seconds() - before
        png = picture.read_bytes() if picture.exists() else b""
    return Rendered(png, seconds, done.stderr.decode(errors="replace").strip(), processor)


def _processor_seconds() -> float:
    """Return the user and system seconds of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _as_gltf(path: Path, folder: Path) -> Path:
    if path.suffix.lower() in SUFFIXES:
        return path
    import trimesh

    made = folder / f"{path.name}.glb"
    scene: Any = trimesh.load_scene(path)
    made.write_bytes(scene.export(file_type="glb"))
    return made


def _row(name: str, mine: Rendered, other: Shown) -> str:
    cells = [
        f'<td><img src="{escape(name)}.{kind}.png" alt="no picture"><br>{what}'
        for kind, what in (
            ("glpath", f"glpath, {mine.seconds:.1f} s"),
            ("viewer", escape(other.error) or f"model-viewer, {other.seconds:.1f} s"),
        )
    ]
    return (
        f"<tr><th colspan=2>{escape(name)}<tr>{''.join(cells)}<tr><td colspan=2><pre>{escape(mine.printed)}</pre>"
    )


def _sheet(pairs: Sequence[tuple[bytes, bytes]]) -> Image.Image:
    """Return a sheet of all pairs, small and over white, each with glpath's picture on the left."""
    wide, high = 2 * _SIDE + 3 * _GAP, _SIDE + 2 * _GAP
    columns = min(_PAIRS, len(pairs))
    sheet = Image.new("RGB", (columns * wide, math.ceil(len(pairs) / columns) * high), "white")
    for number, pair in enumerate(pairs):
        for k, png in enumerate(pair):
            if not png:
                continue
            picture = Image.open(io.BytesIO(png)).convert("RGBA")
            picture.thumbnail((_SIDE, _SIDE), Image.Resampling.LANCZOS)
            at = (number % columns) * wide + _GAP + k * (_SIDE + _GAP), (number // columns) * high + _GAP
            sheet.paste(picture, at, picture)
    return sheet
