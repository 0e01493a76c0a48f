"""glTF's surface as a plug-in of Mitsuba's, for the lobes that Mitsuba has not: from the formulas, in Dr.Jit.

Mitsuba's own principled surface has Disney's diffuse base, a varnish of another lobe, and no thin glass of glTF's.
With this one in its place, Mitsuba traces the paths and takes the light samples, and nothing of glpath's is in it
but the numbers of the material.

Source: glTF 2.0, appendix B (D and V of GGX with independent masking, Schlick's Fresnel), KHR_materials_specular,
        _clearcoat, _anisotropy and _transmission. A varnish reflects by the angle to its microfacets, and takes
        from what is under it by the angle to the normal.
Poor at: what is smooth: nothing is sampled well but dull and rough lobes. A smooth pane is `Pane`.
"""

from __future__ import annotations

from typing import Any


def register(mi: Any, dr: Any) -> None:
    """Makes Mitsuba know "gltf" and "pane", in the variant that is set."""

    def schlick(cosine: Any) -> Any:
        return dr.power(dr.clip(1.0 - cosine, 0.0, 1.0), 5)

    class Gltf(mi.BSDF):
        """Both sides alike. base_color, roughness and metallic may be textures; no lobe is a mirror."""

        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.base = props.get_texture("base_color", 1.0)
            self.rough = props.get_texture("roughness", 1.0)
            self.metal = props.get_texture("metallic", 0.0)
            self.f90 = props.get("specular", 1.0)
            self.f0 = ((props.get("ior", 1.5) - 1.0) / (props.get("ior", 1.5) + 1.0)) ** 2
            self.tint = mi.Color3f(props.get("specular_color", mi.ScalarColor3f(1.0)))
            self.anisotropy = props.get("anisotropy", 0.0)
            self.turn = props.get("anisotropy_angle", 0.0)
            self.coat = props.get("clearcoat", 0.0)
            self.coat_alpha = max(props.get("clearcoat_roughness", 0.0) ** 2, 1e-4)
            self.transmission = props.get("transmission", 0.0)
            back = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            self.m_components = [mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.DiffuseReflection | back]
            if self.transmission > 0:
                self.m_components.append(mi.BSDFFlags.GlossyTransmission | back)
            self.m_flags = self.m_components[0]
            for each in self.m_components:
                self.m_flags = self.m_flags | each

        def alphas(self, si: Any, active: Any) -> tuple[Any, Any]:
            across = dr.maximum(dr.square(self.rough.eval_1(si, active)), 1e-3)
            return dr.lerp(across, 1.0, self.anisotropy**2), across

        def brushed(self, w: Any) -> Any:
            """In the axes of the brush, which turns from where u grows to where v grows."""
            sine, cosine = dr.sincos(mi.Float(self.turn))
            return mi.Vector3f(cosine * w.x + sine * w.y, cosine * w.y - sine * w.x, w.z)

        def lobe(self, i: Any, o: Any, h: Any, ax: Any, ay: Any) -> Any:
            """D V of GGX."""
            D = 1.0 / (dr.pi * ax * ay * dr.square(dr.square(h.x / ax) + dr.square(h.y / ay) + dr.square(h.z)))

            def masked(w: Any) -> Any:
                return 1.0 / (w.z + dr.sqrt(dr.square(ax * w.x) + dr.square(ay * w.y) + dr.square(w.z)))

            return D * masked(i) * masked(o)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            # Mitsuba's wi is towards the eye; from the back all is mirrored.
            side = dr.select(si.wi.z > 0, 1.0, -1.0)
            eye, light = self.brushed(side * si.wi), self.brushed(side * wo)
            through = light.z < 0
            light.z = dr.abs(light.z)
            h = dr.normalize(eye + light)
            cosine = dr.dot(eye, h)
            base, metal = self.base.eval(si, active), self.metal.eval_1(si, active)
            ax, ay = self.alphas(si, active)
            DV = self.lobe(eye, light, h, ax, ay)
            f0 = dr.minimum(self.f0 * self.tint, 1.0) * self.f90
            F = f0 + (self.f90 - f0) * schlick(cosine)
            under = 1.0 - dr.max(F)
            dielectric = F * DV + under * (1.0 - self.transmission) * base / dr.pi
            f = metal * (base + (1.0 - base) * schlick(cosine)) * DV + (1.0 - metal) * dielectric
            beyond = (1.0 - metal) * self.transmission * base * under * DV
            coat = dr.lerp(0.04, 1.0, schlick(cosine)) * self.lobe(eye, light, h, self.coat_alpha, self.coat_alpha)
            left = 1.0 - self.coat * dr.lerp(0.04, 1.0, schlick(eye.z))
            f = dr.select(through, left * beyond, left * f + self.coat * coat)
            return dr.select(active & (eye.z > 0) & (light.z > 0), f * light.z, 0.0)

        def distributions(self, si: Any, active: Any) -> list[Any]:
            ggx = mi.MicrofacetType.GGX
            ax, ay = self.alphas(si, active)
            found = [mi.MicrofacetDistribution(ggx, ax, ay)]
            if self.coat > 0:
                found.append(mi.MicrofacetDistribution(ggx, mi.Float(self.coat_alpha)))
            return found

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            side = dr.select(si.wi.z > 0, 1.0, -1.0)
            eye, light = self.brushed(side * si.wi), self.brushed(side * wo)
            through = light.z < 0
            light.z = dr.abs(light.z)
            h = dr.normalize(eye + light)
            found = light.z / dr.pi
            lobes = self.distributions(si, active)
            for each in lobes:
                found += each.pdf(eye, h) / (4.0 * dr.dot(eye, h))
            share = 0.5 if self.transmission > 0 else dr.select(through, 0.0, 1.0)
            good = active & (eye.z > 0) & (light.z > 0)
            return dr.select(good, found * share / (1 + len(lobes)), 0.0)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            side = dr.select(si.wi.z > 0, 1.0, -1.0)
            eye = self.brushed(side * si.wi)
            light = mi.warp.square_to_cosine_hemisphere(sample2)
            number = sample1
            if self.transmission > 0:
                number = 2.0 * number - dr.floor(2.0 * number)
            lobes = self.distributions(si, active)
            for i, each in enumerate(lobes):
                h, _ = each.sample(eye, sample2)
                chosen = number * (1 + len(lobes)) >= i + 1
                light = dr.select(chosen, mi.reflect(eye, h), light)
            sine, cosine = dr.sincos(mi.Float(-self.turn))
            light = mi.Vector3f(cosine * light.x + sine * light.y, cosine * light.y - sine * light.x, light.z)
            good = active & (light.z > 0)
            if self.transmission > 0:
                light.z = dr.select(sample1 < 0.5, -light.z, light.z)
            wo = side * light
            bs = mi.BSDFSample3f()
            bs.wo, bs.eta, bs.sampled_component = wo, 1.0, 0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            bs.pdf = self.pdf(ctx, si, wo, good)
            good &= bs.pdf > 0
            return bs, dr.select(good, self.eval(ctx, si, wo, good) / bs.pdf, 0.0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def to_string(self) -> str:
            return "Gltf[]"

    class Pane(mi.BSDF):
        """A thin sheet of smooth glass: reflects once by Schlick's formula, and lets the rest straight through."""

        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.base = props.get_texture("base_color", 1.0)
            self.f0 = ((props.get("ior", 1.5) - 1.0) / (props.get("ior", 1.5) + 1.0)) ** 2
            self.weight = props.get("specular", 1.0)
            both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            self.m_components = [mi.BSDFFlags.DeltaReflection | both, mi.BSDFFlags.Null | both]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return mi.Color3f(0.0)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return mi.Float(0.0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return mi.Color3f(0.0), mi.Float(0.0)

        def eval_null_transmission(self, si: Any, active: Any = True) -> Any:
            return self.base.eval(si, active) * (1.0 - self.reflected(si))

        def reflected(self, si: Any) -> Any:
            return self.weight * dr.lerp(self.f0, 1.0, schlick(dr.abs(si.wi.z)))

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            F = self.reflected(si)
            mirrored = sample1 < F
            bs = mi.BSDFSample3f()
            bs.wo = dr.select(mirrored, mi.reflect(si.wi), -si.wi)
            bs.pdf, bs.eta = dr.select(mirrored, F, 1.0 - F), mi.Float(1.0)
            bs.sampled_component = dr.select(mirrored, mi.UInt32(0), mi.UInt32(1))
            kinds = mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.Null
            bs.sampled_type = dr.select(mirrored, *(mi.UInt32(+kind) for kind in kinds))
            return bs, dr.select(mirrored, mi.Color3f(1.0), self.base.eval(si, active)) & active

        def to_string(self) -> str:
            return "Pane[]"

    mi.register_bsdf("gltf", Gltf)
    mi.register_bsdf("pane", Pane)
