"""The child's side: does the tasks that its owner sends, says how they go, and ends when the owner says no more.

A task is a function that the child can import, with its arguments, and whether `Progress` is to bring the surface as
it stands.  The answer is an `Answer`; where the function returns `Steps`, `Progress` comes before it, no more often
than an owner can use it.
"""

from __future__ import annotations

import os
import queue
import signal
import threading
import time
import traceback
from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from io import FileIO
from typing import Any, NamedTuple

import numpy as np

from ..errors import WorkerError
from ..progress import FINISH, Progress, run_to_end
from .channel import OWN_PACKAGE, Parts, pack, receive, send, unpack
from .child_main import give_way, give_way_entirely, stop_giving_way
from .memory import peak_memory_mb

UNTIL_A_PICTURE = 0.7
"""Seconds for which a task that is watched takes its turns beside others' work, unless its first picture is out before:
a window that is drawn by software leaves no processor idle."""

SECONDS_BETWEEN_MESSAGES = 0.05
SECONDS_BETWEEN_PREVIEWS = 0.5
PREVIEW_REST = 5.0
"""The next preview comes no earlier than this many times the processor seconds of the last one: a large mesh is solved,
too, not only shown."""


class Answer(NamedTuple):
    """What came of a task: its value, or the exception that it raised; and the child's peak memory so far."""

    value: Any
    error: Exception | None
    peak_memory_mb: float


def serve(owners_package: str, preload: str, *, gives_way: bool) -> None:
    """Do tasks until standard input closes, which ends this process whatever it is doing.

    It loads its modules before it gives way: that takes less than a second, but a window that is drawn by software
    keeps every processor for much longer, and whoever presses the button meanwhile waits for the modules.  Until the
    first picture it still takes its turns, though fewer than others, for the same reason.
    """
    incoming, outgoing = _private_channels()
    owner = _Owner(incoming)
    import_module(f"{OWN_PACKAGE}.{preload}")
    if gives_way:
        give_way()
    while True:
        send(outgoing, _answer(owner, outgoing, owners_package, _Turns(gives_way, owner.finish)))


def _private_channels() -> tuple[FileIO, FileIO]:
    """Take standard input and output for messages; whatever prints from now on goes to standard error.

    Nothing else sees the owner's pipe: on Windows, loading a library that looks at standard input would wait for a
    thread that reads from it.  An interrupt from the keyboard is the owner's to handle.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    incoming, outgoing = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return os.fdopen(incoming, "rb", buffering=0), os.fdopen(outgoing, "wb", buffering=0)


class _Owner:
    """What the owner says, read by a thread; the end of its words is the end of this process."""

    def __init__(self, incoming: FileIO) -> None:
        self.tasks: queue.SimpleQueue[Parts] = queue.SimpleQueue()
        self.finish = threading.Event()
        threading.Thread(target=self._listen, args=(incoming,), daemon=True).start()

    def _listen(self, incoming: FileIO) -> None:
        try:
            while True:
                message = receive(incoming)
                if message:
                    self.tasks.put(message)
                else:
                    self.finish.set()
                    stop_giving_way()  # the owner waits for what there is
        except (EOFError, OSError):
            stop_giving_way()
            os._exit(0)


class _Turns:
    """When a process that gives way takes its turns beside others' work: until the first picture that is waited for."""

    def __init__(self, gives_way: bool, finish: threading.Event) -> None:
        self._gives_way = gives_way
        self._finish = finish
        self._timer = threading.Timer(UNTIL_A_PICTURE, self.end)
        self._timer.daemon = True

    def begin(self, watched: bool) -> None:
        """Take turns for a while if somebody watches."""
        if watched and self._gives_way:
            self._timer.start()
        else:
            self.end()

    def end(self) -> None:
        """Leave the processors to others from now on, unless the owner waits for the end."""
        self._timer.cancel()
        if self._gives_way and not self._finish.is_set():
            self._gives_way = False
            give_way_entirely()


def _answer(owner: _Owner, outgoing: FileIO, owners_package: str, turns: _Turns) -> Parts:
    """Wait for the next task, do it and return the packed answer."""
    message = owner.tasks.get()
    try:
        function, args, kwargs, previews = unpack(message, owners_package)
        turns.begin(previews)
        value = function(*args, **kwargs)
        if isinstance(value, Generator):
            value = run_to_end(value, _Reporter(owner, outgoing, previews, turns))
        return pack(Answer(value, None, peak_memory_mb()))
    except Exception as error:
        error.add_note("In a worker process:\n" + traceback.format_exc())
        return _packed_failure(error)
    finally:
        turns.end()


def _packed_failure(error: Exception) -> Parts:
    try:
        message = pack(Answer(None, error, peak_memory_mb()))
        unpack(message, OWN_PACKAGE)  # an exception may be written that cannot be read
    except Exception:
        substitute = WorkerError(f"The solver failed ({type(error).__name__}: {error}).")
        return pack(Answer(None, substitute, peak_memory_mb()))
    return message


@dataclass
class _Reporter:
    """Passes progress on to the owner, and the owner's wish to finish back."""

    owner: _Owner
    outgoing: FileIO
    previews: bool
    turns: _Turns
    _stage: str = ""
    _sent: float = 0.0
    _next_shown: float = 0.0

    def __call__(self, step: Progress) -> str | None:
        now = time.monotonic()
        surface = None
        if self.previews and step.surface is not None and now >= self._next_shown:
            before = time.thread_time()
            surface = partial(np.asarray, step.surface().astype(np.float32))
            took = time.thread_time() - before
            self._next_shown = now + max(SECONDS_BETWEEN_PREVIEWS, PREVIEW_REST * took)
        if surface or step.stage != self._stage or now - self._sent >= SECONDS_BETWEEN_MESSAGES:
            self._stage, self._sent = step.stage, now
            send(self.outgoing, pack(replace(step, surface=surface)))
            if surface:
                self.turns.end()
        return FINISH if self.owner.finish.is_set() else None
