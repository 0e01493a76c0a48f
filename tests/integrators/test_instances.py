"""A scene whose meshes are there once, below a tree of instances, has the picture of all of their triangles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.film.film import Film
from glpath.gl import instance_numbers, ray_bvh
from glpath.integrators.path_settings import PathSettings
from glpath.radiosity import memory
from glpath.rendering import factory
from glpath.scene import instances
from glpath.scene.model import Material, Mesh, Scene, Shape, Shapes, Sky, Texture, TextureSlot
from glpath.scene.motion import Motion
from tests.support.surfaces import camera, lamp, level, quad, scene_of, squares
from tests.support.witnesses import bumps, noise

AOVS = ("albedo", "normal", "position", "uv", "object_id", "material_id", "direct")


def bumpy_ball(parts: int = 16) -> Mesh:
    """A closed surface of 2 parts^2 triangles with texture coordinates, smooth normals and colours of vertices."""
    u, v = (grid.ravel() for grid in np.meshgrid(*[np.linspace(0, 1, parts + 1)] * 2))
    around, up = 2 * np.pi * u, 0.96 * np.pi * (v - 0.5)
    radius = 1 + 0.2 * np.sin(3 * around) * np.cos(5 * up)
    unit = np.stack([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)], axis=1)
    colours = np.column_stack([np.full((len(u), 3), 0.5) + 0.5 * np.abs(unit), np.ones(len(u))])
    faces = quad([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], parts).faces
    # Not about its own origin.
    vertices = 3.0 + radius[:, None] * unit
    return Mesh(vertices, faces, np.stack([u, v], axis=1), unit, colours=colours)


def maps(count: int, x: float) -> Any:
    """(N, 3, 4): turned, stretched, sheared, every third one mirrored, in a row along z."""
    random = np.random.default_rng(int(10 * abs(x)))
    found = np.empty((count, 3, 4))
    found[:, :, :3] = np.linalg.qr(random.normal(size=(count, 3, 3)))[0] * random.uniform(0.15, 0.4, (count, 1, 3))
    found[:, 0, 1] += 0.1
    found[::3, :, 0] *= -1
    middle = np.stack([np.full(count, x), random.uniform(0.3, 0.8, count), np.linspace(-1.2, 1.2, count)], axis=1)
    found[:, :, 3] = middle - found[:, :, :3] @ np.full(3, 3.0)
    return found


def many_things(blend: bool = False) -> Scene:
    """Balls of one mesh and five materials: normal map, brushed metal, mask or blend, thin glass, solid glass."""
    textures = (
        Texture("noise", noise(8, 8, low=0.3)),
        bumps(),
        replace(squares(6), filter="nearest"),
    )
    white = np.ones(3)
    balls = [
        Material("mapped", white, texture=TextureSlot(0), normal_texture=TextureSlot(1), normal_scale=5.0),
        Material("brushed", white, roughness=0.5, metallic=1.0, anisotropy=0.7, anisotropy_angle=20.0),
        Material("lattice", white, texture=TextureSlot(2), alpha="blend" if blend else "mask", opacity=0.7),
        Material("pane", 0.9 * white, roughness=0.0, transmission=1.0),
        Material("solid", 0.9 * white, roughness=0.1, transmission=1.0, thin=False),
    ]
    ball = bumpy_ball()
    shapes = [
        Shape("floor", level(0.0, 4.0), 0),
        lamp(level(4.0, 1.0, down=True), radiance=(9.0, 8.0, 7.0)),
        *(Shape(each.name, ball, 1 + i, maps(4, 1.1 * i - 2.2)) for i, each in enumerate(balls)),
        Shape("beside", ball, 1, maps(2, 2.9)),  # a second shape of a mesh and a material
    ]
    view = replace(camera((0.4, 2.6, 5.5), (0, 0.3, 0)), resolution=(64, 48))
    grey = Material("grey", np.full(3, 0.5))
    return scene_of(shapes, [grey, *balls], view, textures, sky=Sky(white, np.full(3, 0.4)))


def film(scene: Scene, monkeypatch: pytest.MonkeyPatch, once: bool, **more: Any) -> Film:
    def parted(scene: Scene) -> instances.InstancedScene | None:
        monkeypatch.setattr(instances, "MIN_SAVED", 1 if once else 1 << 40)
        found = instances.instanced(scene)
        assert (found is not None) == once
        return found

    monkeypatch.setattr(factory, "instanced", parted)
    return glpath.render(scene, integrator=PathSettings(aovs=AOVS, max_depth=6), **more)


def share_that_differs(a: Any, b: Any) -> float:
    """Of pixels; rays through the edge between two triangles may meet either."""
    return float(np.mean(~np.isclose(a, b, rtol=2e-3, atol=2e-4).all(axis=-1)))


def test_the_picture_is_that_of_all_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = many_things()
    once, expanded = (film(scene, monkeypatch, kept, spp=4) for kept in (True, False))
    for name in ("object_id", "material_id"):
        assert np.mean(once.aov(name) != expanded.aov(name)) < 0.002
    assert set(np.unique(once.aov("object_id"))) >= set(range(3, 9))
    for name in ("position", "uv", "normal", "albedo"):
        assert share_that_differs(once.aov(name), expanded.aov(name)) < 0.005, name
    # Of many bounces: a ray that meets another triangle has another path from there.
    assert share_that_differs(once.mean, expanded.mean) < 0.01
    assert share_that_differs(once.aov("direct"), expanded.aov("direct")) < 0.005
    assert once.mean.mean() == pytest.approx(expanded.mean.mean(), rel=1e-3)


def test_blended_instances_let_the_same_share_of_light_through(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chance depends on the number of a triangle, so that the two agree on average alone."""
    scene = many_things(blend=True)
    once, expanded = (film(scene, monkeypatch, kept, spp=64) for kept in (True, False))
    apart = once.mean - expanded.mean
    blocks = apart.reshape(6, 8, 8, 8, 3).mean(axis=(1, 3))
    variance = once.variance_of_mean() + expanded.variance_of_mean()
    error = np.sqrt(variance.reshape(6, 8, 8, 8, 3).mean(axis=(1, 3)))
    assert np.mean(np.abs(blocks) > 3 * error) < 0.01


