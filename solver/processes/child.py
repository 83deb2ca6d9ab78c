"""Child processes: a plain Python that has loaded this folder (see `child_main`) and talks through private pipes.

Never a pool or a fork: those hang, or leave processes and windows behind, when they start inside Blender.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

THREAD_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Set to 1: the solver's stacked small products are ten times slower with threaded BLAS; NumPy reads them on import."""


def start_child(
    module: str,
    *arguments: str,
    python: Sequence[str] = (),
    stderr: IO[bytes],
    cwd: Path | None = None,
    gives_way: bool = False,
) -> subprocess.Popen[bytes]:
    """Start a Python that calls `serve(*arguments)` of the solver's module of this name.

    The child finds what this process finds: it gets the module search path, which leads to SciPy.

    Parameters
    ----------
    module
        Name of the module inside this package.
    arguments
        Handed to its `serve`.
    python
        The command that starts a plain Python, with its options; this process's own where empty.
    stderr
        Where the child's complaints go; not a pipe, which nobody would empty.
    cwd
        Its working folder.
    gives_way
        Whether it takes processors only while nothing else wants them; children that it starts do the same.
    """
    order = {
        "module_search_path": [str(p) for p in sys.path],
        "module": module,
        "arguments": arguments,
        "gives_way": gives_way,  # elsewhere than on Windows the child sees to that itself
    }
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0) | getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
    if gives_way:
        flags |= getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
    script = Path(__file__).resolve().with_name("child_main.py")
    return subprocess.Popen(
        [*(python or (sys.executable,)), str(script), json.dumps(order)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        env={**os.environ, **dict.fromkeys(THREAD_COUNTS, "1")},
        cwd=cwd,
        creationflags=flags,
    )


def private_channels() -> tuple[int, int]:
    """Child's side: take standard input and output for messages; returns their file descriptors.

    Whatever prints from now on goes to standard error.  Nothing else sees the owner's pipe: on Windows, loading a
    library that looks at standard input would wait for a thread that reads from it.  An interrupt from the keyboard
    is the owner's to handle.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    incoming, outgoing = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return incoming, outgoing


def stop_giving_way() -> None:
    """Child's side: take its turn again, where the system allows it; what is to end must not wait for others' work.

    Linux lets idle processes do so with the right to set priorities only.
    """
    if not hasattr(os, "SCHED_IDLE"):
        return
    with contextlib.suppress(OSError):
        for thread in os.listdir("/proc/self/task"):
            os.sched_setscheduler(int(thread), os.SCHED_OTHER, os.sched_param(0))


def last_words(log: IO[bytes]) -> str:
    """Return the last line that a child wrote to its log, or nothing."""
    log.seek(0)
    lines = log.read().decode("utf-8", errors="replace").strip().splitlines()
    return lines[-1].strip() if lines else ""


def close_streams(process: subprocess.Popen[Any]) -> None:
    """Close an ended child's pipes, whatever they still hold."""
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):  # what was buffered has no reader any more
                stream.close()
