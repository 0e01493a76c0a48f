"""Take outputs out of notebooks, before a commit: `python .ci/notebooks.py [FILE ...]`, or all.

What they show is of one run on one machine: `make test` runs them and stores that in out/notebooks, for the site.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import nbformat

ROOT = Path(__file__).parent.parent
LANGUAGE = {"name": "python", "file_extension": ".py", "mimetype": "text/x-python"}
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def without_outputs(book: Any) -> Any:
    """The notebook with what was typed alone."""
    book.metadata = {"kernelspec": KERNEL, "language_info": LANGUAGE}
    for cell in book.cells:
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    return book


if __name__ == "__main__":
    for each in map(Path, sys.argv[1:] or sorted((ROOT / "notebooks").glob("*.ipynb"))):
        nbformat.write(without_outputs(nbformat.read(each, 4)), each)
