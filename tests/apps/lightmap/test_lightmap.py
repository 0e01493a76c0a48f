"""Lightmaps: texels against brute force, light against closed forms, files by what others read in them."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import glpath
from glpath.apps.lightmap import atlas
from glpath.apps.lightmap.atlas import Atlas
from glpath.apps.lightmap.files import radiance_of, write_kept
from glpath.apps.lightmap.lightmap import Bake, Lightmap
from glpath.apps.lightmap.pages import pages_of
from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.apps.lightmap.texels import AtlasTexels, lattice, rasterised
from glpath.cli.main import app
from glpath.errors import SceneError, SceneWarning, UsageError
from glpath.film.film import Film
from glpath.film.image import read_image
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathSettings
from glpath.io import load_scene
from glpath.rendering.sides import Sides
from glpath.scene import Scene
from tests.reference.closed_forms import polygon_irradiance
from tests.support.engines import engine_options
from tests.support.gltf_files import Gltf, ReadGlb
from tests.support.lightmap_scenes import BLACK, CAMERA, FLOOR, LAMP, box, scene_of

pytest.importorskip("xatlas")


def lamp_irradiance(points: np.ndarray) -> np.ndarray:
    """Of the lamp on points (..., 3) that face up, over its radiance."""
    return polygon_irradiance(points, (0.0, 0.0, 1.0), LAMP["corners"])


def of_shape(surfaces: AtlasSurfaces, name: str) -> np.ndarray:
    """(N,): which texels are of a shape's front."""
    scene, atlas = surfaces.scene, surfaces.atlas
    number = [shape.name for shape in scene.shapes].index(name)
    face = surfaces.texels.face[0]
    return (scene.triangle_shape[atlas.triangle[face]] == number) & (atlas.side[face] == 0)


def positions(surfaces: AtlasSurfaces) -> np.ndarray:
    """(S, N, 3) of all samples."""
    texels = surfaces.texels
    return np.stack([texels.positions(surfaces.scene, surfaces.atlas, s) for s in range(len(texels.face))])


def quietly(baked: Lightmap, path: Path, **options: Any) -> list[Path]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return baked.save(path, **options)


# Texels


def test_many_charts_fit_a_small_page_by_narrower_gutters() -> None:
    """Of the furniture of `room` there are 1,797, whose gutters of four texels alone do not fit."""
    surfaces = AtlasSurfaces.of(glpath.load_scene("room"), size=512)
    assert surfaces.atlas.chart.max() > 1000
    assert surfaces.atlas.size == (512, 512)
    assert len(surfaces.inside) > 0.2 * 512**2


def test_charts_that_fit_no_page_are_refused_after_few_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model of 2,469 charts took 95 s to say that they do not fit 256 x 256."""
    trials = []

    def counted(*given: Any) -> Atlas:
        trials.append(given)
        return packed_once(*given)

    packed_once = atlas._packed
    monkeypatch.setattr(atlas, "_packed", counted)
    corners = np.random.default_rng(0).random((400, 1, 3)) + 0.1 * np.eye(3)
    leaves = {"type": "mesh", "vertices": corners.reshape(-1, 3), "faces": np.arange(1200).reshape(-1, 3)}
    with pytest.raises(UsageError, match=r"64 x 64 texels is too small: \d+ charts"):
        AtlasSurfaces.of(scene_of(leaves, ambient=1.0), size=64)
    assert len(trials) <= 8


def test_small_triangles_of_a_large_scene_are_on_a_page(tmp_path: Path) -> None:
    """xatlas has no chart for areas below 1e-7 of its unit, which were on a page that there is not."""
    ground = {"type": "quad", "corners": [[-500, -500, 0], [500, -500, 0], [500, 500, 0], [-500, 500, 0]]}
    pebble = {"name": "pebble", "type": "sphere", "center": [0, 0, 0.5], "radius": 0.1}
    splinter = {"type": "mesh", "vertices": [[5, 5, 5], [5.00001, 5, 5], [5, 5.00001, 5]], "faces": [[0, 1, 2]]}
    surfaces = AtlasSurfaces.of(scene_of(ground, pebble, splinter, ambient=1.0), texels=0.2, size=256)
    found, scene = surfaces.atlas, surfaces.scene
    names = [scene.shapes[number].name for number in scene.triangle_shape[found.triangle]]
    assert names.count("pebble") == np.sum(scene.triangle_shape == 1)
    assert (found.page < found.pages).all()
    assert len(scene.triangles) == len(np.unique(found.triangle)), "not even an area of 5e-11 is missing"
    baked = Bake.of(surfaces.scene, texels=0.2, size=256, spp=1)
    film = glpath.rendering.run(baked.job, scene=baked.scene)
    assert quietly(baked.lightmap(film), tmp_path / "a.glb")


def test_a_chart_that_is_larger_than_a_page_is_told_of() -> None:
    wide = {**FLOOR, "corners": [[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]]}
    scene = scene_of(wide, box("block", [1, 1, 1], [2, 2, 2]), ambient=1.0)
    with pytest.warns(
        SceneWarning, match=r"2 of 8 charts are larger than a page of 128 x 128 and have 1\.\d+ texels"
    ):
        AtlasSurfaces.of(scene, texels=8, size=128)


@pytest.mark.parametrize("options", [{"texels": 1e5}, {"size": 8192}])
def test_texels_that_fit_no_memory_are_refused(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """64 texels per unit of a square kilometre ended by the system's killer of processes."""
    monkeypatch.setattr("glpath.radiosity.memory.available_bytes", lambda: 20_000_000_000)
    with pytest.raises(UsageError, match=r"so many texels would need about .* GB of memory(.|\n)*Give "):
        AtlasSurfaces.of(scene_of(FLOOR, LAMP), **options)


