"""`glpath lightmap`: bake the light on a scene's surfaces into textures, and write the scene as glTF."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from glpath.cli.completion import words
from glpath.cli.help import command_help
from glpath.cli.options import FOR_ALL, option_values, with_options
from glpath.cli.outcome import bias_lines
from glpath.cli.point_options import POINT_CHOICES, POINT_INTEGRATORS
from glpath.cli.run_request import EXIT_CODES, OF_FILMS, RunRequest
from glpath.cli.running import outcome_of
from glpath.cli.scene import Parameters, SceneArgument, read_scene
from glpath.cli.scene_options import OF_LIGHT, with_scene_options
from glpath.cli.unattended import checkpointed
from glpath.cli.values import check_choice, check_spp
from glpath.cli.values import exposure as read_exposure
from glpath.errors import GlpathError, UsageError
from glpath.integrators.by_name import AUTO
from glpath.io.completed import aside
from glpath.scene.summary import light_of
from glpath.system.outputs import check_outputs, save_all
from glpath.system.reporting import duration, percent
from glpath.system.terminal import say

if TYPE_CHECKING:
    from glpath.apps.lightmap.lightmap import Lightmap, Materials

_ATLAS, _OUTPUT = "Atlas", "Output"
#: Integrator options that `glpath lightmap` accepts.
_OPTIONS = (
    "max_depth", "seed", "sampling", "guide", "ambient", "roulette", "directions", "light_resolution",
    "geometry_budget", "bounce_lod", "lookup_depth", "cast", "radiosity", "radiosity_lookup", "direct_light",
    "lookup_distance", "branches",
)  # fmt: skip
_MATERIALS = ("unlit", "keep")
_UV = ("make", "keep")
#: Relative error above which the summary of a lightmap suggests more path sets.
_NOISY = 0.05
#: Relative error for which the summary estimates the number of path sets.
_CLEAN = 0.02


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath lightmap room -o room.glb", "one page of 512 x 512 texels"),
        ("glpath lightmap house.glb -o baked.glb --texels 20", "20 texels per scene unit"),
        ("glpath lightmap room -o a.glb --size 2048 --spp 512", "large, and cleaner"),
        everyday="scene out texels size uv materials exposure denoise spp integrator noise time_limit checkpoint "
        "resume radiosity device environment animation variant parameters",
    )
    app.command(epilog=f"{EXIT_CODES}.", **help)(
        with_options(with_scene_options(lightmap, OF_LIGHT), OF_FILMS, _OPTIONS, integrators=POINT_INTEGRATORS)
    )


def lightmap(
    scene: SceneArgument,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE.glb", help="Where the baked scene goes.")],
    texels: Annotated[
        float | None,
        typer.Option(
            metavar="N", help="Texels per scene unit, on as many pages as it takes.", rich_help_panel=_ATLAS
        ),
    ] = None,
    size: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Side of a page in texels, by default 512 or as needed; without --texels there is one page.",
            rich_help_panel=_ATLAS,
        ),
    ] = None,
    uv: Annotated[
        str,
        typer.Option(
            metavar="|".join(_UV),
            help="Second texture coordinates: made by xatlas (pip install 'glpath[bake]'), or the file's, within 0 "
            "to 1 and without overlaps.",
            rich_help_panel=_ATLAS,
            autocompletion=words(_UV),
        ),
    ] = "make",
    materials: Annotated[
        str,
        typer.Option(
            metavar="|".join(_MATERIALS),
            help="unlit: base colour times light, which every viewer shows (KHR_materials_unlit). keep: materials "
            "as they are, TEXCOORD_1, and irradiance beside the file: baked-0.lightmap.exr, and .png whose range "
            "and unit baked-0.lightmap.json says.",
            rich_help_panel=_OUTPUT,
            autocompletion=words(_MATERIALS),
        ),
    ] = "unlit",
    moz: Annotated[
        bool,
        typer.Option(
            "--moz-lightmap",
            help="With --materials keep: the light in the file, too, as MOZ_lightmap.",
            rich_help_panel=_OUTPUT,
        ),
    ] = False,
    exposure: Annotated[
        str | None,
        typer.Option(
            metavar="STOPS|auto",
            help="Brightness of unlit: 1 doubles it; default as the scene says, or else auto, as of a picture from "
            "the scene's camera: log-average luminance to middle grey.",
            show_default=False,
            rich_help_panel=_OUTPUT,
        ),
    ] = None,
    denoise: Annotated[
        bool | None,
        typer.Option(
            "--denoise/--no-denoise",
            help="By Open Image Denoise's filter for lightmaps; by default where it is installed (pip install "
            "'glpath[denoise]').",
            show_default=False,
            rich_help_panel=_OUTPUT,
        ),
    ] = None,
    spp: Annotated[
        int | None,
        typer.Option(
            help="Samples per texel; default 128 where it is denoised, else as of render.", rich_help_panel=FOR_ALL
        ),
    ] = None,
    integrator: Annotated[
        str,
        typer.Option(
            metavar="|".join(POINT_CHOICES),
            help="auto: gather where the scene allows that, path-buffer for streamed triangles, else path. path: "
            "paths, their rays cast by a BVH. "
            "path-buffer: paths that share directions, cast by scans. gather: from a radiosity solution.",
            rich_help_panel=FOR_ALL,
            autocompletion=words(POINT_CHOICES),
        ),
    ] = AUTO,
    parameters: Parameters = None,
    *,
    run: RunRequest,
    **options: Any,
) -> None:
    """Bake the light on a scene's surfaces into textures, and write the scene with these textures as .glb.

    The engines of `glpath render` compute the light, with all bounces and from every kind of light. The whole model
    is baked. The inside of closed solids has no texels; texels inside other geometry get the light of texels beside
    them. Of shiny materials and glass, only the diffuse part is baked. Mirrors and metal are baked as if they were
    rough. Ctrl-C ends the render, and the light so far is written.
    """
    from glpath.apps.lightmap.lightmap import check_glb
    from glpath.apps.lightmap.surfaces import check_density

    check_glb(out)
    for option, found, allowed in (
        ("--materials", materials, _MATERIALS),
        ("--uv", uv, _UV),
        ("--integrator", integrator, POINT_CHOICES),
    ):
        check_choice(option, found, allowed)
    check_density(texels, size, uv)
    if moz and materials != "keep":
        raise UsageError("--moz-lightmap: is light for materials that are kept.", "Add --materials keep.")
    if materials == "keep" and exposure is not None:
        raise UsageError("--exposure: irradiance is written as it is.", "Leave it out, or --materials keep.")
    check_spp(spp)
    stops = read_exposure(exposure)
    given = {
        "texels": texels, "size": size, "uv": uv, "denoise": denoise, "integrator": integrator,
        "spp": run.options().spp(spp), **option_values(integrator, options),
    }  # fmt: skip
    if uv == "make":
        from glpath.apps.lightmap.atlas import require_xatlas

        require_xatlas()  # fail before anything is read or compiled
    with aside("camera", "picture"):
        loaded = read_scene(scene, parameters)
    check_outputs([out], [scene])
    with checkpointed([out], run) as (checkpoint, begun):
        from glpath.apps.lightmap.files import check_keepable, page_files
        from glpath.apps.lightmap.lightmap import Bake

        if materials == "keep":
            check_keepable(loaded)
        announce = None if run.mode in ("none", "json") or run.quiet else lambda line: say(line, err=True)
        asked = {name: value for name, value in given.items() if value is not None}
        bake = Bake.of(loaded, say=announce, **asked)
        if materials == "keep":
            pages = range(bake.surfaces.atlas.pages)
            check_outputs([], [scene], (file for page in pages for file in page_files(out, page)))

        outcome = outcome_of(bake.film, run, checkpoint, begun)
        film = outcome.film
        made: list[Lightmap] = []
        files: list[Path] = []
        exposure_stops: list[float] = []

        def save(path: Path) -> None:
            made.append(bake.lightmap(film))  # made here, because `save_all` keeps the film if this function fails
            kind = cast("Materials", materials)
            exposure_stops.append(made[0].exposure_stops(stops))
            files.extend(made[0].save(path, materials=kind, exposure=exposure_stops[0], moz=moz))

        def write() -> tuple[list[Path], GlpathError | None]:
            kept = "The film is kept in {}; as the checkpoint's file, --resume continues it."
            return files, save_all({out: save}, {"film.npz": film.save}, kept)[1]

        def lines(written: list[Path]) -> Iterator[str]:
            if written:
                yield from _summary(made[0], None if materials == "keep" else exposure_stops[0], denoise)
                yield f"  {light_of(loaded)}"
            yield from (f"wrote {path}" for path in written)

        outcome.leave(
            write,
            lines,
            lambda _: f"light of {film.path_sets} path sets is in {out}",
            lambda: {"denoised": bake.denoise},
        )


def _summary(baked: Lightmap, stops: float | None, denoise: bool | None) -> Iterator[str]:
    """Yield the summary of a bake.

    stops   : exposure of the file's colours in stops; None if the file holds irradiance
    denoise : value of --denoise; None if it was not given
    """
    atlas, film = baked.atlas, baked.film
    texels, inside = len(baked.surfaces.inside), int(baked.surfaces.inside.sum())
    density = f", {atlas.texels:.3g} texels per scene unit" if atlas.texels else ""
    pages = f"{atlas.pages} page{'s' * (atlas.pages > 1)}"
    yield f"{pages} of {atlas.size[0]} x {atlas.size[1]}, {int(atlas.chart.max()) + 1:,} charts{density}"
    yield f"  {texels:,} texels, {inside:,} of them inside other geometry"
    hidden = baked.surfaces.hidden
    left_out = f", but for {hidden:,} sides that are inside closed solids" if hidden else ""
    resident = "" if baked.surfaces.streamed is None else " in memory"
    yield f"  all {len(baked.scene.triangles):,} triangles{resident} are in it{left_out}"
    error = film.relative_error()
    before = " before denoising" if baked.denoised else ""
    noise = "" if error is None else f", error about {percent(error)}{before}"
    yield f"  {film.path_sets} path sets in {duration(film.metadata.elapsed_s)}{noise}"
    yield f"  {_denoising(baked.denoised, denoise)}"
    if error is not None and error > _NOISY and not baked.denoised:
        more = film.path_sets * math.ceil((error / _CLEAN) ** 2)
        remedy = "leave out --no-denoise" if denoise is False else "pip install 'glpath[denoise]'"
        yield f"  for less noise: {remedy}, or --noise {_CLEAN:g} (some {more:,} path sets)"
    yield from bias_lines(film)
    if stops is not None:
        yield f"  exposure {stops:+g} stops"
    if len(baked.seams):
        yield f"  largest step across a seam {percent(float(baked.steps().max()))}"


def _denoising(denoised: bool, denoise: bool | None) -> str:
    """Return the summary's line on denoising, with the reason if the bake is not denoised.

    denoise : value of --denoise; None if it was not given
    """
    if denoised:
        return "denoised by Open Image Denoise"
    return (
        "not denoised (--no-denoise)"
        if denoise is False
        else "not denoised: pyoidn is missing (pip install 'glpath[denoise]')"
    )
