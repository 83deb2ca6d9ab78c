"""A `concurrent.futures.Executor` over child processes that starts safely inside Blender and outside, on every system.

A thread for each child (see `child`) feeds it one task at a time.  A child that dies is replaced and its task done
again.  Children end when their standard input closes, so even a killed owner leaves none behind.

loky, the pool that joblib brings along, does not work here: where only this process knows the package by its name
(``bl_ext...`` inside Blender), its children fail with ``BrokenProcessPool: A task has failed to un-serialize`` (tried
with loky 3.5.6 of joblib 1.5.3).  A `ProcessPoolExecutor` in Blender left three processes behind when Blender quit in
the middle of a job, and held it up for 13 seconds.
"""

from __future__ import annotations

import contextlib
import queue
import subprocess
import tempfile
import threading
import weakref
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from io import FileIO
from typing import IO, Any, NamedTuple, ParamSpec, TypeVar, cast

from ..errors import Cancelled, WorkerError
from ..progress import Progress, Steps
from .channel import FINISH_MESSAGE, Parts, pack, receive, send, unpack
from .child import start_child
from .child_main import PACKAGE
from .service import Answer

Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")

ATTEMPTS = 3
"""How often a task is begun before the deaths of its workers are attributed to the task."""

SECONDS_TO_END = 5.0


class _Task(NamedTuple):
    future: Future[Any]
    message: Parts
    report: Callable[[Progress], None]
    attempts: int


