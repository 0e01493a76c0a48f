"""Shadow-buffers of point lights: entries are what rays from the light meet, and lookups come to be shadow rays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from glpath.buffers.shadow_buffer import CubeShadowBuffer, PointShadowBuffer, ShadowTest, SphereShadowBuffer
from glpath.errors import UsageError
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.scene.model import Mesh, Scene, Shape
from tests.reference.numpy_ray_tracer import camera_rays, nearest, shape_of_primitive, surface_of
from tests.reference.shadow_cells import cube_directions, sphere_directions
from tests.support.objects import ball, camera, ground, rotation, scene_of

Float64 = NDArray[np.float64]


def buffer_for(
    scene: Scene, rows: int, kind: type[SphereShadowBuffer] | type[CubeShadowBuffer], lights: int = 1
) -> PointShadowBuffer:
    """Of about rows x 2 rows cells, whatever the kind."""
    gl = get_context().gl
    objects = DeviceScene(gl, scene)
    if kind is SphereShadowBuffer:
        return SphereShadowBuffer(gl, objects, rows, 2 * rows, lights)
    return CubeShadowBuffer(gl, objects, round(rows / np.sqrt(3)), lights)


BOTH = pytest.mark.parametrize("kind", [SphereShadowBuffer, CubeShadowBuffer], ids=["sphere", "cube"])


class Seen(NamedTuple):
    """Places that a camera sees, whose seen side faces the light; elsewhere shadows change nothing."""

    pixel: NDArray[np.intp]
    position: Float64
    normal: Float64
    object: NDArray[np.int64]
    lit: NDArray[np.bool_]


def seen(scene: Scene, light: Float64) -> Seen:
    """With the truth, by shadow rays in float64."""
    origins, d = camera_rays(scene)
    primitive, t = nearest(scene, origins, d)
    pixel = np.flatnonzero(primitive >= 0)
    position = origins[pixel] + t[pixel, None] * d[pixel]
    normal, _ = surface_of(scene, primitive[pixel], position)
    towards = light - position
    facing = np.einsum("ij,ij->i", normal, towards) * -np.einsum("ij,ij->i", normal, d[pixel]) > 0
    pixel, position, normal, towards = pixel[facing], position[facing], normal[facing], towards[facing]
    # From the light, so that a ray to a place on a surface ends there and does not start in its rounding.
    _, way = nearest(scene, np.broadcast_to(light, position.shape), -towards)
    return Seen(pixel, position, normal, shape_of_primitive(scene)[primitive[pixel]], way > 1 - 1e-7)


def wrong(buffer: PointShadowBuffer, at: Seen, test: ShadowTest = "distance", taps: int = 1) -> float:
    """Share of places whose shadow differs from that of exact rays."""
    found = buffer.visibility(0, at.position, at.normal, at.object, test, taps)
    return float(np.mean(np.abs(found - at.lit) > 0.5))


LIGHT = np.array([3.0, 5.0, 2.0])


@cache
def stack() -> Scene:
    """Three spheres on a ground, as in TB figure 9, and a triangle."""
    return scene_of(
        spheres=[ball((0, -1, 0), 1.0), ball((0, 0.6, 0), 0.6), ball((0, 1.5, 0), 0.3)],
        triangles=[[[1.2, -1.8, 1.0], [2.6, -1.8, -0.4], [1.7, 0.2, 0.2]]],
        planes=[ground()],
        view=camera((4, 2, 6), (0, -0.5, 0), resolution=(160, 120)),
    )


@cache
def knot() -> Scene:
    """A torus, one object of 400 triangles that throws shadows on itself, over a ground."""
    torus = trimesh.creation.torus(major_radius=1.2, minor_radius=0.5, major_sections=25, minor_sections=8)
    turned = torus.triangles @ rotation(np.random.default_rng(4)).T
    return scene_of(triangles=turned, planes=[ground()], view=camera((4, 3, 6), (0, -0.5, 0), resolution=(120, 90)))


@cache
def everything() -> Scene:
    """All kinds of objects on all sides of the light, and around it."""
    rng = np.random.default_rng(3)
    spheres = [ball(rng.normal(size=3) * 2, r) for r in rng.uniform(0.1, 0.8, 12)]
    spheres += [ball(rng.normal(size=3) * 2, 1.0) @ np.diag([0.6, 0.2, 0.4, 1.0]) for _ in range(3)]
    for flat in spheres[-3:]:
        flat[:, :3] = rotation(rng) @ flat[:, :3]
    spheres += [ball((0, 0, 0), 40.0)]
    triangles = rng.normal(size=(30, 1, 3)) * 2 + rng.normal(size=(30, 3, 3)) * rng.exponential(0.8, (30, 1, 1))
    tilted = np.concatenate([rotation(rng), np.array([[-3.0], [-4.0], [2.0]])], axis=1)
    return scene_of(spheres=spheres, triangles=triangles, planes=[ground(), tilted])


def assert_holds_what_rays_meet(scene: Scene, buffer: PointShadowBuffer, light: Float64, number: int) -> None:
    columns, rows = buffer.cells
    d = sphere_directions(rows, columns)[None] if buffer.shape == "sphere" else cube_directions(rows)
    primitive, t = nearest(scene, np.broadcast_to(light, (d.size // 3, 3)), d.reshape(-1, 3))
    entries = buffer.read(number)
    order = buffer.objects.numbering.spheres
    names = np.concatenate([order, np.arange(len(order), buffer.objects.count), [-1]])
    assert entries.primitive.shape == d.shape[:3]
    same = names[entries.primitive.ravel()] == primitive
    # But for a ray that passes an edge within rounding.
    assert np.mean(~same) < 1e-3
    np.testing.assert_allclose(entries.t.ravel()[same], t[same], rtol=2e-5)


@BOTH
def test_entries_are_what_rays_from_the_light_meet(kind: type[SphereShadowBuffer]) -> None:
    """For several lights, each in its own tile, whatever order they are filled in."""
    scene = everything()
    buffer = buffer_for(scene, 33, kind, lights=3)
    lights = np.array([[0.3, 0.1, -0.2], [2.0, 3.0, 1.0], [-1.0, 0.5, 4.0]]).astype(np.float32).astype(float)
    for number in (2, 0, 1):
        buffer.fill(lights[number], number)
    for number, light in enumerate(lights):
        assert_holds_what_rays_meet(scene, buffer, light, number)
    assert get_context().gl.error == "GL_NO_ERROR"


@BOTH
def test_a_buffer_is_kept_while_nothing_moves(kind: type[SphereShadowBuffer]) -> None:
    buffer = buffer_for(stack(), 20, kind, lights=2)
    assert buffer.key(0) is None
    assert buffer.fill(LIGHT, 0)
    tests, key = buffer.intersection_tests, buffer.key(0)
    assert tests > 0
    assert not buffer.fill(LIGHT, 0)
    assert buffer.intersection_tests == tests
    assert buffer.key(1) is None
    assert buffer.fill(LIGHT, 1)
    assert buffer.key(1) == key
    assert buffer.fill(LIGHT + 0.1, 0)
    assert buffer.key(0) != key
    assert buffer.intersection_tests > tests


@BOTH
def test_a_buffer_is_filled_again_when_an_object_moves(kind: type[SphereShadowBuffer]) -> None:
    before, after = (scene_of(spheres=[ball((x, 0, 0), 0.5)], planes=[ground()]) for x in (0.0, 3.0))
    buffer = buffer_for(before, 200, kind)
    below = np.array([[0.0, -2.0, 0.0], [3.0, -2.0, 0.0]])
    up = np.tile([0.0, 1.0, 0.0], (2, 1))
    for scene, lit in ((before, [0, 1]), (after, [1, 0]), (before, [0, 1])):
        buffer.objects = DeviceScene(buffer.gl, scene)
        buffer.fill((1.5, 8.0, 0.0))
        np.testing.assert_array_equal(buffer.visibility(0, below, up, [1, 1]), lit)
        assert not buffer.fill((1.5, 8.0, 0.0))


@BOTH
def test_far_fewer_rays_are_shot_than_there_are_cells_and_objects(kind: type[SphereShadowBuffer]) -> None:
    """TB's argument: the count hardly grows with the number of objects, when they fill the same view."""
    counts = []
    for n in (5, 20):
        grid = np.linspace(-2, 2, n)
        spheres = [ball((x, y, -4), 1.8 / n) for x in grid for y in grid]
        buffer = buffer_for(scene_of(spheres=spheres), 200, kind)
        buffer.fill((0.1, 0.2, 0.0))
        counts.append(buffer.intersection_tests)
        primitive = buffer.read().primitive
        assert np.sum(primitive >= 0) <= buffer.intersection_tests <= 1.7 * np.sum(primitive >= 0)
    assert counts[1] < 1.3 * counts[0]


