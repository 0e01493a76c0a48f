"""What `glpath doctor` says that rendering needs is what rendering uses, and no more than OpenGL 4.3 guarantees."""

from __future__ import annotations

import importlib.metadata
import json
import os
from pathlib import Path
from typing import NamedTuple

import pytest
import typer
from typer.testing import CliRunner

import glpath
import glpath.cli.devices as devices_cli
from glpath.gl import limits, llvmpipe
from glpath.gl.context import get_context
from glpath.gl.limits import IMAGE_LIMITS, LIMITS, Found, Limit
from glpath.gl.passes import Dispatch, Pass, PixelDispatch
from glpath.integrators.ray_paths import RayPathEngine
from tests.support.hashed_films import film_of
from tests.support.terrain import Hills

#: OpenGL 4.3, tables 23.53 to 23.72: the least that every device has.
GUARANTEED = {
    "GL_MAX_TEXTURE_SIZE": 16384,
    "GL_MAX_DRAW_BUFFERS": 8,
    "GL_MAX_COLOR_ATTACHMENTS": 8,
    "GL_MAX_CLIP_DISTANCES": 8,
    "GL_MAX_TEXTURE_IMAGE_UNITS": 16,
    "GL_MAX_VERTEX_TEXTURE_IMAGE_UNITS": 16,
    "GL_MAX_COMPUTE_TEXTURE_IMAGE_UNITS": 16,
    "GL_MAX_COMPUTE_IMAGE_UNIFORMS": 8,
    "GL_MAX_FRAGMENT_UNIFORM_COMPONENTS": 1024,
    "GL_MAX_SHADER_STORAGE_BUFFER_BINDINGS": 8,
    "GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS": 8,
    "GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS": 8,
    "GL_MAX_SHADER_STORAGE_BLOCK_SIZE": 1 << 24,
    "GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS": 1024,
}


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    devices_cli.register(app)
    return app


def test_no_more_is_needed_than_opengl_guarantees() -> None:
    assert LIMITS.keys() == GUARANTEED.keys()
    for name, limit in LIMITS.items():
        assert limit.needed <= GUARANTEED[name], name


def streamed_beside(stream: dict[str, object]) -> dict[str, object]:
    """A textured box and a lamp, and a stream: shading reads of all of them."""
    corners = [[-1, 3, -1], [1, 3, -1], [1, 3, 1], [-1, 3, 1]]
    return {
        "camera": {"position": [0, 3, 6], "target": [0, 0, 0]},
        "film": {"resolution": [24, 18]},
        "textures": {"squares": {"type": "checker"}},
        "materials": {"squares": {"texture": "squares"}},
        "shapes": [
            {"type": "box", "min": [-0.4, 0.5, -0.3], "max": [0.3, 1.2, 0.3], "material": "squares"},
            {"type": "quad", "corners": corners, "emission": {"radiance": 9}},
            stream,
        ],
    }


class Used(NamedTuple):
    """By one draw or dispatch."""

    name: str
    attachments: int
    clip_distances: int
    samplers: int
    images: int
    buffers: dict[int, object]


