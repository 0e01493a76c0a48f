"""Words to choose from, of fields of a scene. Without numpy, as the command line lists them in its help."""

from __future__ import annotations

from typing import Literal, get_args

#: How a camera projects.
Projection = Literal["perspective", "orthographic", "panorama"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)

#: What the camera sees behind all shapes: the sky, a colour, or nothing.
BackgroundKind = Literal["environment", "plain", "transparent"]
BACKGROUNDS: tuple[BackgroundKind, ...] = get_args(BackgroundKind)
