"""Drawings of shafts, boxes and spheres: 2D sections, or 3D, in which the paper's Y is up, matplotlib's z."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.film.charts import BLUE, GREEN, GREY, INK, ORANGE, PALE, PURPLE
from glpath.notebook.shaft_scene import box_corners, box_planes, faces, shaft_planes
from glpath.radiosity import Shaft

Float64 = NDArray[np.float64]

VIEW = {"elev": 20, "azim": -62}


def flat_box(axes: Any, box: ArrayLike, colour: str, label: str = "", **style: Any) -> None:
    from matplotlib.patches import Rectangle

    b = np.asarray(box, float)
    kind: Any = {"facecolor": colour, "edgecolor": colour, "linewidth": 1.5, "alpha": 0.9, "zorder": 3} | style
    axes.add_patch(Rectangle((b[0], b[1]), b[3] - b[0], b[4] - b[1], **kind))
    if label:
        middle = (b[:3] + b[3:]) / 2
        # Text in a box without fill is on white.
        ink = INK if kind["facecolor"] in ("none", "white") else "white"
        axes.text(middle[0], middle[1], label, color=ink, fontsize=10, ha="center", va="center", zorder=6)


def frame(axes: Any, boxes: Float64, margin: float = 0.35) -> None:
    """Set limits around all boxes."""
    low, high = boxes[:, :2].min(axis=0) - margin, boxes[:, 3:5].max(axis=0) + margin
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])


def flat_shaft(axes: Any, shaft: Shaft) -> None:
    """Draw the shaft's section, which its planes along Z bound, and a line for each of these planes."""
    from matplotlib.patches import Polygon

    planes = shaft_planes(shaft)
    section = next(f for f, p in zip(faces(planes), planes, strict=True) if p[2] > 0 and len(f))
    axes.add_patch(Polygon(section[:, :2], facecolor="#DCEBF5", edgecolor="none", zorder=1))
    for plane in shaft.planes:
        ends = section[np.abs(section @ plane[:3] + plane[3]) < 1e-9]
        axes.plot(ends[:, 0], ends[:, 1], color=BLUE, linewidth=2, zorder=4)
        foot, normal = ends.mean(axis=0), plane[:3] / np.linalg.norm(plane[:3])
        tip = foot + 0.4 * normal
        axes.annotate(
            "", tip[:2], foot[:2], arrowprops={"arrowstyle": "-|>", "color": BLUE, "linewidth": 1.2}, zorder=5
        )


def _up(points: Float64) -> Float64:
    """Return x, z, y of points (N, 3)."""
    return points[:, [0, 2, 1]]


def solid_planes(
    axes: Any, planes: Float64, colour: str, alpha: float = 0.9, edge: str = "white", **style: Any
) -> None:
    _polygons(axes, faces(planes), colour, alpha=alpha, edgecolor=edge, **style)


def _polygons(axes: Any, polygons: Sequence[Float64], colour: str, **style: Any) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    kind = {"facecolor": colour, "linewidth": 0.8} | style
    axes.add_collection3d(Poly3DCollection([_up(f) for f in polygons if len(f)], **kind))


def wire(axes: Any, box: ArrayLike, colour: str = GREY, dashes: Any = (0, (4, 3)), width: float = 1.0) -> None:
    corners = box_corners(box)
    for i in range(8):
        for bit in (1, 2, 4):
            if not i & bit:
                ends = _up(corners[[i, i | bit]])
                axes.plot(*ends.T, color=colour, linestyle=dashes, linewidth=width)


def look(axes: Any, boxes: Float64, zoom: float = 1.0, **view: float) -> None:
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[2], high[2])
    axes.set_zlim(low[1], high[1])
    axes.set_box_aspect((high - low)[[0, 2, 1]], zoom=zoom)
    axes.view_init(**(VIEW | view))


def draw_shaft(axes: Any, shaft: Shaft, zoom: float = 1.0, **view: float) -> None:
    """Draw both boxes, the dashed extent box, the planes of the plane set, and the extent's faces between them."""
    planes = shaft_planes(shaft)
    look(axes, shaft.extent[None], zoom, **view)
    wire(axes, shaft.extent)
    # Draw from back to front: what is behind transparent planes must come first.
    solid_planes(axes, box_planes(shaft.box_b), GREEN)
    solid_planes(axes, box_planes(shaft.box_a), ORANGE)
    solid_planes(axes, planes[:6], PALE, 0.25, GREY, linewidth=0.4)
    _polygons(axes, faces(planes)[6:], BLUE, edgecolor=BLUE, linewidth=1.2, alpha=0.28)


def solid_sphere(axes: Any, centre: Float64, radius: float) -> None:
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi, 17))
    x, y, z = np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)
    c = centre[[0, 2, 1]]
    axes.plot_surface(
        c[0] + radius * x, c[1] + radius * y, c[2] + radius * z, color=PURPLE, alpha=0.55, linewidth=0, shade=False
    )
