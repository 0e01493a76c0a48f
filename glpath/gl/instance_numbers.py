"""Numbers of the triangles of instances, beyond those of a scene's own, and the tables that shaders read of them.

Numbers come in blocks of a power of two, each of one instance, so that a look at a table finds the instance of a
triangle. `shaders/scene/instances.glsl` reads them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.scene.instances import InstancedScene

Int64 = NDArray[np.int64]

# Numbers that may be in use whatever is left out of them; and by what share more than there are triangles.
_FREE, _WASTE = 1 << 28, 1.25
_MIN_SHIFT, _MAX_SHIFT = 4, 27


@dataclass(frozen=True)
class InstanceNumbers:
    """The numbers of a scene's instances' triangles.

    shift  : the logarithm of a block's size
    blocks : (I,) how many an instance has
    more   : (I,) by what the numbers of its triangles are more than those of its mesh's
    end    : of all numbers
    """

    instances: InstancedScene
    shift: int
    blocks: Int64
    more: Int64
    end: int

    @classmethod
    def of(cls, instances: InstancedScene) -> InstanceNumbers:
        """In the largest blocks that leave few numbers out."""
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
        """(1 + I, 3, 4): the identity, then world_from_mesh of each instance."""
        return np.concatenate([np.eye(3, 4)[None], self.instances.world_from_mesh])

    def block_table(self) -> Int64:
        """(1 + blocks, 3): 1 + the instance, 1 + its shape, `more`; zeros first, for triangles of no instance."""
        entries = np.column_stack([1 + np.arange(len(self.blocks)), 1 + self.instances.shape, self.more])
        return np.concatenate([np.zeros((1, 3), np.int64), np.repeat(entries, self.blocks, axis=0)])
