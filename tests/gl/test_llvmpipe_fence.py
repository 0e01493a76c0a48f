"""llvmpipe frees fences that its threads are still unlocking; ours are held. See `glpath.gl.fences`.

A preloaded library makes the threads sleep there, and counts what is freed too early.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Self

import pytest

from glpath.cli import devices
from glpath.gl.context import open_context
from glpath.gl.fences import HELD, HeldFences
from tests.support.repository import ROOT, TESTS

HERE = TESTS / "llvmpipe_fence"
SECONDS = 600

pytestmark = pytest.mark.skipif(
    not open_context().info.renderer.startswith("llvmpipe"), reason="another driver, without these fences"
)


def compiled(folder: Path) -> Path:
    """The library, compiled; or the test is skipped with the reason."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    library = folder / "slow_broadcast.so"
    command = [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(HERE / "slow_broadcast.c"), "-ldl"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"{compiler} cannot compile it: {done.stderr.strip().splitlines()[-1]}")
    return library


class Stress:
    """`stress.py` under the library, until it is ended."""

    def __init__(self, library: Path, threads: int, *arguments: str) -> None:
        self.count = library.with_name(f"count-{threads}{''.join(arguments)}")
        self._log = self.count.with_suffix(".log")
        environment = {
            "LD_PRELOAD": str(library),
            "SLOW_BROADCAST_COUNT": str(self.count),
            "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")])),
        }
        script = [str(HERE / "stress.py"), "3600", str(threads), *arguments]
        with self._log.open("wb") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-X", "faulthandler", *script],
                env=os.environ | environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
            )
        self._since = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._since

    @property
    def freed_too_early(self) -> int:
        return self.count.stat().st_size if self.count.exists() else 0

    def wait(self, seconds: float) -> bool:
        """Until it ran for so long: whether it still does then."""
        while self.seconds < seconds and self.process.poll() is None:
            time.sleep(0.1)
        return self.process.poll() is None

    def end(self) -> str:
        """What it wrote, once it has ended."""
        self.process.kill()
        self.process.wait()
        return self._log.read_text(errors="replace")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("fence"))


def test_without_the_remedy_fences_are_freed_too_early(library: Path) -> None:
    """Which is what shows that the library would see it. Measured: dozens in a second; often a crash too."""
    with Stress(library, 2, "without") as stress:
        while stress.seconds < 120 and stress.process.poll() is None and not stress.freed_too_early:
            stress.wait(stress.seconds + 0.2)
        log = stress.end()
        assert stress.freed_too_early or stress.process.returncode == -11, log


def test_with_the_remedy_none_is(library: Path) -> None:
    with Stress(library, 2) as stress:
        assert stress.wait(5), stress.end()
        assert stress.freed_too_early == 0


def test_no_more_fences_are_held_than_needed() -> None:
    context = open_context()
    with context:
        fences = HeldFences(context._opened.loader.load_opengl_function)
        for _ in range(2 * HELD):
            fences.hold()
        assert len(fences._held) == HELD
        assert all(fences._held)
        while fences._held:
            fences._delete(fences._held.popleft())
        assert context.gl.error == "GL_NO_ERROR"


def test_one_thread_is_taken_as_none_and_gives_the_bits_of_two() -> None:
    code = (
        "import glpath, hashlib, pathlib\n"
        "film = glpath.render('cornell-box-36', spp=2, max_depth=2, resolution=(24, 16))\n"
        "names = [p.read_text() for p in pathlib.Path('/proc/self/task').glob('*/comm')]\n"
        "print(sum(n.startswith('llvmpipe') for n in names), hashlib.sha256(film.radiance_sums).hexdigest())\n"
    )
    found = {}
    for threads in ("1", "2"):
        environment = os.environ | {"LP_NUM_THREADS": threads}
        found[threads] = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, timeout=120
        ).stdout.split()
    assert {threads: int(number) for threads, (number, _) in found.items()} == {"1": 0, "2": 2}
    assert len({digest for _, digest in found.values()}) == 1
    [finding] = devices._threads("1")
    assert "LP_NUM_THREADS = 1; taken as 0" in finding.found
    [finding] = devices._threads("2")
    assert "taken as" not in finding.found


@pytest.mark.evidence
@pytest.mark.beside
def test_ten_minutes_of_renders_free_none_too_early(library: Path) -> None:
    """With one of llvmpipe's threads, and with two."""
    with Stress(library, 1) as one, Stress(library, 2) as two:
        for stress in (one, two):
            alive = stress.wait(SECONDS)
            assert alive, stress.end()
            assert stress.freed_too_early == 0
