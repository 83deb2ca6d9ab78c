"""Where blocks are solved: in this process, in worker processes, on any executor, on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..errors import SparseSurfaceError, WorkerError
from ..processes.pool import WorkerExecutor, physical_cores
from .task import BlockTask, solve_block

TASKS_AHEAD = 1
"""Blocks that wait for a worker beside those that are being solved; more would only take memory."""

SECONDS_BETWEEN_BEATS = 0.5
"""How often progress is reported, and so cancelling is possible, while nothing is done."""

BEATS_BETWEEN_LOOKS, LOOKS_AT_A_DEAD_ENGINE = 10, 6
"""How often an engine is asked whether it still works, and how often in turn it may say no."""

UNKNOWN_WORKERS = 4
"""Workers that an executor is assumed to have unless the settings say."""

RETRIES = 3
"""How often Dask begins a block again whose worker was lost."""

LOST = "The workers were lost ({}); the blocks that are done are kept: the same call with the same folder goes on."


@dataclass(frozen=True)
class Engine:
    """What solves blocks.

    Attributes
    ----------
    executor
        Where; None: in this process.
    workers
        How many blocks are solved at once.
    is_alive
        Whether the executor still works, as far as it can be known.
    """

    executor: Executor | None = None
    workers: int = 1
    is_alive: Callable[[], bool] = lambda: True

    def run(self, tasks: Iterable[BlockTask]) -> Iterator[tuple[int, bytes | None]]:
        """Solve blocks and yield number and content of each, as they are done; no content while nothing is done.

        Tasks are made as late as possible.  Leaving the iteration early cancels those that have not started.

        Raises
        ------
        WorkerError
            When the executor or its workers are lost, in one sentence that says how to go on.
        """
        executor = self.executor
        assert executor is not None
        waiting: dict[Future[bytes], int] = {}
        try:
            for task in tasks:
                waiting[_guarded(executor.submit, solve_block, task)] = task.number
                del task  # not kept while waiting
                if len(waiting) >= self.workers + TASKS_AHEAD:
                    yield from self._done(waiting)
            while waiting:
                yield from self._done(waiting)
        finally:
            for future in waiting:
                future.cancel()

    def _done(self, waiting: dict[Future[bytes], int]) -> Iterator[tuple[int, bytes | None]]:
        """Wait until some are done, and take them out."""
        looks, dead = 0, 0
        while not (done := wait(waiting, SECONDS_BETWEEN_BEATS, FIRST_COMPLETED).done):
            yield -1, None
            looks += 1
            if looks % BEATS_BETWEEN_LOOKS == 0:
                dead = 0 if self.is_alive() else dead + 1
            if dead == LOOKS_AT_A_DEAD_ENGINE:
                raise WorkerError(LOST.format("they do not answer any more"))
        for future in done:
            number = waiting.pop(future)
            yield number, _guarded(future.result)


def _guarded(function: Callable[..., Any], *args: Any) -> Any:
    """Call a function of an executor; what its engine raises becomes one sentence."""
    try:
        return function(*args)
    except (SparseSurfaceError, MemoryError):
        raise
    except Exception as error:  # each engine has its own for a lost scheduler, worker or connection
        raise WorkerError(LOST.format(type(error).__name__)) from error


@contextmanager
def engine_of(given: Any, workers: int, blocks: int) -> Iterator[Engine]:
    """Provide what solves some blocks; what was started for it ends with the context.

    Parameters
    ----------
    given
        A `concurrent.futures.Executor` or a Dask `Client`, which stay open; None for worker processes of our own.
    workers
        How many blocks are solved at once; 0: as many as there are workers.
    blocks
        How many there are.
    """
    if given is None:
        count = min(workers or physical_cores(), blocks)
        if count <= 1:
            yield Engine()
            return
        own = WorkerExecutor(count, preload="blocks.task")
        try:
            yield Engine(own, count)
        finally:
            own.shutdown(cancel_futures=True)
    elif hasattr(given, "get_executor"):
        with given.get_executor(pure=False, retries=RETRIES) as executor:
            yield Engine(executor, workers or _dask_threads(given), lambda: given.status == "running")
    else:
        yield Engine(given, workers or UNKNOWN_WORKERS)


def _dask_threads(client: Any) -> int:
    """How many tasks a cluster runs at once."""
    return max(1, sum(client.nthreads().values()))