def test_every_texel_that_a_triangle_touches_has_samples_at_the_nearest_places() -> None:
    random = np.random.default_rng(5)
    uv = random.uniform(2, 30, (3, 3, 2))
    zeros = np.zeros(3, np.int64)
    atlas = Atlas(np.arange(3), zeros, zeros, zeros, uv, (32, 32), 1, 1.0)
    found = rasterised(atlas)
    touched = {tuple(at) for at in np.stack([found.row, found.column], axis=1).tolist()}
    # By brute force: points all over the triangles, each of which is in some texel.
    b = random.dirichlet((1, 1, 1), 60_000)
    all_over = np.einsum("pc,fcx->fpx", b, uv).reshape(-1, 2)
    missed = {(int(y), int(x)) for x, y in all_over} - touched
    assert not missed
    edges = uv[found.face, 1:] - uv[found.face, :1]
    at = uv[found.face, 0] + np.einsum("snc,sncx->snx", found.b, edges)
    nearest = np.array([np.min(np.linalg.norm(all_over - place, axis=1)) for place in at[:, ::40].reshape(-1, 2)])
    assert nearest.max() < 0.2  # on a triangle
    middle = np.stack([found.column, found.row], axis=1) + 0.5
    assert np.abs(at - middle).max() < 1.2  # and no farther than the far corner of a texel that is just touched
    corner = np.stack([found.column, found.row], axis=1)
    in_lattice = np.abs(at - corner - lattice(len(at))[:, None]).max(axis=(0, 2)) < 0.06
    assert in_lattice.sum() > 150, "of texels that are covered as a whole no sample is moved but off edges"


def test_what_no_light_gets_to_is_a_dark_side() -> None:
    room = box("room", [-1, -1, 0], [1, 1, 2.5])
    block = box("block", [-0.5, -0.5, 0], [0.2, 0.2, 0.6])
    scene = scene_of(room, block, LAMP)
    lit = Sides.of(scene).lit
    of = {shape.name: lit[part] for shape, part in zip(scene.shapes, scene.shapes.ranges, strict=True)}
    assert of["room"].tolist() == [[False, True]] * 12, "a box's fronts are outside"
    assert of["block"].tolist() == [[True, False]] * 12
    assert of["lamp"][:, 0].all()
    # A window lets the sky in, and a pane in it the light through.
    assert Sides.of(replace(scene, sky=load_scene("cornell-box").sky)).lit.tolist() == lit.tolist()


def lights_in_two_rooms(first: int, intensity: float = 1.0) -> Scene:
    """Two closed rooms, with so many point lights in the first and one in the second."""
    rooms = [box(name, [x - 1, -1, -1], [x + 1, 1, 1]) for name, x in (("first", 0), ("second", 5))]
    places = [(0.8 * i / first - 0.4, 0.3, 0.0) for i in range(first)]
    lights = [{"type": "point", "position": place, "intensity": intensity} for place in places]
    lights.append({"type": "point", "position": (5, 0.3, 0), "intensity": 1.0})
    return scene_of(*rooms, lights=lights)


@pytest.mark.parametrize("first", [2, 8, 200])
def test_a_room_is_lit_by_its_light_however_many_another_room_has(first: int) -> None:
    scene = lights_in_two_rooms(first)
    sides = Sides.of(scene)
    assert sides.lit.tolist() == [[False, True]] * 24
    middles = scene.triangles.mean(axis=1)
    assert not sides.inside(np.arange(24), np.ones(24, np.int64), middles, np.full(24, 0.01)).any()


def test_lights_that_are_off_light_nothing() -> None:
    lit = Sides.of(lights_in_two_rooms(8, 0.0)).lit
    assert lit.tolist() == [[False, False]] * 12 + [[False, True]] * 12


