"""Reading: the fields of a representation from head and blocks; nothing in a file is trusted."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ...arrays import Array, Booleans, Indices, offsets_of
from ...fitting.dictionary import Dictionary
from ..closing import Fans
from ..container import demand
from .blocks import BlockReader
from .connectivity import demand_range, read_faces, read_triangles
from .content import Sizes
from .cover import Cover, Incidence, ring_members, weights_of
from .domains import Shapes, code_domains
from .entropy import NumberReader
from .functions import coefficient_steps, degrees_of, domain_inputs, domain_steps, mean_positions, position_steps
from .growth import Reading
from .positions import code_positions


def read(head: dict[str, Any], sizes: Sizes, blocks: BlockReader) -> dict[str, Any]:
    """Return the fields of a representation, but for `initial_domains` where they are to be found again.

    Raises
    ------
    Refusal
        When the blocks contradict the sizes, each other, or what a representation is.
    """
    mesh = _read_mesh(blocks, sizes)
    creases = _read_creases(blocks, mesh["triangles"])
    nodes, node_vertex = _read_nodes(blocks, sizes, mesh["triangles"], creases)
    incidence = Incidence.of(nodes, len(node_vertex))
    cover, centres = _read_cover(blocks, sizes, incidence)
    names = node_vertex[cover.nodes]
    weights = _read_weights(blocks, sizes, head["blending"], cover, incidence, names)
    positions = _read_positions(blocks, sizes, mesh["triangles"], names, weights)
    dictionary = Dictionary(head["degree"], head["basis"])
    functions = _read_functions(blocks, sizes, dictionary, mean_positions(cover, positions[names]))
    shapes = Shapes.of(positions, mesh["triangles"])
    fields = {
        **mesh,
        "vertices": positions,
        "vertex_offsets": cover.vertex_offsets,
        "patch_vertices": names,
        "triangle_offsets": cover.triangle_offsets,
        "patch_triangles": _patch_triangles(blocks, cover, len(nodes)),
        "mesh_triangles": cover.mesh_triangles,
        "domains": _read_domains(
            blocks, sizes, cover, centres, positions, weights, functions, dictionary, names, shapes
        ),
        "weights": weights,
        **functions,
        "energy": _read_energy(blocks, sizes),
        "creases": creases,
    }
    if "initial_domains" in blocks:
        fields["initial_domains"] = blocks.real("initial_domains", sizes.domains, sizes.patch_vertices, 2)
    return fields


def _read_mesh(blocks: BlockReader, sizes: Sizes) -> dict[str, Any]:
    count = sizes.triangles
    if "face_sizes" not in blocks:
        demand(sizes.faces == count and sizes.face_corners == 3 * count, "its faces are not its triangles")
        triangles = read_triangles(blocks, count, sizes.vertices)
        offsets, corners, polygon = 3 * np.arange(count + 1), triangles.ravel().copy(), np.arange(count)
    else:
        offsets, corners, triangles, polygon = read_faces(
            blocks, sizes.faces, sizes.face_corners, count, sizes.vertices
        )
    return {"triangles": triangles, "polygon": polygon, "face_offsets": offsets, "face_corners": corners}


def _read_creases(blocks: BlockReader, triangles: Indices) -> Indices:
    if "creases" not in blocks:
        return np.zeros((0, 2), dtype=np.int64)
    sides = blocks.listed("creases", triangles.size, triangles.size)
    ends = [np.roll(triangles, -k, axis=1).ravel()[sides] for k in (0, 1)]
    return np.unique(np.sort(np.stack(ends, axis=1), axis=1), axis=0)


def _read_nodes(blocks: BlockReader, sizes: Sizes, triangles: Indices, creases: Indices) -> tuple[Indices, Indices]:
    """Return the nodes of the triangles' corners, and the vertex of each node; those between creases, if not stored."""
    if len(creases) and "cut_corners" not in blocks:
        fans = Fans.of(triangles, creases, sizes.vertices)  # they are numbered as `renumbered` does it
        demand(len(fans.vertex) == sizes.nodes, "its creases do not lead to the nodes that it says")
        return fans.corners, fans.vertex
    cut = blocks.listed("cut_corners", triangles.size, triangles.size)
    extra = blocks.whole("cut_nodes", len(cut))
    demand_range(extra, sizes.nodes - sizes.vertices, "a corner names a node that is not there")
    nodes = triangles.ravel().copy()
    node_vertex = np.arange(sizes.nodes)
    node_vertex[sizes.vertices :] = 0
    node_vertex[sizes.vertices + extra] = nodes[cut]
    demand((node_vertex[sizes.vertices + extra] == nodes[cut]).all(), "a node has two vertices")
    nodes[cut] = sizes.vertices + extra
    return nodes.reshape(-1, 3), node_vertex


