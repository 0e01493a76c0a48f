"""Report of a pytest run: one self-contained HTML file, or JSON for programs.

The page is `report.html` in this package. The comparisons are inserted as JSON, and images as data URIs.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Mapping, Sequence
from importlib import import_module, resources
from pathlib import Path
from typing import Any

from glpath.system.files import whole_file
from glpath.system.versions import versions

_RECORDS = "/*RECORDS*/"


def write_report(folder: Path, kind: str, records: Sequence[Mapping[str, Any]], unused: Sequence[str]) -> Path:
    """Write report.html or report.json into `folder`, the worst failure first, and return its path.

    A .gitignore that ignores the folder is written too. Raises ImageError if the system reports an error.
    """
    # Failures first, then the others; each part by severity, so that nearly failed comparisons lead the second.
    ordered = sorted(records, key=lambda r: (r["outcome"] not in ("failed", "missing"), -r["severity"], r["test"]))
    content: dict[str, Any] = {
        "versions": versions("glpath", "flip-evaluator", "pytest"),
        "records": ordered,
        "unused_baselines": list(unused),
    }
    ignore = folder / ".gitignore"
    if not os.path.exists(ignore):
        with whole_file(ignore) as temporary:
            temporary.write_text("*\n")
    path = folder / f"report.{kind}"
    if kind == "json":
        text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    else:
        content["records"] = [{**record, "pictures": _embedded(record["files"])} for record in ordered]
        page = resources.files(__package__).joinpath("report.html").read_text(encoding="utf-8")
        # "<" would let a name like "</script>" end the script.
        text = page.replace(_RECORDS, json.dumps(content, allow_nan=False).replace("<", "\\u003c"))
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def extras_of(records: Sequence[Mapping[str, Any]]) -> list[Any]:
    """Return the stored images for the report of pytest-html, in the order of the records."""
    extras = import_module("pytest_html").extras  # already loaded by the caller
    return [
        extras.png(base64.b64encode(Path(path).read_bytes()).decode("ascii"), f"{record['picture']}: {kind}")
        for record in records
        for kind, path in record["files"].items()
        if os.path.isfile(path)
    ]


def _embedded(files: Mapping[str, str]) -> dict[str, str]:
    found = {}
    for kind, path in files.items():
        try:
            data = Path(path).read_bytes()
        except OSError:
            continue  # the file may be on a worker's machine; the report shows the available images
        found[kind] = f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"
    return found
