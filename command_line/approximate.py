"""The command `approximate`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import bpy
import numpy as np
from bpy.types import Object
from numpy.typing import NDArray

from ..operators.data import meshes as mesh_data
from ..operators.data.colours import ColourScale
from ..operators.data.report_text import one_line
from ..operators.data.results import create_result, create_unmeasured
from ..operators.files.meshes import named, read_meshes
from ..operators.representation.compacting import compact_drafts
from ..operators.representation.domain_maps import write_domain_maps
from ..solver.approximation.parts import groups_of_parts, joined, taken_apart
from ..solver.approximation.result import Approximation
from ..solver.errors import InputError, SparseSurfaceError
from ..solver.job import approximate_arrays
from ..solver.mesh.input_checks import checked_faces, checked_vertices
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
    frames: dict[Any, list[tuple[int, Any]]] = {}
    for number, source in enumerate(sources):
        read = None if options.domain_maps else _sound(source)
        frame = number if read is None else tuple(map(tuple, source.matrix_world))
        frames.setdefault(frame, []).append((number, read))
    groups: list[list[int]] = []
    for inside in frames.values():
        several = len(inside) > 1
        found = groups_of_parts([read.arrays for _, read in inside], options.settings) if several else [[0]]
        groups += [[inside[each][0] for each in group] for group in found]
    return [[sources[number] for number in group] for group in sorted(groups)]


def _sound(source: Object) -> mesh_data.Source | None:
    """Read an object; None where it alone would be refused."""
    try:
        read = mesh_data.read_object(source, bpy.context.evaluated_depsgraph_get())
        points = checked_vertices(read.arrays.vertices)
        checked_faces(read.arrays.polygons(), len(points))
    except InputError:
        return None
    return read


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
    report = outcome.report if len(together) == 1 else _of_parts(outcome.report, together)
    made = _objects(options, together, reads, outcome, report)
    if made is None:
        vertices, outcome = outcome.vertices, None  # the functions go: their memory is needed
        solved.pop(key, None)
        raise Unmeasured(_placed(together, reads, vertices))
    console.say(one_line(name, report), name)
    console.detail(report)
    return made


def _objects(
    options: argparse.Namespace,
    together: Sequence[Object],
    reads: Sequence[mesh_data.Source],
    outcome: Approximation,
    report: dict[str, Any],
) -> list[Made] | None:
    """Make objects of a result; None where memory ends but may suffice for the surface alone."""
    whole, before = len(together) == 1, set(bpy.data.objects)
    made = []
    try:
        parts = [(outcome, None)] if whole else taken_apart(outcome, [read.arrays for read in reads])
        scale = ColourScale(0.0, float(outcome.error.max(initial=0.0)))
        for each, read, (own, part) in zip(together, reads, parts, strict=True):
            result = create_result(bpy.context, read, own, scale, keeps_functions=whole and keeps_functions(options))
            if options.domain_maps:
                write_domain_maps(result)
            kept = report, outcome.representation, options.resample
            made.append(Made(options.input, each, result, *kept, **asked_for(options), part=part))
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


def _of_parts(report: dict[str, Any], together: Sequence[Object]) -> dict[str, Any]:
    """Say in a report which objects its figures are about."""
    return {**report, "input": {**report["input"], "parts": [each.name for each in together]}}


def _shared(source: Object, read: mesh_data.Source) -> Any:
    """Return what is equal for two objects with the same mesh in the same size."""
    if source.modifiers:
        return source.name
    stretch = read.lengths.stretch
    return source.data.name, None if stretch is None else stretch.round(9).tobytes()
