"""The command line: what it hands to the renderer, what it writes, what it says and how it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import imageio.v3 as iio
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import glpath
from glpath import rendering
from glpath.cli.main import Commands, app
from glpath.cli.scene import read_scene
from glpath.compare import Picture
from glpath.errors import ContextError, SceneWarning
from glpath.film import denoise
from glpath.film.aovs import DENOISER_AOVS
from glpath.film.exr import write_exr
from glpath.film.film import Film, read_image
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.whitted_settings import TBufferSettings
from glpath.rendering import RenderJob, calls
from glpath.rendering.calls import reporting_to
from glpath.rendering.progress import reporting
from glpath.rendering.run_options import RunOptions
from glpath.scene import Scene
from glpath.system.log import compilations
from glpath.system.reporting import duration, percent
from glpath.system.signals import TERMINATING
from tests.conftest import MakeFilm
from tests.support.command_line import run
from tests.support.killing import default_signals


@dataclass
class Renderer:
    """Stands for `run_job`: keeps what it was called with, reports, and gives a film."""

    film: Film
    interrupt: bool = False
    calls: list[tuple[RenderJob, Scene, RunOptions]] = field(default_factory=list)

    def __call__(self, job: RenderJob, scene: Scene, options: RunOptions) -> Film:
        self.calls.append((job, scene, options))
        with reporting_to(options) as told:
            assert told.on_progress is not None
            for stage, done in (("compiling shaders", 0), ("rendering", 8), ("rendering", 16), ("rendering", 32)):
                told.on_progress(
                    rendering.Progress(
                        done=done,
                        total=32,
                        elapsed_s=float(done),
                        error=0.05 if done else None,
                        film=self.film,
                        stage=stage,
                        renderer="llvmpipe (test)",
                    )
                )
        if self.interrupt:
            raise interrupted(self.film)
        return self.film


def interrupted(film: Film) -> rendering.RenderInterrupted:
    stop = rendering.RenderInterrupted.__new__(rendering.RenderInterrupted)
    stop.film = film
    return stop


@pytest.fixture
def renderer(make_film: MakeFilm, monkeypatch: pytest.MonkeyPatch) -> Renderer:
    """Without a denoiser: the film has no AOVs by which one goes."""
    fake = Renderer(make_film([(0, 32)]))
    monkeypatch.setattr(calls, "run_job", fake)
    monkeypatch.setattr(denoise, "can_denoise", lambda: False)
    return fake


def python(code: str, *arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, **options)


# The package.


def test_the_public_names_are_these() -> None:
    assert glpath.__all__ == [
        "ContextError",
        "DaylightCoefficients",
        "DaylightYear",
        "ElementError",
        "Film",
        "GlpathError",
        "HeightField",
        "Horizon",
        "ImageError",
        "Irradiance",
        "Lightmap",
        "Probes",
        "Progress",
        "RadiosityInterrupted",
        "RadiosityProgress",
        "RadiositySolution",
        "RenderInterrupted",
        "Scene",
        "SceneError",
        "SceneWarning",
        "ShaderError",
        "StrictError",
        "Texels",
        "TimeLimitError",
        "UsageError",
        "ViewFactorProgress",
        "ViewFactors",
        "Views",
        "__version__",
        "camera",
        "daylight_coefficients",
        "daylight_year",
        "element_error",
        "export",
        "horizon",
        "irradiance",
        "lightmap",
        "load_height_field",
        "load_point_cloud",
        "load_scene",
        "probes",
        "read_image",
        "relative_mse",
        "render",
        "render_frames",
        "render_views",
        "solve_radiosity",
        "texels",
        "view_factors",
    ]
    for name in glpath.__all__:
        assert getattr(glpath, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Renderer'"):
        glpath.Renderer  # noqa: B018


def test_importing_glpath_loads_nothing_heavy() -> None:
    heavy = ["numpy", "scipy", "moderngl", "trimesh", "OpenEXR", "imageio", "typer", "rich", "msgspec"]
    done = python(f"import glpath, sys; print([m for m in {heavy} if m in sys.modules], glpath.__version__)")
    assert done.stdout.startswith("[] ")
    assert done.stderr == ""


@pytest.mark.parametrize("command", ["", "render", "diff", "merge"])
def test_help_loads_nothing_that_computes(command: str) -> None:
    """numpy alone takes as long as all that a command's help needs."""
    heavy = ["numpy", "scipy", "numba", "moderngl", "trimesh", "OpenEXR", "imageio", "PIL", "mitsuba", "pydantic"]
    done = python(
        "import sys\nfrom glpath.cli.main import run\n"
        f"sys.argv = ['glpath', *{command.split()}, '--help']\n"
        f"try:\n    run()\nexcept SystemExit:\n    print('loaded:', [m for m in {heavy} if m in sys.modules])"
    )
    assert "Usage: glpath" in done.stdout, done.stderr
    assert "\nloaded: []" in done.stdout


