"""Figures 1 to 4 and table 1 of the shaft paper [SC]: how a shaft is formed, and what it saves.

Figures 1 to 4 are lost in the text of the paper, and are drawn from what it says of them: in 2D (a section, in
which all boxes are equally deep) and in 3D. All that is drawn is read off `Shaft` and `candidate_list`.

[SC] E. Haines, J. Wallace, "Shaft culling for efficient ray-cast radiosity", Eurographics Workshop on Rendering,
1991.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.bvh import Bvh
from glpath.experiments.office_table import OFFICES, savings_rows, table_1_rows
from glpath.experiments.verdict import Condition
from glpath.figures.outcome import Outcome, Rows, Say, judged
from glpath.figures.polyhedron import box_corners, box_planes, faces, farthest_gap, shaft_planes, volume
from glpath.figures.style import BLUE, GREEN, GREY, INK, ORANGE, PALE, PURPLE, drawings, table
from glpath.radiosity import Place, Shaft, Strategy, candidate_list
from glpath.radiosity.shafts.shaft import FACES

Float64 = NDArray[np.float64]
Panel = tuple[str, Callable[[Any], None], bool]

AXES = "XYZ"
VIEW = {"elev": 20, "azim": -62}


_outcome = partial(judged, with_gl=False)


# Drawing. In 3D the paper's Y is up, which is matplotlib's z.


def _flat_box(axes: Any, box: ArrayLike, colour: str, label: str = "", **style: Any) -> None:
    from matplotlib.patches import Rectangle

    b = np.asarray(box, float)
    kind: Any = {"facecolor": colour, "edgecolor": colour, "linewidth": 1.5, "alpha": 0.9, "zorder": 3} | style
    axes.add_patch(Rectangle((b[0], b[1]), b[3] - b[0], b[4] - b[1], **kind))
    if label:
        middle = (b[:3] + b[3:]) / 2
        # Without a face, letters stand on white.
        ink = INK if kind["facecolor"] in ("none", "white") else "white"
        axes.text(middle[0], middle[1], label, color=ink, fontsize=10, ha="center", va="center", zorder=6)


def _frame(axes: Any, boxes: Float64, margin: float = 0.35) -> None:
    """Limits around everything."""
    low, high = boxes[:, :2].min(axis=0) - margin, boxes[:, 3:5].max(axis=0) + margin
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])


def _flat_shaft(axes: Any, shaft: Shaft) -> None:
    """The shaft's section, which is where all of its planes along Z are kept, and a line for each of these."""
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
    """x, z, y: of points (N, 3)."""
    return points[:, [0, 2, 1]]


def _solid(axes: Any, planes: Float64, colour: str, alpha: float = 0.9, edge: str = "white", **style: Any) -> None:
    _polygons(axes, faces(planes), colour, alpha=alpha, edgecolor=edge, **style)


def _polygons(axes: Any, polygons: Sequence[Float64], colour: str, **style: Any) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    kind = {"facecolor": colour, "linewidth": 0.8} | style
    axes.add_collection3d(Poly3DCollection([_up(f) for f in polygons if len(f)], **kind))


def _wire(axes: Any, box: ArrayLike, colour: str = GREY, dashes: Any = (0, (4, 3)), width: float = 1.0) -> None:
    corners = box_corners(box)
    for i in range(8):
        for bit in (1, 2, 4):
            if not i & bit:
                ends = _up(corners[[i, i | bit]])
                axes.plot(*ends.T, color=colour, linestyle=dashes, linewidth=width)


def _look(axes: Any, boxes: Float64, zoom: float = 1.0, **view: float) -> None:
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[2], high[2])
    axes.set_zlim(low[1], high[1])
    axes.set_box_aspect((high - low)[[0, 2, 1]], zoom=zoom)
    axes.view_init(**(VIEW | view))


