"""Numbers, names and settings that nobody means end in one short error, before anything is computed."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
from typer.testing import CliRunner

import glpath
from glpath.cli import devices, values
from glpath.cli.frames import Frames
from glpath.cli.main import app
from glpath.compare import read_picture
from glpath.errors import ContextError, UsageError
from glpath.gl.devices import chosen
from glpath.gl.fences import asks_for_one_thread
from glpath.jobs import connection
from glpath.system.numerals import real, unsigned, whole

MANY = "9" * 400
MODEL = Path(__file__).parents[2] / "scenes" / "room.glb"
LAUNCH = ["render", "cornell-box-36", "--resolution", "4x4", "--spp", "1", "-q"]


def refused(*arguments: str | Path) -> str:
    """The error of a command that must be a single, short block without a traceback."""
    done = CliRunner().invoke(app, [str(each) for each in arguments])
    assert done.exit_code in (1, 2), done.output
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    assert done.output.startswith("glpath: error: "), done.output
    assert len(done.output) < 600
    return done.output


@pytest.mark.parametrize("number", [MANY, "9" * 5000, "-" + MANY, "1_0", "\u0661\u0662", "\u00b2", "0x10", "1e400"])
@pytest.mark.parametrize("option", ["--seed", "--spp", "--threads", "--max-depth", "--device", "--turntable"])
def test_a_whole_number_is_of_few_plain_digits(option: str, number: str, tmp_path: Path) -> None:
    assert option in refused(*LAUNCH, "-o", tmp_path / "a.png", option, number)


@pytest.mark.parametrize(
    "given",
    [
        f"--resolution={MANY}x4",
        "--resolution=\u0664x4",
        f"--crop=0,0,{MANY},1",
        f"--checkpoint={MANY}i",
        f"--checkpoint={MANY}s",
        f"--time-limit={MANY}",
        f"--sample-range=0:{MANY}",
        f"--frames=0:{MANY}",
        f"--exposure={MANY}",
        "--noise=1_0",
        "--camera-position=1e300,0,0",
        "--camera-target=1e300,0,0",
        "--camera-up=1e300,1e300,0",
        "--ambient=1e300",
    ],
)
@pytest.mark.filterwarnings("error")
def test_other_numbers_are_within_reason(given: str, tmp_path: Path) -> None:
    refused(*LAUNCH, "-o", tmp_path / "a.png", given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command",
    [
        "lightmap cornell-box -o a.glb --texels 1e-300",
        "lightmap cornell-box -o a.glb --texels 1e308",
        "radiosity cornell-box-36 -o a.npz --splits 1000",
        f"probes cornell-box -o a.json --grid {MANY}x1x1",
        f"radiosity cornell-box-36 -o a.npz --shaft clump={MANY}",
        f"radiosity cornell-box-36 -o a.npz --patches {MANY}",
        "radiosity cornell-box-36 -o a.npz --seed -1",
        "daylight cornell-box -o a.npz --points p.csv --seed -1",
        "daylight cornell-box -o a.npz --points p.csv --elements 2000000000",
        f"measure cornell-box -o a.csv --plane y=0.1 --spacing {MANY}",
        f"measure cornell-box -o a.csv --plane y=0.1 --grid {MANY},{MANY}",
        "render cornell-box-36 --turntable 3 -o a{:999999999}.png",
        f"render cornell-box-36 -o a.png -D {MANY}={MANY}",
        f"render furnace -o a.png -D resolution={MANY}",
    ],
)
def test_options_of_other_commands_are_within_reason(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.csv").write_text("x,y,z,nx,ny,nz\n1,1,1,0,1,0\n")
    refused(*command.split())


@pytest.mark.parametrize("text", ["1_0", "\u0661", "", "a", "\uff11", MANY])
def test_numerals_are_plain(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        whole(text)
    if text != MANY:
        with pytest.raises(ValueError):  # noqa: PT011
            real(text)
    assert (whole(" -12 "), real("+1.5e3")) == (-12, 1500.0)


@pytest.mark.parametrize("text", ["\u0661", "\u00b2", "9" * 5000, "1_0", "-1", ""])
def test_numbers_among_names_are_of_few_plain_digits(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert unsigned(text) is None
    for word in (f"--animation={text}", f"--variant={text}", f"--parameter=camera={text}"):
        refused("info", MODEL, word)
    assert not asks_for_one_thread(text)
    assert [each.status for each in devices._threads(text)] == ["ok"]
    with pytest.raises(UsageError, match="from 1 to"):
        connection._count(f"local:{text}")
    connection._wait_while_refused(f"tcp://x:{text}")
    monkeypatch.setenv("GLPATH_DEVICE", text or "a")
    with pytest.raises(ContextError) if text != "-1" else nullcontext():
        chosen("auto", None)


def test_frame_numbers_with_many_zeros_are_read_in_linear_time() -> None:
    zeros = "0" * 200_000
    assert Frames.of_range(f"{zeros}1:{zeros}3") == Frames.of_range("1:3")
    with pytest.raises(UsageError, match="expected A:B"):
        Frames.of_range(zeros)


@pytest.mark.parametrize("variable", ["MESA_SHADER_CACHE_DIR", "XDG_CACHE_HOME", "HOME", "LIBGL_DRIVERS_PATH"])
def test_doctor_accepts_folders_with_impossible_names(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable, "/" + 300 * "x")
    assert len(list(devices._shader_cache())) == 1
    devices._drivers()


def test_a_shard_is_of_few_plain_digits() -> None:
    for text in (f"1/{MANY}", "\u0661/\u0662", "0/2", "3/2"):
        with pytest.raises(UsageError, match="expected K/N"):
            values.shard_of(text)


def run(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "glpath", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, env=os.environ | variables, errors="replace"
    )


@pytest.mark.parametrize("threads", ["0", "-1", "many", "\u00b2"])
def test_the_number_of_numba_s_threads_is_checked(threads: str) -> None:
    done = run("radiosity", "cornell-box-36", "-o", "a.npz", NUMBA_NUM_THREADS=threads)
    assert done.returncode == 2
    assert done.stderr.startswith("glpath: error: NUMBA_NUM_THREADS is ")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("columns", ["0", "-3", "x", MANY])
def test_columns_that_are_none_are_not_obeyed(columns: str) -> None:
    done = run("scenes", "--help", COLUMNS=columns, TERMINAL_WIDTH=columns)
    assert done.returncode == 0, done.stderr
    assert "Usage: glpath scenes" in done.stdout


def test_too_little_memory_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def exhausted(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 1.00 TiB")

    monkeypatch.setattr("glpath.io.load_scene", exhausted)
    text = refused(*LAUNCH, "-o", tmp_path / "a.png")
    assert text.startswith("glpath: error: there is not enough memory: Unable to allocate 1.00 TiB.")


def test_the_memory_of_ulimit_is_all_there_is() -> None:
    code = "import resource; from glpath.radiosity.memory import available_bytes\n"
    code += "resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30)); a = available_bytes()\n"
    code += "resource.setrlimit(resource.RLIMIT_AS, (7 << 30, 8 << 30)); print(a, available_bytes())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    before, after = map(int, done.stdout.split())
    assert after < 7 << 30
    assert after <= before


def test_names_of_bytes_that_are_no_text_are_written_and_read(tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff"))
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes UTF-8 alone")
    film = glpath.render("cornell-box-36", resolution=(4, 4), spp=1, integrator="path", progress=False)
    for name in ("a.exr", "a.png", "a.npz"):
        film.save(folder / name)
        assert glpath.read_image(folder / name).shape == (4, 4, 3)


def test_a_scene_whose_name_is_no_text_is_rendered_measured_and_exported(tmp_path: Path) -> None:
    stem = os.fsencode(tmp_path) + b"/a\xff"
    scene, model = (Path(os.fsdecode(stem + suffix)) for suffix in (b".toml", b".obj"))
    try:
        scene.write_text(
            'camera = { position = [0, 1, 3], target = [0, 0, 0] }\nshapes = [{ type = "quad", '
            "corners = [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]] }]\nsky = { zenith = 1, horizon = 1 }\n"
        )
    except OSError:
        pytest.skip("this file system takes UTF-8 alone")
    model.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    out = tmp_path / "out"
    quick = ("--spp", "1", "--resolution", "8x8", "--quiet")
    assert glpath.load_scene(scene).name == r"a\xff"
    with pytest.warns(glpath.SceneWarning, match="has no camera"):
        assert {shape.name for shape in glpath.load_scene(model).shapes} >= {r"a\xff"}
    for arguments in (
        ("render", scene, "-o", out / "a.png", "-o", out / "a.exr", *quick),
        ("render", model, "-o", out / "b.exr", "--aov", "object_id", *quick),
        ("export", scene, "-o", out / "a.glb"),
        ("export", model, "-o", out / "b.glb"),
        ("export", model, "-o", out / "b.xml"),
        ("measure", scene, "--plane", "y=0.1", "--spp", "16", "-o", out / "c.png", "-o", out / "c.html", "--quiet"),
    ):
        done = CliRunner().invoke(app, [str(each) for each in arguments])
        assert done.exit_code == 0, done.output
    assert read_picture(out / "a.png").provenance["glpath.scene"] == r"a\xff"
