"""What a command says on a terminal or to another program: as much as was asked for, colours on terminals."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from typing import Any, TextIO

QUIET, NORMAL, VERBOSE = 0, 1, 2
BOLD, RED = "1", "31;1"


@dataclass
class Console:
    """How much is said, and whether standard output holds one JSON document and nothing else.

    Attributes
    ----------
    level
        `QUIET`: errors only.  `NORMAL`: progress and a line about each result.  `VERBOSE`: also where the time went.
    json
        Whether figures are printed as JSON; what people read goes to standard error then.
    """

    level: int = NORMAL
    json: bool = False

    @property
    def stream(self) -> TextIO:
        """Where lines for people go."""
        return sys.stderr if self.json else sys.stdout

    def say(self, text: str, name: str = "") -> None:
        """Print a line about a result unless the command is quiet; the name that it begins with stands out."""
        if self.level > QUIET:
            begin = painted(name, BOLD, self.stream) if name and text.startswith(name) else name
            print(begin + text.removeprefix(name), file=self.stream, flush=True)

    def detail(self, report: dict[str, Any]) -> None:
        """Print where a result's time and memory went, if the command is verbose."""
        if self.level < VERBOSE:
            return
        times = [f"{stage} {spent:.2f} s" for stage, spent in report["seconds"].items() if stage != "total"]
        self.say(f"  {', '.join(times)}")
        why = report.get("numpy_reason")
        solver = f"NumPy ({why})" if why else "the compiled kernel"
        memory, workers = report["peak_memory_mb"], report["workers"]
        self.say(f"  fitted by {solver}, workers: {workers}, memory: {memory:.0f} MB at most")

    def figures(self, values: Any) -> None:
        """Print values as JSON where that was asked for."""
        if self.json:
            print(json.dumps(values, indent=2), flush=True)

    def complain(self, text: str, program: str) -> None:
        """Print in one line, on standard error, what is wrong."""
        print(f"{painted(f'{program}:', RED, sys.stderr)} {text}", file=sys.stderr, flush=True)


def painted(text: str, colour: str, stream: TextIO) -> str:
    """Return text in a colour if the stream is a terminal that shows colours (https://no-color.org)."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM", "") in ("", "dumb")
    return text if plain or not stream.isatty() else f"\x1b[{colour}m{text}\x1b[0m"


console = Console()
"""The one of this process; `main` sets it up."""
