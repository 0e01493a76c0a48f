"""Direct and indirect light apart: beside renders of depth 1, and in sum the picture."""

from __future__ import annotations

import numpy as np
import pytest

import glpath
from glpath.errors import SceneWarning
from glpath.film.film import Film
from glpath.gl.lanes import fragments_of_pixels
from glpath.rendering.factory import solve_for_gather
from tests.support.engines import engine_options, with_depth

#: Every kind of light, textures, masks aside; diffuse, so that every engine has it.
LIGHTS: dict[str, object] = {
    "camera": {"position": [0, 2.2, 4.5], "target": [0, 0.4, 0], "fov": 35},
    "materials": {"floor": {"reflectance": [0.8, 0.3, 0.2]}, "ball": {"reflectance": [0.3, 0.5, 0.8]}},
    "film": {"resolution": [32, 24]},
    "sky": {"zenith": [0.2, 0.3, 0.5], "horizon": 0.5},
    "shapes": [
        {"type": "quad", "corners": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]], "material": "floor"},
        {"type": "box", "min": [0.2, 0, 0], "max": [1.2, 0.9, 0.7], "material": "ball"},
        {"type": "box", "min": [-0.9, 1.2, -0.9], "max": [0.1, 1.3, -0.2], "emission": {"radiance": 3}},
    ],
    "lights": [
        {"type": "point", "position": [1.2, 2.5, 1.5], "intensity": 12},
        {"type": "spot", "position": [-2, 3, 2], "target": [0, 0, 0], "intensity": 30},
        {"type": "directional", "direction": [1, -1, -0.3], "irradiance": [0.8, 0.7, 0.5]},
    ],
}

ENGINES: dict[str, dict[str, object]] = {
    "path": {},
    "pair": {"integrator": "path-buffer"},
    "lattice": {"integrator": "path-buffer", "directions": "lattice"},
    "sphere": {"integrator": "path-buffer", "directions": "sphere"},
    "roulette": {"roulette": 1},
    "guided": {"guide": "solution"},
    "gather": {"integrator": "gather"},
    "gather-pair": {"integrator": "gather", "cast": "path-buffer"},
    "gather-far": {"integrator": "gather", "cast": "path-buffer", "lookup_distance": 0, "direct_light": "solution"},
    "t-buffer": {"integrator": "t-buffer"},
}


def render(scene: object, depth: int = 3, **options: object) -> Film:
    return glpath.render(scene, aovs=("direct", "indirect"), **with_depth(options, depth))


def assert_is_the_picture(film: Film) -> None:
    """Direct and indirect light are the picture, exactly so in the sums, and none is negative."""
    direct = film.aov_sums["direct"]
    indirect = film.radiance_sums.sum(axis=0) - direct
    assert np.array_equal(direct + indirect, film.radiance_sums.sum(axis=0))
    assert direct.min() >= 0
    assert indirect.min() >= 0
    assert np.allclose(film.aov("direct") + film.aov("indirect"), film.mean, rtol=1e-15, atol=0)


@pytest.fixture(scope="module")
def depth_1() -> Film:
    """Direct light by light samples alone."""
    return glpath.render(LIGHTS, max_depth=1, spp=512)


@pytest.fixture(scope="module")
def solution() -> glpath.RadiositySolution:
    """Of gathers: as each would make it, once."""
    return solve_for_gather(glpath.load_scene(LIGHTS))


@pytest.mark.parametrize("options", ENGINES.values(), ids=ENGINES)
def test_direct_light_is_a_render_of_depth_1(
    options: dict[str, object], depth_1: Film, solution: glpath.RadiositySolution
) -> None:
    spp = 128 if options.get("integrator") == "t-buffer" else 512
    solved = {"radiosity": solution} if "gather" in options.values() else {}
    film = render(LIGHTS, spp=spp, **options, **solved)
    assert_is_the_picture(film)
    direct = film.aov("direct")
    assert direct.mean(axis=(0, 1)) == pytest.approx(depth_1.mean.mean(axis=(0, 1)), rel=0.01)
    # Pixel by pixel, but for noise.
    assert np.median(np.abs(direct - depth_1.mean) / depth_1.mean) < 0.06
    indirect = film.aov("indirect")
    if options.get("integrator") == "t-buffer":
        assert indirect.max() == 0  # no mirrors, no ambient light
    else:
        assert indirect.mean() == pytest.approx(0.0187, rel=0.04)  # in all of them


@pytest.mark.parametrize(
    "options", [{}, {"integrator": "path-buffer"}, {"integrator": "path-buffer", "directions": "sphere"}], ids=str
)
def test_of_depth_1_all_light_is_direct(options: dict[str, object]) -> None:
    film = render(LIGHTS, 1, spp=8, **options)
    assert np.array_equal(film.aov_sums["direct"], film.radiance_sums.sum(axis=0))


