"""Figures 1 to 4 of the shaft paper [SC]: how a shaft is formed, and how it classifies objects.

The copy of the paper lacks figures 1 to 4, so they are drawn after its text: in 2D (a section, in which all boxes
have equal depth) and in 3D. All drawings use the data of `Shaft` and `candidate_list`.

[SC] E. Haines, J. Wallace, "Shaft culling for efficient ray-cast radiosity", Eurographics Workshop on Rendering,
1991.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.figures.outcome import Outcome, Rows, Say, judged
from benchmarks.figures.shaft_drawing import (
    draw_shaft,
    flat_box,
    flat_shaft,
    frame,
    look,
    solid_planes,
    solid_sphere,
    wire,
)
from benchmarks.figures.style import drawings
from benchmarks.verdict import Condition
from glpath.accel.nodes import Bvh
from glpath.film.charts import BLUE, GREEN, GREY, INK, ORANGE, PURPLE
from glpath.notebook.shaft_scene import box_corners, box_planes, faces, shaft_planes
from glpath.radiosity import Containment, Shaft, Strategy, candidate_list
from glpath.radiosity.shafts.shaft import FACES

Float64 = NDArray[np.float64]
Panel = tuple[str, Callable[[Any], None], bool]

AXES = "XYZ"


_outcome = partial(judged, with_gl=False)


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
    """Return the culled edge of a plane, such as "MIN_X--MAX_Y", from the signs of its normal."""
    return "--".join(f"{'MAX' if plane[k] > 0 else 'MIN'}_{AXES[k]}" for k in range(3) if plane[k])


def volume(planes: Float64) -> float:
    """Return the volume inside all planes, as the sum of pyramids from the origin over the faces."""
    total = 0.0
    for plane, face in zip(planes, faces(planes), strict=True):
        if len(face):
            normal = plane[:3] / np.linalg.norm(plane[:3])
            area = 0.5 * abs(normal @ np.cross(face, np.roll(face, -1, axis=0)).sum(axis=0))
            total += area * float(normal @ face[0]) / 3
    return total


def farthest_gap(points: Float64, centres: Float64, steps: int = 400) -> Float64:
    """Return (N,) lower bounds of the distance of centres (N, 3) from the convex hull of points (P, 3); 0 inside.

    A point of the hull approaches the centre iteratively [Gilbert 1966]. In each step, the vector between them
    defines a plane that has the whole hull on one side. The result is the largest distance of the centre from such
    a plane, so it is never too large.
    """
    nearest = np.repeat(points.mean(axis=0, keepdims=True), len(centres), axis=0)
    best = np.zeros(len(centres))
    for _ in range(steps):
        to_centre = centres - nearest
        length = np.maximum(np.linalg.norm(to_centre, axis=1), 1e-300)
        along = to_centre @ points.T
        support = points[along.argmax(axis=1)]
        best = np.maximum(best, ((centres - support) * to_centre).sum(axis=1) / length)
        step = support - nearest
        share = (to_centre * step).sum(axis=1) / np.maximum((step * step).sum(axis=1), 1e-300)
        nearest = nearest + np.clip(share, 0, 1)[:, None] * step
    return best


def _too_large(shaft: Shaft, count: int, seed: int = 1) -> float:
    """Return the most by which the shaft exceeds its boxes' hull in `count` random directions; 0 if it fits."""
    hull = np.concatenate([box_corners(shaft.box_a), box_corners(shaft.box_b)])
    own = np.concatenate([f for f in faces(shaft_planes(shaft)) if len(f)])
    ways = np.random.default_rng(seed).normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return float(np.abs((own @ ways.T).max(axis=0) - (hull @ ways.T).max(axis=0)).max())


# Figure 1


def figure_1(scale: float, say: Say) -> Outcome:
    """Make figure 1: shaft formation with reference boxes, extent box with its culled edges, and planes."""
    emitter, receiver = np.array([1.4, 2.6, 0, 2.6, 3.2, 2.0]), np.array([0, 0, 0, 4.2, 0.8, 2.0])
    shaft = Shaft.between(emitter, receiver)
    deep = Shaft.between([1.4, 2.6, 0.7, 2.6, 3.2, 1.5], [0, 0, 0, 4.2, 0.8, 2.6])
    edges = [_edge(p) for p in shaft.planes]

    def boxes(axes: Any) -> None:
        flat_box(axes, emitter, ORANGE, "emitter")
        flat_box(axes, receiver, GREEN, "receiver")
        frame(axes, shaft.extent[None], 0.45)

    def extent(axes: Any) -> None:
        boxes(axes)
        flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)
        # Write each list beside the faces in it.
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
        flat_shaft(axes, shaft)
        boxes(axes)
        flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)

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
        ("In 3D", partial(draw_shaft, shaft=deep), True),
    ]
    picture = drawings("Figure 1: shaft formation", f"Paper: {said}.\nHere: {here}.", panels, 2, (440, 340))
    rows = _shaft_rows(shaft, "2D") + _shaft_rows(deep, "3D")
    return _outcome("shaft-1", said, rule, measured, rows, picture)


