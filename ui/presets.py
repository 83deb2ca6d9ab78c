"""Presets with Blender's own system: the solver's are files in `presets/`, and users save theirs beside them."""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_ui.utils import PresetPanel
from bpy.types import Menu, Panel

from ..operators.data.presets import FOLDER

PATH = str(Path(__file__).parent.parent)


class SPARSE_SURFACE_MT_presets(Menu):
    bl_label = "Sparse Surface Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    draw = Menu.draw_preset


class SPARSE_SURFACE_PT_presets(PresetPanel, Panel):
    bl_label = "Sparse Surface Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "sparse_surface.preset_add"


_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (SPARSE_SURFACE_MT_presets, SPARSE_SURFACE_PT_presets)
)


def register() -> None:
    """Register menu and panel, and let Blender find the solver's presets."""
    _register_classes()
    bpy.utils.register_preset_path(PATH)


def unregister() -> None:
    """Undo `register`."""
    bpy.utils.unregister_preset_path(PATH)
    _unregister_classes()
