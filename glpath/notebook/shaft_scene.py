"""Widget and figures of the shaft between two shapes and its candidate occluders (shaft culling)."""

from __future__ import annotations

import io
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import ipywidgets
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.accel.bvh import build_bvh
from glpath.accel.nodes import Bvh
from glpath.errors import UsageError
from glpath.film.charts import BLUE, GREEN, GREY, INK, ORANGE, PALE, PURPLE, require_matplotlib
from glpath.io import AnyScene, load_scene
from glpath.notebook.show import error_html, with_picture
from glpath.radiosity import Occluders, Shaft, Strategy, candidate_list
from glpath.scene import Scene
from glpath.system.arguments import short_repr

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]


@dataclass(frozen=True)
class Candidates:
    """Candidate occluders in the shaft between two shapes.

    shaft    : shaft between the boxes of the two shapes
    nodes    : (n,) int32, BVH nodes of the candidate list: leaves (single polygons), and inner nodes that the
               strategy left unopened (closed boxes)
    boxes    : (b, 6) bounds of the closed boxes
    polygons : (p,) int32, indices of the polygons on the list, single or in closed boxes, without those of the two
               shapes
    others   : number of polygons in the scene, without those of the two shapes
    """

    shaft: Shaft
    nodes: Int32
    boxes: Float64
    polygons: Int32
    others: int


@dataclass(frozen=True)
class ShaftScene:
    """Polygons of a scene and their BVH, for finding the candidate occluders of shafts.

    Raises UsageError for a scene without triangles, because spheres and planes are not polygons.
    """

    scene: Scene
    occluders: Occluders = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "occluders", Occluders.of_scene(self.scene))
        if not len(self.occluders.corners):
            raise UsageError(f"{self.scene.name}: has no triangles, and shafts cull polygons.")

    @cached_property
    def tree(self) -> Bvh:
        """BVH with one polygon in every leaf."""
        return build_bvh(*self.occluders.boxes(), leaf_size=1)

    @property
    def shapes(self) -> list[str]:
        """Names of the shapes that have polygons."""
        return list(dict.fromkeys(self.scene.shapes[i].name for i in np.unique(self.occluders.shape)))

    def outlines(self) -> list[Float64]:
        """Return the corners of every polygon, each (3, 3) or (4, 3)."""
        return [
            np.array([a, b, b + c - a, c] if four else [a, b, c])
            for (a, b, c), four in zip(self.occluders.corners, self.occluders.parallelogram, strict=True)
        ]

    def polygons_of(self, shape: str) -> Int32:
        """Return the indices of the polygons of all shapes of a name. Raises UsageError for an unknown name."""
        if shape not in self.shapes:
            known = self.shapes
            raise UsageError(
                f"{self.scene.name}: no shape of polygons is named {short_repr(shape)}.",
                f"There are {', '.join(known[:12])}{', ...' if len(known) > 12 else ''}.",
            )
        named = [number for number, each in enumerate(self.scene.shapes) if each.name == shape]
        return np.flatnonzero(np.isin(self.occluders.shape, named)).astype(np.int32)

    def box_of(self, shape: str) -> Float64:
        """Return the (6,) bounding box of a shape: lower corner, upper corner."""
        corners = np.concatenate([self.outlines()[i] for i in self.polygons_of(shape)])
        return np.concatenate([corners.min(axis=0), corners.max(axis=0)])

    def between(
        self, emitter: str, receiver: str, strategy: Strategy = Strategy.RATIO_OPEN, ratio: float = 0.4
    ) -> Candidates:
        """Return the candidate occluders between two shapes, which are given by name.

        strategy, ratio : treatment of boxes that are not outside the shaft, see `Strategy`
        """
        shaft = Shaft.between(self.box_of(emitter), self.box_of(receiver))
        nodes = candidate_list(self.tree, shaft, strategy, ratio=ratio)
        closed = nodes[self.tree.count[nodes] == 0]
        boxes = np.concatenate([self.tree.lower[closed], self.tree.upper[closed]], axis=1)
        own = np.concatenate([self.polygons_of(emitter), self.polygons_of(receiver)])
        found = np.concatenate([np.zeros(0, np.int32), *(self.tree.items(int(node)) for node in nodes)])
        polygons = np.setdiff1d(found, own).astype(np.int32)
        return Candidates(shaft, nodes, boxes, polygons, len(self.occluders.corners) - len(own))

    def draw(
        self, emitter: str, receiver: str, strategy: Strategy = Strategy.RATIO_OPEN, ratio: float = 0.4
    ) -> Figure:
        """Return a matplotlib figure of the shaft between two shapes, from above and in 3D.

        The shaft is blue, candidates are purple, the emitter is orange, the receiver green, and the rest grey.
        """
        require_matplotlib()
        from matplotlib.figure import Figure

        found = self.between(emitter, receiver, strategy, ratio)
        up = int(np.abs(self.scene.camera.up).argmax())
        # Order of the figure's axes: right-handed, with the scene's up axis last.
        axes = [(up + 1) % 3, (up + 2) % 3, up]
        figure = Figure(figsize=(11, 4.6), layout="constrained")
        above = figure.add_subplot(1, 2, 1)
        solid: Any = figure.add_subplot(1, 2, 2, projection="3d")
        self._draw(above, solid, found, emitter, receiver, axes)
        share = len(found.polygons) / max(found.others, 1)
        boxes = f" and {len(found.boxes)} closed boxes" if len(found.boxes) else ""
        figure.suptitle(
            f"{emitter} to {receiver}, {strategy.name.lower().replace('_', ' ')}: a list of "
            f"{len(found.nodes) - len(found.boxes)} polygons{boxes}, with {len(found.polygons)} of the "
            f"{found.others} others on it ({share:.1%})",
            fontsize=10,
            color=INK,
        )
        return figure

    def _draw(
        self, above: Any, solid: Any, found: Candidates, emitter: str, receiver: str, axes: list[int]
    ) -> None:
        from matplotlib.collections import PolyCollection
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

        outlines = [o[:, axes] for o in self.outlines()]
        of = {name: set(self.polygons_of(name).tolist()) for name in (emitter, receiver)}
        listed = set(found.polygons.tolist())
        hull = [f[:, axes] for f in faces(shaft_planes(found.shaft)) if len(f)]
        rest = [i for i in range(len(outlines)) if i not in listed | of[emitter] | of[receiver]]
        large = _large(outlines)
        layers = (
            ([outlines[i] for i in rest], GREY, 0.12, 0.4),
            (hull, BLUE, 0.10, 0.8),
            ([outlines[i] for i in sorted(listed)], PURPLE, 0.55, 0.8),
            ([outlines[i] for i in sorted(of[receiver])], GREEN, 0.45, 1.0),
            ([outlines[i] for i in sorted(of[emitter])], ORANGE, 0.9, 1.0),
        )
        for order, (polygons, colour, alpha, width) in enumerate(layers):
            # Walls, floor and ceiling are left out, because they would hide the interior.
            within = [p for p, wall in zip(polygons, _are(polygons, large), strict=True) if not wall]
            style: dict[str, Any] = {"edgecolor": colour, "linewidth": width, "zorder": order + 1}
            above.add_collection(PolyCollection([p[:, :2] for p in within], facecolor=colour, alpha=alpha, **style))
            solid.add_collection3d(Poly3DCollection(within, facecolor=colour, alpha=alpha, **style))
        for box in found.boxes:
            corners = box_corners(box)[:, axes]
            low, high = corners.min(axis=0), corners.max(axis=0)
            above.plot(*_rectangle(low[:2], high[:2]), color=PURPLE, linewidth=1.2, linestyle="--", zorder=7)
        points = np.concatenate(outlines)
        low, high = points.min(axis=0), points.max(axis=0)
        above.set_xlim(low[0], high[0])
        above.set_ylim(low[1], high[1])
        above.set_aspect("equal")
        above.set_xlabel("xyz"[axes[0]])
        above.set_ylabel("xyz"[axes[1]])
        above.set_facecolor("white")
        for spine in above.spines.values():
            spine.set_color(PALE)
        solid.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        solid.set_box_aspect(high - low, zoom=1.25)
        solid.view_init(elev=38, azim=-60)
        solid.set_axis_off()


