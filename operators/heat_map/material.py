"""The material that renders error colours.  Needs no NumPy."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.types import Material, NodeTree

from ..data.result_keys import ERROR_COLOUR

MATERIAL = "Heat Map"

MARK = "sparse_surface_material"
"""Custom property of the material, by which it is found whatever its name."""

SHINE = 0.5
"""Share of a colour that does not depend on the light: enough to compare it with the legend, and to see the shape."""


def make_material(name: str = MATERIAL) -> Material:
    """Make a material that shows the colours of `error_color`, in every render engine and in Material Preview."""
    material = bpy.data.materials.new(name)
    material[MARK] = True
    if bpy.app.version < (5, 0, 0):  # always on from there, and the property is deprecated
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    kinds = ("ShaderNodeAttribute", "ShaderNodeBsdfPrincipled", "ShaderNodeOutputMaterial")
    colours, surface, output = (add_node(tree, kind, 300 * place) for place, kind in enumerate(kinds))
    colours.attribute_type, colours.attribute_name = "GEOMETRY", ERROR_COLOUR
    surface.inputs["Roughness"].default_value = 0.7
    surface.inputs["Specular IOR Level"].default_value = 0.2
    surface.inputs["Emission Strength"].default_value = SHINE
    for name in ("Base Color", "Emission Color"):
        tree.links.new(colours.outputs["Color"], surface.inputs[name])
    tree.links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    return material


def heat_map_material() -> Material:
    """Return the material of this file, which is made where there is none."""
    found = (each for each in bpy.data.materials if MARK in each and each.library is None)
    return next(found, None) or make_material()


def add_node(tree: NodeTree, kind: str, x: float) -> Any:
    """Add a node at a place from left to right."""
    made = tree.nodes.new(kind)
    made.location = (x, 0.0)
    return made
