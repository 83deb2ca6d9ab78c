"""Initial planar domains of patches: least squares conformal maps, harmonic maps and Tutte's embedding (paper, 3.2.1).

All patches are solved together as one block-diagonal sparse system.  A patch whose map turns a triangle over, or
squeezes one to nothing, gets the next method: conformal, then harmonic with a circle as border, then Tutte's, which
cannot fail on a disk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..arrays import Array, Booleans, Indices, largest_of, length_of, rows_at, runs_of_rows, sum_of
from ..mesh.triangle_mesh import TriangleMesh
from ..native import maps as native
from ..native.library import reason_against
from ..processes.each import Each, all_done
from .linear_systems import solve_held
from .loops import Loops, boundary_loops
from .patches import Patches

METHODS = ("lscm", "harmonic", "tutte")
"""The methods, in the order in which one stands in for the one before it."""

_CHUNK = 20_000  # vertices factorised together; bounds the memory
_SMALLEST_RATIO = 1e-3  # of domain area to surface area, where the whole patch has 1
_UNUSABLE_RATIO = 1e-6
_SLACK = 1e-4  # of the mean edge: least excess of two sides of a triangle over the third


@dataclass(frozen=True, eq=False)
class InitialDomains:
    """Planar domains of all patches.

    Attributes
    ----------
    points
        Domain of each patch vertex, (M, 2), in scene units: each patch is centred and has the area of its surface.
    method
        Number in `METHODS` of the method that each patch ended with, (K,).
    """

    points: Array
    method: Indices


def initial_domains(mesh: TriangleMesh, patches: Patches, method: str = "lscm", each: Each = map) -> Array:
    """Return the domain of each patch vertex, (M, 2); see `solve_initial_domains`."""
    return solve_initial_domains(mesh, patches, method, each).points


def solve_initial_domains(
    mesh: TriangleMesh, patches: Patches, method: str = "lscm", each: Each = map
) -> InitialDomains:
    """Map each patch to the plane without turning a triangle over.

    Parameters
    ----------
    method
        "lscm": least squares conformal map with a free border (Levy et al. 2002); "harmonic": discrete harmonic map
        with a circle as border, arc by the length of its edges; "tutte": Tutte's embedding in the same circle.

    Returns
    -------
    Domains of positive orientation, each centred and scaled to the total area of its triangles in space.
    """
    points = np.zeros((len(patches.vertices), 2))
    chosen = np.zeros(len(patches), dtype=np.int64)

    def solve(run: tuple[int, int]) -> None:
        rows = slice(*patches.vertex_offsets[list(run)])
        part = patches.select(np.arange(*run))
        points[rows], chosen[slice(*run)] = _solve_chunk(mesh, part, METHODS.index(method))

    all_done(each, solve, runs_of_rows(patches.vertex_offsets, _CHUNK))
    return InitialDomains(points, chosen)


@dataclass(frozen=True, eq=False)
class DomainQuality:
    """How evenly the domains hold their surfaces.

    Attributes
    ----------
    squeeze
        The 2nd percentile of the triangles' area ratio (domain / surface) against the median, (K,): 1 for an isometric
        domain, small where a finger of the surface lies in a narrow spot of the domain.  Below 0.1 a patch should be
        split.
    unusable
        Domains with a triangle of almost no area, (K,).  Every method squeezes the tip of a long thin finger to
        almost nothing in the domain of the plane that it stands on.  Such a patch has to be split.
    """

    squeeze: Array
    unusable: Booleans


def domain_quality(mesh: TriangleMesh, patches: Patches, domains: Array, each: Each = map) -> DomainQuality:
    """Tell how evenly each domain, (M, 2), holds its surface."""
    squeeze, unusable = np.zeros(len(patches)), np.zeros(len(patches), dtype=bool)

    def tell(run: tuple[int, int]) -> None:
        low, high = run
        part = patches.select(np.arange(low, high))
        rows = slice(patches.vertex_offsets[low], patches.vertex_offsets[high])
        ratio = np.maximum(_area_ratios(_Geometry.of(mesh, part), part, domains[rows]), 0.0)
        # One sort for all patches: the number of the patch before the point, the ratio squeezed into [0, 1) behind it.
        ranked = np.sort(part.triangle_patch + ratio / (1.0 + ratio)) - part.triangle_patch
        first, sizes = part.triangle_offsets[:-1], np.diff(part.triangle_offsets)
        worst = ranked[first + (0.02 * (sizes - 1)).astype(np.int64)]
        median = ranked[first + (sizes - 1) // 2]
        worst, median = worst / (1.0 - worst), median / (1.0 - median)
        np.divide(worst, median, out=squeeze[low:high], where=median > 0)
        unusable[low:high] = ranked[first] < _UNUSABLE_RATIO

    all_done(each, tell, runs_of_rows(patches.vertex_offsets, _CHUNK))
    return DomainQuality(squeeze, unusable)


def _solve_chunk(mesh: TriangleMesh, patches: Patches, method: int) -> tuple[Array, Indices]:
    geometry = _Geometry.of(mesh, patches)
    points = np.zeros((len(patches.vertices), 2))
    chosen = np.full(len(patches), method, dtype=np.int64)
    best = np.full(len(patches), -np.inf)
    pending = np.arange(len(patches))
    for number in range(method, len(METHODS)):
        all_of_them = len(pending) == len(patches)
        part = patches if all_of_them else patches.select(pending)
        part_geometry = geometry if all_of_them else geometry.select(patches, pending)
        rows = np.flatnonzero(np.isin(patches.vertex_patch, pending))
        found = _scaled(part, part_geometry, _SOLVERS[METHODS[number]](part, part_geometry))
        worst = np.minimum.reduceat(_area_ratios(part_geometry, part, found), part.triangle_offsets[:-1])
        better = worst > best[pending]
        keep = np.repeat(better, np.diff(part.vertex_offsets))
        points[rows[keep]] = found[keep]
        best[pending[better]], chosen[pending[better]] = worst[better], number
        pending = pending[best[pending] < _SMALLEST_RATIO]
        if len(pending) == 0:
            break
    return points, chosen


@dataclass(frozen=True, eq=False)
class _Geometry:
    """Positions (M, 3) of patch vertices; edge lengths (S, 3), opposite to corner i, and areas (S,) of triangles.

    Lengths are those of the surface, but for patches with needles or collapsed triangles: there every edge is made
    longer by the little that gives each triangle an area (intrinsic mollification, Sharp and Crane 2020).
    """

    positions: Array
    lengths: Array
    areas: Array

    @classmethod
    def of(cls, mesh: TriangleMesh, patches: Patches) -> _Geometry:
        positions = rows_at(mesh.vertices, patches.vertices)
        a, b, c = (rows_at(positions, corner) for corner in patches.block_triangles.T)
        lengths = np.stack([length_of(b - c), length_of(c - a), length_of(a - b)], axis=1)
        sizes = np.diff(patches.triangle_offsets)
        mean = np.add.reduceat(sum_of(lengths), patches.triangle_offsets[:-1]) / (3 * sizes)
        slack = np.maximum(_SLACK * mean, 1e-12 * mesh.longest_side)
        lack = np.repeat(slack, sizes) - (sum_of(lengths) - 2 * largest_of(lengths))
        longer = np.maximum(np.maximum.reduceat(lack, patches.triangle_offsets[:-1]), 0.0)
        lengths = lengths + np.repeat(longer, sizes)[:, None]
        return cls(positions, lengths, _heron(lengths))

    def select(self, patches: Patches, chosen: Indices) -> _Geometry:
        in_vertices = np.isin(patches.vertex_patch, chosen)
        in_triangles = np.isin(patches.triangle_patch, chosen)
        return _Geometry(self.positions[in_vertices], self.lengths[in_triangles], self.areas[in_triangles])


def _heron(lengths: Array) -> Array:
    """Return triangle areas from edge lengths, in Kahan's stable form."""
    one, two, three = lengths.T
    low, high = np.minimum(one, two), np.maximum(one, two)
    c, b, a = np.minimum(low, three), np.maximum(low, np.minimum(high, three)), np.maximum(high, three)
    product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c))
    return 0.25 * np.sqrt(np.maximum(product, 0.0))


