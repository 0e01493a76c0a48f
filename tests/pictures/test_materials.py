"""Metal, plastic, varnish and glass, beside a quadrature of the formulas, Mitsuba, and the other engines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath import GlpathError, load_scene
from glpath.io.load import scene_from_dict
from glpath.scene.material import SMOOTH
from glpath.scene.model import Float64, Material, Scene, Shapes
from tests.support.engines import coarse
from tests.support.uniform_sky import furnace, plane_under_the_sky

GREY = np.full(3, 0.5)


def directional_albedo(
    cosine: float, roughness: float, f0: Float64, base: Float64, metallic: float = 0.0
) -> Float64:
    """(3,): what glTF's surface sends back at this cosine of light from everywhere, by the midpoint rule.

    Written from glTF 2.0, appendix B.2 and B.3: D and G of GGX with independent masking, Schlick's Fresnel.
    """
    n = 1200
    z = (np.arange(n) + 0.5) / n
    phi = 2 * np.pi * (np.arange(n) + 0.5) / n
    wi_z, phi = (each.ravel() for each in np.meshgrid(z, phi, indexing="ij"))
    r = np.sqrt(1 - wi_z**2)
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), wi_z])
    wo = np.array([np.sqrt(1 - cosine**2), 0, cosine])
    h = wi + wo[:, None]
    h /= np.linalg.norm(h, axis=0)
    a2 = roughness**4
    D = a2 / (np.pi * (h[2] ** 2 * (a2 - 1) + 1) ** 2)
    V = 1.0
    for x in (wi_z, cosine):
        V = V / (x + np.sqrt(a2 + (1 - a2) * x * x))
    s = (1 - wo @ h) ** 5
    mean = 2 * np.pi / n**2
    found = []
    for channel in range(3):
        metal = base[channel] + (1 - base[channel]) * s
        F = f0[channel] + (1 - f0[channel]) * s
        under = (1 - (f0.max() + (1 - f0.max()) * s)) * base[channel] / np.pi
        f = metallic * V * D * metal + (1 - metallic) * (V * D * F + under)
        found.append((f * wi_z).sum() * mean * n * n / len(wi_z))
    return np.array(found)


@pytest.mark.parametrize("cosine", [0.95, 0.5, 0.2])
@pytest.mark.parametrize("roughness", [0.4, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 1.0, 0.5])
def test_a_surface_under_a_uniform_sky_sends_back_what_a_quadrature_finds(
    cosine: float, roughness: float, metallic: float
) -> None:
    base = np.array([0.9, 0.5, 0.1])
    material = Material("m", base, roughness=roughness, metallic=metallic, multiple_scattering=False)
    scene = plane_under_the_sky(material, cosine)
    found = glpath.render(scene, spp=256, max_depth=2).mean.mean(axis=(0, 1))
    expected = directional_albedo(cosine, roughness, np.full(3, 0.04), base, metallic)
    assert found == pytest.approx(expected, rel=0.01)


def test_glass_elsewhere_changes_no_opaque_surface() -> None:
    """By Fresnel's equations, in place of Schlick's formula, a ninth more would be reflected over the base."""
    plastic = Material("plastic", GREY, roughness=0.15, thin=False)
    scene = plane_under_the_sky(plastic, 0.5)
    behind = {"type": "quad", "corners": [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]}
    pane = scene_from_dict({"camera": {"position": [0, 0, 4], "target": [0, 0, 0]}, "shapes": [behind]}).shapes[0]
    glass = Material("glass", np.ones(3), roughness=0.0, transmission=1.0)
    both = replace(
        scene, materials=(plastic, glass), shapes=Shapes([*scene.shapes, replace(pane, name="pane", material=1)])
    )
    alone, beside = (glpath.render(each, spp=64, max_depth=2).mean.mean() for each in (scene, both))
    assert beside == pytest.approx(alone, rel=1e-3)


def test_the_last_vertex_of_a_path_has_the_light_that_only_its_mirror_finds() -> None:
    scene = plane_under_the_sky(Material("m", np.ones(3), roughness=0.0, metallic=1.0), 0.7)
    assert glpath.render(scene, spp=1, max_depth=1).mean == pytest.approx(np.ones((16, 16, 3)), abs=2e-3)


@pytest.mark.parametrize("thin", [True, False])
def test_clear_glass_vanishes_in_a_furnace(thin: bool) -> None:
    glass = Material("glass", np.ones(3), roughness=0.0, transmission=1.0, thin=thin)
    found = glpath.render(furnace(glass), spp=16, max_depth=40).mean
    assert found == pytest.approx(np.ones_like(found), abs=5e-3)


def test_glass_takes_from_light_what_its_attenuation_says() -> None:
    """Through the middle: in and out, a way of 2 without refraction; light that is reflected within goes on.

    With T = exp(-2 a) a way through the ball, F reflected at each surface: F + (1-F)^2 T / (1 - F T).
    """
    attenuation = np.array([0.2, 0.7, 1.5])
    glass = Material("glass", np.ones(3), roughness=0.0, transmission=1.0, thin=False, attenuation=attenuation)
    scene = furnace(glass, 8).with_camera(fov=0.5)
    found = glpath.render(scene, spp=2048, max_depth=40).mean.mean(axis=(0, 1))
    F, T = 0.04, np.exp(-2.0 * attenuation)
    assert found == pytest.approx(F + (1 - F) ** 2 * T / (1 - F * T), rel=0.02)


def test_a_varnish_reflects_and_takes_away() -> None:
    """Over black, at normal incidence: 0.04 of all light; over white metal nothing is lost but what masks."""
    black = Material("m", np.zeros(3), roughness=1.0, specular_weight=0.0, clearcoat=1.0, clearcoat_roughness=0.0)
    found = glpath.render(plane_under_the_sky(black, 0.999), spp=64, max_depth=2).mean
    assert found.mean() == pytest.approx(0.04, rel=0.02)
    mirror = Material("m", np.ones(3), roughness=0.0, metallic=1.0, clearcoat=1.0, clearcoat_roughness=0.0)
    found = glpath.render(plane_under_the_sky(mirror, 0.6), spp=64, max_depth=2).mean
    assert found.mean() == pytest.approx(1.0, rel=5e-3)


def with_balls(side: int = 48, subdivisions: int = 4, **material: Any) -> Scene:
    """The Cornell box with two balls of a material, in few pixels."""
    scene = load_scene("cornell-box-36").with_camera(resolution=(side, side))
    for i, centre in enumerate([[0.33, -0.1, 0.35], [-0.33, 0.55, -0.3]]):
        scene = scene.add(
            {"type": "sphere", "center": centre, "radius": 0.3, "subdivisions": subdivisions}, name=f"ball-{i}"
        )
    ball = len(scene.materials)
    shapes = [replace(s, material=ball) if s.name.startswith("ball") else s for s in scene.shapes]
    return replace(scene, materials=(*scene.materials, Material("ball", **material)), shapes=shapes)


BALLS: dict[str, dict[str, Any]] = {
    "mirror": {"reflectance": np.zeros(3), "mirror": np.full(3, 0.9)},
    "half-mirror": {"reflectance": np.full(3, 0.4), "mirror": np.full(3, 0.5)},
    "metal-0.05": {"reflectance": np.array([1.0, 0.8, 0.4]), "roughness": 0.05, "metallic": 1.0},
    "metal-0.3": {"reflectance": np.array([1.0, 0.8, 0.4]), "roughness": 0.3, "metallic": 1.0},
    "metal-0.6": {"reflectance": np.array([1.0, 0.8, 0.4]), "roughness": 0.6, "metallic": 1.0},
    "metal-1": {"reflectance": np.array([1.0, 0.8, 0.4]), "roughness": 1.0, "metallic": 1.0},
    "glass": {"reflectance": np.ones(3), "roughness": 0.0, "transmission": 1.0, "thin": False},
    "frosted": {"reflectance": np.ones(3), "roughness": 0.3, "transmission": 1.0, "thin": False},
}


def blocks(image: Float64, side: int = 8) -> Float64:
    """Means of squares of pixels; bright ones are cut, as a caustic's few paths would decide all."""
    cut = np.minimum(image, 2.0)
    n = len(image) // side
    return cut.reshape(n, side, n, side, 3).mean(axis=(1, 3))


