"""Materials and their textures as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from operator import attrgetter
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.scene.directional_albedo import SMOOTH as SMOOTH
from glpath.scene.directional_albedo import (
    boundary_reflectance,
    burley_albedo,
    hemispherical_albedo,
    plastic_entry,
)
from glpath.scene.geometry import Float64
from glpath.scene.iridescence import film_reflects
from glpath.scene.slab import between_faces, hemispherical
from glpath.system.arguments import check_count, check_word, checked_fields, short_repr
from glpath.system.colour import decode_srgb
from glpath.system.vectors import LARGEST, vector

Wrap = Literal["repeat", "clamp", "mirror"]
Layering = Literal["gltf", "plastic", "disney", "beside"]
_MAX_REFLECTED = 0.97
# Roughness above which a dielectric's highlight is so wide that it looks diffuse.
_MATTE = 0.8
#: Minimum alpha of sheen. Below it, Charlie's distribution is a rim that no pixel resolves, with an albedo of
#: several times 1.
SHEEN_MIN_ALPHA = 0.01
#: Number of cells of the table of white sheen's albedo, along the fourth root of alpha.
SHEEN_CELLS = 24
#: Coefficients a to e of Charlie's fitted lambda, for alpha = 0 and for alpha = 1 [Estevez & Kulla 2017, table 1].
CHARLIE_LAMBDA = (
    (25.3245, 3.32435, 0.16801, -1.27393, -4.85967),
    (21.5473, 3.82987, 0.19823, -1.97760, -4.32054),
)
# Value of each byte of an image with linear values.
_LINEAR = (np.arange(256) / 255.0).astype(np.float32)
# Linear value of each byte of an sRGB colour.
_FROM_SRGB = decode_srgb(np.arange(256) / 255.0).astype(np.float32)
# Maximum of a fraction; rounding errors of readers may exceed 1.
_ONE = 1.0 + 1e-6
# Maximum number of letters of a name in messages.
_NAME_LENGTH = 60
# Maximum index of a texture.
_MAX_TEXTURES = (1 << 31) - 1
# Smallest and largest number of each field of a `Material` that is a colour. Attenuation may be very large, because
# files give it as the colour that is left after a short distance.
_COLOURS = (
    ("reflectance", 0.0, _ONE),
    ("specular", 0.0, LARGEST),
    ("mirror", 0.0, _ONE),
    ("specular_colour", 0.0, LARGEST),
    ("attenuation", 0.0, 1e300),
    ("sheen", 0.0, _ONE),
    ("diffuse_transmission_colour", 0.0, _ONE),
)
# Smallest and largest value of each field that is a number.
_NUMBERS = (
    ("exponent", 0.0, LARGEST),
    ("roughness", 0.0, _ONE),
    ("metallic", 0.0, _ONE),
    ("anisotropy", 0.0, _ONE),
    ("anisotropy_angle", -LARGEST, LARGEST),
    ("ior", 1.0, LARGEST),
    ("specular_weight", 0.0, _ONE),
    ("transmission", 0.0, _ONE),
    ("clearcoat", 0.0, _ONE),
    ("clearcoat_roughness", 0.0, _ONE),
    ("sheen_roughness", 0.0, _ONE),
    ("diffuse_transmission", 0.0, _ONE),
    ("iridescence", 0.0, _ONE),
    ("iridescence_ior", 1.0, LARGEST),
    ("iridescence_thickness", 0.0, LARGEST),
    ("iridescence_thickness_min", 0.0, LARGEST),
    ("opacity", 0.0, _ONE),
    ("cutoff", -LARGEST, LARGEST),
    ("normal_scale", -LARGEST, LARGEST),
    ("clearcoat_normal_scale", -LARGEST, LARGEST),
)
# Allowed words of each field that is a word.
_WORDS = {
    "distribution": ("ggx", "beckmann"),
    "layering": get_args(Layering),
    "alpha": ("opaque", "mask", "blend"),
}
#: The fields of a `Material` that are texture slots.
SLOTS = (
    "texture",
    "surface_texture",
    "normal_texture",
    "emission_texture",
    "transmission_texture",
    "clearcoat_texture",
    "clearcoat_roughness_texture",
    "clearcoat_normal_texture",
    "anisotropy_texture",
    "specular_texture",
    "specular_colour_texture",
    "iridescence_texture",
    "iridescence_thickness_texture",
    "diffuse_transmission_texture",
    "diffuse_transmission_colour_texture",
    "sheen_texture",
    "sheen_roughness_texture",
)


_slot_values = attrgetter(*SLOTS)


@checked_fields
@dataclass(frozen=True)
class Texture:
    """Image that colours surfaces, by default repeated endlessly. A checker is an unfiltered image of 2 x 2 texels.

    image  : (h, w, 3) or, with alpha, (h, w, 4), row 0 at the top, where v = 1. float32, linear Rec. 709; or uint8,
             where 255 stands for 1
    scale  : repeats per unit of u and of v
    filter : "linear" or "nearest"
    srgb   : True if uint8 colours are sRGB; False if they are linear, like data other than colours. Alpha is linear
    wrap   : what u and what v below 0 and above 1 show: repetitions, the edge, or mirrored repetitions
    """

    name: str
    image: NDArray[np.float32] | NDArray[np.uint8]
    scale: tuple[float, float] = (1.0, 1.0)
    filter: Literal["linear", "nearest"] = "linear"
    srgb: bool = False
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")

    def linear(self) -> NDArray[np.float32]:
        """Return the (h, w, 3) or (h, w, 4) float32 image with linear Rec. 709 colours."""
        if self.image.dtype != np.uint8:
            return np.asarray(self.image, np.float32)
        linear = _LINEAR[self.image]
        if self.srgb:
            linear[..., :3] = self._colours[self.image[..., :3]]
        return linear

    @property
    def _colours(self) -> NDArray[np.float32]:
        """Linear value (256,) of each byte of a colour."""
        return _FROM_SRGB if self.srgb else _LINEAR

    @cached_property
    def mean(self) -> Float64:
        """Mean (3,) float64 of all texels, linear Rec. 709, weighted by alpha if the image has it."""
        image = self.linear()
        weight = image[..., 3] if image.shape[2] == 4 and image[..., 3].any() else None
        colours = image[..., :3].reshape(-1, 3).astype(np.float64)
        return np.average(colours, axis=0, weights=None if weight is None else weight.ravel())

    @cached_property
    def max(self) -> Float64:
        """Maximum (3,) float64 of each channel, linear Rec. 709."""
        # Axis by axis, because numpy is then many times as fast. Larger bytes are brighter colours.
        largest = self.image.max(axis=0).max(axis=0)[:3]
        largest = self._colours[largest] if self.image.dtype == np.uint8 else largest.astype(np.float32)
        return np.asarray(largest, np.float64)


@checked_fields
@dataclass(frozen=True)
class TextureSlot:
    """Use of a texture by a material.

    texture      : index into `Scene.textures`
    uv_set       : texture coordinates of the mesh: 0 is `Mesh.uv`, 1 is `Mesh.uv1`
    uv_transform : (2, 3) float64, affine map applied to the coordinates before the look-up
    """

    texture: int
    uv_set: Literal[0, 1] = 0
    uv_transform: Float64 = field(default_factory=lambda: np.eye(2, 3))

    def __post_init__(self) -> None:
        check_count("TextureSlot.texture", self.texture, 0, _MAX_TEXTURES)
        check_count("TextureSlot.uv_set", self.uv_set, 0, 1)
        matrix = np.asarray(self.uv_transform, np.float64)
        if matrix.shape != (2, 3) or not np.isfinite(matrix).all():
            raise SceneError(f"TextureSlot.uv_transform: {short_repr(matrix)}, but must be 2 x 3 finite numbers.")
        object.__setattr__(self, "uv_transform", matrix)


@checked_fields
@dataclass(frozen=True)
class Material:
    """Material: a base, diffuse or of metal, under specular layers.

    The base may have a roughness. With one, it is glTF's metallic-roughness surface [glTF 2.0, appendix B]: GGX
    microfacets [Walter et al. 2007] over a Lambertian base, over metal, or over glass. Without one, it is
    Lambertian, with Phong's highlight and a mirror [TB IV].

    reflectance      : (3,) float64 in [0, 1], linear Rec. 709. Reflectance of the diffuse base, or of metal at
                       normal incidence; for glass, the fraction that is transmitted
    two_sided        : False makes the back black, but it still blocks light; the back of glass is its inside
    culled           : True if the back of a one-sided material does not exist for eyes, bounces and shadow rays;
                       glass keeps its back
    specular         : (3,) float64 >= 0, Phong's coefficient
    exponent         : Phong's exponent, > 0
    mirror           : (3,) float64 in [0, 1], fraction of the light from the mirror direction
    roughness        : roughness in [0, 1], whose square is GGX's alpha; None for a base without microfacets
    metallic         : fraction of metal in [0, 1]
    anisotropy       : number in [0, 1]; its square mixes alpha along the tangent towards 1
                       [KHR_materials_anisotropy]
    anisotropy_angle : degrees, from the direction in which u grows towards that in which v grows; u and v are those
                       of the normal texture, else of the anisotropy texture, else the first texture coordinates
    ior              : index of refraction of a dielectric, >= 1
    specular_weight  : factor in [0, 1] of the dielectric's reflection at all angles; specular_colour (3,)
                       multiplies its reflection at normal incidence only
    transmission     : fraction in [0, 1] of the base that is glass instead of diffuse
    thin             : True for a thin dielectric, which does not refract; False for the surface of a solid that
                       does
    slab             : True if a smooth thin dielectric reflects at both faces, with all reflections between them.
                       Its reflectance is then what the glass transmits in one crossing (`glpath.scene.slab`).
                       False: it reflects at one face by Schlick's formula, as in glTF
    attenuation      : (3,) float64 >= 0 per scene unit, absorption inside a solid (Beer's law)
    clearcoat        : fraction in [0, 1] covered by a clearcoat of index 1.5; with clearcoat_roughness
    sheen            : (3,) float64 in [0, 1], colour of the sheen over all layers but the clearcoat; with
                       sheen_roughness, for which values below 0.1 count as 0.1 [KHR_materials_sheen]
    diffuse_transmission : fraction in [0, 1] of the diffuse base that scatters its light to the other side. Its
                           colour is diffuse_transmission_colour (3,) instead of reflectance
                           [KHR_materials_diffuse_transmission]
    iridescence      : fraction in [0, 1] of the reflection of metal and dielectric that is under a thin film
    iridescence_ior  : index of the film, >= 1; with iridescence_thickness in nm, and iridescence_thickness_min for
                       texels that are 0 [KHR_materials_iridescence]
    distribution     : distribution of microfacet normals, GGX or Beckmann, for the same alpha
    metal_index      : (2, 3) float64, n and k of metal in air, for Fresnel's equations; `reflectance` remains its
                       reflectance at normal incidence. None: Schlick's formula
    layering         : model of the dielectric and the base below. "gltf": Schlick's formula; the base receives what
                       the dielectric leaves. "plastic": Fresnel's equations; light of the base crosses the boundary
                       twice, and a thin dielectric reflects at both faces, unpolarized, as in Mitsuba. "disney":
                       Fresnel's equations over Burley's base, which loses nothing; `anisotropy` is Burley's, and
                       solid glass takes the root of the reflectance at each crossing [Burley 2012, 2015]. "beside":
                       Fresnel's equations; glass covers its fraction of the surface, and a bare base the rest
    multiple_scattering : True keeps, approximately, light that microfacets scatter more than once; the base under a
                          dielectric receives all light that the dielectric does not reflect. False loses the light
                          scattered more than once, as in Mitsuba. It uses glTF's formula for the base, which is up
                          to 3 % brighter or darker
    unlit            : True if it shows only its emission, times vertex colours. Other light does not affect it, but
                       it lights others as any emitter does
    opacity          : opacity in [0, 1], multiplied by the alpha of the texture and of the vertices
    alpha            : effect of opacity. "opaque": none; "mask": all or nothing, from `cutoff` on; "blend": a
                       fraction of the light
    texture              : colour and alpha, which multiply reflectance and opacity
    surface_texture      : green multiplies roughness, blue multiplies metallic
    normal_texture       : normals in tangent space [glTF 2.0, 3.9.3], with x and y multiplied by normal_scale
    emission_texture     : colour that multiplies the emission of shapes
    transmission_texture : red multiplies transmission
    clearcoat_texture    : red multiplies clearcoat; green of clearcoat_roughness_texture multiplies its roughness
    clearcoat_normal_texture : normals of the clearcoat only, with x and y multiplied by clearcoat_normal_scale.
                               Without it the clearcoat has the vertex normals; normal_texture does not affect it
    anisotropy_texture   : red and green, from -1 to 1, are the tangent before rotation by the angle; blue
                           multiplies anisotropy
    iridescence_texture  : red multiplies iridescence; green of iridescence_thickness_texture interpolates between
                           the two thicknesses
    diffuse_transmission_texture : alpha multiplies diffuse_transmission; diffuse_transmission_colour_texture
                                   multiplies its colour
    sheen_texture        : colour multiplies sheen; alpha of sheen_roughness_texture multiplies its roughness
    specular_texture     : alpha multiplies specular_weight; specular_colour_texture multiplies specular_colour

    Raises UsageError for fields of a wrong type, and SceneError for numbers outside of their range.
    """

    name: str
    reflectance: Float64
    two_sided: bool = True
    specular: Float64 = field(default_factory=lambda: np.zeros(3))
    exponent: float = 32.0
    mirror: Float64 = field(default_factory=lambda: np.zeros(3))
    texture: TextureSlot | None = None
    roughness: float | None = None
    metallic: float = 0.0
    anisotropy: float = 0.0
    anisotropy_angle: float = 0.0
    ior: float = 1.5
    specular_weight: float = 1.0
    specular_colour: Float64 = field(default_factory=lambda: np.ones(3))
    transmission: float = 0.0
    thin: bool = True
    slab: bool = False
    attenuation: Float64 = field(default_factory=lambda: np.zeros(3))
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen: Float64 = field(default_factory=lambda: np.zeros(3))
    sheen_roughness: float = 0.0
    diffuse_transmission: float = 0.0
    diffuse_transmission_colour: Float64 = field(default_factory=lambda: np.ones(3))
    iridescence: float = 0.0
    iridescence_ior: float = 1.3
    iridescence_thickness: float = 400.0
    iridescence_thickness_min: float = 100.0
    distribution: Literal["ggx", "beckmann"] = "ggx"
    metal_index: Float64 | None = None
    layering: Layering = "gltf"
    multiple_scattering: bool = True
    culled: bool = False
    unlit: bool = False
    opacity: float = 1.0
    alpha: Literal["opaque", "mask", "blend"] = "opaque"
    cutoff: float = 0.5
    surface_texture: TextureSlot | None = None
    normal_texture: TextureSlot | None = None
    normal_scale: float = 1.0
    emission_texture: TextureSlot | None = None
    transmission_texture: TextureSlot | None = None
    clearcoat_texture: TextureSlot | None = None
    clearcoat_roughness_texture: TextureSlot | None = None
    clearcoat_normal_texture: TextureSlot | None = None
    clearcoat_normal_scale: float = 1.0
    anisotropy_texture: TextureSlot | None = None
    specular_texture: TextureSlot | None = None
    specular_colour_texture: TextureSlot | None = None
    iridescence_texture: TextureSlot | None = None
    iridescence_thickness_texture: TextureSlot | None = None
    diffuse_transmission_texture: TextureSlot | None = None
    diffuse_transmission_colour_texture: TextureSlot | None = None
    sheen_texture: TextureSlot | None = None
    sheen_roughness_texture: TextureSlot | None = None

    def __post_init__(self) -> None:
        where = f"material {self.name[:_NAME_LENGTH]!r}: "
        for name, words in _WORDS.items():
            check_word(where + name, getattr(self, name), words)
        for name, low, high in _COLOURS:
            object.__setattr__(self, name, vector(where + name, getattr(self, name), low, high))
        for name, low, high in _NUMBERS:
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise SceneError(f"{where}{name}: {short_repr(value)}, but must be from {low:g} to {high:g}.")
        if self.metal_index is not None:
            index = np.asarray(self.metal_index, np.float64)
            if index.shape != (2, 3) or not np.isfinite(index).all():
                raise SceneError(f"{where}metal_index: {short_repr(index)}, but must be 2 x 3 finite numbers.")

    @property
    def has_lobes(self) -> bool:
        """True if the material has a mirror or microfacets, not just Lambertian or Phong reflection."""
        return self.roughness is not None or bool(np.any(self.mirror > 0))

    @property
    def is_matte(self) -> bool:
        """True if the material looks nearly the same from all directions: its only lobes are rough microfacets."""
        smooth = self.roughness is None or self.roughness < _MATTE or self.surface_texture is not None
        more = (self.metallic, self.transmission, self.clearcoat, self.iridescence, self.diffuse_transmission)
        return not smooth and not any(more) and not np.any(self.sheen > 0) and not np.any(self.mirror > 0)

    @property
    def lets_light_through(self) -> bool:
        """True if rays may pass the material, because of its opacity or through a culled back."""
        return self.alpha != "opaque" or self.culled

    @property
    def needs_uv(self) -> bool:
        """True if shapes of the material need texture coordinates, for textures or for the tangent's direction."""
        return bool(self.slots) or (self.roughness is not None and self.anisotropy > 0)

    @property
    def is_smooth(self) -> bool:
        """True if the material's microfacets form a mirror, or glass that one can see through."""
        return self.roughness is not None and self.roughness**2 < SMOOTH and self.anisotropy == 0

    @property
    def keeps_energy(self) -> bool:
        """True if multiple scattering is kept, or the base receives all light that a dielectric leaves."""
        if self.roughness is None or not self.multiple_scattering:
            return False
        has_base = self.metallic < 1 and self.transmission < 1 and self.specular_weight > 0
        return has_base or self.scatters_repeatedly

    @property
    def scatters_repeatedly(self) -> bool:
        """True for rough metal or rough glass, whose microfacets scatter much of the light more than once."""
        rough = self.roughness is not None and not self.is_smooth
        return rough and (self.metallic > 0 or self.transmission > 0)

    @property
    def is_clear(self) -> bool:
        """True for a mirror or for see-through glass, which show sharp images."""
        if self.roughness is None:
            return bool(np.any(self.mirror > 0))
        return self.is_smooth and (self.metallic > 0 or self.transmission > 0)

    @property
    def is_thin_dielectric(self) -> bool:
        """True for glass that light passes without refraction."""
        return self.is_smooth and self.transmission > 0 and self.thin

    @property
    def is_slab(self) -> bool:
        """True for glass that light passes without refraction, and that reflects at both faces."""
        return self.slab and self.is_thin_dielectric

    @property
    def dielectric(self) -> tuple[Float64, float]:
        """Reflectance of the material's dielectric at normal incidence, (3,) float64, and at grazing incidence.

        Fresnel's equations give the first from the index. glTF's KHR_materials_specular adds a colour and a weight.
        """
        return np.minimum(self.dielectric_ratio, 1.0) * self.specular_weight, self.specular_weight

    @property
    def dielectric_ratio(self) -> Float64:
        """Ratio (3,) float64 of the reflectances at normal and at grazing incidence, not clipped to 1."""
        once = ((self.ior - 1.0) / (self.ior + 1.0)) ** 2
        if self.layering in ("plastic", "beside") and self.is_thin_dielectric:
            once = float(between_faces(once))
        return once * self.specular_colour

    @property
    def sheen_alpha(self) -> float:
        """Alpha of Charlie's distribution."""
        return float(max(self.sheen_roughness**2, SHEEN_MIN_ALPHA))

    @property
    def clear(self) -> float:
        """Fraction of the material's base that is glass, in [0, 1]."""
        return 0.0 if self.roughness is None else (1.0 - self.metallic) * self.transmission

    def hemispherical_reflectance(self, base: Float64, clear: float = 0.0) -> Float64:
        """Return the (3,) float64 fraction of uniform illumination that the material reflects or transmits.

        base  : (3,) reflectance of the base
        clear : fraction of the base whose transmitted light is not included

        Solvers that treat all surfaces as diffuse use this fraction. It is at most 0.97, because light between
        mirrors or clear surfaces would never die out. Roughness is ignored for glass and under a thin film. The
        cosine-weighted hemispherical mean of Schlick's formula is then f0 + (f90 - f0) / 21.
        """
        if not self.has_lobes:
            return base
        if self.roughness is None:
            return np.asarray(np.minimum(base + self.mirror, _MAX_REFLECTED))
        if self.is_slab:
            reflected, through = hemispherical(self.ior, base)
            return np.asarray(np.minimum(reflected + (1.0 - clear) * through, _MAX_REFLECTED))
        layer, sheen, coat = self._layers()
        kept = (1.0 - self.transmission) * (1.0 - self.diffuse_transmission)
        counted = max(self.transmission - clear / max(1.0 - self.metallic, 1e-9), 0.0)
        under = self.layer_share * layer + self.base_share * base * kept
        under = under + self._crossing * self.glass_colour(base) * counted
        if self.iridescence > 0:
            metal = self._under_film(base + (1.0 - base) / 21.0, base)
        else:
            metal = hemispherical_albedo(base, 1.0, self.roughness, self.multiple_scattering)
        covered = self.metallic * metal + (1.0 - self.metallic) * under
        if np.any(sheen > 0):
            covered = sheen + (1.0 - sheen.max()) * covered
        all_ = coat + (1.0 - coat) * covered
        return np.asarray(np.minimum(all_, _MAX_REFLECTED))

    def hemispherical_transmittance(self, base: Float64, clear: float = 0.0) -> Float64:
        """Return the (3,) float64 fraction of uniform illumination that the diffuse base sends to the other side.

        Its sum with `hemispherical_reflectance` is at most 0.97. Both have the same parameters.
        """
        if self.roughness is None or self.diffuse_transmission == 0:
            return np.zeros(3)
        _, sheen, coat = self._layers()
        left = (1.0 - coat) * (1.0 - sheen.max()) * self.base_share * (1.0 - self.metallic - clear)
        through = self.diffuse_transmission * left * self.diffuse_transmission_colour
        return np.asarray(np.clip(through, 0.0, _MAX_REFLECTED - self.hemispherical_reflectance(base, clear)))

    @property
    def schlick(self) -> tuple[Float64, float]:
        """Reflectances (3,) of the material's dielectric at normal and at grazing incidence, for Schlick's formula.

        If Fresnel's equations apply, the formula with these reflectances has the same mean over uniform light.
        """
        f0, f90 = self.dielectric
        if self.layering == "gltf":
            return f0, f90
        normal, mean = boundary_reflectance(self.ior, self.is_thin_dielectric)
        return np.asarray((21.0 * f0 * (mean / max(normal, 1e-9)) - f90) / 20.0), f90

    @property
    def layer_share(self) -> float:
        """Fraction of the part without metal that the dielectric covers."""
        return self.transmission if self.layering == "beside" else 1.0

    @property
    def _crossing(self) -> float:
        """Fraction of uniform light that crosses the boundary of the material's glass."""
        if self.layering == "gltf":
            return float(1.0 - self.dielectric_albedo.max())
        return 1.0 - boundary_reflectance(self.ior, self.is_thin_dielectric)[1]

    def glass_colour(self, base: Float64) -> Float64:
        """Return the transmittance of glass of colour `base` for light that is not reflected."""
        return np.sqrt(base) if self.layering == "disney" else base

    @property
    def dielectric_albedo(self) -> Float64:
        """Fraction (3,) float64 of uniform illumination that the material's dielectric reflects."""
        assert self.roughness is not None
        f0, f90 = self.schlick
        if self.iridescence > 0 and self.layering == "gltf":
            return self._under_film(f0 + (f90 - f0) / 21.0, f0)
        if self.transmission > 0:
            return np.asarray(f0 + (f90 - f0) / 21.0)
        return hemispherical_albedo(f0, f90, self.roughness, self.multiple_scattering)

    @property
    def base_share(self) -> float:
        """Fraction of uniform illumination that a white base returns, through its dielectric if it has one."""
        if self.layering == "plastic" and self.transmission < 1:
            assert self.roughness is not None
            return plastic_entry(self.ior, self.roughness**2, self.distribution)[1] ** 2
        if self.layering == "disney":
            assert self.roughness is not None
            return burley_albedo(self.roughness)
        if self.layering == "beside":
            return 1.0
        return float(1.0 - self.dielectric_albedo.max())

    def _layers(self) -> tuple[Float64, Float64, float]:
        """Return the fractions of uniform illumination that dielectric (3,), sheen (3,) and clearcoat reflect.

        Each is computed as if the others were absent.
        """
        layer, sheen = self.dielectric_albedo, np.zeros(3)
        if np.any(self.sheen > 0):
            cosine = (np.arange(32) + 0.5) / 32
            sheen = self.sheen * 2.0 * np.mean(cosine * np.minimum(sheen_albedo(cosine, self.sheen_alpha), 1.0))
        return layer, sheen, self.clearcoat * (0.04 + 0.96 / 21.0)

    def _under_film(self, plain: Float64, f0: Float64) -> Float64:
        """Return the (3,) reflectance for uniform illumination of a surface that is partly under a film."""
        cosine = (np.arange(32) + 0.5) / 32
        film = film_reflects(cosine, self.iridescence_thickness, self.iridescence_ior, f0)
        seen = 2.0 * np.mean(cosine[:, None] * film, axis=0)
        return np.asarray((1.0 - self.iridescence) * plain + self.iridescence * seen)

    def described(self) -> str:
        """Return a short description of the material's properties other than diffuse; "" if there are none."""
        words = ["texture"] * (self.texture is not None) + ["highlight"] * bool(np.any(self.specular > 0))
        words += ["mirror"] * bool(np.any(self.mirror > 0))
        if self.roughness is not None:
            words.append(f"roughness {self.roughness:g}")
            words += [f"metal {self.metallic:g}"] * (self.metallic > 0)
            words += [f"glass {self.transmission:g}, index {self.ior:g}"] * (self.transmission > 0)
            words += ["thin dielectric"] * (self.transmission > 0 and self.thin) + ["both faces"] * self.is_slab
            words += [f"clearcoat {self.clearcoat:g}"] * (self.clearcoat > 0)
            words += [f"diffuse transmission {self.diffuse_transmission:g}"] * (self.diffuse_transmission > 0)
            words += [f"iridescence {self.iridescence:g}"] * (self.iridescence > 0)
            words += [f"sheen {self.sheen.max():g}"] * bool(np.any(self.sheen > 0))
        words += [f"alpha {self.alpha}"] * (self.alpha != "opaque") + ["unlit"] * self.unlit
        return ", ".join(
            words + ["one-sided"] * (not self.two_sided and not self.culled) + ["culled"] * self.culled
        )

    @property
    def slots(self) -> dict[str, TextureSlot]:
        """Texture slots in use, by field name."""
        return {name: slot for name, slot in zip(SLOTS, _slot_values(self), strict=True) if slot is not None}


def metal_reflectance(n: Float64, k: Float64) -> Float64:
    """Return the reflectance of metal in air at normal incidence, from its refractive index and absorption."""
    return np.asarray(((n - 1.0) ** 2 + k**2) / ((n + 1.0) ** 2 + k**2))


def averaged(material: Material, textures: Sequence[Texture]) -> Material:
    """Return the material with its layers multiplied by their textures' means, so that they are constant."""

    def mean(slot: TextureSlot | None, channel: int) -> float:
        if slot is None:
            return 1.0
        image = textures[slot.texture].linear()
        return float(image[..., channel].mean()) if channel < image.shape[2] else 1.0

    thinnest, thickness = material.iridescence_thickness_min, material.iridescence_thickness_texture

    def colour(slot: TextureSlot | None) -> Float64:
        return np.ones(3) if slot is None else textures[slot.texture].linear()[..., :3].mean(axis=(0, 1))

    roughness, metallic = material.roughness, material.metallic
    # Materials with glass keep their constant metallic: the argument `clear` of `hemispherical_reflectance` was
    # computed with it.
    if roughness is not None and material.transmission == 0:
        roughness *= mean(material.surface_texture, 1)
        metallic *= mean(material.surface_texture, 2)
    return replace(
        material,
        roughness=roughness,
        metallic=metallic,
        transmission=material.transmission * mean(material.transmission_texture, 0),
        clearcoat=material.clearcoat * mean(material.clearcoat_texture, 0),
        specular_weight=material.specular_weight * mean(material.specular_texture, 3),
        specular_colour=material.specular_colour * colour(material.specular_colour_texture),
        sheen=material.sheen * colour(material.sheen_texture),
        sheen_roughness=material.sheen_roughness * mean(material.sheen_roughness_texture, 3),
        diffuse_transmission=material.diffuse_transmission * mean(material.diffuse_transmission_texture, 3),
        diffuse_transmission_colour=material.diffuse_transmission_colour
        * colour(material.diffuse_transmission_colour_texture),
        iridescence=material.iridescence * mean(material.iridescence_texture, 0),
        iridescence_thickness=thinnest + (material.iridescence_thickness - thinnest) * mean(thickness, 1),
    )


def sheen_lambda(alpha: float) -> Float64:
    """Return coefficients a to e, (5,), of L(x) = a / (1 + b x^c) + d x + e, the basis of Charlie's lambda."""
    blend = (1.0 - alpha) ** 2
    return np.asarray(blend * np.array(CHARLIE_LAMBDA[0]) + (1.0 - blend) * np.array(CHARLIE_LAMBDA[1]))


def sheen_albedo(cosine: Float64, alpha: float) -> Float64:
    """Return the (n,) float64 albedo of white sheen at cosines (n,), by quadrature.

    It uses Charlie's distribution with its own visibility. The albedo exceeds 1 at grazing angles for small alpha,
    because the fitted visibility masks too little.

    Source: Estevez & Kulla 2017, Production friendly microfacet sheen BRDF.
    """
    n = 192
    theta, phi = 0.5 * np.pi * (np.arange(n) + 0.5) / n, np.pi * (np.arange(n) + 0.5) / n
    x, y = np.sin(theta)[:, None] * np.cos(phi), np.sin(theta)[:, None] * np.sin(phi)
    z, a, b, c, d, e = np.cos(theta)[:, None], *sheen_lambda(alpha)

    def masking(w: Float64) -> Float64:
        at = a / (1.0 + b * w**c) + d * w + e
        half, other = (a / (1.0 + b * v**c) + d * v + e for v in (np.array(0.5), 1.0 - w))
        return np.asarray(np.where(w < 0.5, np.exp(at), np.exp(2.0 * half - other)))

    lambda_i, lambda_o = masking(z), masking(cosine)
    found = np.empty(len(cosine))
    for i, o in enumerate(cosine):
        h = np.array([x + np.sqrt(1.0 - o * o), y, np.broadcast_to(z + o, x.shape)])
        sine2 = np.maximum(h[0] ** 2 + h[1] ** 2, 0.0) / (h**2).sum(axis=0)
        D = (2.0 + 1.0 / alpha) * sine2 ** (0.5 / alpha) / (2.0 * np.pi)
        f = D / (4.0 * z * o * (1.0 + lambda_i + lambda_o[i]))
        found[i] = (f * z * np.sin(theta)[:, None]).sum() * (0.5 * np.pi / n) * (2.0 * np.pi / n)
    return found


def sheen_albedo_fit(alpha: float) -> Float64:
    """Return (8,) float64 coefficients, constant first, of a polynomial that approximates log(`sheen_albedo`).

    The variable of the polynomial is the square root of the cosine.

    The error is below 0.003 of the incident light for cosines of 0.01 and more.
    """
    cosine = np.linspace(0.02, 1.0, 50) ** 1.5
    albedo = sheen_albedo(cosine, alpha)
    weight = np.minimum(albedo, 1.0) + 1e-4
    powers = np.vander(np.sqrt(cosine), 8, increasing=True)
    logs = np.log(np.maximum(albedo, 1e-6))
    return np.asarray(np.linalg.lstsq(powers * weight[:, None], logs * weight, rcond=None)[0])


@lru_cache(maxsize=1)
def sheen_albedo_table() -> Float64:
    """Return (SHEEN_CELLS + 1, 8) float64: `sheen_albedo_fit` at alphas with equally spaced fourth roots.

    The logarithm is interpolated between rows, with an error below 0.006 of the incident light.
    """
    lowest = SHEEN_MIN_ALPHA**0.25
    roots = lowest + (1.0 - lowest) * np.arange(SHEEN_CELLS + 1) / SHEEN_CELLS
    return np.stack([sheen_albedo_fit(float(root) ** 4) for root in roots])


def moved_textures(material: Material, first: int) -> Material:
    """Return the material with its texture indices increased by `first`."""
    moved = {name: replace(slot, texture=slot.texture + first) for name, slot in material.slots.items()}
    return replace(material, **moved)  # type: ignore[arg-type]
