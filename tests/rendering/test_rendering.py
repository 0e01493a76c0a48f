"""A render as a whole: tiles, crops, overrides, interruption, memory."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.gl import passes
from glpath.rendering import tiles
from glpath.scene import Background
from tests.support.engines import engine_options

BOX = "cornell-box-36"


@pytest.mark.parametrize("window", [(0, 0, 7, 5), (3, 2, 4000, 900), (0, 0, 1, 3000), (0, 0, 3000, 1)])
def test_tiles_of_one_size_cover_the_window_once(window: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "MAX_PATHS", 1 << 16)
    x, y, width, height = window
    covered = np.zeros((height, width), int)
    found = tiles.cover(window, limit=512)
    for tile in found:
        tx, ty, w, h = tile.window
        assert (w, h) == found[0].window[2:]
        assert w * h <= 1 << 16
        assert max(w, h) <= 512
        assert x <= tx <= tx + w <= x + width
        assert y <= ty <= ty + h <= y + height
        rows, columns = tile.keep
        own = np.add.outer((ty - y + np.arange(h)) * width, tx - x + np.arange(w))
        whole = np.arange(width * height).reshape(height, width)
        np.testing.assert_array_equal(own[rows, columns], whole[tile.target])
        covered[tile.target] += 1
    assert np.all(covered == 1)


def test_a_picture_in_tiles_is_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = glpath.render(BOX, spp=64, max_depth=1, resolution=(50, 40)).mean
    monkeypatch.setattr(tiles, "MAX_PATHS", 300)
    tiled = glpath.render(BOX, spp=64, max_depth=1, resolution=(50, 40)).mean
    # Rounding may put a sample on the other side of an edge.
    assert np.mean(np.abs(tiled - whole).max(axis=-1) > 1e-3 * whole.max()) < 0.01
    assert relative_mse(tiled, whole) < 1e-4


def test_a_crop_is_that_part_of_the_picture() -> None:
    whole = glpath.render(BOX, spp=64, max_depth=1, resolution=(50, 40))
    crop = glpath.render(BOX, spp=64, max_depth=1, resolution=(50, 40), crop=(11, 5, 20, 30))
    assert crop.mean.shape == (30, 20, 3)
    assert relative_mse(crop.mean, whole.mean[5:35, 11:31]) < 1e-4


def test_a_wide_picture_shows_more_at_the_sides_and_the_same_in_the_middle() -> None:
    square = glpath.render(BOX, spp=192, max_depth=1, resolution=(32, 32)).mean
    wide = glpath.render(BOX, spp=192, max_depth=1, resolution=(64, 32)).mean
    assert relative_mse(wide[:, 16:48], square) < 1e-4


def test_the_camera_can_be_replaced_field_by_field() -> None:
    film = glpath.render(
        BOX,
        spp=2,
        max_depth=1,
        resolution=(8, 8),
        camera={"position": (0, 0, 0.9), "target": (0, 1, 0.01), "fov": 5},
    )
    # From below, straight into the lamp.
    np.testing.assert_allclose(film.mean.max(axis=(0, 1)), [18.387, 13.9873, 6.75357], rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"spp": 0}, "spp: 0"),
        ({"max_depth": 0}, "max_depth: 0"),
        ({"seed": -1}, "seed: -1"),
        ({"sampling": "halton"}, "sobol, random"),
        ({"integrator": "path-buffer", "directions": "cube"}, "pair, lattice, hemisphere, sphere"),
        ({"ambient": -1.0}, "ambient"),
        ({"ambient": (1.0, 2.0)}, "ambient"),
        ({"ambient": "red"}, "ambient"),
        ({"resolution": "16x16"}, "resolution"),
        ({"resolution": 5}, "resolution"),
        ({"resolution": (16.7, 16)}, "whole numbers"),
        ({"crop": (1, 2, 3)}, "crop"),
        ({"camera": {"fov": "abc"}}, "camera fov"),
        ({"camera": {"position": (1, 2)}}, "camera position"),
        ({"crop": (250, 0, 10, 10)}, "256 x 256"),
        ({"camera": {"zoom": 2}}, "position, target, up, fov"),
        ({"camera": {"fov": 190}}, "fov"),
        ({"camera": {"target": (0, 0, 3.9)}}, "target"),
        ({"backend": "vulkan"}, "auto, egl, osmesa"),
    ],
)
def test_wrong_options_are_refused_with_what_is_allowed(options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.GlpathError) as caught:
        glpath.render(BOX, **options)
    assert words in str(caught.value)


def test_cameras_behind_a_scene_among_the_frames_show_the_first_scene() -> None:
    base = glpath.load_scene(BOX).with_camera(resolution=(8, 8))
    other = replace(base, materials=tuple(replace(m, reflectance=0.5 * m.reflectance) for m in base.materials))
    options: dict[str, Any] = {"integrator": "path", "guide": "cosine", "spp": 1}
    films = glpath.render_frames(base, [other, {}, base.camera], **options)
    expected = [glpath.render(scene, **options).radiance_sums for scene in (other, base, base)]
    assert np.array_equal([film.radiance_sums for film in films], expected)


def test_frame_of_a_transparent_scene_has_alpha() -> None:
    base = glpath.load_scene(BOX).with_camera(resolution=(8, 8), fov=120.0)
    clear = replace(base, background=Background(transparent=True))
    films = list(glpath.render_frames(base, [{}, clear], integrator="path", spp=1))
    expected = glpath.render(clear, integrator="path", spp=1).alpha
    assert films[0].alpha is None
    assert expected is not None
    assert 0.0 < expected.mean() < 1.0
    assert np.array_equal(films[1].alpha, expected)


def test_ctrl_c_gives_the_path_sets_done_so_far() -> None:
    def stop(progress: glpath.Progress) -> None:
        if progress.done:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(glpath.RenderInterrupted) as caught:
        glpath.render(BOX, spp=10**6, max_depth=2, resolution=(16, 16), on_progress=stop)
    film = caught.value.film
    assert 0 < film.path_sets < 10**6
    same = glpath.render(BOX, spp=film.path_sets, max_depth=2, resolution=(16, 16))
    np.testing.assert_array_equal(film.mean, same.mean)


def _irradiance(**options: Any) -> glpath.Film:
    return glpath.irradiance("furnace", [[0.5, 0.5, 0.5]], [[0.0, 1.0, 0.0]], integrator="path", **options).film


def _frame(**options: Any) -> glpath.Film:
    return next(
        iter(glpath.render_frames("furnace", [{"fov": 40.0}], integrator="path", resolution=(8, 8), **options))
    )


def _still(**options: Any) -> glpath.Film:
    return glpath.render("furnace", camera={"fov": 40.0}, integrator="path", resolution=(8, 8), **options)


@pytest.mark.parametrize(
    ("call", "resumes", "remedy"),
    [
        (_irradiance, _irradiance, "the same call with film=film"),
        (_frame, _still, "(for a frame of render_frames: render)"),
    ],
)
def test_interruption_names_the_call_that_resumes(
    call: Callable[..., glpath.Film], resumes: Callable[..., glpath.Film], remedy: str
) -> None:
    with pytest.raises(glpath.RenderInterrupted, match=re.escape(remedy)) as caught:
        call(spp=64, on_step=lambda film: signal.raise_signal(signal.SIGINT))
    film = caught.value.film
    assert film.path_sets < 64
    assert resumes(spp=64, film=film).path_sets == 64


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_job_that_is_told_to_stop_writes_what_it_has(number: signal.Signals, tmp_path: Path) -> None:
    """As a shell starts a background job, with SIGINT ignored, when it is SIGTERM that stops it."""
    out = tmp_path / "a.npz"
    command = [sys.executable, "-m", "glpath", "render", BOX, "-o", str(out), "--spp", "1000000"]
    command += ["--resolution", "16x16", "--progress", "lines"]

    def ignore_interrupts() -> None:
        if number is signal.SIGTERM:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=ignore_interrupts) as job:
        assert job.stderr is not None
        for line in job.stderr:
            if "path sets" in line:
                break
        job.send_signal(number)
        job.stderr.read()
    assert job.returncode == 130
    assert glpath.Film.load(out).path_sets > 0


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def test_many_renders_leave_memory_flat() -> None:
    def some(n: int) -> float:
        for i in range(n):
            glpath.render(BOX, spp=1, max_depth=2, seed=i, resolution=(64, 64))
        return resident_mib()

    before = some(20)  # caches and the allocator's arenas fill first
    after = some(50)
    # A render's textures are 10 MiB here (the shadow-buffer and 64 x 64 paths): leaking them would be half a GiB.
    assert after - before < 30


def test_progress_counts_up_to_the_end() -> None:
    seen: list[glpath.Progress] = []
    glpath.render(BOX, spp=40, max_depth=1, resolution=(16, 16), on_progress=seen.append)
    assert seen[0].stage == "compiling shaders"
    assert [p.done for p in seen] == sorted(p.done for p in seen)
    assert (seen[-1].done, seen[-1].total) == (40, 40)
    assert seen[-1].error is not None


def test_paths_that_are_drawn_in_parts_have_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """No draw is so long that a watchdog ends it, however deep paths are."""
    whole = glpath.render(BOX, spp=2, max_depth=3, resolution=(50, 40))
    monkeypatch.setattr(passes, "TESTS_PER_DRAW", 200_000)
    parts = glpath.render(BOX, spp=2, max_depth=3, resolution=(50, 40))
    np.testing.assert_array_equal(whole.radiance_sums, parts.radiance_sums)


def test_timings_are_there_when_asked_for() -> None:
    scans = {"shadow-buffer", "eye", "first vertex", "scan positions", "scan scene", "advance"}
    for engine, expected in (("path", {"emitter silhouettes", "eye", "paths"}), ("pair", scans)):
        film = glpath.render(
            BOX, spp=2, max_depth=2, resolution=(16, 16), **engine_options(engine), timings=True
        )  # fmt: skip
        stages = film.metadata.statistics["stage_ms"]
        assert set(stages) == expected
        assert all(ms > 0 for ms in stages.values())


def test_a_picture_that_crowding_makes_noisy_says_so() -> None:
    from glpath.io import scene_from_dict

    ground = [[-900, 0, 900], [900, 0, 900], [900, 0, -900], [-900, 0, -900]]
    lamp = {"type": "box", "center": [0, 3, 0], "size": [1, 0.1, 1], "emission": {"radiance": 5.0}}
    scene = scene_from_dict(
        {
            "camera": {"type": "perspective", "position": [0, 2, 5], "target": [0, 0.5, 0], "fov": 50},
            "film": {"resolution": [48, 48]},
            "shapes": [
                {"type": "quad", "corners": ground},
                {"type": "box", "min": [-1, 0, -1], "max": [1, 1, 1]},
                lamp,
            ],
        }
    )
    with pytest.warns(glpath.SceneWarning, match="lost the roulette"):
        glpath.render(scene, spp=4, max_depth=3, integrator="path-buffer")


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")  # paths crowd into few cells
@pytest.mark.parametrize("resolution", [(16384, 2), (2, 20000)])
def test_a_picture_as_long_as_a_texture_may_be_or_longer_is_rendered_in_tiles(resolution: tuple[int, int]) -> None:
    film = glpath.render("furnace", spp=1, max_depth=2, resolution=resolution)
    assert film.mean.shape == (resolution[1], resolution[0], 3)
    assert (film.mean > 0).all()
