"""The process that works: `python -m sparse_surface.command_line.guarded`, started by `guard` in its own folder."""

from __future__ import annotations

import os
import sys
import threading
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

from ..solver.atomic_files import note_drafts, remove_drafts
from .guard import FOLDER, REFUSED

if sys.platform != "win32":
    import resource

LEAST_MEMORY = 2 << 30
"""Bytes of address space below which a process with Blender, NumPy and SciPy cannot be sure to start."""

NO_MEMORY = "There is not enough memory for this."


class LastingStream:
    """A standard stream that goes nowhere when nobody reads it or there is no room: the results are written anyway."""

    def __init__(self, number: int, encoding: str) -> None:
        # for a character that the encoding lacks, its code
        self._stream = os.fdopen(number, "w", encoding=encoding, errors="backslashreplace", buffering=1, closefd=False)
        self._lost: list[TextIO] = []

    def write(self, text: str) -> int:
        """Write text; returns its length."""
        try:
            return self._stream.write(text)
        except OSError:
            self._give_up()
            return len(text)

    def flush(self) -> None:
        """Send what was written."""
        try:
            self._stream.flush()
        except OSError:
            self._give_up()

    def _give_up(self) -> None:
        self._lost.append(self._stream)  # closed, it would complain again
        self._stream = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def main() -> None:
    """Run the command line and leave at once: Blender's own way out may never end."""
    folder = Path(os.environ.pop(FOLDER))
    note_drafts(folder)
    threading.Thread(target=_end_with_owner, args=(folder,), daemon=True).start()
    _take_streams(folder)
    code = _run()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _run() -> int:
    if _address_space() < LEAST_MEMORY:
        return _refuse(f"{NO_MEMORY} Its address space is limited to {_address_space() / 2**30:.1f} GB (ulimit -v).")
    try:
        from .main import main as run  # NumPy: there must be memory for it

        return run(sys.argv[1:])
    except MemoryError:
        return _refuse(NO_MEMORY)
    except BaseException:  # a fault of this program: all of it is to be seen, and the process ends nevertheless
        traceback.print_exc()
        return REFUSED


def _refuse(text: str) -> int:
    print(f"sparse_surface: {text}", file=sys.stderr)
    return REFUSED


def _address_space() -> float:
    """Return the bytes that this process may map."""
    if sys.platform == "win32":
        return float("inf")
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return float("inf") if limit == resource.RLIM_INFINITY else float(limit)


def _take_streams(folder: Path) -> None:
    """Keep the standard streams for what the command says; what libraries print goes to a file that nobody reads."""
    own = [os.dup(number) for number in (1, 2)]
    log = os.open(folder / "log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in (1, 2):
        os.dup2(log, number)
    sys.stdout, sys.stderr = (
        LastingStream(number, getattr(like, "encoding", "utf-8"))
        for number, like in zip(own, (sys.stdout, sys.stderr), strict=True)
    )


def _end_with_owner(folder: Path) -> None:
    """Wait for the end of the process that started this one, which keeps the other end of standard input open."""
    with suppress(OSError):
        while os.read(0, 1 << 10):
            pass
    remove_drafts(folder)
    os._exit(REFUSED)


if __name__ == "__main__":
    main()
