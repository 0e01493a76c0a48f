"""Without Linux's own modules, SIGUSR1, or OpenGL: what needs none of them runs, and doctor says what is missing.

Each is hidden in a process of its own. That is not macOS or Windows, where nobody has tried it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from glpath.film.image import write_png
from tests.support.repository import ROOT

FCNTL = "import sys; sys.modules['fcntl'] = None"
RESOURCE = "import sys; sys.modules['resource'] = None"
SIGUSR1 = "import signal; del signal.SIGUSR1"
# Systems without these have no fcntl either.
CALLS = f"""
{FCNTL}
import os
hidden = "O_CLOEXEC O_NONBLOCK O_DIRECTORY pread pwrite sched_getaffinity fork register_at_fork"
for name in hidden.split():
    delattr(os, name)
"""
OPENGL = """
import ctypes, sys
sys.modules["moderngl"] = sys.modules["glcontext"] = None
class Hidden(ctypes.CDLL):
    def __init__(self, name, *more, **options):
        if name is not None and any(word in str(name) for word in ("EGL", "libGL", "OpenGL", "OSMesa")):
            raise OSError(f"{name}: cannot open shared object file")
        super().__init__(name, *more, **options)
ctypes.CDLL = Hidden
"""
HIDDEN = {"fcntl": FCNTL, "resource": RESOURCE, "SIGUSR1": SIGUSR1, "calls": CALLS, "OpenGL": OPENGL}

CLI = """
import sys
from glpath.cli.main import run
def called(*arguments):
    sys.argv = ["glpath", *arguments]
    try:
        run()
    except SystemExit as end:
        return end.code
    return 0
"""
WHAT_NEEDS_NO_OPENGL = """
import glpath
assert called("info", "cornell-box-36") == called("validate", "cornell-box-36") == 0
assert called("diff", "a.png", "b.png") == 0
factors = glpath.view_factors("cornell-box-36").matrix
assert abs(factors.sum(axis=1).max() - 1) < 0.1
assert called("radiosity", "cornell-box-36", "-o", "light.npz", "--patches", "40", "--checkpoint", "1i", "-q") == 0
print("all of it")
"""


def python(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.evidence) for name in HIDDEN] + ["all"])
def test_what_needs_no_opengl_runs(name: str, tmp_path: Path) -> None:
    for file, value in (("a.png", 51), ("b.png", 52)):
        write_png(tmp_path / file, np.full((8, 8, 3), value, np.uint8))
    hidden = HIDDEN.get(name) or "\n".join(HIDDEN.values())
    done = python(hidden + CLI + WHAT_NEEDS_NO_OPENGL, tmp_path)
    assert done.stdout.endswith("all of it\n"), done.stderr
    assert (tmp_path / "light.npz").exists()


def test_the_pytest_plugin_compares_pictures(tmp_path: Path) -> None:
    (tmp_path / "test_picture.py").write_text(
        "import numpy as np\n"
        "def test_same(render_regression):\n"
        "    render_regression(np.full((8, 8, 3), 51, np.uint8))\n"
    )
    arguments = ["-q", "-p", "no:cacheprovider", "-p", "glpath.apps.image_tests"]
    for more in (["--glpath-update=all"], []):
        code = "\n".join(HIDDEN.values()) + f"\nimport pytest\nsys.exit(pytest.main({[*arguments, *more]}))"
        done = python(code, tmp_path, PYTEST_DISABLE_PLUGIN_AUTOLOAD="1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout


def test_doctor_starts_without_opengl_and_says_what_is_missing(tmp_path: Path) -> None:
    done = python("\n".join(HIDDEN.values()) + CLI + "sys.exit(called('doctor', '--json'))", tmp_path)
    assert done.returncode == 1, done.stderr
    assert '"possible": false' in done.stdout
    assert "libEGL.so.1 cannot be loaded" in done.stdout


DRAWS = {
    "render": ["cornell-box-36", "-o", "a.png"],
    "measure": ["cornell-box-36", "-o", "a.csv", "--plane", "y=0", "--spacing", "0.5"],
    "lightmap": ["cornell-box-36", "-o", "a.glb"],
    "probes": ["cornell-box-36", "-o", "a.json"],
}


@pytest.mark.parametrize(
    "command",
    [
        pytest.param("render", marks=()),
        *(pytest.param(c, marks=pytest.mark.evidence) for c in ("lightmap", "probes")),
        "measure",
    ],
)
def test_what_draws_ends_with_the_remedy(command: str, tmp_path: Path) -> None:
    code = "\n".join(HIDDEN.values()) + CLI + f"sys.exit(called({command!r}, *{DRAWS[command]!r}))"
    done = python(code, tmp_path)
    assert (done.returncode, list(tmp_path.iterdir())) == (1, []), done.stderr
    assert done.stderr.startswith("glpath: error: OpenGL cannot be reached: moderngl cannot be imported")
    assert "`glpath doctor` lists what else is missing" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_without_a_driver_measure_ends_with_the_remedy(tmp_path: Path) -> None:
    """moderngl is there, but neither EGL nor OSMesa."""
    hidden = OPENGL.replace('sys.modules["moderngl"] = sys.modules["glcontext"] = None', "")
    done = python(hidden + CLI + f"sys.exit(called('measure', *{DRAWS['measure']!r}))", tmp_path)
    assert done.returncode == 1, done.stderr
    assert "libEGL.so.1 cannot be loaded" in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_notebooks_say_what_is_missing(tmp_path: Path) -> None:
    pytest.importorskip("jupyter_rfb", reason="needs the extra jupyter")
    pytest.importorskip("IPython", "8.24", reason="older ones need fcntl where they are not on Windows")
    code = """
