"""Watts and lumens: a lamp of 1000 cd, 2 m above a floor, makes 250 lx there, whatever file it comes from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner

import glpath
from glpath.cli.main import app
from glpath.errors import SceneError, UsageError
from glpath.scene.appearance import Appearance
from glpath.scene.triangulate import path_traceable
from glpath.system.units import EFFICACY
from tests.support.gltf_files import Gltf
from tests.support.photometry import ies

FLOOR = {"type": "quad", "corners": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]], "material": "black"}
LAMP = {"type": "point", "position": [0, 2, 0]}
#: Of the luminance.
REC709 = np.array([0.2126, 0.7152, 0.0722])
AMBER = np.array([1.0, 0.6, 0.1])


def scene(*lights: dict[str, Any], **fields: Any) -> dict[str, Any]:
    return {
        "camera": {"position": [0, 1, 6], "target": [0, 0, 0]},
        "materials": {"black": {"reflectance": 0}},
        "shapes": [FLOOR],
        "lights": list(lights),
        **fields,
    }


def lux(scene: Any, at: tuple[float, float, float] = (0, 0, 0), **options: Any) -> float:
    (found,) = glpath.irradiance(scene, [at], [0, 1, 0], **{"spp": 16, "max_depth": 1} | options).illuminance()
    return float(found)


@pytest.fixture
def profile(tmp_path: Path) -> str:
    """A file of a lamp of 1000 cd in all directions."""
    gamma = np.array([0.0, 90.0, 180.0])
    return str(ies(tmp_path / "lamp.ies", gamma, np.zeros(1), np.full((1, 3), 1000.0)))


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A glTF file of a black floor, a lamp of 1000 cd 2 m above, and a panel of 500 cd m^-2 and 1 m2 above
    (9, 0, 0)."""
    return gltf().write(tmp_path)


def gltf() -> Gltf:
    file = Gltf()
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 1000}]}}
    black = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "doubleSided": True}
    black |= of("specular", specularFactor=0)
    floor = file.add("materials", **black)
    panel = file.add("materials", **black, emissiveFactor=[1, 1, 1])
    file.json["materials"][panel]["extensions"] = (
        black["extensions"] | of("emissive_strength", emissiveStrength=500)["extensions"]
    )
    corners = np.array([[-1.0, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]])
    file.node(mesh=file.mesh(20 * corners, [0, 1, 2, 0, 2, 3], material=floor))
    file.node(mesh=file.mesh(corners[::-1] / 2, [0, 1, 2, 0, 2, 3], material=panel), translation=[9, 2, 0])
    camera = file.add("cameras", type="perspective", perspective={"yfov": 1.0, "znear": 0.1})
    file.node(camera=camera, translation=[0, 1, 15])
    file.node(translation=[0, 2, 0], extensions={"KHR_lights_punctual": {"light": 0}})
    return file


def of(name: str, **fields: Any) -> dict[str, Any]:
    return {"extensions": {f"KHR_materials_{name}": fields}}


def below_a_panel(half: float, height: float) -> float:
    """The integral of the cosine over the solid angle of a square, seen from below its middle."""
    x = half / height
    root = np.sqrt(1 + x * x)
    return float(4 * x / root * np.arctan(x / root))


#: Of the glTF file: below the lamp, the panel far away; below the panel, with the lamp.
UNDER_LAMP = 250.0 + 500 * 2 * 2 / (81 + 4) ** 2  # of a panel 9 m away, within 1 % of what is 1.2e-3 of all
UNDER_PANEL = 500 * below_a_panel(0.5, 2.0) + 1000 * 2 / (81 + 4) ** 1.5


def test_a_lamp_of_a_thousand_candela_makes_250_lux_two_metres_below(profile: str) -> None:
    """From IES and from TOML, whatever the unit of the scene; all of them together make the sum."""
    down = {"direction": [0, -1, 0]}
    lamps = [
        LAMP | {"profile": profile} | down,
        LAMP | {"intensity": 1000, "unit": "photometric"},
        LAMP | {"intensity": 1000 / 179, "unit": "radiometric"},
        {"type": "directional", "irradiance": 250, "unit": "photometric"} | down,
        {"type": "spot", "position": [0, 2, 0], "target": [0, 0, 0], "intensity": 1000, "unit": "photometric"},
    ]
    for unit in ("radiometric", "photometric"):
        for lamp in lamps:
            assert lux(scene(lamp, unit=unit)) == pytest.approx(250, rel=1e-5)
        assert lux(scene(*lamps, unit=unit)) == pytest.approx(5 * 250, rel=1e-5)
    # By default a file is in watts.
    assert lux(scene(LAMP | {"intensity": 1000 / 179})) == pytest.approx(250, rel=1e-5)
    assert lux(scene(LAMP | {"profile": profile, "intensity": 0.5} | down)) == pytest.approx(125, rel=1e-5)


