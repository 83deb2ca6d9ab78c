"""The commands that work where Blender is not installed: on arrays, and files that `operators.files.plain` knows."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from ..operators.data.report_text import one_line
from ..operators.files.plain import PlainMesh, read_plain, write_plain
from ..solver.approximation.approximate import approximate_steps
from ..solver.errors import SettingsError
from ..solver.progress import run_to_end
from ..solver.surface.representation import Representation
from ..solver.surface.resampling import resample, resample_steps
from .console import console
from .listing import list_patches
from .outputs import write_json
from .progress import progress_display

NEEDS_BLENDER = "--{} needs Blender: install its Python module (pip install bpy) or run in Blender."


def run(options: argparse.Namespace) -> None:
    """Run `approximate`, `evaluate` or `inspect`."""
    COMMANDS[options.command](options)


def _approximate(options: argparse.Namespace) -> None:
    _refuse_others(options, "heatmap", "domain_maps", "object")
    name, mesh = options.input.stem, read_plain(options.input)
    vertices = np.asarray(mesh.vertices, dtype=np.float32)  # what Blender computes with
    with progress_display(name) as show:
        found = run_to_end(approximate_steps(vertices, mesh.polygons(), options.settings), show)
    if options.output is not None:
        source = None if options.resample else options.input
        write_plain(options.output, _written(mesh, found, options.resample), source)
    if options.report is not None:
        write_json(options.report, found.report)
    if options.representation is not None:
        order = options.vertex_order == "keep"
        found.representation.save(options.representation, options.quality, keep_vertex_order=order)
    console.say(one_line(name, found.report), name)
    console.detail(found.report)
    console.figures(found.report)


def _written(mesh: PlainMesh, found: Any, splits: int | None) -> PlainMesh:
    """Return the result as a mesh: the input's values stay; those of a finer mesh would have to be invented."""
    if splits:
        fine = resample(found.representation, splits)
        return PlainMesh(fine.vertices, fine.corners, fine.sizes)
    own = {"error": found.error.astype(np.float32), "patch": found.patch}
    return PlainMesh(found.vertices, mesh.corners, mesh.sizes, {**mesh.values, **own})


def _evaluate(options: argparse.Namespace) -> None:
    representation, name = Representation.load(options.representation), options.representation.stem
    with progress_display(name) as show:
        fine = run_to_end(resample_steps(representation, options.resample), show)
    write_plain(options.output, PlainMesh(fine.vertices, fine.corners, fine.sizes))
    console.say(f"{name}: {len(fine.vertices)} vertices, {len(fine.sizes)} faces", name)
    console.figures({"vertices": len(fine.vertices), "faces": len(fine.sizes)})


def _inspect(options: argparse.Namespace) -> None:
    _refuse_others(options, "output")
    list_patches(Representation.load(options.representation), options.patch, options.report)


def _refuse_others(options: argparse.Namespace, *names: str) -> None:
    for name in names:
        if getattr(options, name):
            raise SettingsError(NEEDS_BLENDER.format(name.replace("_", "-")))


COMMANDS = {"approximate": _approximate, "evaluate": _evaluate, "inspect": _inspect}
