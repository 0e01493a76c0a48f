"""Run the quick tests by other Pythons and packages: python .ci/pythons.py PYTHON... [--lowest] -o FILE.

Each Python gets an environment of its own, with the wheel of this checkout and its extra `test`; --lowest takes the
oldest releases that pyproject.toml allows (needs uv). A row of FILE is a run; rows of the same Python and packages
are replaced. Packages that could not be installed are left out and named.

    python .ci/pythons.py /usr/bin/python3.11 python3.13 -o benchmarks/results/pythons.json
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.verdict import machine  # noqa: E402
from glpath.system.versions import versions  # noqa: E402

#: What runs in minutes, and touches each dependency.
TESTS = ("cli", "film", "io", "apps/image_tests", "radiosity", "rendering", "scene", "system")
#: What the tests cannot do without; of the rest what has no wheel is left out.
NEEDED = ("pytest>=8", "pytest-xdist>=3.6", "hypothesis>=6.136", "filelock>=3.12", "packaging", "PyYAML>=6")
_COUNT = re.compile(r"(\d+) (passed|failed|skipped|error)")


def call(*command: object, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [str(part) for part in command], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def installed(python: Path, wheel: Path) -> list[str]:
    """Install the wheel and its test extra by pip; returns what could not be. SystemExit without the core."""
    pip = (python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:")
    whole = call(*pip, f"{wheel}[test]")
    if whole.returncode == 0:
        return []
    core = call(*pip, wheel, *NEEDED)
    if core.returncode:
        raise SystemExit(f"{python}: not even the core can be installed:\n{core.stderr}")
    extras = ("bake", "denoise", "figures", "flip", "lod", "video", "cluster", "jupyter")
    return [extra for extra in extras if call(*pip, f"{wheel}[{extra}]").returncode]


def lowest(python: Path, wheel: Path, folder: Path) -> list[str]:
    """The oldest releases, by uv, which has to be on the path."""
    wanted = folder / "lowest.txt"
    options = ("--python", python, "--resolution", "lowest-direct", "--extra", "test", "--extra", "frames")
    for command in (
        ("uv", "pip", "compile", "-q", *options, "pyproject.toml", "-o", wanted),
        ("uv", "pip", "install", "-q", "--python", python, "-r", wanted),
        ("uv", "pip", "install", "-q", "--python", python, "--no-deps", wheel),
    ):
        done = call(*command)
        if done.returncode:
            raise SystemExit(f"{' '.join(map(str, command))}:\n{done.stderr}")
    return []


def row(python: str, wheel: Path, lowest_releases: bool, folder: Path, tests: list[str]) -> dict[str, Any]:
    """Make an environment, and run the tests in it."""
    home = folder / "environment"
    subprocess.run([python, "-m", "venv", "--clear", str(home)], check=True)
    own = home / "bin" / "python"
    missing = lowest(own, wheel, folder) if lowest_releases else installed(own, wheel)
    drawn = call(own, "-m", "glpath", "render", "furnace", "--spp", "4", "-o", "a.png", folder=folder)
    if drawn.returncode:
        raise SystemExit(f"{python}: the wheel does not render:\n{drawn.stderr}")
    # The tests are those of the checkout, and so is the package that they import; all else is of the environment.
    options = ("-n", "2", "--dist", "loadfile", "-m", "not evidence", "-p", "no:cacheprovider")
    done = call(own, "-m", "pytest", *options, *(f"tests/{name}" for name in tests))
    counts = {
        word: int(number) for number, word in _COUNT.findall(done.stdout.splitlines()[-1] if done.stdout else "")
    }
    if not counts.get("passed"):
        raise SystemExit(f"{python}: no tests ran:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    print(*failed, sep="\n")
    told = call(own, "-c", "import platform; print(platform.python_version())").stdout.strip()
    return {
        "python": told,
        "packages": "oldest that are allowed" if lowest_releases else "newest",
        "tests": ", ".join(tests),
        "passed": counts["passed"],
        "failed": counts.get("failed", 0) + counts.get("error", 0),
        "skipped": counts.get("skipped", 0),
        "not_installed": ", ".join(missing) or "-",
        "date": datetime.date.today().isoformat(),
    }


def main() -> int:
    """Run, and write the rows. Exit code 1 where a test fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pythons", nargs="+", metavar="PYTHON")
    parser.add_argument("--lowest", action="store_true", help="the oldest releases that pyproject.toml allows")
    parser.add_argument("--tests", nargs="+", default=list(TESTS), metavar="FOLDER", help="of tests/")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    given = parser.parse_args()
    rows = json.loads(given.output.read_text())["rows"] if given.output.exists() else []
    with tempfile.TemporaryDirectory() as folder:
        built = call(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, ".")
        if built.returncode:
            raise SystemExit(built.stderr)
        (wheel,) = Path(folder).glob("*.whl")
        for python in given.pythons:
            found = row(python, wheel, given.lowest, Path(folder), given.tests)
            rows = [
                each for each in rows if (each["python"], each["packages"]) != (found["python"], found["packages"])
            ]
            rows = sorted([*rows, found], key=lambda each: (each["python"], each["packages"]))
            report = {
                "name": "pythons",
                "rows": rows,
                "machine": machine(""),
                "versions": versions("glpath"),
                "date": datetime.date.today().isoformat(),
            }
            given.output.write_text(json.dumps(report, indent=2) + "\n")
    return int(any(each["failed"] for each in rows))


if __name__ == "__main__":
    sys.exit(main())
