"""The notebooks: what they import, what the site shows of them, and that each runs with what it says to install."""

from __future__ import annotations

import ast
import importlib
import json
import re
import shlex
import subprocess
import sys
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from glpath_docs.notebooks import with_results
from glpath_docs.python_api import PUBLIC
from tests.support.repository import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))

named = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)


def cells(notebook: Path, kind: str) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(notebook.read_text("utf-8"))["cells"] if cell["cell_type"] == kind]


def requirements(notebook: Path) -> list[str]:
    """What the notebook says to install, as pip's arguments."""
    text = "".join(cells(notebook, "markdown")[0]["source"])
    found = re.search(r"`pip install ([^`]+)`", text)
    assert found, "the first cell says what to install"
    return shlex.split(found[1])


def imports(notebook: Path) -> Iterator[tuple[str, str]]:
    """(module, name) of all that is imported from glpath; the name is empty where a module is."""
    for cell in cells(notebook, "code"):
        lines = [line for line in cell["source"] if not line.startswith(("%", "!"))]
        for node in ast.walk(ast.parse("".join(lines))):
            if isinstance(node, ast.Import):
                yield from ((alias.name, "") for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield from ((node.module or "", alias.name) for alias in node.names)


@named
def test_a_notebook_imports_what_is_public(notebook: Path) -> None:
    for module, name in imports(notebook):
        if module.split(".")[0] != "glpath":
            continue
        assert module in PUBLIC, f"from {module} import {name}"
        assert not name or name in importlib.import_module(module).__all__, f"from {module} import {name}"


@named
def test_a_notebook_begins_with_what_one_learns_and_its_time(notebook: Path) -> None:
    text = " ".join("".join(cells(notebook, "markdown")[0]["source"]).split())
    assert re.search(r"\*\*You learn\*\* .*\*\*Time\*\*: .* to read", text)


@named
def test_a_notebook_has_what_was_typed_alone(notebook: Path) -> None:
    """Outputs are of a run and a machine; `python .ci/notebooks.py` takes them out."""
    book = json.loads(notebook.read_text("utf-8"))
    assert set(book["metadata"]) == {"kernelspec", "language_info"}, "widget states stay out"
    for cell in book["cells"]:
        assert cell["metadata"] == {}
    for cell in cells(notebook, "code"):
        assert cell["outputs"] == []
        assert cell["execution_count"] is None


def test_the_lightmap_ends_with_the_lines_for_three_js_of_the_documentation() -> None:
    """`tests/apps/lightmap/test_lightmap_seen.py` runs both."""
    page = "".join("".join(cell["source"]) for cell in cells(ROOT / "notebooks" / "09_lightmap.ipynb", "code"))
    guide = (ROOT / "docs" / "howto" / "lightmap-threejs.md").read_text("utf-8")
    (lines,) = re.findall(r"```js\n(.*?)```", guide, re.DOTALL)
    assert lines in page


# ---- as pages of the site ----------------------------------------------------------------------------------------

TYPED: dict[str, Any] = {
    "cells": [
        {"cell_type": "markdown", "source": ["# A title"], "metadata": {}},
        {"cell_type": "code", "source": ["1 + 1"], "metadata": {}, "outputs": [], "execution_count": None},
    ],
    "metadata": {"kernelspec": {"name": "python3"}, "language_info": {"name": "python"}},
}
LIVE = "application/vnd.jupyter.widget-view+json"


def stored(folder: Path, outputs: list[dict[str, Any]], source: str = "1 + 1") -> Path:
    """A notebook that was run."""
    book = json.loads(json.dumps(TYPED))
    book["cells"][1] |= {"source": source, "outputs": outputs, "execution_count": 1}
    (folder / "run.ipynb").write_text(json.dumps(book))
    return folder / "run.ipynb"


def test_a_page_shows_the_results_of_the_same_code(tmp_path: Path) -> None:
    result = {"output_type": "execute_result", "data": {"text/plain": "2"}, "metadata": {}}
    found = with_results(TYPED, stored(tmp_path, [result]))
    assert found["cells"][1]["outputs"] == [result]
    assert found["cells"][1]["execution_count"] == 1
    assert found["cells"][1]["metadata"] == {"mystnb": {"image": {"alt": "Picture: A title"}}}


def test_results_of_other_code_are_not_shown(tmp_path: Path) -> None:
    output = {"output_type": "stream", "name": "stdout", "text": "3"}
    found = with_results(TYPED, stored(tmp_path, [output], "1 + 2"))
    assert found["cells"][1]["outputs"] == []
    assert with_results(TYPED, tmp_path / "absent.ipynb")["cells"][1]["outputs"] == []


def test_a_page_has_nothing_of_the_machine_or_of_a_kernel(tmp_path: Path) -> None:
    outputs = [
        {"output_type": "stream", "name": "stderr", "text": "a warning of /somebody/else.py"},
        {"output_type": "stream", "name": "stdout", "text": ["compiling for this CPU, once\n", "42\n"]},
        {"output_type": "display_data", "data": {LIVE: {"model_id": "1"}}, "metadata": {}},
        {"output_type": "display_data", "data": {LIVE: {}, "image/png": "AAAA"}, "metadata": {}},
    ]
    first, second = with_results(TYPED, stored(tmp_path, outputs))["cells"][1]["outputs"]
    assert first["text"] == "42\n"
    assert second["data"] == {"image/png": "AAAA"}


# ---- in environments of their own --------------------------------------------------------------------------------

REQUIREMENTS = sorted({tuple(requirements(notebook)) for notebook in NOTEBOOKS}, key=len)


def pip(python: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(python), "-m", "pip", "--disable-pip-version-check", "-q", *arguments],
        capture_output=True,
        text=True,
        timeout=600,
    )


@pytest.mark.evidence
@pytest.mark.release
def test_each_notebook_runs_with_no_more_than_it_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One environment, in which more and more is installed: the least first, and what that is enough for."""
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.delenv("PYTHONPATH", raising=False)
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / "bin" / "python"
    wheel = pip(Path(sys.executable), "wheel", "--no-deps", "-w", str(tmp_path), str(ROOT))
    assert wheel.returncode == 0, wheel.stderr
    (built,) = tmp_path.glob("glpath-*.whl")
    spec = tmp_path / "share" / "kernels" / "only"
    spec.mkdir(parents=True)
    argv = [str(python), "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    (spec / "kernel.json").write_text(json.dumps({"argv": argv, "display_name": "only", "language": "python"}))
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "share"))

    for wanted in [("glpath",), *REQUIREMENTS]:
        installed = pip(python, "install", *(w.replace("glpath", f"{built}", 1) for w in wanted))
        assert installed.returncode == 0, installed.stderr
        if wanted == ("glpath",):
            command = [str(python), "-m", "glpath", "render", "furnace", "-o", "a.png", "--spp", "4", "--quiet"]
            subprocess.run(command, cwd=tmp_path, check=True, timeout=300)
        for notebook in NOTEBOOKS:
            if tuple(requirements(notebook)) != wanted:
                continue
            book = nbformat.read(notebook, 4)
            place = {"metadata": {"path": tmp_path}}
            NotebookClient(book, kernel_name="only", timeout=240, startup_timeout=240, resources=place).execute()
