"""Removes what Inspect Patch has laid out.  Needs no NumPy: the button that clears is there from the start."""

from __future__ import annotations

import bpy
from bpy.types import Context

from ..data.objects import remove_marked
from ..data.result_keys import INSPECTED, INSPECTION


def clear_inspection(context: Context) -> None:
    """Remove everything that the inspection shows."""
    remove_marked(INSPECTED)
    collection = bpy.data.collections.get(INSPECTION)
    if collection is not None and not collection.objects and not collection.children and collection.library is None:
        bpy.data.collections.remove(collection)
    noted = context.scene.sparse_surface.inspection
    noted.holder = ""
    noted.terms.clear()
    noted.energy.clear()
