"""The script of every child process: loads the solver as a package of its own name and serves its owner.

It is started by its path because the package's name is not importable everywhere: Blender knows an
extension as ``bl_ext...``, which exists only inside Blender.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

PACKAGE = "sparse_surface_solver"


def give_way() -> None:
    """Take fewer turns than others, an owner's window above all; what this starts inherits it."""
    if sys.platform != "win32":  # there its owner started it with a lower priority
        os.nice(10)


def give_way_entirely() -> None:
    """Take processors only while nothing else wants them: this process, and those that it has started already.

    On Linux the lowest nice value would not do: a thread that wakes up still waits for the end of this process's time
    slice, and drawing one picture wakes threads dozens of times.  Idle processes are interrupted at once.
    """
    if hasattr(os, "SCHED_IDLE"):
        for thread in [*_own_threads(), *_threads_of_children()]:
            with suppress(OSError):  # forbidden in some containers; others end meanwhile
                os.sched_setscheduler(thread, os.SCHED_IDLE, os.sched_param(0))


def _own_threads() -> Iterator[int]:
    with suppress(OSError):
        yield from (int(thread) for thread in os.listdir("/proc/self/task"))


def _threads_of_children() -> Iterator[int]:
    for own in Path("/proc/self/task").glob("*/children"):
        for child in own.read_text().split():
            with suppress(OSError):
                yield from (int(thread) for thread in os.listdir(f"/proc/{child}/task"))


def stop_giving_way() -> None:
    """Take turns again, where the system allows it: a process that is to end must not wait for others' work.

    Linux allows it to processes with the right to set priorities only.
    """
    if hasattr(os, "SCHED_IDLE"):
        with suppress(OSError):
            for thread in _own_threads():
                os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))


def main(text: str) -> None:
    """Carry out the order that `child.start_child` wrote; the owner's module search path comes first of all."""
    order = json.loads(text)
    sys.path[:] = order["module_search_path"]
    folder = Path(__file__).resolve().parent.parent
    spec = importlib.util.spec_from_file_location(
        PACKAGE, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None
    assert spec.loader is not None
    sys.modules[PACKAGE] = package = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(package)
    serve = importlib.import_module(f"{PACKAGE}.processes.service").serve
    serve(order["owners_package"], order["preload"], gives_way=order["gives_way"])


if __name__ == "__main__":
    main(sys.argv[1])
