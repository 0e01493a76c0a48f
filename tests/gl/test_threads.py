"""Threads take turns with the context, which is never lost, and render what one thread renders, bit for bit."""

from __future__ import annotations

import ctypes
import gc
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import ContextError
from glpath.gl.context import Context, get_context, open_context
from glpath.gl.turns import Turns
from glpath.rendering.job import RenderJob

SMALL = {"spp": 3, "max_depth": 2, "resolution": (16, 12)}
RENDERS: list[tuple[str, dict[str, Any]]] = [
    *[("cornell-box-36", {**SMALL, "seed": seed}) for seed in range(3)],
    ("three-spheres", {"integrator": "t-buffer", "shadows": "cube", "spp": 2, "resolution": (16, 12)}),
]


def render(number: int) -> np.ndarray:
    scene, options = RENDERS[number % len(RENDERS)]
    return glpath.render(scene, **options).radiance_sums


@pytest.fixture
def context() -> Iterator[Context]:
    """The context, which no thread has; this one keeps it again afterwards where it did."""
    context = open_context()
    kept = context._turns.mine
    context.leave()
    assert context._turns.thread is None
    yield context
    assert context._turns.thread is None, "the test left it to a thread"
    if kept:
        context.use()


def in_thread(act: Callable[[], Any]) -> Any:
    """What it returns or raises in a thread of its own, which ends."""
    found: queue.Queue[tuple[bool, Any]] = queue.Queue()

    def run() -> None:
        try:
            found.put((True, act()))
        except BaseException as error:
            found.put((False, error))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    good, value = found.get()
    if not good:
        raise value
    return value


def python(code: str, **environment: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_a_pool_of_16_renders_what_a_loop_renders(context: Context) -> None:
    serial = [render(i) for i in range(len(RENDERS))]
    with ThreadPoolExecutor(16) as pool:
        films = list(pool.map(render, range(32)))
    for i, film in enumerate(films):
        np.testing.assert_array_equal(film, serial[i % len(RENDERS)])


def test_threads_may_be_the_first_to_do_anything_in_a_process() -> None:
    """Imports, scenes, job files, kernels, pictures and the context: all at once, by threads alone."""
    python(
        "import threading, glpath\n"
        "barrier, failed = threading.Barrier(8), []\n"
        "def act(i):\n"
        "    barrier.wait()\n"
        "    try:\n"
        "        if i % 4 == 3:\n"
        "            from glpath.rendering import RenderJob\n"
        "            job = RenderJob.of('cornell-box-36', spp=2, max_depth=1, resolution=(8, 8))\n"
        "            assert RenderJob.from_json(job.to_json()) == job\n"
        "        elif i % 4 == 2:\n"
        "            glpath.load_scene('three-spheres')\n"
        "        else:\n"
        "            film = glpath.render('cornell-box-36', spp=2, max_depth=2, resolution=(8, 8))\n"
        "            assert film.mean.mean() > 0 and len(film._repr_mimebundle_()['image/png']) > 0\n"
        "    except BaseException as error:\n"
        "        failed.append(error)\n"
        "threads = [threading.Thread(target=act, args=(i,)) for i in range(8)]\n"
        "[t.start() for t in threads]; [t.join() for t in threads]\n"
        "assert not failed, failed\n"
    )


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_a_context_outlives_the_thread_that_made_it_or_kept_it(backend: str) -> None:
    out = python(
        "import sys, threading\n"
        "from glpath.errors import ContextError\n"
        "from glpath.gl.context import get_context\n"
        "def keep():\n"
        "    try:\n"
        f"        made.append(get_context({backend!r}).gl.texture((4, 4), 1, data=bytes(range(16))))\n"
        "    except ContextError as error:\n"
        "        print(error.message)\n"
        "made = []\n"
        "for _ in range(3):\n"
        "    thread = threading.Thread(target=keep); thread.start(); thread.join()\n"
        "    if made: assert get_context().gl.error == 'GL_NO_ERROR'\n"
        "    if made: assert made[-1].read() == bytes(range(16)); get_context().leave()\n"
        "print(len(made))\n"
    )
    if backend == "osmesa" and "can be loaded" in out:
        pytest.skip("libOSMesa is not installed")
    assert out == "3\n"


def test_who_keeps_it_refuses_others_by_name_until_it_leaves(context: Context) -> None:
    get_context()
    with pytest.raises(ContextError, match=r"'MainThread' keeps it .* 'Thread-\d+"):
        in_thread(lambda: render(0))
    with pytest.raises(ContextError, match="open_context"):
        in_thread(get_context)
    texture = context.gl.texture((2, 2), 1, data=b"abcd")
    assert texture.read() == b"abcd"  # still its own
    render(0)
    assert texture.read() == b"abcd"  # after a render too
    context.leave()
    context.leave()
    in_thread(lambda: render(0))


def test_blocks_within_blocks_let_go_at_the_last(context: Context) -> None:
    with context:
        with context:
            render(0)
        assert in_other(context) is False
        context.use()
    assert context._turns.mine
    with context:
        context.leave()
        assert context._turns.mine
    assert in_other(context) is True


def in_other(context: Context) -> bool:
    """Could another thread have it now?"""

    def ask() -> bool:
        return context._turns.thread is None

    return bool(in_thread(ask))


def alive(context: Context, glo: int) -> bool:
    """Does GL know a texture of this name?"""
    address = context._opened.loader.load_opengl_function("glIsTexture")
    return bool(ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)(address)(glo))


