"""Estimate how large the noise of a mesh is from the mesh alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array

from ..arrays import Array, Booleans
from ..mesh.normals import normals_and_areas, unit
from ..mesh.triangle_mesh import TriangleMesh
from .normal_filter import filter_normals
from .seeds import scattered
from .surface import Surface

FEWEST_VERTICES = 200
"""With fewer vertices away from borders and creases, noise cannot be distinguished from shape."""

STRONG = 0.35
"""Noise above this share of the mean edge length makes single normals useless for a bilateral filter."""

_FOLDED = 0.14  # share of edges with the triangles folded over each other that only strong noise makes
_CREASE = 0.35  # angle between filtered normals across an edge
_SMOOTH_SHARE = 0.1  # of the vertices must be away from creases for them to stand for all
_CLIP = 2.5  # standard deviations beyond which a value counts as shape (a crease), not as noise
_CLIPPED_DEVIATION = 0.9546  # standard deviation of a unit normal variable within the clip
_LOW_SHARE = 0.25
_LOW_QUANTILE = 0.3186  # a quarter of a unit normal variable is smaller than this
_MEDIAN_LENGTH = 1.1774  # of a vector of two unit normal variables
_NEIGHBOURHOOD = 3  # rings
_TOO_EVEN = 0.14  # of the unevenness; white noise has 0.19 or more
_REPEATED = 0.1  # of the repetition
_REPEATED_LINES = 0.22  # where there are only lines; 60 of them have up to 0.16 by chance, regular ones 0.32 or more
_SOURCES = 400
_BEYOND, _FARTHEST = 6, 10  # rings: two applications of the Laplacian reach two rings around each of two nodes


@dataclass(frozen=True)
class NoiseEstimate:
    """The noise estimated from a mesh.

    Attributes
    ----------
    level
        Standard deviation of the noise along the surface's normals, in scene units; 0 where it cannot be estimated.
    along_surface
        The same within the surface, along each of two directions.  Uneven spacing of the vertices counts as noise, so
        this is an upper bound.
    unevenness
        Coefficient of variation of the fine relief's mean size around each vertex.  About 0.2 for noise, which is
        the same everywhere; larger for relief that belongs to the shape, and smaller for a pattern.
    repetition
        Largest correlation of the fine relief with itself from 6 to 10 rings away.  About 0.02 for noise, which knows
        nothing of itself beyond the Laplacians' reach; larger for a brick wall or a fabric.
    relief
        The fine relief itself, (N,), clipped; empty where nothing can be estimated.
    """

    level: float
    along_surface: float
    unevenness: float
    repetition: float
    relief: Array = field(default_factory=lambda: np.zeros(0), compare=False, repr=False)

    @property
    def is_pattern(self) -> bool:
        """Whether the relief is too even, or repeats itself too well, for noise."""
        return self.unevenness < _TOO_EVEN or self.repetition > _REPEATED

    @property
    def is_pattern_of_lines(self) -> bool:
        """The same for relief that consists of lines, of which there are few: by chance they repeat themselves more."""
        return self.unevenness < _TOO_EVEN or self.repetition > _REPEATED_LINES


UNKNOWN = NoiseEstimate(0.0, 0.0, np.inf, 0.0)


def estimate_noise_level(mesh: TriangleMesh, surface: Surface) -> NoiseEstimate:
    """Estimate the noise of a mesh from the mesh alone.

    The Laplacian applied twice cancels the shape of a smooth surface up to fourth order and leaves the noise,
    magnified by a known factor at each vertex.  What creases and fine relief leave is larger and is clipped away.  A
    first estimate shows where the creases are; the second leaves their surroundings out.
    """
    inside = mesh.used & ~mesh.border & (mesh.adjacency @ mesh.border.astype(float) == 0)
    if inside.sum() < FEWEST_VERTICES:
        return UNKNOWN
    signed, sideways = _relief(mesh)
    relief = np.abs(signed)
    first = _clipped_deviation(relief[inside])
    if first == 0.0:
        return UNKNOWN
    chosen = inside
    if first < STRONG * mean_edge_length(mesh):
        smooth = inside & ~_beside_creases(mesh, filter_normals(surface, mesh.vertices, first))
        if smooth.sum() < FEWEST_VERTICES and _folded_share(mesh, surface) < _FOLDED:
            return UNKNOWN
        if smooth.sum() >= max(FEWEST_VERTICES, _SMOOTH_SHARE * inside.sum()):
            chosen = smooth
    level = _clipped_deviation(relief[chosen])
    clipped = np.clip(signed, -_CLIP * level, _CLIP * level)
    along_surface = float(np.median(sideways[inside])) / _MEDIAN_LENGTH
    unevenness = _unevenness(mesh, np.abs(clipped), chosen)
    return NoiseEstimate(level, along_surface, unevenness, _repetition(mesh, clipped, chosen), clipped)


def mean_edge_length(mesh: TriangleMesh) -> float:
    """Return the mean length of the edges, in scene units."""
    ends = mesh.vertices[mesh.node_vertex[mesh.edges]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()) if len(ends) else 0.0


def _relief(mesh: TriangleMesh) -> tuple[Array, Array]:
    """Return the twice-applied Laplacian over its gain: noise of deviation 1 has deviation 1 here.

    Returns
    -------
    Its part along smoothed normals, with sign, and the length of the rest, (N,) each.
    """
    positions = mesh.vertices[mesh.node_vertex] - mesh.vertices[mesh.node_vertex].mean(axis=0)
    valence = np.maximum(np.diff(mesh.adjacency.indptr), 1)
    laplacian = csr_array(eye_array(len(valence)) - diags_array(1.0 / valence) @ mesh.adjacency)
    twice = csr_array(laplacian @ laplacian)
    gain = np.sqrt(np.asarray(twice.multiply(twice).sum(axis=1)).ravel())
    change = (twice @ positions) * np.divide(1.0, gain, out=np.zeros_like(gain), where=gain > 0)[:, None]
    normals = smoothed_normals(mesh)
    along = (change * normals).sum(axis=1)
    return along, np.linalg.norm(change - along[:, None] * normals, axis=1)


def smoothed_normals(mesh: TriangleMesh) -> Array:
    """Return unit normals of the nodes, (N, 3), averaged over two rings."""
    triangles = mesh.nodes.copy()
    turned = mesh.winding < 0
    triangles[turned] = triangles[turned, ::-1]
    normals, areas = normals_and_areas(mesh.vertices[mesh.node_vertex], triangles)
    around = unit(mesh.incidence.astype(float) @ (normals * areas[:, None]))
    for _ in range(2):
        around = around + mesh.adjacency @ around
    return unit(around)


def _beside_creases(mesh: TriangleMesh, normals: Array) -> Booleans:
    """Nodes that a crease is at most two edges away from, (N,): the reach of the twice-applied Laplacian."""
    one, two = mesh.edge_triangles.T
    sharp = (two >= 0) & ((normals[one] * normals[two]).sum(axis=1) < np.cos(_CREASE))
    beside = np.zeros(mesh.node_count)
    beside[mesh.edges[sharp]] = 1.0
    for _ in range(2):
        beside = beside + mesh.adjacency @ beside
    return beside > 0


def _folded_share(mesh: TriangleMesh, surface: Surface) -> float:
    """Share of the edges whose two triangles face against each other."""
    normals, _ = normals_and_areas(mesh.vertices, surface.triangles)
    one, two = mesh.edge_triangles[mesh.edge_triangles[:, 1] >= 0].T
    return float(np.mean((normals[one] * normals[two]).sum(axis=1) < 0)) if len(one) else 0.0


def _unevenness(mesh: TriangleMesh, relief: Array, chosen: Booleans) -> float:
    total, count = relief * chosen, chosen.astype(np.float64)
    reach = mesh.reach.astype(np.float64)
    for _ in range(_NEIGHBOURHOOD):
        total, count = reach @ total, reach @ count
    around = total[chosen] / count[chosen]
    return float(around.std() / around.mean()) if around.any() else np.inf


def _repetition(mesh: TriangleMesh, relief: Array, chosen: Booleans) -> float:
    """Return the largest correlation of the relief, (N,), with itself on rings beyond the Laplacians' reach."""
    power = float(np.mean(relief[chosen] ** 2))
    nodes = scattered(np.flatnonzero(chosen))[:_SOURCES]
    if power == 0.0 or not len(nodes):
        return 0.0
    shape = (len(nodes), mesh.node_count)
    disks = csr_array((np.ones(len(nodes), dtype=bool), (np.arange(len(nodes)), nodes)), shape=shape)
    kept = np.where(chosen, relief, 0.0)
    inner = np.zeros((2, len(nodes)))
    largest = 0.0
    for ring in range(1, _FARTHEST + 1):
        disks = csr_array(disks @ mesh.reach)
        outer = np.stack([disks @ kept, disks @ chosen.astype(np.float64)])
        total, count = outer - inner
        inner = outer
        if ring >= _BEYOND and count.sum() > 0:
            largest = max(largest, abs(float(relief[nodes] @ total) / (float(count.sum()) * power)))
    return largest


def _clipped_deviation(magnitudes: Array) -> float:
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
