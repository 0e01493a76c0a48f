"""What textures do to pictures: where they lie, how they are read, and what each slot changes."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from glpath.errors import SceneError
from glpath.radiosity.mesh.mesh import Elements
from glpath.radiosity.mesh.sides import Sides
from glpath.scene.appearance import Appearance, texture_at
from glpath.scene.material import SLOTS as SLOT_NAMES
from glpath.scene.model import Float64, Material, Mesh, Scene, Shape, Sky, Texture, TextureSlot
from glpath.system.colour import decode_srgb
from tests.support.surfaces import BLACK, GREY, camera, lamp, level, quad, scene_of

WHITE = Material("white", np.ones(3))
#: Half the height of the quad that fills the picture seen from 1 away at 90 degrees.
FRONT = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
SKY = Sky(np.ones(3), np.ones(3))
PIXELS = 16
STILL: dict[str, Any] = {"integrator": "path", "guide": "cosine", "max_depth": 2}


def random_image(height: int = 3, width: int = 5, channels: int = 3) -> np.ndarray[Any, np.dtype[np.uint8]]:
    return np.random.default_rng(1).integers(0, 256, (height, width, channels), np.uint8)


def front(material: Material, *textures: Texture, mesh: Mesh | None = None, **more: Any) -> Scene:
    """A quad that fills the picture, under a sky of radiance 1: what is seen is its reflectance."""
    shape = Shape("quad", mesh or quad(FRONT), 0)
    return scene_of([shape], [material], camera([0, 0, 1], fov=90, pixels=PIXELS), textures, sky=SKY, **more)


def picture(scene: Scene, spp: int = 64, **options: Any) -> Float64:
    return np.asarray(glpath.render(scene, spp=spp, **(options or STILL)).mean)


def expected(texture: Texture, slot: TextureSlot, mesh: Mesh | None = None) -> Float64:
    """(PIXELS, PIXELS, 3): means over the pixels, of uv that is that of the quad or, of `uv1`, its own map."""
    n = PIXELS * 16
    s = (np.arange(n) + 0.5) / n
    u, v = np.meshgrid(s, s[::-1])
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    if slot.uv_set == 1:
        uv = 0.3 + 0.5 * uv
    values = texture_at(texture, uv @ slot.uv_transform[:, :2].T + slot.uv_transform[:, 2])[:, :3]
    return np.asarray(values.reshape(PIXELS, 16, PIXELS, 16, 3).mean(axis=(1, 3)))


TURNED = np.array([[1.3, -0.4, 0.2], [0.7, 1.9, -0.6]])
SLOTS = {
    "as it is": (TextureSlot(0), {}),
    "transformed": (TextureSlot(0, uv_transform=TURNED), {}),
    "repeats": (TextureSlot(0), {"scale": (2.0, 3.0)}),
    "clamped": (TextureSlot(0, uv_transform=TURNED), {"wrap": ("clamp", "clamp")}),
    "mirrored": (TextureSlot(0, uv_transform=TURNED), {"wrap": ("mirror", "mirror")}),
    "one of each": (TextureSlot(0, uv_transform=TURNED), {"wrap": ("mirror", "clamp")}),
    "second uv": (TextureSlot(0, uv_set=1), {}),
}


@pytest.mark.parametrize("filter_", ["linear", "nearest"])
@pytest.mark.parametrize("name", SLOTS)
def test_the_device_looks_textures_up_as_the_cpu_does(name: str, filter_: str) -> None:
    slot, more = SLOTS[name]
    texture = Texture("t", random_image(), filter=filter_, srgb=True, **more)  # type: ignore[arg-type]
    mesh = quad(FRONT)
    assert mesh.uv is not None
    mesh = replace(mesh, uv1=0.3 + 0.5 * mesh.uv)
    found = picture(front(replace(WHITE, texture=slot), texture, mesh=mesh))
    wanted = expected(texture, slot)
    print(name, filter_, np.abs(found - wanted).mean(), np.abs(found - wanted).max())
    assert np.abs(found - wanted).mean() < 0.01
    assert np.abs(found - wanted).max() < 0.12  # of pixels between two texels, whose samples are 64


def test_bytes_of_srgb_are_the_image_in_floats() -> None:
    stored = random_image()
    images = {
        "bytes": Texture("t", stored, srgb=True),
        "floats": Texture("t", decode_srgb(stored / 255).astype(np.float32)),
        "linear bytes": Texture("t", stored),
    }
    found = {name: picture(front(replace(WHITE, texture=TextureSlot(0)), t), 4) for name, t in images.items()}
    assert np.abs(found["bytes"] - found["floats"]).max() < 3e-6
    assert found["linear bytes"].mean() > 1.1 * found["bytes"].mean()


def test_each_byte_of_srgb_is_decoded() -> None:
    ramp = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    texture = Texture("t", ramp, filter="nearest", srgb=True)
    found = picture(front(replace(GREY, texture=TextureSlot(0)), texture), 4) / picture(front(GREY), 4)
    assert np.abs(found - decode_srgb(ramp / 255)).max() < 1.5e-6


@pytest.mark.evidence
@pytest.mark.parametrize("slot", SLOT_NAMES)
def test_each_slot_decodes_an_image_of_srgb(slot: str) -> None:
    """Which slots are of colours stands in `texture_images` and, by how each is read, in `scene/surface.glsl`."""
    stored = random_image(channels=4)
    decoded = np.concatenate([decode_srgb(stored[..., :3] / 255), stored[..., 3:] / 255], axis=2).astype(np.float32)
    shares = (
        "transmission",
        "diffuse_transmission",
        "clearcoat",
        "clearcoat_roughness",
        "anisotropy",
        "iridescence",
    )
    lobes: dict[str, Any] = {**dict.fromkeys(shares, 0.4), "sheen": np.full(3, 0.5), "sheen_roughness": 0.5}
    all_lobes = replace(GREY, roughness=0.6, metallic=0.3, **lobes, **{slot: TextureSlot(0)})
    found = []
    for texture in (Texture("t", stored, srgb=True), Texture("t", decoded)):
        scene = front(all_lobes, texture)
        lit = replace(scene.shapes[0], emission=np.full(3, 0.5)) if slot == "emission_texture" else scene.shapes[0]
        found.append(picture(replace(scene, shapes=(lit,), sky=Sky(np.full(3, 4.0), np.zeros(3))), 2))
    plain = front(replace(all_lobes, **{slot: None}))
    assert np.abs(found[0] - found[1]).max() < 2e-5
    assert np.abs(found[0] - picture(replace(plain, sky=Sky(np.full(3, 4.0), np.zeros(3))), 2)).max() > 1e-3


def test_colours_of_vertices_are_materials_of_triangles() -> None:
    corners = quad(FRONT).vertices[quad(FRONT).faces]
    colours = np.array([[0.9, 0.2, 0.1, 1], [0.1, 0.4, 0.8, 1]])
    mesh = replace(Mesh.of_triangles(corners), colours=np.repeat(colours, 3, axis=0))
    coloured = picture(front(WHITE, mesh=mesh), 16)
    shapes = [Shape(str(i), Mesh.of_triangles(corners[i : i + 1]), i) for i in range(2)]
    materials = [Material(str(i), colours[i, :3]) for i in range(2)]
    plain = picture(scene_of(shapes, materials, camera([0, 0, 1], fov=90, pixels=PIXELS), sky=SKY), 16)
    assert np.abs(coloured - plain).max() < 1e-5
    # Between corners, colours are linear: the mean of a triangle is that of its corners.
    ramp = replace(quad(FRONT), colours=np.array([[0, 0, 0, 1], [1, 1, 1, 1.0]])[[0, 1, 0, 1]])
    across = picture(front(WHITE, mesh=ramp), 64).mean(axis=(0, 2))
    assert np.abs(across - (np.arange(PIXELS) + 0.5) / PIXELS).max() < 0.01


def test_a_normal_map_of_one_tilt_is_a_plane_with_tilted_normals() -> None:
    """Lit by a sky that is bright above alone, tilts of four directions shade differently.

    Normals of vertices stand for a smooth surface, so that light is made up for which the triangle's own plane
    hides: (1 + the tilt's cosine) / 2 is left of it [`shading_cosine`]. A normal map is what glTF says it is.
    """
    sky = Sky(np.full(3, 4.0), np.zeros(3))
    for tilt in ([0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8], [-0.48, 0.36, 0.8]):
        stored = (np.array(tilt) + 1) / 2
        texture = Texture("tilt", np.broadcast_to(stored, (2, 2, 3)).astype(np.float32))
        mapped = front(replace(GREY, normal_texture=TextureSlot(0)), texture)
        tilted = front(GREY, mesh=replace(quad(FRONT), normals=np.tile(np.array(tilt, float), (4, 1))))
        a, b = (picture(replace(s, sky=sky), 64) for s in (mapped, tilted))
        print(tilt, a.mean(), b.mean())
        apart = np.abs(a * 2 / (1 + tilt[2]) - b)
        assert np.median(apart) < 1e-6
        assert apart.max() < 2e-3  # where a normal looks away from the eye it is turned, and hides otherwise
    half = replace(GREY, normal_texture=TextureSlot(0), normal_scale=0.0)
    flat, plain = (picture(replace(s, sky=sky), 16) for s in (front(half, texture), front(GREY)))
    assert np.abs(flat - plain).max() < 1e-4


LAMPS: dict[str, dict[str, Any]] = {
    "rays": {"integrator": "path", "guide": "cosine", "max_depth": 3},
    "scans": {"integrator": "path-buffer", "max_depth": 3},
    "gather": {"integrator": "gather"},
    "classic": {"integrator": "classic"},
}


@pytest.mark.parametrize("engine", LAMPS)
def test_a_picture_that_shines_is_lamps_of_its_colours(engine: str) -> None:
    image = np.random.default_rng(2).uniform(0, 1, (3, 3, 3)).astype(np.float32)
    size, height, n = 0.6, 1.0, 3
    shining = replace(BLACK, emission_texture=TextureSlot(0))
    screen = lamp(level(height, size, down=True), 0)
    many = []
    mesh = level(height, size, down=True, parts=n)
    for k in range(n * n):
        row, column = divmod(k, n)
        gone = np.repeat(np.arange(n * n) != k, 2)
        many.append(lamp(mesh.without_faces(gone), 0, 5.0 * image[n - 1 - row, column]))
    view = camera([0, 0.35, 3.0], [0, 0.3, 0], 50)
    floor = Shape("floor", level(0.0, 1.5), 1)
    texture = Texture("screen", image, filter="nearest")
    one = scene_of([floor, screen], [shining, GREY], view, (texture,))
    several = scene_of([floor, *many], [BLACK, GREY], view)
    a, b = (picture(s, 256, **LAMPS[engine]) for s in (one, several))
    print(engine, a.mean(axis=(0, 1)), b.mean(axis=(0, 1)))
    assert a.mean(axis=(0, 1)) == pytest.approx(b.mean(axis=(0, 1)), rel=0.02)
    lit = slice(20, 30)  # the floor below
    # The noise of shared directions does not average out over pixels.
    rel = 0.06 if engine == "scans" else 0.02
    assert a[lit].mean(axis=(0, 1)) == pytest.approx(b[lit].mean(axis=(0, 1)), rel=rel)


METAL = Material("metal", np.array([0.9, 0.6, 0.3]), roughness=0.4, metallic=0.7)
GLASS = Material("glass", np.array([0.9, 0.6, 0.3]), roughness=0.4, transmission=0.6)
CONSTANT = {
    "roughness and metallic": (
        replace(METAL, roughness=0.8, metallic=1.0, surface_texture=TextureSlot(0)),
        (0.2, 0.5, 0.7),
        METAL,
    ),
    "transmission": (
        replace(GLASS, transmission=1.0, transmission_texture=TextureSlot(0)),
        (0.6, 0.1, 0.2),
        GLASS,
    ),
}


@pytest.mark.parametrize("name", CONSTANT)
def test_a_texture_of_one_value_is_the_plain_material(name: str) -> None:
    textured, value, plain = CONSTANT[name]
    texture = Texture("value", np.broadcast_to(np.array(value, np.float32), (2, 2, 3)).copy())
    sky = Sky(np.full(3, 4.0), np.zeros(3), up=np.array([0.6, 0.8, 0.0]))
    a, b = (picture(replace(s, sky=sky), 64) for s in (front(textured, texture), front(plain)))
    print(name, a.mean(), b.mean(), np.abs(a - b).max())
    assert np.abs(a - b).mean() < 1e-3 * b.mean()


def test_a_solver_knows_what_each_triangle_reflects_and_each_element_sends() -> None:
    image = np.zeros((2, 2, 3), np.float32)
    image[:, 1] = 0.8  # the right half
    texture = Texture("half", image, filter="nearest")
    painted, shining = replace(WHITE, texture=TextureSlot(0)), replace(BLACK, emission_texture=TextureSlot(0))
    scene = scene_of(
        [Shape("wall", quad(FRONT, 2), 0), lamp(quad(FRONT + np.array([0, 0, 1])), 1)],
        [painted, shining],
        camera([0, 0, 4]),
        (texture,),
    )
    found = scene.side_reflectance[0, :8, 0]
    assert sorted(found.round(6)) == [0.0] * 4 + [0.8] * 4
    elements = Elements.of_lattices(np.full(10, 4))
    sides = Sides.of(scene, elements)
    areas = scene.areas[elements.triangle[sides.element]] / 16
    assert (sides.emission[:, 0] * areas).sum() == pytest.approx(np.pi * 5 * 0.4 * 4, rel=0.01)


def test_many_triangles_with_fine_textures_have_fewer_points_and_the_same_means(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fine = np.kron(random_image(16, 16), np.ones((16, 16, 1), np.uint8))
    scene = front(replace(WHITE, texture=TextureSlot(0)), Texture("fine", fine, srgb=True))
    exact = scene.side_reflectance[0]
    monkeypatch.setattr("glpath.scene.appearance._ALL_POINTS", 256 * len(exact))
    look_up, points = texture_at, []

    def counted(texture: Texture, uv: Float64) -> Float64:
        points.append(len(uv))
        return look_up(texture, uv)

    monkeypatch.setattr("glpath.scene.appearance.texture_at", counted)
    found = replace(scene).side_reflectance[0]
    print(len(exact), exact, found, points)
    assert max(points) <= 256 * len(exact)
    np.testing.assert_allclose(found, exact, rtol=0.02)


def test_what_sides_reflect_is_found_once_in_a_gather(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solver, guides and look-ups ask for it, and it takes seconds of a room with textures."""
    asked = []
    find = Appearance.side_reflectance

    def counted(self: Appearance) -> NDArray[np.float64]:
        asked.append(self.scene)
        return find(self)

    monkeypatch.setattr(Appearance, "side_reflectance", counted)
    scene = front(replace(WHITE, texture=TextureSlot(0)), Texture("random", random_image(), srgb=True))
    glpath.render(scene, integrator="gather", spp=1)
    assert len(asked) == 1
    with pytest.raises(ValueError, match="read-only"):
        scene.side_reflectance[0] = 0
    dimmed = replace(scene, materials=tuple(replace(m, reflectance=0.5 * m.reflectance) for m in scene.materials))
    np.testing.assert_allclose(dimmed.side_reflectance, 0.5 * scene.side_reflectance)
    assert "side_reflectance" not in vars(pickle.loads(pickle.dumps(scene)))


def test_textures_beyond_what_the_device_may_take_name_the_largest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.gl.texture_images.MAX_TEXTURE_BYTES", 1000)
    small, large = Texture("small", random_image(2, 2)), Texture("large", random_image(9, 9).astype(np.float32))
    materials = [replace(WHITE, texture=TextureSlot(i)) for i in range(2)]
    scene = scene_of(
        [Shape("a", quad(FRONT), 0), Shape("b", level(-0.5), 1)],
        materials,
        camera([0, 0, 1]),
        (small, large),
        sky=SKY,
    )
    with pytest.raises(SceneError, match=r'2 textures of .* the largest is "large", 9 x 9 texels'):
        glpath.render(scene, spp=1)


def test_exact_spheres_have_one_set_of_texture_coordinates() -> None:
    material = replace(WHITE, texture=TextureSlot(0, uv_set=1))
    scene = scene_of(
        [Shape("ball", "sphere", 0)], [material], camera([0, 0, 3]), (Texture("t", random_image()),), sky=SKY
    )
    with pytest.raises(SceneError, match=r'"ball" is an exact sphere, which has one set'):
        glpath.render(scene, integrator="t-buffer", spp=1)
    with pytest.raises(SceneError, match=r"no texture coordinates `uv1`"):
        glpath.render(scene, spp=1)


def test_a_preview_looks_through_what_is_mostly_clear_and_sees_colours_of_vertices() -> None:
    red = replace(quad(FRONT), colours=np.tile([1.0, 0.0, 0.0, 1.0], (4, 1)))
    veil = Shape("veil", quad(0.5 * FRONT + [0, 0, 0.3]), 1)
    for opacity, green in ((0.2, 0), (0.9, 1)):
        materials = [WHITE, replace(GREY, alpha="blend", opacity=opacity)]
        scene = scene_of([Shape("back", red, 0), veil], materials, camera([0, 0, 1], fov=90, pixels=PIXELS))
        middle = scene.preview(PIXELS)[PIXELS // 2, PIXELS // 2]
        assert (middle[1] > 0) == bool(green)
        assert middle[0] > 0


def test_what_is_unlit_shows_its_emission_times_its_colours_and_reflects_nothing() -> None:
    colours = np.tile([0.25, 0.5, 1.0, 1.0], (4, 1))
    mesh = replace(quad(FRONT), colours=colours)
    scene = front(replace(WHITE, unlit=True), mesh=mesh)
    glowing = replace(scene, shapes=(replace(scene.shapes[0], emission=np.array([2.0, 2.0, 4.0])),))
    assert not picture(scene, spp=4).any()
    np.testing.assert_allclose(
        picture(glowing, spp=4), np.broadcast_to([0.5, 1.0, 4.0], (PIXELS, PIXELS, 3)), rtol=1e-5
    )
