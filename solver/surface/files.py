"""Representations as files: which arrays there are, how small they are stored, and what is checked when they are read.

Reading trusts nothing: contents are checked before they are used, and a cut, foreign, newer or forged file is refused
in one sentence and never evaluated.  The format is described in docs/representation.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import IO, Any

import numpy as np

from ..arrays import Array, Indices, rows_in_order
from ..fitting.dictionary import Dictionary
from ..settings import Settings
from .container import INDICES, REAL, Arrays, Format, Layer, demand, pack, refusing, smallest_indices, unpack

HARMLESS = 2e-7
"""Move of the surface, in longest sides, up to which domains are stored in single precision."""

LARGEST_VALUES = {
    "vertices": 1e60,
    "domains": 1e4,
    "initial_domains": 1e4,
    "weights": 2.0,
    "origins": 1e60,
    "scales": 1e60,
    "coefficients": 1e60,
}
"""Beyond these a forged file could make evaluation overflow; what is fitted stays far below."""

LAYERS = {
    "vertices": Layer(("vertices", 3), REAL),
    "triangles": Layer(("triangles", 3), INDICES),
    "polygon": Layer(("triangles",), INDICES),
    "face_offsets": Layer(("faces + 1",), INDICES),
    "face_corners": Layer(("face corners",), INDICES),
    "vertex_offsets": Layer(("patches + 1",), INDICES),
    "patch_vertices": Layer(("patch vertices",), INDICES),
    "triangle_offsets": Layer(("patches + 1",), INDICES),
    "patch_triangles": Layer(("patch triangles", 3), INDICES),
    "mesh_triangles": Layer(("patch triangles",), INDICES),
    "domains": Layer(("domains", "patch vertices", 2), REAL),
    "initial_domains": Layer(("domains", "patch vertices", 2), REAL),
    "weights": Layer(("patch vertices",), REAL),
    "origins": Layer(("patches", 3), REAL),
    "scales": Layer(("patches", "domains"), REAL),
    "support": Layer(("patches", 3, "functions"), ("<i2",)),
    "coefficients": Layer(("patches", 3, "functions"), REAL),
    "energy": Layer(("patches", "iterations"), REAL),
}
"""The arrays of a file, with the names of the fields of `Representation`."""

FORMAT = Format(
    "sparse surface representation",
    1,
    "a saved representation of Sparse Surface",
    frozenset({"blending", "basis", "degree"}),
    LAYERS,
)


def to_bytes(head: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Return the fields of a representation as the content of a file, in small types that hold the same.

    Parameters
    ----------
    head
        Its `blending`, `basis` and `degree`.
    arrays
        All others; `domains` in the precision in which they are stored.
    """
    stored: Arrays = {}
    for name, layer in LAYERS.items():
        array = smallest_indices(arrays[name]) if layer.types == INDICES else arrays[name]
        stored[name] = np.ascontiguousarray(array)
    stored["support"] = stored["support"].astype("<i2")
    for name in ("initial_domains", "energy"):  # nothing is evaluated with them
        stored[name] = stored[name].astype("<f4")
    if _is_single(stored["vertices"]):
        stored["vertices"] = stored["vertices"].astype("<f4")
    little = {name: array.astype(array.dtype.newbyteorder("<"), copy=False) for name, array in stored.items()}
    return pack(FORMAT, head, little)


def _is_single(values: Array) -> bool:
    """Whether the values came from single precision."""
    with np.errstate(over="ignore"):
        return bool((values.astype(np.float32) == values).all())


def from_file(file: IO[bytes], name: str) -> dict[str, Any]:
    """Return the fields of a representation when all of its contents make sense together.

    Raises
    ------
    FileFormatError
        When the file is cut, damaged, newer than this version, or something else; `name` begins the sentence.
    """
    head, stored, sizes = unpack(FORMAT, file, name)
    with refusing(name):
        demand(sizes["patches + 1"] == sizes["patches"] + 1, "the numbers of patches differ")
        demand(sizes["domains"] in (1, 3), f"it has {sizes['domains']} domains for each patch")
        demand(head["blending"] in ("partition", "uniform"), "its blending is unknown")
        demand(head["basis"] in ("legendre", "monomial"), "its basis is unknown")
        degree, most = head["degree"], Settings.__dataclass_fields__["degree"].metadata["high"]
        demand(type(degree) is int and 0 <= degree <= most, f"its degree is not a whole number from 0 to {most}")
        arrays = {
            name: array.astype(np.float64 if LAYERS[name].types == REAL else np.int64) for name, array in stored.items()
        }
        _check_mesh(arrays)
        _check_patches(arrays)
        _check_functions(arrays, Dictionary(degree, head["basis"]).size)
    return {**head, **arrays}


def _check_mesh(arrays: Arrays) -> None:
    _check_offsets(arrays, "face_offsets", "face_corners")
    for name, end in (("face_corners", "vertices"), ("triangles", "vertices")):
        _check_range(arrays, name, len(arrays[end]))
    _check_range(arrays, "polygon", len(arrays["face_offsets"]) - 1)


def _check_patches(arrays: Arrays) -> None:
    _check_offsets(arrays, "vertex_offsets", "patch_vertices")
    _check_offsets(arrays, "triangle_offsets", "patch_triangles")
    _check_range(arrays, "patch_vertices", len(arrays["vertices"]))
    _check_range(arrays, "mesh_triangles", len(arrays["triangles"]))
    counts, first = np.diff(arrays["triangle_offsets"]), arrays["vertex_offsets"][:-1]
    local = arrays["patch_triangles"]
    sizes = np.repeat(np.diff(arrays["vertex_offsets"]), counts)
    demand((local < sizes[:, None]).all(), "a patch's triangle names a vertex that it does not have")
    corners = local + np.repeat(first, counts)[:, None]
    wanted = arrays["triangles"][arrays["mesh_triangles"]]
    names = arrays["patch_vertices"]
    demand(
        (names[rows_in_order(corners, names[corners], wanted)] == wanted).all(),
        "a patch's triangle is not that of the mesh",
    )
    patch = np.repeat(np.arange(len(counts)), counts)
    twice = np.unique(patch * max(len(arrays["triangles"]), 1) + arrays["mesh_triangles"])
    demand(len(twice) == len(patch), "a patch holds a triangle twice")


def _check_functions(arrays: Arrays, functions: int) -> None:
    for name, largest in LARGEST_VALUES.items():
        demand((np.abs(arrays[name]) <= largest).all(), f"a value of {name} is too large or not finite")
    demand((arrays["weights"] >= 0.0).all(), "a weight is negative")
    demand((arrays["scales"] >= 1.0 / LARGEST_VALUES["scales"]).all(), "a scale is too small")
    demand(not np.isinf(arrays["energy"]).any(), "an energy is infinite")
    support = arrays["support"]
    demand((support >= -1).all() and (support < functions).all(), "a function is not in its dictionary")


def _check_offsets(arrays: Arrays, name: str, what: str) -> None:
    offsets: Indices = arrays[name]
    demand(len(offsets) > 0 and offsets[0] == 0 and offsets[-1] == len(arrays[what]), f"{name} does not span its array")
    demand((np.diff(offsets) >= 0).all(), f"{name} does not ascend")


def _check_range(arrays: Arrays, name: str, end: int) -> None:
    # 64-bit unsigned numbers cannot occur, so nothing below is a wrapped one
    indices: Indices = arrays[name]
    demand(indices.min(initial=0) >= 0 and indices.max(initial=-1) < end, f"{name} names what is not there")
