"""Every engine renders every shipped scene, or says by name what it cannot."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest

import glpath
from glpath.integrators.by_name import Integrator
from glpath.io import shipped_scenes
from tests.support.engines import coarse

#: What an engine says instead, by scene.
REFUSED = {
    ("path", "three-spheres"): "planes (ground), which",
    ("path-buffer", "parlour"): "has glass (parlour/pane, parlour/glass)",
    ("path-buffer", "three-spheres"): "planes (ground), which",
    ("gather", "stacked"): "materials.red.specular",
    ("gather", "three-spheres"): "planes (ground), which",
    ("classic", "parlour"): "has glass (parlour/pane, parlour/glass)",
    ("t-buffer", "parlour"): "has glass (parlour/pane, parlour/glass)",
}

#: What takes most of a minute: the radiosity solutions of many triangles under a sky.
SLOW = {("terrain", "gather"), ("teapot", "gather")}


@pytest.mark.filterwarnings("ignore:The scene's ambient light:glpath.SceneWarning")
@pytest.mark.parametrize(
    ("name", "engine"),
    [
        pytest.param(name, engine, marks=pytest.mark.evidence if (name, engine) in SLOW else ())
        for name in shipped_scenes()
        for engine in get_args(Integrator)
    ],
)
def test_every_engine_renders_every_shipped_scene_or_says_what_it_cannot(name: str, engine: Any):
    options: dict[str, Any] = {"integrator": engine, "spp": 2, "resolution": (24, 18)}
    refusal = REFUSED.get((engine, name))
    if refusal:
        with pytest.raises(glpath.SceneError) as error:
            glpath.render(name, **options)
        assert refusal in error.value.message
        assert 'integrator="' in error.value.remedy
        return
    if engine == "gather":
        options["radiosity"] = coarse(name)
    film = glpath.render(name, **options)
    assert np.isfinite(film.mean).all()
    assert film.mean.max() > 0
