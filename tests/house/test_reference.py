"""The reference is made from the code, and has all that the code has."""

from __future__ import annotations

import dataclasses
import importlib
import json
import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import typer

import glpath
from glpath.cli.commands import COMMANDS
from glpath.cli.main import app
from glpath.cli.records import EndRecord, ProgressRecord, RenderStats
from glpath.cli.signals import INTERRUPTED, RESUME_LATER
from glpath.integrators.by_name import INTEGRATORS
from glpath.io import scene_schema
from glpath.rendering import RenderJob
from glpath.rendering.options import settings_of
from glpath_docs import (
    commands,
    engines,
    environment,
    exit_codes,
    extras,
    file_formats,
    python_api,
    records,
    scene_format,
)
from glpath_docs.results import MissingResultError, columns_of, results_table
from tests.support.command_line import run
from tests.support.repository import ROOT

GROUP: Any = typer.main.get_command(app)


# ---- commands ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def command_pages() -> Mapping[str, str]:
    return commands.pages()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_all_of_its_options_and_examples(command_pages: Mapping[str, str], name: str) -> None:
    page = command_pages[f"reference/commands/{name}.md"]
    command = GROUP.commands[name]
    for parameter in command.params:
        if parameter.param_type_name == "option":
            assert re.search(rf"^:::{{option}} .*{re.escape(parameter.opts[-1])}\b", page, re.MULTILINE), (
                parameter.opts
            )
    for line, _ in command.examples:
        assert line in page


def test_defaults_are_sentences(command_pages: Mapping[str, str]) -> None:
    assert "Default: `auto`." in command_pages["reference/commands/render.md"]
    assert commands.help_of("How many.  [default: 3; x>=1]") == "How many. Default: `3`. Range: `x>=1`."
    assert commands.help_of("Where.  [required]") == "Where. Required."
    assert commands.help_of("An option [of two].") == "An option [of two]."
    assert commands.help_of("Of --max-depth, `--a *` or x--y * 2.") == "Of `--max-depth`, `--a *` or x--y \\* 2."


# ---- the scene format --------------------------------------------------------------------------------------------


def test_each_part_of_the_scene_format_is_there_once() -> None:
    listed = Counter(name for names in scene_format.TASKS.values() for name in names)
    assert listed == Counter(dict.fromkeys(scene_schema()["$defs"], 1))


def test_the_scene_format_has_every_key() -> None:
    page = scene_format.page(scene_schema())
    for name, found in scene_schema()["$defs"].items():
        section = page.partition(f"\n### {name}\n")[2].partition("\n### ")[0]
        for key in found["properties"]:
            assert f"| `{key}` |" in section, f"{name}.{key}"


# ---- Python ------------------------------------------------------------------------------------------------------


def test_each_public_name_is_on_one_page() -> None:
    listed = Counter(name for task in python_api.TASKS for name in python_api.names_of(task))
    assert set(listed.values()) == {1}
    homes: dict[int, set[str]] = {}
    for module, name in listed:
        homes.setdefault(id(getattr(importlib.import_module(module), name)), set()).add(name)
    for module in python_api.PUBLIC:
        for name in importlib.import_module(module).__all__:
            value = getattr(importlib.import_module(module), name)
            assert (module, name) in listed or name in homes.get(id(value), ()), f"{module}.{name}"


def test_all_that_is_public_says_what_it_is() -> None:
    for task in python_api.TASKS:
        for module, name in python_api.names_of(task):
            assert python_api.first_sentence(getattr(importlib.import_module(module), name)), f"{module}.{name}"


def test_every_parameter_of_render_is_a_field() -> None:
    lines = python_api.docstring("function", (glpath.render.__doc__ or "").splitlines())
    for name in ("scene", "spp", "shadow_test", "shadow_filter", "secondary", "count_tests", "progress"):
        assert any(line.startswith(f":param {name}: ") for line in lines), name


def test_columns_become_fields_and_the_rest_stays() -> None:
    docstring = (
        "What it is: `prose`.\n\nParameters\n----------\nspp    : samples, and\n         more of *them*\n"
        "first, second : of two\n\nCost: little,\n      as a rule\n\nExample\n-------\n>>> 1 + 1\n2\n\nEnd."
    )
    assert [line for line in python_api.docstring("function", docstring.splitlines()) if line] == [
        "What it is: ``prose``.",
        ":param spp: samples, and more of \\*them\\*",
        ":param first: of two",
        ":param second: of two",
        "**Cost:** little, as a rule",
        ".. rubric:: Example",
        ">>> 1 + 1",
        "2",
        "End.",
    ]


# ---- integrators -------------------------------------------------------------------------------------------------


def test_the_table_of_integrators_asks_the_code_that_refuses() -> None:
    by_name = {feature.name: feature.made() for each in engines.FEATURES.values() for feature in each}
    refused = {
        (feature, title)
        for feature in ("endless planes", "glass", "panorama", "diffuse")
        for title in ("path", "path-buffer", "t-buffer")
        if engines.refusal(by_name[feature], settings_of(title, {})) is not None
    }
    assert refused == {
        ("endless planes", "path"),
        ("endless planes", "path-buffer"),
        ("glass", "path-buffer"),
        ("glass", "t-buffer"),
        ("panorama", "t-buffer"),
    }


def test_every_integrator_is_a_column() -> None:
    assert {name for name, _ in engines.ENGINES} == set(INTEGRATORS)


def test_each_error_of_the_table_stands_below_it() -> None:
    page = engines.pages()["reference/integrators.md"]
    numbers = {int(number) for number in re.findall(r"\| no\s\((\d+)\)", page)}
    assert numbers == {int(number) for number in re.findall(r"^(\d+)\. `", page, re.MULTILINE)}
    assert len(numbers) > 5


