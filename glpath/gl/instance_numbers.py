"""Numbering of instances' triangles, which follow a scene's own triangles, and lookup tables for shaders.

A block of successive numbers belongs to one instance, and its size is a power of two. So a table lookup by the
upper bits of a triangle's number finds the instance. `shaders/scene/instances.glsl` reads the tables.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.scene.instances import InstancedScene

Int64 = NDArray[np.int64]

# Count of triangle numbers that is always allowed, however many of them no triangle uses.
_FREE = 1 << 28
# Maximum ratio of the count of numbers to the count of triangles, if more than `_FREE` numbers are needed.
_WASTE = 1.25
_MIN_SHIFT, _MAX_SHIFT = 4, 27


@dataclass(frozen=True)
class InstanceNumbers:
    """Numbering of the triangles of a scene's instances.

    shift  : base-2 logarithm of the block size
    blocks : (I,) number of blocks of each instance
    more   : (I,) offset of an instance's triangle numbers from those of its mesh
    end    : largest number + 1
    """

    instances: InstancedScene
    shift: int
    blocks: Int64
    more: Int64
    end: int

    @classmethod
    def of(cls, instances: InstancedScene) -> InstanceNumbers:
        """Assign numbers, in the largest blocks that leave few numbers unused (`_FREE`, `_WASTE`)."""
        sizes = np.array([part.stop - part.start for part in instances.ranges])[instances.mesh]
        limit = max(_FREE, _WASTE * float(sizes.sum()))
        for shift in range(_MAX_SHIFT, _MIN_SHIFT - 1, -1):
            blocks = -(-sizes >> shift)
            if int(blocks.sum()) << shift <= limit:
                break
        ends = len(instances.mesh_of_triangle) + (np.cumsum(blocks) << shift)
        first = np.array([part.start for part in instances.ranges])[instances.mesh]
        return cls(instances, shift, blocks, ends - (blocks << shift) - first, int(ends[-1]))

    def maps(self) -> NDArray[np.float64]:
        """Return (1 + I, 3, 4) affine transforms: the identity, then world_from_mesh of each instance."""
        return np.concatenate([np.eye(3, 4)[None], self.instances.world_from_mesh])

    def block_table(self) -> Int64:
        """Return (1 + blocks, 3): index of the instance + 1, index of its shape + 1, and `more`.

        The first row is zero, for triangles of no instance.
        """
        entries = np.column_stack([1 + np.arange(len(self.blocks)), 1 + self.instances.shape, self.more])
        return np.concatenate([np.zeros((1, 3), np.int64), np.repeat(entries, self.blocks, axis=0)])
