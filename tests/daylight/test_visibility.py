"""Points on streamed triangles: scans find what rays find in the same triangles in memory."""

from __future__ import annotations

import numpy as np

from benchmarks.benches.parallel_rays import neighbouring
from glpath.daylight.visibility import visible
from tests.gl.test_streams import SKY, corners, in_memory, scene_of
from tests.support.terrain import Hills


def test_points_of_a_stream_see_what_they_see_of_the_same_in_memory() -> None:
    hills = Hills(2, 12)
    triangles = corners(hills)
    points = triangles.mean(axis=1)[::5]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[::5]
    directions = neighbouring(8) @ np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    of_stream = scene_of({"type": "stream", "stream": hills}, **SKY)
    of_memory = scene_of({"type": "mesh", **in_memory(triangles)}, **SKY)
    streamed, rays = (
        np.stack(list(visible(scene, points, normals, directions))) for scene in (of_stream, of_memory)
    )
    assert 0.3 < rays.mean() < 0.99
    # Rays have edges that are a little wider.
    assert np.count_nonzero(streamed != rays) <= 0.002 * rays.size
