"""How distances are measured: what the operator and the panel both ask.  Needs no NumPy: the panel is made of it."""

from __future__ import annotations

from typing import Any

from bpy.props import BoolProperty, EnumProperty, IntProperty


def how_to_measure() -> dict[str, Any]:
    """Return the properties, as annotations of an operator or of a group."""
    return {
        "signed": BoolProperty(
            name="Signed", description="Make distances inside the other object, which must be a mesh, negative"
        ),
        "align": EnumProperty(
            name="Align",
            description="How to move the measured object onto the other one first",
            items=[
                ("none", "Off", "Measure where the objects are"),
                ("rigid", "Move", "Move and rotate the measured object onto the other one"),
                ("scaled", "Move and Scale", "Move, rotate and scale the measured object onto the other one"),
            ],
        ),
        "move": BoolProperty(
            name="Move the Object", description="Move the measured object itself, too, to where it was aligned"
        ),
        "samples": IntProperty(
            name="Samples",
            description="Number of places on each mesh over which the statistics are taken. "
            "More cost time in proportion",
            default=200_000,
            min=100,
            max=100_000_000,
            soft_max=5_000_000,
        ),
    }
