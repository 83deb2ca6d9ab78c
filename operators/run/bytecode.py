"""Has the solver's modules translated into bytecode once after an installation, before the first run waits for it."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from importlib.util import cache_from_source
from pathlib import Path

SOLVER = Path(__file__).resolve().parents[2] / "solver"

_LOADED_BY_CHILDREN = SOLVER / "approximation" / "approximate.py"
"""A module that Blender's own process never loads."""

_TRANSLATE = """
import compileall, os, sys
if hasattr(os, "nice"):
    os.nice(10)
compileall.compile_dir(sys.argv[1], quiet=2)
"""

_process: subprocess.Popen[bytes] | None = None


def is_needed() -> bool:
    """Whether there is no bytecode, and a place for it."""
    return not Path(cache_from_source(str(_LOADED_BY_CHILDREN))).exists() and os.access(SOLVER, os.W_OK)


def begin(python: Sequence[str]) -> None:
    """Start a process that translates what is not yet translated; it takes a second and ends by itself."""
    global _process
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0) | getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
    nothing = subprocess.DEVNULL
    _process = subprocess.Popen(
        [*python, "-c", _TRANSLATE, str(SOLVER)], stdin=nothing, stdout=nothing, stderr=nothing, creationflags=flags
    )


def stop() -> None:
    """End that process: the folder may be about to be removed."""
    global _process
    if _process is not None:
        _process.kill()
        _process.wait()
        _process = None
