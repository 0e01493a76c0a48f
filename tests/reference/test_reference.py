"""The witnesses against each other: closed forms, the numpy path tracer, and Mitsuba as the peer.

Statistical tests have a fixed seed, and say how many standard errors they allow: 4 where one number is
compared, more where the largest of many is.
"""

from __future__ import annotations

import functools
import json
import sys

import numpy as np
import pytest
from scipy import integrate

from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.references.stored import stored_reference
from glpath.compare import relative_mse
from glpath.errors import GlpathError
from glpath.io import load_scene
from glpath.scene.model import Camera, Material, Mesh, Scene, Shape, Shapes
from tests.reference import closed_forms
from tests.reference.numpy_path_tracer import nearest_hits, path_trace
from tests.support.repository import ROOT

DATA = ROOT / "benchmarks" / "references"

GREY = Material("grey", np.full(3, 0.5))
BLACK = Material("black", np.zeros(3))


def quad(corner, u, v):
    """Two triangles; the front is towards u x v."""
    a, u, v = np.array(corner, float), np.array(u, float), np.array(v, float)
    return np.array([[a, a + u, a + u + v], [a, a + u + v, a + v]])


def quad_facing_up(a, b, z):
    return quad((-a / 2, -b / 2, z), (a, 0, 0), (0, b, 0))


def quad_facing_down(a, b, z):
    return quad((-a / 2, -b / 2, z), (0, b, 0), (a, 0, 0))


def cube(size=1.0, inside=True):
    """Twelve triangles about the origin."""
    h, faces = size / 2, []
    for axis in range(3):
        for side in (-1, 1):
            corner, u, v = np.full(3, -h), np.zeros(3), np.zeros(3)
            corner[axis], u[(axis + 1) % 3], v[(axis + 2) % 3] = side * h, size, size
            faces.append(quad(corner, v, u) if (side > 0) == inside else quad(corner, u, v))
    return np.concatenate(faces)


def scene_of(camera, *parts):
    """A scene of (triangles, Material, emission, emission_two_sided) parts; the last two may be left out."""
    shapes = []
    for i, (triangles, _, *light) in enumerate(parts):
        emission, two_sided = (*light, *(np.zeros(3), False)[len(light) :])
        emission = np.broadcast_to(np.asarray(emission, float), 3)
        mesh = Mesh.of_triangles(triangles)
        shapes.append(Shape(f"part{i}", mesh, i, emission=emission, emission_two_sided=two_sided))
    return Scene("test", camera, Shapes(shapes), tuple(p[1] for p in parts))


def camera(position, target, up=(0, 0, 1), fov=40.0, resolution=(1, 1)):
    return Camera(np.array(position, float), np.array(target, float), np.array(up, float), fov, resolution)


def look_at_point(position, target, up=(0, 1, 0)):
    """One pixel so narrow that all of it sees the same point."""
    return camera(position, target, up, fov=1e-3)


def assert_within(mean, variance_of_mean, expected, sigmas=4.0):
    error = np.abs(mean - expected)
    allowed = sigmas * np.sqrt(variance_of_mean) + 1e-6 * np.abs(expected)
    assert np.all(error <= allowed), f"{np.max(error / np.sqrt(variance_of_mean + 1e-300)):.1f} standard errors off"


# ---- closed forms against each other


def test_four_corner_rectangles_are_lamberts_polygon():
    point, height, (x0, x1, y0, y1) = np.array([0.2, -0.1, 0.0]), 1.3, (-0.5, 1.0, -0.7, 0.4)
    corners = [(x0, y0, height), (x0, y1, height), (x1, y1, height), (x1, y0, height)]
    by_polygon = closed_forms.polygon_irradiance(point, (0, 0, 1), corners, radiance=2.0)
    sides = [(a, b) for a in (point[0] - x0, x1 - point[0]) for b in (point[1] - y0, y1 - point[1])]
    by_corners = 2.0 * np.pi * sum(closed_forms.corner_form_factor(a, b, height) for a, b in sides)
    assert by_polygon == pytest.approx(by_corners, rel=1e-12)


