"""Approximating meshes of any size: block by block, on one machine or many, and on from where it was."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..approximation.denoised import MeshInput
from ..approximation.report import Stopwatch
from ..approximation.welded import Welded, held_together
from ..arrays import Array, Indices
from ..errors import SettingsError
from ..mesh.welding import may_coincide
from ..processes.memory import peak_memory_mb
from ..progress import FINISH, Progress, Steps, run_to_end, within
from ..settings import Settings
from ..version import VERSION
from .block_report import joined_report
from .cut import Cut, Parts
from .engines import engine_of
from .folder import CREASES, REPORT, JobFolder
from .joining import distances, joined
from .large_mesh import LargeMesh
from .noise import with_noise_level
from .scratch import Scratch
from .surface import BlockSurface
from .task import BlockTask, solve_block_steps

BLOCK_SIZE = 250_000
"""Vertices of a block: about a minute of work and a gigabyte of memory, with a halo that costs a tenth more."""

BEYOND_PATCHES = 2
"""Steps that a halo reaches beyond all patches, so that their rims and what bends beside them are seen."""

BEYOND_DENOISED = 8
"""Further steps where noise is removed first: the patches of that reach about so far."""

SOLVE_STARTS, SOLVE_ENDS = 0.02, 0.95
"""Shares of the progress bar at which solving blocks begins and ends."""


@dataclass(frozen=True, eq=False)
class BlockApproximation:
    """A mesh approximated in blocks.

    Attributes
    ----------
    vertices
        The surface at the input's vertices, (V, 3), of the input's floating-point type.
    error
        Distance of each vertex from the input, (V,), scene units.
    patch
        Patch with the largest blending weight at each vertex, (V,), counted over all blocks; -1 where the input passes
        through.
    report
        Measures, counts and times, as `approximate` reports them.
    representation
        What evaluates the surface anywhere, block by block.
    folder
        Where all of this lies; `vertices`, `error` and `patch` are mapped from there.
    creases
        Edges that the optimisation treats as creases, pairs of vertices (E, 2); None unless `Settings.mark_creases`.
    """

    vertices: NDArray[np.floating[Any]]
    error: Array
    patch: NDArray[np.int32]
    report: dict[str, Any]
    representation: BlockSurface
    folder: Path
    creases: Indices | None = None


def approximate_blocks(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    settings: Settings | None = None,
    *,
    block_size: int = BLOCK_SIZE,
    folder: Path | str | None = None,
    weights: ArrayLike | None = None,
    sharp_edges: ArrayLike | None = None,
    executor: Any = None,
    report: Callable[[Progress], str | None] | None = None,
) -> BlockApproximation:
    """Approximate a mesh of any size, cut into blocks that are solved by themselves and blended.

    The surface is S(x) = sum_b W_b(x) S_b(x): S_b is what `approximate` makes of block b and a halo around it, and the
    shares W_b, which fall to zero within `Settings.ring` steps outside of the block, are one in sum.  So no error is
    larger than the largest of the blocks.

    The same mesh, settings and block size give the same bytes, whatever solves the blocks.  A mesh of one block gives
    those of `approximate`.

    Parameters
    ----------
    vertices, faces, weights, sharp_edges
        As in `approximate`; arrays in files that are mapped into memory (`numpy.load(..., mmap_mode="r")`) stay there.
    settings
        What to do; the defaults where None.
    block_size
        Largest number of vertices in a block.
    folder
        Where blocks are kept as they are done, and at the end the result; a temporary folder where None.  A call with
        the folder of an earlier one goes on where that was, even if it was killed.
    executor
        What solves blocks: a `concurrent.futures.Executor`, or a `Client` of Dask.  Where None,
        `Settings.workers` processes.  `workers` also says how many blocks an executor solves at once.
    report
        Called with each `Progress`.

    Returns
    -------
    BlockApproximation

    Raises
    ------
    InputError
        When the mesh cannot be worked on, or the folder holds another job.
    SettingsError
        When a setting cannot be kept in blocks.
    WorkerError
        When the executor is lost; the same call with the same folder goes on.

    Examples
    --------
    >>> from sparse_surface.solver import Settings, approximate_blocks
    >>> result = approximate_blocks(vertices, faces, Settings(ring=4, degree=8), block_size=200)
    >>> result.representation.evaluate([0, 5], [[1, 0, 0], [0.2, 0.3, 0.5]]).shape
    (2, 3)
    """
    steps = approximate_blocks_steps(
        vertices,
        faces,
        settings,
        block_size=block_size,
        folder=folder,
        weights=weights,
        sharp_edges=sharp_edges,
        executor=executor,
    )
    return run_to_end(steps, report)


def approximate_blocks_steps(
    vertices: ArrayLike,
    faces: ArrayLike | list[list[int]],
    settings: Settings | None = None,
    *,
    block_size: int = BLOCK_SIZE,
    folder: Path | str | None = None,
    weights: ArrayLike | None = None,
    sharp_edges: ArrayLike | None = None,
    executor: Any = None,
) -> Steps[BlockApproximation]:
    """`approximate_blocks` as a generator of `Progress`; closing it cancels, sending `FINISH` ends it early.

    Blocks that worker processes or an executor have begun are then finished, and the others are fitted over their
    initial domains, as patches are in one piece.  The same call with the same folder solves those as they should be.
    """
    settings, watch = Settings.given(settings).resolved(), Stopwatch()
    if block_size < 1:
        raise SettingsError(f"A block has 1 vertex or more, not {block_size}.")
    yield Progress("Cutting the mesh into blocks", 0.0)
    with watch.stage("cut"):
        given = LargeMesh.of(vertices, faces, weights, sharp_edges)
        count = -(-len(given.positions) // block_size)
        if count > 1:
            _refuse_whole(settings)
        mesh, welded = _welded(given, vertices, faces, settings) if count > 1 else (given, None)
        cut = Cut.of(mesh, block_size)
        keeper = None
        if folder is None:
            keeper = tempfile.TemporaryDirectory(prefix="sparse_surface_")
            folder = keeper.name
        place = JobFolder.of(Path(folder), _job(given, settings, block_size, len(cut)))
    if not place.is_there(REPORT) or place.report.get("ended_early"):
        place.reopen()
        with Scratch(place.scratch) as scratch:
            yield from _solved(mesh, cut, place, scratch, settings, executor, watch)
        with Scratch(place.scratch) as scratch:
            yield from _finished(given, mesh, welded, cut, place, scratch, settings, watch)
    creases = place.load(CREASES) if settings.mark_creases else None
    arrays = {name: place.load(f"{name}.npy") for name in ("vertices", "error", "patch")}
    surface = BlockSurface(place, keeper)
    return BlockApproximation(**arrays, report=place.report, representation=surface, folder=place.path, creases=creases)


def _refuse_whole(settings: Settings) -> None:
    """Refuse what concerns the mesh as a whole."""
    if settings.keep_iterations:
        raise SettingsError("The setting keep_iterations needs the mesh in one block.")


def _welded(given: LargeMesh, vertices: Any, faces: Any, settings: Settings) -> tuple[LargeMesh, Welded | None]:
    """Hold vertices at one place together before the mesh is cut; arrays in files only where a distance is given."""
    if isinstance(vertices, np.memmap) and not settings.merge_distance:
        return given, None
    if not may_coincide(given.positions, settings.merge_distance):
        return given, None
    weights = given.weights
    welded = held_together(MeshInput(given.positions, faces, None, weights, sharp_edges=given.sharp_edges), settings)
    if welded is None:
        return given, None
    found = welded.mesh
    return LargeMesh.of(found.positions, found.faces, found.weights, found.sharp_edges), welded


def _job(mesh: LargeMesh, settings: Settings, block_size: int, blocks: int) -> dict[str, Any]:
    """What a job is; the number of workers plays no part."""
    own = {name: value for name, value in settings.as_dict().items() if name != "workers"}
    counts = {"vertices": len(mesh.positions), "faces": mesh.face_count, "block_size": block_size, "blocks": blocks}
    return {"program": f"sparse_surface {VERSION}", **counts, "mesh": mesh.fingerprint(), "settings": own}


def _solved(
    mesh: LargeMesh,
    cut: Cut,
    folder: JobFolder,
    scratch: Scratch,
    settings: Settings,
    executor: Any,
    watch: Stopwatch,
) -> Steps[None]:
    """Solve the blocks that are not done."""
    missing = [number for number in range(len(cut)) if not folder.is_done(number)]
    if not missing:
        return
    with watch.stage("cut"):
        beyond = BEYOND_PATCHES + (BEYOND_DENOISED if settings.denoise != "off" else 0)
        parts = Parts(mesh, cut, 2 * settings.ring + beyond, scratch.array)
    # many blocks are solved at once, each on one thread; vertices at one place are one already
    own = settings if len(cut) == 1 and executor is None else replace(settings, workers=1)
    if len(cut) > 1:
        with watch.stage("cut"):
            own = with_noise_level(replace(own, merge_vertices=False), parts, cut, folder)

    hurried: set[int] = set()
    hurry = False

    def tasks() -> Iterator[BlockTask]:
        for number in missing:
            with watch.stage("cut"):
                part = parts.part(number)
                folder.keep_part(number, part)
                task = parts.task(number, part, own, settings.ring, hurry)
                scratch.rest()
            if hurry:
                hurried.add(number)
            yield task

    with engine_of(executor, settings.workers, len(missing)) as engine:
        done = len(cut) - len(missing)
        if engine.executor is None:
            for number, task in zip(missing, tasks(), strict=True):
                solved, early = yield from _shown(solve_block_steps(task), done, len(cut))
                hurry = hurry or early
                folder.keep(number, solved, hurry)
                done += 1
            return
        for number, content in engine.run(tasks()):
            if content is not None:
                folder.keep(number, content, number in hurried)
                done += 1
            hurry = hurry or (yield _solving(done, len(cut))) == FINISH


def _solving(done: int, blocks: int, inside: float = 0.0, detail: str = "") -> Progress:
    fraction = SOLVE_STARTS + (SOLVE_ENDS - SOLVE_STARTS) * (done + inside) / blocks
    text = f"{done} of {blocks} blocks" if blocks > 1 else ""
    return Progress("Solving blocks", fraction, ", ".join(part for part in (text, detail) if part))


def _shown(steps: Steps[bytes], done: int, blocks: int) -> Steps[tuple[bytes, bool]]:
    """Show how one block goes; returns its content, and whether `FINISH` was sent."""
    request, early = None, False
    try:
        while True:
            try:
                step = steps.send(request)
            except StopIteration as end:
                return end.value, early
            request = yield _solving(done, blocks, step.fraction, step.stage if blocks > 1 else step.detail)
            early = early or request == FINISH
    finally:
        steps.close()


def _finished(
    given: LargeMesh,
    mesh: LargeMesh,
    welded: Welded | None,
    cut: Cut,
    folder: JobFolder,
    scratch: Scratch,
    settings: Settings,
    watch: Stopwatch,
) -> Steps[None]:
    """Join the blocks, measure the whole, and write the result; the report, which comes last, says that it is there."""
    with watch.stage("join"):
        found = yield from within(joined(mesh, cut, folder, scratch), SOLVE_ENDS, 0.99)
        vertices, patch, creases = found.vertices, found.patch, found.creases
        if welded is not None:
            place = welded.weld.place
            vertices, patch, creases = vertices[place], patch[place], welded.edges(creases)
    yield Progress("Measuring", 0.99)
    with watch.stage("measure"):
        error = scratch.array("error", (len(vertices),), np.float64)
        distances(given, vertices, error)
        for name, array in (("vertices", vertices), ("error", error), ("patch", patch)):
            folder.save(f"{name}.npy", array)
            scratch.rest()
        if settings.mark_creases:
            folder.save(CREASES, creases)
        if len(cut) == 1:
            report = found.reports[0]
        else:
            report = joined_report(given, found, error, settings)
    report["input"] |= {"blocks": len(cut), "block_size": folder.job["block_size"]}
    if len(cut) > 1:
        report["seconds"] |= {**watch.seconds, "total": watch.report()["total"]}
    report["peak_memory_mb"] = max(report["peak_memory_mb"], peak_memory_mb())
    folder.write_json(REPORT, report)
