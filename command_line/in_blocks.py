"""The command `approximate` for a large mesh: in blocks, on a cluster, on from where an earlier one was."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from ..operators.data.report_text import one_line
from ..operators.files.formats import ERROR_COLOURS, ORDERS, QUALITIES
from ..operators.files.large import LargeFile, read_large, write_large
from ..solver.blocks.approximate_blocks import BLOCK_SIZE, approximate_blocks
from ..solver.blocks.resampled import BlocksResampled, resample_blocks_steps
from ..solver.blocks.surface import BlockSurface
from ..solver.errors import SettingsError, WorkerError
from ..solver.progress import run_to_end
from .console import console
from .outputs import write_json
from .progress import progress_display

SECONDS_TO_CONNECT = 30

WHOLE = "--{} needs the mesh in one piece: leave --block-size, --cluster and --resume out."


def run(options: argparse.Namespace) -> None:
    """Approximate the mesh of a file, or evaluate the folder of a job, and write what was asked for.

    Raises
    ------
    SparseSurfaceError
        When it cannot be read or worked on, or the cluster is lost.
    """
    if options.command == "evaluate":
        _evaluate(options)
        return
    for name in ("heatmap", "domain_maps", "object"):
        if getattr(options, name):
            raise SettingsError(WHOLE.format(name.replace("_", "-")))
    for name, usual in (("quality", QUALITIES), ("error_colors", ERROR_COLOURS), ("vertex_order", ORDERS)):
        if getattr(options, name) != next(iter(usual)):
            raise SettingsError(WHOLE.format(name.replace("_", "-")))
    if options.settings.mark_creases and options.resume is None and options.representation is None:
        raise SettingsError("Creases of blocks are written into a folder: name one with --resume or --representation.")
    source, name = read_large(options.input), options.input.stem
    with _cluster(options.cluster) as client, progress_display(name) as show:
        found = approximate_blocks(
            source.vertices,
            source.faces,
            options.settings,
            block_size=options.block_size or BLOCK_SIZE,
            folder=options.resume,
            executor=client,
            report=show,
        )
    if options.output is not None and options.resample:
        _write_resampled(found.representation, options)
    elif options.output is not None:
        values = {"error": found.error.astype(np.float32), "patch": found.patch}
        write_large(options.output, source, found.vertices, values)
    if options.report is not None:
        write_json(options.report, found.report)
    if options.representation is not None:
        found.representation.save(options.representation)
    console.say(one_line(name, found.report), name)
    console.detail(found.report)
    console.figures(found.report)


def _evaluate(options: argparse.Namespace) -> None:
    """Evaluate the folder of a finished job on its mesh with split edges, and write that mesh."""
    name = options.representation.name
    fine = _write_resampled(BlockSurface.load(options.representation), options)
    console.say(f"{name}: {len(fine.vertices)} vertices, {len(fine.sizes)} faces", name)
    console.figures({"vertices": len(fine.vertices), "faces": len(fine.sizes)})


def _write_resampled(surface: BlockSurface, options: argparse.Namespace) -> BlocksResampled:
    beside = options.output.absolute().parent
    with progress_display(options.output.stem) as show:
        fine = run_to_end(resample_blocks_steps(surface, options.resample, beside), show)
    write_large(options.output, LargeFile(fine.vertices, fine.faces), fine.vertices, {})
    return fine


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[Any]:
    """Connect to a Dask cluster; None where there is no address."""
    if address is None:
        yield None
        return
    if find_spec("distributed") is None:
        raise SettingsError("--cluster needs Dask, which is not installed (pip install distributed).")
    # imported where it is needed: it is an optional package
    distributed = import_module("distributed")
    try:
        client = distributed.Client(address, timeout=SECONDS_TO_CONNECT)
    except (OSError, ValueError, TimeoutError) as error:
        raise WorkerError(f"There is no Dask cluster at '{address}' ({type(error).__name__}).") from None
    with client:
        yield client
