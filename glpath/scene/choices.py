"""Allowed values of scene fields. This module needs no numpy, because the command line lists them in its help."""

from __future__ import annotations

from typing import Literal, get_args

#: Projection of a camera.
Projection = Literal["perspective", "orthographic", "panorama"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)

#: Background that the camera sees behind all shapes: the sky, a colour, or nothing.
BackgroundKind = Literal["environment", "plain", "transparent"]
BACKGROUNDS: tuple[BackgroundKind, ...] = get_args(BackgroundKind)
