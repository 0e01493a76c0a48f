"""The page of a comparison: a table, and each model's pictures side by side with their difference."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.khronos.beside_cycles import Beside
from glpath.film.image import write_png
from glpath.system.files import write_bytes

#: Factor that makes differences visible.
_SEEN = 8
_STYLE = """
body { font: 15px system-ui, sans-serif; margin: 2em; color: #222; background: #fff }
table { border-collapse: collapse } td, th { padding: 0.2em 0.8em; text-align: left }
td.number { text-align: right; font-variant-numeric: tabular-nums } tr.fails td { background: #fdd }
figure { display: inline-block; margin: 0.3em } img { width: 20em; display: block } figcaption { color: #666 }
pre { white-space: pre-wrap; color: #666 }
"""
_COLUMNS = {
    "features": "Materials",
    "difference": "Difference",
    "limit": "At most",
    "worst_tenth": "Of the worst tenth",
    "processor_seconds": "Processor s",
    "seconds": "s",
    "cycles_seconds": "Cycles s",
}


def write_page(found: Sequence[Beside], folder: Path, introduction: str) -> Path:
    """Write FOLDER/index.html and its pictures; return the path of the page."""
    folder.mkdir(parents=True, exist_ok=True)
    rows, parts = [], []
    for each in found:
        rows.append(_row(each.row))
        parts.append(_section(each, folder))
    head = "".join(f"<th>{html.escape(title)}</th>" for title in ("Model", *_COLUMNS.values()))
    text = (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>Sample models</title>'
        f"<style>{_STYLE}</style>\n<h1>Sample models beside Cycles</h1>\n<p>{html.escape(introduction)}</p>\n"
        f"<table><tr>{head}</tr>\n{''.join(rows)}</table>\n{''.join(parts)}</html>\n"
    )
    path = folder / "index.html"
    write_bytes(text.encode(), path)
    return path


def _row(row: dict[str, Any]) -> str:
    name = html.escape(row["model"])
    cells = [f'<td><a href="#{name}">{name}</a></td>']
    for key in _COLUMNS:
        value = row.get(key)
        if isinstance(value, float):
            cells.append(f'<td class="number">{value:.2f}</td>')
        else:
            cells.append(f"<td>{html.escape('' if value is None else str(value))}</td>")
    fails = ' class="fails"' if row.get("holds") is False else ""
    return f"<tr{fails}>{''.join(cells)}</tr>\n"


def _section(each: Beside, folder: Path) -> str:
    name = each.row["model"]
    pictures = dict(each.pictures)
    if "cycles" in pictures:
        apart = np.abs(pictures["glpath"].astype(int) - pictures["cycles"])
        pictures["difference"] = np.minimum(_SEEN * apart, 255).astype(np.uint8)
    shown = []
    titles = {"glpath": "glpath", "cycles": "Cycles", "difference": f"difference x {_SEEN}"}
    for kind, picture in pictures.items():
        file = f"{name}-{kind}.png"
        write_png(folder / file, picture)
        shown.append(
            f'<figure><img src="{html.escape(file)}" alt=""><figcaption>{titles[kind]}</figcaption></figure>'
        )
    said = [each.row.get("message"), each.row.get("notes")]
    notes = "".join(f"<pre>{html.escape(text)}</pre>" for text in said if text)
    return f'<h2 id="{html.escape(name)}">{html.escape(name)}</h2>\n{"".join(shown)}{notes}\n'
