"""No work is lost: outputs that cannot be written, signals at every moment, pipes and devices."""

from __future__ import annotations

import errno
import gzip
import io
import os
import resource
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from benchmarks.figures.outcome import Outcome, write
from glpath.cli.main import app
from glpath.errors import ImageError, UsageError
from glpath.film import denoise
from glpath.film.exr import write_exr
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata
from glpath.radiosity import RadiositySolution
from glpath.rendering import RenderJob, calls
from glpath.rendering.interrupts import interrupt_as_flag
from glpath.system import files, outputs
from glpath.system.signals import SignalRecord
from tests.conftest import MakeFilm
from tests.support.time_limit import time_limit

FULL = Path("/dev/full")

SCENE = """
film = { resolution = [8, 8] }
camera = { position = [0, 0, 3], target = [0, 0, 0] }
[[shapes]]
type = "sphere"
radius = 1.0
emission = { radiance = 1.0 }
"""


def run(*arguments: object, stdin: str | bytes | None = None) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments], input=stdin)


@pytest.fixture
def film(make_film: MakeFilm, monkeypatch: pytest.MonkeyPatch) -> Film:
    """What `glpath render` renders, at once; and without a denoiser, as it has no AOVs by which one goes."""
    made = make_film([(0, 32)])
    monkeypatch.setattr(calls, "run_job", lambda job, scene, options: made)
    monkeypatch.setattr(denoise, "can_denoise", lambda: False)
    return made


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary folders are made."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def full(folder: Path, name: str) -> Path:
    """A name that leads to a full disk."""
    (folder / name).symlink_to(FULL)
    return folder / name


# An output that cannot be written.


def test_an_output_that_fails_takes_no_other_with_it_and_all_failures_are_named(film: Film, tmp_path: Path) -> None:
    outputs = [full(tmp_path, "a.png"), tmp_path / "b.png", full(tmp_path, "c.exr"), tmp_path / "d.npz"]
    result = run("render", "furnace", *(x for path in outputs for x in ("-o", path)))
    assert result.exit_code == 1
    assert "2 of 4 outputs cannot be written." in result.stderr
    for path in (outputs[0], outputs[2]):
        assert f"{path}: cannot be written: No space left on device." in result.stderr
    assert iio.imread(outputs[1]).shape == (4, 6, 3)
    assert Film.load(outputs[3]).path_sets == 32
    assert f"wrote {outputs[1]}" in result.stderr
    assert f"wrote {outputs[0]}" not in result.stderr
    assert "kept" not in result.stderr


@pytest.mark.parametrize("good", [(), ("b.png",)])
def test_where_no_film_could_be_written_it_is_kept_in_a_temporary_folder(
    film: Film, tmp_path: Path, temporary: Path, good: tuple[str, ...]
) -> None:
    outputs = [full(tmp_path, "a.npz"), *(tmp_path / name for name in good)]
    result = run("render", "furnace", *(x for path in outputs for x in ("-o", path)))
    assert result.exit_code == 1
    (kept,) = temporary.glob("*/*")
    assert f"The film is kept in {kept};" in result.stderr
    assert np.array_equal(Film.load(kept).radiance_sums, film.radiance_sums)


def test_where_only_a_picture_was_wanted_the_film_is_kept_too(film: Film, tmp_path: Path, temporary: Path) -> None:
    result = run("render", "furnace", "-o", full(tmp_path, "a.png"))
    (kept,) = temporary.glob("*/*")
    assert (result.exit_code, Film.load(kept).path_sets) == (1, 32)
    assert result.stderr.endswith(
        f"a.png: cannot be written: No space left on device.\n"
        f"  The film is kept in {kept}; glpath.Film.load reads it, save writes it.\n"
    )


