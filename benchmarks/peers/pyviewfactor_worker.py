"""pyviewfactor in a separate process, in the Python that has it, which may be another than glpath's.

    python pyviewfactor_worker.py

Each line of standard input asks for a matrix, {"mesh": "mesh.npz", "out": "F.npy"}, for (N, 3, 3) triangles in the
array `triangles`; each line of standard output is an answer, {"seconds": 1.5, "CPU seconds": 2.9}. The first
answer, after a small matrix that compiles the kernels, is the version. This file imports nothing of glpath.

It uses the fastest settings: the matrix in one compiled call on all cores. The mesh is passed as its own obstacle,
because by default pyviewfactor tests no obstruction.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib.metadata import version
from typing import Any

import numpy as np


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    import pyviewfactor
    import pyvista

    def matrix(triangles: Any) -> Any:
        corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        cells = np.column_stack([np.full(len(triangles), 3), index.reshape(-1, 3)]).ravel()
        mesh = pyvista.PolyData(corners, cells)
        start, before = time.perf_counter(), time.process_time()
        # pyviewfactor's F[i, j] is from j to i.
        found = pyviewfactor.compute_viewfactor_matrix(mesh, obstacles=mesh).T
        return {"seconds": time.perf_counter() - start, "CPU seconds": time.process_time() - before}, found

    matrix(np.random.default_rng(1).random((8, 3, 3)))
    print(json.dumps({"version": version("pyviewfactor")}), file=answers, flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        times, found = matrix(np.load(asked["mesh"])["triangles"])
        np.save(asked["out"], found)
        print(json.dumps(times), file=answers, flush=True)


if __name__ == "__main__":
    main()
