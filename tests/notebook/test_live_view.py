"""The live view in a real browser: JupyterLab on the loopback, and Chromium without a screen, driven by Selenium.

Needs Debian's chromium and chromium-driver and the extra `browser`; `make evidence` installs them, and without them
these tests are skipped. `pytest -m evidence -s tests/notebook/test_live_view.py -k frames` prints the rates.
"""

from __future__ import annotations

import base64
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import glpath
from glpath.notebook.view import nearer, turned
from tests.support import browser
from tests.support.repository import ROOT

pytestmark = browser.marks("jupyterlab")

SECONDS = browser.SECONDS
# On the loopback alone, and nothing is asked of the network.
SERVER = (
    "--no-browser",
    "--allow-root",
    "--ip=127.0.0.1",
    "--port=0",
    "--IdentityProvider.token=glpath",
    "--LabApp.expose_app_in_browser=True",
    "--LabApp.extension_manager=readonly",
    "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
    "--LabApp.news_url=None",
)
OPTIONS = {"resolution": (256, 192), "spp": 24, "max_depth": 2}

# The browser's own events, 50 a second, whatever the driver's rate is; frames are counted as the image shows them.
CIRCLE = """
const [seconds, done] = arguments
const image = document.querySelector('.renderview-wrapper img')
const box = image.getBoundingClientRect()
const at = (type, x, y, buttons) => image.dispatchEvent(new PointerEvent(type, {
  clientX: box.x + x, clientY: box.y + y, button: type === 'pointermove' ? -1 : 0, buttons, pointerId: 1,
  pointerType: 'mouse', isPrimary: true, bubbles: true, cancelable: true }))
let frames = 0
const seen = new MutationObserver(() => { frames += 1 })
seen.observe(image, { attributes: true, attributeFilter: ['src'] })
const cx = box.width / 2, cy = box.height / 2, begun = performance.now()
image.setPointerCapture = () => {}
at('pointerdown', cx + 20, cy, 1)
const timer = setInterval(() => {
  const t = (performance.now() - begun) / 1000
  at('pointermove', cx + 20 * Math.cos(3 * t), cy + 20 * Math.sin(3 * t), 1)
  if (t < seconds) return
  clearInterval(timer)
  at('pointerup', cx + 20 * Math.cos(3 * t), cy + 20 * Math.sin(3 * t), 0)
  seen.disconnect()
  done(frames / t)
}, 20)
"""

PICTURE = """
const image = document.querySelector('.renderview-wrapper img')
const canvas = document.createElement('canvas')
canvas.width = image.naturalWidth
canvas.height = image.naturalHeight
canvas.getContext('2d').drawImage(image, 0, 0)
return canvas.toDataURL('image/png').split(',')[1]
"""


SHOWN = "return !!document.querySelector('.renderview-wrapper img')"
SHOWS_AN_IMAGE = "return document.querySelector('.renderview-wrapper img')?.naturalWidth > 1"


def wait_for(condition: Callable[[], Any], what: str, seconds: float = SECONDS) -> Any:
    end = time.monotonic() + seconds
    while True:
        found = condition()
        if found:
            return found
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.1)


