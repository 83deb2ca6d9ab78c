"""Draws the values that were read off a heat map: at each vertex a word, and a line to the point measured to."""

from __future__ import annotations

import blf
import bpy
import gpu
from bpy.types import Context
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..operators.data.lengths import length_text
from ..operators.data.viewports import Drawing, sidebar_width
from ..operators.heat_map.readings import Reading, readings
from ..operators.heat_map.shown import shows_colours

TEXT_SIZE, PAD, ARM, BESIDE = 13, 5, 6, 14
"""Of the words, the box around them, the arms of the cross at a vertex, and how far the words stand beside it."""


def words_of(reading: Reading, context: Context) -> str:
    """Return what stands beside a vertex."""
    return length_text(context.scene, reading.value)


def draw() -> None:
    """Draw the readings, if this viewport shows the colours that they belong to."""
    context = bpy.context
    if not readings.going_on or not shows_colours(context.space_data):
        return
    under = readings.under_mouse
    shown = [*readings.kept, *([under] if under is not None and under not in readings.kept else [])]
    interface = context.preferences.system.ui_scale
    for reading in shown:
        _draw_reading(reading, context, interface)


def _draw_reading(reading: Reading, context: Context, interface: float) -> None:
    region, view = context.region, context.region_data
    at = location_3d_to_region_2d(region, view, reading.place)
    if at is None:  # behind the camera
        return
    arm = ARM * interface
    lines = [(at.x - arm, at.y), (at.x + arm, at.y), (at.x, at.y - arm), (at.x, at.y + arm)]
    to = None if reading.partner is None else location_3d_to_region_2d(region, view, reading.partner)
    if to is not None:
        lines += [tuple(at), tuple(to)]
    blf.size(0, TEXT_SIZE * interface)
    text, beside, pad = words_of(reading, context), BESIDE * interface, PAD * interface
    width, height = blf.dimensions(0, text)
    room = region.width - sidebar_width(context.area, context)
    corner = Vector((min(at.x + beside, room - width - 2.0 * pad), at.y + beside))
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    for thickness, colour in ((3.0, (0.02, 0.02, 0.02, 0.9)), (1.0, (1.0, 1.0, 1.0, 1.0))):
        gpu.state.line_width_set(thickness * interface)
        shader.uniform_float("color", colour)
        batch_for_shader(shader, "LINES", {"pos": lines}).draw(shader)
    gpu.state.line_width_set(1.0)
    low, high = corner - Vector((pad, pad)), corner + Vector((width + pad, height + pad))
    box = [(low.x, low.y), (high.x, low.y), (high.x, high.y), (low.x, high.y)]
    shader.uniform_float("color", (0.02, 0.02, 0.02, 0.92))
    batch_for_shader(shader, "TRIS", {"pos": box}, indices=[(0, 1, 2), (0, 2, 3)]).draw(shader)
    gpu.state.blend_set("NONE")
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    blf.position(0, corner.x, corner.y, 0)
    blf.draw(0, text)


_drawing = Drawing(draw, "POST_PIXEL")
register, unregister = _drawing.start, _drawing.stop
