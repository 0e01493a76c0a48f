"""Compiled functions are compiled again when a file that they call into has changed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from glpath.kernels import folder_stamp

INNER = """
from typing import NamedTuple
from glpath.kernels import inner_kernel

class {name}(NamedTuple):
    value: float

@inner_kernel
def inner(pair):
    return pair.value + {number}
"""
OUTER = """
import inside
from glpath.kernels import kernel

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
    names = [name for name, *_ in folder_stamp(outer)]
    (tmp_path / "beside.py").write_text("")
    assert names == [name for name, *_ in folder_stamp(inner)]
    assert "lower/inside.py" in names
    assert "beside.py" not in names


def test_an_unchanged_folder_is_loaded_from_the_cache(tmp_path: Path) -> None:
    run(tmp_path, "Pair", 1)
    (data,) = (tmp_path / "__pycache__").glob("outside.outer*.nbc")
    before, stamp = data.stat().st_mtime_ns, folder_stamp(tmp_path / "outside.py")
    subprocess.run([sys.executable, "outside.py"], cwd=tmp_path, capture_output=True, check=True)
    assert data.stat().st_mtime_ns == before
    assert folder_stamp(tmp_path / "outside.py") == stamp
