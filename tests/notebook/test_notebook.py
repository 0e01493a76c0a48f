"""The live view of notebooks, by the events that a browser would send; progress; and a driver that fails."""

from __future__ import annotations

import asyncio
import base64
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

import glpath
from glpath.film.film import Film
from glpath.gl.context import open_context
from glpath.notebook import View, explore_shafts, view
from glpath.notebook.live import LiveImage
from glpath.notebook.shaft_scene import ShaftScene
from glpath.notebook.view import nearer, shifted, turned
from glpath.radiosity import Strategy
from glpath.rendering.job import describe
from glpath.rendering.progress import Progress, reporting
from glpath.scene import Camera
from glpath.scene.model import Shapes

SIZE = (48, 32)


def send(shown: View, kind: str, **fields: Any) -> None:
    """As the browser's half of the widget sends it."""
    message = {"type": kind, "x": 0, "y": 0, "timestamp": 0.0, "modifiers": [], **fields}
    shown._canvas._rfb_handle_msg(shown._canvas, message, [])


def rest(shown: View) -> None:
    """Let time go by: the camera counts as resting."""
    shown._image._moved_at = -np.inf


def converge(shown: View) -> np.ndarray:
    rest(shown)
    shown.picture()
    while not shown.converged:
        shown.draw()
    assert shown._message.value == ""
    return shown.picture()


def test_left_alone_it_converges_to_the_render() -> None:
    shown = view("cornell-box", resolution=SIZE, spp=24, max_depth=2)
    first = shown.picture()
    assert first.shape == (32, 48, 3)
    film = glpath.render("cornell-box", resolution=SIZE, spp=24, max_depth=2)
    np.testing.assert_array_equal(converge(shown), film.to_srgb(exposure=shown.exposure))
    assert shown.path_sets == 24
    shown.close()


@pytest.mark.parametrize(("scene", "options"), [("cornell-box", {"max_depth": 2}), ("three-spheres", {})])
def test_a_drag_turns_the_scene_and_the_picture_is_that_of_the_new_camera(scene: str, options: Any) -> None:
    shown = view(scene, resolution=SIZE, spp=4, **options)
    before = converge(shown)
    home = shown.scene.camera
    send(shown, "pointer_move", x=30, y=5)
    assert shown.converged, "the pointer was not down"
    send(shown, "pointer_down", button=1)
    send(shown, "pointer_move", x=60, y=25, buttons=[1])
    assert not shown.converged
    shown.draw()
    send(shown, "pointer_up", x=62, y=25)
    after = converge(shown)
    assert np.mean(np.abs(after.astype(int) - before)) > 2
    np.testing.assert_allclose(shown.scene.camera.position, turned(home, 62, 25).position, atol=1e-12)
    if scene == "three-spheres":
        options = {"shadows": "cube", "shadow_resolution": 512, "integrator": "t-buffer"}
    film = glpath.render(shown.scene, spp=4, **options)
    np.testing.assert_array_equal(after, film.to_srgb(exposure=shown.exposure))
    assert shown.film.merge(glpath.render(shown.scene, spp=4, first_path_set=4, **options)).path_sets == 8
    send(shown, "double_click")
    np.testing.assert_array_equal(converge(shown), before)