#: A mirror and a pane of glass before a grey wall and a lamp.
GLASS: dict[str, object] = {
    "camera": {"position": [0, 1, 5], "target": [0, 1, 0], "fov": 40},
    "film": {"resolution": [32, 24]},
    "materials": {
        "wall": {"reflectance": 0.5},
        "mirror": {"type": "phong", "reflectance": 0, "mirror": 0.8},
        "pane": {"type": "principled", "reflectance": 1, "roughness": 0, "transmission": 1, "thin": True},
    },
    "shapes": [
        {"type": "quad", "corners": [[-3, -1, -1], [3, -1, -1], [3, 3, -1], [-3, 3, -1]], "material": "wall"},
        {"type": "quad", "corners": [[5, -3, 7], [-5, -3, 7], [-5, 5, 7], [5, 5, 7]], "material": "wall"},
        {"type": "quad", "corners": [[-2, 0, 0.5], [-0.2, 0, 0], [-0.2, 2, 0], [-2, 2, 0.5]], "material": "mirror"},
        {"type": "quad", "corners": [[0.2, 0, 0], [2, 0, 0], [2, 2, 0], [0.2, 2, 0]], "material": "pane"},
        {"type": "box", "min": [-0.4, 2.3, 1.8], "max": [0.4, 2.4, 2.6], "emission": {"radiance": 10}},
    ],
}


def test_through_a_pane_and_by_a_mirror_direct_light_is_as_of_depth_1() -> None:
    """A pane is no surface on the way; what a mirror shows of a lamp is direct, of a wall it is not."""
    film, first = render(GLASS, 4, spp=256), glpath.render(GLASS, max_depth=1, spp=256)
    assert_is_the_picture(film)
    direct = film.aov("direct")
    difference = np.abs(direct - first.mean).mean(axis=2)
    assert np.median(difference) < 0.002 * first.mean.mean()  # but in the lamp's image in the mirror
    behind_pane, in_mirror, beside = np.s_[10:14, 20:24], np.s_[10:14, 8:12], np.s_[2:4, 8:12]
    assert direct[behind_pane].mean() > 0.3 * direct[beside].mean()
    assert film.aov("indirect")[in_mirror].mean() > 0.8 * film.mean[in_mirror].mean() > 0


@pytest.mark.parametrize("options", [{}, {"integrator": "path-buffer"}, {"integrator": "t-buffer"}], ids=str)
def test_ambient_light_is_indirect(options: dict[str, object]) -> None:
    scene = {**LIGHTS, "ambient": 0.3}
    scene = {**scene, "sky": {"zenith": 0, "horizon": 0}}
    film = render(scene, 1, spp=64, **options)
    assert_is_the_picture(film)
    dark = glpath.render({**scene, "ambient": 0}, max_depth=1, spp=64, **options)
    assert film.aov("direct").mean() == pytest.approx(dark.mean.mean(), rel=0.01)
    reflectances = film.aov("indirect").max(axis=(0, 1)) / 0.3
    assert reflectances == pytest.approx([0.8, 0.5, 0.8], abs=1e-5)


@pytest.mark.parametrize("engine", ["path", "pair"])
def test_samples_that_are_dropped_do_not_count(engine: str, spoil) -> None:
    """An engine that now and then finds what is no number: the AOV says where, and no light is kept of it."""
    spoil(
        "film/accumulate.glsl",
        "    vec3 scaled = floor(radiance.rgb * quanta + 0.5);",
        "    if (pixel == ivec2(5, 3)) radiance.r = uintBitsToFloat(0x7fc00000u);\n"
        "    vec3 scaled = floor(radiance.rgb * quanta + 0.5);",
    )
    with pytest.warns(SceneWarning, match="samples were NaN or infinite"):
        film = glpath.render(LIGHTS, max_depth=2, spp=6, aovs="all", **engine_options(engine))
    spoilt = np.zeros(film.mean.shape[:2], bool)
    if engine == "path":  # whose sums are in the order of its lanes
        spoilt = fragments_of_pixels((32, 24))[::-1] == 3 * 32 + 5
    else:
        spoilt[24 - 1 - 3, 5] = True
    assert spoilt.sum() == 1
    assert np.array_equal(film.aov("samples"), np.where(spoilt, 0, 6))
    assert film.metadata.statistics["dropped_samples"] >= 6
    for name in ("direct", "indirect"):
        assert np.all(film.aov(name)[spoilt] == 0)
        assert np.isfinite(film.aov(name)).all()
