"""Edges of a mesh at which a crease may run: those that bend much more than what is beside them, in long chains.

A dihedral alone tells little: a coarse sphere bends at each of its edges.  Along a crease the surface bends at one
line of edges and hardly at the lines beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Booleans, Indices, any_of, rows_at, slices_of
from .edges import connected_parts
from .normals import angle_between, face_normals
from .triangle_mesh import TriangleMesh, cut_along

LEAST_DIHEDRAL = 12.0
"""Edges that bend less, in degrees, are not creases."""

CONTRAST = 2.5
"""How many times as much a crease bends as the second calmest of the edges beside it."""

CALM = 1.0
"""Dihedrals below this are taken to be this large, degrees."""

SHORTEST_CHAIN = 12
"""The smallest number of edges of a crease."""

STEEP = 75.0
"""Edges that bend by this, degrees, need less contrast: rods of six sides, which may mean round ones, bend less."""

FLAT, FEWEST_BESIDE = 0.1, 4
"""Triangles that bend by less, degrees, are one flat face; how many triangles the faces on both sides of a rim that may
be short must have: in wild noise two are flat by chance."""

EDGES_AT_ONCE = 50_000
"""Edges whose triangles' normals are gathered together: more would leave the cache."""


@dataclass(frozen=True)
class PotentialCreases:
    """What the edges of a mesh say about creases.

    Attributes
    ----------
    dihedral
        Angle between the triangles of each edge, (E,), degrees; 0 on borders.
    chain
        Chain of potential creases that each edge belongs to, (E,); -1 for all others.
    steep
        Edges that bend by 75 degrees or more between faces that bend much less, (E,).
    """

    dihedral: Array
    chain: Indices
    steep: Booleans

    @property
    def edges(self) -> Booleans:
        """Which edges are potential creases, (E,)."""
        return self.chain >= 0

    def with_any_of(self, edges: Booleans) -> PotentialCreases:
        """Keep the chains that some of these edges, (E,), belong to."""
        kept = np.zeros(int(self.chain.max(initial=-1)) + 2, dtype=bool)  # the last is that of edges without a chain
        kept[self.chain[edges & self.edges]] = True
        return replace(self, chain=np.where(kept[self.chain], self.chain, -1))


def potential_creases(mesh: TriangleMesh) -> PotentialCreases:
    """Find the edges of dihedral d >= 12 degrees that bend 2.5 times as much as what is beside them.

    Beside an edge are the four other edges of its triangles, and the four edges on the lines parallel to it, one strip
    of triangles away; of each four the second smallest counts.  Edges around a wall that is one strip wide need not
    bend more than each other, and what lies beyond them counts as bent: the wall may be round.  Chains of connected
    edges need 12 of them, unless they are closed rims of flat faces.
    """
    dihedral = dihedrals(mesh)
    bend = np.where(mesh.triangle_edges >= 0, dihedral[mesh.triangle_edges], 0.0)
    paired = np.flatnonzero(mesh.edge_triangles[:, 1] >= 0)
    bent = dihedral[paired] >= LEAST_DIHEDRAL
    edges, sides = paired[bent], mesh.paired_sides[bent]
    others = np.sort(_other_edges(bend, sides), axis=1)
    rims = _rims_of_flat_faces(mesh, dihedral) & mesh.named_by_vertices
    steep = _steep_edges(mesh, dihedral, bend, (edges, sides), others[:, 2]) | rims
    alone = dihedral[edges] >= CONTRAST * np.maximum(others[:, 1], CALM)
    edges, sides = edges[alone], sides[alone]
    parallel = np.sort(_parallel_edges(mesh, bend, sides, steep), axis=1)
    candidates = steep.copy()
    candidates[edges[dihedral[edges] >= CONTRAST * parallel[:, 1]]] = True
    candidates &= mesh.named_by_vertices
    chain = np.full(len(dihedral), -1)
    ends = mesh.edges[candidates]
    count, part = connected_parts(ends[:, 0], ends[:, 1], mesh.node_count)
    sizes = np.bincount(part[ends[:, 0]], minlength=count)
    long = sizes >= SHORTEST_CHAIN
    long[part[mesh.edges[rims, 0]]] = True
    chain[candidates] = np.where(long, np.arange(count), -1)[part[ends[:, 0]]]
    return PotentialCreases(dihedral, chain, steep)


def _rims_of_flat_faces(mesh: TriangleMesh, dihedral: Array) -> Booleans:
    """Edges of closed rims that bend by 75 degrees or more all along, between flat faces of several triangles, (E,).

    They may have any number of sides: those of a hole with six corners in a plate, of a bolt's head, of a box.
    """
    found = np.zeros(len(dihedral), dtype=bool)
    if not (dihedral >= STEEP).any():
        return found
    paired = mesh.edge_triangles[:, 1] >= 0
    flat = (dihedral < FLAT) & paired
    one, other = mesh.edge_triangles[flat].T
    _, face = connected_parts(one, other, len(mesh.triangles))
    size = np.bincount(face)
    # a side of each triangle, by its face, where that ends: sides of one face that share a node are one rim
    triangle, corner = np.nonzero(mesh.triangle_edges >= 0)
    edge = mesh.triangle_edges[triangle, corner]
    ends = ~flat[edge]
    triangle, edge = triangle[ends], edge[ends]
    beside = face[mesh.edge_triangles[edge]]
    good = (dihedral[edge] >= STEEP) & (size[beside].sum(axis=1) >= FEWEST_BESIDE) & (beside[:, 0] != beside[:, 1])
    own = face[triangle]
    asked = np.isin(own, own[good])
    edge, own, good = edge[asked], own[asked], good[asked]
    keys = own[:, None] * np.int64(mesh.node_count) + mesh.edges[edge]
    _, node = np.unique(keys, return_inverse=True)
    node = node.reshape(-1, 2)
    count, rim = connected_parts(node[:, 0], node[:, 1], int(node.max(initial=-1)) + 1)
    whole = np.ones(count, dtype=bool)
    whole[rim[node[~good, 0]]] = False
    found[edge[whole[rim[node[:, 0]]]]] = True
    return found & paired