def test_a_moving_image_is_smaller_and_better_than_a_path_set() -> None:
    """One path set has one light point for all pixels: hard shadows, and black where neither direction is lit."""
    scene = glpath.load_scene("cornell-box").with_camera(resolution=(128, 128))
    with open_context() as context:
        live = LiveImage(*describe(scene, spp=64), context)
        live.first(0.0)
        for turn in range(4):
            live.look_from(turned(scene.camera, 5.0 + turn, 0.0))
            moving = live.step()
            assert moving is not None
    assert moving.shape[0] in (32, 64, 128)
    side = moving.shape[0]
    exact = glpath.render(live.scene.with_camera(**vars(live.camera)), spp=256).mean
    coarse = exact.reshape(side, 128 // side, side, 128 // side, 3).mean(axis=(1, 3))
    single = glpath.render(live.scene.with_camera(**vars(live.camera)), spp=1).mean
    assert glpath.relative_mse(moving, coarse) < 0.4 * glpath.relative_mse(single, exact)
    live._moved_at = -np.inf
    better = None
    while better is None:
        with context:
            better = live.step()
    assert better.shape == (128, 128, 3)
    assert live.path_sets >= 4, "the whole image takes the coarse one's place when it is better"


def test_shadow_buffers_are_kept_while_the_camera_moves() -> None:
    shown = view("three-spheres", resolution=SIZE, spp=2)
    converge(shown)
    engine: Any = shown._image._level(1).engine
    buffer = engine.shadow_buffer
    tests = buffer.intersection_tests
    send(shown, "wheel", dy=-200)
    converge(shown)
    assert engine.shadow_buffer is buffer
    assert buffer.intersection_tests == tests > 0


def test_another_render_in_between_does_no_harm() -> None:
    shown = view("cornell-box", resolution=SIZE, spp=6, max_depth=2)
    shown.draw()
    glpath.render("three-spheres", integrator="t-buffer", resolution=(16, 16), spp=1)
    film = glpath.render("cornell-box", resolution=SIZE, spp=6, max_depth=2)
    np.testing.assert_array_equal(converge(shown), film.to_srgb(exposure=shown.exposure))


def test_stop_holds_the_image_and_reset_goes_back() -> None:
    shown = view("cornell-box", resolution=SIZE, spp=500, max_depth=1)
    shown.picture()
    shown._stop.value = True
    sets = shown.path_sets
    for _ in range(3):
        shown.draw()
    assert shown.path_sets == sets > 0
    shown._stop.value = False
    shown.draw()
    assert shown.path_sets > sets
    home = shown.scene.camera
    send(shown, "wheel", dy=-200)
    assert shown.scene.camera is not home
    shown._stop.value = True
    shown._reset.click()
    assert shown.scene.camera is home
    assert not shown._stop.value, "Reset goes on with what Stop held"


@pytest.mark.parametrize("stopped", [False, True])
def test_save_makes_a_picture_where_there_is_none_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    shown = view("cornell-box", resolution=SIZE, spp=100000, max_depth=1)
    shown.picture()
    shown._stop.value = stopped
    send(shown, "wheel", dy=-200)
    if not stopped:
        rest(shown)
        shown.draw()
        shown._reset.click()
    assert shown.path_sets == 0
    shown._save.click()
    assert re.search(r"Saved cornell-box.png: [1-9]\d* of 100000 path sets", shown._message.value)
    saved = np.asarray(Image.open(tmp_path / "cornell-box.png"))
    np.testing.assert_array_equal(saved, shown.film.to_srgb(exposure=shown.exposure))


def test_keys_turn_shift_come_nearer_and_reset() -> None:
    shown = view("cornell-box", resolution=SIZE, spp=1, max_depth=1)
    home = shown.scene.camera

    def press(key: str, *modifiers: str) -> Camera:
        send(shown, "key_down", key=key, modifiers=modifiers)
        return shown.scene.camera

    np.testing.assert_allclose(press("ArrowLeft").position, turned(home, -25, 0).position)
    np.testing.assert_allclose(press("ArrowRight").position, home.position)
    np.testing.assert_allclose(press("ArrowUp", "Shift").target, shifted(home, 0, -25).target)
    np.testing.assert_allclose(press("ArrowDown", "Shift").target, home.target)
    np.testing.assert_allclose(press("+").position, nearer(home, -1).position)
    np.testing.assert_allclose(press("-").position, home.position)
    assert press("r", "Control") is not home, "that is the browser's own"
    assert press("r") is home


def test_frames_lost_with_a_page_are_not_waited_for() -> None:
    """A page that is loaded anew says its size; nobody says what became of the frames that went to the old one."""
    shown = view("cornell-box", resolution=SIZE, spp=100000, max_depth=1)

    async def pages() -> list[int]:
        drawn = []
        shown._canvas._has_visible_views = True
        for _ in range(2):
            send(shown, "resize", width=48, height=32)
            for _ in range(20):
                rest(shown)
                shown._image._shown_at = -np.inf
                await asyncio.sleep(0.01)
            drawn.append(shown._canvas._rfb_frame_index)
        return drawn

    first, second = asyncio.run(pages())
    assert first == shown._canvas.max_buffered_frames, "more than these are not sent unheard"
    assert second > first


def test_save_writes_what_is_seen_and_overwrites_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shown = view("cornell-box", resolution=SIZE, spp=4, max_depth=1)
    image = converge(shown)
    for _ in range(2):
        shown._save.click()
    for name in ("cornell-box.png", "cornell-box-2.png"):
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / name)), image)
    assert "Saved cornell-box-2.png: 4 of 4 path sets" in shown._message.value
    assert Image.open(tmp_path / "cornell-box.png").text["glpath.scene"] == "cornell-box"
    monkeypatch.setattr(Film, "save", Mock(side_effect=glpath.ImageError("a.png: the disk is full", "Make room.")))
    shown._save.click()
    assert "the disk is full<br>Make room." in shown._message.value
    assert shown._canvas in shown.children, "what could not be saved is still there"


