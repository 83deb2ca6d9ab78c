"""Patches: overlapping k-rings that are topological disks (paper, section 4).

A patch consists of all triangles that touch the (k - 1)-ring of its centre, so its vertices are the k-ring.  A patch
that is not a disk is repaired: enclosed gaps are filled, then the ring is made smaller; smaller rings cover what no
patch holds any more.  Around thin tubes and walls, where even half a ring closes, a patch is a strip instead that grows
node by node.  A small hole of the mesh inside a patch is allowed: such a patch has two boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..arrays import Booleans, Indices, offsets_of, row_positions, rows_in_order
from ..mesh.normals import triangle_areas
from ..mesh.topology import solve_winding
from ..mesh.triangle_mesh import TriangleMesh
from ..native.library import reason_against
from ..processes.each import Each
from .cover import build_cover
from .disks import Disks, held_nodes, largest_disks, numbered_nodes, row_chunks, rows_for_threads

_OF_PATCHES, _OF_VERTICES = ("centres", "rings", "levels"), ("vertices", "nodes", "rim_distance")
_OF_TRIANGLES = ("triangles", "mesh_triangles")

SIDES = 3
"""Rounds of strips of one radius, before what they leave gets smaller ones."""


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
        vertices that are passed through.  An open border of the mesh is not a rim.  Without a rim it is constant.
    passed_through
        Vertices that no patch holds off its rim, (V,).
    levels
        How often the surface had to be refined where the patch lies, (K,): finer patches hide coarser ones.
    """

    centres: Indices
    rings: Indices
    vertex_offsets: Indices
    vertices: Indices
    nodes: Indices
    triangle_offsets: Indices
    triangles: Indices
    mesh_triangles: Indices
    rim_distance: Indices
    passed_through: Booleans
    levels: Indices

    def __len__(self) -> int:
        return len(self.centres)

    @property
    def vertex_patch(self) -> Indices:
        """Patch of each entry of `vertices`, (M,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.vertex_offsets))

    @property
    def triangle_patch(self) -> Indices:
        """Patch of each entry of `triangles`, (S,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.triangle_offsets))

    @property
    def block_triangles(self) -> Indices:
        """Triangles as positions in `vertices`, (S, 3): all patches as one mesh of separate pieces."""
        return self.triangles + np.repeat(self.vertex_offsets[:-1], np.diff(self.triangle_offsets))[:, None]

    def select(self, which: Indices | Booleans) -> Patches:
        """Return some of the patches, in the given order; `passed_through` does not change."""
        chosen = np.arange(len(self))[which]
        vertex_rows, vertex_offsets = row_positions(self.vertex_offsets, chosen)
        triangle_rows, triangle_offsets = row_positions(self.triangle_offsets, chosen)
        rows = dict.fromkeys(_OF_PATCHES, chosen)
        rows |= {**dict.fromkeys(_OF_VERTICES, vertex_rows), **dict.fromkeys(_OF_TRIANGLES, triangle_rows)}
        taken = {name: getattr(self, name)[own] for name, own in rows.items()}
        return replace(self, vertex_offsets=vertex_offsets, triangle_offsets=triangle_offsets, **taken)

    def passing(self, vertices: Booleans) -> Patches:
        """Return the patches with further vertices (V,) passed through."""
        passed = self.passed_through | vertices
        distance = np.where(passed[self.vertices], 0, self.rim_distance)
        return replace(self, passed_through=passed, rim_distance=distance)


def corners_as_in_mesh(mesh: TriangleMesh, patches: Patches) -> Indices:
    """Triangles as local vertex numbers of their patch, (S, 3), from the mesh triangles' own first corner on.

    Barycentric coordinates of a mesh triangle are those of its corners in this order: patches turn some triangles.
    """
    if (mesh.winding == 1).all():
        return patches.triangles
    own = patches.nodes[patches.block_triangles]
    return rows_in_order(patches.triangles, own, mesh.nodes[patches.mesh_triangles])