# ---- exit codes, variables, extras, files ------------------------------------------------------------------------


def test_exit_codes_are_those_of_the_code() -> None:
    page = exit_codes.pages()["reference/exit-codes.md"]
    for code in (0, 1, 2, 3, RESUME_LATER, INTERRUPTED, 134):
        assert f"| `{code}` |" in page
    assert exit_codes.codes_of("Exit codes: 0 done, 2 bad, or worse, 75 later (with --resume).") == {
        0: "done",
        2: "bad, or worse",
        75: "later (with --resume)",
    }


def test_the_table_of_variables_has_all_that_the_code_reads() -> None:
    read = environment.of_package(ROOT / "glpath")
    assert set(read) == {*environment.GLPATH, *environment.OTHERS}


def test_a_variable_that_code_reads_is_found() -> None:
    source = (
        "import os\nos.environ.get('A')\nos.environ['B'] = '1'\nos.getenv('C', '')\n"
        "d = [os.environ[k] for k in ('D', 'E') if os.environ.get(k)]\n"
    )
    assert set(environment.read_by(source)) == {"A", "B", "C", "D", "E"}
    with pytest.raises(ValueError, match="looks up name"):
        list(environment.read_by("import os\nos.environ.get(name)\n"))


def test_every_extra_is_described() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert {*extras.MEANINGS, *extras.FOR_DEVELOPERS} == set(project["optional-dependencies"])


def test_every_command_that_writes_says_what() -> None:
    page = file_formats.pages()["reference/file-formats.md"]
    for name in COMMANDS:
        if any("--out" in parameter.opts for parameter in GROUP.commands[name].params):
            assert f"glpath {name}" in page


# ---- JSON --------------------------------------------------------------------------------------------------------


def test_what_a_render_writes_is_what_the_reference_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options = ("--spp", "4", "--resolution", "16x16", "--stats", "stats.json", "--progress", "json")
    done = run("render", "cornell-box-36", "-o", "a.npz", *options)
    assert done.exit_code == 0, done.output
    lines = [json.loads(line) for line in done.output.splitlines() if line.startswith("{")]
    found = [(RenderStats, json.loads(Path("stats.json").read_text())), (EndRecord, lines[-1])]
    found += [(ProgressRecord, line) for line in lines[:-1]]
    assert len(found) > 2
    for record, value in found:
        assert set(value) == set(get_type_hints(record)), record.__name__


def test_a_job_has_the_keys_of_the_reference() -> None:
    job = json.loads(RenderJob.of("cornell-box-36", spp=1).to_json())
    described = records.schema(records.RECORDS["job-files"][1])["$defs"]
    assert set(job) == set(described["JobFile"]["properties"])
    assert set(job["sensor"]) <= {*described["CameraFile"]["properties"], "type"}
    settings = {field.name for field in dataclasses.fields(INTEGRATORS[job["integrator"]["name"]])}
    assert set(job["integrator"]) <= {"name", *settings}


# ---- tables of numbers -------------------------------------------------------------------------------------------


@pytest.fixture
def results(tmp_path: Path) -> Path:
    stored = {
        "name": "speed",
        "claim": "it is fast",
        "measured": {"ours_s": 0.123, "theirs_s": 4.0},
        "holds": True,
        "rows": [{"size": 1, "s": 0.5}, {"size": 2, "s": 1.5}],
        "machine": {"renderer": "llvmpipe", "cpu": "a CPU", "cores": 2},
        "versions": {"glpath": "0.1.0"},
    }
    (tmp_path / "speed.json").write_text(json.dumps(stored))
    return tmp_path


def test_a_table_has_the_numbers_of_the_result_and_its_machine(results: Path) -> None:
    made = results_table(["speed"], columns_of(["ours, s: ours_s .2f", "holds: holds"]), False, results)
    assert "| 0.12 | yes |" in made
    assert "Measured on 2 cores of a CPU, llvmpipe, glpath 0.1.0." in made
    other = (results / "speed.json").read_text("utf-8").replace("a CPU", "another")
    (results / "again.json").write_text(other)
    made = results_table(["speed", "again"], columns_of(["name: name"]), False, results)
    assert "Measured on 2 cores of a CPU, llvmpipe, glpath 0.1.0; and on 2 cores of another, llvmp" in made
    assert "| 2 | 1.5 |" in results_table(["speed"], columns_of(["n: size", "s: s .1f"]), True, results)


def test_a_number_that_could_not_be_measured_is_a_dash_and_keys_may_have_blanks(tmp_path: Path) -> None:
    stored = {"measured": {"s to 5 %": None, "s to 40 %": 12.3}, "machine": {"cpu": "a CPU"}, "versions": {}}
    (tmp_path / "speed.json").write_text(json.dumps(stored))
    columns = columns_of(['a: "s to 40 %" .0f', 'b: "s to 5 %" .0f'])
    assert "| 12 | \u2013 |" in results_table(["speed"], columns, False, tmp_path)


@pytest.mark.parametrize(
    ("name", "columns", "words"),
    [
        ("absent", "s: ours_s", "absent.json: is not in"),
        ("speed", "s: other_s", "has no 'other_s'. It has: claim, cpu, holds, name, ours_s, theirs_s"),
        ("speed", "s ours_s", "each line is"),
    ],
)
def test_a_table_without_data_is_an_error(results: Path, name: str, columns: str, words: str) -> None:
    with pytest.raises(MissingResultError, match=re.escape(words)):
        results_table([name], columns_of([columns]), False, results)
