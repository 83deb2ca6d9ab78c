"""A `concurrent.futures.Executor` over child processes that starts safely inside Blender and outside, on every system.

Each child is a plain Python with this folder loaded (see `child`); a thread feeds it one task at a time through its
pipes.  A child that dies is replaced and its task done anew.  Children end when their standard input closes, so even a
killed owner leaves none behind.

Functions and classes travel by name.  The package's name may differ on both sides (``bl_ext...`` exists only inside
Blender), so each side reads the other's names as its own.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import queue
import subprocess
import tempfile
import threading
import traceback
import weakref
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from importlib import import_module
from typing import IO, Any, ParamSpec, TypeVar

from ..errors import Cancelled, WorkerError
from .child import close_streams, last_words, private_channels, start_child, stop_giving_way
from .child_main import PACKAGE
from .memory import peak_memory_mb

Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")

ATTEMPTS = 3
"""How often a task is begun before its workers' deaths are put down to the task."""

SECONDS_TO_END = 5.0

OWN_PACKAGE = __name__.removesuffix(".processes.pool")

LENGTH_BYTES = 8

Task = tuple[Future[Any], bytes]


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
    """

    def __init__(self, workers: int, *, preload: str = "errors", python: Sequence[str] = ()) -> None:
        self.workers = workers
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._crew = [_Worker(preload, python) for _ in range(workers)]
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
        message = pickle.dumps((function, args, kwargs), protocol=pickle.HIGHEST_PROTOCOL)
        future: Future[Result] = Future()
        with self._lock:
            if self._closed:
                raise RuntimeError("The executor has been shut down.")
            self._tasks.put((future, message))
        return future

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


def _dismiss(crew: list[_Worker], tasks: queue.SimpleQueue[Task | None]) -> None:
    """Drop the waiting tasks and kill the children; their threads end by themselves."""
    try:
        while task := tasks.get_nowait():
            task[0].cancel()
            task[0].set_running_or_notify_cancel()
    except queue.Empty:
        pass
    for worker in crew:
        worker.kill()
        tasks.put(None)


class _Died(Exception):
    """A child ended before it answered; the text is its last words."""


class _Worker:
    """One child at a time, replaced when it dies, and the pipes to it."""

    def __init__(self, preload: str, python: Sequence[str]) -> None:
        self.peak_memory_mb = 0.0
        self._preload = preload
        self._python = python
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] | None = None
        self._killed = False
        self._lock = threading.Lock()

    def work(self, tasks: queue.SimpleQueue[Task | None]) -> None:
        """Do tasks until the queue holds None (a thread's whole life)."""
        with contextlib.suppress(OSError, Cancelled):  # the first task tries again and tells its future
            self._start()
        while (task := tasks.get()) is not None:
            future, message = task
            if future.set_running_or_notify_cancel():
                self._do(future, message)
            del task, future, message  # not kept while waiting for the next
        self._stop()

    def kill(self) -> None:
        """End the child now, and start no other."""
        with self._lock:
            self._killed = True
            if self._process is not None:
                self._process.kill()

    def _do(self, future: Future[Any], message: bytes) -> None:
        try:
            succeeded, answer, self.peak_memory_mb = self._answer(message)
        except Exception as error:
            future.set_exception(error)
            return
        if succeeded:
            future.set_result(answer)
        else:
            future.set_exception(answer)

    def _answer(self, message: bytes) -> tuple[bool, Any, float]:
        words = ""
        for _ in range(ATTEMPTS):
            try:
                process = self._start()
                answer: tuple[bool, Any, float] = _unpickle(_exchange(process, message), PACKAGE)
                return answer
            except _Died:
                words = self._stop()
                if self._killed:
                    raise Cancelled("The work was cancelled.") from None
            except OSError as error:
                raise WorkerError(f"No worker process could be started ({error}); one worker needs none.") from error
        said = f" ({words})" if words else ""
        raise WorkerError(f"Worker processes died {ATTEMPTS} times at the same task{said}.")

    def _start(self) -> subprocess.Popen[bytes]:
        """Return the child, a new one where there is none."""
        with self._lock:
            if self._killed:
                raise Cancelled("The work was cancelled.")
            if self._process is None:
                self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the child has ended
                self._process = start_child(
                    "processes.pool", OWN_PACKAGE, self._preload, python=self._python, stderr=self._log
                )
            return self._process

    def _stop(self) -> str:
        """End the child, which has nothing to do, and return its last words."""
        with self._lock:
            process, self._process = self._process, None
            log, self._log = self._log, None
        words = ""
        if process is not None:
            close_streams(process)
            try:
                process.wait(SECONDS_TO_END)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if log is not None:
            words = last_words(log)
            log.close()
        return words


def _exchange(process: subprocess.Popen[bytes], message: bytes) -> bytes:
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        _write(process.stdin, message)
        return _read(process.stdout)
    except (OSError, EOFError, ValueError) as error:
        raise _Died from error


def _write(stream: IO[bytes], message: bytes) -> None:
    stream.write(len(message).to_bytes(LENGTH_BYTES, "little"))
    stream.write(message)
    stream.flush()


def _read(stream: IO[bytes]) -> bytes:
    length = int.from_bytes(_read_exactly(stream, LENGTH_BYTES), "little")
    return _read_exactly(stream, length)


def _read_exactly(stream: IO[bytes], length: int) -> bytes:
    data = stream.read(length)
    if len(data) < length:
        raise EOFError
    return data


class _Unpickler(pickle.Unpickler):
    """Reads what another process has written whose name of this package is `theirs`."""

    def __init__(self, data: bytes, theirs: str) -> None:
        super().__init__(io.BytesIO(data))
        self._theirs = theirs

    def find_class(self, module: str, name: str) -> Any:
        if module == self._theirs or module.startswith(f"{self._theirs}."):
            module = f"{OWN_PACKAGE}{module[len(self._theirs) :]}"
        return super().find_class(module, name)


def _unpickle(data: bytes, theirs: str) -> Any:
    return _Unpickler(data, theirs).load()


# The child's side


def serve(owners_package: str, preload: str) -> int:
    """Do tasks until standard input closes, which ends this process whatever it is doing."""
    incoming, outgoing = private_channels()
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(os.fdopen(incoming, "rb"), tasks), daemon=True).start()
    import_module(f"{OWN_PACKAGE}.{preload}")
    with os.fdopen(outgoing, "wb") as answers:
        while True:
            _write(answers, _answer_to(tasks.get(), owners_package))


def _receive(stream: IO[bytes], tasks: queue.SimpleQueue[bytes]) -> None:
    try:
        while True:
            tasks.put(_read(stream))
    except (EOFError, OSError):
        stop_giving_way()
        os._exit(0)


def _answer_to(message: bytes, owners_package: str) -> bytes:
    """The pickled answer: whether it worked, the result or the exception, and this process's peak memory."""
    try:
        function, args, kwargs = _unpickle(message, owners_package)
        return pickle.dumps((True, function(*args, **kwargs), peak_memory_mb()), protocol=pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        error.add_note("In a worker process:\n" + traceback.format_exc())
        return _pickled_failure(error)


def _pickled_failure(error: Exception) -> bytes:
    try:
        message = pickle.dumps((False, error, peak_memory_mb()))
        pickle.loads(message)  # an exception may be written that cannot be read
    except Exception:
        substitute = WorkerError(f"The solver failed ({type(error).__name__}: {error}).")
        return pickle.dumps((False, substitute, peak_memory_mb()))
    return message


def physical_cores() -> int:
    """Number of physical cores that this process may use."""
    from joblib import cpu_count  # only where many workers are wanted: it comes with scikit-learn, and takes its time

    return max(1, int(cpu_count(only_physical_cores=True)))