def _extent(polygon: Float64) -> float:
    return float(np.linalg.norm(np.ptp(polygon, axis=0)))


def _large(outlines: list[Float64]) -> float:
    """Return half of the scene's diagonal, the minimum size of a wall."""
    return 0.5 * _extent(np.concatenate(outlines))


def _are(polygons: list[Float64], large: float) -> list[bool]:
    return [_extent(p) > large and len(p) == 4 and np.ptp(p, axis=0).min() < 1e-6 * large for p in polygons]


def _rectangle(low: Float64, high: Float64) -> tuple[list[float], list[float]]:
    return [low[0], high[0], high[0], low[0], low[0]], [low[1], low[1], high[1], high[1], low[1]]


def box_planes(box: ArrayLike) -> Float64:
    """Return the (6, 4) planes of a box (lower corner, upper corner): outward normal and distance.

    Points x inside the box have normal . x + distance <= 0.
    """
    b = np.asarray(box, float)
    return np.column_stack([np.vstack([-np.eye(3), np.eye(3)]), np.concatenate([b[:3], -b[3:]])])


def box_corners(box: ArrayLike) -> Float64:
    """Return the (8, 3) corners of a box (lower corner, upper corner)."""
    b = np.asarray(box, float)
    return np.array([[b[x], b[y], b[z]] for x in (0, 3) for y in (1, 4) for z in (2, 5)])


def shaft_planes(shaft: Shaft) -> Float64:
    """Return (6 + P, 4) planes: the faces of the extent box, then the plane set."""
    return np.concatenate([box_planes(shaft.extent), shaft.planes])


def faces(planes: Float64) -> list[Float64]:
    """Return the face in each plane as (n, 3) corners in order around it; no corners if the plane is redundant.

    planes : (P, 4), which together bound a volume
    """
    unit = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    return [_face(unit, i) for i in range(len(unit))]


def _face(unit: Float64, i: int) -> Float64:
    """Return a large square in the plane, clipped by all other planes [Sutherland and Hodgman 1974]."""
    normal, half = unit[i, :3], 1e3
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    polygon = [-unit[i, 3] * normal + half * (x * u + y * v) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for j, plane in enumerate(unit):
        if j == i or not polygon:
            continue
        heights = [float(plane[:3] @ p + plane[3]) for p in polygon]
        cut = []
        for k, (p, h) in enumerate(zip(polygon, heights, strict=True)):
            q, g = polygon[k - 1], heights[k - 1]
            if (g <= 1e-9) != (h <= 1e-9):
                cut.append(q + (p - q) * (g / (g - h)))
            if h <= 1e-9:
                cut.append(p)
        polygon = cut
    corners = np.array(polygon).reshape(-1, 3)
    # Drop repeated corners. A plane that only touches the volume then has fewer than three corners, so no face.
    apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 1e-7
    corners = corners[apart]
    return corners if len(corners) >= 3 else np.zeros((0, 3))


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
