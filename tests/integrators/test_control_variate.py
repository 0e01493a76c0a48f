"""A radiosity solution as a control variate of paths: no bias, whatever it is worth, and less noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from benchmarks.scenes.daylit_office import office, sensors
from glpath.gl.context import get_context
from glpath.gl.passes import run_in_areas
from glpath.integrators.settings import DEEPEST
from glpath.io import load_scene
from glpath.lights import rectangles
from glpath.lights.lighting import Lighting
from glpath.lights.rectangles import LampRectangles
from glpath.radiosity import RadiositySolution
from glpath.rendering import factory
from glpath.scene import path_traceable

PLAIN: dict[str, Any] = {"integrator": "path", "max_depth": DEEPEST, "roulette": 4}
CORRECTED = {**PLAIN, "guide": "solution"}

#: A room with a mirror, glossy and glass things, a lamp, and a window to the sky.
ROOM: dict[str, Any] = {
    "camera": {"position": [0, 1, 2.8], "target": [0, 0.9, 0], "fov": 60},
    "materials": {
        "white": {"reflectance": [0.8, 0.75, 0.7]},
        "mirror": {"type": "principled", "reflectance": [0.9, 0.9, 0.9], "metallic": 1.0, "roughness": 0.0},
        "plastic": {"type": "principled", "reflectance": [0.7, 0.2, 0.1], "roughness": 0.3},
        "glass": {"type": "principled", "reflectance": [1, 1, 1], "roughness": 0.0, "transmission": 1.0},
    },
    "sky": {"zenith": 2.0, "horizon": 2.0},
    "shapes": [
        {"type": "quad", "corners": [[-2, 0, 3], [2, 0, 3], [2, 0, -2], [-2, 0, -2]], "material": "white"},
        {"type": "quad", "corners": [[-2, 0, -2], [2, 0, -2], [2, 2, -2], [-2, 2, -2]], "material": "white"},
        {"type": "quad", "corners": [[-2, 0, 3], [-2, 0, -2], [-2, 2, -2], [-2, 2, 3]], "material": "white"},
        {"type": "quad", "corners": [[2, 0, -2], [2, 0, 3], [2, 2, 3], [2, 2, -2]], "material": "white"},
        {"type": "quad", "corners": [[-2, 2, -2], [2, 2, -2], [2, 2, 1], [-2, 2, 1]], "material": "white"},
        {"type": "sphere", "center": [-0.8, 0.5, -0.6], "radius": 0.5, "subdivisions": 2, "material": "mirror"},
        {"type": "sphere", "center": [0.9, 0.4, -0.4], "radius": 0.4, "subdivisions": 2, "material": "plastic"},
        {"type": "sphere", "center": [0.2, 0.3, 0.6], "radius": 0.3, "subdivisions": 2, "material": "glass"},
        {
            "type": "quad",
            "corners": [[-0.4, 1.95, -0.8], [0.4, 1.95, -0.8], [0.4, 1.95, -0.2], [-0.4, 1.95, -0.2]],
            "material": "white",
            "emission": {"radiance": [12, 11, 9]},
        },
    ],
}


@pytest.fixture(autouse=True)
def _solved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seeds of a picture share their solution."""
    solve, solutions = factory.solve_for_gather, {}

    def solved(scene: Any, *given: Any) -> RadiositySolution:
        key = scene.digest(), scene.camera.resolution
        if key not in solutions:
            solutions[key] = solve(scene, *given)
        return solutions[key]

    monkeypatch.setattr(factory, "solve_for_gather", solved)


def means(scene: Any, options: dict[str, Any], seeds: int, spp: int, side: int) -> NDArray[np.float64]:
    """(seeds, 4, 4, 3): of blocks of the picture."""
    films = [glpath.render(scene, resolution=(side, side), spp=spp, seed=seed, **options) for seed in range(seeds)]
    assert all(film.metadata.statistics["dropped_samples"] == 0 for film in films)
    block = side // 4
    return np.array([film.mean.reshape(4, block, 4, block, 3).mean(axis=(1, 3)) for film in films])


