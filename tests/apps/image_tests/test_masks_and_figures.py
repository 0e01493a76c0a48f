"""What a project that comes from pytest-mpl or Playwright looks for: masks, styles, platforms, reports, no cost."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from glpath.apps.image_tests.figures import FigureSettings
from glpath.apps.image_tests.regression import RenderRegression
from glpath.compare import Picture, compare
from glpath.compare.masks import mask_of, masked, padded
from glpath.compare.picture import Noise
from glpath.errors import UsageError
from glpath.film.image import read_image, write_png
from tests.support.image_suite import GREY, Run
from tests.support.repository import ROOT

pytest_plugins = ["pytester", "tests.support.image_suite"]

CLOCK = """
import numpy as np

def test_grey(render_regression):
    picture = np.full((32, 48, 3), 128, np.uint8)
    picture[2:6, 3:13] = {clock}
    picture[20, 40] = {other}
    render_regression(picture, ignore={ignore})
"""


def test_what_is_ignored_may_change_and_nothing_else(run: Run, suite) -> None:
    suite(CLOCK.format(clock=10, other=128, ignore="[(3, 2, 10, 4)]"))
    run().assert_outcomes(passed=1)
    suite(CLOCK.format(clock=250, other=128, ignore="[(3, 2, 10, 4)]"))
    run().assert_outcomes(passed=1)
    suite(CLOCK.format(clock=250, other=128, ignore="None"))
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*40 of 1536 pixels*"])
    suite(CLOCK.format(clock=250, other=255, ignore="[(3, 2, 10, 4)]"))
    run().stdout.fnmatch_lines(["*1 of 1536 pixels*worst at (40, 20) by 127"])
    suite(CLOCK.format(clock=250, other=128, ignore="[(45, 2, 10, 4)]"))
    run().stdout.fnmatch_lines([r"*ignore?0?: (45, 2, 10, 4) is not inside of the picture of 48 x 32*"])


def test_a_marker_and_a_picture_say_what_is_ignored(run: Run, suite, pytester: pytest.Pytester) -> None:
    mask = np.zeros((32, 48, 3), np.uint8)
    mask[2:6, 3:13] = 255
    write_png(pytester.path / "mask.png", mask)
    marked = CLOCK.replace("def test", "import pytest\n@pytest.mark.render_regression(ignore='mask.png')\ndef test")
    suite(marked.format(clock=10, other=128, ignore="None"))
    run().assert_outcomes(passed=1)
    suite(marked.format(clock=99, other=128, ignore="None"))
    run().assert_outcomes(passed=1)
    write_png(pytester.path / "mask.png", mask[:16])
    run().stdout.fnmatch_lines(["*ignore: a picture of 48 x 16, but that compared has 48 x 32*"])


def test_a_mask_takes_whole_blocks_where_noise_is_known() -> None:
    rng = np.random.default_rng(0)
    batches = rng.uniform(0.4, 0.6, (8, 32, 48, 3))
    mean = batches.mean(axis=0)
    blocks = batches.reshape(8, 2, 16, 3, 16, 3).mean(axis=(2, 4))
    noise = Noise(batches.var(axis=0, ddof=1) / 8, blocks, np.full(8, 8))
    picture = Picture(mean, noise)
    done = masked(picture, mask_of([(3, 2, 10, 4)], mean.shape))
    assert not done.mean[:16, :16].any()
    assert not done.noise.block_batches[:, 0, 0].any()
    np.testing.assert_array_equal(done.mean[16:], mean[16:])
    changed = Picture(np.where(np.arange(48)[None, :, None] < 16, 5.0, mean), noise)
    below = masked(changed, mask_of([(0, 0, 16, 32)], mean.shape))
    assert compare(below, masked(picture, mask_of([(0, 0, 16, 32)], mean.shape)), "stat").passed
    with pytest.raises(UsageError, match="expected rectangles"):
        mask_of([[1, 2], [3]], mean.shape)
    assert padded(picture, (40, 50)).mean.shape == (40, 50, 3)


@pytest.mark.parametrize(("kind", "white"), [(np.uint8, 255), (np.uint16, 65535), (np.float64, 1), (np.int64, 1)])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_mask_ignores_what_is_brighter_than_half_of_white(kind, white, channels) -> None:
    mask = np.zeros((8, 12, *channels), kind)
    mask[2:5, 3:7] = white
    mask[0] = white // 50  # nearly black
    assert np.argwhere(mask_of(mask, (8, 12, 3))).tolist() == [[y, x] for y in (2, 3, 4) for x in range(3, 7)]


def test_a_mask_of_the_whole_picture_is_refused() -> None:
    picture = Picture(np.full((16, 20, 3), 0.5))
    with pytest.raises(UsageError, match=r"ignore: takes all 320 pixels of the picture, so that nothing is"):
        masked(picture, mask_of(np.ones((16, 20)), picture.mean.shape))
    # One pixel of each block of 16 x 16 takes all blocks.
    noisy = Picture(picture.mean, Noise(np.zeros((16, 20, 3)), np.full((2, 1, 2, 3), 0.5), np.full(2, 8)))
    mask = mask_of([(15, 0, 2, 1)], picture.mean.shape)
    assert masked(picture, mask).mean.any()
    with pytest.raises(UsageError, match=r"in blocks of 16 x 16 pixels"):
        masked(noisy, mask)


def test_pictures_of_two_sizes_are_shown_padded(run: Run, suite, pytester: pytest.Pytester) -> None:
    suite(GREY.format(level=0.5))
    run()
    suite(GREY.replace("(8, 8, 3)", "(6, 9, 3)").format(level=0.5))
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*of the 8 x 6 pixels that both have at the upper left, 0 differ"])
    shown = read_image(pytester.path / "glpath-results/test_a/test_grey/difference.png")
    assert shown.shape[:2] == (8, 9)


def test_baselines_of_a_platform_are_apart(run: Run, suite, pytester: pytest.Pytester) -> None:
    suite(GREY.format(level=0.5))
    run("--glpath-platform", "auto").assert_outcomes(passed=1)
    assert (pytester.path / "baseline" / sys.platform / "test_a" / "test_grey.exr").is_file()
    run("--glpath-platform=other", "--glpath-update", "none").assert_outcomes(failed=1)


def test_new_baselines_go_where_ci_keeps_them(run: Run, suite, pytester: pytest.Pytester) -> None:
    baselines = suite(GREY.format(level=0.5))
    result = run("--glpath-update", "none", "--glpath-new-path=artifact")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E    *new         artifact/baseline/test_a/test_grey.exr"])
    assert not baselines.exists()
    assert np.all(read_image(pytester.path / "artifact/baseline/test_a/test_grey.exr") == 0.5)
    # Copied over the checkout they are what the next run compares with.
    (pytester.path / "artifact/baseline").rename(pytester.path / "baseline")
    run("--glpath-update", "none").assert_outcomes(passed=1)


def test_passing_pictures_are_in_the_report_on_demand(run: Run, suite, pytester: pytest.Pytester) -> None:
    suite(GREY.format(level=0.5))
    run()
    run("--glpath-keep", "all").assert_outcomes(passed=1)
    page = (pytester.path / "glpath-results/report.html").read_text()
    content = json.loads(page.partition('type="application/json">')[2].partition("</script>")[0])
    (record,) = content["records"]
    assert record["outcome"] == "passed"
    assert {"result", "reference", "difference"} <= record["pictures"].keys()
    for view in ("side by side", "slider", "location.hash"):
        assert view in page


FIGURE = """
import pytest
import matplotlib.pyplot as plt

