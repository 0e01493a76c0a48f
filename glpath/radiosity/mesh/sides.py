"""Sides of elements that reflect, transmit or emit, and the unburied parts of these sides.

Solids overlap each other and stand on floors. The part of an element that is buried in a solid gets no light and
sends none. If it counted, the rest of the element would be too dark, and so would the room.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.mesh.mesh import Elements, Int64
from glpath.radiosity.shafts.occluders import closed_shapes
from glpath.radiosity.shafts.rays import Rays, nearest, rays_of
from glpath.scene import Scene
from glpath.scene.appearance import Appearance
from glpath.scene.model import Float64
from glpath.scene.pieces import pieces
from glpath.scene.sight import winding_number
from glpath.system.kernels import kernel
from glpath.system.threads import in_threads
from glpath.system.time_limit import check_time

#: Number of parts per edge of a partly buried element, whose _FINE^2 parts are tested to measure its unburied area.
_FINE = 8
#: Distance of ray origins from the surface, as a fraction of the largest coordinate. It exceeds the rounding of
#: coordinates in files, which have 24 bits.
_OFF = 1e-6
#: Number of points that a thread tests at a time.
_TOGETHER = 1 << 12
#: Number of sides whose parts are tested at a time.
_SIDES_TOGETHER = 1 << 13
# Area of a piece of a lamp, as a fraction of the largest piece of its shape and of the area of a closed shape
# around it, up to which it does not make the closed shape a room.
_PIECE, _PIECE_IN_SHAPE = 1e-3, 1e-4


@dataclass(frozen=True)
class Sides:
    """Sides of elements that reflect, transmit or emit, as arrays (R,).

    element     : index of the element
    back        : 0 for the front, 1 for the back
    normal      : (R, 3) unit normal that points away from this side
    reflectance : (R, 3), fraction of the light on this side that it reflects diffusely
    emission    : (R, 3), radiosity pi Le, W m^-2
    transmittance : (R, 3), fraction of the light on this side that leaves diffusely from the other side
    """

    element: Int64
    back: Int64
    normal: Float64
    reflectance: Float64
    emission: Float64
    transmittance: Float64

    def __len__(self) -> int:
        return len(self.element)

    @classmethod
    def of(cls, scene: Scene, elements: Elements) -> Sides:
        """Return the sides that are not black: fronts first, then backs, each in the order of the elements."""
        check_time()
        shape = scene.triangle_shape[elements.triangle]
        reflectance = scene.side_reflectance[:, elements.triangle]
        emits_at_all = np.array([s.emits for s in scene.shapes], bool)[shape]
        through = np.broadcast_to(np.zeros(3), (2, len(elements), 3))
        if any(scene.materials[s.material].diffuse_transmission > 0 for s in scene.shapes):
            through = Appearance(scene).side_transmittance()[:, elements.triangle]
        emission = np.pi * np.array([s.emission for s in scene.shapes]).reshape(-1, 3)[shape]
        appearance = Appearance(scene)
        painted = np.flatnonzero(appearance.varies("emission")[shape])
        if len(painted):
            own = elements[painted]
            emission[painted] = np.pi * appearance.mean_emission(own.triangle, own.corners() / own.n[:, None, None])
        both = np.array([s.emission_two_sided for s in scene.shapes], bool)
        normal = scene.normals[elements.triangle]
        parts = []
        for back in (0, 1):
            check_time()
            reflects = reflectance[back]
            emits = emission * (both[shape, None] if back else 1.0)
            # Black elements under an emission texture are kept, because the patches that contain them are kept.
            shines = emits_at_all & (both[shape] if back else True)
            some = np.flatnonzero(reflects.any(axis=1) | through.any(axis=(0, 2)) | shines)
            parts.append(
                (
                    some,
                    np.full(len(some), back),
                    normal[some] * (1 - 2 * back),
                    reflects[some],
                    emits[some],
                    through[back, some],
                )
            )
        return cls(*(np.concatenate(pair) for pair in zip(*parts, strict=True)))

    def number(self, count: int) -> Int64:
        """Return (count, 2), the index in these arrays of each element's front and back; -1 for a black side."""
        found = np.full((count, 2), -1, np.int64)
        found[self.element, self.back] = np.arange(len(self))
        return found


def sub_triangles(k: int) -> Float64:
    """Return (k * k, 3), the barycentric coordinates of the middles of the k * k equal parts of a triangle."""
    cells = [(i + (1 + up) / 3, j + (1 + up) / 3) for j in range(k) for i in range(k - j) for up in (0, 1)
             if i + j + up < k]  # fmt: skip
    b1, b2 = np.array(cells).T / k
    return np.stack([1 - b1 - b2, b1, b2], axis=1)