@pytest.mark.evidence
@pytest.mark.parametrize("name", BALLS)
def test_balls_in_the_cornell_box_are_mitsubas(name: str) -> None:
    """The mean within 1 %; of squares of 8 x 8 pixels half within 3 %, and all as far as two of ours differ."""
    mitsuba_peer = pytest.importorskip("benchmarks.peers.mitsuba")
    pytest.importorskip("mitsuba")
    scene, notes = mitsuba_peer.comparable(with_balls(**BALLS[name]))
    assert len(notes) == 1
    ours = [blocks(glpath.render(scene, spp=512, max_depth=8, seed=seed).mean) for seed in (1, 2)]
    theirs = blocks(mitsuba_peer.render_mitsuba(scene, 1024, 8))
    mean = 0.5 * (ours[0] + ours[1])
    assert mean.mean() == pytest.approx(theirs.mean(), rel=0.01)
    off, spread = np.abs(mean - theirs), np.abs(ours[0] - ours[1])
    lit = theirs > 0.02 * theirs.max()
    assert np.median(off[lit] / theirs[lit]) < 0.03
    assert off[lit].mean() < 2.0 * spread[lit].mean() + 0.005 * theirs[lit].mean()


@pytest.mark.parametrize(("name", "off"), [("half-mirror", 0.02), ("metal-0.3", 0.03), ("glass", 0.05)])
def test_a_gather_has_the_light_that_path_tracing_has(name: str, off: float) -> None:
    """But for what the solver, to which all is diffuse, does not know of mirrors and glass."""
    scene = with_balls(24, 2, **BALLS[name])
    path = glpath.render(scene, spp=192, max_depth=10, guide="cosine").mean
    gather = glpath.render(scene, spp=64, integrator="gather", radiosity=coarse(scene)).mean
    assert np.minimum(gather, 2).mean() == pytest.approx(np.minimum(path, 2).mean(), rel=off)


