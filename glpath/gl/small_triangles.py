"""Scan of triangles in two parts: a compute shader takes those in few cells of the path-buffer, a draw the others.

Setting up a triangle costs a rasteriser more than testing a few cells. Mesa's llvmpipe does it in one thread, for
each of three vertices.

Cost:     16 bytes a cell of the path-buffer and 24 a triangle; a pass over the cells.
Poor at:  few triangles; triangles that touch many cells each.
Source:   Karis et al. 2021, A Deep Dive into Nanite Virtualized Geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import moderngl
import numpy as np

from glpath.gl.passes import Dispatch, Pass
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts

_GROUP = 64  # group size of scan_small.comp
_WIDEST = 1 << 15  # groups across, below every device's limit


def empty_words(gl: moderngl.Context, cells: tuple[int, int]) -> moderngl.Buffer:
    """Create the buffer for the hits of each cell's four paths, initially none. Scans leave it empty again."""
    return gl.buffer(data=b"\xff" * (16 * cells[0] * cells[1]))


class TriangleList:
    """List of the triangles that are not small, which a scan of the path-buffer draws.

    elements : three vertices of each triangle
    command  : indirect command that draws them
    defines  : defines of path_scan.vert, which draws them

    Parameters
    ----------
    count : maximum number of triangles
    """

    defines: ClassVar[dict[str, object]] = {"LISTED": 1}

    def __init__(self, gl: moderngl.Context, count: int) -> None:
        self._gl = gl
        self.elements = gl.buffer(reserve=12 * max(1, count))
        self.command = gl.buffer(reserve=20)
        self._nothing = gl.buffer(data=np.array([0, 1, 0, 0, 0], np.uint32).tobytes())

    def clear(self) -> None:
        """Empty the list on the device; commands that were issued earlier still read the old list."""
        self._gl.copy_buffer(self.command, self._nothing)


class SmallTriangles:
    """Compute shader that rasterizes triangles that touch few cells, and lists the others for a later draw call.

    Parameters
    ----------
    parts  : parts of the scan's program
    target : framebuffer into which a pass then merges the hits of the compute shader
    words  : buffer for the hits in the target's cells, made by `empty_words`
    listed : list of the triangles to draw, with room for each triangle in every view
    blend, clear : blending of the merge pass, and the colour to which it first clears the target
    """

    def __init__(
        self,
        name: str,
        gl: moderngl.Context,
        parts: ProgramParts,
        target: moderngl.Framebuffer,
        words: moderngl.Buffer,
        listed: TriangleList,
        *,
        blend: str,
        clear: tuple[float, float, float, float] | None = None,
    ) -> None:
        self._list = listed
        self._scan = Dispatch(
            f"{name}: small triangles",
            gl,
            load_program(
                gl, compute="path_buffer/scan_small.comp", generated=parts.generated, defines=parts.defines
            ),
            parts.textures,
            {0: listed.command, 1: listed.elements, 2: words},
        )
        self._merge = Pass(
            f"{name}: merge",
            gl,
            load_program(
                gl,
                vertex="gl/fullscreen.vert",
                fragment="path_buffer/scan_merge.frag",
                generated=parts.generated,
                defines=parts.defines,
            ),
            target,
            blend=blend,
            clear=clear,
            buffers={2: words},
        )

    def run(self, uniforms: Mapping[str, object], count: int) -> None:
        """Scan the first `count` triangles."""
        self._list.clear()
        groups = -(-count // _GROUP)
        given = {**uniforms, "listed_of": count}
        if groups:
            self._scan.run(given, (min(groups, _WIDEST), -(-groups // _WIDEST)))
        self._merge.run(given)