def _draw_shaft(axes: Any, shaft: Shaft, zoom: float = 1.0, **view: float) -> None:
    """The two boxes, the extent box in dashes, the planes of the plane set, and between them the extent's faces."""
    planes = shaft_planes(shaft)
    _look(axes, shaft.extent[None], zoom, **view)
    _wire(axes, shaft.extent)
    # From back to front: what is far behind the transparent planes has to be there first.
    _solid(axes, box_planes(shaft.box_b), GREEN)
    _solid(axes, box_planes(shaft.box_a), ORANGE)
    _solid(axes, planes[:6], PALE, 0.25, GREY, linewidth=0.4)
    _polygons(axes, faces(planes)[6:], BLUE, edgecolor=BLUE, linewidth=1.2, alpha=0.28)


# Numbers


def _box_row(what: str, box: ArrayLike, note: str = "") -> dict[str, Any]:
    names = ("lo.x", "lo.y", "lo.z", "hi.x", "hi.y", "hi.z")
    values = dict(zip(names, np.asarray(box, float).tolist(), strict=True))
    return {"what": what, **values, **dict.fromkeys(("n.x", "n.y", "n.z", "distance")), "note": note}


def _shaft_rows(shaft: Shaft, name: str, a: str = "emitter", b: str = "receiver") -> Rows:
    rows = [
        _box_row(f"{name} {a}", shaft.box_a, " ".join(shaft.faces_a)),
        _box_row(f"{name} {b}", shaft.box_b, " ".join(shaft.faces_b)),
        _box_row(f"{name} extent box", shaft.extent),
    ]
    for plane, near, far in zip(shaft.planes, shaft.near, shaft.far, strict=True):
        row = _box_row(f"{name} plane", np.zeros(6), _edge(plane))
        row |= dict.fromkeys(("lo.x", "lo.y", "lo.z", "hi.x", "hi.y", "hi.z"))
        row |= dict(zip(("n.x", "n.y", "n.z", "distance"), plane.tolist(), strict=True))
        words = [" ".join(FACES[f] for f in corner) for corner in (near, far)]
        rows.append(row | {"note": f"{row['note']}; near {words[0]}; far {words[1]}"})
    return rows


def _edge(plane: Float64) -> str:
    """The culled edge of a plane, such as "MIN_X--MAX_Y": its normal points there."""
    return "--".join(f"{'MAX' if plane[k] > 0 else 'MIN'}_{AXES[k]}" for k in range(3) if plane[k])


def _too_large(shaft: Shaft, count: int, seed: int = 1) -> float:
    """By how much the shaft sticks out of the hull of its boxes, in any of so many directions; 0 for not at all."""
    hull = np.concatenate([box_corners(shaft.box_a), box_corners(shaft.box_b)])
    own = np.concatenate([f for f in faces(shaft_planes(shaft)) if len(f)])
    ways = np.random.default_rng(seed).normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return float(np.abs((own @ ways.T).max(axis=0) - (hull @ ways.T).max(axis=0)).max())


# Figure 1


