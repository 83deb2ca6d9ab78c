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

LEAST_TO_WRITE, TO_WRITE = 16 << 20, 600
"""Bytes that it takes to write a surface, and those for each vertex.  They are asked for, but not touched."""


class LastSurface:
    """The surface that a computation only has to measure.

    It is blended when it is reported, and memory to write it is set aside: where memory ends later, too little may be
    left for either.

    Attributes
    ----------
    vertices
        Its vertices, (V, 3); None as long as it is being fitted.
    """

    def __init__(self) -> None:
        self.vertices: Any = None
        self._stage = ""
        self._set_aside: bytearray | None = None

    def give_back(self) -> None:
        """Free the memory that was set aside."""
        self._set_aside = None

    def noting(self, show: Callable[[Progress], None]) -> Callable[[Progress], None]:
        """Return what shows progress by `show` and keeps the surface."""

        def note(step: Progress) -> None:
            if step.stage in FINISHED and step.stage != self._stage and step.surface is not None:
                self._stage, self.vertices = step.stage, step.surface()
                if self._set_aside is None:
                    with contextlib.suppress(MemoryError):  # then there is enough to write it, or there is not
                        self._set_aside = bytearray(LEAST_TO_WRITE + TO_WRITE * len(self.vertices))
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
