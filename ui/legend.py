"""The legend of the heat map: its layout (a pure function), and how it is drawn over a viewport."""

from __future__ import annotations

from dataclasses import dataclass

import blf
import bpy
import gpu
from bpy.app.translations import pgettext_iface as iface_
from bpy.types import Context, SpaceView3D
from gpu_extras.batch import batch_for_shader

from ..operators.data.result_keys import SCALE, has_heat_map
from ..operators.show_heat_map import anywhere_shown, forget, shows_heat_map

BAR_WIDTH, BAR_HEIGHT, MARGIN, GAP, TEXT_SIZE = 18, 220, 24, 8, 12
TICKS = 5


@dataclass(frozen=True)
class Text:
    """A word at a place in pixels, its lower left corner."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class Band:
    """A piece of the bar: lower left and upper right corner in pixels, and its place on the ramp or a fixed colour."""

    left: float
    bottom: float
    right: float
    top: float
    share: float


@dataclass(frozen=True)
class Legend:
    """Bands of colour from bottom to top, tick marks and words."""

    bands: tuple[Band, ...]
    ticks: tuple[float, ...]
    texts: tuple[Text, ...]


def build_legend(
    low: float, high: float, tolerance: float, unit: str, height: float, *, left: float = 0.0, scale: float = 1.0
) -> Legend:
    """Lay the legend out.

    Parameters
    ----------
    low, high, tolerance
        Values at the ends of the ramp; with a positive tolerance there are two bands, inside and outside.
    unit
        Short name of the unit of length, may be empty.
    height
        Of the viewport, in pixels; a low viewport gets a short bar.
    left
        Pixels that a toolbar covers at the left.
    scale
        Pixels per point of Blender's interface.
    """
    margin, width, gap = MARGIN * scale, BAR_WIDTH * scale, GAP * scale
    start = left + margin
    line = TEXT_SIZE * 1.6 * scale
    length = max(min(BAR_HEIGHT * scale, height - 2 * margin - 2 * line), 2 * line)
    title = Text(start, margin + length + line * 0.7, iface_("Error") + (f" [{unit}]" if unit else ""))
    if tolerance > 0.0:
        return _bands(start, margin, width, gap, length, tolerance, title, signed=low < 0.0)
    count = 64
    bands = tuple(
        Band(start, margin + length * k / count, start + width, margin + length * (k + 1) / count, (k + 0.5) / count)
        for k in range(count)
    )
    values = tick_values(low, high)
    ticks = tuple(margin + length * (value - low) / ((high - low) or 1.0) for value in values)
    digits = tick_digits(values)
    words = tuple(
        Text(start + width + gap, y - TEXT_SIZE * 0.35 * scale, f"{value:.{digits}g}")
        for value, y in zip(values, ticks, strict=True)
    )
    return Legend(bands, ticks, (title, *words))


def _bands(
    start: float, margin: float, width: float, gap: float, length: float, tolerance: float, title: Text, *, signed: bool
) -> Legend:
    """Lay out bands of equal height: inside and outside of the tolerance, or below, within and above it."""
    names = (iface_("below"), iface_("within"), iface_("above")) if signed else (iface_("inside"), iface_("outside"))
    borders = (-tolerance, tolerance) if signed else (tolerance,)
    count = len(names)
    edges = [margin + length * k / count for k in range(count + 1)]
    bands = tuple(Band(start, edges[k], start + width, edges[k + 1], (k + 0.5) / count) for k in range(count))
    x = start + width + gap
    words = [Text(x, (edges[k] + edges[k + 1]) / 2, name) for k, name in enumerate(names)]
    words += [Text(x, edge, f"{value:.4g}") for edge, value in zip(edges[1:-1], borders, strict=True)]
    return Legend(bands, tuple(edges[1:-1]), (title, *words))


def tick_values(low: float, high: float) -> list[float]:
    """Return both ends of the range and even steps between them."""
    if high <= low:
        return [low]
    return [low + (high - low) * k / (TICKS - 1) for k in range(TICKS)]


def tick_digits(values: list[float]) -> int:
    """Return the number of significant digits that tells the values apart."""
    return next((d for d in range(2, 7) if len({f"{v:.{d}g}" for v in values}) == len(values)), 6)


def unit_of(context: Context) -> tuple[str, float]:
    """Return the short name of the scene's unit of length, and its number in one Blender unit."""
    units = context.scene.unit_settings
    named = {
        "KILOMETERS": ("km", 1e-3), "METERS": ("m", 1.0), "CENTIMETERS": ("cm", 1e2), "MILLIMETERS": ("mm", 1e3),
        "MICROMETERS": ("µm", 1e6), "MILES": ("mi", 1 / 1609.344), "FEET": ("ft", 1 / 0.3048),
        "INCHES": ("in", 1 / 0.0254), "THOU": ("thou", 1000 / 0.0254),
    }  # fmt: skip
    if units.system == "NONE":
        return "", 1.0
    fallback = "METERS" if units.system == "METRIC" else "FEET"
    name, factor = named.get(units.length_unit, named[fallback])
    return name, factor * units.scale_length