def assert_the_same(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> None:
    """Means of blocks within their errors, by eight seeds each."""
    errors = np.sqrt(sum(each.var(axis=0, ddof=1) / len(each) for each in (ours, theirs)))
    z = (ours.mean(axis=0) - theirs.mean(axis=0)) / errors
    assert np.sqrt(np.mean(z**2)) < 1.5
    whole = [each.mean(axis=(1, 2, 3)) for each in (ours, theirs)]
    error = np.sqrt(sum(each.var(ddof=1) / len(each) for each in whole))
    assert abs(whole[0].mean() - whole[1].mean()) < 4 * error


@pytest.mark.parametrize("scene", ["cornell-box-36", ROOM], ids=["box", "room"])
def test_there_is_no_bias(scene: Any) -> None:
    assert_the_same(means(scene, CORRECTED, 8, 64, 32), means(scene, PLAIN, 8, 128, 32))


def test_there_is_none_behind_window_glass() -> None:
    """Light through a pane weighs as light that comes straight; plain paths of depth 64 say how much it is."""
    room = {**office(), "unit": "radiometric", "sky": {"zenith": 1.0, "horizon": 1.0}}
    points = sensors()[::7]
    found = [
        glpath.irradiance(room, points, [0.0, 0.0, 1.0], spp=spp, max_depth=depth)
        for depth, spp in ((None, 1024), (64, 2048))
    ]
    means, errors = ([getattr(each, name)[:, 1] for each in found] for name in ("values", "standard_errors"))
    off = means[0].sum() - means[1].sum()
    assert abs(off) < 4 * np.hypot(*(np.linalg.norm(each) for each in errors))
    assert abs(off) < 0.025 * means[1].sum(), "five percent too much, once"


@pytest.mark.parametrize("options", [PLAIN, CORRECTED], ids=["paths", "with a solution"])
def test_there_is_none_by_portals_and_lamps_in_solid_angle(
    options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With mirrors and glass, by which directions reach both."""
    roof = [[-2, 2, 1], [2, 2, 1], [2, 2, 3], [-2, 2, 3]]
    front = [[2, 0, 3], [-2, 0, 3], [-2, 2, 3], [2, 2, 3]]
    scene = {**ROOM, "sky": {**ROOM["sky"], "portals": [{"corners": each} for each in (roof, front)]}}
    by_area = means(ROOM, PLAIN, 8, 128, 32)
    for name in ("_MIN_SOLID_ANGLE", "_MIN_SHARE"):
        monkeypatch.setattr(rectangles, name, 0.0)
    assert len(LampRectangles.that_pay(Lighting.of(path_traceable(load_scene(scene))))) == 1
    assert_the_same(means(scene, options, 8, 64, 32), by_area)


@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_there_is_none_if_the_solution_is_wrong(factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its numbers are three times too large, or there are none at all."""
    solve = factory.solve_for_gather

    def wrong(*given: Any) -> RadiositySolution:
        solution = solve(*given)
        return replace(solution, vertices=factor * solution.vertices, elements=factor * solution.elements)

    monkeypatch.setattr(factory, "solve_for_gather", wrong)
    assert_the_same(means("cornell-box-36", CORRECTED, 8, 64, 32), means("cornell-box-36", PLAIN, 8, 128, 32))


def test_noise_is_a_third_of_what_guides_alone_leave() -> None:
    def squared_error(options: dict[str, Any]) -> float:
        films = [
            glpath.render("cornell-box-36", resolution=(64, 64), spp=16, seed=seed, **options).mean
            for seed in range(4)
        ]
        mean = np.mean(films, axis=0)
        return float(np.mean(np.var(films, axis=0, ddof=1) / (mean**2 + 0.01)))

    guided = {**CORRECTED, "max_depth": DEEPEST - 1}  # which has an end, so that nothing is looked up
    assert squared_error(CORRECTED) < 0.5 * squared_error(guided)


def test_direct_and_indirect_light_make_the_picture() -> None:
    options: dict[str, Any] = {**CORRECTED, "resolution": (32, 32), "spp": 8, "aovs": ("direct", "indirect")}
    film = glpath.render("cornell-box-36", **options)
    np.testing.assert_allclose(film.aov("direct") + film.aov("indirect"), film.mean, rtol=1e-5, atol=1e-6)
    direct = glpath.render(
        "cornell-box-36", **{**PLAIN, "roulette": None, "max_depth": 1}, resolution=(32, 32), spp=64
    )
    assert film.aov("direct").mean() == pytest.approx(direct.mean.mean(), rel=0.02)


def test_parts_of_a_render_add_up_to_its_bits() -> None:
    options: dict[str, Any] = {**CORRECTED, "resolution": (32, 32)}
    whole = glpath.render("cornell-box-36", spp=6, **options)
    parts = [
        glpath.render("cornell-box-36", first_path_set=first, spp=spp, **options) for first, spp in ((0, 2), (2, 4))
    ]
    assert np.array_equal(parts[0].merge(parts[1]).mean, whole.mean)


def test_software_draws_all_of_a_set_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """llvmpipe shares out squares of 64 x 64: draws of one kept all cores but one idle."""
    drawn = []

    def seen(of_pass, areas, uniforms):
        drawn.append(list(areas))
        run_in_areas(of_pass, areas, uniforms)

    monkeypatch.setattr("glpath.integrators.ray_paths.run_in_areas", seen)
    glpath.render("cornell-box-36", integrator="path", spp=1, resolution=(160, 128))
    if get_context().info.hardware:
        pytest.skip("a graphics card may end a draw that takes long")
    assert drawn == [[(0, 0, 160, 128)]]
