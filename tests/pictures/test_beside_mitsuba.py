"""Each material, texture slot and light beside Mitsuba: the same small scene by path tracing and by a gather.

Mitsuba has it as `glpath export` writes it; where it has no such lobe, by glTF's formulas written for it
(tests/reference/gltf_in_mitsuba.py). `make test` compares with what Mitsuba found, in squares of pixels
(tests/data/witnesses.npz, written by `python -m tests.pictures.test_beside_mitsuba`); `make evidence` asks Mitsuba
itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.compare import relative_mse
from glpath.compare.picture import BLOCK_SIDE, Noise, Picture
from glpath.compare.statistical import stat
from glpath.film.film import Film
from glpath.io.export.mitsuba import MitsubaScene, described
from glpath.scene import Scene
from glpath.scene.model import Float64
from tests.support.repository import TESTS
from tests.support.witnesses import Witness, lights, materials, textures

WITNESSES: dict[str, Witness] = {**materials(), **textures(), **lights()}
STORED = TESTS / "data" / "witnesses.npz"
#: Renders of Mitsuba, of other seeds each, so that the noise of their mean is known.
BATCHES = 8
#: Where the gather's own solution is too coarse for half a percent: of a room of 3, a sharp shadow of the sun.
ELEMENTS = 0.2
ALL_LIGHT = 64


def translated(witness: Witness, depth: int) -> MitsubaScene:
    """Without differences but those that the witness knows of."""
    made = described(witness.scene, depth, instances=False)
    left = [text for text in made.differences if not any(note in text for note in witness.notes)]
    plugins = dict(made.plugins)
    if witness.plugin is not None:
        plugins["it"] = witness.plugin
        left = [text for text in left if not text.startswith('material "it"')]
    assert not left
    return MitsubaScene(plugins, ())


def by_mitsuba(witness: Witness, depth: int, spp: int) -> Float64:
    """(BATCHES, H, W, 3), of `spp` samples in all."""
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    import drjit

    from benchmarks.peers import mitsuba as mitsuba_peer
    from tests.reference import gltf_in_mitsuba

    gltf_in_mitsuba.register(mitsuba_peer.load_mitsuba(), drjit)
    scene = mitsuba_peer.in_memory(translated(witness, depth))
    return np.stack([mitsuba_peer.render_peer(scene, spp // BATCHES, seed) for seed in range(1, BATCHES + 1)])


def squares(image: Float64, side: int) -> Float64:
    """(..., h, w, 3) means of squares of pixels."""
    *more, height, width, _ = image.shape
    return np.asarray(image.reshape(*more, height // side, side, width // side, side, 3).mean(axis=(-4, -2)))


def picture(batches: Float64) -> Picture:
    variance = batches.var(axis=0, ddof=1) / len(batches)
    noise = Noise(variance, squares(batches, BLOCK_SIDE), np.ones(len(batches), np.int64))
    return Picture(batches.mean(axis=0), noise)


def render(scene: Scene, engine: str, depth: int, spp: int, **options: Any) -> Film:
    if engine == "gather":
        solution = glpath.solve_radiosity(scene, method="monte-carlo", size=ELEMENTS)
        return glpath.render(scene, spp=spp, integrator="gather", radiosity=solution, **options)
    return glpath.render(scene, spp=spp, max_depth=depth, **options)


@pytest.mark.evidence
@pytest.mark.parametrize("engine", ["path", "gather"])
@pytest.mark.parametrize("name", WITNESSES)
def test_a_witness_is_mitsubas(name: str, engine: str) -> None:
    """The mean within half a percent, the error no more than the noise of both, and nothing that noise is not.

    Of 4096 pixels the squares of noise add up to within 5 % of what they should: a seventh more is no noise.
    """
    witness = WITNESSES[name]
    depth = ALL_LIGHT if engine == "gather" else witness.depth
    theirs = picture(by_mitsuba(witness, depth, 768))
    # More than for Mitsuba's error in a pixel: pixels that share random numbers have their error in common.
    film = render(witness.scene, engine, depth, 640)
    assert theirs.noise is not None
    noise = ((film.variance_of_mean() + theirs.noise.variance) / (theirs.mean**2 + 0.01)).mean()
    off, error = film.mean.mean() / theirs.mean.mean() - 1.0, relative_mse(film.mean, theirs.mean)
    # A gather's bias may be 3 % in blocks; in single pixels and blocks of these rooms it is up to a percent.
    # Pixels share samples of an environment map, so the noise of its whole picture is about 2 %.
    tolerance, visible_bias = (0.015, 0.04) if engine == "gather" else (0.005, 0.03)
    verdict = stat(Picture.of_film(film), theirs, tolerance=tolerance, sees=visible_bias)
    print(f"{name:20s} {engine:6s} mean {off:+.2%} relMSE {error:.1e} noise {noise:.1e}; {verdict.summary}")
    assert abs(off) < (witness.gather if engine == "gather" else 0.005)
    assert error < 1.15 * noise
    assert verdict.passed, verdict.summary


@pytest.mark.parametrize("name", WITNESSES)
def test_a_witness_is_what_mitsuba_found(name: str) -> None:
    """By path tracing, in squares of 8 x 8 pixels."""
    with np.load(STORED) as stored:
        theirs, error = stored[name].astype(float), stored[f"{name}.error"].astype(float)
    film = render(WITNESSES[name].scene, "path", WITNESSES[name].depth, 64)
    used = film.batch_counts > 0
    batches = squares(film.radiance_sums[used] / film.batch_counts[used, None, None, None], 8)
    ours = batches.mean(axis=0)
    own = batches.std(axis=0, ddof=1) / np.sqrt(len(batches))
    of_mean = batches.mean(axis=(1, 2, 3)).std(ddof=1) / np.sqrt(len(batches))
    assert abs(ours.mean() - theirs.mean()) < 0.005 * theirs.mean() + 3.0 * of_mean
    off = np.abs(ours - theirs) / (0.005 * theirs + np.hypot(own, error) + 1e-4 * theirs.mean())
    assert np.median(off) < 1.5
    assert np.percentile(off, 95) < 5.0


def test_what_is_stored_is_of_these_witnesses() -> None:
    with np.load(STORED) as stored:
        assert {name for name in stored.files if not name.endswith(".error")} == set(WITNESSES)
    assert STORED.stat().st_size < 128 * 1024


def store() -> None:
    """Write what the quick tests compare with; Mitsuba takes some minutes."""
    found: dict[str, Any] = {}
    for name, witness in WITNESSES.items():
        batches = squares(by_mitsuba(witness, witness.depth, 8192), 8)
        found[name] = batches.mean(axis=0).astype(np.float32)
        found[f"{name}.error"] = (batches.std(axis=0, ddof=1) / np.sqrt(BATCHES)).astype(np.float16)
        print(name, found[name].mean(), flush=True)
    np.savez_compressed(STORED, **found)


if __name__ == "__main__":
    store()
