"""The mesh that blocks are tested on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks import generated_models as models


@pytest.fixture(scope="module")
def terrain() -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """A terrain of some 3,000 vertices in single precision."""
    vertices, faces = models.creased_terrain(3000)
    return vertices.astype(np.float32), faces