def _signed_areas(points: Array, triangles: Indices) -> Array:
    a, b, c = (rows_at(points, triangles[:, i]) for i in range(3))
    one, two = b - a, c - a
    areas: Array = 0.5 * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    return areas


def _area_ratios(geometry: _Geometry, patches: Patches, domains: Array) -> Array:
    return _signed_areas(domains, patches.block_triangles) / geometry.areas


def _scaled(patches: Patches, geometry: _Geometry, points: Array) -> Array:
    """Centre each domain and give it the area of its surface."""
    sizes = np.diff(patches.vertex_offsets)
    first, first_triangle = patches.vertex_offsets[:-1], patches.triangle_offsets[:-1]
    centred = points - np.repeat(np.add.reduceat(points, first) / sizes[:, None], sizes, axis=0)
    areas = np.add.reduceat(np.abs(_signed_areas(centred, patches.block_triangles)), first_triangle)
    wanted = np.add.reduceat(geometry.areas, first_triangle)
    scale = np.sqrt(np.divide(wanted, areas, out=np.zeros_like(areas), where=areas > 0))
    return centred * np.repeat(scale, sizes)[:, None]


def _cotangents(geometry: _Geometry) -> Array:
    """Return the cotangent of each triangle's angles, (S, 3)."""
    squared = geometry.lengths**2
    return (squared.sum(axis=1, keepdims=True) - 2 * squared) / (4 * geometry.areas[:, None])


