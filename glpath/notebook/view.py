"""Widget that shows a scene, rotates it with the mouse, and has buttons.

JupyterLab from 4.4 on sends messages of a widget's browser half to a separate kernel thread (a subshell of
ipykernel 7), so that widgets work while a cell runs. Older versions send them to the main thread, where cells run.
So everything that changes a view holds its lock, and all drawing is done in the event loop that receives browser
events. The OpenGL context is always acquired before the lock, so that threads cannot deadlock. It is held for short
periods, alternating with renders.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, Literal, Unpack

import ipywidgets
import numpy as np
import traitlets
from jupyter_rfb import RemoteFrameBuffer
from numpy.typing import NDArray

from glpath.errors import SceneError, UsageError
from glpath.film import image
from glpath.film.film import Film
from glpath.film.tonemap import auto_exposure, check_tonemap, tonemap
from glpath.gl.context import open_context
from glpath.integrators.by_name import Integrator, IntegratorKeywords
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.notebook.live import LiveImage
from glpath.notebook.show import error_html, message_html, with_picture
from glpath.rendering.job import describe
from glpath.rendering.options import with_options
from glpath.scene import Camera, Scene, path_traceable
from glpath.system.colour import check_exposure
from glpath.system.interactive import in_notebook
from glpath.system.private_interfaces import rfb_page

UInt8 = NDArray[np.uint8]

#: Seconds of rendering for the first image; pages without a kernel show this image.
_FIRST_SECONDS = 0.5
#: Seconds between two progress texts.
_WORD_SECONDS = 0.25
#: Drag distance in pixels that one press of an arrow key stands for; it rotates the camera by ten degrees.
_PIXELS_PER_KEY = 25
#: Drag direction of the arrow keys: right, down.
_ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, -1), "ArrowDown": (0, 1)}
#: Wheel notches by key: + and -, and = and _, which many keyboards have on the same keys.
_NOTCHES = {"+": -1, "=": -1, "-": 1, "_": 1}
_KEYS_HELP = "Arrow keys turn it, with Shift they shift it; + and - go nearer and back; R resets it."
_SCRIPT = Path(__file__).with_name("canvas.js")
_FOCUSED = "\n.renderview-view:focus-visible { outline: 2px solid var(--jp-brand-color1, #1976d2); }\n"


@with_options(run=False)
def view(
    scene: AnyScene,
    *,
    integrator: Integrator | IntegratorSettings | None = None,
    spp: int | None = None,
    resolution: tuple[int, int] | None = None,
    parameters: Mapping[str, object] | None = None,
    exposure: float | Literal["auto"] | None = None,
    tonemap: str = "srgb",
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    **options: Unpack[IntegratorKeywords],
) -> View:
    """Return an image of the scene that rotates with the mouse, and converges while the camera rests.

    Drag to rotate around the camera's target; with shift or the right button, drag to translate. The wheel moves
    nearer; a double click, or Reset, restores the scene's camera. After a click or Tab, keys do the same: arrows
    rotate, with shift they translate; + and - move nearer and back; R resets. Stop freezes the image. Save writes a
    PNG into the current folder, after a first path set. `view(...).scene` is the scene with the current camera, for
    rendering; `view(...).film` is the current film. Moving objects are shown as when the shutter opens. While the
    camera moves, the image has a half or a quarter of the pixels along a side.

    Parameters
    ----------
    scene      : file, name of a shipped scene, or `Scene`
    integrator : as for `glpath.render`; None: "path" for scenes that it can render, otherwise "t-buffer", whose
                 shadow-buffers are kept while the camera moves
    spp        : number of path sets of a converged image; default as for `glpath.render`
    resolution : (width, height) in pixels instead of the scene's
    exposure, tonemap : as for `Film.save`; the result of "auto" for the first image is kept when the camera moves
    {options}

    Raises the errors of `glpath.render`, and UsageError for unknown options.

    Poor at: many pixels in software. While a cell renders, both alternate every half second. If the kernel has no
             subshells (ipykernel below 7, JupyterLab below 4.4), the image does not change while a cell runs.
    """
    check_tonemap(tonemap)
    check_exposure(exposure)
    loaded = load_scene(scene, parameters).at()
    chosen = integrator or _integrator(loaded)
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    if integrator is None and chosen == "path":
        given = {"guide": "cosine"} | given  # no guide, because its radiosity solution would delay the first image
    if chosen in ("t-buffer", "classic") and "shadows" not in given:
        given = {"shadows": "cube", "shadow_resolution": 512} | given
    job, loaded = describe(loaded, integrator=chosen, spp=spp, resolution=resolution, **given)
    context = open_context(backend, device, require_gpu, probe_first=in_notebook())
    with context:
        live = LiveImage(job, loaded, context)
    asked = loaded.exposure if exposure is None else exposure
    return View(live, None if asked is None or asked == "auto" else float(asked), tonemap)


class View(ipywidgets.VBox):  # type: ignore[misc]  # ipywidgets has no type annotations
    """Widget that `view` returns.

    scene     : scene with the current camera
    film      : current film
    path_sets : number of path sets in the image
    spp       : number of path sets of a converged image
    converged : True if the image has `spp` path sets
    exposure  : stops; None until the first image determines them
    """

    def __init__(self, live: LiveImage, exposure: float | None, tonemap: str) -> None:
        self._lock = threading.RLock()
        self._live: LiveImage | None = live
        self.exposure, self._tonemap = exposure, tonemap
        self._home = live.scene
        self._grip: tuple[float, float] | None = None  # last position of the pressed pointer
        self._loop: asyncio.AbstractEventLoop | None = None
        self._reported_at = -np.inf

        width, height = live.camera.resolution
        what = f"{live.scene.name}, {width} x {height} pixels, by {live.job.integrator.integrator}"
        self._canvas = _Canvas(self, f"{what}, up to {live.job.spp} path sets. {_KEYS_HELP}")
        self._canvas.css_width, self._canvas.css_height = f"{width}px", f"{height}px"
        layout = ipywidgets.Layout(width="6.5em")
        self._reset = ipywidgets.Button(description="Reset", icon="home", layout=layout)
        self._reset.tooltip = "Go back to the scene's camera"
        self._stop = ipywidgets.ToggleButton(description="Stop", icon="pause", layout=layout)
        self._stop.tooltip = "Hold the image as it is"
        self._save = ipywidgets.Button(description="Save", icon="save", layout=layout)
        self._save.tooltip = "Write a PNG into the present folder"
        self._word = ipywidgets.Label()
        self._message = ipywidgets.HTML()
        self._buttons = ipywidgets.HBox([self._reset, self._stop, self._save, self._word])
        super().__init__([self._buttons, self._canvas, self._message])
        self._reset.on_click(lambda button: self.reset())
        self._stop.observe(lambda change: self._hold(), names="value")
        self._save.on_click(lambda button: self._save_png())

    @property
    def scene(self) -> Scene:
        """Scene with the current camera."""
        return replace(self._home, camera=self._image.camera)

    @property
    def film(self) -> Film:
        """`Film` of the image's path sets, with its metadata; without path sets while the camera moves."""
        live = self._image
        with live.context, self._lock:
            return live.film

    @property
    def path_sets(self) -> int:
        """Number of path sets in the image; 0 while the camera moves."""
        return self._image.path_sets

    @property
    def spp(self) -> int:
        """Number of path sets of a converged image."""
        return self._image.job.spp

    @property
    def converged(self) -> bool:
        """True if nothing is left to do until the camera moves."""
        return self._image.converged

    def reset(self) -> None:
        """Restore the scene's camera, and continue if Stop was on; after an error, try again."""
        with self._lock:
            self._stop.value = False
            self._show(self._buttons, self._canvas, self._message)
            self._message.value = ""
            self._look(self._home.camera)

    def close(self) -> None:
        """Remove the widget from the page and free its device memory. It cannot be used afterwards."""
        if self._live is None:
            return
        # The context is acquired before the lock, as everywhere, so that threads cannot deadlock.
        with self._live.context, self._lock:
            self._live = None
            for widget in (self._canvas, *self._buttons.children, self._buttons, self._message):
                widget.close()
            super().close()

    def picture(self) -> UInt8:
        """Return the (H, W, 3) uint8 sRGB of the current image, with at least a few path sets."""
        live = self._image
        with live.context, self._lock:
            return self._toned(live.first(_FIRST_SECONDS))

    def _repr_mimebundle_(self, **options: Any) -> Any:
        png = image.encode_png(self.picture())
        width, height = self._image.camera.resolution
        sets = f"{self.path_sets} of {self.spp} path sets"
        engine = self._image.job.integrator.integrator
        text = f"<View of {self._home.name}: by {engine}, {width} x {height} pixels, {sets}>"
        return with_picture(super()._repr_mimebundle_(**options), png, text)

    @property
    def _image(self) -> LiveImage:
        if self._live is None:
            raise UsageError("view: is closed", "Make another one.")
        return self._live

    # Browser events, in the widget's thread. Errors are displayed, because they would be lost otherwise.

    def handle_event(self, event: Mapping[str, Any]) -> None:
        """Rotate, translate, zoom or reset for an event of jupyter_rfb; called by the widget."""
        with self._lock, self._shown():
            with suppress(RuntimeError):  # called outside of an event loop
                self._loop = asyncio.get_running_loop()
            if self._live is not None:
                self._handle(self._live.camera, event)

    def _handle(self, camera: Camera, event: Mapping[str, Any]) -> None:
        kind = event["event_type"]
        if kind == "pointer_down":
            self._grip = event["x"], event["y"]
        elif kind in ("pointer_move", "pointer_up") and self._grip is not None:
            dx, dy = event["x"] - self._grip[0], event["y"] - self._grip[1]
            self._grip = (event["x"], event["y"]) if kind == "pointer_move" else None
            if dx or dy:
                shifts = "Shift" in event.get("modifiers", ()) or 2 in event.get("buttons", ())
                self._look(shifted(camera, dx, dy) if shifts else turned(camera, dx, dy))
        elif kind == "wheel":
            self._look(nearer(camera, event["dy"] / 100))
        elif kind == "double_click":
            self.reset()
        elif kind == "key_down" and not {"Control", "Alt", "Meta"} & {*event.get("modifiers", ())}:
            self._press(camera, event["key"], "Shift" in event.get("modifiers", ()))

    def _press(self, camera: Camera, key: str, shifts: bool) -> None:
        if key in _ARROWS:
            right, down = (_PIXELS_PER_KEY * sign for sign in _ARROWS[key])
            self._look(shifted(camera, right, down) if shifts else turned(camera, right, down))
        elif key in _NOTCHES:
            self._look(nearer(camera, _NOTCHES[key]))
        elif key in ("r", "R"):
            self.reset()

    def _show(self, *widgets: ipywidgets.Widget) -> None:
        self.children = widgets

    def _look(self, camera: Camera) -> None:
        self._image.look_from(camera)
        self._redraw()

    def _hold(self) -> None:
        with self._lock, self._shown():
            self._image.stopped = self._stop.value
            self._redraw()

    def _save_png(self) -> None:
        with self._shown(ends=False):
            live = self._image
            with live.context, self._lock:
                # No image exists just after the camera has moved, or later while Stop is on.
                self._find_exposure(live.first(_FIRST_SECONDS))
                film = live.film
            path = _unused(self._home.name)
            film.save(path, exposure=self.exposure, tonemap=self._tonemap)
            self._message.value = message_html(f"Saved {path}: {film.path_sets} of {self.spp} path sets.")
            self._redraw()  # so that the page shows the saved image

    # Drawing.

    def _redraw(self) -> None:
        """Request a frame, in the event loop that receives browser events."""
        if self._loop is None:
            return  # no browser shows the widget yet; its first event sets `_loop`
        with suppress(RuntimeError):  # the loop is closed, because the page was reloaded
            self._loop.call_soon_threadsafe(self._canvas.request_draw)

    def draw(self) -> None:
        """Render for a short time, and send an image if there is a new one; called by the widget."""
        live = self._live
        if live is None:
            return
        with self._shown(), live.context, self._lock:
            if self._live is None:
                return
            radiance = live.step()
            if radiance is not None:
                self._canvas.send_frame(self._toned(radiance))
            self._report(live)
            if not live.idle:
                self._canvas.request_draw()

    def _toned(self, radiance: NDArray[np.float64]) -> UInt8:
        return tonemap(radiance, self._find_exposure(radiance), self._tonemap)

    def _find_exposure(self, radiance: NDArray[np.float64]) -> float:
        if self.exposure is None:
            self.exposure = auto_exposure(radiance)
        return self.exposure

    def _report(self, live: LiveImage) -> None:
        now = time.perf_counter()
        if live.idle or now - self._reported_at > _WORD_SECONDS:
            self._reported_at = now
            self._word.value = f"{live.path_sets} of {live.job.spp} path sets"

    @contextmanager
    def _shown(self, ends: bool = True) -> Iterator[None]:
        """Context that displays an error, below the view or, if `ends`, instead of it; the buttons stay."""
        try:
            yield
        except Exception as error:
            self._message.value = error_html(error)
            if ends:
                self._show(self._buttons, self._message)


