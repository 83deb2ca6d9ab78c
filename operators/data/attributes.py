"""Data layers on a resampled mesh: everything that the original carries beside its positions, interpolated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from bpy.types import Mesh, Object
from numpy.typing import NDArray

from ...solver.surface.resampling import Resampled
from .result_keys import ERROR, ERROR_COLOUR

Indices = NDArray[np.int64]

# For `foreach_get`: the name of an element's value and its width; whether values between two others make sense.
_KINDS = {
    "FLOAT": ("value", 1, True),
    "FLOAT2": ("vector", 2, True),
    "FLOAT_VECTOR": ("vector", 3, True),
    "FLOAT_COLOR": ("color", 4, True),
    "BYTE_COLOR": ("color", 4, True),
    "INT": ("value", 1, False),
    "INT8": ("value", 1, False),
    "INT16_2D": ("value", 2, False),
    "INT32_2D": ("value", 2, False),
    "BOOLEAN": ("value", 1, False),
    "QUATERNION": ("value", 4, False),
    "FLOAT4X4": ("value", 16, False),
}

# What Blender computes itself, what no longer holds on another mesh, and what is written anew.
_LEFT_OUT = {"position", ".edge_verts", ".corner_vert", ".corner_edge", "custom_normal", ERROR, ERROR_COLOUR}
_LEFT_OUT_BEGINNINGS = (".select", ".hide", ".pn.", ".vs.", ".es.")


@dataclass(frozen=True)
class Layer:
    """An attribute with its values, (elements, width)."""

    name: str
    kind: str
    domain: str
    values: NDArray[Any]

    @property
    def between(self) -> bool:
        """Whether values between two others make sense."""
        return _KINDS[self.kind][2]


def interpolate_layers(source: Object, made: Object, resampled: Resampled) -> None:
    """Give a resampled object the materials, attributes, UV maps, edge marks and vertex groups of its source.

    Parameters
    ----------
    source
        The object whose mesh has the topology that was resampled.
    made
        An object with the mesh of `resampled` (see `mesh_data.create_mesh`).
    """
    for slot in source.material_slots:
        made.data.materials.append(slot.material)
    edges = _edges_on_source_edges(source.data, made.data, resampled)
    transfers: dict[str, Callable[[Layer], NDArray[Any]]] = {
        "POINT": lambda layer: _interpolated(layer, resampled.at_vertices),
        "CORNER": lambda layer: _interpolated(layer, resampled.at_corners),
        "FACE": lambda layer: layer.values[resampled.source_face],
        "EDGE": lambda layer: _along_edges(layer, edges, len(made.data.edges)),
    }
    layers = [layer for layer in read_layers(source.data) if layer.domain in transfers]
    write_layers(made.data, [Layer(la.name, la.kind, la.domain, transfers[la.domain](la)) for la in layers])
    _choose_same_maps(source.data, made.data)
    _interpolate_groups(source, made, resampled)


def read_layers(mesh: Mesh) -> list[Layer]:
    """Copy every attribute that can be carried over."""
    found = []
    for attribute in mesh.attributes:
        name = attribute.name
        if attribute.data_type not in _KINDS or name in _LEFT_OUT or name.startswith(_LEFT_OUT_BEGINNINGS):
            continue
        value, width, between = _KINDS[attribute.data_type]
        number = np.float32 if between or attribute.data_type in {"QUATERNION", "FLOAT4X4"} else np.int32
        values = np.empty(width * len(attribute.data), dtype=bool if attribute.data_type == "BOOLEAN" else number)
        attribute.data.foreach_get(value, values)
        found.append(Layer(name, attribute.data_type, attribute.domain, values.reshape(-1, width)))
    return found


def write_layers(mesh: Mesh, layers: list[Layer]) -> None:
    """Write attributes; all are made before any is filled: up to Blender 5.0 a handle goes stale with the next one."""
    for layer in layers:
        there = mesh.attributes.get(layer.name)
        if there is None or (there.data_type, there.domain) != (layer.kind, layer.domain):
            mesh.attributes.new(layer.name, layer.kind, layer.domain)
    for layer in layers:
        data = mesh.attributes[layer.name].data
        kind = bool if layer.kind == "BOOLEAN" else np.float32 if layer.values.dtype.kind == "f" else np.int32
        data.foreach_set(_KINDS[layer.kind][0], np.ascontiguousarray(layer.values, dtype=kind).ravel())
    mesh.update()


def _interpolated(layer: Layer, interpolation: Any) -> NDArray[Any]:
    values: NDArray[Any] = interpolation.linear(layer.values) if layer.between else interpolation.nearest(layer.values)
    return values


def _along_edges(layer: Layer, edges: tuple[Indices, Indices], count: int) -> NDArray[Any]:
    """Values of the source's edges on the parts of them; nothing on edges inside of its faces."""
    made, of_source = edges
    values = np.zeros((count, layer.values.shape[1]), dtype=layer.values.dtype)
    values[made] = layer.values[of_source]
    return values


def _edges_on_source_edges(source: Mesh, made: Mesh, resampled: Resampled) -> tuple[Indices, Indices]:
    """Edges of the new mesh that lie on edges of the source, and those edges."""
    parts = np.stack([resampled.chains[:, :-1], resampled.chains[:, 1:]], axis=2)
    loose = loose_edges(source)
    pairs = np.concatenate([parts.reshape(-1, 2), loose])
    whole = np.concatenate([np.repeat(resampled.edges, parts.shape[1], axis=0), loose])
    return _find_pairs(read_edges(made), pairs), _find_pairs(read_edges(source), whole)


def read_edges(mesh: Mesh) -> Indices:
    """Vertices of a mesh's edges, (E, 2)."""
    pairs = np.empty(2 * len(mesh.edges), dtype=np.int32)
    mesh.edges.foreach_get("vertices", pairs)
    return pairs.reshape(-1, 2).astype(np.int64)


def loose_edges(mesh: Mesh) -> Indices:
    """Vertices of the edges that belong to no face, (E, 2)."""
    used = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.loops.foreach_get("edge_index", used)
    free = np.ones(len(mesh.edges), dtype=bool)
    free[used] = False
    return read_edges(mesh)[free]


def _find_pairs(edges: Indices, pairs: Indices) -> Indices:
    """Where the pairs stand among the edges; all of them do."""
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


def _interpolate_groups(source: Object, made: Object, resampled: Resampled) -> None:
    """Carry vertex groups over; Blender has no way to write their weights at once but by equal weights."""
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
        fine = resampled.at_vertices.linear(weights[group.index]).astype(np.float32)
        for weight, vertices in _equal(fine):
            copied.add(vertices, weight, "REPLACE")


def _equal(weights: NDArray[np.float32]) -> list[tuple[float, list[int]]]:
    """Positive weights, each with the vertices that have it."""
    vertices = np.flatnonzero(weights > 0.0)
    levels, which = np.unique(weights[vertices], return_inverse=True)
    order = np.argsort(which, kind="stable")
    groups = np.split(vertices[order], np.cumsum(np.bincount(which, minlength=len(levels)))[:-1]) if len(levels) else []
    return [(float(level), members.tolist()) for level, members in zip(levels, groups, strict=True)]
