"""Small scenes, each of one material, texture slot or light, that Mitsuba has as well.

An open room of two coloured walls, with a ball and a card of what is to be shown. All is flat but where smooth
normals are what it is about, as glpath divides by the light that these lose and Mitsuba does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from glpath.io import scene_from_dict
from glpath.io.export.mitsuba_surfaces import Plugin
from glpath.scene import Environment, Scene, Sky
from glpath.scene.model import Light, Material, Mesh, Shape, Shapes, Texture, TextureSlot
from glpath.scene.tessellate import unit_sphere
from glpath.scene.triangulate import path_traceable
from tests.support.surfaces import quad

#: Vertices of a path: of light that is left after as many, no more than a thousandth.
THROUGH = 24
GOLD = np.array([1.0, 0.8, 0.4])
BLUE = np.array([0.2, 0.4, 0.8])
WHITE = np.ones(3)


@dataclass(frozen=True)
class Witness:
    """A scene, and what of it Mitsuba needs otherwise than `glpath export` writes it.

    plugin : in place of the material "it"
    notes  : beginnings of what the export says of it that does not change the picture
    gather : by how much of its mean a gather may be off
    depth  : vertices of a path; many where Mitsuba counts a surface that is passed through, and glpath does not
    """

    scene: Scene
    plugin: Plugin | None = None
    notes: tuple[str, ...] = ()
    depth: int = 5
    gather: float = 0.005


def flat(shape: Shape) -> Shape:
    assert isinstance(shape.geometry, Mesh)
    return replace(shape, geometry=replace(shape.geometry, normals=None))


def room(
    it: Material,
    *textures: Texture,
    lamp: Shape | None = None,
    card: Mesh | None = None,
    resolution: int = 64,
    **more: Any,
) -> Scene:
    """A ball and a card of `it` in the room, under a lamp that is a square where nothing else is given.

    Its microfacets scatter light once, as the witnesses' do.
    """
    scene = scene_from_dict(
        {
            "camera": {"position": [0, 1.2, 4.6], "target": [0, 0.85, 0], "fov": 38},
            "film": {"resolution": [resolution, resolution]},
            "materials": {
                "chalk": {"reflectance": 0.6},
                "red": {"reflectance": [0.6, 0.15, 0.1]},
                "green": {"reflectance": [0.15, 0.5, 0.1]},
            },
            "shapes": [
                {"type": "quad", "corners": [[-1.5, 0, 1.5], [1.5, 0, 1.5], [1.5, 0, -1.5], [-1.5, 0, -1.5]]},
                {"type": "quad", "corners": [[-1.5, 0, -1.5], [1.5, 0, -1.5], [1.5, 2.5, -1.5], [-1.5, 2.5, -1.5]]},
                {"type": "quad", "corners": [[-1.5, 0, 1.5], [-1.5, 0, -1.5], [-1.5, 2.5, -1.5], [-1.5, 2.5, 1.5]]},
                {"type": "quad", "corners": [[1.5, 0, -1.5], [1.5, 0, 1.5], [1.5, 2.5, 1.5], [1.5, 2.5, -1.5]]},
                {"type": "sphere", "center": [-0.55, 0.62, 0.1], "radius": 0.5, "subdivisions": 4},
            ],
            "sky": {"zenith": 1.0},
        }
    )
    scene = path_traceable(scene)
    floor, back, left, right, ball = (flat(shape) for shape in scene.shapes)
    square = quad([[-0.5, 2.3, -0.5], [0.5, 2.3, -0.5], [0.5, 2.3, 0.5], [-0.5, 2.3, 0.5]])
    lamp = lamp or Shape("lamp", square, 0, emission=np.array([9.0, 8.0, 7.0]))
    card = card or CARD
    shapes = [
        replace(floor, material=0),
        replace(back, material=0),
        replace(left, material=1),
        replace(right, material=2),
        replace(ball if not it.slots and not it.needs_uv else in_longitudes(ball), material=3),
        Shape("card", card, 3),
    ]
    if "lights" not in more and "sky" not in more:
        shapes.append(lamp)
    walls = tuple(m for m in scene.materials if m.name in ("chalk", "red", "green"))
    fields_of = {"sky": None, **more}
    return replace(
        scene,
        materials=(*walls, replace(it, name="it", multiple_scattering=False)),
        shapes=Shapes(shapes),
        textures=textures,
        **fields_of,
    )


#: In place of a card, of solids: it is closed.
BRICK = (
    path_traceable(
        scene_from_dict(
            {
                "camera": {"position": [0, 0, 4], "target": [0, 0, 0]},
                "shapes": [{"type": "box", "min": [0.3, 0.1, -0.2], "max": [0.9, 0.9, 0.3]}],
            }
        )
    )
    .shapes[0]
    .geometry
)

#: Leans against the air on the right.
CARD = quad([[0.15, 0.1, 0.5], [1.1, 0.1, 0.2], [1.0, 1.2, -0.3], [0.05, 1.2, 0.0]], parts=4)


def in_longitudes(ball: Shape) -> Shape:
    """With texture coordinates: longitude and latitude, each triangle by itself, so that none goes around."""
    assert isinstance(ball.geometry, Mesh)
    apart = ball.geometry.unshared()
    middle = ball.world_from_object[0][:, :3].T  # a scale and a shift
    unit = apart.vertices @ middle
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    u = np.arctan2(unit[:, 1], unit[:, 0]) / (2 * np.pi)
    u = u.reshape(-1, 3)
    u = u - np.round(u - u[:, :1])
    v = 0.5 + np.arcsin(np.clip(unit[:, 2], -1, 1)) / np.pi
    return replace(ball, geometry=replace(apart, uv=np.stack([u.ravel(), v], axis=1)))


def noise(height: int, width: int, channels: int = 3, seed: int = 0, low: float = 0.0) -> Any:
    return np.random.default_rng(seed).uniform(low, 1.0, (height, width, channels)).astype(np.float32)


def gltf(**parameters: Any) -> Plugin:
    """See tests/reference/gltf_in_mitsuba.py; angles in radians."""
    return {"type": "gltf", **parameters}


def rgb(colour: Any) -> Plugin:
    return {"type": "rgb", "value": [float(c) for c in colour]}


def bitmap(image: Any, **more: Any) -> Plugin:
    return {"type": "bitmap", "image": np.ascontiguousarray(image, np.float32), "raw": True, **more}


def bumps(n: int = 8) -> Texture:
    """Normals that lean by up to four degrees, so that hardly any light is lost between them and the surface."""
    lean = np.random.default_rng(4).uniform(-0.07, 0.07, (n, n, 2))
    normal = np.dstack([lean, np.sqrt(1.0 - (lean**2).sum(axis=2))])
    return Texture("bumps", (0.5 + 0.5 * normal).astype(np.float32))


def textured(slot: str, texture: Texture, **material: Any) -> tuple[Material, Texture]:
    fields: dict[str, Any] = {"reflectance": WHITE, **material, slot: TextureSlot(0)}
    return Material("it", **fields), texture


def materials() -> dict[str, Witness]:
    grey, base = np.full(3, 0.4), np.array([0.7, 0.4, 0.1])
    brushed = {"roughness": 0.3, "metallic": 1.0, "anisotropy": 0.6}
    across = 0.09
    along = across + (1 - across) * 0.36
    glass: dict[str, Any] = {"reflectance": WHITE, "roughness": 0.0, "transmission": 1.0, "thin": False}
    return {
        "diffuse": Witness(room(Material("it", base))),
        "one-sided": Witness(room(Material("it", base, two_sided=False))),
        "mirror": Witness(room(Material("it", np.zeros(3), mirror=np.full(3, 0.9)))),
        "half-mirror": Witness(room(Material("it", grey, mirror=np.full(3, 0.5)))),
        "metal-0.1": Witness(room(Material("it", GOLD, roughness=0.1, metallic=1.0))),
        "metal-0.5": Witness(room(Material("it", GOLD, roughness=0.5, metallic=1.0))),
        "brushed-white": Witness(
            room(Material("it", WHITE, **brushed)),
            {
                "type": "twosided",
                "bsdf": {
                    "type": "roughconductor",
                    "material": "none",
                    "distribution": "ggx",
                    "alpha_u": along,
                    "alpha_v": across,
                },
            },
        ),
        "brushed-gold": Witness(
            room(Material("it", GOLD, anisotropy_angle=30.0, **brushed)),
            gltf(base_color=rgb(GOLD), metallic=1.0, roughness=0.3, anisotropy=0.6, anisotropy_angle=np.pi / 6),
        ),
        "plastic": Witness(room(Material("it", base, roughness=0.3)), gltf(base_color=rgb(base), roughness=0.3)),
        "half-metal": Witness(
            room(Material("it", base, roughness=0.5, metallic=0.5)),
            gltf(base_color=rgb(base), roughness=0.5, metallic=0.5),
        ),
        "specular": Witness(
            room(
                Material(
                    "it", base, roughness=0.4, ior=2.4, specular_weight=0.7, specular_colour=np.array([3.0, 1, 9])
                )
            ),
            gltf(base_color=rgb(base), roughness=0.4, ior=2.4, specular=0.7, specular_color=rgb([3.0, 1, 9])),
        ),
        "varnish": Witness(
            room(Material("it", base, roughness=0.6, metallic=0.5, clearcoat=0.8, clearcoat_roughness=0.3)),
            gltf(base_color=rgb(base), roughness=0.6, metallic=0.5, clearcoat=0.8, clearcoat_roughness=0.3),
        ),
        "pane": Witness(
            room(Material("it", base, roughness=0.0, transmission=1.0)),
            {"type": "pane", "base_color": rgb(base)},
            depth=THROUGH,
        ),
        "frosted-pane": Witness(
            room(Material("it", base, roughness=0.4, transmission=1.0)),
            gltf(base_color=rgb(base), roughness=0.4, transmission=1.0),
        ),
        "glass": Witness(room(Material("it", **glass), card=BRICK)),
        # The solver's particles take it for clear.
        "frosted-glass": Witness(room(Material("it", **glass | {"roughness": 0.4}), card=BRICK), gather=0.01),
        "tinted-glass": Witness(room(Material("it", **glass, attenuation=np.array([0.3, 1.0, 2.0])), card=BRICK)),
    }


def textures() -> dict[str, Witness]:
    colours = Texture("colours", noise(3, 4), (2.0, 3.0))
    squares = Texture(
        "squares", (np.random.default_rng(1).random((4, 6, 4)) * 255).astype(np.uint8), srgb=True, filter="nearest"
    )
    data = noise(4, 5, seed=2, low=0.3)
    holes = noise(6, 6, 4, seed=3)
    holes[..., 3] = np.random.default_rng(5).random((6, 6)) > 0.4
    veil = noise(6, 6, 4, seed=3)
    opaque = squares.image[..., :3]
    smooth = room(Material("it", np.array([0.7, 0.4, 0.1])))
    ball = unit_sphere(4)
    to_room = np.array([[[0.5, 0, 0, -0.55], [0, 0.5, 0, 0.62], [0, 0, 0.5, 0.1]]])
    smooth = replace(
        smooth,
        shapes=Shapes(
            replace(s, geometry=ball, world_from_object=to_room) if s.name == "sphere" else s for s in smooth.shapes
        ),
    )
    tones = np.random.default_rng(7).uniform(0, 1, (len(CARD.vertices), 4))
    tones[:, 3] = 1.0
    return {
        "base-colour": Witness(room(*textured("texture", colours))),
        "base-colour-srgb": Witness(room(*textured("texture", replace(squares, image=opaque)))),
        "metallic-roughness": Witness(
            room(
                *textured("surface_texture", Texture("data", data), reflectance=GOLD, roughness=0.8, metallic=0.9)
            ),
            gltf(
                base_color=rgb(GOLD),
                roughness=bitmap(0.8 * data[..., 1:2]),
                metallic=bitmap(0.9 * data[..., 2:3]),
            ),
        ),
        "transmission": Witness(
            room(
                *textured(
                    "transmission_texture",
                    Texture("data", data),
                    reflectance=np.array([0.8, 0.5, 0.3]),
                    roughness=0.0,
                    transmission=0.9,
                    specular_weight=0.0,
                    ior=1.0,
                )
            ),
            notes=("its thin dielectric reflects", "glass and the rest"),
            depth=THROUGH,
        ),
        "normal-map": Witness(
            room(*textured("normal_texture", bumps(), reflectance=np.full(3, 0.6)), **GRAZING), notes=(OF_SEAMS,)
        ),
        "normal-map-metal": Witness(
            room(*textured("normal_texture", bumps(), reflectance=GOLD, roughness=0.4, metallic=1.0)),
            notes=(OF_SEAMS,),
        ),
        "mask": Witness(
            room(*textured("texture", Texture("holes", holes, filter="nearest"), alpha="mask")), depth=THROUGH
        ),
        "blend": Witness(
            room(*textured("texture", Texture("veil", veil), alpha="blend", opacity=0.8)), depth=THROUGH
        ),
        "vertex-colours": Witness(room(Material("it", np.full(3, 0.8)), card=replace(CARD, colours=tones))),
        "smooth-normals": Witness(smooth),
    }


#: Note about the few triangles of a sphere across which its texture coordinates jump.
OF_SEAMS = "its normal map is inverted along green where texture coordinates are mirrored"
GRAZING: dict[str, Any] = {
    "lights": (Light("bulb", "point", np.array([3.0, 3, 3]), np.array([0.2, 2.2, 0.6])),),
}


def lights() -> dict[str, Witness]:
    it = Material("it", np.array([0.7, 0.4, 0.1]))
    at = np.array([0.6, 2.2, 0.8])
    aim = np.array([-0.2, 0.6, 0.0]) - at
    aim /= np.linalg.norm(aim)
    bulb = Light("bulb", "point", np.array([5.0, 4, 3]), at)
    spot = replace(bulb, kind="spot", direction=aim, cone=(28.0, 28.0))
    sun = Light("sun", "directional", np.array([4.0, 3.5, 3]), direction=aim)
    brick = replace(BRICK, vertices=BRICK.vertices * 0.4 + [0.0, 2.0, 0.3])
    image = 2.0 * noise(16, 32, seed=9) ** 4
    hot = image.copy()
    hot[3, 12] = (900.0, 700.0, 500.0)
    picture = Texture("picture", noise(4, 4, seed=11))
    glow = replace(room(it), textures=(picture,))
    shining = Material("shining", np.full(3, 0.5), emission_texture=TextureSlot(0))
    glow = replace(
        glow,
        materials=(*glow.materials, shining),
        shapes=Shapes(replace(s, material=4) if s.name == "lamp" else s for s in glow.shapes),
    )
    return {
        "quad": Witness(room(it)),
        "two-sided-quad": Witness(
            room(it, lamp=Shape("lamp", HANGING, 0, emission=np.full(3, 5.0), emission_two_sided=True))
        ),
        "mesh": Witness(room(it, lamp=Shape("lamp", brick, 0, emission=np.array([20.0, 15, 10])))),
        "textured-emission": Witness(glow),
        "point": Witness(room(it, lights=(bulb,))),
        "spot": Witness(room(it, lights=(spot,))),
        "directional": Witness(room(it, lights=(sun,))),
        "three-lights": Witness(room(it, lights=(bulb, replace(spot, name="spot"), sun))),
        "white-sky": Witness(room(it, sky=Sky(WHITE, WHITE))),
        "sky": Witness(room(it, sky=Sky(np.array([0.2, 0.5, 2.0]), np.array([1.0, 0.5, 0.1])))),
        "environment": Witness(room(it, sky=Environment(image, np.array([0.1, 1.0, 0.2]), 30.0))),
        "environment-with-sun": Witness(room(it, sky=Environment(hot, np.array([0.1, 1.0, 0.2]), 50.0))),
    }


#: Under the ceiling that is not there, on edge.
HANGING = quad([[-0.4, 1.7, 0.0], [0.4, 1.7, 0.0], [0.4, 2.2, 0.1], [-0.4, 2.2, 0.1]])
