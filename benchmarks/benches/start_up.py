"""Time of a small picture from the shell, for the whole process: the cost that each job of a batch pays.

Programs take turns, and the median counts. Each runs once before, so that shaders and files are cached. Mitsuba
renders its own box, which is the same scene, at the same size and with as many samples, in both of its variants for
the CPU. The faster variant is compared.

measured:
    python_s, glpath_s, mitsuba_s : seconds of a process: an empty Python, glpath, Mitsuba
    vs_mitsuba                    : Mitsuba's time divided by ours
    default_s                     : seconds of `glpath render cornell-box` at the same size, which is denoised
    cold_s                        : the same without cached shaders and kernels
    cold_512_s                    : the same at 512 x 512, which needs a radiosity solution and its kernels
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.peers.mitsuba import find_llvm
from benchmarks.timing import in_turns, seconds_of
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.errors import GlpathError
from glpath.gl.context import get_context
from glpath.system.versions import versions

RULE = (Condition("glpath_s", "<=", 1.2), Condition("cold_s", "<=", 6.0))
_SIZE = 64
_DEFAULT = ("-m", "glpath", "render", "cornell-box", "--quiet")
# Sizes that are rendered with empty caches; the larger one needs a radiosity solution, whose kernels are compiled.
_COLD = {"cold_s": (_SIZE, _SIZE), "cold_512_s": (512, 512)}

_MITSUBA = """
import sys
import mitsuba as mi
mi.set_variant(sys.argv[1])
box = mi.cornell_box()
box["sensor"]["film"] |= {"width": int(sys.argv[2]), "height": int(sys.argv[2])}
mi.util.write_bitmap(sys.argv[3], mi.render(mi.load_dict(box), spp=1), write_async=False)
"""


def bench_start_up(rounds: int = 7, progress: Callable[[str], None] = lambda text: None) -> Report:
    """Time the processes. Raises GlpathError if glpath fails; a peer that does not run is left out."""
    with tempfile.TemporaryDirectory() as folder:
        picture = str(Path(folder, "a.png"))
        ours = ["-m", "glpath", "render", "cornell-box-36", "--spp", "1", "--resolution", f"{_SIZE}x{_SIZE}"]
        default = [*_DEFAULT, "-o", picture, "--resolution", f"{_SIZE}x{_SIZE}"]
        programs = {"python": ["-c", "pass"], "glpath": [*ours, "--quiet", "-o", picture], "default": default}
        if importlib.util.find_spec("mitsuba") is not None:
            for variant in ("scalar_rgb", "llvm_ad_rgb"):
                programs[f"mitsuba {variant}"] = ["-c", _MITSUBA, variant, str(_SIZE), picture]
        failed = {}
        for name, arguments in programs.items():
            progress(f"{name}, once to fill its caches")
            done = _run(arguments)
            if done.returncode:
                failed[name] = (done.stderr.decode(errors="replace").strip().splitlines() or ["no word"])[-1]
        if "glpath" in failed:
            raise GlpathError(f"bench start-up: glpath render failed: {failed['glpath']}", "See `glpath doctor`.")
        progress(f"{rounds} turns")
        contestants = {
            name: partial(seconds_of, partial(_run, arguments))
            for name, arguments in programs.items()
            if name not in failed
        }
        seconds = in_turns(contestants, rounds)
        progress("with empty caches")
        cold = {key: _cold([*default[:-1], f"{width}x{height}"]) for key, (width, height) in _COLD.items()}
    measured = {f"{name.replace(' ', '_')}_s": s for name, s in seconds.items() if "mitsuba" not in name} | cold
    peers = [s for name, s in seconds.items() if name.startswith("mitsuba")]
    if peers:
        measured |= {"mitsuba_s": min(peers), "vs_mitsuba": min(peers) / seconds["glpath"]}
    claim = f"a picture of {_SIZE} x {_SIZE} and one path set within 1.2 s, the first one of a machine within 6 s"
    claim, holds = judge(claim, RULE, measured)
    return Report(
        "start-up",
        claim,
        measured,
        holds,
        rows=[{"program": name, "seconds": s} for name, s in seconds.items()],
        machine=machine(get_context().info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "mitsuba"),
        notes=[f"left out: {name}: {why}" for name, why in failed.items()],
    )


def _cold(arguments: list[str]) -> float:
    """Return the seconds of a process without cached shaders of Mesa and kernels of numba."""
    with tempfile.TemporaryDirectory() as home:
        caches = {
            "HOME": home,
            "XDG_CACHE_HOME": str(Path(home, ".cache")),
            "NUMBA_CACHE_DIR": str(Path(home, "numba")),
        }
        return seconds_of(partial(_run, arguments, caches))


def _run(arguments: list[str], more: dict[str, str] | None = None) -> subprocess.CompletedProcess[bytes]:
    llvm = find_llvm()
    environment = os.environ | ({"DRJIT_LIBLLVM_PATH": llvm} if llvm else {}) | (more or {})
    return subprocess.run(
        [sys.executable, *arguments], env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False
    )
