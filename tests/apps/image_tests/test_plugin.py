"""The pytest plugin, as a project that uses it sees it: small suites that are run by pytester."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

import imageio.v3 as iio
import numpy as np
import pytest

from glpath.compare import Picture
from glpath.film.exr import write_exr
from glpath.film.image import read_image
from tests.support.image_suite import GREY, LOADED, Run
from tests.support.repository import TESTS

pytest_plugins = ["pytester", "tests.support.image_suite"]


def test_the_first_run_writes_the_baseline_and_the_second_compares(run: Run, suite) -> None:
    baselines = suite(GREY.format(level=0.5))
    first = run()
    first.assert_outcomes(passed=1)
    first.stdout.fnmatch_lines(["1 picture stored", "baseline written: baseline/test_a/test_grey.exr"])
    first.stdout.no_fnmatch_line("*compared*")
    assert sorted(file.name for file in baselines.iterdir()) == ["test_grey.exr", "test_grey.png"]
    assert np.all(read_image(baselines / "test_grey.exr") == 0.5)
    assert np.all(iio.imread(baselines / "test_grey.png") == 188)
    second = run()
    second.assert_outcomes(passed=1)
    second.stdout.fnmatch_lines(["1 picture compared, 0 failed"])
    second.stdout.no_fnmatch_line("*baseline written*")
    assert not (baselines.parent.parent / "glpath-results").exists()


def test_a_difference_fails_and_leaves_what_a_person_wants_to_see(
    run: Run, suite, pytester: pytest.Pytester
) -> None:
    suite(GREY.format(level=0.5))
    run()
    suite(GREY.format(level=0.55))
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "E  *glpath: test_grey differs from its baseline (fuzzy)",
            "E    *64 of 64 pixels (100 %) are off by more than 2 of 255 levels, 0 % allowed; the worst at *",
            "E    *baseline    baseline/test_a/test_grey.exr",
            "E    *result      glpath-results/test_a/test_grey/result.png",
            "E    *difference  glpath-results/test_a/test_grey/difference.png",
            "E    *flip        glpath-results/test_a/test_grey/flip.png",
            "E    *again       glpath diff --mode fuzzy glpath-results/test_a/test_grey/result.exr baseline/*",
            "E    *accept      pytest --glpath-update failed test_a.py::test_grey",
            "report: glpath-results/report.html",
        ]
    )
    result.stdout.fnmatch_lines([">*render_regression(np.full((8, 8, 3), 0.55))", "test_a.py:5: Failed"])
    assert "Traceback" not in result.stdout.str()
    assert "regression.py" not in result.stdout.str()
    folder = pytester.path / "glpath-results"
    assert (folder / ".gitignore").read_text() == "*\n"
    assert np.allclose(read_image(folder / "test_a/test_grey/result.exr"), 0.55)
    suite(GREY.format(level=0.5))
    run().assert_outcomes(passed=1)
    assert not (folder / "test_a/test_grey").exists()  # of a failure that is gone
    assert "0 of 1" not in (folder / "report.html").read_text()
    assert '"outcome": "passed"' in (folder / "report.html").read_text()


def test_a_missing_baseline_fails_in_ci(run: Run, suite, monkeypatch: pytest.MonkeyPatch) -> None:
    baselines = suite(GREY.format(level=0.5))
    monkeypatch.setenv("CI", "true")
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "E  *glpath: there is no baseline baseline/test_a/test_grey.exr",
            "*--glpath-update missing test_a.py::test_grey",
        ]
    )
    assert not baselines.exists()
    monkeypatch.setenv("CI", "false")
    run("--glpath-update", "none").assert_outcomes(failed=1)
    monkeypatch.setenv("CI", "true")
    run("--glpath-update", "missing").assert_outcomes(passed=1)  # whoever says so means it
    run().assert_outcomes(passed=1)


TWO = """
import numpy as np

def test_left(render_regression):
    render_regression(np.full((4, 4, 3), {left}))

def test_right(render_regression):
    render_regression(np.full((4, 4, 3), {right}))
