"""The process that a user starts: it lets another one work, and ends when that has ended, or when it is told to.

Blender handles signals, standard streams and its own exit in ways that a command must not: a signal in mid-render ends
well with a traceback, a full standard output aborts, some files keep it from ever ending, and its temporary files stay.
So whatever loads Blender runs in a child with a temporary folder of its own.  This process imports little, hears
signals from its first line on, and cleans up.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

from ..solver.atomic_files import remove_drafts, scratch_folder

FOLDER = "SPARSE_SURFACE_FOLDER"
"""Environment variable that tells the child its temporary folder."""

REFUSED = 1
ENDED_BY_SIGNAL = 128
"""Added to a signal's number: the exit code that shells know."""

CRASHED = "The work ended unexpectedly ({}), most likely for lack of memory."

_TEMPORARY = ("TMPDIR", "TEMP", "TMP")


class _Guard:
    """One child and the signal that ended it."""

    def __init__(self) -> None:
        self.signal = 0
        self._child: subprocess.Popen[bytes] | None = None
        for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
            number = getattr(signal, name, None)
            # What was started to outlive a terminal ignores its end; what a shell runs in the background hears no
            # interrupts.
            if number is not None and signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, self._hear)

    def _hear(self, number: int, _: FrameType | None) -> None:
        self.signal = self.signal or number
        self._kill()

    def run(self, command: list[str], folder: Path) -> int:
        """Run the child to its end; returns its exit code, negative for a signal."""
        environment = {**os.environ, FOLDER: str(folder), **dict.fromkeys(_TEMPORARY, str(folder))}
        # The child ends when its standard input does: that covers the death of this process.
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, env=environment, start_new_session=True)
        if self.signal:
            self._kill()
        return self._child.wait()

    def _kill(self) -> None:
        """End the child and what it has started, at once: it leaves nothing that is not cleaned up here."""
        child = self._child
        if child is None or child.returncode is not None:
            return
        with suppress(OSError):
            if hasattr(os, "killpg"):
                os.killpg(child.pid, signal.SIGKILL)
            else:
                child.kill()


def main(module: str, arguments: list[str]) -> NoReturn:
    """Let a child run a module with these arguments, and leave with its exit code.

    Python's own way out gives signals back to the system before it ends: one that comes then would end the process by
    itself, with another code and nothing said.
    """
    code = REFUSED
    try:
        code = _run(module, arguments)
    except BaseException:  # a fault of this program: all of it is to be seen
        traceback.print_exc()
    os._exit(code)


def _run(module: str, arguments: list[str]) -> int:
    guard = _Guard()
    _open_streams()
    folder = scratch_folder()
    try:
        code = guard.run([sys.executable, "-m", module, *arguments], folder) if not guard.signal else 0
    finally:
        remove_drafts(folder)
    if guard.signal:
        _say("cancelled")
        return ENDED_BY_SIGNAL + guard.signal
    if code < 0:
        _say(CRASHED.format(signal.Signals(-code).name))
        return REFUSED
    return code


def _open_streams() -> None:
    """Open the standard streams that are closed: a file that is opened later would take their places."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def _say(text: str) -> None:
    with suppress(OSError):
        os.write(2, f"sparse_surface: {text}\n".encode())