def figure_1(scale: float, say: Say) -> Outcome:
    """Shaft formation: reference boxes, extent box with its culled edges, planes [SC, figure 1]."""
    emitter, receiver = np.array([1.4, 2.6, 0, 2.6, 3.2, 2.0]), np.array([0, 0, 0, 4.2, 0.8, 2.0])
    shaft = Shaft.between(emitter, receiver)
    deep = Shaft.between([1.4, 2.6, 0.7, 2.6, 3.2, 1.5], [0, 0, 0, 4.2, 0.8, 2.6])
    edges = [_edge(p) for p in shaft.planes]

    def boxes(axes: Any) -> None:
        _flat_box(axes, emitter, ORANGE, "emitter")
        _flat_box(axes, receiver, GREEN, "receiver")
        _frame(axes, shaft.extent[None], 0.45)

    def extent(axes: Any) -> None:
        boxes(axes)
        _flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)
        # Each list beside the faces it is of.
        middle = (shaft.extent[:2] + shaft.extent[3:5]) / 2
        for listed, colour in ((shaft.faces_a, ORANGE), (shaft.faces_b, GREEN)):
            for face in listed:
                side, k = face[:3] == "MAX", AXES.index(face[-1])
                at = middle.copy()
                at[k] = shaft.extent[k + 3 * side] + (0.22 if side else -0.22)
                axes.text(
                    *at, face, color=colour, fontsize=9, ha="center", va="center", fontweight="bold",
                    rotation=90 if k == 0 else 0,
                )  # fmt: skip
        for plane in shaft.planes:
            corner = np.where(plane[:2] > 0, shaft.extent[3:5], shaft.extent[:2])
            axes.plot(*corner, marker="x", color=PURPLE, markersize=11, markeredgewidth=3, zorder=7)

    def planes(axes: Any) -> None:
        _flat_shaft(axes, shaft)
        boxes(axes)
        _flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)

    # [SC, Forming the Testing Structure]: MAX_Y of the emitter with MIN_X of the receiver.
    printed = np.array([receiver[4] - emitter[4], emitter[0] - receiver[0], 0.0, 0.0])
    printed[3] = -(printed[0] * receiver[0] + printed[1] * receiver[4])
    ours = shaft.planes[edges.index("MIN_X--MAX_Y")]
    measured = {
        "planes_2d": float(len(shaft.planes)),
        "planes_3d": float(len(deep.planes)),
        "receiver_list": float(shaft.faces_b == ("MIN_X", "MIN_Y", "MAX_X")),
        "emitter_list": float(shaft.faces_a == ("MAX_Y",)),
        "formula_error": float(
            np.abs(ours / np.linalg.norm(ours[:3]) - printed / np.linalg.norm(printed[:3])).max()
        ),
        "hull_error": max(_too_large(s, max(100, round(10_000 * scale))) for s in (shaft, deep)),
    }
    rule = (
        Condition("planes_2d", ">=", 2),
        Condition("planes_2d", "<=", 2),
        Condition("receiver_list", ">=", 1),
        Condition("emitter_list", ">=", 1),
        Condition("formula_error", "<=", 1e-12),
        Condition("hull_error", "<=", 1e-9),
    )
    said = "the lists of the paper's example lead to its two planes, and the shaft is the hull of the boxes"
    here = (
        f"emitter: {', '.join(shaft.faces_a)}; receiver: {', '.join(shaft.faces_b)}; planes {' and '.join(edges)}. "
        f"The same with depth has {len(deep.planes)} planes"
    )
    panels: list[Panel] = [
        ("1. Reference boxes", boxes, False),
        ("2. Extent box, lists, culled edges (x)", extent, False),
        ("3. Planes", planes, False),
        ("In 3D", partial(_draw_shaft, shaft=deep), True),
    ]
    picture = drawings("Figure 1: shaft formation", f"Paper: {said}.\nHere: {here}.", panels, 2, (440, 340))
    rows = _shaft_rows(shaft, "2D") + _shaft_rows(deep, "3D")
    return _outcome("shaft-1", said, rule, measured, rows, picture)


# Figure 2

PLATE_HIGH = ([0, 2.55, 0, 4, 2.75, 4], [1.5, 0, 1.5, 2.5, 3, 2.5])
PLATE_MIDDLE = ([0, 1.4, 0, 4, 1.6, 4], [1.5, 0, 1.5, 2.5, 3, 2.5])


def _cut_shares(shaft: Shaft) -> Float64:
    """The share of the extent box that each plane alone cuts off."""
    box = box_planes(shaft.extent)
    whole = volume(box)
    return np.array([1 - volume(np.concatenate([box, p[None]])) / whole for p in shaft.planes])


