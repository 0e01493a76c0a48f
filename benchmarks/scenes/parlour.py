"""A furnished room with textures and glTF's materials, similar to a user's own model.

It has boards, wallpaper, plaster, a woven rug, linen and wood with normal maps and roughness; a window of two
casements, one with its pane and an open one, and the view through it; a brass lamp, a glass vase, a mirror and a
painting. Units are metres; x runs along the back wall, y up, and z from it into the room.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.scenes import furniture, patterns
from benchmarks.scenes.furniture import Fineness, Part, Piece, placed
from benchmarks.scenes.patterns import Pattern
from benchmarks.scenes.solids import Profile, arc, block, cushion, framed, moved, patch, turned
from glpath.scene.model import Camera, Float64, Material, Mesh, Scene, Shape, Shapes, Texture, TextureSlot

#: Size of the room, whose corner is at 0.
ROOM = (4.6, 2.7, 5.2)
W, H, D = ROOM
# The window in the wall x = 0: its range along z, then its range in y.
_WINDOW = (1.25, 2.95, 0.85, 2.25)
_DEEP = 0.22  # thickness of the wall, and so depth of the reveal
# W sr^-1 m^-2
_DAYLIGHT, _CEILING, _SHADE, _CANDLE = (5.0, 5.0, 5.0), (26.0, 21.0, 14.5), (14.0, 9.6, 4.9), (30.0, 17.0, 5.0)
_RUG = (0.95, 3.55, 1.15, 2.9)
# Largest angle in degrees between adjacent triangles of one smooth surface.
_CREASE = 38.0


def parlour() -> Scene:
    """Return the room by daylight and a lamp, with normal maps, metal, glass and a mirror."""
    fine = Fineness(2.0)
    surfaces = _Surfaces()
    parts = [*_walls(), *_window(), *_on_the_floor(fine), *_ornaments(fine)]
    shapes = [
        Shape(
            part.name,
            surfaces.mesh(part),
            surfaces.number(part.material),
            emission=np.array(part.emission),
        )
        for part in parts
    ]
    camera = Camera(
        np.array([4.15, 1.5, 4.75]),
        np.array([1.35, 0.93, 0.75]),
        np.array([0.0, 1.0, 0.0]),
        48.0,
        (512, 384),
    )
    return Scene(
        name="parlour",
        camera=camera,
        shapes=Shapes(shapes),
        materials=tuple(surfaces.materials),
        textures=tuple(surfaces.textures),
        source="parlour",
    )


# Materials


class _Surfaces:
    """The materials and textures that parts use, in the order of their first use."""

    def __init__(self) -> None:
        self.materials: list[Material] = []
        self.textures: list[Texture] = []
        self._numbers: dict[str, int] = {}
        self._slots: dict[str, dict[str, TextureSlot]] = {}

    def number(self, name: str) -> int:
        if name not in self._numbers:
            self._numbers[name] = len(self.materials)
            self.materials.append(self._made(name))
        return self._numbers[name]

    def mesh(self, part: Part) -> Mesh:
        """Return a part's mesh with smooth normals, and with coordinates if its material has textures."""
        pattern = _MATERIALS[part.material].get("pattern")
        uv = None if pattern is None else _coordinates(part.corners, _PATTERNS[pattern][1])
        mesh = Mesh.of_triangles(part.corners, uv)
        return Mesh(mesh.vertices, mesh.faces, mesh.uv, _smooth(part.corners)).welded()

    def _made(self, name: str) -> Material:
        fields = {"roughness": 0.6, "two_sided": False} | _MATERIALS[name]
        pattern = fields.pop("pattern", None)
        slots: dict[str, Any] = {} if pattern is None else dict(self._of_pattern(pattern))
        if pattern == "view":
            slots = {"emission_texture": slots["texture"]}
        if "surface_texture" in slots:
            fields["roughness"] = 1.0  # the texture multiplies it
        colour = np.array(fields.pop("colour", (1.0, 1.0, 1.0)), float)
        return Material(name, colour, **slots, **fields)

    def _of_pattern(self, name: str) -> dict[str, TextureSlot]:
        if name not in self._slots:
            made = _PATTERNS[name][0]()
            pattern = made if isinstance(made, Pattern) else Pattern(made)
            images = {
                "texture": pattern.colour, "normal_texture": pattern.bumps, "surface_texture": pattern.finish,
            }  # fmt: skip
            self._slots[name] = {}
            for slot, image in images.items():
                if image is not None:
                    self._slots[name][slot] = TextureSlot(len(self.textures))
                    suffix = {"texture": "", "normal_texture": "-normal", "surface_texture": "-finish"}[slot]
                    self.textures.append(Texture(name + suffix, image, srgb=slot == "texture"))
        return self._slots[name]