@pytest.mark.render_regression({marker})
def test_plot(render_regression):
    figure, axes = plt.subplots(figsize=(1, 1))
    axes.plot([0, 1], [0, 1])
    axes.set_title("{title}")
    print("backend", plt.get_backend(), plt.rcParams["lines.linewidth"])
    render_regression(figure{options})
"""


def test_figures_have_the_style_and_no_text(run: Run, suite, pytester: pytest.Pytester) -> None:
    pytest.importorskip("matplotlib.pyplot")
    marker = "style={'lines.linewidth': 7.0}, backend='agg', savefig_kwargs={'dpi': 50}, remove_text=True"
    baselines = suite(FIGURE.format(marker=marker, title="monday", options=""))
    run("-s").stdout.fnmatch_lines(["*backend agg 7.0*"])
    assert read_image(baselines / "test_plot.png").shape[:2] == (50, 50)
    suite(FIGURE.format(marker=marker, title="tuesday", options=""))
    run().assert_outcomes(passed=1)
    suite(FIGURE.format(marker=marker, title="tuesday", options=", remove_text=False"))
    run().assert_outcomes(failed=1)
    suite(FIGURE.format(marker=marker, title="tuesday", options=", savefig_kwargs={'dpi': 40}"))
    run().stdout.fnmatch_lines(["*of the 40 x 40 pixels that both have*"])
    suite(FIGURE.format(marker="style='no-such-style'", title="", options=""))
    run().stdout.fnmatch_lines(["*glpath: render_regression: style 'no-such-style'*"])


class FakeFigure:
    def savefig(self, file, *, format, dpi=100):
        if not dpi > 0:
            raise ZeroDivisionError("of the figure")
        file.write(b"content")


def _regression(tmp_path: Path, **marked: object) -> RenderRegression:
    """Return the fixture of a test with a marker, without running pytest."""
    marker = SimpleNamespace(args=(), kwargs=marked)
    item = SimpleNamespace(
        name="test_a", nodeid="test_a.py::test_a", path=tmp_path / "test_a.py", iter_markers=lambda name: [marker]
    )
    settings = SimpleNamespace(style=None, backend=None, device={})
    return RenderRegression(item, settings, [])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"limits": 0.01}, "limits: 0.01 where a dictionary"),
        ({"savefig_kwargs": "png"}, "savefig_kwargs: 'png' where a dictionary"),
        ({"remove_text": "no"}, "remove_text: 'no' where True or False"),
        ({"mode": 3}, "mode: 3 where"),
    ],
)
def test_settings_of_wrong_types_fail_the_test(given: dict[str, object], words: str, tmp_path: Path) -> None:
    picture = np.zeros((2, 2, 3))
    with pytest.raises(pytest.fail.Exception, match=f"glpath: {words}"):
        _regression(tmp_path)(picture, **given)
    with pytest.raises(pytest.fail.Exception, match=f"glpath: {words}"):
        _regression(tmp_path, **given)(picture)
    with pytest.raises(pytest.fail.Exception, match="glpath: name: 3 where text"):
        _regression(tmp_path)(picture, name=3)
    with pytest.raises(pytest.fail.Exception, match="glpath: baseline_path: 5 where a path"):
        _regression(tmp_path, baseline_path=5)(picture)


def test_arguments_that_savefig_refuses_are_named() -> None:
    assert FigureSettings(savefig_kwargs={"dpi": 50}).saved(FakeFigure()) == b"content"
    with pytest.raises(UsageError, match=r"savefig_kwargs \{'dpii': 100\}: .*unexpected keyword"):
        FigureSettings(savefig_kwargs={"dpii": 100}).saved(FakeFigure())
    with pytest.raises(UsageError, match="of the figure"):
        FigureSettings(savefig_kwargs={"dpi": 0}).saved(FakeFigure())


HTML = """
from types import ModuleType, SimpleNamespace
import sys

