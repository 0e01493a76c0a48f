"""Widget for choosing a shaft and viewing its candidate occluders (shaft culling)."""

from __future__ import annotations

import io
import threading
from collections.abc import Mapping
from typing import Any

import ipywidgets

from glpath.io import AnyScene, load_scene
from glpath.notebook.shaft_scene import ShaftScene
from glpath.notebook.show import error_html, with_picture
from glpath.radiosity import Strategy


def explore_shafts(scene: AnyScene, parameters: Mapping[str, object] | None = None) -> ShaftExplorer:
    """Return a widget that shows the shaft between two shapes and its candidate occluders (shaft culling).

    The shapes and the strategy can be chosen.

    scene : scene with triangles; `glpath.notebook.shaft_scene.ShaftScene` draws the same without widgets

    Cost: up to a minute the first time, when kernels are compiled; then well under a second an image.
    """
    return ShaftExplorer(ShaftScene(load_scene(scene, parameters)))


class ShaftExplorer(ipywidgets.VBox):  # type: ignore[misc]  # ipywidgets has no type annotations
    """Widget of `explore_shafts`.

    emitter, receiver, strategy, ratio : ipywidgets; set their `value` to view another shaft
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
        self._message = ipywidgets.HTML()
        self._lock = threading.Lock()  # the browser and a cell may change values at the same time
        chosen = (self.emitter, self.receiver, self.strategy, self.ratio)
        super().__init__([ipywidgets.HBox(chosen), self.picture, self._message])
        self._draw()
        for each in chosen:
            each.observe(self._chosen, names="value")

    def _repr_mimebundle_(self, **options: Any) -> Any:
        png = bytes(self.picture.value)
        return with_picture(super()._repr_mimebundle_(**options), png, f"<ShaftExplorer: {self._described()}>")

    def _described(self) -> str:
        scene, strategy = self._shafts.scene.name, self.strategy.label
        return f"the shaft from {self.emitter.value} to {self.receiver.value} of {scene}, {strategy}"

    def _chosen(self, change: object) -> None:
        with self._lock:
            self._message.value = ""
            try:
                self._draw()
            except Exception as error:
                self._message.value = error_html(error)

    def _draw(self) -> None:
        figure = self._shafts.draw(self.emitter.value, self.receiver.value, self.strategy.value, self.ratio.value)
        with io.BytesIO() as file:
            figure.savefig(file, format="png", dpi=90)
            self.picture.value = file.getvalue()
        self.picture.tooltip = f"Figure of {self._described()}"  # text alternative of the image