def test_texels_under_a_block_are_inside_and_get_the_light_beside_it() -> None:
    block = box("block", [-0.5, -0.5, 0], [0.2, 0.3, 0.6])
    surfaces = AtlasSurfaces.of(scene_of(FLOOR, block, LAMP), size=128)
    floor = of_shape(surfaces, "floor")
    place = positions(surfaces)
    under = (place[..., 0] > -0.5) & (place[..., 0] < 0.2) & (place[..., 1] > -0.5) & (place[..., 1] < 0.3)
    under = under & (place[..., 2] < 0.01)
    inside = surfaces.inside[floor]
    expected = under[:, floor].all(axis=0)
    assert (inside == expected).mean() > 0.99
    assert not under[:, floor & ~surfaces.inside].any(), "no sample in the dark is part of a texel in the light"
    values = np.where(surfaces.inside, 0.0, 1.0)[:, None] * np.ones(3)
    pages, baked = pages_of(surfaces.atlas, surfaces.texels, values, surfaces.inside)
    assert pages[surfaces.texels.index][floor].min() == 1.0
    assert not baked[surfaces.texels.index][surfaces.inside].any()


def test_a_texel_that_a_wall_without_thickness_crosses_is_on_one_side_of_it() -> None:
    """So that the light of one side alone is on it, and half a texel of the other's at the most."""
    wall = {
        "name": "wall",
        "type": "quad",
        "corners": [[0.013, -1, 0], [0.013, 1, 0], [0.013, 1, 3], [0.013, -1, 3]],
    }
    other = LAMP | {"name": "other", "corners": [[x + 3, y, z] for x, y, z in LAMP["corners"]]}
    both = [LAMP | {"corners": [[x - 1, y, z] for x, y, z in LAMP["corners"]]}, other]
    surfaces = AtlasSurfaces.of(scene_of(FLOOR, wall | {"material": "grey"}, *both), size=96)
    floor = of_shape(surfaces, "floor")
    beyond = positions(surfaces)[:, floor, 0] > 0.013
    assert (beyond.all(axis=0) | ~beyond.any(axis=0)).all()
    before = rasterised(surfaces.atlas)
    was = (
        np.stack([before.positions(surfaces.scene, surfaces.atlas, s)[floor, 0] for s in range(len(beyond))])
        > 0.013
    )
    crossed = ~(was.all(axis=0) | ~was.any(axis=0))
    assert crossed.sum() > 20
    middle = len(beyond) // 2
    assert np.array_equal(beyond[0, crossed], was[middle, crossed]), "the side that the middle is on"


def test_what_is_under_a_wall_gets_light_of_its_own_side() -> None:
    column = np.arange(20)
    texels = AtlasTexels(*np.zeros((2, 20), np.int64), column, np.zeros((1, 20), np.int32), np.zeros((1, 20, 2)))
    atlas = Atlas(*np.zeros((4, 1), np.int64), np.zeros((1, 3, 2)), (20, 1), 1, 1.0)
    values = np.where(column < 10, 5.0, 0.0)[:, None] * np.ones(3)
    inside = (column >= 8) & (column < 12)
    pages, _ = pages_of(atlas, texels, np.where(inside[:, None], 99.0, values), inside)
    assert pages[0, 0, :, 0].tolist() == [5.0] * 10 + [0.0] * 10


# Light


@pytest.fixture(scope="module")
def lit_floor() -> Lightmap:
    return glpath.lightmap(scene_of(FLOOR, LAMP), size=48, spp=256, max_depth=1, denoise=False)


def test_under_a_lamp_every_texel_is_within_a_percent_of_the_closed_form(lit_floor: Lightmap) -> None:
    surfaces = lit_floor.surfaces
    floor = of_shape(surfaces, "floor")
    expected = lamp_irradiance(positions(surfaces)[:, floor]).mean(axis=0)[:, None] * [10, 5, 2]
    found = lit_floor.irradiance[surfaces.texels.index][floor]
    assert len(found) > 500
    np.testing.assert_allclose(found, expected, rtol=0.01)


@pytest.mark.parametrize("facing", ["up", "down"])
def test_a_back_that_is_not_there_throws_no_shadow(facing: str) -> None:
    """Of a sheet between lamp and floor the floor sees the back, or the front, which keeps all light away."""
    corners = [[-2, -2, 1], [2, -2, 1], [2, 2, 1], [-2, 2, 1]]
    sheet = {"type": "quad", "corners": corners if facing == "up" else corners[::-1], "material": "paper"}
    materials = BLACK | {"paper": {"reflectance": 0.5, "two_sided": False, "culled": True}}
    scene = scene_of(FLOOR, LAMP, sheet | {"name": "sheet"}, materials=materials)
    baked = glpath.lightmap(scene, size=64, spp=256, max_depth=1, denoise=False)
    floor = of_shape(baked.surfaces, "floor")
    found = baked.irradiance[baked.surfaces.texels.index][floor]
    assert len(found) > 100
    if facing == "up":
        expected = lamp_irradiance(positions(baked.surfaces)[:, floor]).mean(axis=0)[:, None] * [10, 5, 2]
        np.testing.assert_allclose(found, expected, rtol=0.015)
    else:
        assert found.max() == 0