from glpath.errors import ContextError
import glpath
scene = glpath.load_scene("cornell-box-36")
assert "image/png" in scene._repr_mimebundle_()  # its preview is drawn by numpy
try:
    import glpath.notebook
except ContextError as error:
    print(error)
"""
    done = python("\n".join(HIDDEN.values()) + code, tmp_path)
    assert "OpenGL cannot be reached" in done.stdout, done.stderr


def test_another_system_is_named(tmp_path: Path) -> None:
    """By what doctor says of it; and what only other systems require is not called missing on Linux."""
    code = (
        "import sys\nfrom glpath.cli import devices\n"
        "assert list(devices._system()) == []\n"
        "assert devices._is_of_another_system(\"filelock>=3.12; sys_platform != 'linux'\")\n"
        "sys.platform = 'darwin'\n"
        "assert not devices._is_of_another_system(\"filelock>=3.12; sys_platform != 'linux'\")\n"
        "(finding,) = devices._system()\nprint(finding.found)"
    )
    assert (
        "darwin: glpath renders by EGL or OSMesa on Linux, and was not tried here" in python(code, tmp_path).stdout
    )


LOCKING = """
import subprocess, sys
from pathlib import Path
from glpath.errors import GlpathError
from glpath.system.locks import Lock
def held():
    return subprocess.run([sys.executable, "-c", sys.argv[1], sys.argv[1], "other"]).returncode
if sys.argv[2:] == ["other"]:
    try:
        with Lock(Path("a.npz"), "a render"):
            sys.exit(0)
    except GlpathError as error:
        assert "a render has it already: another process" in str(error)
        sys.exit(9)
with Lock(Path("a.npz"), "a render", 0, 4) as lock, lock:
    assert held() == 9
assert held() == 0
print("held")
"""


def test_without_locks_of_parts_filelock_keeps_others_away(tmp_path: Path) -> None:
    pytest.importorskip("filelock", reason="the extra test has it")
    code = FCNTL + LOCKING
    done = subprocess.run(
        [sys.executable, "-c", code, code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.stdout == "held\n", done.stderr


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_without_locks_of_parts_a_lock_that_is_a_link_is_refused_too(
    link: Callable[[Path, Path], None], tmp_path: Path
) -> None:
    pytest.importorskip("filelock", reason="the extra test has it")
    target = tmp_path / "precious"
    target.write_text("years of work")
    link(target, tmp_path / ".a.npz.lock")
    done = python(
        FCNTL
        + "\nfrom pathlib import Path\nfrom glpath.system.locks import Lock\n"
        + "Lock(Path('a.npz'), 'a render').__enter__()",
        tmp_path,
    )
    assert "ImageError: a.npz: its lock" in done.stderr
    assert target.read_text() == "years of work"


def test_without_any_locks_a_line_says_so(tmp_path: Path) -> None:
    code = (
        FCNTL + "; sys.modules['filelock'] = None\nfrom pathlib import Path\nfrom glpath.system.locks import Lock\n"
        "with Lock(Path('a.npz'), 'a render'):\n    print('goes on')"
    )
    done = python(code, tmp_path)
    assert done.stdout == "goes on\n", done.stderr
    assert "a.npz: no locks without filelock: take care that one process writes it" in done.stderr