_handle: object | None = None


def draw() -> None:
    """Draw the active object's legend if this viewport shows a heat map."""
    context = bpy.context
    if not anywhere_shown() or not shows_heat_map(context.space_data) or not has_heat_map(context.active_object):
        return
    low, high, tolerance = context.active_object[SCALE]
    unit, factor = unit_of(context)
    interface = context.preferences.system.ui_scale
    legend = build_legend(
        low * factor,
        high * factor,
        tolerance * factor,
        unit,
        context.region.height,
        left=_toolbar_width(context),
        scale=interface,
    )
    _draw_bands(legend, low, high, tolerance)
    _draw_words(legend, interface, context)


def _toolbar_width(context: Context) -> float:
    """Return the width of the toolbar that covers the viewport's left side."""
    overlap = context.preferences.system.use_region_overlap
    toolbars = [region for region in context.area.regions if region.type == "TOOLS" and region.alignment == "LEFT"]
    return float(max((region.width for region in toolbars if overlap and region.width > 1), default=0))


def _draw_bands(legend: Legend, low: float, high: float, tolerance: float) -> None:
    from ..operators.data.colours import STEPS, ColourScale, linear_to_srgb, ramp

    positions: list[tuple[float, float]] = []
    colours: list[tuple[float, ...]] = []
    indices: list[tuple[int, int, int]] = []
    scale = ColourScale(low, high, tolerance)
    srgb = scale.bands if tolerance > 0.0 else linear_to_srgb(ramp(scale.signed))
    for band in legend.bands:
        colour = srgb[int(band.share * (len(srgb) if tolerance > 0.0 else STEPS - 1))]
        first = len(positions)
        positions += [
            (band.left, band.bottom), (band.right, band.bottom), (band.right, band.top), (band.left, band.top)
        ]  # fmt: skip
        colours += [(*(float(c) for c in colour), 1.0)] * 4
        indices += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRIS", {"pos": positions, "color": colours}, indices=indices).draw(shader)
    edge = legend.bands[0].right
    marks = [(edge + dx, y) for y in legend.ticks for dx in (-4, 4)]
    lines = gpu.shader.from_builtin("UNIFORM_COLOR")
    lines.uniform_float("color", (1.0, 1.0, 1.0, 0.9))
    batch_for_shader(lines, "LINES", {"pos": marks}).draw(lines)


def _draw_words(legend: Legend, interface: float, context: Context) -> None:
    blf.size(0, TEXT_SIZE * interface)
    blf.color(0, *context.preferences.themes[0].view_3d.space.text_hi, 1.0)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.8)
    for word in legend.texts:
        blf.position(0, word.x, word.y, 0)
        blf.draw(0, word.text)
    blf.disable(0, blf.SHADOW)


@bpy.app.handlers.persistent
def _forget_viewports(*_: object) -> None:
    forget()


def register() -> None:
    """Draw over every 3D viewport that shows a heat map."""
    global _handle
    if not bpy.app.background:
        _handle = SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")
    bpy.app.handlers.load_pre.append(_forget_viewports)


def unregister() -> None:
    """Stop drawing."""
    global _handle
    if _handle is not None:
        SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    bpy.app.handlers.load_pre.remove(_forget_viewports)
    forget()
