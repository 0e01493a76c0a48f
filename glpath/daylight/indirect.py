"""What reflections give to sensors under each patch of the sky and each sun: two matrices, whose product it is."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.film.bias import Bias
from glpath.system.npz import Arrays

Float32 = NDArray[np.float32]

# Floats of some columns: 32 MiB.
_COLUMNS = 1 << 23


@dataclass(frozen=True, eq=False)
class Indirect:
    """What reflections give to N sensors, as a product: (weights @ radiosity).

    weights   : scipy.sparse.csr_array (N, R) float32, or the identity where the rows themselves are smaller
    radiosity : (R, C) float32, of the sides for each column: ground, patches and suns
    errors    : (N,) float32, standard errors of the sums of the columns of ground and sky, by the sensors' rays
    bias      : of the light under a sky and a ground of radiance 1, by the size of the elements; None if unknown
    """

    weights: Any
    radiosity: Float32
    errors: Float32
    bias: Bias | None = None

    def rows(self, which: NDArray[np.intp], columns: slice) -> Float32:
        """(n, c) float32."""
        weights, radiosity = self.weights[which], self.radiosity[:, columns]
        found = np.empty((weights.shape[0], radiosity.shape[1]), np.float32)
        # Some columns at a time, as a product copies what is not contiguous.
        step = max(1, _COLUMNS // max(1, len(radiosity)))
        for begin in range(0, radiosity.shape[1], step):
            some = slice(begin, begin + step)
            found[:, some] = weights @ np.ascontiguousarray(radiosity[:, some])
        return found

    def arrays(self) -> dict[str, NDArray[Any]]:
        """As a file keeps them; `read` reads them."""
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
        """Raises ValueError for what `arrays` has not written."""
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