"""


def test_updates_replace_what_they_say(run: Run, suite) -> None:
    baselines = suite(TWO.format(left=0.5, right=0.5))
    run()
    suite(TWO.format(left=0.5005, right=0.9))  # the left one is within what fuzzy lets pass
    run("--glpath-update", "missing").assert_outcomes(passed=1, failed=1)
    result = run("--glpath-update", "failed")
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["baseline replaced: baseline/test_a/test_right.exr"])
    result.stdout.no_fnmatch_line("*replaced*test_left*")
    assert np.allclose(read_image(baselines / "test_right.exr"), 0.9)
    assert np.all(read_image(baselines / "test_left.exr") == 0.5)
    run("--glpath-update", "all").assert_outcomes(passed=2)
    assert np.allclose(read_image(baselines / "test_left.exr"), 0.5005)


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        ("lambda: 1 / 0", "ZeroDivisionError"),
        ("np.full((4, 4, 3), np.nan)", "16 of its 16 pixels are NaN or infinite"),
        ("'no-such-scene'", "no-such-scene"),
        ("np.zeros((4, 4, 7))", "expected (H, W, 3)"),
        ("object()", "found object, expected a scene, a Film, an array, an image or its file"),
        ("np.zeros((4, 4)), spp=4", "spp: options of a render, but this is a picture already"),
        ("np.zeros((4, 4)), mode='fuzy'", "there is no 'fuzy'. Allowed: exact, fuzzy, stat, flip"),
        ("np.zeros((4, 4)), limits={'thresh': 1}, mode='fuzzy'", "has no limit 'thresh'. Allowed: threshold, edge"),
        ("np.zeros((4, 4)), limits={'threshold': -1}", "threshold: found -1, expected a number of at least 0"),
        (
            "'cornell-box', spp=8, resolution=(8, 8)",
            "the picture has 8 path sets; noise is separated from a change with 32",
        ),
        ("np.zeros((4, 4)), name='a/b'", "found 'a/b', expected up to 80 letters"),
        ("np.full((4, 4), 128)", ".astype(np.uint8) where white is 255, np.uint16 where it is 65535, float of"),
        ("__import__('matplotlib.figure').figure.Figure().subplots()", "hand in the figure: axes.figure"),
        ("__import__('matplotlib.figure').figure.Figure().subplots(2, 2)", "hand in the figure: axes.figure"),
        (
            "type('Plotter', (), {'screenshot': print})()",
            "its picture: Plotter(off_screen=True).screenshot(",
        ),
    ],
)
def test_what_cannot_be_made_or_compared_fails_with_a_reason_and_keeps_the_old_baseline(
    run: Run, suite, picture: str, message: str
) -> None:
    text = "import numpy as np\ndef test_grey(render_regression):\n    render_regression({})\n"
    baselines = suite(text.format("np.full((4, 4, 3), 0.5)"))
    run()
    before = (baselines / "test_grey.exr").read_bytes()
    suite(text.format(picture))
    result = run("--glpath-update", "all")
    result.assert_outcomes(failed=1)
    assert message in result.stdout.str()
    assert (baselines / "test_grey.exr").read_bytes() == before
    assert [file.name for file in baselines.iterdir() if "part" in file.name] == []


def test_baselines_that_cannot_be_used_are_failures_with_a_reason(run: Run, suite) -> None:
    baselines = suite(GREY.format(level=0.5))
    run()
    file = baselines / "test_grey.exr"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*test_grey.exr: cannot be read as .exr: *"])
    write_exr(file, np.full((8, 8, 3), 0.5))
    result = run()
    result.stdout.fnmatch_lines(["*test_grey.exr: is not a baseline of this version of glpath, but *"])
    Picture.of_array(np.full((8, 4, 3), 0.5)).save(file)
    result = run()
    result.stdout.fnmatch_lines(["*the picture is 8 x 8 and the reference 4 x 8; they must be of one size.*"])
    result.stdout.fnmatch_lines(["*a render by its resolution and crop, a plot by its figsize and dpi."])
    run("--glpath-update", "failed").assert_outcomes(passed=1)
    run().assert_outcomes(passed=1)


def test_a_scene_is_rendered_and_a_missing_bounce_is_found_by_stat(run: Run, suite) -> None:
    text = (
        "def test_box(render_regression):\n"
        '    render_regression("cornell-box", spp=64, resolution=(32, 32), max_depth={})\n'
    )
    baselines = suite(text.format(3))
    run("--glpath-device", "0").assert_outcomes(passed=1)
    stored = Picture.load(baselines / "test_box.exr")
    assert stored.noise is not None
    assert stored.provenance["glpath.path_sets"] == "64"
    assert "glpath.device" in stored.provenance
    run().assert_outcomes(passed=1)
    suite(text.format('3, limits={"sees": 0.00202}'))
    for update in ("none", "all"):
        result = run("--glpath-update", update)
        result.assert_outcomes(failed=1)
        result.stdout.fnmatch_lines(["*noise hides too much to compare*0.202 % asked; render both *"])
    assert Picture.load(baselines / "test_box.exr").mean.tobytes() == stored.mean.tobytes()
    suite(text.format(2))
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "E  *glpath: test_box differs from its baseline (stat)",
            "E    *more than noise (batch by batch): *the whole picture is darker by *",
            "E    *made otherwise: max_depth is 2 here and 3 in the reference",
            "*glpath diff --mode stat glpath-results/test_a/test_box/result.exr baseline/test_a/test_box.exr",
        ]
    )


def test_unused_baselines_are_reported_where_all_tests_ran(run: Run, suite) -> None:
    baselines = suite(TWO.format(left=0.5, right=0.5))
    run()
    shutil.copy(baselines / "test_left.exr", baselines / "test_gone.exr")
    unused = "no test uses this baseline: baseline/test_a/test_gone.exr"
    run().stdout.fnmatch_lines([unused])
    for selection in (["-k", "left"], ["test_a.py::test_left"], ["--collect-only"]):
        run(*selection).stdout.no_fnmatch_line("no test uses*")
    # A test that ends before its picture does not make its baseline unused.
    suite(TWO.format(left=0.5, right=0.5).replace("render_regression(np.full((4, 4, 3), 0.5))", "assert 0", 1))
    result = run()
    result.stdout.fnmatch_lines([unused])
    result.stdout.no_fnmatch_line("*test_left.exr")


def test_an_unused_file_that_is_no_picture_is_named_but_not_deleted(run: Run, suite) -> None:
    baselines = suite(GREY.format(level=0.5))
    run()
    (baselines / "test_old.exr").write_bytes(b"cut off")
    (baselines / "test_older.png").touch()
    result = run("--glpath-unused", "delete")
    for name in ("test_old.exr", "test_older.png"):
        line = f"no test uses this file, which is no picture: baseline/test_a/{name}; delete it by hand"
        result.stdout.fnmatch_lines([line])
        assert (baselines / name).exists()
    assert run("--glpath-unused", "fail").ret == pytest.ExitCode.TESTS_FAILED


def test_names_of_baselines(run: Run, suite) -> None:
    baselines = suite(
        """
