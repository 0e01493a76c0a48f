"""Scenes far from the origin, as georeferenced models are, and cameras far from a scene: the light is the same.

The witness is the same scene at the origin, whose numbers are those of the other tests.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_erosion

import glpath
from benchmarks.figures.eye_hits import ShownHits
from glpath import Film, SceneWarning, load_scene, render
from glpath.apps.lightmap.atlas import packed
from glpath.film.exr import read_exr_channels
from glpath.rendering import RenderJob, run
from glpath.rendering.points import irradiance
from glpath.scene import Scene
from glpath.scene.centre import FARTHEST, origin_of
from glpath.scene.model import Mesh, Shapes
from glpath.scene.triangulate import path_traceable
from glpath.sensors.sensor import PointSensor
from tests.support.command_line import run as run_command

#: UTM zones: metres to the east and to the north, by a file whose y is up, and by one whose z is.
PLACES = ((500000.37, 30.21, 450000.11), (450000.3, 5800000.77, 37.2))
UTM = (500123.37, 31.7, 5412345.91)
SIZES = (1.0, 1000.0)
ENGINES: dict[str, dict[str, Any]] = {
    "path": {"integrator": "path", "max_depth": 3},
    "guided": {"integrator": "path", "max_depth": 3, "guide": "solution"},
    "pair": {"max_depth": 3, "integrator": "path-buffer"},
    "lattice": {"max_depth": 3, "integrator": "path-buffer", "directions": "lattice"},
    "hemisphere": {"max_depth": 3, "integrator": "path-buffer", "directions": "hemisphere"},
    "sphere": {"max_depth": 3, "integrator": "path-buffer", "directions": "sphere"},
    "gather": {"integrator": "gather"},
    "gather by scans": {"integrator": "gather", "cast": "path-buffer"},
    "t-buffer": {"integrator": "t-buffer"},
    "classic": {"integrator": "classic"},
}


def hut(at: Any = (0.0, 0.0, 0.0), size: float = 4.0, **more: Any) -> Scene:
    """A floor and two walls, a box that goes through it, a ball and a lamp, `size` wide, about a place."""
    at, s = np.asarray(at, float), size / 4.0

    def points(*given: tuple[float, float, float]) -> list[list[float]]:
        return (s * np.array(given) + at).tolist()

    walls = {"material": "wall", "type": "quad"}
    floor = [(-2.0, 0.0, 2.0), (2.0, 0.0, 2.0), (2.0, 0.0, -2.0), (-2.0, 0.0, -2.0)]
    back = [(-2.0, 0.0, -2.0), (2.0, 0.0, -2.0), (2.0, 3.0, -2.0), (-2.0, 3.0, -2.0)]
    left = [(-2.0, 0.0, 2.0), (-2.0, 0.0, -2.0), (-2.0, 3.0, -2.0), (-2.0, 3.0, 2.0)]
    lamp = [(-0.6, 2.6, -0.6), (0.6, 2.6, -0.6), (0.6, 2.6, 0.6), (-0.6, 2.6, 0.6)]
    low, high, ball, light = points((-0.9, -0.1, -0.8), (0.1, 1.1, 0.2), (1.0, 0.5, 0.3), (1.5, 2.4, 1.5))
    eye, target = points((0.3, 1.6, 5.5), (0.0, 0.9, 0.0))
    shapes: list[dict[str, Any]] = [
        walls | {"corners": points(*floor)},
        walls | {"corners": points(*back), "material": "green"},
        walls | {"corners": points(*left)},
        {"type": "box", "min": low, "max": high, "material": "wall"},
        {"type": "sphere", "center": ball, "radius": 0.5 * s, "material": "green", "subdivisions": 2},
        walls | {"corners": points(*lamp), "emission": {"radiance": [6, 6, 5], "two_sided": True}},
    ]
    materials = {"wall": {"reflectance": [0.7, 0.6, 0.5]}, "green": {"reflectance": [0.3, 0.5, 0.2]}}
    return load_scene(
        {
            "camera": {"position": eye, "target": target, "fov": 45},
            "film": {"resolution": [24, 18]},
            "materials": materials,
            "shapes": shapes + more.pop("shapes", []),
            "lights": [{"type": "point", "position": light, "intensity": 6 * s * s}],
            **more,
        }
    )


def test_the_centre_is_a_whole_number_and_leaves_what_is_near_alone() -> None:
    near, far = hut(), hut(PLACES[0])
    assert near.centred is near
    assert not near.origin.any()
    origin = far.centred.origin
    assert np.array_equal(origin, np.round(origin))
    np.testing.assert_allclose(far.centred.triangles + origin, far.triangles, rtol=0, atol=1e-9)
    np.testing.assert_allclose(far.centred.camera.target + origin, far.camera.target, rtol=0, atol=1e-9)
    np.testing.assert_allclose(far.centred.lights[0].position + origin, far.lights[0].position, rtol=0, atol=1e-9)
    assert far.centred.centred is far.centred
    assert np.abs(far.centred.bounds).max() < 8.0
    # A camera that is far away from a scene at the origin moves nothing.
    assert near.with_camera(position=(1e6, 0.0, 1e6)).centred.origin.any() == np.False_
    low, high = np.array([7.9, 0.0, 0.0]), np.array([8.9, 1.0, 1.0])
    assert not origin_of(low - [8.4 - FARTHEST, 0, 0], high - [8.4 - FARTHEST, 0, 0]).any()
    assert origin_of(low + 100.0, high + 100.0).any()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("engine", ENGINES)
def test_a_picture_is_that_of_the_scene_at_the_origin(engine: str, size: float) -> None:
    options = ENGINES[engine] | {"spp": 4, "seed": 2}
    near = render(hut(size=size), **options).mean
    # Of a solution by particles the last digit decides where some go; of a scene 1 unit wide that is 1e-9 of it.
    solved = engine in ("guided", "gather")
    for place in PLACES:
        far = render(hut(place, size), **options).mean
        assert far.mean() == pytest.approx(near.mean(), rel=1e-3)
        apart = np.abs(far - near).mean() / near.mean()
        assert apart < (2e-3 if solved else 1e-4)


def test_300_units_from_the_origin_no_part_of_a_picture_by_scans_is_darker() -> None:
    """`DEPTH_TOLERANCE` was below the rounding there, so that paths met the surface that they started at."""
    options: dict[str, Any] = ENGINES["pair"] | {"spp": 16}
    near, far = (render(hut(at, 2.0), **options).mean for at in ((0, 0, 0), (300.3, 0.7, -200.1)))
    blocks = [picture.reshape(3, 6, 4, 6, 3).mean(axis=(1, 3)) for picture in (near, far)]
    np.testing.assert_allclose(blocks[1], blocks[0], rtol=1e-3, atol=1e-3 * near.mean())


@pytest.mark.parametrize("size", SIZES)
def test_points_are_measured_where_the_file_has_them(size: float) -> None:
    s = size / 4.0
    points = s * np.array([(0.5, 0.8, 0.9), (-1.9, 1.0, 0.3), (1.5, 0.0, 1.5)])
    normals = [(0, 1, 0), (1, 0, 0), (0, 1, 0)]
    near = irradiance(hut(size=size), points, normals, spp=32).values
    assert (near > 0).all()
    for place in PLACES:
        far = irradiance(hut(place, size), points + place, normals, spp=32).values
        np.testing.assert_allclose(far, near, rtol=1e-3)
        alone = irradiance(hut(place, size), points[1:2] + place, normals[1], spp=32).values
        at_origin = irradiance(hut(size=size), points[1:2], normals[1], spp=32).values
        np.testing.assert_allclose(alone, at_origin, rtol=1e-3)


def test_a_sensor_of_points_holds_what_32_bits_do_not() -> None:
    points, up = np.array([[[500000.37, 5800000.77, 37.2], [500001.62, 5800000.7, 37.9]]]), [[[0, 0, 1.0]] * 2]
    sensor = PointSensor.of(points, up)
    assert sensor.points is not None
    np.testing.assert_allclose(sensor.points.positions[0] + np.array(sensor.points.origin), points, atol=1e-6)
    assert sensor.middle == pytest.approx((500000.995, 5800000.735, 37.55), abs=1e-6)
    elsewhere = PointSensor.of(points + np.array([0, 1e6, 0]), up)
    assert elsewhere.sha256 != sensor.sha256
    near = PointSensor.of(points % 4, up)
    assert near.points is not None
    assert near.points.origin == (0, 0, 0)
    job = RenderJob.of(hut(points[0, 0]), sensor=PointSensor.of(points + np.array([0, 1, 0]), up), spp=2)
    again = RenderJob.from_json(job.to_json())
    here = {"scene": hut(points[0, 0])}
    np.testing.assert_array_equal(run(again, sensor=job.sensor, **here).mean, run(job, **here).mean)


def test_a_table_of_measured_points_has_the_coordinates_of_the_file(tmp_path: Path) -> None:
    place = np.array(PLACES[1])
    scene, table, out = tmp_path / "plate.toml", tmp_path / "points.csv", tmp_path / "out.csv"
    x, y, z = place
    scene.write_text(
        f"[camera]\nposition = [{x}, {y + 1}, {z + 9}]\ntarget = [{x}, {y}, {z}]\n[sky]\nzenith = 1\n"
        f'[[shapes]]\ntype = "box"\ncenter = [{x}, {y - 2}, {z}]\nsize = [1.5, 1.5, 1.5]\n'
    )
    points = place + np.array([[0.123, 0.0, 0.0], [0.0, 0.456, 0.789]])
    table.write_text("x,y,z\n" + "\n".join(",".join(f"{value:.3f}" for value in row) for row in points) + "\n")
    done = run_command("measure", scene, "--points", table, "--normal", "0,1,0", "-o", out, "--spp", 16)
    assert done.exit_code == 0, done.output
    found = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(found[:, :3], points, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[:, 6:9], np.pi, rtol=0.05)


def test_positions_are_those_of_the_file_and_an_exr_names_what_its_own_are_relative_to(tmp_path: Path) -> None:
    names = ("albedo", "normal", "depth", "position", "object_id", "direct")
    for integrator in ("path", "t-buffer"):
        options: dict[str, Any] = {"integrator": integrator, "spp": 4, "aovs": names}
        near, far = render(hut(), **options), render(hut(PLACES[0]), **options)
        for name in names:
            place = PLACES[0] if name == "position" else 0.0
            met = near.aov("depth") < 1e9
            apart = np.abs(far.aov(name) - place - near.aov(name))[met]
            assert apart.max() < 1e-4, name
        assert not far.aov("position")[~met].any()
        assert near.metadata.position_origin is None
        origin = far.metadata.position_origin
        assert origin is not None
        far.save(tmp_path / "far.exr")
        channels, texts = read_exr_channels(tmp_path / "far.exr")
        assert texts["glpath.position_origin"] == str([*origin])
        stored = np.stack([channels[f"position.{axis}"] for axis in "XYZ"], axis=-1).astype(np.float64) + origin
        np.testing.assert_allclose(stored[met], far.aov("position")[met], rtol=0, atol=1e-5)
        far.save(tmp_path / "far.npz")
        loaded = Film.load(tmp_path / "far.npz")
        np.testing.assert_array_equal(loaded.aov("position"), far.aov("position"))


def test_a_film_far_from_the_origin_is_gone_on_with() -> None:
    options: dict[str, Any] = {"aovs": ("position",)}
    whole = render(hut(PLACES[1]), spp=8, **options)
    begun = render(hut(PLACES[1]), spp=4, **options)
    done = render(hut(PLACES[1]), spp=8, film=begun, **options)
    np.testing.assert_array_equal(done.mean, whole.mean)
    np.testing.assert_array_equal(done.aov("position"), whole.aov("position"))


@pytest.mark.filterwarnings("ignore:.*rows see backs of faces")
@pytest.mark.parametrize("size", SIZES)
def test_radiosity_and_view_factors_agree(size: float) -> None:
    near = hut(size=size)
    solved, factors = glpath.solve_radiosity(near, patches=60), glpath.view_factors(near, error=0.01)
    for place in PLACES:
        far = hut(place, size)
        found = glpath.solve_radiosity(far, patches=60)
        # But for the inside of the box, where the few rays that the floor sends are at an edge, on either side.
        apart = np.abs(found.elements - solved.elements) > 1e-3 * (solved.elements + solved.elements.mean())
        assert apart.mean() < 0.02
        assert found.elements.mean() == pytest.approx(solved.elements.mean(), rel=1e-3)
        found.check_scene(far)
        options: dict[str, Any] = {"integrator": "gather", "spp": 4}
        pictures = [render(s, radiosity=r, **options).mean for s, r in ((near, solved), (far, found))]
        assert np.abs(pictures[1] - pictures[0]).mean() < 1e-3 * pictures[0].mean()
        assert abs(glpath.view_factors(far, error=0.01).matrix - factors.matrix).max() < 1e-3
        hits = ShownHits.of(far, 1).position
        np.testing.assert_allclose(hits - place, ShownHits.of(near, 1).position, rtol=0, atol=1e-5 * size)


@pytest.mark.parametrize(("size", "place"), [(1.0, PLACES[1]), (4.0, UTM), (1000.0, UTM)])
def test_a_lightmap_agrees_and_its_model_stands_where_the_scene_does(
    tmp_path: Path, size: float, place: tuple[float, float, float]
) -> None:
    """Texel by texel: charts are packed alike wherever a scene is."""
    pytest.importorskip("xatlas")
    options: dict[str, Any] = {"size": 64, "spp": 8, "integrator": "path", "guide": "cosine", "denoise": False}
    near, far = (glpath.lightmap(hut(at, size), **options) for at in ((0.0, 0.0, 0.0), place))
    np.testing.assert_allclose(far.atlas.uv, near.atlas.uv, rtol=0, atol=1e-2)
    np.testing.assert_array_equal(far.baked, near.baked)
    apart = np.abs(far.irradiance - near.irradiance) / near.irradiance.mean()
    assert apart.mean() < 1e-4
    assert (apart > 1e-3).mean() < 2e-3  # texels at the edge of a shadow, one of whose rays passes on either side
    if size == 4.0:
        for materials in ("unlit", "keep"):
            far.save(tmp_path / "far.glb", materials=materials)
            check_place(tmp_path / "far.glb", hut(place))


@pytest.mark.parametrize("size", SIZES)
def test_charts_of_what_is_not_regular_are_packed_alike(size: float) -> None:
    """A lump of 1,280 triangles, whose own vertices are far away: no two of them round alike."""
    pytest.importorskip("xatlas")
    lump, random = trimesh.creation.icosphere(3, 0.3), np.random.default_rng(4)
    vertices = lump.vertices * (1.0, 0.8, 0.6) + random.normal(0, 2e-3, lump.vertices.shape) + (-0.2, 0.4, 0.1)
    density = np.ones((len(lump.faces), 2)) * (1.0, 0.0)
    made = []
    for place in ((0.0, 0.0, 0.0), UTM, *PLACES):
        given = {"vertices": (size * vertices + place).tolist(), "faces": lump.faces.tolist()}
        seen = {"position": [*np.add(place, (0.0, 0.0, 3 * size))], "target": [*place]}
        scene = load_scene({"camera": seen, "shapes": [{"type": "mesh"} | given], "sky": {"zenith": 1}})
        made.append(packed(path_traceable(scene), density, 50.0 / size, 256))
    for far in made[1:]:
        np.testing.assert_array_equal(far.triangle, made[0].triangle)
        np.testing.assert_array_equal(far.chart, made[0].chart)
        # A corner may be one step of 2^-20 or so of the lump elsewhere.
        np.testing.assert_allclose(far.uv, made[0].uv, rtol=0, atol=1e-2)


def check_place(model: Path, scene: Scene) -> None:
    """Read again, a .glb stands where the scene does, to 32 bits of the scene's own size."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "(?s).*has no light")
        warnings.filterwarnings("ignore", "(?s).*not used")
        read = load_scene(model)
    np.testing.assert_allclose(read.bounds, scene.bounds, rtol=0, atol=0.06)  # a ball in triangles is smaller
    np.testing.assert_allclose(read.camera.position, scene.camera.position, rtol=0, atol=1e-5)


