"""A scene's preview and what Jupyter shows of it."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

import glpath
from glpath.buffers.t_buffer import ClassicEye
from glpath.gl.camera import eye_uniforms
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.scene import preview


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("cornell-box", {}), ("three-spheres", {}), ("stacked", {"objects": 3000, "kind": "triangle"})],
)
def test_a_preview_sees_what_the_ray_tracer_sees(name: str, parameters: dict[str, object]) -> None:
    scene = glpath.load_scene(name, parameters).with_camera(resolution=(96, 64))
    gl = get_context().gl
    eye = ClassicEye(gl, DeviceScene(gl, scene), (96, 64))
    eye.fill(eye_uniforms(scene.camera))
    primitive, t = eye.read()
    found, distance = preview.first_hits(scene)
    # The device numbers primitives by kind too: triangles come last but planes.
    kinds = np.searchsorted([0, len(scene.triangles), len(scene.triangles) + len(scene.spheres)], found, "right")
    assert np.mean((found >= 0) == (primitive >= 0)) > 0.995
    same = (found >= 0) & (primitive >= 0)
    assert len(np.unique(kinds[same])) == sum(map(bool, map(len, (scene.triangles, scene.spheres, scene.planes))))
    close = np.isclose(distance[same], t[same], rtol=1e-3)
    assert np.mean(close) > 0.99  # an edge may fall to either side


def test_rays_of_a_camera_go_through_the_middles_of_its_pixels() -> None:
    camera = replace(
        glpath.load_scene("cornell-box").camera,
        position=np.zeros(3), target=np.array([0, 0, -1.0]), up=np.array([0, 1.0, 0]), fov=90.0, resolution=(4, 2),
    )  # fmt: skip
    rays = camera.rays()
    assert rays.shape == (2, 4, 3)
    np.testing.assert_allclose(rays / -rays[..., 2:], [
        [(x, y, -1) for x in (-1.5, -0.5, 0.5, 1.5)] for y in (0.5, -0.5)
    ])  # fmt: skip


def test_a_scene_shows_itself_with_picture_and_tables() -> None:
    bundle = glpath.load_scene("cornell-box")._repr_mimebundle_()
    assert str(bundle["text/plain"]).startswith("<Scene cornell-box: 32 triangles")
    assert Image.open(BytesIO(bundle["image/png"])).size == (320, 320)  # type: ignore[arg-type]
    page = str(bundle["text/html"])
    for words in ("8 shapes", "4 materials", "1 light<", "data:image/png;base64,", "W/(sr m²)"):
        assert words in page


def test_names_of_a_scene_are_text_not_markup() -> None:
    scene = glpath.load_scene("cornell-box")
    shapes = (replace(scene.shapes[0], name="<b>&"), *scene.shapes[1:])
    assert "&lt;b&gt;&amp;" in str(replace(scene, shapes=shapes)._repr_mimebundle_()["text/html"])


def test_a_long_table_is_cut_and_says_so() -> None:
    assert "154 more" in str(glpath.load_scene("office")._repr_mimebundle_()["text/html"])


def test_looking_at_a_scene_takes_no_opengl() -> None:
    code = (
        "import sys, glpath\n"
        "glpath.load_scene('three-spheres')._repr_mimebundle_()\n"
        "print([name for name in ('moderngl', 'numba') if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "[]\n"


def test_no_pixels_are_refused() -> None:
    with pytest.raises(glpath.UsageError, match="at least 1"):
        glpath.load_scene("cornell-box").preview(0)
