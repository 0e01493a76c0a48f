"""Run what shows glpath among other programs, and store it: python .ci/others.py [formats] [systems].

formats : files that glpath writes or reads, taken by the program that owns them
systems : what other systems lack is hidden, and what is to run without it runs

Each row of `benchmarks/results/formats.json` and `systems.json` is tests of this repository, how many passed, and
the version of the program beside glpath. Exit code 1 where one fails or where none of a row could run: the row says
so, and the program that is missing has to be installed first:

    pip install vtk honeybee-radiance mitsuba
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.verdict import machine  # noqa: E402
from glpath.system.versions import versions  # noqa: E402
from tests.support import npm  # noqa: E402

RESULTS = ROOT / "benchmarks" / "results"
#: What is shown, the program that judges with its package, and the tests: a file, and words of their names.
FORMATS = (
    ("VTK, .vtp and .vtu", "written", "VTK", "vtk", "tests/io/test_vtk.py", "vtk_itself"),
    ("glTF, .glb", "written", "Khronos' validator", "gltf-validator", "tests/io/test_export.py", "validator"),
    (
        "Mitsuba, .xml",
        "written",
        "Mitsuba",
        "mitsuba",
        "tests/io/test_export.py",
        "mitsuba_makes or mitsuba_reads or instances_in_mitsuba",
    ),
    (
        "Mitsuba, .xml",
        "read",
        "Mitsuba",
        "mitsuba",
        "tests/io/test_mitsuba_scenes.py",
        "as_mitsuba or is_mitsubas or mitsuba_makes",
    ),
    (
        "honeybee, .hbjson",
        "read",
        "honeybee",
        "honeybee-core",
        "tests/io/honeybee/test_honeybee.py",
        "honeybee_finds",
    ),
)
_WITHOUT = "tests/system/test_other_systems.py"
#: What is hidden, what is to happen, and the tests.
SYSTEMS = (
    *(
        (hidden, "all that needs no OpenGL runs", _WITHOUT, f"needs_no_opengl_runs and {hidden}]")
        for hidden in ("fcntl", "resource", "SIGUSR1", "calls", "OpenGL")
    ),
    ("all at once", "all that needs no OpenGL runs", _WITHOUT, "needs_no_opengl_runs and all]"),
    ("all at once", "the pytest plugin compares pictures", _WITHOUT, "pytest_plugin_compares"),
    ("all at once", "doctor says what is missing", _WITHOUT, "doctor_starts"),
    ("all at once", "what draws ends with the remedy", _WITHOUT, "what_draws_ends"),
    ("EGL and OSMesa", "measure ends with the remedy", _WITHOUT, "without_a_driver"),
)
_NAMES = {
    "calls": "`fork`, `pread`, `O_CLOEXEC` and others of `os`",
    "fcntl": "`fcntl`",
    "resource": "`resource`",
    "SIGUSR1": "`SIGUSR1`",
    "OpenGL": "EGL, OSMesa and moderngl",
}


def outcomes(file: str, words: str) -> dict[str, int]:
    """How many of these tests passed, failed and were skipped. SystemExit where there are none."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "tests.xml"
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-p",
            "no:cacheprovider",
            f"--junit-xml={told}",
            "-k",
            words,
            file,
        ]
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        done = subprocess.run(
            command, cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False
        )
        if done.returncode not in (0, 1):
            raise SystemExit(f"{file}: the tests with {words!r} did not run:\n{done.stdout[-2000:]}{done.stderr}")
        if done.returncode:
            print(done.stdout)
        (suite,) = ElementTree.parse(told).getroot().iter("testsuite")
    counts = {name: int(suite.attrib[name]) for name in ("tests", "failures", "errors", "skipped")}
    failed = counts["failures"] + counts["errors"]
    return {
        "passed": counts["tests"] - failed - counts["skipped"],
        "failed": failed,
        "skipped": counts["skipped"],
    }


def version_of(package: str) -> str:
    """Of a package of Python or of npm; "-" where it is missing."""
    try:
        return version(package)
    except PackageNotFoundError:
        found = npm.package(package) if package == "gltf-validator" else None
        return json.loads((found / "package.json").read_text("utf-8"))["version"] if found else "-"


def formats() -> list[dict[str, Any]]:
    """A row for each format and direction."""
    return [
        {
            "format": name,
            "glpath": does,
            "program": program,
            "version": version_of(package),
            **outcomes(file, words),
        }
        for name, does, program, package, file, words in FORMATS
    ]


def systems() -> list[dict[str, Any]]:
    """A row for each thing that is hidden."""
    return [
        {"hidden": _NAMES.get(hidden, hidden), "what": what, **outcomes(file, words)}
        for hidden, what, file, words in SYSTEMS
    ]


def main() -> int:
    """Run, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", default=["formats", "systems"], help="formats, systems; both")
    given = parser.parse_args()
    makers = {"formats": formats, "systems": systems}
    if not set(given.what) <= set(makers):
        parser.error(f"expected {' or '.join(makers)}")
    wrong = False
    for name in given.what:
        rows = makers[name]()
        wrong |= any(row["failed"] or not row["passed"] for row in rows)
        report = {
            "name": name,
            "rows": rows,
            "machine": machine(""),
            "versions": versions("glpath"),
            "date": datetime.date.today().isoformat(),
        }
        (RESULTS / f"{name}.json").write_text(json.dumps(report, indent=2) + "\n", "utf-8")
        for row in rows:
            print(*row.values(), sep="  ")
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
