"""A suite of somebody else's, with all that `render_regression` takes and all that can be set."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from glpath.apps.image_tests.paths import baseline_name
from glpath.compare import read_picture
from glpath.film.image import write_png
from tests.support.image_suite import GREY, LOADED, Run
from tests.support.repository import ROOT

pytest_plugins = ["pytester", "tests.support.image_suite"]


def files_of(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


# ---- what is compared

SUBJECTS = """
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

COLOUR = np.array([[[{level}, 60, 20], [10, 200, 30]]] * 2, np.uint8).repeat(8, axis=0).repeat(8, axis=1)

def test_array(render_regression):
    render_regression(COLOUR)

def test_alpha(render_regression):
    render_regression(np.dstack([COLOUR[..., 1:2].repeat(3, axis=2), COLOUR[..., 0]]))

def test_palette(render_regression):
    image = Image.fromarray(np.arange(256, dtype=np.uint8).reshape(16, 16)).convert("P")
    image.putpalette([{level}, 0, 90] * 256)
    render_regression(image)

def test_path(render_regression, tmp_path):
    Image.fromarray(COLOUR).save(tmp_path / "a.png")
    render_regression(tmp_path / "a.png")

def test_file_beside_the_test(render_regression):
    Image.fromarray(COLOUR).save(Path(__file__).with_name("beside.png"))
    render_regression("beside.png")

def test_bytes(render_regression):
    data = io.BytesIO()
    Image.fromarray(COLOUR).save(data, "PNG")
    render_regression(data.getvalue())
    render_regression(data, name="file")

@pytest.mark.parametrize("i", range(3))
def test_figure(render_regression, i):
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    assert plt.get_fignums() == []
    figure, axes = plt.subplots(figsize=(1, 1), dpi=40)
    axes.bar([0, 1], [{level} / 100, 1])
    render_regression(figure)
    axes.set_title("later")
    render_regression(figure, name="titled")
"""


def test_all_kinds_of_pictures_are_compared_by_what_they_show(run: Run, suite) -> None:
    pytest.importorskip("matplotlib.pyplot")
    baselines = suite(SUBJECTS.format(level=150))
    run().assert_outcomes(passed=9)
    assert {Path(name).suffix for name in files_of(baselines)} == {".png"}
    run("--glpath-mode=exact").assert_outcomes(passed=9)
    suite(SUBJECTS.format(level=180))
    result = run()
    result.assert_outcomes(failed=9)
    assert len(result.reprec.getfailures()) == 9
    run("--glpath-update", "failed").assert_outcomes(passed=9)
    run("--glpath-mode=exact").assert_outcomes(passed=9)


def test_a_baseline_is_a_png_where_that_holds_all(run: Run, suite) -> None:
    text = "import numpy as np\ndef test_a(render_regression):\n    render_regression(np.full((4, 4, 4), {}))\n"
    baselines = suite(text.format("np.array([9, 8, 7, 100], np.uint8)"))
    run()
    assert files_of(baselines) == ["test_a.png"]
    assert iio.imread(baselines / "test_a.png")[0, 0].tolist() == [9, 8, 7, 100]
    assert read_picture(baselines / "test_a.png").provenance["glpath.test"] == "test_a"
    run("--glpath-mode=exact").assert_outcomes(passed=1)
    # Once it is radiance the baseline is an EXR, with a PNG to look at, which alone is none.
    suite(text.format("np.array([0.2, 0.3, 7.5, 0.5])"))
    run("--glpath-update=failed").assert_outcomes(passed=1)
    assert files_of(baselines) == ["test_a.exr", "test_a.png"]
    (baselines / "test_a.exr").unlink()
    run("--glpath-update=none").stdout.fnmatch_lines(["E  *there is no baseline baseline/test_a/test_a.exr"])
    run().assert_outcomes(passed=1)
    # And back again.
    suite(text.format("np.uint8(50)"))
    run().assert_outcomes(failed=1)
    run("--glpath-update=failed").assert_outcomes(passed=1)
    assert files_of(baselines) == ["test_a.png"]
    # A picture that somebody else has made is a baseline as well.
    write_png(baselines / "test_a.png", np.full((4, 4, 3), 50, np.uint8))
    run().assert_outcomes(failed=1)
    suite(text.format("np.array([50, 50, 50, 255], np.uint8)"))
    run().assert_outcomes(passed=1)


# ---- how it is compared

MARKED = """
import numpy as np
import pytest

pytestmark = pytest.mark.render_regression(limits={{"threshold": 20}})

def picture():
    return np.full((8, 8, 3), {level}, np.uint8)

