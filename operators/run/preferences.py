"""Access to the add-on's preferences from operators."""

from __future__ import annotations

from typing import Any

from bpy.types import Context

ADD_ON = __package__.rpartition(".")[0].rpartition(".")[0]
"""The add-on's name in Blender."""


def preferences(context: Context) -> Any | None:
    """Return the add-on's preferences; None where it was registered by a script and not enabled."""
    add_on = context.preferences.addons.get(ADD_ON)
    return add_on.preferences if add_on is not None else None


def preferred_workers(context: Context) -> int:
    """Return the number of worker processes that the user prefers, 0 for one each core."""
    own = preferences(context)
    return own.workers if own is not None else 0
