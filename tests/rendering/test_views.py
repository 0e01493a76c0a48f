"""Many views by matrices: what a pixel shows is where the matrices project it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import UsageError
from glpath.scene import Scene

K = np.array([[50.0, 0.0, 24.0], [0.0, 50.0, 16.0], [0.0, 0.0, 1.0]])
#: Centres of small balls, which pictures must show where they are projected.
BALLS = np.array([[0.6, 0.3, 0.0], [-0.7, -0.4, 0.5], [0.1, -0.5, -0.8]])


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
@pytest.mark.parametrize("centre", [(24.0, 16.0), (19.5, 20.0)])
def test_surfaces_are_where_the_matrices_project_them(convention: Any, centre: tuple[float, float]) -> None:
    k = K.copy()
    k[:2, 2] = centre
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


@pytest.mark.parametrize(
    ("poses", "k", "options", "message"),
    [
        (np.eye(3), K, {}, r"poses: of shape \(3, 3\)"),
        (2 * np.eye(4), K, {}, "must end in"),
        (np.diag([2.0, 2, 2, 1]), K, {}, "no rotation: it stretches"),
        (np.diag([1.0, 1, -1, 1]), K, {}, "mirrors"),
        (np.eye(4), np.eye(4), {}, r"K: of shape \(4, 4\)"),
        (np.eye(4), K * [[1], [1.1], [1]], {}, "pixels here are square"),
        (np.eye(4), with_entry(0, 1, 2.0), {}, "without skew"),
        (np.eye(4), with_entry(0, 2, 24.3), {}, r"Round it to 24.5, which shifts .* 0.2 pixels"),
        (np.full((4, 4), np.nan), K, {}, "not finite"),
        ("pose", K, {}, "no array of numbers"),
        (np.eye(4), K, {"convention": "blender"}, "convention"),
        (np.eye(4), K, {"resolution": (0, 3)}, "resolution"),
    ],
)
def test_mistakes_are_explained(poses: Any, k: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        glpath.render_views("cornell-box", poses, k, spp=1, **options)
