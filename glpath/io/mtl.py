"""Read MTL files, which hold the materials of OBJ files, as microfacet surfaces with textures.

Colours are linear, as Blender writes them. The statements are translated as follows:

    Kd map_Kd             reflectance and its texture. Kd of 0 with a texture counts as 1, and so does Ke of 0. If
                          the Kd of a file are from 0 to 255, they are divided by 255, and so are Ks, Ke and Tf if
                          any of their values is above 1
    Ks Ns                 gloss or metal, see `phong`; with illum 3, 5 or 8, Ks is the reflectance of a mirror
    Pr Pm                 roughness and metallic, which replace Ks and Ns; map_Pr and map_Pm replace them. Beside
                          them, the mean of Tf is the transmission of refracting glass of colour Kd and index Ni,
                          unless illum is a mode of glass: Blender writes such a Tf
    Pc Pcr Ps aniso       clearcoat and its roughness, sheen, anisotropy, over Ks and Ns or over Pr and Pm
    d, or Tr, map_d       opacity, blended; a surface of opacity 0 counts as opaque, with a note
    illum 6, 7            refracting glass of index Ni and colour Tf. It is always smooth, as in the ray tracers for
                          which these modes were made
    illum 4, 9            glass as for illum 6, but without refraction, if d < 1 or Tf is neither 0 nor 1. Otherwise
                          the surface is opaque, because Maya writes illum 4 and Tf 1 for opaque paint. Without such
                          a Tf, a coloured Kd is the colour of the glass
    illum 6, 9 with d < 1 as illum 2, unless Tf is neither 0 nor 1: Blender writes them for surfaces with alpha
    illum 4 with Ni 1     as illum 2, if d is missing, with the mean of Tf as opacity, as Maya writes it
    Ke map_Ke             emission, W sr^-1 m^-2
    norm, map_Bump        normal map; a map_Bump that does not hold normals is a height map, which is not used

EXR and float TIFF files hold linear colours. As other maps, such as of roughness or normals, their values are used
as they are.

Source: Wavefront, MTL material format (1995); the PBR extension of tinyobjloader and Blender.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glpath.io import phong
from glpath.io.gltf.surfaces import Surface
from glpath.io.named_files import UnusableError, spelt_file, without_comment
from glpath.io.pictures import Image, Pictures, resized
from glpath.io.text import decoded, statements
from glpath.scene.model import Float64, Material, Texture, TextureSlot
from glpath.system.files import read_bytes, reason_of
from glpath.system.numerals import real
from glpath.system.time_limit import check_time

#: Maximum size of a material library in bytes.
MAX_BYTES = 2**28
# Maximum number of MTL files of a model; more are ignored, with a note. Each missing file costs a search through
# the model's folder and its subfolders.
_MAX_LIBRARIES = 100
# Maximum length of a texture statement in characters. Longer ones are not used, with a note.
_MAX_STATEMENT = 2**20
_SHORT = {"bump": "map_bump", "map_normal": "norm", "map_kn": "norm", "map_tr": "map_d", "map_disp": "disp"}
# Number of arguments of each texture option; -o, -s and -t are missing, because they have one to three numbers.
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2, "-texres": 1}
_OPTIONS |= {"-bm": 1, "-type": 1}
# Options that are not used, with their values that change nothing; on and off count as 1 and 0.
_UNUSED_OPTIONS = {"-mm": [0.0, 1.0], "-boost": [0.0], "-cc": [0.0]}
_TRAILING_OPTIONS = re.compile(
    r"(?:[ \t]{1,8}-(?:(?:[sot]|bm|mm|boost|texres)(?:[ \t]{1,8}[-+.\de]+){1,3}"
    r"|(?:blend[uv]|cc|clamp)[ \t]{1,8}o(?:n|ff)|(?:imfchan|type)[ \t]{1,8}\w+)){1,16}$",
    re.IGNORECASE,
)
# Maximum Kd that counts as a fraction; some programs write fractions a little above 1. A larger Kd means that the
# colours of the file are from 0 to 255.
_MAX_FRACTION = 2.0
_MAPS = ("map_kd", "map_d", "map_ke", "norm", "map_bump", "map_pr", "map_pm")
# Statements of textures whose names do not begin with "map_", and that are not used.
_UNUSED_MAPS = ("disp", "decal", "refl")
# Statements that begin with "map_", but name no texture.
_NO_MAPS = ("map_aat",)
# Maximum number of notes after which unknown textures get no more notes.
_MAX_NOTES = 100
# Sheen has this roughness, because MTL states none; it is the default of scene files.
_SHEEN_ROUGHNESS = 0.5
# Minimum mean of blue, and range of median lengths of the vectors, of a picture that holds normals.
_MIN_BLUE, _NORMAL_LENGTHS = 0.7, (0.8, 1.2)
# Approximate number of pixels that show whether a picture holds normals.
_SAMPLED_PIXELS = 1 << 16
# Index of a channel in a picture by its name in -imfchan.
_CHANNELS = {"r": 0, "g": 1, "b": 2, "m": 3}
_MIRRORS, _GLASS, _REFRACTS = (3, 5, 8), (4, 6, 7, 9), (6, 7)


@dataclass(frozen=True)
class _Map:
    """Texture that an MTL statement names, with the options of the statement.

    matrix     : (2, 3) affine map from texture coordinates to lookup coordinates, of -s and -o
    clamped    : True if -clamp is on
    channel    : channel that -imfchan names, in lower case; None without that option
    multiplier : factor of -bm
    """

    image: Image
    name: str
    matrix: Float64
    clamped: bool
    channel: str | None
    multiplier: float

    @property
    def index(self) -> int:
        """Index of the channel that -imfchan names; 4, which no picture has, for the mean of the colours."""
        return _CHANNELS.get(self.channel or "", 4)


@dataclass
class Library:
    """Materials in the MTL files of one OBJ file. `surface` builds a material by its name.

    notes    : sentences about parts of the materials that are not used
    pictures : reader of the texture files; notes on unused files are in `pictures.files`
    """

    folder: Path
    textures: list[Texture] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    _written: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    _commented: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    _numbers: dict[tuple[object, ...], int] = field(default_factory=dict)
    _checks: dict[tuple[int, object], bool] = field(default_factory=dict)
    _surfaces: dict[int, Surface] = field(default_factory=dict)  # by id() of the material's statements
    _count: int = 0
    pictures: Pictures = field(init=False)

    def __post_init__(self) -> None:
        self.pictures = Pictures(self.folder)

    def add(self, name: str) -> None:
        """Read the MTL file `name` in the folder, or several files if `name` lists several."""
        if self._count > _MAX_LIBRARIES:
            return
        try:
            spelt_file(self.folder, name, self.pictures.files.folders)
            names = [name]
        except UnusableError:
            names = name.split() or [name]
        for each in names:
            self._count += 1
            if self._count > _MAX_LIBRARIES:
                self._note(f"Material libraries after the first {_MAX_LIBRARIES}.")
                return
            self._add(each)

    def _add(self, name: str) -> None:
        try:
            path = self.pictures.files.find(self.folder, name)
            content = read_bytes(path, MAX_BYTES)
        except UnusableError as error:
            self._note(f'The materials of "{name}", {error}.')
            return
        except OSError as error:
            self._note(f'The materials of "{name}", which cannot be read: {reason_of(error)}.')
            return
        written: dict[str, list[str]] = {}
        materials: dict[str, dict[str, list[str]]] = {}
        for _, words in statements(decoded(content)):
            keyword, values = words[0].lower(), words[1:]
            if keyword == "newmtl":
                # Materials of one name share an entry, so later statements add to or replace the earlier ones.
                defined = " ".join(" ".join(values).split())
                written = self._written.setdefault(defined, {})
                self._commented.setdefault(without_comment(defined), written)
                materials[defined] = written
            else:
                written[_SHORT.get(keyword, keyword)] = values
        self._divide_bytes(materials.values())

    def surface(self, name: str) -> Surface | None:
        """Return the surface of the material `name`; None, with a note, if no MTL file defines it.

        Names that differ by a comment share the surface, which is built once.
        """
        for names, each in ((self._written, name), (self._written, without_comment(name)), (self._commented, name)):
            if each in names:
                written = names[each]
                if id(written) not in self._surfaces:
                    self._surfaces[id(written)] = _Reader(self, name, written).surface()
                built = self._surfaces[id(written)]
                return replace(built, material=replace(built.material, name=name))
        self._note(f'The material "{name}", which no file defines.')
        return None

    def _divide_bytes(self, materials: Collection[dict[str, list[str]]]) -> None:
        """Divide the colours of a file by 255, with a note, if its Kd values are from 0 to 255."""
        for keyword in ("kd", "ks", "ke", "tf"):
            rows = [each[keyword] for each in materials if all(map(_is_number, each.get(keyword, ["none"])))]
            numbers = np.array([real(word) for row in rows for word in row])
            highest = numbers.max(initial=0.0)
            if keyword == "kd":
                if not _MAX_FRACTION < highest <= 255 or ((numbers > 0) & (numbers < 1)).any():
                    return
                self._note(f"Kd of {highest:g}, which is more than 1: white is taken to be 255.")
            if highest > 1:
                for row in rows:
                    row[:] = [repr(real(word) / 255) for word in row]

    def slot(
        self, key: tuple[object, ...], make: Callable[[], Image], given: _Map, srgb: bool, new_bytes: int = 0
    ) -> TextureSlot | None:
        """Return the texture slot of an image, which is made once for each `key`.

        Returns None, with a note, if the converted images take too much memory for the size of their files.

        new_bytes : bytes of an image that is made; 0 for a view of a picture
        """
        wrap: Literal["clamp", "repeat"] = "clamp" if given.clamped else "repeat"
        key = (*key, srgb, wrap)
        if key not in self._numbers:
            try:
                self.pictures.unfolded.add_derived(new_bytes)
            except ValueError as error:
                self.pictures.files.unusable[given.name] = f"which cannot be used, because {error}"
                return None
            image = make()
            self.textures.append(
                Texture(given.name, image, srgb=srgb and image.dtype == np.uint8, wrap=(wrap, wrap))
            )
            self._numbers[key] = len(self.textures) - 1
        return TextureSlot(self._numbers[key], 0, given.matrix)

    def check(self, image: Image, check: Callable[[Image], bool]) -> bool:
        """Return the result of a check of a picture, which is made once for each picture."""
        key = (id(image), check)
        if key not in self._checks:
            self._checks[key] = check(image)
        return self._checks[key]

    def _note(self, text: str) -> None:
        self.notes[text] = None


@dataclass
class _Reader:
    library: Library
    name: str
    written: dict[str, list[str]]

    def surface(self) -> Surface:
        maps = {key: self._map(key) for key in _MAPS}
        base, alpha = maps["map_kd"], maps["map_d"]
        diffuse = self._tint("kd", 1.0 if base is not None else 0.8)
        specular = self._colour("ks", 0.0)
        illum, opacity = self._illumination()
        if any(key in self.written for key in ("pr", "pm", "map_pr", "map_pm")):
            fields = self._metallic_roughness(diffuse, maps["map_pr"], maps["map_pm"])
            transmission = float(self._colour("tf", 0.0).mean())
            if transmission and illum not in _GLASS:
                fields |= {"transmission": transmission, "thin": False, "ior": self._index()}
        else:
            if illum in (0, 1):
                specular = np.zeros(3)
            exponent = self._number("ns", 0.0)
            fields = phong.layers(diffuse, base is not None, specular, exponent, mirror=illum in _MIRRORS)
        glass = self._glass(illum, opacity, diffuse)
        if glass:
            fields |= glass
            opacity = 1.0
        elif opacity == 0:
            # Some programs write transparency as d, and an invisible surface is never intended.
            self.library.notes["d of 0, by which a surface would not be there: it is opaque."] = None
            opacity = 1.0
        if layers := self._layers():
            if "roughness" not in fields:
                fields |= {"roughness": 1.0, "specular_weight": 0.0}  # a matte surface with layers
            fields |= layers
        texture = self._base_slot(base, alpha)
        emission = np.maximum(self._tint("ke", 1.0 if maps["map_ke"] is not None else 0.0, limited=False), 0.0)
        self._note_unused_maps()
        material = Material(
            name=self.name,
            texture=texture,
            opacity=opacity,
            alpha="blend" if opacity < 1 or alpha is not None else "opaque",
            emission_texture=self._slot(maps["map_ke"], is_light=True) if emission.any() else None,
            **self._normal(maps["norm"], maps["map_bump"]),
            **fields,
        )
        return Surface(material, emission)

    def _metallic_roughness(self, base: Float64, rough: _Map | None, metal: _Map | None) -> dict[str, Any]:
        fields: dict[str, Any] = {
            "reflectance": base,
            "roughness": self._share_without_map("pr", rough, 0.5),
            "metallic": self._share_without_map("pm", metal, 0.0),
        }
        given = rough or metal
        if given is not None:
            height, width = given.image.shape[:2]

            def packed() -> Image:
                white = np.full((height, width), 255, np.uint8)
                # Channels as in glTF: roughness in green, metallic in blue.
                greys = (None if each is None else _grey(each) for each in (rough, metal))
                scaled = [white if grey is None else resized(grey, (height, width)) for grey in greys]
                return np.stack([white, *scaled], axis=2)

            self._same_slot(rough, metal, "map_Pr and map_Pm")
            parts = (None if each is None else (id(each.image), each.index) for each in (rough, metal))
            key = ("surface", *parts)
            fields["surface_texture"] = self.library.slot(key, packed, given, False, 3 * height * width)
        return fields

    def _share_without_map(self, keyword: str, texture: _Map | None, default: float) -> float:
        """Return the share of a keyword; 1, with a note if another is written, if a texture replaces the share."""
        if texture is None:
            return self._share(keyword, default)
        if self._share(keyword, 1.0) != 1:
            name = keyword.capitalize()
            self.library.notes[f"{name} beside map_{name}, which replaces it."] = None
        return 1.0

    def _layers(self) -> dict[str, Any]:
        """Return fields of a `Material` for clearcoat, sheen and anisotropy; empty if the material has none."""
        coat, sheen, anisotropy = (self._share(key, 0.0) for key in ("pc", "ps", "aniso"))
        fields: dict[str, Any] = {}
        if coat:
            fields |= {"clearcoat": coat, "clearcoat_roughness": self._share("pcr", 0.0)}
        if sheen:
            fields |= {"sheen": np.full(3, sheen), "sheen_roughness": _SHEEN_ROUGHNESS}
        if anisotropy:
            fields |= {"anisotropy": anisotropy, "anisotropy_angle": 360.0 * self._number("anisor", 0.0)}
        return fields

    def _note_unused_maps(self) -> None:
        for key in self.written:
            if key == "map_ka" and "map_kd" in self.written:
                continue  # it usually repeats map_Kd
            is_map = key in _UNUSED_MAPS or (key.startswith("map_") and key not in (*_MAPS, *_NO_MAPS))
            if is_map and len(self.library.notes) < _MAX_NOTES:
                self.library.notes[f"Textures of {key[:40]}."] = None

    def _illumination(self) -> tuple[int, float]:
        """Return illum and the opacity. illum is 2 if an exporter writes a mode of glass for a blended surface."""
        illum = int(self._number("illum", 2.0))
        opacity = float(phong.share(self._opacity()))
        passes = self._filter()
        if illum in (6, 9) and 0 < opacity < 1 and passes is None:
            return 2, opacity  # as Blender writes alpha; d 0 is more likely clear glass
        if illum == 4 and passes is not None and self._number("ni", 1.5) == 1 and not {"d", "tr"} & {*self.written}:
            return 2, float(passes.mean())  # as Maya writes transparency
        return illum, opacity

    def _opacity(self) -> float:
        values = [word for word in self.written.get("d", []) if word != "-halo"]
        if values:
            return _number(values[0], 1.0)
        transparency = self._number("tr", 0.0)
        if transparency == 1:
            # Some programs write opacity as Tr, and an invisible surface is never intended.
            self.library.notes["Tr of 1 without d, by which a surface would not be there: it is opaque."] = None
            return 1.0
        return 1.0 - transparency

    def _filter(self) -> Float64 | None:
        """Return Tf, the (3,) colour of glass; None if it is 0 or 1, which exporters write for any surface."""
        colour = self._colour("tf", 0.0)
        return colour if colour.any() and (colour != 1).any() else None

    def _glass(self, illum: int, opacity: float, diffuse: Float64) -> dict[str, Any]:
        """Return the fields of a `Material` of glass; empty if the material is not glass."""
        passes = self._filter()
        if illum not in _GLASS or (illum not in _REFRACTS and opacity >= 1 and passes is None):
            return {}  # many exporters write illum 4 and 9 for opaque surfaces
        if passes is None:
            passes = diffuse if illum not in _REFRACTS and np.ptp(diffuse) > 0 else np.ones(3)
        return {
            "reflectance": passes,
            "transmission": 1.0 - opacity if opacity < 1 else 1.0,
            "thin": illum not in _REFRACTS,
            "ior": self._index(),
            "roughness": 0.0,
            "metallic": 0.0,
            "specular_colour": np.ones(3),
        }

    def _index(self) -> float:
        """Return Ni, the index of refraction, clamped to [1, 10]."""
        return float(np.clip(self._number("ni", 1.5), 1.0, 10.0))

    def _base_slot(self, base: _Map | None, alpha: _Map | None) -> TextureSlot | None:
        """Return the slot of a texture with map_Kd as colours and map_d as alpha; None if there is neither."""
        if base is None and alpha is None:
            return None
        if alpha is None:
            assert base is not None
            return self._slot(base)
        given = base or alpha
        height, width = given.image.shape[:2]

        def composed() -> Image:
            is_base = base is not None and base.image is alpha.image
            coverage = resized(_alpha(alpha, is_base), (height, width))
            if base is None:
                return np.dstack([np.full((height, width, 3), 255, np.uint8), coverage])
            return np.dstack([_bytes(base.image)[..., :3], coverage])

        if base is not None:
            self._same_slot(base, alpha, "map_Kd and map_d")
        uses_alpha = alpha.channel is None
        key = (None if base is None else id(base.image), "alpha", id(alpha.image), uses_alpha, alpha.index)
        return self.library.slot(key, composed, given, True, 4 * height * width)

    def _normal(self, norm: _Map | None, bump: _Map | None) -> dict[str, Any]:
        given = norm or bump
        if given is None:
            return {}
        if norm is not None and bump is not None and norm.image is not bump.image:
            self.library.notes["Textures of map_bump beside norm."] = None
        if norm is None and not self.library.check(given.image, _holds_normals):
            self.library.notes["Maps of heights (map_Bump); normal maps are used."] = None
            return {}
        return {
            "normal_texture": self.library.slot(
                (id(given.image), "data"), lambda: _data_bytes(given.image)[..., :3], given, False
            ),
            "normal_scale": given.multiplier,
        }

    def _slot(self, given: _Map | None, *, is_light: bool = False) -> TextureSlot | None:
        """Return the slot of a texture of colours, clipped with a note if they are out of range; None without one.

        is_light : True if colours above 1 are in range
        """
        if given is None:
            return None
        colours: Image = given.image[..., :3]
        if self.library.check(given.image, _is_light if is_light else _is_reflectance):
            return self.library.slot((id(given.image),), lambda: colours, given, True)
        self.library.notes[
            f'Colours of "{given.name}" below 0{"" if is_light else " or above 1"}: they are clipped.'
        ] = None
        clipped = (id(given.image), is_light)
        maximum = np.inf if is_light else 1.0
        return self.library.slot(
            clipped, lambda: np.asarray(np.clip(colours, 0.0, maximum), np.float32), given, True, colours.nbytes
        )

    def _same_slot(self, first: _Map | None, second: _Map | None, names: str) -> None:
        if first is not None and second is not None and not np.array_equal(first.matrix, second.matrix):
            self.library.notes[f"Options -o and -s that differ between {names}: the first's are used."] = None

    def _map(self, keyword: str) -> _Map | None:
        text = " ".join(self.written.get(keyword, ()))
        if len(text) > _MAX_STATEMENT:
            self.library.notes[f"Textures in statements of more than {_MAX_STATEMENT:,} letters."] = None
            return None
        text = _with_options_first(text)
        words, at = text.split(), 0
        scale, offset = np.ones(2), np.zeros(2)
        clamped, channel, multiplier = False, None, 1.0
        while at < len(words) and words[at].startswith("-"):
            check_time()
            option = words[at].lower()
            at += 1
            if option in ("-s", "-o", "-t"):
                numbers: list[float] = []
                while at + 1 < len(words) and len(numbers) < 3 and _is_number(words[at]):
                    numbers.append(_number(words[at], 1.0))
                    at += 1
                target = {"-s": scale, "-o": offset}.get(option)
                if target is not None:
                    target[: len(numbers[:2])] = numbers[:2]
                elif any(numbers):
                    self._note_option(option)
                continue
            values = words[at : at + _OPTIONS.get(option, 0)]
            at += len(values)
            if option == "-clamp":
                clamped = values[:1] == ["on"]
            elif option == "-imfchan" and values:
                channel = values[0].lower()
            elif option == "-bm" and values:
                multiplier = _number(values[0], 1.0)
            elif option in _UNUSED_OPTIONS:
                given = [_number(value, float(value.lower() != "off")) for value in values]
                if given != _UNUSED_OPTIONS[option]:
                    self._note_option(option)
        if at >= len(words):
            return None
        name = text.split(maxsplit=at)[-1]
        image = self.library.pictures.picture(name)
        if image is None:
            return None
        matrix = np.column_stack([np.diag(scale), offset])
        return _Map(image, name, matrix, clamped, channel, multiplier)

    def _note_option(self, option: str) -> None:
        self.library.notes[f"The option {option} of textures."] = None

    def _tint(self, keyword: str, default: float, *, limited: bool = True) -> Float64:
        """Return the (3,) colour of a keyword, which may have a texture.

        If the colour is 0 but has a texture, return the default and add a note, because their product would be
        black.
        """
        colour = self._colour(keyword, default, limited=limited)
        name = keyword.capitalize()
        if colour.any() or not default or f"map_{keyword}" not in self.written:
            return colour
        # Maya writes Kd 0 0 0 if a texture replaces the colour.
        self.library.notes[f"{name} of 0 beside map_{name}, by which the texture would be black."] = None
        return np.full(3, default)

    def _colour(self, keyword: str, default: float, *, limited: bool = True) -> Float64:
        """Return the (3,) colour of a keyword, which has one number or three.

        If the colour is a spectrum or CIE XYZ, return the default and add a note.

        limited : True to clamp the colour to [0, 1]
        """
        words = self.written.get(keyword, [])
        if not words:
            return np.full(3, default)
        if words[0].lower() in ("spectral", "xyz"):
            self.library.notes["Colours that are spectra or CIE XYZ."] = None
            return np.full(3, default)
        values = [self._value(keyword, word, default) for word in words[:3]]
        colour = np.array(values if len(values) == 3 else values[:1] * 3)
        return phong.share(colour) if limited else colour

    def _number(self, keyword: str, default: float) -> float:
        words = self.written.get(keyword, [])
        return self._value(keyword, words[0], default) if words else default

    def _value(self, keyword: str, word: str, default: float) -> float:
        """Return the number of a word; the default, with a note, if the word is not a finite number."""
        if not _is_number(word):
            self.library.notes[f'"{keyword} {word[:40]}" of "{self.name}", which is not a finite number.'] = None
        return _number(word, default)

    def _share(self, keyword: str, default: float) -> float:
        return float(phong.share(self._number(keyword, default)))


def _with_options_first(text: str) -> str:
    """Return the values of a texture statement, with options after the file name moved before it."""
    trailing = _TRAILING_OPTIONS.search(text)
    return text if trailing is None else f"{trailing[0].strip()} {text[: trailing.start()]}"


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(real(word))
    except ValueError:
        return False


def _number(word: str, default: float) -> float:
    """Return the number of a word, clamped to ±1e15 for 32-bit floats; the default if it is not a finite number."""
    return max(-1e15, min(real(word), 1e15)) if _is_number(word) else default


def _bytes(image: Image) -> NDArray[np.uint8]:
    """Return the levels of colours; floats are encoded as sRGB."""
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    from glpath.system.colour import encode_srgb

    return np.asarray(encode_srgb(np.asarray(image, np.float64)) * 255 + 0.5, np.uint8)


def _data_bytes(image: Image) -> NDArray[np.uint8]:
    """Return the levels of values that are no colours; floats from 0 to 1 are scaled linearly."""
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    return np.asarray(np.clip(np.asarray(image, np.float32), 0.0, 1.0) * 255 + 0.5, np.uint8)


def _is_light(image: Image) -> bool:
    """Return True if no colour of a picture is below 0."""
    return image.dtype == np.uint8 or bool(image[..., :3].min() >= 0)


def _is_reflectance(image: Image) -> bool:
    """Return True if all colours of a picture are from 0 to 1."""
    return image.dtype == np.uint8 or (_is_light(image) and bool(image[..., :3].max() <= 1))


def _holds_normals(image: Image) -> bool:
    """Return True if the colours of a picture look like normals n that are stored as (n + 1) / 2."""
    step = max(1, math.isqrt(image.shape[0] * image.shape[1] // _SAMPLED_PIXELS))
    stored = _data_bytes(image[::step, ::step, :3])
    lengths = np.linalg.norm(stored / 127.5 - 1.0, axis=2)
    shortest, longest = _NORMAL_LENGTHS
    has_colours = bool(np.ptp(stored, axis=2).any())
    is_blue = bool(stored[..., 2].mean() > 255 * _MIN_BLUE)
    return has_colours and is_blue and shortest <= float(np.median(lengths)) <= longest


def _grey(given: _Map) -> NDArray[np.uint8]:
    """Return one channel (h, w) of a map: the channel that -imfchan names, otherwise the mean of the colours."""
    image = _data_bytes(given.image)
    if given.index < image.shape[2]:
        return np.ascontiguousarray(image[..., given.index])
    # Six times (mean + 0.5), in integers of 16 bits, because floats would take eight times the memory.
    total = image[..., 0].astype(np.uint16)
    for index in (1, 2):
        total += image[..., index]
    return np.asarray((2 * total + 3) // 6, np.uint8)


def _alpha(given: _Map, has_colours: bool) -> NDArray[np.uint8]:
    """Return the opacity (h, w) of a map: its alpha, unless -imfchan is given; otherwise its grey values.

    A grey picture with an opaque alpha is a mask, too, so it has its grey values.

    has_colours : True if the picture also gives colours, so that its grey values are no mask
    """
    image = _data_bytes(given.image)
    if given.channel is None and image.shape[2] == 4:
        alpha = image[..., 3]
        if has_colours or alpha.min() < 255 or (image[..., :1] != image[..., 1:3]).any():
            return np.ascontiguousarray(alpha)
    return _grey(given)
