"""Everything that the add-on registers in Blender, in one order."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import PointerProperty

from .operators import (
    approximate,
    cancel,
    compare,
    compare_methods,
    copy_statistics,
    finish,
    inspect_patch,
    reconstruct,
    resample,
    separate_patches,
    show_heat_map,
)
from .operators import domains_to_uv as domain_maps
from .operators import show_patches as patch_colours
from .operators.preview import object as early_object
from .operators.run import control as running
from .operators.run import preloading
from .ui import command, inspect_panel, legend, panels, preferences, presets, properties, translations

CLASSES: tuple[type, ...] = (
    *properties.CLASSES,
    *preferences.CLASSES,
    *approximate.CLASSES,
    *cancel.CLASSES,
    *finish.CLASSES,
    *show_heat_map.CLASSES,
    *compare.CLASSES,
    *copy_statistics.CLASSES,
    *separate_patches.CLASSES,
    *resample.CLASSES,
    *reconstruct.CLASSES,
    *inspect_patch.CLASSES,
    *patch_colours.CLASSES,
    *domain_maps.CLASSES,
    *compare_methods.CLASSES,
    *presets.CLASSES,
    *panels.CLASSES,
    *inspect_panel.CLASSES,
)

PRESETS = str(Path(__file__).parent)


def register() -> None:
    """Register every class, property, handler, preset, translation and command."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.sparse_surface = PointerProperty(type=properties.SparseSurfaceSettings, name="Sparse Surface")
    bpy.utils.register_preset_path(PRESETS)
    bpy.app.translations.register(__package__, translations.DICTIONARY)
    running.register()
    early_object.register()
    legend.register()
    preferences.register()
    command.register()


def unregister() -> None:
    """Undo `register`, in reverse; a run that is under way is ended."""
    command.unregister()
    preferences.unregister()
    legend.unregister()
    early_object.unregister()
    running.unregister()
    preloading.unregister()
    bpy.app.translations.unregister(__package__)
    bpy.utils.unregister_preset_path(PRESETS)
    del bpy.types.Scene.sparse_surface
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