def test_a_path_tracer_loads_neither_numba_nor_scipys_statistics() -> None:
    """They take longer to import than a small picture takes to render."""
    done = python(
        "import glpath, sys\n"
        "glpath.render('cornell-box-36', integrator='path', guide='cosine', spp=1, resolution=(8, 8))\n"
        "print([m for m in ('numba', 'scipy.stats', 'scipy') if m in sys.modules])"
    )
    assert done.stdout.strip() == "[]", done.stderr


def test_render_stays_a_function_whoever_imports_its_module_first() -> None:
    done = python("import glpath.rendering\nimport glpath\nprint(callable(glpath.render), callable(glpath.Film))")
    assert done.stdout == "True True\n", done.stderr


# The command as a whole.


def test_the_version_is_printed() -> None:
    result = run("--version")
    assert (result.exit_code, result.stdout) == (0, f"glpath {glpath.__version__}\n")


def test_help_names_the_exit_codes_and_every_command() -> None:
    result = run("--help")
    assert result.exit_code == 0
    assert "130 interrupted" in " ".join(result.stdout.split())
    for command in (
        "render",
        "merge",
        "diff",
        "info",
        "validate",
        "schema",
        "scenes",
        "export",
        "devices",
        "doctor",
    ):
        assert command in result.stdout


@pytest.mark.parametrize("command", ["measure", "lightmap"])
def test_help_of_what_measures_has_its_own_options_and_defaults(command: str) -> None:
    """Not those of a picture: there is no eye, and no ray tracer whose depth has another default."""

    def helped(command: str) -> str:
        said = CliRunner().invoke(app, [command, "--help-all"], env={"COLUMNS": "200"}).output
        return " ".join(said.replace("│", " ").split())

    said = helped(command)
    assert f"default {PathSettings.max_depth}. " in said
    assert "--geometry-budget" in said
    for other in ("--shadows", "--aov", "--count-tests", "t-buffer", "--clean"):
        assert other not in said, other
    rendered = helped("render")
    assert (
        f'default {PathSettings.max_depth} of "path" and "path-buffer", {TBufferSettings.max_depth} of' in rendered
    )
    assert "--clean" in rendered


def test_help_says_what_is_written_in_brackets() -> None:
    """rich would take [figures] for a style and leave it out."""
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    bracketed = 0
    for name, command in commands.items():
        said = "".join(run(name, "--help-all").stdout.replace("│", "").split())
        written = re.findall(r"\S*\[[^\]]*\]\S*", command.callback.__doc__)
        assert [word for word in written if word not in said] == [], name
        extras = [
            extra for part in command.params for extra in re.findall(r"glpath\\?(\[[a-z]+\])", part.help or "")
        ]
        bracketed += len(extras)
        assert [extra for extra in extras if f"glpath{extra}" not in said] == [], name
    assert bracketed >= 2


def test_help_of_an_option_is_no_markup_either() -> None:
    def own(value: Annotated[str, typer.Option(help="of [red] and [/]")] = "[a]") -> None:
        """Of [bold]all[/bold] things.

        And [more], too.
        """

    made = typer.Typer(cls=Commands, epilog="[end]")
    made.command("own")(own)
    made.command("other", help="the [other]")(lambda: None)
    group = " ".join(CliRunner().invoke(made, ["--help"]).stdout.split())
    said = " ".join(CliRunner().invoke(made, ["own", "--help"]).stdout.split())
    for text in ("of [red] and [/]", "[default: [a]]", "Of [bold]all[/bold] things.", "And [more], too."):
        assert text in said
    for text in ("Of [bold]all[/bold] things.", "the [other]", "[end]"):
        assert text in group


