"""The state of the solver in Blender: at most one run at a time."""

from __future__ import annotations

import atexit

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from .control import Run
from .preloading import dismiss, pause
from .status import redraw_progress, settle_sidebars, show_status


class Session:
    """What is running.

    Attributes
    ----------
    current
        The run that has the solver to itself, or None.
    notice
        Why the last run ended, where its operator could not say so itself.
    """

    def __init__(self) -> None:
        self.current: Run | None = None
        self.notice = ""

    def start(self, run: Run) -> None:
        """Make a run the current one; there must be none."""
        assert self.current is None
        self.current, self.notice = run, ""
        pause()

    def stop(self, reason: str = "") -> None:
        """End the current run, if there is one, and remove all that it shows.

        May be called from anywhere, any number of times: by Cancel and ESC, before another file is loaded, when the
        add-on is disabled, when Blender quits and when something fails.
        """
        run, self.current = self.current, None
        if run is None:
            return
        run.stop()
        self.notice = reason
        if reason:
            print(reason)
        if run.preview is not None:
            run.preview.clear()
        if run.timer is not None:
            bpy.context.window_manager.event_timer_remove(run.timer)
        show_status(bpy.context, None)
        redraw_progress(bpy.context)
        settle_sidebars()


session = Session()


@bpy.app.handlers.persistent
def _stop_before_load(*_: object) -> None:
    session.stop(rpt_("The approximation was cancelled because another file was loaded"))


def _kill_at_exit() -> None:
    dismiss()
    if session.current is not None:
        session.current.stop()


def register() -> None:
    """Let loading a file and quitting Blender end the run."""
    bpy.app.handlers.load_pre.append(_stop_before_load)
    atexit.register(_kill_at_exit)


def unregister() -> None:
    """End the run, and no longer listen to Blender."""
    session.stop()
    atexit.unregister(_kill_at_exit)
    bpy.app.handlers.load_pre.remove(_stop_before_load)
