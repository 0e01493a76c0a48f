"""Compare pytest-mpl and glpath on one project of image tests: changes that each finds, and seconds of a run.

The project is `benchmarks/image_suite`: 22 matplotlib figures, two for each kind of change. Each program writes its
own baselines, then the code changes. Both compare the same pictures with their default limits. A run loads only the
plugin that it needs. Programs take turns, and the median counts.

measured:
    figures                       : number of figures compared in a run
    pytest_mpl_found, glpath_found : figures with a visible change that fail
    glpath_missed                 : figures that only pytest-mpl finds
    pytest_mpl_missed             : figures that only glpath finds
    pytest_mpl_false, glpath_false : figures without a visible change that fail
    pytest_mpl_s, glpath_s        : processor seconds of the whole process for a run in which all pass
    saved_s                       : the same for a run that only draws and saves the figures
    pytest_mpl_failing_s, glpath_failing_s : the same for a run with the changes, including the files of failures
"""

from __future__ import annotations

import importlib.util
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from benchmarks.image_suite.figures import CASES, CHANGED, UNSEEN
from benchmarks.timing import in_turns
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.errors import GlpathError
from glpath.system.versions import versions

RULE = (Condition("glpath_missed", "<=", 0), Condition("glpath_false", "<=", 0))

_SUITE = Path(__file__).resolve().parents[1] / "image_suite"
_CHECKOUT = _SUITE.parents[1]

_MPL = ("by_pytest_mpl.py", "-p", "pytest_mpl.plugin")
_GLPATH = ("by_glpath.py", "-p", "glpath.apps.image_tests")
_COMPARES = {
    "pytest_mpl": (*_MPL, "--mpl", "--mpl-baseline-path=mpl", "--mpl-results-path=mpl-results"),
    "glpath": _GLPATH,
}
_WRITES = {"pytest_mpl": (*_MPL, "--mpl-generate-path=mpl"), "glpath": (*_GLPATH, "--glpath-update=all")}


def bench_image_tests(rounds: int = 7, progress: Callable[[str], None] = lambda text: None) -> Report:
    """Run both programs. Raises GlpathError if a run fails unexpectedly. Without pytest-mpl, only glpath runs."""
    programs = ["glpath", *(["pytest_mpl"] if importlib.util.find_spec("pytest_mpl") else [])]
    notes = [] if len(programs) == 2 else ["without pytest-mpl: pip install pytest-mpl"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in ("by_pytest_mpl.py", "by_glpath.py", "saved_only.py"):
            shutil.copy(_SUITE / file, folder)  # baselines are stored beside the tests
        (folder / "pytest.ini").write_text("[pytest]\n")
        for program in programs:
            progress(f"{program}: baselines")
            _passed(_run(folder, _WRITES[program]), program)
        plain = {program: _COMPARES[program] for program in programs} | {"saved": ("saved_only.py",)}
        progress(f"{rounds} turns of each")
        seconds = in_turns({name: partial(_passing_s, folder, name, plain[name]) for name in plain}, rounds)
        found: dict[str, set[str]] = {}
        failing = in_turns({name: partial(_failing_s, folder, name, found) for name in programs}, rounds)
    seen = {case for case in map(_name, CASES) if not case.startswith(UNSEEN)}
    measured: dict[str, float] = {"figures": len(CASES), "changed": len(seen), "saved_s": seconds["saved"]}
    for program in programs:
        measured |= {
            f"{program}_found": len(found[program] & seen),
            f"{program}_false": len(found[program] - seen),
            f"{program}_s": seconds[program],
            f"{program}_failing_s": failing[program],
        }
    claim, holds = "glpath finds each change that pytest-mpl finds, and nothing where nothing is seen", None
    if "pytest_mpl" in found:
        measured |= {
            "glpath_missed": len(found["pytest_mpl"] & seen - found["glpath"]),
            "pytest_mpl_missed": len(found["glpath"] & seen - found["pytest_mpl"]),
        }
        claim, holds = judge(claim, RULE, measured)
    return Report(
        "image-tests",
        claim,
        measured,
        holds,
        rows=[
            {"change": change} | {program: _share(change, found[program]) for program in programs}
            for change in dict.fromkeys(change for change, _ in CASES)
        ],
        machine=machine("matplotlib agg"),
        versions=versions("glpath", "pytest", "pytest-mpl", "matplotlib", "numpy"),
        notes=notes,
    )


def _run(folder: Path, arguments: Iterable[str], *, changed: bool = False) -> subprocess.CompletedProcess[bytes]:
    """Run pytest with only the named plugin, in an environment without CI."""
    environment = {key: value for key, value in os.environ.items() if key not in ("CI", CHANGED)}
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    environment["PYTHONPATH"] = os.pathsep.join([str(_CHECKOUT), *sys.path[1:]])
    if changed:
        environment[CHANGED] = "yes"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False
    )


def _passed(done: subprocess.CompletedProcess[bytes], program: str) -> None:
    if done.returncode:
        text = done.stdout.decode(errors="replace")[-1500:] + done.stderr.decode(errors="replace")[-500:]
        raise GlpathError(f"bench image-tests: the run of {program} fails:\n{text}", "Run it by hand.")


def _passing_s(folder: Path, program: str, arguments: tuple[str, ...]) -> float:
    """Return the processor seconds of a run without a change. Raises GlpathError if one of its tests fails."""
    before = _processor_s()
    done = _run(folder, arguments)
    taken = _processor_s() - before
    _passed(done, program)
    return taken


def _failing_s(folder: Path, program: str, found: dict[str, set[str]]) -> float:
    """Return the processor seconds of a run with the changes, and add the failing cases to `found`."""
    record = folder / "record.xml"
    arguments = (*_COMPARES[program], f"--junitxml={record}")
    before = _processor_s()
    _run(folder, arguments, changed=True)
    taken = _processor_s() - before
    cases = ElementTree.parse(record).iter("testcase")
    found[program] = {
        case.get("name", "").partition("[")[2].rstrip("]") for case in cases if case.find("failure") is not None
    }
    return taken


def _processor_s() -> float:
    """Return the processor seconds of all ended child processes, which other work on the machine changes little."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _name(case: tuple[str, int]) -> str:
    return f"{case[0]}-{case[1]}"


def _share(change: str, found: set[str]) -> str:
    names = [_name(case) for case in CASES if case[0] == change]
    return f"{sum(name in found for name in names)} of {len(names)}"