# Closed forms: whoever stands inside a convex room, or outside of a convex body on the side of the light, is lit.


def random_places(triangles: Float64, n: int) -> tuple[Float64, Float64]:
    rng = np.random.default_rng(8)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normals, axis=1)
    which = rng.choice(len(triangles), n, p=area / area.sum())
    root, v = np.sqrt(rng.random((n, 1))), rng.random((n, 1))
    corners = triangles[which]
    places = (1 - root) * corners[:, 0] + root * ((1 - v) * corners[:, 1] + v * corners[:, 2])
    return places, (normals / area[:, None])[which]


@BOTH
@pytest.mark.parametrize("away", [0.0, 1000.0])
@pytest.mark.parametrize("outside", [False, True], ids=["inside", "outside"])
@pytest.mark.parametrize("body", ["box", "icosphere", "sphere"])
def test_a_convex_surface_does_not_shadow_itself(
    kind: type[SphereShadowBuffer], away: float, outside: bool, body: str
) -> None:
    """Not one place, in a coarse buffer, with filters, slanted to the light or not, far from the origin."""
    light = np.array([2.0, 1.4, 3.0] if outside else [0.3, -0.2, 0.1]) + away
    mesh = trimesh.creation.box((2, 3, 1.5)) if body == "box" else trimesh.creation.icosphere(2)
    places, normals = random_places(np.asarray(mesh.triangles, float), 20_000)
    if body == "sphere":
        places = normals = places / np.linalg.norm(places, axis=1, keepdims=True)
        scene = scene_of(spheres=[ball((away,) * 3, 1.0)])
    else:
        scene = scene_of(triangles=np.asarray(mesh.triangles) + away)
    places = places + away
    towards = np.einsum("ij,ij->i", normals, light - places)
    # Not those in the light's own horizon, which rounding of the scene may move to either side.
    some = towards > 1e-6 * away if outside else np.full(len(places), True)
    for rows in (20, 100):
        buffer = buffer_for(scene, rows, kind)
        buffer.fill(light)
        for taps in (1, 4):
            found = buffer.visibility(0, places[some], normals[some], np.zeros(np.sum(some)), taps=taps)
            assert np.all(found > 1 - 1e-6), f"{np.sum(found <= 1 - 1e-6)} places of {len(found)}"