def test_exports_keep_their_digits(tmp_path: Path) -> None:
    far = hut(PLACES[0])
    glpath.export(far, tmp_path / "far.glb")
    check_place(tmp_path / "far.glb", far)
    glpath.solve_radiosity(far, patches=20).to_glb(far, tmp_path / "radiosity.glb")
    check_place(tmp_path / "radiosity.glb", far)
    origin = far.centred.origin
    with pytest.warns(SceneWarning, match=r"relative to \[500000, 32, 450000\]"):
        glpath.export(far, tmp_path / "far.xml")
    text = (tmp_path / "far.xml").read_text()
    assert "relative to [500000, 32, 450000]" in text
    meshes = [trimesh.load(path, process=False) for path in (tmp_path / "far_files").glob("*.ply")]
    low = np.min([mesh.vertices.min(axis=0) for mesh in meshes], axis=0)
    np.testing.assert_allclose(low + origin, far.bounds[0], rtol=0, atol=1e-5)


def test_z_up_models_are_translated_after_they_are_turned(tmp_path: Path) -> None:
    far = hut(PLACES[1]).with_camera(up=(0, 0, 1))
    glpath.export(far, tmp_path / "far.glb")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = load_scene(tmp_path / "far.glb")
    # z is turned to y, and y to -z.
    low, high = far.bounds
    np.testing.assert_allclose(read.bounds[0], (low[0], low[2], -high[1]), rtol=0, atol=0.06)