def test_shared_directions_refuse_what_mirrors_sharply() -> None:
    refused = {"mirror": "a mirror", "metal-0.05": "a roughness below 0.2", "glass": "glass"}
    for name, kind in refused.items():
        with pytest.raises(GlpathError, match=rf"(?s){kind} \(ball\).*share their directions.*integrator=.path."):
            glpath.render(with_balls(**BALLS[name]), spp=1, integrator="path-buffer")


def test_rough_metal_is_the_same_with_shared_directions() -> None:
    scene = with_balls(24, 2, **BALLS["metal-0.6"])
    own, shared = (
        glpath.render(scene, spp=128, max_depth=3, integrator=engine).mean  # type: ignore[arg-type]
        for engine in ("path", "path-buffer")
    )
    assert np.minimum(shared, 2).mean() == pytest.approx(np.minimum(own, 2).mean(), rel=0.02)


@pytest.mark.parametrize("anisotropy", [0.5, 1.0])
def test_a_brush_without_roughness_is_one_of_the_least(anisotropy: float) -> None:
    """Its density across has no value, and it was black."""
    pictures = [
        glpath.render(
            plane_under_the_sky(
                Material("m", np.ones(3), roughness=roughness, metallic=1.0, anisotropy=anisotropy), 0.7
            ),
            spp=64,
            max_depth=2,
        ).mean
        for roughness in (0.0, SMOOTH**0.5)
    ]
    assert pictures[0].mean() == pytest.approx(pictures[1].mean(), rel=1e-5)
    assert pictures[0].mean() > 0.3