def _laplacian(triangles: Indices, weights: Array, count: int) -> coo_array:
    """Return the Laplacian with `weights` (S, 3) on the edges opposite to the triangles' corners."""
    one, two = triangles[:, [1, 2, 0]].reshape(-1), triangles[:, [2, 0, 1]].reshape(-1)
    weight = weights.reshape(-1)
    rows = np.concatenate((one, two, one, two))
    columns = np.concatenate((two, one, one, two))
    return coo_array((np.concatenate((-weight, -weight, weight, weight)), (rows, columns)), shape=(count, count))


def _solve_lscm(patches: Patches, geometry: _Geometry) -> Array:
    """Least squares conformal maps by the compiled kernel, and by NumPy where that cannot solve a system."""
    if reason_against() is not None:
        return _conformal_maps(patches, geometry)
    rings = patches.vertex_offsets, geometry.positions, patches.triangle_offsets, patches.triangles
    points, solved = native.conformal_maps(native.Disks(*rings, geometry.lengths, geometry.areas))
    others = np.flatnonzero(~solved)
    if len(others):
        rows = np.isin(patches.vertex_patch, others)
        points[rows] = _conformal_maps(patches.select(others), geometry.select(patches, others))
    return points


def _conformal_maps(patches: Patches, geometry: _Geometry) -> Array:
    """Least squares conformal maps, with two vertices of the border held.

    The energy is that of Dirichlet less the area of the map, which in complex numbers is one Hermitian form in half
    the unknowns.
    """
    triangles = patches.block_triangles
    count = len(patches.vertices)
    outer, holes = boundary_loops(patches)
    start = np.concatenate((outer.vertices, holes.vertices))
    end = np.concatenate((outer.following, holes.following))
    laplacian = _laplacian(triangles, 0.5 * _cotangents(geometry), count)
    turn = np.full(len(start), 0.5j)
    rows, columns = laplacian.coords
    energy = coo_array(
        (
            np.concatenate((laplacian.data.astype(np.complex128), turn, -turn)),
            (np.concatenate((rows, start, end)), np.concatenate((columns, end, start))),
        ),
        shape=(count, count),
    ).tocsr()
    first, second = _far_apart(outer, geometry.positions)
    values = np.zeros(count, dtype=np.complex128)
    values[second] = np.linalg.norm(geometry.positions[second] - geometry.positions[first], axis=1)
    # Two border vertices at the same place still need different images.
    values[second[values[second] == 0]] = 1.0
    held = np.zeros(count, dtype=bool)
    held[first] = held[second] = True
    solved = solve_held(csr_array(energy), held, values)
    return np.stack((solved.real, solved.imag), axis=1)