def test_a_furnace_is_flat() -> None:
    """White surfaces in a white world, as long as paths that end are in it as well."""
    parts = {"materials": {"grey": {"reflectance": 1}}, "sky": {"zenith": 1, "horizon": 1}, "ambient": 1}
    ball = {"type": "sphere", "center": [0.4, 0, 0.5], "radius": 0.5, "subdivisions": 2, "material": "grey"}
    floor = FLOOR | {"material": "grey"}
    scene = load_scene({"camera": CAMERA, "shapes": [floor, ball, box("block", [-1, -1, 0], [0, 0, 1])], **parts})
    with pytest.warns(SceneWarning, match="reflects all light"):
        flat = glpath.lightmap(scene, size=96, spp=4, max_depth=1, denoise=False)
    # Nothing is chosen at random here: charts, gutters and seams leave it as it is.
    np.testing.assert_allclose(flat.irradiance, np.pi, rtol=1e-5)
    with pytest.warns(SceneWarning, match="reflects all light"):
        sampled = glpath.lightmap(scene, size=96, spp=16, max_depth=4, denoise=False)
    assert sampled.irradiance[sampled.baked].mean() == pytest.approx(np.pi, rel=0.01)


def test_a_bake_goes_on_to_the_same_bits(lit_floor: Lightmap) -> None:
    options: dict[str, Any] = {"size": 48, "max_depth": 1, "denoise": False}
    first = glpath.lightmap(scene_of(FLOOR, LAMP), spp=128, **options)
    whole = glpath.lightmap(scene_of(FLOOR, LAMP), spp=256, film=first.film, **options)
    assert np.array_equal(whole.irradiance, lit_floor.irradiance)
    with pytest.raises(UsageError, match="points"):
        glpath.lightmap(scene_of(FLOOR, LAMP), size=64, spp=256, max_depth=1, film=first.film)


# Files


def test_unlit_is_base_colour_times_light(lit_floor: Lightmap, tmp_path: Path) -> None:
    floor = FLOOR | {"material": "grey"}
    baked = glpath.lightmap(scene_of(floor, LAMP), size=48, spp=16)
    quietly(baked, tmp_path / "a.glb", exposure=-1.0)
    document = ReadGlb.of(tmp_path / "a.glb")
    assert document.json["extensionsUsed"] == ["KHR_materials_unlit"]
    (tmp_path / "a.png").write_bytes(document.image(0))
    shown = read_image(tmp_path / "a.png")
    texels = baked.surfaces.texels.index[1:]
    light = baked.irradiance[0][texels]
    floor_texels = of_shape(baked.surfaces, "floor")
    expected = np.clip(0.5 * light / np.pi * 0.5, 0, 1)
    np.testing.assert_allclose(shown[texels][floor_texels], expected[floor_texels], atol=0.006)
    assert (shown[texels][of_shape(baked.surfaces, "lamp")] > 0.9)[:, :3].all(axis=1).mean() > 0.4


@pytest.mark.parametrize("kind", ["lightmap", "radiosity"])
@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")  # backs are culled by viewers alone
def test_who_does_not_cull_sees_the_side_that_faces_him(kind: str, tmp_path: Path) -> None:
    """A sheet, red from above and blue from below. Each side is triangles of its own, which were in one place."""
    sheet = [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]
    above = [[x, 3, -z] for x, _, z in sheet]
    scene = glpath.load_scene(
        {
            "camera": {"position": [0.3, 4, 5], "target": [0, 0, 0], "fov": 40},
            "materials": {"white": {"reflectance": 0.8, "two_sided": True}, "black": {"reflectance": 0.0}},
            "shapes": [
                {"type": "quad", "corners": sheet, "material": "white"},
                {"type": "quad", "corners": above, "material": "black", "emission": {"radiance": [9, 0, 0]}},
                {
                    "type": "quad",
                    "corners": [[x, -3, z] for x, _, z in sheet],
                    "material": "black",
                    "emission": {"radiance": [0, 0, 9]},
                },
            ],
        }
    )
    path = tmp_path / "sheet.glb"
    if kind == "lightmap":
        glpath.lightmap(scene, size=64, spp=16).save(path, exposure=0)
    else:
        glpath.solve_radiosity(scene, patches=60).to_glb(scene, path)
    for height, channel in ((4, 0), (-4, 2)):
        camera = {"position": [0.3, height, 5], "target": [0, 0, 0]}
        seen = glpath.render(path, camera=camera, resolution=(48, 48), max_depth=1, spp=8).mean
        middle = seen[18:30, 18:30]
        assert middle[..., channel].min() > 0.05
        assert middle[..., 2 - channel].max() < 0.1 * middle[..., channel].min()


