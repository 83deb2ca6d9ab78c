"""Build a .blend file with a Geometry Nodes group that colours a result by its attribute `error`.

    blender --background --python examples/error_colours.py -- error_colours.blend
    python examples/error_colours.py error_colours.blend

The group "Colour by Error" is marked as an asset: append it, or put the file in an asset library, and add it as a
modifier to any result of Sparse Surface.  Its input "Largest" is the error, in scene units, that gets the last colour;
at 0 it is the object's own largest error.  It needs no add-on: the attribute is part of the mesh.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy

ATTRIBUTE = "error ramp"
# Dark violet, blue, teal, green, yellow: lightness rises all the way.
COLOURS = ((0.05, 0.01, 0.15), (0.02, 0.10, 0.42), (0.01, 0.32, 0.40), (0.13, 0.62, 0.22), (0.93, 0.85, 0.05))


def main(path: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    group = colouring_group(display_material())
    group.asset_mark()
    group.asset_data.description = "Colours a mesh by the attribute that Sparse Surface leaves on it"
    group.use_fake_user = True
    example = example_object()
    modifier = example.modifiers.new("Colour by Error", "NODES")
    modifier.node_group = group
    bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()))


def colouring_group(material: Any) -> Any:
    """Return the node group: error, divided by the largest, through a colour ramp into a colour attribute."""
    group = bpy.data.node_groups.new("Colour by Error", "GeometryNodeTree")
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    largest = group.interface.new_socket("Largest", in_out="INPUT", socket_type="NodeSocketFloat")
    largest.subtype, largest.min_value, largest.default_value = "DISTANCE", 0.0, 0.0
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes = group.nodes
    inputs, outputs = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    error = nodes.new("GeometryNodeInputNamedAttribute")
    error.data_type = "FLOAT"
    error.inputs["Name"].default_value = "error"
    statistic = nodes.new("GeometryNodeAttributeStatistic")
    given = compare_with_zero(nodes)
    end = nodes.new("GeometryNodeSwitch")
    end.input_type = "FLOAT"
    scale = nodes.new("ShaderNodeMapRange")
    ramp = nodes.new("ShaderNodeValToRGB")
    spread(ramp.color_ramp)
    store = nodes.new("GeometryNodeStoreNamedAttribute")
    store.data_type, store.domain = "FLOAT_COLOR", "POINT"
    store.inputs["Name"].default_value = ATTRIBUTE
    look = nodes.new("GeometryNodeSetMaterial")
    look.inputs["Material"].default_value = material
    link = group.links.new
    link(inputs.outputs["Geometry"], statistic.inputs["Geometry"])
    link(error.outputs["Attribute"], statistic.inputs["Attribute"])
    link(inputs.outputs["Largest"], given.inputs[0])
    link(given.outputs[0], end.inputs["Switch"])
    link(statistic.outputs["Max"], end.inputs["False"])
    link(inputs.outputs["Largest"], end.inputs["True"])
    link(error.outputs["Attribute"], scale.inputs["Value"])
    link(end.outputs["Output"], scale.inputs["From Max"])
    link(scale.outputs["Result"], ramp.inputs["Fac"] if "Fac" in ramp.inputs else ramp.inputs[0])
    link(inputs.outputs["Geometry"], store.inputs["Geometry"])
    link(ramp.outputs["Color"], store.inputs["Value"])
    link(store.outputs["Geometry"], look.inputs["Geometry"])
    link(look.outputs["Geometry"], outputs.inputs["Geometry"])
    for place, node in enumerate((inputs, error, statistic, given, end, scale, ramp, store, look, outputs)):
        node.location = (190.0 * place, 0.0)
    return group


def compare_with_zero(nodes: Any) -> Any:
    """Return a node that says whether its first input is above zero."""
    node = nodes.new("FunctionNodeCompare")
    node.data_type, node.operation = "FLOAT", "GREATER_THAN"
    node.inputs[1].default_value = 0.0
    return node


def spread(ramp: Any) -> None:
    """Give a colour ramp the colours, evenly spaced."""
    while len(ramp.elements) < len(COLOURS):
        ramp.elements.new(0.5)
    for k, colour in enumerate(COLOURS):
        ramp.elements[k].position = k / (len(COLOURS) - 1)
        ramp.elements[k].color = (*colour, 1.0)


def display_material() -> Any:
    """Return a material that shows the colours."""
    material = bpy.data.materials.new("Error Colours")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    colours = nodes.new("ShaderNodeVertexColor")
    colours.layer_name = ATTRIBUTE
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(colours.outputs["Color"], shader.inputs["Base Color"])
    return material


def example_object() -> Any:
    """Return a sphere with an error that grows towards its top, to see the group at work."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24)
    sphere = bpy.context.object
    sphere.name = "Example"
    error = sphere.data.attributes.new("error", "FLOAT", "POINT")
    error.data.foreach_set("value", [0.005 * (1.0 + vertex.co.z) for vertex in sphere.data.vertices])
    return sphere


if __name__ == "__main__":
    given_arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if len(given_arguments) != 1:
        raise SystemExit("Say where to save the file: error_colours.py PATH")
    main(Path(given_arguments[0]))
