"""Where blocks are solved: in this process, in worker processes, on any executor, on a Dask cluster."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median
from time import monotonic
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

SLOW, SECONDS_BEFORE_A_COPY = 3.0, 5.0
"""A block is sent a second time after this many times the median of the others' seconds, and never earlier
than this many seconds."""

LOST = "The workers were lost ({}); the blocks that are done are kept: the same call with the same folder goes on."


@dataclass(frozen=True)
class _Sent:
    """A block that an executor has, from a point in time on; a second future where a copy was sent, too."""

    task: BlockTask
    since: float
    futures: list[Future[bytes]]

    def cancel(self) -> None:
        """Drop what has not begun."""
        for future in self.futures:
            future.cancel()


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
    copies
        Whether a block that takes much longer than others is sent out a second time.
    """

    executor: Executor | None = None
    workers: int = 1
    is_alive: Callable[[], bool] = lambda: True
    copies: bool = False

    def run(self, tasks: Iterable[BlockTask]) -> Iterator[tuple[int, bytes | None]]:
        """Solve blocks and yield number and content of each, as they are done; no content while nothing is done.

        Tasks are made as late as possible.  Leaving the iteration early cancels those that have not started.

        Once every block is sent out, one that takes `SLOW` times as long as the others is sent again: the machine
        that has it may be stuck.  The first answer counts; both would be the same bytes.

        Raises
        ------
        WorkerError
            When the executor or its workers are lost, in one sentence that says how to go on.
        """
        waiting: dict[int, _Sent] = {}
        seconds: list[float] = []
        try:
            for task in tasks:
                waiting[task.number] = _Sent(task, monotonic(), [self._submitted(task)])
                del task  # not kept while waiting
                if len(waiting) >= self.workers + TASKS_AHEAD:
                    yield from self._done(waiting, seconds)
            while waiting:
                yield from self._done(waiting, seconds, copies=self.copies)
        finally:
            for sent in waiting.values():
                sent.cancel()

    def _submitted(self, task: BlockTask) -> Future[bytes]:
        assert self.executor is not None
        with warnings.catch_warnings():
            # Dask advises to load data on the workers, for every block; ours comes from no place that they can read.
            warnings.filterwarnings("ignore", "Sending large graph")
            future: Future[bytes] = _guarded(self.executor.submit, solve_block, task)
        return future

    def _done(
        self, waiting: dict[int, _Sent], seconds: list[float], copies: bool = False
    ) -> Iterator[tuple[int, bytes | None]]:
        """Wait until some are done, take them out, and add how long each took to `seconds`."""
        looks, dead = 0, 0
        while not (done := wait(_futures(waiting), SECONDS_BETWEEN_BEATS, FIRST_COMPLETED).done):
            yield -1, None
            looks += 1
            if looks % BEATS_BETWEEN_LOOKS == 0:
                dead = 0 if self.is_alive() else dead + 1
            if dead == LOOKS_AT_A_DEAD_ENGINE:
                raise WorkerError(LOST.format("they do not answer any more"))
            if copies and seconds:
                self._copy_slow(waiting, max(SECONDS_BEFORE_A_COPY, SLOW * median(seconds)))
        for number in [number for number, sent in waiting.items() if not done.isdisjoint(sent.futures)]:
            sent = waiting.pop(number)
            seconds.append(monotonic() - sent.since)
            sent.cancel()
            yield number, _guarded(next(future for future in sent.futures if future in done).result)

    def _copy_slow(self, waiting: dict[int, _Sent], limit: float) -> None:
        """Send blocks that have taken longer than `limit` seconds a second time."""
        for sent in waiting.values():
            if len(sent.futures) == 1 and monotonic() - sent.since > limit:
                sent.futures.append(self._submitted(sent.task))


def _futures(waiting: dict[int, _Sent]) -> list[Future[bytes]]:
    return [future for sent in waiting.values() for future in sent.futures]


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
        executor = given.get_executor(pure=False, retries=RETRIES)
        try:
            yield Engine(executor, workers or _dask_threads(given), lambda: given.status == "running", copies=True)
        finally:
            executor.shutdown(wait=False)  # a machine that is stuck may still have a block whose copy is done
    else:
        yield Engine(given, workers or UNKNOWN_WORKERS, copies=True)


def _dask_threads(client: Any) -> int:
    """How many tasks a cluster runs at once."""
    return max(1, sum(client.nthreads().values()))