@pytest.mark.parametrize(("where", "name"), [(ray_bvh, "_NEAR_GROUPS"), (instance_numbers, "_FREE")])
def test_numbers_of_large_scenes_find_the_same(where: Any, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of nodes beyond 20 bits, and of triangles in several blocks an instance."""
    scene = many_things()
    small = film(scene, monkeypatch, True, spp=1)
    monkeypatch.setattr(where, name, 0)
    assert np.array_equal(small.mean, film(scene, monkeypatch, True, spp=1).mean)


def test_what_has_no_second_instance_or_shines_is_left_as_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instances, "MIN_SAVED", 1)
    ball = bumpy_ball()
    three = maps(3, 0.0)
    flattened = three * [[[1.0], [1.0], [1e-7]]]
    shapes = [
        Shape("kept", ball, 0, three),
        Shape("shines", ball, 0, three, emission=np.ones(3)),
        Shape("single", bumpy_ball(), 0),
        Shape("small", level(0.0), 0, three),
        Shape("flattened", ball, 0, flattened),
        Shape("of another material", ball, 1, three[:1]),
    ]
    scene = scene_of(shapes, [Material("a", np.ones(3)), Material("b", np.ones(3))], camera((0, 1, 5)))
    parted = instances.instanced(scene)
    assert parted is not None
    assert parted.shape.tolist() == [0, 0, 0]
    assert parted.resident.shapes.total("triangle") == scene.shapes.total("triangle") - 2 * len(ball.faces)
    lower, upper = parted.boxes
    corners = scene.triangles[: 3 * len(ball.faces)].reshape(3, -1, 3)
    assert np.allclose(lower, corners.min(axis=1))
    assert np.allclose(upper, corners.max(axis=1))


def test_a_scene_that_saves_little_or_moves_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = many_things()
    assert instances.instanced(scene) is None
    monkeypatch.setattr(instances, "MIN_SAVED", 1)
    assert instances.instanced(scene) is not None
    times, keys = np.array([0.0, 1.0]), np.stack([np.eye(3, 4)] * 2)
    keys[1, :, 3] = 1.0
    moving = replace(scene.shapes[0], motion=Motion(times, keys, scene.shapes[0].world_from_object))
    shapes = Shapes([moving, *scene.shapes[1:]])
    shutter = replace(scene.camera, shutter=(0.0, 1.0))
    assert instances.instanced(replace(scene, shapes=shapes, camera=shutter)) is None


def test_a_solution_is_of_all_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """A gather finds its elements by their numbers."""
    asked: list[Scene] = []
    monkeypatch.setattr(factory, "instanced", lambda scene: asked.append(scene))
    things = many_things()
    balls = Shape("balls", bumpy_ball(6), 0, maps(2, 0.0))
    small = replace(things, shapes=Shapes([*things.shapes[:2], balls])).with_camera(resolution=(16, 12))
    glpath.render(small, integrator="gather", spp=1)
    assert not asked
    glpath.render(small, integrator="path", guide="cosine", spp=1)
    assert len(asked) == 1


@pytest.mark.parametrize("integrator", ["gather", "path-buffer", "classic"])
def test_triangles_of_all_instances_that_memory_does_not_hold_are_refused(
    integrator: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: 1 << 30)
    balls = Shape("balls", bumpy_ball(), 0, np.tile(np.eye(3, 4), (3000, 1, 1)))
    scene = scene_of([lamp(level(4.0)), balls], [Material("grey", np.full(3, 0.5))], camera((3, 3, 9), (3, 3, 3)))
    with pytest.raises(glpath.SceneError, match="1,536,002 triangles of all instances of 514 would take") as caught:
        glpath.render(scene, integrator=integrator, spp=1)
    assert 'integrator="path"' in str(caught.value)