def random_in_parts(k: int, count: int, seed: int) -> Float64:
    """Return (count, k * k, 3), barycentric coordinates of random points, one in each equal part of a triangle.

    Points are uniform, and different for each of `count` triangles.
    """
    middles = sub_triangles(k)
    within = np.random.default_rng(seed).random((count, k * k, 2))
    within = np.where(within.sum(axis=2, keepdims=True) > 1, 1 - within, within)
    off = np.concatenate([1 - within.sum(axis=2, keepdims=True), within], axis=2) - 1 / 3
    # Upper parts, which are rotated by 180 degrees, have their middle at two thirds of a cell.
    upper = np.round(middles[:, 1:2] * k % 1 * 3) == 2
    return np.asarray(middles + np.where(upper, -off, off) / k)


@dataclass(frozen=True)
class Solids:
    """Closed surfaces of a scene. They may hide parts of other surfaces, such as the floor under a box.

    scene : triangulated scene
    solid : (T,) bool, True if the triangle belongs to a closed surface without a camera or light inside
    rays  : ray queries of the scene
    """

    scene: Scene
    solid: NDArray[np.bool_]
    rays: Rays

    @classmethod
    def of(cls, scene: Scene, closed: NDArray[np.bool_], rays: Rays | None = None) -> Solids:
        """Select the closed surfaces that are not rooms, which means that no camera and no light is inside.

        closed : (T,) bool, True if the triangle belongs to a closed surface; its fronts may point inwards or
                 outwards
        """
        of_shape = np.bincount(scene.triangle_shape, closed, len(scene.shapes)) > 0
        return cls(scene, closed & ~_inhabited(scene, of_shape)[scene.triangle_shape], rays or rays_of(scene))

    def open_points(
        self, elements: Elements, sides: Sides, count: int, seed: int | None = None
    ) -> tuple[Float64, Float64]:
        """Return points (R, count, 3) on the unburied part of each side, and (R,) its fraction of the side's area.

        count : 1, 4, 9, ...
        seed  : seed of random points in equal parts of an element; None for the centres of the parts. Centres never
                come close to the element's edge, so that points of a blind behind a window see too much of the
                window
        """
        k = round(count**0.5)
        parts = sub_triangles(k) if seed is None else random_in_parts(k, len(elements), seed)
        points = elements.points(self.scene, parts)[sides.element]
        is_open = np.ones(len(sides))
        if not (self.solid.any() and len(sides)):
            return points, is_open
        # Test more points on triangles that have a buried point.
        triangle = elements.triangle[sides.element]
        buried = ~self._free(points, sides.normal).all(axis=1)
        near = np.flatnonzero(np.isin(triangle, triangle[buried]))
        for begin in range(0, len(near), _SIDES_TOGETHER):
            check_time()
            part = near[begin : begin + _SIDES_TOGETHER]
            fine = elements[sides.element[part]].points(self.scene, sub_triangles(_FINE))
            is_free = self._free(fine, sides.normal[part])
            free_ones = is_free.sum(axis=1)
            is_open[part] = free_ones / _FINE**2
            some = (free_ones > 0) & (free_ones < _FINE**2)
            order = np.argsort(~is_free[some], axis=1, kind="stable")
            spread = ((np.arange(count) + 0.5) / count * free_ones[some, None]).astype(np.int64)
            chosen = np.take_along_axis(order, spread, axis=1)
            points[part[some]] = np.take_along_axis(fine[some], chosen[..., None], axis=1)
        return points, is_open

    def _free(self, tested: Float64, normal: Float64) -> NDArray[np.bool_]:
        """Return (R, k) bool, True for points (R, k, 3) of sides with normals (R, 3) that are not buried."""
        normals = np.repeat(normal, tested.shape[1], axis=0)
        found = in_the_open(self.scene, self.solid, tested.reshape(-1, 3), normals, self.rays)
        return found.reshape(tested.shape[:2])


