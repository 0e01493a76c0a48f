"""The notebooks: what they import, what they keep, and that each runs with no more than it says to install."""

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

from tests.support.repository import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))

#: What users import from; the public names of each are its `__all__`.
PUBLIC = (
    "glpath",
    "glpath.buffers",
    "glpath.compare",
    "glpath.gl",
    "glpath.film.image",
    "glpath.notebook",
    "glpath.radiosity",
    "glpath.rendering",
    "glpath.scene",
)

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
    text = "".join(cells(notebook, "markdown")[0]["source"])
    assert re.search(r"\*\*You learn\*\* .*\*\*Time\*\*: .* to read", text, re.DOTALL)


@named
def test_a_notebook_keeps_its_pictures_and_nothing_of_the_machine(notebook: Path) -> None:
    book = json.loads(notebook.read_text("utf-8"))
    assert set(book["metadata"]) == {"kernelspec", "language_info"}, "widget states stay out"
    pictures = 0
    for cell in cells(notebook, "code"):
        assert cell["metadata"] == {}
        for output in cell["outputs"]:
            assert output["output_type"] != "error", output
            assert output.get("name") != "stderr" or "SceneWarning" in "".join(output["text"])
            data = output.get("data", {})
            pictures += "image/png" in data
            shown = json.dumps({k: v for k, v in data.items() if k != "image/png"} | {"t": output.get("text")})
            assert not re.search(r"/(home|root|tmp|work)/", shown), shown[:500]
            assert not [kind for kind in data if "widget-view" in kind and "image/png" not in data]
    assert pictures


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
