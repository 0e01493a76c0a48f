"""Docstrings: their examples run, and they become readable pages."""

from __future__ import annotations

import doctest
import importlib
import importlib.util
import inspect
import pkgutil
from pathlib import Path
from types import ModuleType

import pytest

import glpath
from tests.support.repository import ROOT


def _docs() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs", ROOT / ".ci" / "docs.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _with_examples() -> list[str]:
    folder = Path(glpath.__path__[0])
    names = (module.name for module in pkgutil.walk_packages([str(folder)], "glpath."))
    files = {name: folder.parent.joinpath(*name.split(".")) for name in names}
    sources = {n: f / "__init__.py" if f.is_dir() else f.with_suffix(".py") for n, f in files.items()}
    return [name for name, source in sources.items() if ">>> " in source.read_text(encoding="utf-8")]


@pytest.mark.parametrize("name", _with_examples())
def test_examples_of_docstrings_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)
    assert result.attempted > 0
    assert result.failed == 0


def test_every_parameter_of_render_is_a_line_of_its_own() -> None:
    page = _docs().markdown(inspect.getdoc(glpath.render))
    for name in ("scene", "spp", "shadow_test", "shadow_filter", "secondary", "count_tests", "progress"):
        assert f"\n- **{name}**: " in page
    assert "shadow_filter :" not in page


def test_columns_become_lists_and_the_rest_stays() -> None:
    docstring = (
        "What it is: prose.\n\nParameters\n----------\nspp    : samples, and\n         more of them\n"
        "first, second : of two\n\nCost: little,\n      as a rule\n\nExample\n-------\n>>> 1 + 1\n2\n\nEnd."
    )
    assert _docs().markdown(docstring) == (
        "What it is: prose.\n\n###### Parameters\n\n- **spp**: samples, and more of them\n"
        "- **first, second**: of two\n\n**Cost**: little, as a rule\n\n###### Example\n\n"
        "```python\n>>> 1 + 1\n2\n```\n\nEnd."
    )


def test_all_that_is_public_is_documented() -> None:
    """Each name of `glpath` has a docstring, and its module a page."""
    pages = _docs().documented()
    for name in glpath.__all__:
        value = getattr(glpath, name)
        if name != "__version__":
            assert value.__doc__, name
            assert value.__module__ in pages, name
