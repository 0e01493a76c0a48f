"""In notebooks: a scene to turn with the mouse, and a shaft to choose.

    from glpath.notebook import explore_shafts, view
    view("three-spheres")
    explore_shafts("office")

Films and scenes show themselves without this module, and `glpath.render(..., progress=True)` shows an image while
it converges. Needs the extra: `pip install "glpath[jupyter]"`.
"""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath import image
from glpath.errors import GlpathError, SceneError
from glpath.figures.candidates import ShaftScene
from glpath.gl.context import Context, open_context
from glpath.integrators.settings import Integrator, IntegratorSettings
from glpath.interactive import in_notebook
from glpath.radiosity import Strategy
from glpath.rendering.factory import Engine, plan_of
from glpath.rendering.options import MAX_SPP, check_count, numbers, settings_of, with_options
from glpath.scene import AnyScene, Camera, Scene, check_camera, load_scene, path_traceable
from glpath.sensors import CameraSensor

try:
    import ipywidgets
    from jupyter_rfb import RemoteFrameBuffer
except ImportError as missing:
    raise GlpathError(
        f"glpath.notebook: {missing.name} is not installed, and the browser is reached by it.",
        'pip install "glpath[jupyter]"',
    ) from None

#: Seconds that a frame may take: while the mouse moves, and while it rests.
FRAME_SECONDS = {"moving": 1 / 15, "still": 1 / 4}

_DEGREES_PER_PIXEL = 0.4
_STEEPEST = 89.0
# A turn of the wheel by one notch is 100.
_ZOOM_PER_NOTCH = 1.15


@with_options
def view(
    scene: AnyScene,
    *,
    integrator: Integrator | IntegratorSettings | None = None,
    spp: int | None = None,
    resolution: tuple[int, int] | None = None,
    parameters: Mapping[str, object] | None = None,
    exposure: float = 0.0,
    tonemap: str = "srgb",
    backend: str = "auto",
    device: int | None = None,
    require_gpu: bool = False,
    **options: Any,
) -> View:
    """An image of the scene that turns with the mouse, and converges when it is left alone.

    Drag to turn about the camera's target, with shift or the right button to shift it; the wheel goes nearer; a
    double click goes back to the scene's camera. `view(...).scene` is the scene as it is seen now, to be rendered.

    Parameters
    ----------
    scene      : a file, the name of a shipped scene, or a `Scene`
    integrator : as of `glpath.render`; None takes "path" for scenes that it can render, else "t-buffer", whose
                 shadow-buffers are kept while the camera moves
    spp        : path sets until the image counts as converged; by default as of `glpath.render`
    resolution : (width, height) in pixels instead of the scene's
    exposure, tonemap : as of `Film.save`
    {options}

    Raises what `glpath.render` raises, and UsageError for options that it does not know.

    Poor at: many pixels in software; a frame is then a single path set. Kernels work one thing at a time: while a
    cell runs, the image stands still.
    """
    image.check_tonemap(tonemap)
    loaded = load_scene(scene, parameters)
    if resolution is not None:
        width, height = numbers("resolution", resolution, 2).astype(int).tolist()
        loaded = loaded.with_camera(resolution=(width, height))
        check_camera(loaded.camera, loaded.source or loaded.name)
    chosen = integrator or _integrator(loaded)
    if chosen in ("t-buffer", "classic") and options.get("shadows") is None:
        given = {name: value for name, value in options.items() if value is not None}
        options = {"shadows": "cube", "shadow_resolution": 512} | given
    settings = settings_of(chosen, options)
    spp = settings.default_spp if spp is None else spp
    check_count("spp", spp, 1, MAX_SPP)
    planned = plan_of(settings)
    traced = planned.traceable(loaded)
    planned = planned.prepared(traced, lambda stage: None)
    context = open_context(backend, device, require_gpu, probe_first=in_notebook())
    with context:
        engine = planned.engine(context, traced, (0, 0, *loaded.camera.resolution), False)
    return View(loaded, engine, context, spp, exposure, tonemap)