def test_a_mistake_in_one_format_does_not_lose_the_others(
    film: Film, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glpath.film.film.write_exr", lambda *_, **__: 1 / 0)
    result = run("render", "furnace", "-o", tmp_path / "a.exr", "-o", tmp_path / "b.npz")
    assert result.exit_code == 1
    assert "a.exr: cannot be written: ZeroDivisionError('division by zero')." in result.stderr
    assert Film.load(tmp_path / "b.npz").path_sets == 32


def test_where_even_the_temporary_folder_is_full_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    monkeypatch.setattr(os.path, "isdir", lambda path: False)
    written, failure = outputs.save_all({full(tmp_path, "a.txt"): save_text}, {"b.txt": save_text}, "In {}.")
    assert (written, failure and failure.remedy) == ([], "Nor could it be kept in a temporary folder.")


def test_files_of_the_whole_result_are_written_first(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.png", "b.npz", "c.exr")]
    written, _ = outputs.save_all(dict.fromkeys(paths, save_text), {"film.npz": save_text}, "In {}.")
    assert [path.name for path in written] == ["b.npz", "a.png", "c.exr"]


def test_export_names_a_file_in_the_place_of_its_folder_before_it_writes(tmp_path: Path) -> None:
    (tmp_path / "e_files").write_text("mine")
    result = run("export", "cornell-box-36", "-o", tmp_path / "e.xml", "-o", tmp_path / "e.glb")
    assert result.exit_code == 1
    assert "e_files is a file, but a folder of this name is needed.\n  Rename it" in result.stderr
    assert os.listdir(tmp_path) == ["e_files"]


def test_export_that_fails_in_one_format_writes_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ImageError("e.xml: no room.")

    monkeypatch.setattr("glpath.io.export.write_xml", fail)
    result = run("export", "cornell-box-36", "-o", tmp_path / "e.xml", "-o", tmp_path / "e.glb")
    assert (result.exit_code, (tmp_path / "e.glb").exists()) == (1, True)
    assert "1 of 2 outputs cannot be written" in result.stderr


@pytest.mark.parametrize("count", [1, 2])
def test_remedy_of_an_output_that_fails_is_reported(count: int, tmp_path: Path) -> None:
    def fail(path: Path) -> None:
        raise ImageError("it is too large.", "Make it smaller.")

    _, failure = outputs.save_all(dict.fromkeys([tmp_path / f"{i}.txt" for i in range(count)], fail))
    assert "Make it smaller." in str(failure)


def save_text(path: Path) -> None:
    files.write_bytes(b"text", path)


def test_a_solution_is_kept_where_its_file_cannot_be_written(tmp_path: Path, temporary: Path) -> None:
    options = ("--patches", 20, "--receiver-points", 1, "-q")
    result = run("radiosity", "cornell-box-36", "-o", full(tmp_path, "s.npz"), *options)
    (kept,) = temporary.glob("*/*")
    assert result.exit_code == 1
    assert f"The solution is kept in {kept}" in result.stderr
    result = run("radiosity", "cornell-box-36", "-o", full(tmp_path, "b.glb"), "--radiosity", kept, "-q")
    assert (result.exit_code, len(list(temporary.glob("*/*")))) == (1, 2)
    again = [RadiositySolution.load(path).elements for path in temporary.glob("*/*")]
    assert np.array_equal(*again)


def test_a_figure_that_fails_in_one_file_is_kept_whole(tmp_path: Path, temporary: Path) -> None:
    from tests.support.figure_commands import outcome

    made: Outcome = outcome()
    full(tmp_path, f"{made.report.name}.csv")
    with pytest.raises(ImageError, match="1 of 3 outputs cannot be written") as caught:
        write(made, tmp_path)
    assert sorted(path.suffix for path in temporary.glob("*/*")) == [".csv", ".json", ".png"]
    assert str(next(temporary.iterdir())) in str(caught.value)
    assert (tmp_path / f"{made.report.name}.json").is_file()


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("-o", "a.png", "--stats", "a.png"), "--stats a.png"),
        (("-o", "a.png", "--stats", "link.png"), "--stats link.png"),
        (("-o", "a.npz", "--stats", "a.npz"), "--stats a.npz"),
        (("-o", "a.png", "--checkpoint", "1i", "--stats", "a.checkpoint.npz"), "--stats a.checkpoint.npz"),
        (("-o", "-", "--stats", "-"), "--stats -"),
        (("-o", "a.png", "-o", "link.png"), "-o link.png"),
    ],
)
def test_two_outputs_in_one_file_are_refused_before_rendering(
    words: tuple[str, ...], option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(calls, "run_job", lambda *_: pytest.fail("it is rendered"))
    Path("link.png").symlink_to("a.png")
    result = run("render", "furnace", *words)
    assert result.exit_code == 2, result.output
    assert f"{option}: is the same file as the output" in result.stderr
    assert os.listdir() == ["link.png"]


@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize(
    "command",
    [
        "lightmap {} -o out.glb",
        "export {} -o out.glb",
        "diff {} b.png -o out.png",
        "diff a.png {} -o out.png",
        "horizon field.npy --points {} -o out.csv",
        "measure furnace --normal 0,1,0 --points {} -o out.csv",
        "radiosity furnace --radiosity {} -o out.npz",
        "render furnace --integrator gather --radiosity {} -o out.npz",
        "merge {} other.npz -o out.npz",
    ],
)
def test_output_that_is_also_an_input_is_refused(
    command: str, linked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    out = Path(command.split()[-1])
    source = Path(f"in{out.suffix}") if linked else out
    if out.suffix == ".glb":
        assert run("export", "furnace", "-o", source).exit_code == 0
    else:
        source.write_text("0,0,2\n")
    if linked:
        out.symlink_to(source)
    before = source.read_bytes()
    result = run(*command.format(source).split())
    assert result.exit_code == 2, result.output
    assert f"-o {out}: is the input {source}, which it would replace." in " ".join(result.output.split())
    assert source.read_bytes() == before


_OBJ = "mtllib quad.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a scene that names a model, which names a material file, which names a picture."""
    monkeypatch.chdir(tmp_path)
    iio.imwrite("skin.png", np.full((2, 2, 3), 99, np.uint8))
    write_exr(Path("sky-0.exr"), np.ones((2, 4, 3), np.float32))
    Path("quad.obj").write_text(_OBJ)
    Path("quad.mtl").write_text("newmtl a\nmap_Kd skin.png\n")
    Path("scene.toml").write_text(SCENE + '[[assets]]\nfile = "quad.obj"\n')
    return tmp_path


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("render quad.obj -o skin.png", "skin.png"),
        ("render scene.toml -o skin.png", "skin.png"),
        ("render scene.toml -o a.png --stats quad.mtl", "quad.mtl"),
        ("render --job job.json -o skin.png", "skin.png"),
        ("measure scene.toml --plane z=2 -o skin.png", "skin.png"),
        ("render furnace -D environment=sky-0.exr -o sky-0.exr", "sky-0.exr"),
        ("render furnace -D environment=sky-0.exr --turntable 2 -o sky.exr", "sky-0.exr"),
        ("render furnace -D environment=sky-0.exr --turntable 2 -o a.png -o sky-{}.exr", "sky-0.exr"),
        (
            "lightmap furnace -D environment=l-0.lightmap.exr --materials keep --size 64 -o l.glb",
            "l-0.lightmap.exr",
        ),
    ],
)
def test_output_that_the_scene_reads_is_refused(words: str, name: str, model: Path) -> None:
    if "--job" in words:
        Path("job.json").write_text(RenderJob.of("scene.toml", spp=1).to_json())
    if "lightmap" in words:
        shutil.move("sky-0.exr", name)
    before = Path(name).read_bytes()
    result = run(*words.split())
    assert result.exit_code == 2, result.output
    assert f"{name}: is the input" in result.stderr
    assert Path(name).read_bytes() == before


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("render furnace -D resolution=8 --spp 1 --no-denoise --turntable 2 -o a.png", "a-1.png"),
        ("lightmap furnace --materials keep --size 64 --spp 1 --no-denoise -o a.glb", "a-0.lightmap.exr"),
        ("lightmap furnace --materials keep --size 64 --spp 1 --no-denoise -o a.glb", "a-0.lightmap.json"),
    ],
)
@pytest.mark.parametrize("exists", [False, True])
def test_link_with_a_derived_name_is_replaced(
    words: str, name: str, exists: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    victim = Path("victim")
    if exists:
        victim.write_text("precious")
    Path(name).symlink_to(victim)
    result = run(*words.split(), "-q")
    assert result.exit_code == 0, result.output
    assert not Path(name).is_symlink()
    assert Path(name).stat().st_size > 100
    assert (victim.read_text() == "precious") if exists else not victim.exists()


def test_folder_of_an_export_is_no_link(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "e_files").symlink_to("data")
    result = run("export", "cornell-box", "-o", tmp_path / "e.xml")
    assert result.exit_code == 1
    assert "e_files: is a symbolic link" in result.stderr
    assert os.listdir(tmp_path / "data") == []


def test_file_of_an_export_that_is_a_link_is_replaced(tmp_path: Path) -> None:
    assert run("export", "cornell-box", "-o", tmp_path / "e.xml", "-q").exit_code == 0
    mesh = next((tmp_path / "e_files").glob("*.ply"))
    content = mesh.read_bytes()
    (tmp_path / "victim").write_text("precious")
    mesh.unlink()
    mesh.symlink_to(tmp_path / "victim")
    assert run("export", "cornell-box", "-o", tmp_path / "e.xml", "-q").exit_code == 0
    assert (mesh.is_symlink(), mesh.read_bytes()) == (False, content)
    assert (tmp_path / "victim").read_text() == "precious"


def test_names_of_one_device_are_separate_outputs(film: Film, tmp_path: Path) -> None:
    result = run("render", "furnace", "-o", tmp_path / "a.png", "-o", tmp_path / "a.png", "--stats", os.devnull)
    assert result.exit_code == 0, result.output
    outputs.check_outputs([Path(os.devnull), Path("/dev/null")])
    (tmp_path / "null.png").symlink_to(os.devnull)
    outputs.check_outputs([Path(os.devnull), tmp_path / "null.png"])


def test_the_checkpoint_of_a_solution_is_no_output(tmp_path: Path) -> None:
    outputs = ("-o", tmp_path / "a.npz", "-o", tmp_path / "a.checkpoint.npz")
    result = run("radiosity", "cornell-box-36", *outputs, "--checkpoint", "1i")
    assert result.exit_code == 2
    assert "a.checkpoint.npz: is the same file as the output" in result.stderr


LIMITED = """
import sys
from pathlib import Path
from typing import Any
import numpy as np
from glpath.errors import ImageError
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata

film = Film.empty(FilmMetadata("noise", "0", "path", 0, 5, {}, (96, 96), (0, 0, 96, 96)))
film.add(0, 5, np.random.default_rng(0).random((96, 96, 3)))
for path in sys.argv[1:]:
    try:
        film.save(path)
        print("saved")
    except ImageError as error:
        print(error)
"""


@pytest.mark.parametrize("old", [False, True])
def test_a_disk_that_fills_up_while_writing_is_an_error_in_every_format(tmp_path: Path, old: bool) -> None:
    paths = [tmp_path / f"a{suffix}" for suffix in (".png", ".exr", ".npz")]
    for path in paths:
        if old:
            path.write_bytes(b"old")
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))  # noqa: E731
    command = [sys.executable, "-B", "-c", LIMITED, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, preexec_fn=limit)
    lines = done.stdout.splitlines()
    assert len(lines) == 3, done.stderr
    for path, line in zip(paths, lines, strict=True):
        assert line.startswith(f"{path}: cannot be written: "), line
        assert (path.read_bytes() if old else path.exists()) == (b"old" if old else False)
    assert len(os.listdir(tmp_path)) == (3 if old else 0)


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("needs the right to mount")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.filterwarnings("ignore:Exception ignored in:pytest.PytestUnraisableExceptionWarning")  # numpy 1
def test_a_full_disk_leaves_the_old_file_and_no_half_one(tiny_disk: Path, make_film: MakeFilm) -> None:
    large = make_film([(0, 8)], (200, 200))
    for suffix in (".exr", ".npz", ".png"):
        path = tiny_disk / f"a{suffix}"
        path.write_bytes(b"old")
        with pytest.raises(ImageError, match="cannot be written"):
            large.save(path)
        assert path.read_bytes() == b"old"
    assert len(os.listdir(tiny_disk)) == 3