def test_names_of_a_scene_are_no_markup(tmp_path: Path) -> None:
    path = tmp_path / "a[red]:bell:.toml"
    path.write_text(
        'camera = { type = "perspective", position = [0, 0, 4], target = [0, 0, 0], fov = 40 }\n'
        'materials = { "[bold]:bell:" = {} }\n'
        '[[shapes]]\nname = "[/]:star:"\ntype = "sphere"\ncenter = [0, 0, 0]\nradius = 1\n'
        'material = "[bold]:bell:"\n'
    )
    told = run("info", path)
    assert told.exit_code == 0, told.output
    for text in ("[bold]:bell:", "[/]:star:", "a[red]:bell:: 1 sphere"):
        assert text in told.stdout
    assert "a[red]:bell:.toml" in run("validate", path).stdout


def test_info_lists_the_first_forty_materials_and_lights(tmp_path: Path) -> None:
    path = tmp_path / "many.toml"
    materials = "".join(f"[materials.m{i}]\n" for i in range(45))
    shapes = "".join(
        f'[[shapes]]\ntype = "sphere"\ncenter = [{i}, 0, 0]\nradius = 0.1\nmaterial = "m{i}"\n' for i in range(45)
    )
    lights = '[[lights]]\ntype = "point"\nposition = [0, 9, 0]\nintensity = 1\n' * 60
    path.write_text(f"camera = {{ position = [0, 0, 9], target = [0, 0, 0] }}\n{materials}{shapes}{lights}")
    told = run("info", path)
    assert told.exit_code == 0, told.output
    text = " ".join(told.stdout.split())
    assert text.count("5 more (--json lists all)") == 2
    assert text.count("20 more (--json lists all)") == 1
    assert len(json.loads(run("info", path, "--json").stdout)["lights"]) == 60