def test_of_the_module(render_regression):
    render_regression(picture())

class TestClass:
    pytestmark = pytest.mark.render_regression(mode="fuzzy", limits={{"threshold": 40}})

    def test_of_the_class(self, render_regression):
        render_regression(picture())

    @pytest.mark.render_regression(mode="exact")
    def test_of_its_own(self, render_regression):
        render_regression(picture())

    def test_of_the_call(self, render_regression):
        render_regression(picture(), limits={{"threshold": 1}})
        render_regression(picture(), mode="exact", name="exact")
"""


def failing(result: pytest.RunResult) -> set[str]:
    return set(re.findall(r"^FAILED \S*::(\w+)", result.stdout.str(), re.MULTILINE))


def test_markers_from_the_module_to_the_call(run: Run, suite) -> None:
    suite(MARKED.format(level=100))
    run("--strict-markers").assert_outcomes(passed=4)
    suite(MARKED.format(level=130))
    assert failing(run()) == {"test_of_the_module", "test_of_its_own", "test_of_the_call"}
    suite(MARKED.format(level=115))
    assert failing(run()) == {"test_of_its_own", "test_of_the_call"}
    suite(MARKED.format(level=101))
    assert failing(run()) == {"test_of_its_own", "test_of_the_call"}


def test_a_marker_has_names_that_are_checked(run: Run, suite, pytester: pytest.Pytester) -> None:
    suite(GREY.format(level=0.5) + "\nimport pytest\npytestmark = pytest.mark.render_regression(tolerance=1)\n")
    run().stdout.fnmatch_lines(
        ["E*the marker render_regression: has no tolerance. Allowed: mode, limits, baseline_*"]
    )
    suite(
        GREY.format(level=0.5)
        + '\nimport pytest\npytestmark = pytest.mark.render_regression(baseline_path="shots")\n'
    )
    run().assert_outcomes(passed=1)
    assert files_of(pytester.path / "shots/test_a") == ["test_grey.exr", "test_grey.png"]
    shutil.copy(pytester.path / "shots/test_a/test_grey.exr", pytester.path / "shots/test_a/test_gone.exr")
    run().stdout.fnmatch_lines(["no test uses this baseline: shots/test_a/test_gone.exr"])


def test_options_of_the_ini_file_count_less_than_the_command_line(
    run: Run, suite, pytester: pytest.Pytester
) -> None:
    suite(GREY.format(level=0.5))
    pytester.makeini(
        "[pytest]\nglpath_baseline_path = shots\nglpath_results_path = out/shown\nglpath_report = json\n"
        "glpath_mode = fuzzy\nglpath_limits =\n    fuzzy.threshold=20\n    flip.mean=0.5\n"
    )
    run().assert_outcomes(passed=1)
    assert (pytester.path / "shots/test_a/test_grey.exr").exists()
    assert (pytester.path / "out/shown/report.json").exists()
    suite(GREY.format(level=0.55))
    run().assert_outcomes(passed=1)
    run("--glpath-mode=exact").assert_outcomes(failed=1)
    run("--glpath-limits=fuzzy.threshold=2").assert_outcomes(failed=1)
    result = run("--glpath-limits=fuzy.threshold=2")
    result.stdout.fnmatch_lines(["E*mode: there is no 'fuzy'. Allowed: exact, fuzzy, stat, flip."])
    for line, message in (
        ("glpath_update = sometimes", "glpath_update = sometimes: expected one of none, missing, failed, all."),
        ("glpath_limits = threshold=4", "glpath_limits: found threshold=4, expected MODE.NAME=X*"),
    ):
        pytester.makeini(f"[pytest]\n{line}\n")
        result = run()
        assert result.ret == pytest.ExitCode.USAGE_ERROR
        result.stderr.fnmatch_lines([f"ERROR: {message}"])


# ---- tests that are expected to fail

XFAIL = """
import numpy as np
import pytest

@pytest.mark.xfail({condition}, reason="not yet")
def test_known(render_regression):
    render_regression(np.full((8, 8, 3), {level}))
