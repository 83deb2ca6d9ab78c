"""The operator that saves the current settings as a preset, or removes one, with Blender's own preset system."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from bl_operators.presets import AddPresetBase
from bpy.types import Context, Operator

from ..solver.settings import Settings
from .data.presets import preset_named


class SPARSE_SURFACE_OT_preset_add(AddPresetBase, Operator):
    """Save the current settings as a preset, or remove one"""

    bl_idname = "sparse_surface.preset_add"
    bl_label = "Add Sparse Surface Preset"
    preset_menu = "SPARSE_SURFACE_MT_presets"
    # Whole paths: where Blender 4 has Python 3.13, what `preset_defines` names is not found.
    preset_values = tuple(f"bpy.context.scene.sparse_surface.{item.name}" for item in fields(Settings))
    preset_subdir = "sparse_surface"

    def execute(self, context: Context) -> set[str]:
        # The list hands over what it shows, and Blender looks for a file of that name.
        shown: Any = self
        shown.name = preset_named(shown.name)
        return set(super().execute(context))
