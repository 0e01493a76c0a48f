"""Feeds glpath hostile input and failures of the system, and counts the outcomes.

    python tests/support/attack.py [KIND ...]      all, or some of: scenes, environments, disks, kills, threads

Prints JSON: for each kind, the number of inputs that were `tried`, that were `fine`, and that got a clear `error`;
and the numbers of outcomes that must not occur: `traceback`, `crash` (a signal, or an undocumented exit code),
`hang`, and `lost` (a film that was on disk before, or was reported as written, is incomplete afterwards). `first`
has the first of these. The run is deterministic but for the times of signals. `damaged.py` attacks data files and
meshes.
"""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

BAD = ("traceback", "crash", "hang", "lost")
_SECONDS = 60.0
_RENDER = ("render", "cornell-box-36", "--resolution", "16x16", "--max-depth", "2", "--progress", "none")

# A small scene that uses all parts of a scene file.
EVERYTHING = """
name = "everything"
ambient = [0.1, 0.1, 0.1]
[camera]
type = "perspective"
position = [0, 1, 4]
target = [0, 1, 0]
up = [0, 1, 0]
fov = 40
[film]
resolution = [16, 12]
exposure = 0.5
[textures.squares]
type = "checker"
colors = [[1, 1, 1], [0, 0, 0]]
[materials.chalk]
type = "diffuse"
reflectance = [0.7, 0.7, 0.65]
texture = "squares"
[materials.gloss]
type = "phong"
reflectance = 0.3
specular = 0.2
exponent = 20
mirror = 0.3
[[shapes]]
type = "quad"
corners = [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]]
material = "chalk"
[[shapes]]
type = "sphere"
center = [0, 0.6, 0]
radius = 0.6
material = "gloss"
[[shapes]]
type = "box"
min = [-0.3, 2.0, -0.3]
max = [0.3, 2.05, 0.3]
emission = { radiance = 12 }
[[shapes]]
type = "mesh"
vertices = [[0, 0, 1], [1, 0, 1], [0, 1, 1]]
faces = [[0, 1, 2]]
transform = [{ translate = [0, 0.5, 0] }, { scale = 0.5 }]
[[shapes]]
type = "plane"
point = [0, -1, 0]
normal = [0, 1, 0]
[[lights]]
type = "point"
position = [1, 3, 1]
intensity = 5
[[lights]]
type = "spot"
position = [1, 3, 1]
target = [0, 0, 0]
intensity = 5
[[lights]]
type = "directional"
direction = [0, -1, 0.2]
irradiance = 1
[sky]
zenith = [0.2, 0.3, 0.5]
horizon = 0.4
"""

VALUES: tuple[Any, ...] = (
    "",
    "x",
    "chalk",
    "\x1b[31m\u202e",
    "a" * 10_000,
    True,
    0,
    -1,
    2**70,
    1e308,
    -1e308,
    1e-308,
    float("nan"),
    float("inf"),
    [],
    [0, 0, 0],
    [1, 2],
    [[]],
    [1e38, 1e38, 1e38],
    [float("nan")] * 3,
    ["x", 1, 2],
    {},
    {"type": "x"},
    {"radiance": -1},
)


