"""Loads what a run needs while the user looks at the panel, so that pressing the button loads no module.

Enabling the add-on and drawing the panel load none of it.  It is loaded in two parts, with a redraw between them, to
keep Blender responsive.  Once after an installation, another process translates the modules into bytecode.
"""

from __future__ import annotations

import sys
from importlib import import_module

import bpy

_JOB = "...solver.job"
_BYTECODE = ".bytecode"
_NEEDED = (_JOB, "..data.results", "..preview.controller")
"""What the run's functions import; a test compares this with the modules that a run loads."""

ENABLED_SINCE = 0.1
"""Seconds after the add-on was enabled."""

FIRST_AFTER = 0.2
BETWEEN = 0.02
"""Seconds after the panel was drawn, and between the parts."""

_left: list[str] | None = None
"""What remains to be loaded; None before `preload` was called."""


def python_command() -> tuple[str, ...]:
    """Return what starts Blender's own Python without Blender."""
    return sys.executable, *bpy.app.python_args


def preload() -> None:
    """Start to load, once, and have a child wait for the next run; a panel calls this whenever it is drawn."""
    global _left
    if _left is None:
        _left = list(_NEEDED)
    if not (bpy.app.background or bpy.app.timers.is_registered(_load_next)):
        bpy.app.timers.register(_load_next, first_interval=FIRST_AFTER)


def _load_next() -> float | None:
    if not _left:
        import_module(_JOB, __package__).prepare(python_command())
        return None
    if _JOB in _left:  # first of all: its child loads beside the window
        _left.remove(_JOB)
        import_module(_JOB, __package__).prepare(python_command())
        return BETWEEN
    for name in _left:
        import_module(name, __package__)
    _left.clear()
    return None


def _translate() -> None:
    bytecode = import_module(_BYTECODE, __package__)
    if bytecode.is_needed():
        bytecode.begin(python_command())


def register() -> None:
    """Let the first panel that is drawn start the loading."""
    global _left
    _left = None
    if not bpy.app.background:
        bpy.app.timers.register(_translate, first_interval=ENABLED_SINCE)


def pause() -> None:
    """Load nothing more until a panel is drawn without a run: the next run's child would slow this run down."""
    if bpy.app.timers.is_registered(_load_next):
        bpy.app.timers.unregister(_load_next)


def unregister() -> None:
    """Stop loading, and end the child that waits."""
    if bpy.app.timers.is_registered(_translate):
        bpy.app.timers.unregister(_translate)
    import_module(_BYTECODE, __package__).stop()
    pause()
    dismiss()


def dismiss() -> None:
    """End the child that waits, if there is one."""
    if _left is not None and _NEEDED[0] not in _left:
        import_module(_JOB, __package__).dismiss_prepared()