def test_python_dash_m_glpath_is_glpath() -> None:
    command = [sys.executable, "-m", "glpath", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith("glpath ")


@pytest.mark.parametrize(
    "arguments", [["rendr"], ["render"], ["render", "furnace"], ["diff", "a.png"], ["--nonsense"]]
)
def test_wrong_usage_ends_with_2(arguments: list[str]) -> None:
    assert run(*arguments).exit_code == 2


def test_an_error_is_one_block_without_a_traceback(renderer: Renderer, monkeypatch, tmp_path) -> None:
    def fail(*_: object, **__: object) -> Film:
        raise ContextError("no device renders OpenGL 4.3.", "apt install libegl1\nglpath doctor says more")

    monkeypatch.setattr(calls, "run_job", fail)
    result = run("render", "furnace", "-o", tmp_path / "a.png", "-q")
    assert result.exit_code == 1
    assert result.stderr == (
        "glpath: error: no device renders OpenGL 4.3.\n  apt install libegl1\n  glpath doctor says more\n"
    )


def test_scene_warnings_are_lines(renderer: Renderer, monkeypatch, tmp_path) -> None:
    def warn(*_: object, **__: object) -> Film:
        warnings.warn("furnace: has no light", SceneWarning, stacklevel=2)
        return renderer.film

    monkeypatch.setattr(calls, "run_job", warn)
    result = run("render", "furnace", "-o", tmp_path / "a.png", "-q")
    assert (result.exit_code, result.stderr) == (0, "glpath: warning: furnace: has no light\n")


def test_a_closed_pipe_is_no_traceback() -> None:
    command = f"{sys.executable} -m glpath schema | true"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""


# glpath render


def test_render_writes_every_output_and_says_how_it_went(renderer: Renderer, tmp_path: Path) -> None:
    outputs = [tmp_path / "new" / name for name in ("a.png", "a.exr", "a.npz")]
    result = run("render", "furnace", *(x for path in outputs for x in ("-o", path)), "--spp", 32)
    assert result.exit_code == 0, result.stderr
    assert iio.imread(outputs[0]).shape == (4, 6, 3)
    np.testing.assert_allclose(read_image(outputs[1]), renderer.film.mean, rtol=1e-6)
    assert np.array_equal(Film.load(outputs[2]).radiance_sums, renderer.film.radiance_sums)
    assert result.stdout == ""
    assert "32 path sets of 6 x 4 in 1.5 s, error about" in result.stderr
    assert "on llvmpipe: 512 paths/s" in result.stderr
    assert "2 % of the rays lost" in result.stderr
    assert "NaN" not in result.stderr
    assert all(f"wrote {path}" in result.stderr for path in outputs)
    assert "ms per path set" not in result.stderr


def test_render_hands_on_what_was_asked_for(renderer: Renderer, tmp_path: Path) -> None:
    words = (
        "--spp 32 --max-depth 3 --seed 9 --resolution 64x32 --crop 1,2,30,20 --camera-position -1,0,.5 "
        "--camera-fov 50 "
        "--integrator path-buffer --directions sphere --light-resolution 128 "
        "--sampling random --ambient 0.5 --roulette 3 "
        "--backend egl --device 1 --require-gpu"
    )
    run("render", "furnace", "-o", tmp_path / "a.png", "-D", "radiance=2", "-D", "shape=sphere", *words.split())
    ((job, scene, options),) = renderer.calls
    assert scene.shapes[0].emission.tolist() == [2, 2, 2]
    assert (scene.camera.resolution, scene.camera.position.tolist(), scene.camera.fov) == (
        (64, 32),
        [-1, 0, 0.5],
        50,
    )
    assert (job.path_sets, job.window) == ((0, 32), (1, 2, 30, 20))
    assert job.integrator == PathBufferSettings(
        max_depth=3,
        seed=9,
        sampling="random",
        directions="sphere",
        light_resolution=128,
        ambient=(0.5, 0.5, 0.5),
        roulette=3,
        aovs=DENOISER_AOVS,
    )
    assert callable(options.on_progress)
    expected = RunOptions(backend="egl", device=1, require_gpu=True, progress="auto")
    assert replace(options, on_progress=None) == expected


def test_render_hands_on_what_a_gather_was_asked_for(renderer: Renderer, tmp_path: Path) -> None:
    options = "--integrator gather --radiosity solution.npz --radiosity-lookup constant"
    run("render", "furnace", "-o", tmp_path / "a.png", *options.split())
    ((job, _, _),) = renderer.calls
    assert job.integrator == GatherSettings(
        radiosity=Path("solution.npz"), radiosity_lookup="constant", aovs=DENOISER_AOVS
    )


def test_render_hands_on_what_a_ray_tracer_was_asked_for(renderer: Renderer, tmp_path: Path) -> None:
    options = (
        "--integrator t-buffer --shadows sphere --shadow-resolution 400 --shadow-test identity --shadow-filter 1 "
        "--secondary classic --count-tests"
    )
    run("render", "furnace", "-o", tmp_path / "a.png", *options.split())
    ((job, _, _),) = renderer.calls
    assert job.integrator == TBufferSettings(
        shadows="sphere",
        shadow_resolution=400,
        shadow_test="identity",
        shadow_filter=1,
        secondary="classic",
        count_tests=True,
    )


def test_render_leaves_the_usual_to_the_engine_when_nothing_is_said(renderer: Renderer, tmp_path: Path) -> None:
    run("render", "furnace", "-o", tmp_path / "a.npz")
    ((job, _, options),) = renderer.calls
    expected = RenderJob.of("furnace", aovs=DENOISER_AOVS)
    assert replace(job, scene=expected.scene) == expected  # but for where it is from
    assert replace(options, on_progress=None) == RunOptions(progress="auto")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--spp 0", "--spp 0: must be at least 1"),
        ("--max-depth 0", "--max-depth 0: must be at least 1"),
        ("--seed -1", "--seed -1: must be at least 0"),
        ("--roulette 0", "--roulette 0: must be at least 1"),
        ("--device -1", "--device -1: must be at least 0"),
        ("--resolution 640", "--resolution 640: expected WxH"),
        ("--resolution 640x", "--resolution 640x: expected WxH"),
        ("--resolution 0x480", "must be at least 1 pixel"),
        ("--crop 1,2,3", "--crop 1,2,3: expected X,Y,W,H"),
        ("--crop 0,0,0,5", "must be at least 1 pixel"),
        ("--crop 60,0,10,10", "reaches out of the picture of 64 x 64"),
        ("--crop -1,0,10,10", "reaches out of the picture"),
        ("--resolution 32x16 --crop 0,0,32,17", "reaches out of the picture of 32 x 16"),
        ("--camera-position 1,2", "--camera-position 1,2: expected X,Y,Z"),
        ("--camera-up 0,nan,0", "--camera-up 0,nan,0: expected X,Y,Z in finite numbers"),
        ("--ambient red", "--ambient red: expected R,G,B"),
        ("--ambient 1,-1,0", "radiance cannot be negative"),
        ("--exposure inf", "from -100 to 100"),
        ("--exposure 2000", "from -100 to 100"),
        ("--tonemap filmic", "Allowed: srgb, reinhard, aces"),
        ("--integrator bdpt", "Allowed: auto, path"),
        ("--sampling halton", "Allowed: sobol, random"),
        ("--directions cone", "Allowed: pair, lattice, hemisphere, sphere"),
        ("--progress loud", "Allowed: auto, bar, lines, json, none"),
        ("-q -v", "contradict each other"),
        ("-D radiance", "not of the form key=value"),
        ("-o b.gif", "an output cannot have the suffix .gif. Allowed: .png, .jpg, .jpeg, .exr, .npz"),
        ("-o b", "an output cannot have no suffix"),
    ],
)
def test_an_option_out_of_range_is_named_before_rendering(
    renderer: Renderer, tmp_path: Path, options: str, message: str
) -> None:
    result = run("render", "furnace", "-o", tmp_path / "a.png", *options.split())
    assert message in result.stderr
    assert result.stderr.startswith("glpath: error: ")
    assert result.exit_code == 2
    assert not renderer.calls
    assert not list(tmp_path.iterdir())


