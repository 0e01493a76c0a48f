"""Images of what moves: each is the still of its time, whichever of them are rendered, and by whom."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from typer.testing import CliRunner, Result

import glpath
from glpath.cli.frames import write_movie
from glpath.cli.main import app
from glpath.errors import SceneWarning
from glpath.film.image import write_png

MOVING = """
[camera]
position = [0, 1.3, 4]
target = [0, 0.65, 0]
fov = 40
[[shapes]]
type = "quad"
corners = [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]]
[[shapes]]
type = "box"
min = [-0.3, 0, -0.3]
max = [0.3, 0.8, 0.3]
motion = [{ time = 0 }, { time = 1, transform = [{ translate = [1, 0, 0] }] }]
[sky]
zenith = 1
"""
SMALL = ("--spp", 2, "--resolution", "21x16", "--max-depth", 2)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "moving.toml"
    path.write_text(MOVING)
    return path


def render(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["render", *map(str, (*arguments, *SMALL))])


def film(path: Path) -> np.ndarray:
    return glpath.Film.load(path).radiance_sums


@pytest.mark.parametrize("integrator", ["path", "t-buffer"])
def test_a_frame_is_the_still_of_its_time(scene, tmp_path, integrator):
    options = ("--integrator", integrator)
    done = render(scene, "--frames", "1:4", "--fps", 4, "-o", tmp_path / "f_{:03}.npz", *options)
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in tmp_path.glob("f_*")) == ["f_001.npz", "f_002.npz", "f_003.npz"]
    stills = []
    for i in (1, 2, 3):
        still = tmp_path / "still.npz"
        assert render(scene, "-D", f"time={i / 4}", "-o", still, *options).exit_code == 0
        stills.append(film(still))
        assert np.array_equal(film(tmp_path / f"f_{i:03}.npz"), stills[-1])
    assert not np.array_equal(stills[0], stills[1])


def test_a_shutter_that_stays_open_opens_with_each_frame(scene, tmp_path):
    scene.write_text(MOVING.replace("fov = 40", "fov = 40\nshutter = [0, 0.2]"))
    assert render(scene, "--frames", "2:3", "--fps", 4, "-o", tmp_path / "f.npz").exit_code == 0
    wanted = glpath.render(scene, spp=2, resolution=(21, 16), max_depth=2, camera={"shutter": (0.5, 0.7)})
    assert np.array_equal(film(tmp_path / "f-0002.npz"), wanted.radiance_sums)


def test_only_what_is_missing_is_rendered_again_and_as_bright(scene, tmp_path):
    out = tmp_path / "f_{:02}.png"
    first = render(scene, "--frames", "0:3", "-o", out)
    assert first.exit_code == 0, first.output
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.png")}
    picture, _ = opened(tmp_path / "f_01.png")
    (tmp_path / "f_01.png").unlink()
    again = render(scene, "--frames", "0:3", "-o", out, "--resume")
    assert again.exit_code == 0, again.output
    assert "frame 1 of 1" in again.output
    after = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.png")}
    assert [path.name for path in before if before[path] != after[path]] == ["f_01.png"]
    assert np.array_equal(opened(tmp_path / "f_01.png")[0], picture)
    assert len({opened(path)[1] for path in after}) == 1


@pytest.mark.parametrize(("resume", "stops"), [((), "9"), (("--resume",), "nan")])
def test_old_pictures_do_not_expose_new_ones(scene, tmp_path, resume, stops):
    """Witness: the same frame in an empty folder."""
    assert render(scene, "--frames", "1:2", "-o", tmp_path / "new_{:02}.png").exit_code == 0
    old = PngInfo()
    old.add_text("glpath.exposure_stops", stops)
    first = 0 if resume else 1
    Image.new("RGB", (21, 16)).save(tmp_path / f"f_{first:02}.png", pnginfo=old)
    assert render(scene, "--frames", f"{first}:2", "-o", tmp_path / "f_{:02}.png", *resume).exit_code == 0
    assert opened(tmp_path / "f_01.png")[1] == opened(tmp_path / "new_01.png")[1]


def opened(path: Path) -> tuple[np.ndarray, str]:
    """The picture, and the stops that it was exposed with."""
    with Image.open(path) as picture:
        return np.asarray(picture), picture.info["glpath.exposure_stops"]


# imageio-ffmpeg leaves the end of its pipe to the collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_movie_has_the_frames(scene, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    from imageio import v2 as imageio

    out = ("-o", tmp_path / "f.png", "-o", tmp_path / "f.mp4")
    done = render(scene, "--frames", "0:5", "--fps", 10, *out)
    assert done.exit_code == 0, done.output
    with imageio.get_reader(tmp_path / "f.mp4") as movie:
        seen = [np.asarray(frame) for frame in movie]
        assert movie.get_meta_data()["fps"] == 10
    assert len(seen) == 5
    assert seen[0].shape == (16, 22, 3)  # codecs take even sizes
    for i, frame in enumerate(seen):
        picture, _ = opened(tmp_path / f"f-{i:04}.png")
        assert np.abs(frame[:, :21].astype(float) - picture).mean() < 12
    assert not list(tmp_path.glob(".*"))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_movie_has_the_colours_of_rec_709(tmp_path):
    """Rec. ITU-R BT.709-6, 3.4 and 4.6: luma is 0.2126 R + 0.7152 G + 0.0722 B, from 16 to 235."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    colours = np.repeat(np.array([[[200, 40, 20], [30, 180, 40]]], np.uint8), 8, axis=1)
    write_png(tmp_path / "f.png", np.repeat(colours, 16, axis=0))
    write_movie(tmp_path / "f.mp4", [tmp_path / "f.png"], 10)
    command = [ffmpeg, "-i", tmp_path / "f.mp4", "-f", "rawvideo", "-pix_fmt", "yuv420p", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    y, u, v = done.stdout[:256], done.stdout[256:320], done.stdout[320:384]
    luma = np.array([0.2126, 0.7152, 0.0722])
    for column, (r, g, b) in ((3, (200, 40, 20)), (12, (30, 180, 40))):
        whole = luma @ (r, g, b) / 255
        assert y[8 * 16 + column] == pytest.approx(16 + 219 * whole, abs=2)
        assert u[4 * 8 + column // 2] == pytest.approx(128 + 224 * (b / 255 - whole) / 1.8556, abs=2)
        assert v[4 * 8 + column // 2] == pytest.approx(128 + 224 * (r / 255 - whole) / 1.5748, abs=2)
    assert b"(tv, bt709/bt709/iec61966-2-1" in done.stderr


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_transparent_frames_of_a_movie_are_over_white(tmp_path):
    imageio = pytest.importorskip("imageio.v2")
    pytest.importorskip("imageio_ffmpeg")
    picture = np.full((16, 16, 4), (255, 0, 0, 0), np.uint8)
    picture[:, 8:, 3] = 128
    write_png(tmp_path / "f.png", picture)
    with pytest.warns(SceneWarning, match="a movie has no alpha channel, so that its background is white"):
        write_movie(tmp_path / "f.mp4", [tmp_path / "f.png"], 10)
    with imageio.get_reader(tmp_path / "f.mp4") as movie:
        found = np.asarray(movie.get_data(0)).astype(float)
    for column, expected in ((3, (255, 255, 255)), (12, (255, 127, 127))):
        assert found[8, column] == pytest.approx(expected, abs=4)


def test_workers_render_the_same_frames(scene, tmp_path):
    pytest.importorskip("distributed")
    for name, more in (("a", ()), ("b", ("--cluster", "local:2"))):
        done = render(scene, "--frames", "0:2", "--fps", 2, "-o", tmp_path / f"{name}.npz", *more)
        assert done.exit_code == 0, done.output
    for i in (0, 1):
        assert np.array_equal(film(tmp_path / f"a-{i:04}.npz"), film(tmp_path / f"b-{i:04}.npz"))


def test_a_turntable_goes_on_too(tmp_path):
    out = tmp_path / "t.npz"
    assert render("cornell-box-36", "--turntable", 3, "-o", out).exit_code == 0
    wanted = film(tmp_path / "t-1.npz")
    (tmp_path / "t-1.npz").unlink()
    assert render("cornell-box-36", "--turntable", 3, "-o", out, "--resume").exit_code == 0
    assert np.array_equal(film(tmp_path / "t-1.npz"), wanted)


# A frame is a still of what moves, and that is meant.
@pytest.mark.filterwarnings("ignore:There is motion:glpath.SceneWarning")
def test_frames_of_another_scene_or_kind_of_camera_are_rendered_alike(scene):
    here, there = (glpath.load_scene(scene, {"time": time}) for time in (0, 0.5))
    frames = [here, there, there.with_camera(projection="orthographic", height=2.0)]
    options = {"integrator": "path", "spp": 1, "resolution": (12, 8)}
    films = list(glpath.render_frames(here, [f.with_camera(resolution=(12, 8)) for f in frames], **options))
    for found, frame in zip(films, frames, strict=True):
        assert np.array_equal(found.radiance_sums, glpath.render(frame, **options).radiance_sums)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--frames", "3"), "--frames 3: expected A:B"),
        (("--frames", "3:3"), "of which B is greater"),
        (("--frames", "0:100001"), "100,001 frames, but one call renders at most 100,000"),
        (("--frames", "7:100000000"), "Render a part at a time: --frames 7:100007"),
        (("--frames", "0:1000000000"), "the number of a frame must be at most 999,999,999"),
        (("--turntable", 1_000_000_000), "--turntable 1000000000: must be at most 100,000"),
        (("--frames", "0:2", "--turntable", 2), "--frames beside --turntable"),
        (("--frames", "0:2", "--fps", 0), "--fps 0: must be above 0"),
        (("--fps", 24), "--fps 24: belongs to --frames and --turntable"),
        (("--frames", "0:2", "-o", "a_{.png"), "does not hold the number of a frame"),
        (("--frames", "0:2", "-o", "a_{:.0}.png"), "does not hold the number of a frame"),
        (("--frames", "0:2", "-o", "a.mp4"), "a movie is made of .png frames"),
        (("--frames", "0:2", "-o", "-"), "-o - beside --frames"),
        (("--frames", "0:2", "--crop", "0,0,4,4"), "--crop beside --frames"),
        (("--frames", "0:2", "-D", "time=soon"), "-D time=soon beside --frames: expected seconds"),
    ],
)
def test_what_cannot_be_is_said(scene, tmp_path, arguments, said):
    given = arguments if "-o" in arguments else (*arguments, "-o", tmp_path / "a.npz")
    done = render(scene, *given)
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.output.split())


def test_a_scene_that_knows_no_time_says_so(tmp_path):
    done = render("teapot", "--frames", "0:2", "-o", tmp_path / "a.npz")
    assert done.exit_code != 0
    assert "has no parameter `time`" in " ".join(done.output.split())


def test_each_frame_ends_by_its_own_noise() -> None:
    cameras = [{"fov": 40.0}, {"fov": 60.0}]
    small = {"resolution": (16, 12), "max_depth": 2}
    films = list(glpath.render_frames("cornell-box-36", cameras, integrator="path", noise=0.2, **small))
    assert [made.metadata.stop_rule for made in films] == ["noise", "noise"]
    for camera, made in zip(cameras, films, strict=True):
        still = glpath.render("cornell-box-36", camera=camera, noise=0.2, **small)
        assert np.array_equal(still.radiance_sums, made.radiance_sums)
    with pytest.raises(glpath.UsageError, match="each frame has its own"):
        next(glpath.render_frames("cornell-box-36", cameras, film=films[0]))
