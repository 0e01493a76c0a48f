"""pyviewfactor as a process of its own: run by the Python that has it, which need not be the one that has glpath.

    python pyviewfactor_worker.py

Each line of standard input is a matrix to make, {"mesh": "mesh.npz", "out": "F.npy"}, of triangles (N, 3, 3) called
`triangles`; each line of standard output its answer, {"seconds": 1.5, "CPU seconds": 2.9}. The first answer, after
a small matrix for which its kernels are compiled, is its version. Nothing of glpath is imported here.

At its best: its matrix in one call, compiled and on all cores, the mesh itself as the obstacle, without which it
would look for none.
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
        # Its F[i, j] is from j to i.
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
