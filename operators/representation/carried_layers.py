"""What a resampled mesh inherits from its original beside positions: materials, attributes, UV maps, vertex groups."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from bpy.types import Attribute, Mesh, Object
from numpy.typing import NDArray

from ...solver.surface.resampling import Resampled
from ..data.attributes import KINDS, read, write
from ..data.meshes import loose_edges, read_edges
from ..data.result_keys import ERROR, ERROR_COLOUR

Values = NDArray[Any]
Indices = NDArray[np.int64]

# What Blender computes itself, what another mesh invalidates, and what the add-on writes itself.
_LEFT_OUT = {"position", ".edge_verts", ".corner_vert", ".corner_edge", "custom_normal", ERROR, ERROR_COLOUR}
_LEFT_OUT_BEGINNINGS = (".select", ".hide", ".pn.", ".vs.", ".es.")


def carry_layers(source: Object, made: Object, resampled: Resampled, vertex: Indices) -> None:
    """Give a resampled object the materials, attributes, UV maps, edge marks and vertex groups of its source.

    Parameters
    ----------
    source
        The object whose mesh has the topology that was resampled.
    made
        An object with the mesh of `resampled` (see `create_mesh`).
    vertex
        Vertex of the resampled surface that each of the source's is; of several the first gives its values.
    """
    first = np.unique(vertex, return_index=True)[1]
    for slot in source.material_slots:
        made.data.materials.append(slot.material)
    edges = _edges_on_source_edges(source.data, made.data, resampled, vertex)
    transfers: dict[str, Callable[[Values, bool], Values]] = {
        "POINT": lambda values, blends: _interpolated(values[first], blends, resampled.at_vertices),
        "CORNER": lambda values, blends: _interpolated(values, blends, resampled.at_corners),
        "FACE": lambda values, _: values[resampled.source_face],
        "EDGE": lambda values, _: _along_edges(values, edges, len(made.data.edges)),
    }
    layers = [layer for layer in source.data.attributes if _is_carried(layer) and layer.domain in transfers]
    kinds = {layer.name: (layer.data_type, layer.domain) for layer in layers}
    values = {
        name: transfers[domain](read(source.data, name), KINDS[kind].blends) for name, (kind, domain) in kinds.items()
    }
    write(made.data, values, kinds)
    _choose_same_maps(source.data, made.data)
    _interpolate_groups(source, made, resampled, first)


def _is_carried(layer: Attribute) -> bool:
    name = layer.name
    return layer.data_type in KINDS and name not in _LEFT_OUT and not name.startswith(_LEFT_OUT_BEGINNINGS)


def _interpolated(values: Values, blends: bool, interpolation: Any) -> Values:
    carried: Values = interpolation.linear(values) if blends else interpolation.nearest(values)
    return carried


def _along_edges(values: Values, edges: tuple[Indices, Indices], count: int) -> Values:
    """Values of the source's edges on their parts; zero on edges inside of its faces."""
    made, of_source = edges
    carried = np.zeros((count, *values.shape[1:]), dtype=values.dtype)
    carried[made] = values[of_source]
    return carried


def _edges_on_source_edges(source: Mesh, made: Mesh, resampled: Resampled, vertex: Indices) -> tuple[Indices, Indices]:
    """Edges of the new mesh that lie on edges of the source, and those edges."""
    parts = np.stack([resampled.chains[:, :-1], resampled.chains[:, 1:]], axis=2)
    loose = vertex[loose_edges(source)]
    pairs = np.concatenate([parts.reshape(-1, 2), loose])
    whole = np.concatenate([np.repeat(resampled.edges, parts.shape[1], axis=0), loose])
    return _find_pairs(read_edges(made), pairs), _find_pairs(vertex[read_edges(source)], whole)


def _find_pairs(edges: Indices, pairs: Indices) -> Indices:
    """Positions of the pairs in the list of edges, which holds all of them."""
    width = int(edges.max(initial=0)) + 1
    keys, wanted = (np.sort(ends, axis=1) @ np.array([width, 1]) for ends in (edges, pairs))
    order = np.argsort(keys, kind="stable")
    places: Indices = order[np.searchsorted(keys[order], wanted)]
    return places


def _choose_same_maps(source: Mesh, made: Mesh) -> None:
    if source.uv_layers.active is not None:
        made.uv_layers.active = made.uv_layers[source.uv_layers.active.name]
    for layer in source.uv_layers:
        made.uv_layers[layer.name].active_render = layer.active_render


def _interpolate_groups(source: Object, made: Object, resampled: Resampled, first: Indices) -> None:
    """Carry vertex groups over; Blender writes many weights at once only where they are equal."""
    weights: dict[int, NDArray[np.float32]] = {}
    for vertex in source.data.vertices:
        for entry in vertex.groups:
            column = weights.setdefault(entry.group, np.zeros(len(source.data.vertices), dtype=np.float32))
            column[vertex.index] = entry.weight
    for group in source.vertex_groups:
        copied = made.vertex_groups.new(name=group.name)
        copied.lock_weight = group.lock_weight
        if group.index not in weights:
            continue
        fine = resampled.at_vertices.linear(weights[group.index][first]).astype(np.float32)
        for weight, vertices in _equal(fine):
            copied.add(vertices, weight, "REPLACE")


def _equal(weights: NDArray[np.float32]) -> list[tuple[float, list[int]]]:
    """Positive weights, each with the vertices that have it."""
    vertices = np.flatnonzero(weights > 0.0)
    levels, which = np.unique(weights[vertices], return_inverse=True)
    order = np.argsort(which, kind="stable")
    groups = np.split(vertices[order], np.cumsum(np.bincount(which, minlength=len(levels)))[:-1]) if len(levels) else []
    return [(float(level), members.tolist()) for level, members in zip(levels, groups, strict=True)]