@pytest.mark.parametrize(("name", "step"), [("a.stl", 0.5), ("single.ply", 0.5), ("a.glb", 0.5)])
def test_a_file_of_32_bits_there_prints_its_step(tmp_path: Path, name: str, step: float) -> None:
    box = trimesh.creation.box((3.1, 2.3, 4.7))
    box.export(tmp_path / name)  # trimesh writes floats
    assert not _said_of_bits(tmp_path / name)
    box.apply_translation((450000.3, 5800000.77, 37.2))
    if name == "single.ply":
        _write_ply(tmp_path / name, box, "float")
    else:
        box.export(tmp_path / name)
    (said,) = _said_of_bits(tmp_path / name)
    assert f"{name}: its vertices are numbers of 32 bits, which are {step:g} apart at 5,80" in said


@pytest.mark.parametrize("name", ["a.obj", "double.ply", "ascii.stl", "a.toml", "node.glb"])
def test_formats_with_more_digits_keep_them(tmp_path: Path, name: str) -> None:
    box = trimesh.creation.box((3.1, 2.3, 4.7))
    place, path = np.array((450000.3, 5800000.77, 37.2)), tmp_path / name
    if name == "node.glb":
        scene = trimesh.Scene()
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix(place))
        scene.export(path)
    box.apply_translation(place)
    if name == "a.obj":
        box.export(path, digits=9)
    elif name == "double.ply":
        _write_ply(path, box, "double")
    elif name == "ascii.stl":
        path.write_text(trimesh.exchange.stl.export_stl_ascii(box))
    elif name == "a.toml":
        path.write_text(
            f'[camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\n[[shapes]]\ntype = "mesh"\nvertices = '
            f"{box.vertices.tolist()}\nfaces = {box.faces.tolist()}\n"
        )
    assert not _said_of_bits(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = load_scene(path)
    np.testing.assert_allclose(read.bounds, box.bounds, rtol=0, atol=1e-6)


def _said_of_bits(path: Path) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneWarning)
        load_scene(path)
    return [str(each.message) for each in caught if "32 bits" in str(each.message)]


