"""Files in and out, through Blender's own importers and exporters.

Axes are left as they stand in the file, and so are vertex order and scale: a vertex that nothing moved comes
out where it went in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.types import Object

from ...solver.errors import FileFormatError, InputError
from .atomic import beside

_AXES = {"forward_axis": "Y", "up_axis": "Z"}  # Blender's own, which is: no turning


def _enable(add_on: str) -> None:
    """Enable an importer that comes with Blender; what it is kept in can be found only once bpy is loaded."""
    import addon_utils

    addon_utils.enable(add_on)


def _import_fbx(path: str) -> None:
    if _is_operator("wm.fbx_import"):
        bpy.ops.wm.fbx_import(filepath=path)
    else:
        _enable("io_scene_fbx")
        bpy.ops.import_scene.fbx(filepath=path)


def _is_operator(name: str) -> bool:
    space, _, operator = name.partition(".")
    return operator in dir(getattr(bpy.ops, space))


def _import_gltf(path: str) -> None:
    _enable("io_scene_gltf2")
    bpy.ops.import_scene.gltf(filepath=path, merge_vertices=True)


def _open_blend(path: str) -> None:
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, use_scripts=False)


_IMPORTERS: dict[str, Callable[[str], Any]] = {
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path, **_AXES),
    ".ply": lambda path: bpy.ops.wm.ply_import(filepath=path, **_AXES),
    ".stl": lambda path: bpy.ops.wm.stl_import(filepath=path, **_AXES),
    ".blend": _open_blend,
    ".glb": _import_gltf,
    ".gltf": _import_gltf,
    ".fbx": _import_fbx,
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), lambda path: bpy.ops.wm.usd_import(filepath=path)),
    ".abc": lambda path: bpy.ops.wm.alembic_import(filepath=path, as_background_job=False),
}


def _export_gltf(path: str) -> None:
    _enable("io_scene_gltf2")
    kind = "GLB" if path.endswith(".glb") else "GLTF_SEPARATE"
    bpy.ops.export_scene.gltf(filepath=path, export_format=kind, use_selection=True)


def _export_fbx(path: str) -> None:
    _enable("io_scene_fbx")
    bpy.ops.export_scene.fbx(filepath=path, use_selection=True)


_EXPORTERS: dict[str, Callable[[str], Any]] = {
    ".obj": lambda path: bpy.ops.wm.obj_export(filepath=path, export_selected_objects=True, **_AXES),
    # A PLY file has coordinates for each vertex only: with UVs the exporter would split vertices at seams.
    ".ply": lambda path: bpy.ops.wm.ply_export(filepath=path, export_selected_objects=True, export_uv=False, **_AXES),
    ".stl": lambda path: bpy.ops.wm.stl_export(filepath=path, export_selected_objects=True, **_AXES),
    ".blend": lambda path: bpy.ops.wm.save_as_mainfile(filepath=path, copy=True, compress=True),
    ".glb": _export_gltf,
    ".gltf": _export_gltf,
    ".fbx": _export_fbx,
    **dict.fromkeys(
        (".usd", ".usda", ".usdc"), lambda path: bpy.ops.wm.usd_export(filepath=path, selected_objects_only=True)
    ),
    ".abc": lambda path: bpy.ops.wm.alembic_export(filepath=path, selected=True, as_background_job=False),
}

READABLE, WRITABLE = tuple(_IMPORTERS), tuple(_EXPORTERS)


def read_meshes(path: Path) -> list[Object]:
    """Read a file into an empty scene and return its mesh objects, sorted by name; raises what `read_objects` does."""
    return read_objects(path, ("MESH",), "mesh")


def read_objects(path: Path, kinds: Sequence[str], wanted: str) -> list[Object]:
    """Read a file into an empty scene and return its objects of these kinds, sorted by name.

    Raises
    ------
    InputError
        When the file is not there or holds none; `wanted` says of what.
    FileFormatError
        When Blender cannot read it.
    """
    if not path.is_file():
        raise InputError(f"There is no file '{path}'.")
    if path.suffix.lower() not in _IMPORTERS:
        raise FileFormatError(f"'{path.name}' is of no kind that can be read ({', '.join(READABLE)}).")
    bpy.ops.wm.read_homefile(use_empty=True)
    try:
        outcome = _IMPORTERS[path.suffix.lower()](str(path))
    except RuntimeError as error:  # Blender's operators report their errors so
        raise FileFormatError(f"'{path.name}' cannot be read: {_first_line(error)}.") from error
    found = [candidate for candidate in bpy.context.scene.objects if candidate.type in kinds]
    if outcome == {"CANCELLED"} or not found:
        raise InputError(f"'{path.name}' holds no {wanted}.")
    return sorted(found, key=lambda one: one.name)


def named(objects: Sequence[Object], name: str) -> list[Object]:
    """Return the object of this name alone.

    Raises
    ------
    InputError
        When there is none.
    """
    found = [candidate for candidate in objects if candidate.name == name]
    if not found:
        there = ", ".join(f"'{candidate.name}'" for candidate in objects)
        raise InputError(f"The file has no mesh '{name}', only {there}.")
    return found


def write_meshes(path: Path, objects: Sequence[Object]) -> None:
    """Write these objects, or for a .blend file everything, into a file; it appears when it is complete.

    Raises
    ------
    FileFormatError
        When the ending names no kind of file that can be written.
    OSError
        When the folder cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in _EXPORTERS:
        raise FileFormatError(f"'{path.name}' is of no kind that can be written ({', '.join(WRITABLE)}).")
    bpy.context.view_layer.update()
    for other in bpy.context.view_layer.objects:
        other.select_set(other in objects)
    with beside(path) as draft:
        try:
            _EXPORTERS[suffix](str(draft))
        except RuntimeError as error:
            raise OSError(_first_line(error)) from error


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if lines and "Traceback" in lines[0]:  # an exporter in Python: what it says comes last
        lines = [line for line in lines if not line.startswith("Location:")][::-1]
    return (lines[0] if lines else type(error).__name__).removeprefix("Error: ").rstrip(".")
