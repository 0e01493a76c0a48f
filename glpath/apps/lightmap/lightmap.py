"""Lightmaps: global illumination stored in textures of a scene's surfaces, for real-time programs.

    glpath.lightmap("cornell-box", size=512, spp=64).save("baked.glb")

Paths start at texels and use the same engine, film and stop rules as a camera's picture. The irradiance of a texel
is pi times its radiance in the film.

Cost:     that of a picture with as many pixels as texels, plus seconds for the atlas.
Poor at:  view-dependent light: highlights and glass are left out; mirrors and metal are baked as if they were
          diffuse. Normal maps have no effect on the light; texel size limits the sharpness of shadows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Unpack, cast, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.atlas import Atlas, require_xatlas
from glpath.apps.lightmap.files import radiance_of, write_kept, write_unlit
from glpath.apps.lightmap.pages import unlit_regions
from glpath.apps.lightmap.seams import DARK, Seams, lit_texels
from glpath.apps.lightmap.surfaces import AtlasSurfaces, Bools, Float32, Uv, check_density
from glpath.apps.lightmap.view import seen_by_camera
from glpath.errors import UsageError, warning_scope
from glpath.film.denoise import can_denoise, denoised_lightmap, require_denoiser
from glpath.film.film import Film
from glpath.film.image import encode_png
from glpath.film.tonemap import auto_exposure
from glpath.integrators.by_name import AUTO, IntegratorKeywords
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
from glpath.rendering.below_stream import budget_for
from glpath.rendering.calls import run_job
from glpath.rendering.job import RenderJob, check_sensor, describe
from glpath.rendering.options import RenderKeywords, settings_of, with_options
from glpath.rendering.run_options import RunOptions
from glpath.scene import Scene
from glpath.sensors.sensor import PointSensor
from glpath.system.arguments import check_word, checked
from glpath.system.colour import check_exposure, encode_srgb, luminance
from glpath.system.time_limit import lift_limit, without_limit_if_resumed

Materials = Literal["unlit", "keep"]

#: Default samples per texel of a bake that is denoised. With half as many, the denoiser leaves visible blotches in
#: the scene `room`.
DENOISED_SPP = 128
#: Maximum side of a page's preview in a notebook, pixels.
_PREVIEW = 1024
_POINT, _UP = np.zeros((1, 1, 3)), np.array([[[0.0, 0.0, 1.0]]])


class _Glimpse:
    """Notebook preview of a converging film: the light of texels on the first page of the atlas."""

    before_shown: Callable[[], None] | None = None

    def __init__(self, surfaces: AtlasSurfaces, film: Film) -> None:
        self.surfaces, self.film, self.path_sets = surfaces, film, film.path_sets

    def __repr__(self) -> str:
        return f"{self.film.path_sets} path sets of {self.surfaces.scene.name}'s lightmap"

    def shown(self) -> dict[str, object]:
        texels, (width, height) = self.surfaces.texels, self.surfaces.atlas.size
        light = np.zeros((height, width, 3))
        rendered = np.flatnonzero(~self.surfaces.inside)
        first = texels.page[rendered] == 0
        light[texels.row[rendered[first]], texels.column[rendered[first]]] = self.film.mean.reshape(-1, 3)[
            : len(rendered)
        ][first]
        return {"text/plain": repr(self), "image/png": _thumbnail(light, auto_exposure(light))}


def _thumbnail(radiance: NDArray[np.floating[Any]], stops: float) -> bytes:
    """Return a page of radiance (h, w, 3) as the bytes of a .png of at most `_PREVIEW` pixels along each side.

    stops : exposure; 1 doubles the brightness
    """
    step = -(-max(radiance.shape[:2]) // _PREVIEW)
    shown = np.clip(radiance[::step, ::step] * 2.0**stops, 0.0, 1.0)
    return encode_png(np.round(255 * encode_srgb(shown)).astype(np.uint8))


@checked
@dataclass(frozen=True, eq=False)
class Lightmap:
    """Light on surfaces, stored in the pages of an atlas.

    surfaces   : scene, atlas and texels
    film       : film of the texels; it can be merged, and a bake can resume from it
    irradiance : (P, h, w, 3) float32, one image per page, W m^-2 (lx if the scene is photometric), linear Rec. 709,
                 row 0 at the top; gutters are filled
    baked      : (P, h, w) bool, True for rendered texels, False for gutters and empty texels
    lit        : (P, h, w) bool, True if the rendered light is above zero, before denoising and stitching
    seams      : points along edges that two charts share
    denoised   : True if the pages are denoised; the film never is
    """

    surfaces: AtlasSurfaces
    film: Film
    irradiance: Float32
    baked: Bools
    lit: Bools
    seams: Seams
    denoised: bool

    @classmethod
    def of(cls, surfaces: AtlasSurfaces, film: Film, denoise: bool = False) -> Lightmap:
        """Return the lightmap of a film of the texels, with nearly equal light on both sides of seams.

        denoise : True to denoise the pages. A denoiser spreads a little light to dark texels, so the light is set
                  to zero again in the regions that `unlit_regions` returns
        """
        pages, baked = surfaces.pages(film)
        lit = np.asarray((pages > 0).any(axis=-1))
        if denoise:
            pages = np.stack([denoised_lightmap(page) for page in pages])
            pages[unlit_regions(surfaces.atlas, surfaces.texels, lit)] = 0.0
        seams = Seams.of(surfaces.scene, surfaces.atlas)
        return cls(surfaces, film, seams.stitched(pages, baked, lit), baked, lit, seams, denoise)

    @property
    def scene(self) -> Scene:
        """Triangulated scene."""
        return self.surfaces.scene

    @property
    def atlas(self) -> Atlas:
        return self.surfaces.atlas

    def steps(self) -> NDArray[np.float64]:
        """Return (K,) relative differences between the luminances of the two charts at points along seams.

        Each difference is divided by the larger of two values: the mean of both luminances, and a hundredth of the
        mean luminance of lit texels.
        """
        a, b = luminance(self.seams.values(self.irradiance).astype(np.float64))
        lit = self.irradiance[lit_texels(self.lit, self.baked)].astype(np.float64)
        dark = DARK * float(luminance(lit).mean())
        return np.asarray(np.abs(a - b) / np.maximum(0.5 * (a + b), max(dark, 1e-12)))

    @property
    def lit_irradiance(self) -> Float32:
        """Irradiance (P, h, w, 3) for statistics, set to zero at texels whose rendered light is zero."""
        return np.where(self.lit[..., None], self.irradiance, np.float32(0.0))

    def quality(self) -> dict[str, Any]:
        """Return the quality as a dictionary for JSON: `denoised`, and `bias` if the film's bias was measured.

        The value of `bias` is a dictionary of the fields of `glpath.film.bias.Bias`.
        """
        bias = self.film.bias()
        return {"denoised": self.denoised} | ({} if bias is None else {"bias": vars(bias)})

    def exposure_stops(self, exposure: float | Literal["auto"] | None = None) -> float:
        """Return the exposure in stops, chosen as for a picture that `glpath.render` makes of the scene.

        exposure : number of stops; "auto": exposure that brings the camera's view to middle grey
                   (`auto_exposure`); None: exposure of the scene, or "auto" if the scene has none

        A scene without a camera gets the default camera of `glpath.render`. Streamed triangles in view are ignored.
        If the camera sees no light, "auto" uses all baked texels instead of the view.

        Raises UsageError for other values.
        """
        check_exposure(exposure)
        asked = self.scene.exposure if exposure is None else exposure
        return self._auto_stops if asked is None or asked == "auto" else float(asked)

    @cached_property
    def _auto_stops(self) -> float:
        """Automatic exposure in stops, of the camera's view; of all baked texels if the view has no baked light."""
        view = seen_by_camera(self.surfaces, self.lit_irradiance).reshape(-1, 3)
        view = view[np.isfinite(view).all(axis=1)]
        if not (view > 0).any():
            return auto_exposure(radiance_of(self.surfaces, self.lit_irradiance)[0][self.baked][None])
        return auto_exposure(view[None])

    def __repr__(self) -> str:
        atlas, film = self.atlas, self.film
        error = film.relative_error()
        before = " before denoising" if self.denoised else ""
        error_text = "" if error is None else f", error about {100 * error:.2g} %{before}"
        pages = f"{atlas.pages} page{'s' * (atlas.pages > 1)} of {atlas.size[0]} x {atlas.size[1]}"
        return (
            f"<Lightmap of {self.scene.name}: {pages}, {len(self.surfaces.inside):,} texels, "
            f"{film.path_sets} path sets{error_text}>"
        )

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """Return Jupyter's view: an image of the first page, base colour times light, and a line of text."""
        radiance, _ = radiance_of(self.surfaces, self.irradiance)
        return {"text/plain": repr(self), "image/png": _thumbnail(radiance[0], self.exposure_stops())}

    def save(
        self,
        path: str | Path,
        *,
        materials: Materials = "unlit",
        exposure: float | Literal["auto"] | None = None,
        moz: bool = False,
    ) -> list[Path]:
        """Write the scene with its light as .glb and return all written files.

        path      : file name with the suffix .glb
        materials : "unlit": textures of base colour times light, plus emission. Every viewer shows them
                    (KHR_materials_unlit). "keep": original materials, with TEXCOORD_1 for the light map. Page i is
                    then written beside baked.glb, as irradiance in the unit of the scene (baked-i.lightmap.exr),
                    and as a linear .png of eight bits. baked-i.lightmap.json has the unit, and the irradiance of
                    the .png's value 255. Emission in the .glb has the unit of the light map
        exposure  : exposure for "unlit" in stops; 1 doubles the brightness, see `exposure_stops`
        moz       : with "keep", True to store the .png also inside the file, as MOZ_lightmap

        Raises UsageError for another suffix, and ImageError if a file cannot be written. Issues a SceneWarning for
        features of the scene that the file cannot contain.
        """
        path = check_glb(path)
        check_word("materials", materials, get_args(Materials))
        if moz and materials != "keep":
            raise UsageError('moz: MOZ_lightmap is light for materials that are kept; given with "unlit".')
        with warning_scope(strict=False) as scope:
            if materials == "unlit":
                stops, metadata = self.exposure_stops(exposure), self.film.metadata
                extras = {"scene_hash": metadata.scene_hash, "spp": self.film.path_sets, **self.quality()}
                files = write_unlit(self.surfaces, self.irradiance, path, stops, extras)
            else:
                files = write_kept(self.surfaces, self.irradiance, path, self.quality(), moz)
        scope.raise_late(files)
        return files


