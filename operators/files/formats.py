"""The kinds of mesh file that Blender reads and writes; a new kind is a row.  Needs no Blender.

Axes stay as they are in the file, and so do vertex order and scale: an unmoved vertex keeps its
coordinates from file to file.
"""

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

_AXES = {"forward_axis": "Y", "up_axis": "Z"}  # Blender's own: nothing is rotated


class Format(NamedTuple):
    """A kind of file.

    Attributes
    ----------
    endings
        Its file endings, in lower case, with the dot.
    reader, writer
        Names of Blender's operators; the first that this Blender has is used. None: cannot be written.
    reading, writing
        What the operators are told beside the path.
    add_on
        Add-on of Blender's that brings an operator which is not built in.
    byte_colours
        Whether colours are stored as bytes, of which Blender's exporter cuts the fractions off.
    keeps_all
        Whether the file holds the scene as it is, with every layer, whatever is exported.
    parents
        Whether the file has a hierarchy: what places an object is written with it.
    beside
        Whether it is one file that names others by where they are from it, so that a draft must lie in its folder.
    up
        The axis that points upwards, as most programs that write such files have it.
    """

    endings: tuple[str, ...]
    reader: tuple[str, ...]
    writer: str | None
    reading: Mapping[str, Any] = MappingProxyType({})
    writing: Mapping[str, Any] = MappingProxyType({})
    add_on: str = ""
    byte_colours: bool = False
    keeps_all: bool = False
    parents: bool = False
    beside: bool = False
    up: str = "Z"


# Paths in an .mtl are absolute: one from the draft's folder would lead elsewhere from the file's.
_OWN = {"export_selected_objects": True, **_AXES}
# A PLY file has coordinates for each vertex only: with UVs the exporter would split vertices at seams.
_PLY = {**_OWN, "export_uv": False}
_BLEND = {"load_ui": False, "use_scripts": False}, {"copy": True, "compress": True}
_GLTF = ("import_scene.gltf",), "export_scene.gltf", {"merge_vertices": True}
_FBX = ("wm.fbx_import", "import_scene.fbx"), "export_scene.fbx"
_FBX_OUT = {"use_selection": True, "path_mode": "RELATIVE"}  # Blender reads absolute paths as relative ones
_ABC = {"as_background_job": False}
# Blender crashes on the zero bytes of the stored representation.
_ABC_OUT = {**_ABC, "selected": True, "export_custom_properties": False}

FORMATS = (
    Format(
        (".obj",),
        ("wm.obj_import",),
        "wm.obj_export",
        _AXES,
        {**_OWN, "export_colors": True, "path_mode": "ABSOLUTE"},
        up="Y",
    ),
    Format((".ply",), ("wm.ply_import",), "wm.ply_export", _AXES, _PLY, byte_colours=True),
    Format((".stl",), ("wm.stl_import",), "wm.stl_export", _AXES, _OWN),
    Format((".blend",), ("wm.open_mainfile",), "wm.save_as_mainfile", *_BLEND, keeps_all=True, beside=True),
    Format((".glb",), *_GLTF, {"export_format": "GLB", "use_selection": True}, "io_scene_gltf2", parents=True),
    Format(
        (".gltf",), *_GLTF, {"export_format": "GLTF_SEPARATE", "use_selection": True}, "io_scene_gltf2", parents=True
    ),
    Format((".fbx",), *_FBX, {}, _FBX_OUT, "io_scene_fbx", parents=True, beside=True),
    Format(
        (".usd", ".usda", ".usdc"),
        ("wm.usd_import",),
        "wm.usd_export",
        {},
        {"selected_objects_only": True},
        parents=True,
    ),
    Format((".usdz",), ("wm.usd_import",), None),
    Format((".abc",), ("wm.alembic_import",), "wm.alembic_export", _ABC, _ABC_OUT, parents=True),
)

ERROR_COLOURS = {
    "keep": "the input's own, no others",
    "add": "the input's own first, those of the error beside them",
    "replace": "those of the error in their place",
}
"""Which colours a written mesh has."""

QUALITIES = {
    "exact": "the result's numbers to the last bit",
    "compact": "a third to a half of the bytes, the surface within 1e-5 of its longest side",
    "plain": "exact, larger, for readers of other programs",
    "draft": "exact to the last bit, two or three times as large, written in a fraction of the time",
}
"""How a representation is saved: what `solver.surface.format.canonical` offers, in words."""

ORDERS = {
    "keep": "vertices and faces keep their numbers",
    "free": "they are numbered as they follow each other, for a smaller file",
}
"""Whether a saved representation keeps the order of its mesh, in words."""

BY_ENDING = {ending: kind for kind in FORMATS for ending in kind.endings}
READABLE = tuple(BY_ENDING)
WRITABLE = tuple(ending for ending, kind in BY_ENDING.items() if kind.writer is not None)
PLAIN = {
    **dict.fromkeys((".ply", ".obj", ".stl", ".off", ".vtk", ".vtu"), "meshio"),
    **dict.fromkeys((".dae", ".3mf"), "trimesh"),
    ".vtp": "pyvista",
    ".npz": "",
}
"""Endings of files that are read and written without Blender, and the library for each; .npz needs none."""

_BESIDE = {".dae": {"collada": "pycollada"}, ".3mf": {"networkx": "networkx", "lxml": "lxml"}}
"""Packages that a library needs for a kind of file: as Python and as pip call them."""

ONLY_PLAIN = tuple(ending for ending in PLAIN if ending not in BY_ENDING)
READABLE, WRITABLE = (*READABLE, *ONLY_PLAIN), (*WRITABLE, *ONLY_PLAIN)

POINTS = tuple(dict.fromkeys((*READABLE, ".xyz", ".txt", ".csv", ".asc", ".pts", ".pcd", ".las", ".laz", ".e57")))
"""Endings of files that hold points."""


def missing_library(path: Path) -> str:
    """Say in one sentence what is not installed that this kind of file is read and written with; empty if nothing."""
    ending = path.suffix.lower()
    needed = {name: name for name in [PLAIN.get(ending)] if name} | _BESIDE.get(ending, {})
    missing = [install for name, install in needed.items() if find_spec(name) is None]
    if not missing:
        return ""
    blender = "Blender (pip install bpy) or " if ending in BY_ENDING and find_spec("bpy") is None else ""
    are = "are" if len(missing) > 1 else "is"
    return (
        f"'{path.name}' is read and written with {blender}{' and '.join(needed.values())}; {' and '.join(missing)} "
        f"{are} not installed (pip install {' '.join(missing)})."
    )


def up_axis(path: Path) -> str:
    """Return the axis that most likely points upwards in a file."""
    kind = BY_ENDING.get(path.suffix.lower())
    return "Z" if kind is None else kind.up