# Signals.

# A render that takes no time; `AT` is a moment at which the process sends itself a signal.
PROGRAM = """
import os, signal, sys, time
import numpy as np
from glpath.cli.main import run
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata
from glpath.rendering import Progress, RenderInterrupted, calls

at, number, times = sys.argv.pop(1), getattr(signal, sys.argv.pop(1)), int(sys.argv.pop(1))

def strike(moment):
    if moment == at:
        for _ in range(times):
            os.kill(os.getpid(), number)
            time.sleep(0.01)

def run_job(job, scene, options):
    on_progress = options.on_progress
    film = Film.empty(FilmMetadata("fast", "0", "path", 0, 5, {}, (6, 4), (0, 0, 6, 4)))
    on_progress(Progress(0, 5, 0.0, None, film, "compiling shaders", ""))
    film.add(0, 5, np.ones((4, 6, 3)))
    if at == "unwinding":
        try:
            raise RenderInterrupted(film)
        finally:
            strike("unwinding")
    on_progress(Progress(5, 5, 1.0, None, film, "rendering", ""))
    strike("end")
    return film

def savez(file, **arrays):
    strike("saving")
    real(file, **arrays)

real, np.savez, calls.run_job = np.savez, savez, run_job
run()
"""


def struck(out: Path, moment: str, name: str, times: int) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROGRAM, moment, name, str(times), "render", "furnace", "-o", str(out)]
    command += ["--spp", "5", "--progress", "lines"]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(
    ("moment", "name", "times"),
    [
        ("end", "SIGINT", 1),
        ("end", "SIGTERM", 2),
        ("unwinding", "SIGINT", 1),
        ("unwinding", "SIGTERM", 3),
        ("saving", "SIGINT", 2),
        ("saving", "SIGTERM", 1),
    ],
)
def test_no_signal_loses_a_film(tmp_path: Path, moment: str, name: str, times: int) -> None:
    done = struck(tmp_path / "a.npz", moment, name, times)
    assert done.returncode == 130, done.stderr
    assert Film.load(tmp_path / "a.npz").path_sets == 5
    assert f"interrupted: 5 of 5 path sets are in {tmp_path / 'a.npz'}" in done.stderr
    assert os.listdir(tmp_path) == ["a.npz"]


