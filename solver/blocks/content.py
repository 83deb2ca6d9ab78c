"""What is known of a solved block, as the content of a file."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Indices
from ..surface.container import INDICES, REAL, Format, Layer, pack, unpack
from ..surface.representation import Representation
from ..surface.spread import Spread
from .turning import Turning

NUMBERS = ("<i2", *INDICES)

_SURFACE = {
    "vertices": Layer(("places", 3), REAL),
    "triangles": Layer(("triangles", 3), NUMBERS),
    "polygon": Layer(("triangles",), NUMBERS),
    "vertex_offsets": Layer(("patches + 1",), INDICES),
    "patch_vertices": Layer(("patch vertices",), NUMBERS),
    "triangle_offsets": Layer(("patches + 1",), INDICES),
    "patch_triangles": Layer(("patch triangles", 3), INDICES),
    "mesh_triangles": Layer(("patch triangles",), NUMBERS),
    "domains": Layer(("domains", "patch vertices", 2), REAL),
    "weights": Layer(("patch vertices",), REAL),
    "origins": Layer(("patches", 3), REAL),
    "scales": Layer(("patches", "domains"), REAL),
    "support": Layer(("patches", 3, "functions"), NUMBERS),
    "coefficients": Layer(("patches", 3, "functions"), REAL),
    "creases": Layer(("creases", 2), INDICES),
}
"""The fields of a representation that evaluate it."""

_CLIMBING = ("triangles", "polygon", "patch_vertices", "mesh_triangles")
"""Fields that are stored as differences between rows, which are small."""

_BLOCK = {
    "share": Layer(("vertices",), REAL),
    "points": Layer(("vertices", 3), REAL),
    "patch": Layer(("vertices",), NUMBERS),
    "piece": Layer(("vertices",), NUMBERS),
    "blended": Layer(("blended",), INDICES),
    "parts": Layer(("blended", "samples", 3), REAL),
    "marked": Layer(("marked", 2), INDICES),
    "text": Layer(("characters",), ("|u1",)),
}

BLOCK = Format(
    name="sparse_surface_block",
    version=2,
    noun="a block of a Sparse Surface job",
    keys=frozenset(("basis", "blending", "degree", "solver")),
    layers={**_SURFACE, **_BLOCK},
)


@dataclass(frozen=True, eq=False)
class MeasuredBlock:
    """What is known of a solved block beside its functions: its part has n vertices and t triangles.

    Attributes
    ----------
    share
        The block's share at the vertices, (n,).
    points
        Its surface at the vertices, (n, 3), of the input's type.
    patch, piece
        Patch of the largest weight, -1 where the input passes through, and connected component, (n,).
    blended
        Triangles of the part that share some point with another block, (b,).
    parts
        The block's part of S(x) - x at `MEASURED_SAMPLES` of them, (b, 6, 3), float32.
    marked
        Edges to mark as sharp, pairs of vertices of the part, (E, 2).
    between
        Distances in the triangles of the block alone.
    turning
        How far the normals of the faces of the block alone turn.
    report
        Its report.
    triangles, polygon
        Vertices of the part's triangles, (t, 3), and the face of the part that each lies in, (t,).
    patches
        How many it has.
    """

    share: Array
    points: NDArray[np.floating[Any]]
    patch: Indices
    piece: Indices
    blended: Indices
    parts: NDArray[np.float32]
    marked: Indices
    between: Spread
    turning: Turning
    report: dict[str, Any]
    triangles: Indices
    polygon: Indices
    patches: int

    @classmethod
    def read(cls, file: IO[bytes], name: str) -> Self:
        """Read the file of a block, without its functions.

        Raises
        ------
        FileFormatError
            When it is damaged; `name` begins the sentence.
        """
        _, _, arrays, sizes = unpack({BLOCK.version: BLOCK}, file, name, (*_BLOCK, "triangles", "polygon"))
        return cls(**_measures(arrays), **_wide(arrays, ("triangles", "polygon")), patches=sizes["patches"])


@dataclass(frozen=True, eq=False)
class SolvedBlock(MeasuredBlock):
    """A block's own surface over its part, and its measures.

    Attributes
    ----------
    surface
        Without initial domains, energies and polygons.
    """

    surface: Representation

    def to_bytes(self) -> bytes:
        """Return the content of a file; the same bytes for the same block."""
        text = json.dumps({"between": self.between.as_list(), "turning": self.turning, "report": self.report}).encode()
        arrays = {name: getattr(self.surface, name) for name in _SURFACE}
        arrays |= {name: np.diff(arrays[name], axis=0, prepend=0) for name in _CLIMBING}
        arrays |= {name: getattr(self, name) for name in _BLOCK if name != "text"}
        arrays = {name: _narrow(array, name in _BLOCK) for name, array in arrays.items()}
        head = {name: getattr(self.surface, name) for name in sorted(BLOCK.keys)}
        return pack(BLOCK, head, {**arrays, "text": np.frombuffer(text, dtype=np.uint8)})

    @classmethod
    def read(cls, file: IO[bytes], name: str) -> Self:
        """Read the file of a block; raises as `MeasuredBlock.read` does."""
        _, head, arrays, _ = unpack({BLOCK.version: BLOCK}, file, name)
        surface = _surface(head, _wide(arrays, _SURFACE))
        return cls(
            **_measures(arrays),
            triangles=surface.triangles,
            polygon=surface.polygon,
            patches=surface.patches,
            surface=surface,
        )

    @classmethod
    def from_bytes(cls, data: bytes, name: str) -> Self:
        """Read what `to_bytes` returned; raises as `read` does."""
        return cls.read(io.BytesIO(data), name)


def sizes_in(file: IO[bytes], name: str) -> dict[str, int]:
    """How many vertices, triangles, blended triangles and so on the file of a block has; raises as `read` does."""
    return unpack({BLOCK.version: BLOCK}, file, name, ())[3]


def _measures(arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """The fields of a `MeasuredBlock` that are in the layers of `_BLOCK`."""
    text = json.loads(arrays["text"].tobytes())
    own: dict[str, Any] = {name: arrays[name] for name in _BLOCK if name != "text"}
    own |= {name: own[name].astype(np.int64) for name in ("patch", "piece", "blended", "marked")}
    between, turning = Spread.from_list(text["between"]), Turning(*text["turning"])
    return {**own, "between": between, "turning": turning, "report": text["report"]}


def _wide(arrays: dict[str, NDArray[Any]], names: Iterable[str]) -> dict[str, Any]:
    """Layers as they were before they were made narrow."""
    wide = {name: arrays[name].astype(np.float64 if arrays[name].dtype.kind == "f" else np.int64) for name in names}
    return {name: np.cumsum(array, axis=0) if name in _CLIMBING else array for name, array in wide.items()}


def _surface(head: dict[str, Any], wide: dict[str, Any]) -> Representation:
    nothing = np.zeros(0, dtype=np.int64)
    return Representation(
        **wide,
        **head,
        face_offsets=nothing,
        face_corners=nothing,
        initial_domains=np.zeros((len(wide["domains"]), 0, 2)),
        energy=np.zeros((len(wide["origins"]), 0)),
    )


def _narrow(array: NDArray[Any], as_is: bool) -> NDArray[Any]:
    """Return an array of the smallest type that holds it exactly."""
    if array.dtype.kind == "f":
        if not as_is and (short := array.astype(np.float32)).astype(array.dtype).tobytes() == array.tobytes():
            return short
        return array
    kinds = (np.uint16, np.int32, np.int64) if array.min(initial=0) >= 0 else (np.int16, np.int32, np.int64)
    largest = max(array.max(initial=0), -array.min(initial=0))
    return array.astype(next(kind for kind in kinds if largest <= np.iinfo(kind).max))
