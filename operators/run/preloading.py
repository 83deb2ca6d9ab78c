"""Loads what a run needs while the panel is looked at: pressing the button then waits for no module.

Enabling the add-on and drawing the panel load none of it, and one module comes at a time: neither is felt.
"""

from __future__ import annotations

from importlib import import_module

import bpy

_NEEDED = ("...solver.job", "..data.meshes", "..preview.controller")

FIRST_AFTER = 0.2
BETWEEN = 0.1
"""Seconds after the panel was drawn, and between modules."""

_left: list[str] | None = None
"""What is still to be loaded; None before anything was asked for."""


def preload() -> None:
    """Begin to load, unless that was done before; for a panel to call whenever it is drawn."""
    global _left
    if _left is None:
        _left = list(_NEEDED)
        bpy.app.timers.register(_load_next, first_interval=FIRST_AFTER)


def _load_next() -> float | None:
    if _left:
        import_module(_left.pop(0), __package__)
    return BETWEEN if _left else None


def unregister() -> None:
    """Load nothing any more."""
    global _left
    _left = None
    if bpy.app.timers.is_registered(_load_next):
        bpy.app.timers.unregister(_load_next)