class Lab:
    """A notebook open in JupyterLab, in a browser; and its kernel, asked over the kernel's own sockets."""

    def __init__(self, driver: Any, folder: Path, log: Path) -> None:
        self.driver, self.folder, self.log = driver, folder, log
        self._client: Any = None
        # What the page and the kernel of the test before say as they end is not this one's.
        self._before = len(log.read_text().splitlines())
        driver.get_log("browser")

    def run_cells(self) -> None:
        wait_for(
            lambda: self.driver.execute_script(
                "const n = window.jupyterapp?.shell.currentWidget; "
                "return n?.context?.isReady && n.sessionContext.session?.kernel?.status === 'idle'"
            ),
            "the notebook is open and its kernel idle",
        )
        self.driver.execute_script("window.jupyterapp.commands.execute('notebook:run-all-cells')")

    @property
    def client(self) -> Any:
        if self._client is None:
            from jupyter_client.blocking import BlockingKernelClient

            files = (self.folder / "runtime").glob("kernel-*.json")
            self._client = BlockingKernelClient()
            self._client.load_connection_file(str(max(files, key=lambda file: file.stat().st_mtime)))
            self._client.start_channels()
            self._client.wait_for_ready(timeout=SECONDS)
        return self._client

    def start(self, code: str) -> None:
        """Run the code as a cell; do not wait for it."""
        self.client.execute(code)

    def interrupt(self) -> None:
        self.driver.execute_script(
            "return window.jupyterapp.shell.currentWidget.sessionContext.session.kernel.interrupt()"
        )

    def ask(self, code: str) -> str:
        """What the code prints in the notebook's kernel."""
        out: list[str] = []

        def hook(message: dict[str, Any]) -> None:
            content = message["content"]
            if message["msg_type"] == "stream":
                out.append(content["text"])
            assert message["msg_type"] != "error", "\n".join(content["traceback"])

        self.client.execute_interactive(code, timeout=SECONDS, output_hook=hook)
        return "".join(out)

    def picture(self) -> np.ndarray:
        """(H, W, 3) uint8: the pixels of the view's image, as it was sent."""
        png = base64.b64decode(self.driver.execute_script(PICTURE))
        return np.asarray(Image.open(BytesIO(png)).convert("RGB"))

    def text(self) -> str:
        return str(self.driver.execute_script("return document.querySelector('.jp-Notebook').innerText"))

    def reload(self) -> None:
        """As the browser's own button does, with the notebook saved; the kernel lives on."""
        self.driver.execute_async_script(
            "const done = arguments[0]; window.jupyterapp.commands.execute('docmanager:save').then(() => done())"
        )
        self.driver.refresh()
        wait_for(lambda: self.driver.execute_script(SHOWN), "the view is in the page again")

    def path_sets(self) -> int:
        return int(self.ask("print(shown.path_sets)"))

    def counter(self) -> int:
        """Path sets, as the view itself says."""
        return int(re.search(r"(\d+) of \d+ path sets", self.text())[1])

    def press(self, button: str) -> None:
        self.driver.find_element("xpath", f"//button[contains(., '{button}')]").click()

    def drag(self, right: int, down: int) -> None:
        from selenium.webdriver import ActionChains

        image = self.driver.find_element("css selector", ".renderview-wrapper img")
        chain = ActionChains(self.driver, duration=40).move_to_element(image).click_and_hold()
        for i in range(10):
            chain.move_by_offset(right * (i + 1) // 10 - right * i // 10, down * (i + 1) // 10 - down * i // 10)
        chain.release().perform()

    def converged(self) -> None:
        wait_for(lambda: self.ask("print(shown.converged)") == "True\n", "the view has converged")

    def complaints(self) -> list[str]:
        """Errors in the notebook's outputs, in the browser's log and in the server's, kernels' words included."""
        shown = self.driver.execute_script(
            "return [...document.querySelectorAll('.jp-OutputArea-output')]"
            ".filter(o => /stderr|error/.test(o.dataset.mimeType || '')).map(o => o.innerText)"
        )
        console = [e["message"] for e in self.driver.get_log("browser") if e["level"] == "SEVERE"]
        # Chromium's word on leaving a notebook that was not saved.
        console = [message for message in console if "beforeunload" not in message]
        lines = self.log.read_text().splitlines()[self._before :]
        # Of a traceback its error's words, the first line after it that is not set in.
        said = [
            next((each for each in lines[k + 1 :] if each[:1].strip()), line) if "Traceback" in line else line
            for k, line in enumerate(lines)
            if "Traceback" in line or line.startswith("[E ")
        ]
        # tornado's, where a message was on its way to a page that is gone: nobody awaits what becomes of it.
        gone = ("tornado.iostream.StreamClosedError", "tornado.websocket.WebSocketClosedError")
        return [*shown, *console, *(line for line in said if not line.startswith(gone))]

    def camera(self) -> glpath.scene.Camera:
        text = self.ask(
            "import json, dataclasses\n"
            "print(json.dumps(dataclasses.asdict(shown.scene.camera), default=lambda a: a.tolist()))"
        )
        return glpath.scene.Camera(**json.loads(text))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    folder = tmp_path_factory.mktemp("lab")
    own = {f"JUPYTER_{name}_DIR": str(folder / name.lower()) for name in ("CONFIG", "DATA", "RUNTIME")}
    (folder / "runtime").mkdir()
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "jupyterlab", *SERVER, f"--ServerApp.root_dir={folder}"],
            cwd=folder,
            env=os.environ | own | {"IPYTHONDIR": str(folder / "ipython"), "PYTHONPATH": str(ROOT)},
            stdout=log,
            stderr=log,
        )
        try:

            def address() -> str:
                assert process.poll() is None, (folder / "log").read_text()
                found = list((folder / "runtime").glob("jpserver-*.json"))
                return json.loads(found[0].read_text())["url"] if found else ""

            yield folder, wait_for(address, "JupyterLab answers")
        finally:
            process.terminate()
            process.wait(timeout=SECONDS)


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    with browser.chrome("--disable-gpu") as chrome:
        yield chrome


OpenNotebook = Callable[..., Lab]