@BOTH
def test_nothing_leaks_through_a_wall(kind: type[SphereShadowBuffer]) -> None:
    """Behind a wall that stands on the ground all is dark, up to a cell from the line where they meet."""
    wall = np.array([[-9.0, -2, -1], [9, -2, -1], [9, 3, -1], [-9, 3, -1]])
    scene = scene_of(triangles=wall[[[0, 1, 2], [0, 2, 3]]], planes=[ground()])
    buffer = buffer_for(scene, 100, kind)
    light = np.array([0.3, 0.0, 1.5])
    buffer.fill(light)
    rng = np.random.default_rng(0)
    places = np.stack(
        [rng.uniform(-3, 3, 20_000), np.full(20_000, -2.0), -1 - rng.exponential(0.3, 20_000)], axis=1
    )
    up = np.tile([0.0, 1.0, 0.0], (len(places), 1))
    found = buffer.visibility(0, places, up, np.ones(len(places)))
    # A cell is about 0.03 wide and three times as long, seen from there on the ground.
    assert np.all(found[places[:, 2] < -1.3] == 0)
    assert np.mean(found) < 0.08


def test_without_objects_all_is_lit() -> None:
    buffer = buffer_for(scene_of(planes=[ground()]), 10, SphereShadowBuffer)
    buffer.fill(LIGHT)
    found = buffer.visibility(0, [[0.0, -2.0, 0.0], [0.0, 50.0, 0.0]], [[0, 1.0, 0]] * 2, [0, 7], taps=2)
    np.testing.assert_array_equal(found, 1)