def _write_ply(path: Path, mesh: Any, kind: str) -> None:
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.vertices)}\n"
        + "".join(f"property {kind} {axis}\n" for axis in "xyz")
        + f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    vertices = mesh.vertices.astype("<f4" if kind == "float" else "<f8")
    path.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())


class Rows:
    """A terrain in chunks, made when asked."""

    def __init__(self, place: Any) -> None:
        self.place = np.asarray(place, float)

    def __len__(self) -> int:
        return 4

    def chunk(self, index: int) -> Any:
        z = index - 2.0
        strip = np.array([(-2, 0, z), (-2, 0, z + 1), (2, 0, z + 1), (2, 0, z)]) + self.place
        return strip, np.array([(0, 1, 2), (0, 2, 3)])


def test_streams_instances_and_what_moves_are_moved_with_the_rest() -> None:
    def scene(place: Any) -> Scene:
        x, y, z = np.asarray(place, float).tolist()
        ball = {"type": "box", "min": [-0.25] * 3, "max": [0.25] * 3, "material": "wall"}
        keys = [{"time": t, "transform": [{"translate": [x + t, y + 0.5, z]}]} for t in (0.0, 1.0)]
        made = hut(place, shapes=[ball | {"motion": keys}])
        return made.with_camera(shutter=(0.0, 1.0))

    for name in ("path", "pair", "t-buffer"):
        options = ENGINES[name] | {"spp": 8, "aovs": ("position",)}
        near, far = render(scene((0, 0, 0)), **options), render(scene(PLACES[0]), **options)
        assert np.abs(far.mean - near.mean).mean() < 1e-3 * near.mean.mean()
        met = near.aov("position").any(axis=-1)
        apart = (far.aov("position") - near.aov("position") - PLACES[0])[met]
        assert np.abs(apart).max() < 1e-4
    streamed = [
        render(hut(at, shapes=[{"stream": Rows(np.add(at, (0, -0.1, 0)))}]), **ENGINES["pair"] | {"spp": 4})
        for at in ((0, 0, 0), PLACES[0])
    ]
    assert np.abs(streamed[1].mean - streamed[0].mean).mean() < 1e-3 * streamed[0].mean.mean()