def test_brushed_metal_shines_across_its_brush() -> None:
    """A highlight is spread along the direction in which the metal is rougher; turned by the angle."""
    lamp = {"type": "sphere", "center": [0, 3, 3], "radius": 0.3, "subdivisions": 2, "emission": {"radiance": 10}}
    spreads = []
    for angle in (0.0, 90.0):
        scene = scene_from_dict(
            {
                "camera": {"position": [0, -3, 3], "target": [0, 0, 0], "fov": 40, "up": [0, 0, 1]},
                "film": {"resolution": [48, 48]},
                "materials": {
                    "m": {
                        "type": "principled",
                        "reflectance": 0.9,
                        "metallic": 1,
                        "roughness": 0.15,
                        "anisotropy": 0.4,
                        "anisotropy_angle": angle,
                    }
                },
                "shapes": [
                    {
                        "type": "mesh",
                        "material": "m",
                        "vertices": [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]],
                        "faces": [[0, 1, 2, 3]],
                        "uv": [[0, 0], [1, 0], [1, 1], [0, 1]],
                    },
                    lamp,
                ],
            }
        )
        seen = glpath.render(scene, spp=128, max_depth=1).mean.mean(axis=2)
        seen[:6] = 0.0  # the lamp itself, should it be seen
        rows, columns = np.indices(seen.shape)
        weight = seen / seen.sum()
        spread = [np.sqrt((weight * (x - (weight * x).sum()) ** 2).sum()) for x in (columns, rows)]
        spreads.append(spread[0] / spread[1])
    assert spreads[0] > 2.0 * spreads[1]


def test_a_brush_agrees_with_a_quadrature() -> None:
    """Of light from everywhere; along the brush and across, which differ."""
    material = Material("m", np.ones(3), roughness=0.4, metallic=1.0, anisotropy=0.6, multiple_scattering=False)
    found = []
    for turn in (0.0, 90.0):
        scene = plane_under_the_sky(replace(material, anisotropy_angle=turn), 0.3)
        mesh = scene.shapes[0].geometry
        assert not isinstance(mesh, str)
        uv = mesh.vertices[:, :2].copy()
        scene = replace(scene, shapes=[replace(scene.shapes[0], geometry=replace(mesh, uv=uv))])
        found.append(glpath.render(scene, spp=256, max_depth=2).mean.mean())
    along, across = 0.16 + 0.84 * 0.36, 0.16
    expected = [brushed_albedo(0.3, *alphas) for alphas in ((along, across), (across, along))]
    assert abs(expected[0] - expected[1]) > 0.02
    assert found == pytest.approx(expected, rel=0.01)


def brushed_albedo(cosine: float, alpha_x: float, alpha_y: float) -> float:
    """What white metal sends back of light from everywhere, seen in the plane of x."""
    n = 1200
    z, phi = np.meshgrid((np.arange(n) + 0.5) / n, 2 * np.pi * (np.arange(n) + 0.5) / n, indexing="ij")
    r = np.sqrt(1 - z**2)
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), z])
    wo = np.array([np.sqrt(1 - cosine**2), 0, cosine])
    h = wi + wo[:, None, None]
    h /= np.linalg.norm(h, axis=0)
    D = 1 / (np.pi * alpha_x * alpha_y * ((h[0] / alpha_x) ** 2 + (h[1] / alpha_y) ** 2 + h[2] ** 2) ** 2)

    def masked(w: Float64) -> Float64:
        return np.asarray(2 / (1 + np.sqrt(1 + ((alpha_x * w[0]) ** 2 + (alpha_y * w[1]) ** 2) / w[2] ** 2)))

    f = D * masked(wi) * masked(wo) / (4 * z * cosine)
    return float((f * z).mean() * 2 * np.pi)


def test_the_ray_tracer_mirrors_metal_and_refuses_glass() -> None:
    metal = {"reflectance": np.full(3, 0.9), "roughness": 0.0, "metallic": 1.0}
    mirror = {"reflectance": np.zeros(3), "mirror": np.full(3, 0.9)}
    of_metal, of_mirror = (
        glpath.render(with_balls(**ball), spp=1, integrator="t-buffer", max_depth=3).mean
        for ball in (metal, mirror)
    )
    assert of_metal.mean() == pytest.approx(of_mirror.mean(), rel=0.01)
    with pytest.raises(GlpathError, match=r'(?s)glass.*ball.*integrator="path"'):
        glpath.render(with_balls(**BALLS["glass"]), spp=1, integrator="t-buffer")


