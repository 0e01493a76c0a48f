"""A radiosity solution as the eye sees it, on the CPU: what its elements look like, before any gather."""

from __future__ import annotations

import numpy as np

from glpath.hierarchy import Float64
from glpath.radiosity.solution import Lookup, RadiositySolution
from glpath.scene import Scene, path_traceable
from glpath.scene.preview import first_hits


def picture(solution: RadiositySolution, scene: Scene, lookup: Lookup = "interpolated") -> Float64:
    """(H, W, 3) float64 radiance at the middles of the camera's pixels: emitted, and reflected radiosity / pi.

    scene  : that it is a solution of, with the camera to look from
    lookup : "interpolated" between the vertices, or "constant" over each element

    Black where nothing is seen. Raises SceneError for a solution of another scene, UsageError for another lookup.
    """
    solution.check_scene(scene)
    traced = path_traceable(scene)
    triangle, distance = first_hits(traced)
    seen = triangle >= 0
    number, rays = triangle[seen], traced.camera.rays()[seen]
    places = traced.camera.position + distance[seen, None] * rays
    corners = traced.triangles[number]
    edges = corners[:, 1:] - corners[:, :1]
    # Least squares, as a place is never quite in the plane.
    gram = np.einsum("nik,njk->nij", edges, edges)
    along = np.einsum("nik,nk->ni", edges, places - corners[:, 0])
    barycentric = np.linalg.solve(gram, along[..., None])[..., 0]
    back = (np.einsum("ij,ij->i", traced.normals[number], rays) > 0).astype(np.int64)
    shape = traced.triangle_shape[number]
    emission = np.array([s.emission for s in traced.shapes])[shape]
    sides = np.array([s.emission_two_sided for s in traced.shapes])[shape]
    emitted = emission * ((back == 0) | sides)[:, None]
    image = np.zeros((*triangle.shape, 3))
    image[seen] = emitted + solution.lookup(number, barycentric, back, lookup) / np.pi
    return image
