"""The legend of the heat map: its layout (a pure function), and how it is drawn over a viewport."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import blf
import bpy
import gpu
from bpy.app.translations import pgettext_iface as iface_
from bpy.types import Context, Object
from gpu_extras.batch import batch_for_shader

from ..operators.data.lengths import unit_for
from ..operators.data.result_keys import (
    DISTANCES,
    ERROR_COLOUR,
    MADE_FROM,
    PATCH_COLOUR,
    REPORT,
    SCALE,
    SHARES,
    has_heat_map,
)
from ..operators.data.viewports import Drawing, sidebar_width
from ..operators.heat_map.shown import anywhere_shown, shows_colours

BAR_WIDTH, BAR_HEIGHT, MARGIN, GAP, TEXT_SIZE = 18, 220, 24, 8, 12
BLOCK_WIDTH = 120
"""Of bar and words together; wider where words need it."""
HISTOGRAM_WIDTH = 70
"""Of the longest bar of the histogram, at the left of the colours."""
NAVIGATION_WIDTH, NAVIGATION_HEIGHT = 44, 140
"""Of the buttons at the right side, and of the gizmo above them."""

MODES = {"OBJECT", "EDIT_MESH", "SCULPT", "PAINT_VERTEX"}
"""Modes that show colours of vertices; the others show textures or weights in their place."""


class Text(NamedTuple):
    """A word at a place in pixels, its lower left corner."""

    x: float
    y: float
    text: str


class Band(NamedTuple):
    """A piece of the bar: lower left and upper right corner in pixels, and its place on the ramp or a fixed colour."""

    left: float
    bottom: float
    right: float
    top: float
    share: float


class Legend(NamedTuple):
    """Bands of colour from bottom to top, tick marks and words, bars of a histogram, and the width of it all."""

    bands: tuple[Band, ...]
    ticks: tuple[float, ...]
    texts: tuple[Text, ...]
    bars: tuple[Band, ...] = ()
    width: float = BLOCK_WIDTH

    @property
    def left(self) -> float:
        """Where it begins."""
        return min([word.x for word in self.texts] + [bar.left for bar in self.bars])


def build_legend(
    low: float,
    high: float,
    tolerance: float,
    title: str,
    height: float,
    *,
    right: float,
    scale: float = 1.0,
    shares: Sequence[float] = (),
    text_width: Callable[[str], float] | None = None,
) -> Legend:
    """Lay the legend out, in the lower right corner: Blender's own words and panels lie in the others.

    Parameters
    ----------
    low, high, tolerance
        Values at the ends of the ramp; with a positive tolerance there are two bands, inside and outside.
    title
        What is shown, and its unit.
    height
        Of the viewport, in pixels; a low viewport gets a short bar.
    right
        Where the sidebar begins, or the viewport ends, in pixels from the left.
    scale
        Pixels per point of Blender's interface.
    shares
        Which share of the area has values in each part of the range, or in each band; nothing without a histogram.
    text_width
        Returns the width of a word in pixels; without it words are taken to fit.
    """
    margin, width, gap = MARGIN * scale, BAR_WIDTH * scale, GAP * scale
    start = _left(right, scale)
    line = TEXT_SIZE * 1.6 * scale
    length = max(min(BAR_HEIGHT * scale, height - 2 * margin - 2 * line - NAVIGATION_HEIGHT * scale), 2 * line)
    heading = Text(start, margin + length + line * 0.7, title)
    if tolerance > 0.0:
        made = _bands(start, margin, width, gap, length, tolerance, heading, signed=low < 0.0, shares=shares)
        return _widened(made, scale, text_width)
    count = 64
    bands = tuple(
        Band(start, margin + length * k / count, start + width, margin + length * (k + 1) / count, (k + 0.5) / count)
        for k in range(count)
    )
    values = tick_values(low, high, next((count for count in (5, 3) if length >= count * line), 2))
    ticks = tuple(margin + length * (value - low) / ((high - low) or 1.0) for value in values)
    digits = tick_digits(values)
    words = tuple(
        Text(start + width + gap, y - TEXT_SIZE * 0.35 * scale, f"{value:.{4 if value == high else digits}g}")
        for value, y in zip(values, ticks, strict=True)
    )
    made = Legend(bands, ticks, (heading, *words), _histogram(start, margin, length, shares, scale))
    return _widened(made, scale, text_width)


def _histogram(start: float, margin: float, length: float, shares: Sequence[float], scale: float) -> tuple[Band, ...]:
    """Lay out a bar for each share, at the left of the colours, from bottom to top; the longest fills the width."""
    most, count = max(shares, default=0.0), len(shares)
    if most <= 0.0:
        return ()
    edge = start - GAP / 2.0 * scale
    heights = [margin + length * k / count for k in range(count + 1)]
    return tuple(
        Band(edge - HISTOGRAM_WIDTH * scale * share / most, low, edge, high, (k + 0.5) / count)
        for k, (share, low, high) in enumerate(zip(shares, heights[:-1], heights[1:], strict=True))
        if share > 0.0
    )


def _widened(legend: Legend, scale: float, text_width: Callable[[str], float] | None) -> Legend:
    """Move a legend to the left, away from what lies at its right, so far that its longest word has room."""
    start = legend.bands[0].left
    right = start + BLOCK_WIDTH * scale
    needed = max([right, *(word.x + text_width(word.text) for word in legend.texts)]) if text_width else right
    by = right - needed
    boxes = [
        tuple(each._replace(left=each.left + by, right=each.right + by) for each in group)
        for group in (legend.bands, legend.bars)
    ]
    words = tuple(word._replace(x=word.x + by) for word in legend.texts)
    left = min([start, *(bar.left for bar in legend.bars)])
    return Legend(boxes[0], legend.ticks, words, boxes[1], needed - left)


def legend_of_patches(right: float, scale: float = 1.0) -> Legend:
    """Lay out what stands in the place of the legend where patches are shown."""
    start, margin, line = _left(right, scale), MARGIN * scale, TEXT_SIZE * 1.6 * scale
    words = (Text(start, margin + line, iface_("Patches")), Text(start, margin, iface_("a colour each")))
    return Legend((), (), words, width=BLOCK_WIDTH * scale)


def _left(right: float, scale: float) -> float:
    return right - (MARGIN + BLOCK_WIDTH + NAVIGATION_WIDTH) * scale


def surrounding_box(legend: Legend, scale: float = 1.0) -> tuple[float, float, float, float]:
    """Return left, bottom, right and top of the dark box that makes a legend readable on every background."""
    pad, text = GAP * scale, TEXT_SIZE * scale
    start = legend.left
    bottom = min([*(band.bottom for band in legend.bands), *(word.y for word in legend.texts)])
    top = max(word.y for word in legend.texts) + text
    return start - pad, bottom - pad, start + legend.width + pad, top + pad


def _bands(
    start: float,
    margin: float,
    width: float,
    gap: float,
    length: float,
    tolerance: float,
    title: Text,
    *,
    signed: bool,
    shares: Sequence[float],
) -> Legend:
    """Lay out bands of equal height: inside and outside of the tolerance, or below, within and above it.

    Each says which share of the area lies in it.
    """
    names = (iface_("below"), iface_("within"), iface_("above")) if signed else (iface_("inside"), iface_("outside"))
    borders = (-tolerance, tolerance) if signed else (tolerance,)
    count, said = len(names), list(names)
    edges = [margin + length * k / count for k in range(count + 1)]
    bands = tuple(Band(start, edges[k], start + width, edges[k + 1], (k + 0.5) / count) for k in range(count))
    x = start + width + gap
    if len(shares) == count:
        said = [f"{name}  {share_text(share)}" for name, share in zip(names, shares, strict=True)]
    words = [Text(x, (edges[k] + edges[k + 1]) / 2, name) for k, name in enumerate(said)]
    words += [Text(x, edge, f"{value:.4g}") for edge, value in zip(edges[1:-1], borders, strict=True)]
    return Legend(bands, tuple(edges[1:-1]), (title, *words))


def share_text(share: float) -> str:
    """Return a share in per cent; neither none nor all where it is neither."""
    if 0.0 < share < 5e-4:
        return "<0.1%"
    return ">99.9%" if 0.9995 <= share < 1.0 - 1e-9 else f"{share:.1%}"


def tick_values(low: float, high: float, count: int) -> list[float]:
    """Return `count` values in even steps, from one end of the range to the other."""
    if high <= low:
        return [low]
    return [low + (high - low) * k / (count - 1) for k in range(count)]


def tick_digits(values: list[float]) -> int:
    """Return the number of significant digits that tells the values apart."""
    return next((d for d in range(2, 7) if len({f"{v:.{d}g}" for v in values}) == len(values)), 6)


def title_of(coloured: Object, unit: str) -> str:
    """Say what the colours of an object show, and in which unit."""
    if coloured[SCALE][0] < 0.0:
        what = iface_("Signed distance")
    else:
        what = iface_("Distance") if DISTANCES in coloured or not _is_made(coloured) else iface_("Error")
    return f"{what} [{unit}]" if unit else what


def _is_made(coloured: Object) -> bool:
    return REPORT in coloured or MADE_FROM in coloured


def explained(context: Context) -> Object | None:
    """Return the object whose colours the viewport's legend explains: the active one if it can be, or another."""
    others = sorted(context.view_layer.objects, key=lambda each: each != context.active_object)
    return next((each for each in others if has_heat_map(each) and each.visible_get(viewport=context.space_data)), None)


