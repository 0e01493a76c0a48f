"""Uniform values in the form that moderngl takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def vectors(vectors: Sequence[NDArray[np.float64]] | NDArray[np.float64], size: int = 0) -> object:
    """Return vectors in moderngl's form for an array of vec3: a tuple for one, a list of tuples for more.

    size : length of the array in the shader; the last vector fills the rest
    """
    tuples = [tuple(float(x) for x in v) for v in vectors]
    tuples += tuples[-1:] * (size - len(tuples))
    return tuples if len(tuples) > 1 else tuples[0]
