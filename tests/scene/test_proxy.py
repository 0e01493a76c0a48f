"""Meshes in place of streams: few triangles, of the same surface, and closed where that is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from glpath.scene.proxy import TRIANGLES, with_proxies
from glpath.scene.tessellate import unit_sphere
from glpath.system.time_limit import limited, named_work
from tests.support.clock import Clock
from tests.support.streams import SKY, Given, scene_of, streamed_corners
from tests.support.terrain import Hills


def streamed(*chunks: Any) -> glpath.Scene:
    return glpath.load_scene(
        {
            "camera": {"position": [0, 3, 6], "target": [0, 0, 0]},
            **SKY,
            "shapes": [{"type": "stream", "stream": Given(*chunks)}],
        }
    )


def sphere(subdivisions: int) -> NDArray[np.float64]:
    mesh = unit_sphere(subdivisions, with_uv=False)
    return np.asarray(mesh.vertices[mesh.faces], np.float64)


def test_a_stream_of_few_triangles_is_its_own_proxy():
    hills = Hills(2, 12)
    found = with_proxies(scene_of({"type": "stream", "stream": hills}))
    np.testing.assert_array_equal(found.scene.triangles[found.first :], streamed_corners(hills))
    assert found.first == 14
    assert found.cell == 0
    assert found.area == pytest.approx(1)


def test_what_was_in_memory_keeps_its_numbers_and_streams_their_materials():
    before = scene_of({"type": "stream", "stream": Hills(1, 4)})
    shapes = (before.shapes[2], *before.shapes[:2])  # the stream first
    found = with_proxies(glpath.Scene(**{**before.__getstate__(), "shapes": shapes}))
    np.testing.assert_array_equal(found.scene.triangles[: found.first], before.triangles)
    assert [shape.material for shape in found.scene.shapes] == [shape.material for shape in before.shapes]


def test_of_many_triangles_some_thousand_are_left_of_nearly_the_same_area():
    found = with_proxies(scene_of({"type": "stream", "stream": Hills(3, 80)}))
    count = len(found.scene.triangles) - found.first
    assert 0.7 * TRIANGLES < count <= TRIANGLES
    assert 0.8 < found.area < 1.02  # what is rough is smoother


def test_a_closed_surface_stays_closed():
    corners = sphere(6)
    found = with_proxies(streamed(*np.array_split(corners, 7)), 2000).scene
    faces = found.shapes.faces
    assert 1000 < len(faces) <= 2000
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward, backward = ({tuple(edge) for edge in part.tolist()} for part in (edges, edges[:, ::-1]))
    assert forward == backward
    # The volume by the divergence theorem: fronts are outside.
    a, b, c = found.triangles.swapaxes(0, 1)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=0.05)


def test_chunks_do_not_matter():
    corners = sphere(6)
    one, many = (
        with_proxies(streamed(*chunks), 2000).scene for chunks in ([corners], np.array_split(corners[::-1], 50))
    )
    np.testing.assert_allclose(many.shapes.vertices, one.shapes.vertices, atol=1e-12)
    np.testing.assert_array_equal(many.shapes.faces, one.shapes.faces)


def test_what_is_smaller_than_a_cell_is_missed_in_the_area():
    random = np.random.default_rng(3)
    leaves = random.uniform(-1, 1, (20_000, 1, 3)) + random.uniform(-1, 1, (20_000, 3, 3)) * 1e-4
    assert with_proxies(streamed(leaves)).area < 0.1


def test_a_time_limit_ends_the_simplification_of_streams(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    scene = streamed(*np.random.default_rng(1).random((3, 1000, 3, 3)))

    def corner_areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
        clock.ahead = 9.0
        return np.ones(3 * len(triangles))

    monkeypatch.setattr("glpath.scene.proxy._corner_areas", corner_areas)
    with (
        limited(2.0),
        pytest.raises(glpath.TimeLimitError, match="over while simplifying"),
        named_work("simplifying"),
    ):
        with_proxies(scene, 100)
