"""The command `approximate`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import bpy
import numpy as np
from bpy.types import Depsgraph, Object
from numpy.typing import NDArray

from ..operators.data import meshes as mesh_data
from ..operators.data.colours import ColourScale
from ..operators.data.parts import groups_in_frames, share_functions
from ..operators.data.report_text import one_line
from ..operators.data.results import create_result, create_unmeasured
from ..operators.files.meshes import named, read_meshes
from ..operators.representation.compacting import compact_drafts
from ..operators.representation.domain_maps import write_domain_maps
from ..solver.approximation.parts import joined, places_of_parts, taken_apart
from ..solver.approximation.result import Approximation
from ..solver.errors import InputError, SparseSurfaceError
from ..solver.job import approximate_arrays
from ..solver.progress import run_to_end
from .arguments import PROGRAM
from .console import console
from .outputs import Made, asked_for, is_scene, keeps_functions, write_outputs
from .progress import LastSurface, progress_display

UNMEASURED = "{}: There is not enough memory to measure the surface; '{}' has it, with nothing known of its errors."
"""Also where it was measured, but there is no memory for the measures and the functions."""


class Unmeasured(Exception):
    """The memory ended when the surface was finished; `made` has pairs of source and result."""

    def __init__(self, made: list[tuple[Object, Object]]) -> None:
        super().__init__()
        self.made = made


def run(options: argparse.Namespace) -> int:
    """Approximate each mesh of the file, then write what was asked for; a mesh that is refused does not stop the rest.

    Returns
    -------
    int
        Exit code: with `--strict` 1 where a mesh was refused.

    Raises
    ------
    SparseSurfaceError
        When nothing was made.
    """
    sources = named(read_meshes(options.input), options.object)
    made: list[Made] = []
    solved: dict[Any, Any] = {}
    refused, unmeasured = 0, []
    waiting = _together(options, sources)
    while waiting:
        together = waiting.pop(0)
        try:
            made += _approximated(options, together, solved)
        except SparseSurfaceError as error:
            if len(sources) == 1:
                raise
            if len(together) > 1:  # one of them may be to blame
                waiting[:0] = [[each] for each in together]
                continue
            refused += 1
            console.complain(f"{together[0].name}: {error}", PROGRAM)
        except Unmeasured as left:
            made += [Made(options.input, *pair, {}, None, **asked_for(options)) for pair in left.made]
            unmeasured.append(together[0].name)
    if not made:
        raise InputError(f"None of the {len(sources)} meshes of '{options.input.name}' could be approximated.")
    if is_scene(options.output):
        with suppress(MemoryError):  # a draft is larger and as good
            compact_drafts()
    write_outputs(options, made)
    for name in unmeasured:
        console.complain(UNMEASURED.format(name, options.output), PROGRAM)
    return int(bool(unmeasured or (refused and options.strict)))


def _together(options: argparse.Namespace, sources: Sequence[Object]) -> list[list[Object]]:
    """Return the objects, those together that are parts of one surface: in one frame, with a border in common.

    What would be refused stands alone, and so does each where domains are wanted as maps, which one surface has.
    """
    if len(sources) == 1:
        return [list(sources)]
    graph = bpy.context.evaluated_depsgraph_get()
    reads = [None if options.domain_maps else _read(source, graph) for source in sources]
    return [[sources[number] for number in group] for group in groups_in_frames(sources, reads, options.settings)]


def _read(source: Object, graph: Depsgraph) -> mesh_data.Source | None:
    """Read an object; None where it would be refused."""
    try:
        return mesh_data.read_object(source, graph)
    except InputError:
        return None


def _approximated(options: argparse.Namespace, together: Sequence[Object], solved: dict[Any, Any]) -> list[Made]:
    """Approximate an object, or the parts of one surface as one mesh; objects that share a mesh are solved once."""
    graph = bpy.context.evaluated_depsgraph_get()
    reads = [mesh_data.read_object(source, graph) for source in together]
    name, source, arrays = " + ".join(each.name for each in together), together[0], joined([r.arrays for r in reads])
    key = _shared(source, reads[0]) if len(together) == 1 else name
    outcome = solved.get(key)
    if outcome is None:
        last = LastSurface()
        try:
            with progress_display(name) as show:
                outcome = run_to_end(approximate_arrays(arrays, options.settings), last.noting(show))
        except MemoryError:
            if options.output is None or options.resample or last.vertices is None:
                raise
        last.give_back()
        if outcome is None:  # here, where no traceback holds what the solver had
            raise Unmeasured(_placed(together, reads, last.vertices))
    if source.data.users > 1:
        solved[key] = outcome
    parts = [outcome]
    if len(together) > 1:
        parts = taken_apart(outcome, [read.arrays for read in reads], [each.name for each in together])
    report = parts[0].report
    made = _objects(options, together, reads, parts)
    if made is None:
        vertices, outcome, parts = outcome.vertices, None, []  # the functions go: their memory is needed
        solved.pop(key, None)
        raise Unmeasured(_placed(together, reads, vertices))
    console.say(one_line(name, report), name)
    console.detail(report)
    return made


def _objects(
    options: argparse.Namespace,
    together: Sequence[Object],
    reads: Sequence[mesh_data.Source],
    results: Sequence[Approximation],
) -> list[Made] | None:
    """Make objects of a result; None where memory ends but may suffice for the surface alone."""
    whole, before = len(together) == 1, set(bpy.data.objects)
    made, surface, report = [], results[0].representation, results[0].report
    try:
        places = [None] if whole else places_of_parts(surface, [read.arrays for read in reads])
        scale = ColourScale(0.0, max(float(own.error.max(initial=0.0)) for own in results))
        for each, read, own, part in zip(together, reads, results, places, strict=True):
            result = create_result(bpy.context, read, own, scale, keeps_functions=whole and keeps_functions(options))
            if options.domain_maps:
                write_domain_maps(result)
            kept = report, surface, options.resample
            made.append(Made(options.input, each, result, *kept, **asked_for(options), part=part))
        if not whole and is_scene(options.output):
            share_functions([each.result for each in made], reads, surface.draft)
    except MemoryError:
        if options.output is None or options.resample:
            raise
        for left in set(bpy.data.objects) - before:
            bpy.data.meshes.remove(left.data)
        return None
    return made


def _placed(
    together: Sequence[Object], reads: Sequence[mesh_data.Source], vertices: NDArray[Any]
) -> list[tuple[Object, Object]]:
    """Return each object with one that has its part of the surface's vertices."""
    ends = np.cumsum([len(read.arrays.vertices) for read in reads])[:-1]
    parts = np.split(vertices, ends)
    made = [create_unmeasured(bpy.context, read, part) for read, part in zip(reads, parts, strict=True)]
    return list(zip(together, made, strict=True))


def _shared(source: Object, read: mesh_data.Source) -> Any:
    """Return what is equal for two objects with the same mesh in the same size."""
    if source.modifiers:
        return source.name
    stretch = read.lengths.stretch
    return source.data.name, None if stretch is None else stretch.round(9).tobytes()
