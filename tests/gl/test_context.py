"""Contexts: each way of making one draws and computes, and each misuse is told from a crash.

A process has one context, shared by the whole suite; what would replace or break it runs in a process of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from glpath.cli import devices as devices_cli
from glpath.errors import ContextError, UsageError
from glpath.gl.context import get_context
from glpath.gl.devices import BACKENDS, Candidate, DeviceProbe, list_devices, start_probe
from glpath.gl.osmesa import load_osmesa
from tests.support.repository import ROOT

needs_osmesa = pytest.mark.skipif(
    load_osmesa() is None, reason="libOSMesa is not installed (Debian 12: libosmesa6)"
)
each_backend = pytest.mark.parametrize("backend", ["egl", pytest.param("osmesa", marks=needs_osmesa)])


def python(code: str, *arguments: str, **environment: str) -> str:
    """What the code prints in a fresh process, which must end well."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("GLPATH_", "MESA_"))}
    clean["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), clean.get("PYTHONPATH", "")]))
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env=clean | environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def context_error(code: str, **environment: str) -> str:
    """The text of the ContextError that the code must raise."""
    body = "".join(f"    {line}\n" for line in code.splitlines())
    return python(
        "from glpath.errors import ContextError\nfrom glpath.gl.context import *\n"
        f"try:\n{body}except ContextError as error:\n    print(error)\nelse:\n    raise SystemExit('no error')\n",
        **environment,
    )


DRAW_AND_COMPUTE = """
import struct, sys
from glpath.gl.context import get_context
from glpath.gl.limits import device_limits
context = get_context(sys.argv[1])
assert context.info.backend == sys.argv[1]
gl = context.gl
assert gl.gc_mode == "auto"
assert all(limit.enough for limit in device_limits(context).values())

target = gl.texture((8, 8), 4, dtype="f4")
frame = gl.framebuffer([target], gl.depth_renderbuffer((8, 8)))
frame.use()
frame.clear(depth=1.0)
program = gl.program(
    vertex_shader='''#version 430 core
        void main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }''',
    fragment_shader='''#version 430 core
        out vec4 color;
        void main() { color = vec4(gl_FragCoord.xy, 0.25, 1); }''')
gl.vertex_array(program, []).render(vertices=3)
pixels = struct.unpack("256f", target.read())
assert pixels[:4] == (0.5, 0.5, 0.25, 1.0), pixels[:4]
assert pixels[-4:] == (7.5, 7.5, 0.25, 1.0), pixels[-4:]

numbers = gl.buffer(struct.pack("64I", *range(64)))
numbers.bind_to_storage_buffer(0)
gl.compute_shader('''#version 430 core
    layout(local_size_x = 16) in;
    layout(std430, binding = 0) buffer Numbers { uint n[]; };
    void main() { n[gl_GlobalInvocationID.x] *= 3u; }''').run(4)
gl.memory_barrier()
assert struct.unpack("64I", numbers.read()) == tuple(3 * i for i in range(64))
assert gl.error == "GL_NO_ERROR"
print(context.info)
"""


@each_backend
def test_it_draws_and_computes(backend: str) -> None:
    assert f"{backend} device 0" in python(DRAW_AND_COMPUTE, backend)


@needs_osmesa
def test_a_released_context_makes_room_for_another_backend() -> None:
    code = DRAW_AND_COMPUTE + (
        "\nfrom glpath.gl.context import release_context"
        "\nfor sys.argv[1] in ('osmesa', 'egl', 'osmesa'):"
        "\n    release_context()"
        "\n    exec(source)\n"
    )
    lines = python(f"source = {DRAW_AND_COMPUTE!r}\n{code}", "egl").splitlines()
    assert [line.split(" device")[0].split()[-1] for line in lines] == ["egl", "osmesa", "egl", "osmesa"]


def test_a_process_has_one_context() -> None:
    context = get_context()
    assert get_context() is context
    assert get_context(context.info.backend, context.info.index) is context
    assert context.info.version_code >= 430


@needs_osmesa
def test_another_device_in_the_same_process_is_refused() -> None:
    text = context_error("get_context('egl')\nget_context('osmesa')")
    assert "renders on egl device 0 already" in text
    assert "another process" in text


def test_a_forked_child_is_told_so_and_ends() -> None:
    out = python(
        "import os, sys, gc\n"
        "from glpath.errors import ContextError\n"
        "from glpath.gl.context import get_context\n"
        "context = get_context()\n"
        "texture = context.gl.texture((4, 4), 1)\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    for use in (get_context, context.check, context.use):\n"
        "        try:\n"
        "            use()\n"
        "        except ContextError as error:\n"
        "            print(error, flush=True)\n"
        "    del texture, context\n"
        "    gc.collect()\n"
        "    sys.exit(3)\n"
        "assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3\n"
        "assert get_context() is context\n"
        "assert context.gl.texture((4, 4), 1).glo != texture.glo\n"
    )
    assert out.count("made in process") == 3
    assert "spawn" in out


def test_a_required_gpu_is_not_replaced_by_software() -> None:
    software = {"LIBGL_ALWAYS_SOFTWARE": "1"}
    device = python("from glpath.gl.context import *\nprint(get_context().info.hardware)", **software)
    if "True" in device:
        pytest.skip("the driver here does not let itself be replaced by software")
    assert "a GPU is required" in context_error("get_context(require_gpu=True)", **software)
    assert "llvmpipe" in context_error("get_context()\nget_context(require_gpu=True)", **software)


@pytest.mark.parametrize(
    ("call", "environment", "said"),
    [
        ("get_context('vulkan')", {}, ["'vulkan'", *BACKENDS]),
        ("get_context()", {"GLPATH_BACKEND": "glx"}, ["GLPATH_BACKEND", "'glx'", *BACKENDS]),
        ("get_context()", {"GLPATH_DEVICE": "first"}, ["GLPATH_DEVICE", "'first'"]),
        ("get_context()", {"GLPATH_DEVICE": "97"}, ["egl device 97", "this machine has: 0"]),
        ("get_context(device=98)", {"GLPATH_DEVICE": "0"}, ["egl device 98", "this machine has: 0"]),
        ("get_context('osmesa', 5)", {}, ["osmesa device 5", "this machine has: 0"]),
        ("get_context(device=-1)", {}, ["egl device -1", "this machine has: 0"]),
    ],
)
def test_what_does_not_exist_is_named_with_what_does(
    call: str, environment: dict[str, str], said: list[str]
) -> None:
    text = context_error(call, **environment)
    assert [word for word in said if word not in text] == []


def test_arguments_win_over_the_environment() -> None:
    code = "from glpath.gl.context import *\nprint(get_context({}).info.backend)"
    nonsense = {"GLCONTEXT_DEVICE_INDEX": "42", "GLCONTEXT_GLVERSION": "999"}
    assert python(code.format("'egl'"), GLPATH_BACKEND="osmesa", **nonsense) == "egl\n"
    assert python(code.format("device=0"), GLPATH_BACKEND="osmesa", GLPATH_DEVICE="7", **nonsense) == "egl\n"


@needs_osmesa
def test_the_environment_wins_over_the_order_of_preference() -> None:
    code = "from glpath.gl.context import *\nprint(get_context().info.backend)"
    assert python(code, GLPATH_BACKEND="osmesa", GLPATH_DEVICE="7") == "osmesa\n"


def test_too_old_a_driver_is_said_to_be_too_old() -> None:
    if "Mesa" not in get_context().info.gl_version:
        pytest.skip("only Mesa can be told to be older")
    assert "4.3 is needed" in context_error("get_context('egl', 0)", MESA_GL_VERSION_OVERRIDE="4.1")


def test_every_device_is_listed_and_auto_takes_the_one_it_says() -> None:
    probes = list_devices()
    [taken] = [p for p in probes if p.auto]
    assert taken.info == get_context().info
    assert all(bool(p.info) != bool(p.error) for p in probes)


def test_a_driver_that_crashes_only_fails_its_own_probe() -> None:
    out = python(
        "import glpath.gl.devices as c, subprocess, sys\n"
        "c.start_probe = lambda candidate: subprocess.Popen(\n"
        "    [sys.executable, '-c', 'import os; os.kill(os.getpid(), 11)'],\n"
        "    stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)\n"
        "print([p.error for p in c.list_devices()], any(p.auto for p in c.list_devices()))\n"
    )
    assert "SIGSEGV" in out
    assert "False" in out


def test_probes_import_no_module_of_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("json", "numpy", "moderngl"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    start_probe(Candidate("osmesa", 0, software=True)).communicate()
    assert devices_cli._not_importable(["numpy"]) == {}
    assert not (tmp_path / "ran").exists()


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    devices_cli.register(app)
    return app


def test_devices_prints_one_line_for_each(app: typer.Typer) -> None:
    table = CliRunner().invoke(app, ["devices"], env={"COLUMNS": "200"})
    plain = CliRunner().invoke(app, ["devices", "--json"])
    assert (table.exit_code, plain.exit_code) == (0, 0)
    listed = json.loads(plain.stdout)
    assert sum(one["auto"] for one in listed) == 1
    assert all(one["info"]["renderer"] in table.stdout for one in listed if one["info"])


def test_doctor_says_that_rendering_is_possible_here(app: typer.Typer) -> None:
    table = CliRunner().invoke(app, ["doctor"], env={"COLUMNS": "200"})
    plain = CliRunner().invoke(app, ["doctor", "--json"])
    assert (table.exit_code, plain.exit_code) == (0, 0)
    assert "Rendering is possible here." in table.stdout
    report = json.loads(plain.stdout)
    assert report["possible"]
    checks = {f["check"] for f in report["findings"]}
    assert checks >= {"Python", "packages", "libEGL", "EGL driver", "libOSMesa", "OpenGL 4.3", "limits", "threads"}


def test_doctor_names_the_packages_where_nothing_renders(app: typer.Typer, monkeypatch: pytest.MonkeyPatch) -> None:
    failing = [DeviceProbe("egl", 0, "", None, "libEGL.so.1 cannot be loaded")]
    monkeypatch.setattr(devices_cli, "list_devices", lambda: failing)
    monkeypatch.setattr(devices_cli, "library_loads", lambda library: False)
    table = CliRunner().invoke(app, ["doctor"], env={"COLUMNS": "200"})
    assert table.exit_code == 1
    assert "apt-get install libegl1 libgl1-mesa-dri" in table.stdout
    assert CliRunner().invoke(app, ["devices"]).exit_code == 1


def test_doctor_explains_a_wrong_environment(app: typer.Typer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GLPATH_BACKEND", "glx")
    result = CliRunner().invoke(app, ["doctor", "--json"])
    assert result.exit_code == 1
    assert "unset GLPATH_BACKEND" in result.stdout
    with pytest.raises(ContextError, match="GLPATH_BACKEND"):
        list_devices()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"backend": None}, "backend: None"),
        ({"backend": 5}, "backend: 5"),
        ({"device": "x"}, "device: 'x'"),
        ({"device": 2**70}, "device: an integer of 22 digits"),
        ({"require_gpu": "x"}, "require_gpu: 'x'"),
    ],
)
def test_arguments_of_a_wrong_type_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        get_context(**arguments)  # type: ignore[arg-type]
