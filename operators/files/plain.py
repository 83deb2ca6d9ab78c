"""Meshes read and written without Blender: arrays in .npz, and what optional packages read."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...solver.atomic_files import atomic_output
from ...solver.errors import FileFormatError, InputError
from ...solver.mesh.objects import given_mesh
from .formats import PLAIN, missing_library
from .stl import carry_marks

ARRAYS = ".npz"

_FACES = {"triangle": 3, "quad": 4, "polygon": 0}


@dataclass(frozen=True)
class PlainMesh:
    """A polygon mesh: positions (V, 3), corners (C,), corners of each face (F,), and values of the vertices by name."""

    vertices: NDArray[np.floating[Any]]
    corners: NDArray[np.integer[Any]]
    sizes: NDArray[np.integer[Any]]
    values: Mapping[str, Any] = field(default_factory=dict)

    def polygons(self) -> list[NDArray[np.integer[Any]]]:
        """Return the faces one by one."""
        return np.split(self.corners, np.cumsum(self.sizes)[:-1]) if len(self.sizes) else []


def read_plain(path: Path, *, points: bool = False) -> PlainMesh:
    """Read a file; with `points` it need not hold faces.

    Raises
    ------
    InputError
        When it is missing or holds no faces.
    FileFormatError
        When it is of another kind, or cannot be read.
    """
    if not path.is_file():
        raise InputError(f"There is no file '{path}'.")
    try:
        found = _read_arrays(path) if path.suffix.lower() == ARRAYS else _read_by_library(path)
    except FileFormatError:
        raise
    except Exception as error:  # whatever the reader stumbles over in a file that is not what its name says
        raise FileFormatError(f"'{path.name}' cannot be read: {_first_line(error)}.") from error
    if not len(found.sizes) and not (points and len(found.vertices)):
        raise InputError(f"'{path.name}' holds no mesh with faces.")
    return found


def write_plain(path: Path, mesh: PlainMesh, source: Path | None = None) -> None:
    """Write a file; it appears when it is complete.  It keeps what `source` says of the triangles (see `stl`).

    Raises
    ------
    FileFormatError
        When it is of a kind that cannot be written.
    OSError
        When the folder cannot be written.
    """
    if path.suffix.lower() == ARRAYS:
        with atomic_output(path) as draft, open(draft, "wb") as file:
            own: dict[str, Any] = {"vertices": mesh.vertices, "corners": mesh.corners, "sizes": mesh.sizes}
            np.savez_compressed(file, **own, **mesh.values)
        return
    library = _library(path)
    with atomic_output(path) as draft:
        try:
            _WRITERS[library.__name__](library, draft, mesh)
        except OSError:
            raise
        except Exception as error:  # these libraries raise anything
            raise FileFormatError(f"'{path.name}' cannot be written: {_first_line(error)}.") from error
        carry_marks(source, draft)


def _read_arrays(path: Path) -> PlainMesh:
    """Read `vertices` (V, 3) with `faces` (F, n), or with `corners` and `sizes`."""
    with np.load(path, allow_pickle=False) as stored:
        if "faces" in stored:
            faces = np.atleast_2d(stored["faces"])
            corners, sizes = faces.ravel(), np.full(len(faces), faces.shape[1])
        else:
            corners, sizes = stored["corners"], stored["sizes"]
        return PlainMesh(stored["vertices"], corners, sizes)


def _read_by_library(path: Path) -> PlainMesh:
    library = _library(path)
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)  # what a library complains of at length, one sentence says
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _READERS[library.__name__](library, path)
    finally:
        logging.disable(before)


def _read_by_meshio(_: Any, path: Path) -> PlainMesh:
    found = _meshio_format(path).read(path)
    blocks = [block for block in found.cells if block.type in _FACES and len(block.data)]
    rows = [np.asarray(row) for block in blocks for row in block.data]
    points = np.asarray(found.points, dtype=np.float64)
    if points.shape[1] == 2:  # flat meshes
        points = np.column_stack([points, np.zeros(len(points))])
    return _of_rows(points, rows, {name: np.asarray(array) for name, array in found.point_data.items()})


def _read_by_trimesh(trimesh: Any, path: Path) -> PlainMesh:
    """Read all meshes of a scene, where they stand, as one."""
    scene = trimesh.load_scene(path, process=False)
    meshes = [each for each in scene.dump() if len(getattr(each, "faces", ()))]
    starts = np.cumsum([0, *(len(each.vertices) for each in meshes)])
    rows = [row + start for each, start in zip(meshes, starts, strict=False) for row in np.asarray(each.faces)]
    return _of_rows(np.concatenate([np.zeros((0, 3)), *(each.vertices for each in meshes)]), rows)


def _read_by_pyvista(pyvista: Any, path: Path) -> PlainMesh:
    found = pyvista.read(path)
    given: Any = given_mesh(found)
    values = {name: np.asarray(found.point_data[name]) for name in found.point_data}
    return _of_rows(np.asarray(given.vertices), [np.asarray(face) for face in given.faces], values)


def _of_rows(points: Any, rows: list[NDArray[Any]], values: Mapping[str, Any] | None = None) -> PlainMesh:
    corners = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    return PlainMesh(points, corners, np.array([len(row) for row in rows], dtype=np.int64), values or {})


def _write_by_meshio(meshio: Any, path: Path, mesh: PlainMesh) -> None:
    ending = path.suffix.lower()
    how = {"binary": True} if ending == ".stl" else {}  # a fifth of the text's size, and as other programs write it
    _meshio_format(path).write(path, _for_meshio(meshio, mesh, ending), **how)


def _write_by_trimesh(trimesh: Any, path: Path, mesh: PlainMesh) -> None:
    points = np.asarray(mesh.vertices, dtype=np.float64)
    made = trimesh.Trimesh(points, _fans(mesh.polygons()), process=False)
    path.write_bytes(made.export(file_type=path.suffix.lower().removeprefix(".")))


def _write_by_pyvista(pyvista: Any, path: Path, mesh: PlainMesh) -> None:
    starts = np.cumsum(mesh.sizes) - mesh.sizes
    made = pyvista.PolyData(np.asarray(mesh.vertices), np.insert(mesh.corners, starts, mesh.sizes))
    for name, values in mesh.values.items():
        made.point_data[name] = values
    made.save(path)


def _for_meshio(meshio: Any, mesh: PlainMesh, ending: str) -> Any:
    """Return the mesh as meshio has it: a block for each run of faces with as many corners."""
    polygons, cells = mesh.polygons(), []
    change = np.flatnonzero(np.diff(mesh.sizes)) + 1
    names = {number: name for name, number in _FACES.items()}
    for first, end in zip([0, *change], [*change, len(polygons)], strict=True):
        cells.append((names.get(len(polygons[first]), "polygon"), np.stack(polygons[first:end])))
    if ending in (".stl", ".off"):  # formats of triangles
        cells = [("triangle", _fans(polygons))]
    values = {} if ending in (".stl", ".off", ".obj") else dict(mesh.values)
    return meshio.Mesh(np.asarray(mesh.vertices, dtype=np.float64), cells, point_data=values)


def _fans(polygons: list[NDArray[np.integer[Any]]]) -> NDArray[np.int64]:
    """Cut polygons into the triangles around their first corner."""
    triangles = [np.stack([np.full(len(p) - 2, p[0]), p[1:-1], p[2:]], axis=1) for p in polygons]
    return np.concatenate(triangles).astype(np.int64)


def _library(path: Path) -> Any:
    """Return the library for a kind of file."""
    name = PLAIN.get(path.suffix.lower())
    if not name:
        raise FileFormatError(f"'{path.name}' is not a kind of file that can be used here ({', '.join(PLAIN)}).")
    missing = missing_library(path)
    if missing:
        raise FileFormatError(missing)
    return import_module(name)  # imported where it is needed: it is an optional package


def _meshio_format(path: Path) -> Any:
    return import_module(f"meshio.{path.suffix.lower().removeprefix('.')}")


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")


_READERS = {"meshio": _read_by_meshio, "trimesh": _read_by_trimesh, "pyvista": _read_by_pyvista}
_WRITERS = {"meshio": _write_by_meshio, "trimesh": _write_by_trimesh, "pyvista": _write_by_pyvista}
