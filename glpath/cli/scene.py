"""Argument SCENE with its parameters (-D), for every command that takes a scene."""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glpath.cli import completion
from glpath.errors import UsageError
from glpath.scene.source_location import SourceLocation
from glpath.system.bounded_reading import reading_scene
from glpath.system.files import MAX_TEXT_BYTES, read_standard_input, reason_of
from glpath.system.numerals import real

if TYPE_CHECKING:
    from glpath.scene import Scene

HELP = "A file, the name of a shipped scene, or - for TOML from stdin."

_PIPE = "Write the scene into a file, and name that."

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help=HELP, autocompletion=completion.scenes)]


def parameters_option(panel: str | None = None) -> Any:
    """Return the declaration of the option `-D`, listed in a panel of the help."""
    return typer.Option(
        "-D",
        metavar="KEY=VALUE",
        help="A parameter of a generated scene, or of a glTF file (`glpath info`); may be repeated.",
        rich_help_panel=panel,
        autocompletion=completion.parameters,
    )


Parameters = Annotated[list[str] | None, parameters_option()]


class OptionLocation(SourceLocation):
    """Source location that is a command-line option, such as --camera-up with the value 0,1,0."""

    def __str__(self) -> str:
        return self.path

    def field(self, name: str) -> SourceLocation:
        word = name.replace("_", "-")
        path = f"{self.path}-{word}" if self.path else f"--{word}"
        return OptionLocation("", path.replace("--film-", "--"))

    def written(self, value: object) -> str:
        import numpy as np

        parts = np.atleast_1d(np.asarray(value)).tolist()
        return ("x" if self.path == "--resolution" else ",").join(f"{part:.9g}" for part in parts)

    def setting(self, value: object) -> str:
        return f"{self.path} {self.written(value)}"

    def error(self, text: str, remedy: str = "") -> UsageError:  # type: ignore[override]
        return UsageError(f"{self.path} {text}", remedy)


def seen(scene: Scene, resolution: tuple[int, int] | None, camera: Mapping[str, Any]) -> Scene:
    """Return the scene with the resolution and camera fields that options set; None: not set.

    Raises UsageError that names the option.
    """
    from glpath.rendering.job import with_overrides

    given = {name: value for name, value in camera.items() if value is not None}
    return with_overrides(scene, resolution, given, OptionLocation(""))


def read_scene(scene: str, parameters: Sequence[str] | None) -> Scene:
    """Load the scene of the argument and of `-D`. Raises SceneError and UsageError; warns as `load_scene`."""
    from glpath.io import load_scene, parameters_from_options
    from glpath.io.load import TOO_LARGE, scene_from_toml
    from glpath.io.surroundings import SURROUNDINGS

    values = parameters_from_options(parameters or [])
    if scene != "-":
        return load_scene(scene, values)
    surroundings = {name: value for name, value in values.items() if name in SURROUNDINGS}
    if len(values) > len(surroundings):
        raise UsageError("-D: belongs to a generated scene, not to one from standard input.", "Leave it out.")
    with reading_scene("standard input"):
        try:
            content = read_standard_input(MAX_TEXT_BYTES)
        except OSError as error:
            remedy = TOO_LARGE if error.errno == errno.EFBIG else _PIPE
            raise SourceLocation("standard input").error(f"cannot be read: {reason_of(error)}.", remedy) from error
        read = scene_from_toml(content, SourceLocation("standard input"), Path(), "scene")
    return load_scene(read, surroundings)


@dataclass(frozen=True)
class Scenes:
    """Scene of the command line at the time of any frame.

    camera : camera fields to replace; None: not given
    """

    scene: str
    parameters: Sequence[str]
    resolution: tuple[int, int] | None
    camera: dict[str, Any]
    fps: float

    def at(self, frame: int | None = None) -> Scene:
        """Return the scene at the time of a frame. Raises and warns as `read_scene`.

        frame : number of the frame; None without --frames
        """
        from glpath.io.completed import camera_replaced

        with camera_replaced(self.camera):
            return self._at(frame)

    def _at(self, frame: int | None) -> Scene:
        if frame is None:
            return seen(read_scene(self.scene, self.parameters), self.resolution, self.camera)
        others = [text for text in self.parameters if text.partition("=")[0].strip() != "time"]
        begun = [text.partition("=")[2] for text in self.parameters if text not in others]
        try:
            time = frame / self.fps + (real(begun[-1]) if begun else 0.0)
        except ValueError:
            raise UsageError(f"-D time={begun[-1]} beside --frames: expected seconds, as in -D time=1.5.") from None
        camera = self.camera
        if camera["shutter"] is not None:
            camera = camera | {"shutter": tuple(moment + frame / self.fps for moment in camera["shutter"])}
        return seen(read_scene(self.scene, [*others, f"time={time!r}"]), self.resolution, camera)