"""


def test_what_is_expected_to_fail_is_neither_updated_nor_a_failure(run: Run, suite) -> None:
    baselines = suite(XFAIL.format(condition="True", level=0.5))
    result = run()  # nor is its baseline written
    result.assert_outcomes(xfailed=1)
    assert not baselines.exists()
    suite(XFAIL.format(condition="False", level=0.5))
    run().assert_outcomes(passed=1)
    before = (baselines / "test_known.exr").read_bytes()
    suite(XFAIL.format(condition="True", level=0.7))
    for update in ("none", "missing", "failed", "all"):
        result = run("--glpath-update", update, "--glpath-report=json")
        result.assert_outcomes(xfailed=1)
        result.stdout.fnmatch_lines(["1 picture compared, 0 failed, 1 expected to"])
        result.stdout.no_fnmatch_line("report: *.html")
        assert (baselines / "test_known.exr").read_bytes() == before
    run("--runxfail").assert_outcomes(failed=1)
    suite(XFAIL.format(condition="1 > 2", level=0.7))
    run("--glpath-update", "failed").assert_outcomes(passed=1)
    assert (baselines / "test_known.exr").read_bytes() != before


# ---- baselines that nobody uses

TWO = GREY.format(level=0.5) + GREY.format(level=0.25).replace("test_grey", "test_other")


def test_unused_baselines_fail_or_are_deleted(run: Run, suite, pytester: pytest.Pytester) -> None:
    baselines = suite(TWO)
    (pytester.path / "test_b.py").write_text(TWO)
    run().assert_outcomes(passed=4)
    suite(GREY.format(level=0.5))
    (pytester.path / "test_b.py").unlink()
    foreign = baselines / "test_mine.png"
    write_png(foreign, np.zeros((2, 2, 3), np.uint8))
    gone = ["test_a/test_other", "test_b/test_grey", "test_b/test_other"]
    listed = [f"no test uses this baseline: baseline/{name}.exr" for name in gone]
    result = run()
    assert result.ret == 0
    result.stdout.fnmatch_lines([*listed, "to delete *: pytest --glpath-unused delete"])
    result = run("--glpath-unused=fail")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(listed)
    assert run("--glpath-unused=delete", "-k", "nothing").ret == pytest.ExitCode.NO_TESTS_COLLECTED
    assert (baselines / "test_other.exr").exists()
    workers = ("-n", "1") if find_spec("xdist") else ()
    result = run("--glpath-unused=delete", *workers)
    assert result.ret == 0
    result.stdout.fnmatch_lines([f"unused baseline deleted: baseline/{name}.exr" for name in gone])
    assert files_of(baselines) == ["test_grey.exr", "test_grey.png", "test_mine.png"]
    assert not (baselines.parent / "test_b").exists()
    run("--glpath-unused=fail").assert_outcomes(passed=1)


def test_baselines_of_tests_that_a_selection_leaves_out_are_in_use(
    run: Run, suite, pytester: pytest.Pytester
) -> None:
    baselines = suite(TWO)
    run()
    before = files_of(baselines)
    suite(TWO.replace("0.25", "0.75"))
    run().assert_outcomes(passed=1, failed=1)
    suite(TWO)
    pytester.syspathinsert()
    for selection in (["--lf"], ["--pyargs", "test_a::test_grey"]):
        run("--glpath-unused", "delete", *selection).assert_outcomes(passed=1)
        assert files_of(baselines) == before


# ---- names


def test_names_differ_by_more_than_case() -> None:
    tests = ["test_a", "test_A", "test_a[x]", "test_a[X]", "test_a[x-]", "test_a[-x]", "test_a[a[b]", "test_a[a-b]"]
    tests += ["test_a[é]", "test_a[E]", "test_a[con.]", "test_a[con]", "TestA.test_a", "test_a[a/b]", "test_a[a b]"]
    tests += [f"test_a[{'x' * 200}]", f"test_a[{'x' * 201}]"]
    names = [baseline_name(test) for test in tests]
    assert len({name.lower() for name in names}) == len(tests)
    assert all(re.fullmatch(r"[A-Za-z0-9_.=+-]{1,140}", name) for name in names)
    for plain, name in (("test_a[0.6-plain]", "test_a-0.6-plain"), ("TestGrey.test_one", "TestGrey.test_one")):
        assert baseline_name(plain) == name
    assert baseline_name("test_a[x]", "left") == "test_a-x.left"


CASES = """
import numpy as np
import pytest

@pytest.mark.parametrize("kind", ["a", "A"])
def test_kind(render_regression, kind):
    render_regression(np.full((4, 4), ord(kind), np.uint8))

def test_KIND(render_regression):
    render_regression(np.full((4, 4), 7, np.uint8))