def test_lamberts_polygon_is_the_integral_of_the_cosines():
    corners = [(1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 2.0), (1.0, -1.0, 2.0)]  # a wall that faces -x
    by_quadrature, _ = integrate.dblquad(lambda z, y: z / (1 + y**2 + z**2) ** 2, -1, 1, 0, 2)
    assert closed_forms.polygon_irradiance((0, 0, 0), (0, 0, 1), corners[::-1]) == pytest.approx(
        by_quadrature, rel=1e-7
    )
    assert closed_forms.polygon_irradiance((0, 0, 0), (0, 0, 1), corners) == 0.0


def test_a_polygon_below_the_horizon_is_refused():
    with pytest.raises(ValueError, match="horizon"):
        closed_forms.polygon_irradiance((0, 0, 0), (0, 0, 1), [(1, 0, -1), (1, 1, 1), (0, 1, 1)])


def test_the_form_factor_of_facing_rectangles_is_the_mean_of_lamberts_irradiance():
    a, b, c = 2.0, 1.0, 0.8
    x, weight = np.polynomial.legendre.leggauss(16)
    corners = [(-a / 2, -b / 2, c), (-a / 2, b / 2, c), (a / 2, b / 2, c), (a / 2, -b / 2, c)]
    mean = sum(
        wx * wy / 4 * closed_forms.polygon_irradiance((px * a / 2, py * b / 2, 0), (0, 0, 1), corners) / np.pi
        for px, wx in zip(x, weight, strict=True)
        for py, wy in zip(x, weight, strict=True)
    )
    assert closed_forms.facing_rectangles_form_factor(a, b, c) == pytest.approx(mean, rel=1e-8)


def test_facing_plates_at_depth_two_are_scipys_double_quadrature():
    """Lower plate dark and grey, upper plate a grey light: its own light comes back to it by one reflection."""
    a, b, gap, rho = 1.5, 1.0, 0.7, (0.6, 0.8)
    corners = [(-a / 2, -b / 2, gap), (-a / 2, b / 2, gap), (a / 2, b / 2, gap), (a / 2, -b / 2, gap)]

    def reflected_once(y, x):
        E = closed_forms.polygon_irradiance((x, y, 0.0), (0, 0, 1), corners)
        return rho[0] * E / np.pi * gap**2 / (gap**2 + x**2 + y**2) ** 2

    once, _ = integrate.dblquad(reflected_once, -a / 2, a / 2, -b / 2, b / 2, epsabs=1e-7, epsrel=1e-7)
    _, upper = closed_forms.facing_plates_radiance(a, b, gap, (0, 1), rho, depth=2)
    assert upper == pytest.approx(1 + rho[1] * once / np.pi, rel=1e-6)


def test_the_quadrature_between_plates_has_converged():
    plates = (2.0, 2.0, 0.5, (1.0, 0.3), (0.7, 0.9), 6)
    coarse, fine = (closed_forms.facing_plates_radiance(*plates, nodes=n) for n in (24, 40))
    assert coarse == pytest.approx(fine, rel=1e-7)


def test_wide_plates_become_infinite_ones():
    emission, reflectance = (1.0, 0.5), (0.6, 0.3)
    wide = closed_forms.facing_plates_radiance(400, 400, 20.0, emission, reflectance, 4, nodes=60)
    assert wide == pytest.approx(closed_forms.infinite_plates_radiance(emission, reflectance, 4), rel=0.02)
    assert closed_forms.facing_rectangles_form_factor(1e4, 1e4, 1.0) == pytest.approx(1, abs=1e-3)


