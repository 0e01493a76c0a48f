"""Small models of one glTF feature each, in the layout of Khronos' samples: procedural spheres and plates.

    python -m tests.support.sample_models FOLDER

writes FOLDER/Models/NAME/glTF/NAME.gltf, for `python -m benchmarks khronos FOLDER`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glpath.scene.model import Float64
from tests.support.gltf_files import Gltf

#: A plate in the plane z = 0 that faces +z; v increases downwards as in glTF.
PLATE = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
PLATE_UV = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])
TWO = [0, 1, 2, 0, 2, 3]
GOLD = [1.0, 0.77, 0.34, 1.0]


def pbr(colour: Sequence[float] = (0.8, 0.8, 0.8, 1.0), metallic: float = 0.0, roughness: float = 0.5) -> Any:
    return {"baseColorFactor": list(colour), "metallicFactor": metallic, "roughnessFactor": roughness}


def material(base: Any = None, **extensions: Any) -> dict[str, Any]:
    """Return a material; extensions are given by name without KHR_materials_."""
    named = {f"KHR_materials_{name}": fields for name, fields in extensions.items()}
    return {"pbrMetallicRoughness": base or pbr(), **({"extensions": named} if named else {})}


def sphere(file: Gltf, material: int, columns: int = 48, rows: int = 24, **attributes: Any) -> int:
    """Add a mesh of radius 0.45 with normals and texture coordinates; return its number."""
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows)
    theta, phi = np.pi * v.ravel(), 2 * np.pi * u.ravel()
    normals = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=1)
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = number[1:, :-1], number[1:, 1:], number[:-1, 1:], number[:-1, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1)[:-1].reshape(-1, 3), np.stack([a, c, d], -1)[1:].reshape(-1, 3)]
    )
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    return file.mesh(0.45 * normals, faces.ravel(), NORMAL=normals, TEXCOORD_0=uv, material=material, **attributes)


def plate(file: Gltf, material: int, uv: Float64 = PLATE_UV, **attributes: Any) -> int:
    normals = np.tile([0.0, 0, 1], (4, 1))
    return file.mesh(PLATE, TWO, NORMAL=normals, TEXCOORD_0=uv, material=material, **attributes)


def in_a_row(file: Gltf, meshes: Sequence[int], columns: int = 0, **node: Any) -> None:
    """Add nodes beside each other, in rows of `columns`, from the top."""
    columns = columns or len(meshes)
    for i, mesh in enumerate(meshes):
        file.node(mesh=mesh, translation=[i % columns, -(i // columns), 0], **node)


def spheres(*materials: dict[str, Any], columns: int = 0) -> Gltf:
    file = Gltf()
    in_a_row(file, [sphere(file, file.add("materials", **each)) for each in materials], columns)
    return named(file)


def named(file: Gltf) -> Gltf:
    """Add the list of the extensions that the file uses."""
    used = sorted({name for each in file.json.get("materials", []) for name in each.get("extensions", {})})
    used += ["KHR_texture_transform"] * ("KHR_texture_transform" in str(file.json.get("materials", [])))
    if used:
        file.json["extensionsUsed"] = used
    return file


STEPS = (0.0, 0.25, 0.5, 0.75, 1.0)


def metal_rough() -> Gltf:
    return spheres(*(material(pbr(GOLD, m, r)) for m in (1.0, 0.5, 0.0) for r in STEPS), columns=5)


def white_metal() -> Gltf:
    return spheres(*(material(pbr((1, 1, 1, 1), 1.0, r)) for r in STEPS))


def white_dielectric() -> Gltf:
    return spheres(*(material(pbr((0.9, 0.9, 0.9, 1), 0.0, r)) for r in STEPS))


def sheen() -> Gltf:
    colours = ([1.0, 1, 1], [1.0, 0.3, 0.1])
    return spheres(
        *(
            material(pbr((0.1, 0.1, 0.3, 1), 0.0, 1.0), sheen={"sheenColorFactor": c, "sheenRoughnessFactor": r})
            for c in colours
            for r in (0.2, 0.4, 0.6, 0.8, 1.0)
        ),
        columns=5,
    )


def clearcoat() -> Gltf:
    base = pbr((0.6, 0.05, 0.05, 1), 0.5, 0.6)
    return spheres(
        *(
            material(base, clearcoat={"clearcoatFactor": f, "clearcoatRoughnessFactor": r})
            for f in (0.5, 1.0)
            for r in (0.0, 0.2, 0.4, 0.7)
        ),
        columns=4,
    )


def specular() -> Gltf:
    base = pbr((0.3, 0.1, 0.1, 1), 0.0, 0.3)
    weights = [material(base, specular={"specularFactor": f}) for f in (0.0, 0.25, 0.5, 1.0)]
    tints = [
        material(base, specular={"specularColorFactor": c})
        for c in ([0.0, 0, 0], [1.0, 0.2, 0.2], [0.2, 1.0, 0.3], [3.0, 3, 3])
    ]
    return spheres(*weights, *tints, columns=4)


def iridescence() -> Gltf:
    def film(thickness: float) -> dict[str, Any]:
        return {"iridescenceFactor": 1.0, "iridescenceIor": 1.4, "iridescenceThicknessMaximum": thickness}

    metals = [material(pbr(GOLD, 1.0, 0.2), iridescence=film(t)) for t in (150.0, 300.0, 500.0, 800.0)]
    others = [
        material(pbr((0.05, 0.05, 0.05, 1), 0.0, 0.2), iridescence=film(t)) for t in (150.0, 300.0, 500.0, 800.0)
    ]
    return spheres(*metals, *others, columns=4)


def anisotropy() -> Gltf:
    return spheres(
        *(
            material(pbr(GOLD, 1.0, 0.3), anisotropy={"anisotropyStrength": s, "anisotropyRotation": a})
            for s in (0.5, 1.0)
            for a in (0.0, np.pi / 4, np.pi / 2)
        ),
        columns=3,
    )


def transmission_roughness() -> Gltf:
    solid = {"thicknessFactor": 1.0, "attenuationColor": [0.4, 0.9, 0.6], "attenuationDistance": 0.8}
    clear = pbr((1, 1, 1, 1))
    thin = [
        material({**clear, "roughnessFactor": r}, transmission={"transmissionFactor": 1.0}) for r in (0.0, 0.3, 0.6)
    ]
    thick = [
        material(
            {**clear, "roughnessFactor": r},
            transmission={"transmissionFactor": 1.0},
            volume=solid,
            ior={"ior": 1.5},
        )
        for r in (0.0, 0.3, 0.6)
    ]
    return spheres(*thin, *thick, columns=3)


def diffuse_transmission() -> Gltf:
    """Return turned plates that transmit none, half and all of the diffuse light."""
    file = Gltf()
    for i, share in enumerate((0.0, 0.5, 1.0)):
        leaf = {"diffuseTransmissionFactor": share, "diffuseTransmissionColorFactor": [0.4, 0.8, 0.2]}
        number = file.add(
            "materials", doubleSided=True, **material(pbr((0.6, 0.6, 0.5, 1)), diffuse_transmission=leaf)
        )
        file.node(mesh=plate(file, number), translation=[1.1 * i, 0, 0], rotation=[0, 0.4, 0, 0.9165])
    return named(file)


def negative_scale() -> Gltf:
    """Return single-sided letters L and balls, each mirrored along no axis, x, y, and both."""
    file = Gltf()
    number = file.add("materials", **material(pbr((0.9, 0.5, 0.2, 1), 0.0, 0.6)))
    corners = np.array([[0, 0], [0.8, 0], [0.8, 0.25], [0.25, 0.25], [0.25, 0.9], [0, 0.9]]) - [0.4, 0.45]
    flat = np.concatenate([corners, np.zeros((6, 1))], axis=1)
    letter = file.mesh(flat, [0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5], material=number)
    ball = sphere(file, number)
    for i, scale in enumerate(([1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1])):
        file.node(mesh=letter, translation=[i, 0, 0], scale=scale)
        file.node(mesh=ball, translation=[i, -1, 0], scale=[0.8 * s for s in scale])
    return file


def vertex_colour() -> Gltf:
    """Return plates with vertex colours above plates with base colours: each must look like the one below it."""
    file = Gltf()
    white = file.add("materials", **material(pbr((1, 1, 1, 1), 0.0, 1.0)))
    colours = ([0.8, 0.1, 0.1], [0.1, 0.7, 0.2], [0.1, 0.2, 0.8])
    for i, colour in enumerate(colours):
        file.node(mesh=plate(file, white, COLOR_0=np.tile(colour, (4, 1))), translation=[1.1 * i, 0, 0])
        plain = file.add("materials", **material(pbr((*colour, 1), 0.0, 1.0)))
        file.node(mesh=plate(file, plain), translation=[1.1 * i, -1.1, 0])
    return file


def checker() -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return (4, 4, 3) different texels, so that each rotation and each mirror image is another picture."""
    value = np.arange(16).reshape(4, 4)
    return np.stack([40 + 12 * value, 230 - 12 * value, 60 + 40 * (value % 4)], axis=-1).astype(np.uint8)


WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}


def texture_settings() -> Gltf:
    """Return unlit plates: nine pairs of wraps with coordinates from -1 to 2, and filters."""
    file = Gltf()
    image = file.image(checker())
    uv = 3 * PLATE_UV - 1
    meshes = []
    for s in WRAPS.values():
        for t in WRAPS.values():
            sampler = file.add("samplers", wrapS=s, wrapT=t, magFilter=9728, minFilter=9728)
            texture = file.add("textures", source=image, sampler=sampler)
            meshes.append(plate(file, _unlit(file, {"index": texture}), uv))
    in_a_row(file, meshes, 3)
    return named(file)


TRANSFORMS: list[dict[str, Any]] = [
    {"offset": [0.25, -0.5]},
    {"scale": [2.0, 0.5]},
    {"rotation": 0.6},
    {"offset": [0.5, 0.25], "rotation": -1.1, "scale": [1.5, -2.0]},
]


def texture_transform() -> Gltf:
    file = Gltf()
    image = file.image(checker())
    sampler = file.add("samplers", magFilter=9728, minFilter=9728)
    texture = file.add("textures", source=image, sampler=sampler)
    meshes = [
        plate(file, _unlit(file, {"index": texture, "extensions": {"KHR_texture_transform": transform}}))
        for transform in TRANSFORMS
    ]
    in_a_row(file, meshes, 2)
    return named(file)


