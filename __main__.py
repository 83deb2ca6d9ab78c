"""`python -m sparse_surface`: the command line."""

from __future__ import annotations

import os
import signal
import sys

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""What asks a command to end, by any system's name."""

ENDED_BY_SIGNAL = 128
"""Added to a signal's number: the exit code that shells know."""


def main() -> None:
    """Run the command line with the process's arguments, and leave with its exit code."""
    for name in SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _leave)  # until the guard listens: it takes a moment to load
    from .command_line.guard import main as run

    run(f"{__package__}.command_line.guarded", sys.argv[1:])


def _leave(number: int, _: object) -> None:
    os.write(2, b"sparse_surface: cancelled\n")
    os._exit(ENDED_BY_SIGNAL + number)


if __name__ == "__main__":
    main()