# Against exact shadow rays.

RESOLUTIONS = (50, 100, 200, 400, 800)


@BOTH
@pytest.mark.parametrize(("make", "bound"), [(stack, 2e-3), (knot, 4e-3)], ids=["stack", "torus"])
def test_shadows_converge_to_exact_shadow_rays(
    kind: type[SphereShadowBuffer], make: Callable[[], Scene], bound: float
) -> None:
    scene = make()
    at = seen(scene, LIGHT)
    assert 0.02 < np.mean(~at.lit) < 0.6
    table = []
    for rows in RESOLUTIONS:
        buffer = buffer_for(scene, rows, kind)
        buffer.fill(LIGHT)
        table.append([wrong(buffer, at, "distance", taps) for taps in (1, 3)])
        print(f"{buffer.shape} {buffer.cells} nearest {table[-1][0]:.5f} 3 x 3 taps {table[-1][1]:.5f}")
    shares = np.array(table)
    assert np.all(np.diff(shares, axis=0) < 0), shares
    # The error is that of an outline's width, so it halves as the resolution doubles.
    assert np.all(shares[-1] < bound)
    assert np.all(shares[-1] < shares[0] / 8)


@BOTH
def test_identity_is_wrong_where_an_object_shadows_itself(kind: type[SphereShadowBuffer]) -> None:
    """The paper's rule lights the torus all over, however fine the buffer; a comparison of distances does not."""
    scene = knot()
    at = seen(scene, LIGHT)
    torus = at.object == 0
    at = Seen(*(field[torus] for field in at))
    dark = float(np.mean(~at.lit))
    buffer = buffer_for(scene, 600, kind)
    buffer.fill(LIGHT)
    by_identity, by_distance = wrong(buffer, at, "identity"), wrong(buffer, at, "distance")
    print(
        f"{buffer.shape}: {dark:.4f} in shadow; wrong by identity {by_identity:.4f}, by distance {by_distance:.4f}"
    )
    assert dark > 0.05
    assert by_identity > 0.9 * dark
    assert by_distance < 0.05 * dark


@BOTH
def test_identity_is_right_for_convex_objects_in_a_fine_buffer(kind: type[SphereShadowBuffer]) -> None:
    at = seen(stack(), LIGHT)
    shares = []
    for rows in (50, 200, 800):
        buffer = buffer_for(stack(), rows, kind)
        buffer.fill(LIGHT)
        shares.append(wrong(buffer, at, "identity"))
    assert shares[0] > 2 * shares[1] > 4 * shares[2]
    assert shares[2] < 0.02


def test_the_cube_uses_its_cells_better_than_the_sphere() -> None:
    """Equal numbers of cells, lights all around: fewer wrong pixels on the whole, the largest cell is smaller."""
    scene = stack()
    rng = np.random.default_rng(11)
    shares = []
    for _ in range(8):
        way = rng.normal(size=3)
        light = 5 * way / np.linalg.norm(way)
        light[1] = abs(light[1])
        at = seen(scene, light)
        row = []
        for kind in (SphereShadowBuffer, CubeShadowBuffer):
            buffer = buffer_for(scene, 100, kind)
            buffer.fill(light)
            row.append(wrong(buffer, at))
        shares.append(row)
    sphere, cube = np.mean(shares, axis=0)
    print(f"wrong pixels: sphere {sphere:.5f}, cube {cube:.5f}")
    assert cube < sphere


# Filters.