def test_a_scene_file_has_it_all() -> None:
    scene = scene_from_dict(
        {
            "camera": {"position": [0, 0, 4], "target": [0, 0, 0]},
            "materials": {
                "gold": {"type": "principled", "reflectance": [1, 0.8, 0.4], "metallic": 1, "roughness": 0.2},
                "glass": {"type": "principled", "transmission": 1, "attenuation": [1, 0, 0], "ior": 1.33},
                "car": {"type": "principled", "clearcoat": 1.0, "specular": 0.5, "specular_color": [1, 0.5, 0.5]},
            },
            "shapes": [{"type": "sphere", "radius": 1, "material": "gold"}],
        }
    )
    gold, glass, car = scene.materials
    assert (gold.metallic, gold.roughness, glass.ior, glass.thin, car.clearcoat) == (1.0, 0.2, 1.33, False, 1.0)
    f0, f90 = car.dielectric
    assert f0 == pytest.approx([0.02, 0.01, 0.01])
    assert f90 == 0.5


@pytest.mark.parametrize("colour", [0.0, 1.0, 25.0, 100.0])
@pytest.mark.parametrize("weight", [1.0, 0.4])
def test_a_dielectric_reflects_no_more_than_all_however_strong_its_colour(colour: float, weight: float) -> None:
    """KHR_materials_specular: f0 = min(f0 of the index * colour, 1) * weight, f90 = weight."""
    tint = colour * np.array([1.0, 0.5, 2.0])
    material = Material("m", np.full(3, 0.5), roughness=0.4, specular_colour=tint, specular_weight=weight)
    f0, f90 = material.dielectric
    assert f0 == pytest.approx([min(0.04 * c, 1.0) * weight for c in tint])
    assert f0.max() <= f90 == weight
    scene = plane_under_the_sky(material, 0.8)
    assert glpath.render(scene, spp=64, max_depth=2).mean.max() < 1.03  # noise


@pytest.mark.parametrize("thin", [True, False])
def test_frosted_glass_is_lit_from_behind_by_a_light_that_no_direction_finds(thin: bool) -> None:
    """A point light beside a small lamp of the same intensity: of the first, light samples alone know."""
    sheet = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    lamp = [[0.1, 0.1, -4], [0.1, -0.1, -4], [-0.1, -0.1, -4], [-0.1, 0.1, -4]]
    side = {
        "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "fov": 20},
        "film": {"resolution": [16, 16]},
        "materials": {
            "frosted": {"type": "principled", "transmission": 1, "reflectance": 0.9, "roughness": 0.6, "thin": thin}
        },
    }
    glass = {"type": "quad", "corners": sheet, "material": "frosted"}
    intensity = 100.0
    point = scene_from_dict(
        side | {"shapes": [glass], "lights": [{"type": "point", "position": [0, 0, -4], "intensity": intensity}]}
    )
    area = scene_from_dict(
        side
        | {"shapes": [glass, {"type": "quad", "corners": lamp[::-1], "emission": {"radiance": intensity / 0.04}}]}
    )
    by_samples = glpath.render(point, spp=64, max_depth=2).mean
    by_both = glpath.render(area, spp=512, max_depth=2).mean
    assert by_samples.mean() > 0.05
    assert by_both.mean() == pytest.approx(by_samples.mean(), rel=0.02)


TINT = [0.9, 0.6, 0.3]