def test_infinite_plates_that_are_alike_are_a_furnace():
    furnace = closed_forms.furnace_radiance(0.7, 0.4, 5)
    assert closed_forms.infinite_plates_radiance((0.7, 0.7), (0.4, 0.4), 5) == pytest.approx((furnace, furnace))
    assert closed_forms.furnace_radiance(0.5, 0.5, 3, ambient=0.5) == pytest.approx(1.0)


# ---- the numpy path tracer against closed forms


@pytest.mark.parametrize("depth", [1, 2, 8])
def test_furnace_sums_the_geometric_series(depth):
    scene = scene_of(camera((0.1, 0.2, 0.1), (1, 0, 0), resolution=(3, 2)), (cube(), GREY, 0.5))
    mean, variance = path_trace(scene, 1500, depth, seed=depth)
    assert_within(mean.mean(), variance.mean() / mean.size, closed_forms.furnace_radiance(0.5, 0.5, depth))


def test_ambient_stands_for_the_depths_that_are_left_out():
    scene = scene_of(camera((0.1, 0.2, 0.1), (1, 0, 0), resolution=(3, 2)), (cube(), GREY, 0.5))
    mean, variance = path_trace(scene, 1500, 2, ambient=0.5)
    assert_within(mean.mean(), variance.mean() / mean.size, 1.0)
    without, _ = path_trace(scene, 1500, 2)
    assert np.allclose(mean - without, 0.25 * 0.5, rtol=1e-12)


def test_radiance_under_a_rectangular_light():
    light = quad_facing_down(1.0, 0.6, 0.5)
    floor = quad_facing_up(10, 10, 0)
    point = np.array([0.8, 0.3, 0.0])
    scene = scene_of(look_at_point((0.9, 0.4, 2.0), point), (floor, GREY), (light, BLACK, (1.0, 2.0, 4.0)))
    corners = [(-0.5, -0.3, 0.5), (-0.5, 0.3, 0.5), (0.5, 0.3, 0.5), (0.5, -0.3, 0.5)]
    E = closed_forms.polygon_irradiance(point, (0, 0, 1), corners)
    for depth in (1, 3):  # nothing else is there to reflect
        mean, variance = path_trace(scene, 20000, depth, seed=depth)
        assert_within(mean[0, 0], variance[0, 0], closed_forms.reflected_radiance(E, 0.5) * np.array([1, 2, 4]))


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_facing_plates_at_their_centres(depth):
    a, b, gap = 2.0, 1.0, 0.8
    lower, upper = Material("lower", np.full(3, 0.8)), Material("upper", np.full(3, 0.6))
    parts = ((quad_facing_up(a, b, 0), lower, 1.0), (quad_facing_down(a, b, gap), upper, 0.4))
    expected = closed_forms.facing_plates_radiance(a, b, gap, (1.0, 0.4), (0.8, 0.6), depth)
    for target_z, radiance in zip((0.0, gap), expected, strict=True):
        scene = scene_of(look_at_point((0.2, 0.1, gap / 2), (0, 0, target_z)), *parts)
        mean, variance = path_trace(scene, 40000, depth, seed=10 * depth)
        assert_within(mean[0, 0, 0], variance[0, 0, 0], radiance)
        assert np.sqrt(variance[0, 0, 0]) < 0.005 * radiance


# ---- sides


@pytest.mark.parametrize("two_sided", [False, True])
def test_an_emitter_lights_its_front_and_its_back_only_if_two_sided(two_sided):
    light = quad_facing_up(0.5, 0.5, 0.5)  # turns its back on the floor
    floor = quad_facing_up(4, 4, 0)
    parts = ((floor, GREY), (light, BLACK, 3.0, two_sided))
    seen_from_below, _ = path_trace(scene_of(look_at_point((0, 0, 0.2), (0, 0, 0.5)), *parts), 10, 1)
    assert np.allclose(seen_from_below, 3.0 if two_sided else 0.0)
    mean, variance = path_trace(scene_of(look_at_point((0.4, 0.3, 0.3), (0, 0, 0)), *parts), 5000, 1)
    E = 4 * np.pi * closed_forms.corner_form_factor(0.25, 0.25, 0.5) * 3.0 * two_sided
    assert_within(mean[0, 0], variance[0, 0], closed_forms.reflected_radiance(E, 0.5))