def test_planes_stay_where_they_are() -> None:
    """One whose point is at the origin passes under a scene far from there; a texture on it keeps its place."""
    pictures = []
    for place in ((0.0, 0.0, 0.0), (500000.0, 32.0, 450000.0)):
        x, y, z = place
        slope = {"type": "plane", "point": [x - 300.0, y - 1.0, z], "normal": [0.0, 1.0, 0.1], "material": "wall"}
        pictures.append(render(hut(place, shapes=[slope]), integrator="t-buffer", spp=4).mean)
    np.testing.assert_allclose(pictures[1], pictures[0], atol=1e-3 * pictures[0].mean(), rtol=1e-3)


@pytest.mark.parametrize("distance", [30.0, 160.0, 10000.0])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_distant_camera_sees_the_same_by_scans_as_by_rays(distance: float, projection: str) -> None:
    """From 160 radii on all was beyond the far plane by rounding, so black; at 10,000 it was 30 % too bright.

    Direct light alone, by its sample: what each pixel sees is lit alike by both kinds of paths.
    """
    target, way = np.array([0.0, 1.0, 0.0]), np.array([0.2, 0.5, 1.0])
    fov = float(2 * np.degrees(np.arctan(np.tan(np.radians(22.5)) / distance)))
    seen: dict[str, Any] = {"position": target + 5.5 * distance * way / np.linalg.norm(way), "target": target}
    seen |= {"fov": fov} if projection == "perspective" else {"projection": projection, "height": 4.5}
    scene = hut().with_camera(**seen)
    options: dict[str, Any] = {"max_depth": 1, "aovs": ("position", "depth", "object_id")}
    own, pair = render(scene, spp=128, **options), render(scene, integrator="path-buffer", spp=128, **options)
    met = own.aov("depth") < 1e9
    np.testing.assert_array_equal(pair.aov("depth") < 1e9, met)
    assert pair.mean.mean() == pytest.approx(own.mean.mean(), rel=0.01)
    # What is met lies on the floor, to the last digits of the scene's size, not of the distance.
    inner = binary_erosion((own.aov("object_id") == 1) & (pair.aov("object_id") == 1), np.ones((3, 3)))
    assert inner.sum() > 10
    whitted = render(scene, integrator="t-buffer", spp=8, aovs=options["aovs"])
    np.testing.assert_array_equal(whitted.aov("depth")[inner] < 1e9, True)
    for film in (own, pair, whitted):
        assert np.abs(film.aov("position")[inner][:, 1]).max() < 1e-5
    if distance < 1000:  # beyond, a depth is cut
        away = np.linalg.norm(scene.camera.position - own.aov("position")[inner], axis=1)
        np.testing.assert_allclose(own.aov("depth")[inner], away, rtol=1e-3)


