"""A script that makes a shell complete commands, options and files: `--print-completion bash`."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..solver.errors import SparseSurfaceError
from .outputs import Output

try:
    import shtab
except ImportError:  # an optional extra
    shtab = None

SHELLS = ("bash", "zsh", "tcsh")
SCRIPT = "sparse-surface"
"""The program whose words are completed: the script that pip installs."""

NO_SHTAB = 'Completion takes shtab: pip install "sparse-surface[completion]".'


class PrintCompletion(argparse.Action):
    """Prints the script and ends."""

    def __call__(self, parser: argparse.ArgumentParser, options: argparse.Namespace, shell: Any, *_: Any) -> None:
        """Print the script for a shell."""
        print(completion(parser, shell))
        parser.exit()


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return the script that completes the words of a parser.

    Raises
    ------
    SparseSurfaceError
        Where shtab is not installed.
    """
    if shtab is None:
        raise SparseSurfaceError(NO_SHTAB)
    for action in _actions(parser):
        if action.type is Path or getattr(action.type, "__func__", None) is Output.path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    parser.prog = SCRIPT
    return str(shtab.complete(parser, shell=shell))


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:  # argparse has no public way to them; shtab goes this one too
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
        else:
            yield action