def test_what_is_collected_elsewhere_is_deleted_by_whoever_has_the_context_next(context: Context) -> None:
    with context:
        held = [context.gl.texture((4, 4), 1) for _ in range(2)]
        names = [texture.glo for texture in held]
        held.pop()
        assert [alive(context, name) for name in names] == [True, False]  # at once
    in_thread(held.clear)
    assert len(context.gl.objects) == 1
    with context:
        assert not alive(context, names[0])
    # A cycle, which Python's collector finds in a thread that was never near GL, while another one draws.
    with context:
        cycle: list[Any] = [context.gl.texture((4, 4), 1)]
        name = cycle[0].glo
        cycle.append(cycle)
        del cycle
        in_thread(gc.collect)
        assert alive(context, name)
        with context:
            assert not alive(context, name)


def test_a_render_leaves_nothing_on_the_device(context: Context) -> None:
    def names() -> list[int]:
        with context:
            texture = context.gl.texture((1, 1), 1)
            highest = texture.glo + 200
            return [name for name in range(1, highest) if alive(context, name) and name != texture.glo]

    gc.collect()
    before = names()
    films = [render(i) for i in (0, 3)]
    walk = glpath.render_frames("three-spheres", [{}, {}], spp=1, resolution=(8, 8))
    films.append(next(walk).radiance_sums)
    during = names()
    del walk
    assert len(during) > len(before)
    assert len(names()) == len(before)  # moderngl's context keeps the framebuffer that was used last


def test_between_frames_the_context_is_free(context: Context) -> None:
    walk = [{"position": (x, -10.0, 3.0)} for x in (-1.0, 0.0, 1.0)]
    options: dict[str, Any] = {"shadows": "cube", "spp": 1, "resolution": (12, 9)}
    alone = [film.radiance_sums for film in glpath.render_frames("three-spheres", walk, **options)]
    frames = glpath.render_frames("three-spheres", walk, **options)
    for frame in alone:  # each in a thread of its own, and another render between them
        np.testing.assert_array_equal(in_thread(lambda: next(frames)).radiance_sums, frame)
        assert context._turns.thread is None
        in_thread(lambda: render(0))
    frames.close()


