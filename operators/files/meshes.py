"""Mesh files in and out, through Blender's own importers and exporters."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.types import Object

from ...solver.atomic_files import atomic_output
from ...solver.errors import FileFormatError, InputError
from ..data.attributes import read
from ..data.meshes import create_mesh, read_polygons, read_positions, to_world
from ..data.result_keys import ERROR, SHIFT
from .colours import colours_chosen
from .formats import BY_ENDING, ONLY_PLAIN, READABLE, WRITABLE, Format
from .plain import PlainMesh, read_plain, write_plain
from .shifted import give_back_shift
from .stand_ins import placing, standing_in
from .stl import carry_marks


def read_meshes(path: Path) -> list[Object]:
    """Read a file into an empty scene and return its mesh objects, sorted by name; raises what `read_objects` does."""
    return read_objects(path, ("MESH",), "mesh")


def read_objects(path: Path, kinds: Sequence[str], wanted: str) -> list[Object]:
    """Read a file into an empty scene and return its objects of these kinds, sorted by name.

    Raises
    ------
    InputError
        When the file is missing or holds no such object; `wanted` names what it lacks.
    FileFormatError
        When Blender cannot read it.
    """
    if not path.is_file():
        raise InputError(f"There is no file '{path}'.")
    if path.suffix.lower() in ONLY_PLAIN and "MESH" in kinds:
        return [_plain_object(path, points="POINTCLOUD" in kinds)]
    kind = BY_ENDING.get(path.suffix.lower())
    if kind is None:
        raise FileFormatError(f"'{path.name}' is not a kind of file that can be read ({', '.join(READABLE)}).")
    bpy.ops.wm.read_homefile(use_empty=True)
    try:
        with _quiet():
            # Absolute: Blender would look in the folder that the environment names, which may be another.
            outcome = _operator(kind, kind.reader)(filepath=str(path.absolute()), **kind.reading)
    except RuntimeError as error:  # how Blender's operators report their errors
        raise FileFormatError(f"'{path.name}' cannot be read: {_first_line(error)}.") from error
    found = [candidate for candidate in bpy.context.scene.objects if candidate.type in kinds]
    if outcome == {"CANCELLED"} or not found:
        raise InputError(f"'{path.name}' holds no {wanted}.")
    return sorted(found, key=lambda one: one.name)


def named(objects: Sequence[Object], name: str | None) -> list[Object]:
    """Return the object of this name alone, or all of them where no name is given.

    Raises
    ------
    InputError
        When the file has no such object.
    """
    found = [candidate for candidate in objects if name in (None, candidate.name)]
    if not found:
        there = ", ".join(f"'{candidate.name}'" for candidate in objects)
        raise InputError(f"The file has no mesh '{name}', only {there}.")
    return found


def write_meshes(
    path: Path,
    objects: Sequence[Object],
    error_colours: str = "replace",
    models: Sequence[Object] = (),
    source: Path | None = None,
) -> None:
    """Write these objects, or for a .blend file everything, into a file; it appears when it is complete.

    Parameters
    ----------
    error_colours
        One of `ERROR_COLOURS`.
    models
        Objects whose names and places in the hierarchy these have in the file, if each has one.
    source
        The file that these have the triangles of, whose marks on them they keep (see `stl`).

    Raises
    ------
    FileFormatError
        When the ending names no kind of file that can be written.
    OSError
        When the folder cannot be written.
    """
    if path.suffix.lower() in ONLY_PLAIN:
        write_plain(path, _joined(objects))
        return
    kind = BY_ENDING.get(path.suffix.lower())
    if kind is None or kind.writer is None:
        raise FileFormatError(f"'{path.name}' is not a kind of file that can be written ({', '.join(WRITABLE)}).")
    bpy.context.view_layer.update()
    chosen = {*objects, *(placing(objects) if kind.parents else ())}
    for other in bpy.context.view_layer.objects:
        other.select_set(other in chosen)
    drafted = atomic_output(path, silent_writer=True, beside=kind.beside)
    with standing_in(objects, models), drafted as draft, colours_chosen(objects, error_colours, kind):
        try:
            with _quiet():
                _operator(kind, (kind.writer,))(filepath=str(draft), **kind.writing)
        except RuntimeError as error:
            raise OSError(_first_line(error)) from error
        shift = next((np.array(each[SHIFT]) for each in objects if SHIFT in each), None)
        if shift is not None:
            give_back_shift(draft, path.suffix.lower(), shift)
        carry_marks(source, draft)


def _plain_object(path: Path, points: bool) -> Object:
    found = read_plain(path, points=points)
    bpy.ops.wm.read_homefile(use_empty=True)
    made = bpy.data.objects.new(path.stem, create_mesh(path.stem, found.vertices, found.corners, found.sizes))
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    return made


def _joined(objects: Sequence[Object]) -> PlainMesh:
    """Return objects as one mesh in the world, with their errors."""
    bpy.context.view_layer.update()
    points = [to_world(each, read_positions(each.data)) + np.array(each.get(SHIFT, (0.0,) * 3)) for each in objects]
    corners, sizes = zip(*(read_polygons(each.data) for each in objects), strict=True)
    starts = np.cumsum([0, *map(len, points[:-1])])
    joined = np.concatenate([own + start for own, start in zip(corners, starts, strict=True)])
    whole = all(ERROR in each.data.attributes for each in objects)
    values = {ERROR: np.concatenate([read(each.data, ERROR) for each in objects])} if whole else {}
    return PlainMesh(np.concatenate(points), joined, np.concatenate(sizes), values)


def _quiet() -> contextlib.redirect_stdout[io.StringIO]:
    """Keep Blender's reports to itself: it calls what it cannot find beside a mesh an error, and all is well."""
    return contextlib.redirect_stdout(io.StringIO())


def _operator(kind: Format, names: Sequence[str]) -> Any:
    """Return the first of these operators that this Blender has; an add-on of Blender's may bring the last."""
    *built_in, last = names
    chosen = next((name for name in built_in if _is_there(name)), last)
    if chosen == last and kind.add_on:
        import addon_utils  # its folder is on Python's path only once bpy is loaded

        addon_utils.enable(kind.add_on)
    space, _, operator = chosen.partition(".")
    return getattr(getattr(bpy.ops, space), operator)


def _is_there(name: str) -> bool:
    space, _, operator = name.partition(".")
    return operator in dir(getattr(bpy.ops, space))


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if lines and "Traceback" in lines[0]:  # an exporter in Python: what it says comes last
        lines = [line for line in lines if not line.startswith("Location:")][::-1]
    return (lines[0] if lines else type(error).__name__).removeprefix("Error: ").rstrip(".")