@with_options()
def lightmap(
    scene: AnyScene,
    *,
    texels: float | None = None,
    size: int | None = None,
    uv: Uv = "make",
    integrator: str | IntegratorSettings = AUTO,
    spp: int | None = None,
    first_path_set: int = 0,
    parameters: Mapping[str, object] | None = None,
    denoise: bool | None = None,
    **options: Unpack[RenderKeywords],
) -> Lightmap:
    """Bake the light on all surfaces of a scene.

    Every triangle is baked, two-sided materials on both sides, except the inside of closed solids. Sides that no
    light seems to reach have fewer texels. Streamed triangles light and shade other surfaces, but have no texels
    and are not in the file. With streamed triangles, the integrator "auto" is "path-buffer".

    Parameters
    ----------
    scene   : scene as for `load_scene`
    texels  : texels per scene unit, on as many pages as needed
    size    : side of a page, texels; default 512, doubled up to 4096 until all charts fit. Without `texels` there
              is one page with charts as large as fit
    uv      : "make": make second texture coordinates by xatlas (`glpath[bake]`). "keep": use the second texture
              coordinates of the file, which must be within 0 to 1 and without overlaps
    integrator, options : "auto", "path", "path-buffer" or "gather" and its options, as in `glpath.render`
    film    : film of an interrupted bake of the same scene with the same options, to resume
    denoise : denoise the pages by Open Image Denoise (`glpath[denoise]`), but not the film; by default True if it
              is installed

    The other parameters are those of `glpath.render`; `spp` is samples per texel, by default 128 if the pages are
    denoised.

    Raises the errors of `glpath.render`, and GlpathError if xatlas is missing.

    Example
    -------
    >>> import glpath
    >>> baked = glpath.lightmap("cornell-box", size=128, spp=16)
    >>> baked.irradiance.shape
    (1, 128, 128, 3)
    >>> baked.save("baked.glb")
    [PosixPath('baked.glb')]
    """
    run_options, given = RunOptions.taken_from(options)
    with aside("camera", "picture"):
        loaded = load_scene(scene, parameters)
    bake = Bake.of(
        loaded,
        texels=texels,
        size=size,
        uv=uv,
        denoise=denoise,
        integrator=integrator,
        spp=run_options.spp(spp),
        first_path_set=first_path_set,
        **given,
    )
    film = bake.film(run_options)
    lift_limit()
    return bake.lightmap(film)