def test_lux_are_the_luminance_of_colours(profile: str) -> None:
    lamp = LAMP | {"profile": profile, "intensity": AMBER.tolist()}
    for unit in ("radiometric", "photometric"):
        assert lux(scene(lamp, unit=unit)) == pytest.approx(250 * float(AMBER @ REC709), rel=1e-5)


@pytest.mark.parametrize("unit", ["radiometric", "photometric"])
def test_a_gltf_file_is_in_candela_alone_and_as_an_asset(model: Path, unit: str) -> None:
    options = {"spp": 256}
    asset = scene(shapes=[], materials={}, unit=unit, assets=[{"file": str(model)}])
    for each in (model, asset):
        assert lux(each, **options) == pytest.approx(UNDER_LAMP, rel=2e-3)
        assert lux(each, (9, 0, 0), **options) == pytest.approx(UNDER_PANEL, rel=0.01)
    # Beside an equal lamp of the scene's own.
    lamp = LAMP | {"intensity": 1000, "unit": "photometric"}
    assert lux(asset | {"lights": [lamp]}, **options) == pytest.approx(UNDER_LAMP + 250, rel=2e-3)


def test_a_gltf_file_in_watts_is_read_as_that(model: Path) -> None:
    read = glpath.load_scene(model, {"unit": "radiometric"})
    assert lux(read, spp=256) == pytest.approx(179 * UNDER_LAMP, rel=2e-3)
    asset = scene(shapes=[], materials={}, assets=[{"file": str(model), "unit": "radiometric"}])
    assert lux(asset, spp=256) == pytest.approx(179 * UNDER_LAMP, rel=2e-3)


def test_an_unlit_material_of_an_asset_keeps_its_colour(tmp_path: Path) -> None:
    """It is no light that could be measured: what is white on the screen stays white."""
    path = Gltf().one_triangle(doubleSided=True, **of("unlit")).write(tmp_path)
    loaded = glpath.load_scene(scene(assets=[{"file": str(path)}]))
    assert loaded.shapes[-1].emission.tolist() == [1, 1, 1]


@pytest.mark.parametrize("unit", ["radiometric", "photometric"])
def test_panels_and_skies_have_units(unit: str) -> None:
    expected = 500 * below_a_panel(0.5, 2.0)
    corners = [[-0.5, 2, -0.5], [0.5, 2, -0.5], [0.5, 2, 0.5], [-0.5, 2, 0.5]]
    panel = {"type": "quad", "corners": corners, "material": "black"}
    for emission in ({"radiance": 500, "unit": "photometric"}, {"radiance": 500 / 179, "unit": "radiometric"}):
        there = scene(unit=unit, shapes=[FLOOR, panel | {"emission": emission}])
        assert lux(there, spp=256) == pytest.approx(expected, rel=0.01)
        dark = glpath.load_scene(scene(unit=unit, ambient=1))
        bare = {key: value for key, value in panel.items() if key != "material"}
        added = dark.add(bare | {"emission": emission}, material={"reflectance": 0})
        assert lux(replace(added, ambient=np.zeros(3)), spp=256) == pytest.approx(expected, rel=0.01)
    for sky in ({"zenith": 100, "unit": "photometric"}, {"zenith": 100 / 179, "unit": "radiometric"}):
        assert lux(scene(unit=unit, sky=sky), spp=256) == pytest.approx(100 * np.pi, rel=1e-3)


def test_a_trimesh_scene_is_in_candela() -> None:
    """Its lights and materials are those of glTF."""
    trimesh = pytest.importorskip("trimesh")
    floor = trimesh.Trimesh([[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]], [[0, 1, 2], [0, 2, 3]])
    lamp = trimesh.scene.lighting.PointLight(intensity=1000, color=[255, 255, 255, 255])
    made = trimesh.Scene(floor, lights=[lamp])
    made.graph.update(lamp.name, matrix=trimesh.transformations.translation_matrix([0, 2, 0]))
    assert lux(made) == pytest.approx(250, rel=1e-5)