@pytest.fixture
def notebook(server: tuple[Path, str], driver: Any) -> Iterator[OpenNotebook]:
    """Opens a notebook of one cell in JupyterLab, and runs it until a script of the page finds what is to come."""
    import nbformat

    folder, url = server
    opened: list[Lab] = []

    def run(code: str, shows: str = SHOWS_AN_IMAGE) -> Lab:
        book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
        book.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
        nbformat.write(book, folder / "view.ipynb")
        driver.get(f"{url}lab/tree/view.ipynb?reset&token=glpath")
        lab = Lab(driver, folder, folder / "log")
        lab.run_cells()
        wait_for(lambda: driver.execute_script(shows), "the cell shows an image")
        opened.append(lab)
        return lab

    yield run
    for lab in opened:
        lab.driver.execute_script("return window.jupyterapp.serviceManager.sessions.shutdownAll()")


CELL = f"""
from glpath.notebook import view
shown = view("cornell-box", **{OPTIONS})
shown
"""


def test_the_view_turns_with_the_mouse_and_shows_what_render_gives(notebook: OpenNotebook) -> None:
    lab = notebook(CELL)
    lab.converged()
    home = lab.camera()
    before = wait_for_film(lab, home)
    lab.drag(60, 25)
    lab.converged()
    camera = lab.camera()
    expected = turned(home, 60, 25)
    np.testing.assert_allclose(camera.position, expected.position, atol=1e-9)
    after = wait_for_film(lab, camera)
    assert np.mean(np.abs(after.astype(int) - before)) > 5
    assert lab.complaints() == []


def wait_for_film(lab: Lab, camera: glpath.scene.Camera, exposure: float | None = None) -> np.ndarray:
    """The view's image, once it is the render from this camera; what is sent without loss comes a moment later."""
    scene = glpath.load_scene("cornell-box").with_camera(**vars(camera))
    film = glpath.render(scene, **OPTIONS)
    exposure = float(lab.ask("print(shown.exposure)")) if exposure is None else exposure
    shown = film.to_srgb(exposure=exposure)
    wait_for(lambda: np.array_equal(lab.picture(), shown), "the view shows the render", 20)
    return shown


def test_a_frame_that_fails_is_seen_and_reset_tries_again(notebook: OpenNotebook) -> None:
    lab = notebook(CELL)
    lab.converged()
    lab.ask(
        "engine = shown._image._level(1).engine\n"
        "def fail(index): raise RuntimeError('the driver is out of luck')\n"
        "engine.trace_path_set = fail\n"
        "shown._image._reduction = 1"
    )
    lab.drag(30, 0)
    wait_for(lambda: "RuntimeError: the driver is out of luck" in lab.text(), "the error is shown")
    lab.ask("del engine.trace_path_set")
    lab.press("Reset")
    lab.converged()
    wait_for_film(lab, glpath.load_scene("cornell-box").with_camera(resolution=OPTIONS["resolution"]).camera)
    assert "out of luck" not in lab.text()


def test_the_buttons_stop_save_and_reset(notebook: OpenNotebook) -> None:
    lab = notebook(CELL.replace("'spp': 24", "'spp': 100000"))
    lab.press("Stop")
    sets = lab.ask("print(shown.path_sets)")
    time.sleep(1)
    assert lab.ask("print(shown.path_sets)") == sets != "0\n"
    lab.press("Save")
    wait_for((lab.folder / "cornell-box.png").exists, "the picture is saved")
    saved = np.asarray(Image.open(lab.folder / "cornell-box.png"))
    wait_for(lambda: np.array_equal(lab.picture(), saved), "what is saved is what is seen", 20)
    # A machine that traces whole images fast enough has one of this camera when the drag ends.
    lab.ask("shown._image._quick_enough = lambda: 4")
    lab.drag(60, 25)
    time.sleep(0.5)
    assert lab.path_sets() == 0, "it is held, with no image of this camera"
    lab.press("Save")
    wait_for((lab.folder / "cornell-box-2.png").exists, "it is made for that, and saved")
    saved = np.asarray(Image.open(lab.folder / "cornell-box-2.png"))
    wait_for(lambda: np.array_equal(lab.picture(), saved), "what is saved is what is seen", 20)
    sets = lab.path_sets()
    lab.press("Reset")
    wait_for(lambda: lab.path_sets() > sets, "Reset goes back, and on")
    assert lab.complaints() == []