def test_materials_are_kept_and_the_light_is_beside(lit_floor: Lightmap, tmp_path: Path) -> None:
    written = quietly(lit_floor, tmp_path / "a.glb", materials="keep", moz=True)
    assert [path.name for path in written] == ["a.glb", *(f"a-0.lightmap.{s}" for s in ("exr", "png", "json"))]
    np.testing.assert_array_equal(read_image(tmp_path / "a-0.lightmap.exr"), lit_floor.irradiance[0])
    about = json.loads((tmp_path / "a-0.lightmap.json").read_text())
    assert about["unit"] == "W m^-2"
    document = ReadGlb.of(tmp_path / "a.glb")
    light = document.json["materials"][0]["extensions"]["MOZ_lightmap"]
    assert light["texCoord"] == 1
    assert light["intensity"] == pytest.approx(about["range"]) == pytest.approx(lit_floor.irradiance.max())
    # The file's second coordinates are where the light of a place is: read again, and kept.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of MOZ_lightmap, which is not used
        read = load_scene(tmp_path / "a.glb")
    again = AtlasSurfaces.of(read, size=48, uv="keep")
    found = lit_floor.irradiance[again.texels.index]
    for name in ("floor", "lamp"):
        which = of_shape(again, name)
        assert which.sum() == of_shape(lit_floor.surfaces, name).sum()
    floor = of_shape(again, "floor")
    height = again.scene.bounds[1] - again.scene.bounds[0]
    assert height[1] == pytest.approx(2.0, rel=1e-4), "y is up in glTF; backs are a little behind"
    place = positions(again)[:, floor][..., [0, 2, 1]] * [1, -1, 1]
    expected = lamp_irradiance(place).mean(axis=0)[:, None] * [10, 5, 2]
    np.testing.assert_allclose(found[floor], expected, rtol=0.02)


def test_moz_lightmap_has_the_light_of_each_place_on_several_pages(tmp_path: Path) -> None:
    """By what a reader does: the texture of the index, at the coordinates of texCoord, times the intensity."""
    wall = FLOOR | {"name": "wall", "corners": [[-1, 1, 0], [1, 1, 0], [1, 1, 2], [-1, 1, 2]], "material": "grey"}
    baked = glpath.lightmap(scene_of(FLOOR, wall, LAMP), texels=24, size=64, spp=64, max_depth=1, denoise=False)
    assert baked.atlas.pages > 1
    quietly(baked, tmp_path / "a.glb", materials="keep", moz=True)
    document = ReadGlb.of(tmp_path / "a.glb")
    assert "MOZ_lightmap" in document.json["extensionsUsed"]
    assert "extensionsRequired" not in document.json
    used, floors = set(), 0
    for mesh in document.json["meshes"]:
        for primitive in mesh["primitives"]:
            light = document.json["materials"][primitive["material"]]["extensions"]["MOZ_lightmap"]
            assert light.keys() == {"index", "texCoord", "intensity"}
            assert light["texCoord"] == 1
            used.add(light["index"])
            texture = document.json["textures"][light["index"]]
            sampler = document.json["samplers"][texture["sampler"]]
            assert sampler["wrapS"] == sampler["wrapT"] == 33071, "clamped to the edge"
            (tmp_path / "light.png").write_bytes(document.image(texture["source"]))
            levels = np.asarray(Image.open(tmp_path / "light.png"))
            assert levels.max() in (0, 255), "the intensity is the brightest texel's; the lamp itself has no light"
            # In the middles of triangles, which texels are small beside.
            faces = document.values(primitive["indices"]).reshape(-1, 3)
            middle = document.values(primitive["attributes"]["POSITION"])[faces].mean(axis=1)
            uv = document.values(primitive["attributes"]["TEXCOORD_1"])[faces].mean(axis=1)
            column, row = np.floor(uv.T * 64).astype(int)
            found = levels[row, column] / 255 * light["intensity"]
            if np.abs(middle[:, 2]).max() > 1e-6:
                continue  # of the floor alone the light is known; a node turns z, which is up, to y
            floors += 1
            expected = lamp_irradiance(middle)[:, None] * [10, 5, 2]
            np.testing.assert_allclose(found, expected, rtol=0.03, atol=light["intensity"] / 255)
    assert floors == 1
    assert used == set(range(baked.atlas.pages)) == set(range(len(document.json["textures"])))


# Refusals


