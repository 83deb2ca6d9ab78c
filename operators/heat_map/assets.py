"""What the asset browser offers beside the material: the node group that makes error colours; and its pictures."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.types import ID, Material, NodeTree
from numpy.typing import NDArray

from ..data.colours import linear_to_srgb, ramp
from ..data.result_keys import ERROR, ERROR_COLOUR
from .material import add_node

GROUP = "Error Colours"

STOPS = 32
"""Colours of Blender's ramp at most."""

PREVIEW = 128
"""Pixels along a side of an asset's picture."""


def make_group(material: Material, name: str = GROUP) -> NodeTree:
    """Make a node group that colours a mesh by a number of each vertex, and gives it the material.

    As a modifier it colours results in a range of one's own, and any mesh that has such a number.
    """
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    group.is_modifier = True
    _add_sockets(group, material)
    given, value, scaled, colours, stored, painted, result = (
        add_node(group, kind, 220 * place) for place, kind in enumerate(_KINDS)
    )
    value.data_type = "FLOAT"
    stored.data_type, stored.domain = "FLOAT_COLOR", "POINT"
    stored.inputs["Name"].default_value = ERROR_COLOUR
    _fill(colours.color_ramp)
    for start, end in (
        (given.outputs["Attribute"], value.inputs["Name"]),
        (value.outputs["Attribute"], scaled.inputs["Value"]),
        (given.outputs["Minimum"], scaled.inputs["From Min"]),
        (given.outputs["Maximum"], scaled.inputs["From Max"]),
        (scaled.outputs["Result"], colours.inputs[0]),
        (given.outputs["Geometry"], stored.inputs["Geometry"]),
        (colours.outputs["Color"], _enabled(stored, "Value")),
        (stored.outputs["Geometry"], painted.inputs["Geometry"]),
        (given.outputs["Material"], painted.inputs["Material"]),
        (painted.outputs["Geometry"], result.inputs["Geometry"]),
    ):
        group.links.new(start, end)
    return group


_KINDS = (
    "NodeGroupInput", "GeometryNodeInputNamedAttribute", "ShaderNodeMapRange", "ShaderNodeValToRGB",
    "GeometryNodeStoreNamedAttribute", "GeometryNodeSetMaterial", "NodeGroupOutput",
)  # fmt: skip
"""The nodes of the group, from left to right."""


def _add_sockets(group: NodeTree, material: Material) -> None:
    """Add what a user sees of the group as a modifier."""
    sockets = group.interface
    sockets.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    sockets.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    numbers = sockets.new_socket("Attribute", in_out="INPUT", socket_type="NodeSocketString")
    numbers.default_value, numbers.description = ERROR, "Number of each vertex that is shown"
    for title, value, text in (("Minimum", 0.0, "darkest"), ("Maximum", 0.01, "brightest")):
        limit = sockets.new_socket(title, in_out="INPUT", socket_type="NodeSocketFloat")
        limit.default_value, limit.description = value, f"Value with the {text} colour"
        limit.subtype = "DISTANCE"
    shown = sockets.new_socket("Material", in_out="INPUT", socket_type="NodeSocketMaterial")
    shown.default_value = material


def _enabled(node: Any, name: str) -> Any:
    """Return the input of this name that the node's data type uses."""
    return next(each for each in node.inputs if each.name == name and each.enabled)


def _fill(colours: Any) -> None:
    """Give a ramp the colours of the legend."""
    picked = ramp()[np.linspace(0, len(ramp()) - 1, STOPS).round().astype(int)]
    while len(colours.elements) < STOPS:
        colours.elements.new(0.5)
    for number, (element, colour) in enumerate(zip(colours.elements, picked, strict=True)):
        element.position = number / (STOPS - 1)
        element.color = (*(float(c) for c in colour), 1.0)


def mark(block: ID, description: str, catalogue: str) -> None:
    """Make a data-block an asset with a picture."""
    block.asset_mark()
    own = block.asset_data
    own.description, own.author, own.catalog_id = description, "Sparse Surface", catalogue
    own.tags.new("sparse surface", skip_if_exists=True)
    preview = block.preview_ensure()
    preview.image_size = (PREVIEW, PREVIEW)
    preview.image_pixels_float.foreach_set(_picture().ravel())


def _picture() -> NDArray[np.float32]:
    """Return a ball in the colours of the legend, RGBA in sRGB, (PREVIEW, PREVIEW, 4), from the bottom."""
    y, x = np.mgrid[-1.1 : 1.1 : PREVIEW * 1j, -1.1 : 1.1 : PREVIEW * 1j]
    inside = x**2 + y**2
    height = np.sqrt(np.clip(1.0 - inside, 0.0, None))
    wave = 0.5 + 0.5 * np.sin(3.0 * x + 2.0) * np.cos(4.0 * y)
    colour = ramp()[np.rint(wave * (len(ramp()) - 1)).astype(int)]
    light = np.clip(0.5 * height - 0.3 * x + 0.5 * y, 0.0, 1.0)[..., None]
    alpha = np.clip((1.0 - np.sqrt(inside)) * PREVIEW / 3.0, 0.0, 1.0)[..., None]
    shown = linear_to_srgb(colour * (0.45 + 0.7 * light)) * alpha
    return np.concatenate([shown, alpha], axis=2).astype(np.float32)
