"""Compiled functions are compiled again when a file that they call into has changed."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from glpath.errors import TimeLimitError
from glpath.io import load_scene
from glpath.lights.lighting import Lighting
from glpath.radiosity.solvers import ahead
from glpath.radiosity.solvers.ahead import kernels_of
from glpath.radiosity.solvers.checks import METHODS
from glpath.scene import path_traceable
from glpath.system import kernel_cache, kernels
from glpath.system.kernel_cache import _FOLDER as FOLDER
from glpath.system.kernel_cache import room_stamp
from glpath.system.private_interfaces import numba_cache
from glpath.system.time_limit import limited
from tests.support.clock import Clock
from tests.support.repository import ROOT

INNER = """
from typing import NamedTuple
from glpath.system.kernels import inner_kernel

class {name}(NamedTuple):
    value: float

@inner_kernel
def inner(pair):
    return pair.value + {number}
"""
OUTER = """
import inside
from glpath.system.kernels import kernel

@kernel
def outer(pair):
    return inside.inner(pair)

print(outer(getattr(inside, inside.NAME)(1.0)))
"""


def run(folder: Path, name: str, number: int) -> str:
    (folder / "inside.py").write_text(INNER.format(name=name, number=number))
    if not (folder / "outside.py").exists():
        (folder / "outside.py").write_text(OUTER)
    with (folder / "inside.py").open("a") as file:
        file.write(f"\nNAME = {name!r}\n")
    done = subprocess.run(
        [sys.executable, "outside.py"], cwd=folder, capture_output=True, text=True, env={**os.environ}, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_kernel_sees_what_it_calls_change(tmp_path: Path) -> None:
    assert run(tmp_path, "Pair", 1) == "2.0"
    assert run(tmp_path, "Pair", 10) == "11.0"  # the caller's own file is as it was
    assert run(tmp_path, "Other", 100) == "101.0"  # and the index names a class that is gone


def test_a_kernel_sees_other_folders_of_its_room_change(tmp_path: Path) -> None:
    """A room is a package with packages in it; what lies beside the room is none of its business."""
    room = tmp_path / "room"
    for folder in (room, room / "lower", room / "upper"):
        folder.mkdir()
        (folder / "__init__.py").write_text("")
    inner = room / "lower" / "inside.py"
    outer = room / "upper" / "outside.py"
    outer.write_text(OUTER.replace("import inside", "from room.lower import inside"))
    for number in (1, 10):
        inner.write_text(INNER.format(name="Pair", number=number) + "\nNAME = 'Pair'\n")
        done = subprocess.run(
            [sys.executable, "-m", "room.upper.outside"], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.stdout.strip() == f"{1 + number}.0", done.stderr
    names = [name for name, *_ in room_stamp(outer)]
    (tmp_path / "beside.py").write_text("")
    assert names == [name for name, *_ in room_stamp(inner)]
    assert "lower/inside.py" in names
    assert "beside.py" not in names


def test_an_unchanged_folder_is_loaded_from_the_cache(tmp_path: Path) -> None:
    run(tmp_path, "Pair", 1)
    (data,) = (tmp_path / "__pycache__" / FOLDER).glob("outside.outer*.nbc")
    before = data.stat().st_mtime_ns
    for source in tmp_path.glob("*.py"):  # a copied installation: what counts is the content
        os.utime(source, (1, 1))
    subprocess.run([sys.executable, "outside.py"], cwd=tmp_path, capture_output=True, check=True)
    assert data.stat().st_mtime_ns == before


def test_what_is_loaded_from_the_cache_needs_no_compiler(tmp_path: Path) -> None:
    assert run(tmp_path, "Pair", 1) == "2.0"
    code = (
        f"import runpy, sys\nrunpy.run_path({str(tmp_path / 'outside.py')!r}, run_name='__main__')\n"
        "print('numba.np.linalg' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "2.0\nFalse\n"


@dataclass
class Session:
    """Kernels of a file as one process after another would have them, and what was compiled."""

    folder: Path
    compiled: list[str]
    kernel: Any = None

    @property
    def kernel_folder(self) -> Path:
        return self.folder / "__pycache__" / FOLDER

    def kernels(self) -> list[Path]:
        return list(self.kernel_folder.glob("*.nbc"))

    def call(self) -> float:
        file = self.folder / "twice.py"
        file.write_text("def twice(x):\n    return 2 * x\n")
        spec = importlib.util.spec_from_file_location("twice", file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        self.compiled.clear()
        with kernels.announced((), self.compiled.append):
            self.kernel = kernels.kernel(module.twice)
            result: float = self.kernel(2.0)
        return result

    def plant(self, data: Path, content: bytes) -> None:
        """Replace a kernel by other content with a valid checksum."""
        (signature,) = self.kernel.signatures
        cache = numba_cache(self.kernel)
        data.write_bytes(cache._checksum(signature, self.kernel.targetctx.codegen(), content) + content)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path, [])


def cut_off(data: Path) -> None:
    data.write_bytes(data.read_bytes()[: data.stat().st_size // 2])


def empty(data: Path) -> None:
    data.write_bytes(b"")


def one_bit(data: Path) -> None:
    content = data.read_bytes()
    data.write_bytes(content[:-2000] + bytes([content[-2000] ^ 1]) + content[-1999:])


def noise(data: Path) -> None:
    data.write_bytes(bytes(range(256)) * 100)


def foreign(data: Path) -> None:
    content = pickle.dumps(("another version", 1))
    data.write_bytes(hashlib.sha256(content).digest() + content)


def a_folder(data: Path) -> None:
    data.unlink()
    data.mkdir()


def no_folder(data: Path) -> None:
    shutil.rmtree(data.parent)
    data.parent.write_text("a file where the folder was")


@pytest.mark.parametrize("damage", [cut_off, empty, one_bit, noise, foreign, a_folder, no_folder])
def test_a_damaged_cache_counts_as_none(damage: Callable[[Path], None], session: Session) -> None:
    assert session.call() == 4
    assert session.compiled == ["compiling kernels: twice"]
    assert session.call() == 4
    assert session.compiled == []
    (data,) = session.kernels()
    damage(data)
    assert session.call() == 4
    assert session.compiled == ["compiling kernels: twice"]


class Planted:
    """Makes a folder when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return os.mkdir, (str(self.path),)


