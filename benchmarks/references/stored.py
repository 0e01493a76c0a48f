"""Converged pictures by Mitsuba 3, which a checkout has: what somebody else's renderer sees in a scene.

They lie in this folder, linear radiance as float16, each with the command that made it
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

#: Depth at which all bounces are there: what is beyond is less than a float can hold beside the rest.
ALL_BOUNCES = 64

FOLDER = Path(__file__).parent


def reference_path(scene: str, depth: int) -> Path | None:
    """The file with the picture of a shipped scene at a path depth as PB counts it; None where none is stored."""
    path = FOLDER / f"{scene}-depth{depth}.npz"
    return path if path.is_file() else None


def find_reference(scene: str, depth: int) -> Float64 | None:
    """(H, W, 3) float64 radiance of `reference_path`; None where there is none."""
    path = reference_path(scene, depth)
    return None if path is None else read_image(path)


def error_of_reference(path: str | Path) -> float:
    """The relMSE that a converged picture's file says it has; NaN for a file that does not say."""
    if Path(path).suffix.lower() != ".npz":
        return math.nan
    with open_npz(path, ".npz") as stored:
        if "made_with" not in stored:
            return math.nan
        made_with = json.loads(str(stored.read("made_with", "U", ())))
        return float(made_with.get("relmse_of_reference", math.nan))


def stored_reference(scene: str, depth: int) -> Float64:
    """`find_reference`, for what ships. Raises GlpathError where the file is missing."""
    found = find_reference(scene, depth)
    if found is None:
        raise GlpathError(
            f"benchmarks/references/{scene}-depth{depth}.npz: missing from this checkout.",
            "git checkout benchmarks/references",
        )
    return found


def smaller(image: NDArray[np.floating], side: int) -> Float64:
    """A square image (S, S, ...) with a side that divides S: the mean of each block, as a camera would see it."""
    n = len(image) // side
    assert image.shape[:2] == (n * side, n * side), f"{image.shape[:2]} in {side} x {side} blocks"
    return np.asarray(image.reshape(side, n, side, n, *image.shape[2:]).mean(axis=(1, 3)), float)


def at_one_size(*images: NDArray[np.floating]) -> list[Float64]:
    """Square images of sides that divide each other, all as small as the smallest."""
    side = min(map(len, images))
    return [smaller(image, side) for image in images]