def behind_panes(
    panes: int, light: dict[str, Any], specular: float = 0.0, tint: Any = TINT, size: float = 4.0
) -> Scene:
    """A floor that is lit through tinted panes by a light above them."""
    level = [[-size, 0, size], [size, 0, size], [size, 0, -size], [-size, 0, -size]]
    shapes: list[dict[str, Any]] = [{"type": "quad", "corners": level, "material": "floor"}]
    for i in range(panes):
        corners = [[x, 1.0 + 0.1 * i, z] for x, _, z in level]
        shapes.append({"type": "quad", "corners": corners, "material": "pane"})
    tables: dict[str, Any] = {}
    if "radiance" in light:
        lamp = [[-0.2, 3, -0.2], [0.2, 3, -0.2], [0.2, 3, 0.2], [-0.2, 3, 0.2]]
        shapes.append({"type": "quad", "corners": lamp, "emission": {"radiance": light["radiance"]}})
    else:
        tables["lights"] = [light]
    return scene_from_dict(
        {
            "camera": {"position": [0, 0.8, 3], "target": [0, 0, 0], "fov": 20},
            "film": {"resolution": [24, 24]},
            "materials": {
                "floor": {"reflectance": 0.5},
                "pane": {
                    "type": "principled",
                    "transmission": 1,
                    "roughness": 0,
                    "thin": True,
                    "specular": specular,
                    "reflectance": tint,
                },
            },
            "shapes": shapes,
            **tables,
        }
    )


@pytest.mark.parametrize("lamp", [True, False])
@pytest.mark.parametrize("x", [0.0, 3.0, 8.0])
def test_a_pane_reflects_more_of_light_that_grazes_it(x: float, lamp: bool) -> None:
    """Of what comes straight through one and two of them 1 - F and its square are left, by Schlick's formula."""
    light: dict[str, Any] = (
        {"radiance": 20.0} if lamp else {"type": "point", "position": [0, 3, 0], "intensity": 9.0}
    )
    cosine = 3 / np.hypot(3, x)
    through = 1 - (0.04 + 0.96 * (1 - cosine) ** 5)
    scenes = [behind_panes(n, light, specular=1.0, tint=1.0, size=20.0) for n in (0, 1, 2)]
    view = {"position": np.array([x, 0.3, 0.0]), "target": np.array([x, 0.0, 0.0]), "up": np.array([0.0, 0.0, 1.0])}
    plain, one, two = (
        glpath.render(scene.with_camera(fov=4.0, **view), spp=128, max_depth=1).mean.mean() for scene in scenes
    )
    assert [one / plain, two / plain] == pytest.approx([through, through**2], rel=2e-3)


@pytest.mark.parametrize(
    "light",
    [
        {"type": "directional", "direction": [0, -1, 0], "irradiance": 1.0},
        {"type": "point", "position": [0, 3, 0], "intensity": 9.0},
        {"radiance": 60.0},
    ],
    ids=["sun", "point", "lamp"],
)
@pytest.mark.parametrize("integrator", ["path", "gather"])
def test_light_goes_straight_through_panes(light: dict[str, Any], integrator: str) -> None:
    """By light samples and by directions, together once: each pane takes its tint, with nothing reflected by it."""

    def seen(panes: int) -> Float64:
        scene = behind_panes(panes, light)
        options: dict[str, Any] = {"max_depth": 1} if integrator == "path" else {"radiosity": coarse(scene)}
        film = glpath.render(scene, spp=256, integrator=integrator, **options)  # type: ignore[arg-type]
        return np.asarray(film.mean.mean(axis=(0, 1)))

    plain, one, two = (seen(panes) for panes in (0, 1, 2))
    tint = np.array(TINT)
    assert one == pytest.approx(plain * tint, rel=0.02)
    assert two == pytest.approx(plain * tint**2, rel=0.02)


def test_a_lamp_is_seen_through_a_pane() -> None:
    scene = behind_panes(1, {"radiance": 1.0}).with_camera(
        position=np.array([0.0, 0.5, 0.0]), target=np.array([0.0, 3.0, 0.0]), up=np.array([0.0, 0.0, 1.0]), fov=1.0
    )
    seen = glpath.render(scene, spp=16, max_depth=2).mean
    assert seen.mean(axis=(0, 1)) == pytest.approx([0.9, 0.6, 0.3], rel=0.02)