def draw() -> None:
    """Draw the legend if this viewport shows the colours of errors or patches, and nothing else in their place."""
    context = bpy.context
    space = context.space_data
    if not anywhere_shown() or not shows_colours(space) or not space.overlay.show_overlays:
        return
    coloured = explained(context) if context.mode in MODES else None
    if coloured is None:
        return
    active = coloured.data.color_attributes.active_color
    if active is None or active.name not in {ERROR_COLOUR, PATCH_COLOUR}:
        return
    interface, right = context.preferences.system.ui_scale, _right_edge(context)
    low, high, tolerance = coloured[SCALE]
    if active.name == PATCH_COLOUR:
        legend = legend_of_patches(right, interface)
    else:
        unit, factor = unit_for(context.scene, tolerance or high)
        values = low * factor, high * factor, tolerance * factor
        title = title_of(coloured, unit)
        legend = build_legend(
            *values,
            title,
            context.region.height,
            right=right,
            scale=interface,
            shares=coloured.get(SHARES, ()),
            text_width=_text_width(interface),
        )
    _draw_box(surrounding_box(legend, interface))
    if legend.bands:
        _draw_bands(legend, low, high, tolerance)
    _draw_words(legend, interface)


def _text_width(interface: float) -> Callable[[str], float]:
    blf.size(0, TEXT_SIZE * interface)
    return lambda text: float(blf.dimensions(0, text)[0])