import numpy as np, pytest

class TestGrey:
    @pytest.mark.parametrize("kind", ["plain", "a/b", "a-b"])
    def test_one(self, render_regression, kind):
        render_regression(np.zeros((4, 4)))
        render_regression(np.zeros((4, 4)), name="second")
"""
    )
    run().assert_outcomes(passed=3)
    names = sorted(file.stem for file in baselines.glob("*.exr"))
    assert "TestGrey.test_one-plain" in names
    assert "TestGrey.test_one-plain.second" in names
    assert len(names) == 6  # a/b and a-b are kept apart
    suite(
        "import numpy as np\ndef test_one(render_regression):\n"
        "    for i in range(2): render_regression(np.zeros((4, 4)))\n"
    )
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*a second picture without a name in test_a.py::test_one.", "*name=*"])


def test_paths_are_options(run: Run, suite, pytester: pytest.Pytester, tmp_path: Path) -> None:
    suite(GREY.format(level=0.5))
    options = (f"--glpath-baseline-path={tmp_path / 'kept'}", "--glpath-results-path=shown")
    run(*options).assert_outcomes(passed=1)
    assert (tmp_path / "kept/test_a/test_grey.exr").exists()
    suite(GREY.format(level=0.7))
    run(*options).assert_outcomes(failed=1)
    assert (pytester.path / "shown/test_a/test_grey/result.png").exists()
    assert (pytester.path / "shown/report.html").exists()
    run("--glpath-baseline-path=beside").assert_outcomes(passed=1)
    assert (pytester.path / "beside/test_a/test_grey.exr").exists()
    assert not (pytester.path / "baseline").exists()


def test_results_that_cannot_be_written_do_not_hide_the_difference(run: Run, suite, tmp_path: Path) -> None:
    suite(GREY.format(level=0.5))
    run()
    suite(GREY.format(level=0.75))
    (tmp_path / "file").write_text("not a folder")
    result = run(f"--glpath-results-path={tmp_path / 'file' / 'results'}")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*64 of 64 pixels*", "E  *the pictures are not kept: *", "the report is not written: *"]
    )


def test_a_device_that_cannot_be_is_wrong_usage(run: Run, suite) -> None:
    suite(GREY.format(level=0.5))
    result = run("--glpath-device", "quantum")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: --glpath-device quantum: expected a number of `glpath devices`, *"])


MANY = """
import numpy as np, pytest

@pytest.mark.parametrize("i", range(6))
def test_grey(render_regression, i):
    render_regression(np.full((8, 8, 3), 0.5 + {step} * i))