def test_an_error_is_shown_in_the_views_place_and_reset_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = view("cornell-box", resolution=SIZE, spp=4, max_depth=1)
    engine = shown._image._level(1).engine
    with monkeypatch.context() as broken:
        broken.setattr(engine, "trace_path_set", Mock(side_effect=ZeroDivisionError("<b>out of luck</b>")))
        shown.draw()
    assert shown._canvas not in shown.children
    assert "ZeroDivisionError: &lt;b&gt;out of luck" in shown._message.value
    send(shown, "pointer_down", x=None, y=0)
    send(shown, "pointer_move", x=1, y=0)
    assert "TypeError" in shown._message.value
    shown._grip = None
    shown._reset.click()
    assert shown._canvas in shown.children
    assert shown._message.value == ""
    converge(shown)


def test_a_page_without_a_kernel_shows_the_first_picture() -> None:
    shown = view("cornell-box", resolution=SIZE, spp=2, max_depth=1)
    data = data_of(shown)
    picture = np.asarray(Image.open(BytesIO(base64.b64decode(data["image/png"]))))
    assert picture.shape == (32, 48, 3)
    assert np.ptp(picture) > 50
    assert "2 path sets" in data["text/plain"]
    assert any("widget-view" in kind for kind in data)


def test_a_closed_view_is_deaf_and_says_so() -> None:
    shown = view("cornell-box", resolution=SIZE, spp=2, max_depth=1)
    shown.close()
    shown.close()
    shown.draw()
    send(shown, "pointer_down")
    send(shown, "pointer_move", x=30, y=5)
    with pytest.raises(glpath.UsageError, match="closed"):
        _ = shown.film


CAMERA = Camera(np.array([0.0, 0.0, 5.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 90.0, (100, 100))


def test_dragging_to_the_right_turns_the_scene_to_the_right() -> None:
    moved = turned(CAMERA, 90 / 0.4, 0)
    np.testing.assert_allclose(moved.position, [-5, 0, 0], atol=1e-12)
    # What was in front of the target, nearest to the eye, is now to the right of it.
    assert np.array([0, 0, 1.0]) @ moved.frame()[0] > 0.99


def test_dragging_down_looks_from_above_but_never_over_the_pole() -> None:
    assert turned(CAMERA, 0, 50).position[1] > 0
    for _ in range(20):
        CAMERA_ABOVE = turned(CAMERA, 3, 1000)
    assert 4.99 < CAMERA_ABOVE.position[1] < 5
    assert np.isfinite(CAMERA_ABOVE.frame()).all()


def test_shifting_takes_the_target_along_with_the_pointer() -> None:
    moved = shifted(CAMERA, 10, 0)
    np.testing.assert_allclose(moved.target, [-1, 0, 0], atol=1e-12)  # 10 of 100 pixels of a view 10 wide
    np.testing.assert_allclose(moved.position - moved.target, [0, 0, 5])


def test_the_wheel_comes_nearer_and_goes_back() -> None:
    near = nearer(CAMERA, -3)
    assert 0 < near.position[2] < 5
    np.testing.assert_allclose(nearer(near, 3).position, CAMERA.position)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"integrator": "radiance"}, "radiance"),
        ({"shadows": "cube"}, "shadows"),
        ({"tonemap": "filmic"}, "reinhard"),
        ({"spp": 0}, "spp"),
        ({"resolution": "big"}, "resolution"),
        ({"colour": 1}, "colour"),
    ],
)
def test_wrong_options_of_a_view_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(glpath.GlpathError, match=words):
        view("cornell-box", **options)