def test_what_is_needed_is_what_passes_use(monkeypatch: pytest.MonkeyPatch) -> None:
    draws: list[Used] = []
    dispatches: list[Used] = []
    written: list[int] = []
    draw, dispatch, dispatch_pixels = Pass.run, Dispatch.run, PixelDispatch.run

    def seen_draw(self: Pass, *arguments: object, **named: object) -> None:
        program, attachments = self.program, len(self.target.color_attachments)
        sizes = attachments, self.clip_distances, len(program.samplers), len(program.images)
        draws.append(Used(self.name, *sizes, dict(self.buffers)))
        draw(self, *arguments, **named)  # type: ignore[arg-type]

    def seen_dispatch(self: Dispatch, *arguments: object) -> None:
        program = self.program
        dispatches.append(Used(self.name, 0, 0, len(program.samplers), len(program.images), dict(self.buffers)))
        dispatch(self, *arguments)  # type: ignore[arg-type]

    def seen_pixels(self: PixelDispatch, *arguments: object) -> None:
        program = self.program
        dispatches.append(Used(self.name, 0, 0, len(program.samplers), len(program.images), {}))
        written.append(len(self.written))
        dispatch_pixels(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Pass, "run", seen_draw)
    monkeypatch.setattr(Dispatch, "run", seen_dispatch)
    monkeypatch.setattr(PixelDispatch, "run", seen_pixels)
    for name in (
        "path-cornell-box-36-crop",
        "gather-cornell-box-36",
        "t-buffer-three-spheres-cube",
        "t-buffer-stacked-triangles",
    ):
        film_of(name, spp=1)
    film_of("t-buffer-stacked-triangles", spp=1, count_tests=True)
    film_of("gather-cornell-box-36", spp=1)
    hills = {"type": "stream", "stream": Hills(1, 2)}
    glpath.render(streamed_beside(hills), spp=1, max_depth=3, integrator="path-buffer", aovs=("albedo",))
    monkeypatch.setattr(RayPathEngine, "_pass", RayPathEngine._dispatch)  # as on a graphics card
    film_of("gather-cornell-box-36", spp=1)
    needed = {name: limit.needed for name, limit in (LIMITS | IMAGE_LIMITS).items()}
    assert max(d.attachments for d in draws) == needed["GL_MAX_DRAW_BUFFERS"]
    assert max(d.clip_distances for d in draws) == needed["GL_MAX_CLIP_DISTANCES"]
    assert max(d.samplers + d.images for d in draws) <= needed["GL_MAX_TEXTURE_IMAGE_UNITS"]
    assert max(d.images for d in draws) <= needed["GL_MAX_IMAGE_UNITS"]
    if llvmpipe.is_spoken(get_context().gl):  # then fragment shaders have hardly a sampler
        assert max(d.samplers for d in draws) <= needed["GL_MAX_VERTEX_TEXTURE_IMAGE_UNITS"]
    assert max(d.samplers + d.images for d in dispatches) <= needed["GL_MAX_COMPUTE_TEXTURE_IMAGE_UNITS"]
    assert max(written) == needed["GL_MAX_COMPUTE_IMAGE_UNIFORMS"]
    assert max(len(d.buffers) for d in draws) <= needed["GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS"]
    assert max(len(d.buffers) for d in dispatches) == needed["GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS"]
    bindings = 1 + max(binding for used in draws + dispatches for binding in used.buffers)
    assert bindings == needed["GL_MAX_SHADER_STORAGE_BUFFER_BINDINGS"]


def findings(app: typer.Typer) -> dict[str, dict[str, str]]:
    report = json.loads(CliRunner().invoke(app, ["doctor", "--json"]).stdout)
    return {finding["check"]: finding for finding in report["findings"]}


def test_doctor_names_a_limit_that_is_too_low(app: typer.Typer, monkeypatch: pytest.MonkeyPatch) -> None:
    few = Limit(0x8824, 99, "testing")
    monkeypatch.setitem(limits.LIMITS, "GL_MAX_DRAW_BUFFERS", few)
    found = findings(app)["limits"]
    assert found["status"] == "missing"
    assert found["found"].startswith("GL_MAX_DRAW_BUFFERS ")
    assert "(needed: 99, for testing)" in found["found"]
    assert not Found(1, 2, "").enough


def test_doctor_asks_the_packages_own_metadata(app: typer.Typer, monkeypatch: pytest.MonkeyPatch) -> None:
    found = findings(app)["packages"]
    assert found["status"] == "ok"
    assert "numba" in found["found"]  # no list of its own that could be behind
    monkeypatch.setattr(
        importlib.metadata,
        "requires",
        lambda _: ["numpy>=999.1", "no-such-thing>=2", 'rich>=99; extra == "x"', "typer"],
    )
    found = findings(app)["packages"]
    assert found["status"] == "missing"
    assert "(needed: 999.1); no-such-thing is not installed" in found["found"]
    assert found["remedy"] == 'pip install "numpy>=999.1" "no-such-thing>=2"'


def test_doctor_names_a_package_with_damaged_metadata(app: typer.Typer, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after an installation that was cut off: Python 3.11 then has no version, and later ones no key."""

    def version(name: str) -> str | None:
        if name == "typer":
            raise KeyError("Version")
        return None if name == "numpy" else "1"

    monkeypatch.setattr(importlib.metadata, "requires", lambda _: ["numpy>=1.26", "typer"])
    monkeypatch.setattr(importlib.metadata, "version", version)
    found = findings(app)["packages"]
    assert "numpy has damaged metadata" in found["found"]
    assert "typer has damaged metadata" in found["found"]


@pytest.mark.parametrize(
    ("module", "why"),
    [
        ("raise ImportError('Numba needs NumPy 2.4 or less')", "ImportError: Numba needs NumPy 2.4 or less"),
        ("import os, signal\nos.kill(os.getpid(), signal.SIGILL)", "ends the process with -4"),
    ],
)
def test_doctor_imports_what_rendering_needs(
    app: typer.Typer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, why: str
) -> None:
    """That a package is installed does not say that it works here."""
    (tmp_path / "numba.py").write_text(module)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    found = findings(app)["packages"]
    assert found["status"] == "missing"
    assert "numba cannot be imported" in found["found"]
    assert why in found["found"]
    assert found["remedy"] == 'pip install "numba"'