def figure_2(scale: float, say: Say) -> Outcome:
    """Two shafts with eight planes: of one, four cut off little [SC, figure 2]."""
    shafts = [Shaft.between(*boxes) for boxes in (PLATE_HIGH, PLATE_MIDDLE)]
    cuts = [_cut_shares(s) for s in shafts]
    top = [c[s.planes[:, 1] > 0] for s, c in zip(shafts, cuts, strict=True)]
    bottom = [c[s.planes[:, 1] < 0] for s, c in zip(shafts, cuts, strict=True)]
    most = _most_planes(max(500, round(20_000 * scale)))

    def section(axes: Any, shaft: Shaft, cut: Float64) -> None:
        """At the middle of z, where the planes along z are lines."""
        middle = (shaft.extent[2] + shaft.extent[5]) / 2
        held = np.concatenate([shaft_planes(shaft), [[0, 0, 1, -middle]]])
        outline = faces(held)[-1]
        from matplotlib.patches import Polygon

        axes.add_patch(Polygon(outline[:, :2], facecolor="#DCEBF5", edgecolor=BLUE, linewidth=2, zorder=1))
        _flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)
        _flat_box(axes, shaft.box_b, GREEN, zorder=3)
        _flat_box(axes, shaft.box_a, ORANGE, zorder=4)
        for plane, share in zip(shaft.planes, cut, strict=True):
            if plane[2] == 0:
                corner = np.where(plane[:2] > 0, shaft.extent[3:5], shaft.extent[:2])
                out = 0.2 * np.sign(plane[1])
                axes.text(
                    corner[0], corner[1] + out, f"{100 * share:.1f} %", fontsize=10, color=BLUE, va="center",
                    ha="left" if plane[0] < 0 else "right",
                )  # fmt: skip
        _frame(axes, shaft.extent[None], 0.35)

    measured = {
        "planes_left": float(len(shafts[0].planes)),
        "planes_right": float(len(shafts[1].planes)),
        "most_planes": float(most),
        "top_cut_left": float(top[0].mean()),
        "bottom_cut_left": float(bottom[0].mean()),
        "least_cut_right": float(cuts[1].min()),
    }
    rule = (
        Condition("planes_left", ">=", 8),
        Condition("planes_right", ">=", 8),
        Condition("most_planes", "<=", 8),
        Condition("top_cut_left", "<", "bottom_cut_left"),
        Condition("top_cut_left", "<", "least_cut_right"),
    )
    said = "at most eight planes; the left shaft's top four cut off little, all of the right one's a fair share"
    here = (
        f"a plane at the left's top cuts {100 * top[0].mean():.1f} % off the extent box, "
        f"one at its bottom {100 * bottom[0].mean():.1f} %; at the right none cuts less than "
        f"{100 * cuts[1].min():.1f} %. Of random pairs of boxes none has more than {most} planes"
    )
    panels: list[Panel] = [
        (f"{side}: 8 planes", partial(_draw_shaft, shaft=s, elev=14), True)
        for side, s in zip(("Left", "Right"), shafts, strict=True)
    ]
    panels += [
        (f"{side}: section, and what each plane cuts off", partial(section, shaft=s, cut=c), False)
        for side, s, c in zip(("Left", "Right"), shafts, cuts, strict=True)
    ]
    picture = drawings("Figure 2: eight-plane shafts", f"Paper: {said}.\nHere: {here}.", panels, 2, (420, 330))
    rows: Rows = []
    for side, shaft, cut in zip(("left", "right"), shafts, cuts, strict=True):
        found = _shaft_rows(shaft, side, "plate", "post")
        rows += [row | {"cuts off": share} for row, share in zip(found, [None] * 3 + cut.tolist(), strict=True)]
    return _outcome("shaft-2", said, rule, measured, rows, picture)


def _most_planes(count: int) -> int:
    """The largest plane set of so many pairs of boxes with corners on a small grid, where faces often agree."""
    rng = np.random.default_rng(2)
    ends = np.sort(rng.integers(0, 6, (count, 2, 2, 3)), axis=2).astype(float)
    return max(len(Shaft.between(a, b).planes) for a, b in ends)


# Figure 3

#: The boxes of objects 1 to 6.
OBJECTS = np.array(
    [
        [0.1, 2.9, 0.6, 0.6, 3.5, 1.4],
        [2.0, 2.9, 0.6, 2.5, 3.3, 1.1],
        [2.9, 2.5, 0.9, 3.4, 3.0, 1.4],
        [3.0, 1.25, 0.7, 3.5, 1.75, 1.2],
        [3.8, 1.3, 0.6, 4.4, 1.8, 1.3],
        [4.65, 1.9, 0.8, 5.2, 2.4, 1.4],
    ]
)
EMITTER_3, RECEIVER_3 = np.array([1.4, 4.2, 0.0, 3.8, 4.7, 2.0]), np.array([0.6, 0.0, 0.0, 4.9, 0.6, 2.0])
#: The paper's lists.
LISTS = {
    "always open": ("2", "3", "4", "5"),
    "keep closed": ("A", "B"),
    "overlap open": ("A", "4", "5"),
    "ratio open 0.4": ("A", "B"),
}
NODES = ("root", "1", "A", "2", "3", "B", "4", "5", "6")


