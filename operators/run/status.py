"""How far a run is, in words: in the status bar, and redrawn in the sidebars."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context

from ..data.objects import current_name
from ..data.viewports import redraw_regions

if TYPE_CHECKING:
    from .control import Run

_NUMBER = re.compile(r"\d[\d,.]*\b")

SECONDS_BETWEEN_LOOKS = 0.5
"""Progress is redrawn no more often than it can be read, and not before the first picture of a small mesh: even a small
part costs a redraw of the whole window, which takes the processors from the solver where Blender draws by software."""


def show_progress(context: Context, run: Run) -> None:
    """Draw a run's progress in the status bar and the sidebars if it differs from what they show."""
    now = time.monotonic()
    text = (context.workspace.name if context.workspace is not None else "", status_text(run))
    if text != run.shown and (run.waiting or now - run.shown_at >= SECONDS_BETWEEN_LOOKS):
        run.shown, run.shown_at, run.sidebars_behind = text, now, True
        show_status(context, run)
    elif run.sidebars_behind:
        # One redraw later: two costly parts in one would block the window for twice as long.
        run.sidebars_behind = False
        redraw_progress(context)


def status_text(run: Run) -> str:
    """Return one line about a run: object, stage, percentage, time left, and how to stop."""
    if run.waiting:
        return rpt_("The surface is ready: return to Object Mode to receive it")
    if run.progress is None:
        return rpt_("Starting the solver")
    name = current_name(run.current_source) if run.current_source is not None else ""
    stage, detail = rpt_(run.progress.stage), in_words(run.progress.detail)
    parts = [name, stage, detail, f"{run.progress.fraction:.0%}", remaining_text(run)]
    return "  |  ".join(part for part in [*parts, rpt_("ESC: Cancel")] if part)


def in_words(text: str) -> str:
    """Return what the solver says of its progress in the user's language: numbers are put in after translation."""
    return rpt_(_NUMBER.sub("{}", text)).format(*_NUMBER.findall(text))


def remaining_text(run: Run) -> str:
    """Return how long a run still takes, or nothing if that is not known yet."""
    seconds = run.remaining_seconds()
    return "" if seconds is None else rpt_("{} left").format(duration_text(seconds))


def duration_text(seconds: float) -> str:
    """Return a duration as a person says it."""
    if seconds < 60.0:
        return rpt_("{:.0f} s").format(max(seconds, 1.0))
    minutes = round(seconds / 60.0)
    if minutes < 60:
        return rpt_("{} min").format(minutes)
    return rpt_("{} h {} min").format(minutes // 60, minutes % 60)


def show_status(context: Context, run: Run | None) -> None:
    """Write a run's line into the status bar; None clears it in every workspace."""
    if run is not None and context.workspace is not None:
        context.workspace.status_text_set(status_text(run))
    elif run is None:
        for workspace in bpy.data.workspaces:
            workspace.status_text_set(None)


def settle_sidebars() -> None:
    """Redraw the sidebars a few more times: Blender moves panels into place only while it redraws them."""
    global _redraws_left
    _redraws_left = 5
    if not (bpy.app.background or bpy.app.timers.is_registered(_redraw_again)):
        bpy.app.timers.register(_redraw_again, first_interval=0.1)


_redraws_left = 0


def _redraw_again() -> float | None:
    global _redraws_left
    _redraws_left -= 1
    redraw_progress(bpy.context)
    return 0.1 if _redraws_left > 0 else None


def redraw_progress(context: Context) -> None:
    """Redraw only the sidebars of the 3D viewports: a viewport may be costly."""
    redraw_regions(context, "UI")