def _unlit(file: Gltf, texture: dict[str, Any]) -> int:
    surface = {"baseColorTexture": texture}
    return file.add("materials", pbrMetallicRoughness=surface, extensions={"KHR_materials_unlit": {}})


def dome(side: int = 64) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the (side, side, 3) normal map of a flat dome, green upwards."""
    x, y = np.meshgrid((np.arange(side) + 0.5) / side * 2 - 1, 1 - (np.arange(side) + 0.5) / side * 2)
    inside = x * x + y * y < 0.8
    nx, ny = np.where(inside, 0.6 * x, 0.0), np.where(inside, 0.6 * y, 0.0)
    nz = np.sqrt(1 - nx * nx - ny * ny)
    return np.asarray(np.round(127.5 * (np.stack([nx, ny, nz], axis=-1) + 1)), np.uint8)


def normal_tangent_mirror() -> Gltf:
    """Return plates with a dome each, by coordinates that are mirrored or rotated: all domes must bulge equally."""
    file = Gltf()
    texture = file.texture(dome())
    number = file.add("materials", **material(pbr((0.7, 0.7, 0.7, 1), 0.0, 0.4)), normalTexture={"index": texture})
    flipped = PLATE_UV * [-1, 1] + [1, 0]
    turned = PLATE_UV[:, ::-1] * [1, -1] + [0, 1]
    in_a_row(file, [plate(file, number, uv) for uv in (PLATE_UV, flipped, turned, PLATE_UV * [1, -1] + [0, 1])], 2)
    return file


def alpha_blend() -> Gltf:
    file = Gltf()
    wall = file.add("materials", **material(pbr((0.1, 0.1, 0.5, 1), 0.0, 1.0)))
    file.node(mesh=plate(file, wall), translation=[1, 0, -0.5], scale=[3.4, 1.2, 1])
    alpha = np.full((8, 8, 4), 200, np.uint8)
    alpha[..., 3] = np.linspace(0, 255, 8)[None, :]
    texture = {"index": file.texture(alpha)}
    for i, mode in enumerate(
        ({"alphaMode": "OPAQUE"}, {"alphaMode": "MASK", "alphaCutoff": 0.5}, {"alphaMode": "BLEND"})
    ):
        number = file.add(
            "materials",
            pbrMetallicRoughness={"baseColorTexture": texture, "metallicFactor": 0},
            doubleSided=True,
            **mode,
        )
        file.node(mesh=plate(file, number), translation=[i, 0, 0])
    return file


MODELS: dict[str, Callable[[], Gltf]] = {
    "MetalRoughSpheres": metal_rough,
    "WhiteMetal": white_metal,
    "WhiteDielectric": white_dielectric,
    "Sheen": sheen,
    "ClearCoat": clearcoat,
    "Specular": specular,
    "Iridescence": iridescence,
    "Anisotropy": anisotropy,
    "TransmissionRoughness": transmission_roughness,
    "DiffuseTransmission": diffuse_transmission,
    "NegativeScale": negative_scale,
    "VertexColor": vertex_colour,
    "TextureSettings": texture_settings,
    "TextureTransform": texture_transform,
    "NormalTangentMirror": normal_tangent_mirror,
    "AlphaBlend": alpha_blend,
}


def write_models(folder: Path, names: Sequence[str] = tuple(MODELS)) -> None:
    """Write FOLDER/Models/NAME/glTF/NAME.gltf of each model."""
    for name in names:
        into = folder / "Models" / name / "glTF"
        into.mkdir(parents=True, exist_ok=True)
        MODELS[name]().write(into, f"{name}.gltf")


if __name__ == "__main__":
    write_models(Path(sys.argv[1]))
