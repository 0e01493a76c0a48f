"""The table of shader variants: it declares all that shaders ask for, and says truly who sets it."""

from __future__ import annotations

import re
import runpy

import pytest

from glpath.gl.context import get_context
from glpath.gl.program import load_program
from glpath.gl.variants import VALUES, VARIANTS, defined
from tests.support.repository import ROOT

tables = runpy.run_path(str(ROOT / ".ci" / "tables.py"))


def test_every_name_that_a_shader_asks_for_is_declared_and_every_declared_one_asked_for() -> None:
    asked = tables["asked_for"]()
    assert set(asked) == set(VARIANTS)


def test_every_value_is_used_by_a_shader() -> None:
    text = "\n".join(path.read_text() for path in (ROOT / "shaders").rglob("*.*"))
    assert not {name for name in VALUES if not re.search(rf"\b{name}\b", text)}


@pytest.mark.parametrize("name", VARIANTS)
def test_who_is_said_to_set_a_variant_has_its_name(name: str) -> None:
    set_by = VARIANTS[name].set_by
    if set_by == "shaders":
        text = "\n".join(path.read_text() for path in (ROOT / "shaders").rglob("*.*"))
        assert re.search(rf"#define {name}\b", text)
        return
    text = (ROOT / "glpath" / f"{set_by.replace('.', '/')}.py").read_text()
    made = {"HAS_": 'f"HAS_{kind.upper()}S"', "KIND_": 'f"KIND_{kind.upper()}"', "EYE_": 'f"EYE_{camera'}
    computed = [expression for prefix, expression in made.items() if name.startswith(prefix)]
    assert re.search(rf"\b{name}\b", text) or any(expression in text for expression in computed)


def test_what_is_not_declared_is_refused() -> None:
    gl = get_context().gl
    with pytest.raises(AssertionError, match="HAS_WINGS"):
        load_program(gl, vertex="gl/fullscreen.vert", fragment="film/aov.frag", defines={"HAS_WINGS": 1})
    with pytest.raises(AssertionError, match="HAS_SKY"):
        load_program(gl, vertex="gl/fullscreen.vert", fragment="film/aov.frag", defines={"HAS_SKY": False})
    with pytest.raises(AssertionError, match="HAS_WINGS"):
        defined(HAS_WINGS=True)
    assert defined(HAS_SKY=False, HAS_ALPHA=True) == {"HAS_ALPHA": 1}


@pytest.mark.parametrize(("page", "name"), tables["TABLES"])
def test_the_documentation_has_the_tables(page: str, name: str) -> None:
    text = (ROOT / page).read_text()
    assert tables["with_table"](page, name, text) == text, "python .ci/tables.py writes it"