@pytest.mark.parametrize("two_sided", [False, True])
def test_the_back_of_a_one_sided_material_is_black_but_blocks(two_sided):
    card = quad_facing_down(1, 1, 0.2)
    white = Material("card", np.ones(3), two_sided)
    light = quad_facing_down(1, 1, 1.0)
    parts = ((quad_facing_up(3, 3, 0), GREY), (card, white), (light, BLACK, 1.0))
    on_card, variance = path_trace(scene_of(look_at_point((0.1, 0, 0.9), (0, 0, 0.2)), *parts), 5000, 1)
    E = 4 * np.pi * closed_forms.corner_form_factor(0.5, 0.5, 0.8) * two_sided
    assert_within(on_card[0, 0], variance[0, 0], closed_forms.reflected_radiance(E, 1.0))
    under_card, _ = path_trace(scene_of(look_at_point((0.1, 0, 0.1), (0, 0, 0)), *parts), 1000, 1)
    assert np.all(under_card == 0)


def test_a_scene_without_light_is_black_and_empty_space_too():
    scene = scene_of(
        camera((0, 0, 2), (0, 0, 0), (0, 1, 0), fov=90, resolution=(2, 2)), (quad_facing_up(1, 1, 0), GREY)
    )
    mean, variance = path_trace(scene, 4, 2)
    assert np.all(mean == 0)
    assert np.all(variance == 0)


def test_rows_go_down_and_columns_to_the_right():
    """A light at the upper left of a 3 x 2 picture whose camera has no axis in common with the world."""
    position, target, up = np.array([1.0, -2.0, 0.5]), np.array([-0.5, 1.0, 1.2]), np.array([0.1, 0.3, 1.0])
    seen_by = Camera(position, target, up, 50.0, (3, 2))
    right, top, forward = seen_by.frame()
    centre = position + 2 * forward - 0.9 * right + 0.45 * top
    light = quad(centre - 0.05 * right - 0.05 * top, 0.1 * right, 0.1 * top)
    mean, _ = path_trace(scene_of(seen_by, (light, BLACK, 1.0)), 400, 1)
    lit = mean[..., 0] > 0
    assert lit.tolist() == [[True, False, False], [False, False, False]]
    pixel = 2 * 2 * np.tan(np.radians(25.0)) / 2  # its size at distance 2
    assert mean[0, 0, 0] == pytest.approx(0.01 / pixel**2, abs=0.03)


# ---- nearest hits


def test_nearest_hits_between_two_walls():
    walls = np.concatenate([quad_facing_up(2, 2, z) for z in (1.0, 2.0)])
    origins = np.array([[0.3, 0.2, 0.0]] * 4 + [[5.0, 0.0, 0.0]])
    directions = np.array([[0, 0, 1], [0, 0, 2], [0, 0, 1], [0, 0, -1], [0, 0, 1]], float)
    index, t = nearest_hits(walls, origins, directions, np.array([0.0, 0.0, 1.0, 0.0, 0.0]))
    assert index.tolist() == [0, 0, 2, -1, -1]
    assert t.tolist() == [1.0, 0.5, 2.0, np.inf, np.inf]


def test_no_ray_leaves_a_closed_cube():
    rng = np.random.default_rng(1)
    origins, directions = rng.uniform(-0.49, 0.49, (5000, 3)), rng.standard_normal((5000, 3))
    directions[:1000] = np.sign(directions[:1000]) - origins[:1000] * 2  # straight into the corners
    index, t = nearest_hits(cube(), origins, directions)
    assert np.all(index >= 0)
    assert np.allclose(np.max(np.abs(origins + t[:, None] * directions), axis=1), 0.5)


