"""Meshes as other libraries have them: trimesh, PyVista, Open3D, meshio, and files; read, and given back as they came.

No library is imported but the one that a given object comes from, or that is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

Faces = ArrayLike | Sequence[Sequence[int]]
KINDS = ("arrays", "trimesh", "pyvista", "open3d", "meshio")
"""What `Given.back` makes of a mesh."""

POLYGONS = {"triangle": 3, "quad": 4}
"""Cells of meshio that are faces, with their corners; "polygon" may have any number."""


@dataclass(frozen=True)
class Given:
    """A mesh as it was given.

    Attributes
    ----------
    vertices, faces
        (V, 3), and (F, n) or a list of polygons.
    kind
        One of `KINDS`.
    """

    vertices: ArrayLike
    faces: Faces
    kind: str = "arrays"

    def back(self, vertices: NDArray[Any], kind: str | None = None) -> Any:
        """Return the mesh with other vertices (V, 3), as `kind`; as it was given where None.

        Raises
        ------
        InputError
            When there is no such kind, or the library is not installed.
        """
        kind = kind or self.kind
        if kind not in KINDS:
            raise InputError(f"A mesh is given back as {', '.join(KINDS)}, but not as {kind!r}.")
        return (vertices, self.faces) if kind == "arrays" else _MAKERS[kind](np.asarray(vertices), self.faces)


def given_mesh(mesh: Any, faces: Faces | None = None) -> Given:
    """Take vertices and faces as they are, or find them in the mesh of another library, a pair or a file.

    Raises
    ------
    InputError
        When the mesh is of a kind that is not known, has no faces, or its file cannot be read.
    """
    if faces is not None:
        return Given(mesh, faces)
    if isinstance(mesh, (str, os.PathLike)):
        return _from_file(Path(mesh))
    if isinstance(mesh, tuple) and len(mesh) == 2:
        return Given(*mesh)
    library = type(mesh).__module__.partition(".")[0]
    if library not in _READERS:
        raise InputError(
            f"Faces are missing: give vertices and faces, a mesh of {', '.join(KINDS[1:])}, or a file, "
            f"not {type(mesh).__name__!r} alone."
        )
    return _READERS[library](mesh)


def _from_file(path: Path) -> Given:
    if not path.is_file():
        raise InputError(f"There is no file '{path}'.")
    for library in ("trimesh", "meshio"):
        try:
            module = import_module(library)
        except ImportError:
            continue
        try:
            found = module.load_mesh(path, process=False) if library == "trimesh" else module.read(path)
        except Exception as error:  # these libraries raise anything
            text = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"'{path.name}' cannot be read: {text[:200]}.") from None
        return _READERS[library](found)
    raise InputError('Reading files takes trimesh or meshio: pip install "sparse-surface[io]".')


def _of_trimesh(mesh: Any) -> Given:
    if not hasattr(mesh, "faces"):
        raise InputError(f"A {type(mesh).__name__} of trimesh has no faces; give a Trimesh.")
    return Given(np.array(mesh.vertices), np.array(mesh.faces), "trimesh")


def _of_pyvista(mesh: Any) -> Given:
    surface = mesh if hasattr(mesh, "regular_faces") else mesh.extract_surface()
    if surface.is_all_triangles:
        return Given(np.array(surface.points), np.array(surface.regular_faces), "pyvista")
    cells, faces, place = np.asarray(surface.faces), [], 0
    while place < len(cells):
        faces.append(cells[place + 1 : place + 1 + cells[place]].tolist())
        place += 1 + int(cells[place])
    return Given(np.array(surface.points), faces, "pyvista")


def _of_open3d(mesh: Any) -> Given:
    if hasattr(mesh, "vertex"):  # the newer of its two kinds of meshes
        return Given(mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy(), "open3d")
    return Given(np.array(mesh.vertices), np.array(mesh.triangles), "open3d")


def _of_meshio(mesh: Any) -> Given:
    blocks = [np.asarray(block.data).tolist() for block in mesh.cells if block.type in ("polygon", *POLYGONS)]
    faces = [face for block in blocks for face in block]
    if not faces:
        raise InputError("The mesh of meshio has no triangles, quads or polygons.")
    return Given(np.array(mesh.points)[:, :3], faces, "meshio")


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise InputError(f"{name} is not installed: pip install {name}.") from None


def _rows(faces: Any) -> list[list[int]]:
    """Faces as lists of whole numbers."""
    return faces.tolist() if isinstance(faces, np.ndarray) else [[int(corner) for corner in row] for row in faces]


def _triangles(faces: Faces, library: str) -> NDArray[np.int64]:
    rows = _rows(faces)
    if any(len(row) != 3 for row in rows):
        raise InputError(f"Meshes of {library} have triangles only; this one has other polygons too.")
    return np.asarray(rows, dtype=np.int64).reshape(-1, 3)


def _to_trimesh(vertices: NDArray[Any], faces: Faces) -> Any:
    return _library("trimesh").Trimesh(vertices, _triangles(faces, "trimesh"), process=False)


def _to_pyvista(vertices: NDArray[Any], faces: Faces) -> Any:
    cells = np.concatenate([np.zeros(0, dtype=np.int64), *([len(row), *row] for row in _rows(faces))])
    return _library("pyvista").PolyData(vertices, cells.astype(np.int64))


def _to_open3d(vertices: NDArray[Any], faces: Faces) -> Any:
    o3d = _library("open3d")
    rows = _triangles(faces, "open3d").astype(np.int32)
    points = o3d.utility.Vector3dVector(vertices.astype(np.float64))
    return o3d.geometry.TriangleMesh(points, o3d.utility.Vector3iVector(rows))


def _to_meshio(vertices: NDArray[Any], faces: Faces) -> Any:
    by_size: dict[int, list[list[int]]] = {}
    for face in _rows(faces):
        by_size.setdefault(len(face), []).append(face)
    names = {corners: name for name, corners in POLYGONS.items()}
    return _library("meshio").Mesh(vertices, [(names.get(n, "polygon"), np.array(rows)) for n, rows in by_size.items()])


_READERS: dict[str, Callable[[Any], Given]] = {
    "trimesh": _of_trimesh,
    "pyvista": _of_pyvista,
    "open3d": _of_open3d,
    "meshio": _of_meshio,
}
_MAKERS: dict[str, Callable[[NDArray[Any], Faces], Any]] = {
    "trimesh": _to_trimesh,
    "pyvista": _to_pyvista,
    "open3d": _to_open3d,
    "meshio": _to_meshio,
}
