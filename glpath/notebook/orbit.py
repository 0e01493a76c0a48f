"""Camera motion around its target, by pixels of pointer motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from glpath.scene import Camera

_DEGREES_PER_PIXEL = 0.4
_STEEPEST = 89.0
# Factor on the distance to the target for one notch of the mouse wheel.
_ZOOM_PER_NOTCH = 1.15


def turned(camera: Camera, right: float, down: float) -> Camera:
    """Return the camera rotated around its target, so that the scene follows the pointer.

    The camera stops below the pole.

    right, down : pointer motion, pixels
    """
    camera = camera.turned(-_DEGREES_PER_PIXEL * right)
    up = camera.up / np.linalg.norm(camera.up)
    arm = camera.position - camera.target
    length = np.linalg.norm(arm)
    height = np.degrees(np.arcsin(np.clip(arm @ up / length, -1, 1)))
    flat = arm - (arm @ up) * up
    direction = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 0 else camera.frame()[1]
    steepest = max(_STEEPEST, abs(height))
    angle = np.radians(np.clip(height + _DEGREES_PER_PIXEL * down, -steepest, steepest))
    position = camera.target + length * (np.cos(angle) * direction + np.sin(angle) * up)
    return replace(camera, position=position)


def shifted(camera: Camera, right: float, down: float) -> Camera:
    """Return the camera and its target translated so that the target's plane follows the pointer, in pixels."""
    to_right, up, _ = camera.frame()
    distance = float(np.linalg.norm(camera.target - camera.position))
    move = _pixel(camera, distance) * (down * up - right * to_right)
    return replace(camera, position=camera.position + move, target=camera.target + move)


def nearer(camera: Camera, notches: float) -> Camera:
    """Return the camera nearer to the target (notches < 0), or farther; it never reaches the target.

    An orthographic camera does not move; its image height changes instead.
    """
    if camera.projection == "orthographic":
        return replace(camera, height=camera.height * _ZOOM_PER_NOTCH**notches)
    arm = (camera.position - camera.target) * _ZOOM_PER_NOTCH**notches
    return replace(camera, position=camera.target + arm)


def _pixel(camera: Camera, distance: float) -> float:
    """Return the width of a pixel in the target's plane, scene units."""
    if camera.projection == "panorama":
        return distance * 2.0 * np.pi / camera.resolution[0]
    return (1.0 if camera.projection == "orthographic" else distance) / camera.focal
