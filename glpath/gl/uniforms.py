"""Values of uniforms in the form that moderngl takes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def vectors(vectors: Sequence[NDArray[np.float64]]) -> object:
    """As moderngl takes an array of vec3: a tuple for one, a list of tuples for more."""
    tuples = [tuple(float(x) for x in v) for v in vectors]
    return tuples if len(tuples) > 1 else tuples[0]