def folder_of_another_user(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    owner = os.geteuid()
    if owner == 0:
        os.chown(session.kernel_folder, 65534, -1)
    else:  # none but root can give a file away; another user may be the one who reads
        monkeypatch.setattr(kernel_cache.os, "geteuid", lambda: owner + 1)


def file_of_another_user(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    owner = os.geteuid()
    if owner != 0:
        pytest.skip("none but root can give a file away")
    os.chown(session.kernels()[0], 65534, -1)


def folder_of_a_group(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    session.kernel_folder.chmod(0o770)


def folder_of_all(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    session.kernel_folder.chmod(0o1777)


def file_of_a_group(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    session.kernels()[0].chmod(0o620)


def linked_folder(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    session.kernel_folder.rename(session.folder / "elsewhere")
    session.kernel_folder.symlink_to(session.folder / "elsewhere")


def linked_file(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    (data,) = session.kernels()
    data.rename(session.folder / "elsewhere")
    data.symlink_to(session.folder / "elsewhere")


def file_of_two_names(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    os.link(session.kernels()[0], session.folder / "elsewhere")


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="a system of users and modes")
@pytest.mark.parametrize(
    "opened",
    [
        folder_of_another_user,
        folder_of_a_group,
        folder_of_all,
        linked_folder,
        file_of_another_user,
        file_of_a_group,
        linked_file,
        file_of_two_names,
    ],
)
def test_kernel_that_another_user_could_have_written_is_not_run(
    opened: Callable[[Session, pytest.MonkeyPatch], None],
    session: Session,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert session.call() == 4
    (data,) = session.kernels()
    ran = session.folder / "ran"
    session.plant(data, pickle.dumps(Planted(ran)))
    opened(session, monkeypatch)
    assert session.call() == 4
    assert session.compiled == ["compiling kernels: twice"]
    assert not ran.exists()
    assert session.call() == 4
    of_folder = "folder" in opened.__name__
    assert session.compiled == (["compiling kernels: twice"] if of_folder else []), "a bad file is replaced"
    assert caplog.text.count("NUMBA_CACHE_DIR") == of_folder, "one warning for each folder"


def test_kernel_made_from_other_inputs_is_not_unpickled(session: Session) -> None:
    assert session.call() == 4
    (data,) = session.kernels()
    content = pickle.dumps(Planted(session.folder / "ran"))
    data.write_bytes(hashlib.sha256(content).digest() + content)
    assert session.call() == 4
    assert not (session.folder / "ran").exists()
    session.plant(data, content)
    assert session.call() == 4
    assert (session.folder / "ran").exists(), "the same content with its inputs' checksum is unpickled"


@pytest.mark.parametrize("first", ["glpath", "numba"])
def test_file_in_current_folder_does_not_choose_kernel_folder(first: str, tmp_path: Path) -> None:
    pytest.importorskip("yaml", reason="numba reads the file by PyYAML")
    planted = "cache_dir: planted\ncache_locator_classes: planted.Locator\n"
    (tmp_path / ".numba_config.yaml").write_text(planted + "disable_jit: 1\n" * (first == "glpath"))
    code = f"import {first}; from glpath.accel import bvh; from glpath.system.kernels import cache_folder as of; "
    code += "print(of(bvh._build))"
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment["PYTHONPATH"] = str(ROOT)
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert Path(done.stdout.strip()).name == FOLDER
    assert tmp_path not in Path(done.stdout.strip()).resolve().parents
    assert done.stderr == ""


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="a system of users and modes")
@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077])
def test_kernels_are_private_whatever_the_umask(umask: int, session: Session) -> None:
    before = os.umask(umask)
    try:
        assert session.call() == 4
    finally:
        os.umask(before)
    (data,) = session.kernels()
    assert [path.stat().st_mode & 0o777 for path in (session.kernel_folder, data)] == [0o700, 0o600]
    assert session.call() == 4
    assert session.compiled == []


def test_a_full_disk_costs_a_warning(
    session: Session, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(self: Path, content: bytes) -> int:
        self.touch()
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        assert session.call() == 4
        assert session.call() == 4
    assert caplog.text.count("No space left on device") == 1
    assert "NUMBA_CACHE_DIR" in caplog.text
    assert not list(session.kernel_folder.iterdir())


def test_without_any_place_for_a_cache_it_compiles(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(*arguments: object) -> None:
        raise RuntimeError("no locator available")

    monkeypatch.setattr(kernels, "KernelCache", nowhere)
    assert session.call() == 4
    assert session.compiled == ["compiling kernels: twice"]


SLOW = """
import time, sys
from glpath.system import kernels
begin = kernels._compilations.begin
def slowly(name):
    begin(name)
    time.sleep(2)
kernels._compilations.begin = slowly
import outside
"""


def test_of_two_processes_one_compiles(tmp_path: Path) -> None:
    """The other waits, and finds it in the cache."""
    run(tmp_path, "Pair", 1)
    for data in (tmp_path / "__pycache__" / FOLDER).glob("*.nbc"):
        data.unlink()
    both = [
        subprocess.Popen([sys.executable, "-c", SLOW], cwd=tmp_path, stdout=-1, stderr=-1, text=True)
        for _ in range(2)
    ]
    said = [process.communicate(timeout=100) for process in both]
    assert [out.strip() for out, _ in said] == ["2.0", "2.0"]
    assert sorted(err.count("compiling kernels: outer") for _, err in said) == [0, 1]
    assert sorted(err.count("waiting for outer, which another process compiles") for _, err in said) == [0, 1]
    assert not list((tmp_path / "__pycache__" / FOLDER).glob("*.lock"))


def test_time_limit_ends_the_wait_for_a_kernel_of_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, lock = Clock(monkeypatch), tmp_path / "a.lock"
    waits: list[str] = []

    def wait() -> None:
        waits.append("waiting")
        clock.ahead = 5.0  # the limit of 3 s and its grace are over

    with (
        kernel_cache._alone(lock, lambda: None),
        limited(3.0),
        pytest.raises(TimeLimitError, match="over while waiting for kernels that another process compiles"),
        kernel_cache._alone(lock, wait),
    ):
        pass
    assert waits == ["waiting"]


def test_kernels_are_told_by_name_and_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that another process has made count as well, or the last one would not be the last."""

    def _first() -> None: ...
    def second() -> None: ...
    def third() -> None: ...
    def fourth() -> None: ...

    told: list[str] = []
    with kernels.announced((_first, second, third, fourth), told.append):
        kernels._compilations.begin("_first")
        kernels._compilations.loaded("second")
        kernels._compilations.loaded("another")
        kernels._compilations.wait("third")
        kernels._compilations.loaded("third")
        kernels._compilations.begin("fourth")
        kernels._compilations.begin("unforeseen")
    assert told == [
        "compiling kernels: first 1/4",
        "waiting for third 3/4, which another process compiles",
        "compiling kernels: fourth 4/4",
        "compiling kernels: unforeseen 5/5",
    ]


def test_a_part_of_a_kernel_runs_as_python_when_python_calls_it() -> None:
    @kernels.inner_kernel
    def twice(x):  # type: ignore[no-untyped-def]
        return 2 * x

    @kernels.kernel_part
    def thrice(x):  # type: ignore[no-untyped-def]
        return 3 * x

    assert twice("a") == "aa"
    assert thrice("a") == "aaa"


FACTORIES = """
from glpath.system import kernels
kernels.only = {"second"}

@kernels.kernel
def first(x):
    return 2 * x

@kernels.kernel
def second(x):
    return 3 * x

assert (first(1), second(1)) == (2, 3)
assert not kernels.waiting([first, second])
print(type(first).__name__, len(second.signatures))
"""


def test_a_process_can_be_told_to_compile_one_kernel_only(tmp_path: Path) -> None:
    (tmp_path / "factories.py").write_text(FACTORIES)
    done = subprocess.run(
        [sys.executable, "factories.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "function 1", done.stderr


class Kernel:
    """What `compile_ahead` asks a kernel: is it compiled?"""

    def __init__(self, name: str, compiled: bool) -> None:
        self.__name__ = name
        self.signatures = [()] if compiled else []
        self._cache = object.__new__(kernels.KernelCache)
        self._cache.holds_any = lambda: False  # type: ignore[method-assign]
        self._cache._cache_path = "/tmp"  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("largest", "others", "cores", "processes"),
    [(False, 3, 2, 2), (True, 3, 2, 0), (False, 2, 2, 0), (False, 3, 1, 0)],
    ids=["all to do", "the largest is there", "not worth it", "one core"],
)
def test_a_process_compiles_the_largest_kernel_ahead(
    largest: bool, others: int, cores: int, processes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []

    class Process:
        def __init__(self, arguments: list[str], **_: object) -> None:
            started.append(arguments)

        def wait(self) -> int:
            return 0

    monkeypatch.setattr(ahead.subprocess, "Popen", Process)
    monkeypatch.setattr(ahead, "core_count", lambda: cores)
    needed = [Kernel(ahead.LARGEST[0], largest), *(Kernel(f"k{i}", i >= others) for i in range(5))]
    ahead.compile_ahead(needed)
    assert len(started) == processes


DEBUGGED = """
import numpy as np
from glpath.accel.bvh import build_bvh
from glpath.radiosity import Shaft, candidate_list

shaft = Shaft.between([[0, 0, 0], [1, 1, 0]], [[0, 0, 5], [1, 1, 5]])
boxes = np.array([[[0.2, 0.2, 2], [0.4, 0.4, 3]], [[2, 0, 2], [3, 1, 3]]])
bvh = build_bvh(boxes[:, 0], boxes[:, 1], leaf_size=1)
found = candidate_list(bvh, shaft)
print(shaft.classify(boxes).tolist(), shaft.classify_spheres([[0.5, 0.5, 2.5]], 0.1).tolist(), found.tolist())
"""


def test_without_compilation_kernels_are_functions_that_a_debugger_can_enter() -> None:
    answers = set()
    for plain in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": plain}
        done = subprocess.run(
            [sys.executable, "-c", DEBUGGED], env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        answers.add(done.stdout)
    assert answers == {"[2, 0] [2] [1]\n"}


def test_the_largest_kernel_is_one_that_a_solution_needs() -> None:
    box = path_traceable(load_scene("cornell-box-36"))
    of_methods = [kernels_of(box, Lighting.of(box), method, near_lamps=False) for method in METHODS]
    names = {k.__name__ for of_method in of_methods for k in of_method}
    assert ahead.LARGEST[0] in names


UNDER_A_SKY = {
    "camera": {"position": [0.5, 0.5, 5], "target": [0.5, 0.5, 0]},
    "shapes": [{"type": "box", "min": [0, 0, 0], "max": [1, 1, 1]}],
    "sky": {"zenith": 1},
}


def test_boxes_lamps_and_skies_need_kernels_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def names(scene: Any, *, near_lamps: bool) -> set[str]:
        traced = path_traceable(load_scene(scene))
        found = kernels_of(traced, Lighting.of(traced), "monte-carlo", near_lamps)
        return {k.__name__ for k in found} - {"_parallelograms", "_build", "shoot_batch"}

    monkeypatch.setattr(ahead, "waiting", list)
    assert names("cornell-box", near_lamps=True) == {"_closest"}
    assert names("cornell-box-36", near_lamps=True) == {"_closest", "_in_the_open"}
    assert names("cornell-box-36", near_lamps=False) == {"_in_the_open"}
    assert names("furnace", near_lamps=False) == set()
    assert names(UNDER_A_SKY, near_lamps=True) == {"_free", "_in_the_open"}


FIRST_RUN = """
import re, glpath
told = []
glpath.solve_radiosity(
    {scene!r}, method={method!r}, for_camera={for_camera}, patches=40, particles=1 << 14,
    on_progress=lambda progress: told.extend(re.findall("([0-9]+)/([0-9]+)", progress.stage)),
)
print(told[-1][0], *{{total for _, total in told}})
"""


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("scene", "method", "for_camera"),
    [
        ("cornell-box", "monte-carlo", True),
        ("room", "monte-carlo", True),
        (UNDER_A_SKY, "monte-carlo", True),
        ("cornell-box", "progressive", False),
    ],
)
def test_a_first_run_compiles_as_many_kernels_as_it_announces(
    scene: Any, method: str, for_camera: bool, tmp_path: Path
) -> None:
    code = FIRST_RUN.format(scene=scene, method=method, for_camera=for_camera)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "compiling" not in done.stderr, "before it was announced"
    last, *totals = done.stdout.split()
    assert [last] == totals


@pytest.mark.evidence
def test_the_first_solution_compiles_in_several_processes(tmp_path: Path) -> None:
    """The others meet the very types that this one asks for, or the largest kernels would be compiled twice."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "glpath", "radiosity", "cornell-box", "--patches", "40"]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "box.npz")], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "compiling kernels: factors" in done.stderr
    for name in ahead.LARGEST:
        assert f"compiling kernels: {name}" not in done.stderr
        assert len(list(tmp_path.rglob(f"*.{name}*.nbc"))) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such locks")
def test_a_lock_whose_descriptor_is_that_of_a_closed_standard_input_is_released(tmp_path: Path) -> None:
    program = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from glpath.system.kernel_cache import _alone\n"
        "os.close(0)\n"
        "with _alone(Path('kernel.lock'), lambda: None):\n"
        "    assert os.path.samestat(os.fstat(0), os.stat('kernel.lock'))\n"
        "assert not os.path.exists('kernel.lock')\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
