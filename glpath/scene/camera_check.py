"""Check that a camera has a view. `Scene` calls it for its camera; readers call it first, with their location."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

from glpath.scene.camera import Camera, CameraKey
from glpath.scene.choices import PROJECTIONS
from glpath.scene.source_location import SourceLocation
from glpath.system.arguments import checked
from glpath.system.vectors import LARGEST

MAX_PIXELS = 2**28

# `up` and the view direction count as parallel if the sine of the angle between them is below this.
_PARALLEL = 1e-6


@checked
def check_camera(camera: Camera, source: str | SourceLocation) -> None:
    """Raise SceneError if the camera has no view: no direction, no up vector, no angle or no pixels.

    Every `Scene` checks its camera by this function. So cameras changed by `Scene.with_camera` or `--camera-up` are
    checked too.

    source : name of the scene in messages, or its location
    """
    scene = SourceLocation(source) if isinstance(source, str) else source
    location = scene.field("camera")
    for name in ("position", "target", "up"):
        vector = np.asarray(getattr(camera, name), np.float64)
        if vector.shape != (3,) or not (np.abs(vector) <= LARGEST).all():
            allowed = f"three finite numbers between -{LARGEST:g} and {LARGEST:g}"
            raise location.field(name).wrong(vector, allowed)
    if not 0 < camera.fov < 180:
        raise location.field("fov").wrong(
            float(camera.fov), "above 0 and below 180 degrees", "It is the vertical field of view."
        )
    _check_lens(camera, location)
    _check_motion(camera, location)
    width, height = camera.resolution
    whole = isinstance(width, int) and isinstance(height, int)
    if not (whole and width >= 1 and height >= 1 and width * height <= MAX_PIXELS):
        raise (
            scene.field("film")
            .field("resolution")
            .wrong(
                [width, height],
                f"two whole numbers, at least 1 x 1 and at most {MAX_PIXELS:,} pixels",
                "Choose another resolution, such as [640, 480].",
            )
        )
    _check_pose(camera, location)
    for index, key in enumerate(camera.motion):
        _check_pose(key, location.field("motion").item(index))
    if len(camera.motion) > 1:
        _check_between_keys(camera, location.field("motion"))


def _check_lens(camera: Camera, location: SourceLocation) -> None:
    if camera.projection not in PROJECTIONS:
        raise location.field("type").wrong(camera.projection, f"one of: {', '.join(PROJECTIONS)}")
    for name, min_value in (("height", 0.0), ("aperture_radius", -1.0), ("focus_distance", 0.0)):
        value = getattr(camera, name)
        if value is not None and not (np.isfinite(value) and value > min_value and value >= 0):
            raise location.field(name).wrong(float(value), "0 or more" if min_value < 0 else "above 0")
    if not (0 < camera.pixel_aspect < np.inf):
        raise location.field("pixel_aspect").wrong(
            float(camera.pixel_aspect), "above 0", "It is the width of a pixel over its height."
        )
    if len(camera.principal_point) != 2 or not np.isfinite(camera.principal_point).all():
        raise location.field("principal_point").wrong(list(camera.principal_point), "two finite numbers")
    for name, usual in (("pixel_aspect", 1.0), ("principal_point", (0.5, 0.5))):
        if camera.projection == "panorama" and getattr(camera, name) != usual:
            raise location.field(name).error(
                "is given, but a camera of type panorama sees all around.",
                'Leave it out, or take type = "perspective".',
            )
    if camera.aperture_radius > 0 and camera.projection != "perspective":
        raise location.field("aperture_radius").error(
            f"is {camera.aperture_radius:g}, but a camera of type {camera.projection} has no lens.",
            'Leave it out, or take type = "perspective".',
        )


def _check_motion(camera: Camera, location: SourceLocation) -> None:
    opened, closed = camera.shutter
    if not (np.isfinite([opened, closed]).all() and opened <= closed):
        raise location.field("shutter").wrong(
            [float(opened), float(closed)], "two finite numbers, the first at most the second"
        )
    for index, key in enumerate(camera.motion):
        here = location.field("motion").item(index)
        for name in ("position", "target", "up"):
            vector = np.asarray(getattr(key, name), np.float64)
            if vector.shape != (3,) or not (np.abs(vector) <= LARGEST).all():
                allowed = f"three finite numbers between -{LARGEST:g} and {LARGEST:g}"
                raise here.field(name).wrong(vector, allowed)
        before = camera.motion[index - 1].time if index else -np.inf
        if not (np.isfinite(key.time) and key.time > before):
            raise here.field("time").wrong(
                float(key.time), f"above {before:g}, the key before" if index else "a finite number", "Sort them."
            )


def _check_between_keys(camera: Camera, location: SourceLocation) -> None:
    """Raise SceneError if the camera is at its target, or looks along `up`, at a time when the shutter is open.

    Other times are allowed, because a film may cut between two opposite views while the shutter is closed.

    location : location of the list of keys
    """
    opened, closed = camera.shutter
    views = np.array([key.target - key.position for key in camera.motion])
    ups = np.array([key.up for key in camera.motion])
    views, ups = views / np.abs(views).max(), ups / np.abs(ups).max()
    # Bezier points of view x up, which points to the right of the image, and is quadratic in time between two keys.
    first, last = np.cross(views[:-1], ups[:-1]), np.cross(views[1:], ups[1:])
    middle = 0.5 * (np.cross(views[:-1], ups[1:]) + np.cross(views[1:], ups[:-1]))
    # If both points are on the side of the first one, so is the whole curve, which then does not reach 0.
    crosses = np.minimum((first * middle).sum(axis=1), (first * last).sum(axis=1)) <= 0
    for index in np.flatnonzero(crosses).tolist():
        a, b, c = first[index], middle[index], last[index]
        x, y, z = (Polynomial(powers) for powers in np.stack([a, 2 * (b - a), a - 2 * b + c], axis=1))
        slope = (x**2 + y**2 + z**2).deriv()
        shortest = _PARALLEL * np.sqrt(max(a @ a, c @ c))
        for t in slope.trim(1e-8 * np.abs(slope.coef).max()).roots().real:
            before, after = camera.motion[index], camera.motion[index + 1]
            span = after.time - before.time
            share = (opened - before.time) / span - _PARALLEL, (closed - before.time) / span + _PARALLEL
            if 0 < t < 1 and share[0] <= t <= share[1] and np.linalg.norm([x(t), y(t), z(t)]) < shortest:
                raise location.item(index + 1).error(
                    f"is reached from {location.item(index).path} through a pose without a view: at time "
                    f"{before.time + t * span:.6g} the camera is at its target, or looks "
                    "along up.",
                    "Move one of the two keys, or put another between them.",
                )


def _check_pose(camera: Camera | CameraKey, location: SourceLocation) -> None:
    view = camera.target - camera.position
    distance = np.linalg.norm(view)
    up = location.field("up")
    if not distance > 1e-12 * np.linalg.norm(camera.position):
        raise location.field("target").error(
            f"is the same point as {location.field('position').path}, so that the camera looks nowhere.",
            "Move one of them.",
        )
    length = np.linalg.norm(camera.up)
    if not length > 0:
        raise up.wrong(camera.up, "a vector of any length but zero", f"For example {up.setting([0, 1, 0])}.")
    if np.linalg.norm(np.cross(view / distance, camera.up / length)) < _PARALLEL:
        across = np.eye(3, dtype=int)[np.argmin(np.abs(view))].tolist()
        raise up.error(
            f"is {up.written(camera.up)}, parallel to the view from position to target, which leaves no up.",
            f"Choose another, such as {up.setting(across)}.",
        )
