"""Starts child processes: each a plain Python that has loaded this folder, with pipes to it.

Never a fork: inside Blender that leaves processes and windows behind.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from . import child_main
from .channel import OWN_PACKAGE

THREAD_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Set to 1: the solver's stacked small products are ten times slower with threaded BLAS; NumPy reads them on import."""


def start_child(
    preload: str, *, stderr: IO[bytes], python: Sequence[str] = (), gives_way: bool = False
) -> subprocess.Popen[bytes]:
    """Start a Python that does what it is told through its pipes (see `service.serve`).

    Parameters
    ----------
    preload
        The module of this package that it imports before its first task.
    stderr
        Where its complaints go; not a pipe, which nobody would empty.
    python
        The command that starts a plain Python, with its options; this process's own where empty.
    gives_way
        Whether it takes processors only while nothing else wants them; children that it starts do the same.
    """
    order = {
        "module_search_path": [str(place) for place in sys.path],  # it leads to SciPy, inside Blender too
        "gives_way": gives_way,  # except on Windows the child sees to that itself
        "owners_package": OWN_PACKAGE,
        "preload": preload,
    }
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0) | getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
    if gives_way:
        flags |= getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
    return subprocess.Popen(
        [*(python or (sys.executable,)), str(Path(child_main.__file__).resolve()), json.dumps(order)],
        bufsize=0,  # a thread that waits in a buffer would abort the interpreter's regular end
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        env={**os.environ, **dict.fromkeys(THREAD_COUNTS, "1")},
        creationflags=flags,
    )