# Figure 2

PLATE_HIGH = ([0, 2.55, 0, 4, 2.75, 4], [1.5, 0, 1.5, 2.5, 3, 2.5])
PLATE_MIDDLE = ([0, 1.4, 0, 4, 1.6, 4], [1.5, 0, 1.5, 2.5, 3, 2.5])


def _cut_shares(shaft: Shaft) -> Float64:
    """Return, for each plane, the fraction of the extent box that it alone cuts off."""
    box = box_planes(shaft.extent)
    whole = volume(box)
    return np.array([1 - volume(np.concatenate([box, p[None]])) / whole for p in shaft.planes])


def figure_2(scale: float, say: Say) -> Outcome:
    """Make figure 2: two shafts with eight planes; in one of them, four planes cut off little."""
    shafts = [Shaft.between(*boxes) for boxes in (PLATE_HIGH, PLATE_MIDDLE)]
    cuts = [_cut_shares(s) for s in shafts]
    top = [c[s.planes[:, 1] > 0] for s, c in zip(shafts, cuts, strict=True)]
    bottom = [c[s.planes[:, 1] < 0] for s, c in zip(shafts, cuts, strict=True)]
    most = _most_planes(max(500, round(20_000 * scale)))

    def section(axes: Any, shaft: Shaft, cut: Float64) -> None:
        """Draw the section through the middle of z, in which the planes along z are lines."""
        middle = (shaft.extent[2] + shaft.extent[5]) / 2
        held = np.concatenate([shaft_planes(shaft), [[0, 0, 1, -middle]]])
        outline = faces(held)[-1]
        from matplotlib.patches import Polygon

        axes.add_patch(Polygon(outline[:, :2], facecolor="#DCEBF5", edgecolor=BLUE, linewidth=2, zorder=1))
        flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)
        flat_box(axes, shaft.box_b, GREEN, zorder=3)
        flat_box(axes, shaft.box_a, ORANGE, zorder=4)
        for plane, share in zip(shaft.planes, cut, strict=True):
            if plane[2] == 0:
                corner = np.where(plane[:2] > 0, shaft.extent[3:5], shaft.extent[:2])
                out = 0.2 * np.sign(plane[1])
                axes.text(
                    corner[0], corner[1] + out, f"{100 * share:.1f} %", fontsize=10, color=BLUE, va="center",
                    ha="left" if plane[0] < 0 else "right",
                )  # fmt: skip
        frame(axes, shaft.extent[None], 0.35)

    measured = {
        "planes_left": float(len(shafts[0].planes)),
        "planes_right": float(len(shafts[1].planes)),
        "most_planes": float(most),
        "top_cut_left": float(top[0].mean()),
        "bottom_cut_left": float(bottom[0].mean()),
        "min_cut_right": float(cuts[1].min()),
        "hull_error": max(_too_large(s, max(100, round(10_000 * scale))) for s in shafts),
    }
    rule = (
        Condition("planes_left", ">=", 8),
        Condition("planes_right", ">=", 8),
        Condition("most_planes", "<=", 8),
        Condition("top_cut_left", "<", "bottom_cut_left"),
        Condition("top_cut_left", "<", "min_cut_right"),
        Condition("hull_error", "<=", 1e-9),
    )
    said = "at most eight planes; the left shaft's top four cut off little, all of the right one's a fair share"
    here = (
        f"a plane at the left's top cuts {100 * top[0].mean():.1f} % off the extent box, "
        f"one at its bottom {100 * bottom[0].mean():.1f} %; at the right none cuts less than "
        f"{100 * cuts[1].min():.1f} %. Of random pairs of boxes none has more than {most} planes"
    )
    panels: list[Panel] = [
        (f"{side}: 8 planes", partial(draw_shaft, shaft=s, elev=14), True)
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
    """Return the largest plane set of random pairs of boxes on a small grid, which often share planes."""
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
#: Lists that the paper states.
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
    """Return the nodes' boxes and the BVH: the room's box contains object 1, A with 2 and 3, and B with 4 to 6."""
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
    """Make figure 3: six objects in two boxes, and the candidate list of each strategy."""
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
    places = {node: Containment(int(p)) for node, p in zip(NODES, shaft.classify(boxes), strict=True)}

    def colour(node: str, listed: Sequence[str]) -> str:
        return PURPLE if node in listed else "white"

    def flat(axes: Any, listed: Sequence[str]) -> None:
        flat_shaft(axes, shaft)
        flat_box(axes, EMITTER_3, ORANGE, "emitter")
        flat_box(axes, RECEIVER_3, GREEN, "receiver")
        for node, box in zip(NODES[1:], boxes[1:], strict=True):
            if node in "AB":
                line = PURPLE if node in listed else GREY
                width = 3.0 if node in listed else 1.0
                flat_box(axes, box, line, facecolor="none", linewidth=width, alpha=1, zorder=5)
                axes.text(
                    box[0] - 0.1, box[4], node, color=line, fontsize=11, fontweight="bold", ha="right", va="top"
                )
            else:
                flat_box(axes, box, PURPLE if node in listed else GREY, node, facecolor=colour(node, listed))
        frame(axes, boxes[:1], 0.25)

    def solid(axes: Any, listed: Sequence[str]) -> None:
        draw_shaft(axes, shaft, 0.98)
        for node, box in zip(NODES[1:], boxes[1:], strict=True):
            if node in "AB":
                taken = node in listed
                wire(axes, box, PURPLE if taken else GREY, "-", 2.4 if taken else 0.8)
            else:
                solid_planes(
                    axes, box_planes(box), colour(node, listed), 0.95, INK if node not in listed else "white"
                )

    right = {name: float(lists[name] == LISTS[name]) for name in lists}
    measured = {f"{name.replace(' ', '_')}_as_in_the_paper": value for name, value in right.items()}
    rule = (*(Condition(name, ">=", 1) for name in measured), Condition("hull_error", "<=", 1e-9))
    measured["hull_error"] = _too_large(shaft, max(100, round(10_000 * scale)))
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
    """Return a sort key that puts boxes before objects, as in the paper."""
    return node.isdigit(), node


# Figure 4


def figure_4(scale: float, say: Say) -> Outcome:
    """Make figure 4: a sphere outside the shaft that is classified as overlapping, which never happens to boxes."""
    light, receiver = np.array([0, 3, 0, 0, 3, 0.0]), np.array([-1, 0, -1, 1, 0.4, 1])
    shaft = Shaft.between(light, receiver)
    way = np.array([np.sin(0.63), np.cos(0.63), 0.0])
    centre, radius = light[:3] + 0.8 * way, 0.7
    sphere = int(shaft.classify_spheres(centre, [radius])[0])
    hull = np.concatenate([box_corners(light), box_corners(receiver)])
    gap = float(farthest_gap(hull, centre[None])[0])
    # A box above the light: it is inside the other faces of the extent box, and straddles all planes of the plane
    # set.
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
        flat_box(axes, receiver, GREEN, "receiver")
        flat_box(axes, shaft.extent, GREY, facecolor="none", linestyle=(0, (4, 3)), zorder=2)
        for plane in shaft.planes:
            if plane[2] == 0:
                # Beyond the light, the plane continues, but bounds nothing.
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
            flat_box(axes, above, PURPLE, alpha=0.5)
        axes.plot(0, 3, marker="o", color=ORANGE, markersize=8, markeredgecolor="white", zorder=8)
        axes.set_xlim(-1.8, 1.8)
        axes.set_ylim(-0.15, 4.4)

    def solid(axes: Any, kind: str) -> None:
        draw_shaft(axes, shaft)
        if kind == "sphere":
            solid_sphere(axes, centre, radius)
        else:
            solid_planes(axes, box_planes(above), PURPLE, 0.55)
        solid_planes(axes, box_planes(np.concatenate([light[:3] - 0.05, light[3:] + 0.05])), ORANGE, 1)
        seen = np.concatenate([shaft.extent[:3], shaft.extent[3:] + np.array([0.2, 1.4, 0.2])])[None]
        look(axes, seen, 1.1, elev=10, azim=-75)

    measured = {
        "called_overlapping": float(sphere == Containment.OVERLAPPING),
        "sphere_radius": radius,
        "sphere_distance": gap,
        "box_called_outside": float(box == Containment.OUTSIDE),
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
    rows.append(_box_row("box above the light", above, Containment(box).name.lower()))
    around = np.concatenate([centre - radius, centre + radius])
    rows.append(_box_row("sphere, the box around it", around, Containment(sphere).name.lower()))
    return _outcome("shaft-4", said, rule, measured, rows, picture)


def _outline(shaft: Shaft) -> Float64:
    """Return (n, 2) corners of the section at z = 0."""
    return faces(np.concatenate([shaft_planes(shaft), [[0, 0, 1, 0]]]))[-1][:, :2]


def _false_spheres(shaft: Shaft, count: int) -> tuple[int, int]:
    """Count random spheres that are called overlapping: those that are outside, and all."""
    rng = np.random.default_rng(4)
    low, high = shaft.extent[:3] - 1, shaft.extent[3:] + 1
    centres, radii = rng.uniform(low, high, (count, 3)), rng.uniform(0.05, 1.0, count)
    called = shaft.classify_spheres(centres, radii) == Containment.OVERLAPPING
    hull = np.concatenate([box_corners(shaft.box_a), box_corners(shaft.box_b)])
    return int((farthest_gap(hull, centres[called]) > radii[called]).sum()), int(called.sum())


FIGURES = {
    "shaft-1": (figure_1, "how a shaft is formed: reference boxes, extent box, planes"),
    "shaft-2": (figure_2, "two shafts of eight planes, and what each plane cuts off"),
    "shaft-3": (figure_3, "six objects in two boxes: the candidate list of each strategy"),
    "shaft-4": (figure_4, "a sphere falsely called overlapping, and a box that is not"),
}
