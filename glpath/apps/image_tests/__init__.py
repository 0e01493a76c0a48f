"""Image tests for any pytest suite: the fixture `render_regression`.

    def test_box(render_regression):
        render_regression("cornell-box", spp=64)

pytest finds it by the entry point `pytest11`, without configuration. The plugin is loaded with every pytest run on
the machine. So this module and its imports load nothing but pytest; heavy modules are loaded with the first image.

With pytest-xdist, the workers compare and write images. Their results travel with the test reports, and only the
controller writes the report and looks for unused baselines.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import pytest

from glpath.apps.image_tests.gathering import Gathering
from glpath.apps.image_tests.settings import Settings, add_options

if TYPE_CHECKING:
    from glpath.apps.image_tests.regression import RenderRegression

_RECORDS = pytest.StashKey[list[dict[str, Any]]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    add_options(parser)


def pytest_configure(config: pytest.Config) -> None:
    Settings.of(config)  # report invalid options before any test runs
    config.addinivalue_line(
        "markers",
        "render_regression(mode=None, limits=None, baseline_path=None, ignore=None, style=None, backend=None, "
        "savefig_kwargs=None, remove_text=None): how glpath compares the pictures of a test, where the test itself "
        "does not say, and how matplotlib makes its figures.",
    )
    config.pluginmanager.register(Gathering(config), "glpath-gathering")


@pytest.fixture
def render_regression(request: pytest.FixtureRequest) -> Generator[RenderRegression, None, None]:
    """Compare an image with its baseline: `render_regression(subject, **options)`.

    subject : scene (name, file or `glpath.Scene`, rendered with the options of `glpath.render`), `glpath.Film`,
              array, Pillow image, matplotlib figure, path or bytes of an image file, or a function that returns one
              of these. See `glpath.apps.image_tests.regression.RenderRegression`
    """
    from glpath.apps.image_tests.regression import RenderRegression
    from glpath.apps.image_tests.subjects import close_figures

    records = request.node.stash.setdefault(_RECORDS, [])
    comparison = RenderRegression(request.node, Settings.of(request.config), records)
    with comparison.styled():
        yield comparison
    close_figures(comparison.figures)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    # The records become an attribute of the report, because pytest-xdist sends a report's attributes from a worker
    # to the controller if their values are plain.
    records = item.stash.setdefault(_RECORDS, [])
    if report.skipped and hasattr(report, "wasxfail"):
        for record in records:
            if record["outcome"] in ("failed", "missing"):
                record["outcome"] = "xfailed"
    report.glpath = list(records)  # type: ignore[attr-defined]
    if records and item.config.pluginmanager.hasplugin("html"):
        from glpath.apps.image_tests.report import extras_of

        report.extras = [*getattr(report, "extras", []), *extras_of(records)]  # type: ignore[attr-defined]
    records.clear()
    return report
