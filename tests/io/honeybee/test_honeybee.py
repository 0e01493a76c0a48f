"""HBJSON of honeybee: what light depends on is read, by honeybee's own rules, and what is not known is named."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import SceneError, SceneWarning
from glpath.io.honeybee import sensor_points
from glpath.io.library import scene_parameters
from glpath.scene.model import Light, Scene
from glpath.sky.cie import cie_sky
from tests.support.command_line import run
from tests.support.honeybee_model import OUTDOORS, face, opening, polygon, shade, two_rooms, write

SKY = {"overcast": 10_000.0}


def loaded(tmp_path: Path, model: dict[str, Any], **parameters: Any) -> Scene:
    return glpath.load_scene(write(model, tmp_path / "a.hbjson"), {**SKY, **parameters})


def shape_of(scene: Scene, name: str) -> tuple[np.ndarray, np.ndarray, Any]:
    """Area vectors of a shape's triangles (n, 3), its corners (n, 3, 3), and its material."""
    number = next(i for i, shape in enumerate(scene.shapes) if shape.name == name)
    corners = scene.triangles[scene.shapes.ranges[number]]
    vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return vectors, corners, scene.materials[scene.shapes[number].material]


def test_faces_are_where_they_are_without_their_openings(tmp_path: Path) -> None:
    scene = loaded(tmp_path, two_rooms())
    wanted = {
        "a_floor": (0, 0, -20), "a_ceiling": (0, 0, 20), "a_south": (0, -9, 0), "window": (0, -3, 0),
        "a_east": (13, 0, 0), "door_a": (2, 0, 0), "a_north": (0, 12, 0), "a_west": (-15, 0, 0),
        "b_floor": (0, 0, -15), "b_east": (15, 0, 0), "board": (0, 0, 1), "table": (0, 0, 1), "tower": (0, -81, 0),
    }  # fmt: skip
    for name, vector in wanted.items():
        np.testing.assert_allclose(shape_of(scene, name)[0].sum(axis=0), vector, atol=1e-12, err_msg=name)


def test_a_byte_order_mark_before_the_json_is_left_out(tmp_path: Path) -> None:
    path = write(two_rooms(), tmp_path / "a.hbjson")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(glpath.load_scene(path, SKY).shapes)


def test_a_room_is_a_closed_solid(tmp_path: Path) -> None:
    """Its volume by the divergence theorem, from any origin."""
    scene = loaded(tmp_path, two_rooms())
    names = ["a_floor", "a_ceiling", "a_south", "window", "a_east", "door_a", "a_north", "a_west"]
    for origin in ((0, 0, 0), (7, -3, 11)):
        parts = [shape_of(scene, name)[:2] for name in names]
        volume = sum(float(((corners.mean(axis=1) - origin) * vectors).sum()) / 3 for vectors, corners in parts)
        assert volume == pytest.approx(60)


def test_of_a_shared_wall_there_is_one(tmp_path: Path) -> None:
    names = [shape.name for shape in loaded(tmp_path, two_rooms()).shapes]
    assert {"a_east", "door_a"} <= set(names)
    assert not {"b_west", "door_b"} & set(names)


def test_what_has_no_modifier_has_that_of_its_type(tmp_path: Path) -> None:
    model = two_rooms()
    model["orphaned_faces"] = [face("air", "AirBoundary", [(0, 0, 0), (1, 0, 0), (1, 1, 0)])]
    scene = loaded(tmp_path, model)
    grey = {"a_floor": 0.2, "a_ceiling": 0.8, "a_north": 0.5, "board": 0.35, "table": 0.5, "tower": 0.2}
    for name, reflectance in grey.items():
        assert shape_of(scene, name)[2].reflectance == pytest.approx([reflectance] * 3), name
    names = {name: shape_of(scene, name)[2].name for name in ("window", "door_a")}
    assert names == {"window": "generic_exterior_window_vis_0.64", "door_a": "generic_interior_window_vis_0.88"}
    assert "air" not in [shape.name for shape in scene.shapes]


