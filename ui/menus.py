"""Menus: Object > Sparse Surface, so that Menu Search finds everything by its words; importing, exporting; help."""

from __future__ import annotations

import bpy
from bpy.types import Context, Menu, UILayout

from ..operators.files.formats import POINTS, READABLE
from ..operators.run.about import bug_page, website
from .jobs import is_points

Entry = tuple[str, str]
"""The name of an operator and its icon."""

MAKE: tuple[Entry, ...] = (("approximate", "MOD_SMOOTH"), ("reconstruct", "POINTCLOUD_DATA"))
MEASURE: tuple[Entry, ...] = (
    ("distance", "DRIVER_DISTANCE"),
    ("compare", "MOD_MESHDEFORM"),
    ("compare_methods", "ARROW_LEFTRIGHT"),
    ("copy_statistics", "COPYDOWN"),
)
LOOK: tuple[Entry, ...] = (
    ("show_heat_map", "COLOR"),
    ("show_patches", "COLOR"),
    ("show_point_errors", "POINTCLOUD_DATA"),
    ("show_source", "HIDE_OFF"),
    ("read_values", "EYEDROPPER"),
    ("select_above", "RESTRICT_SELECT_OFF"),
    ("use_heat_map_material", "MATERIAL"),
    ("inspect_patch", "VIEWZOOM"),
    ("clear_inspection", "TRASH"),
)
RESULT: tuple[Entry, ...] = (
    ("apply_to_source", "CHECKMARK"),
    ("run_again", "FILE_REFRESH"),
    ("use_as_source", "MESH_DATA"),
    ("subdivide", "MOD_SUBSURF"),
    ("resample", "MOD_SUBSURF"),
    ("separate_patches", "OUTLINER_COLLECTION"),
    ("domains_to_uv", "UV"),
)
RUNNING: tuple[Entry, ...] = (("finish", "CHECKMARK"), ("cancel", "CANCEL"))
IMPORT = (
    ("import_points", "Points for Sparse Surface (.xyz, .las, ...)"),
    ("import_representation", "Sparse Surface (.npz)"),
)
EXPORT = (("export_representation", "Sparse Surface (.npz)"),)


class SPARSE_SURFACE_MT_object(Menu):
    bl_label = "Sparse Surface"

    def draw(self, context: Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_REGION_WIN"
        _draw(layout, MAKE)
        denoise = layout.operator("sparse_surface.approximate", text="Denoise", icon="BRUSH_DATA")
        denoise.only_denoise = True
        for group in (MEASURE, LOOK, RESULT, RUNNING):
            layout.separator()
            _draw(layout, group)
        layout.separator()
        for name, _ in (*IMPORT, *EXPORT):
            layout.operator(f"sparse_surface.{name}")
        layout.separator()
        layout.operator("sparse_surface.open_sample", icon="SCENE_DATA")
        draw_help(layout)


class SPARSE_SURFACE_MT_help(Menu):
    bl_label = "Sparse Surface"

    def draw(self, context: Context) -> None:
        draw_help(self.layout)


def _draw(layout: UILayout, entries: tuple[Entry, ...]) -> None:
    for name, icon in entries:
        layout.operator(f"sparse_surface.{name}", icon=icon)


def draw_help(layout: UILayout) -> None:
    """Show where to read on, and where bugs are reported; the pages only where the manifest names a website."""
    if website():
        layout.operator("wm.url_open", text="Sparse Surface Manual", icon="URL").url = website()
    layout.operator("sparse_surface.whats_new", text="What's New in Sparse Surface", icon="INFO")
    text = "Report a Bug in Sparse Surface" if bug_page() else "Copy Versions for a Bug Report"
    layout.operator("sparse_surface.report_bug", text=text, icon="URL" if bug_page() else "COPYDOWN")


def _in_object_menu(menu: Menu, context: Context) -> None:
    menu.layout.separator()
    menu.layout.menu("SPARSE_SURFACE_MT_object", icon="MOD_SMOOTH")


def _in_context_menu(menu: Menu, context: Context) -> None:
    active = context.active_object
    if active is not None and (active.type == "MESH" or is_points(active)):
        _in_object_menu(menu, context)


def _in_import_menu(menu: Menu, context: Context) -> None:
    for name, title in IMPORT:
        menu.layout.operator(f"sparse_surface.{name}", text=title)


def _in_export_menu(menu: Menu, context: Context) -> None:
    for name, title in EXPORT:
        menu.layout.operator(f"sparse_surface.{name}", text=title)


def _in_help_menu(menu: Menu, context: Context) -> None:
    menu.layout.separator()
    menu.layout.menu("SPARSE_SURFACE_MT_help")


PLACES = {
    "VIEW3D_MT_object": _in_object_menu,
    "VIEW3D_MT_object_context_menu": _in_context_menu,
    "TOPBAR_MT_file_import": _in_import_menu,
    "TOPBAR_MT_file_export": _in_export_menu,
    "TOPBAR_MT_help": _in_help_menu,
}
"""Blender's own menus, and what is added at the end of each."""


class SPARSE_SURFACE_FH_points(bpy.types.FileHandler):
    bl_label = "Points for Sparse Surface"
    bl_import_operator = "sparse_surface.import_points"
    bl_file_extensions = ";".join(each for each in POINTS if each not in READABLE)  # Blender has handlers for these

    @classmethod
    def poll_drop(cls, context: Context) -> bool:
        return _drops_here(context)


class SPARSE_SURFACE_FH_representation(bpy.types.FileHandler):
    bl_label = "Sparse Surface"
    bl_import_operator = "sparse_surface.import_representation"
    bl_export_operator = "sparse_surface.export_representation"
    bl_file_extensions = ".npz"

    @classmethod
    def poll_drop(cls, context: Context) -> bool:
        return _drops_here(context)


def _drops_here(context: Context) -> bool:
    return context.area is not None and context.area.type in {"VIEW_3D", "OUTLINER"}


CLASSES = (
    SPARSE_SURFACE_MT_object,
    SPARSE_SURFACE_MT_help,
    SPARSE_SURFACE_FH_points,
    SPARSE_SURFACE_FH_representation,
)

_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def _manual_pages() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Lead "Online Manual" of a button's or setting's right-click menu to the website."""
    return website(), (("bpy.ops.sparse_surface.*", ""), ("bpy.types.sparsesurface*", ""))


def register() -> None:
    """Register the menus and what files can be dropped, and extend Blender's menus."""
    _register_classes()
    for name, draw in PLACES.items():
        getattr(bpy.types, name).append(draw)
    if website():
        bpy.utils.register_manual_map(_manual_pages)


def unregister() -> None:
    """Undo `register`."""
    if website():
        bpy.utils.unregister_manual_map(_manual_pages)
    for name, draw in PLACES.items():
        getattr(bpy.types, name).remove(draw)
    _unregister_classes()
