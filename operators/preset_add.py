"""The operator that saves the current settings as a preset, or removes one, with Blender's own preset system."""

from __future__ import annotations

from dataclasses import fields

from bl_operators.presets import AddPresetBase
from bpy.types import Operator

from ..solver.settings import Settings


class SPARSE_SURFACE_OT_preset_add(AddPresetBase, Operator):
    """Save the current settings as a preset, or remove one"""

    bl_idname = "sparse_surface.preset_add"
    bl_label = "Add Sparse Surface Preset"
    preset_menu = "SPARSE_SURFACE_MT_presets"
    preset_defines = ("settings = bpy.context.scene.sparse_surface",)
    preset_values = tuple(f"settings.{item.name}" for item in fields(Settings))
    preset_subdir = "sparse_surface"