def test_a_set_counts_more_than_the_type_and_an_own_modifier_most(tmp_path: Path) -> None:
    model = two_rooms()
    radiance = model["properties"]["radiance"]
    radiance["modifiers"] = [
        {"type": "Plastic", "identifier": "red", "r_reflectance": 0.6, "g_reflectance": 0.1, "b_reflectance": 0.1},
        {"type": "plastic", "identifier": "blue", "b_reflectance": 0.7, "specularity": 0.04, "roughness": 0.09},
        {"type": "Metal", "identifier": "steel", **dict.fromkeys(("r_reflectance", "g_reflectance"), 0.7)},
        {"type": "Light", "identifier": "tube", "r_emittance": 0.9, "g_emittance": 0.8, "b_emittance": 0.7},
        {"type": "Void", "identifier": "hole"},
    ]
    radiance["modifier_sets"] = [
        {
            "type": "ModifierSetAbridged",
            "identifier": "mine",
            "wall_set": {"type": "WallModifierSetAbridged", "exterior_modifier": "red"},
            "aperture_set": {"window_modifier": "generic_exterior_window_sol_0.37"},
            "air_boundary_modifier": None,
        }
    ]
    model["rooms"][0]["properties"]["radiance"]["modifier_set"] = "mine"
    faces = {each["identifier"]: each for each in model["rooms"][0]["faces"]}
    for name, modifier in {"a_west": "blue", "a_north": "steel", "a_ceiling": "tube", "a_floor": "hole"}.items():
        faces[name]["properties"]["radiance"]["modifier"] = modifier
    scene = loaded(tmp_path, model)
    assert shape_of(scene, "a_south")[2].reflectance == pytest.approx([0.6, 0.1, 0.1])
    assert shape_of(scene, "a_east")[2].name == "generic_wall_0.50"  # within, which the set does not say
    assert shape_of(scene, "window")[2].name == "generic_exterior_window_sol_0.37"
    blue = shape_of(scene, "a_west")[2]
    assert (blue.roughness, ((blue.ior - 1) / (blue.ior + 1)) ** 2) == pytest.approx((0.3, 0.04))
    assert shape_of(scene, "a_north")[2].metallic == 0.9
    ceiling = next(shape for shape in scene.shapes if shape.name == "a_ceiling")
    assert (*ceiling.emission, ceiling.emission_two_sided) == (0.9, 0.8, 0.7, False)
    assert "a_floor" not in [shape.name for shape in scene.shapes]


def test_holes_and_meshes_are_read(tmp_path: Path) -> None:
    model = two_rooms()
    ring = polygon((0, 0, 5), (4, 0, 5), (4, 4, 5), (0, 4, 5))
    ring["holes"] = [[[1, 1, 5], [2, 1, 5], [2, 3, 5]], [[3, 1, 5], [3, 2, 5], [3.5, 1, 5]]]
    model["orphaned_shades"].append({**shade("ring", [(0, 0, 0)] * 3), "geometry": ring})
    mesh = {"type": "Mesh3D", "vertices": [[0, 0, 6], [2, 0, 6], [2, 1, 6], [0, 1, 6]], "faces": [[0, 1, 2, 3]]}
    model["shade_meshes"] = [{"type": "ShadeMesh", "identifier": "sail", "geometry": mesh, "properties": {}}]
    scene = loaded(tmp_path, model)
    assert shape_of(scene, "ring")[0].sum(axis=0) == pytest.approx([0, 0, 16 - 1 - 0.25])
    assert shape_of(scene, "sail")[0].sum(axis=0) == pytest.approx([0, 0, 2])
    assert shape_of(scene, "sail")[2].name == "generic_context_0.20"


def test_meshes_without_faces_are_left_out(tmp_path: Path) -> None:
    model = two_rooms()
    mesh = {"type": "Mesh3D", "vertices": [[0, 0, 6], [2, 0, 6], [2, 1, 6]], "faces": []}
    model["shade_meshes"] = [{"type": "ShadeMesh", "identifier": "sail", "geometry": mesh, "properties": {}}]
    assert "sail" not in {shape.name for shape in loaded(tmp_path, model).shapes}
    with pytest.raises(SceneError, match="has no faces and no shades, so there is nothing to see"):
        loaded(tmp_path, {**model, "rooms": [], "orphaned_shades": []})


