"""What is drawn of a surface while it is solved: all of a small mesh, a coarser one in the place of a large mesh.

A picture of more triangles takes longer, each time that the viewport is drawn; one of fewer looks much the same.
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

    They are found in a thread where that takes time: NumPy lets Blender go on while it works.  Quitting waits for it,
    for about a second and a half with a million vertices; a thread that Python ends in mid-work can bring Blender down.

    Attributes
    ----------
    ready
        Whether the others are known.
    vertices
        Which vertices of the mesh are drawn, (W,).
    triangles
        (S, 3), on those vertices.
    """

    vertices: NDArray[np.int64]
    triangles: NDArray[np.int64]

    def __init__(self, arrays: MeshArrays, most: int) -> None:
        """Begin to look for no more than so many triangles."""
        self.ready = False
        if len(arrays.triangles) <= most:
            self._find(arrays, most)
        else:
            Thread(target=self._find, args=(arrays, most)).start()

    def _find(self, arrays: MeshArrays, most: int) -> None:
        self.vertices, self.triangles = coarsen(arrays.vertices, arrays.triangles, most)
        self.ready = True
