"""The README: one screen, links that lead somewhere, and blocks that do what they say."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

import tests.support.preloaded  # noqa: F401
from glpath.film.image import read_image
from tests.support.code_blocks import LAMP, PAGES
from tests.support.command_line import run
from tests.support.repository import ROOT

pytest_plugins = ["pytester"]

README = (ROOT / "README.md").read_text(encoding="utf-8")
EXPLAINED = sorted((ROOT / "docs/explanation").glob("*.md"))
GUIDES = sorted((ROOT / "docs/howto").glob("*.md"))


def blocks(title: str, kind: str) -> str:
    """What a section of the README has of a kind of block, together."""
    section = README.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    return "\n".join(re.findall(rf"```{kind}\n(.*?)```", section, re.DOTALL))


def run_commands(lines: str, *also: str) -> None:
    """Run each `glpath` of a shell block as it is typed; what installs and pytest's own are other tests'.

    also : options after what is typed, for a smaller picture
    """
    commands = [shlex.split(line, comments=True) for line in lines.splitlines() if line.startswith("glpath ")]
    assert commands
    for command in commands:
        result = run(*command[1:], *also)
        assert result.exit_code == 0, f"{command}: {result.output}"
        for option, value in pairwise(command):
            assert option != "-o" or Path(value).stat().st_size > 0, value


def test_the_readme_has_at_most_200_lines() -> None:
    assert README.count("\n") <= 200


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    """Of the repository; `test_docs.py` looks at those within the site."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)]+)\)", text):
        file = (page.parent / target.partition("#")[0]).resolve()
        if not target.startswith("http") and (page.name == "README.md" or ROOT / "docs" not in file.parents):
            assert file.exists(), f"{page.name}: {target}"


def test_every_page_is_reached_from_the_readme() -> None:
    for page in EXPLAINED:
        assert f"(docs/explanation/{page.name})" in README, page.name
    assert "(docs/howto/index.md)" in README
    guides = (ROOT / "docs/howto/index.md").read_text(encoding="utf-8")
    for page in GUIDES:
        assert page.name == "index.md" or f"({page.name})" in guides, page.name


def test_the_first_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """But of fewer samples."""
    monkeypatch.chdir(tmp_path)
    code = blocks("First picture", "python")
    assert "spp=64" in code
    exec(compile(code.replace("spp=64", "spp=4"), "README.md", "exec"), {})
    assert read_image(tmp_path / "cornell-box.png").shape == (512, 512, 3)


def test_the_lightmap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_commands(blocks("A lightmap for three.js", "sh"), "--size", "128", "--spp", "8")
    assert (tmp_path / "baked-0.lightmap.exr").is_file()
    # `tests/apps/lightmap/test_lightmap_seen.py` runs the lines for three.js, which stand on a page of docs/, too.
    lines = blocks("A lightmap for three.js", "js")
    assert any(lines in page.read_text(encoding="utf-8") for page in PAGES[1:])


def test_lux_of_an_obj_with_an_ies_lamp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box([6, 3, 4]).export("room.obj")
    Path("lamp.ies").write_text(LAMP)
    Path("room.toml").write_text(blocks("Lux of an OBJ with an IES lamp", "toml"))
    run_commands(blocks("Lux of an OBJ with an IES lamp", "sh"))


def test_view_factors_of_an_stl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box([6, 3, 4]).export("hall.stl")
    run_commands(blocks("View factors of an STL", "sh"))
    exec(compile(blocks("View factors of an STL", "python"), "README.md", "exec"), {})


def test_a_long_render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_commands(blocks("Long renders", "sh"), "--resolution", "96x96")


def test_image_tests(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib.pyplot")  # pytester unloads what a run of its own has loaded
    monkeypatch.delenv("CI", raising=False)
    pytester.makepyfile("import matplotlib\nmatplotlib.use('Agg')\n" + blocks("Image tests in CI", "python"))
    for arguments in ((), ("--glpath-update", "failed")):
        pytester.runpytest(*arguments).assert_outcomes(passed=1)
    monkeypatch.setenv("CI", "1")
    pytester.runpytest().assert_outcomes(passed=1)


@pytest.mark.evidence
def test_the_four_pictures_are_what_their_commands_make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for what no eye sees: processors round differently, and a mirror that a denoiser blurred made 3.7e-3."""
    monkeypatch.chdir(tmp_path)
    run_commands(README.partition("The four pictures are made by these commands")[2].partition("\n## ")[0])
    made = sorted(tmp_path.glob("*.png"))
    assert len(made) == 4
    for picture in made:
        shown = read_image(ROOT / "docs" / "images" / picture.name)
        assert np.sqrt(np.mean((read_image(picture) - shown) ** 2)) < 3e-3, picture.name
