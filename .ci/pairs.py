"""Speed of two trees in interleaved pairs: python .ci/pairs.py OLD NEW [--pairs 10] [--json FILE] [BENCH ...]

OLD and NEW are folders of checkouts; both run with this Python, which has what they need. A bench is one command.
Old and new take turns, after one run each that is not counted. What is compared is the processor time of the whole
process, as the wall time of a shared machine says little. A line has the geometric mean of the ratios new / old and
its 95 % interval; a bench is slower where the whole interval is above 1.03, and the exit code is then 1.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

# Student's t, 97.5 %, by degrees of freedom.
_T = {2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365, 8: 2.306, 9: 2.262, 14: 2.145, 19: 2.093}
_SLOWER = 1.03

BOX = "render cornell-box-36 --resolution 256x256 -o OUT.png"
BENCHES = {
    "path": f"{BOX} --integrator path --max-depth 5 --spp 48",
    "path-buffer": f"{BOX} --integrator path-buffer --max-depth 4 --spp 96",
    "gather": f"{BOX} --integrator gather --spp 24",
    "t-buffer": "render three-spheres --integrator t-buffer --resolution 512x512 --spp 32 -o OUT.png",
    "classic": "render three-spheres --integrator classic --resolution 512x512 --spp 32 -o OUT.png",
    "textures": "render parlour --integrator path --max-depth 4 --resolution 128x96 --spp 8 -o OUT.png",
    "lightmap": "lightmap cornell-box-36 --size 128 --spp 24 -o OUT.glb",
    "measure": "measure office --plane y=0.85 --spacing 0.25 --spp 1024 -o OUT.csv",
    "radiosity": "radiosity office -o OUT.npz --max-steps 300",
    "viewfactors": "viewfactors office --error 1e-1 -o OUT.npz",
}


def processor_seconds(tree: Path, command: str, folder: Path) -> float:
    """User and system time of the command in a tree, its children included."""
    words = [word.replace("OUT", str(folder / "out")) for word in command.split()]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "glpath", *words, "--quiet"],
        cwd=tree,
        # Python must keep its bytecode, or every run compiles the package anew.
        env={**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": ""},
        capture_output=True,
        text=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{tree}: glpath {command}: exit code {done.returncode}\n{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compared(old: Path, new: Path, commands: tuple[str, str], pairs: int) -> dict[str, Any]:
    """Ratios new / old of the pairs, their geometric mean and its interval."""
    ratios, seconds = [], []
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(pairs + 1):
            order = ((old, 0), (new, 1)) if turn % 2 else ((new, 1), (old, 0))
            times = {which: processor_seconds(tree, commands[which], Path(folder)) for tree, which in order}
            if turn:
                ratios.append(times[1] / times[0])
                seconds.append(times[0])
    logs = [math.log(ratio) for ratio in ratios]
    mean = sum(logs) / pairs
    spread = math.sqrt(sum((log - mean) ** 2 for log in logs) / (pairs - 1) / pairs)
    half = _T.get(pairs - 1, 1.98) * spread
    low, high = math.exp(mean - half), math.exp(mean + half)
    middle = sorted(seconds)[pairs // 2]
    return {"ratio": math.exp(mean), "low": low, "high": high, "old_s": middle, "slower": low > _SLOWER}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("benches", nargs="*", metavar="BENCH", help=", ".join(BENCHES))
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--json", type=Path)
    parser.add_argument(
        "--old-command", action="append", default=[], metavar="BENCH=COMMAND", help="where it differs"
    )
    given = parser.parse_args()
    differs = dict(each.split("=", 1) for each in given.old_command)
    found = {}
    for name in given.benches or BENCHES:
        command = BENCHES[name]
        commands = (differs.get(name, command), command)
        row = found[name] = compared(given.old.resolve(), given.new.resolve(), commands, given.pairs)
        print(
            f"{name:12s} {row['ratio']:.3f} ({row['low']:.3f} to {row['high']:.3f}) of {row['old_s']:.1f} s"
            f"{'  SLOWER' if row['slower'] else ''}",
            flush=True,
        )
    if given.json:
        machine = {"cpu": platform.processor() or platform.machine(), "cores": os.cpu_count()}
        given.json.write_text(
            json.dumps({"pairs": given.pairs, "benches": found, "machine": machine}, indent=1) + "\n"
        )
    return int(any(row["slower"] for row in found.values()))


if __name__ == "__main__":
    sys.exit(main())
