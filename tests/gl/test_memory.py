"""What renders take, they give back: objects on the device, compiled programs, memory of the process."""

from __future__ import annotations

import ctypes
import functools
import gc
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.gl import program
from glpath.gl.context import Context, get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.path_engines import path_engine
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from tests.support import many_scenes
from tests.support.engines import with_depth
from tests.support.repository import ROOT

SMALL: dict[str, Any] = {"resolution": (16, 12), "spp": 1, "max_depth": 2}
# Names of a driver are numbers from 1 on; Mesa gives the least that is free.
_NAMES = 4096
_ALONE = "GLPATH_TESTS_ALONE"


def objects(
    context: Context, kinds: tuple[str, ...] = ("Texture", "Buffer", "Framebuffer", "VertexArray", "Query")
):
    """How many objects of each kind the driver says there are."""
    found: Counter[str] = Counter()
    for kind in kinds:
        address = context._opened.loader.load_opengl_function(f"glIs{kind}")
        there = ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)(address)
        found[kind] = sum(there(name) for name in range(1, _NAMES))
    return found


def in_a_process_of_its_own(test: Callable[..., None]) -> Callable[..., None]:
    """Other tests of the same process may hold objects, or let go of some meanwhile."""

    @functools.wraps(test)
    def run(*given: Any, **named: Any) -> None:
        if os.environ.get(_ALONE):
            test(*given, **named)
            return
        command = [sys.executable, "-m", "pytest", "-p", "no:nbmake", f"{__file__}::{test.__name__}"]
        done = subprocess.run(command, env={**os.environ, _ALONE: "1"}, capture_output=True, text=True, timeout=240)
        assert done.returncode == 0, done.stdout + done.stderr

    return run


@contextmanager
def without_collector() -> Iterator[None]:
    """What only Python's collector of cycles would find is not freed meanwhile."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@pytest.fixture
def context() -> Iterator[Context]:
    context = get_context()
    yield context
    context.leave()


OPTIONS: list[dict[str, Any]] = [
    {"integrator": "path", "aovs": ("albedo", "normal", "depth", "object_id")},
    {"integrator": "path-buffer"},
    {"integrator": "path", "guide": "solution"},
    {"integrator": "gather"},
    {"integrator": "t-buffer", "aovs": ("depth",)},
    {"integrator": "classic"},
]


@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: "-".join(map(str, options.values())))
def test_a_render_leaves_no_object_on_the_device(context, options):
    scene = glpath.load_scene("cornell-box-36").add({"type": "sphere", "center": [0, 0, 0.5], "radius": 0.2})
    options = with_depth({"resolution": (16, 12), "spp": 1, **options}, 2)
    glpath.render(scene, **options)  # what is made once
    with without_collector():
        before = objects(context)
        glpath.render(scene, **options)
        assert objects(context) == before


@in_a_process_of_its_own
def test_an_engine_that_is_closed_has_nothing_on_the_device(context):
    scene = glpath.load_scene("cornell-box-36")
    settings = PathBufferSettings(max_depth=2)
    glpath.render(scene, **SMALL, integrator="path-buffer")  # what is made once
    with without_collector():
        before = objects(context)
        with DeviceScene(context.gl, scene) as on_device:
            alone = objects(context)
            assert alone["Texture"] > before["Texture"]
            engine = path_engine(context.gl, on_device, settings, (0, 0, 16, 12)).prepare()
            with engine:
                engine.trace_path_set(0)
                assert objects(context).total() > alone.total()
            assert objects(context) == alone + Counter({"Buffer": 1})  # of the scene: its triangles, since drawn
            engine.close()  # twice does no harm
        assert objects(context) == before


@in_a_process_of_its_own
def test_programs_are_bounded_and_those_in_use_stay(context, monkeypatch):
    monkeypatch.setattr(program, "MAX_PROGRAMS", 5)
    program.forget_programs(context.gl)
    scene = glpath.load_scene("cornell-box-36")
    with without_collector():
        settings = PathSettings(max_depth=2)
        window = (0, 0, 16, 12)
        with path_engine(context.gl, DeviceScene(context.gl, scene), settings, window).prepare() as engine:
            engine.trace_path_set(0)
            first = engine.take()
            of_engine = objects(context, ("Program",))["Program"]
            for i in range(4):
                glpath.render(many_scenes.scene(i), **SMALL)
            assert objects(context, ("Program",))["Program"] <= of_engine + 5
            engine.trace_path_set(0)
            np.testing.assert_array_equal(engine.take(), first)
        glpath.render(scene, **SMALL)
        assert objects(context, ("Program",))["Program"] <= 5


_RENDERS = """
import sys, warnings
import glpath
from tests.support import many_scenes
from glpath.gl import program
from glpath.system.machine import peak_resident_bytes
warnings.simplefilter("ignore")
made, compile_one = [], program._compile
program._compile = lambda *given: made.append(1) or compile_one(*given)
for i in range(int(sys.argv[1])):
    glpath.render(many_scenes.scene(i), resolution=(16, 16), spp=1, max_depth=2)
print(len(made), peak_resident_bytes() / 2**20)
"""


@pytest.mark.evidence
@pytest.mark.release
def test_300_different_scenes_in_one_process_stay_below_600_mb():
    """340 MB. Its scenes take 500 programs, some 3 MB each: 1.5 GB where they stay."""
    command = [sys.executable, "-c", _RENDERS, "300"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, done.stderr
    programs, peak_mb = done.stdout.split()
    assert int(programs) > 400  # what was let go of is made anew
    assert float(peak_mb) < 600