@BOTH
@pytest.mark.parametrize("test", ["distance", "identity"])
def test_a_filter_is_smooth_and_keeps_the_mean(kind: type[SphereShadowBuffer], test: ShadowTest) -> None:
    """Across a shadow's edge on the ground: many levels, no jump, and as much light as without a filter."""
    scene = scene_of(spheres=[ball((0, 0, 0), 0.7)], planes=[ground()])
    buffer = buffer_for(scene, 60, kind)
    buffer.fill((0.4, 4.0, 0.3))
    x, z = np.meshgrid(np.linspace(-2.5, 2.5, 400), np.linspace(-2.5, 2.5, 400))
    places = np.stack([x, np.full_like(x, -2.0), z], axis=-1).reshape(-1, 3)
    up = np.tile([0.0, 1.0, 0.0], (len(places), 1))
    plain, bilinear, wide = (
        buffer.visibility(0, places, up, np.full(len(places), 1), test, taps).reshape(x.shape) for taps in (1, 2, 4)
    )
    assert set(np.unique(plain)) == {0, 1}
    for smooth, steepest in ((bilinear, 0.35), (wide, 0.2)):
        assert abs(smooth.mean() - plain.mean()) < 2e-3
        assert smooth.min() == 0
        assert smooth.max() > 1 - 1e-6
        # A cell is 0.3 wide on the ground, 25 places.
        assert np.abs(np.diff(smooth, axis=0)).max() < steepest
        assert np.abs(np.diff(smooth, axis=1)).max() < steepest
        assert len(np.unique(np.round(smooth, 3))) > 50


@BOTH
@pytest.mark.parametrize(
    "towards",
    [
        (1.0, 1e-3, 0.05),
        (0.01, 0.02, 1.0),
        (0.0, -0.01, -1.0),
        (1.0, 1.0, 1.0),
        (1.0, -1.0, 0.02),
        (-1.0, 0.0, 1.0),
    ],
    ids=["seam", "north pole", "south pole", "corner", "edge", "another edge"],
)
def test_shadows_are_whole_across_seams_poles_edges_and_corners(
    kind: type[SphereShadowBuffer], towards: tuple[float, float, float]
) -> None:
    """A ball throws its round shadow on a screen behind it, whichever way that is; also with a filter."""
    way = np.array(towards) / np.linalg.norm(towards)
    side = np.cross(way, [0.3, 0.5, -0.8])
    side /= np.linalg.norm(side)
    over = np.cross(side, way)
    screen = np.stack([side, over, -way, 4 * way], axis=1)
    scene = scene_of(spheres=[ball(2 * way, 0.5)], planes=[screen])
    buffer = buffer_for(scene, 151, kind)
    buffer.fill((0.0, 0.0, 0.0))
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-2, 2, (2, 20_000))
    places = 4 * way + u[:, None] * side + v[:, None] * over
    radius = 4 * 0.5 / np.sqrt(2.0**2 - 0.5**2)
    distance = np.hypot(u, v) - radius
    # Half a cell's diagonal at this distance, and as much for what the filter reaches.
    cell = 4 * np.pi / 151 if kind is SphereShadowBuffer else 4 * np.pi / 2 / buffer.cells[0]
    facing = np.tile(-way, (len(places), 1))
    for taps in (1, 3):
        found = buffer.visibility(0, places, facing, np.full(len(places), 1), taps=taps)
        reach = (0.75 if taps == 1 else 2.2) * cell
        assert np.all(found[distance < -reach] == 0), taps
        assert np.all(found[distance > reach] > 1 - 1e-6), taps


# What a user may ask for.


def test_what_is_impossible_is_refused() -> None:
    gl = get_context().gl
    objects = DeviceScene(gl, stack())
    for make in (
        lambda: SphereShadowBuffer(gl, objects, 0, 10),
        lambda: CubeShadowBuffer(gl, objects, 100_000),
        lambda: CubeShadowBuffer(gl, objects, 8, lights=0),
        lambda: CubeShadowBuffer(gl, objects, 8).defines("distance", 0),
        lambda: CubeShadowBuffer(gl, objects, 8).defines("distance", 9),
    ):
        with pytest.raises(UsageError):
            make()