def test_a_visitor_comes_in_between_the_steps_of_a_long_render(context: Context) -> None:
    started, stop = threading.Event(), threading.Event()

    def on_progress(progress: glpath.Progress) -> None:
        started.set()
        if stop.is_set():
            raise KeyboardInterrupt

    def long() -> glpath.Film:
        try:
            return glpath.render("furnace", spp=1 << 20, resolution=(8, 8), max_depth=1, on_progress=on_progress)
        except glpath.RenderInterrupted as interrupted:
            return interrupted.film

    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(long)
        started.wait()
        for _ in range(3):
            asked = time.perf_counter()
            with context:
                assert not running.done()
            assert time.perf_counter() - asked < 10  # a step takes half a second
        stop.set()
        assert running.result().path_sets > 0


def test_to_keep_it_by_hand_waits_for_a_render_under_way(context: Context) -> None:
    steps: list[int] = []
    begun = threading.Event()

    def on_progress(progress: glpath.Progress) -> None:
        steps.append(progress.done)
        begun.set()
        time.sleep(0.05)

    def work() -> glpath.Film:
        return glpath.render("furnace", spp=64, resolution=(8, 8), max_depth=1, on_progress=on_progress)

    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(work)
        begun.wait()
        get_context()
        assert steps[-1] == 64
        assert running.result().path_sets == 64
    context.leave()


def test_turns_come_in_the_order_of_asking() -> None:
    turns = Turns(lambda thread: AssertionError(thread))
    turns.enter()
    order: list[int] = []

    def ask(number: int) -> None:
        turns.enter()
        order.append(number)
        turns.exit()

    threads = [threading.Thread(target=ask, args=(i,)) for i in range(6)]
    for i, thread in enumerate(threads):
        thread.start()
        while len(turns._waiting) <= i:
            time.sleep(0.001)
    turns.exit()
    turns.enter()  # at once again, and yet it is last
    assert order == list(range(6))
    turns.exit()
    [thread.join() for thread in threads]
    assert turns.thread is None


