"""Importance of a scene's light for a camera, estimated by particles that leave the camera.

The solver starts more particles where importance is high.

Importance is the adjoint of radiance (Pattanaik & Mudur 1993, Adjoint equations and random walks for illumination
computation).
"""

from __future__ import annotations

import numpy as np

from glpath.radiosity.form_factors.lights import BINS
from glpath.radiosity.mesh.mesh import Elements, Int64, divisions_of_size, size_for_count
from glpath.radiosity.shafts.rays import Rays, rays_of
from glpath.radiosity.solution import INDIRECT
from glpath.radiosity.solvers.particles import (
    BATCH,
    ENDLESS,
    Arrivals,
    Lamps,
    ParticleSurfaces,
    Starts,
    shoot_batch,
)
from glpath.sampling.points import uniform_sphere
from glpath.scene import Scene
from glpath.scene.model import Camera, Float64
from glpath.system.threads import worker_threads
from glpath.system.time_limit import check_time

#: Target number of cells in which particles of reflected light start, if importance distributes them over cells.
CELLS = 4096
#: Number of batches of camera paths that estimate importance.
_VISIT_BATCHES = 12
#: Number of batches of camera paths that estimate contributions to the image.
_VIEW_BATCHES = 1


def start_cells(scene: Scene, surface: Int64) -> Elements:
    """Return the cells in which particles of reflected light start: parts of triangles, all of similar size."""
    size = size_for_count(scene, surface, CELLS, by_size=True)
    return Elements.of_lattices(divisions_of_size(scene, surface, size))


def divisions_for_camera(scene: Scene, surface: Int64, size: float, count: int, seed: int) -> Int64:
    """Return (T,) parts of each triangle's edges, so that surfaces of high importance have smaller elements.

    Each smooth surface gets a fraction of `count` elements in proportion to its importance for the camera, but no
    element is larger than `size`.
    """
    cells = start_cells(scene, surface)
    visits = visits_from_camera(scene, rays_of(scene), cells, seed).sum(axis=0)
    of = np.bincount(surface[cells.triangle], visits, minlength=surface.max(initial=-1) + 1)
    area = np.bincount(surface, scene.areas, minlength=len(of))
    # Longest edge of an element: the hypotenuse of half a square that has the surface's area per element.
    longest = 2.0 * np.sqrt(area / np.maximum(count * of / max(float(of.sum()), 1e-300), 1e-300))
    return divisions_of_size(scene, surface, np.minimum(longest, size)[surface])


def visits_from_camera(
    scene: Scene, rays: Rays, cells: Elements, seed: int, came: Float64 | None = None
) -> Float64:
    """Return (2, C), importance of the sides of cells: about the fraction of their light that a camera sees.

    Half of the paths leave the camera in its view, half in all directions, as the camera may turn. They continue as
    particles do. Arrivals count after a reflection only, because the camera sees the first surface directly.

    came : (2, C, BINS) array to which the same sums are added, by bin of the direction from which paths arrive;
           None if these sums are not needed
    """
    return np.asarray(_from_camera(scene, rays, cells, seed, _VISIT_BATCHES, 0.5, ENDLESS, came).mean(axis=2))


def gathered_by_camera(scene: Scene, rays: Rays, elements: Elements, seed: int) -> Float64:
    """Return (2, E, 3), sr^-1, mean radiance that each element's side adds to a camera's image, per irradiance.

    Only sides count that the camera sees by one reflection, because a gather looks up these.
    """
    found = _from_camera(scene, rays, elements, seed, _VIEW_BATCHES, 1.0, 1, None) / (_VIEW_BATCHES * BATCH)
    return np.asarray(found * scene.side_reflectance[:, elements.triangle] / np.pi)


def _from_camera(
    scene: Scene,
    rays: Rays,
    cells: Elements,
    seed: int,
    batches: int,
    in_view: float,
    max_reflections: int,
    came: Float64 | None,
) -> Float64:
    """Return (2, C, 3), energy that camera paths bring to sides of cells after the first surface."""
    divisions = np.ones(len(scene.triangles), np.int64)
    np.maximum.at(divisions, cells.triangle, cells.n)
    surfaces, camera = ParticleSurfaces.of(scene, rays, divisions, from_eye=True), scene.camera.at()
    nothing = np.zeros(0, np.int64)
    lamps = Lamps(np.zeros((0, 9)), nothing, nothing, np.zeros(0), np.zeros((0, 3)))
    flux = np.zeros((2, 2, len(cells), 3))
    none = np.zeros(BATCH, np.int64)
    arrivals = Arrivals(flux, np.zeros((2, 0)), np.zeros((2, 0, BINS)) if came is None else came)
    doing, work = "finding what the camera sees", np.empty((4, 3))
    with worker_threads(rays.stop, doing=doing) as pool:
        for i in range(batches):
            check_time(doing)
            random = np.random.default_rng([seed, i, 0])
            origin, direction = _camera_rays(camera, random.random((BATCH, 2)), in_view)
            starts = Starts(origin, np.ones((BATCH, 3)), none - 1, none, direction)
            pool.submit(
                shoot_batch, 1 << 40 | i, seed, surfaces, lamps, starts, max_reflections, arrivals, work
            ).result()
    return np.asarray(flux[INDIRECT])


def _camera_rays(camera: Camera, u: Float64, in_view: float) -> tuple[Float64, Float64]:
    """Return origins and unit directions (N, 3) of paths from the camera, for u (N, 2) in [0, 1).

    in_view : fraction of the paths in the camera's view; the others leave in all directions
    """
    direction = uniform_sphere(u)
    origin = np.repeat(np.asarray(camera.position, np.float64)[None], len(u), axis=0)
    if camera.projection != "panorama":
        half = round(in_view * len(u))
        right, up, forward = camera.frame()
        width, height = camera.resolution
        at = (2 * u[:half] - 1) * [width * camera.pixel_aspect / height, 1.0]
        if camera.projection == "orthographic":
            at = at * (0.5 * camera.height) + camera.offset
            origin[:half] += at[:, :1] * right + at[:, 1:] * up
            direction[:half] = forward
        else:
            at = at * np.tan(np.radians(camera.fov) / 2) + camera.offset
            seen = forward + at[:, :1] * right + at[:, 1:] * up
            direction[:half] = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    return origin, direction