def with_uv1(uv1: list[list[float]], apart: float = 0.5) -> Scene:
    scene = scene_of(FLOOR, LAMP)
    made = []
    for i, shape in enumerate(scene.shapes):
        mesh = replace(shape.geometry, uv1=np.add(uv1, (0.0, apart * i)))
        made.append(replace(shape, geometry=mesh))
    return replace(scene, shapes=tuple(made))


GOOD = [[0.1, 0.1], [0.4, 0.1], [0.4, 0.4], [0.1, 0.4]]


def test_coordinates_of_the_file_are_kept_if_they_are_an_unwrapping() -> None:
    surfaces = AtlasSurfaces.of(with_uv1(GOOD), size=40, uv="keep")
    rows = surfaces.texels.row[of_shape(surfaces, "floor")]
    assert (rows.min(), rows.max()) == (24, 35), "v runs upwards"
    with pytest.raises(SceneError, match="not within 0 to 1"):
        AtlasSurfaces.of(with_uv1([[0.1, 0.1], [1.4, 0.1], [1.4, 0.4], [0.1, 0.4]]), size=40, uv="keep")
    with pytest.raises(SceneError, match='"floor" and "lamp" overlap'):
        AtlasSurfaces.of(with_uv1(GOOD, apart=0.1), size=40, uv="keep")
    with pytest.raises(SceneError, match="no second texture coordinates"):
        AtlasSurfaces.of(scene_of(FLOOR, LAMP), size=40, uv="keep")


def test_a_two_sided_lamp_with_kept_coordinates_stays_two_sided(tmp_path: Path) -> None:
    scene = with_uv1(GOOD)
    shapes = tuple(replace(shape, emission_two_sided=shape.emits) for shape in scene.shapes)
    materials = tuple(replace(material, two_sided=True) for material in scene.materials)
    surfaces = AtlasSurfaces.of(replace(scene, shapes=shapes, materials=materials), size=40, uv="keep")
    page = np.ones((1, 40, 40, 3), np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_kept(surfaces, page, tmp_path / "a.glb", {"denoised": False}, False)
    read = load_scene(tmp_path / "a.glb")
    (lamp,) = (shape for shape in read.shapes if shape.emits)
    assert lamp.emission_two_sided


@pytest.mark.parametrize(("lamps", "side"), [("above", 0), ("below", 1), ("above and below", 0)])
def test_of_a_sheet_with_kept_coordinates_the_side_with_light_is_baked(
    lamps: str, side: int, tmp_path: Path
) -> None:
    """A doubleSided material has one place on the page: the front has it, but where the back alone is lit."""
    sheet = FLOOR | {"material": "both"}
    below = LAMP | {"name": "lower lamp", "corners": [[x, -y, -1.5] for x, y, _ in LAMP["corners"]]}
    shapes = [sheet, *([LAMP] if "above" in lamps else []), *([below] if "below" in lamps else [])]
    scene = scene_of(*shapes, materials={**BLACK, "both": {"reflectance": 0.5, "two_sided": True}})
    made = []
    for i, shape in enumerate(scene.shapes):
        beside = 0.2 * np.array(GOOD) + np.array([0.3 * i, 0.7])
        uv1 = beside if i else np.array([[0.05, 0.05], [0.95, 0.05], [0.95, 0.5], [0.05, 0.5]])
        made.append(replace(shape, geometry=replace(shape.geometry, uv1=uv1)))
    baked = glpath.lightmap(
        replace(scene, shapes=tuple(made)), size=40, uv="keep", spp=256, max_depth=1, denoise=False
    )
    found = baked.atlas
    assert np.array_equal(np.sort(found.triangle), np.arange(len(scene.triangles))), "each triangle once"
    of_sheet = scene.triangle_shape[found.triangle] == 0
    assert (found.side[of_sheet] == side).all()
    texels = baked.surfaces.texels
    there = of_sheet[texels.face[0]]
    lamp, normal = (LAMP, (0.0, 0.0, 1.0)) if side == 0 else (below, (0.0, 0.0, -1.0))
    expected = polygon_irradiance(positions(baked.surfaces)[:, there], normal, lamp["corners"]).mean(axis=0)
    np.testing.assert_allclose(baked.irradiance[texels.index][there], expected[:, None] * [10, 5, 2], rtol=0.01)
    quietly(baked, tmp_path / "a.glb", materials="keep")
    document = ReadGlb.of(tmp_path / "a.glb").json
    (mesh,) = [mesh for mesh in document["meshes"] if mesh["name"].startswith("floor")]
    assert document["materials"][mesh["primitives"][0]["material"]]["doubleSided"], (
        "who sees the other side sees this light"
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-o", "a.png"], "written as .glb"),
        (["-o", "a.glb", "--texels", "0"], "above 0"),
        (["-o", "a.glb", "--size", "8"], "from 16 to"),
        (["-o", "a.glb", "--uv", "mine"], "make, keep"),
        (["-o", "a.glb", "--materials", "all"], "unlit, keep"),
        (["-o", "a.glb", "--moz-lightmap"], "--materials keep"),
        (["-o", "a.glb", "--materials", "keep", "--exposure", "1"], "irradiance is written as it is"),
        (["-o", "a.glb", "--integrator", "classic"], "path, path-buffer, gather"),
        (["-o", "a.glb", "--uv", "keep", "--texels", "4"], "kept"),
    ],
)
def test_what_cannot_be_is_refused(arguments: list[str], says: str, tmp_path: Path) -> None:
    arguments[1] = str(tmp_path / arguments[1])
    done = CliRunner().invoke(app, ["lightmap", "cornell-box", *arguments])
    assert done.exit_code == 2
    assert says in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())


