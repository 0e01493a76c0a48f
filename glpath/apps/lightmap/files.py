"""Baked scenes as .glb: unlit with base colour times light, or original materials with a separate light map."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.pages import pages_of
from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.errors import SceneError, warn
from glpath.film.exr import write_exr
from glpath.film.image import encode_png
from glpath.io.export import gltf_json
from glpath.io.export.geometry import behind, listed
from glpath.io.export.glb import Glb
from glpath.io.export.gltf import write_gltf
from glpath.scene.appearance import Appearance, texture_at
from glpath.scene.geometry import Mesh, Shape, Shapes
from glpath.scene.material import Material, averaged
from glpath.scene.model import Float64, Scene
from glpath.system.colour import encode_srgb
from glpath.system.files import replacing_links, write_bytes
from glpath.system.units import symbol

if TYPE_CHECKING:
    from glpath.apps.lightmap.atlas import Atlas

#: Maximum number of samples over which the base colour of a texel is averaged.
_COLOUR_SAMPLES = 5
#: Value of `metallic` above which the warning calls a material metal.
_METAL = 0.99


def write_unlit(
    surfaces: AtlasSurfaces,
    irradiance: NDArray[np.float32],
    path: Path,
    exposure: float,
    extras: Mapping[str, Any],
) -> list[Path]:
    """Write the scene with unlit materials, whose colour is the baked light; see `Lightmap.save`.

    irradiance : (P, h, w, 3) light of the pages
    exposure   : exposure in stops
    extras     : description to store with the exposure
    """
    scene, atlas = surfaces.scene, surfaces.atlas
    _warn_of_what_is_left_out(scene, path)
    radiance, opacity = radiance_of(surfaces, irradiance)
    colours = np.round(255 * encode_srgb(np.clip(radiance * 2.0**exposure, 0.0, 1.0))).astype(np.uint8)
    alpha = np.round(255 * np.clip(opacity, 0.0, 1.0)).astype(np.uint8)
    file = Glb(scene)
    file.samplers.append(
        gltf_json.Sampler(
            mag_filter=gltf_json.LINEAR,
            min_filter=gltf_json.LINEAR_MIPMAP_LINEAR,
            wrap_s=gltf_json.CLAMP_TO_EDGE,
            wrap_t=gltf_json.CLAMP_TO_EDGE,
        )
    )
    for page in range(atlas.pages):
        clear = bool((alpha[page] < 255).any())
        image = np.concatenate([colours[page], alpha[page]], axis=-1) if clear else colours[page]
        name = f"light {page}"
        file.textures.append(gltf_json.Texture(name=name, sampler=0, source=file.add_image(name, image)))
    materials: dict[tuple[int, str, float, bool], int] = {}
    for number, shape in enumerate(scene.shapes):
        material = scene.materials[shape.material]
        mode = "blend" if material.clear > 0 else material.alpha
        primitives = []
        for page, mesh in _parts(scene, atlas, number):
            # Coordinates kept from the file cover one side of a triangle, so a two-sided material shows its light
            # on the other side, too.
            key = page, mode, material.cutoff, atlas.of_file and material.two_sided
            if key not in materials:
                materials[key] = len(file.materials)
                file.materials.append(_unlit(file, *key))
            assert mesh.uv1 is not None
            attributes = {
                "POSITION": file.add_array(mesh.vertices.astype(np.float32), bounds=True),
                "TEXCOORD_0": file.add_array((mesh.uv1 * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32)),
            }
            indices = file.add_array(mesh.faces.astype(np.uint32).ravel(), indices=True)
            primitives.append(gltf_json.Primitive(attributes=attributes, indices=indices, material=materials[key]))
        if primitives:
            file.add_node(shape.name, mesh=file.add_mesh(shape.name, primitives))
    file.save(path, exposure_stops=exposure, **extras)
    return [path]


def write_kept(
    surfaces: AtlasSurfaces,
    irradiance: NDArray[np.float32],
    path: Path,
    quality: Mapping[str, Any],
    moz: bool,
) -> list[Path]:
    """Write the scene with its original materials, and the light maps beside it; see `Lightmap.save`.

    irradiance : (P, h, w, 3) light of the pages
    quality    : values of `Lightmap.quality`
    """
    scene, atlas = surfaces.scene, surfaces.atlas
    ranges = [max(float(page.max()), 1e-9) for page in irradiance]
    pictures = [
        np.round(255 * np.clip(page / range_, 0.0, 1.0)).astype(np.uint8)
        for page, range_ in zip(irradiance, ranges, strict=True)
    ]
    shapes, page_of = [], []
    materials = [_with_first_uv(material) for material in scene.materials]
    for number, shape in enumerate(scene.shapes):
        moved = materials[shape.material] is not scene.materials[shape.material]
        for side in range(2):
            name = f"{shape.name} (back)" if side else shape.name
            for page, mesh in _parts(scene, atlas, number, side, uv_set=1 if moved else 0):
                emits = shape.emits and (not side or shape.emission_two_sided)
                emission = shape.emission if emits else np.zeros(3)
                # Coordinates kept from the file cover one side of a triangle, whose mesh stands for both sides.
                both = atlas.of_file and shape.emission_two_sided
                shapes.append(
                    Shape(name, mesh, shape.material, emission=emission, emission_two_sided=both, kind="mesh")
                )
                page_of.append(page)
    shapes = _named_by_page(shapes, page_of)
    if not atlas.of_file:
        materials = [replace(material, two_sided=False) for material in materials]
    made = replace(
        scene, shapes=Shapes(shapes), materials=tuple(materials), sky=None, ambient=np.zeros(3), lights=()
    )
    # With this unit, `write_gltf` does not convert emission, so that it keeps the unit of the light map.
    made = replace(made, unit="photometric")
    _warn_of_what_is_black(scene, path)
    notes = write_gltf(made, path, [(pictures[page], ranges[page]) for page in page_of] if moz else None)
    for text in notes:
        warn(f"{path}: {text}.", late=True)
    for page, (light, picture, range_) in enumerate(zip(irradiance, pictures, ranges, strict=True)):
        header = {
            "quantity": "irradiance",
            "unit": symbol(scene.unit, "irradiance"),
            "primaries": "linear Rec. 709",
        }
        about_page = {"texCoord": "1", "page": str(page), "denoised": str(quality["denoised"]).lower()}
        exr, png, about_file = page_files(path, page)
        about = header | {"range": range_, "encoding": "linear: irradiance = range * value / 255", "texCoord": 1}
        about |= quality
        about["shapes"] = sorted({s.name for s, p in zip(shapes, page_of, strict=True) if p == page})
        with replacing_links():
            write_exr(exr, light, header | about_page)
            write_bytes(encode_png(picture), png)
            write_bytes((json.dumps(about, indent=2) + "\n").encode(), about_file)
    return [path, *(file for page in range(atlas.pages) for file in page_files(path, page))]


def page_files(path: Path, page: int) -> list[Path]:
    """Return the .exr, .png and .json files of a page's light map, which `write_kept` writes beside `path`."""
    return [path.with_name(f"{path.stem}-{page}.lightmap.{suffix}") for suffix in ("exr", "png", "json")]


