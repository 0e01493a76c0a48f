"""Image tests in other people's pytest suites: the fixture `render_regression`.

    def test_box(render_regression):
        render_regression("cornell-box", spp=64)

pytest finds it by the entry point `pytest11`; nothing has to be configured. It loads with every pytest run on the
machine, so this module and `gathering` import nothing but pytest: what is heavy comes with the first picture.

Under pytest-xdist the workers compare and write pictures; what they found travels with their test reports, and the
controller alone writes the report.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import pytest

from glpath.pytest_plugin.gathering import Gathering

if TYPE_CHECKING:
    from glpath.pytest_plugin.regression import RenderRegression

UPDATES = ("none", "missing", "failed", "all")
REPORTS = ("html", "json")

_RECORDS = pytest.StashKey[list[dict[str, Any]]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("glpath", "image tests by glpath")
    group.addoption(
        "--glpath-update",
        choices=UPDATES,
        help="Which baselines to write: those that are missing (the default, but none where CI is set), those that "
        "fail as well, or all.",
    )
    group.addoption(
        "--glpath-baseline-path",
        metavar="DIR",
        help="Where baselines are; a relative one is beside each test file. Default: baseline. Write folders with "
        "a =, as pytest takes one that stands alone for a place of tests.",
    )
    group.addoption(
        "--glpath-results-path",
        metavar="DIR",
        help="Where pictures of failures and the report go. Default: glpath-results in pytest's rootdir.",
    )
    group.addoption(
        "--glpath-report",
        choices=REPORTS,
        help="Write a report also when nothing fails, for people or for programs. Default: html, after a failure.",
    )
    group.addoption(
        "--glpath-device",
        metavar="DEVICE",
        help="What renders scenes: a number of `glpath devices`, gpu (fail rather than render in software), egl or "
        "osmesa.",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Gathering(config), "glpath-gathering")


@pytest.fixture
def render_regression(request: pytest.FixtureRequest) -> RenderRegression:
    """Compare a picture with its baseline: `render_regression(subject, **options)`.

    subject : a scene (name, file or `glpath.Scene`, rendered with the options of `glpath.render`), a `glpath.Film`,
              an array, or a function that returns one of these. See
              `glpath.pytest_plugin.regression.RenderRegression`
    """
    from glpath.pytest_plugin.regression import RenderRegression, Settings

    records = request.node.stash.setdefault(_RECORDS, [])
    return RenderRegression(request.node, Settings.of(request.config), records)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    # Attributes of plain values travel from a worker to the controller with the report.
    records = item.stash.setdefault(_RECORDS, [])
    report.glpath = list(records)  # type: ignore[attr-defined]
    records.clear()
    return report