def test_a_light_in_or_on_an_object() -> None:
    """Inside of a ball all outside is dark; on a plane, the plane itself is not in the way."""
    scene = scene_of(spheres=[ball((0, 0, 0), 0.5)], planes=[ground()])
    places = np.array([[0.0, -2.0, 0.0], [1.0, -2.0, 1.0]])
    up = np.tile([0.0, 1.0, 0.0], (2, 1))
    for kind in (SphereShadowBuffer, CubeShadowBuffer):
        buffer = buffer_for(scene, 40, kind)
        buffer.fill((0.1, 0.0, 0.1))
        np.testing.assert_array_equal(buffer.visibility(0, places, up, [1, 1]), 0)
        buffer.fill((3.0, -2.0, 0.0))
        ball_side = np.array([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]])
        found = buffer.visibility(0, ball_side, ball_side * 2, [0, 0])
        assert found[0] == 1


def test_shape_is_what_identity_compares() -> None:
    """Two triangles of one shape don't shadow each other by identity; of two shapes they do."""
    low = np.array([[-1.0, 0, -1], [3, 0, -1], [-1, 0, 3]])
    triangles = np.stack([low, low + np.array([0.0, 1.0, 0.0])])
    one = scene_of(triangles=triangles)
    two = replace(
        one, shapes=[Shape(name, Mesh.of_triangles(t[None]), 0) for name, t in zip("ab", triangles, strict=True)]
    )
    for scene, expected in ((one, 1), (two, 0)):
        buffer = buffer_for(scene, 40, SphereShadowBuffer)
        buffer.fill((0.0, 4.0, 0.0))
        found = buffer.visibility(0, [[0.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]], [0], "identity")
        assert found[0] == expected
        assert buffer.visibility(0, [[0.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]], [0], "distance")[0] == 0


@BOTH
def test_hundreds_of_lights_are_each_their_own(kind: type[SphereShadowBuffer]) -> None:
    """More than uniforms could hold the positions of: OpenGL promises a fragment shader 1024 numbers."""
    count, n = 400, 64
    rng = np.random.default_rng(2)
    scene = stack()
    at = seen(scene, LIGHT)
    some = rng.choice(len(at.pixel), n)
    places = at.position[some], at.normal[some], at.object[some]
    lights = rng.normal(size=(count, 3)) * 3 + [0, 6, 0]
    many, one = buffer_for(scene, 16, kind, count), buffer_for(scene, 16, kind)
    for number, light in enumerate(lights):
        many.fill(light, number)
    shares = []
    for number in (0, 1, 255, 256, 300, 399):
        one.fill(lights[number])
        found = many.visibility(number, *places)
        np.testing.assert_array_equal(found, one.visibility(0, *places))
        shares.append(found)
    assert len(np.unique(shares, axis=0)) > 3


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        ("fill", ("x",), "position"),
        ("fill", ([0, 0],), "position"),
        ("fill", ([0, 0, np.nan],), "position"),
        ("fill", ([0, 0, 0], 1), "light"),
        ("fill", ([0, 0, 0], -1), "light"),
        ("read", (1,), "light"),
        ("read", ("x",), "light"),
        ("defines", ("x",), "test"),
        ("defines", ("distance", "x"), "taps"),
        ("visibility", (1, [[0, 0, 0]], [[0, 0, 1]], [0]), "light"),
        ("visibility", (0, [[0, 0]], [[0, 0, 1]], [0]), "positions of shape"),
        ("visibility", (0, [[0, 0, 0]], [[0, 0]], [0]), "normals of shape"),
        ("visibility", (0, [[0, 0, 0]], [[0, 0, 1]], [0, 1]), "objects of shape"),
    ],
)
def test_wrong_arguments_of_methods_are_refused(method: str, arguments: tuple[Any, ...], message: str) -> None:
    gl = get_context().gl
    buffer = CubeShadowBuffer(gl, DeviceScene(gl, stack()), 8)
    with pytest.raises(UsageError, match=message):
        getattr(buffer, method)(*arguments)


@pytest.mark.parametrize("side", ["x", 2.5, -1, 10**9, 2**70])
def test_wrong_size_of_a_face_is_refused(side: Any) -> None:
    gl = get_context().gl
    with pytest.raises(UsageError):
        CubeShadowBuffer(gl, DeviceScene(gl, stack()), side)
