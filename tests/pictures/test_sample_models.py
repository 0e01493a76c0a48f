"""Check marks of small models that have one feature of glTF each: pictures against what the specification computes.

The models are those of `tests.support.sample_models`, which `python -m benchmarks khronos` compares with Cycles.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.io.completed import aside
from glpath.io.gltf import read_gltf
from glpath.scene.model import Camera, Float64, Light, Scene
from glpath.system.colour import decode_srgb
from tests.support.sample_models import MODELS, TRANSFORMS, WRAPS, checker, dome, write_models

#: Pixels of a plate: a unit of length.
PLATE = 24


def loaded(tmp_path: Path, name: str) -> Scene:
    write_models(tmp_path, [name])
    with aside("camera", "light"):
        return glpath.load_scene(tmp_path / "Models" / name / "glTF" / f"{name}.gltf")


def flat_view(scene: Scene, columns: int, rows: int) -> Scene:
    """Seen straight on, a plate of unit size for PLATE x PLATE pixels; the first is at the upper left."""
    middle = np.array([0.5 * (columns - 1), -0.5 * (rows - 1), 0.0])
    camera = Camera(
        middle + np.array([0, 0, 5.0]), middle, np.array([0.0, 1, 0]), 40.0, (PLATE * columns, PLATE * rows),
        projection="orthographic", height=float(rows),
    )  # fmt: skip
    return replace(scene, camera=camera, background=None)


def picture(scene: Scene, **options: Any) -> Float64:
    return np.asarray(glpath.render(scene, **{"integrator": "path", "spp": 1, "guide": "cosine", **options}).mean)


def plates(image: Float64, columns: int) -> list[Float64]:
    """(PLATE, PLATE, 3) each, in rows."""
    rows = len(image) // PLATE
    parts = image.reshape(rows, PLATE, columns, PLATE, 3).swapaxes(1, 2).reshape(-1, PLATE, PLATE, 3)
    return list(parts)


def pixel_uv() -> tuple[Float64, Float64]:
    """Texture coordinates (PLATE, PLATE) at the middles of a plate's pixels, v downwards."""
    at = (np.arange(PLATE) + 0.5) / PLATE
    u, v = np.meshgrid(at, at)
    return u, v


def wrapped(x: Float64, mode: str) -> Float64:
    """glTF 2.0, 3.8.4.1, as OpenGL ES 3.0 defines the modes."""
    if mode == "clamp":
        return np.clip(x, 0, 1 - 1e-9)
    if mode == "mirror":
        x = np.abs(np.mod(x, 2.0) - 1.0)
        return np.minimum(1.0 - x, 1 - 1e-9)
    return np.mod(x, 1.0)


def texels(u: Float64, v: Float64) -> Float64:
    image = decode_srgb(checker() / 255.0)
    side = len(image)
    row, column = (np.minimum((x * side).astype(int), side - 1) for x in (v, u))
    return image[row, column]


def inside(u: Float64, v: Float64, span: float) -> Any:
    """Pixels that show one texel alone, wherever in them a ray goes: none at a texel's edge."""
    half = 0.499 * span / PLATE * 4
    near = [np.abs(4 * x - np.round(4 * x)) < half for x in (u, v)]
    return ~(near[0] | near[1])


def test_texture_settings(tmp_path: Path) -> None:
    scene = flat_view(loaded(tmp_path, "TextureSettings"), 3, 3)
    found = plates(picture(scene), 3)
    u, v = (3 * x - 1 for x in pixel_uv())
    sure = inside(u, v, 3.0)
    assert sure.mean() > 0.1
    pairs = [(s, t) for s in WRAPS for t in WRAPS]
    for (s, t), plate in zip(pairs, found, strict=True):
        expected = texels(wrapped(u, s), wrapped(v, t))
        np.testing.assert_allclose(plate[sure], expected[sure], atol=2e-3, err_msg=f"{s}, {t}")


def test_texture_transform(tmp_path: Path) -> None:
    """KHR_texture_transform: scaled, then turned counter-clockwise as one sees the image, then moved."""
    scene = flat_view(loaded(tmp_path, "TextureTransform"), 2, 2)
    found = plates(picture(scene), 2)
    u0, v0 = pixel_uv()
    for transform, plate in zip(TRANSFORMS, found, strict=True):
        (a, b), angle = transform.get("scale", (1, 1)), transform.get("rotation", 0.0)
        c, s = np.cos(angle), np.sin(angle)
        u, v = c * a * u0 + s * b * v0, -s * a * u0 + c * b * v0
        u, v = (x + o for x, o in zip((u, v), transform.get("offset", (0, 0)), strict=True))
        sure = inside(u, v, abs(a) + abs(b))
        assert sure.mean() > 0.1
        expected = texels(np.mod(u, 1), np.mod(v, 1))
        np.testing.assert_allclose(plate[sure], expected[sure], atol=2e-3, err_msg=str(transform))


