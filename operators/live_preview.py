"""The surface while it is being solved, drawn over the 3D viewports.

It is no object.  Whenever an object changes, Blender draws every viewport anew and once more for each sample of its
anti-aliasing, which holds a window without a graphics card up for longer than a preview is worth; and objects that come
and go get in the way of undo, of saving and of what the user does meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import bpy
import gpu
import numpy as np
from bpy.types import Object, Scene, Space, SpaceView3D
from numpy.typing import NDArray

from .colour_ramp import ColourScale
from .heat_map import colour_scale
from .mesh_data import find_object
from .status import redraw_regions

if TYPE_CHECKING:
    from .mesh_data import Source

USUAL_PERCENTILE = 95.0
"""Of the errors so far: the upper end of the colours."""

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


@dataclass
class _Preview:
    """What is drawn: triangles on the graphics card, and the object whose place in the world they share."""

    session_uid: int
    batch: Any


_shown: _Preview | None = None
_handle: object | None = None
_shader: Any = None


def show(source: Source, positions: NDArray[np.float32], scene: Scene) -> None:
    """Draw the surface at positions (V, 3) in the frame of `source.arrays`, in the colours of how far they are off."""
    global _shown, _handle
    error = np.linalg.norm(positions - source.arrays.vertices, axis=1)
    colours = _shown_scale(error, scene).colours(error)
    _shown = _Preview(source.session_uid, _upload(source.lengths.to_local(positions), colours, source.arrays.triangles))
    if _handle is None:
        _handle = SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")
    redraw_regions(bpy.context, "WINDOW")


def clear() -> None:
    """Draw nothing any more."""
    global _shown, _handle
    _shown = None
    if _handle is not None:
        SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
        redraw_regions(bpy.context, "WINDOW")


def shown_object() -> int | None:
    """Return the session number of the object whose surface is shown, if any is."""
    return _shown.session_uid if _shown is not None else None


def _shown_scale(error: NDArray[np.floating[Any]], scene: Scene) -> ColourScale:
    """The scene's scale; where its range is automatic, patches still far off do not darken all others."""
    scale = colour_scale(scene, error)
    usual = float(np.percentile(error, USUAL_PERCENTILE))
    automatic = scene.sparse_surface.display.range_mode == "AUTOMATIC"
    return replace(scale, high=usual) if automatic and usual > 0.0 else scale


def _draw() -> None:
    context = bpy.context
    placed = find_object(_shown.session_uid) if _shown is not None else None
    if _shown is None or placed is None or not _is_wanted(placed, context.space_data):
        return
    viewer = (context.region_data.view_matrix @ placed.matrix_world).to_3x3().row[2].normalized()
    shader = _surface_shader()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    try:
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(placed.matrix_world)
            shader.bind()
            shader.uniform_float("towards_viewer", viewer)
            _shown.batch.draw(shader)
    finally:
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")


def _is_wanted(placed: Object, view: Space | None) -> bool:
    """Whether the surface belongs into a viewport: not over a mesh that is being worked on, nor into another's view."""
    if not isinstance(view, SpaceView3D) or placed.mode != "OBJECT":
        return False
    return view.local_view is None or placed.local_view_get(view)


def _upload(positions: NDArray[np.float32], colours: NDArray[np.floating[Any]], triangles: NDArray[np.int32]) -> Any:
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    layout.attr_add(id="color", comp_type="F32", len=4, fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(positions))
    vertices.attr_fill("pos", np.ascontiguousarray(positions, dtype=np.float32))
    vertices.attr_fill("color", np.ascontiguousarray(colours, dtype=np.float32))
    corners = gpu.types.GPUIndexBuf(type="TRIS", seq=np.ascontiguousarray(triangles, dtype=np.int32))
    return gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=corners)


def _surface_shader() -> Any:
    """Compile the shader, once in a session."""
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
