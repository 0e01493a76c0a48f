"""The shipped scenes: found by name, and what their sources say they are."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
import typer
from scipy import spatial
from typer.testing import CliRunner

from glpath.cli import scenes
from glpath.errors import SceneError, UsageError
from glpath.io import load_scene, parameters_from_options, scene_from_dict, shipped_scenes
from glpath.scene import Scene, Shape, check_scene


def shape(scene: Scene, name: str) -> Shape:
    return next(each for each in scene.shapes if each.name == name)


def part_of(scene: Scene, name: str) -> slice:
    return scene.shapes.ranges[scene.shapes.index(shape(scene, name))]


def triangles(scene: Scene, name: str) -> np.ndarray:
    return scene.triangles[part_of(scene, name)]


def pixels(scene: Scene, points: np.ndarray) -> np.ndarray:
    """(N, 2) where points (N, 3) lie in the picture: x to the right and y up, each -1 to 1."""
    right, up, forward = scene.camera.frame()
    seen = points - scene.camera.position
    half = np.tan(np.radians(scene.camera.fov) / 2)
    return np.stack([seen @ right, seen @ up], axis=1) / (half * (seen @ forward)[:, None])


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_shipped_scene_loads_without_a_warning(name: str):
    scene = load_scene(name)
    assert check_scene(scene) == []
    assert scene.name == name
    assert "\n" not in shipped_scenes()[name]


@pytest.mark.parametrize("name", ["cornell-box", "cornell-box-36"])
def test_the_red_wall_is_on_the_left_and_the_light_above(name: str):
    scene = load_scene(name)
    red = next(s for s in scene.shapes if scene.materials[s.material].name == "red")
    green = next(s for s in scene.shapes if scene.materials[s.material].name == "green")
    assert (pixels(scene, triangles(scene, red.name).reshape(-1, 3))[:, 0] < -0.5).all()
    assert (pixels(scene, triangles(scene, green.name).reshape(-1, 3))[:, 0] > 0.5).all()
    assert (pixels(scene, triangles(scene, "light").reshape(-1, 3))[:, 1] > 0.5).all()


@pytest.mark.parametrize("name", ["cornell-box", "cornell-box-36"])
def test_the_fronts_of_the_room_are_inward_and_of_the_blocks_outward(name: str):
    scene = load_scene(name)
    lower, upper = scene.bounds
    normals, centres = scene.normals, scene.triangles.mean(axis=1)
    for each, part in zip(scene.shapes, scene.shapes.ranges, strict=True):
        inside_of_it = (lower + upper) / 2
        sign = 1
        if each.count > 2:
            inside_of_it = scene.triangles[part].reshape(-1, 3).mean(axis=0)
            sign = -1
        assert (sign * np.sum(normals[part] * (inside_of_it - centres[part]), axis=1) > 0).all(), each.name
    assert np.allclose(normals[part_of(scene, "light").start], [0, -1, 0], atol=1e-6)


def test_the_cornell_box_has_the_published_measures():
    scene = load_scene("cornell-box")
    assert len(scene.triangles) == 6 * 2 + 2 * 10
    assert scene.bounds[1].tolist() == [556, 548.8, 559.2]
    camera = scene.camera
    assert camera.fov == pytest.approx(2 * np.degrees(np.arctan(0.0125 / 0.035)), abs=1e-4)
    assert camera.frame()[2].tolist() == [0, 0, 1]
    light = triangles(scene, "light")
    assert scene.areas[part_of(scene, "light")].sum() == pytest.approx(130 * 105)
    assert 548.8 - 0.2 < light[..., 1].min() < 548.8  # below the ceiling, not in it
    tops = {"short-block": 165, "tall-block": 330}
    for name, height in tops.items():
        corners = triangles(scene, name)
        assert corners[..., 1].max() == height
        edges = np.linalg.norm(corners[:2] - np.roll(corners[:2], 1, axis=1), axis=2)
        assert np.sort(edges.ravel())[:4] == pytest.approx(
            [166] * 4, abs=2
        )  # the blocks are square, about 166 wide
        assert shape(scene, name).count == 10


def test_the_cornell_box_has_no_gap_between_its_walls():
    scene = load_scene("cornell-box")
    walls = ["floor", "ceiling", "back-wall", "right-wall", "left-wall"]
    corners = {tuple(point) for name in walls for point in triangles(scene, name).reshape(-1, 3)}
    assert len(corners) == 8  # each wall's corners are its neighbours', to the last digit
    for name, top in (("short-block", 165), ("tall-block", 330)):
        points = {tuple(point) for point in triangles(scene, name).reshape(-1, 3)}
        assert {(x, y == top, z) for x, y, z in points} == {(x, b, z) for x, _, z in points for b in (True, False)}


@pytest.mark.evidence
def test_cornell_box_36_is_the_scene_of_mitsuba():
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    theirs = mitsuba.cornell_box()
    ours = load_scene("cornell-box-36")
    plane = np.array([[x, y, 0] for x in (-1, 1) for y in (-1, 1)], float)
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)

    def world(points: np.ndarray, to_world: object) -> np.ndarray:
        matrix = np.array(to_world.matrix)  # type: ignore[attr-defined]
        return points @ matrix[:3, :3].T + matrix[:3, 3]

    objects = {key: value for key, value in theirs.items() if isinstance(value, dict) and "to_world" in value}
    del objects["sensor"]
    assert {each.name for each in ours.shapes} == set(objects)
    for key, value in objects.items():
        expected = world(cube if value["type"] == "cube" else plane, value["to_world"])
        found = np.unique(triangles(ours, key).reshape(-1, 3).round(6), axis=0)
        assert np.allclose(found, np.unique(expected.round(6), axis=0), atol=2e-6), key
        material = ours.materials[shape(ours, key).material]
        assert not material.two_sided  # a `diffuse` of Mitsuba is black behind
        assert material.name == value["bsdf"]["id"]
        assert np.allclose(material.reflectance, theirs[material.name]["reflectance"]["value"])
        if value["type"] == "rectangle":
            normal = np.array(value["to_world"].matrix)[:3, 2]
            assert np.allclose(
                ours.normals[part_of(ours, key).start], normal / np.linalg.norm(normal), atol=1e-6
            ), key
    assert np.allclose(shape(ours, "light").emission, theirs["light"]["emitter"]["radiance"]["value"])
    sensor, camera = theirs["sensor"], ours.camera
    matrix = np.array(sensor["to_world"].matrix)
    assert np.allclose(camera.position, matrix[:3, 3])
    right, up, forward = camera.frame()
    assert np.allclose([-right, up, forward], matrix[:3, :3].T)
    assert camera.fov == pytest.approx(sensor["fov"])
    assert camera.resolution == (sensor["film"]["width"], sensor["film"]["height"])
    assert len(ours.triangles) == 36


@pytest.mark.parametrize(
    "parameters", [{}, {"shape": "sphere"}, {"subdivisions": "0"}, {"shape": "sphere", "subdivisions": 3}]
)
def test_the_furnace_is_closed_and_its_fronts_are_inward(parameters: dict):
    scene = load_scene("furnace", parameters)
    ends = scene.triangles[:, [1, 2, 0]]
    edges = {
        (tuple(a), tuple(b))
        for start, end in zip(scene.triangles, ends, strict=True)
        for a, b in zip(start, end, strict=True)
    }
    assert len(edges) == 3 * len(scene.triangles)
    assert all((b, a) in edges for a, b in edges)
    inward = scene.camera.position - scene.triangles[:, 0]
    assert (np.sum(inward * scene.normals, axis=1) > 0).all()


def test_three_spheres_are_stacked_on_a_ground_under_a_lamp():
    scene = load_scene("three-spheres")
    assert [each.primitive for each in scene.shapes] == ["plane", "sphere", "sphere", "sphere"]
    centres = scene.spheres[:, :, 3]
    assert centres[:2, 2].tolist() == pytest.approx([1, 1])  # on the ground
    apart = np.linalg.norm(centres - np.roll(centres, 1, axis=0), axis=1)
    assert apart == pytest.approx([2, 2, 2], abs=1e-6)  # each touches the other two
    assert (np.abs(pixels(scene, np.concatenate([centres + d for d in np.eye(3)]))) < 0.8).all()
    (lamp,) = scene.lights
    assert lamp.kind == "point"
    assert lamp.position[2] > 4
    assert scene.sky is not None
    materials = [scene.materials[each.material] for each in scene.shapes]
    assert sum(material.texture is not None for material in materials) >= 2  # figure 11
    assert all(material.mirror.any() for material in materials)  # figure 10


def covered(scene: Scene, side: int = 64) -> float:
    """Share of the picture that the spheres and triangles cover, by rays through side x side places."""
    right, up, forward = scene.camera.frame()
    half_height = np.tan(np.radians(scene.camera.fov) / 2)
    half_width = half_height * scene.camera.resolution[0] / scene.camera.resolution[1]
    x, y = np.meshgrid((np.arange(side) + 0.5) / side * 2 - 1, (np.arange(side) + 0.5) / side * 2 - 1)
    rays = forward + half_width * x[..., None] * right + half_height * y[..., None] * up
    hit = np.zeros((side, side), bool)
    for sphere in scene.spheres:
        away = sphere[:, 3] - scene.camera.position
        distance = np.linalg.norm(np.cross(rays, away), axis=2) / np.linalg.norm(rays, axis=2)
        hit |= distance < sphere[0, 0]
    for corners in scene.triangles - scene.camera.position:
        sides = rays @ np.cross(corners, np.roll(corners, -1, axis=0)).T
        hit |= (sides < 0).all(axis=2) | (sides > 0).all(axis=2)
    return float(hit.mean())


@pytest.mark.parametrize("objects", [1, 2, 3, 10, 50, 100, 6000])
@pytest.mark.parametrize("kind", ["sphere", "triangle"])
@pytest.mark.parametrize("aspect", [0.5, 1, 1280 / 720])
def test_stacked_objects_are_in_view_and_touch_no_other(objects: int, kind: str, aspect: float):
    scene = load_scene("stacked", {"objects": objects, "kind": kind, "aspect": aspect})
    assert len(scene.shapes) == len(scene.spheres) + len(scene.triangles) == objects
    assert {each.count for each in scene.shapes} == {1}
    if kind == "sphere":
        centres, radius = scene.spheres[:, :, 3], scene.spheres[0, 0, 0]
        assert np.array_equal(scene.spheres[:, :, :3], np.broadcast_to(radius * np.eye(3), (objects, 3, 3)))
        corners = np.array([[x, y, 1] for x in (-1, 1) for y in (-1, 1)])
        points = (centres[:, None] + radius * corners).reshape(-1, 3)
        if objects > 1:
            nearest = spatial.cKDTree(centres).query(centres, 2)[0][:, 1]
            assert nearest == pytest.approx(2 * radius, rel=1e-9)  # each rests on others, none is in another
    else:
        points = scene.triangles.reshape(-1, 3)
        assert (scene.normals[:, 2] > 0.9).all()
        centres = scene.triangles.mean(axis=1)
        reach = np.linalg.norm(scene.triangles - centres[:, None], axis=2).max()
        if objects > 1:
            assert spatial.cKDTree(centres).query(centres, 2)[0][:, 1].min() > 0.99 * reach
    seen = np.abs(pixels(scene, points) / [scene.camera.resolution[0] / scene.camera.resolution[1], 1])
    assert (seen <= 1 + 1e-12).all()
    assert seen.max() > 0.95  # as large as the picture allows


@pytest.mark.parametrize(("kind", "least"), [("sphere", 0.6), ("triangle", 0.55)])
def test_stacked_objects_fill_the_picture_whatever_their_number(kind: str, least: float):
    shares = [covered(load_scene("stacked", {"objects": n, "kind": kind})) for n in (50, 100, 1000)]
    assert min(shares) > least
    three = covered(load_scene("stacked", {"objects": 3, "kind": kind}))
    assert three > 0.25


def test_stacked_spheres_stand_on_each_other_row_by_row():
    centres = load_scene("stacked", {"objects": 3}).spheres[:, :, 3]
    assert centres[0, 1] == centres[1, 1] < centres[2, 1]
    assert centres[2, 0] == pytest.approx(0)  # figure 12, left
    tower = load_scene("stacked", {"objects": 3, "aspect": 0.25}).spheres[:, :, 3]
    assert np.ptp(tower[:, 0]) == 0


def test_a_ground_goes_below_the_stack():
    scene = load_scene("stacked", {"objects": 20, "ground": "true"})
    (ground,) = scene.planes
    assert ground[:, 2].tolist() == [0, 1, 0]
    assert np.linalg.det(ground[:, :3]) == pytest.approx(1)
    assert ground[1, 3] == pytest.approx(scene.bounds[0][1])
    assert scene.shapes[0].primitive == "plane"
    assert scene.shapes.primitive_shape("sphere").tolist() == list(range(1, 21))
    assert check_scene(scene) == []


def test_a_million_objects_are_quickly_there():
    start = time.process_time()
    scene = load_scene("stacked", {"objects": 1_000_000})
    elapsed = time.process_time() - start
    assert len(scene.spheres) == 1_000_000
    assert sum(each.count for each in scene.shapes) == 1_000_000
    assert len(scene.shapes.primitive_shape("sphere")) == 1_000_000
    assert elapsed < 10  # 0.6 s where nothing else runs
    start = time.process_time()
    assert len(load_scene("stacked", {"objects": 6000, "kind": "triangle"}).shapes) == 6000
    assert time.process_time() - start < 1  # 0.02 s


def test_parameters_shape_the_furnace():
    text = {"reflectance": "0.25", "radiance": "3", "resolution": "16", "subdivisions": "1"}
    scene = load_scene("furnace", text)
    assert scene.materials[0].reflectance.tolist() == [0.25] * 3
    assert scene.shapes[0].emission.tolist() == [3] * 3
    assert scene.camera.resolution == (16, 16)
    assert len(scene.triangles) == 48
    values = {"reflectance": 0.25, "radiance": 3, "resolution": 16, "subdivisions": 1}
    assert load_scene("furnace", values).digest() == scene.digest()


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        (
            "furnace",
            {"reflectence": "1"},
            ["no parameter `reflectence`", "reflectance=0.5", "Did you mean `reflectance`?"],
        ),
        ("furnace", {"reflectance": "1.5"}, ['reflectance is "1.5"', "from 0 to 1", "default is 0.5"]),
        ("furnace", {"reflectance": "nan"}, ["reflectance is"]),
        ("furnace", {"resolution": "many"}, ['resolution is "many"', "whole number from 1"]),
        ("furnace", {"shape": "torus"}, ['shape is "torus"', "box or sphere"]),
        ("stacked", {"objects": "0"}, ['objects is "0"', "from 1 to 1000000", "default is 100"]),
        ("stacked", {"kind": "cube"}, ['kind is "cube"', "sphere or triangle"]),
        ("stacked", {"ground": "perhaps"}, ['ground is "perhaps"', "true or false"]),
        ("cornell-box", {"size": "2"}, ["cornell-box: has no parameter `size`", "time=0.0"]),
    ],
)
def test_a_wrong_parameter_is_named_with_what_is_allowed(name: str, parameters: dict, expected: list[str]):
    with pytest.raises(SceneError) as error:
        load_scene(name, parameters)
    for part in expected:
        assert part in str(error.value)


def test_options_are_pairs():
    assert parameters_from_options(["a=1", "b = x=y"]) == {"a": "1", "b": "x=y"}
    for wrong in ("a", "=3"):
        with pytest.raises(UsageError, match="key=value"):
            parameters_from_options([wrong])


def test_an_unknown_name_lists_the_shipped_scenes_the_nearest_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError) as error:
        load_scene("furnaces")
    assert '"furnaces" is neither a shipped scene nor a file. Shipped: furnace, ' in str(error.value)
    (tmp_path / "furnaces").write_text("[camera]\n")
    with pytest.raises(SceneError, match="furnaces: camera lacks the field `position`"):
        load_scene("furnaces")


def test_a_scene_is_taken_as_it_is():
    scene = load_scene("furnace")
    assert load_scene(scene) is scene
    with pytest.raises(SceneError, match="no parameters"):
        load_scene(scene, {"radiance": 1})


def test_the_hash_is_of_what_is_seen_and_not_of_names():
    data = {"camera": {"position": [0, 0, 5], "target": [0, 0, 0]}, "shapes": [{"type": "sphere", "radius": 1.0}]}
    named = {**data, "name": "other", "shapes": [{**data["shapes"][0], "name": "ball"}]}
    larger = {**data, "shapes": [{"type": "sphere", "radius": 1.0000001}]}
    assert scene_from_dict(data).digest() == scene_from_dict(named).digest()
    assert scene_from_dict(data).digest() != scene_from_dict(larger).digest()


# --- the commands ---


def run(*arguments: str) -> str:
    app = typer.Typer()
    scenes.register(app)
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == 0, result.output
    return result.stdout


def test_info_tells_what_is_in_a_scene():
    output = run("info", "cornell-box")
    for part in ("32 triangles", "tall-block", "[0.63, 0.065, 0.05]", "at [278, 273, -800]", "512 x 512", "Lights"):
        assert part in output


def test_info_tells_of_spheres_planes_textures_and_lights():
    output = run("info", "three-spheres")
    parts = ["3 spheres, 1 plane", "infinite", "12.5664", "tiles", "2 x 2", "nearest", "point", "sky", "ambient"]
    for part in parts:
        assert part in output
    told = json.loads(run("info", "three-spheres", "--json"))
    assert (told["triangles"], told["spheres"], told["planes"]) == (0, 3, 1)
    assert [each["area"] for each in told["shapes"]] == [None, *[pytest.approx(4 * np.pi)] * 3]
    scene = load_scene("three-spheres")
    (lamp,) = told["lights"]
    assert lamp["kind"] == "point"
    assert lamp["power"] == pytest.approx((4 * np.pi * scene.lights[0].intensity).tolist())
    assert told["ambient"] == scene.ambient.tolist()
    assert told["sky"]["zenith"] == scene.sky.zenith.tolist()
    assert [each["texture"] for each in told["materials"]] == ["tiles", "beach-ball", None, None]
    assert told["materials"][3]["mirror"] == scene.materials[3].mirror.tolist()
    assert told["textures"][0] == {"name": "tiles", "size": [2, 2], "scale": [0.4, 0.4], "filter": "nearest"}


def test_info_describes_every_kind_of_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("COLUMNS", "200")
    (tmp_path / "a.toml").write_text(
        """
        camera = { position = [0, 0, 5], target = [0, 0, 0] }
        shapes = [{ type = "sphere", radius = 1, transform = [{ scale = [1, 2, 3] }], emission = { radiance = 1 } }]
        lights = [
            { type = "spot", position = [0, 0, 4], target = [0, 0, 0], intensity = 7 },
            { type = "directional", direction = [0, -1, 0], irradiance = 3 },
            { type = "point", position = [0, 5, 0], intensity = 2, falloff = "none" },
        ]
        """
    )
    output = run("info", str(tmp_path / "a.toml"))
    for part in ("front", "cone 30 to 40 degrees", "towards [0, -1, 0]", "[7, 7, 7] W sr^-1", "[2, 2, 2] W m^-2"):
        assert part in output
    told = json.loads(run("info", str(tmp_path / "a.toml"), "--json"))
    # The surface of the ellipsoid 1, 2, 3 by the elliptic integrals: 48.8821.
    assert told["shapes"][0]["area"] == pytest.approx(48.8821, rel=0.011)
    assert [each["power"] is None for each in told["lights"]] == [False, True, True, True]


def test_info_shows_the_first_of_thousands_of_shapes():
    output = run("info", "stacked", "-D", "objects=500")
    assert "sphere-39" in output
    assert "sphere-40" not in output
    assert "460 more" in output
    assert len(json.loads(run("info", "stacked", "-D", "objects=500", "--json"))["shapes"]) == 500


def test_info_gives_the_power_of_a_light_to_programs():
    told = json.loads(run("info", "cornell-box", "--json"))
    (light,) = told["lights"]
    assert light["power"] == pytest.approx([np.pi * 130 * 105 * radiance for radiance in (17, 12, 4)])
    assert told["sha256"] == load_scene("cornell-box").digest()
    assert told["triangles"] == sum(each["triangles"] for each in told["shapes"])
    assert told["warnings"] == []


def test_the_scenes_and_the_schema_are_listed(tmp_path: Path):
    listed = run("scenes")
    assert all(name in listed for name in shipped_scenes())
    assert json.loads(run("schema"))["title"] == "glpath scene"
    run("schema", "-o", str(tmp_path / "schema.json"))
    assert json.loads((tmp_path / "schema.json").read_text()) == json.loads(run("schema"))


def test_the_office_with_many_luminaires_has_the_light_of_the_one_with_ten() -> None:
    few, many = load_scene("office"), load_scene("office", parameters={"luminaires": 37})
    ten, lights = ([s for s in scene.shapes if s.name.startswith("light-")] for scene in (few, many))
    assert (len(ten), len(lights)) == (10, 37)
    area = [
        sum(scene.areas[part_of(scene, s.name)].sum() for s in of) for scene, of in ((few, ten), (many, lights))
    ]
    assert area[1] == pytest.approx(area[0], rel=1e-12)
    corners = np.array([triangles(many, s.name).reshape(-1, 3) for s in lights])[..., [0, 2]]
    assert (corners > 0).all(), "below the ceiling"
    assert (corners < (12, 8)).all(), "below the ceiling"
    middles = (corners.min(axis=1) + corners.max(axis=1)) / 2
    apart = np.abs(middles[:, None] - middles) + 1e3 * np.eye(len(middles))[..., None]
    assert (apart > np.ptp(corners[0], axis=0) - 1e-9).any(axis=2).all(), "no two overlap"
