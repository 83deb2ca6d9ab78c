"""An approximation, a reconstruction or a measurement in a process of its own, for owners that must stay responsive.

A thread of the `WorkerExecutor` talks to the child and makes the objects, so that the owner's own thread only takes
what is there.  Nothing is written to a disk.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .approximation.result import Approximation
from .distance.settings import DistanceSettings
from .distance.surface_pair import SurfacePair
from .errors import SparseSurfaceError
from .interchange import CloudArrays, CloudOutcome, MeshArrays, StoredRepresentation
from .processes.pool import WorkerExecutor
from .progress import Progress, Steps, run_to_end
from .settings import Settings

if TYPE_CHECKING:
    from .distance.distance import Distances

Task = MeshArrays | CloudArrays | SurfacePair
"""What to work on."""

# What solves is imported where it is called: an owner in whose process it does not run need not load SciPy.


def approximate_arrays(arrays: MeshArrays, settings: Settings) -> Steps[Approximation]:
    """Do `approximate_steps` on flat arrays."""
    from .approximation.approximate import approximate_steps

    return approximate_steps(
        arrays.vertices,
        arrays.polygons(),
        settings,
        triangles=(arrays.triangles.astype(np.int64), arrays.triangle_polygons.astype(np.int64)),
        weights=None if arrays.weights is None else arrays.weights.astype(np.float64),
        sharp_edges=arrays.sharp_edges,
    )


def solve_arrays(arrays: Task, settings: Any) -> Steps[Any]:
    """Approximate a mesh, reconstruct a surface from points, or measure distances."""
    if isinstance(arrays, SurfacePair):
        from .distance.distance import distance_of_pair

        return (yield from distance_of_pair(arrays, settings))
    if isinstance(arrays, MeshArrays):
        return (yield from approximate_arrays(arrays, settings))
    from .reconstruction.evaluated import reconstruct_arrays

    return (yield from reconstruct_arrays(arrays, settings))


def solve_here(arrays: Task, settings: Any, show: Callable[[Progress], None]) -> Any:
    """Do `solve_arrays` to its end in this process."""
    return run_to_end(solve_arrays(arrays, settings), show)


def solve_and_store(arrays: Task, settings: Any) -> Steps[Any]:
    """Do `solve_arrays`; a surface's representation travels to another process as the content of a file.

    It is a draft: a compact file takes three times as long to make as the surface itself, and nobody waits for it.
    """
    result = yield from solve_arrays(arrays, settings)
    if isinstance(arrays, SurfacePair):
        return result
    stored: Any = StoredRepresentation(result.representation.draft)
    return replace(result, representation=stored)


def compacted(draft: bytes) -> bytes:
    """Return the content of a compact file for that of a draft; the same bytes in whatever process."""
    return bytes(StoredRepresentation(draft).compact)


def begin_compacting(drafts: Sequence[bytes], python: Sequence[str] = ()) -> tuple[Executor, list[Future[bytes]]]:
    """Do `compacted` for each in one child, which gives way to other programs and ends when it is done.

    Until then it ends with its executor, which is returned, too.
    """
    executor = WorkerExecutor(1, preload="surface.representation", python=python, gives_way=True)
    futures = [executor.submit(compacted, draft) for draft in drafts]
    executor.shutdown(wait=False)
    return executor, futures


class Job:
    """One such task in a child process, as its owner sees it.

    Parameters
    ----------
    python
        The command that starts a plain Python, with its options.

    Attributes
    ----------
    outcome
        The result, once the work is done; its `representation` is a `StoredRepresentation`.
    failure
        One sentence that says why there is no result, once the work has failed.

    Notes
    -----
    Only `poll`, called by the owner as often as it likes, changes the attributes.
    """

    def __init__(self, python: Sequence[str] = ()) -> None:
        self.outcome: Approximation | CloudOutcome | Distances | None = None
        self.failure = ""
        self._python = python
        self._executor: WorkerExecutor | None = None
        self._future: Future[Approximation | CloudOutcome | Distances] = Future()
        self._newest = _Newest()

    @property
    def running(self) -> bool:
        """Whether the work goes on: started, and neither an outcome nor a failure known."""
        return self._executor is not None and self.outcome is None and not self.failure

    def start(self, arrays: Task, settings: Settings | DistanceSettings, *, previews: bool = False) -> None:
        """Start the child; with `previews` it sends the surface as it stands.

        The arrays are not copied: they must not change before the first progress.
        """
        self._executor = _prepared.pop(tuple(self._python), None) or _new_executor(self._python)
        self._future = self._executor.submit_steps(
            solve_and_store, arrays, settings, report=self._newest.put, previews=previews
        )

    def poll(self) -> Progress | None:
        """Take in what the child has said since the last call and return its newest progress, if any."""
        if not self.running:
            return None
        ended = self._future.done()  # before the newest progress is taken: none comes after the end
        newest = self._newest.take()
        if ended:
            error = self._future.exception()
            if error is None:
                self.outcome = self._future.result()
            else:
                self.failure = _sentence(error)
        return newest

    def finish(self) -> None:
        """Ask the child to end early with the best result so far."""
        if self._executor is not None and self.running:
            self._executor.finish()

    def stop(self) -> None:
        """End the child, if it lives; may be called again and again.

        Nothing waits for its end: on a busy machine a killed process that gives way takes seconds to go.
        """
        executor, self._executor = self._executor, None
        if executor is not None:
            executor.shutdown(wait=False, cancel_futures=True)


def _sentence(error: BaseException) -> str:
    if isinstance(error, SparseSurfaceError | MemoryError):
        return str(error) or "There is not enough memory for this mesh."
    return f"The solver failed ({type(error).__name__}: {error})."


_prepared: dict[tuple[str, ...], WorkerExecutor] = {}
"""Children that no job has taken yet, by the command that started them."""


def prepare(python: Sequence[str] = ()) -> None:
    """Start the child of the next job that asks for the same command, unless one waits: it loads the solver meanwhile.

    That saves the next job a second.  The child takes some 100 MB and no time while it waits.
    """
    if tuple(python) not in _prepared:
        _prepared[tuple(python)] = _new_executor(python)


def dismiss_prepared() -> None:
    """End what `prepare` has started, as far as no job has taken it."""
    while _prepared:
        _prepared.popitem()[1].shutdown(wait=False, cancel_futures=True)


def _new_executor(python: Sequence[str]) -> WorkerExecutor:
    return WorkerExecutor(1, preload="approximation.approximate", python=python, gives_way=True)


class _Newest:
    """The newest progress, with the newest surface: what an owner that is busy for long misses does not pile up."""

    def __init__(self) -> None:
        self._step: Progress | None = None
        self._lock = threading.Lock()

    def put(self, step: Progress) -> None:
        with self._lock:
            if step.surface is None and self._step is not None:
                step = replace(step, surface=self._step.surface)
            self._step = step

    def take(self) -> Progress | None:
        with self._lock:
            step, self._step = self._step, None
        return step