def test_the_command_bakes_and_goes_on(tmp_path: Path) -> None:
    out = tmp_path / "a.glb"
    asked = ["lightmap", "cornell-box", "-o", str(out), "--size", "64", "-q", "--spp"]
    assert CliRunner().invoke(app, [*asked, "4"]).exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["a.glb"]
    whole = out.read_bytes()
    kept = tmp_path / "a.checkpoint.npz"
    bake = glpath.lightmap("cornell-box", size=64, spp=2)
    bake.film.save(kept)
    assert Film.load(kept).path_sets == 2
    done = CliRunner().invoke(app, [*asked, "4", "--resume"])
    assert done.exit_code == 0, done.output
    assert out.read_bytes() == whole
    assert not kept.exists()


def test_texels_may_share_their_directions() -> None:
    """As a camera's pixels may: the same light, by scans of the path-buffer."""
    own, pair = (
        glpath.lightmap("cornell-box-36", size=64, spp=128, max_depth=4, denoise=False, **engine_options(engine))
        for engine in ("path", "pair")
    )
    assert pair.irradiance[pair.baked].mean() == pytest.approx(own.irradiance[own.baked].mean(), rel=0.02)
    far = np.abs(pair.irradiance - own.irradiance)[own.baked].mean() / own.irradiance[own.baked].mean()
    assert 0 < far < 0.15


def test_a_lightmap_has_all_bounces_by_itself() -> None:
    """As points have; five vertices are not enough."""
    scene = glpath.load_scene("cornell-box")
    assert isinstance(Bake.of(scene, size=64).job.integrator, GatherSettings)
    settings = Bake.of(scene, size=64, integrator="path").job.integrator
    assert isinstance(settings, PathSettings)
    assert (settings.max_depth, settings.roulette) == (1000, 4), "chance alone ends paths"


def test_metal_is_baked_as_if_it_were_rough_and_that_is_told(tmp_path: Path) -> None:
    """As glTF's materials are that leave the factor out; a model of these was black."""
    materials = {
        "gold": {"type": "principled", "reflectance": [1, 0.8, 0.3], "metallic": 1, "roughness": 0.5},
        "half": {"type": "principled", "reflectance": [1, 0.8, 0.3], "metallic": 0.5, "roughness": 0.5},
    }
    shapes = [{**FLOOR, "material": "gold"}, {**box("block", [0, 0, 0.1], [0.5, 0.5, 0.5]), "material": "half"}]
    sky = {"zenith": 1, "horizon": 1}
    scene = load_scene({"camera": CAMERA, "materials": materials, "shapes": shapes, "sky": sky})
    bake = Bake.of(scene, size=64, spp=8, max_depth=1, denoise=False)
    baked = bake.lightmap(glpath.rendering.run(bake.job, scene=bake.scene))
    with pytest.warns(SceneWarning) as told:
        baked.save(tmp_path / "a.glb")
    half, gold = (str(warning.message) for warning in told)
    assert 'material "half": the diffuse part alone is baked' in half
    assert 'material "gold": metal and mirrors' in gold
    radiance, opacity = radiance_of(baked.surfaces, baked.irradiance)
    page = (radiance * np.pi / np.maximum(baked.irradiance, 1e-9))[baked.baked & (opacity[..., 0] > 0)]
    of_gold = np.abs(page - [1.0, 0.8, 0.3]).max(axis=1) < 0.02
    assert of_gold.mean() > 0.5, "the floor reflects as much as it did, to all sides"


