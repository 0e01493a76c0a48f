"""Alpha: masks and blended surfaces, in every engine."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import SceneError
from glpath.radiosity.mesh.mesh import Elements
from glpath.scene.model import Float64, Light, Material, Mesh, Scene, Shape, Shapes, TextureSlot
from tests.support.surfaces import BLACK, GREY, camera, lamp, level, scene_of, squares

ENGINES: dict[str, dict[str, Any]] = {
    "rays": {"integrator": "path", "guide": "cosine"},
    "scans": {"integrator": "path-buffer"},
    "gather": {"integrator": "gather"},
    "gather by scans": {"integrator": "gather", "cast": "path-buffer"},
    "t-buffer": {"integrator": "t-buffer"},
    "classic": {"integrator": "classic"},
}


def canopy(material: Material, mesh: Mesh | None = None, n: int = 4) -> Scene:
    """A lamp over a floor, and between them a canopy, looked at from above the floor."""
    return scene_of(
        [
            Shape("floor", level(0.0, 2.0), 1),
            Shape("canopy", mesh or level(0.6, 1.2), 2),
            lamp(level(1.5, 0.3, down=True)),
        ],
        [BLACK, GREY, material],
        camera([0, 0.5, 3.0], [0, 0.2, 0], 50),
        (squares(n),),
    )


def cut_out(mesh: Mesh, n: int) -> Mesh:
    """Of a quad in n x n squares those that a texture of squares keeps."""
    row, column = np.divmod(np.arange(n * n), n)
    gone = (n - 1 - row + column) % 2 == 1
    return mesh.without_faces(np.repeat(gone, 2))


MASK = Material("leaf", np.full(3, 0.4), texture=TextureSlot(0), alpha="mask")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_mask_is_the_geometry_cut_out(engine: str) -> None:
    masked = glpath.render(canopy(MASK), spp=128, **ENGINES[engine])
    plain = replace(MASK, texture=None, alpha="opaque")
    cut = glpath.render(canopy(plain, cut_out(level(0.6, 1.2, parts=4), 4)), spp=128, **ENGINES[engine])
    a, b = np.asarray(masked.mean), np.asarray(cut.mean)
    print(engine, a.mean(), b.mean(), np.abs(a - b).mean() / b.mean())
    assert a.mean() == pytest.approx(b.mean(), rel=0.02)
    blocks = [x.reshape(8, 4, 8, 4, 3).mean(axis=(1, 3)) for x in (a, b)]
    assert np.abs(blocks[0] - blocks[1]).mean() < 0.06 * b.mean()


@pytest.mark.parametrize("engine", [name for name in ENGINES if "gather" not in name])
def test_half_of_a_blended_surface_is_half_of_its_light(engine: str) -> None:
    """From right above and below: what is seen is half the surface and half of what is behind it."""
    pictures = []
    for opacity in (0.0, 0.5, 1.0):
        material = Material("veil", np.full(3, 0.4), alpha="blend", opacity=opacity)
        scene = scene_of(
            [Shape("floor", level(0.0, 2.0), 1), Shape("veil", level(0.5, 0.7), 2)],
            [BLACK, GREY, material],
            camera([0, 3.0, 0], pixels=16),
            lights=(Light("sun", "directional", np.full(3, 2.0), direction=np.array([0.0, -1.0, 0.0])),),
        )
        film = glpath.render(scene, spp=256, max_depth=1, **ENGINES[engine])
        pictures.append(np.asarray(film.mean)[6:10, 6:10])
    nothing, half, all_of_it = (p.mean() for p in pictures)
    assert nothing == pytest.approx(2.0 * 0.5 / np.pi, rel=1e-3)
    assert all_of_it == pytest.approx(2.0 * 0.4 / np.pi, rel=1e-3)
    # Seen by half, and where it is not, the floor is lit through it by half.
    assert half == pytest.approx(0.5 * all_of_it + 0.25 * nothing, rel=0.04)


def veils(*opacities: float) -> Scene:
    """Black sheets one over the other, over a floor that glows as brightly as 1, looked at from above."""
    sheets = [Shape(f"veil {k}", level(0.3 + 0.2 * k, 2.0), 2 + k) for k, _ in enumerate(opacities)]
    materials = [
        Material(f"veil {k}", np.zeros(3), alpha="blend", opacity=opacity) for k, opacity in enumerate(opacities)
    ]
    return scene_of(
        [lamp(level(0.0, 2.0), 1, np.ones(3)), *sheets], [BLACK, GREY, *materials], camera([0, 3.0, 0], pixels=16)
    )


@pytest.mark.parametrize("engine", ["rays", "t-buffer"])
@pytest.mark.parametrize("opacity", [0.3, 0.5, 0.9])
def test_of_eight_sets_a_blended_surface_is_seen_by_its_share(engine: str, opacity: float) -> None:
    """In each pixel up to one of them, where chance alone has some off by three or four."""
    seen = 8.0 * np.asarray(glpath.render(veils(opacity), spp=8, **ENGINES[engine]).mean)[..., 0]
    i, j = np.indices(seen.shape)
    seen = seen[np.abs(i + j - 15) > 1]  # two triangles share the other pixels
    assert np.abs(seen - 8.0 * (1.0 - opacity)).max() < 1.0


def test_two_blended_surfaces_hide_what_is_behind_them_apart_from_each_other() -> None:
    """In each pixel: a sequence that both shared would have a bias there that no number of sets takes away."""
    seen = np.asarray(glpath.render(veils(0.5, 0.5), spp=1024, **ENGINES["rays"]).mean)[..., 0][6:10, 6:10]
    assert np.abs(seen - 0.25).max() < 4 * np.sqrt(0.25 * 0.75 / 1024)


def mean_light(scene: Scene, **options: Any) -> Float64:
    return np.asarray(glpath.render(scene, **options).mean).mean(axis=(0, 1))


@pytest.mark.parametrize("engine", ["rays", "scans", "t-buffer"])
def test_squares_of_a_mask_shade_as_a_blend_of_their_mean(engine: str) -> None:
    fine = canopy(MASK, n=32)
    veil = canopy(Material("veil", np.full(3, 0.4), alpha="blend", opacity=0.5))
    a, b = (mean_light(s, spp=128, **ENGINES[engine])[0] for s in (fine, veil))
    assert a == pytest.approx(b, rel=0.03)


@pytest.mark.parametrize("engine", ["rays", "scans", "t-buffer"])
def test_ranges_of_path_sets_merge_bit_for_bit(engine: str) -> None:
    scene = canopy(Material("veil", np.full(3, 0.4), alpha="blend", opacity=0.5, texture=TextureSlot(0)))
    options = ENGINES[engine]
    whole = glpath.render(scene, spp=8, **options)
    parts = [glpath.render(scene, spp=n, first_path_set=first, **options) for first, n in ((0, 3), (3, 5))]
    assert np.array_equal(parts[0].merge(parts[1]).radiance_sums, whole.radiance_sums)
    if engine != "scans":  # whose cells are the window's
        crop = glpath.render(scene, spp=8, crop=(9, 11, 13, 12), **options)
        assert np.array_equal(crop.mean, np.asarray(whole.mean)[11:23, 9:22])


@pytest.mark.parametrize("shadows", ["sphere", "cube"])
def test_shadow_buffers_of_point_lights_know_masks(shadows: Any) -> None:
    light = Light("bulb", "point", np.full(3, 5.0), position=np.array([0.1, 1.5, 0.05]))

    def lit(scene: Scene) -> Scene:
        return replace(scene, shapes=Shapes(scene.shapes[:2]), lights=(light,))

    scene = lit(canopy(MASK))
    by_rays, by_buffer = (
        np.asarray(glpath.render(scene, integrator="t-buffer", shadows=s, spp=16).mean) for s in ("rays", shadows)
    )
    assert np.abs(by_rays - by_buffer).mean() < 0.02 * by_rays.mean()
    veil = Material("veil", np.full(3, 0.4), alpha="blend", opacity=0.5)
    with pytest.raises(SceneError, match=r'veil have alpha = "blend"'):
        glpath.render(lit(canopy(veil)), integrator="t-buffer", shadows=shadows)


def test_the_t_buffer_has_the_bits_of_the_classical_algorithm_through_holes() -> None:
    sphere = Shape(
        "ball",
        "sphere",
        2,
        world_from_object=np.eye(3, 4)[None] * 0.4 + [[[0, 0, 0, 0], [0, 0, 0, 0.3], [0, 0, 0, 0.9]]],
    )
    scene = canopy(replace(MASK, two_sided=True))
    scene = replace(scene, shapes=Shapes((*scene.shapes, sphere)))
    a, b = (glpath.render(scene, integrator=i, spp=4).mean for i in ("t-buffer", "classic"))
    assert np.array_equal(a, b)


@pytest.mark.parametrize("method", ["progressive", "matrix", "monte-carlo"])
def test_radiosity_knows_what_passes_through(method: Any) -> None:
    """A veil of a tenth hides next to nothing, one of nine tenths nearly all: from the lamp, and from a light."""

    def floor_light(opacity: float, sun: bool) -> float:
        material = Material("veil", np.zeros(3), alpha="blend", opacity=opacity)
        scene = canopy(material)
        if sun:
            light = Light("sun", "directional", np.full(3, 2.0), direction=np.array([0.0, -1.0, 0.0]))
            scene = replace(scene, shapes=Shapes(scene.shapes[:2]), lights=(light,))
        options: dict[str, Any] = {"particles": 200_000} if method == "monte-carlo" else {}
        solution = glpath.solve_radiosity(scene, method=method, patches=64, **options)
        elements = Elements.of_lattices(solution.divisions.astype(np.int64))
        x, _, z = elements.points(scene, np.full((1, 3), 1 / 3))[:, 0].T
        # The floor right below the canopy: the sun's light elsewhere is the same.
        below = (scene.triangle_shape[elements.triangle] == 0) & (np.maximum(np.abs(x), np.abs(z)) < 1.0)
        return float(solution.elements.sum(axis=0)[0, below, 0].mean())

    for sun in (False, True):
        free = floor_light(0.0, sun)
        thin, thick = (floor_light(opacity, sun) / free for opacity in (0.1, 0.9))
        if sun or method == "monte-carlo":  # by the share that is let through
            assert thin == pytest.approx(0.9, abs=0.03)
            assert thick == pytest.approx(0.1, abs=0.03)
        else:  # visibility is all or nothing
            assert thin == pytest.approx(1.0, abs=0.01)
            assert thick < 0.02
