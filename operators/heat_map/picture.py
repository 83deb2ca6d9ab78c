"""A picture of a result's errors: the source beside the result in its heat-map colours, with a scale.

It is drawn without Blender's renderers: the quickest of them that needs no window took 6 s for what is drawn here in
less than one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from bpy.types import Object

from ...solver.errors import InputError
from ..data.colours import ColourScale, linear_to_srgb
from ..data.report_text import quality
from ..data.result_keys import SCALE, has_heat_map, read_report
from .lettering import Lettering, add_legend
from .png import write_png
from .raster import draw
from .scene import HEIGHT, WIDTH, Body, View, read_body
from .shading import draw_bodies

CELL = (7.0, 6.0)
"""Width and height of the space for an object, in the units of the picture."""

CELL_HEIGHT = 0.35

TURNED_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Turns y upright."""


def render_heatmap(
    result: Object,
    picture: Path,
    *,
    source: Object | None = None,
    up: str = "Z",
    width: int = 1200,
    title: str = "",
    caption: str = "Sparse Surface",
    view: View | None = None,
) -> None:
    """Render a result's heat map to a PNG file, 16 by 9.

    Parameters
    ----------
    result
        Object with the attributes `error` and `error_color`.
    picture
        The file; it appears when it is complete.
    source
        Object to show beside it in plain clay.
    up
        "Z" or "Y": the axis that points up in the picture.
    width
        In pixels.
    title
        Caption of the source; its name where empty.
    caption
        Caption of the result.
    view
        From where; from the front right and above where None.

    Raises
    ------
    InputError
        When the result has no heat map.
    """
    if not has_heat_map(result):
        raise InputError(f"'{result.name}' has no heat map to show.")
    shown = [read_body(result, heat_map=True)]
    if source is not None:
        shown.insert(0, read_body(source, heat_map=False))
    view = view or View.three_quarter()
    bodies, ground = _arranged(shown, view, up)
    canvas = np.ones((round(width * HEIGHT / WIDTH), width, 3), dtype=np.float32)
    draw_bodies(canvas, bodies, view, ground)
    letter = Lettering()
    if source is not None:
        letter.write(title or source.name, _cell_centres(2)[0], 3.95, 0.36)
    letter.write(caption, _cell_centres(len(shown))[-1], 3.95, 0.36)
    add_legend(letter, ColourScale(*result[SCALE]))
    report = read_report(result)
    letter.write(quality(report) if report is not None else "", 0.0, -2.95, 0.26)
    colours = linear_to_srgb(np.clip(canvas, 0.0, 1.0))
    draw(colours, letter.shapes)
    write_png(picture, colours)


def _cell_centres(count: int) -> list[float]:
    return [0.0] if count == 1 else [-WIDTH / 4, WIDTH / 4]


def _arranged(shown: list[Body], view: View, up: str) -> tuple[list[Body], float]:
    """Put bodies into their cells, at the largest scale at which all of them, seen the same way, stay within one.

    Returns
    -------
    bodies
        In the picture's axes.
    ground
        Height of their lowest point above (0, 0, 0), upright in the world.
    """
    seen = [body.turned(view.axes @ (TURNED_UP if up == "Y" else np.eye(3))) for body in shown]
    every = np.concatenate([body.vertices for body in seen])
    low, high = every.min(axis=0), every.max(axis=0)
    scale = float(min(np.array(CELL) / np.maximum((high - low)[:2], 1e-30)))
    move = np.array([0.0, CELL_HEIGHT, 0.0]) - scale * (low + high) / 2
    across = ([x, 0.0, 0.0] for x in _cell_centres(len(seen)))
    placed = [body.placed(scale, move + cell) for body, cell in zip(seen, across, strict=True)]
    return placed, float(((scale * every + move) @ view.axes[:, 2]).min())