def test_what_cannot_be_kept_is_refused_before_it_is_baked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Textures on both texture coordinates leave none for the light, which was told after all path sets."""
    file = Gltf()
    image = file.texture(np.full((2, 2, 3), 200, np.uint8))
    material = file.add(
        "materials",
        pbrMetallicRoughness={"baseColorTexture": {"index": image}},
        emissiveTexture={"index": image, "texCoord": 1},
        emissiveFactor=[1, 1, 1],
    )
    uv = np.zeros((3, 2))
    file.node(mesh=file.mesh(TEXCOORD_0=uv, TEXCOORD_1=uv, material=material))
    monkeypatch.setattr(Bake, "of", None)  # is not come to
    asked = ["lightmap", str(file.write(tmp_path)), "-o", str(tmp_path / "a.glb"), "--materials", "keep"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 1
    assert "there is none left for its light" in " ".join(done.stderr.split())


def test_a_film_that_no_lightmap_can_be_made_of_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Lightmap, "of", Mock(side_effect=MemoryError("no room")))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "kept"))
    (tmp_path / "kept").mkdir()
    asked = ["lightmap", "cornell-box", "-o", str(tmp_path / "a.glb"), "--size", "64", "--spp", "1", "-q"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 1
    assert "The film is kept in" in done.stderr
    (film,) = (tmp_path / "kept").glob("*/film.npz")
    assert Film.load(film).path_sets == 1


@pytest.mark.parametrize("wrong", [{"size": "big"}, {"size": 256.5}, {"texels": "4"}, {"texels": [4]}])
def test_sizes_that_are_none_are_refused(wrong: dict[str, Any]) -> None:
    (name,) = wrong
    with pytest.raises(UsageError, match=rf"{name}: .* where a (whole )?number or None is needed"):
        glpath.lightmap("cornell-box", **wrong)


def test_a_size_may_be_numpys() -> None:
    assert AtlasSurfaces.of(glpath.load_scene("cornell-box"), size=np.int64(64)).atlas.size == (64, 64)


@pytest.mark.parametrize(("roughness", "warns"), [(0.9, False), (0.5, True)])
def test_a_matte_material_is_not_warned_of(tmp_path: Path, roughness: float, warns: bool) -> None:
    """Its highlight is as wide as its diffuse light."""
    materials = {"paint": {"type": "principled", "reflectance": 0.7, "roughness": roughness}}
    shapes = [{**FLOOR, "material": "paint"}]
    scene = load_scene(
        {"camera": CAMERA, "materials": materials, "shapes": shapes, "sky": {"zenith": 1, "horizon": 1}}
    )
    bake = Bake.of(scene, size=64, spp=1, max_depth=1, denoise=False)
    baked = bake.lightmap(glpath.rendering.run(bake.job, scene=bake.scene))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        baked.save(tmp_path / "a.glb")
    assert [str(each.message) for each in told if "diffuse part alone" in str(each.message)] != [] or not warns
    assert warns or not told


@pytest.mark.filterwarnings("error::glpath.errors.SceneWarning")
def test_lightmap_is_written_whole_before_its_warning_is_raised(tmp_path: Path) -> None:
    surfaces = AtlasSurfaces.of(with_uv1(GOOD), size=40, uv="keep")
    materials = tuple(replace(material, mirror=np.full(3, 0.5)) for material in surfaces.scene.materials)
    scene = replace(surfaces.scene, materials=materials)
    page = np.ones((1, 40, 40, 3), np.float32)
    film: Any = Mock(bias=lambda: None)
    seams: Any = None
    lit = np.ones((1, 40, 40), bool)
    baked = Lightmap(replace(surfaces, scene=scene), film, page, lit, lit, seams, False)
    with pytest.raises(SceneWarning, match="mirrors and metal are black") as caught:
        baked.save(tmp_path / "a.glb", materials="keep")
    files = {"a.glb", *(f"a-0.lightmap.{suffix}" for suffix in ("exr", "png", "json"))}
    assert {path.name for path in caught.value.result} == files == {path.name for path in tmp_path.iterdir()}


def test_a_name_on_several_pages_says_its_page(tmp_path: Path) -> None:
    """By these names a viewer finds the page of each mesh: the lines of the guide for three.js do."""
    shapes = [{**FLOOR, "name": "tile"}, {**box("block", [0, 0, 0.1], [0.5, 0.5, 0.5]), "name": "tile"}]
    materials = {"black": {"reflectance": 0.0}, "grey": {"reflectance": 0.5}}
    scene = load_scene(
        {"camera": CAMERA, "materials": materials, "shapes": shapes, "sky": {"zenith": 1, "horizon": 1}}
    )
    baked = glpath.lightmap(scene, texels=40, size=64, spp=1, max_depth=1, denoise=False)
    assert baked.atlas.pages > 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        baked.save(tmp_path / "a.glb", materials="keep")
    pages = [set(json.loads(file.read_text())["shapes"]) for file in sorted(tmp_path.glob("*.json"))]
    assert len(pages) == baked.atlas.pages
    assert sum(map(len, pages)) == len(set.union(*pages)), "no name is on two pages"
    document = ReadGlb.of(tmp_path / "a.glb").json
    assert {node["name"] for node in document["nodes"] if "mesh" in node} == set.union(*pages)