@pytest.mark.parametrize(("pane", "transmitted"), [("exterior", 0.64), ("interior", 0.88)])
def test_a_pane_lets_through_what_its_name_says(tmp_path: Path, pane: str, transmitted: float) -> None:
    """Honeybee names its panes by their transmittance at normal incidence."""
    corners = [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]
    condition = (
        OUTDOORS if pane == "exterior" else {"type": "Surface", "boundary_condition_objects": ["x", "y", "z"]}
    )
    model = {**two_rooms(), "rooms": [], "orphaned_shades": []}
    model["orphaned_apertures"] = [opening("Aperture", "pane", corners, condition)]
    sun = Light("sun", "directional", np.ones(3), direction=np.array([0.0, 0.0, -1.0]))
    scene = replace(loaded(tmp_path, model), sky=None, lights=(sun,))
    found = glpath.irradiance(scene, [[1.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]], spp=1, integrator="path")
    assert found.values[0] == pytest.approx([transmitted] * 3, abs=5e-3)


def test_a_translucent_sheet_sends_on_what_radiance_sends_on(tmp_path: Path) -> None:
    """Under a uniform sky of radiance 1: half of 0.8 goes through, a fifth of that straight on."""
    sheet = {"type": "Trans", "identifier": "sheet", **dict.fromkeys(("r_reflectance", "g_reflectance"), 0.8)}
    sheet |= {"b_reflectance": 0.8, "transmitted_diff": 0.5, "transmitted_spec": 0.2}
    model = {**two_rooms(), "rooms": [], "orphaned_shades": []}
    model["properties"]["radiance"]["modifiers"] = [sheet]
    large = opening("Aperture", "pane", [(-99, -99, 1), (99, -99, 1), (99, 99, 1), (-99, 99, 1)])
    large["properties"]["radiance"]["modifier"] = "sheet"
    model["orphaned_apertures"] = [large]
    up = np.array([0.0, 0.0, 1.0])
    scene = replace(loaded(tmp_path, model), sky=cie_sky(5, up, None, zenith=1.0))  # black below
    found = glpath.irradiance(scene, [[0.0, 0.0, 0.9]], [up], spp=256, integrator="path")
    assert found.values[0].mean() / np.pi == pytest.approx(0.8 * 0.5, rel=0.03)


def test_the_sky_gives_its_lux_on_open_ground(tmp_path: Path) -> None:
    scene = loaded(tmp_path, two_rooms(), ground=0.2)
    above, below = [[100.0, 100.0, 50.0]] * 2, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    found = glpath.irradiance(scene, above, below, spp=64, integrator="path")
    assert found.illuminance() == pytest.approx([10_000, 2_000], rel=0.02)


def test_measures_need_a_sky_and_pictures_have_one(tmp_path: Path) -> None:
    path = write(two_rooms(), tmp_path / "a.hbjson")
    with pytest.warns(SceneWarning, match=r"no light, so an overcast sky lights it; -D overcast=10000 sets lx"):
        scene = glpath.load_scene(path)
    assert scene.sky is not None
    assert scene.sky.up[2] == 1
    result = run("measure", path, "--points", f"{path}#desk", "-o", tmp_path / "a.csv")
    assert result.exit_code != 0
    assert "no light" in result.output


def test_sensors_are_points_of_measure(tmp_path: Path) -> None:
    path = write(two_rooms(), tmp_path / "a.hbjson")
    points, normals = sensor_points(path, "desk")
    assert points.tolist() == [[1.5, 1.25, 0.8], [1.5, 3.25, 0.8], [2.5, 1.25, 0.8], [2.5, 3.25, 0.8]]
    assert normals.tolist() == [[0, 0, 1]] * 4
    assert sensor_points(path, "Desk heights")[0].tolist() == points.tolist()
    assert len(sensor_points(path)[0]) == 5
    out = tmp_path / "lux.csv"
    result = run(
        "measure",
        path,
        "--points",
        f"{path}#desk",
        "-D",
        "overcast=10000",
        "--spp",
        "512",
        "--guide",
        "cosine",
        "-o",
        out,
    )
    assert result.exit_code == 0, result.output
    table = np.genfromtxt(out, delimiter=",", skip_header=1)
    assert table[:, :3].tolist() == points.tolist()
    lux = table[:, -2]
    assert np.all((lux > 10) & (lux < 5000))
    assert lux[[0, 2]].min() > lux[[1, 3]].max()  # nearer to the window


