"""The command line: `python -m sparse_surface ...` and `blender --command sparse_surface ...`.

Exit codes: 0 done, 1 refused input (one line on standard error), 2 wrong usage, 130 cancelled; `guard` gives other
signals theirs.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec

from ..solver.errors import SettingsError, SparseSurfaceError
from .arguments import PROGRAM, parse
from .console import NORMAL, QUIET, VERBOSE, console

DONE, REFUSED, WRONG_USAGE, CANCELLED = 0, 1, 2, 130

NO_BLENDER = "Files are read with Blender: install its Python module (pip install bpy) or run in Blender."
BLENDERS_PYTHONS = ((3, 11), (3, 13))
OTHER_PYTHON = " The module exists for Python 3.11 and 3.13 only."

WITHOUT_BLENDER = ("approximate", "evaluate", "inspect")
"""Commands that can do without."""

BLOCKS = ("block_size", "cluster", "resume")
"""Arguments with which a mesh is approximated in blocks."""

NO_THREAD = "can't start new thread"
"""What Python says, with an error of no kind of its own, where there is no memory for a thread's stack."""

NO_MEMORY = "There is not enough memory for this mesh"

NO_BENCHMARK = "The benchmark comes with the source code, not with the extension."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code.

    This replaces the scene that is open in Blender: run it in a process of its own.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    try:
        return _run(words)
    except SystemExit as end:  # argparse has said why
        return int(end.code or DONE)
    except SettingsError as error:
        return _refuse(error, WRONG_USAGE)
    except (SparseSurfaceError, OSError, MemoryError) as error:
        return _refuse(error, REFUSED)
    except RuntimeError as error:
        if NO_THREAD not in str(error):
            raise
        return _refuse(MemoryError(str(error)), REFUSED)
    except KeyboardInterrupt:
        console.complain("cancelled", PROGRAM)
        return CANCELLED


def _run(words: list[str]) -> int:
    if words[:1] == ["benchmark"]:  # a development tool: it is there in a checkout and where pip has installed it
        name = f"{__package__.rpartition('.')[0]}.benchmarks"
        if find_spec(name) is None:
            raise SettingsError(NO_BENCHMARK)
        return int(import_module(f"{name}.__main__").main(words[1:]))
    options = parse(words)
    console.json = options.json
    console.level = QUIET if options.quiet else VERBOSE if options.verbose else NORMAL
    module = options.command
    folder = options.command == "evaluate" and options.representation.is_dir()
    if folder or any(getattr(options, name, None) for name in BLOCKS):
        module = "in_blocks"
    elif find_spec("bpy") is None:
        if module not in WITHOUT_BLENDER:
            raise SparseSurfaceError(NO_BLENDER + ("" if sys.version_info[:2] in BLENDERS_PYTHONS else OTHER_PYTHON))
        module = "without_blender"
    return import_module(f".{module}", __package__).run(options) or DONE


def _refuse(error: BaseException, code: int) -> int:
    """Say in one line why nothing was done."""
    if isinstance(error, OSError) and error.strerror:
        where = f" '{os.fspath(error.filename)}'" if error.filename else ""
        text = f"{error.strerror}{where}."
    else:
        text = " ".join(str(error).split())
    if isinstance(error, MemoryError) and "not enough memory" not in text:
        text = f"{NO_MEMORY}{f' ({text[:1].lower()}{text[1:]})' if text else ''}."
    console.complain(text, PROGRAM)
    return code