def test_ctrl_c_lets_go_of_the_context_and_of_the_queue(context: Context) -> None:
    with pytest.raises(KeyboardInterrupt), context:
        signal.raise_signal(signal.SIGINT)
    assert context._turns.thread is None

    release, held = threading.Event(), threading.Event()

    def hold() -> None:
        with context:
            held.set()
            release.wait()

    other = threading.Thread(target=hold)
    other.start()
    held.wait()
    threading.Timer(0.1, lambda: signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        render(0)
    assert not context._turns._waiting
    release.set()
    other.join()
    render(0)


def test_ctrl_c_at_any_moment_leaves_a_context_that_others_can_have(context: Context) -> None:
    """Signals at random moments, while two other threads ask for it too."""
    stop = threading.Event()

    def ask() -> None:
        while not stop.is_set():
            with context:
                pass

    others = [threading.Thread(target=ask) for _ in range(2)]
    [thread.start() for thread in others]
    main = (threading.get_ident(), signal.SIGINT)
    caught, until = 0, time.perf_counter() + 1.5
    while time.perf_counter() < until:
        try:
            threading.Timer(0.001 * np.random.default_rng(caught).random(), signal.pthread_kill, main).start()
            while True:
                with context:
                    context.gl.error  # noqa: B018
        except KeyboardInterrupt:
            caught += 1
    stop.set()
    [thread.join(10) for thread in others]
    assert not any(thread.is_alive() for thread in others)
    assert caught > 50


def test_a_fork_while_it_is_used_is_a_clear_error() -> None:
    out = python(
        "import os, sys, threading, glpath\n"
        "from glpath.gl.context import get_context, open_context\n"
        "context = open_context()\n"
        "def hold():\n"
        "    with context: held.set(); release.wait()\n"
        "held, release = threading.Event(), threading.Event()\n"
        "thread = threading.Thread(target=hold); thread.start(); held.wait()\n"
        "child = os.fork()\n"
        "if not child:\n"
        "    for act in (get_context, context.use, lambda: glpath.render('furnace', spp=1)):\n"
        "        try:\n"
        "            act()\n"
        "        except glpath.ContextError as error:\n"
        "            print(error.message, flush=True)\n"
        "    os._exit(3)\n"
        "assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3\n"
        "release.set(); thread.join()\n"
        "with context:\n"
        "    child = os.fork()\n"
        "    if child: os.waitpid(child, 0)\n"
        "if not child: os._exit(0)\n"
        "print(glpath.render('furnace', spp=1, resolution=(4, 4)).path_sets)\n"
    )
    assert out.count("used in its fork") == 3
    assert out.endswith("\n1\n")


def test_whoever_waits_for_a_context_that_is_released_is_told_so() -> None:
    out = python(
        "import threading, time\n"
        "from glpath.errors import ContextError\n"
        "from glpath.gl.context import open_context, release_context\n"
        "context = open_context()\n"
        "def wait():\n"
        "    try:\n"
        "        with context: print('had it')\n"
        "    except ContextError as error:\n"
        "        print(error.message)\n"
        "with context:\n"
        "    thread = threading.Thread(target=wait); thread.start()\n"
        "    while not context._turns._waiting: time.sleep(0.001)\n"
        "    release_context()\n"
        "thread.join()\n"
        "with open_context() as another: assert another is not context and another.gl.error == 'GL_NO_ERROR'\n"
    )
    assert "it was released" in out


def test_jobs_are_read_by_many_threads(context: Context) -> None:
    job = RenderJob.of("cornell-box-36", spp=2, max_depth=1, resolution=(8, 8))
    with ThreadPoolExecutor(16) as pool:
        assert all(one == job for one in pool.map(RenderJob.from_json, [job.to_json()] * 64))


LIMITED = """
import sys
from pathlib import Path
import glpath
from glpath.system.machine import core_count
film = glpath.render("cornell-box-36", spp=2, max_depth=2, resolution=(16, 12), threads=int(sys.argv[1]))
names = [path.read_text() for path in Path("/proc/self/task").glob("*/comm")]
software = film.metadata.device.startswith("llvmpipe")
print(core_count(), sum(name.startswith("llvmpipe-") for name in names) if software else None)
"""


@pytest.mark.parametrize(("asked", "of_llvmpipe"), [(1, 0), (3, 3)])
def test_a_process_computes_with_as_many_threads_as_it_was_asked_for(asked: int, of_llvmpipe: int) -> None:
    """One is none but the caller's, which draws what llvmpipe's thread would."""
    done = subprocess.run([sys.executable, "-c", LIMITED, str(asked)], capture_output=True, text=True, timeout=120)
    cores = min(asked, len(os.sched_getaffinity(0)))
    assert done.stdout.split() in ([str(cores), str(of_llvmpipe)], [str(cores), "None"]), done.stderr


LIMITED_COMMANDS = """
from typer.testing import CliRunner
from glpath.cli.main import app
from glpath.system import machine
for command, *more in (
    ("render", "-o", "a.npz"), ("measure", "-o", "a.npz", "--plane", "y=1"),
    ("lightmap", "-o", "a.glb", "--uv", "keep"), ("radiosity", "-o", "a.npz"), ("viewfactors", "-o", "a.npz"),
    ("daylight", "-o", "a.npz", "--points", "a.csv"),
):
    machine.limit_threads(64)
    done = CliRunner().invoke(app, [command, "no-such-scene", *more, "--threads", "1"])
    assert done.exit_code == 1 and "no-such-scene" in done.output, done.output
    assert machine.core_count() == 1, command
    assert CliRunner().invoke(app, [command, "cornell-box", *more, "--threads", "0"]).exit_code == 2
"""


def test_every_command_that_computes_can_be_limited() -> None:
    done = subprocess.run([sys.executable, "-c", LIMITED_COMMANDS], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    with pytest.raises(glpath.UsageError, match="threads: 0 where a whole number from 1"):
        glpath.render("furnace", threads=0)