#: Where cameras look at a scene from, and the height of what they see of it.
TARGET, WAY, HEIGHT = np.array([0.0, 1.0, 0.0]), np.array([0.2, 0.5, 1.0]) / np.linalg.norm([0.2, 0.5, 1.0]), 4.5


def seen_from(scene: Scene, distance: float, projection: str) -> Scene:
    """The scene as a long lens has it, or by parallel rays, which have no distance."""
    seen: dict[str, Any] = {"position": TARGET + distance * WAY, "target": TARGET}
    fov = float(2 * np.degrees(np.arctan(0.5 * HEIGHT / distance)))
    return scene.with_camera(
        **seen | ({"fov": fov} if projection == "perspective" else {"projection": projection, "height": HEIGHT})
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_a_camera_may_be_far_away(engine: str) -> None:
    """By parallel rays a picture is the same from anywhere. What a lens adds goes with one over the distance.

    By `t-buffer` and `classic` t had the rounding of the distance: single pixels were off by a sixth of the mean
    from 1,000 units on, and by 0.3 % in their mean from 100,000.
    """
    options = ENGINES[engine] | {"spp": 4, "seed": 2}
    scene, solved = hut(), engine in ("guided", "gather", "gather by scans")
    if options["integrator"] == "gather":
        # One solution for both cameras: by default its elements are finer where the camera looks.
        options["radiosity"] = glpath.solve_radiosity(scene, method="monte-carlo", for_camera=False)
    near = render(seen_from(scene, 6.0, "orthographic"), **options).mean
    for distance in (1e4,) if solved else (1e3, 1e4, 1e5):
        far = render(seen_from(scene, distance, "orthographic"), **options).mean
        # Another camera makes other guides, and so other noise: 0.24 and 1.2 %.
        mean, pixel = {"guided": (5e-3, 2e-2)}.get(engine, (1e-3, 3e-3) if solved else (1e-5, 1e-5))
        assert far.mean() == pytest.approx(near.mean(), rel=mean)
        assert np.abs(far - near).mean() < pixel * near.mean()
    if solved:
        return  # the rest is of what lenses alone change
    # Without the lamp, one sample of which is 2 % of the picture's mean.
    dim, options = replace(scene, shapes=Shapes(s for s in scene.shapes if not s.emits)), options | {"spp": 16}
    views = [(6.0, "orthographic"), (1e3, "perspective"), (1e4, "perspective")]
    without, closer, farther = (float(render(seen_from(dim, *view), **options).mean.mean()) for view in views)
    assert farther == pytest.approx(without, rel=1e-3)
    assert closer - without == pytest.approx(10 * (farther - without), abs=1e-3 * without)


@pytest.mark.parametrize("distance", [30.0, 1e3, 1e4])
@pytest.mark.parametrize("engine", ["t-buffer", "classic", "path", "pair", "lattice"])
def test_a_lit_floor_far_away_has_its_closed_form_in_every_pixel(engine: str, distance: float) -> None:
    """rho cos I / (pi r^2) of a point light, where the middle of a pixel is. 64 path sets are about there."""
    light, floor = np.array([0.5, 2.0, 0.3]), 20.0
    corners = [[-floor, 0, floor], [floor, 0, floor], [floor, 0, -floor], [-floor, 0, -floor]]
    scene = load_scene(
        {
            "camera": {"position": [0, 1, 9], "target": [0, 1, 0]},
            "film": {"resolution": [48, 36]},
            "materials": {"wall": {"reflectance": [0.6, 0.6, 0.6]}},
            "shapes": [{"type": "quad", "corners": corners, "material": "wall"}],
            "lights": [{"type": "point", "position": light.tolist(), "intensity": 5}],
        }
    )
    scene = seen_from(scene, distance, "perspective")
    found = render(scene, **ENGINES[engine] | {"spp": 64, "seed": 1}).mean[..., 0]
    camera, steps = scene.camera, (np.arange(8) + 0.5) / 8
    right, up, forward = camera.frame()
    x = (np.arange(48)[:, None] + steps).ravel() - 24
    y = 18 - (np.arange(36)[:, None] + steps).ravel()
    way = forward + (x[None, :, None] * right + y[:, None, None] * up) / camera.focal
    at = camera.position - way * (camera.position[1] / way[..., 1])[..., None]
    r2 = np.sum((light - at) ** 2, axis=-1)
    value = 0.6 / np.pi * 5 * light[1] / r2**1.5
    expected = value.reshape(36, 8, 48, 8).mean(axis=(1, 3))
    assert found.mean() == pytest.approx(expected.mean(), rel=1e-3)
    assert np.abs(found - expected).mean() < 5e-3 * expected.mean()


def test_scene_add_and_a_new_camera_take_the_coordinates_of_the_file() -> None:
    place = np.array(PLACES[0])
    far, near = hut(place), hut()
    eye = np.array([2.0, 2.0, 4.0])
    ball = {"type": "sphere", "radius": 0.3}
    pictures = [
        render(
            scene.add(ball | {"center": np.add(at, (0.0, 1.6, 0.0)).tolist()}, material="green"),
            camera={"position": (at + eye).tolist(), "target": at.tolist()},
            spp=4,
        ).mean
        for scene, at in ((near, np.zeros(3)), (far, place))
    ]
    assert np.abs(pictures[1] - pictures[0]).mean() < 1e-4 * pictures[0].mean()
    corners = place + np.array([(-1, 2, 0), (1, 2, 0), (0, 2, 1)])
    added = far.add(Mesh(corners, np.array([[0, 1, 2]], np.int32)))
    np.testing.assert_array_equal(added.triangles[-1], corners)