#: The function that makes each pattern, and the side of one repeat in metres; 0 fits the pattern to the whole part.
_PATTERNS: dict[str, tuple[Any, float]] = {
    "boards": (lambda: patterns.boards(1), 1.6),
    "wallpaper": (lambda: patterns.wallpaper(2, (0.30, 0.42, 0.36), (0.50, 0.58, 0.46)), 0.46),
    "plaster": (lambda: patterns.plaster(3), 1.5),
    "linen": (lambda: patterns.cloth(4), 0.07),
    "rug": (lambda: patterns.rug(5), 0.0),
    "walnut": (lambda: patterns.wood(6, (0.085, 0.038, 0.016), (0.30, 0.15, 0.065)), 0.6),
    "painting": (lambda: patterns.painting(7), 0.0),
    "view": (lambda: patterns.view(8), 0.0),
}

_MATERIALS: dict[str, dict[str, Any]] = {
    "boards": {"pattern": "boards"},
    "wallpaper": {"pattern": "wallpaper"},
    "plaster": {"pattern": "plaster", "roughness": 0.9},
    "paint": {"colour": (0.80, 0.79, 0.75), "roughness": 0.35},
    "rug": {"pattern": "rug", "roughness": 0.95},
    "linen-blue": {"pattern": "linen", "colour": (0.13, 0.30, 0.42), "roughness": 0.9},
    "linen-ochre": {"pattern": "linen", "colour": (0.95, 0.56, 0.13), "roughness": 0.9},
    "walnut": {"pattern": "walnut"},
    "walnut-polished": {"pattern": "walnut", "clearcoat": 1.0, "clearcoat_roughness": 0.08},
    "painting": {"pattern": "painting", "roughness": 0.5},
    "gilt": {"colour": (0.83, 0.60, 0.24), "roughness": 0.35, "metallic": 1.0},
    "brass": {"colour": (0.91, 0.74, 0.38), "roughness": 0.18, "metallic": 1.0},
    "mirror": {"colour": (0.92, 0.93, 0.92), "roughness": 0.0, "metallic": 1.0},
    "pane": {"transmission": 1.0, "roughness": 0.0, "two_sided": True},
    "glass": {
        "transmission": 1.0, "roughness": 0.0, "thin": False, "ior": 1.5, "two_sided": True,
        "attenuation": np.array([6.0, 1.0, 2.5]),
    },
    "porcelain": {"colour": (0.82, 0.83, 0.85), "roughness": 0.12},
    "apple": {"colour": (0.55, 0.07, 0.04), "roughness": 0.25},
    "pear": {"colour": (0.56, 0.54, 0.11), "roughness": 0.3},
    "wax": {"colour": (0.86, 0.82, 0.70), "roughness": 0.5},
    "shade": {"colour": (0.8, 0.78, 0.72), "roughness": 0.9},
    "view": {"pattern": "view", "colour": (0.0, 0.0, 0.0), "roughness": 1.0},
    **{
        f"book-{name}": {"colour": colour, "roughness": 0.45}
        for name, colour in {
            "red": (0.40, 0.06, 0.05), "green": (0.07, 0.21, 0.12), "blue": (0.07, 0.11, 0.30),
            "brown": (0.28, 0.14, 0.06), "cream": (0.68, 0.60, 0.44),
        }.items()
    },
}  # fmt: skip


def _coordinates(corners: Float64, repeat: float) -> Float64:
    """Return (T, 3, 2) coordinates, projected along each face's main axis; `repeat` in metres, 0 fits the part."""
    edges = corners[:, 1:] - corners[:, :1]
    axis = np.argmax(np.abs(np.cross(edges[:, 0], edges[:, 1])), axis=1)
    # v is up on upright faces, and along z on horizontal ones.
    across, up = np.array([2, 0, 0])[axis], np.array([1, 2, 1])[axis]
    rows = np.arange(len(corners))
    flat = np.stack([corners[rows, :, across], corners[rows, :, up]], axis=2)
    if repeat > 0:
        return np.asarray(flat / repeat)
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    return np.asarray((flat - low) / (high - low))


