"""Lightmaps: the light of all bounces at the texels of a scene's surfaces, for programs that have none.

    glpath.lightmap("cornell-box", size=512, spp=64).save("baked.glb")

Texels are points where paths start, rendered by the same engine, into the same film and by the same stop rules as a
camera's picture: pi times what the film holds is their irradiance.

Cost:     what a picture of as many pixels as there are texels costs, plus seconds for the atlas.
Poor at:  what looks different from elsewhere: highlights and glass are no light of a texel; mirrors and metal have
          it as if they were rough. Normal maps are not seen by the light; shadows are as sharp as texels are small.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Unpack, cast, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.bake.atlas import MAX_SIZE, Atlas, kept, packed, require_xatlas
from glpath.bake.outside import outside
from glpath.bake.pages import pages_of, unlit_regions
from glpath.bake.seams import DARK, Seams, lit_texels
from glpath.bake.sides import Sides
from glpath.bake.streamed import Covered, StreamedRays, budget_for, in_memory
from glpath.bake.texels import Texels, rasterised
from glpath.errors import SceneError, UsageError, warn
from glpath.film.denoise import can_denoise, denoised_lightmap, require_denoiser
from glpath.film.film import Film
from glpath.film.image import auto_exposure, check_exposure, encode_png, encode_srgb, luminance
from glpath.integrators.by_name import AUTO, IntegratorKeywords
from glpath.integrators.settings import GEOMETRY_BUDGET, IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
from glpath.io.export.geometry import listed
from glpath.radiosity.memory import require_memory
from glpath.rendering.calls import run_job
from glpath.rendering.job import RenderJob, check_sensor, describe
from glpath.rendering.options import RenderKeywords, check_word, settings_of, with_options
from glpath.rendering.run_options import RunOptions
from glpath.scene import Scene
from glpath.scene.triangulate import path_traceable
from glpath.sensors.sensor import PointSensor

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]
Uv = Literal["make", "keep"]
Materials = Literal["unlit", "keep"]

DEFAULT_SIZE = 512
#: Texels per scene unit that are possible: squares of others, times areas, are beyond floating-point numbers.
DENSITIES = 1e-18, 1e18
#: Samples of a texel where a denoiser follows: of half as many it leaves blotches that the eye finds (`room`).
DENOISED_SPP = 128
#: Texels of the longer side of a page that a notebook shows.
_PREVIEW = 1024
#: Of a texel, at the worst moment: its samples, the sensor's tables, the film's sums, and pages (measured: 1500 of
#: each of a million, more of fewer). Of a page that is filled as far as fits, half has texels at least.
_BYTES, _FILLED = 1400, 0.5
_POINT, _UP = np.zeros((1, 1, 3)), np.array([[[0.0, 0.0, 1.0]]])


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The texels of a scene, before there is light on them.

    scene  : in triangles, as it stands when the shutter opens, without its streams, which have no texels
    atlas  : where its surfaces are on the pages
    texels : N of them, of which those that are inside other geometry are not rendered
    inside : (N,) bool
    hidden : how many sides of triangles are the inside of closed solids, and have no texels; all else has some
    streamed : rays against the scene's streams; None without
    """

    scene: Scene
    atlas: Atlas
    texels: Texels
    inside: Bools
    hidden: int
    streamed: StreamedRays | None = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        texels: float | None = None,
        size: int | None = None,
        uv: Uv = "make",
        say: Callable[[str], None] | None = None,
        geometry_budget: int = GEOMETRY_BUDGET,
    ) -> Surfaces:
        """See `lightmap` for the parameters, and `packed` for `say`. Raises UsageError and SceneError.

        geometry_budget : MiB for triangles of the scene's streams, while it is found which texels they cover

        Warns SceneWarning of streams, which are not baked.
        """
        check_density(texels, size, uv)
        whole = path_traceable(scene.at(), streams=True)
        still = in_memory(whole)
        if not len(still.triangles):
            raise _without_surfaces(whole)
        _check_shines(still)
        streamed = StreamedRays(whole, geometry_budget) if whole.shapes.streams else None
        if streamed is not None:
            _warn_of_streams(whole)
        sides = Sides.of(still, streamed=streamed is not None)
        area = float((still.areas[:, None] * sides.density**2).sum())
        require_memory(
            _BYTES * (_FILLED * (size or DEFAULT_SIZE) ** 2 if texels is None else area * float(texels) ** 2),
            "lightmap: so many texels",
            "Give a smaller size." if texels is None else "Give fewer texels per scene unit.",
        )
        if uv == "keep":
            atlas = kept(still, sides.lit, int(size or DEFAULT_SIZE))
        else:
            page = DEFAULT_SIZE if size is None and texels is None else size
            atlas = packed(still, sides.density, texels, None if page is None else int(page), say)
        return cls.on(still, atlas, sides, streamed)

    @classmethod
    def on(cls, scene: Scene, atlas: Atlas, sides: Sides, streamed: StreamedRays | None = None) -> Surfaces:
        """From an existing atlas, of a scene in triangles that are in memory. Raises SceneError."""
        found = rasterised(atlas)
        if not len(found.row):
            raise SceneError(f"{scene.source or scene.name}: no surface is as large as a texel.")
        covered = None if streamed is None else Covered(streamed, sides)
        texels, inside = outside(scene, atlas, found, sides, covered)
        if streamed is not None:
            streamed.forget()  # before the render, which has the budget then
        return cls(scene, atlas, texels, inside, int(sides.hidden.sum()), streamed)

    @property
    def rendered(self) -> Scene:
        """The scene that lights the texels: with its streams, in the coordinates of `scene`."""
        return self.scene if self.streamed is None else self.streamed.scene

    def sensor(self) -> PointSensor:
        """The texels that are rendered, in rows of a square; the rest of its last row is not valid."""
        rendered = np.flatnonzero(~self.inside)
        if not len(rendered):
            raise SceneError(f"{self.scene.name}: all texels are inside other geometry.")
        width = int(np.ceil(np.sqrt(len(rendered))))
        height = -(-len(rendered) // width)
        samples = len(self.texels.face)
        positions, normals, shading = np.zeros((3, samples, height * width, 3), np.float32)
        for s in range(samples):
            positions[s, : len(rendered)] = self.texels.positions(self.scene, self.atlas, s)[rendered]
            normals[s, : len(rendered)] = self.texels.normals(self.scene, self.atlas, s, smooth=False)[rendered]
            shading[s, : len(rendered)] = self.texels.normals(self.scene, self.atlas, s)[rendered]
        valid = (np.arange(height * width) < len(rendered)).reshape(height, width)
        shape = (samples, height, width, 3)
        smooth = None if np.array_equal(normals, shading) else shading.reshape(shape)
        return PointSensor.of(positions.reshape(shape), normals.reshape(shape), valid, shading_normals=smooth)

    def pages(self, film: Film) -> tuple[Float32, Bools]:
        """Irradiance (P, h, w, 3) of a film of the sensor, and where it was rendered, (P, h, w)."""
        values = np.zeros((len(self.inside), 3))
        rendered = ~self.inside
        values[rendered] = np.pi * film.mean.reshape(-1, 3)[: rendered.sum()]
        return pages_of(self.atlas, self.texels, values, self.inside)


class _Glimpse:
    """A film of texels as a notebook shows it while it converges: their light on the first page, not in rows."""

    before_shown: Callable[[], None] | None = None

    def __init__(self, surfaces: Surfaces, film: Film) -> None:
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
    """A page (h, w, 3) as a .png, texels left out of a large one."""
    step = -(-max(radiance.shape[:2]) // _PREVIEW)
    shown = np.clip(radiance[::step, ::step] * 2.0**stops, 0.0, 1.0)
    return encode_png(np.round(255 * encode_srgb(shown)).astype(np.uint8))


@dataclass(frozen=True, eq=False)
class Lightmap:
    """Light on surfaces.

    surfaces   : where the texels are
    film       : of the texels' receivers, as of any render: it merges, and a bake resumes from it
    irradiance : (P, h, w, 3) float32, W m^-2 (lx of a photometric scene), linear Rec. 709, row 0 at the top, of
                 each page; gutters are filled
    baked      : (P, h, w) bool, where it was rendered and not only continued
    lit        : (P, h, w) bool, where the rendered light is above zero, before the denoiser and the seams change it
    seams      : points where charts meet
    denoised   : True if the pages are denoised; the film never is
    """

    surfaces: Surfaces
    film: Film
    irradiance: Float32
    baked: Bools
    lit: Bools
    seams: Seams
    denoised: bool

    @classmethod
    def of(cls, surfaces: Surfaces, film: Film, denoise: bool = False) -> Lightmap:
        """Return the lightmap of a film of the texels, stitched at seams.

        A denoiser spreads a little light to texels that have none. It is taken away again in `unlit_regions`.
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
        """In triangles."""
        return self.surfaces.scene

    @property
    def atlas(self) -> Atlas:
        return self.surfaces.atlas

    def steps(self) -> NDArray[np.float64]:
        """(K,) at points along seams, how far the luminances on both charts are apart, as a share of their mean.

        Where that is darker than a hundredth of the mean of all texels with light, as a share of the latter.
        """
        a, b = luminance(self.seams.values(self.irradiance).astype(np.float64))
        lit = self.irradiance[lit_texels(self.lit, self.baked)].astype(np.float64)
        dark = DARK * float(luminance(lit).mean())
        return np.asarray(np.abs(a - b) / np.maximum(0.5 * (a + b), max(dark, 1e-12)))

    @property
    def lit_irradiance(self) -> Float32:
        """Return `irradiance`, zero where the rendered light is zero: what statistics of light are made of."""
        return np.where(self.lit[..., None], self.irradiance, np.float32(0.0))

    def quality(self) -> dict[str, Any]:
        """Return JSON for the files: `denoised`, and `bias` as in `glpath.film.bias.Bias` if it is known."""
        bias = self.film.bias()
        return {"denoised": self.denoised} | ({} if bias is None else {"bias": vars(bias)})

    def exposure_stops(self, exposure: float | Literal["auto"] | None = None) -> float:
        """Return the stops of an exposure: those of a picture from the scene's camera, as `glpath.render` has it.

        exposure : stops; "auto": the camera's view to middle grey, by `auto_exposure`; None: as the scene says, or
                   else "auto"

        The camera of a scene without one is that of `glpath.render`. Streamed triangles do not count. If the camera
        sees no light, all texels with light count.

        Raises UsageError for another one.
        """
        check_exposure(exposure)
        asked = self.scene.exposure if exposure is None else exposure
        return self._auto_stops if asked is None or asked == "auto" else float(asked)

    @cached_property
    def _auto_stops(self) -> float:
        """Stops of the camera's view; of all texels if the camera sees streamed triangles or no light alone."""
        from glpath.bake.files import radiance_of
        from glpath.bake.view import seen_by_camera

        view = seen_by_camera(self).reshape(-1, 3)
        view = view[np.isfinite(view).all(axis=1)]
        if not (view > 0).any():
            return auto_exposure(radiance_of(self, self.lit_irradiance)[0][self.baked][None])
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
        """Jupyter's view: the first page, base colour times light, at most 1024 texels long, and a line."""
        from glpath.bake.files import radiance_of

        radiance, _ = radiance_of(self)
        return {"text/plain": repr(self), "image/png": _thumbnail(radiance[0], self.exposure_stops())}

    def save(
        self,
        path: str | Path,
        *,
        materials: Materials = "unlit",
        exposure: float | Literal["auto"] | None = None,
        moz: bool = False,
    ) -> list[Path]:
        """Write the scene with its light as .glb; returns all files that were written.

        path      : .glb
        materials : "unlit": base colour times light, and what surfaces emit, in pictures that every viewer shows
                    (KHR_materials_unlit); "keep": materials as they are, TEXCOORD_1, and beside baked.glb the
                    irradiance of page i, in the unit of the scene, as baked-i.lightmap.exr, and as .png of eight
                    bits, linear, whose range and unit baked-i.lightmap.json says; so are the numbers of what shines
        exposure  : of "unlit", stops: 1 doubles its brightness; see `exposure_stops`
        moz       : with "keep", the .png inside the file, too, as MOZ_lightmap

        Raises UsageError for another suffix, and ImageError. Warns SceneWarning of what is left out.
        """
        from glpath.bake.files import write_kept, write_unlit

        path = check_glb(path)
        check_word("materials", materials, get_args(Materials))
        if moz and materials != "keep":
            raise UsageError('moz: MOZ_lightmap is light for materials that are kept; given with "unlit".')
        if materials == "unlit":
            return write_unlit(self, path, exposure)
        return write_kept(self, path, moz)


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

    Every triangle of the scene is in the bake. Of a material with two sides both have texels, but for the inside of
    closed solids; sides that no light is found to get to have fewer. Streamed triangles alone have none, and are
    not in the file: they light and shade the others, and "auto" is "path-buffer" then.

    Parameters
    ----------
    scene   : what `load_scene` takes
    texels  : per scene unit, on as many pages as that takes
    size    : side of a page, texels; 512. Without `texels` there is one page, on which charts are as large as fit
    uv      : "make": second texture coordinates by xatlas (`glpath[bake]`); "keep": those that the file has, within
              0 to 1 and without overlaps
    integrator, options : "auto", "path", "path-buffer" or "gather" and their options, as of `glpath.render`
    film    : of an interrupted bake of the same scene with the same options, to resume
    denoise : by Open Image Denoise, on the pages (`glpath[denoise]`); the film stays as it is. By default where it
              is installed

    The others are those of `glpath.render`; `spp` counts samples of each texel, by default 128 where the pages are
    denoised.

    Raises what `glpath.render` raises, and GlpathError where xatlas is missing.

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
    return bake.lightmap(bake.film(run_options))


@dataclass(frozen=True, eq=False)
class Bake:
    """A bake before its render: all that can be wrong with it is found when it is made.

    surfaces   : the texels
    job, scene : that render them
    """

    surfaces: Surfaces
    job: RenderJob
    scene: Scene
    denoise: bool

    @classmethod
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
        """See `lightmap` for parameters and errors, and `glpath.bake.atlas.packed` for `say`."""
        if denoise:
            require_denoiser()
        denoise = can_denoise() if denoise is None else denoise
        check_density(texels, size, uv)
        if uv == "make":
            require_xatlas()
        # Before the work: any point will do.
        if integrator != AUTO:
            check_sensor(settings_of(integrator, options), PointSensor.of(_POINT, _UP))
        budget = budget_for(scene, integrator, options)
        surfaces = Surfaces.of(scene, texels, size, uv, say, budget)
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
        """Of the texels. Raises what `glpath.rendering.run` raises."""
        return run_job(
            self.job, self.scene, options, pictured=lambda film: cast("Film", _Glimpse(self.surfaces, film))
        )

    def lightmap(self, film: Film) -> Lightmap:
        """From a film of the texels."""
        return Lightmap.of(self.surfaces, film, self.denoise)


def check_density(texels: float | None, size: int | None, uv: str) -> None:
    """Raise UsageError for what no atlas can be made of."""
    check_word("uv", uv, get_args(Uv))
    low, high = DENSITIES
    if texels is not None and not (isinstance(texels, int | float | np.number) and low <= texels <= high):
        raise UsageError(
            f"texels is {texels!r}; must be a number above 0, texels per scene unit, from {low:g} to {high:g}."
        )
    if size is not None and not (isinstance(size, int | np.integer) and 16 <= size <= MAX_SIZE):
        raise UsageError(f"size is {size!r}; must be a whole number from 16 to {MAX_SIZE}, texels.")
    if uv == "keep" and texels is not None:
        raise UsageError(
            "texels: has no meaning with coordinates that are kept, which say how large surfaces are on the page.",
            "Give the size of the page.",
        )


def _check_shines(scene: Scene) -> None:
    if scene.sky is None and not (np.any(scene.ambient > 0) or scene.lights or any(s.emits for s in scene.shapes)):
        raise SceneError(
            f"{scene.source or scene.name}: has no light, so there is nothing to bake.",
            "Give the scene a light or a sky.",
        )


def _without_surfaces(scene: Scene) -> SceneError:
    name, count = scene.source or scene.name, scene.shapes.total("stream")
    if not count:
        return SceneError(f"{name}: has no surface to bake.")
    return SceneError(
        f"{name}: has no surface in memory to bake: its {count:,} triangles are streamed, and have no texels.",
        'Hold what is to be baked in memory, as a mesh, not in a shape of the type "stream".',
    )


def _warn_of_streams(scene: Scene) -> None:
    names = listed([scene.shapes[index].name for index, _ in scene.shapes.streams])
    warn(
        f"{scene.source or scene.name}: {scene.shapes.total('stream'):,} streamed triangles ({names}) are not "
        "baked, and not in the file: they light and shade the other surfaces. To bake them, hold them in memory, "
        "as a mesh."
    )


def check_glb(path: str | Path) -> Path:
    """`path`, if a baked scene can be written to a file of that name; else UsageError."""
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise UsageError(f"{path}: a scene with its lightmap is written as .glb.", "For example -o baked.glb.")
    return path