def test_a_shaft_is_drawn_anew_when_another_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = explore_shafts("cornell-box")
    before = bytes(shown.picture.value)
    assert before.startswith(b"\x89PNG")
    shown.strategy.value = Strategy.ALWAYS_OPEN
    shown.receiver.value = "left-wall" if "left-wall" in shown.receiver.options else shown.receiver.options[0]
    assert bytes(shown.picture.value) not in (b"", before)
    assert shown._message.value == ""
    monkeypatch.setattr(ShaftScene, "draw", Mock(side_effect=glpath.UsageError("the shaft is shut", "Open it.")))
    shown.strategy.value = Strategy.KEEP_CLOSED
    assert "the shaft is shut<br>Open it." in shown._message.value
    shown.close()


def test_candidates_between_two_shapes_hold_all_that_stands_between() -> None:
    office = ShaftScene(glpath.load_scene("office"))
    lists = {s: office.between("light-1-4", "desk-0-top", s) for s in Strategy}
    opened = lists[Strategy.ALWAYS_OPEN]
    assert 0 < len(opened.polygons) < 0.1 * opened.others
    assert not len(opened.boxes)
    for found in lists.values():
        assert set(opened.polygons) <= set(found.polygons)
        assert len(found.nodes) <= len(opened.nodes)
    assert len(lists[Strategy.KEEP_CLOSED].boxes)
    # Whoever is off the list is outside.
    boxes = np.concatenate(office.occluders.boxes(), axis=1)
    own = np.concatenate([office.polygons_of(name) for name in ("light-1-4", "desk-0-top")])
    touching = np.setdiff1d(np.flatnonzero(opened.shaft.classify(boxes)), own)
    np.testing.assert_array_equal(touching, opened.polygons)


def test_polygons_of_a_name_are_those_of_all_shapes_of_that_name() -> None:
    def quad(x: float) -> dict[str, object]:
        return {"type": "quad", "corners": [[x, 0, 0], [x, 1, 0], [x, 1, 1], [x, 0, 1]]}

    ball = {"type": "sphere", "center": [9, 0, 0], "radius": 1}
    camera = {"position": [0, 0, 9], "target": [0, 0, 0]}
    scene = glpath.load_scene({"camera": camera, "shapes": [ball, quad(0), quad(1), quad(5)], "ambient": 1})
    names = ("lamp", "lamp", "lamp", "wall")  # a sphere has no polygons
    shapes = Shapes([replace(shape, name=name) for shape, name in zip(scene.shapes, names, strict=True)])
    found = ShaftScene(replace(scene, shapes=shapes))
    assert found.shapes == ["lamp", "wall"]
    lower, upper = found.box_of("lamp").reshape(2, 3)
    np.testing.assert_allclose(upper - lower, 1.0)
    assert found.between("lamp", "wall").others == 0


def test_a_shape_that_there_is_not_is_named_with_those_that_are() -> None:
    with pytest.raises(glpath.UsageError, match="sofa"):
        ShaftScene(glpath.load_scene("office")).between("sofa", "floor")
    with pytest.raises(glpath.UsageError, match="no triangles"):
        explore_shafts("three-spheres")


KERNEL = """
import subprocess, sys
import glpath, glpath.gl.opening as c
import glpath.rendering.run_options
glpath.rendering.run_options.in_notebook = lambda: True
"""


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", KERNEL + code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_in_a_kernel_a_driver_that_crashes_is_an_error_not_the_end() -> None:
    out = python(
        "c.open_device = lambda candidate: sys.exit('the driver was called')\n"
        "c.start_probe = lambda candidate: subprocess.Popen(\n"
        "    [sys.executable, '-c', 'import os; os.kill(os.getpid(), 11)'],\n"
        "    stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)\n"
        "try:\n"
        "    glpath.render('furnace', spp=1)\n"
        "except glpath.ContextError as error:\n"
        "    print(error)\n"
    )
    assert "ended the process that tried it (signal SIGSEGV)" in out
    assert "apt-get install" in out


def test_in_a_kernel_a_device_that_answers_is_taken() -> None:
    out = python("print(glpath.render('furnace', spp=1, max_depth=1, resolution=(4, 4)).path_sets)\n")
    assert out == "1\n"