"""


@pytest.fixture
def failed(run: Run, suite, pytester: pytest.Pytester) -> Callable[..., Path]:
    """Six pictures of which the last three differ, the last most; the folder of the results."""

    def with_options(*options: str) -> Path:
        suite(MANY.format(step=0))
        run()
        suite(MANY.format(step=0.005))
        run(*options).assert_outcomes(passed=3, failed=3)
        return pytester.path / "glpath-results"

    return with_options


def test_the_json_report_has_the_worst_first(failed: Callable[..., Path]) -> None:
    report = json.loads((failed("--glpath-report", "json") / "report.json").read_text())
    outcomes = [record["outcome"] for record in report["records"]]
    assert outcomes == ["failed"] * 3 + ["passed"] * 3
    assert [record["picture"][-1] for record in report["records"]] == list("543210")
    severities = [record["severity"] for record in report["records"]]
    assert severities == sorted(severities, reverse=True)
    assert severities[2] > 1 > severities[3]
    assert report["records"][0]["limits"] == {"threshold": 2.0, "edge": 0.25, "failpercent": 0.0}
    commands = report["records"][0]["commands"]
    assert commands["accept"] == "pytest --glpath-update failed 'test_a.py::test_grey[5]'"
    assert commands["again"].startswith("glpath diff --mode fuzzy glpath-results/test_a/test_grey-5/result.exr ")
    assert report["records"][-1]["commands"] == {}, "what passed needs none"


def test_workers_of_xdist_are_merged_into_one_report(run: Run, suite, pytester: pytest.Pytester) -> None:
    pytest.importorskip("xdist")
    baselines = suite(MANY.format(step=0))
    run()
    shutil.copy(baselines / "test_grey-0.exr", baselines / "test_gone.exr")
    suite(MANY.format(step=0.005))
    result = run("-n", "2", "--glpath-report", "json")
    result.assert_outcomes(passed=3, failed=3)
    result.stdout.fnmatch_lines(
        ["6 pictures compared, 3 failed", "no test uses this baseline: baseline/test_a/test_gone.exr"]
    )
    report = json.loads((pytester.path / "glpath-results/report.json").read_text())
    assert len(report["records"]) == 6
    for record in report["records"][:3]:
        assert Path(record["files"]["difference"]).exists()
    assert report["unused_baselines"] == [str(baselines / "test_gone.exr")]


def test_the_plugin_loads_nothing_until_a_picture_is_compared(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import sys

        def test_nothing():
            heavy = {"numpy", "scipy", "moderngl", "OpenEXR", "glpath.compare", "glpath.film"}
            assert not heavy & set(sys.modules)
        """
    )
    options = (*LOADED, "-p", "no:hypothesispytest", "-p", "no:xdist")
    result = pytester.runpytest_subprocess(*options)
    result.assert_outcomes(passed=1)
    assert "glpath" not in "".join(result.outlines[-3:])


def test_only_one_fixture_is_registered(run: Run, suite) -> None:
    suite(GREY.format(level=0.5))
    listed = re.findall(r"^(\w+).* -- .*glpath/apps/image_tests/", run("--fixtures").stdout.str(), re.MULTILINE)
    assert listed == ["render_regression"]


