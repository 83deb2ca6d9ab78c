"""Shows a surface while it is being solved: as its object, or as a drawing over the source where that is slow."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import bpy
import gpu
import numpy as np
from bpy.types import Context, Scene, SpaceView3D
from numpy.typing import NDArray

from ..data.colours import ColourScale
from ..data.parts import of_parts
from ..data.viewports import redraw_regions
from ..heat_map.scale import colour_scale
from ..heat_map.shown import shown_tolerance
from . import object as early_object
from . import overlay
from .subset import DrawnPart

if TYPE_CHECKING:
    from ..data.meshes import Source

NO_VIEWPORT = 1.0
"""Seconds after which no 3D viewport is expected to be drawn: there may be none."""

USUAL_PERCENTILE = 95.0
"""Of a source's errors when it is first shown: the upper end of the colours."""

REST = 20.0
"""After a preview there is none for this many times as long as it blocked the window."""

QUICK = 1.0 / 30.0
"""Seconds: if a redraw with the drawing takes less, an object is fast enough, although it redraws viewports often."""

SLOW = 0.1
"""Seconds: if an object takes more after all, the surface is drawn; if drawings do, only first ones are asked for."""

SLOW_IN_A_ROW = 2
"""Slow drawings before drawing counts as slow: one may have compiled its shader, or been slow by chance."""

MOST_TRIANGLES = 200_000
MOST_BY_SOFTWARE = 20_000
"""Triangles of a drawing, at most: more take longer in every redraw and show little more.  Where a source has more than
the first, its own redraw by software takes a quarter of a second or longer, so none is asked for."""


class LivePreview:
    """The `Preview` of a run.

    Parameters
    ----------
    kind
        "OBJECT", "DRAWN", or "AUTOMATIC": an object once Blender has proved to draw quickly.  Where it draws slowly,
        above all by software, it is asked to redraw only for the first picture of each source, and not of a large one:
        others appear when it redraws for another reason.
    """

    def __init__(self, kind: str) -> None:
        self._as_object = kind == "OBJECT"
        self._automatic = kind == "AUTOMATIC"
        self._objects_are_slow = False
        by_software = draws_by_software()
        self._asks_for_drawing = not (self._automatic and by_software)
        self._most_triangles = MOST_BY_SOFTWARE if by_software else MOST_TRIANGLES
        self._seen: set[int] = set()
        self._parts: dict[tuple[int, int], DrawnPart] = {}
        self._slow_drawings = 0
        self._newest: tuple[Source, NDArray[np.float64]] | None = None
        self._shown = False
        self._next = 0.0
        self._to_be_drawn = False
        self._handle: object | None = None
        self._usual_error: dict[int, float] = {}
        early_object.begin()

    def take(self, source: Source, positions: NDArray[np.float64]) -> None:
        """Remember the newest surface, positions (V, 3) in the frame of `source.arrays`."""
        self._newest, self._shown = (source, positions), False

    def update(self, context: Context) -> bool:
        """Show the newest surface unless the rest period is running; return whether anything was shown."""
        if self._as_object and context.mode != "OBJECT":  # undo does not know objects that are made in other modes
            early_object.remove_all()
            self._shown = False
            return False
        if self._newest is None or self._shown or time.monotonic() < self._next:
            return False
        source, positions = self._newest
        if not (self._as_object or self._part(source).ready):
            return False
        self._shown = True
        began = time.monotonic()
        if self._as_object:
            self._show_object(source, positions, context)
        else:
            self._draw(source, self._part(source), positions, context)
        if self._as_object or self._asks_for_drawing:
            self._rest_once_drawn(began)
        else:
            self._rest(began)
        return True

    def _show_object(self, source: Source, positions: NDArray[np.float64], context: Context) -> None:
        error = np.linalg.norm(positions - source.arrays.vertices, axis=1)
        scale, errors = self._scale(context.scene, source, error), of_parts(source, error)
        for (part, own), (_, away) in zip(of_parts(source, positions), errors, strict=True):
            early_object.show(part, own, away, scale, context)
        overlay.discard(source.session_uid)

    def _draw(self, source: Source, part: DrawnPart, positions: NDArray[np.float64], context: Context) -> None:
        drawn = positions[part.vertices]
        error = np.linalg.norm(drawn - source.arrays.vertices[part.vertices], axis=1)
        scale = self._scale(context.scene, source, error)
        overlay.show(source, drawn, scale.colours(error), part.triangles)
        first = source.session_uid not in self._seen and source.arrays.triangle_count <= MOST_TRIANGLES
        if self._asks_for_drawing or first:
            redraw_regions(context, "WINDOW")
        self._seen.add(source.session_uid)

    def _part(self, source: Source) -> DrawnPart:
        """Return what is drawn of a source; the first call starts to compute it."""
        key = source.session_uid, len(source.arrays.vertices)  # an object may be solved as a part and then by itself
        if key not in self._parts:
            self._parts[key] = DrawnPart(source.arrays, self._most_triangles)
        return self._parts[key]

    def clear(self) -> None:
        """Remove everything that is shown."""
        if self._handle is not None:
            SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
            self._handle = None
        overlay.clear()
        early_object.end()

    def _scale(self, scene: Scene, source: Source, error: NDArray[np.float64]) -> ColourScale:
        """The scene's scale; an automatic range stays as it was at first, so that colours show the progress."""
        if source.session_uid not in self._usual_error:
            self._usual_error[source.session_uid] = float(np.percentile(error, USUAL_PERCENTILE))
        usual = self._usual_error[source.session_uid]
        if usual == 0.0 or scene.sparse_surface.display.range_mode != "AUTOMATIC":
            return colour_scale(scene, error)
        return ColourScale(0.0, usual, shown_tolerance(scene))

    def _rest(self, began: float) -> float:
        """Keep previews to a small share of the window's time; return how long this one has taken."""
        took = time.monotonic() - began
        self._next = began + (1.0 + REST) * took
        return took

    def _rest_once_drawn(self, began: float) -> None:
        """Count the time until the window is redrawn as part of the preview."""

        def drawn() -> float | None:
            if self._to_be_drawn and time.monotonic() - began < NO_VIEWPORT:
                return 0.0
            took = self._rest(began)
            if not self._to_be_drawn:
                self._choose(took)
            return None

        self._next = math.inf
        self._to_be_drawn = True
        if self._handle is None:
            self._handle = SpaceView3D.draw_handler_add(self._note_drawing, (), "WINDOW", "POST_PIXEL")
        # The timer's first call after a viewport was drawn comes when the whole window has been drawn.
        bpy.app.timers.register(drawn, first_interval=0.0)

    def _note_drawing(self) -> None:
        self._to_be_drawn = False

    def _choose(self, seconds: float) -> None:
        """Choose how to show the next surface by how long the last preview blocked the window."""
        if not self._automatic:
            return
        if self._as_object:
            if seconds > SLOW:
                self._as_object, self._objects_are_slow = False, True
                early_object.remove_all()
            return
        self._slow_drawings = self._slow_drawings + 1 if seconds > SLOW else 0
        self._asks_for_drawing = self._slow_drawings < SLOW_IN_A_ROW
        self._as_object = seconds < QUICK and not self._objects_are_slow


def draws_by_software() -> bool:
    """Whether Blender draws without a graphics card: one redraw of a viewport takes a tenth of a second or more."""
    return str(gpu.platform.device_type_get()) == "SOFTWARE"
