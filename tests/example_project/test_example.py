"""Image tests as a project has them: `pip install "glpath[flip]" pytest`, then `pytest`.

The first run writes the baselines into `baseline/` beside this file, to be looked at and kept. Later runs compare;
`pytest --glpath-update failed` accepts what has changed.
"""

import numpy as np
import pytest

import glpath


def test_room(render_regression):
    render_regression("room.toml", spp=64, max_depth=3)


@pytest.mark.parametrize("height", [0.6, 1.4])
def test_room_from(render_regression, height):
    render_regression("room.toml", spp=64, max_depth=2, camera={"position": (0.6, height, 3.6)})


def test_two_pictures_in_one_test(render_regression):
    film = glpath.render("three-spheres", integrator="t-buffer", resolution=(48, 32), spp=4)
    render_regression(film, name="spheres")
    render_regression(np.log2(1 + film.mean), name="stops", mode="fuzzy", limits={"threshold": 4})
