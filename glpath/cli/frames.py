"""`glpath render --turntable N` and `--frames A:B`: a scene from N cameras around its target, or at so many times.

Each frame is a file, whole or not there, so that `--resume` goes on after the last one.
"""

from __future__ import annotations

import contextlib
import json
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from glpath.cli.signals import arrived, hold, release
from glpath.errors import GlpathError, UsageError
from glpath.files import Save, check_writable, save_all, whole_file
from glpath.progress import duration
from glpath.scene.camera import Camera

if TYPE_CHECKING:
    from glpath.film import Film
    from glpath.scene import Scene

#: Of films of frames, which imageio-ffmpeg writes.
MOVIES = (".mp4", ".mov", ".mkv")


@dataclass(frozen=True)
class Frames:
    """The frames of one call.

    option : by which they were asked for
    first, stop : their numbers, half-open
    """

    option: str
    first: int
    stop: int

    @classmethod
    def around(cls, count: int) -> Frames:
        """Of `--turntable count`. Raises UsageError."""
        if count < 1:
            raise UsageError(f"--turntable {count}: must be at least 1.")
        return cls("--turntable", 0, count)

    @classmethod
    def of_range(cls, text: str) -> Frames:
        """Of `--frames A:B`. Raises UsageError."""
        match = re.fullmatch(r"(\d{1,9}):(\d{1,9})", text.strip())
        if not match or int(match[1]) >= int(match[2]):
            raise UsageError(f"--frames {text}: expected A:B, whole numbers of which B is greater, e.g. 0:240.")
        return cls("--frames", int(match[1]), int(match[2]))

    def path(self, out: Path, index: int) -> Path:
        """turn.png as turn-007.png, with as many digits as the last one needs; or frame_{:04}.png as it says."""
        if "{" in out.name:
            return out.with_name(out.name.format(index))
        digits = len(str(self.stop - 1)) if self.option == "--turntable" else max(4, len(str(self.stop - 1)))
        return out.with_name(f"{out.stem}-{index:0{digits}}{out.suffix}")

    def check(self, out: Sequence[Path], others: Mapping[str, object]) -> None:
        """Raise UsageError for what cannot be: the `others` that are not None, a pipe, a name that is none."""
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
            try:
                different = self.path(path, 0) != self.path(path, 1)
            except (IndexError, KeyError, ValueError):
                different = False
            if not different:
                raise UsageError(
                    f"-o {path}: its name has no place for the number of a frame.",
                    "Write it as frame_{:04}.png, or leave the braces out: turn.png is turn-0.png ...",
                )

    def split(self, out: Sequence[Path]) -> tuple[list[Path], list[Path]]:
        """Pictures and movies of the outputs. Raises UsageError for a movie without pictures to make it from,
        GlpathError where the package for it is missing."""
        pictures = [path for path in out if path.suffix.lower() not in MOVIES]
        movies = [path for path in out if path not in pictures]
        if movies and not any(path.suffix.lower() == ".png" for path in pictures):
            raise UsageError(
                f"-o {movies[0]}: a movie is made of .png frames.", "Name these as well: -o frame_{:04}.png."
            )
        if movies:
            require_encoder(movies[0])
        return pictures, movies


def require_encoder(path: Path) -> None:
    """Raise GlpathError where imageio has no plugin for movies."""
    try:
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise GlpathError(
            f"{path}: a movie needs the package imageio-ffmpeg, which is not installed.",
            "pip install 'glpath[video]'; or leave it out, and any encoder makes one of the frames.",
        ) from error


def write_movie(path: Path, frames: Sequence[Path], fps: float) -> None:
    """Encode pictures in their order, at so many a second. Raises ImageError."""
    from imageio import v2 as imageio

    with whole_file(path) as temporary:
        settings: dict[str, Any] = {"fps": fps, "macro_block_size": 1, "quality": 8}
        movie: Any = imageio.get_writer(temporary, format="FFMPEG", **settings)
        with movie:
            for frame in frames:
                movie.append_data(_even(imageio.imread(frame)))


