"""Energy and reciprocity of every lobe, as the shader makes it of a material and evaluates it: the one by
tests/reference/bsdf_read.frag, the other by bsdf_probe.comp.

Two are not reciprocal by definition: what a varnish takes from under it goes by the angle to the eye alone
[KHR_materials_clearcoat], and Phong's highlight has no cosine in it [TB IV].
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
import glpath.gl.program as program
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.material_texels import material_variants
from glpath.gl.passes import Pass
from glpath.scene import path_traceable
from glpath.scene.model import Float64, Material
from tests.support.repository import TESTS
from tests.support.uniform_sky import furnace, plane_under_the_sky

#: Surfaces of Mitsuba's files, and what Mitsuba evaluates.
MITSUBAS = json.loads((TESTS / "data" / "mitsuba_bsdfs.json").read_text())
LOBES = ("diffuse", "microfacets", "coat", "through", "all", "mirrored")
GOLD = np.array([1.0, 0.8, 0.4])
COPPER_N, COPPER_K = [0.201, 0.924, 1.102], [3.913, 2.453, 2.142]


@pytest.fixture(scope="module")
def probe(tmp_path_factory: pytest.TempPathFactory) -> Iterator[program.Program]:
    folder = tmp_path_factory.mktemp("shaders")
    shutil.copytree(program.shader_folder(), folder, dirs_exist_ok=True)
    for name in ("bsdf_probe.comp", "bsdf_read.frag"):
        shutil.copy(TESTS / "reference" / name, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(program, "shader_folder", lambda: folder)
        yield program.load_program(get_context().gl, compute="bsdf_probe.comp")


def as_shaded(m: Material, front: bool = True) -> NDArray[np.float32]:
    """What the shader's `bsdf_at` makes of a material, in the order of the probe. Needs the folder of `probe`."""
    gl = get_context().gl
    with DeviceScene(gl, path_traceable(plane_under_the_sky(m, 0.9))) as device:
        read = program.load_program(
            gl,
            vertex="gl/fullscreen.vert",
            fragment="bsdf_read.frag",
            generated=device.generated,
            defines=device.defines,
        )
        target = gl.framebuffer([gl.texture((17, 1), 4, dtype="f4")])
        known = {**device.uniforms, "from_front": int(front)}
        Pass("what is read of a material", gl, read, target, textures=device.textures).run(known)
        return np.frombuffer(target.read(components=4, dtype="f4"), np.float32)


def evaluate(probe: program.Program, values: NDArray[np.float32], wo: Float64, wi: Float64) -> dict[str, Float64]:
    """Of each lobe f and density, (N, 4) float64; of "mirrored" shares and what the varnish takes."""
    gl = get_context().gl
    wo, wi = np.broadcast_arrays(wo, wi)
    pairs = np.zeros((len(wo), 2, 4), np.float32)
    pairs[:, 0, :3], pairs[:, 1, :3] = wo, wi
    buffers = [gl.buffer(each.tobytes()) for each in (values, pairs)]
    out = gl.buffer(reserve=16 * len(LOBES) * len(wo))
    for i, buffer in enumerate((*buffers, out)):
        buffer.bind_to_storage_buffer(i)
    probe.gl.run(group_x=-(-len(wo) // 64))  # type: ignore[union-attr]
    gl.memory_barrier()
    found = np.frombuffer(out.read(), np.float32).reshape(len(wo), len(LOBES), 4).astype(float)
    for buffer in (*buffers, out):
        buffer.release()
    return {name: found[:, i] for i, name in enumerate(LOBES)}


def directions(n: int, seed: int, below: bool = False) -> Float64:
    """(n, 3), not quite at grazing incidence, where float32 has few digits left."""
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(0.03, 1.0, n), rng.uniform(0, 2 * np.pi, n)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), -z if below else z], axis=1)


