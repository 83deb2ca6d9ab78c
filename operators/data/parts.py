"""Objects that are parts of one surface, read as one: those in one frame whose open borders lie on each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from bpy.types import Depsgraph, Object
from numpy.typing import NDArray

from ...solver.approximation.parts import joined
from ...solver.errors import SparseSurfaceError
from ...solver.interchange import MeshArrays
from ...solver.settings import Settings
from .meshes import Source, WorldLengths, read_object
from .result_keys import PART, SHARED, cut_name, store_representation
from .results import store_stretch


@dataclass(frozen=True)
class Parts:
    """Several sources as one.

    Attributes
    ----------
    parts
        The sources, at least two.
    arrays
        All of their meshes, one after the other.
    """

    parts: tuple[Source, ...]
    arrays: MeshArrays

    @classmethod
    def of(cls, parts: Sequence[Source]) -> Parts:
        """Take sources in one frame."""
        return cls(tuple(parts), joined([each.arrays for each in parts]))

    @property
    def name(self) -> str:
        """The names of all."""
        return " + ".join(each.name for each in self.parts)

    @property
    def session_uid(self) -> int:
        """That of the first, which stands where all do."""
        return self.parts[0].session_uid

    @property
    def lengths(self) -> WorldLengths:
        """Those of each."""
        return self.parts[0].lengths


def of_parts(source: Source | Parts, values: NDArray[Any]) -> list[tuple[Source, NDArray[Any]]]:
    """Return the sources that were read as one, each with its rows of some values of the vertices, (V, ...)."""
    if isinstance(source, Source):
        return [(source, values)]
    ends = np.cumsum([len(each.arrays.vertices) for each in source.parts])[:-1]
    return list(zip(source.parts, np.split(values, ends), strict=True))


def share_functions(made: Sequence[Object | None], sources: Sequence[Source], draft: bytes) -> None:
    """Keep the representation of a surface once for the results that are its parts.

    Parameters
    ----------
    made, sources
        The result of each part, None where there is none, and what it was made from.
    draft
        The representation.
    """
    parts = [each for each in made if each is not None]
    if not parts:
        return
    shared = bpy.data.meshes.new(cut_name(parts[0].name, " Functions"))
    store_representation(shared, draft)
    faces = loose = 0
    for part, each in zip(sources, made, strict=True):
        if each is not None:
            each[SHARED], each[PART] = shared, [faces, loose]
            store_stretch(each, part.lengths)
        faces += len(part.arrays.sizes)
        loose += len(part.arrays.vertices) - len(np.unique(part.arrays.corners))


def read_together(
    chosen: Sequence[Object], depsgraph: Depsgraph, settings: Settings | None, **how: Any
) -> tuple[list[Source | Parts], list[tuple[str, SparseSurfaceError]]]:
    """Read objects, with settings those together that are parts of one surface.

    Parameters
    ----------
    how
        See `read_object`.

    Returns
    -------
    sources, refused
        In the order of the objects, and for each that is refused its name and why.
    """
    reads: list[Source] = []
    placed, refused = [], []
    for each in chosen:
        try:
            reads.append(read_object(each, depsgraph, **how))
            placed.append(each)
        except SparseSurfaceError as error:
            refused.append((each.name, error))
    if settings is None:
        return list(reads), refused
    groups = groups_in_frames(placed, reads, settings)
    return [reads[own[0]] if len(own) == 1 else Parts.of([reads[n] for n in own]) for own in groups], refused


def groups_in_frames(placed: Sequence[Object], reads: Sequence[Source | None], settings: Settings) -> list[list[int]]:
    """Return the numbers of objects, those together that are parts of one surface.

    What could not be read, None, or would be refused stands alone.
    """
    frames: dict[Any, list[int]] = {}
    arrays = {number: read.arrays for number, read in enumerate(reads) if read is not None}
    for number, each in enumerate(placed):
        frame: Any = tuple(map(tuple, each.matrix_world)) if number in arrays else number
        frames.setdefault(frame, []).append(number)
    groups: list[list[int]] = []
    for inside in frames.values():
        if len(inside) == 1:
            groups.append(inside)
            continue
        from ...solver.approximation.shared_borders import groups_of_parts  # SciPy

        found = groups_of_parts([arrays[number] for number in inside], settings)
        groups += [[inside[each] for each in group] for group in found]
    return sorted(groups)
