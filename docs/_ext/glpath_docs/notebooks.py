"""The notebooks as pages of the site, with the results of their last run.

`make test` runs copies of the notebooks and stores them in `out/notebooks`; those in the repository have no
outputs. A stored result is shown where its code is still that of the notebook. Without one a page has the code
alone.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_LIVE = "application/vnd.jupyter.widget-view+json"
FOLDER = "tutorials"


def pages(notebooks: Path, stored: Path) -> dict[str, str]:
    """By path: each notebook, with what is stored of it."""
    found = {}
    for path in sorted(notebooks.glob("*.ipynb")):
        book = json.loads(path.read_text("utf-8"))
        found[f"{FOLDER}/{path.name}"] = json.dumps(with_results(book, stored / path.name), indent=1) + "\n"
    return found


def with_results(book: dict[str, Any], stored: Path) -> dict[str, Any]:
    """The notebook with the outputs of a run of the same code, or with none."""
    ran = None
    if stored.is_file():
        ran = json.loads(stored.read_text("utf-8"))
        if sources(ran) != sources(book):
            ran = None
    shown = [] if ran is None else [cell for cell in ran["cells"] if cell["cell_type"] == "code"]
    cells = [dict(cell) for cell in book["cells"]]
    describe_pictures(cells)
    for number, cell in enumerate(each for each in cells if each["cell_type"] == "code"):
        outputs = shown[number]["outputs"] if shown else []
        cell["outputs"] = [kept for output in outputs if (kept := shown_output(output)) is not None]
        cell["execution_count"] = shown[number]["execution_count"] if shown else None
    language = {**book["metadata"].get("language_info", {}), "pygments_lexer": "ipython3"}
    metadata = {"kernelspec": book["metadata"].get("kernelspec", {}), "language_info": language}
    return {**book, "cells": cells, "metadata": metadata}


def describe_pictures(cells: list[dict[str, Any]]) -> None:
    """Give the pictures of code cells a text for who does not see them: the heading that they stand below."""
    heading = ""
    for cell in cells:
        if cell["cell_type"] == "code":
            cell["metadata"] = {"mystnb": {"image": {"alt": f"Picture: {heading}"}}}
        else:
            found = re.findall(r"^#+ +(.+)$", "".join(cell["source"]), re.MULTILINE)
            heading = found[-1] if found else heading


def sources(book: Mapping[str, Any]) -> list[str]:
    """The code of a notebook, cell by cell."""
    return ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]


def shown_output(output: Mapping[str, Any]) -> dict[str, Any] | None:
    """An output as a page shows it; None for what needs a kernel, or is of the machine that ran it."""
    if output.get("name") == "stderr":
        return None
    data = dict(output.get("data", {}))
    if data:
        live = data.pop(_LIVE, None)
        if live is not None and not any(kind.startswith("image/") for kind in data):
            return None
        return {**output, "data": data}
    if "text" in output:
        # Kernels are compiled once a machine, and say so.
        text = re.sub(r"^compiling for this CPU.*\n", "", "".join(output["text"]), flags=re.MULTILINE)
        return {**output, "text": text} if text else None
    return dict(output)