WHITE = np.ones(3)
SURFACES: dict[str, Material] = {
    "lambert": Material("m", GOLD),
    "metal": Material("m", GOLD, roughness=0.4, metallic=1.0),
    "brushed": Material("m", GOLD, roughness=0.3, metallic=1.0, anisotropy=0.7),
    "plastic": Material("m", GOLD, roughness=0.3),
    "half-metal": Material("m", GOLD, roughness=0.6, metallic=0.5),
    "specular": Material(
        "m", GOLD, roughness=0.5, ior=2.0, specular_weight=0.6, specular_colour=np.array([1.0, 4, 9])
    ),
    "sheen": Material(
        "m", GOLD, roughness=0.5, specular_weight=0.0, sheen=np.array([0.9, 0.5, 0.2]), sheen_roughness=0.4
    ),
    "varnish": Material(
        "m", np.zeros(3), roughness=0.5, specular_weight=0.0, clearcoat=0.8, clearcoat_roughness=0.4
    ),
    "frosted-pane": Material("m", GOLD, roughness=0.5, transmission=1.0),
    "half-glass": Material("m", GOLD, roughness=0.5, transmission=0.5),
    "frosted-glass": Material("m", GOLD, roughness=0.5, transmission=1.0, thin=False),
    "beckmann": Material("m", GOLD, roughness=0.6, metallic=1.0, distribution="beckmann"),
    "beckmann-brushed": Material("m", GOLD, roughness=0.4, metallic=1.0, anisotropy=0.5, distribution="beckmann"),
    "beckmann-glass": Material("m", GOLD, roughness=0.5, transmission=1.0, thin=False, distribution="beckmann"),
    "beckmann-pane": Material("m", GOLD, roughness=0.5, transmission=1.0, distribution="beckmann"),
    "copper": Material(
        "m", np.array([0.95, 0.62, 0.51]), roughness=0.5, metallic=1.0, metal_index=np.array([COPPER_N, COPPER_K])
    ),
    "rough-plastic": Material("m", GOLD, roughness=0.5, layering="plastic"),
    "smooth-plastic": Material("m", GOLD, roughness=0.0, layering="plastic"),
    "beckmann-plastic": Material("m", GOLD, roughness=0.5, layering="plastic", distribution="beckmann"),
    "disney": Material("m", GOLD, roughness=0.5, metallic=0.3, anisotropy=0.6, layering="disney"),
}
# What they scatter more than once is in no lobe that has a partner: tests/pictures/test_kept_energy.py.
SURFACES = {name: replace(material, multiple_scattering=False) for name, material in SURFACES.items()}


@pytest.mark.parametrize("name", [name for name in SURFACES if name != "sheen"])
def test_every_lobe_is_reciprocal(probe: program.Program, name: str) -> None:
    values = as_shaded(SURFACES[name])
    wo, wi = directions(4000, 1), directions(4000, 2)
    there, back = (evaluate(probe, values, *pair) for pair in ((wo, wi), (wi, wo)))
    for lobe in ("diffuse", "microfacets", "coat", "all"):
        np.testing.assert_allclose(there[lobe][:, :3], back[lobe][:, :3], rtol=2e-4, atol=1e-6)
    assert there["all"][:, :3].max() > 0


@pytest.mark.parametrize(
    ("name", "ior"),
    [
        ("frosted-pane", 1.5),
        ("half-glass", 1.5),
        ("frosted-glass", 1.5),
        ("frosted-glass", 2.4),
        ("beckmann-glass", 1.5),
    ],
)
def test_what_goes_through_is_reciprocal(probe: program.Program, name: str, ior: float) -> None:
    """Of a pane as it is. Of a solid with the square of the index: f_s(wi to wo) / eta_o² = f_s(wo to wi) / eta_i²,
    and the shader's f, of radiance over the square of the index, is f_s eta_i² / eta_o²."""
    material = replace(SURFACES[name], ior=ior)
    wo, wi = directions(4000, 3), directions(4000, 4, below=True)
    there = evaluate(probe, as_shaded(material), wo, wi)["through"][:, :3]
    # From the back the surface's own z is on the other side.
    turned = np.array([1.0, -1.0, -1.0])
    back = evaluate(probe, as_shaded(material, front=False), wi * turned, wo * turned)["through"][:, :3]
    seen = there.max(axis=1) > 1e-6
    assert seen.mean() > (0.2 if material.thin else 0.02)
    np.testing.assert_allclose(there, back * (1.0 if material.thin else ior**2), rtol=5e-3, atol=2e-4)


def test_the_two_that_are_not_reciprocal_are_so_as_they_are_defined(probe: program.Program) -> None:
    wo, wi = directions(1000, 5), directions(1000, 6)
    varnished = as_shaded(Material("m", GOLD, roughness=0.5, clearcoat=0.8, clearcoat_roughness=0.4))
    there, back = (evaluate(probe, varnished, *pair) for pair in ((wo, wi), (wi, wo)))
    for lobe in ("diffuse", "microfacets"):
        left = 1 - there["mirrored"][:, 3:], 1 - back["mirrored"][:, 3:]
        np.testing.assert_allclose(there[lobe][:, :3] * left[1], back[lobe][:, :3] * left[0], rtol=2e-4, atol=1e-6)
    phong = as_shaded(Material("m", np.zeros(3), specular=GOLD, exponent=20.0))
    there, back = (evaluate(probe, phong, *pair) for pair in ((wo, wi), (wi, wo)))
    np.testing.assert_allclose(
        there["diffuse"][:, :3] * wi[:, 2:], back["diffuse"][:, :3] * wo[:, 2:], rtol=2e-4, atol=1e-6
    )