def test_without_flip_evaluator_all_else_works(run: Run, suite, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    suite(GREY.format(level=0.5))
    run()
    suite(GREY.format(level=0.6))
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E    *difference  *"])
    result.stdout.no_fnmatch_line("E  *flip  *")
    suite(GREY.format(level=0.5).replace("})", "").replace("0.5))", "0.5), mode='flip')"))
    run().stdout.fnmatch_lines(["E  *glpath: flip: the package flip-evaluator is not installed.", "*glpath?flip?*"])


def test_the_example_project_passes_and_finds_a_change(run: Run, pytester: pytest.Pytester) -> None:
    shutil.copytree(TESTS / "example_project", pytester.path, dirs_exist_ok=True)
    run().assert_outcomes(passed=4)
    assert len(list((pytester.path / "baseline/test_example").glob("*.exr"))) == 5
    scene = pytester.path / "room.toml"
    scene.write_text(scene.read_text().replace("min = [-0.6, 0, -0.5]", "min = [-0.5, 0, -0.5]"))
    result = run()
    result.assert_outcomes(passed=1, failed=3)
    result.stdout.fnmatch_lines(["E    *made otherwise: the scene's content * is another one"])


# ---- the page


def page_of(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def test_the_page_needs_nothing_beside_it(failed: Callable[..., Path]) -> None:
    page = page_of(failed())
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)|https?://|@import|url\(""", page)
    content = json.loads(re.search(r'type="application/json">(.*?)</script>', page, re.DOTALL)[1])
    pictures = content["records"][0]["pictures"]
    assert sorted(pictures) == ["difference", "flip", "reference", "result"]
    decoded = iio.imread(base64.b64decode(pictures["result"].split(",")[1]))
    assert decoded.shape == (8, 8, 3)


def test_a_name_cannot_break_the_page(run: Run, suite, pytester: pytest.Pytester) -> None:
    text = MANY.replace("range(6)", "['</script><b>']").replace("{step} * i", "{step}")
    suite(text.format(step=0))
    run()
    suite(text.format(step=0.3))
    run().assert_outcomes(failed=1)
    assert "</script><b>" not in page_of(pytester.path / "glpath-results")


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def browse(text: str, folder: Path, *options: str, fragment: str = "") -> str:
    """What Chromium prints of a page, opened at one of its addresses."""
    (folder / "page.html").write_text(text, encoding="utf-8")
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu"]
    command += [f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=1000", "--window-size=1000,700"]
    command += [*options, (folder / "page.html").as_uri() + fragment]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


def pressed(page: str, *keys: str, then: str = "") -> str:
    """The page with a script that presses keys, and more of it."""
    script = "".join(f'document.dispatchEvent(new KeyboardEvent("keydown", {{key: "{key}"}}));' for key in keys)
    return page.replace("</body>", f"<script>{script}{then}</script></body>")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_the_page_in_a_browser(failed: Callable[..., Path], run: Run, tmp_path: Path) -> None:
    """Its keys, in a copy that presses them; and the picture is on the screen."""
    results = failed()
    baselines = results.parent / "baseline" / "test_a"
    shutil.copy(baselines / "test_grey-0.exr", baselines / "test_gone.exr")
    run()
    page = page_of(results)

    screen = tmp_path / "screen.png"
    shown = browse(pressed(page, "j", "k", "j", " "), tmp_path, "--dump-dom")
    assert "glpath image tests: 3 of 6 failed, 1 unused baseline" in shown
    assert re.search(r'id="unused"><.*test_gone\.exr</li>', shown)
    buttons = re.findall(r"<button(.*?)><b>(.*?)</b>", shown)
    assert [name for state, name in buttons if 'aria-current="true"' in state] == [buttons[1][1]]
    assert re.search(r'<img alt="reference of test_grey-4"[^>]* id="picture"', shown)
    assert "<p>accept <code>pytest --glpath-update failed 'test_a.py::test_grey[4]'</code></p>" in shown
    assert "<p>again <code>glpath diff --mode fuzzy glpath-results/" in shown
    browse(page, tmp_path, f"--screenshot={screen}")
    pixels = iio.imread(screen)[..., :3]
    result = iio.imread(next((tmp_path.parent).rglob("glpath-results/test_a/test_grey-5/result.png")))[0, 0]
    assert np.count_nonzero((np.abs(pixels.astype(int) - result) <= 1).all(axis=-1)) >= 64 * 64


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_both_pictures_side_by_side_and_under_a_slider_and_a_link_to_one_test(
    failed: Callable[..., Path], tmp_path: Path
) -> None:
    page = page_of(failed())
    link = "#" + quote("test_a.py::test_grey[4] test_grey-4", safe="")
    beside = browse(pressed(page, "5"), tmp_path, "--dump-dom", fragment=link)
    stage = re.search(r'<div id="stage" class="beside">(.*?)</div>', beside)
    assert stage is not None
    assert re.findall(r'alt="(\w+) of ([\w-]+)"', stage[1]) == [
        ("result", "test_grey-4"),
        ("reference", "test_grey-4"),
    ]
    move = 'const s = document.getElementById("slider"); s.value = 25; s.dispatchEvent(new Event("input"));'
    under = browse(pressed(page, "6", then=move), tmp_path, "--dump-dom", fragment=link)
    stage = re.search(r'<div id="stage" class="over">(.*?)</div>', under)
    assert stage is not None
    assert re.findall(r'alt="(\w+) of ([\w-]+)"', stage[1]) == [
        ("reference", "test_grey-4"),
        ("result", "test_grey-4"),
    ]
    assert re.search(r'class="above"[^>]*clip-path: inset\(0px 75% 0px 0px\)', stage[1])
    assert f'href="{link}"' in under
    first = browse(page, tmp_path, "--dump-dom")
    assert f'href="{link}"' not in first  # without the link it is the worst that is shown
