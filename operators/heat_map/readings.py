"""What has been read off heat maps with the mouse, and whether reading is going on.  Needs no NumPy: it is drawn."""

from typing import NamedTuple

import bpy
from bpy.types import Region, RegionView3D, SpaceView3D
from mathutils import Vector


class Reading(NamedTuple):
    """What a heat map says at one vertex.

    Attributes
    ----------
    name, vertex
        The object and the number of the vertex.
    place, partner
        Where the vertex is in the world, and the point that its distance was measured to; None where that is unknown.
    value
        Error or distance, in Blender units.
    """

    name: str
    vertex: int
    place: Vector
    value: float
    partner: Vector | None


class View(NamedTuple):
    """A 3D viewport: its space, and the region with its view."""

    space: SpaceView3D
    region: Region
    data: RegionView3D


class Readings:
    """The reading under the mouse, those that were kept by a click, and whether reading is going on."""

    def __init__(self) -> None:
        self.going_on = False
        self.under_mouse: Reading | None = None
        self.kept: list[Reading] = []

    def start(self) -> None:
        """Begin with none."""
        self.stop()
        self.going_on = True

    def stop(self) -> None:
        """Forget all; may be called any number of times."""
        self.going_on, self.under_mouse = False, None
        self.kept.clear()

    def keep(self) -> Reading | None:
        """Keep the reading under the mouse, each vertex once, and return it."""
        if self.under_mouse is not None and self.under_mouse not in self.kept:
            self.kept.append(self.under_mouse)
        return self.under_mouse


readings = Readings()


@bpy.app.handlers.persistent
def _stop_before_load(*_: object) -> None:
    readings.stop()


def register() -> None:
    """Let loading a file end the reading: Blender ends the operator without telling it."""
    bpy.app.handlers.load_pre.append(_stop_before_load)


def unregister() -> None:
    """End the reading, and no longer listen to Blender."""
    readings.stop()
    bpy.app.handlers.load_pre.remove(_stop_before_load)
