"""The camera as the uniforms of `shaders/camera.glsl`."""

from __future__ import annotations

from glpath.scene.model import Camera

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
