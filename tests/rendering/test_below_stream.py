"""Lightmaps and probes of scenes with streamed triangles: what they light, shade and cover."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

import glpath
from glpath.apps.lightmap.lightmap import Bake
from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.apps.lightmap.view import seen_by_camera
from glpath.apps.probes import ProbeGrid
from glpath.cli.main import app
from glpath.errors import SceneError, SceneWarning, UsageError
from glpath.film.film import Film
from glpath.rendering.below_stream import StreamedRays
from glpath.rendering.calls import run_job
from glpath.rendering.job import describe
from glpath.rendering.run_options import RunOptions
from glpath.scene.triangulate import path_traceable
from tests.support.gltf_files import ReadGlb
from tests.support.terrain import Hills

pytest.importorskip("xatlas")
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*streamed triangles.*are not baked"),
    pytest.mark.filterwarnings("ignore:.*has no light, so a studio lights it"),  # a file that is read again
]

Triangles = NDArray[np.float64]
SCANS: dict[str, Any] = {"light_resolution": 64, "max_depth": 3}
SKY = {"sky": {"zenith": 1, "horizon": 1}}
SUN = {"lights": [{"type": "directional", "direction": [-1, -1, 0], "irradiance": 2}]}
CAMERA = {"position": [0, 9, 3], "target": [0, 0, 0]}
BLACK_BOX = {"name": "house", "type": "box", "min": [-1, -1, -1], "max": [1, 1, 1], "material": "black"}


class Chunks:
    """A stream of triangles (T, 3, 3), some to a chunk."""

    def __init__(self, triangles: Triangles, size: int = 4) -> None:
        self.parts = [triangles[first : first + size] for first in range(0, len(triangles), size)]

    def __len__(self) -> int:
        return len(self.parts)

    def chunk(self, index: int) -> Triangles:
        return self.parts[index]


def sheet(height: float = 0.0, extent: float = 40.0, squares: int = 8) -> Triangles:
    """Level ground whose fronts face up, y."""
    steps = np.linspace(-extent, extent, squares + 1)
    x, z = np.meshgrid(steps, steps, indexing="ij")
    at = np.stack([x, np.full_like(x, height), z], axis=-1)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])


def block(low: list[float], high: list[float]) -> Triangles:
    """A closed box whose fronts face out."""
    shape = {"type": "box", "min": low, "max": high}
    return glpath.load_scene({"camera": CAMERA, "shapes": [shape], **SKY}).triangles


#: Not level with the middle of a row of texels, where rounding says what is below.
LEVEL = 0.013
GROUNDS = {"sheet": sheet(LEVEL), "slab": block([-40, -3, -40], [40, LEVEL, 40])}


def scene_of(*shapes: dict[str, Any], **more: Any) -> glpath.Scene:
    materials = {"black": {"reflectance": 0}, "grey": {"reflectance": 0.5}}
    return glpath.load_scene({"camera": CAMERA, "materials": materials, "shapes": list(shapes), **more})


def streamed(triangles: Triangles, size: int = 4, **more: Any) -> dict[str, Any]:
    return {"name": "ground", "type": "stream", "stream": Chunks(triangles, size), "material": "black", **more}


def in_memory(triangles: Triangles, **more: Any) -> dict[str, Any]:
    vertices = triangles.reshape(-1, 3)
    return {"vertices": vertices, "faces": np.arange(len(vertices)).reshape(-1, 3), **more}


def middles(surfaces: AtlasSurfaces) -> Triangles:
    """(N, 3) of the texels' middle samples."""
    return surfaces.texels.positions(surfaces.scene, surfaces.atlas, len(surfaces.texels.face) // 2)


def of_walls(surfaces: AtlasSurfaces) -> NDArray[np.bool_]:
    """(N,) texels of what stands upright."""
    return np.abs(surfaces.atlas.normals(surfaces.scene)[surfaces.texels.face[0], 1]) < 0.1


# Light


@pytest.mark.parametrize("light", [SKY, SUN], ids=["sky", "sun"])
def test_texels_over_a_stream_have_the_bits_of_those_over_a_mesh(light: dict[str, Any]) -> None:
    """The atlas is one of the box alone, so its texels are measured over the mesh, too."""
    hills = Hills(3, 9)
    triangles = np.concatenate([vertices[faces] for vertices, faces in map(hills.chunk, range(9))]).astype(float)
    house = {"name": "house", "type": "box", "min": [-0.5, -0.2, -0.5], "max": [0.5, 1, 0.5], "material": "grey"}
    scene = scene_of(house, {"type": "stream", "stream": hills, "material": "grey"}, **light)
    bake = Bake.of(scene, size=32, spp=4, denoise=False, seed=3, **SCANS)
    film = bake.film(RunOptions())
    meshed = scene_of(house, in_memory(triangles, material="grey"), **light)
    job, meshed = describe(
        meshed, integrator="path-buffer", sensor=bake.surfaces.sensor(), spp=4, seed=3, interleave="never", **SCANS
    )
    np.testing.assert_array_equal(film.radiance_sums, run_job(job, meshed, RunOptions()).radiance_sums)
    assert (film.mean > 0).any()


def test_shards_of_a_bake_merge_to_the_bits_of_the_whole() -> None:
    scene = scene_of(BLACK_BOX, streamed(sheet()), **SKY)
    films = [
        glpath.lightmap(scene, size=32, spp=spp, first_path_set=first, denoise=False, **SCANS).film
        for first, spp in ((0, 4), (0, 3), (3, 1))
    ]
    np.testing.assert_array_equal(films[1].merge(films[2]).radiance_sums, films[0].radiance_sums)


def test_a_streamed_wall_takes_the_sun_from_the_side_that_faces_it() -> None:
    wall = np.array([[[3, -9, 9], [3, -9, -9], [3, 9, -9]], [[3, -9, 9], [3, 9, -9], [3, 9, 9]]], float)
    for stands, on_the_side in ((9.0, 2 * math.sqrt(0.5)), (0.0, 0.0)):
        scene = scene_of(
            BLACK_BOX, streamed(sheet(-1.5)), streamed(wall + np.array([stands, 0, 0]), name="wall"), **SUN
        )
        baked = glpath.lightmap(scene, size=32, spp=4, denoise=False, **SCANS)
        surfaces = baked.surfaces
        normals = surfaces.atlas.normals(surfaces.scene)[surfaces.texels.face[0]]
        light = baked.irradiance[surfaces.texels.index][:, 0]
        np.testing.assert_allclose(light[normals[:, 0] > 0.9], on_the_side, rtol=1e-4)
        np.testing.assert_array_equal(light[normals[:, 0] < -0.9], 0.0)


@pytest.mark.parametrize("ground", GROUNDS)
def test_a_wall_has_no_fringe_where_it_enters_the_ground(ground: str) -> None:
    """Under a uniform sky it has pi / 2 over black ground, and below as well, where texels continue it."""
    scene = scene_of(BLACK_BOX, streamed(GROUNDS[ground]), **SKY)
    baked = glpath.lightmap(scene, size=48, spp=256, denoise=False, **SCANS)
    light = baked.irradiance[baked.surfaces.texels.index][of_walls(baked.surfaces)]
    assert len(light) > 500
    np.testing.assert_allclose(light, np.pi / 2, rtol=0.2)  # of the noisiest texel of 700
    assert light.mean() == pytest.approx(np.pi / 2, rel=0.03)  # beyond the ground's edge are 1.6 %


# What is covered


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("budget", [1, 64])
def test_texels_below_the_ground_are_inside(ground: str, budget: int) -> None:
    scene = scene_of(BLACK_BOX, streamed(GROUNDS[ground]), **SKY)
    surfaces = AtlasSurfaces.of(scene, size=48, geometry_budget=budget)
    np.testing.assert_array_equal(surfaces.inside, middles(surfaces)[:, 1] < LEVEL)
    samples = [surfaces.texels.positions(surfaces.scene, surfaces.atlas, s) for s in range(13)]
    assert min(each[~surfaces.inside, 1].min() for each in samples) > LEVEL  # of a texel that is partly below, too


def test_a_scene_in_parts_covers_what_it_covers_as_a_whole() -> None:
    hills = Hills(4, 70)  # of 39,200 triangles 2,600 fit into a MiB
    house = {"type": "box", "min": [-1, -1, -1], "max": [1, 1, 1], "material": "black"}
    triangles = np.concatenate([vertices[faces] for vertices, faces in map(hills.chunk, range(16))]).astype(float)
    scene = scene_of(house, streamed(triangles, 500), **SKY)
    few, one = (AtlasSurfaces.of(scene, size=48, geometry_budget=budget) for budget in (1, 64))
    np.testing.assert_array_equal(few.inside, one.inside)
    assert 0.2 < few.inside.mean() < 0.8
    np.testing.assert_array_equal(few.texels.face, one.texels.face)


def cellar(**more: Any) -> list[dict[str, Any]]:
    """A closed room in the ground, with a lamp at its ceiling."""
    lamp = [[-0.2, -1.1, -0.2], [0.2, -1.1, -0.2], [0.2, -1.1, 0.2], [-0.2, -1.1, 0.2]]
    room = {"type": "box", "min": [-1, -3, -1], "max": [1, -1, 1], "flip_normals": True, "material": "room"}
    return [room, {"type": "quad", "corners": lamp, "emission": {"radiance": 5}, "material": "room", **more}]


def test_a_room_in_the_ground_is_not_covered() -> None:
    scene = glpath.load_scene(
        {
            "camera": CAMERA,
            "materials": {"room": {"reflectance": 0.5, "two_sided": False}, "black": {"reflectance": 0}},
            "shapes": [*cellar(), streamed(sheet())],
            **SKY,
        }
    )
    assert not AtlasSurfaces.of(scene, size=64).inside.any()


def test_a_room_with_a_hole_in_its_wall_is_not_covered() -> None:
    """A few rays from its other walls come to the ground."""
    room = block([-1, -3, -1], [1, -1, 1])[:, ::-1]
    walls = room[~(room[..., 0] > 0.9).all(axis=1)]
    with_a_hole = [
        {"type": "quad", "corners": [[1, y, 1], [1, top, 1], [1, top, -1], [1, y, -1]], "material": "room"}
        for y, top in ((-3, -2.5), (-1.5, -1))
    ]
    scene = glpath.load_scene(
        {
            "camera": CAMERA,
            "materials": {"room": {"reflectance": 0.5, "two_sided": False}, "black": {"reflectance": 0}},
            "shapes": [in_memory(walls, material="room"), *with_a_hole, cellar()[1], streamed(sheet())],
            **SKY,
        }
    )
    surfaces = AtlasSurfaces.of(scene, size=64)
    opposite = middles(surfaces)[:, 0] < 0
    assert opposite.sum() > 500
    assert not surfaces.inside[opposite].any()


def test_a_streamed_roof_covers_nothing_that_light_gets_to() -> None:
    """Its fronts face up, as those of a ground do, so that what is below sees its backs."""
    floor = {"type": "quad", "corners": [[-9, 0, 9], [9, 0, 9], [9, 0, -9], [-9, 0, -9]], "material": "grey"}
    post = {"type": "box", "min": [-0.5, 0.1, -0.5], "max": [0.5, 1.9, 0.5], "material": "grey"}
    scene = scene_of(floor, post, streamed(sheet(2.0, extent=8.0)), **SKY)
    surfaces = AtlasSurfaces.of(scene, size=64)
    assert not surfaces.inside.any()


def test_fronts_that_face_the_ground_cover_nothing_and_warn_of_nothing_else() -> None:
    scene = scene_of(BLACK_BOX, streamed(sheet()[:, ::-1].copy()), **SKY)
    surfaces = AtlasSurfaces.of(scene, size=48)
    assert not surfaces.inside[middles(surfaces)[:, 1] < 0].any()


def test_rays_meet_the_first_of_all_parts() -> None:
    """Two sheets, in chunks that one budget has together and the other apart."""
    ground = np.concatenate([sheet(0.0, squares=40), sheet(3.0, squares=40)])
    scene = path_traceable(scene_of(BLACK_BOX, streamed(ground, 800), **SKY), streams=True)
    origins = np.random.default_rng(1).uniform(-9, 9, (50, 3)) + np.array([0, 20, 0])
    for budget in (1, 64):
        hits = StreamedRays(scene, budget).cast(origins, np.tile([0.0, -1.0, 0.0], (50, 1)))
        np.testing.assert_allclose(hits.distance, origins[:, 1] - 3.0)
        assert not hits.back.any()
        assert (hits.stream == 0).all()


# Errors, warnings and files


def test_it_is_said_what_is_not_baked_and_the_file_has_the_rest(tmp_path: Path) -> None:
    scene = scene_of(BLACK_BOX, streamed(sheet()), **SKY)
    with pytest.warns(
        SceneWarning, match=r'128 streamed triangles \("ground"\) are not baked.*hold them in memory'
    ):
        baked = glpath.lightmap(scene, size=32, spp=1, denoise=False, **SCANS)
    assert baked.film.metadata.integrator == "path-buffer"
    assert [shape.name for shape in baked.scene.shapes] == ["house"]
    for materials in ("unlit", "keep"):
        baked.save(tmp_path / f"{materials}.glb", materials=materials)
        read = glpath.load_scene(tmp_path / f"{materials}.glb")
        assert {shape.name for shape in read.shapes} == {"house"}
        lower, upper = read.bounds
        np.testing.assert_allclose([lower, upper], [[-1] * 3, [1] * 3], atol=1e-6)
    assert len(ReadGlb.of(tmp_path / "unlit.glb").json["meshes"]) == 1


def test_streams_alone_have_nothing_to_bake() -> None:
    with pytest.raises(SceneError, match="no surface in memory to bake: its 128 triangles are streamed") as error:
        glpath.lightmap(scene_of(streamed(sheet()), **SKY), size=32, spp=1)
    assert "meshes in memory" in error.value.remedy


def test_a_gather_bakes_beside_a_stream() -> None:
    """Half of the box's light comes from the ground."""
    grey = {**BLACK_BOX, "min": [-1, 0.5, -1], "max": [1, 2.5, 1], "material": "grey"}
    scene = scene_of(grey, {**streamed(sheet()), "material": "grey"}, **SKY)
    found, right = (
        glpath.lightmap(scene, size=32, spp=64, denoise=False, light_resolution=64, **chosen)
        for chosen in ({"integrator": "gather", "cast": "path-buffer"}, {"integrator": "path-buffer"})
    )
    assert found.film.metadata.integrator == "gather"
    assert found.film.mean.mean() == pytest.approx(right.film.mean.mean(), rel=0.02)


@pytest.mark.parametrize("chosen", [{"integrator": "path"}, {"integrator": "gather", "cast": "bvh"}], ids=str)
def test_engines_by_a_bvh_are_refused_before_the_atlas(
    chosen: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("glpath.apps.lightmap.surfaces.packed")
    scene = scene_of(BLACK_BOX, streamed(sheet()), **SKY)
    with pytest.raises(SceneError, match="streams triangles") as error:
        glpath.lightmap(scene, size=32, spp=1, **chosen)
    assert 'integrator="path-buffer"' in error.value.remedy


def test_a_budget_without_room_for_a_chunk_is_refused_before_the_atlas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("glpath.apps.lightmap.surfaces.packed")
    scene = scene_of(BLACK_BOX, streamed(sheet(squares=64), 8192), **SKY)
    with pytest.raises(UsageError, match="geometry_budget: 1 MiB, but 7 are needed for a chunk of 8,192"):
        glpath.lightmap(scene, size=32, spp=1, geometry_budget=1)


def test_far_from_the_origin_it_is_the_same_lightmap() -> None:
    far = np.array([5e5, 300.0, 4e6])
    house = {"type": "box", "min": (far - 1).tolist(), "max": (far + 1).tolist(), "material": "black"}
    near = AtlasSurfaces.of(scene_of(BLACK_BOX, streamed(sheet()), **SKY), size=48)
    moved = AtlasSurfaces.of(scene_of(house, streamed(sheet() + far), **SKY), size=48)
    np.testing.assert_array_equal(near.inside, moved.inside)
    np.testing.assert_allclose(middles(moved) + moved.scene.origin - far, middles(near), atol=1e-6)


# Exposure


def test_what_the_camera_sees_of_streams_does_not_count_for_the_exposure() -> None:
    """From above: the roof in the middle, with the light of a uniform sky, and ground around it."""
    grey, dim = {**BLACK_BOX, "material": "grey"}, {"sky": {"zenith": 0.1, "horizon": 0.1}}
    camera = {"position": [0, 9, 0], "target": [0, 0, 0], "up": [0, 0, -1], "fov": 40}
    scene = scene_of(grey, streamed(sheet()), **dim, camera=camera, film={"resolution": [64, 64]})
    baked = glpath.lightmap(scene, size=48, spp=64, denoise=False, **SCANS)
    seen = seen_by_camera(baked.surfaces, baked.lit_irradiance)
    x = np.abs(np.linspace(-1, 1, 129)[:-1] + 1 / 128) * 8 * math.tan(math.radians(20))  # on the plane of the roof
    np.testing.assert_array_equal(np.isfinite(seen[64, :, 0]), x < 1)
    np.testing.assert_allclose(seen[56:72, 56:72], 0.05, rtol=0.1)
    assert baked.exposure_stops("auto") == 1.75  # log2(0.18 / 0.05); with the sky of 0.1 for the ground it is 1
    away = {**camera, "position": [20, 9, 0], "target": [20, 0, 0]}
    scene = scene_of(grey, streamed(sheet()), **dim, camera=away)
    baked = glpath.lightmap(scene, size=48, spp=16, denoise=False, **SCANS)
    assert np.isnan(seen_by_camera(baked.surfaces, baked.lit_irradiance)).all()
    assert baked.exposure_stops("auto") == pytest.approx(math.log2(0.18 / 0.03), abs=0.5)  # of all texels


# The command


def test_the_command_bakes_beside_a_stream_and_resumes(tmp_path: Path) -> None:
    np.save(tmp_path / "ground.npy", sheet())
    (tmp_path / "scene.toml").write_text(
        """
        camera = { position = [0, 3, 9], target = [0, 0, 0] }
        sky = { zenith = 1, horizon = 1 }
        [materials]
        grey = { reflectance = 0.5 }
        [[shapes]]
        name = "house"
        type = "box"
        min = [-1, -1, -1]
        max = [1, 1, 1]
        material = "grey"
        [[shapes]]
        type = "stream"
        file = "ground.npy"
        material = "grey"
        """
    )
    out = tmp_path / "baked.glb"
    options = ["--size", "32", "--light-resolution", "64", "--max-depth", "3", "--no-denoise"]
    asked = ["lightmap", str(tmp_path / "scene.toml"), "-o", str(out), *options, "--geometry-budget", "16", "--spp"]
    done = CliRunner().invoke(app, [*asked, "4"])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "128 streamed triangles" in said
    assert "all 12 triangles in memory are in it" in said
    whole = out.read_bytes()
    bake = Bake.of(glpath.load_scene(tmp_path / "scene.toml"), size=32, spp=2, denoise=False, **SCANS)
    bake.film(RunOptions()).save(tmp_path / "baked.checkpoint.npz")
    assert Film.load(tmp_path / "baked.checkpoint.npz").path_sets == 2
    done = CliRunner().invoke(app, [*asked, "4", "-q", "--resume"])
    assert done.exit_code == 0, done.output
    assert out.read_bytes() == whole
    refused = CliRunner().invoke(app, [*asked, "4", "--integrator", "path"])
    assert refused.exit_code != 0


# Probes


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize(
    "shapes", [[], [{**BLACK_BOX, "min": [8, -1, 8], "max": [9, 1, 9]}]], ids=["alone", "house"]
)
def test_probes_below_the_ground_are_inside(ground: str, shapes: list[dict[str, Any]]) -> None:
    scene = scene_of(*shapes, streamed(GROUNDS[ground]), **SKY)
    grid = ProbeGrid.of(scene, (3, 4, 3), [[-3, -2, -3], [3, 2, 3]])
    np.testing.assert_array_equal(grid.valid, grid.positions[:, 1] > LEVEL)


def test_probes_over_black_ground_see_half_a_uniform_sky() -> None:
    scene = scene_of(streamed(GROUNDS["sheet"]), **SKY)
    found = glpath.probes(
        scene, (1, 2, 1), [[-1, -1, -1], [1, 1, 1]], spp=64, integrator="path-buffer", max_depth=2
    )
    assert found.repaired == 1
    np.testing.assert_allclose(found.coefficients[:, 0], 2 * math.pi * math.sqrt(0.25 / math.pi), rtol=0.02)
    by_default = glpath.probes(scene, (1, 2, 1), [[-1, -1, -1], [1, 1, 1]], spp=1)
    assert by_default.film.metadata.integrator == "path-buffer"