def _read_cover(blocks: BlockReader, sizes: Sizes, incidence: Incidence) -> tuple[Cover, Indices]:
    patches, triangles = sizes.patches, len(incidence.nodes)
    centres, rings = np.cumsum(blocks.whole("centres", patches)), blocks.whole("rings", patches)
    demand_range(centres + 1, sizes.nodes + 1, "a centre is not there")
    demand_range(rings, triangles + 1, "a ring is too large")
    demand((centres[rings > 0] >= 0).all(), "a ring has no centre")
    members = ring_members(incidence, centres, rings, sizes.patch_triangles)
    more = blocks.whole("more_sizes", patches)
    demand_range(more, sizes.patch_triangles + 1, "a patch has too many triangles")
    demand(int(more.sum()) + members.nnz == sizes.patch_triangles, "its patches are not as large as it says")
    names = np.cumsum(blocks.whole("more_triangles", int(more.sum())))
    demand_range(names, triangles, "a patch names a triangle that is not there")
    if len(names):
        extra = csr_array((np.ones(len(names), dtype=bool), names, offsets_of(more)), shape=members.shape)
        members = csr_array(members + extra)
        members.sum_duplicates()
        demand(members.nnz == sizes.patch_triangles, "a patch holds a triangle twice")
    offsets = members.indptr.astype(np.int64)
    cover = Cover.of(incidence.nodes, sizes.nodes, offsets, members.indices.astype(np.int64))
    demand(len(cover.nodes) == sizes.patch_vertices, "its patches do not have the vertices that it says")
    return cover, centres


def _patch_triangles(blocks: BlockReader, cover: Cover, triangles: int) -> Indices:
    """Triangles in the patches' own vertices, (S, 3), in their own orientation."""
    turned = np.zeros(triangles, dtype=bool)
    turned[blocks.listed("turned", triangles, triangles)] = True
    own = turned[cover.mesh_triangles]
    back = blocks.listed("turned_back", len(own), len(own))
    own[back] = ~own[back]
    first = np.repeat(cover.vertex_offsets[:-1], np.diff(cover.triangle_offsets))
    local = cover.corners - first[:, None]
    local[own] = local[own][:, [0, 2, 1]]
    return local


def _read_weights(
    blocks: BlockReader, sizes: Sizes, blending: str, cover: Cover, incidence: Incidence, names: Indices
) -> Array:
    if "weights" in blocks:
        weights = blocks.real("weights", sizes.patch_vertices)
        demand(((weights >= 0.0) & (weights <= 2.0)).all(), "a weight is not from 0 to 2")
        return weights
    passed = np.zeros(sizes.vertices, dtype=bool)
    passed[blocks.listed("passed_through", sizes.vertices, sizes.vertices)] = True
    levels = blocks.whole("levels", sizes.patches)
    demand_range(levels, 30, "a level is too high")
    return weights_of(cover, names, cover.rim_distances(incidence), levels, passed, blending)


def _read_positions(blocks: BlockReader, sizes: Sizes, triangles: Indices, names: Indices, weights: Array) -> Array:
    if "exact_vertices" in blocks:
        positions = np.ascontiguousarray(blocks.real("exact_vertices", 3, sizes.vertices).T)
    else:
        low, steps = blocks.real("lowest", 3), blocks.real("vertex_steps", 2)
        demand(np.isfinite(low).all() and ((steps > 0.0) & (steps < 1e60)).all(), "the vertices have no steps")
        total: Array = np.bincount(names, weights, sizes.vertices).astype(np.float64)
        code = Reading(NumberReader(blocks, "vertices", 3 * sizes.vertices), (sizes.vertices, 3), 1e60)
        positions = code_positions(triangles, position_steps(triangles, total, *steps), code) + low
    demand((np.abs(positions) <= 1e60).all(), "a vertex is too far away or not finite")
    return positions