def _named_by_page(shapes: list[Shape], page_of: list[int]) -> list[Shape]:
    """Return the shapes; if a name occurs on several pages, the page number is appended to it."""
    pages: dict[str, set[int]] = {}
    for shape, page in zip(shapes, page_of, strict=True):
        pages.setdefault(shape.name, set()).add(page)
    return [
        replace(shape, name=f"{shape.name} (page {page})") if len(pages[shape.name]) > 1 else shape
        for shape, page in zip(shapes, page_of, strict=True)
    ]


def _parts(
    scene: Scene, atlas: Atlas, number: int, side: int | None = None, uv_set: int | None = None
) -> list[tuple[int, Mesh]]:
    """Return a shape's meshes in world space, one for each page, with the atlas as second texture coordinates.

    If both sides of a triangle have texels, the back is shifted a little behind the front, see `behind`.

    side   : only this side; None: both
    uv_set : keep all vertex attributes and this set (0 or 1) of the scene's texture coordinates; None: keep none
    """
    shapes, attributes = scene.shapes, uv_set is not None
    part = scene.shapes.ranges[number]
    of_shape = (atlas.triangle >= part.start) & (atlas.triangle < part.stop)
    if side is not None:
        of_shape &= atlas.side == side
    made = []
    mesh = scene.shapes[number].geometry
    assert isinstance(mesh, Mesh)
    texture = mesh.uv1 if uv_set else mesh.uv
    both = (np.bincount(atlas.triangle, minlength=len(scene.triangles)) == 2)[atlas.triangle]
    away = np.where((both & (atlas.side == 1))[:, None, None], behind(scene) * atlas.corner_normals(scene), 0.0)
    for page in np.unique(atlas.page[of_shape]):
        faces = np.flatnonzero(of_shape & (atlas.page == page))
        back = atlas.side[faces] == 1
        uv = atlas.uv[faces] / atlas.size * [1.0, -1.0] + [0.0, 1.0]
        vertices = scene.shapes.faces[atlas.triangle[faces]]
        order = np.where(back[:, None], [2, 1, 0], [0, 1, 2])
        row = np.arange(len(faces))[:, None]
        corners = vertices[row, order].ravel()

        def selected(values: Float64, wanted: bool, corners: NDArray[np.int32] = corners) -> Float64 | None:
            return values[corners] if wanted else None

        normals = selected(scene.shapes.vertex_normals, attributes and mesh.normals is not None)
        if normals is not None:
            normals = np.where(np.repeat(back, 3)[:, None], -normals, normals)
        whole = Mesh(
            scene.shapes.vertices[corners] + away[faces][row, order].reshape(-1, 3),
            np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
            uv=selected(shapes.vertex_uv1 if uv_set else shapes.vertex_uv, attributes and texture is not None),
            normals=normals,
            uv1=uv[row, order].reshape(-1, 2),
            colours=selected(scene.shapes.vertex_colours, attributes and mesh.colours is not None),
        )
        made.append((int(page), whole.welded()))
    return made