def test_a_scene_that_is_exported_and_read_again_has_the_same_lux(profile: str, tmp_path: Path) -> None:
    panel = {
        "type": "quad",
        "corners": [[8.5, 2, -0.5], [9.5, 2, -0.5], [9.5, 2, 0.5], [8.5, 2, 0.5]],
        "material": "black",
        "emission": {"radiance": 500 / 179, "two_sided": True},
    }
    floor = {**FLOOR, "corners": (5 * np.array(FLOOR["corners"])).tolist()}
    lamps = (LAMP | {"intensity": (AMBER / 179).tolist()}, LAMP | {"profile": profile})
    there = glpath.load_scene(scene(*lamps, shapes=[floor, panel]))
    with pytest.warns(glpath.SceneWarning, match="profile is left out"):  # of a lamp that is even all around
        glpath.export(there, tmp_path / "a.glb")
    again = glpath.load_scene(tmp_path / "a.glb")
    assert (there.unit, again.unit) == ("radiometric", "photometric")
    assert {round(float(light.intensity.max()), 3) for light in again.lights} == {1.0, 1000.0}
    for at in ((0, 0, 0), (9, 0, 0)):
        assert lux(again, at, spp=256) == pytest.approx(lux(there, at, spp=256), rel=2e-3)
    # What is in candela already leaves as it is.
    glpath.export(again, tmp_path / "b.glb")
    twice = glpath.load_scene(tmp_path / "b.glb")
    for was, found in zip(again.lights, twice.lights, strict=True):
        np.testing.assert_allclose(found.intensity, was.intensity, rtol=1e-6)
    assert twice.shapes[1].emission.max() == pytest.approx(500, rel=1e-6)


def test_every_engine_and_solver_has_the_same_unit(profile: str) -> None:
    """A picture of a grey floor of a radiometric scene is that of the photometric one, divided by 179."""
    grey = {"materials": {"black": {"reflectance": 0.5}}, "film": {"resolution": [16, 16]}}
    mixed = (LAMP | {"profile": profile}, LAMP | {"intensity": 200, "unit": "photometric"})
    watts, lumens = (glpath.load_scene(scene(*mixed, unit=u, **grey)) for u in ("radiometric", "photometric"))
    for options in ({"max_depth": 2}, {"integrator": "gather"}, {"integrator": "t-buffer"}):
        found, other = (glpath.render(each, spp=4, seed=1, **options) for each in (watts, lumens))
        np.testing.assert_allclose(EFFICACY * found.mean, other.mean, rtol=1e-4)
        assert (found.metadata.unit, other.metadata.unit) == ("radiometric", "photometric")
        assert other.metadata.as_strings()["glpath.unit"] == "photometric"
        with pytest.raises(UsageError, match=r"unit is photometric in one film and radiometric in the other|scene"):
            found.merge(other)


def test_a_film_of_before_units_goes_on_in_that_of_its_scene(model: Path, tmp_path: Path) -> None:
    first = glpath.irradiance(model, [[0, 0, 0]], [0, 1, 0], spp=16, max_depth=1)
    old = replace(first.film, metadata=replace(first.film.metadata, unit=""))
    for spp in (16, 32):
        found = glpath.irradiance(model, [[0, 0, 0]], [0, 1, 0], spp=spp, max_depth=1, film=old)
        assert found.unit == "photometric"
        assert found.illuminance()[0] == pytest.approx(UNDER_LAMP, rel=5e-3)


def test_what_is_measured_names_its_unit(model: Path, tmp_path: Path) -> None:
    watts = tmp_path / "watts.toml"
    watts.write_text(
        "camera = { position = [0, 1, 6], target = [0, 0, 0] }\n"
        'shapes = [{ type = "quad", corners = [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]] }]\n'
        f'lights = [{{ type = "point", position = [0, 2, 0], intensity = {1000 / 179!r} }}]\n'
    )
    points = tmp_path / "points.csv"
    points.write_text("x,y,z,nx,ny,nz\n0,0,0,0,1,0\n")
    for each, unit, said in ((watts, "W/m2", True), (model, "lx", False)):
        asked = ["measure", str(each), "--points", str(points), "--spp", "16", "--max-depth", "1", "-o", "-"]
        result = CliRunner().invoke(app, asked)
        assert result.exit_code == 0, result.stderr
        titles, row = result.stdout.splitlines()
        cells = dict(zip(titles.split(","), map(float, row.split(",")), strict=True))
        assert cells["E [lx]"] == pytest.approx(250, rel=5e-3)
        assert cells[f"E_g [{unit}]"] == pytest.approx(250 if unit == "lx" else 250 / 179, rel=5e-3)
        assert ("179 lm/W" in result.stderr) == said