def _read_functions(blocks: BlockReader, sizes: Sizes, dictionary: Dictionary, mean: Array) -> dict[str, Any]:
    shape = (sizes.patches, 3, sizes.functions)
    if "exact_support" in blocks:
        support, coefficients = blocks.whole("exact_support", *shape), blocks.real("exact_coefficients", *shape)
        origins = blocks.real("exact_origins", sizes.patches, 3)
        scales = blocks.real("exact_scales", sizes.patches, sizes.domains)
    else:
        step = float(blocks.real("function_step", 1)[0])
        demand(0.0 < step < 1e60, "the functions have no steps")
        scales = blocks.real("scales", sizes.patches, sizes.domains)
        origins = mean + blocks.whole("origins", 3, sizes.patches).T * step
        used = blocks.whole("used", *shape[:2])
        demand_range(used, sizes.functions + 1, "a patch has too many functions")
        support = np.cumsum(blocks.whole("support", *shape[::-1]).transpose(2, 1, 0), axis=2) - 1
        support[np.arange(sizes.functions) >= used[:, :, None]] = -1
        demand_range(support + 1, dictionary.size + 1, "a function is not in its dictionary")
        coefficients = np.zeros(shape)
        chosen = support >= 0
        reader = NumberReader(blocks, "coefficients", int(chosen.sum()))
        coefficients[chosen] = reader.take(degrees_of(support[chosen]))
        coefficients *= coefficient_steps(scales, step, support)
    demand_range(support + 1, dictionary.size + 1, "a function is not in its dictionary")
    demand(((scales >= 1e-60) & (scales <= 1e60)).all(), "a scale is too small, too large or not finite")
    demand((np.abs(coefficients) <= 1e12).all(), "a coefficient is too large or not finite")
    demand((np.abs(origins) <= 1e60).all(), "an origin is too far away or not finite")
    return {"origins": origins, "scales": scales, "support": support, "coefficients": coefficients}


def _read_domains(
    blocks: BlockReader,
    sizes: Sizes,
    cover: Cover,
    centres: Indices,
    positions: Array,
    weights: Array,
    functions: dict[str, Any],
    dictionary: Dictionary,
    names: Indices,
    shapes: Shapes,
) -> Array:
    if "exact_domains" in blocks:
        return blocks.real("exact_domains", sizes.domains, sizes.patch_vertices, 2)
    step, share = (float(number) for number in blocks.real("domain_step", 2))
    demand(0.0 < step < 1e60 and 0.0 < share <= 1.0, "the domains have no steps")
    finer: Booleans = np.zeros(sizes.vertices, dtype=bool)
    finer[blocks.listed("finer", sizes.vertices, sizes.vertices)] = True
    domains = np.empty((sizes.domains, sizes.patch_vertices, 2))
    for channel, part, target in domain_inputs(cover, functions, positions[names], dictionary):
        steps = domain_steps(cover, weights, functions["scales"][:, channel], (step, share), finer[names])
        code = Reading(
            NumberReader(blocks, f"domains_{channel}", 2 * sizes.patch_vertices), (sizes.patch_vertices, 2), 1e4
        )
        domains[channel] = code_domains(cover, centres, shapes, target, part, steps, code)
    return domains


def _read_energy(blocks: BlockReader, sizes: Sizes) -> Array:
    if "exact_energy" in blocks:
        return blocks.real("exact_energy", sizes.patches, sizes.iterations)
    counts = blocks.whole("energy_counts", sizes.patches)
    steps = np.cumsum(blocks.whole("energy", sizes.iterations, sizes.patches).T, axis=1)
    demand_range(np.abs(steps), 50_000, "an energy is too large")
    energy = np.exp(steps / 100.0)
    energy[np.arange(sizes.iterations) >= counts[:, None]] = np.nan
    return energy
