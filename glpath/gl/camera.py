"""The camera as the uniforms of `shaders/camera.glsl`."""

from __future__ import annotations

from typing import Any

import numpy as np

from glpath.scene.model import Camera, Float64

CENTRE = (0.5, 0.5)


def eye_uniforms(
    camera: Camera, window: tuple[int, int, int, int] | None = None, pixel: tuple[float, float] = CENTRE
) -> dict[str, object]:
    """What rays through a window of the image need.

    window : (x, y, width, height) in pixels of the whole image, y from the top; None: all of it
    pixel  : place in each pixel, x to the right and y down, each in [0, 1)
    """
    width, height = camera.resolution
    x, y, w, h = window or (0, 0, width, height)
    right, up, forward = camera.frame()
    return {
        "eye_position": tuple(camera.position),
        "eye_right": tuple(right),
        "eye_up": tuple(up),
        "eye_forward": tuple(forward),
        "eye_focal": camera.focal,
        "eye_centre": eye_centre(camera.resolution, pixel),
        "eye_corner": (x, height - y - h),
        "eye_size": (w, h),
    }


def eye_centre(resolution: tuple[int, int], pixel: tuple[float, float]) -> tuple[float, float]:
    """The one of them that changes with the place in each pixel."""
    width, height = resolution
    return width / 2.0 + 0.5 - pixel[0], height / 2.0 - 0.5 + pixel[1]


def view_pyramid(eye: dict[str, Any]) -> tuple[Float64, Float64]:
    """Normals (P, 3) and offsets (P,) of the planes around what a window sees: normal . x > offset within.

    eye : the uniforms. A pixel wider on each side than the window, for the rounding of the device.
    """
    right, up, forward, position = (
        np.array(eye[name], np.float64) for name in ("eye_right", "eye_up", "eye_forward", "eye_position")
    )
    normals = [forward]
    for axis, along in enumerate((right, up)):
        first = eye["eye_corner"][axis] + 0.5 - eye["eye_centre"][axis]
        low, high = (first - 1.5) / eye["eye_focal"], (first + eye["eye_size"][axis] + 0.5) / eye["eye_focal"]
        normals += [along - low * forward, high * forward - along]
    planes = np.array(normals)
    return planes, planes @ position
