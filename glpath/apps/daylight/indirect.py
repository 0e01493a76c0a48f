"""Reflected light at sensors for each patch of the sky and each sun, stored as two factors of a matrix."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.film.bias import Bias
from glpath.system.npz import Arrays

Float32 = NDArray[np.float32]

# Maximum number of floats in a block of columns (32 MiB).
_COLUMNS = 1 << 23


@dataclass(frozen=True, eq=False)
class Indirect:
    """Irradiance of N sensors by reflected light: the matrix product (weights @ radiosity).

    weights   : scipy.sparse.csr_array (N, R) float32; the identity if the product itself takes less memory
    radiosity : (R, C) float32, radiosity of element sides for each column (ground, patches and suns); the product
                itself if `weights` is the identity
    errors    : (N,) float32, standard errors of the sums over columns of ground and sky, from the sensors' rays
    bias      : bias of the light under a sky and a ground of radiance 1, caused by element size; None if unknown
    """

    weights: Any
    radiosity: Float32
    errors: Float32
    bias: Bias | None = None

    def rows(self, which: NDArray[np.intp], columns: slice) -> Float32:
        """Return (n, c) float32 irradiance of some sensors for some columns (ground, patches or suns)."""
        weights, radiosity = self.weights[which], self.radiosity[:, columns]
        found = np.empty((weights.shape[0], radiosity.shape[1]), np.float32)
        # Multiply in blocks of columns, because the product copies arrays that are not contiguous.
        step = max(1, _COLUMNS // max(1, len(radiosity)))
        for begin in range(0, radiosity.shape[1], step):
            some = slice(begin, begin + step)
            found[:, some] = weights @ np.ascontiguousarray(radiosity[:, some])
        return found

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays to store in a file; `read` is the inverse."""
        w = self.weights.tocsr()
        return {
            "radiosity": self.radiosity,
            "gathered": w.data,
            "gathered_side": w.indices.astype(np.int32),
            "gathered_begin": w.indptr.astype(np.int64),
            "gathered_error": self.errors,
        } | ({} if self.bias is None else {"bias": np.array(list(vars(self.bias).values()))})

    @classmethod
    def read(cls, arrays: Arrays, sensors: int) -> Indirect:
        """Read arrays that `arrays` returned. Raises ValueError for inconsistent arrays."""
        from scipy import sparse

        radiosity = arrays.read("radiosity", "f", (None, None))
        begin = arrays.read("gathered_begin", "i", (sensors + 1,))
        side = arrays.read("gathered_side", "i", (None,))
        values = arrays.read("gathered", "f", (len(side),))
        if not (begin[0] == 0 and begin[-1] == len(side) and (np.diff(begin) >= 0).all()):
            raise ValueError("its gathered_begin is none")
        if len(side) and not (side.min() >= 0 and side.max() < len(radiosity)):
            raise ValueError("its gathered_side has sides that there are not")
        weights = sparse.csr_array((values, side, begin), shape=(sensors, len(radiosity)))
        bias = Bias(*arrays.read("bias", "f", (len(fields(Bias)),)).tolist()) if "bias" in arrays else None
        return cls(weights, radiosity, arrays.read("gathered_error", "f", (sensors,)), bias)
