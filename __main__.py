"""`python -m sparse_surface`: the command line."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the command line with the process's arguments; returns the exit code."""
    from .command_line.guard import main as run

    return run(f"{__package__}.command_line.guarded", sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