def test_the_third_signal_gives_up(tmp_path: Path) -> None:
    done = struck(tmp_path / "a.npz", "saving", "SIGINT", 3)
    assert (done.returncode, os.listdir(tmp_path)) == (130, [])
    assert "interrupt once more" in done.stderr
    assert "Traceback" not in done.stderr


REAL = """
import os, signal, sys
from glpath.cli.main import run
from glpath.rendering.session import Session

Session.warn_about = lambda *_: os.kill(os.getpid(), signal.SIGTERM)
run()
"""


def test_a_signal_between_a_real_render_and_its_saving_waits(tmp_path: Path) -> None:
    command = [sys.executable, "-c", REAL, "render", "furnace", "-D", "resolution=8", "--spp", "1"]
    out = tmp_path / "a.npz"
    done = subprocess.run([*command, "-o", str(out)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 130, done.stderr
    assert Film.load(out).path_sets == 1


SOLVER = """
import os, signal, sys
from pathlib import Path
from typing import Any
from glpath.cli.main import run
from glpath.radiosity import solution, solvers

save = solution.RadiositySolution.save
def struck(self, path):
    os.kill(os.getpid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGTERM)
    save(self, path)
solution.RadiositySolution.save = struck
run()
"""


def test_signals_wait_for_a_solution_to_be_saved(tmp_path: Path) -> None:
    command = [sys.executable, "-c", SOLVER, "radiosity", "cornell-box-36", "-o", str(tmp_path / "s.npz")]
    command += ["--patches", "20", "--receiver-points", "1", "-q"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 130, done.stderr
    assert "what was solved is in" in done.stderr
    assert RadiositySolution.load(tmp_path / "s.npz").elements.max() > 0


def test_a_second_signal_does_not_tear_a_film_apart() -> None:
    class Torn(Film):
        """Two signals come when the first of its fields has changed."""

        def __setattr__(self, name: str, value: object) -> None:
            super().__setattr__(name, value)
            if name == "ranges" and value:
                signal.raise_signal(signal.SIGINT)
                signal.raise_signal(signal.SIGINT)

    film = Torn.empty(FilmMetadata("torn", "0", "path", 0, 5, {}, (6, 4), (0, 0, 6, 4)))

    def add() -> None:
        with interrupt_as_flag() as interrupted, interrupted.whole():
            film.add(0, 5, np.ones((4, 6, 3)))

    with pytest.raises(KeyboardInterrupt):
        add()
    assert (film.path_sets, film.ranges, film.mean.max()) == (5, ((0, 5),), 0.2)


def test_a_signal_after_the_last_step_ends_a_render_too() -> None:
    """It is not swallowed: who renders in a loop means the loop."""
    import glpath

    def strike(progress: glpath.Progress) -> None:
        if progress.done == progress.total:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(glpath.RenderInterrupted) as caught:
        glpath.render("furnace", spp=1, resolution=(8, 8), on_progress=strike)
    assert caught.value.film.path_sets == 1


# Pipes and devices.


def received(path: Path, save: Callable[[Path], object]) -> bytes:
    """What comes out of a pipe that something is saved to."""
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(path.read_bytes()))
    reader.start()
    save(path)
    reader.join(10)
    return got[0]


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npz", "a"])
def test_a_pipe_gets_the_bytes_of_the_file(make_film: MakeFilm, tmp_path: Path, name: str) -> None:
    made = make_film([(0, 32)])
    os.mkfifo(tmp_path / name)
    got = received(tmp_path / name, made.save)
    assert stat.S_ISFIFO((tmp_path / name).stat().st_mode)
    expected = tmp_path / f"file{Path(name).suffix or '.png'}"
    made.save(expected)
    if expected.suffix == ".npz":  # a zip file has the time in it
        expected.write_bytes(got)
        assert np.array_equal(Film.load(expected).radiance_sums, made.radiance_sums)
    else:
        assert got == expected.read_bytes()


@pytest.mark.parametrize("command", [("render", "furnace"), ("export", "furnace")])
def test_files_are_written_before_a_pipe_that_blocks(film: Film, tmp_path: Path, command: tuple[str, ...]) -> None:
    names = ("a.png", "b.npz") if command[0] == "render" else ("a.glb", "b.glb")
    pipe, file = (tmp_path / name for name in names)
    os.mkfifo(pipe)
    existed: list[bool] = []

    def read() -> None:
        with pipe.open("rb") as reader:  # returns when the writer opens the pipe
            existed.append(file.is_file())
            reader.read()

    reader = threading.Thread(target=read)
    reader.start()
    result = run(*command, "-o", pipe, "-o", file)
    reader.join(10)
    assert (result.exit_code, existed) == (0, [True]), result.output


def test_a_device_stays_a_device(film: Film, tmp_path: Path) -> None:
    for arguments in (("render", "furnace", "-o", "/dev/null"), ("schema", "-o", "/dev/null")):
        result = run(*arguments)
        assert result.exit_code == 0, result.stderr
    film.save("/dev/null")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert not list(Path("/dev").glob(".null*"))


def test_what_is_neither_file_nor_pipe_is_refused(make_film: MakeFilm, tmp_path: Path) -> None:
    import socket

    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "a.png"))
        for attempt in (files.check_writable, make_film([(0, 8)]).save):
            with pytest.raises(ImageError, match=r"a.png: .*is a block device or a socket"):
                attempt(tmp_path / "a.png")
        assert stat.S_ISSOCK((tmp_path / "a.png").stat().st_mode)


