"""`glpath render`: image of a scene or of a job file.

Errors in options, scene and outputs are found before the render begins. The module `running` renders one film and
`outcome` writes and reports it; `frames` renders and writes several.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from glpath.cli import camera, completion, outcome, running
from glpath.cli.completion import words
from glpath.cli.frames import Frames, FramesToRender
from glpath.cli.help import command_help
from glpath.cli.options import FOR_ALL, option_values, with_options
from glpath.cli.picture import IMAGE, TONEMAP, DenoiseOption, ExposureOption, Picture, TonemapOption
from glpath.cli.run_request import EXIT_CODES, OF_RENDERS, RunRequest
from glpath.cli.scene import HELP, Scenes, parameters_option
from glpath.cli.scene_options import OF_PICTURES, with_scene_options
from glpath.cli.typed import typed_parameters
from glpath.cli.unattended import checkpointed
from glpath.cli.values import check_choice, check_spp
from glpath.cli.values import crop as read_crop
from glpath.cli.values import resolution as read_resolution
from glpath.cli.values import sample_range as read_range
from glpath.errors import UsageError, argument
from glpath.film.aovs import DENOISER_AOVS, guides_denoiser
from glpath.integrators.by_name import AUTO, Integrator
from glpath.rendering.options import default_spp_text
from glpath.system.outputs import check_outputs

_INTEGRATORS = get_args(Integrator)


def register(app: typer.Typer) -> None:
    """Add the command to the command line."""
    help = command_help(
        ("glpath render cornell-box -o box.png", "a shipped scene"),
        ("glpath render model.glb -o a.png -o a.exr --clean 0.01", "cleaner than by default"),
        ("glpath render room -o room.npz --integrator path --noise 0.01", "without bias, until the error is 1 %"),
        everyday="scene out resolution exposure tonemap denoise parameters environment background animation "
        "variant spp integrator aovs camera_position camera_target camera_fov look_at turntable frames device "
        "checkpoint resume clean noise time_limit",
    )
    app.command(epilog=f"{EXIT_CODES}, 134 ended by --hang-limit.", **help)(
        with_options(with_scene_options(render, OF_PICTURES), OF_RENDERS)
    )


def render(
    context: typer.Context,
    out: Annotated[
        list[Path],
        typer.Option(
            "-o",
            "--out",
            help="Write .png, .jpg, .exr (radiance) or .npz (the whole film); - for a PNG to stdout; may be "
            "repeated.",
            rich_help_panel=IMAGE,
        ),
    ],
    scene: Annotated[
        str | None, typer.Argument(metavar="SCENE", help=HELP, autocompletion=completion.scenes)
    ] = None,
    job: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Render what a job file says (`RenderJob.save`), instead of SCENE and all options of the image.",
            rich_help_panel=IMAGE,
        ),
    ] = None,
    spp: Annotated[
        int | None,
        typer.Option(
            help=f"Path sets: samples per pixel; default {default_spp_text()}.",
            show_default=False,
            rich_help_panel=FOR_ALL,
        ),
    ] = None,
    resolution: Annotated[
        str | None, typer.Option(metavar="WxH", help="Instead of the scene's.", rich_help_panel=IMAGE)
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option(metavar="X,Y,W,H", help="Only these pixels, from the top left.", rich_help_panel=IMAGE),
    ] = None,
    exposure: ExposureOption = None,
    tonemap: TonemapOption = TONEMAP,
    denoise: DenoiseOption = None,
    camera_position: camera.PositionOption = None,
    camera_target: camera.TargetOption = None,
    look_at: camera.LookAtOption = None,
    camera_up: camera.UpOption = None,
    camera_fov: camera.FovOption = None,
    camera_type: camera.TypeOption = None,
    camera_height: camera.HeightOption = None,
    camera_aperture_radius: camera.ApertureRadiusOption = None,
    camera_focus_distance: camera.FocusDistanceOption = None,
    camera_shutter: camera.ShutterOption = None,
    parameters: Annotated[list[str] | None, parameters_option(IMAGE)] = None,
    integrator: Annotated[
        str,
        typer.Option(
            metavar="|".join(_INTEGRATORS),
            autocompletion=words(_INTEGRATORS),
            help="auto: of the next three, the one that shows the scene clean soonest. Global illumination: "
            "path, by paths whose rays a BVH casts; gather, from a radiosity solution; path-buffer, by paths that "
            "share directions, cast by scans. Ray tracing with point lights and mirrors: classic, or t-buffer.",
            rich_help_panel=FOR_ALL,
        ),
    ] = AUTO,
    turntable: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="N images from around the camera's target, about its up: a.png is a-0.png and so on, with the "
            "exposure of the first.",
            rich_help_panel=camera.CAMERA,
        ),
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(
            metavar="A:B",
            help="Images of frames A to B - 1 of what moves: frame_{:04}.png says where the number goes. --resume "
            "renders those that are missing; -o a.mp4 besides makes a movie of the .png (glpath[video]).",
            rich_help_panel=camera.CAMERA,
        ),
    ] = None,
    fps: Annotated[
        float, typer.Option(metavar="N", help="Frames a second of --frames.", rich_help_panel=camera.CAMERA)
    ] = 24.0,
    sample_range: Annotated[
        str | None,
        typer.Option(
            metavar="A:B",
            help="Path sets A to B - 1 alone, instead of --spp: a shard, which `glpath merge` adds to others.",
            rich_help_panel=FOR_ALL,
        ),
    ] = None,
    *,
    run: RunRequest,
    **options: Any,
) -> None:
    """Render a scene to one or more files.

    Ctrl-C ends the render after the running path set, and the result so far is written. SIGTERM, SIGHUP, SIGUSR1
    and similar signals do the same; with --checkpoint or --resume, they write only the checkpoint. Each file is
    written completely or not at all. Missing folders are created.
    """
    from glpath.film.film import check_suffix
    from glpath.rendering.job import RenderJob

    if job is not None:
        running.refuse_beside_a_job(context)
    elif scene is None:
        raise UsageError("render: no SCENE and no --job.", "Name a scene file or a shipped scene; `glpath scenes`.")
    many = Frames.of_options(turntable, frames, fps)
    movies: list[Path] = []
    if many is None and any(option.name == "fps" for option in typed_parameters(context)):
        raise UsageError(f"--fps {fps:g}: belongs to --frames and --turntable.", "Leave it out.")
    if many is not None:
        out, movies = many.split(out)
    for path in out:
        check_suffix(path)
    check_choice("--integrator", integrator, _INTEGRATORS)
    check_spp(spp)
    first = {}
    if sample_range is not None:
        if spp is not None:
            raise UsageError("--spp beside --sample-range: the range says how many.", "Leave one out.")
        first["first_path_set"], spp = read_range(sample_range)
    picture = Picture.of_options(exposure, tonemap, denoise, out)
    options = option_values(integrator, options)
    if many is not None:
        others = {
            "--crop": crop,
            "--job": job,
            "--checkpoint": run.checkpoint,
            "--sample-range": sample_range,
            "--stats": run.stats,
        }
        many.check(out, others)
    if job is None:
        assert scene is not None, "asked for above"
        shown = camera.replaced(
            look_at=look_at,
            position=camera_position,
            target=camera_target,
            up=camera_up,
            fov=camera_fov,
            type=camera_type,
            height=camera_height,
            aperture_radius=camera_aperture_radius,
            focus_distance=camera_focus_distance,
            shutter=camera_shutter,
        )
        size = None if resolution is None else read_resolution(resolution)
        scenes = Scenes(scene, parameters or [], size, shown, fps)
        loaded = scenes.at(many.first) if frames is not None and many is not None else scenes.at()
        options = {"integrator": integrator, "spp": run.options().spp(spp), **first, **options}
        asked = running.job_of_scene(loaded, None if crop is None else read_crop(crop), options)
        # A stored film gets the AOVs for a denoiser even if none is installed here. It may be denoised later, after
        # merging or resuming on another machine.
        holds_guides = asked.integrator.noisy and picture.denoise is not False
        picture = picture.of_film(asked.integrator.noisy, out)
        if (picture.denoise or run.clean is not None) and not asked.integrator.noisy:
            raise UsageError(
                f"{'--denoise' if picture.denoise else '--clean'} with --integrator "
                f"{asked.integrator.integrator}: it has no noise for a denoiser to remove.",
                "Render more path sets, or take --integrator path, path-buffer or gather.",
            )
        if holds_guides or run.clean is not None:
            asked = running.denoisable(asked)
        if spp is None and not run.ends_by_rule:
            run = run.until_clean(asked.integrator.noisy, picture)
            spp = None if run.ends_by_rule else asked.spp
        start = running.of_scene(asked, loaded)
    else:
        asked = RenderJob.load(job)
        picture = picture.of_film(asked.integrator.noisy and guides_denoiser(asked.integrator.aovs), out)
        if picture.denoise and not guides_denoiser(asked.integrator.aovs):
            raise UsageError(
                f"--denoise beside --job: {job} asks for no AOVs albedo and normal, which a denoiser needs.",
                f"Make the job with {argument('aovs', DENOISER_AOVS)}.",
            )
        start, spp = running.of_file(asked, out), asked.spp
    if many is None:
        check_outputs(out, [scene, job, getattr(asked.integrator, "radiosity", None)])
        if Path("-") in out and sys.stdout.isatty():
            raise UsageError("-o -: a PNG is no text for a terminal.", "Send it on, e.g. -o - > a.png.")
    else:
        options = {"integrator": asked.integrator, "spp": asked.spp}
        FramesToRender(many, out, movies, fps, picture, run).render(loaded, scenes, options)
        return
    with checkpointed(out, run) as (checkpoint, begun):
        outcome.leave_picture(running.outcome_of(start, run, checkpoint, begun), out, picture, spp)
