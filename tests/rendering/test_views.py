"""Many views by matrices: what a pixel shows is where the matrices project it."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import ContextError, GlpathError, TimeLimitError
from glpath.film.film import Film
from glpath.rendering.session import Session
from glpath.scene import Scene

K = np.array([[50.0, 0.0, 24.0], [0.0, 50.0, 16.0], [0.0, 0.0, 1.0]])
#: Centres of small balls, which pictures must show where they are projected.
BALLS = np.array([[0.6, 0.3, 0.0], [-0.7, -0.4, 0.5], [0.1, -0.5, -0.8]])


BAD_SIZES = [(0, 3), (np.nan, np.nan), (np.inf, 2), (10**9, 10**9), (1.5, 2)]
FAR = np.eye(4)
FAR[0, 3] = 1e308


def with_entry(row: int, column: int, value: float) -> np.ndarray:
    changed = K.copy()
    changed[row, column] = value
    return changed


def balls() -> Scene:
    return glpath.load_scene(
        {
            "camera": {"position": [0, 0, 9], "target": [0, 0, 0]},
            "materials": {"chalk": {"reflectance": 0.7}},
            "shapes": [
                {"type": "sphere", "center": c, "radius": 0.2, "name": f"ball-{i}", "material": "chalk"}
                for i, c in enumerate(BALLS.tolist())
            ],
            "sky": {"zenith": 1.0},
        }
    )


def looking(eye: Any, target: Any = (0, 0, 0), convention: str = "opengl") -> np.ndarray:
    """(4, 4) camera to world of a camera that sees y up."""
    eye, target = np.array(eye, float), np.array(target, float)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 1, 0], back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    pose[:3, 3] = eye
    if convention == "opencv":
        pose[:3, 1:3] *= -1
    return pose


POSES = [(0, 0, 4.0), (2.0, 1.0, 3.5), (-1.0, 2.0, 3.0)]


@pytest.mark.parametrize("convention", ["opengl", "opencv"])
@pytest.mark.parametrize(("centre", "fx"), [((24.0, 16.0), 50.0), ((19.3, 20.1), 50.0), ((25.0, 15.2), 38.0)])
def test_surfaces_are_where_the_matrices_project_them(
    convention: Any, centre: tuple[float, float], fx: float
) -> None:
    k = K.copy()
    k[:2, 2], k[0, 0] = centre, fx
    poses = [looking(eye, convention=convention) for eye in POSES]
    views = glpath.render_views(
        balls(), poses, k, resolution=(48, 32), convention=convention, spp=16, integrator="path", max_depth=1
    )
    assert views.rgb.shape == (3, 32, 48, 3)
    assert views.names == ("ball-0", "ball-1", "ball-2")
    for number, pose in enumerate(poses):
        # The usual projection, x = K R^T (X - t), in the axes of OpenCV.
        turn = pose[:3, :3] if convention == "opencv" else pose[:3, :3] * [1, -1, -1]
        local = (BALLS - pose[:3, 3]) @ turn
        at = (local @ k.T)[:, :2] / local[:, 2:]
        for ball in range(3):
            x, y = at[ball]
            rows, columns = np.nonzero(views.segmentation[number] == ball + 1)
            if not (2 < x < 46 and 2 < y < 30):
                continue
            assert len(rows)
            assert np.mean(columns + 0.5) == pytest.approx(x, abs=0.35)
            assert np.mean(rows + 0.5) == pytest.approx(y, abs=0.35)
            middle = views.depth[number, int(y), int(x)]
            assert middle == pytest.approx(local[ball, 2] - 0.2, abs=0.03)
            towards = views.normal[number, int(y), int(x)] @ (pose[:3, 3] - BALLS[ball])
            assert towards > 0.8 * np.linalg.norm(pose[:3, 3] - BALLS[ball]) * 0.9
    assert np.isinf(views.depth[views.segmentation == 0]).any()


def test_a_view_is_the_picture_of_the_same_camera() -> None:
    scene = balls()
    views = glpath.render_views(scene, looking((0, 0, 4.0)), K, spp=4, integrator="path", max_depth=1)
    camera = scene.with_camera(
        position=np.array([0, 0, 4.0]),
        target=np.array([0, 0, 3.0]),
        fov=float(np.degrees(2 * np.arctan(16 / 50))),
        resolution=(48, 32),
    )
    alone = glpath.render(camera, spp=4, integrator="path", max_depth=1)
    np.testing.assert_allclose(views.rgb[0], alone.mean, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("failure", [KeyboardInterrupt, ContextError("the device is lost"), TimeLimitError("over")])
def test_failure_in_a_view_keeps_the_films_of_the_views_before_it(
    failure: BaseException | type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    render, calls = Session.render, count()

    def failing(*given: Any) -> Film:
        if next(calls) == 2:
            raise failure
        return render(*given)

    poses, options = [looking(eye) for eye in POSES], {"spp": 1, "integrator": "path", "max_depth": 1}
    whole = glpath.render_views(balls(), poses, K, **options)
    monkeypatch.setattr(Session, "render", failing)
    with pytest.raises(BaseException) as caught:  # noqa: PT011  # whatever was raised
        glpath.render_views(balls(), poses, K, **options)
    assert caught.type is (failure if isinstance(failure, type) else type(failure))
    assert [film.mean.tolist() for film in caught.value.films] == whole.rgb[:2].tolist()  # type: ignore[attr-defined]
    assert "2 of 3 views" in caught.value.__notes__[0]


@pytest.mark.parametrize("integrator", ["path", "path-buffer", "t-buffer", "classic"])
def test_every_engine_sees_through_the_same_pixels(integrator: Any) -> None:
    """Each engine's nearest depth, of one sample at the pixel's centre, against rays in numpy."""
    k = np.array([[38.0, 0.0, 20.3], [0.0, 55.0, 18.4], [0.0, 0.0, 1.0]])
    camera = glpath.camera(looking((0.3, 0.2, 4.0)), k, resolution=(48, 32))
    film = glpath.render(balls(), camera=camera, spp=16, integrator=integrator, aovs=("object_id",))
    origin, directions = camera.position, camera.rays()
    found = np.zeros((32, 48), int)
    for number, ball in enumerate(BALLS):
        along = (ball - origin) @ np.moveaxis(directions, -1, 0).reshape(3, -1)
        beside = np.sum((ball - origin) ** 2) - along**2
        found[(beside < 0.2**2).reshape(32, 48)] = number + 1
    assert (found > 0).sum() > 40
    # Pixels at edges may show either, by the samples in them.
    assert np.mean(film.aov("object_id") != found) < 0.03


def test_a_shifted_principal_point_is_a_part_of_a_larger_picture() -> None:
    """A crop of a picture around the same view has the same rays; which random numbers they have differs."""
    scene, pose = balls(), looking((0.3, 0.2, 4.0))
    k = np.array([[50.0, 0.0, 19.5], [0.0, 50.0, 20.0], [0.0, 0.0, 1.0]])
    options = {"spp": 4, "integrator": "path", "max_depth": 1}
    shifted = glpath.render(scene, camera=glpath.camera(pose, k, resolution=(48, 32)), **options)
    k[:2, 2] = 28.5, 20.0
    whole = glpath.render(scene, camera=glpath.camera(pose, k, resolution=(57, 40)), crop=(9, 0, 48, 32), **options)
    assert shifted.mean.max() > 0.1
    assert np.mean(np.abs(shifted.mean - whole.mean)) < 0.02 * whole.mean.mean()


@pytest.mark.parametrize(
    ("poses", "k", "options", "message"),
    [
        (np.eye(3), K, {}, r"poses: of shape \(3, 3\)"),
        (2 * np.eye(4), K, {}, "must end in"),
        (np.diag([2.0, 2, 2, 1]), K, {}, "no rotation: it stretches"),
        (np.diag([1.0, 1, -1, 1]), K, {}, "mirrors"),
        (np.eye(4), np.eye(4), {}, r"K: of shape \(4, 4\)"),
        (np.eye(4), K * [[1], [-1.1], [1]], {}, "both must be above 0"),
        (np.eye(4), with_entry(0, 1, 2.0), {}, "without skew"),
        (np.full((4, 4), np.nan), K, {}, "not finite"),
        ("pose", K, {}, "where an array of numbers is needed"),
        (np.eye(4), K, {"convention": "blender"}, "convention"),
        *((np.eye(4), K, {"resolution": size}, "resolution") for size in BAD_SIZES),
        (np.eye(4), with_entry(0, 2, 1e308), {}, "resolution of twice the principal point"),
        (FAR, K, {}, r"poses\[0\]: camera.position is"),
        (np.eye(4), np.where([[1, 0, 0], [0, 1, 0], [0, 0, 0]], 1e-308, K), {}, r"poses\[0\]: camera.fov is 180"),
    ],
)
def test_mistakes_are_explained(poses: Any, k: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(GlpathError, match=message):
        glpath.render_views("cornell-box", poses, k, spp=1, **options)