def _steep_edges(
    mesh: TriangleMesh, dihedral: Array, bend: Array, bent: tuple[Indices, Indices], other: Array
) -> Booleans:
    """Find edges that bend by 75 degrees or more, and 2.5 times as much as those beside them but their own kind, (E,).

    Around a wall that is one strip wide the parallel edges are such edges, too.

    Parameters
    ----------
    dihedral, bend
        Of the edges, (E,), and of the triangles' edges, (T, 3).
    bent
        Edges that may be steep, (J,), and the sides of both their triangles, (J, 2).
    other
        Third smallest bend of the other edges of these triangles, (J,).
    """
    edges, sides = bent
    limit = dihedral[edges] / CONTRAST
    likely = (dihedral[edges] >= STEEP) & (other <= limit)
    edges, sides, limit = edges[likely], sides[likely], limit[likely]
    steep = np.zeros(len(dihedral), dtype=bool)
    steep[edges] = True
    calm = np.where((mesh.triangle_edges >= 0) & steep[mesh.triangle_edges], 0.0, bend)
    steep[edges] = _parallel_edges(mesh, calm, sides).max(axis=1) <= limit
    return steep


def dihedrals(mesh: TriangleMesh) -> Array:
    """Angle between the two triangles of each edge, (E,), degrees; 0 on borders and beside triangles without area."""
    angles = np.zeros(len(mesh.edges))
    for known, one, other in _normals_beside(mesh):
        angles[known] = np.degrees(angle_between(one, other))
    return angles


def beside_sharp_edges(mesh: TriangleMesh, degrees: float) -> Booleans:
    """Triangles beside edges that bend by more than an angle below 180 degrees, (T,)."""
    beside = np.zeros(len(mesh.triangles), dtype=bool)
    for known, one, other in _normals_beside(mesh):
        sharp = known[np.einsum("nd,nd->n", one, other) < np.cos(np.radians(degrees))]
        beside[mesh.edge_triangles[sharp]] = True
    return beside


def _normals_beside(mesh: TriangleMesh) -> Iterator[tuple[Indices, Array, Array]]:
    """Yield the edges that have two triangles with an area, some at a time, (n,), and the normals of both, (n, 3)."""
    normals, turned = face_normals(mesh.vertices, mesh.triangles), mesh.winding < 0
    normals[turned] = -normals[turned]
    usable = any_of(normals != 0.0)
    for rows in slices_of(len(mesh.edges), EDGES_AT_ONCE):
        one, other = mesh.edge_triangles[rows].T
        known = np.flatnonzero((other >= 0) & usable[one] & usable[other])
        yield rows.start + known, rows_at(normals, one[known]), rows_at(normals, other[known])


def cut_along_marked(mesh: TriangleMesh, marked: Indices) -> TriangleMesh:
    """Cut a mesh along marked edges, pairs of vertices (n, 2), those between two triangles."""
    ends = np.sort(mesh.node_vertex[mesh.edges], axis=1)
    width = np.int64(len(mesh.vertices))
    low, high = np.sort(marked, axis=1).T
    creases = np.isin(ends[:, 0] * width + ends[:, 1], low * width + high)
    creases &= (mesh.edge_triangles[:, 1] >= 0) & mesh.named_by_vertices
    return cut_along(mesh, creases) if creases.any() else mesh


def _other_edges(bend: Array, sides: Indices) -> Array:
    """Bend of the four other edges of the triangles beside edges with sides (J, 2), (J, 4), from all (T, 3)."""
    triangle, corner = np.divmod(sides, 3)
    return np.concatenate([bend[triangle, (corner + k) % 3] for k in (1, 2)], axis=1)


def _parallel_edges(mesh: TriangleMesh, bend: Array, both: Indices, steep: Booleans | None = None) -> Array:
    """The same of the four edges opposite to the ends of each edge, in the triangles beyond its own; 0 without one.

    Infinite beyond edges that are `steep`, (E,).
    """
    twin = np.full(mesh.triangles.size, -1)
    twin[mesh.paired_sides] = mesh.paired_sides[:, ::-1]
    found = []
    for sides in both.T:
        triangle, corner = np.divmod(sides, 3)
        apex = mesh.nodes[triangle, (corner + 2) % 3]
        for k in (1, 2):
            beyond = twin[3 * triangle + (corner + k) % 3]
            other, side = np.divmod(np.maximum(beyond, 0), 3)
            from_apex, to_own = (mesh.nodes[other] == apex[:, None]).argmax(axis=1), (side + 2) % 3
            parallel = np.where((from_apex + 1) % 3 == to_own, from_apex, to_own)
            bends = np.where(beyond >= 0, bend[other, parallel], 0.0)
            if steep is not None:
                bends[steep[mesh.triangle_edges[triangle, (corner + k) % 3]]] = np.inf
            found.append(bends)
    return np.stack(found, axis=1)
