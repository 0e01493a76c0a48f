"""Run notebooks in place, and keep what a reader wants of them: `python .ci/notebooks.py [FILE ...]`, or all.

Outputs stay, with the pictures; what is of the machine or of the run goes: times, widget states, paths.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parent.parent
LIVE = "application/vnd.jupyter.widget-view+json"
LANGUAGE = {"name": "python", "file_extension": ".py", "mimetype": "text/x-python"}
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def run(path: Path) -> None:
    """Execute the notebook and write it back."""
    book = nbformat.read(path, 4)
    NotebookClient(book, timeout=240, startup_timeout=240, kernel_name="python3").execute()
    book.metadata = {"kernelspec": KERNEL, "language_info": LANGUAGE}
    for cell in book.cells:
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs = [output for output in map(_cleaned, cell.outputs) if output]
    nbformat.write(book, path)


def _cleaned(output: Any) -> Any:
    data = output.get("data", {})
    if LIVE in data and "image/png" not in data:
        return None  # the live view's outlet for errors
    if "text" in output:
        # A warning's place is a file of the kernel's own; kernels are compiled once a machine.
        output.text = re.sub(r"^/\S+\.py:\d+: |^compiling for this CPU.*\n", "", output.text, flags=re.MULTILINE)
        return output if output.text else None
    return output


if __name__ == "__main__":
    os.environ["PYTHONPATH"] = str(ROOT)
    for each in sys.argv[1:] or sorted((ROOT / "notebooks").glob("*.ipynb")):
        print(each, flush=True)
        run(Path(each))
