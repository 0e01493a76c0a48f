"""Converged pictures by Mitsuba 3 that are part of a checkout: independent references for shipped scenes.

They are in this folder as linear float16 radiance, each with the command that made it
(`benchmarks/references/make.py`) and its own error.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError
from glpath.film.film import read_image
from glpath.scene.model import Float64
from glpath.system.npz import open_npz

#: Depth that includes all bounces: the rest is below the precision of a float.
ALL_BOUNCES = 64

FOLDER = Path(__file__).parent


def reference_path(scene: str, depth: int) -> Path | None:
    """Return the file with a shipped scene's picture at a path depth as PB counts it; None if there is none."""
    path = FOLDER / f"{scene}-depth{depth}.npz"
    return path if path.is_file() else None


def find_reference(scene: str, depth: int) -> Float64 | None:
    """Return the (H, W, 3) float64 radiance of `reference_path`; None if there is none."""
    path = reference_path(scene, depth)
    return None if path is None else read_image(path)


def error_of_reference(path: str | Path) -> float:
    """Return the relMSE that the file of a converged picture states; NaN if it states none."""
    if Path(path).suffix.lower() != ".npz":
        return math.nan
    with open_npz(path, ".npz") as stored:
        if "made_with" not in stored:
            return math.nan
        made_with = json.loads(str(stored.read("made_with", "U", ())))
        return float(made_with.get("relmse_of_reference", math.nan))


def stored_reference(scene: str, depth: int) -> Float64:
    """Return `find_reference` for a shipped picture. Raises GlpathError if the file is missing."""
    found = find_reference(scene, depth)
    if found is None:
        raise GlpathError(
            f"benchmarks/references/{scene}-depth{depth}.npz: missing from this checkout.",
            "git checkout benchmarks/references",
        )
    return found


def smaller(image: NDArray[np.floating], side: int) -> Float64:
    """Reduce a square image (S, S, ...) to a side that divides S, by the mean of each block."""
    n = len(image) // side
    assert image.shape[:2] == (n * side, n * side), f"{image.shape[:2]} in {side} x {side} blocks"
    return np.asarray(image.reshape(side, n, side, n, *image.shape[2:]).mean(axis=(1, 3)), float)


def at_one_size(*images: NDArray[np.floating]) -> list[Float64]:
    """Reduce square images, whose sides divide each other, to the smallest side."""
    side = min(map(len, images))
    return [smaller(image, side) for image in images]