def radiance_of(
    surfaces: AtlasSurfaces, irradiance: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return pages of exitant radiance, (P, h, w, 3), W sr^-1 m^-2, and of opacity, (P, h, w, 1).

    irradiance : (P, h, w, 3) light of the pages
    """
    texels, atlas = surfaces.texels, surfaces.atlas
    samples = np.unique(np.linspace(0, len(texels.face) - 1, _COLOUR_SAMPLES).round().astype(int))
    sums = np.zeros((len(texels.row), 7))
    for sample in samples:
        face = texels.face[sample]
        sums += reflected(surfaces.scene, atlas.triangle[face], atlas.side[face], texels.b[sample])
    nothing = np.zeros(len(texels.row), np.bool_)
    pages, _ = pages_of(atlas, texels, sums / len(samples), nothing)
    return pages[..., :3] * irradiance / np.float32(np.pi) + pages[..., 3:6], pages[..., 6:]


def _unlit(file: Glb, page: int, mode: str, cutoff: float, two_sided: bool) -> gltf_json.Material:
    return gltf_json.Material(
        name=f"baked light {page}" + ("" if mode == "opaque" else f" ({mode})"),
        pbr_metallic_roughness=gltf_json.PbrMetallicRoughness(
            metallic_factor=0.0,
            base_color_texture=gltf_json.TextureInfo(index=page),
        ),
        extensions={file.use("KHR_materials_unlit"): {}},
        double_sided=two_sided,
        alpha_mode=mode.upper(),
        alpha_cutoff=cutoff if mode == "mask" else None,
    )


def _warn_of_what_is_left_out(scene: Scene, path: Path) -> None:
    used = {shape.material for shape in scene.shapes}
    shiny: list[str] = []
    rough: list[str] = []
    translucent: list[str] = []
    for i, material in enumerate(scene.materials):
        if i not in used or material.unlit or not (material.has_lobes or np.any(material.specular > 0)):
            continue
        if material.is_matte:
            continue
        metal = material.roughness is not None and material.metallic > _METAL and material.surface_texture is None
        (rough if metal or np.any(material.mirror > 0) else shiny).append(material.name)
        if material.roughness is not None and material.diffuse_transmission > 0:
            translucent.append(material.name)
    for names, text in (
        (shiny, "the diffuse part alone is baked; highlights and glass look different from everywhere."),
        (rough, "metal and mirrors, which look different from everywhere, are baked as if they were rough."),
        (
            translucent,
            "light through it from the other side lights what is around, but is not baked on it.",
        ),
    ):
        if names:
            listing = f"material{'s' * (len(names) > 1)} {listed(names)}"
            warn(f"{path}: {listing}: {text}", late=True)


def _warn_of_what_is_black(scene: Scene, path: Path) -> None:
    """Warn of mirrors and metal, which are black in viewers without an environment map."""
    used = {shape.material for shape in scene.shapes}
    names = [
        m.name
        for i, m in enumerate(scene.materials)
        if i in used and not m.unlit and ((m.roughness is not None and m.metallic > 0.5) or np.any(m.mirror > 0))
    ]
    if names:
        warn(
            f"{path}: material{'s' * (len(names) > 1)} {listed(names)}: mirrors and metal are black in a viewer "
            "without an environment map, as a light map is of what is diffuse alone.",
            late=True,
        )


def check_keepable(scene: Scene) -> None:
    """Raise SceneError, before the bake, for materials that cannot be combined with a light map."""
    for material in scene.materials:
        _with_first_uv(material)


def _with_first_uv(material: Material) -> Material:
    """Return the material with all textures on the first coordinates; the second belong to the light map.

    Raises SceneError if the material uses both.
    """
    sets = {slot.uv_set for slot in material.slots.values()}
    if 1 not in sets:
        return material
    if 0 in sets:
        raise SceneError(
            f'the material "{material.name}" has textures on the first and on the second texture coordinates, so '
            "that there is none left for its light.",
            'Write it with materials "unlit".',
        )
    moved = {name: replace(slot, uv_set=0) for name, slot in material.slots.items()}
    return replace(material, **moved)  # type: ignore[arg-type]


Int64 = NDArray[np.int64]


def reflected(scene: Scene, triangle: Int64, side: Int64, b: Float64) -> Float64:
    """Return (N, 7) reflectance, emission and opacity of triangle sides (N,) at barycentric coordinates (N, 2).

    The base below microfacets reflects the light that the Fresnel layer transmits, averaged over all directions.
    Mirrors and metal, which have no diffuse reflection, count as diffuse surfaces of the same reflectance.
    """
    look = Appearance(scene)
    opacity = look.opacity(triangle, b)
    over = 1.0 / np.where(opacity > 0, opacity, 1.0)[:, None]
    found = np.concatenate(
        [look.reflectance(triangle, b) * over, look.emission(triangle, b) * over, opacity[:, None]], axis=1
    )
    shape_of = scene.triangle_shape[triangle]
    for number in np.unique(shape_of):
        own = np.flatnonzero(shape_of == number)
        shape = scene.shapes[number]
        material = averaged(scene.materials[shape.material], scene.textures)
        if material.roughness is not None:
            # Below, textures of metallic and transmission are looked up at the points, so their means are not used.
            untextured = scene.materials[shape.material]
            metallic = np.full(len(own), untextured.metallic)
            clear = np.full(len(own), untextured.transmission)
            for share, slot, channel in (
                (metallic, material.surface_texture, 2),
                (clear, material.transmission_texture, 0),
            ):
                if slot is not None:
                    share *= texture_at(scene.textures[slot.texture], look.slot_uv(slot, triangle[own], b[own]))[
                        :, channel
                    ]
            coat = material.clearcoat * (0.04 + 0.96 / 21.0)
            glass = (1 - metallic) * clear
            clear = clear + (1 - clear) * material.diffuse_transmission
            found[own, :3] *= ((1 - coat) * (metallic + material.base_share * (1 - metallic) * (1 - clear)))[
                :, None
            ]
            found[own, 6] *= 1 - glass
        else:
            found[own, :3] += material.mirror
        back = own[side[own] == 1]
        if not material.two_sided:
            found[back, :3] = 0.0
        if not shape.emission_two_sided:
            found[back, 3:6] = 0.0
    return found