@dataclass(frozen=True, eq=False)
class Bake:
    """Prepared bake. `Bake.of` checks everything, so that errors are raised before the render.

    surfaces   : texels to render
    job, scene : render job of the texels and its scene
    denoise    : True if the pages are to be denoised
    """

    surfaces: AtlasSurfaces
    job: RenderJob
    scene: Scene
    denoise: bool

    @classmethod
    @without_limit_if_resumed()
    def of(
        cls,
        scene: Scene,
        *,
        texels: float | None = None,
        size: int | None = None,
        uv: Uv = "make",
        denoise: bool | None = None,
        integrator: str | IntegratorSettings = AUTO,
        spp: int | None = None,
        first_path_set: int = 0,
        say: Callable[[str], None] | None = None,
        **options: Unpack[IntegratorKeywords],
    ) -> Bake:
        """Check the options of a bake, and prepare its texels and its render job.

        say : called with an estimate of the time if the atlas takes more than some seconds

        The other parameters, and the errors, are those of `lightmap`.
        """
        if denoise:
            require_denoiser()
        denoise = can_denoise() if denoise is None else denoise
        check_density(texels, size, uv)
        if uv == "make":
            require_xatlas()
        # Check the integrator's options before the slow work, with a placeholder for the points.
        if integrator != AUTO:
            check_sensor(settings_of(integrator, options), PointSensor.of(_POINT, _UP))
        budget = budget_for(scene, integrator, options)
        surfaces = AtlasSurfaces.of(scene, texels, size, uv, say, budget)
        job, seen = describe(
            surfaces.rendered,
            integrator=integrator,
            spp=DENOISED_SPP if spp is None and denoise else spp,
            first_path_set=first_path_set,
            sensor=surfaces.sensor(),
            **options,
        )
        return cls(surfaces, job, seen, denoise)

    def film(self, options: RunOptions) -> Film:
        """Render the film of the texels. Raises the errors of `glpath.render`."""
        return run_job(
            self.job, self.scene, options, pictured=lambda film: cast("Film", _Glimpse(self.surfaces, film))
        )

    def lightmap(self, film: Film) -> Lightmap:
        """Return the lightmap of a film whose pixels are the samples of texels."""
        return Lightmap.of(self.surfaces, film, self.denoise)


def check_glb(path: str | Path) -> Path:
    """Return `path` if its suffix is allowed for a baked scene. Raises UsageError otherwise."""
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise UsageError(f"{path}: a scene with its lightmap is written as .glb.", "For example -o baked.glb.")
    return path
