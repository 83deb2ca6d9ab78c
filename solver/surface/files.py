"""Representations as files: written in format 3 (docs/format.md), read in formats 1 and 2 too.

Reading trusts nothing: contents are checked before they are used, and a cut, foreign, newer or forged file is refused
in one sentence and never evaluated.
"""

from __future__ import annotations

from typing import IO, Any

import numpy as np

from ..arrays import Indices, rows_in_order
from ..errors import InputError
from ..fitting.dictionary import Dictionary
from ..patches.parameterisation import METHODS
from ..settings import Settings
from .container import INDICES, REAL, Arrays, Format, Layer, demand, pack, refusing, unpack
from .format.blocks import BlockReader
from .format.canonical import QUALITIES
from .format.content import SMALL, Sizes
from .format.reading import read
from .format.writing import write

LARGEST_VALUES = {
    "vertices": 1e60,
    "domains": 1e4,
    "initial_domains": 1e4,
    "weights": 2.0,
    "origins": 1e60,
    "scales": 1e60,
    "coefficients": 1e12,
}
"""Beyond these a forged file could make evaluation overflow; what is fitted stays far below."""

FARTHEST = 1e37
"""No point of a surface lies farther from the origin: meshes hold single precision."""

MOST_DERIVED = 10
"""Bytes that evaluation may take for each byte of the arrays of a file of format 1."""

LARGEST_DEGREE: int = Settings.__dataclass_fields__["degree"].metadata["high"]

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
"""The arrays of format 1, with the names of the fields of `Representation`."""

NAME, NOUN = "sparse surface representation", "a saved representation of Sparse Surface"
FORMAT_1 = Format(NAME, 1, NOUN, frozenset({"blending", "basis", "degree"}), LAYERS)
_KEYS = frozenset({"blending", "basis", "degree", "initial", "quality", "error", "sizes"})
_BLOCKS = {"data": Layer(("bytes",), ("|u1",))}
FORMAT_2 = Format(NAME, 2, NOUN, _KEYS, _BLOCKS)
FORMAT = Format(NAME, 3, NOUN, _KEYS, _BLOCKS)
"""As format 2, whose programs do not know walks and would take nodes between creases for missing."""

FORMATS = {kind.version: kind for kind in (FORMAT_1, FORMAT_2, FORMAT)}


def to_bytes(surface: Any, quality: str) -> bytes:
    """Return a representation as the content of a file; the same bytes for the same representation.

    Parameters
    ----------
    surface
        The representation.
    quality
        One of `QUALITIES`.
    """
    if quality not in QUALITIES:
        raise InputError(f"A representation is saved as {', '.join(QUALITIES)}, but not as {quality!r}.")
    written = write(surface, QUALITIES[quality])
    head = {
        "blending": surface.blending,
        "basis": surface.basis,
        "degree": surface.degree,
        "initial": surface.initial,
        "quality": quality,
        "error": float(f"{written.error:.2g}"),
        "sizes": written.sizes.stated(),
    }
    return pack(FORMAT, head, {"data": np.frombuffer(written.blocks.content(), dtype=np.uint8)})


def from_file(file: IO[bytes], name: str) -> dict[str, Any]:
    """Return the fields of a representation when all of its contents make sense together.

    `initial_domains` is missing where it is to be found again.

    Raises
    ------
    FileFormatError
        When the file is cut, damaged, newer than this version, or something else; `name` begins the sentence.
    """
    version, head, stored, sizes = unpack(FORMATS, file, name)
    with refusing(name):
        demand(head["blending"] in ("partition", "uniform"), "its blending is unknown")
        demand(head["basis"] in ("legendre", "monomial"), "its basis is unknown")
        degree, most = head["degree"], LARGEST_DEGREE
        demand(type(degree) is int and 0 <= degree <= most, f"its degree is not a whole number from 0 to {most}")
        fields = {key: head[key] for key in FORMAT_1.keys} | {"creases": np.zeros((0, 2), dtype=np.int64)}
        if version == 1:
            return {**fields, **_fields_of_format_1(stored, sizes, degree, Dictionary(degree, head["basis"]).size)}
        demand(head["initial"] in ("", *METHODS), "its initial domains are unknown")
        content = stored["data"].tobytes()
        fields |= read(head, Sizes.read(head["sizes"], degree, len(content)), BlockReader(content))
        demand(bool(head["initial"]) != ("initial_domains" in fields), "it lacks its initial domains")
        _check_functions(fields, Dictionary(degree, head["basis"]).size)
        return {**fields, "initial": head["initial"]}