def test_progress_replaces_a_picture_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    import IPython.display

    shown: list[tuple[str, int, dict[str, Any]]] = []

    class Handle:
        def __init__(self) -> None:
            self.number = len({number for _, number, _ in shown})

        def update(self, bundle: dict[str, Any], raw: bool) -> None:
            shown.append(("update", self.number, bundle))

    def display(bundle: dict[str, Any], raw: bool, display_id: bool) -> Handle:
        handle = Handle()
        shown.append(("display", handle.number, bundle))
        return handle

    monkeypatch.setattr(IPython.display, "display", display)
    monkeypatch.setattr("glpath.rendering.progress.in_notebook", lambda: True)
    told: list[int] = []
    film = glpath.render(
        "furnace", spp=40, max_depth=1, resolution=(8, 8), progress=True, on_progress=lambda p: told.append(p.done)
    )
    assert [(what, number) for what, number, _ in shown[:2]] == [("display", 0), ("display", 1)]
    assert all(what == "update" for what, _, _ in shown[2:])
    assert shown[-2][2] == film.shown()
    converging = [bundle for _, number, bundle in shown[:-2] if number == 0 and "text/html" in bundle]
    assert all("image/png" not in bundle for bundle in converging), "not twice, twice a second"
    lines = [bundle["text/plain"] for _, number, bundle in shown if number == 1]
    assert lines[0].startswith("compiling shaders on ")
    assert lines[-1].startswith("40 path sets in ")
    assert told[-1] == 40


class Kernel:
    """A real kernel, and what its cells show: outputs in order, those with a display's name replaced in place."""

    def __init__(self) -> None:
        from jupyter_client.manager import start_new_kernel

        self.manager, self.client = start_new_kernel()
        self.outputs: list[dict[str, Any]] = []
        self.interrupt_at = ""

    def run(self, cell: str, interrupt_at: str = "") -> list[dict[str, Any]]:
        """The outputs of a cell, which is interrupted when it shows a text with these words."""
        first, self.interrupt_at = len(self.outputs), interrupt_at
        self.client.execute_interactive(cell, timeout=120, output_hook=self._collect)
        return self.outputs[first:]

    def _collect(self, message: dict[str, Any]) -> None:
        kind, content = message["msg_type"], message["content"]
        name = content.get("transient", {}).get("display_id")
        if kind == "update_display_data":
            for output in self.outputs:
                if output["name"] == name:
                    output["data"] = content["data"]
        elif kind in ("display_data", "execute_result", "stream", "error"):
            error = {"text/plain": "\n".join(content["traceback"])} if kind == "error" else {}
            self.outputs.append({"kind": kind, "name": name, "data": content.get("data", error)})
            self.outputs[-1]["text"] = content.get("text", "")
        if self.interrupt_at and self.interrupt_at in content.get("data", {}).get("text/plain", ""):
            self.interrupt_at = ""
            self.manager.interrupt_kernel()

    def close(self) -> None:
        self.client.stop_channels()
        self.manager.shutdown_kernel(now=True)


@pytest.fixture(scope="module")
def kernel() -> Iterator[Kernel]:
    made = Kernel()
    yield made
    made.close()


def pictures(outputs: list[dict[str, Any]]) -> int:
    return sum("image/png" in output["data"] for output in outputs)


def test_a_film_that_a_cell_has_shown_as_it_converged_is_shown_once(kernel: Kernel) -> None:
    render = "film = glpath.render('furnace', spp=2, max_depth=1, resolution=(8, 8), progress=True)"
    first = kernel.run(f"import glpath\n{render}\nfilm")
    assert pictures(first) == 1
    assert first[-1]["kind"] == "execute_result"
    assert "image/png" in first[-1]["data"]
    second = kernel.run(render)
    assert pictures(second) == 1, "as it converged"
    assert pictures(kernel.run("film")) == 1, "another cell shows it again"
    assert pictures(second) == 1, "and takes it from none"


def test_an_interruption_says_where_the_film_is(kernel: Kernel) -> None:
    render = "glpath.render('cornell-box', spp=10**6, max_depth=1, resolution=(16, 16), progress=True)"
    shown = kernel.run(f"import glpath\nfound = {render}", interrupt_at=" left")
    assert shown[-1]["kind"] == "error"
    traceback = re.sub(r"\x1b\[[0-9;]*m", "", shown[-1]["data"]["text/plain"])
    command = re.search(r"import sys; film = sys.last_value.film", traceback)
    assert command, traceback
    sets = int(kernel.run(f"{command[0]}\nprint(film.path_sets)")[0]["text"])
    assert sets > 0
    assert f"interrupted after {sets} path sets" in traceback
    picture, line = (output["data"] for output in shown[:2])
    assert line["text/plain"].startswith(f"interrupted after {sets} path sets, "), "no time that is left"
    assert f"{sets} path sets" in picture["text/plain"]
    assert "image/png" in picture