def test_views_are_cameras(tmp_path: Path) -> None:
    model = two_rooms()
    scene = loaded(tmp_path, model)
    camera = scene.camera
    assert camera.position.tolist() == [3.5, 4.5, 1.6]
    assert camera.fov == 60
    aspect = math.tan(math.radians(45)) / math.tan(math.radians(30))
    assert camera.resolution == (512, round(512 / aspect))
    model["properties"]["radiance"]["views"][0]["view_type"] = "h"
    with pytest.warns(SceneWarning, match="no view in perspective"):
        inside = loaded(tmp_path, model).camera
    assert 0 < inside.position[0] < 4
    assert 0 < inside.position[1] < 5
    assert 0 < inside.position[2] < 3
    with pytest.raises(SceneError, match=r'has no view "other". It has: corner'):
        loaded(tmp_path, model, view="other")
    with pytest.raises(SceneError, match=r'the view "corner" is of the type h'):
        loaded(tmp_path, model, view="corner")


def test_a_view_is_shifted_as_in_radiance(tmp_path: Path) -> None:
    """A shift of 1 starts where the view ends: its left border is the view's right border, and so for the lift."""
    model = two_rooms()
    (view,) = model["properties"]["radiance"]["views"]
    plain = loaded(tmp_path, model).camera
    view |= {"shift": 1.0, "lift": 1.0}
    moved = loaded(tmp_path, model).camera
    width, height = plain.resolution
    np.testing.assert_allclose(moved.rays(np.array([0.0, height])), plain.rays(np.array([width, 0.0])), atol=1e-12)
    view |= {"fore_clip": 1.0}
    with pytest.warns(SceneWarning, match='the fore_clip and aft_clip of the view "corner" are not used'):
        loaded(tmp_path, model)


def test_other_units_than_metres_are_told(tmp_path: Path) -> None:
    with pytest.warns(SceneWarning, match=r'units are "Feet".*EN 12464-1 need metres'):
        loaded(tmp_path, {**two_rooms(), "units": "Feet"})


def test_a_glow_that_never_illuminates_gives_no_light(tmp_path: Path) -> None:
    model = two_rooms()
    emittance = dict.fromkeys(("r_emittance", "g_emittance", "b_emittance"), 5.0)
    _modified(model, type="Glow", max_radius=-1, **emittance)
    with pytest.warns(SceneWarning, match=r'the glow "x" has the max_radius -1'):
        scene = loaded(tmp_path, model)
    (floor,) = (shape for shape in scene.shapes if shape.name == "a_floor")
    assert not floor.emission.any()
    _modified(model, type="Glow", max_radius=0, **emittance)
    (floor,) = (shape for shape in loaded(tmp_path, model).shapes if shape.name == "a_floor")
    assert floor.emission.tolist() == [5, 5, 5]


def test_a_mirror_whose_alternate_is_void_is_invisible(tmp_path: Path) -> None:
    model = two_rooms()
    _modified(model, type="Mirror", alternate_material={"type": "Void", "identifier": "void"})
    assert "a_floor" not in [shape.name for shape in loaded(tmp_path, model).shapes]
    _modified(model, type="Mirror", alternate_material=None)
    assert shape_of(loaded(tmp_path, model), "a_floor")[2].metallic == 1


@pytest.mark.parametrize(
    ("name", "reflectance"), [("mine", 0.6), ("lost", 0.5), ({"type": "GlobalModifierSet"}, 0.5)]
)
def test_the_global_modifier_set_is_that_of_rooms_without_one(
    tmp_path: Path, name: object, reflectance: float
) -> None:
    model = two_rooms()
    grey = dict.fromkeys(("r_reflectance", "g_reflectance", "b_reflectance"), 0.6)
    model["properties"]["radiance"] |= {
        "modifiers": [{"type": "Plastic", "identifier": "light", **grey}],
        "modifier_sets": [{"identifier": "mine", "wall_set": {"exterior_modifier": "light"}}],
        "global_modifier_set": name,
    }
    assert shape_of(loaded(tmp_path, model), "a_south")[2].reflectance.tolist() == [reflectance] * 3


