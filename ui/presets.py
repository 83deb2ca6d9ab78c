"""Presets with Blender's own system: those of the solver come as files in `presets/`, users save theirs beside."""

from __future__ import annotations

from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel
from bpy.types import Menu, Operator, Panel

from .properties import SOLVER_NAMES

FOLDER = "sparse_surface"


class SPARSE_SURFACE_MT_presets(Menu):
    bl_label = "Sparse Surface Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    draw = Menu.draw_preset


class SPARSE_SURFACE_OT_preset_add(AddPresetBase, Operator):
    """Save the current settings as a preset, or remove one"""

    bl_idname = "sparse_surface.preset_add"
    bl_label = "Add Sparse Surface Preset"
    preset_menu = "SPARSE_SURFACE_MT_presets"
    preset_defines = ("settings = bpy.context.scene.sparse_surface",)
    preset_values = tuple(f"settings.{name}" for name in SOLVER_NAMES)
    preset_subdir = FOLDER


class SPARSE_SURFACE_PT_presets(PresetPanel, Panel):
    bl_label = "Sparse Surface Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "sparse_surface.preset_add"


CLASSES = (SPARSE_SURFACE_MT_presets, SPARSE_SURFACE_OT_preset_add, SPARSE_SURFACE_PT_presets)