def _union(boxes: Float64) -> Float64:
    return np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


def _scene_of_figure_3() -> tuple[Float64, Bvh]:
    """The boxes of all nodes, and the BVH: object 1, A of 2 and 3, B of 4 to 6, all in the room's box."""
    a, b = _union(OBJECTS[1:3]), _union(OBJECTS[3:])
    room = _union(np.concatenate([OBJECTS, [EMITTER_3, RECEIVER_3]]))
    boxes = np.array([room, OBJECTS[0], a, OBJECTS[1], OBJECTS[2], b, *OBJECTS[3:]])
    bvh = Bvh(
        lower=boxes[:, :3].copy(),
        upper=boxes[:, 3:].copy(),
        skip=np.array([9, 2, 5, 4, 5, 9, 7, 8, 9], np.int32),
        first=np.array([0, 0, 1, 1, 2, 3, 3, 4, 5], np.int32),
        count=np.array([0, 1, 0, 1, 1, 0, 1, 1, 1], np.int32),
        order=np.arange(6, dtype=np.int32),
    )
    return boxes, bvh


def figure_3(scale: float, say: Say) -> Outcome:
    """Six objects in two boxes: the candidate list of each strategy [SC, figure 3]."""
    boxes, bvh = _scene_of_figure_3()
    shaft = Shaft.between(EMITTER_3, RECEIVER_3)
    strategies = {
        "always open": Strategy.ALWAYS_OPEN,
        "keep closed": Strategy.KEEP_CLOSED,
        "overlap open": Strategy.OVERLAP_OPEN,
        "ratio open 0.4": Strategy.RATIO_OPEN,
    }
    lists = {
        name: tuple(sorted((NODES[i] for i in candidate_list(bvh, shaft, strategy, ratio=0.4)), key=_rank))
        for name, strategy in strategies.items()
    }
    places = {node: Place(int(p)) for node, p in zip(NODES, shaft.classify(boxes), strict=True)}

    def colour(node: str, listed: Sequence[str]) -> str:
        return PURPLE if node in listed else "white"

    def flat(axes: Any, listed: Sequence[str]) -> None:
        _flat_shaft(axes, shaft)
        _flat_box(axes, EMITTER_3, ORANGE, "emitter")
        _flat_box(axes, RECEIVER_3, GREEN, "receiver")
        for node, box in zip(NODES[1:], boxes[1:], strict=True):
            if node in "AB":
                line = PURPLE if node in listed else GREY
                width = 3.0 if node in listed else 1.0
                _flat_box(axes, box, line, facecolor="none", linewidth=width, alpha=1, zorder=5)
                axes.text(
                    box[0] - 0.1, box[4], node, color=line, fontsize=11, fontweight="bold", ha="right", va="top"
                )
            else:
                _flat_box(axes, box, PURPLE if node in listed else GREY, node, facecolor=colour(node, listed))
        _frame(axes, boxes[:1], 0.25)

    def solid(axes: Any, listed: Sequence[str]) -> None:
        _draw_shaft(axes, shaft, 0.98)
        for node, box in zip(NODES[1:], boxes[1:], strict=True):
            if node in "AB":
                taken = node in listed
                _wire(axes, box, PURPLE if taken else GREY, "-", 2.4 if taken else 0.8)
            else:
                _solid(axes, box_planes(box), colour(node, listed), 0.95, INK if node not in listed else "white")

    right = {name: float(lists[name] == LISTS[name]) for name in lists}
    measured = {f"{name.replace(' ', '_')}_as_in_the_paper": value for name, value in right.items()}
    rule = tuple(Condition(name, ">=", 1) for name in measured)
    said = "the candidate lists of the four strategies are those of the paper"
    here = "; ".join(f"{name}: {', '.join(found)}" for name, found in lists.items())
    panels: list[Panel] = [
        (f"{name[0].upper()}{name[1:]}: {', '.join(found)}", partial(flat, listed=found), False)
        for name, found in lists.items()
    ]
    panels += [("", partial(solid, listed=found), True) for found in lists.values()]
    picture = drawings(
        "Figure 3: shaft strategies",
        f"Paper: {said}; filled or framed in purple: on the list. A is inside the shaft, B overlaps it, 1 and 6 "
        f"are outside.\nHere: {here}.",
        panels,
        4,
        (310, 290),
    )
    rows: Rows = [_box_row("emitter", EMITTER_3), _box_row("receiver", RECEIVER_3)]
    for node, box in zip(NODES, boxes, strict=True):
        on = ", ".join(name for name, found in lists.items() if node in found)
        rows.append(_box_row(node, box, places[node].name.lower()) | {"on the list of": on})
    first = {"on the list of": ""}
    return _outcome("shaft-3", said, rule, measured, [first | r for r in rows], picture)


