"""Which rings around a centre are topological disks, and how the others are repaired (paper, section 4).

A ring is the set of triangles that touch the (k - 1)-ring of a vertex, one row of a boolean matrix (patches, mesh
triangles).  All rings are checked at once.  Where rings had to be less than half as large, they close around something
thin: there disks grow as strips instead (`strips`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, vstack

from ..arrays import Booleans, Indices, slices_of
from ..mesh.edges import connected_parts
from ..mesh.triangle_mesh import TriangleMesh
from ..native import disks as native
from ..native.graphs import Graph
from ..native.library import reason_against
from ..processes.each import Each
from .strips import grown_by_numpy

_LARGEST_SHARE = 0.5  # of the triangles of a closed component that one patch may hold
_LARGEST_GAP = 0.25  # filled gap, as a share of the patch's triangles
_MOST_TRIANGLES = 20_000  # a larger ring shrinks, unless a single vertex has as many
_CHUNK = 1024  # rings handled together; bounds the memory
_PARTS, _LEAST = 8, 500  # parts that threads share, and the smallest number of rings in one


@dataclass(frozen=True, eq=False)
class Disks:
    """K disks.

    Attributes
    ----------
    centres
        Nodes, (K,).
    rings
        Radii in edges, (K,).
    members
        Which triangles each has, (K, T).
    grown
        Which are not whole rings, but grew within them, (K,).
    """

    centres: Indices
    rings: Indices
    members: csr_array
    grown: Booleans

    @classmethod
    def joined(cls, parts: list[Disks], mesh: TriangleMesh) -> Disks:
        """Return several sets of disks as one."""
        none = np.zeros(0, dtype=np.int64)
        empty = csr_array((0, len(mesh.triangles)), dtype=bool)
        return cls(
            np.concatenate([none, *(part.centres for part in parts)]),
            np.concatenate([none, *(part.rings for part in parts)]),
            csr_array(vstack([empty, *(part.members for part in parts)], format="csr")),
            np.concatenate([none.astype(bool), *(part.grown for part in parts)]),
        )

    def take(self, which: Indices) -> Disks:
        """Return some of the disks."""
        return Disks(self.centres[which], self.rings[which], csr_array(self.members[which]), self.grown[which])


def largest_disks(mesh: TriangleMesh, centres: Indices, ring: int, wanted: Booleans, each: Each = map) -> Disks:
    """Return for each centre the largest ring up to `ring` that is, or can be filled to be, a disk.

    Where that would be less than half of `ring`, a disk grows within the whole ring, at first over nodes that are
    `wanted`, (N,).  A centre around which not even the smallest ring is a disk has none.
    """
    limits = _Limits.of(mesh, ring)
    parts: list[Disks] = []
    owners: list[Indices] = []
    pending = np.arange(len(centres))
    for radius in range(ring, ring // 2, -1):
        rows, members = _disks_of_radius(mesh, limits, centres[pending], radius, each)
        parts.append(Disks(centres[pending[rows]], np.full(len(rows), radius), members, np.zeros(len(rows), bool)))
        owners.append(pending[rows])
        pending = np.delete(pending, rows)
        if len(pending) == 0:
            break
    else:
        rows, disks = _grown(mesh, centres[pending], ring, limits.triangles[mesh.component[centres[pending]]], wanted)
        parts.append(disks)
        owners.append(pending[rows])
    order = np.argsort(np.concatenate([np.zeros(0, dtype=np.int64), *owners]), kind="stable")
    return Disks.joined(parts, mesh).take(order)


def _grown(mesh: TriangleMesh, centres: Indices, ring: int, most: Indices, wanted: Booleans) -> tuple[Indices, Disks]:
    """Grow a disk around each centre; returns which centres have one, as positions, and the disks."""
    if reason_against() is None:
        (offsets, triangles), radii = _native(mesh).grown(centres, ring, most, wanted)
    else:
        offsets, triangles, radii = grown_by_numpy(mesh, centres, ring, most, wanted)
    shape = len(centres), len(mesh.triangles)
    members = csr_array((np.ones(len(triangles), dtype=bool), triangles, offsets), shape=shape)
    found = np.flatnonzero(radii)
    return found, Disks(centres[found], radii[found], csr_array(members[found]), np.ones(len(found), dtype=bool))


def ring_triangles(mesh: TriangleMesh, centres: Indices, ring: int) -> csr_array:
    """Return the triangles that touch the (ring - 1)-ring of each centre as a (K, T) boolean matrix."""
    if reason_against() is None:
        found = _native(mesh).rings(centres, ring)
        shape = len(centres), len(mesh.triangles)
        return csr_array((np.ones(len(found.triangles), dtype=bool), found.triangles, found.offsets), shape=shape)
    ball = csr_array(
        (np.ones(len(centres), dtype=bool), centres, np.arange(len(centres) + 1)),
        shape=(len(centres), mesh.node_count),
    )
    for _ in range(ring - 1):
        ball = ball @ mesh.reach
    members = csr_array(ball @ mesh.incidence)
    members.sort_indices()
    return members


def held_nodes(mesh: TriangleMesh, members: csr_array) -> Booleans:
    """Return the nodes that some patch contains with all of their triangles, (N,)."""
    if reason_against() is None:
        return _native(mesh).held(as_members(members))
    held = np.zeros(mesh.node_count, dtype=bool)
    fan_sizes, nodes = np.diff(mesh.fan_offsets), _countable(mesh.incidence.T)
    for rows in row_chunks(members):
        counts = _count(rows, nodes)
        held[counts.indices[counts.data == fan_sizes[counts.indices]]] = True
    return held


def as_members(members: csr_array) -> native.Members:
    """Return the rows of a matrix as the compiled kernel takes them."""
    return native.Members(members.indptr.astype(np.int64), members.indices.astype(np.int64))


def _native(mesh: TriangleMesh) -> native.Surface:
    """Return a mesh as the compiled kernel takes it, without holes."""
    return native.Surface(
        Graph(mesh.adjacency.indptr, mesh.adjacency.indices),
        mesh.fan_offsets,
        mesh.fan_triangles,
        mesh.nodes,
        mesh.triangle_edges,
        mesh.edges,
        np.zeros(0, dtype=np.int64),
        np.zeros(0, dtype=np.int64),
        mesh.twin_of_edge,
    )


def numbered_nodes(mesh: TriangleMesh, members: csr_array) -> native.Numbered:
    """Number the nodes of each patch, by the compiled kernel."""
    return _native(mesh).numbered(as_members(members))


def _countable(what: csr_array) -> csr_array:
    """Return a boolean matrix as `_count` takes it: converted once, not for every chunk of rows."""
    return csr_array(what, dtype=np.int32)


def _count(members: csr_array, what: csr_array) -> csr_array:
    """Return how many triangles of each patch lie at each node or edge, of which `what` (T, n) tells."""
    return csr_array(members.astype(np.int32) @ what)


def row_chunks(members: csr_array) -> list[csr_array]:
    """Split the rows of a matrix into parts of bounded size, at least one."""
    if members.shape[0] <= _CHUNK:
        return [members]
    return [csr_array(members[low : low + _CHUNK]) for low in range(0, members.shape[0], _CHUNK)]


@dataclass(frozen=True, eq=False)
class _Limits:
    """What a patch may hold.

    `triangles` (C,): of each component at most; `hole` (E,) and `hole_sides` (H,): the hole of the mesh that an edge
    lies on, -1 on most, and the number of edges around each.  Holes of few edges count as filled.
    """

    triangles: Indices
    hole: Indices
    hole_sides: Indices

    @classmethod
    def of(cls, mesh: TriangleMesh, ring: int) -> _Limits:
        component = mesh.component[mesh.nodes[~mesh.collapsed, 0]]
        total = np.bincount(component, minlength=mesh.component_count)
        loop, sides = mesh.border_loops
        on_border = np.flatnonzero(loop >= 0)
        loop_component = np.zeros(len(sides), dtype=np.int64)
        loop_component[loop[on_border]] = mesh.component[mesh.edges[on_border, 0]]
        # A disk with n border edges can have fewer than n^2 triangles; the surface around a hole has more.
        small = (sides <= 2 * ring) & (total[loop_component] > sides**2)
        is_open = np.zeros(mesh.component_count, dtype=bool)
        is_open[loop_component[~small]] = True
        most = np.where(is_open, total, (_LARGEST_SHARE * total).astype(np.int64))
        largest_fan = int(np.diff(mesh.fan_offsets).max())
        hole = loop.copy()
        hole[on_border[~small[loop[on_border]]]] = -1
        return cls(np.minimum(most, max(_MOST_TRIANGLES, 2 * largest_fan)), hole, sides)


def rows_for_threads(count: int) -> list[slice]:
    """Split `count` rings into parts for threads; by the compiled kernel, each part takes time for the whole mesh."""
    return list(slices_of(count, max(_LEAST, -(-count // _PARTS))))


def _disks_of_radius(
    mesh: TriangleMesh, limits: _Limits, centres: Indices, radius: int, each: Each
) -> tuple[Indices, csr_array]:
    """Return the centres whose ring of this radius is a disk, as positions, and the rings, filled where need be."""
    parts = rows_for_threads(len(centres))
    if len(parts) < 2:
        return _some_disks(mesh, limits, centres, radius)
    _ = mesh.twin_of_edge  # computed before several threads ask for it
    found = list(each(lambda own: _some_disks(mesh, limits, centres[own], radius), parts))
    rows = np.concatenate([own.start + rows for own, (rows, _) in zip(parts, found, strict=True)])
    return rows, csr_array(vstack([members for _, members in found], format="csr"))


def _some_disks(mesh: TriangleMesh, limits: _Limits, centres: Indices, radius: int) -> tuple[Indices, csr_array]:
    """The same of some centres."""
    most = limits.triangles[mesh.component[centres]]
    if radius == 1:
        most = np.full(len(centres), len(mesh.triangles))
    members = ring_triangles(mesh, centres, radius)
    fits = np.diff(members.indptr) <= most
    good = fits.copy()
    good[fits] = _are_disks(mesh, limits, csr_array(members[fits]))
    gappy = np.flatnonzero(fits & ~good)
    if len(gappy) == 0:
        return np.flatnonzero(good), csr_array(members[good])
    filled = _fill_gaps(mesh, csr_array(members[gappy]), centres[gappy], radius)
    mended = (np.diff(filled.indptr) <= most[gappy]) & _are_disks(mesh, limits, filled)
    rows = np.concatenate((np.flatnonzero(good), gappy[mended]))
    return rows, csr_array(vstack([members[good], filled[mended]], format="csr"))


def _are_disks(mesh: TriangleMesh, limits: _Limits, members: csr_array) -> Booleans:
    """Tell which patches are disks: Euler characteristic 1 and a boundary that never touches itself.

    Patches are connected, and around each node there is one fan.  So a boundary with two sides at each of its vertices
    makes a patch a surface with boundary, and of these only the disk has Euler characteristic 1.
    """
    if reason_against() is None:
        return replace(_native(mesh), hole=limits.hole, hole_sides=limits.hole_sides).are_disks(as_members(members))
    what = _countable(mesh.incidence.T), _countable(mesh.triangle_edge_incidence)
    return np.concatenate(
        [np.zeros(0, dtype=bool), *(_are_disks_in_chunk(mesh, limits, m, *what) for m in row_chunks(members))]
    )


def _are_disks_in_chunk(
    mesh: TriangleMesh, limits: _Limits, members: csr_array, of_nodes: csr_array, of_edges: csr_array
) -> Booleans:
    count = members.shape[0]
    vertices, edges = _count(members, of_nodes), _count(members, of_edges)
    row = np.repeat(np.arange(count), np.diff(edges.indptr))
    on_border = edges.data == 1
    border_row, border_edge = row[on_border], edges.indices[on_border]
    ends = border_row[:, None] * np.int64(mesh.node_count) + mesh.edges[border_edge]
    end, sides = np.unique(ends, return_counts=True)
    holes, in_holes, longest_hole = _enclosed_holes(limits, count, border_row, border_edge)
    # A loop around a small hole in a flat surface is longer by six for each ring; the end of a tube is not such a hole.
    shortest = np.where(holes > 0, 2 * longest_hole + 6, 3)
    bad = np.bincount(border_row, minlength=count) - in_holes < shortest
    bad[end[sides > 2] // mesh.node_count] = True
    bad[_rows_with_twin_edges(mesh, row, edges.indices)] = True
    vertex_count, edge_count, triangle_count = (np.diff(matrix.indptr) for matrix in (vertices, edges, members))
    good: Booleans = (vertex_count - edge_count + triangle_count + holes == 1) & ~bad
    return good


def _enclosed_holes(limits: _Limits, count: int, row: Indices, edge: Indices) -> tuple[Indices, Indices, Indices]:
    """Return, for each of `count` patches, its whole holes, the number of their edges, and that of the longest."""
    on_hole = limits.hole[edge] >= 0
    width = np.int64(max(len(limits.hole_sides), 1))
    keys, found = np.unique(row[on_hole] * width + limits.hole[edge[on_hole]], return_counts=True)
    patch, hole = np.divmod(keys, width)
    whole = found == limits.hole_sides[hole]
    patch, sides = patch[whole], found[whole]
    longest = np.zeros(count, dtype=np.int64)
    np.maximum.at(longest, patch, sides)
    total = np.bincount(patch, weights=sides, minlength=count).astype(np.int64)
    return np.bincount(patch, minlength=count), total, longest


def _rows_with_twin_edges(mesh: TriangleMesh, row: Indices, edge: Indices) -> Indices:
    """Return the patches that have two edges between the same nodes: no straight-edged domain could hold them."""
    twin = mesh.twin_of_edge[edge] >= 0
    key = np.sort(row[twin] * np.int64(len(mesh.edges)) + mesh.twin_of_edge[edge[twin]])
    return key[1:][key[1:] == key[:-1]] // len(mesh.edges)


def _fill_gaps(mesh: TriangleMesh, members: csr_array, centres: Indices, ring: int) -> csr_array:
    """Add to each patch the small regions that it encloses."""
    around = ring_triangles(mesh, centres, 2 * ring)
    outside = _difference(around, members)
    row = np.repeat(np.arange(outside.shape[0]), np.diff(outside.indptr))
    triangle = outside.indices.astype(np.int64)
    if len(row) == 0:
        return members
    region, leaks = _regions(mesh, around, outside, row, triangle)
    sizes = np.bincount(region)
    patch_of_region = np.zeros(len(sizes), dtype=np.int64)
    patch_of_region[region] = row
    small = sizes <= np.maximum(_LARGEST_GAP * np.diff(members.indptr), 1)[patch_of_region]
    add = (small & ~leaks)[region]
    extra = csr_array((np.ones(int(add.sum()), dtype=bool), (row[add], triangle[add])), shape=members.shape)
    filled = csr_array(members + extra)
    filled.sort_indices()
    return filled


def _difference(one: csr_array, two: csr_array) -> csr_array:
    """Return the entries of a boolean matrix that another one does not have."""
    difference = csr_array(one.astype(np.int8) - one.multiply(two).astype(np.int8))
    difference.eliminate_zeros()
    difference.sort_indices()
    return difference


def _regions(
    mesh: TriangleMesh, around: csr_array, outside: csr_array, row: Indices, triangle: Indices
) -> tuple[Indices, Booleans]:
    """Number the edge-connected regions of `outside`, and tell which of them go on beyond `around`."""
    width = np.int64(outside.shape[1])
    key = row * width + triangle
    both = mesh.edge_triangles[mesh.triangle_edges[triangle]]
    at_border = both[:, :, 1] < 0
    neighbour = both.sum(axis=2) - triangle[:, None]
    wanted = row[:, None] * width + neighbour
    position = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
    connected = (key[position] == wanted) & ~at_border
    own = np.broadcast_to(np.arange(len(key))[:, None], connected.shape)
    count, region = connected_parts(own[connected], position[connected], len(key))
    around_row = np.repeat(np.arange(around.shape[0]), np.diff(around.indptr))
    known = np.isin(wanted, around_row * width + around.indices)
    leaks = np.zeros(count, dtype=bool)
    leaks[region[(~known & ~at_border).any(axis=1)]] = True
    return region, leaks