def _fields_of_format_1(stored: Arrays, sizes: dict[str, int], degree: int, functions: int) -> dict[str, Any]:
    demand(sizes["patches + 1"] == sizes["patches"] + 1, "the numbers of patches differ")
    demand(sizes["domains"] in (1, 3), f"it has {sizes['domains']} domains for each patch")
    demand(sizes["triangles"] > 0, "it has no faces")
    derived = Sizes(
        vertices=sizes["vertices"],
        faces=sizes["faces + 1"],
        face_corners=sizes["face corners"],
        triangles=sizes["triangles"],
        nodes=sizes["vertices"],
        patches=sizes["patches"],
        patch_vertices=sizes["patch vertices"],
        patch_triangles=sizes["patch triangles"],
        domains=sizes["domains"],
        functions=sizes["functions"],
        iterations=sizes["iterations"],
    )
    held = sum(array.nbytes for array in stored.values())
    demand(derived.memory(degree) <= SMALL + MOST_DERIVED * held, "evaluating it would fill the memory")
    arrays = {
        name: array.astype(np.float64 if LAYERS[name].types == REAL else np.int64) for name, array in stored.items()
    }
    _check_mesh(arrays)
    _check_patches(arrays)
    _check_functions(arrays, functions)
    return arrays


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
    for name in LARGEST_VALUES.keys() & arrays.keys():
        largest = LARGEST_VALUES[name]
        demand((np.abs(arrays[name]) <= largest).all(), f"a value of {name} is too large or not finite")
    demand((arrays["weights"] >= 0.0).all(), "a weight is negative")
    demand((arrays["scales"] >= 1.0 / LARGEST_VALUES["scales"]).all(), "a scale is too small")
    demand(not np.isinf(arrays["energy"]).any(), "an energy is infinite")
    _check_reach(arrays)
    support = arrays["support"]
    demand((support >= -1).all() and (support < functions).all(), "a function is not in its dictionary")


def _check_reach(arrays: Arrays) -> None:
    """Refuse functions that could leave the numbers that meshes have."""
    scales = np.broadcast_to(arrays["scales"], (len(arrays["scales"]), 3))
    widest = max(1.0, 2.0 * float(np.abs(arrays["domains"]).max(initial=0.0)))
    with np.errstate(over="ignore"):
        reach = np.abs(arrays["coefficients"]).sum(axis=2) / scales + np.abs(arrays["origins"])
        demand((reach <= FARTHEST).all(), "a patch reaches too far away")
        demand(np.log10(widest) * LARGEST_DEGREE + np.log10(reach.max(initial=1.0)) < 300.0, "a domain is too large")


def _check_offsets(arrays: Arrays, name: str, what: str) -> None:
    offsets: Indices = arrays[name]
    demand(len(offsets) > 0 and offsets[0] == 0 and offsets[-1] == len(arrays[what]), f"{name} does not span its array")
    demand((np.diff(offsets) >= 0).all(), f"{name} does not ascend")


def _check_range(arrays: Arrays, name: str, end: int) -> None:
    # 64-bit unsigned numbers cannot occur, so nothing below is a wrapped one
    indices: Indices = arrays[name]
    demand(indices.min(initial=0) >= 0 and indices.max(initial=-1) < end, f"{name} names what is not there")