def test_a_degenerate_triangle_and_an_empty_scene_are_never_met():
    line = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [2.0, 0.0, 1.0]]])
    for triangles in (line, np.zeros((0, 3, 3))):
        index, t = nearest_hits(triangles, np.zeros((2, 3)), np.array([[0.5, 0.0, 1.0], [0, 0, 1.0]]))
        assert index.tolist() == [-1, -1]
        assert np.all(np.isinf(t))


# ---- Mitsuba


def test_the_newest_usable_llvm_is_found(tmp_path, monkeypatch):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    for name in ("libLLVM-15.so.1", "libLLVM-15.so", "libLLVM-19.so", "libLLVM.so.20.1", "libLLVMSupport.so.21"):
        (tmp_path / name).touch()
    assert mitsuba_peer.find_llvm([str(tmp_path)]) == str(tmp_path / "libLLVM.so.20.1")
    (tmp_path / "libLLVM.so.20.1").unlink()
    (tmp_path / "libLLVM-19.so").unlink()
    assert mitsuba_peer.find_llvm([str(tmp_path)]) is None  # LLVM 15 crashes under Dr.Jit
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/named/by/the/user.so")
    assert mitsuba_peer.find_llvm([str(tmp_path)]) == "/named/by/the/user.so"


def test_without_llvm_the_note_says_what_to_install(monkeypatch):
    monkeypatch.setattr(mitsuba_peer, "find_llvm", lambda: None)
    variant, note = mitsuba_peer.best_variant()
    assert variant == "scalar_rgb"
    assert "libllvm19" in note


def test_without_mitsuba_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(GlpathError, match=r"pip install glpath\[reference\]"):
        mitsuba_peer.load_mitsuba("scalar_rgb")


# Side and error of each.
REFERENCES = {
    ("cornell-box-36", 1): (128, 1e-6),
    ("cornell-box-36", 2): (128, 1e-5),
    ("cornell-box-36", 3): (256, 1e-5),
    ("cornell-box-36", 64): (256, 5e-5),
    ("room", 1): (128, 5e-5),
    ("room", 64): (128, 1e-3),
}


@pytest.mark.parametrize(("scene", "depth"), REFERENCES)
def test_the_stored_references_are_what_their_notes_say(scene, depth):
    side, error = REFERENCES[scene, depth]
    path = DATA / f"{scene}-depth{depth}.npz"
    with np.load(path) as stored:
        radiance, made_with = stored["radiance"].astype(np.float64), json.loads(str(stored["made_with"]))
    assert radiance.shape == (side, side, 3)
    assert np.allclose(radiance.mean(axis=(0, 1)), made_with["image_mean"], rtol=3e-4)
    assert made_with["relmse_of_reference"] + made_with["relmse_of_rounding"] < error
    assert made_with["max_depth"] == depth
    assert path.stat().st_size < 600 * 1024


def test_every_stored_reference_is_known():
    assert {path.stem for path in DATA.glob("*.npz")} == {f"{scene}-depth{depth}" for scene, depth in REFERENCES}


@pytest.mark.evidence
@pytest.mark.parametrize(("scene", "depth"), REFERENCES)
def test_mitsuba_makes_the_stored_references_again(mitsuba, scene, depth):
    """With fewer samples of other seeds, whose own spread says how near they have to come."""
    side, _ = REFERENCES[scene, depth]
    stored = stored_reference(scene, depth)
    square = load_scene(scene).with_camera(resolution=(side, side))
    again = np.stack([mitsuba_peer.render_mitsuba(square, 64, depth, seed=5000 + i) for i in range(4)])
    assert again.mean() == pytest.approx(stored.mean(), rel=0.01)
    weight = 1 / (stored**2 + 0.01)
    expected = np.mean(again.var(axis=0, ddof=1) / 4 * weight)
    assert relative_mse(again.mean(axis=0), stored) < 1.5 * expected + 2e-4


@pytest.fixture
def mitsuba():
    return pytest.importorskip("mitsuba", reason="needs the reference extra")