@pytest.mark.parametrize("case", MITSUBAS, ids=lambda case: case["name"])
def test_surface_of_a_mitsuba_file_sends_light_as_mitsuba_says(
    probe: program.Program, case: dict[str, Any], tmp_path: Path
) -> None:
    """Values of Mitsuba 3.9.1, scalar_rgb: `bsdf.eval` over the cosine, times pi; rows of wo, wi and the value."""
    path = tmp_path / "a.xml"
    shape = f'<shape type="sphere">{case["xml"]}</shape>'
    path.write_text(f'<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>{shape}</scene>')
    (material,) = glpath.load_scene(path).materials
    pairs = np.array(case["pairs"])
    wo, wi, expected = pairs[:, :3], pairs[:, 3:6], pairs[:, 6:]
    found = evaluate(probe, as_shaded(material), wo, wi)
    # Mitsuba's radiance changes by the square of the index at a boundary, which is left out here.
    sent = np.where(wi[:, 2:] > 0, found["all"], found["through"] / material.ior**2)[:, :3]
    np.testing.assert_allclose(sent, expected, rtol=5e-3, atol=2e-4)


def albedo(probe: program.Program, values: NDArray[np.float32], cosine: float, below: bool = False) -> Float64:
    """(3,) of light from everywhere on one side that is sent to the eye at this cosine, by the midpoint rule."""
    n = 400
    z, phi = np.meshgrid((np.arange(n) + 0.5) / n, 2 * np.pi * (np.arange(n) + 0.5) / n, indexing="ij")
    z = np.sin(0.5 * np.pi * z)  # finer at grazing incidence is not needed, where the cosine is small
    r = np.sqrt(1 - z * z)
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), -z if below else z], axis=-1).reshape(-1, 3)
    weight = (z * np.sqrt(1 - z * z)).ravel() * (0.5 * np.pi / n) * (2 * np.pi / n)
    wo = np.array([[np.sqrt(1 - cosine**2), 0.0, cosine]])
    found = evaluate(probe, values, wo, wi)["through" if below else "all"][:, :3]
    return np.asarray((found * weight[:, None]).sum(axis=0) / np.pi)


@pytest.mark.parametrize("cosine", [0.9, 0.4])
@pytest.mark.parametrize(
    "name",
    [
        *("lambert", "metal", "plastic", "half-metal", "specular", "sheen", "varnish", "frosted-pane"),
        *("beckmann", "beckmann-brushed", "beckmann-pane", "copper", "rough-plastic", "beckmann-plastic"),
        "disney",
    ],
)
def test_a_surface_in_a_furnace_sends_back_what_its_lobes_add_up_to(
    probe: program.Program, name: str, cosine: float
) -> None:
    """Within 1 %: so lobes are sampled as they are evaluated, their choice, masking and shares included."""
    values, material = as_shaded(SURFACES[name]), SURFACES[name]
    expected = albedo(probe, values, cosine)
    if material.transmission > 0:
        expected = expected + albedo(probe, values, cosine, below=True)
    assert expected.max() <= (1.06 if name in ("plastic", "disney") else 1.001)  # see the last test
    found = glpath.render(plane_under_the_sky(material, cosine), spp=256, max_depth=4).mean.mean(axis=(0, 1))
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=1e-3)


def fresnel(cosine: Any, index: Any) -> Any:
    """Of unpolarized light from air, by the complex index."""
    inside = np.sqrt(np.asarray(index, complex) ** 2 - (1 - cosine**2))
    across = np.abs((cosine - inside) / (cosine + inside)) ** 2
    along = np.abs((index**2 * cosine - inside) / (index**2 * cosine + inside)) ** 2
    return 0.5 * (across + along)


