"""The part of a surface that is drawn while it is solved: all of a small mesh, a coarser version of a large one.

Every redraw of more triangles takes longer; fewer look much the same.
"""

from __future__ import annotations

from threading import Thread
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...solver.mesh.clustering import coarsen

if TYPE_CHECKING:
    from ...solver.interchange import MeshArrays


class DrawnPart:
    """Some of a mesh's vertices, and triangles on them.

    A thread finds them where that takes time: NumPy lets Blender go on while it works.  Quitting waits for the thread,
    about a second and a half with a million vertices; a thread that Python ends in mid-work can crash Blender.

    Attributes
    ----------
    ready
        Whether the others are set.
    vertices
        Which vertices of the mesh are drawn, (W,).
    triangles
        (S, 3), on those vertices.
    """

    vertices: NDArray[np.int64]
    triangles: NDArray[np.int64]

    def __init__(self, arrays: MeshArrays, most: int) -> None:
        """Start to look for at most `most` triangles."""
        self.ready = False
        if arrays.triangle_count <= most:
            self._find(arrays, most)
        else:
            Thread(target=self._find, args=(arrays, most)).start()

    def _find(self, arrays: MeshArrays, most: int) -> None:
        self.vertices, self.triangles = coarsen(arrays.vertices, arrays.triangles, most)
        self.ready = True
