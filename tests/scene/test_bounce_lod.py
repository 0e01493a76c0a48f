"""A simpler scene for what is seen by way of other surfaces: what stays, what it costs in error, who refuses."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.scene import tessellate
from glpath.scene.simplify import _distance, simplified

pytest.importorskip("fast_simplification", reason='pip install "glpath[lod]"')

SCANS = {"integrator": "path-buffer", "light_resolution": 64, "resolution": (40, 40)}


def dense_box(times: int = 4) -> dict[str, Any]:
    """A room of 12 * 4**times triangles, seen from within, and a lamp."""
    vertices, faces = tessellate.box((-1, -1, -1), (1, 1, 1))
    for _ in range(times):
        vertices, faces = tessellate.subdivide(vertices, faces)
    return {
        "camera": {"position": [0.6, -0.2, 0.9], "target": [-0.4, -0.3, -0.6], "fov": 60},
        "materials": {"wall": {"reflectance": [0.7, 0.5, 0.4]}},
        "shapes": [
            {"vertices": vertices, "faces": faces, "material": "wall", "flip_normals": True, "name": "walls"},
            {
                "type": "quad",
                "corners": [[-0.4, 0.9, -0.4], [0.4, 0.9, -0.4], [0.4, 0.9, 0.4], [-0.4, 0.9, 0.4]],
                "emission": {"radiance": 8, "two_sided": True},
            },
        ],
    }


BALL = {"type": "sphere", "center": [-0.3, -0.5, -0.3], "radius": 0.4, "material": "wall"}


def test_flat_walls_lose_triangles_and_no_light():
    scene = glpath.load_scene(dense_box())
    found = simplified(scene, 0.05)
    assert len(scene.triangles) == 12 * 4**4 + 2
    assert len(found.scene.triangles) < 0.06 * len(scene.triangles)
    assert found.deviation < 1e-5
    full, simple = (glpath.render(scene, spp=64, max_depth=4, **SCANS, **o) for o in ({}, {"bounce_lod": 0.05}))
    # The same light, but for paths on the edges of triangles.
    assert relative_mse(simple.mean, full.mean) < 1e-6
    assert simple.mean.mean() == pytest.approx(full.mean.mean(), rel=1e-4)


def test_direct_light_and_what_the_eye_sees_are_not_touched():
    scene = glpath.load_scene({**dense_box(2), "shapes": [*dense_box(2)["shapes"], BALL]})
    films = [
        glpath.render(scene, spp=4, max_depth=1, **SCANS, aovs=("normal",), **o) for o in ({}, {"bounce_lod": 0.05})
    ]
    np.testing.assert_array_equal(films[0].mean, films[1].mean)
    films = [
        glpath.render(scene, spp=4, max_depth=3, **SCANS, aovs=("normal",), **o) for o in ({}, {"bounce_lod": 0.05})
    ]
    np.testing.assert_array_equal(films[0].aov("normal"), films[1].aov("normal"))
    assert np.any(films[0].mean != films[1].mean)


@pytest.mark.parametrize("sky", [pytest.param(False, marks=pytest.mark.evidence), True])
def test_a_ball_is_wrong_by_little_and_by_the_more_the_simpler_it_is(sky: bool):
    data = dense_box(2)
    data["shapes"].append(BALL)
    if sky:  # a lamp, a sky and a sun outside: lights of each kind keep their chances
        data["shapes"] = data["shapes"][1:]
        data["sky"] = {"zenith": [0.3, 0.4, 0.7], "horizon": 0.5}
        data["lights"] = [{"type": "directional", "direction": [0.3, -1, -0.2], "irradiance": 2}]
        floor = [[-3, -1, 3], [3, -1, 3], [3, -1, -3], [-3, -1, -3]]
        data["shapes"].append({"type": "quad", "corners": floor, "material": "wall"})
    scene = glpath.load_scene(data)
    full = glpath.render(scene, spp=64, max_depth=4, **SCANS).mean
    errors = []
    for share in (0.8, 0.05):
        film = glpath.render(scene, spp=64, max_depth=4, **SCANS, bounce_lod=share)
        errors.append(relative_mse(film.mean, full))
        assert film.mean.mean() == pytest.approx(full.mean(), rel=0.01)
    assert 0 < errors[0] < errors[1] < 1e-3


def test_lamps_textures_and_small_meshes_stay():
    data = dense_box()
    walls = data["shapes"][0]
    data["textures"] = {"t": {"type": "checker"}}
    data["materials"]["seen"] = {"texture": "t"}
    data["materials"]["pane"] = {"alpha": "blend", "opacity": 0.5}
    data["shapes"] += [
        {**walls, "emission": {"radiance": 1}, "name": "lamp"},
        {**walls, "material": "seen", "name": "seen"},
        {**walls, "material": "pane", "name": "pane"},
        {"type": "box", "min": [0, 0, 0], "max": [0.1, 0.1, 0.1], "name": "box"},
    ]
    scene = glpath.load_scene(data)
    found = simplified(scene, 0.1).scene
    counts = {a.name: (a.count, b.count) for a, b in zip(scene.shapes, found.shapes, strict=True)}
    assert counts["walls"][1] < 0.11 * counts["walls"][0]
    for name in ("lamp", "seen", "pane", "box"):
        assert counts[name][0] == counts[name][1]


def test_the_deviation_is_that_of_points_from_triangles():
    random = np.random.default_rng(4)
    points, triangles = random.normal(size=(200, 3)), random.normal(size=(200, 3, 3))
    found = _distance(points, triangles)
    # By many points of each triangle.
    b = np.sort(random.random((4000, 2)), axis=1)
    weights = np.column_stack([b[:, 0], b[:, 1] - b[:, 0], 1 - b[:, 1]])
    sampled = np.linalg.norm(np.einsum("kc,ncx->nkx", weights, triangles) - points[:, None], axis=2).min(axis=1)
    assert (found <= sampled + 1e-12).all()
    np.testing.assert_allclose(found, sampled, atol=0.1)


def test_what_is_no_share_or_has_own_rays_is_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(glpath.UsageError, match=r'bounce_lod: 0.5 with the integrator "path"'):
        glpath.render("cornell-box-36", integrator="path", spp=1, bounce_lod=0.5)
    for share in (0, 1.5):
        with pytest.raises(glpath.UsageError, match="bounce_lod"):
            glpath.render("cornell-box-36", spp=1, integrator="path-buffer", bounce_lod=share)
    with pytest.raises(glpath.SceneError, match=r"streams triangles \(ground\), which bounce_lod cannot simplify"):
        glpath.render("terrain", parameters={"streamed": True}, spp=1, integrator="path-buffer", bounce_lod=0.5)
    monkeypatch.setitem(sys.modules, "fast_simplification", None)
    with pytest.raises(glpath.UsageError, match="fast-simplification") as error:
        glpath.render(dense_box(2), spp=1, integrator="path-buffer", bounce_lod=0.5)
    assert 'pip install "glpath[lod]"' in error.value.remedy


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("name", "parameters"), [("room", {}), ("terrain", {"level": 24}), ("teapot", {"level": 16})]
)
def test_the_error_of_simpler_bounces(name: str, parameters: dict[str, int]):
    scene = glpath.load_scene(name, parameters)
    options = {"integrator": "path-buffer", "resolution": (48, 48), "max_depth": 3, "spp": 32}
    full = glpath.render(scene, **options)
    noise = relative_mse(glpath.render(scene, seed=1, **options).mean, full.mean)
    for share in (0.5, 0.1):
        found = simplified(scene, share)
        film = glpath.render(scene, bounce_lod=share, **options)
        error, bias = relative_mse(film.mean, full.mean), film.mean.mean() / full.mean.mean() - 1
        print(
            f"{name} {share}: {len(scene.triangles)} to {len(found.scene.triangles)} triangles, deviation "
            f"{found.deviation:.3g}, relMSE {error:.2e} (noise {noise:.2e}), mean {bias:+.2%}, "
            f"{film.metadata.elapsed_s:.1f} of {full.metadata.elapsed_s:.1f} s"
        )
        assert error < 0.1 * noise
        assert abs(bias) < 0.01
        assert found.deviation <= 1e-3 * np.linalg.norm(np.ptp(scene.bounds, axis=0))