class WorkerExecutor(Executor):
    """Runs functions of this package, or of any module that a child can import, in child processes.

    The children start at once, so that they load while their first tasks are prepared.

    Parameters
    ----------
    workers
        Number of child processes.
    preload
        A module of this package that the children import before their first task.
    python
        The command that starts a plain Python, with its options; this process's own where empty.
    gives_way
        Whether the children take processors only while nothing else wants them.
    """

    def __init__(
        self, workers: int, *, preload: str = "errors", python: Sequence[str] = (), gives_way: bool = False
    ) -> None:
        self.workers = workers
        self._tasks: queue.SimpleQueue[_Task | None] = queue.SimpleQueue()
        self._crew = [_Worker(preload, python, gives_way) for _ in range(workers)]
        self._threads = [
            threading.Thread(
                target=worker.work, args=(self._tasks,), name=f"sparse surface worker {number}", daemon=True
            )
            for number, worker in enumerate(self._crew)
        ]
        self._closed = False
        self._lock = threading.Lock()
        # An executor that is forgotten, or lives at the interpreter's end, takes its children with it.
        self._end = weakref.finalize(self, _dismiss, self._crew, self._tasks)
        for thread in self._threads:
            thread.start()

    @property
    def peak_memory_mb(self) -> float:
        """Largest resident memory of the children, in megabytes, summed over them."""
        return sum(worker.peak_memory_mb for worker in self._crew)

    def submit(
        self, function: Callable[Parameters, Result], /, *args: Parameters.args, **kwargs: Parameters.kwargs
    ) -> Future[Result]:
        """Call `function(*args, **kwargs)` in a child; see `concurrent.futures.Executor.submit`."""
        message = pack((function, args, kwargs, False), snapshot=True)
        return self._put(_Task(Future(), message, lambda step: None, ATTEMPTS))

    def submit_steps(
        self,
        function: Callable[..., Steps[Result]],
        /,
        *args: Any,
        report: Callable[[Progress], None],
        previews: bool = False,
    ) -> Future[Result]:
        """Run the steps that `function(*args)` returns in a child, once.

        Arrays among the arguments are not copied: they must not change before the first `Progress`.  `report` is called
        in another thread, with `Progress` that has a surface only with `previews`.
        """
        return self._put(_Task(Future(), pack((function, args, {}, previews)), report, 1))

    def finish(self) -> None:
        """Ask steps that run to end early with their best result so far; returns at once."""
        for worker in self._crew:
            threading.Thread(target=worker.finish, daemon=True).start()  # the arguments may still be on their way

    def _put(self, task: _Task) -> Future[Any]:
        with self._lock:
            if self._closed:
                raise RuntimeError("The executor has been shut down.")
            self._tasks.put(task)
        return task.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks; see `concurrent.futures.Executor.shutdown`.

        Beyond what that promises, `cancel_futures` also kills tasks that run: their futures raise `Cancelled`.
        """
        with self._lock:
            first, self._closed = not self._closed, True
            self._end.detach()
            if cancel_futures:
                _dismiss(self._crew, self._tasks)
            elif first:
                for _ in self._crew:
                    self._tasks.put(None)
        if wait:
            for thread in self._threads:
                thread.join()


def _dismiss(crew: list[_Worker], tasks: queue.SimpleQueue[_Task | None]) -> None:
    """Drop the waiting tasks and kill the children; their threads end by themselves."""
    try:
        while task := tasks.get_nowait():
            task.future.cancel()
            task.future.set_running_or_notify_cancel()
    except queue.Empty:
        pass
    for worker in crew:
        worker.kill()
        tasks.put(None)


class _Died(Exception):
    """A child ended before it answered."""


class _Worker:
    """One child at a time, replaced when it dies, and the pipes to it."""

    def __init__(self, preload: str, python: Sequence[str], gives_way: bool) -> None:
        self.peak_memory_mb = 0.0
        self._preload = preload
        self._python = python
        self._gives_way = gives_way
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] | None = None
        self._killed = False
        self._lock = threading.Lock()
        self._sending = threading.Lock()

    def work(self, tasks: queue.SimpleQueue[_Task | None]) -> None:
        """Do tasks until the queue holds None (a thread's whole life)."""
        with contextlib.suppress(OSError, Cancelled):  # the first task tries again and tells its future
            self._start()
        while (task := tasks.get()) is not None:
            if task.future.set_running_or_notify_cancel():
                self._do(task)
            del task  # not kept while waiting for the next
        self._stop()

    def finish(self) -> None:
        """Ask the child to end its task early."""
        with contextlib.suppress(_Died, OSError, Cancelled):
            self._send(self._start(), FINISH_MESSAGE)

    def kill(self) -> None:
        """End the child now, and start no other."""
        with self._lock:
            self._killed = True
            if self._process is not None:
                self._process.kill()

    def _do(self, task: _Task) -> None:
        try:
            answer = self._answer(task)
        except Exception as error:
            answer = Answer(None, error, self.peak_memory_mb)
        self.peak_memory_mb = answer.peak_memory_mb
        if answer.error is None:
            task.future.set_result(answer.value)
        else:
            task.future.set_exception(answer.error)

    def _answer(self, task: _Task) -> Answer:
        words = ""
        for _ in range(task.attempts):
            try:
                process = self._start()
                self._send(process, task.message)
                while not isinstance(said := _next(process), Answer):
                    task.report(said)
                return said
            except _Died:
                words = self._stop()
                if self._killed:
                    raise Cancelled("The work was cancelled.") from None
            except OSError as error:
                raise WorkerError(f"The solver's process could not be started ({error}).") from error
        times = f" {task.attempts} times" if task.attempts > 1 else ""
        raise WorkerError(f"The solver's process ended{times} before its work was done{': ' if words else ''}{words}.")

    def _start(self) -> subprocess.Popen[bytes]:
        """Return the child, a new one where there is none."""
        with self._lock:
            if self._killed:
                raise Cancelled("The work was cancelled.")
            if self._process is None:
                self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the child has ended
                self._process = start_child(
                    self._preload, stderr=self._log, python=self._python, gives_way=self._gives_way
                )
            return self._process

    def _send(self, process: subprocess.Popen[bytes], message: Parts) -> None:
        try:
            with self._sending:
                send(cast(FileIO, process.stdin), message)
        except (OSError, ValueError) as error:
            raise _Died from error

    def _stop(self) -> str:
        """End the child, which has nothing to do, and return the last line that it wrote to its log."""
        with self._lock:
            process, self._process = self._process, None
            log, self._log = self._log, None
        if process is not None:
            cast(FileIO, process.stdin).close()
            cast(FileIO, process.stdout).close()
            try:
                process.wait(SECONDS_TO_END)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if log is None:
            return ""
        with log:
            log.seek(0)
            lines = log.read().decode("utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else ""


def _next(process: subprocess.Popen[bytes]) -> Any:
    """Wait for what the child says next: `Progress`, or its `Answer`."""
    try:
        parts = receive(cast(FileIO, process.stdout))
    except (OSError, EOFError, ValueError) as error:
        raise _Died from error
    return unpack(parts, PACKAGE)


def physical_cores() -> int:
    """Number of physical cores that this process may use.

    joblib knows Windows, macOS and Linux, processor affinity and the limits of containers, which is more than
    `os.sched_getaffinity` and /proc tell; scikit-learn brings it along.
    """
    from joblib import cpu_count  # takes its time, and is needed only where many workers are wanted

    return max(1, int(cpu_count(only_physical_cores=True)))
