"""Patches: overlapping k-rings that are topological disks (paper, section 4).

A patch consists of all triangles that touch the (k - 1)-ring of its centre, so its vertices are the k-ring.  One that
is no disk is repaired: enclosed gaps are filled, then the ring is made smaller; what no patch holds any more is covered
again by smaller rings.  Everything is done for all patches at once; a patch never gets a Python loop of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components

from .cover import build_cover
from .mesh import TriangleMesh, solve_winding, triangle_areas

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

_LARGEST_SHARE = 0.5  # of the triangles of a component, unless the patch is the whole of an open one
_LARGEST_GAP = 0.25  # filled gap, as a share of the patch's triangles
_CROWDED = 8  # a ring is made smaller when it holds this many times the vertices of a regular one
_CHUNK = 1024  # patches assembled together; bounds the memory


@dataclass(frozen=True, eq=False)
class Patches:
    """K patches in ragged arrays: patch k owns `vertices[vertex_offsets[k]:vertex_offsets[k + 1]]` and so on.

    Attributes
    ----------
    centres
        Mesh vertex at the centre of each patch, (K,).
    rings
        Radius of each patch in edges, (K,).
    vertex_offsets, vertices
        Mesh vertices of the patches, (K + 1,) and (M,).  A vertex of a cut may occur twice in a patch.
    nodes
        The same as nodes of the cut mesh, (M,); no node occurs twice in a patch.
    triangle_offsets, triangles
        Triangles as local vertex numbers of their patch, (K + 1,) and (S, 3), with one orientation in each patch.
    mesh_triangles
        Mesh triangle of each of them, (S,).
    rim_distance
        Edges to the rim, (M,): 0 on the rim, that is at vertices with a triangle outside of the patch, and at
        vertices that are passed through.  An open border of the mesh is no rim.  A patch without a rim has a constant.
    passed_through
        Vertices that no patch holds off its rim, (V,).
    """

    centres: Integers
    rings: Integers
    vertex_offsets: Integers
    vertices: Integers
    nodes: Integers
    triangle_offsets: Integers
    triangles: Integers
    mesh_triangles: Integers
    rim_distance: Integers
    passed_through: Booleans

    def __len__(self) -> int:
        return len(self.centres)

    @property
    def vertex_patch(self) -> Integers:
        """Patch of each entry of `vertices`, (M,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.vertex_offsets))

    @property
    def triangle_patch(self) -> Integers:
        """Patch of each entry of `triangles`, (S,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.triangle_offsets))

    @property
    def block_triangles(self) -> Integers:
        """Triangles as positions in `vertices`, (S, 3): all patches as one mesh of separate pieces."""
        return self.triangles + np.repeat(self.vertex_offsets[:-1], np.diff(self.triangle_offsets))[:, None]

    def select(self, which: Integers | Booleans) -> Patches:
        """Return some of the patches, in the order given; `passed_through` stays as it is."""
        chosen = np.arange(len(self))[which]
        vertex_rows, vertex_offsets = _rows_of(self.vertex_offsets, chosen)
        triangle_rows, triangle_offsets = _rows_of(self.triangle_offsets, chosen)
        return Patches(
            centres=self.centres[chosen],
            rings=self.rings[chosen],
            vertex_offsets=vertex_offsets,
            vertices=self.vertices[vertex_rows],
            nodes=self.nodes[vertex_rows],
            triangle_offsets=triangle_offsets,
            triangles=self.triangles[triangle_rows],
            mesh_triangles=self.mesh_triangles[triangle_rows],
            rim_distance=self.rim_distance[vertex_rows],
            passed_through=self.passed_through,
        )


def build_patches(mesh: TriangleMesh, centres: Integers, ring: int) -> Patches:
    """Build the patches around the centres of a cover, each a disk.

    Every vertex that is not passed through has a positive rim distance in at least one patch; where repairs made
    patches smaller, that takes more of them than there are centres.

    Parameters
    ----------
    centres
        Nodes that `build_cover` chose for this ring, (K,).
    ring
        Largest radius of a patch in edges.
    """
    wanted = ~mesh.passed_through[mesh.node_vertex]
    found = _cover_with_disks(mesh, centres, ring, wanted)
    return _assemble(mesh, found, _unheld(mesh, found))


def refine_patches(
    mesh: TriangleMesh, patches: Patches, which: Integers | Booleans, ring: int
) -> tuple[Patches, Booleans]:
    """Replace some patches by ones of smaller rings that cover the same vertices.

    Vertices that a kept patch holds well inside need no new one.

    Parameters
    ----------
    which
        The patches to be replaced: their numbers, or (K,) booleans.
    ring
        Largest radius of the new patches, in edges.

    Returns
    -------
    The patches, kept ones first and in their order, and which of them are new.
    """
    replaced = np.zeros(len(patches), dtype=bool)
    replaced[which] = True
    kept = patches.select(~replaced)
    depth, old_depth = (_deepest(mesh, part) for part in (kept, patches.select(replaced)))
    wanted = (old_depth > 0) & (depth < np.minimum(old_depth, max(ring // 2, 1)))
    found = _cover_with_disks(mesh, build_cover(mesh, ring, wanted), ring, wanted)
    unheld = patches.passed_through | _unheld(mesh, found, depth > 0)
    new = _assemble(mesh, found, unheld)
    return _concatenate(kept, new, unheld), np.arange(len(kept) + len(new)) >= len(kept)


def boundary_loops(patches: Patches) -> tuple[Integers, Integers]:
    """Return the boundary of each patch in order.

    Returns
    -------
    Offsets, (K + 1,), and the vertices along each boundary as positions in `patches.vertices`, in the direction of the
    patch's orientation, starting with the lowest.
    """
    triangles = patches.block_triangles
    following = np.full(len(patches.vertices), -1, dtype=np.int64)
    start, end = _boundary_sides(triangles, len(patches.vertices))
    following[start] = end
    on_loop = np.flatnonzero(following >= 0)
    position = np.full(len(patches.vertices), -1, dtype=np.int64)
    position[on_loop] = np.arange(len(on_loop))
    patch = patches.vertex_patch[on_loop]
    sizes = np.bincount(patch, minlength=len(patches))
    offsets = np.concatenate(([0], np.cumsum(sizes)))
    order = _rank_in_cycle(position[following[on_loop]], offsets[patch])
    loops = np.empty(len(on_loop), dtype=np.int64)
    loops[offsets[patch] + order] = on_loop
    return offsets, loops


def _rank_in_cycle(following: Integers, first: Integers) -> Integers:
    """Return how many steps each element is behind the first of its cycle, by doubling the step."""
    count = len(following)
    preceding = np.empty(count, dtype=np.int64)
    preceding[following] = np.arange(count)
    own = np.arange(count)
    jump = np.where(own == first, own, preceding)
    rank = (own != first).astype(np.int64)
    while True:
        further = rank + rank[jump]
        if np.array_equal(further, rank):
            return rank
        rank, jump = further, jump[jump]


def _boundary_sides(triangles: Integers, vertex_count: int) -> tuple[Integers, Integers]:
    """Return start and end of the triangle sides that have no opposite side."""
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    ones = np.ones(len(start), dtype=np.int8)
    sides = csr_array((ones, (start, end)), shape=(vertex_count, vertex_count))
    alone = (sides - sides.T).tocoo()
    kept = alone.data > 0
    rows, columns = alone.coords
    return rows[kept].astype(np.int64), columns[kept].astype(np.int64)


# ------------------------------------------------------------------------------------------------------ finding disks


@dataclass(frozen=True, eq=False)
class _Found:
    """Patches as sets of mesh triangles: centres as nodes, and a row of (K, T) `members` for each."""

    centres: Integers
    rings: Integers
    members: csr_array


def _cover_with_disks(mesh: TriangleMesh, centres: Integers, ring: int, wanted: Booleans) -> _Found:
    """Cover the wanted nodes; where patches had to be made smaller, cover what they lost by smaller ones."""
    parts = []
    limit = ring
    remaining = wanted
    while len(centres):
        found = _largest_disks(mesh, centres, limit)
        parts.append(found)
        remaining = remaining & ~_held(mesh, found.members)
        if limit == 1:
            break
        limit = min(limit - 1, int(found.rings.max(initial=1)))
        centres = build_cover(mesh, limit, remaining)
    if not parts:
        return _Found(np.zeros(0, np.int64), np.zeros(0, np.int64), csr_array((0, len(mesh.triangles)), dtype=bool))
    members = csr_array(vstack([part.members for part in parts], format="csr"))
    return _Found(
        np.concatenate([part.centres for part in parts]), np.concatenate([part.rings for part in parts]), members
    )


def _largest_disks(mesh: TriangleMesh, centres: Integers, ring: int) -> _Found:
    """Return for each centre the largest ring up to `ring` that is, or can be filled to be, a disk."""
    component_triangles = np.bincount(mesh.component[mesh.nodes[~mesh.collapsed, 0]], minlength=mesh.component_count)
    open_component = np.zeros(mesh.component_count, dtype=bool)
    open_component[mesh.component[mesh.border]] = True
    pending = np.arange(len(centres))
    rings = np.zeros(len(centres), dtype=np.int64)
    rows: list[csr_array] = []
    owners: list[Integers] = []
    for radius in range(ring, 0, -1):
        part = mesh.component[centres[pending]]
        total, is_open = component_triangles[part], open_component[part]
        members = ring_triangles(mesh, centres[pending], radius)
        good = _acceptable(mesh, members, radius, total, is_open)
        if not good.all():
            bad = np.flatnonzero(~good)
            filled = _fill_gaps(mesh, csr_array(members[bad]), centres[pending[bad]], radius)
            mended = _acceptable(mesh, filled, radius, total[bad], is_open[bad])
            rows.append(csr_array(filled[np.flatnonzero(mended)]))
            owners.append(pending[bad[mended]])
            rings[pending[bad[mended]]] = radius
            rows.append(csr_array(members[np.flatnonzero(good)]))
            owners.append(pending[good])
            rings[pending[good]] = radius
            pending = pending[bad[~mended]]
        else:
            rows.append(members)
            owners.append(pending)
            rings[pending] = radius
            pending = pending[:0]
        if len(pending) == 0:
            break
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    chosen = owner[order]
    return _Found(centres[chosen], rings[chosen], csr_array(csr_array(vstack(rows, format="csr"))[order]))


def ring_triangles(mesh: TriangleMesh, centres: Integers, ring: int) -> csr_array:
    """Return the triangles that touch the (ring - 1)-ring of each centre as a (K, T) boolean matrix."""
    ball = csr_array(
        (np.ones(len(centres), dtype=bool), centres, np.arange(len(centres) + 1)),
        shape=(len(centres), mesh.node_count),
    )
    for _ in range(ring - 1):
        ball = ball @ mesh.reach
    members = csr_array(ball @ mesh.incidence)
    members.sort_indices()
    return members


def _held(mesh: TriangleMesh, members: csr_array) -> Booleans:
    """Return the nodes that some patch contains with all of their triangles, (N,)."""
    held = np.zeros(mesh.node_count, dtype=bool)
    fan_sizes = np.diff(mesh.fan_offsets)
    for rows in _chunks(members):
        counts = _count(rows, mesh.incidence.T)
        held[counts.indices[counts.data == fan_sizes[counts.indices]]] = True
    return held


def _count(members: csr_array, what: csr_array) -> csr_array:
    """Return how many triangles of each patch lie at each node or edge, of which `what` (T, n) tells."""
    return csr_array(members.astype(np.int32) @ what.astype(np.int32))


def _unheld(mesh: TriangleMesh, found: _Found, held_already: Booleans | None = None) -> Booleans:
    held = _held(mesh, found.members)
    if held_already is not None:
        held |= held_already
    unheld = mesh.passed_through.copy()
    unheld[mesh.node_vertex[mesh.used & ~held]] = True
    return unheld


def _deepest(mesh: TriangleMesh, patches: Patches) -> Integers:
    """Return the largest rim distance of each node over the patches, (N,)."""
    deepest = np.zeros(mesh.node_count, dtype=np.int64)
    np.maximum.at(deepest, patches.nodes, patches.rim_distance)
    return deepest


@dataclass(frozen=True, eq=False)
class _Local:
    """Local vertices and sides of some patches.

    `node`, `patch`, `triangle_count`: of the M local vertices, sorted by patch and node; `corners`: (S, 3) positions
    in them; `row`: patch of each triangle; `mesh_triangle`: (S,).
    """

    node: Integers
    patch: Integers
    triangle_count: Integers
    corners: Integers
    row: Integers
    mesh_triangle: Integers
    patch_count: int

    @classmethod
    def of(cls, mesh: TriangleMesh, members: csr_array) -> _Local:
        row = np.repeat(np.arange(members.shape[0]), np.diff(members.indptr))
        triangle = members.indices.astype(np.int64)
        key = (row[:, None] * np.int64(mesh.node_count) + mesh.nodes[triangle]).reshape(-1)
        keys, corners, count = np.unique(key, return_inverse=True, return_counts=True)
        patch, node = np.divmod(keys, np.int64(mesh.node_count))
        return cls(node, patch, count, corners.reshape(-1, 3), row, triangle, members.shape[0])


def _chunks(members: csr_array) -> list[csr_array]:
    if members.shape[0] <= _CHUNK:
        return [members] if members.shape[0] else []
    return [csr_array(members[low : low + _CHUNK]) for low in range(0, members.shape[0], _CHUNK)]


def _acceptable(
    mesh: TriangleMesh, members: csr_array, ring: int, component_triangles: Integers, is_open: Booleans
) -> Booleans:
    """Tell which patches are disks and not too large; the smallest ring may be as large as it is."""
    good = np.concatenate([_are_disks(mesh, rows) for rows in _chunks(members)] or [np.zeros(0, dtype=bool)])
    if ring == 1:
        return good
    triangles = np.diff(members.indptr)
    whole = is_open & (triangles == component_triangles)
    crowded = triangles > _CROWDED * 6 * ring * ring
    return good & ((triangles <= _LARGEST_SHARE * component_triangles) | whole) & ~crowded


def _are_disks(mesh: TriangleMesh, members: csr_array) -> Booleans:
    """Tell which patches are disks: Euler characteristic 1 and a boundary that meets itself nowhere.

    Patches are connected, and around each node there is one fan.  So a boundary with two sides at each of its vertices
    makes a patch a surface with boundary, and of these only the disk has Euler characteristic 1.
    """
    vertices = _count(members, mesh.incidence.T)
    edges = _count(members, mesh.triangle_edge_incidence)
    row = np.repeat(np.arange(members.shape[0]), np.diff(edges.indptr))
    on_border = edges.data == 1
    border_row, border_edge = row[on_border], edges.indices[on_border]
    ends = border_row[:, None] * np.int64(mesh.node_count) + mesh.edges[border_edge]
    end, count = np.unique(ends, return_counts=True)
    bad = np.bincount(border_row, minlength=members.shape[0]) < 3
    bad[end[count > 2] // mesh.node_count] = True
    bad[_rows_with_twin_edges(mesh, row, edges.indices)] = True
    vertex_count, edge_count, triangle_count = (np.diff(matrix.indptr) for matrix in (vertices, edges, members))
    return (vertex_count - edge_count + triangle_count == 1) & ~bad


def _rows_with_twin_edges(mesh: TriangleMesh, row: Integers, edge: Integers) -> Integers:
    """Return the patches that have two edges between the same nodes: no straight-edged domain could hold them."""
    twin = mesh.twin_of_edge[edge] >= 0
    key = np.sort(row[twin] * np.int64(len(mesh.edges)) + mesh.twin_of_edge[edge[twin]])
    return key[1:][key[1:] == key[:-1]] // len(mesh.edges)


def _fill_gaps(mesh: TriangleMesh, members: csr_array, centres: Integers, ring: int) -> csr_array:
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
    mesh: TriangleMesh, around: csr_array, outside: csr_array, row: Integers, triangle: Integers
) -> tuple[Integers, Booleans]:
    """Number the edge-connected regions of `outside`, and tell which of them go on beyond `around`."""
    width = np.int64(outside.shape[1])
    key = row * width + triangle
    neighbour = mesh.edge_triangles[mesh.triangle_edges[triangle]].sum(axis=2) - triangle[:, None]  # -1 + t - t at borders
    at_border = mesh.edge_triangles[mesh.triangle_edges[triangle], 1] < 0
    wanted = row[:, None] * width + neighbour
    position = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
    connected = (key[position] == wanted) & ~at_border
    own = np.broadcast_to(np.arange(len(key))[:, None], connected.shape)
    graph = coo_array(
        (np.ones(int(connected.sum()), dtype=np.int8), (own[connected], position[connected])), shape=(len(key),) * 2
    ).tocsr()
    count, region = connected_components(graph, directed=False)
    around_row = np.repeat(np.arange(around.shape[0]), np.diff(around.indptr))
    known = np.isin(wanted, around_row * width + around.indices)
    leaks = np.zeros(count, dtype=bool)
    leaks[region[(~known & ~at_border).any(axis=1)]] = True
    return region.astype(np.int64), leaks


# --------------------------------------------------------------------------------------------------------- assembling


def _assemble(mesh: TriangleMesh, found: _Found, passed_through: Booleans) -> Patches:
    pieces = [_assemble_chunk(mesh, rows, passed_through) for rows in _chunks(found.members)]
    nodes, sizes, triangles, mesh_triangles, rim_distance = (
        (np.concatenate(part) for part in zip(*pieces, strict=True)) if pieces else _nothing()
    )
    return Patches(
        centres=mesh.node_vertex[found.centres],
        rings=found.rings,
        vertex_offsets=np.concatenate(([0], np.cumsum(sizes))),
        vertices=mesh.node_vertex[nodes],
        nodes=nodes,
        triangle_offsets=found.members.indptr.astype(np.int64),
        triangles=triangles,
        mesh_triangles=mesh_triangles,
        rim_distance=rim_distance,
        passed_through=passed_through,
    )


def _nothing() -> tuple[Integers, Integers, Integers, Integers, Integers]:
    none = np.zeros(0, dtype=np.int64)
    return none, none, np.zeros((0, 3), dtype=np.int64), none, none


def _assemble_chunk(
    mesh: TriangleMesh, members: csr_array, passed_through: Booleans
) -> tuple[Integers, Integers, Integers, Integers, Integers]:
    """Return nodes, patch sizes, local triangles, mesh triangles and rim distances of some patches."""
    local = _Local.of(mesh, members)
    sizes = np.bincount(local.patch, minlength=local.patch_count)
    first = np.concatenate(([0], np.cumsum(sizes)))[:-1]
    turned = _winding_in_patches(mesh, local) < 0
    corners = local.corners.copy()
    corners[turned] = corners[turned][:, [0, 2, 1]]
    rim = local.triangle_count < np.diff(mesh.fan_offsets)[local.node]
    distance = _distance_to_rim(local, rim)
    distance[passed_through[mesh.node_vertex[local.node]]] = 0
    return local.node, sizes, corners - first[local.row][:, None], local.mesh_triangle, distance


def _winding_in_patches(mesh: TriangleMesh, local: _Local) -> NDArray[np.int8]:
    winding = mesh.winding[local.mesh_triangle]
    open_question = np.zeros(local.patch_count, dtype=bool)
    open_question[local.row[winding == 0]] = True
    chosen = np.flatnonzero(open_question[local.row])
    if len(chosen):
        winding[chosen] = _solve_patch_winding(mesh, local, chosen)
    return winding


def _solve_patch_winding(mesh: TriangleMesh, local: _Local, chosen: Integers) -> NDArray[np.int8]:
    """Orient the triangles of patches on a surface that as a whole has no orientation."""
    key = (local.row[chosen, None] * np.int64(len(mesh.edges)) + mesh.triangle_edges[local.mesh_triangle[chosen]]).reshape(-1)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, two = order[same], order[same + 1]
    start = local.corners[chosen].reshape(-1)
    areas = triangle_areas(mesh.vertices, mesh.triangles[local.mesh_triangle[chosen]])
    pairs = np.stack((one // 3, two // 3), axis=1)
    return solve_winding(len(chosen), pairs, start[one] != start[two], areas)


def _distance_to_rim(local: _Local, rim: Booleans) -> Integers:
    """Walk inwards from the rims of all patches at once."""
    start = local.corners.reshape(-1)
    end = np.roll(local.corners, -1, axis=1).reshape(-1)
    reached = rim.copy()
    distance = np.where(rim, 0, -1)
    step = 0
    while True:
        step += 1
        wave = reached.copy()
        wave[end[reached[start]]] = True
        wave[start[reached[end]]] = True
        new = wave & ~reached
        if not new.any():
            break
        distance[new] = step
        reached = wave
    distance[distance < 0] = 1
    return distance


def _concatenate(one: Patches, two: Patches, passed_through: Booleans) -> Patches:
    def both(name: str) -> Integers:
        joined: Integers = np.concatenate((getattr(one, name), getattr(two, name)))
        return joined

    def offsets(name: str) -> Integers:
        first, second = getattr(one, name), getattr(two, name)
        return np.concatenate((first, second[1:] + first[-1]))

    return Patches(
        centres=both("centres"),
        rings=both("rings"),
        vertex_offsets=offsets("vertex_offsets"),
        vertices=both("vertices"),
        nodes=both("nodes"),
        triangle_offsets=offsets("triangle_offsets"),
        triangles=both("triangles"),
        mesh_triangles=both("mesh_triangles"),
        rim_distance=both("rim_distance"),
        passed_through=passed_through,
    )


def _rows_of(offsets: Integers, chosen: Integers) -> tuple[Integers, Integers]:
    """Return the positions that belong to the chosen rows of a ragged array, and the offsets of the result."""
    sizes = np.diff(offsets)[chosen]
    new = np.concatenate(([0], np.cumsum(sizes)))
    return np.repeat(offsets[chosen] - new[:-1], sizes) + np.arange(new[-1]), new