def test_an_output_that_cannot_be_written_is_named_before_rendering(renderer: Renderer, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run("render", "furnace", "-o", tmp_path / "a.png", "-o", tmp_path / "file" / "b.png")
    assert result.exit_code == 1
    assert "is a file, but a folder of this name is needed" in result.stderr
    assert not renderer.calls


def test_a_scene_that_is_not_there_is_named(renderer: Renderer, tmp_path: Path) -> None:
    result = run("render", "cornel-box", "-o", tmp_path / "a.png")
    assert result.exit_code == 1
    assert "cornel-box" in result.stderr
    assert "Traceback" not in result.stderr


def test_quiet_is_silent(renderer: Renderer, tmp_path: Path) -> None:
    result = run("render", "furnace", "-o", tmp_path / "a.png", "-q")
    assert (result.exit_code, result.output) == (0, "")


@pytest.mark.parametrize("quiet", [True, False])
def test_quiet_hides_compilations(
    renderer: Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quiet: bool
) -> None:
    def compile_and_read(*arguments: Any) -> glpath.Scene:
        compilations.warning("compiling kernels")
        return read_scene(*arguments)

    monkeypatch.setattr("glpath.cli.scene.read_scene", compile_and_read)
    result = run("render", "furnace", "-o", tmp_path / "a.png", *("-q" for _ in range(quiet)))
    assert ("compiling kernels" in result.output) is not quiet


def test_verbose_tells_settings_and_stages(renderer: Renderer, tmp_path: Path) -> None:
    result = run("render", "furnace", "-o", tmp_path / "a.png", "-v")
    assert "sampling: sobol" in result.stderr
    assert "scene hash: 0123abcd" in result.stderr
    assert "eye: 0.0625 ms per path set" in result.stderr


def test_exposure_and_tonemap_reach_the_png(renderer: Renderer, tmp_path: Path) -> None:
    run("render", "furnace", "-o", tmp_path / "a.png")
    run("render", "furnace", "-o", tmp_path / "b.png", "--exposure", -2)
    run("render", "furnace", "-o", tmp_path / "c.png", "--tonemap", "aces")
    pictures = [iio.imread(tmp_path / f"{name}.png") for name in "abc"]
    assert pictures[1].mean() < pictures[0].mean()
    assert not np.array_equal(pictures[0], pictures[2])


# Ctrl-C


def test_an_interrupted_render_is_written_and_ends_with_130(
    renderer: Renderer, make_film: MakeFilm, tmp_path: Path
) -> None:
    renderer.film, renderer.interrupt = make_film([(0, 11)]), True
    result = run("render", "furnace", "-o", tmp_path / "a.npz", "--spp", 32, "-q")
    assert result.exit_code == 130
    assert result.stderr == f"glpath: interrupted: 11 of 32 path sets are in {tmp_path / 'a.npz'}\n"
    assert Film.load(tmp_path / "a.npz").path_sets == 11


def test_interrupted_before_the_first_path_set_nothing_is_written(
    renderer: Renderer, make_film: MakeFilm, tmp_path: Path
) -> None:
    renderer.film, renderer.interrupt = make_film([]), True
    result = run("render", "furnace", "-o", tmp_path / "a.png", "--spp", 32)
    assert result.exit_code == 130
    assert "nothing is written" in result.stderr
    assert not list(tmp_path.iterdir())


def test_ctrl_c_outside_rendering_ends_with_130(renderer: Renderer, monkeypatch, tmp_path: Path) -> None:
    def stop(*_: object, **__: object) -> Film:
        raise KeyboardInterrupt

    monkeypatch.setattr(calls, "run_job", stop)
    result = run("render", "furnace", "-o", tmp_path / "a.png", "-q")
    assert (result.exit_code, result.stderr) == (130, "glpath: interrupted\n")


SLOW_RENDER = """
import sys, time
import numpy as np
from glpath import rendering
from glpath.cli.main import run
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata
from glpath.rendering import calls

def run_job(job, scene, options):
    film = Film.empty(FilmMetadata("slow", "0", "path", 0, 5, {}, (6, 4), (0, 0, 6, 4)))
    film.add(0, 5, np.ones((4, 6, 3)))
    try:
        print("ready", flush=True)
        time.sleep(50)
    except KeyboardInterrupt:
        stop = rendering.RenderInterrupted.__new__(rendering.RenderInterrupted)
        stop.film = film
        raise stop

calls.run_job = run_job
run()
"""


# A shell starts background jobs with SIGINT ignored; others must work there too.
@pytest.mark.parametrize(
    ("number", "background"),
    [(signal.SIGINT, False), *((number, False) for number in TERMINATING), (signal.SIGTERM, True)],
)
def test_signals_end_a_render_with_its_picture_written(
    tmp_path: Path, number: signal.Signals, background: bool
) -> None:
    out = tmp_path / "a.npz"
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_RENDER, "render", "furnace", "-o", out, "--progress", "none"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=(lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)) if background else default_signals,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    _, stderr = process.communicate(timeout=30)
    assert process.returncode == 130, stderr
    assert f"interrupted: 5 of 256 path sets are in {out}" in stderr
    assert Film.load(out).path_sets == 5
    assert os.listdir(tmp_path) == ["a.npz"]