def build_patches(
    mesh: TriangleMesh, centres: Indices, ring: int, wanted: Booleans | None = None, each: Each = map
) -> Patches:
    """Build the patches around the centres of a cover, each a disk.

    Every vertex that is not passed through has a positive rim distance in at least one patch; where repairs made
    patches smaller, that takes more of them than there are centres.

    Parameters
    ----------
    centres
        Nodes that `build_cover` chose for this ring, (K,).
    ring
        Largest radius of a patch in edges.
    wanted
        Nodes to be covered, (N,), as they were given to `build_cover`.
    each
        Looks at some rings, perhaps several parts at once.
    """
    wanted = ~mesh.passed_through[mesh.node_vertex] if wanted is None else wanted
    disks = _cover_with_disks(mesh, centres, ring, wanted, each)
    return _assemble(mesh, disks, _unheld(mesh, disks), 0, each)


def refine_patches(
    mesh: TriangleMesh, patches: Patches, which: Indices | Booleans, ring: int
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
    disks = _cover_with_disks(mesh, build_cover(mesh, ring, wanted), ring, wanted)
    unheld = patches.passed_through | _unheld(mesh, disks, depth > 0)
    new = _assemble(mesh, disks, unheld, 0)
    return _concatenate(kept, new, unheld), np.arange(len(kept) + len(new)) >= len(kept)


def overlay_patches(mesh: TriangleMesh, patches: Patches, wanted: Booleans, ring: int, level: int) -> Patches:
    """Lay finer patches over a part of the surface; the patches below stay.

    Parameters
    ----------
    wanted
        Vertices that the finer patches must hold off their rims, (V,).
    ring
        Largest radius of the new patches, in edges.
    level
        Level of the new patches; above those of `patches`, they hide what lies below.

    Returns
    -------
    The patches with the new ones behind them.
    """
    nodes = (wanted & ~patches.passed_through)[mesh.node_vertex] & mesh.used
    if not nodes.any():
        return patches
    disks = _cover_with_disks(mesh, build_cover(mesh, ring, nodes), ring, nodes)
    return _concatenate(patches, _assemble(mesh, disks, patches.passed_through, level), patches.passed_through)


def _cover_with_disks(mesh: TriangleMesh, centres: Indices, ring: int, wanted: Booleans, each: Each = map) -> Disks:
    """Take the largest disk around each centre; cover what is lost where disks had to be smaller by smaller ones.

    A strip along something thin leaves its other side: the next ones may be as large.
    """
    parts = []
    limit, rounds = ring, 0
    remaining = wanted
    while len(centres):
        disks = largest_disks(mesh, centres, limit, remaining, each)
        parts.append(disks)
        remaining = remaining & ~held_nodes(mesh, disks.members)
        if limit == 1:
            break
        rounds = rounds + 1 if disks.grown.any() else SIDES
        if rounds >= SIDES:
            limit, rounds = min(limit - 1, int(disks.rings.max(initial=1))), 0
        centres = build_cover(mesh, limit, remaining)
    return Disks.joined(parts, mesh)


def _unheld(mesh: TriangleMesh, disks: Disks, held_already: Booleans | None = None) -> Booleans:
    held = held_nodes(mesh, disks.members)
    if held_already is not None:
        held |= held_already
    unheld = mesh.passed_through.copy()
    unheld[mesh.node_vertex[mesh.used & ~held]] = True
    return unheld


def _deepest(mesh: TriangleMesh, patches: Patches) -> Indices:
    """Return the largest rim distance of each node over the patches, (N,)."""
    deepest = np.zeros(mesh.node_count, dtype=np.int64)
    np.maximum.at(deepest, patches.nodes, patches.rim_distance)
    return deepest


@dataclass(frozen=True, eq=False)
class _Local:
    """Local vertices of some patches.

    `node`, `rim_distance`: of the M local vertices, sorted by patch and node; `sizes`: how many each patch has, (K,);
    `corners`: (S, 3) numbers within the patch; `row`: patch of each triangle; `mesh_triangle`: (S,).
    """

    node: Indices
    rim_distance: Indices
    sizes: Indices
    corners: Indices
    row: Indices
    mesh_triangle: Indices

    @classmethod
    def of(cls, mesh: TriangleMesh, members: csr_array) -> _Local:
        row = np.repeat(np.arange(members.shape[0]), np.diff(members.indptr))
        triangle = members.indices.astype(np.int64)
        if reason_against() is None:
            found = numbered_nodes(mesh, members)
            return cls(found.nodes, found.rim_distance, found.sizes, found.corners, row, triangle)
        key = (row[:, None] * np.int64(mesh.node_count) + mesh.nodes[triangle]).reshape(-1)
        keys, corners, count = np.unique(key, return_inverse=True, return_counts=True)
        patch, node = np.divmod(keys, np.int64(mesh.node_count))
        corners = corners.reshape(-1, 3)
        sizes = np.bincount(patch, minlength=members.shape[0])
        distance = _distance_to_rim(corners, count < np.diff(mesh.fan_offsets)[node])
        return cls(node, distance, sizes, corners - offsets_of(sizes)[:-1][row][:, None], row, triangle)


def _assemble(mesh: TriangleMesh, disks: Disks, passed_through: Booleans, level: int, each: Each = map) -> Patches:
    # NumPy numbers the nodes of some patches at a time, so that memory stays bounded
    parts = row_chunks(disks.members) if reason_against() else _parts_for_threads(disks.members)
    pieces = list(each(lambda rows: _assemble_chunk(mesh, rows, passed_through), parts))
    nodes, sizes, triangles, mesh_triangles, rim_distance = map(np.concatenate, zip(*pieces, strict=True))
    return Patches(
        centres=mesh.node_vertex[disks.centres],
        rings=disks.rings,
        vertex_offsets=offsets_of(sizes),
        vertices=mesh.node_vertex[nodes],
        nodes=nodes,
        triangle_offsets=disks.members.indptr.astype(np.int64),
        triangles=triangles,
        mesh_triangles=mesh_triangles,
        rim_distance=rim_distance,
        passed_through=passed_through,
        levels=np.full(len(disks.rings), level, dtype=np.int64),
    )


def _parts_for_threads(members: csr_array) -> list[csr_array]:
    """Split the rows of a matrix, at least one part."""
    parts = rows_for_threads(members.shape[0])
    return [csr_array(members[own]) for own in parts] if len(parts) > 1 else [members]


def _assemble_chunk(
    mesh: TriangleMesh, members: csr_array, passed_through: Booleans
) -> tuple[Indices, Indices, Indices, Indices, Indices]:
    """Return nodes, patch sizes, local triangles, mesh triangles and rim distances of some patches."""
    local = _Local.of(mesh, members)
    corners = local.corners
    if (mesh.winding != 1).any():
        turned = _winding_in_patches(mesh, local) < 0
        corners = corners.copy()
        corners[turned] = corners[turned][:, [0, 2, 1]]
    distance = np.where(passed_through[mesh.node_vertex[local.node]], 0, local.rim_distance)
    return local.node, local.sizes, corners, local.mesh_triangle, distance


def _winding_in_patches(mesh: TriangleMesh, local: _Local) -> NDArray[np.int8]:
    winding = mesh.winding[local.mesh_triangle]
    open_question = np.zeros(len(local.sizes), dtype=bool)
    open_question[local.row[winding == 0]] = True
    chosen = np.flatnonzero(open_question[local.row])
    if len(chosen):
        winding[chosen] = _solve_patch_winding(mesh, local, chosen)
    return winding


def _solve_patch_winding(mesh: TriangleMesh, local: _Local, chosen: Indices) -> NDArray[np.int8]:
    """Orient the triangles of patches on a surface that as a whole has no orientation."""
    edge = mesh.triangle_edges[local.mesh_triangle[chosen]]
    key = (local.row[chosen, None] * np.int64(len(mesh.edges)) + edge).reshape(-1)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, two = order[same], order[same + 1]
    start = local.corners[chosen].reshape(-1)
    areas = triangle_areas(mesh.vertices, mesh.triangles[local.mesh_triangle[chosen]])
    pairs = np.stack((one // 3, two // 3), axis=1)
    return solve_winding(len(chosen), pairs, start[one] != start[two], areas)


def _distance_to_rim(corners: Indices, rim: Booleans) -> Indices:
    """Walk inwards from the rims of all patches at once; `corners` (S, 3) are those of triangles of separate pieces."""
    start = corners.reshape(-1)
    end = np.roll(corners, -1, axis=1).reshape(-1)
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
    pairs = {
        name: (getattr(one, name), getattr(two, name))
        for name in (*_OF_PATCHES, *_OF_VERTICES, *_OF_TRIANGLES, "vertex_offsets", "triangle_offsets")
    }
    for name in ("vertex_offsets", "triangle_offsets"):
        first, second = pairs[name]
        pairs[name] = first, second[1:] + first[-1]
    return Patches(passed_through=passed_through, **{name: np.concatenate(pair) for name, pair in pairs.items()})
