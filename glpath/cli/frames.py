"""`glpath render --turntable N` and `--frames A:B`: N views around the target, or one picture per frame of time.

The file of a frame is either complete or absent, so that `--resume` can render the missing frames.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from glpath.cli.picture import EIGHT_BIT, Picture
from glpath.cli.running import workers_of
from glpath.cli.scene import Scenes
from glpath.cli.signals import arrived, exit_code, hold, release
from glpath.cli.unattended import watched
from glpath.errors import GlpathError, ImageError, UsageError, warn
from glpath.system.files import replacing_links, whole_file
from glpath.system.heartbeat import heartbeat
from glpath.system.locks import Lock
from glpath.system.outputs import check_outputs, save_all
from glpath.system.reporting import duration
from glpath.system.terminal import say
from glpath.system.time_limit import without_limit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from glpath.cli.run_request import RunRequest
    from glpath.film.film import Film
    from glpath.scene import Camera, Scene

#: Suffixes of movie files; the package imageio-ffmpeg writes them.
MOVIES = (".mp4", ".mov", ".mkv")
# Options of ffmpeg: colours by the matrix of Rec. 709, which players expect of HD, and tags that name it. Values
# are those of the pictures, so the transfer curve is that of sRGB.
_COLOURS = [
    *("-vf", "scale=out_color_matrix=bt709:out_range=tv,setparams=color_primaries=bt709:color_trc=iec61966-2-1"),
    *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv"),
]

#: Maximum number of frames of one call: more than an hour at 24 frames a second.
MAX_FRAMES = 100_000
# Maximum number of a frame.
_MAX_NUMBER = 999_999_999
# File name with one placeholder for the number of a frame, such as frame_{:04}.png. The placeholder's width is at
# most 99.
_FRAME_NUMBER = re.compile(r"[^{}]*\{0?(?::0?[0-9]{0,2}d?)?\}[^{}]*")


@dataclass(frozen=True)
class Frames:
    """Range of the frame numbers that one command renders.

    option      : option that requests the frames: "--turntable" or "--frames"
    first, stop : half-open range of the frame numbers
    """

    option: str
    first: int
    stop: int

    @classmethod
    def of_options(cls, turntable: int | None, frames: str | None, fps: float) -> Frames | None:
        """Return the frames, or None if neither option was given. Raises UsageError."""
        if turntable is not None and frames is not None:
            raise UsageError("--frames beside --turntable: each says which images there are.", "Leave one out.")
        if not 0 < fps < math.inf:
            raise UsageError(f"--fps {fps:g}: must be above 0.")
        if turntable is not None:
            return cls.around(turntable)
        return None if frames is None else cls.of_range(frames)

    @classmethod
    def around(cls, count: int) -> Frames:
        """Return the frames of `--turntable count`. Raises UsageError."""
        if count < 1:
            raise UsageError(f"--turntable {count}: must be at least 1.")
        if count > MAX_FRAMES:
            raise UsageError(
                f"--turntable {count}: must be at most {MAX_FRAMES:,}.", "360 frames turn by one degree each."
            )
        return cls("--turntable", 0, count)

    @classmethod
    def of_range(cls, text: str) -> Frames:
        """Return the frames of `--frames A:B`. Raises UsageError."""
        match = re.fullmatch(r"([0-9]+):([0-9]+)", text.strip())
        numbers = [number.lstrip("0") or "0" for number in match.groups()] if match else []
        if max(map(len, numbers), default=0) > len(str(_MAX_NUMBER)):
            raise UsageError(f"--frames {text}: the number of a frame must be at most {_MAX_NUMBER:,}.")
        if not numbers or int(numbers[0]) >= int(numbers[1]):
            raise UsageError(f"--frames {text}: expected A:B, whole numbers of which B is greater, e.g. 0:240.")
        first, stop = map(int, numbers)
        if stop - first > MAX_FRAMES:
            raise UsageError(
                f"--frames {text}: {stop - first:,} frames, but one call renders at most {MAX_FRAMES:,}.",
                f"Render a part at a time: --frames {first}:{first + MAX_FRAMES}.",
            )
        return cls("--frames", first, stop)

    def path(self, out: Path, index: int) -> Path:
        """Return the file of a frame: turn.png becomes turn-007.png, and frame_{:04}.png becomes frame_0007.png."""
        if "{" in out.name:
            return out.with_name(out.name.format(index))
        digits = len(str(self.stop - 1)) if self.option == "--turntable" else max(4, len(str(self.stop - 1)))
        return out.with_name(f"{out.stem}-{index:0{digits}}{out.suffix}")

    def check(self, out: Sequence[Path], others: Mapping[str, object]) -> None:
        """Raise UsageError for excluded options, for output to a pipe, and for bad file names.

        others : values of the options that exclude `self.option`, by name; None if not given
        """
        for option, given in others.items():
            if given is not None:
                raise UsageError(
                    f"{option} beside {self.option}: its frames are whole images of a scene.", "Leave one out."
                )
        for path in out:
            if str(path) == "-":
                raise UsageError(
                    f"-o - beside {self.option}: each frame is a file.", "Name one: turn.png is turn-0.png ..."
                )
            if "{" in path.name and not _FRAME_NUMBER.fullmatch(path.name):
                raise UsageError(
                    f"-o {path}: its name does not hold the number of a frame.",
                    "Write it as frame_{:04}.png, or leave the braces out: turn.png is turn-0.png ...",
                )

    def split(self, out: Sequence[Path]) -> tuple[list[Path], list[Path]]:
        """Return the pictures and the movies among the outputs.

        Raises UsageError for a movie without pictures, and GlpathError if the encoder's package is missing.
        """
        pictures = [path for path in out if path.suffix.lower() not in MOVIES]
        movies = [path for path in out if path not in pictures]
        if movies and not any(path.suffix.lower() in EIGHT_BIT for path in pictures):
            raise UsageError(
                f"-o {movies[0]}: a movie is made of .png frames.", "Name these as well: -o frame_{:04}.png."
            )
        if movies:
            require_encoder(movies[0])
        return pictures, movies


def require_encoder(path: Path) -> None:
    """Raise GlpathError if imageio has no plugin for movies."""
    try:
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise GlpathError(
            f"{path}: a movie needs the package imageio-ffmpeg, which is not installed.",
            "pip install 'glpath[video]'; or leave it out, and any encoder makes one of the frames.",
        ) from error


def write_movie(path: Path, frames: Sequence[Path], fps: float) -> None:
    """Encode pictures as a movie at `fps` frames a second. Transparent pixels become white, with a warning.

    Raises ImageError.
    """
    from imageio import v2 as imageio

    from glpath.film.image import over_white, read_eight_bits

    transparent = False
    with whole_file(path) as temporary:
        settings: dict[str, Any] = {"fps": fps, "macro_block_size": 1, "quality": 8, "output_params": _COLOURS}
        movie: Any = imageio.get_writer(temporary, format="FFMPEG", **settings)
        with movie:
            for frame in frames:
                picture = read_eight_bits(frame)
                if picture is None:
                    raise ImageError(f"{frame}: is not a picture of 8 bits, which a movie is made of.")
                transparent |= picture.shape[2] == 4
                movie.append_data(_even(over_white(picture)))
    if transparent:
        warn(f"{path}: a movie has no alpha channel, so that its background is white; a .png has one.", late=True)


def _even(picture: NDArray[Any]) -> NDArray[Any]:
    """Repeat the last column and row where needed for an even width and height, which video codecs require."""
    import numpy as np

    height, width = picture.shape[:2]
    return np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


@dataclass(frozen=True)
class FramesToRender:
    """Render job of several frames.

    frames : frame numbers to render
    out      : output files of a frame; the frame number is put into their names
    movies   : movies made from the 8-bit pictures of all frames
    fps      : frames per second of the movies
    picture  : conversion of a film; all frames get the automatic exposure of the first, which avoids flicker
    run      : options for the render of each frame; with `resume`, existing frames are kept
    """

    frames: Frames
    out: Sequence[Path]
    movies: Sequence[Path]
    fps: float
    picture: Picture
    run: RunRequest

    def render(self, scene: Scene, scenes: Scenes, options: dict[str, Any]) -> None:
        """Render and write all frames.

        scene   : scene of the first frame; for --turntable, the scene of all frames
        scenes  : gives the scene of each frame of --frames
        options : options of `glpath.render_frames`

        Raises ImageError, GlpathError if another process renders some of the frames, and `typer.Exit` if a signal
        ended the job before the last frame.
        """
        from glpath import rendering

        frames = self.frames
        check_outputs([*(frames.path(path, frames.first) for path in self.out), *self.movies], [scenes.scene])
        with contextlib.ExitStack() as held:
            for path in self.out:
                held.enter_context(Lock(path, "a render of these frames", frames.first, frames.stop))
            todo = left_to_do(frames, self.out, self.run.resume)
            check_outputs([], [scenes.scene], (frames.path(path, i) for path in self.out for i in todo))
            if frames.option == "--turntable":
                shown: Iterator[Scene | Camera] = (scene.camera.turned(360.0 * i / frames.stop) for i in todo)
            else:
                shown = (scenes.at(i) for i in todo)
            held.enter_context(watched(self.run.silence, "The frames before it are written."))
            workers = held.enter_context(workers_of(self.run.cluster))
            held.enter_context(without_limit())  # each frame has a time limit of its own
            held.enter_context(warnings.catch_warnings())
            warnings.filterwarnings("ignore", "There is motion")  # not given, because the frames show the motion
            run = self.run.options(cluster=workers)
            ended_early = self._write(todo, rendering.render_frames(scene, shown, **options, **vars(run)))
        if ended_early:
            raise typer.Exit(exit_code())
        if self.movies:
            self._write_movies(len(todo))

    def _write_movies(self, done: int) -> None:
        """Encode all frames. A signal may stop this at once: the frames stay, and `--resume` encodes them again.

        done : number of frames that this command has rendered
        """
        pictures = next((path for path in self.out if path.suffix.lower() in EIGHT_BIT), None)
        assert pictures is not None, "asked for by Frames.split"
        paths = [self.frames.path(pictures, i) for i in range(self.frames.first, self.frames.stop)]
        try:
            written, failure = save_all(
                {movie: partial(write_movie, frames=paths, fps=self.fps) for movie in self.movies}
            )
        except KeyboardInterrupt:
            self._tell_interrupted(done, done)
            raise typer.Exit(exit_code()) from None
        for movie in written:
            self._tell({"event": "movie", "file": str(movie)}, f"wrote {movie}")
        if failure is not None:
            raise failure

    def _tell_interrupted(self, done: int, count: int) -> None:
        """Report a signal after `done` of `count` frames."""
        if done < count:
            left = "--resume renders the others"
        else:
            which, them = ("the movie is", "it") if len(self.movies) == 1 else ("the movies are", "them")
            left = f"{which} not; --resume makes {them}"
        if self.run.mode != "json":
            self._tell({}, f"interrupted: {done} of {count} frames are written; {left}")

    def _write(self, todo: Sequence[int], films: Iterator[Film]) -> bool:
        """Write each frame when its film is done. Return True if a signal ended the job before the last frame."""
        started = time.perf_counter()
        asked = self.picture.exposure
        stops = asked if isinstance(asked, float) else _stops_before(self.frames, self.out, todo)
        done = 0
        try:
            for i, film in zip(todo, films, strict=True):
                hold()
                stops = film.exposure_stops(asked) if stops is None else stops
                paths = [self.frames.path(path, i) for path in self.out]
                saves = self.picture.saves(film, paths, stops)
                with heartbeat.paused(), replacing_links():
                    _, failure = save_all(saves, {"film.npz": film.save}, "The film is kept in {}.")
                if failure is not None:
                    raise failure
                done += 1
                self._tell_of(done, len(todo), time.perf_counter() - started, list(map(str, paths)))
                release()
        except KeyboardInterrupt:
            if done == len(todo) and not self.movies:
                return False  # nothing is left to do
            self._tell_interrupted(done, len(todo))
            return True
        return arrived() and done < len(todo)

    def _tell_of(self, done: int, count: int, elapsed_s: float, files: list[str]) -> None:
        left = "" if done == count else f", {duration(elapsed_s / done * (count - done))} left"
        self._tell(
            {"event": "frame", "frame": done, "frames": count, "elapsed_s": round(elapsed_s, 3), "files": files},
            f"frame {done} of {count} after {duration(elapsed_s)}{left}: {', '.join(files)}",
        )

    def _tell(self, event: dict[str, Any], line: str) -> None:
        if self.run.mode != "none":
            say(json.dumps(event) if self.run.mode == "json" else line, err=True)


def left_to_do(frames: Frames, out: Sequence[Path], resume: bool) -> Sequence[int]:
    """Return the frame numbers to render: all, or with `resume` only those of frames with a missing file."""
    numbers = range(frames.first, frames.stop)
    if not resume:
        return numbers
    return [i for i in numbers if not all(os.path.exists(frames.path(path, i)) for path in out)]


def _stops_before(frames: Frames, out: Sequence[Path], todo: Sequence[int]) -> float | None:
    """Return the exposure in stops of an existing frame outside `todo`, for the new frames to match.

    None if no such frame exists.
    """
    from glpath.film.image import png_or_jpeg
    from glpath.system.colour import check_exposure

    replaced = set(todo)
    existing = [i for i in range(frames.first, frames.stop) if i not in replaced]
    for path in out:
        for i in existing:
            there = frames.path(path, i)
            if path.suffix.lower() in EIGHT_BIT and there.is_file():
                # Foreign and damaged pictures make Pillow and the parser raise exceptions of any kind.
                with contextlib.suppress(Exception), png_or_jpeg(there) as picture:
                    info = json.loads(picture.info["comment"]) if picture.format == "JPEG" else picture.info
                    stops = float(info["glpath.exposure_stops"])
                    check_exposure(stops)
                    return stops
    return None
