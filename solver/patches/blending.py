"""Blending weights of overlapping patches (section 4.2).

The paper averages the patches at every point.  Evaluated between vertices that average jumps where a patch ends, so
the default weights form a partition of unity instead: piecewise linear on the mesh, zero on a patch's rim, one in
sum.  The blended surface is then continuous everywhere.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..mesh.triangle_mesh import TriangleMesh
from .patches import Patches

DEPTH_POWER = 1.5
"""Weights fall a little faster than the distance to the rim, where patches are at their worst."""

HIDING = 1000.0
"""Weight of a patch relative to one of the level below."""

PLATEAU = 0.05
"""Share of weight that a patch's fit gives to points which blending ignores."""


def blending_weights(mesh: TriangleMesh, patches: Patches, kind: str) -> Array:
    """Weight of each patch at each of its vertices, phi_k(p), (M,).

    Parameters
    ----------
    mesh, patches
        The cover.
    kind
        "partition": hop distance to the rim to the power of 1.5, divided by its sum over the patches; patches of a
        finer level weigh a thousand times as much as those they lie over.
        "uniform": 1 / n_p with n_p the number of patches that contain the vertex (eq. 6).
        Either is zero at vertices that pass through.
    """
    passed = patches.passed_through[patches.vertices]
    depth = patches.rim_distance.astype(np.float64)
    shape = depth**DEPTH_POWER * HIDING ** patches.levels[patches.vertex_patch] if kind == "partition" else 1.0
    raw = np.where(passed, 0.0, shape)
    # by node: each side of a crease is blended by itself
    total = np.bincount(patches.nodes, weights=raw, minlength=mesh.node_count)
    return np.divide(raw, total[patches.nodes], out=np.zeros_like(raw), where=raw > 0.0)


def fitting_weights(blending: Array, weights: Array, kind: str) -> Array:
    """Weights with which one patch is fitted: those that it has in the blend.

    The rim has no weight after blending, so it need not be fitted well: w = w0 (phi^2 + 0.05), rescaled to the sum of
    w0.

    Parameters
    ----------
    blending
        Blending weights phi at the patch's observations, (N,).
    weights
        Their own weights w0, (N,).
    kind
        "partition" or "uniform"; uniform blending is fitted with uniform weights.
    """
    if kind == "uniform":
        return weights
    fitted = weights * (blending**2 + PLATEAU)
    total = fitted.sum()
    scaled: Array = fitted * (weights.sum() / total) if total > 0.0 else fitted
    return scaled