def test_a_reader_that_leaves_is_an_error_and_no_traceback(make_film: MakeFilm, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: os.close(os.open(path, os.O_RDONLY)))
    reader.start()
    with pytest.raises(ImageError, match=r"a.exr: cannot be written: Broken pipe"):
        make_film([(0, 8)], (400, 400)).save(path)
    reader.join(10)


@pytest.mark.parametrize("is_open", [False, True])
def test_a_signal_ends_the_wait_for_a_reader_of_a_pipe(
    is_open: bool, make_film: MakeFilm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`timeout` sends one signal, and waited for ever."""
    path = tmp_path / "a.exr"
    os.mkfifo(path)
    monkeypatch.setattr(files, "_AFTER_SIGNAL_S", 0.05)
    record = SignalRecord()
    monkeypatch.setattr(files, "RECORDS", [record])
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK) if is_open else None
    later = threading.Timer(0.1, lambda: record.record(signal.SIGTERM))
    later.start()
    with pytest.raises(ImageError, match=r"a.exr: cannot be written: nobody reads the pipe, and a signal ended"):
        make_film([(0, 8)], (400, 400)).save(path)
    assert record.first == signal.SIGTERM
    if reader is not None:
        os.close(reader)


def test_a_device_without_a_driver_is_an_error(make_film: MakeFilm, monkeypatch: pytest.MonkeyPatch) -> None:
    """/dev/tty is such a device for a process without a terminal."""

    def refuse(path: str, *arguments: Any, **named: Any) -> int:
        if path == "/dev/null":
            raise OSError(errno.ENXIO, "No such device or address")
        return real_open(path, *arguments, **named)

    real_open = os.open
    monkeypatch.setattr(os, "open", refuse)
    with time_limit(5), pytest.raises(ImageError, match="/dev/null: cannot be written: No such device or address"):
        make_film([(0, 8)]).save("/dev/null")


def test_a_pipe_that_is_removed_does_not_become_a_file(make_film: MakeFilm, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    os.mkfifo(path)
    later = threading.Timer(0.1, path.unlink)
    later.start()
    with time_limit(5), pytest.raises(ImageError, match=r"a.exr: cannot be written: No such file or directory"):
        make_film([(0, 8)]).save(path)
    assert not path.exists()


def test_standard_output_may_be_compressed(
    make_film: MakeFilm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = make_film([(0, 8)])
    film.save(tmp_path / "a.png")
    with gzip.open(tmp_path / "b.png.gz", "wb") as compressed:
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(compressed))  # type: ignore[arg-type]
        film.save("-")
        monkeypatch.undo()
    assert gzip.decompress((tmp_path / "b.png.gz").read_bytes()) == (tmp_path / "a.png").read_bytes()


def test_a_slow_reader_gets_everything_after_a_signal(
    make_film: MakeFilm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = SignalRecord()
    record.record(signal.SIGTERM)
    monkeypatch.setattr(files, "RECORDS", [record])
    monkeypatch.setattr(files, "_AFTER_SIGNAL_S", 0.5)
    film, path, received = make_film([(0, 8)], (400, 400)), tmp_path / "a.exr", bytearray()
    os.mkfifo(path)

    def read() -> None:
        with path.open("rb", buffering=0) as reader:
            while piece := reader.read(1 << 18):
                received.extend(piece)
                time.sleep(0.02)

    reader = threading.Thread(target=read)
    reader.start()
    film.save(path)
    reader.join(10)
    film.save(tmp_path / "b.exr")
    assert bytes(received) == (tmp_path / "b.exr").read_bytes()


def test_dash_is_a_png_on_standard_output(film: Film, tmp_path: Path) -> None:
    result = run("render", "furnace", "-o", "-", "-o", tmp_path / "a.png")
    assert result.exit_code == 0, result.stderr
    assert result.stdout_bytes == (tmp_path / "a.png").read_bytes()
    assert "wrote -" in result.stderr


def test_standard_output_takes_a_png_from_a_real_render() -> None:
    command = [sys.executable, "-m", "glpath", "render", "-", "-o", "-", "--spp", "1"]
    done = subprocess.run(command, input=SCENE.encode(), capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
    picture = iio.imread(done.stdout)
    assert (picture.shape, picture.max()) == ((8, 8, 3), 255)
    assert b"rendering" in done.stderr
    closed = subprocess.run(
        f"{sys.executable} -m glpath render furnace -D resolution=200 -o - --spp 1 --max-depth 1 -q | true",
        shell=True, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert closed.stderr == "glpath: error: -: cannot be written: Broken pipe.\n" or closed.stderr.startswith(
        "glpath: error: -: cannot be written: Broken pipe.\n  The film is kept in "
    )


@pytest.mark.skipif(not FULL.exists(), reason="a device of Linux")
@pytest.mark.parametrize("command", ["--version", "scenes", "info furnace --json", "--help"])
def test_a_full_disk_behind_standard_output_is_a_line(command: str) -> None:
    with FULL.open("w") as full:
        line = [sys.executable, "-m", "glpath", *command.split()]
        done = subprocess.run(line, stdout=full, stderr=subprocess.PIPE, text=True, timeout=120)
    assert done.stderr == "glpath: error: standard output: cannot be written: No space left on device.\n"
    assert done.returncode == 1


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
@pytest.mark.parametrize("command", ["info furnace --json", "info furnace", "schema", "diff a.npz a.npz"])
@pytest.mark.parametrize("end", ["Broken pipe", "it is closed"])
def test_text_that_standard_output_does_not_take_is_an_error(
    command: str, end: str, make_film: MakeFilm, tmp_path: Path
) -> None:
    make_film([(0, 32)]).save(tmp_path / "a.npz")
    line = f"{sys.executable} -m glpath {command}"
    reader, writer = os.pipe()
    os.close(reader)
    line = f"{line} >&-" if end == "it is closed" else f"exec {line}"
    done = subprocess.run(
        line, shell=True, cwd=tmp_path, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=120
    )
    os.close(writer)
    message = "glpath: error: standard output: cannot be written: it is closed.\n"
    assert done.stderr == (message if end == "it is closed" else "")
    assert done.returncode == (74 if command.startswith("diff") else 1)


@pytest.mark.skipif(not FULL.exists(), reason="a device of Linux")
def test_diff_writes_its_picture_before_standard_output_fails(make_film: MakeFilm, tmp_path: Path) -> None:
    make_film([(0, 32)]).save(tmp_path / "a.npz")
    line = [sys.executable, "-m", "glpath", "diff", "a.npz", "a.npz", "-o", "difference.png"]
    with FULL.open("w") as full:
        done = subprocess.run(line, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, timeout=120)
    assert (done.returncode, "standard output: cannot be written" in done.stderr) == (74, True)
    assert iio.imread(tmp_path / "difference.png").shape == (4, 6, 3)


def test_diff_prints_its_numbers_if_its_picture_cannot_be_written(make_film: MakeFilm, tmp_path: Path) -> None:
    make_film([(0, 32)]).save(tmp_path / "a.npz")
    result = run("diff", tmp_path / "a.npz", tmp_path / "a.npz", "-o", full(tmp_path, "difference.png"))
    assert result.exit_code == 1
    assert "No space left on device" in result.stderr
    assert "relMSE" in result.stdout
    assert "wrote" not in result.stdout


# A scene from standard input.


@pytest.mark.parametrize("command", ["render", "radiosity", "export", "info", "validate"])
def test_a_scene_comes_from_standard_input(command: str, tmp_path: Path, film: Film) -> None:
    out = {"render": "a.png", "radiosity": "s.npz", "export": "e.xml"}.get(command)
    text = SCENE.replace('type = "sphere"\nradius = 1.0', 'type = "box"\nmin = [0, 0, 0]\nmax = [1, 1, 1]')
    options = () if out is None else ("-o", tmp_path / out)
    result = run(command, "-", *options, stdin=text)
    assert result.exit_code == 0, result.output
    assert "Traceback" not in result.output
    assert out is None or (tmp_path / out).stat().st_size


def test_a_mistake_on_standard_input_is_named() -> None:
    result = run("info", "-", stdin="shapes = [")
    assert (result.exit_code, result.stderr[:37]) == (1, "glpath: error: standard input: line 1")
    assert "is not UTF-8 text" in run("validate", "-", stdin=b"\xff\xfe").output
    assert run("info", "-", "-D", "radiance=1", stdin=SCENE).exit_code == 2


def test_model_on_standard_input_is_told_that_it_needs_a_suffix(tmp_path: Path) -> None:
    result = run("info", "-", stdin="v 0 0 0\n")
    assert result.exit_code == 1
    assert (
        "What comes from a pipe is read as a scene file. Save a model in a file with its suffix." in result.stderr
    )
    (tmp_path / "room.json").write_text('{"type": "Model"}')
    result = run("info", tmp_path / "room.json")
    assert "A file with another suffix is read as a scene file." in result.stderr


@pytest.mark.parametrize("text", [b"", b"film = "])
@pytest.mark.parametrize("named", [False, True])
def test_a_silent_pipe_ends_with_the_time_limit(text: bytes, named: bool, tmp_path: Path) -> None:
    pipe = tmp_path / "scene.toml"
    os.mkfifo(pipe)
    with pipe.open("r+b", buffering=0) as writer:
        writer.write(text)
        line = [sys.executable, "-m", "glpath", "render", str(pipe) if named else "-", "-o", "a.png"]
        line += ["--time-limit", "1s"]
        done = subprocess.run(line, cwd=tmp_path, stdin=writer, stderr=subprocess.PIPE, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (1, SILENT)


SILENT = """\
glpath: error: --time-limit 1: over while reading a pipe, before there was a result.
  Give it more time.
"""


def test_a_scene_comes_through_a_pipe(tmp_path: Path) -> None:
    from glpath import load_scene

    os.mkfifo(tmp_path / "scene.toml")
    writer = threading.Thread(target=(tmp_path / "scene.toml").write_text, args=(SCENE,))
    writer.start()
    assert len(load_scene(tmp_path / "scene.toml").shapes) == 1
    writer.join(10)


def test_a_picture_is_not_for_a_terminal(film: Film, monkeypatch: pytest.MonkeyPatch) -> None:
    import pty

    primary, secondary = pty.openpty()
    command = [sys.executable, "-m", "glpath", "render", "furnace", "-o", "-"]
    done = subprocess.run(command, stdout=secondary, stderr=subprocess.PIPE, text=True, timeout=60)
    os.close(primary)
    os.close(secondary)
    assert (done.returncode, "no text for a terminal" in done.stderr) == (2, True)
    with pytest.raises(UsageError):
        film.save("-.gif")


@pytest.mark.parametrize("ask", [files.check_writable, lambda path: files.write_bytes(b"text", path)])
def test_temporary_name_that_is_a_link_already_is_passed_over(
    ask: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if somebody had guessed it."""
    target = tmp_path / "precious"
    target.write_text("years of work")
    guessed = tmp_path / ".a.00000000.part.txt"
    guessed.symlink_to(target)
    names = iter(["00000000", "00000000", "00000001"])
    monkeypatch.setattr(files.secrets, "token_hex", lambda count: next(names))
    ask(tmp_path / "a.txt")
    assert target.read_text() == "years of work"
    assert guessed.is_symlink()
    assert {path.name for path in tmp_path.iterdir()} <= {"precious", guessed.name, "a.txt"}


def test_temporary_file_behind_a_link_has_the_suffix_of_the_link(tmp_path: Path) -> None:
    """Writers of movies choose the format by it."""
    link = tmp_path / "a.mp4"
    link.symlink_to("blob")
    with files.whole_file(link) as temporary:
        temporary.write_bytes(b"movie")
        assert temporary.suffix == ".mp4"
    assert (tmp_path / "blob").read_bytes() == b"movie"
