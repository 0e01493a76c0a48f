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
from pathlib import Path
from typing import Any, Literal, Unpack, cast, get_args

import numpy as np
from numpy.typing import NDArray

from glpath.bake.atlas import MAX_SIZE, Atlas, kept, packed, require_xatlas
from glpath.bake.pages import pages_of
from glpath.bake.seams import DARK, Seams, lit_texels
from glpath.bake.sides import Sides
from glpath.bake.texels import Texels, rasterised
from glpath.errors import SceneError, UsageError
from glpath.film.denoise import can_denoise, denoised_lightmap, require_denoiser
from glpath.film.film import Film
from glpath.film.image import auto_exposure, check_exposure, encode_png, encode_srgb, luminance
from glpath.integrators.by_name import AUTO, IntegratorKeywords
from glpath.integrators.settings import IntegratorSettings
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
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
#: Samples of a texel where a denoiser follows: of half as many it leaves blotches that the eye finds (`room`).
DENOISED_SPP = 128
#: Texels of the longer side of a page that a notebook shows.
_PREVIEW = 1024
#: Points behind a wall count as inside up to so many texels from it.
_NEAR = 2.0
#: Of a texel, at the worst moment: its samples, the sensor's tables, the film's sums, and pages (measured: 1500 of
#: each of a million, more of fewer). Of a page that is filled as far as fits, half has texels at least.
_BYTES, _FILLED = 1400, 0.5
#: Whether a wall is between points of a texel is asked so far above the surface, in the size of the texel.
_ABOVE = 0.1
#: Texels that are asked for together whether they are inside.
_TOGETHER = 1 << 16
_POINT, _UP = np.zeros((1, 1, 3)), np.array([[[0.0, 0.0, 1.0]]])


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The texels of a scene, before there is light on them.

    scene  : in triangles, as it stands when the shutter opens
    atlas  : where its surfaces are on the pages
    texels : N of them, of which those that are inside other geometry are not rendered
    inside : (N,) bool
    hidden : how many sides of triangles are the inside of closed solids, and have no texels; all else has some
    """

    scene: Scene
    atlas: Atlas
    texels: Texels
    inside: Bools
    hidden: int

    @classmethod
    def of(
        cls,
        scene: Scene,
        texels: float | None = None,
        size: int | None = None,
        uv: Uv = "make",
        say: Callable[[str], None] | None = None,
    ) -> Surfaces:
        """See `lightmap` for the parameters, and `packed` for `say`. Raises UsageError and SceneError."""
        check_density(texels, size, uv)
        still = path_traceable(scene.at())
        if not len(still.triangles):
            raise SceneError(f"{scene.source or scene.name}: has no surface to bake.")
        _check_shines(still)
        sides = Sides.of(still)
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
        return cls.on(still, atlas, sides)

    @classmethod
    def on(cls, scene: Scene, atlas: Atlas, sides: Sides) -> Surfaces:
        """From an existing atlas, of a scene in triangles. Raises SceneError."""
        found = rasterised(atlas)
        if not len(found.row):
            raise SceneError(f"{scene.source or scene.name}: no surface is as large as a texel.")
        return cls(scene, atlas, *_outside(scene, atlas, found, sides), int(sides.hidden.sum()))

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
    seams      : points where charts meet
    """

    surfaces: Surfaces
    film: Film
    irradiance: Float32
    baked: Bools
    seams: Seams

    @classmethod
    def of(cls, surfaces: Surfaces, film: Film, denoise: bool = False) -> Lightmap:
        """The lightmap of a film of the texels; stitched at seams."""
        pages, baked = surfaces.pages(film)
        if denoise:
            pages = np.stack([denoised_lightmap(page) for page in pages])
        seams = Seams.of(surfaces.scene, surfaces.atlas)
        return cls(surfaces, film, seams.stitched(pages, baked), baked, seams)

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
        lit = self.irradiance[lit_texels(self.irradiance, self.baked)].astype(np.float64)
        dark = DARK * float(luminance(lit).mean())
        return np.asarray(np.abs(a - b) / np.maximum(0.5 * (a + b), max(dark, 1e-12)))

    def exposure_stops(self, exposure: float | Literal["auto"] | None = None) -> float:
        """The stops that an exposure means: those of a picture from the scene's camera, as `glpath.render` has it.

        exposure : stops; "auto": middle grey, of what the camera sees of the light; None: as the scene says, or
                   "auto"

        Raises UsageError for another one.
        """
        from glpath.bake.view import seen_by_camera

        check_exposure(exposure)
        asked = self.scene.exposure if exposure is None else exposure
        return auto_exposure(seen_by_camera(self)) if asked is None or asked == "auto" else float(asked)

    def __repr__(self) -> str:
        atlas, film = self.atlas, self.film
        error = film.relative_error()
        error_text = "" if error is None else f", error about {100 * error:.2g} %"
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
    closed solids; sides that no light is found to get to have fewer.

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
    run_options, chosen = RunOptions.taken_from(options)
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
        **chosen,
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
        surfaces = Surfaces.of(scene, texels, size, uv, say)
        job, seen = describe(
            surfaces.scene,
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
    if texels is not None and not (isinstance(texels, int | float | np.number) and 0 < texels < np.inf):
        raise UsageError(f"texels is {texels!r}; must be a number above 0, texels per scene unit.")
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


def check_glb(path: str | Path) -> Path:
    """`path`, if a baked scene can be written to a file of that name; else UsageError."""
    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise UsageError(f"{path}: a scene with its lightmap is written as .glb.", "For example -o baked.glb.")
    return path


def _outside(scene: Scene, atlas: Atlas, texels: Texels, sides: Sides) -> tuple[Texels, Bools]:
    """Texels whose samples are all outside of other geometry, and (N,) those of which none is.

    The middle of each texel is asked; where one is inside, or a neighbour is, all its samples are. What is behind a
    wall without thickness from there is no sample, either.
    """
    samples, count = texels.face.shape
    middle = samples // 2
    size = texels.sizes(scene, atlas, middle)

    def inside(sample: int, which: NDArray[np.int64]) -> Bools:
        face = texels.face[sample, which]
        points = texels.positions(scene, atlas, sample)[which]
        near = _NEAR * texels.sizes(scene, atlas, sample)[which]
        triangle, side = atlas.triangle[face], atlas.side[face]
        # In parts, as each point has a dozen numbers beside it.
        parts = (slice(first, first + _TOGETHER) for first in range(0, len(which), _TOGETHER))
        found = [sides.inside(triangle[at], side[at], points[at], near[at], at.start) for at in parts]
        return np.concatenate([*found, np.zeros(0, np.bool_)])

    found = inside(middle, np.arange(count))
    near = np.zeros((atlas.pages, atlas.size[1] + 2, atlas.size[0] + 2), np.bool_)
    page, row, column = texels.index
    hit = page[found], row[found] + 1, column[found] + 1
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            near[hit[0], hit[1] + down, hit[2] + right] = True
    asked = np.flatnonzero(near[page, row + 1, column + 1])
    wrong = np.zeros((samples, count), np.bool_)
    for sample in range(samples) if len(asked) else ():
        wrong[sample, asked] = inside(sample, asked)
    buried = np.asarray(wrong.all(axis=0))
    if sides.lit.all(axis=1).any():
        above = [
            texels.positions(scene, atlas, s)
            + _ABOVE * size[:, None] * texels.normals(scene, atlas, s, smooth=False)
            for s in range(samples)
        ]
        own = atlas.triangle[texels.face[middle]]
        for sample in range(samples):
            wrong[sample] |= ~wrong[middle] & sides.apart(own, above[middle], above[sample])
    if not wrong.any():
        return texels, buried
    # A sample that is inside, or behind a wall, is replaced by the next one that is not.
    source = np.broadcast_to(np.arange(samples)[:, None], wrong.shape).copy()
    for step in range(1, samples):
        still = np.take_along_axis(wrong, source, axis=0)
        source = np.where(still, (np.arange(samples)[:, None] + step) % samples, source)
    return texels.with_samples_of(source), buried
