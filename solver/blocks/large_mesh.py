"""A mesh that is only ever read in parts: its arrays may lie in files that are mapped into memory."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Indices, offsets_of, row_positions
from ..errors import InputError
from ..mesh.input_checks import LARGEST_COORDINATE, checked_edges, checked_faces
from ..patches.observations import checked_weights

ROWS_AT_ONCE = 1 << 16
"""Rows of an array that are read together."""


@dataclass(frozen=True, eq=False)
class LargeMesh:
    """V vertices and F polygons.

    Attributes
    ----------
    positions
        (V, 3), of any floating-point type.
    corners
        Vertices of the polygons: one polygon after the other, (C,), or a row for each, (F, size).
    offsets
        Where each polygon's corners begin, (F + 1,); None where all have `size` corners.
    size
        Corners of each polygon; 0 where they differ.
    weights
        Weight of each vertex in [0, 1], (V,); None for ones.
    sharp_edges
        Edges that are marked as sharp, pairs of vertices (n, 2).
    """

    positions: NDArray[np.floating[Any]]
    corners: NDArray[np.integer[Any]]
    offsets: Indices | None
    size: int
    weights: Array | None
    sharp_edges: Indices

    @classmethod
    def of(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike | list[list[int]],
        weights: ArrayLike | None = None,
        sharp_edges: ArrayLike | None = None,
    ) -> LargeMesh:
        """Check a mesh part by part; arrays in files stay there.

        Raises
        ------
        InputError
            When it cannot be worked on, in one sentence.
        """
        positions = np.asanyarray(vertices)
        if positions.dtype.kind != "f":
            positions = np.asarray(positions, dtype=np.float64)
        if positions.ndim != 2 or positions.shape[1:] != (3,) or not len(positions):
            raise InputError(f"The vertices must be an array of three numbers each, not of shape {positions.shape}.")
        if isinstance(faces, np.ndarray) and faces.ndim == 2 and faces.dtype.kind in "iu" and len(faces):
            corners, offsets, size = faces, None, faces.shape[1]
        else:
            corners, offsets = checked_faces(faces, len(positions))
            size = 0
        if size and size < 3:
            raise InputError("Face 0 has fewer than three corners.")
        mesh = cls(
            positions,
            corners,
            offsets,
            size,
            checked_weights(weights, len(positions)),
            checked_edges(sharp_edges, len(positions)),
        )
        mesh._refuse_unusable()
        return mesh

    @property
    def face_count(self) -> int:
        """Number of polygons, F."""
        return len(self.corners) if self.offsets is None else len(self.offsets) - 1

    def corners_of(self, faces: Indices) -> tuple[Indices, Indices]:
        """Return the corners of some polygons, and the offsets of each of them in it."""
        if self.offsets is None:
            rows = self.corners[faces].astype(np.int64)
            return rows.reshape(-1), np.arange(len(faces) + 1) * self.size
        places, offsets = row_positions(self.offsets, faces)
        return self.corners[places].astype(np.int64), offsets

    def triangle_offsets(self) -> Indices | None:
        """Number of each polygon's first triangle, (F + 1,); None where polygons are triangles."""
        if self.offsets is None:
            kinds = np.int8 if self.size <= np.iinfo(np.int8).max else np.int64
            repeats = np.empty(len(self.corners), dtype=kinds)
            for first, part in numbered_parts(self.corners):
                repeats[first : first + len(part)] = (part == np.roll(part, 1, axis=1)).sum(axis=1)
            if self.size == 3 and not repeats.any():
                return None
            return offsets_of(np.maximum(self.size - 2 - repeats, 0))
        previous = np.roll(self.corners, 1)
        previous[self.offsets[:-1]] = self.corners[self.offsets[1:] - 1]
        kept = (self.corners != previous).astype(np.int64)
        return offsets_of(np.maximum(np.add.reduceat(kept, self.offsets[:-1]) - 2, 0))

    @property
    def triangle_count(self) -> int:
        """Number of triangles that the polygons have."""
        offsets = self.triangle_offsets()
        return self.face_count if offsets is None else int(offsets[-1])

    def fingerprint(self) -> str:
        """Return a number for the mesh, the same for the same arrays."""
        digest = hashlib.sha256()
        for array in (self.positions, self.corners, self.offsets, self.weights, self.sharp_edges):
            if array is not None:
                digest.update(f"{array.dtype.str}{array.shape}".encode())
                for part in parts_of(array):
                    digest.update(np.ascontiguousarray(part).data)
        return digest.hexdigest()

    def _refuse_unusable(self) -> None:
        first = 0
        for part in parts_of(self.positions):
            wrong = ~np.isfinite(part).all(axis=1)
            if wrong.any():
                raise InputError(
                    f"Vertex {first + int(np.argmax(wrong))} has a coordinate that is not a finite number."
                )
            if np.abs(part).max() > LARGEST_COORDINATE:
                raise InputError(f"The coordinates are too large to be computed with (beyond {LARGEST_COORDINATE:g}).")
            first += len(part)
        for part in parts_of(self.corners):
            low, high = int(part.min()), int(part.max())
            if low < 0 or high >= len(self.positions):
                raise InputError(
                    f"A face names vertex {low if low < 0 else high}, "
                    f"but the vertices are numbered from 0 to {len(self.positions) - 1}."
                )


def parts_of(array: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield runs of an array's rows."""
    for _, part in numbered_parts(array):
        yield part


def numbered_parts(array: NDArray[Any]) -> Iterator[tuple[int, NDArray[Any]]]:
    """Yield runs of an array's rows, each with the number of its first."""
    for start in range(0, len(array), ROWS_AT_ONCE):
        yield start, array[start : start + ROWS_AT_ONCE]


def narrow_type(largest: int) -> type[np.int32] | type[np.int64]:
    """The smaller type of whole numbers that holds all up to the largest."""
    return np.int32 if largest <= np.iinfo(np.int32).max else np.int64