def test_a_page_loaded_anew_while_the_view_converges_goes_on(notebook: OpenNotebook) -> None:
    """Frames on their way to the page that is gone are shown by nobody; what goes on needs no word of them."""
    lab = notebook(CELL.replace("'spp': 24", "'spp': 100000"))
    wait_for(lambda: lab.path_sets() > 8, "it converges")
    home = lab.camera()
    lab.reload()
    sets = lab.path_sets()
    wait_for(lambda: lab.driver.execute_script(SHOWS_AN_IMAGE), "the new page shows an image", 20)
    wait_for(lambda: lab.counter() > sets, "it goes on, and its counter", 20)
    lab.drag(60, 25)
    expected = turned(home, 60, 25).position
    wait_for(lambda: np.allclose(lab.camera().position, expected), "the drag turns it", 20)
    wait_for(lambda: 0 < lab.counter() < sets, "the image of the new camera begins", 20)
    lab.press("Reset")
    wait_for(lambda: np.allclose(lab.camera().position, home.position), "it is back", 20)
    wait_for(lambda: lab.counter() > 0, "and goes on", 20)
    assert lab.complaints() == []


def test_the_view_takes_keys_and_says_what_it_is(notebook: OpenNotebook) -> None:
    """Tab reaches it; and Jupyter's own shortcuts, by which R makes a cell raw, do not hear what it takes."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.keys import Keys

    lab = notebook(CELL)
    lab.converged()
    home = lab.camera()
    image = lab.driver.find_element("css selector", ".renderview-wrapper img")
    assert image.accessible_name.startswith("cornell-box, 256 x 192 pixels, by path, up to 24 path sets. Arrow")
    assert image.aria_role == "application"
    lab.driver.find_element("xpath", "//button[contains(., 'Save')]").send_keys(Keys.TAB)
    assert lab.driver.switch_to.active_element == image

    def press(*keys: str) -> None:
        chain = ActionChains(lab.driver)
        for key in keys:
            chain.send_keys(key)
        chain.perform()

    def sees(camera: glpath.scene.Camera, what: str) -> None:
        wait_for(lambda: np.allclose(lab.camera().position, camera.position), what, 20)

    press(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_DOWN)
    sees(turned(home, 50, 25), "the arrows turn it")
    press("+", "+", "-")
    sees(nearer(turned(home, 50, 25), -1), "it comes nearer")
    press("r")
    sees(home, "R resets it")
    lab.drag(25, 0)  # from here on the keys come by the library's own input
    press(Keys.ARROW_LEFT)
    sees(home, "an arrow turns it back")
    cells = "return [...document.querySelectorAll('.jp-Cell')].map(c => c.className.includes('jp-CodeCell'))"
    assert all(lab.driver.execute_script(cells)), "no shortcut has made a cell raw"
    assert lab.complaints() == []


def test_a_film_is_one_picture_and_has_words(notebook: OpenNotebook) -> None:
    """Shown as it converges, and by the cell's last line; what a reader of the screen says is in the page."""
    lab = notebook(
        "import glpath\n"
        "film = glpath.render('cornell-box', resolution=(64, 48), spp=8, max_depth=1, progress=True)\n"
        "film",
        "return document.querySelector('.jp-OutputArea-executeResult img')?.naturalWidth === 64",
    )
    images = lab.driver.find_elements("css selector", ".jp-OutputArea img")
    assert [image.accessible_name for image in images] == ["cornell-box, by path, 8 path sets, 64 x 48 pixels"]
    assert lab.complaints() == []


def test_the_view_turns_while_a_cell_renders(notebook: OpenNotebook) -> None:
    """Where widgets have a thread of their own, that and the cell's take turns."""
    lab = notebook(CELL)
    lab.converged()
    home, exposure = lab.camera(), float(lab.ask("print(shown.exposure)"))
    render = "glpath.render('cornell-box', resolution=(64, 64), spp=20000, max_depth=2)"
    lab.start(
        f"import contextlib, glpath\nwith contextlib.suppress(KeyboardInterrupt):\n    {render}\nopen('ended', 'w')"
    )
    lab.drag(60, 25)
    camera = turned(home, 60, 25)
    wait_for_film(lab, camera, exposure)
    assert not (lab.folder / "ended").exists(), "the render had ended before"
    lab.interrupt()
    assert lab.complaints() == []


@pytest.mark.timed
def test_frames_a_second_while_dragging(notebook: OpenNotebook) -> None:
    """At the size of a shipped scene, 512 x 512, and half of it; printed with -s."""
    for scene, size in (("cornell-box", 256), ("cornell-box", 512), ("three-spheres", 512)):
        lab = notebook(
            f"from glpath.notebook import view\nshown = view('{scene}', resolution=({size}, {size}))\nshown"
        )
        wait_for(lambda lab=lab: int(lab.ask("print(shown.path_sets)")) > 2, "it renders")
        rate = lab.driver.execute_async_script(CIRCLE, 4)
        shape = lab.picture().shape[1::-1]
        print(f"{scene}, {size} x {size}: {rate:.1f} frames a second of {shape[0]} x {shape[1]} pixels")
        assert rate > 1
        assert lab.complaints() == []