def _smooth(corners: Float64) -> Float64:
    """Return (3 T, 3) normals of corners: the mean of the adjacent faces that are not beyond a crease."""
    edges = corners[:, 1:] - corners[:, :1]
    weighted = np.cross(edges[:, 0], edges[:, 1])
    unit = weighted / np.linalg.norm(weighted, axis=1, keepdims=True)
    _, place = np.unique(np.round(corners.reshape(-1, 3), 7), axis=0, return_inverse=True)
    order = np.argsort(place, kind="stable")
    made = np.empty((len(place), 3))
    limit = np.cos(np.radians(_CREASE))
    for group in np.split(order, np.flatnonzero(np.diff(place[order])) + 1):
        faces = group // 3
        near = unit[faces] @ unit[faces].T > limit
        made[group] = near @ weighted[faces]
    return np.asarray(made / np.linalg.norm(made, axis=1, keepdims=True))


# The walls, and the window


def _wall(corners: ArrayLike) -> Float64:
    return patch(corners, 0.8)


def _walls() -> Piece:
    z0, z1, y0, y1 = _WINDOW
    around = [(0, z0, 0, H), (z1, D, 0, H), (z0, z1, 0, y0), (z0, z1, y1, H)]
    left = [_wall([(0, low, b), (0, low, a), (0, high, a), (0, high, b)]) for a, b, low, high in around]
    papered = [
        _wall([(0, 0, 0), (W, 0, 0), (W, H, 0), (0, H, 0)]),
        _wall([(W, 0, 0), (W, 0, D), (W, H, D), (W, H, 0)]),
        _wall([(W, 0, D), (0, 0, D), (0, H, D), (W, H, D)]),
        *left,
    ]
    high, deep = 0.11, 0.016
    skirting = [
        block((0, 0, 0), (W, high, deep), without="-y -z -x +x"),
        block((0, 0, deep), (deep, high, D - deep), without="-y -x -z +z"),
        block((W - deep, 0, deep), (W, high, D - deep), without="-y +x -z +z"),
        block((0, 0, D - deep), (W, high, D), without="-y +z -x +x"),
    ]
    floor = patch([(0, 0, D), (W, 0, D), (W, 0, 0), (0, 0, 0)], 0.8)
    ceiling = patch([(0, H, 0), (W, H, 0), (W, H, D), (0, H, D)], 0.8)
    return [
        Part("walls", "wallpaper", np.concatenate(papered)),
        Part("floor", "boards", floor),
        Part("ceiling", "plaster", ceiling),
        Part("skirting", "paint", np.concatenate(skirting)),
    ]


def _window() -> Piece:
    """Return the reveal, a board, a fixed and an open casement, and the view through them."""
    z0, z1, y0, y1 = _WINDOW
    out = -_DEEP
    reveal = [
        patch([(out, y0, z0), (0, y0, z0), (0, y1, z0), (out, y1, z0)]),
        patch([(0, y0, z1), (out, y0, z1), (out, y1, z1), (0, y1, z1)]),
        patch([(out, y1, z0), (0, y1, z0), (0, y1, z1), (out, y1, z1)]),
        patch([(out, y0, z1), (0, y0, z1), (0, y0, z0), (out, y0, z0)]),
    ]
    board = block((0, y0 - 0.035, z0 - 0.06), (0.14, y0, z1 + 0.06), without="-x")
    half = (z1 - z0) / 2
    # A casement around the origin of the xy plane, with its front towards +z; the inside of the wall is towards +x.
    bars: Profile = [(0, -0.02), (0, 0.02), (0.045, 0.02), (0.05, 0.0), (0.045, -0.02), (0, -0.02)]
    frame = framed(half, y1 - y0, bars)
    inner = np.array([half, y1 - y0]) / 2 - 0.047
    x, y = inner
    glazing = patch([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)])
    bar = block((-x, -0.012, -0.012), (x, 0.012, 0.012), without="-x +x")
    middle = (y0 + y1) / 2
    # The open casement hangs on the jamb nearest to the camera, and stands into the room.
    swing = 30.0
    hinge = np.array([0.0, middle, z1])
    leaf = np.array([np.sin(np.radians(swing)), 0.0, -np.cos(np.radians(swing))]) * half / 2
    fixed, opened = ((out + 0.05, middle, z0 + half / 2), 90.0), (hinge + leaf, 90.0 + swing)
    wood = [moved(np.concatenate([frame, bar]), at, turn=turn) for at, turn in (fixed, opened)]
    panes = [moved(glazing, at, turn=turn) for at, turn in (fixed, opened)]
    far = -1.6
    seen = patch([(far, -0.5, D + 1.2), (far, -0.5, -1.4), (far, H + 1.6, -1.4), (far, H + 1.6, D + 1.2)])
    return [
        Part("reveal", "plaster", np.concatenate(reveal)),
        Part("window-board", "paint", board),
        Part("casements", "paint", np.concatenate(wood)),
        Part("panes", "pane", np.concatenate(panes)),
        Part("view", "view", seen, _DAYLIGHT),
    ]


