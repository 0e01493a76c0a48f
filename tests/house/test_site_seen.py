"""The site in a browser: no page is wider than a phone, pictures have a text, and all can be read, light and dark.

SITE=out/docs python -m pytest tests/house/test_site_seen.py -m evidence      # a site that is built already
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support import browser, seen_site
from tests.support.repository import ROOT

pytestmark = browser.marks("sphinx", "furo")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[seen_site.Site]:
    folder = Path(os.environ.get("SITE", tmp_path_factory.mktemp("site") / "html")).resolve()
    if "SITE" not in os.environ:
        stored = ROOT / "out" / "notebooks"
        if not stored.is_dir():
            pytest.skip("`make test` stores the results of the notebooks, without which there is no whole site")
        # In a process, as `make docs` does: warnings of Sphinx' parts about one another are no errors there.
        done = subprocess.run(
            [sys.executable, ROOT / ".ci" / "docs.py", folder], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    with browser.chrome() as driver:
        yield seen_site.Site(driver, folder)


def test_no_page_is_wider_than_a_phone(site: seen_site.Site) -> None:
    """But for code, tables and pictures in boxes that scroll."""
    found = {}
    for page in seen_site.pages(site.folder):
        site.look(page, "phone", "light")
        found[page] = site.wider()
    assert len(found) > 60
    assert {page: wider for page, wider in found.items() if wider} == {}


def test_pictures_are_there_and_have_a_text_and_words_can_be_read(site: seen_site.Site) -> None:
    missing, faint, cut = {}, {}, {}
    for page in seen_site.pages(site.folder):
        site.look(page, "desk", "light")
        missing[page], cut[page] = site.without_text(), site.wider()
        for theme in seen_site.THEMES:
            site.set_theme(theme)
            faint[page, theme] = site.faint()
    assert {page: one for page, one in missing.items() if one} == {}
    assert {page: one for page, one in faint.items() if one} == {}
    assert {page: one for page, one in cut.items() if one} == {}, "wider than a desk"


def test_what_is_wrong_is_found(site: seen_site.Site, tmp_path: Path) -> None:
    (tmp_path / "wrong.html").write_text(
        "<!doctype html><meta name=viewport content='width=device-width'><article>"
        "<div style='width: 900px'>wide</div>"
        "<div style='overflow: auto'><pre style='width: 2000px'>code</pre></div>"
        "<img src='none.png' alt='a'><p style='color: #ccc'>faint</p><p>plain</p></article>"
    )
    other = seen_site.Site(site.driver, tmp_path)
    other.look("wrong.html", "phone", "light")
    assert [tag for tag, *_ in other.wider()] == ["DIV", "HTML"]
    assert len(other.without_text()) == 1
    assert [each.partition(":")[0] for each in other.faint()] == ["P."]
