"""Docstrings, whose examples run, and the site, which builds without a warning."""

from __future__ import annotations

import doctest
import importlib
import os
import pkgutil
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

import glpath
from benchmarks.gallery_command import IMAGES, MAX_BYTES, PICTURES, Picture, made
from glpath_docs import gallery
from glpath_docs.links import for_site
from glpath_docs.site import with_list, without_empty_globs
from tests.support.repository import ROOT


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


# ---- the changelog -----------------------------------------------------------------------------------------------


def test_the_changelog_has_the_form_of_keep_a_changelog() -> None:
    """Version 1.1.0: the newest release first, each with a date, and six kinds of changes."""
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert text.startswith("# Changelog\n")
    releases = re.findall(r"^## (.+)$", text, re.MULTILINE)
    assert releases[0] == "[Unreleased]"
    assert [each for each in releases[1:] if not re.fullmatch(r"\[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d", each)] == []
    for release in re.split(r"^## .+$", text, flags=re.MULTILINE)[1:]:
        kinds = re.findall(r"^### (.+)$", release, re.MULTILINE)
        assert len(set(kinds)) == len(kinds)
        assert set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


# ---- links -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("link", "shown"),
    [
        ("[a](../../notebooks/01_first_picture.ipynb)", "[a](../tutorials/01_first_picture.ipynb)"),
        ("[a](../../CHANGELOG.md#unreleased)", "[a](../changelog.md#unreleased)"),
        ("[a](../../README.md)", "[a](../index.md)"),
        ("[a](../reference/glossary.md#x)", "[a](../reference/glossary.md#x)"),
        ("![a](../images/room.png)", "![a](../images/room.png)"),
        ("[the shader](../../shaders/bsdf/bsdf.glsl)", "the shader (`shaders/bsdf/bsdf.glsl`)"),
        ("[`notebooks/`](../../notebooks)", "`notebooks/`"),
        ("[a](https://example.org/a) and [b](#here)", "[a](https://example.org/a) and [b](#here)"),
        ("```sh\n[a](../../README.md)\n```", "```sh\n[a](../../README.md)\n```"),
    ],
)
def test_links_of_the_repository_become_links_of_the_site(link: str, shown: str) -> None:
    assert for_site(link, "docs/howto/files.md", "howto/files.md") == shown


def test_the_first_page_of_a_folder_lists_its_pages_in_the_order_of_its_links() -> None:
    text = "# Guides\n\n[b](b.md), [a](a.md), [b](b.md), [other](../other.md)\n"
    assert with_list(text).endswith("```{toctree}\n:hidden:\n\nb\na\n```\n")
    assert with_list(text + "```{toctree}\n```\n") == text + "```{toctree}\n```\n"


def test_lists_of_empty_folders_are_left_out() -> None:
    text = "```{toctree}\n:glob:\n\ngallery\n*\nhowto/*\nfull/*\n```\n"
    names = ["index.md", "gallery.md", "full/a.md", "full/a.png"]
    assert without_empty_globs(text, names) == "```{toctree}\n:glob:\n\ngallery\nfull/*\n```\n"
    assert without_empty_globs(text, [*names, "b.md", "howto/c.ipynb"]) == text


# ---- the site ----------------------------------------------------------------------------------------------------


def test_the_site_builds_without_a_warning_and_no_link_is_dead(tmp_path: Path) -> None:
    """In a process of its own, as Sphinx sets much for good. A warning is an error."""
    code = (
        "import sys; from pathlib import Path; from glpath_docs.site import build\n"
        "sys.exit(build(*map(Path, sys.argv[1:])))"
    )
    folders = [tmp_path / "html", tmp_path / "work", ROOT / "out" / "notebooks"]
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, folders)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "docs" / "_ext")])},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert dead_links(folders[0]) == []


class _Links(HTMLParser):
    """Targets and anchors of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name in ("href", "src"):
                self.targets.add(value)
            elif value and name == "id":
                self.anchors.add(value)


def dead_links(folder: Path) -> list[str]:
    """Links within a site that lead nowhere, and what its pages load and it does not have."""
    pages = {path: _Links() for path in folder.rglob("*.html")}
    for path, found in pages.items():
        found.feed(path.read_text("utf-8"))
    dead = []
    for path, found in pages.items():
        for target in found.targets:
            file, _, anchor = unquote(target).partition("#")
            if re.match(r"[a-z]+:", file):
                continue
            there = (path.parent / file.partition("?")[0]).resolve() if file else path
            known = pages.get(there)
            if not there.exists() or (anchor and known is not None and anchor not in known.anchors):
                dead.append(f"{path.relative_to(folder)}: {target}")
    return dead


def test_a_dead_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<a id="x" href="b.html#y"><img src="c.png"><a href="#z"><a href="b.html">')
    (tmp_path / "b.html").write_text('<a href="a.html#x"><a href="https://example.org">')
    assert sorted(dead_links(tmp_path)) == ["a.html: #z", "a.html: b.html#y", "a.html: c.png"]


# ---- the gallery -------------------------------------------------------------------------------------------------


def test_the_gallery_is_small_and_made_by_its_commands() -> None:
    files = sorted((ROOT / IMAGES).iterdir())
    assert [file.stem for file in files] == sorted(picture.name for picture in PICTURES)
    assert sum(file.stat().st_size for file in files) < MAX_BYTES
    assert gallery.pages()["gallery.md"].count("```sh\nglpath ") == len(PICTURES)


def test_a_picture_of_the_gallery_is_made_as_its_command_says(tmp_path: Path) -> None:
    picture = Picture("a", "A", "A box", "glpath render cornell-box-36 --resolution 16x16 --spp 4 -o a.png")
    row = made(picture, tmp_path / "images")
    assert (row["command"], row["width"], row["height"]) == (picture.command, 16, 16)
    assert row["processor_s"] > 0
    assert row["wall_s"] > 0
    assert (tmp_path / "images" / "a.webp").stat().st_size > 0
