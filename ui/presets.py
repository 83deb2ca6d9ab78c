"""Presets with Blender's own system: the solver's are files in `presets/`, and users save theirs beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bl_ui.utils import PresetPanel
from bpy.types import Menu, Panel

from ..operators.data.presets import FOLDER, preset_title

PATH = str(Path(__file__).parent.parent)


class WithTitles:
    """A list of presets with the names that the panel shows."""

    def path_menu(self, paths: list[str], operator: str, **options: Any) -> None:
        options["display_name"] = lambda path: preset_title(Path(path).stem)
        Menu.path_menu(self, paths, operator, **options)


class SPARSE_SURFACE_MT_presets(WithTitles, Menu):
    bl_label = "Sparse Surface Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    draw = Menu.draw_preset


class SPARSE_SURFACE_PT_presets(WithTitles, PresetPanel, Panel):
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