def _inhabited(scene: Scene, closed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (shapes,) bool, True if the camera, a lamp or a positional light is inside a closed shape.

    closed : (shapes,) bool, True for the shapes to test

    One point represents each piece of a lamp, because a shape may hold the lamps of several rooms. A piece does
    not count if it is small against the largest piece of its shape and against the closed shape around it, because
    a pin of a lamp may end in a slab.
    """
    inside = np.zeros(len(scene.shapes), bool)
    points = np.stack([
        scene.camera.at().position,
        *(light.position for light in scene.lights if light.kind != "directional"),
    ])  # fmt: skip
    counted_area = np.full(len(points), np.inf)
    emits = np.array([shape.emits for shape in scene.shapes], bool)
    lamps = np.flatnonzero(emits[scene.triangle_shape])
    if len(lamps):
        shape = np.broadcast_to(scene.triangle_shape[lamps, None, None], (len(lamps), 3, 1))
        piece = pieces(np.concatenate([scene.triangles[lamps], shape], axis=2))
        areas = scene.areas[lamps]
        order = np.lexsort((-areas, piece))  # the largest triangle of each piece comes first
        of_piece, first = np.unique(piece[order], return_index=True)
        largest = lamps[order[first]]
        piece_area, shape_of_piece = np.bincount(piece, areas)[of_piece], scene.triangle_shape[largest]
        largest_area = np.zeros(len(scene.shapes))
        np.maximum.at(largest_area, shape_of_piece, piece_area)
        piece_area[piece_area > _PIECE * largest_area[shape_of_piece]] = np.inf
        middles = scene.triangles[largest].mean(axis=1)
        off = 1e-6 * np.ptp(scene.triangles.reshape(-1, 3), axis=0).max() * scene.normals[largest]
        both = np.array([shape.emission_two_sided for shape in scene.shapes], bool)[scene.triangle_shape[largest]]
        points = np.concatenate([points, middles + off, (middles - off)[both]])
        counted_area = np.concatenate([counted_area, piece_area, piece_area[both]])
    for number in np.flatnonzero(closed):
        check_time()
        corners = scene.triangles[scene.shapes.ranges[number]]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        area = scene.areas[scene.shapes.ranges[number]].sum()
        near = points[((points > low) & (points < high)).all(axis=1) & (counted_area > _PIECE_IN_SHAPE * area)]
        for point in near:
            check_time()
            if abs(winding_number(corners, point)) > 0.5:
                inside[number] = True
                break
    return inside


def has_solids(scene: Scene) -> bool:
    """Return True if a shape is a closed surface but not a room, so that other surfaces may be buried in it."""
    closed = closed_shapes(scene)
    return bool(np.any(closed & ~_inhabited(scene, closed)))


def in_the_open(
    scene: Scene, solid: NDArray[np.bool_], points: Float64, normals: Float64, rays: Rays | None = None
) -> NDArray[np.bool_]:
    """Return (P,) bool, False for points of surfaces that are buried in a solid, such as a floor under a box.

    solid           : (T,) True for triangles of closed surfaces
    points, normals : (P, 3), points on surfaces, and unit normals that point away from the surfaces

    A point is buried if a ray along its normal and rays to three sides all hit the inside of a closed surface. At
    joins of walls and floors two faces lie in one plane, and which of them a ray hits first is arbitrary. Rays
    therefore start off the surface by more than rounding. Of two such faces, an exit from a solid takes precedence.
    """
    free = np.zeros(len(points), np.bool_)
    of_solid, normals = np.ascontiguousarray(solid), np.ascontiguousarray(normals)
    extent = float(np.ptp(scene.triangles.reshape(-1, 3), axis=0).max(initial=0.0))
    off = _OFF * (np.abs(points).max(axis=1, initial=0.0) + 0.01 * extent)
    rays = rays or rays_of(scene)
    origins, face = points + off[:, None] * normals, scene.normals

    def part(begin: int, end: int) -> None:
        some = (array[begin:end] for array in (origins, normals, off))
        _in_the_open(rays, of_solid, face, *some, np.empty((3, 3)), free[begin:end])

    in_threads(len(points), _TOGETHER, part, rays.stop)
    return free


@kernel
def _in_the_open(rays, solid, face, points, normals, off, work, free):  # type: ignore[no-untyped-def]
    """Set `free` (P,), which is all False before, to True for points that are not buried.

    off  : (P,) maximum distance between faces that count as lying in one plane
    work : (3, 3) working memory
    """
    o, d, found = work[0], work[1], work[2]
    for p in range(len(points)):
        for attempt in range(4):
            for k in range(3):
                o[k] = points[p, k]
                d[k] = normals[p, k]
            if attempt > 0:
                d[attempt - 1] += 0.7 if normals[p, attempt - 1] > 0 else -0.7
            hit, first = -1, 0.0
            buried = False
            for face_there in range(2):
                hit = nearest(rays, o, d, hit, found)
                if hit < 0 or (face_there == 1 and found[0] > first * (1 + _OFF) + 2 * off[p]):
                    break
                first = found[0]
                along = d[0] * face[hit, 0] + d[1] * face[hit, 1] + d[2] * face[hit, 2]
                if solid[hit] and along >= 0:
                    buried = True
                    break
            if not buried:
                free[p] = True
                break
