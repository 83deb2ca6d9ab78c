"""Running chunks of patches: here, or on any `concurrent.futures.Executor`."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor, Future

from .patch_fit import ChunkTask, PatchFit, fit_chunk

TASKS_AHEAD = 8
"""Tasks that wait in an executor's queue; more would only hold memory."""


def run_chunks(
    tasks: Iterable[ChunkTask], executor: Executor | None = None
) -> Iterator[tuple[ChunkTask, list[PatchFit]]]:
    """Fit chunks and yield them with their fits, in the order of the tasks whatever the order of completion.

    Tasks are made as late as possible.  Leaving the iteration early cancels what has not begun.
    """
    if executor is None:
        for task in tasks:
            yield task, fit_chunk(task)
        return
    waiting: deque[tuple[ChunkTask, Future[list[PatchFit]]]] = deque()
    try:
        for task in tasks:
            waiting.append((task, executor.submit(fit_chunk, task)))
            if len(waiting) >= TASKS_AHEAD:
                first, future = waiting.popleft()
                yield first, future.result()
        while waiting:
            first, future = waiting.popleft()
            yield first, future.result()
    finally:
        for _, future in waiting:
            future.cancel()