def test_the_first_state_of_a_dynamic_group_is_that_of_a_static_model(tmp_path: Path) -> None:
    """honeybee-schema: RadianceSubFaceStateAbridged, RadianceShadeStateAbridged. Without a group all is static."""
    louvre = shade("louvre", [(1.0, -0.1, 1.0), (3.0, -0.1, 1.0), (3.0, -0.1, 1.5), (1.0, -0.1, 1.5)])
    curtain = shade("curtain", [(4.0, 1.0, 0.0), (4.0, 2.0, 0.0), (4.0, 2.0, 1.0), (4.0, 1.0, 1.0)])
    both = dynamic, static = two_rooms(), two_rooms()
    tint = {"type": "Glass", "identifier": "tint"} | dict.fromkeys([f"{c}_transmissivity" for c in "rgb"], 0.2)
    for model in both:
        model["properties"]["radiance"]["modifiers"] = [tint]
    window, door, board = ([o["rooms"][0]["faces"][2]["apertures"][0] for o in both],
                           [o["rooms"][0]["faces"][3]["doors"][0] for o in both],
                           [o["orphaned_shades"][0] for o in both])  # fmt: skip

    def give_states(item: dict[str, Any], modifier: str | None, *shades: dict[str, Any]) -> None:
        plain = [{key: each[key] for key in ("identifier", "geometry")} | {"modifier": "black"} for each in shades]
        states = [{"modifier": modifier, "shades": plain}, {"modifier": "black"}]
        item["properties"]["radiance"] |= {"dynamic_group_identifier": "group", "states": states}

    give_states(window[0], "tint", louvre)
    give_states(door[0], None, curtain)
    give_states(board[0], "black")
    window[1]["properties"]["radiance"]["modifier"] = "tint"
    board[1]["properties"]["radiance"]["modifier"] = "black"
    for each in (louvre, curtain):
        each["properties"]["radiance"]["modifier"] = "black"
    static["rooms"][0]["outdoor_shades"] = [louvre, curtain]
    found, expected = loaded(tmp_path, dynamic), loaded(tmp_path, static)
    assert {shape.name for shape in found.shapes} == {shape.name for shape in expected.shapes}
    for name in (shape.name for shape in expected.shapes):
        (_, corners, material), (_, wanted, wanted_material) = shape_of(found, name), shape_of(expected, name)
        np.testing.assert_array_equal(corners, wanted)
        assert material.name == wanted_material.name, name

    del window[0]["properties"]["radiance"]["dynamic_group_identifier"]
    del window[0]["properties"]["radiance"]["states"][0]["shades"][0]["modifier"]
    without = loaded(tmp_path, dynamic)
    assert shape_of(without, "window")[2].name == "generic_exterior_window_vis_0.64"
    assert "louvre" not in {shape.name for shape in without.shapes}
    del door[0]["properties"]["radiance"]["states"][0]["shades"][0]["modifier"]
    with pytest.warns(SceneWarning, match='"curtain" has no modifier, so it has generic_exterior_shade_0.35'):
        loaded(tmp_path, dynamic)


def test_info_has_the_objects(tmp_path: Path) -> None:
    path = write(two_rooms(), tmp_path / "a.hbjson")
    result = run("info", path, "--json")
    assert result.exit_code == 0, result.output
    found = {shape["name"]: shape["area"] for shape in json.loads(result.stdout)["shapes"]}
    assert found["window"] == pytest.approx(3)
    assert set(scene_parameters(str(path))) == {"overcast", "ground", "view"}


def _without(key: str, model: dict[str, Any]) -> None:
    del model["rooms"][1]["faces"][4][key]


def _wide(model: dict[str, Any]) -> None:
    model["rooms"][0]["faces"][2]["apertures"][0]["geometry"] = polygon(
        (1.0, 0.0, 1.0), (5.0, 0.0, 1.0), (5.0, 0.0, 2.5), (1.0, 0.0, 2.5)
    )


