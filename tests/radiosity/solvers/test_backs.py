"""What solvers know of a surface's other side: a diffuse base that lets light through, a back that is not there.

Each scene is compared with one that has neither: light from behind with its mirror image, a back with nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.scene.model import Float64, Material, Scene

METHODS = ("monte-carlo", "progressive", "matrix")
LIGHTS = ("lamp", "point", "sky")
GREEN = np.array([0.2, 0.8, 0.4])


def level(z: float, x: float, half: float, up: bool) -> list[list[float]]:
    corners = [[x - half, -half, z], [x + half, -half, z], [x + half, half, z], [x - half, half, z]]
    return corners if up else corners[::-1]


def scene_of(light: str, z: float, sheet: Material, *shapes: dict[str, Any], floor: Any) -> Scene:
    """A light at a height, shapes, and a floor, which is the last shape."""
    given: dict[str, Any] = {
        "camera": {"position": [0, -9, 0], "target": [0, 0, 0], "fov": 40, "up": [0, 0, 1]},
        "materials": {"sheet": {"reflectance": 0.5}, "black": {"reflectance": 0, "two_sided": False}},
        "shapes": [*shapes],
    }
    given["materials"]["grey"] = {"reflectance": 0.1, "two_sided": False}
    if light == "lamp":
        given["shapes"].append(
            {
                "type": "quad", "corners": level(z, 0, 0.5, up=z < 0), "material": "black",
                "emission": {"radiance": [9, 6, 3]},
            }
        )  # fmt: skip
    elif light == "point":
        given["lights"] = [{"type": "point", "position": [0, 0, z], "intensity": [9, 6, 3]}]
    else:
        given["sky"] = {"zenith": [3, 2, 1], "horizon": 0, "up": [0, 0, 1 if z > 0 else -1]}
    given["shapes"].append({"type": "quad", "corners": floor, "material": "grey"})
    scene = glpath.load_scene(given)
    return replace(scene, materials=(sheet, *scene.materials[1:]))


def on_floor(scene: Scene, method: str) -> Float64:
    """(3,) irradiance of the floor's front, the last two triangles, by their elements, which are equally large."""
    options: dict[str, Any] = {"particles": 1 << 19} if method == "monte-carlo" else {"unshot": 1e-6}
    options = {} if method == "matrix" else options
    solution = glpath.solve_radiosity(scene, method=method, size=0.6, **options)  # type: ignore[arg-type]
    count = int(solution.divisions[-2:].astype(int) @ solution.divisions[-2:])
    return np.asarray(solution.elements.sum(axis=0)[0, -count:].mean(axis=0))


@pytest.mark.parametrize("light", ["lamp", "point"])
@pytest.mark.parametrize("method", METHODS)
def test_light_through_paper_is_that_of_its_mirror_image(method: str, light: str) -> None:
    paper = Material(
        "paper", np.zeros(3), roughness=1.0, specular_weight=0.0, diffuse_transmission=0.8,
        diffuse_transmission_colour=GREEN,
    )  # fmt: skip
    sheet = {"type": "quad", "corners": level(0, 0, 2.5, up=True), "material": "sheet"}
    aside = level(2.0, 2.5, 0.5, up=False)
    through = scene_of(light, -3.0, paper, sheet, floor=aside)
    mirrored = scene_of(light, 3.0, Material("m", 0.8 * GREEN), sheet, floor=aside)
    found, expected = on_floor(through, method), on_floor(mirrored, method)
    assert expected.min() > 1e-3
    np.testing.assert_allclose(found, expected, rtol=0.06 if method == "monte-carlo" else 0.01)


@pytest.mark.parametrize("method", ["monte-carlo", "progressive"])
def test_nothing_leaves_from_a_back_that_is_not_there(method: str) -> None:
    """A culled sheet of paper, lit from its front, throws no light behind it: who looks there sees no sheet."""
    paper = Material(
        "paper", np.zeros(3), two_sided=False, culled=True, roughness=1.0, specular_weight=0.0,
        diffuse_transmission=0.8, diffuse_transmission_colour=GREEN,
    )  # fmt: skip
    aside = level(2.0, 2.5, 0.5, up=False)
    lit_in_front, lit_behind = (
        scene_of("point", -3.0, paper, {"type": "quad", "corners": level(0, 0, 2.5, up=up), "material": "sheet"},
                 floor=aside)
        for up in (False, True)
    )  # fmt: skip
    bare = scene_of("point", -3.0, paper, floor=aside)
    # The floor sees the light through the back, and nothing of the sheet.
    np.testing.assert_allclose(on_floor(lit_in_front, method), on_floor(bare, method), rtol=0.01)
    # From behind the front is lit as any paper, and hides the light.
    plain = scene_of(
        "point", -3.0, replace(paper, culled=False, two_sided=True),
        {"type": "quad", "corners": level(0, 0, 2.5, up=True), "material": "sheet"}, floor=aside,
    )  # fmt: skip
    np.testing.assert_allclose(on_floor(lit_behind, method), on_floor(plain, method), rtol=0.05)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("method", METHODS)
def test_a_floor_is_lit_through_a_back_and_not_through_a_front(method: str, light: str) -> None:
    culled = Material("culled", np.full(3, 0.05), two_sided=False, culled=True)
    floor = level(-1.0, 0, 1.0, up=True)
    facing_up, facing_down = (
        {"type": "quad", "corners": level(0, 0, 1.5, up=up), "material": "sheet"} for up in (True, False)
    )
    bare = on_floor(scene_of(light, 3.0, culled, floor=floor), method)
    through = on_floor(scene_of(light, 3.0, culled, facing_up, floor=floor), method)
    rtol = 0.05 if method == "monte-carlo" else 0.01
    np.testing.assert_allclose(through, bare, rtol=rtol)
    shaded = on_floor(scene_of(light, 3.0, culled, facing_down, floor=floor), method)
    black = replace(culled, culled=False)
    expected = on_floor(scene_of(light, 3.0, black, facing_down, floor=floor), method)
    assert expected.max() < 0.5 * bare.max()
    np.testing.assert_allclose(shaded, expected, rtol=rtol, atol=1e-3 * bare.max())


def test_a_solution_sends_on_what_it_lets_through() -> None:
    """The radiosity of a lamp-lit sheet's other side is its transmittance times the irradiance before it."""
    paper = Material(
        "paper", np.full(3, 0.5), roughness=1.0, specular_weight=0.0, diffuse_transmission=0.5,
        diffuse_transmission_colour=GREEN,
    )  # fmt: skip
    sheet = {"type": "quad", "corners": level(0, 0, 1.0, up=True), "material": "sheet"}
    scene = scene_of("point", 2.0, paper, sheet, floor=level(-50, 0, 0.1, up=True))
    solution = glpath.solve_radiosity(scene, method="progressive", size=3.0)
    front = solution.elements.sum(axis=0)[0, 0]
    sent = solution.reflected(scene)[:, 0]
    np.testing.assert_allclose(sent[0], 0.25 * front, rtol=1e-4)
    np.testing.assert_allclose(sent[1], 0.5 * GREEN * front, rtol=1e-3)
    np.testing.assert_allclose(solution.lookup(scene, 0, [0.3, 0.3], 1, "constant")[0], sent[1], rtol=1e-3)