class _Canvas(RemoteFrameBuffer):  # type: ignore[misc]  # jupyter_rfb has no type annotations
    """Image in the browser, with its pointer and key events.

    label : description of the image and its keys, for screen readers
    """

    _esm = f"const RFB = {json.dumps(rfb_page()[0])};\n{_SCRIPT.read_text('utf-8')}"
    _css = rfb_page()[1] + _FOCUSED
    label = traitlets.Unicode("").tag(sync=True)

    def __init__(self, owner: View, label: str) -> None:
        super().__init__(label=label)
        self._owner = owner
        self.resizable = False
        self.cursor = "grab"

    def get_frame(self) -> None:
        """Draw the view; return no frame, because the view sends the image itself while it holds its lock."""
        self._owner.draw()

    def handle_event(self, event: Mapping[str, Any]) -> None:
        """Pass on pointer and key events."""
        if event["event_type"] in ("show", "resize"):
            self._forget_lost_frames()
        self._owner.handle_event(event)

    def _forget_lost_frames(self) -> None:
        """Reset the frame counters, because a reloaded page shows none of the frames sent to its predecessor.

        Without the browser's acknowledgement of a frame, the library sends no further frames. A draw that waited in
        the event loop of the old page still counts as requested, so the library would request no other draw.
        """
        now = time.time()
        self._rfb_draw_requested = False
        self._frame_feedback = {"index": self._rfb_frame_index, "timestamp": now, "localtime": now}
        self.request_draw()