def _solve_harmonic(patches: Patches, geometry: _Geometry) -> Array:
    return _inside_circle(patches, geometry, 0.5 * _cotangents(geometry))


def _solve_tutte(patches: Patches, geometry: _Geometry) -> Array:
    return _inside_circle(patches, geometry, np.full((len(patches.triangles), 3), 0.5))


_SOLVERS: dict[str, Callable[[Patches, _Geometry], Array]] = {
    "lscm": _solve_lscm,
    "harmonic": _solve_harmonic,
    "tutte": _solve_tutte,
}


def _inside_circle(patches: Patches, geometry: _Geometry, weights: Array) -> Array:
    """Lay each outer boundary on a circle by the length of its edges and solve for the inside."""
    outer, holes = boundary_loops(patches)
    count = len(patches.vertices)
    laplacian = _laplacian(patches.block_triangles, weights, count + len(holes.patch))
    if len(holes.patch):
        laplacian = laplacian + _hubs(holes, count)
    values = np.zeros(laplacian.shape[0], dtype=np.complex128)
    values[outer.vertices] = np.exp(1j * _angles(outer, geometry.positions))
    held = np.zeros(len(values), dtype=bool)
    held[outer.vertices] = True
    solved = solve_held(csr_array(laplacian), held, values)[:count]
    return np.stack((solved.real, solved.imag), axis=1)


def _angles(outer: Loops, positions: Array) -> Array:
    sizes, first = np.diff(outer.offsets), outer.offsets[:-1]
    length = np.linalg.norm(positions[outer.following] - positions[outer.vertices], axis=1)
    mean = np.repeat(np.add.reduceat(length, first) / sizes, sizes)
    # A border edge of no length would make a triangle of no area.
    length = np.where(mean > 0, np.maximum(length, 1e-2 * mean), 1.0)
    total = np.repeat(np.add.reduceat(length, first), sizes)
    before = np.cumsum(length) - length
    return 2 * np.pi * (before - np.repeat(before[first], sizes)) / total


def _hubs(holes: Loops, count: int) -> coo_array:
    """Span each hole by a further vertex in its middle, so that it cannot turn inside out."""
    hub = np.repeat(count + np.arange(len(holes.patch)), np.diff(holes.offsets))
    weight = np.ones(len(hub))
    rim, next_on_rim = holes.vertices, holes.following
    rows = np.concatenate((hub, rim, hub, rim, rim, next_on_rim, rim, next_on_rim))
    columns = np.concatenate((rim, hub, hub, rim, next_on_rim, rim, rim, next_on_rim))
    data = np.concatenate((-weight, -weight, weight, weight, *(0.5 * w for w in (-weight, -weight, weight, weight))))
    total = count + len(holes.patch)
    return coo_array((data, (rows, columns)), shape=(total, total))


def _far_apart(outer: Loops, positions: Array) -> tuple[Indices, Indices]:
    """Return two border vertices of each patch that are far from each other."""
    offsets, loops = outer.offsets, outer.vertices
    sizes = np.diff(offsets)
    start = loops[offsets[:-1]]
    for_all = []
    for _ in range(2):
        distance = np.linalg.norm(positions[loops] - np.repeat(positions[start], sizes, axis=0), axis=1)
        order = np.lexsort((-distance, np.repeat(np.arange(len(sizes)), sizes)))
        farthest = loops[order[offsets[:-1]]]
        for_all.append(farthest)
        start = farthest
    first, second = for_all
    # All border vertices at one place: take the one half way round.
    return first, np.where(first == second, loops[offsets[:-1] + sizes // 2], second)