class View(RemoteFrameBuffer):  # type: ignore[misc]  # which has no types
    """The widget of `view`, which makes it.

    scene     : as it is seen now
    path_sets : in the image that is shown
    spp       : path sets at which it counts as converged
    """

    def __init__(
        self, scene: Scene, engine: Engine, context: Context, spp: int, exposure: float, tonemap: str
    ) -> None:
        super().__init__()
        self.scene = scene
        self.spp = spp
        self.path_sets = 0
        self._engine, self._context = engine, context
        self._shown = exposure, tonemap
        self._home = scene.camera
        width, height = scene.camera.resolution
        self._sum: NDArray[np.float64] = np.zeros((height, width, 3))
        self._moved = False
        self._grip: tuple[float, float] | None = None  # where the pointer was, while it is down
        self._seconds_per_set = FRAME_SECONDS["still"]
        self.css_width, self.css_height = f"{width}px", f"{height}px"
        self.resizable = False
        self.cursor = "grab"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """The widget, and for pages without a kernel its first image."""
        frame = self.get_frame() if not self.path_sets else image.tonemap(self._sum / self.path_sets, *self._shown)
        return _with_picture(super()._repr_mimebundle_(**options), image.encode_png(frame), f"<{self._text}>")

    @property
    def _text(self) -> str:
        width, height = self.scene.camera.resolution
        return f"View of {self.scene.name}: {width} x {height} pixels, {self.path_sets} of {self.spp} path sets"

    @property
    def converged(self) -> bool:
        """Nothing is left to do until the camera moves."""
        return not self._moved and self.path_sets >= self.spp

    def get_frame(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 sRGB: as many path sets more as the time for a frame holds. Called by the widget.

        In any thread: it waits while another one draws.
        """
        with self._context:
            return self._frame()

    def _frame(self) -> NDArray[np.uint8]:
        pace = "moving" if self._grip or self._moved else "still"
        if self._moved:
            self._engine.look_from(CameraSensor.of(self.scene.camera))
            self._engine.take()
            self._sum[:] = 0.0
            self.path_sets, self._moved = 0, False
        fitting = int(FRAME_SECONDS[pace] / max(self._seconds_per_set, 1e-6))
        count = min(max(1, fitting), self.spp - self.path_sets)
        if count > 0:
            begun = time.perf_counter()
            for index in range(self.path_sets, self.path_sets + count):
                self._engine.trace_path_set(index)
            self._sum += self._engine.take()
            self.path_sets += count
            self._seconds_per_set = (time.perf_counter() - begun) / count
        if not self.converged:
            self.request_draw()
        return image.tonemap(self._sum / self.path_sets, *self._shown)

    def handle_event(self, event: Mapping[str, Any]) -> None:
        """Turn, shift, come nearer, go back: by an event of jupyter_rfb; called by the widget."""
        kind = event["event_type"]
        if kind == "pointer_down":
            self._grip = event["x"], event["y"]
        elif kind == "pointer_up":
            self._grip = None
        elif kind == "pointer_move" and self._grip is not None:
            dx, dy = event["x"] - self._grip[0], event["y"] - self._grip[1]
            self._grip = event["x"], event["y"]
            shifts = "Shift" in event.get("modifiers", ()) or 2 in event.get("buttons", ())
            self._look(shifted(self.scene.camera, dx, dy) if shifts else turned(self.scene.camera, dx, dy))
        elif kind == "wheel":
            self._look(nearer(self.scene.camera, event["dy"] / 100))
        elif kind == "double_click":
            self._look(self._home)
        elif kind == "close":
            self._grip = None

    def _look(self, camera: Camera) -> None:
        self.scene = replace(self.scene, camera=camera)
        self._moved = True
        self.request_draw()


def _integrator(scene: Scene) -> Integrator:
    """The path tracer where it can; it says so of a scene where it can not."""
    try:
        path_traceable(scene)
    except SceneError:
        return "t-buffer"
    return "path"


def turned(camera: Camera, right: float, down: float) -> Camera:
    """The camera gone about its target as the pointer drags the scene by so many pixels; never over the pole."""
    up = camera.up / np.linalg.norm(camera.up)
    arm = camera.position - camera.target
    length = np.linalg.norm(arm)
    height = np.degrees(np.arcsin(np.clip(arm @ up / length, -1, 1)))
    flat = arm - (arm @ up) * up
    along = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 0 else camera.frame()[1]
    steepest = max(_STEEPEST, abs(height))
    angle = np.radians(np.clip(height + _DEGREES_PER_PIXEL * down, -steepest, steepest))
    around = np.radians(-_DEGREES_PER_PIXEL * right)
    direction = np.cos(around) * along + np.sin(around) * np.cross(up, along)
    position = camera.target + length * (np.cos(angle) * direction + np.sin(angle) * up)
    return replace(camera, position=position)


def shifted(camera: Camera, right: float, down: float) -> Camera:
    """The camera and its target moved so that the target's plane follows the pointer, pixels."""
    to_right, up, _ = camera.frame()
    distance = float(np.linalg.norm(camera.target - camera.position))
    move = distance / camera.focal * (down * up - right * to_right)
    return replace(camera, position=camera.position + move, target=camera.target + move)


def nearer(camera: Camera, notches: float) -> Camera:
    """The camera on its way to the target (notches < 0), or back; it never arrives."""
    arm = (camera.position - camera.target) * _ZOOM_PER_NOTCH**notches
    return replace(camera, position=camera.target + arm)


def _with_picture(bundle: Any, png: bytes, text: str) -> Any:
    """A widget's own mimebundle, data alone or with metadata, and what to show where no kernel is."""
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    data |= {"text/plain": text, "image/png": base64.b64encode(png).decode()}
    return bundle


def explore_shafts(scene: AnyScene, parameters: Mapping[str, object] | None = None) -> ShaftExplorer:
    """A figure of the shaft between two shapes and who can stand in it [SC]: choose the shapes and the strategy.

    scene : with triangles; see `glpath.figures.candidates.ShaftScene`, which draws the same without widgets

    Cost: the first time kernels are compiled, up to a minute; then well under a second an image.
    """
    return ShaftExplorer(ShaftScene(load_scene(scene, parameters)))


class ShaftExplorer(ipywidgets.VBox):  # type: ignore[misc]  # which has no types
    """The widget of `explore_shafts`.

    emitter, receiver, strategy, ratio : ipywidgets; set their `value` to see another shaft
    picture : an ipywidgets.Image with the PNG
    """

    def __init__(self, shafts: ShaftScene) -> None:
        self._shafts = shafts
        names = shafts.shapes
        lamps = [s.name for s in shafts.scene.shapes if s.emits and s.name in names]
        wide = ipywidgets.Layout(width="230px")
        first, last = (lamps or names)[0], names[-1]
        self.emitter = ipywidgets.Dropdown(options=names, value=first, description="emitter", layout=wide)
        self.receiver = ipywidgets.Dropdown(options=names, value=last, description="receiver", layout=wide)
        self.strategy = ipywidgets.Dropdown(
            options=[(s.name.lower().replace("_", " "), s) for s in Strategy],
            value=Strategy.RATIO_OPEN,
            description="strategy",
            layout=wide,
        )
        self.ratio = ipywidgets.FloatSlider(
            value=0.4, min=0.0, max=1.0, step=0.05, description="ratio", layout=wide
        )
        self.picture = ipywidgets.Image(format="png")
        chosen = (self.emitter, self.receiver, self.strategy, self.ratio)
        super().__init__([ipywidgets.HBox(chosen), self.picture])
        for each in chosen:
            each.observe(self._draw, names="value")
        self._draw()

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """The widget, and for pages without a kernel its image."""
        png = bytes(self.picture.value)
        text = f"<ShaftExplorer: {self.emitter.value} to {self.receiver.value}>"
        return _with_picture(super()._repr_mimebundle_(**options), png, text)

    def _draw(self, change: object = None) -> None:
        figure = self._shafts.draw(self.emitter.value, self.receiver.value, self.strategy.value, self.ratio.value)
        with io.BytesIO() as file:
            figure.savefig(file, format="png", dpi=90)
            self.picture.value = file.getvalue()