def toml(value: Any) -> str:
    """Return a value as TOML, with inline tables."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool | str):
        return json.dumps(value)
    return repr(value)


def document(data: dict[str, Any]) -> str:
    return "".join(f"{key} = {toml(value)}\n" for key, value in data.items())


def leaves(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield (container, key) of everything in the value, except the value itself."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in items:
        yield value, key
        yield from leaves(each)


def scenes() -> Iterator[tuple[str, bytes]]:
    """Yield scene files: each value replaced, omitted or duplicated, then the text itself damaged."""
    count = len(list(leaves(tomllib.loads(EVERYTHING))))
    rng = random.Random(0)
    for i in range(count):
        value: Any
        for value in ("left out", "unknown", "scaled", *rng.sample(VALUES, 5)):
            data = tomllib.loads(EVERYTHING)
            container, key = list(leaves(data))[i]
            if value == "scaled" and isinstance(container[key], int | float):
                value = rng.choice((-1, 1e-9, 1e-3, 0.5, 3, 1e6, 1e14)) * container[key]
            if value == "left out":
                del container[key]
            elif value == "unknown" and isinstance(container, dict):
                container["unknown"] = 1
            else:
                container[key] = value
            yield f"{key} {str(value)[:20]}", document(data).encode()
    whole = EVERYTHING.encode()
    for _ in range(100):
        yield "cut", whole[: rng.randrange(len(whole))]
    for _ in range(300):
        changed = bytearray(whole)
        for _ in range(rng.choice((1, 1, 3, 20))):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
        yield "changed", bytes(changed)
    yield from {
        "empty": b"",
        "nothing": bytes(1000),
        "random": rng.randbytes(5000),
        "utf-16": EVERYTHING.encode("utf-16"),
        "bom": b"\xef\xbb\xbf" + whole,
        "crlf": whole.replace(b"\n", b"\r\n"),
        "twice": whole * 2,
        "deep arrays": b"a = " + b"[" * 100_000,
        "deep tables": b"a = " + b"{a = " * 100_000,
        "deep names": b"[" + b"a." * 50_000 + b"a]\n",
        "long line": b"name = '" + b"x" * 5_000_000 + b"'\n" + whole,
        "many shapes": whole + b'[[shapes]]\ntype = "sphere"\nradius = 0.01\n' * 3000,
        "a folder": b"",
        "big file": whole + b"\n# " + b"x" * 20_000_000,
        "number": b"seed = " + b"9" * 100_000,
    }.items()


def attack_scenes(start: int) -> None:
    """Run in the child: print a line of JSON before and after each input, from number `start` on."""
    import glpath
    from glpath.scene import check_scene

    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "scene.toml")
        for number, (name, content) in enumerate(scenes()):
            if number < start:
                continue
            print(json.dumps([number, name]), flush=True)
            try:
                if name == "a folder":
                    scene = glpath.load_scene(f"{folder}/")
                else:
                    path.write_bytes(content)
                    scene = glpath.load_scene(path)
                check_scene(scene)
                repr(scene)
                film = glpath.render(scene, integrator="t-buffer", spp=1, max_depth=2, resolution=(8, 6))
                outcome = "fine" if np.isfinite(film.mean).all() else "traceback"
            except glpath.GlpathError as error:
                outcome = "error" if str(error).strip() else "traceback"
            except Exception:
                outcome = "traceback"
                traceback.print_exc()
            print(json.dumps(outcome), flush=True)


def run_scenes() -> Iterator[tuple[str, str]]:
    total, done = sum(1 for _ in scenes()), 0
    while done < total:
        command = [sys.executable, __file__, "--child", "scenes", str(done)]
        name = ""
        with (
            tempfile.TemporaryFile("w+") as errors,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as child,
        ):
            assert child.stdout is not None
            while True:
                watch = threading.Timer(_SECONDS, child.kill)
                watch.start()
                line = child.stdout.readline()
                watch.cancel()
                if not line:
                    break
                said = json.loads(line)
                if isinstance(said, list):
                    done, name = said[0] + 1, said[1]
                    continue
                errors.seek(0)
                yield said, f"{name}: {errors.read()[-300:]}"
                name = ""
            child.wait()
        if name:
            yield ("hang" if child.returncode == -signal.SIGKILL else "crash"), name
        elif done < total:
            yield "crash", f"after input {done}: exit code {child.returncode}"
            return


def command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "glpath", *map(str, arguments)]


def judged(done: subprocess.CompletedProcess[bytes], out: Path, codes: tuple[int, ...] = (0, 1, 2)) -> str:
    """Return the outcome of a command that should write `out`."""
    if b"Traceback" in done.stderr:
        return "traceback"
    if done.returncode not in codes:
        return "crash"
    if done.returncode == 0:
        return "fine" if out.is_file() and out.stat().st_size else "lost"
    return "error" if b"glpath: " in done.stderr else "traceback"


def environments() -> Iterator[tuple[str, dict[str, str | None], dict[str, Any]]]:
    """Yield a name, changes of the environment (None: unset), and further arguments of subprocess.run."""
    for name, value in {
        "HOME": None,
        "PATH": "",
        "LANG": "C",
        "LC_ALL": "POSIX",
        "PYTHONUTF8": "0",
        "PYTHONIOENCODING": "ascii",
        "PYTHONOPTIMIZE": "2",
        "PYTHONWARNINGS": "error",
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONHASHSEED": "1",
        "TERM": "dumb",
        "NO_COLOR": "1",
        "COLUMNS": "0",
        "LINES": "x",
        "TMPDIR": "/nonexistent",
        "XDG_CACHE_HOME": "/dev/null",
        "NUMBA_CACHE_DIR": "/proc/nowhere",
        "NUMBA_DISABLE_JIT": "1",
        "DISPLAY": ":99",
        "WAYLAND_DISPLAY": "none",
        "EGL_PLATFORM": "x11",
        "LP_NUM_THREADS": "1",
        "MESA_SHADER_CACHE_DIR": "/dev/null/x",
        "MESA_GL_VERSION_OVERRIDE": "3.3",
        "LIBGL_DRIVERS_PATH": "/nonexistent",
        "GLPATH_DEVICE": "99",
        "GLPATH_BACKEND": "nonsense",
        "GLPATH_TEXELS": "nonsense",
        "OMP_NUM_THREADS": "0",
    }.items():
        yield f"{name}={value}", {name: value}, {}
    yield "HOME is a file", {"HOME": "/etc/passwd"}, {}
    yield "no input", {}, {"stdin": None}
    yield "little memory", {}, {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))}
    yield "few files", {}, {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (24, 24))}
    yield "no core", {}, {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_CORE, (0, 0))}
    yield "nice", {}, {"preexec_fn": lambda: os.nice(19)}


def run_environments() -> Iterator[tuple[str, str]]:
    root = str(Path(__file__).resolve().parents[2])
    with tempfile.TemporaryDirectory() as folder:
        for i, (name, changes, more) in enumerate(environments()):
            environment = {**os.environ, "PYTHONPATH": root} | changes
            out = Path(folder, f"{i}.png")
            more = {"stdin": subprocess.DEVNULL} | more
            try:
                done = subprocess.run(
                    command(*_RENDER, "-o", out, "--spp", "1"),
                    env={key: value for key, value in environment.items() if value is not None},
                    capture_output=True,
                    timeout=_SECONDS,
                    **more,
                )
                yield judged(done, out), f"{name}: {done.returncode} {done.stderr[-300:].decode(errors='replace')}"
            except subprocess.TimeoutExpired:
                yield "hang", name


def run_disks() -> Iterator[tuple[str, str]]:
    """Limit the size of files. One output is small, the other large, and replaces an old film."""
    with tempfile.TemporaryDirectory() as folder:
        small, film = Path(folder, "a.png"), Path(folder, "film.npz")
        first = subprocess.run(command(*_RENDER, "-o", film, "--spp", "1"), capture_output=True)
        old = film.read_bytes()
        assert first.returncode == 0, first.stderr
        for limit in (0, 1, 100, 1000, 3000, 10_000, 20_000, 10**9):
            small.unlink(missing_ok=True)
            film.write_bytes(old)

            def bounded(limit: int = limit) -> None:
                signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

            done = subprocess.run(
                command(*_RENDER, "-o", small, "-o", film, "--spp", "40"),
                capture_output=True,
                timeout=_SECONDS,
                preexec_fn=bounded,
                env={**os.environ, "MESA_SHADER_CACHE_DISABLE": "true", "PYTHONDONTWRITEBYTECODE": "1"},
            )
            outcome = judged(done, film)
            new = film.read_bytes() if film.is_file() else b""
            if new != old and not whole(film):
                outcome = "lost"
            named = {path for path in (small, film) if path.name.encode() in done.stderr}
            if outcome == "error" and not named:
                outcome = "lost"
            yield outcome, f"{limit} bytes: {done.returncode} {done.stderr[-300:].decode(errors='replace')}"


def whole(film: Path) -> bool:
    from glpath import Film, GlpathError

    try:
        return Film.load(film).path_sets > 0
    except GlpathError:
        return False


def run_kills() -> Iterator[tuple[str, str]]:
    """Send signals, one or more, at random moments of a render that replaces a film."""
    rng = random.Random(1)
    # nohup ignores SIGHUP, and the children would inherit that; with a handler here, they get the default.
    signal.signal(signal.SIGHUP, lambda *_: None)
    with tempfile.TemporaryDirectory() as folder:
        film, picture = Path(folder, "film.npz"), Path(folder, "a.png")
        subprocess.run(command(*_RENDER, "-o", film, "--spp", "1"), check=True, capture_output=True)
        # While the program starts, a signal kills Python itself; this time depends on the machine.
        begun = time.monotonic()
        subprocess.run(command("--version"), check=True, capture_output=True)
        starting = max(1.0, 2.0 * (time.monotonic() - begun))
        for number in [signal.SIGTERM] * 10 + [signal.SIGINT] * 8 + [signal.SIGKILL] * 8 + [signal.SIGHUP] * 2:
            wait, times = rng.uniform(0.0, 3.0), rng.choice((1, 1, 2))
            child = subprocess.Popen(
                command(*_RENDER, "-o", film, "-o", picture, "--spp", "100000"), stderr=subprocess.PIPE
            )
            time.sleep(wait)
            for _ in range(times):
                child.send_signal(number)
                time.sleep(0.02)
            try:
                _, said = child.communicate(timeout=_SECONDS)
            except subprocess.TimeoutExpired:
                child.kill()
                child.communicate()
                yield "hang", f"{number.name} after {wait:.2f} s"
                continue
            text = f"{number.name} x {times} after {wait:.2f} s: {child.returncode} {said[-300:].decode()}"
            if not whole(film):
                yield "lost", text
            # Before the program installs its handlers, those of Python or the system apply.
            elif b"Traceback" in said and b"glpath" in said and wait > 1.0:
                yield "traceback", text
            elif child.returncode in (130, 0):
                yield "fine", text
            elif child.returncode in (-number, 1) and (number == signal.SIGKILL or wait < starting):
                yield "error", text
            else:
                yield "crash", text


def attack_threads() -> None:
    """Run in the child: sixteen threads load and render at once, and must give the results of one thread."""
    from concurrent.futures import ThreadPoolExecutor

    import glpath

    jobs = [(name, seed) for seed in range(8) for name in ("cornell-box-36", "furnace", "three-spheres", "stacked")]

    def render(job: tuple[str, int]) -> bytes:
        name, seed = job
        integrator = "path" if name in ("cornell-box-36", "furnace") else "t-buffer"
        scene = glpath.load_scene(name)
        film = glpath.render(scene, integrator=integrator, spp=2, seed=seed, max_depth=2, resolution=(16, 16))
        return film.radiance_sums.tobytes()

    warnings.simplefilter("ignore")
    with ThreadPoolExecutor(16) as pool:
        together = list(pool.map(render, jobs))
    for one, other in zip(map(render, jobs), together, strict=True):
        print(json.dumps("fine" if one == other else "lost"), flush=True)


def run_threads() -> Iterator[tuple[str, str]]:
    for i in range(3):
        child = [sys.executable, __file__, "--child", "threads"]
        done = subprocess.run(child, capture_output=True, text=True, timeout=5 * _SECONDS)
        for line in done.stdout.splitlines():
            yield json.loads(line), f"round {i}"
        if done.returncode:
            yield ("crash" if done.returncode < 0 else "traceback"), done.stderr[-500:]


KINDS: dict[str, Callable[[], Iterator[tuple[str, str]]]] = {
    "scenes": run_scenes,
    "environments": run_environments,
    "disks": run_disks,
    "kills": run_kills,
    "threads": run_threads,
}


def main(kinds: list[str]) -> dict[str, Any]:
    """Return the counts by kind, and the first outcomes that must not occur."""
    found: dict[str, Any] = {}
    for kind in kinds or KINDS:
        counts: Counter[str] = Counter()
        first = []
        for outcome, text in KINDS[kind]():
            counts[outcome] += 1
            if outcome in BAD and len(first) < 10:
                first.append(f"{outcome}: {text}")
        found[kind] = {"tried": counts.total(), **{each: counts[each] for each in ("fine", "error", *BAD)}}
        found[kind]["first"] = first
    return found


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        {"scenes": lambda: attack_scenes(int(sys.argv[3])), "threads": attack_threads}[sys.argv[2]]()
    else:
        print(json.dumps(main(sys.argv[1:]), indent=2))
