"""Running chunks of patches: in this process, its threads, worker processes, or any `concurrent.futures.Executor`."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

from ..fitting.chunks import PatchFit
from ..fitting.gathered import MeshTask, Task
from ..fitting.native_chunks import fit_chunk
from ..native.library import reason_for_numpy
from ..processes.each import Each
from ..processes.memory import peak_memory_mb
from ..processes.pool import WorkerExecutor, physical_cores
from ..settings import Settings

TASKS_AHEAD = 2
"""Tasks that each worker has running or waiting; more would only take memory."""

UNKNOWN_WORKERS = 16
"""Workers that the caller's executor is assumed to have unless the settings say."""

VERTICES_WORTH_A_WORKER = 2000
"""Fewer vertices are fitted before a new process has started, or, by the compiled kernel, in a blink."""


@dataclass(frozen=True)
class ChunkRunner:
    """What fits chunks of patches.

    Attributes
    ----------
    executor
        Where chunks run; None: in this process.
    workers
        How many chunks run at once.
    threads
        Whether the executor's workers are threads of this process, which share its arrays.
    """

    executor: Executor | None = None
    workers: int = 1
    threads: bool = False

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, list[PatchFit]]]:
        """Fit chunks and yield them with their fits, in the order of the tasks whatever the order of completion.

        Tasks are made as late as possible.  Leaving the iteration early cancels those that have not started.
        """
        if self.executor is None:
            for task in tasks:
                yield task, fit_chunk(task)
            return
        waiting: deque[tuple[Task, Future[list[PatchFit]]]] = deque()
        try:
            for task in tasks:
                sent = task if self.threads or not isinstance(task, MeshTask) else task.in_full()
                waiting.append((task, self.executor.submit(fit_chunk, sent)))
                if len(waiting) >= TASKS_AHEAD * self.workers:
                    first, future = waiting.popleft()
                    yield first, future.result()
            while waiting:
                first, future = waiting.popleft()
                yield first, future.result()
        finally:
            for _, future in waiting:
                future.cancel()

    @property
    def each(self) -> Each:
        """What applies functions to the parts of large arrays: in the threads that fit chunks, where there are any."""
        return self.executor.map if self.executor is not None and self.threads else map

    def peak_memory_mb(self) -> float:
        """Largest resident memory of this process and of worker processes of its own, summed, in megabytes."""
        workers = self.executor.peak_memory_mb if isinstance(self.executor, WorkerExecutor) else 0.0
        return peak_memory_mb() + workers


@contextmanager
def chunk_runner(settings: Settings, vertices: int, executor: Executor | None = None) -> Iterator[ChunkRunner]:
    """Provide the runner for a mesh; what was started for it ends with the block.

    If the block is left early, worker processes end at once, and threads after the chunk that they are fitting.

    Parameters
    ----------
    settings
        Resolved settings.  Their `workers` are 0 for one thread or process for each physical core, fewer on small
        meshes; 1 for this thread alone.
    vertices
        Number of vertices of the mesh.
    executor
        The caller's own, which stays open; `workers` then says how many chunks it runs at once.
    """
    threads, workers = reason_for_numpy(settings) is None, settings.workers
    if executor is not None:
        yield ChunkRunner(executor, workers or UNKNOWN_WORKERS)
        return
    count = workers or max(1, min(physical_cores(), vertices // VERTICES_WORTH_A_WORKER))
    if count == 1:
        yield ChunkRunner()
        return
    # The compiled kernel frees Python's lock, so threads do; NumPy holds it too often.
    own = (
        ThreadPoolExecutor(count, "sparse surface")
        if threads
        else WorkerExecutor(count, preload="fitting.native_chunks")
    )
    try:
        yield ChunkRunner(own, count, threads)
    finally:
        # After complete work nothing waits any more; this ends only abandoned tasks.
        own.shutdown(cancel_futures=True)