module = ModuleType("pytest_html")
module.extras = SimpleNamespace(png=lambda content, name: {"name": name, "content": content})
sys.modules["pytest_html"] = module

def pytest_configure(config):
    config.pluginmanager.register(object(), "html")

def pytest_runtest_logreport(report):
    if report.when == "call":
        print("extras", [extra["name"] for extra in getattr(report, "extras", [])])
"""


def test_pytest_html_is_given_the_pictures(run: Run, suite, pytester: pytest.Pytester) -> None:
    suite(GREY.format(level=0.5))
    run()
    pytester.makeconftest(HTML)
    suite(GREY.format(level=0.9))
    run("-s").stdout.fnmatch_lines(
        ["*extras ?'test_grey: result', 'test_grey: reference', 'test_grey: difference'*"]
    )
    sys.modules.pop("pytest_html", None)


IMPORT = "import pytest; before = set(__import__('sys').modules); import glpath.apps.image_tests; print(*sorted("
IMPORT += "set(__import__('sys').modules) - before))"


def _python(*arguments: str) -> subprocess.CompletedProcess[str]:
    # With it, as images of containers have it, each process would compile the plugin anew.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )


def test_the_entry_point_loads_no_more_than_itself() -> None:
    loaded = set(_python("-c", IMPORT).stdout.split())
    assert {name.partition(".")[0] for name in loaded} <= {"glpath", "zlib", "_zlib"}
    assert loaded & {"numpy", "glpath.errors", "glpath.apps.image_tests.regression"} == set()


@pytest.mark.evidence
@pytest.mark.timed
def test_the_entry_point_takes_five_milliseconds_at_most() -> None:
    """Of the processor: what it has to wait for is not its own."""
    code = "import pytest, time; start = time.process_time(); import glpath.apps.image_tests; "
    code += "print(1000 * (time.process_time() - start))"
    assert min(float(_python("-c", code).stdout) for _ in range(7)) <= 5.0
