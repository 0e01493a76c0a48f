"""`glpath render --turntable N`: a scene from N cameras around its target, a file each."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from glpath.cli.signals import arrived, hold, release
from glpath.errors import UsageError
from glpath.files import Save, save_all
from glpath.progress import duration

if TYPE_CHECKING:
    from glpath.film import Film
    from glpath.scene import Scene


def frame_path(path: Path, index: int, count: int) -> Path:
    """turn.png as turn-007.png, with as many digits as the last one needs."""
    return path.with_name(f"{path.stem}-{index:0{len(str(count - 1))}}{path.suffix}")


def check_turntable(count: int, out: Sequence[Path], others: Mapping[str, object]) -> None:
    """Raise UsageError for what cannot be with `--turntable count`: the `others` that are not None, and a pipe."""
    if count < 1:
        raise UsageError(f"--turntable {count}: must be at least 1.")
    for option, given in others.items():
        if given is not None:
            raise UsageError(
                f"{option} beside --turntable: its frames are whole images of a scene.", "Leave one out."
            )
    for path in out:
        if str(path) == "-":
            raise UsageError(
                "-o - beside --turntable: each frame is a file.", "Name one: turn.png is turn-0.png ..."
            )


def render_turntable(
    scene: Scene,
    count: int,
    out: Sequence[Path],
    options: dict[str, Any],
    save: Callable[[Film, Path, float], None],
    exposure: float | Literal["auto"] | None,
    tell: Callable[[str], None] | None,
    as_json: bool,
) -> bool:
    """Render the frames and write each when it is there; whether a signal ended it before the last.

    options  : of `render_frames`
    save     : writes a film to a path with so many stops of exposure
    exposure : as of `Film.exposure_stops`, found for the first frame and kept, so that nothing flickers
    tell     : takes lines of progress, JSON where `as_json`
    """
    from glpath.rendering import render_frames

    started = time.perf_counter()
    stops: float | None = None
    done = 0
    try:
        for i, film in enumerate(render_frames(scene, scene.camera.turntable(count), **options)):
            hold()
            stops = film.exposure_stops(exposure) if stops is None else stops
            paths = [frame_path(path, i, count) for path in out]
            saves: dict[Path, Save] = {path: _saving(save, film, stops) for path in paths}
            _, failure = save_all(saves, {"film.npz": film.save}, "The film is kept in {}.")
            if failure is not None:
                raise failure
            done = i + 1
            if tell is not None:
                tell(_line(done, count, time.perf_counter() - started, paths, as_json))
            release()
    except KeyboardInterrupt:
        if tell is not None and not as_json:
            tell(f"interrupted: {done} of {count} frames are written")
        return True
    return arrived() and done < count


def _saving(save: Callable[[Film, Path, float], None], film: Film, stops: float) -> Save:
    return lambda path: save(film, path, stops)


def _line(done: int, count: int, elapsed_s: float, paths: Sequence[Path], as_json: bool) -> str:
    files = list(map(str, paths))
    if as_json:
        told = {"event": "frame", "frame": done, "frames": count, "elapsed_s": round(elapsed_s, 3), "files": files}
        return json.dumps(told)
    left = "" if done == count else f", {duration(elapsed_s / done * (count - done))} left"
    return f"frame {done} of {count} after {duration(elapsed_s)}{left}: {', '.join(files)}"