def _rank(node: str) -> tuple[bool, str]:
    """Boxes before objects, as the paper lists them."""
    return node.isdigit(), node


# Figure 4


def figure_4(scale: float, say: Say) -> Outcome:
    """A sphere that is called overlapping though it is outside; boxes never are [SC, figure 4]."""
    light, receiver = np.array([0, 3, 0, 0, 3, 0.0]), np.array([-1, 0, -1, 1, 0.4, 1])
    shaft = Shaft.between(light, receiver)
    way = np.array([np.sin(0.63), np.cos(0.63), 0.0])
    centre, radius = light[:3] + 0.8 * way, 0.7
    sphere = int(shaft.classify_spheres(centre, [radius])[0])
    hull = np.concatenate([box_corners(light), box_corners(receiver)])
    gap = float(farthest_gap(hull, centre[None])[0])
    # A box above the light: within the other faces of the extent box, and across all planes of the plane set.
    above = np.array([-0.5, 3.08, -0.5, 0.5, 3.5, 0.5])
    box = int(shaft.classify(above[None])[0])
    separate = [
        edge for edge, plane, near in zip(
            [_edge(p) for p in shaft.planes], shaft.planes, shaft.near, strict=True
        ) if plane[:3] @ above[near] + plane[3] > 0
    ]  # fmt: skip
    count = max(200, round(20_000 * scale))
    false_spheres, called = _false_spheres(shaft, count)

    def flat(axes: Any, kind: str) -> None:
        from matplotlib.patches import Circle, Polygon

        axes.add_patch(Polygon(_outline(shaft), facecolor="#DCEBF5", edgecolor="none", zorder=1))
        _flat_box(axes, receiver, GREEN, "receiver")
        _flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)
        for plane in shaft.planes:
            if plane[2] == 0:
                # Beyond the light, where the plane goes on without bounding anything.
                y = np.array([0.4, 3.9])
                axes.plot(-(plane[1] * y + plane[3]) / plane[0], y, color=BLUE, linewidth=1.6, zorder=4)
        axes.plot([-1.6, 1.6], [3, 3], color=GREY, linestyle=(0, (4, 3)), linewidth=1)
        axes.text(-1.6, 3.06, "MAX_Y", color=INK, fontsize=9)
        if kind == "sphere":
            axes.add_patch(
                Circle(
                    (float(centre[0]), float(centre[1])),
                    radius,
                    facecolor=PURPLE,
                    alpha=0.45,
                    edgecolor=PURPLE,
                    zorder=3,
                )
            )
        else:
            _flat_box(axes, above, PURPLE, alpha=0.5)
        axes.plot(0, 3, marker="o", color=ORANGE, markersize=8, markeredgecolor="white", zorder=8)
        axes.set_xlim(-1.8, 1.8)
        axes.set_ylim(-0.15, 4.4)

    def solid(axes: Any, kind: str) -> None:
        _draw_shaft(axes, shaft)
        if kind == "sphere":
            _solid_sphere(axes, centre, radius)
        else:
            _solid(axes, box_planes(above), PURPLE, 0.55)
        _solid(axes, box_planes(np.concatenate([light[:3] - 0.05, light[3:] + 0.05])), ORANGE, 1)
        seen = np.concatenate([shaft.extent[:3], shaft.extent[3:] + np.array([0.2, 1.4, 0.2])])[None]
        _look(axes, seen, 1.1, elev=10, azim=-75)

    measured = {
        "called_overlapping": float(sphere == Place.OVERLAPPING),
        "sphere_radius": radius,
        "sphere_distance": gap,
        "box_called_outside": float(box == Place.OUTSIDE),
        "planes_with_box_outside": float(len(separate)),
        "false_share_of_spheres": false_spheres / max(called, 1),
    }
    rule = (
        Condition("called_overlapping", ">=", 1),
        Condition("sphere_distance", ">", "sphere_radius"),
        Condition("box_called_outside", ">=", 1),
        Condition("planes_with_box_outside", "<=", 0),
    )
    said = "a sphere can be called overlapping though outside; of a box above the light MAX_Y alone tells"
    here = (
        f"the sphere of radius {radius:g} is {gap:.3g} from the shaft, but reaches the extent box and "
        f"every plane. Of {called:,} random spheres called overlapping here, "
        f"{100 * false_spheres / max(called, 1):.1f} % are outside"
    )
    panels: list[Panel] = [
        ("A sphere: false positive", partial(flat, kind="sphere"), False),
        ("A box: only MAX_Y has it outside", partial(flat, kind="box"), False),
        ("", partial(solid, kind="sphere"), True),
        ("", partial(solid, kind="box"), True),
    ]
    picture = drawings("Figure 4: false positives", f"Paper: {said}.\nHere: {here}.", panels, 2, (400, 380))
    rows = _shaft_rows(shaft, "shaft", "light")
    rows.append(_box_row("box above the light", above, Place(box).name.lower()))
    around = np.concatenate([centre - radius, centre + radius])
    rows.append(_box_row("sphere, the box around it", around, Place(sphere).name.lower()))
    return _outcome("shaft-4", said, rule, measured, rows, picture)