def test_info_says_what_the_light_is_in(model: Path) -> None:
    told = CliRunner().invoke(app, ["info", str(model)]).stdout
    assert "photometric: cd m^-2, cd, lx" in told
    assert "1000, 1000, 1000] cd" in " ".join(told.split())
    assert "power (lm for metres)" in told
    assert "radiometric: W sr^-1 m^-2, W sr^-1, W m^-2" in CliRunner().invoke(app, ["info", "cornell-box"]).stdout


def test_units_that_are_none_are_refused(profile: str) -> None:
    with pytest.raises(SceneError, match=r"(?s)unit.*\"lumens\", but must be one of: .*photometric"):
        glpath.load_scene(scene(LAMP | {"intensity": 1}, unit="lumens"))
    with pytest.raises(SceneError, match=r"(?s)lights.*unit.*candela of a profile are photometric"):
        glpath.load_scene(scene(LAMP | {"profile": profile, "unit": "radiometric"}))


def test_lights_are_given_by_their_flux(profile: str) -> None:
    """In lumens, by closed forms: a point, a profile, a spot with an edge, a panel, a ball."""
    lm = {"unit": "photometric"}
    point = LAMP | {"flux": 4000 * np.pi}
    assert lux(scene(point | lm)) == pytest.approx(250, rel=1e-5)
    assert lux(scene(point)) == pytest.approx(179 * 250, rel=1e-5)  # in watts
    form = LAMP | {"profile": profile, "direction": [0, -1, 0], "flux": 4000 * np.pi}
    assert lux(scene(form)) == pytest.approx(250, rel=1e-3)  # of what is linear between 0, 90 and 180 degrees
    # Within the cone of full light, 1000 lm spread over the solid angle, of which the squared edge counts a third.
    spot = {"type": "spot", "position": [0, 2, 0], "target": [0, 0, 0], "cone": [20, 40], "flux": 1000}
    full, end = np.cos(np.radians([20, 40]))
    angle = 2 * np.pi * (1 - (2 * full + end) / 3)
    assert lux(scene(spot | lm)) == pytest.approx(1000 / angle / 4, rel=1e-5)
    corners = [[-0.5, 2, -0.5], [0.5, 2, -0.5], [0.5, 2, 0.5], [-0.5, 2, 0.5]]
    panel = {"type": "quad", "corners": corners, "material": "black", "emission": {"flux": 500 * np.pi} | lm}
    assert lux(scene(shapes=[FLOOR, panel]), spp=256) == pytest.approx(500 * below_a_panel(0.5, 2.0), rel=0.01)
    both = panel | {"emission": {"flux": 500 * np.pi, "two_sided": True} | lm}
    assert glpath.load_scene(scene(shapes=[FLOOR, both])).shapes[1].emission.max() == pytest.approx(250 / 179)
    ball = {
        "type": "sphere",
        "radius": 0.25,
        "center": [0, 2, 0],
        "material": "black",
        "emission": {"flux": 100} | lm,
    }
    # As from its middle: flux / (4 pi d^2).
    assert lux(scene(shapes=[FLOOR, ball]), spp=1024) == pytest.approx(100 / (16 * np.pi), rel=0.01)


def test_the_flux_of_an_ellipsoid_is_by_its_exact_surface() -> None:
    """A prolate spheroid of axes 1, 1, 2: 2 pi (1 + 2 / e asin e), e its eccentricity."""
    e = np.sqrt(3) / 2
    shape = {"type": "sphere", "radius": 1, "transform": [{"scale": [1, 1, 2]}], "emission": {"flux": 1}}
    loaded = glpath.load_scene(scene(shapes=[FLOOR, shape | {"material": "black"}]))
    assert 1 / (np.pi * loaded.shapes[1].emission[0]) == pytest.approx(
        2 * np.pi * (1 + 2 / e * np.arcsin(e)), rel=1e-6
    )


@pytest.mark.parametrize("scale", [[1, 1, 1], [1, 1, 2], [-1, 3, 1]])
@pytest.mark.parametrize("subdivisions", [0, 1, 4])
def test_triangles_of_a_sphere_have_its_flux_or_its_radiance(subdivisions: int, scale: list[float]) -> None:
    """One side of the area A with the radiance L sends pi A L."""
    ball = {"type": "sphere", "radius": 0.5, "subdivisions": subdivisions, "transform": [{"scale": scale}]}
    lamps = [{**ball, "emission": {"flux": 1000}}, {**ball, "emission": {"radiance": 7}}]
    traced = path_traceable(glpath.load_scene(scene(shapes=lamps)))
    flux = np.pi * traced.areas[traced.triangle_shape == 0].sum() * traced.shapes[0].emission
    np.testing.assert_allclose(flux, 1000, rtol=1e-6)
    assert traced.shapes[1].emission.tolist() == [7, 7, 7]