def _modified(model: dict[str, Any], **modifier: Any) -> None:
    model["properties"]["radiance"]["modifiers"] = [{"identifier": "x", **modifier}]
    model["rooms"][0]["faces"][0]["properties"]["radiance"]["modifier"] = "x"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: _without("geometry", m), r'rooms\[1\]\.faces\[4\] of "b_north" cannot be read: .*`geometry`'),
        (lambda m: m["rooms"][0]["faces"][0]["geometry"]["boundary"].pop(), None),
        (
            lambda m: m["rooms"][0]["faces"][0]["geometry"]["boundary"][1].pop(),
            r'boundary\[1\] of "a_floor" cannot be read: Expected `array` of length 3',
        ),
        (_wide, r'"a_south" has 1 holes, apertures and doors that overlap'),
        (lambda m: _modified(m, type="BSDF"), r'"a_floor" has the modifier "x" of the type BSDF. Allowed: Plastic'),
        (lambda m: _modified(m, type="Plastic", r_reflectance=1.5), r'the modifier "x" cannot be used: .*<= 1'),
        (lambda m: _modified(m, type="Glass", refraction_index=1e308), r'the modifier "x" cannot be used: .*<= 10'),
        (lambda m: _modified(m, type="Light", g_emittance=1e308), r'the modifier "x" cannot be used: .*<= 1000000'),
        (
            lambda m: m["rooms"][0]["properties"]["radiance"].update(modifier_set="lost"),
            r'"a_ceiling" has the modifier set "lost"|"a_floor" has the modifier set "lost"',
        ),
        (
            lambda m: m["orphaned_shades"][0]["properties"]["radiance"].update(modifier="lost"),
            r'"tower" has the modifier "lost", which is neither in the file',
        ),
        (lambda m: m.update(type="Room"), r'of "two_rooms" cannot be read'),
    ],
)
def test_errors_name_the_object(tmp_path: Path, change: Any, message: str | None) -> None:
    model = copy.deepcopy(two_rooms())
    change(model)
    if message is None:
        loaded(tmp_path, model)  # a triangle is a face, too
        return
    with pytest.raises(SceneError, match=message):
        loaded(tmp_path, model)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"overcast": float("inf")}, r"overcast is inf, but must be 0 to 1e15 lx"),
        ({"view": 3}, r"view is 3, but must be [^\n]*\n  Leave it out"),
    ],
)
def test_a_wrong_parameter_is_named(tmp_path: Path, parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        glpath.load_scene(write(two_rooms(), tmp_path / "a.hbjson"), parameters)


def test_files_that_are_no_models(tmp_path: Path) -> None:
    path = tmp_path / "a.hbjson"
    path.write_text("{")
    with pytest.raises(SceneError, match="is no JSON"):
        glpath.load_scene(path)
    with pytest.raises(SceneError, match="cannot be read"):
        glpath.load_scene(tmp_path / "b.hbjson")
    model = two_rooms()
    model["properties"]["radiance"]["sensor_grids"] = []
    with pytest.raises(SceneError, match="has no sensor grids"):
        sensor_points(write(model, path))
    with pytest.raises(SceneError, match=r'has no sensor grid "x". It has: desk, eye'):
        sensor_points(write(two_rooms(), path), "x")


@pytest.mark.evidence
def test_honeybee_finds_the_same(tmp_path: Path) -> None:
    """Areas, normals, modifiers and sensors by honeybee-core and honeybee-radiance."""
    pytest.importorskip("honeybee_radiance")
    from honeybee.model import Model

    path = write(two_rooms(), tmp_path / "a.hbjson")
    scene, theirs = loaded(tmp_path, two_rooms()), Model.from_hbjson(str(path))
    skipped = {"b_west", "door_b"}
    faces = [each for each in theirs.faces if each.identifier not in skipped]
    objects = [(each, each.punched_geometry) for each in faces]
    others = [*theirs.apertures, *theirs.doors, *theirs.shades]
    objects += [(each, each.geometry) for each in others if each.identifier not in skipped]
    assert {each.identifier for each, _ in objects} == {shape.name for shape in scene.shapes}
    for each, geometry in objects:
        vectors, _, material = shape_of(scene, each.identifier)
        normal = np.array(geometry.normal.to_array())
        np.testing.assert_allclose(vectors.sum(axis=0), geometry.area * normal, atol=1e-9)
        assert material.name == each.properties.radiance.modifier.identifier
    for grid in theirs.properties.radiance.sensor_grids:
        points, directions = sensor_points(path, grid.identifier)
        assert points.tolist() == [list(sensor.pos) for sensor in grid.sensors]
        assert directions.tolist() == [list(sensor.dir) for sensor in grid.sensors]
