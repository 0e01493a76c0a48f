"""View factors: closed forms, closed rooms compared with pyviewfactor, and a city of 22,000 facets.

A room is closed, so its rows add up to 1, and the deviation is an error that needs no reference. pyviewfactor runs
in the same run on the same triangles (`pyviewfactor_worker`); it comes with the extra `peers`, perhaps in another
Python (`other_python`). The time of a call counts, in a process that has imported and compiled everything: ours
from corners and faces to the matrix, including checks and threads; pyviewfactor's from its mesh on.

uDALES's city is not available, so ours has as many facets. Its time is compared with the published one in seconds
times threads. Processors differ, so only the order of magnitude of the ratio is meaningful.

Source: uDALES issue 329: 22,176 facets, 5.8 million factors, 1280 s on eight threads, 0.83 GiB.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import other_python
from benchmarks.verdict import Condition, Report, faults, judge, machine
from benchmarks.view_factor_scenes import CLOSED_FORMS, block_in_a_room, city
from glpath.apps.view_factors.compute import ViewFactorProgress, view_factors
from glpath.errors import GlpathError
from glpath.system.machine import core_count, peak_resident_bytes
from glpath.system.versions import versions

Row = dict[str, Any]
Say = Callable[[str], None]

CLAIM = "closed forms within 0.5 %, five times faster than pyviewfactor at a smaller error"
AGREEMENT = (Condition("closed_forms_off", "<=", 0.005),)
RULE = (
    *AGREEMENT,
    Condition("times_pyviewfactor_least", ">=", 5.0),
    Condition("error_over_pyviewfactor", "<=", 1.0),
)
#: Cells along an edge of a room with a block, which give 96 to 9,600 faces.
ROOMS = (2, 4, 7, 12, 20)
#: Target errors of our rows: the default, and one that is still far below pyviewfactor's error.
ERRORS = {"glpath": 1e-3, "glpath, error 1e-2": 1e-2}
#: Blocks along a side, with 57 facets each: 22,800 facets.
BLOCKS = 20
#: Published seconds times threads of uDALES's view3d.
PUBLISHED_CORE_S = 8 * 1280.0
#: Seconds of a room after which no further turn is made.
_ENOUGH_S = 20.0
#: Memory of pyviewfactor for each pair of faces, and its maximum memory, bytes.
_PEER_BYTES, _PEER_MOST = 90, 3 << 30


def closed_form_rows() -> list[Row]:
    """Return a row for each closed form: its value, the computed one, and the relative error."""
    rows = []
    for case in CLOSED_FORMS:
        found = float(view_factors(case.faces, groups=case.groups).matrix[0, 1])
        rows.append({"case": case.name, "exact": case.factor, "found": found, "off": found / case.factor - 1})
    return rows


def room_rows(rooms: tuple[int, ...], rounds: int, say: Say) -> list[Row]:
    """Return rows of rooms with 24 cells^2 triangles, computed by us and by pyviewfactor in turns.

    The rows have median seconds, wall and processor, and errors of row sums.
    """
    rows: list[Row] = []
    try:
        peer: _Peer | None = _Peer()
    except GlpathError as error:
        say(str(error))
        peer = None
    try:
        for cells in rooms:
            vertices, faces = block_in_a_room(cells)
            say(f"a room of {len(faces):,} faces")
            triangles = vertices[np.array(faces)]
            beside = peer if _PEER_BYTES * len(faces) ** 2 <= _PEER_MOST else None
            times: dict[str, list[tuple[float, float]]] = {}
            sums: dict[str, NDArray[np.float64]] = {}
            # For slow rooms, one or two turns are enough.
            for _ in range(rounds):
                if sum(wall for each in times.values() for wall, _ in each) > _ENOUGH_S:
                    break
                for name, wanted in ERRORS.items():
                    start, before = time.perf_counter(), time.process_time()
                    ours = view_factors((vertices, faces), error=wanted)
                    spent = time.perf_counter() - start, time.process_time() - before
                    sums[name] = ours.row_sums
                    times.setdefault(name, []).append(spent)
                if beside is not None:
                    spent, found = beside.matrix(triangles)
                    sums["pyviewfactor"] = found.sum(axis=1)
                    times.setdefault("pyviewfactor", []).append(spent)
            base = statistics.median(wall for wall, _ in times["glpath"])
            for name, each in times.items():
                off = np.abs(sums[name] - 1)
                seconds = statistics.median(wall for wall, _ in each)
                rows.append(
                    {
                        "faces": len(faces),
                        "program": name,
                        "seconds": seconds,
                        "CPU seconds": statistics.median(cpu for _, cpu in each),
                        "times ours": seconds / base,
                        "error, most": float(off.max()),
                        "error, mean": float(off.mean()),
                    }
                )
    finally:
        if peer is not None:
            peer.close()
    return rows


class _Peer:
    """pyviewfactor in a process that has started and compiled."""

    def __init__(self) -> None:
        _, self.version = other_python.find_package("pyviewfactor", other_python.python())
        self._folder = tempfile.TemporaryDirectory(prefix="glpath-")
        worker = Path(__file__).parents[1] / "peers" / "pyviewfactor_worker.py"
        self._log = (Path(self._folder.name) / "log").open("w+")
        self._process = subprocess.Popen(
            [other_python.python(), str(worker)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True,
        )  # fmt: skip
        self._answer()

    def matrix(self, triangles: NDArray[np.float64]) -> tuple[tuple[float, float], NDArray[np.float64]]:
        mesh, out = Path(self._folder.name) / "mesh.npz", Path(self._folder.name) / "F.npy"
        np.savez(mesh, triangles=triangles)
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"mesh": str(mesh), "out": str(out)}) + "\n")
        self._process.stdin.flush()
        answer = self._answer()
        return (float(answer["seconds"]), float(answer["CPU seconds"])), np.load(out)

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        self._log.close()
        self._folder.cleanup()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._process.wait()
            self._log.seek(0)
            raise GlpathError(f"pyviewfactor ended: {self._log.read()[-500:].strip()}", "See its manual.")
        answer: dict[str, Any] = json.loads(line)
        return answer


def city_row(blocks: int, say: Say) -> Row:
    """Return the row of a city of 57 blocks^2 facets: seconds, factors, memory, and its estimated errors."""
    faces = city(blocks)
    start = time.perf_counter()
    before = time.process_time()
    told = 0

    def report(progress: ViewFactorProgress) -> None:
        nonlocal told
        tenths = 10 * progress.done // max(progress.total, 1)
        if progress.stage == "rows" and tenths > told:
            told = tenths
            say(f"  {progress.done:,} of {progress.total:,} rows after {progress.elapsed_s:,.0f} s")

    found = view_factors(faces, on_progress=report)
    return {
        "facets": len(found),
        "factors": int(found.matrix.nnz),
        "seconds": time.perf_counter() - start,
        "core seconds": time.process_time() - before,
        "GiB, most": peak_resident_bytes() / 2**30,
        "error, most": float(found.error.max()),
        "error, mean": float(found.error.mean()),
    }


def bench_view_factors(scale: float = 1.0, rounds: int = 7, say: Say = lambda text: None) -> Report:
    """Measure; takes some minutes on two cores.

    The report's numbers: `closed_forms_off`, the largest relative error; `times_pyviewfactor_N`, its time divided
    by ours for N faces with an error of 1e-2, and the smallest of these; `cpu_times_pyviewfactor_N`, the same for
    CPU time, which depends less on other programs; `error_over_pyviewfactor`, the largest ratio of our largest row
    error to pyviewfactor's; `closure_error_most`, our error with the default target; `city_core_s`, and the
    published time divided by it.

    Parameters
    ----------
    scale  : below 1, smaller rooms and a smaller city; the names of what is measured stay
    rounds : turns of each program; the median counts
    say    : function that gets messages about the progress
    """
    notes: list[str] = []

    def tell(text: str) -> None:
        say(text)
        if "pyviewfactor" in text:
            notes.append(f"without pyviewfactor: {text}")

    say("closed forms")
    forms = closed_form_rows()
    numbers = {"closed_forms_off": max(abs(row["off"]) for row in forms)}
    blocks = max(2, round(BLOCKS * scale))
    say(f"a city of {57 * blocks**2:,} facets")
    town = city_row(blocks, say)  # before the rooms, whose matrices are dense and take more memory
    rooms = room_rows(tuple(c for c in ROOMS if c <= max(2, ROOMS[-1] * scale)), rounds, tell)
    ours = {row["faces"]: row for row in rooms if row["program"] == "glpath"}
    peers = [row for row in rooms if row["program"] == "pyviewfactor"]
    loose = {row["faces"]: row for row in rooms if row["program"] == "glpath, error 1e-2"}
    numbers["closure_error_most"] = max(row["error, most"] for row in ours.values())
    for row in peers:
        beside = loose[row["faces"]]
        numbers[f"times_pyviewfactor_{row['faces']}"] = row["seconds"] / beside["seconds"]
        numbers[f"cpu_times_pyviewfactor_{row['faces']}"] = row["CPU seconds"] / beside["CPU seconds"]
    if peers:
        numbers["times_pyviewfactor_least"] = min(row["seconds"] / loose[row["faces"]]["seconds"] for row in peers)
        numbers["error_over_pyviewfactor"] = max(
            loose[row["faces"]]["error, most"] / max(row["error, most"], 1e-300) for row in peers
        )
    numbers |= {
        "city_facets": town["facets"],
        "city_core_s": town["core seconds"],
        "city_GiB": town["GiB, most"],
    }
    if scale == 1:
        numbers["published_core_s_over_ours"] = PUBLISHED_CORE_S / town["core seconds"]
        notes.append("published: uDALES issue 329, 1280 s on eight threads, 0.83 GiB, another city and processor")
    else:
        notes.append(f"at scale {scale:g}")
    claim, holds = judge(CLAIM, RULE, numbers) if peers else (CLAIM, None)
    return Report(
        name="viewfactors",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=[*forms, *rooms, town],
        machine=machine("none; on the CPU"),
        versions=versions("glpath", "numpy", "numba", "scipy") | _peer_version(),
        notes=[*dict.fromkeys(notes), f"{core_count()} cores"],
        faults=faults(AGREEMENT, numbers),
    )


def _peer_version() -> dict[str, str]:
    try:
        return {"pyviewfactor": other_python.find_package("pyviewfactor", other_python.python())[1]}
    except GlpathError:
        return {}
