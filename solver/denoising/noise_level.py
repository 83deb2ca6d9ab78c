"""How large the noise of a mesh is, told from the mesh alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, eye_array

from ..mesh import TriangleMesh
from .normal_filter import filter_normals
from .surface import Surface, normals_and_areas, unit

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

FEWEST_VERTICES = 50
"""With fewer vertices inside the surface than this, noise cannot be told from shape."""

STRONG = 0.45
"""Noise above this share of the mean edge length leaves nothing in single normals for a bilateral filter to go by."""

_CREASE = 0.35  # angle between filtered normals across an edge
_SMOOTH_SHARE = 0.1  # of the vertices must remain for the second estimate
_CLIP = 2.5  # standard deviations beyond which a value counts as shape (a crease), not as noise
_CLIPPED_DEVIATION = 0.9546  # standard deviation of a unit normal variable within the clip
_LOW_SHARE = 0.25
_LOW_QUANTILE = 0.3186  # a quarter of a unit normal variable is smaller than this


def estimate_noise_level(mesh: TriangleMesh, surface: Surface) -> float:
    """Estimate the standard deviation of the noise along the surface's normal, in scene units.

    The Laplacian applied twice cancels the shape of a smooth surface up to fourth order and leaves the noise,
    magnified by a known factor at each vertex.  What creases and fine relief leave is larger and is clipped away.  A
    first estimate shows where the creases are; the second leaves their surroundings out.

    Returns
    -------
    0 where the mesh has fewer than `FEWEST_VERTICES` vertices away from its borders.
    """
    inside = mesh.used & ~mesh.border & (mesh.adjacency @ mesh.border.astype(float) == 0)
    if inside.sum() < FEWEST_VERTICES:
        return 0.0
    values = np.abs(_relief(mesh))
    first = _clipped_deviation(values[inside])
    if not 0.0 < first < STRONG * mean_edge_length(mesh):
        return first
    smooth = inside & ~_beside_creases(mesh, filter_normals(surface, mesh.vertices, first))
    enough = smooth.sum() >= max(FEWEST_VERTICES, _SMOOTH_SHARE * inside.sum())
    return _clipped_deviation(values[smooth]) if enough else first


def mean_edge_length(mesh: TriangleMesh) -> float:
    """Return the mean length of the edges, in scene units."""
    ends = mesh.vertices[mesh.node_vertex[mesh.edges]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()) if len(ends) else 0.0


def _relief(mesh: TriangleMesh) -> Floats:
    """Twice-applied Laplacian along smoothed normals over its gain: noise of deviation 1 has deviation 1 here, (N,)."""
    positions = mesh.vertices[mesh.node_vertex] - mesh.vertices[mesh.node_vertex].mean(axis=0)
    valence = np.maximum(np.diff(mesh.adjacency.indptr), 1)
    laplacian = csr_array(eye_array(len(valence)) - diags_array(1.0 / valence) @ mesh.adjacency)
    twice = csr_array(laplacian @ laplacian)
    gain = np.sqrt(np.asarray(twice.multiply(twice).sum(axis=1)).ravel())
    along = ((twice @ positions) * _smoothed_normals(mesh)).sum(axis=1)
    return np.divide(along, gain, out=np.zeros_like(along), where=gain > 0)


def _smoothed_normals(mesh: TriangleMesh) -> Floats:
    triangles = mesh.nodes.copy()
    turned = mesh.winding < 0
    triangles[turned] = triangles[turned, ::-1]
    normals, areas = normals_and_areas(mesh.vertices[mesh.node_vertex], triangles)
    around = unit(mesh.incidence.astype(float) @ (normals * areas[:, None]))
    for _ in range(2):
        around = around + mesh.adjacency @ around
    return unit(around)


def _beside_creases(mesh: TriangleMesh, normals: Floats) -> Booleans:
    """Nodes that a crease is at most two edges away from, (N,): the reach of the twice-applied Laplacian."""
    one, two = mesh.edge_triangles.T
    sharp = (two >= 0) & ((normals[one] * normals[two]).sum(axis=1) < np.cos(_CREASE))
    beside = np.zeros(mesh.node_count)
    beside[mesh.edges[sharp]] = 1.0
    for _ in range(2):
        beside = beside + mesh.adjacency @ beside
    return beside > 0


def _clipped_deviation(magnitudes: Floats) -> float:
    """Standard deviation of the noise among the magnitudes, of which a part is not noise but larger."""
    deviation = float(np.quantile(magnitudes, _LOW_SHARE)) / _LOW_QUANTILE
    for _ in range(50):
        kept = magnitudes[magnitudes <= _CLIP * deviation]
        if not len(kept):
            break
        before, deviation = deviation, float(np.sqrt(np.mean(kept**2))) / _CLIPPED_DEVIATION
        if abs(deviation - before) <= 1e-6 * before:
            break
    return deviation