# Furniture and ornaments


def _as(piece: Piece, materials: dict[str, str]) -> Piece:
    """Return the piece with other materials."""
    return [Part(p.name, materials.get(p.material, p.material), p.corners, p.emission) for p in piece]


def _on_the_floor(fine: Fineness) -> Piece:
    x0, x1, z0, z1 = _RUG
    high = 0.014
    pile = block((x0, 0, z0), (x1, high, z1), without="-y")
    books = [f"book-{name}" for name in ("red", "green", "blue", "brown", "cream")]
    sofa = _as(furniture.sofa(fine, 1.9, 2, "linen-blue", "linen-ochre"), {})
    table = _as(furniture.table(fine, 1.05, 0.62, 0.42), {"oak": "walnut-polished"})
    case = _as(furniture.bookcase(fine, 1.25, 1.95, books, 5), {"oak-dark": "walnut"})
    return [
        Part("rug", "rug", pile),
        *placed(sofa, (1.75, 0, 0.62), 0, "sofa"),
        *placed(table, (1.95, high, 1.95), 0, "table"),
        *placed(furniture.pedestal_table(fine), (0.45, 0, 0.45), 0, "side-table"),
        *placed(case, (3.15, 0, 0.0), 0, "bookcase"),
    ]


def _ornaments(fine: Fineness) -> Piece:
    top = 0.42 + 0.014
    lamp = _as(furniture.table_lamp(fine, _SHADE), {"glaze": "brass", "lamp": "shade"})
    bowl = furniture.bowl(Fineness(3.0), "porcelain", 0.15, ["apple", "pear", "apple", "pear"])
    candle = furniture.candlestick(fine)
    flame = [Part("flame", "shade", turned([(0, 0), (0.011, 0.018), (0.008, 0.036), (0, 0.06)], 12), _CANDLE)]
    return [
        *placed(lamp, (0.45, 0.58, 0.45), 0, "lamp"),
        *placed(_glass_vase(fine), (2.28, top + 0.001, 1.82), 0, "glass"),
        *placed(bowl, (1.85, top, 2.05), 20, "bowl"),
        *placed(candle, (1.55, top, 1.84), 0, "candle"),
        *placed(_as(furniture.ceiling_light(fine, 0.46, _CEILING), {"lamp": "shade"}), (2.5, H, 2.9), 0, "ceiling"),
        *placed(flame, (1.55, top + 0.24 + 0.19, 1.84), 0, "candle"),
        *_framed("painting", 1.1, 0.85, (1.75, 1.68, 0.0), "gilt"),
        *_framed("mirror", 0.62, 1.05, (0.62, 1.62, 0.0), "walnut"),
        Part("cushion", "linen-ochre", moved(cushion((0.5, 0.14, 0.5), 0.06, 4, 0.2, 0.03), (3.35, 0, 1.35), 24)),
    ]


def _glass_vase(fine: Fineness) -> Piece:
    """Return a closed surface, because the glass is between the vase's two walls."""
    h, belly, neck, wall = 0.27, 0.075, 0.032, 0.006
    steps = fine.steps(6)
    outer = [
        (0.0, 0.0), (0.05, 0.0), (0.054, 0.006), *arc((0.054, 0.008), (belly, 0.11), 0.12, steps),
        *arc((belly, 0.114), (neck, 0.215), 0.14, steps), (1.25 * neck, h - 0.012), (1.5 * neck, h),
    ]  # fmt: skip
    inner = [
        (1.5 * neck - 0.6 * wall, h + 0.002), (1.25 * neck - wall, h - 0.012), (neck - wall, 0.215),
        *arc((belly - wall, 0.114), (neck - wall, 0.215), 0.14, steps)[-2::-1],
        *arc((0.045, 0.02), (belly - wall, 0.11), 0.12, steps)[::-1], (0.0, 0.018),
    ]  # fmt: skip
    return [Part("vase", "glass", turned(outer + inner, fine.turns(20)))]


def _framed(what: str, width: float, height: float, at: Sequence[float], wood: str) -> Piece:
    """Return a flat thing in a frame on the back wall."""
    profile: Profile = [(0, 0), (0, 0.02), (0.012, 0.034), (0.04, 0.026), (0.055, 0.014), (0.06, 0.006)]
    x, y = width / 2 - 0.06, height / 2 - 0.06
    shown = patch([(-x, -y, 0.006), (x, -y, 0.006), (x, y, 0.006), (-x, y, 0.006)])
    return [
        Part(f"{what}-frame", wood, moved(framed(width, height, profile), at)),
        Part(what, what, moved(shown, at)),
    ]
