"""Progress while a command works."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterator
from typing import Any

from ..solver.progress import Progress
from .console import QUIET, console

try:
    from tqdm import tqdm
except ImportError:  # Blender does not bring it
    tqdm = None


FINISHED = ("Bounding the error", "Blending", "Measuring")
"""Stages of the progress in which the surface does not change any more."""


class LastSurface:
    """The newest surface that a computation has reported."""

    def __init__(self) -> None:
        self._newest: Callable[[], Any] | None = None

    @property
    def is_finished(self) -> bool:
        """Whether there is one that only had to be measured."""
        return self._newest is not None

    def vertices(self) -> Any:
        """Return its vertices, (V, 3)."""
        return self._newest() if self._newest is not None else None

    def noting(self, show: Callable[[Progress], None]) -> Callable[[Progress], None]:
        """Return what shows progress by `show` and keeps the surface."""

        def note(step: Progress) -> None:
            if step.stage in FINISHED and step.surface is not None:
                self._newest = step.surface
            show(step)

        return note


@contextlib.contextmanager
def progress_display(name: str) -> Iterator[Callable[[Progress], None]]:
    """Show progress: a bar on a terminal if tqdm is installed, plain lines otherwise, nothing if quiet."""
    if console.level == QUIET:
        yield lambda step: None
        return
    if tqdm is None or not sys.stderr.isatty():
        yield _PlainLines(name)
        return
    with tqdm(total=100.0, desc=name, bar_format="{desc}: {percentage:3.0f}%|{bar}| {postfix} {remaining}") as bar:

        def show(step: Progress) -> None:
            bar.set_postfix_str(" ".join(part for part in (step.stage, step.detail) if part), refresh=False)
            bar.update(100.0 * step.fraction - bar.n)

        yield show


@dataclasses.dataclass
class _PlainLines:
    """Prints a line for each stage and each tenth of the work."""

    name: str
    _said: tuple[str, int] = ("", -1)

    def __call__(self, step: Progress) -> None:
        now = (step.stage, int(10.0 * step.fraction))
        if now != self._said:
            self._said = now
            detail = f" ({step.detail})" if step.detail else ""
            console.say(f"{self.name}: {step.fraction:4.0%} {step.stage}{detail}")