@pytest.mark.parametrize("cosine", [0.9, 0.4, 0.15])
def test_smooth_surfaces_of_fresnels_equations_in_a_furnace(cosine: float) -> None:
    """Metal reflects F; a sheet of clear glass 2 F / (1 + F); plastic F, and its base the rest times its albedo."""
    index = np.array(COPPER_N) + 1j * np.array(COPPER_K)
    common: dict[str, Any] = {"roughness": 0.0, "multiple_scattering": False}
    copper = Material("m", fresnel(1.0, index), metallic=1.0, metal_index=np.array([COPPER_N, COPPER_K]), **common)
    F = fresnel(cosine, 1.5)
    sheet, plastic = (
        Material("m", GOLD, layering="plastic", ior=1.5, transmission=transmission, **common)
        for transmission in (1.0, 0.0)
    )
    for material, expected in (
        (copper, fresnel(cosine, index)),
        (sheet, 2 * F / (1 + F) + (1 - F) / (1 + F) * GOLD),
        (plastic, F + (1 - F) * GOLD),
    ):
        found = glpath.render(plane_under_the_sky(material, cosine), spp=256, max_depth=4).mean.mean(axis=(0, 1))
        np.testing.assert_allclose(found, expected, rtol=0.005)


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize(("weight", "colour"), [(1.0, 1.0), (0.3, 1.0), (0.6, 3.0), (0.0, 1.0)])
def test_solid_glass_reflects_by_its_weight_and_colour(
    probe: program.Program, weight: float, colour: float, front: bool
) -> None:
    """KHR_materials_specular: 4 % times both at normal incidence, the weight at grazing; between them by Fresnel.

    Beyond the critical angle all light is reflected.
    """
    tint = np.full(3, colour)
    glass = Material(
        "m", WHITE, roughness=0.0, transmission=1.0, thin=False, specular_weight=weight, specular_colour=tint
    )
    cosine = np.array([1.0, 0.8, 0.5, 0.1])
    wo = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=1)
    found = evaluate(probe, as_shaded(replace(glass, multiple_scattering=False), front), wo, wo)["mirrored"][:, 0]
    F = fresnel(cosine, 1.5 if front else 1 / 1.5)
    expected = weight * (0.04 * colour + (1 - 0.04 * colour) * (F - 0.04) / 0.96)
    np.testing.assert_allclose(found, np.where(F < 1 - 1e-9, expected, 1.0), rtol=1e-4, atol=1e-6)


def test_only_solid_glass_with_a_factor_has_the_shader_for_it() -> None:
    glass = Material("m", WHITE, roughness=0.0, transmission=1.0, thin=False)
    variants = (glass, replace(glass, thin=True, specular_weight=0.5), replace(glass, specular_weight=0.5))
    assert [material_variants([m])["HAS_GLASS_SPECULAR"] for m in variants] == [False, False, True]


WHITES: dict[str, dict[str, Any]] = {
    "lambert": {},
    "mirror": {"reflectance": np.zeros(3), "mirror": WHITE},
    "half-mirror": {"reflectance": np.full(3, 0.3), "mirror": np.full(3, 0.7)},
    "smooth metal": {"roughness": 0.0, "metallic": 1.0},
    "metal": {"roughness": 0.15, "metallic": 1.0},
    "brushed metal": {"roughness": 0.1, "metallic": 1.0, "anisotropy": 0.1},
    "varnished metal": {"roughness": 0.1, "metallic": 1.0, "clearcoat": 1.0},
    "pane": {"roughness": 0.0, "transmission": 1.0},
    "pane of half": {"roughness": 0.0, "transmission": 0.5, "specular_weight": 0.0},
    "glass": {"roughness": 0.0, "transmission": 1.0, "thin": False},
    "frosted pane": {"roughness": 0.15, "transmission": 1.0},
    "frosted glass": {"roughness": 0.1, "transmission": 1.0, "thin": False},
    "sheen": {"roughness": 0.7, "specular_weight": 0.0, "sheen": WHITE, "sheen_roughness": 0.3},
    "rough sheen": {"roughness": 0.7, "specular_weight": 0.0, "sheen": WHITE, "sheen_roughness": 1.0},
    "no reflection over the base": {"roughness": 0.7, "specular_weight": 0.0},
}


@pytest.mark.filterwarnings("ignore:.*reflects all light")
@pytest.mark.parametrize("name", WHITES)
def test_what_is_white_vanishes_in_a_furnace(name: str) -> None:
    """All of the light comes back, within 1 %."""
    made: dict[str, Any] = {"reflectance": WHITE, **WHITES[name]}
    film = glpath.render(furnace(Material("m", **made), 24), spp=64, max_depth=40)
    assert film.mean.mean() == pytest.approx(1.0, abs=0.01)
    seen = np.asarray(film.mean)[8:16, 8:16]
    np.testing.assert_allclose(seen.mean(), 1.0, atol=0.01)


def test_a_dielectric_over_white_has_the_energy_that_gltfs_formulas_give_it(probe: program.Program) -> None:
    """What the base is given goes by the microfacet of the half vector, which at grazing incidence is not the one
    that mirrors: a smooth dielectric over a quite white base sends back 3 % too much of light from everywhere, a
    rough one 3 % too little, as in other programs that go by glTF 2.0, B.2."""
    cosines = (np.arange(8) + 0.5) / 8
    for roughness, off in ((0.3, 0.03), (0.6, 0.0), (1.0, -0.0266)):
        values = as_shaded(Material("m", WHITE, roughness=roughness))
        sent = [albedo(probe, values, cosine)[0] for cosine in cosines]
        assert 2 * np.mean(cosines * sent) - 1 == pytest.approx(off, abs=0.003)