@pytest.mark.parametrize(
    ("fields", "opacity"),
    [
        ({"alpha": "blend", "opacity": 0.5}, 0.5),
        ({"alpha": "mask", "opacity": 0.5}, 1.0),
        ({"alpha": "opaque", "opacity": 0.5}, 1.0),
        ({"alpha": "blend", "opacity": 0.5, "texture": "tiles"}, 0.5),
    ],
)
def test_the_flux_of_a_lamp_is_what_its_opacity_lets_it_emit(fields: dict[str, Any], opacity: float) -> None:
    """A square of area 1 sends pi times its radiance, times its opacity."""
    corners = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
    panel = {"type": "quad", "corners": corners, "material": "lamp", "emission": {"flux": 100}}
    tables = {"materials": {"lamp": fields}, "textures": {"tiles": {"type": "checker"}}}
    loaded = glpath.load_scene(scene(shapes=[panel], **tables))
    emitted = Appearance(loaded).emission(np.zeros(1, np.int64), np.full((1, 3), 1 / 3))
    np.testing.assert_allclose(np.pi * emitted, 100)
    np.testing.assert_allclose(np.pi * opacity * loaded.shapes[0].emission, 100)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"alpha": "mask", "opacity": 0.4}, "opacity is 0"),
        ({"alpha": "blend", "opacity": 0.0}, "opacity is 0"),
        ({"alpha": "blend", "texture": "leaf"}, 'alpha = "blend", whose opacity varies'),
        ({"alpha": "mask", "texture": "leaf"}, 'alpha = "mask", whose opacity varies'),
    ],
)
def test_the_flux_of_a_lamp_with_holes_is_refused(fields: dict[str, Any], words: str, tmp_path: Path) -> None:
    iio.imwrite(tmp_path / "leaf.png", np.array([[[9, 9, 9, 255], [9, 9, 9, 0]]], np.uint8))
    leaf = {"type": "image", "file": str(tmp_path / "leaf.png")}
    ball = {"type": "sphere", "radius": 1, "material": "lamp", "emission": {"flux": 100}}
    with pytest.raises(SceneError, match=rf"emission\W+flux.* {words}"):
        glpath.load_scene(scene(shapes=[ball], materials={"lamp": fields}, textures={"leaf": leaf}))


@pytest.mark.parametrize("amount", ["flux", "radiance"])
def test_a_lamp_without_a_back_cannot_emit_from_it(amount: str) -> None:
    ball = {"type": "sphere", "radius": 1, "material": "lamp", "emission": {amount: 100, "two_sided": True}}
    with pytest.raises(SceneError, match=r"emission\W+two_sided.* has no back"):
        glpath.load_scene(scene(shapes=[ball], materials={"lamp": {"two_sided": False, "culled": True}}))


def test_the_flux_of_a_lamp_whose_mask_is_closed_everywhere_is_accepted(tmp_path: Path) -> None:
    """Each alpha is above the cutoff, 0.5. A sphere of radius 1 has the area 4 pi."""
    iio.imwrite(tmp_path / "leaf.png", np.array([[[9, 9, 9, 255], [9, 9, 9, 160]]], np.uint8))
    leaf = {"type": "image", "file": str(tmp_path / "leaf.png")}
    ball = {"type": "sphere", "radius": 1, "material": "lamp", "emission": {"flux": 100}}
    lamp = {"alpha": "mask", "texture": "leaf"}
    loaded = glpath.load_scene(scene(shapes=[ball], materials={"lamp": lamp}, textures={"leaf": leaf}))
    np.testing.assert_allclose(4 * np.pi**2 * loaded.shapes[0].emission, 100)


@pytest.mark.parametrize(
    ("light", "words"),
    [
        (LAMP, "lacks the field `intensity`.*or `flux`"),
        (LAMP | {"intensity": 1, "flux": 1}, "has intensity and flux"),
        (LAMP | {"flux": 1, "falloff": "none"}, "falloff is .none., which has no flux"),
        (LAMP | {"flux": -1}, "0 or more"),
    ],
)
def test_a_flux_that_is_none_is_refused(light: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=rf"(?s)lights.*{words}"):
        glpath.load_scene(scene(light))
    for emission in ({}, {"flux": 1, "radiance": 1}):
        with pytest.raises(SceneError, match="an emission is one of `radiance` and `flux`"):
            glpath.load_scene(scene(shapes=[FLOOR | {"emission": emission}]))