def _outline(shaft: Shaft) -> Float64:
    """(n, 2): the section at z = 0."""
    return faces(np.concatenate([shaft_planes(shaft), [[0, 0, 1, 0]]]))[-1][:, :2]


def _solid_sphere(axes: Any, centre: Float64, radius: float) -> None:
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi, 17))
    x, y, z = np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)
    c = centre[[0, 2, 1]]
    axes.plot_surface(
        c[0] + radius * x, c[1] + radius * y, c[2] + radius * z, color=PURPLE, alpha=0.55, linewidth=0, shade=False
    )


def _false_spheres(shaft: Shaft, count: int) -> tuple[int, int]:
    """Of random spheres around a shaft: how many are called overlapping though outside, and how many in all."""
    rng = np.random.default_rng(4)
    low, high = shaft.extent[:3] - 1, shaft.extent[3:] + 1
    centres, radii = rng.uniform(low, high, (count, 3)), rng.uniform(0.05, 1.0, count)
    called = shaft.classify_spheres(centres, radii) == Place.OVERLAPPING
    hull = np.concatenate([box_corners(shaft.box_a), box_corners(shaft.box_b)])
    return int((farthest_gap(hull, centres[called]) > radii[called]).sum()), int(called.sum())


# Table 1


def table_1(scale: float, say: Say) -> Outcome:
    """Tests and time per ray of every strategy, low and high sampling, both offices [SC, table 1]."""
    # Points of a mesh this far apart, metres; and so many of the ten lights.
    spacing, lights = min(0.25 / scale, 2.0), max(1, round(10 * scale))
    rows = table_1_rows(spacing=spacing, rounds=max(1, round(5 * scale)), say=say, most_lights=lights)
    savings = savings_rows(spacing=spacing, most_lights=lights)
    names = dict(zip(OFFICES, ("office", "premesh"), strict=True))
    measured: dict[str, float] = {}
    for scene, short in names.items():
        of = {row["strategy"]: row for row in rows if row["scene"] == scene}
        ratios = [row for strategy, row in of.items() if strategy.startswith("ratio open")]
        base = of["baseline"]
        measured |= {
            f"tests_gain_{short}": base["tests/ray"] / min(row["tests/ray"] for row in ratios),
            f"time_gain_{short}": base["high µs"] / min(row["high µs"] for row in ratios),
            f"closed_tests_gain_{short}": base["tests/ray"] / of["keep closed"]["tests/ray"],
            f"always_open_tests_gain_{short}": base["tests/ray"] / of["always open"]["tests/ray"],
        }
    for row in savings:
        short = names[row["scene"]]
        measured |= {
            f"cache_saves_{short}": row["cache saves"],
            f"emitter_list_saves_{short}": row["emitter list saves"],
        }
    rule = (
        Condition("tests_gain_office", ">=", 2.0),
        Condition("tests_gain_premesh", ">=", 3.8),
        Condition("time_gain_office", ">=", 1.6),
        Condition("time_gain_premesh", ">=", 2.2),
    )
    said = "ratio open divides the tests by 2.0 (standard) and 3.8 (premesh), the time by 1.6 and 2.2"
    here = (
        f"tests divided by {measured['tests_gain_office']:.2f} and {measured['tests_gain_premesh']:.2f}, "
        f"time at high sampling by {measured['time_gain_office']:.2f} and {measured['time_gain_premesh']:.2f}"
    )
    caption = (
        f"Paper: {said}. Its times are of an HP 9000/433.\nHere: {here}. One thread, shafts included; "
        "rays that the last occluder stopped are not counted. Low: 1 sample of each light, high: 4. Candidates, "
        "empty shafts and rays without a test (free): at high sampling. Walls and floor, with the "
        "most rays, have far more candidates than the mean."
    )
    columns = (
        ("Strategy", 150), ("tests/ray\nhere", 88), ("\npaper", 68), ("low µs\nhere", 78), ("\npaper", 68),
        ("high µs\nhere", 78), ("\npaper", 68), ("rays/shaft\nlow", 96), ("\nhigh", 68),
        ("candidates\nper shaft", 100), ("empty\nshafts", 78), ("free\nrays", 78),
    )  # fmt: skip
    lines: list[list[str]] = []
    for scene, saved in zip(OFFICES, savings, strict=True):
        lines.append([f"{'Premesh' if 'premesh' in scene else 'Standard'} ({scene})"])
        lines += [_line(row) for row in rows if row["scene"] == scene]
        lines.append([
            f"Savings in tests: shadow cache {_percent(saved['cache saves'])} (paper: 31 %), emitter list "
            f"{_percent(saved['emitter list saves'])} (paper: {100 * saved['paper emitter list saves']:.0f} %)"
        ])  # fmt: skip
    picture = table("Table 1: statistics for office databases", caption, columns, lines)
    notes = (
        [] if scale == 1 else [f"at scale {scale:g}, receiver points {spacing:g} m apart and {lights} of 10 lights"]
    )
    return _outcome("shaft-table-1", said, rule, measured, rows, picture, notes)


def _line(row: dict[str, Any]) -> list[str]:
    def number(name: str, form: str) -> str:
        return "–" if row[name] is None else format(row[name], form)

    return [
        row["strategy"], number("tests/ray", ".1f"), number("paper tests/ray", ".1f"), number("low µs", ".3f"),
        number("paper low µs", "d"), number("high µs", ".3f"), number("paper high µs", "d"),
        number("rays/shaft low", ".1f"), number("rays/shaft high", ".1f"), number("candidates/shaft", ".1f"),
        _percent(row["empty shafts"]), _percent(row["free rays"]),
    ]  # fmt: skip


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f} %"


FIGURES = {
    "shaft-1": (figure_1, "how a shaft is formed: reference boxes, extent box, planes"),
    "shaft-2": (figure_2, "two shafts of eight planes, and what each plane cuts off"),
    "shaft-3": (figure_3, "six objects in two boxes: the candidate list of each strategy"),
    "shaft-4": (figure_4, "a sphere falsely called overlapping, and a box that is not"),
    "shaft-table-1": (table_1, "tests and time per ray of every strategy, beside the paper's"),
}
