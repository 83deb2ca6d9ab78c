"""What the add-on does in Blender: one operator a file, named as its `bl_idname`; what they share lies in the folders.

The folders' imports go one way: `data`, `heat_map`, `representation` and `preview`, `run`, and then the operators.
"""

from __future__ import annotations

from importlib import import_module

OPERATORS = (
    "apply_to_source",
    "approximate",
    "cancel",
    "clear_inspection",
    "compare",
    "compare_methods",
    "copy_statistics",
    "distance",
    "domains_to_uv",
    "export_representation",
    "finish",
    "import_points",
    "import_representation",
    "inspect_patch",
    "open_sample",
    "preset_add",
    "read_values",
    "reconstruct",
    "report_bug",
    "resample",
    "run_again",
    "select_above",
    "separate_patches",
    "show_heat_map",
    "show_patches",
    "show_point_errors",
    "show_source",
    "subdivide",
    "use_as_source",
    "use_heat_map_material",
    "whats_new",
)
"""The modules of the operators; each holds the class `SPARSE_SURFACE_OT_<module>`."""

WATCHERS = (
    "data.origins", "run.session", "run.watch", "run.preloading", "preview.object", "heat_map.shown",
    "heat_map.following", "heat_map.readings", "heat_map.asset_library", "representation.compacting",
)  # fmt: skip
"""Modules with handlers for what happens in Blender."""


def operator_classes() -> list[type]:
    """Return the class of each operator."""
    modules = [import_module(f".{name}", __package__) for name in OPERATORS]
    return [getattr(module, f"SPARSE_SURFACE_OT_{name}") for module, name in zip(modules, OPERATORS, strict=True)]


def register() -> None:
    """Register every operator, and have the modules in `WATCHERS` told of what happens."""
    import bpy  # the command line reads operators/files/formats.py without Blender

    for operator in operator_classes():
        bpy.utils.register_class(operator)
    for name in WATCHERS:
        import_module(f".{name}", __package__).register()


def unregister() -> None:
    """Undo `register`; a run that is under way is ended."""
    import bpy

    for name in reversed(WATCHERS):
        import_module(f".{name}", __package__).unregister()
    for operator in reversed(operator_classes()):
        bpy.utils.unregister_class(operator)