def test_pictures_have_words_for_those_who_do_not_see_them() -> None:
    film = glpath.render("cornell-box", spp=2, max_depth=1, resolution=(16, 12))
    alt = words_of(str(film._repr_mimebundle_()["text/html"]))
    assert alt == "cornell-box, by path, 2 path sets, 16 x 12 pixels"
    scene = glpath.load_scene("cornell-box").with_camera(resolution=(16, 12))
    assert "cornell-box: " in words_of(str(scene._repr_mimebundle_()["text/html"]))
    shown = view(scene, spp=2, max_depth=1)
    assert words_of(data_of(shown)["text/html"]).startswith("View of cornell-box: by path, 16 x 12 pixels")
    shafts = explore_shafts("cornell-box")
    assert "the shaft from light to " in words_of(data_of(shafts)["text/html"])
    shafts.strategy.value = Strategy.ALWAYS_OPEN
    assert shafts.picture.tooltip.endswith(" of cornell-box, always open")


def words_of(html: str) -> str:
    (alt,) = re.findall(r'<img alt="([^"]+)"', html)
    return alt


def data_of(widget: Any) -> dict[str, Any]:
    bundle = widget._repr_mimebundle_()
    return bundle[0] if isinstance(bundle, tuple) else bundle


def test_progress_outside_of_a_notebook_is_lines(capfd: pytest.CaptureFixture[str]) -> None:
    glpath.render("furnace", spp=2, max_depth=1, resolution=(4, 4), progress=True)
    out, err = capfd.readouterr()
    assert out == ""
    assert "2/2 path sets (100 %)" in err


def test_a_cell_keeps_the_context_and_between_cells_others_have_it() -> None:
    """In a real kernel: by hand in a cell, a render in another thread between cells, by hand again in the next."""
    from jupyter_client.manager import start_new_kernel

    manager, client = start_new_kernel()
    out: list[str] = []

    def run(cell: str) -> str:
        out.clear()
        reply = client.execute_interactive(cell, timeout=120, output_hook=collect)
        assert reply["content"]["status"] == "ok", "\n".join(reply["content"]["traceback"])
        return "".join(out)

    def collect(message: dict[str, Any]) -> None:
        out.append(message["content"].get("text", ""))

    try:
        found = run(
            "import glpath, threading\n"
            "from glpath.gl.context import get_context\n"
            "context = get_context(); texture = context.gl.texture((2, 2), 1, data=b'abcd')\n"
            "def work():\n"
            "    asked.wait(); films.append(glpath.render('furnace', spp=1, resolution=(4, 4))); done.set()\n"
            "films, asked, done = [], threading.Event(), threading.Event()\n"
            "threading.Thread(target=work).start()\n"
            "asked.set()\n"
            "print(done.wait(0.5), context._turns.mine)"
        )
        assert found == "False True\n"  # the thread waits for the end of the cell
        until = time.monotonic() + 60
        while run("print(len(films), texture.read())") == "0 b'abcd'\n":
            assert time.monotonic() < until
            time.sleep(0.1)
        assert run("print(len(films), texture.read(), context._turns.mine)") == "1 b'abcd' True\n"
        assert run("context.leave(); print(context._turns.thread)") == "None\n"
        assert run("print(context._turns.thread)") == "None\n"
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)


@pytest.mark.parametrize(("error", "at_the_end"), [(MemoryError, False), (KeyboardInterrupt, True)])
def test_a_film_that_cannot_be_shown_is_not_lost(
    error: type[BaseException], at_the_end: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    import IPython.display

    def fail(film: Film) -> dict[str, object]:
        raise error

    monkeypatch.setattr(IPython.display, "display", lambda *_, **__: Mock())
    monkeypatch.setattr("glpath.rendering.progress.in_notebook", lambda: True)
    film = glpath.render("furnace", spp=1, max_depth=1, resolution=(8, 8))
    progress = Progress(1, 2, 1.0, None, film, "rendering", "llvmpipe")

    def render_and_fail() -> None:
        with reporting("auto", None) as report:
            assert report is not None
            report(progress)
            monkeypatch.setattr(Film, "shown", fail)
            if not at_the_end:
                report(progress)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        render_and_fail()