def _unused(name: str) -> Path:
    """Return an unused file name in the current folder for an image of this name."""
    stem = re.sub(r"[^\w.-]+", "-", name).strip(".-") or "view"
    for number in count(1):
        path = Path(f"{stem}.png" if number == 1 else f"{stem}-{number}.png")
        if not os.path.exists(path):
            return path
    raise AssertionError


def _integrator(scene: Scene) -> Integrator:
    """Return the default integrator for a scene: "path" if it can render the scene, otherwise "t-buffer"."""
    try:
        path_traceable(scene)
    except SceneError:
        return "t-buffer"
    return "path"


_DEGREES_PER_PIXEL = 0.4


_STEEPEST = 89.0


# Factor on the distance to the target for one notch of the mouse wheel.
_ZOOM_PER_NOTCH = 1.15


def turned(camera: Camera, right: float, down: float) -> Camera:
    """Return the camera rotated around its target, so that the scene follows the pointer.

    The camera stops below the pole.

    right, down : pointer motion, pixels
    """
    camera = camera.turned(-_DEGREES_PER_PIXEL * right)
    up = camera.up / np.linalg.norm(camera.up)
    arm = camera.position - camera.target
    length = np.linalg.norm(arm)
    height = np.degrees(np.arcsin(np.clip(arm @ up / length, -1, 1)))
    flat = arm - (arm @ up) * up
    direction = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 0 else camera.frame()[1]
    steepest = max(_STEEPEST, abs(height))
    angle = np.radians(np.clip(height + _DEGREES_PER_PIXEL * down, -steepest, steepest))
    position = camera.target + length * (np.cos(angle) * direction + np.sin(angle) * up)
    return replace(camera, position=position)


def shifted(camera: Camera, right: float, down: float) -> Camera:
    """Return the camera and its target translated so that the target's plane follows the pointer, in pixels."""
    to_right, up, _ = camera.frame()
    distance = float(np.linalg.norm(camera.target - camera.position))
    move = _pixel(camera, distance) * (down * up - right * to_right)
    return replace(camera, position=camera.position + move, target=camera.target + move)


def nearer(camera: Camera, notches: float) -> Camera:
    """Return the camera nearer to the target (notches < 0), or farther; it never reaches the target.

    An orthographic camera does not move; its image height changes instead.
    """
    if camera.projection == "orthographic":
        return replace(camera, height=camera.height * _ZOOM_PER_NOTCH**notches)
    arm = (camera.position - camera.target) * _ZOOM_PER_NOTCH**notches
    return replace(camera, position=camera.target + arm)


def _pixel(camera: Camera, distance: float) -> float:
    """Return the width of a pixel in the target's plane, scene units."""
    if camera.projection == "panorama":
        return distance * 2.0 * np.pi / camera.resolution[0]
    return (1.0 if camera.projection == "orthographic" else distance) / camera.focal
