"""The surface while it is being solved, drawn over its source in the 3D viewports by a shader of its own.

Whenever an object changes, Blender redraws every viewport once for each sample of its anti-aliasing, which without a
graphics card blocks the window for longer than a preview is worth.  This drawing costs one redraw.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy
import gpu
import numpy as np
from bpy.types import Context, Object, RegionView3D, Space, SpaceView3D
from numpy.typing import NDArray

from ..data.objects import find_object
from ..data.viewports import Drawing, is_shown_in, redraw_regions

if TYPE_CHECKING:
    from ..data.meshes import Source

_VERTEX_SHADER = """
void main()
{
    place = pos;
    tint = color;
    gl_Position = ModelViewProjectionMatrix * vec4(pos, 1.0);
    // The nearest hundredth of the depth: in front of the source, which lies in the same place, and hiding itself.
    gl_Position.z = 0.01 * gl_Position.z - 0.99 * gl_Position.w;
}
"""

_FRAGMENT_SHADER = """
void main()
{
    // The triangle's own normal, lit from the viewer: creases show as they are.
    vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
    float light = 0.35 + 0.65 * abs(dot(normal, towards_viewer));
    // Viewports encode colours as sRGB by themselves; light is even to the eye.
    shown = vec4(pow(light, 2.2) * tint.rgb, 1.0);
}
"""


_drawn: dict[int, Any] = {}
"""Triangles on the graphics card, by the session number of the object whose place in the world they share."""

_shader: Any = None


def show(
    source: Source, positions: NDArray[np.float64], colours: NDArray[np.float32], triangles: NDArray[np.int64]
) -> None:
    """Draw triangles (S, 3) of positions (W, 3) in the frame of `source.arrays`, with linear colours (W, 4).

    It appears when Blender next redraws a viewport; this function does not ask for that.
    """
    _drawn[source.session_uid] = _upload(source.lengths.to_local(positions), colours, triangles)
    _drawing.start()


def discard(session_uid: int) -> None:
    """Stop drawing the surface of this object."""
    if _drawn.pop(session_uid, None) is not None:
        redraw_regions(bpy.context, "WINDOW")


def clear() -> None:
    """Stop drawing."""
    _drawn.clear()
    if _drawing.going_on:
        _drawing.stop()
        redraw_regions(bpy.context, "WINDOW")


def _draw() -> None:
    context = bpy.context
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    try:
        for session_uid, batch in _drawn.items():
            placed = find_object(session_uid)
            if placed is not None and _is_wanted(placed, context.space_data, context):
                _draw_one(placed, batch, context.region_data)
    finally:
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")


_drawing = Drawing(_draw, "POST_VIEW")


def _draw_one(placed: Object, batch: Any, view: RegionView3D) -> None:
    viewer = (view.view_matrix @ placed.matrix_world).to_3x3().row[2].normalized()
    shader = _surface_shader()
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(placed.matrix_world)
        shader.bind()
        shader.uniform_float("towards_viewer", viewer)
        batch.draw(shader)


def _is_wanted(placed: Object, view: Space | None, context: Context) -> bool:
    """Whether a viewport shows the surface: where it shows the source, unless the user is editing that."""
    return isinstance(view, SpaceView3D) and placed.mode == "OBJECT" and is_shown_in(view, placed, context)


def _upload(positions: NDArray[np.float32], colours: NDArray[np.floating[Any]], triangles: NDArray[np.int64]) -> Any:
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    layout.attr_add(id="color", comp_type="F32", len=4, fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(positions))
    vertices.attr_fill("pos", np.ascontiguousarray(positions, dtype=np.float32))
    vertices.attr_fill("color", np.ascontiguousarray(colours, dtype=np.float32))
    corners = gpu.types.GPUIndexBuf(type="TRIS", seq=np.ascontiguousarray(triangles, dtype=np.int32))
    return gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=corners)


def _surface_shader() -> Any:
    """Compile the shader, once a session."""
    global _shader
    if _shader is None:
        between = gpu.types.GPUStageInterfaceInfo("sparse_surface_preview")
        between.smooth("VEC3", "place")
        between.smooth("VEC4", "tint")
        info = gpu.types.GPUShaderCreateInfo()
        info.push_constant("MAT4", "ModelViewProjectionMatrix")
        info.push_constant("VEC3", "towards_viewer")
        info.vertex_in(0, "VEC3", "pos")
        info.vertex_in(1, "VEC4", "color")
        info.vertex_out(between)
        info.fragment_out(0, "VEC4", "shown")
        info.vertex_source(_VERTEX_SHADER)
        info.fragment_source(_FRAGMENT_SHADER)
        _shader = gpu.shader.create_from_info(info)
    return _shader
