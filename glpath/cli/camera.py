"""Options of `glpath render` that replace fields of the scene's camera."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from glpath.cli.completion import words
from glpath.cli.values import shutter as read_shutter
from glpath.cli.values import vector
from glpath.scene.choices import PROJECTIONS

#: Help panel under which the camera's options are listed.
CAMERA = "Camera"

PositionOption = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="Where it stands.", rich_help_panel=CAMERA)
]
TargetOption = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="What it looks at.", rich_help_panel=CAMERA)
]
LookAtOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Move the camera, without a turn, until the shapes of this name fill the picture, such as 'chair*' "
        "(`glpath info` lists names); with --camera-position, turn it to them.",
        rich_help_panel=CAMERA,
    ),
]
UpOption = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="What is up in the image.", rich_help_panel=CAMERA)
]
FovOption = Annotated[
    float | None, typer.Option(metavar="DEGREES", help="Vertical field of view.", rich_help_panel=CAMERA)
]
TypeOption = Annotated[
    str | None,
    typer.Option(
        metavar="|".join(PROJECTIONS),
        autocompletion=words(PROJECTIONS),
        help="How it projects.",
        rich_help_panel=CAMERA,
    ),
]
HeightOption = Annotated[
    float | None,
    typer.Option(metavar="UNITS", help="Of the whole image, if orthographic.", rich_help_panel=CAMERA),
]
ApertureRadiusOption = Annotated[
    float | None,
    typer.Option(metavar="UNITS", help="Radius of its lens; 0 is a pinhole.", rich_help_panel=CAMERA),
]
FocusDistanceOption = Annotated[
    float | None,
    typer.Option(metavar="UNITS", help="Where it is sharp; default: at the target.", rich_help_panel=CAMERA),
]
ShutterOption = Annotated[
    str | None,
    typer.Option(metavar="T,T", help="When it opens and closes, seconds.", rich_help_panel=CAMERA),
]


def replaced(
    *,
    look_at: str | None,
    position: str | None,
    target: str | None,
    up: str | None,
    shutter: str | None,
    **others: Any,
) -> dict[str, Any]:
    """Return new values of camera fields by name; None if the field's option was not given. Raises UsageError."""
    return {
        "look_at": look_at,
        "position": vector("--camera-position", position),
        "target": vector("--camera-target", target),
        "up": vector("--camera-up", up),
        "shutter": None if shutter is None else read_shutter(shutter),
        **others,
    }
