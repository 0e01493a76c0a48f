"""Converged reference pictures for errors: from a file, shipped with glpath, or made by Mitsuba once and cached.

Pictures made here are cached in `glpath/references` of the user's cache folder (XDG_CACHE_HOME, else ~/.cache), by
the scene's digest and depth, batch by batch: after an interruption, the next run continues. Batches have different
seeds, so their spread gives the picture's error; the picture is finished when that is small enough.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.references.stored import error_of_reference, reference_path
from glpath.errors import GlpathError, UsageError
from glpath.film.film import read_image
from glpath.io import load_scene, shipped_scenes
from glpath.scene.model import Float64, Scene
from glpath.system.files import whole_file
from glpath.system.npz import open_npz
from glpath.system.versions import versions

Say = Callable[[str], None]

#: First seed of the batches; the pictures that are measured use small seeds.
FIRST_SEED = 1_000_000
#: Samples of a batch: a square number, because multijitter uses square strata.
BATCH = 256
# Fewer batches do not suffice to estimate their spread.
_LEAST_BATCHES = 8


@dataclass(frozen=True)
class Reference:
    """image: (H, W, 3) radiance; relmse: its error, NaN if unknown; source: its origin"""

    image: Float64
    relmse: float
    source: str


def reference_picture(
    given: str | Path | None, scene: Scene, depth: int, mitsuba: bool, enough: float, say: Say
) -> Reference | None:
    """Return the picture of a file; else the shipped one, else Mitsuba's, cached or new; None without Mitsuba.

    scene  : a comparable scene
    enough : largest relMSE to accept of a picture that was not given
    """
    width, height = scene.camera.resolution
    if given is not None:
        image = read_image(given)
        if image.shape[:2] != (height, width):
            raise UsageError(
                f"--reference {given}: is a picture of {image.shape[1]} x {image.shape[0]}, the bench's is "
                f"{width} x {height}.",
                f"Give --resolution {image.shape[1]}x{image.shape[0]}, or another picture.",
            )
        return Reference(image, error_of_reference(given), str(given))
    shipped = _shipped(scene, depth)
    if shipped is not None and (shipped.relmse <= enough or not mitsuba):
        return shipped
    if not mitsuba:
        return None
    path = reference_folder() / f"{Path(scene.name).name}-{width}x{height}-depth{depth}-{scene.digest()[:16]}.npz"
    return converged(scene, depth, path, enough, say)


def reference_folder() -> Path:
    """Return the folder in which pictures made here are cached."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "glpath" / "references"


def _shipped(scene: Scene, depth: int) -> Reference | None:
    if scene.name not in shipped_scenes():
        return None
    path = reference_path(scene.name, depth)
    if path is None:
        return None
    image = read_image(path)
    # The scene may differ from the shipped one of the same name.
    shipped = load_scene(scene.name).with_camera(resolution=(image.shape[1], image.shape[0]))
    if shipped.digest() != scene.digest():
        return None
    return Reference(image, error_of_reference(path), f"benchmarks/references/{path.name}")


def converged(scene: Scene, depth: int, path: Path, enough: float, say: Say) -> Reference:
    """Return Mitsuba's picture with an error of at most `enough`; add as many batches to `path` as needed."""
    batches, mean, squares = _kept(path, scene)
    peer = None
    while batches < _LEAST_BATCHES or _relmse(batches, mean, squares) > enough:
        if peer is None:
            peer = mitsuba_peer.to_mitsuba(scene, depth, spp=BATCH)
            say(f"no reference of relMSE {enough:.2g}: Mitsuba renders one, kept in {path}")
        image = mitsuba_peer.render_peer(peer, BATCH, FIRST_SEED + batches)
        mean, squares = (mean * batches + image) / (batches + 1), squares + image**2
        batches += 1
        error = _relmse(batches, mean, squares)
        made_with = {
            "program": f"Mitsuba {versions('mitsuba')['mitsuba']}, path, rr_depth 5, multijitter, box filter",
            "scene": scene.name,
            "max_depth": depth,
            "spp": batches * BATCH,
            "batches": batches,
            "first_seed": FIRST_SEED,
            "relmse_of_reference": error,
        }
        with whole_file(path) as temporary, temporary.open("wb") as stream:
            np.savez(stream, radiance=mean, squares=squares, made_with=json.dumps(made_with))
        if batches >= _LEAST_BATCHES:
            about = max(batches, round(batches * error / enough))
            say(f"reference: {batches} batches of about {about}, relMSE {error:.2g}")
    return Reference(mean, _relmse(batches, mean, squares), str(path))


def _kept(path: Path, scene: Scene) -> tuple[int, Float64, Float64]:
    """Return the number of batches, their mean and the sum of their squares; zeros if the file cannot be read."""
    width, height = scene.camera.resolution
    try:
        with open_npz(path, ".npz") as stored:
            made_with = json.loads(str(stored.read("made_with", "U", ())))
            mean, squares = (stored.read(name, "f", (height, width, 3)) for name in ("radiance", "squares"))
            return int(made_with["batches"]), mean, squares
    except (GlpathError, ValueError, KeyError):
        return 0, np.zeros((height, width, 3)), np.zeros((height, width, 3))


def _relmse(batches: int, mean: Float64, squares: Float64) -> float:
    """Return the relMSE of the mean of this many independent pictures, from their spread."""
    if batches < 2:
        return float("inf")
    variance_of_mean = np.maximum(squares / batches - mean**2, 0) / (batches - 1)
    return float(np.mean(variance_of_mean / (mean**2 + 0.01)))
