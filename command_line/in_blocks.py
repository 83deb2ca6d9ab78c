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
from ..operators.files.formats import ERROR_COLOURS, QUALITIES
from ..operators.files.large import read_large, write_large
from ..solver.blocks.approximate_blocks import BLOCK_SIZE, approximate_blocks
from ..solver.errors import SettingsError, WorkerError
from .console import console
from .outputs import write_json
from .progress import progress_display

SECONDS_TO_CONNECT = 30

WHOLE = "--{} needs the mesh in one piece: leave --block-size, --cluster and --resume out."


def run(options: argparse.Namespace) -> None:
    """Approximate the mesh of a file, and write what was asked for.

    Raises
    ------
    SparseSurfaceError
        When it cannot be read or worked on, or the cluster is lost.
    """
    for name in ("heatmap", "domain_maps", "object", "resample"):
        if getattr(options, name):
            raise SettingsError(WHOLE.format(name.replace("_", "-")))
    for name, usual in (("quality", QUALITIES), ("error_colors", ERROR_COLOURS)):
        if getattr(options, name) != next(iter(usual)):
            raise SettingsError(WHOLE.format(name.replace("_", "-")))
    if options.settings.mark_creases and options.resume is None:
        raise SettingsError("The creases of blocks are written into the job's folder: name one with --resume.")
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
    if options.output is not None:
        values = {"error": found.error.astype(np.float32), "patch": found.patch}
        write_large(options.output, source, found.vertices, values)
    if options.report is not None:
        write_json(options.report, found.report)
    if options.representation is not None:
        found.representation.save(options.representation)
    console.say(one_line(name, found.report), name)
    console.detail(found.report)
    console.figures(found.report)


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
