"""Smallest solution that calls the largest kernels, for the processes of `ahead`, which compile them."""

from __future__ import annotations

from glpath.radiosity.solvers.solve import solve_radiosity


def solve_smallest() -> None:
    """Solve two facing squares, one of which emits light."""
    lamp = {"type": "quad", "corners": [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]], "emission": {"radiance": 1}}
    wall = {"type": "quad", "corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}
    camera = {"position": [0, 0, 3], "target": [0, 0, 0]}
    solve_radiosity({"camera": camera, "shapes": [lamp, wall]}, patches=1, max_steps=1)
