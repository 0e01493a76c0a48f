"""Paths with rays of their own: the fragment shader and the compute shader are one computation."""

from __future__ import annotations

import numpy as np
import pytest

from glpath import solve_radiosity
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.passes import Pass, PixelDispatch
from glpath.integrators import ray_paths
from glpath.integrators.gather import device_radiosity
from glpath.integrators.ray_paths import RayPathEngine
from glpath.integrators.settings import GatherSettings, PathTraceSettings
from glpath.scene import load_scene, path_traceable

# No multiple of a work group's side.
WINDOW = (3, 2, 45, 29)


@pytest.mark.parametrize("name", ["cornell-box-36", "room", "gather"])
@pytest.mark.parametrize("tests", [200, 10**7], ids=["one area", "areas"])
def test_a_compute_shader_has_the_bits_of_the_fragment_shader(
    name: str, tests: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """llvmpipe takes the one, graphics cards the other; either runs both here."""
    monkeypatch.setattr(ray_paths, "_TESTS_A_VERTEX", tests)
    gl = get_context().gl
    scene = path_traceable(load_scene("cornell-box-36" if name == "gather" else name))
    scene = scene.with_camera(resolution=(50, 40))
    settings: PathTraceSettings | GatherSettings = PathTraceSettings(max_depth=3)
    radiosity = None
    if name == "gather":
        settings = GatherSettings()
        radiosity = device_radiosity(gl, scene, solve_radiosity(scene, patches=50), settings)
    taken, counts = [], []
    for hardware, kind in ((False, Pass), (True, PixelDispatch)):
        engine = RayPathEngine(gl, DeviceScene(gl, scene), settings, WINDOW, radiosity=radiosity, hardware=hardware)
        assert {type(each) for each in engine._path_passes} == {kind}
        assert (len(engine._areas) > 1) is (tests > 1000)
        for index in range(3):
            engine.trace_path_set(index)
        taken.append(engine.take())
        counts.append(engine.statistics())
    assert taken[0].mean() > 0.01
    np.testing.assert_array_equal(taken[1], taken[0])
    assert counts[1] == counts[0]
