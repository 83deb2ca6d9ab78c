"""Points with errors as bodies: a modifier puts a small ball in its colour at each.  Needs no NumPy."""

from __future__ import annotations

import bpy
from bpy.types import NodeTree, Object
from mathutils import Vector

from .material import add_node, heat_map_material

NAME = "Point Bodies"
SHARE_OF_SPACING = 0.25
"""Radius of a body: small enough that the surface between them is seen."""

MARK = "sparse_surface_point_bodies"


def give_bodies(points: Object) -> None:
    """Add the modifier, if the object has none."""
    if any(each.type == "NODES" and each.node_group and MARK in each.node_group for each in points.modifiers):
        return
    group = next((each for each in bpy.data.node_groups if MARK in each), None) or _group()
    radius = next(each for each in group.interface.items_tree if each.name == "Radius")
    # A modifier takes the defaults of its group; how its own values are set differs between Blender 4 and 5.
    radius.default_value = SHARE_OF_SPACING * _spacing(points)
    points.modifiers.new(NAME, "NODES").node_group = group


def _spacing(points: Object) -> float:
    """Return about how far the points are apart if they lie on a surface."""
    corners = [Vector(corner) for corner in points.bound_box]  # of the points alone: the modifier is not there yet
    longest = max(max(c[k] for c in corners) - min(c[k] for c in corners) for k in range(3))
    return float(longest) / max(len(points.data.vertices), 1) ** 0.5


def _group() -> NodeTree:
    group = bpy.data.node_groups.new(NAME, "GeometryNodeTree")
    group[MARK] = True
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    radius = group.interface.new_socket("Radius", in_out="INPUT", socket_type="NodeSocketFloat")
    radius.subtype, radius.min_value = "DISTANCE", 0.0
    given, body, placed, both, real, painted, result = (
        add_node(group, kind, 220.0 * x) for x, kind in enumerate(_KINDS)
    )
    body.inputs["Subdivisions"].default_value = 1
    painted.inputs["Material"].default_value = heat_map_material()
    for start, end in (
        (given.outputs["Geometry"], placed.inputs["Points"]),
        (given.outputs["Radius"], body.inputs["Radius"]),
        (body.outputs["Mesh"], placed.inputs["Instance"]),
        # A viewport shows the active colours of the first mesh of those that are joined; the bodies alone have none.
        (placed.outputs["Instances"], both.inputs["Geometry"]),
        (given.outputs["Geometry"], both.inputs["Geometry"]),
        (both.outputs["Geometry"], real.inputs["Geometry"]),
        (real.outputs["Geometry"], painted.inputs["Geometry"]),
        (painted.outputs["Geometry"], result.inputs["Geometry"]),
    ):
        group.links.new(start, end)
    return group


_KINDS = (
    "NodeGroupInput", "GeometryNodeMeshIcoSphere", "GeometryNodeInstanceOnPoints", "GeometryNodeJoinGeometry",
    "GeometryNodeRealizeInstances", "GeometryNodeSetMaterial", "NodeGroupOutput",
)  # fmt: skip