def test_ctrl_c_ends_a_real_render_after_a_whole_path_set(tmp_path: Path) -> None:
    out = tmp_path / "a.npz"
    command = [sys.executable, "-m", "glpath", "render", "furnace", "-D", "resolution=32", "-o", str(out)]
    command += ["--spp", "1000000", "--progress", "json"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if '"rendering"' in line:
                break
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
    assert process.returncode == 130, rest
    film = Film.load(out)
    assert film.path_sets > 0
    assert film.ranges == ((0, film.path_sets),)
    assert f"interrupted: {film.path_sets} of 1000000 path sets" in rest


# Progress


def test_lines_are_plain_and_few(renderer: Renderer, tmp_path: Path) -> None:
    result = run("render", "furnace", "-o", tmp_path / "a.png")
    assert result.stderr.splitlines()[:5] == [
        "rendering on llvmpipe (test)",
        "compiling shaders",
        "8/32 path sets (25 %) after 8.0 s, error 5 %",
        "16/32 path sets (50 %) after 16 s, 1 sets/s, 16 s left, error 5 %",
        "32/32 path sets (100 %) after 32 s, 1 sets/s, error 5 %",
    ]
    assert "\x1b" not in result.stderr


def test_a_long_render_does_not_fill_the_log(make_film: MakeFilm, capsys: pytest.CaptureFixture[str]) -> None:
    film = make_film([])
    with reporting("lines", sys.stderr) as report:
        for second in range(36_001):
            report(rendering.Progress(second, 36_000, float(second), None, film, "rendering", "llvmpipe"))
    assert 100 < len(capsys.readouterr().err.splitlines()) < 400


def test_json_is_one_object_per_line(renderer: Renderer, tmp_path: Path) -> None:
    result = run("render", "furnace", "-o", tmp_path / "a.png", "--progress", "json")
    events = [json.loads(line) for line in result.stderr.splitlines()]
    assert [e["event"] for e in events] == ["progress"] * 4 + ["done"]
    assert events[2] == {
        "event": "progress",
        "stage": "rendering",
        "done": 16,
        "total": 32,
        "elapsed_s": 16.0,
        "left_s": 16.0,
        "error": 0.05,
        "renderer": "llvmpipe (test)",
    }
    assert events[-1]["files"] == [str(tmp_path / "a.png")]
    assert events[-1]["statistics"]["paths_cast"] == 1000


def test_the_bar_shows_renderer_rate_and_error(renderer: Renderer, tmp_path: Path) -> None:
    result = CliRunner(env={"COLUMNS": "150", "FORCE_COLOR": "1", "TERM": "xterm"}).invoke(
        app, ["render", "furnace", "-o", str(tmp_path / "a.png"), "--progress", "bar"]
    )
    assert result.exit_code == 0
    for text in ("rendering on llvmpipe (test)", "32/32 path sets", "1 sets/s", "error 5 %"):
        assert text in result.stderr


def test_times_and_shares_are_written_for_people() -> None:
    assert [duration(s) for s in (0.04, 9.94, 9.96, 59.6, 185, 7800)] == [
        "0.0 s",
        "9.9 s",
        "10 s",
        "1 min 00 s",
        "3 min 05 s",
        "2 h 10 min",
    ]
    assert [percent(x) for x in (0.0, 0.00123, 0.056, 0.5, 1.0, 23.4)] == [
        "0 %",
        "0.12 %",
        "5.6 %",
        "50 %",
        "100 %",
        "2340 %",
    ]


# glpath diff


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    reference = np.random.default_rng(0).uniform(0.1, 1.0, (8, 9, 3))
    write_exr(tmp_path / "a.exr", reference * 1.1)
    write_exr(tmp_path / "b.exr", reference)
    return tmp_path / "a.exr", tmp_path / "b.exr"


def test_diff_prints_the_measures(pair: tuple[Path, Path]) -> None:
    result = run("diff", *pair)
    assert result.exit_code == 0
    table = dict(line.split("  ", 1) for line in result.stdout.splitlines())
    assert list(map(str.strip, table)) == ["relMSE", "RMSE", "max", "PSNR", "mean ratio"]
    assert float(table["mean ratio"]) == pytest.approx(1.1, rel=1e-5)


def test_diff_in_json_has_the_same_numbers(pair: tuple[Path, Path]) -> None:
    measured = json.loads(run("diff", *pair, "--json").stdout)
    assert measured["mean ratio"] == pytest.approx(1.1)
    assert 0 < measured["relMSE"] < 0.01
    equal = json.loads(run("diff", pair[0], pair[0], "--json").stdout)
    assert (equal["relMSE"], equal["PSNR"]) == (0, None)


def test_diff_fails_above_the_limit_only(pair: tuple[Path, Path]) -> None:
    assert run("diff", *pair, "--fail", 0.02).exit_code == 0
    result = run("diff", *pair, "--fail", 1e-4)
    assert result.exit_code == 1
    assert "is above --fail 0.0001" in result.stderr
    assert run("diff", *pair, "--fail", "nan").exit_code == 2
    assert run("diff", *pair, "--fail", "inf").exit_code == 2


def test_diff_refuses_the_scale_of_a_picture_that_it_does_not_write(pair: tuple[Path, Path]) -> None:
    result = run("diff", *pair, "--scale", 0.5)
    assert result.exit_code == 2
    assert "--scale 0.5: belongs to -o FILE.png" in result.stderr


def test_diff_of_values_whose_squares_are_no_numbers_fails(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((2, 2, 3), 1e200))
    np.save(tmp_path / "b.npy", np.full((2, 2, 3), 2e200))
    result = run("diff", tmp_path / "a.npy", tmp_path / "b.npy", "--fail", 0.01)
    assert (result.exit_code, "4 pixels of the picture are NaN" in result.stderr) == (1, True)


def test_diff_writes_the_difference(pair: tuple[Path, Path], tmp_path: Path) -> None:
    result = run("diff", *pair, "-o", tmp_path / "diff.png")
    assert result.exit_code == 0
    picture = iio.imread(tmp_path / "diff.png")
    assert picture.shape == (8, 9, 3)
    assert (picture[..., 0] > picture[..., 2]).all()  # all of it is too bright
    assert run("diff", *pair, "-o", tmp_path / "diff.exr").exit_code == 2


def test_diff_of_two_sizes_or_a_missing_file_fails_with_a_reason(pair: tuple[Path, Path], tmp_path: Path) -> None:
    write_exr(tmp_path / "c.exr", np.ones((2, 2, 3)))
    assert "the picture is 9 x 8 and the reference 2 x 2" in run("diff", pair[0], tmp_path / "c.exr").stderr
    result = run("diff", pair[0], tmp_path / "none.exr")
    assert (result.exit_code, "there is no such file" in result.stderr) == (1, True)


def test_diff_by_pixels(pair: tuple[Path, Path]) -> None:
    result = run("diff", *pair, "--fail", 0.05, "--failpercent", 100)
    assert result.exit_code == 0
    assert "of the pixels differ by more than 0.05" in result.stdout
    result = run("diff", *pair, "--fail", 0.05, "--failpercent", 5)
    assert result.exit_code == 1
    assert "% of the pixels differ by more than --fail 0.05, 5 % allowed" in result.stderr
    assert run("diff", *pair, "--failpercent", 5).exit_code == 2
    assert run("diff", *pair, "--fail", 1, "--failpercent", 101).exit_code == 2


def test_diff_judges_as_an_image_test_does(pair: tuple[Path, Path]) -> None:
    result = run("diff", *pair, "--mode", "fuzzy")
    assert result.exit_code == 1
    assert "fuzzy       not the same: 72 of 72 pixels (100 %) are off by more than 2 of 255 levels" in result.stdout
    assert "not the same by --mode fuzzy" in result.stderr
    assert run("diff", *pair, "--mode", "fuzzy", "--limit", "threshold=20").exit_code == 0
    assert run("diff", pair[0], pair[0], "--mode", "exact").exit_code == 0
    judged = json.loads(run("diff", *pair, "--mode", "fuzzy", "--json").stdout)
    assert (judged["mode"], judged["same"], judged["limits"]["edge"]) == ("fuzzy", False, 0.25)
    for wrong in (["--mode", "fuzy"], ["--limit", "threshold=2"], ["--stat", "--mode", "flip"], ["--stat"]):
        assert run("diff", *pair, *wrong).exit_code == 2


def test_diff_tells_noise_from_a_change(make_film: MakeFilm, tmp_path: Path) -> None:
    film, other = make_film([(0, 64)], (32, 32)), make_film([(64, 128)], (32, 32), seed=4)
    film.save(tmp_path / "a.npz")
    other.save(tmp_path / "b.npz")
    result = run("diff", tmp_path / "a.npz", tmp_path / "b.npz", "--stat")
    assert result.exit_code == 0, result.output
    assert "the same: the difference is within noise (compared as independent renders" in result.stdout
    other.radiance_sums *= 1.1
    Picture.of_film(other).save(tmp_path / "c.exr")
    result = run("diff", tmp_path / "a.npz", tmp_path / "c.exr", "--stat")
    assert result.exit_code == 1
    assert "the whole picture is darker by 9" in result.stdout