def everything_at_once(resolution=(7, 5)):
    """One-sided and two-sided lights that also reflect, a one-sided card, an open room, a slanted camera."""
    red, blue = Material("red", np.array([0.8, 0.2, 0.1])), Material("blue", np.array([0.1, 0.3, 0.9]), False)
    tilted = np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    return scene_of(
        camera((1.6, -2.6, 1.9), (0.1, 0.2, 0.5), (0.2, 0.1, 1.0), 45.0, resolution),
        (quad_facing_up(4, 4, 0), GREY),
        (cube(0.6, inside=False) + np.array([0.7, 0.4, 0.3]), red),
        (quad_facing_down(1.0, 0.5, 2.0), GREY, (5.0, 4.0, 3.0)),
        (quad_facing_up(0.6, 0.6, 0.0) @ tilted.T + [-0.8, 0.0, 0.9], red, (0.5, 1.0, 6.0), True),
        (quad_facing_down(0.8, 0.8, 0.0) @ tilted.T + [-0.2, -0.9, 0.4], blue),
    )


@functools.cache
def by_numpy(depth):
    return path_trace(everything_at_once(), 4096, depth, seed=3)


@pytest.mark.evidence
@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb"])
@pytest.mark.parametrize("depth", [1, 3])
def test_numpy_and_mitsuba_agree_pixel_by_pixel(mitsuba, variant, depth):
    scene = everything_at_once()
    mean, variance = by_numpy(depth)
    seeds = [mitsuba_peer.render_mitsuba(scene, 1024, depth, seed=s, variant=variant) for s in range(8)]
    peer, peer_variance = np.mean(seeds, axis=0), np.var(seeds, axis=0, ddof=1) / len(seeds)
    both = variance + peer_variance + 1e-12
    z = (mean - peer) / np.sqrt(both)
    assert np.max(np.abs(z)) < 4.5
    assert np.mean(z**2) < 1.6
    assert mean.mean() == pytest.approx(peer.mean(), rel=0.01)


@pytest.mark.evidence
@pytest.mark.parametrize("depth", [1, 3])
def test_our_cornell_box_36_is_mitsubas_own(mitsuba, depth):
    ours = mitsuba_peer.to_mitsuba(load_scene("cornell-box-36"), depth, spp=64)
    own = mitsuba_peer.mitsuba_cornell_box(depth, spp=64)
    by_seed = [
        [mitsuba_peer.render_peer(s, 64, seed) for seed in range(k, k + 4)] for k, s in ((0, ours), (4, own))
    ]
    (a, b), (var_a, var_b) = np.mean(by_seed, axis=1), np.var(by_seed, axis=1, ddof=1) / 4
    assert a.mean() == pytest.approx(b.mean(), rel=2e-3)
    # Blocks of 8 x 8 pixels, independent in Mitsuba: a wrong edge, colour or side shows in some block.
    blocks = [v.reshape(32, 8, 32, 8, 3).mean(axis=(1, 3)) for v in (a - b, (var_a + var_b) / 64)]
    z = blocks[0] / np.sqrt(blocks[1] + 1e-12)
    assert np.max(np.abs(z)) < 6
    assert np.mean(z**2) < 1.5


@pytest.mark.evidence
def test_timing_counts_whole_pictures(mitsuba):
    timing = mitsuba_peer.time_to_render(everything_at_once((32, 24)), 16, 2, repeats=2)
    assert timing.images.shape == (2, 24, 32, 3)
    assert timing.images.dtype == np.float64
    assert not np.array_equal(*timing.images)
    assert timing.ms_per_sample > 0


@pytest.mark.evidence
def test_multijitter_tells_how_many_samples_it_took(mitsuba):
    peer = mitsuba_peer.to_mitsuba(everything_at_once(), 1)
    assert [mitsuba_peer.samples_rendered(peer, n) for n in (16, 32, 1024)] == [16, 35, 1024]