def test_vertex_colour(tmp_path: Path) -> None:
    """Colours of vertices are linear, and multiply the base colour: each plate is as the one below it."""
    scene = loaded(tmp_path, "VertexColor")
    sky = glpath.scene.Sky(np.ones(3), np.ones(3))
    found = picture(replace(flat_view(scene, 3, 2), sky=sky), spp=64, max_depth=2)
    columns = found.shape[1]
    upper, lower = found[2 : PLATE - 2], found[PLATE + 4 : 2 * PLATE - 2]
    for x in (PLATE // 2, columns // 2, columns - PLATE // 2):
        above, below = (part[:, x - 4 : x + 4].mean(axis=(0, 1)) for part in (upper, lower))
        np.testing.assert_allclose(above, below, rtol=0.02)
        assert above.max() > 2 * above.min()


def test_negative_scale(tmp_path: Path) -> None:
    """Single-sided letters L under mirrored nodes are seen from their fronts, as mirror images."""
    scene = flat_view(loaded(tmp_path, "NegativeScale"), 4, 2)
    sky = glpath.scene.Sky(np.ones(3), np.ones(3))
    options: dict[str, Any] = {"integrator": "path", "guide": "cosine", "spp": 16, "max_depth": 2}
    film = glpath.render(replace(scene, sky=sky), aovs=("object_id", "normal"), **options)
    letters = plates(np.repeat((film.aov("object_id") > 0)[..., None], 3, axis=2).astype(float), 4)[:4]
    shown = [letter[..., 0] > 0 for letter in letters]
    assert 0.2 < shown[0].mean() < 0.6
    for i, mirrored in ((1, shown[0][:, ::-1]), (2, shown[0][::-1, ::-1]), (3, shown[0][::-1])):
        assert (shown[i] == mirrored).mean() > 0.97
    assert np.median(film.aov("normal")[:PLATE][np.hstack(shown)][:, 2]) > 0.99
    # Balls bulge outward whatever the mirror: the normal points from the middle.
    for ball in plates(np.asarray(film.aov("normal"), float), 4)[4:]:
        assert ball[6:18, 4, 0].mean() < -0.2
        assert ball[6:18, -5, 0].mean() > 0.2


def test_normal_tangent_mirror(tmp_path: Path) -> None:
    """The same dome by coordinates that are as they are, mirrored and turned, lit from one side."""
    scene = flat_view(loaded(tmp_path, "NormalTangentMirror"), 2, 2)
    material = replace(scene.materials[0], roughness=1.0, specular_weight=0.0, reflectance=np.ones(3))
    sun = Light("sun", "directional", np.full(3, np.pi), direction=np.array([-0.6, 0.0, -0.8]))
    lit = replace(scene, sky=None, lights=(sun,), materials=(material,))
    found = plates(picture(lit, spp=64, max_depth=1), 2)
    stored = dome(PLATE * 8) / 127.5 - 1
    stored /= np.linalg.norm(stored, axis=2, keepdims=True)
    cosine = np.maximum(stored @ [0.6, 0.0, 0.8], 0)
    expected = cosine.reshape(PLATE, 8, PLATE, 8).mean(axis=(1, 3))
    straight, mirrored, turned, flipped = (plate.mean(axis=2) for plate in found)
    # The image itself is mirrored and turned with its coordinates: a dome is the same.
    for plate in (straight, mirrored, turned, flipped):
        apart = np.abs(plate - expected)[1:-1, 1:-1]
        assert np.median(apart) < 0.01
        assert apart.mean() < 0.03


def test_alpha_modes(tmp_path: Path) -> None:
    """Opaque, a mask at one half, and blended: what is seen of the wall is what alpha leaves."""
    scene = loaded(tmp_path, "AlphaBlend")
    sky = glpath.scene.Sky(np.ones(3), np.ones(3))
    view = replace(flat_view(scene, 3, 1), sky=sky)
    found = np.asarray(
        glpath.render(view, integrator="path", guide="cosine", spp=256, max_depth=1, aovs=("material_id",)).mean
    )
    opaque, mask, blend = plates(found, 3)
    wall = scene.materials[0].name
    assert wall
    reds = [plate[8:16, :, 0].mean(axis=0) for plate in (opaque, mask, blend)]
    assert np.ptp(reds[0]) < 0.1 * reds[0].mean()
    dark, light = reds[1][2:9].mean(), reds[1][-9:-2].mean()
    assert light == pytest.approx(reds[0].mean(), rel=0.1)
    assert dark < 0.5 * light
    # From the wall's red at the left to the plate's at the right, as alpha rises.
    assert np.all(np.diff(reds[2][1::4]) > -0.02)
    assert dark < reds[2][1] < 0.5 * light  # less of the sky is hidden from the wall there
    assert reds[2][-2] == pytest.approx(light, rel=0.1)


@pytest.mark.filterwarnings("ignore::glpath.errors.SceneWarning")
def test_every_model_is_read_without_a_loss(tmp_path: Path) -> None:
    write_models(tmp_path)
    for name in MODELS:
        model = read_gltf(tmp_path / "Models" / name / "glTF" / f"{name}.gltf")
        assert not model.notes, name