"""


def test_tests_that_differ_in_case_have_baselines_of_their_own(run: Run, suite) -> None:
    baselines = suite(CASES)
    run().assert_outcomes(passed=3)
    assert len({name.lower() for name in files_of(baselines)}) == 3
    run().assert_outcomes(passed=3)


def test_two_tests_of_one_file_name_are_found(run: Run, suite) -> None:
    text = "import numpy as np\nclass {}:\n    def test_x(self, render_regression): render_regression(np.eye(4))\n"
    baselines = suite(text.format("TestOne"))
    run()
    # What a file system does that does not know upper from lower case.
    for suffix in (".exr", ".png"):
        (baselines / f"TestOne.test_x{suffix}").rename(baselines / f"TestONE.test_x{suffix}")
    suite(text.format("TestONE"))
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E*is the baseline of TestOne.test_x; TestONE.test_x has the same file name."])
    suite(
        "import numpy as np, pytest\n"
        '@pytest.mark.parametrize("i", ["x", "x.y"])\n'
        "def test_a(render_regression, i):\n"
        '    render_regression(np.eye(4), name="y" if i == "x" else "")\n'
    )
    result = run()
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(
        ["E*is the baseline of test_a?x?, picture 'y'; test_a?x.y? has the same file name."]
    )
    suite(
        "import numpy as np\ndef test_b(render_regression):\n"
        '    for name in ("left", "Left"): render_regression(np.eye(4), name=name)\n'
    )
    run().stdout.fnmatch_lines(["E*'left' and 'Left' in test_a.py::test_b differ in case alone."])


# ---- what a failure says


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ('render_regression("no-such-scene")', 'E   *Failed: glpath: "no-such-scene" is neither*'),
        ('render_regression("no-such.png")', "E   *Failed: glpath: no-such.png: there is no such file."),
        ("render_regression(lambda: 1 / 0)", "E   ZeroDivisionError: division by zero"),
        ("render_regression(b'text')", "E   *Failed: glpath: 4 bytes: cannot be read as a picture: it is cut off*"),
    ],
)
def test_an_error_is_said_once_with_the_line_of_the_test(run: Run, suite, call: str, message: str) -> None:
    suite(f"def test_a(render_regression):\n    {call}\n")
    result = run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines([f">*{call}", message.replace("[", "[[]"), "test_a.py:2: *"])
    said = result.stdout.str().partition("short test summary")[0]
    assert "During handling" not in said
    assert "pytest_plugin/" not in said
    assert len([line for line in said.splitlines() if line.startswith("E   ") and "glpath: " in line]) <= 1


# ---- the page on image tests


def readme_suite(suite, pytester: pytest.Pytester) -> str:
    """The example of the page on image tests as the suite, with its ini-file; returns the page."""
    pytest.importorskip("matplotlib.pyplot")
    section = (ROOT / "docs/howto/image-tests.md").read_text(encoding="utf-8")
    code, ini = ("\n\n".join(re.findall(rf"```{kind}\n(.*?)```", section, re.DOTALL)) for kind in ("python", "ini"))
    suite("import matplotlib\nmatplotlib.use('Agg')\n" + code)
    pytester.makeini(ini)
    return section


def test_the_example_of_the_readme_is_true(run: Run, suite, pytester: pytest.Pytester) -> None:
    section = readme_suite(suite, pytester)
    first = run()
    first.assert_outcomes(passed=6)
    assert sum(name.endswith(".png") for name in files_of(pytester.path / "shots/test_a")) == 6
    run("--strict-markers", "--glpath-unused=fail", "--glpath-update=none").assert_outcomes(passed=6)
    said = set(re.findall(r"--glpath-[a-z-]+", section))
    assert said <= set(re.findall(r"--glpath-[a-z-]+", run("--help").stdout.str()))


def test_the_picture_of_another_processor_passes_and_one_that_has_moved_does_not(
    run: Run, suite, pytester: pytest.Pytester
) -> None:
    """Its triangle, by llvmpipe as for a processor without SSE, where some levels are others; and turned by as
    much as moves its corners by half a pixel."""
    readme_suite(suite, pytester)
    run("-k", "triangle").assert_outcomes(passed=1)
    again = [sys.executable, "-m", "pytest", *LOADED, "-q", "-p", "no:cacheprovider", "-k", "triangle", "test_a.py"]
    other = {**os.environ, "GALLIUM_OVERRIDE_CPU_CAPS": "nosse"}
    ended = subprocess.run(
        [*again, "--glpath-update=none"], cwd=pytester.path, env=other, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stdout
    assert "1 passed" in ended.stdout
    test = pytester.path / "test_a.py"
    test.write_text(test.read_text().replace("0.3 + 2.0", "0.317 + 2.0"))
    moved = run("-k", "triangle", "--glpath-update=none")
    moved.assert_outcomes(failed=1)
    moved.stdout.fnmatch_lines(["*test_triangle differs from its baseline (fuzzy)"])