def _right_edge(context: Context) -> float:
    """Return where the viewport ends at the right, or the sidebar that lies over it begins."""
    return float(context.region.width - sidebar_width(context.area, context))


def _draw_box(box: tuple[float, float, float, float]) -> None:
    left, bottom, right, top = box
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.uniform_float("color", (0.02, 0.02, 0.02, 0.92))
    corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
    gpu.state.blend_set("ALPHA")
    batch_for_shader(shader, "TRIS", {"pos": corners}, indices=[(0, 1, 2), (0, 2, 3)]).draw(shader)
    gpu.state.blend_set("NONE")


def _draw_bands(legend: Legend, low: float, high: float, tolerance: float) -> None:
    from ..operators.data.colours import STEPS, ColourScale, linear_to_srgb, ramp

    positions: list[tuple[float, float]] = []
    colours: list[tuple[float, ...]] = []
    indices: list[tuple[int, int, int]] = []
    scale = ColourScale(low, high, tolerance)
    srgb = scale.bands if tolerance > 0.0 else linear_to_srgb(ramp(scale.signed))
    for band in (*legend.bands, *legend.bars):
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


def _draw_words(legend: Legend, interface: float) -> None:
    blf.size(0, TEXT_SIZE * interface)
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    for word in legend.texts:
        blf.position(0, word.x, word.y, 0)
        blf.draw(0, word.text)


_drawing = Drawing(draw, "POST_PIXEL")
register, unregister = _drawing.start, _drawing.stop