def _even(picture: NDArray[Any]) -> NDArray[Any]:
    """Codecs take even numbers of pixels."""
    height, width = picture.shape[:2]
    return np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


def render_to_files(
    frames: Frames,
    todo: Sequence[int],
    films: Iterator[Film],
    out: Sequence[Path],
    save: Callable[[Film, Path, float], None],
    exposure: float | Literal["auto"] | None,
    tell: Callable[[str], None] | None,
    as_json: bool,
) -> bool:
    """Write each frame when it is there; whether a signal ended it before the last.

    todo, films : the numbers of the frames, and their films, in that order
    save        : writes a film to a path with so many stops of exposure
    exposure    : as of `Film.exposure_stops`, found for the first frame and kept, so that nothing flickers
    tell        : takes lines of progress, JSON where `as_json`
    """
    started = time.perf_counter()
    stops = exposure if isinstance(exposure, float) else _stops_before(frames, out)
    done = 0
    try:
        for i, film in zip(todo, films, strict=True):
            hold()
            stops = film.exposure_stops(exposure) if stops is None else stops
            paths = [frames.path(path, i) for path in out]
            saves: dict[Path, Save] = {path: _saving(save, film, stops) for path in paths}
            _, failure = save_all(saves, {"film.npz": film.save}, "The film is kept in {}.")
            if failure is not None:
                raise failure
            done += 1
            if tell is not None:
                tell(_line(i, done, len(todo), time.perf_counter() - started, paths, as_json))
            release()
    except KeyboardInterrupt:
        if tell is not None and not as_json:
            tell(f"interrupted: {done} of {len(todo)} frames are written; --resume goes on with the others")
        return True
    return arrived() and done < len(todo)


def left_to_do(frames: Frames, out: Sequence[Path], resume: bool) -> list[int]:
    """Numbers of the frames to render: all, or those of which a file is missing. Raises ImageError, UsageError."""
    numbers = list(range(frames.first, frames.stop))
    for path in out:
        check_writable(frames.path(path, frames.first))
    if not resume:
        return numbers
    return [i for i in numbers if not all(frames.path(path, i).exists() for path in out)]


def _stops_before(frames: Frames, out: Sequence[Path]) -> float | None:
    """The stops of a frame that is there already, so that what follows is as bright; None where there is none."""
    from PIL import Image

    for path in out:
        for i in range(frames.first, frames.stop):
            there = frames.path(path, i)
            if path.suffix.lower() == ".png" and there.exists():
                with contextlib.suppress(OSError, KeyError, ValueError), Image.open(there) as picture:
                    return float(picture.info["glpath.exposure_stops"])
    return None


def _saving(save: Callable[[Film, Path, float], None], film: Film, stops: float) -> Save:
    return lambda path: save(film, path, stops)


def _line(index: int, done: int, count: int, elapsed_s: float, paths: Sequence[Path], as_json: bool) -> str:
    files = list(map(str, paths))
    if as_json:
        told = {"event": "frame", "frame": done, "frames": count, "elapsed_s": round(elapsed_s, 3), "files": files}
        return json.dumps(told)
    left = "" if done == count else f", {duration(elapsed_s / done * (count - done))} left"
    return f"frame {done} of {count} after {duration(elapsed_s)}{left}: {', '.join(files)}"


def films_of(
    scene: Scene,
    shown: Iterator[Camera | Scene],
    options: dict[str, Any],
    cluster: str | None,
) -> Iterator[Film]:
    """A film for each camera or scene, in order; by a cluster, the path sets of each by all its workers.

    options : of `glpath.render_frames`, with those of the machine
    """
    from glpath import rendering

    if cluster is None:
        yield from rendering.render_frames(scene, shown, **options)
        return
    from glpath.jobs.cluster import Cluster, render_on
    from glpath.rendering.job import describe

    machine = {name: options.pop(name) for name in ("backend", "device", "require_gpu", "timings")}
    with Cluster(cluster) as workers:
        for frame in shown:
            whole = scene.with_camera(**vars(frame)) if isinstance(frame, Camera) else frame
            job, loaded = describe(whole, **options)
            yield render_on(workers, job, scene=loaded, **machine)
