"""`python -m sparse_surface.benchmarks`, and `python -m sparse_surface benchmark`: measure speed and accuracy."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from .command import PARTS, benchmark

MODELS = Path(__file__).resolve().parent.parent.parent / "shared" / "models"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what the arguments name; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="sparse_surface benchmark",
        description="Measure speed, in units of a matrix product, and accuracy; prints tables.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument(
        "--models", nargs="+", metavar="MODEL", help="generated, downloaded, or mesh files; default: all"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="file for all figures")
    parser.add_argument("--docs", type=Path, metavar="FOLDER", help="folder of the pages that take figures from here")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), help="measure only this")
    parser.add_argument("--largest", type=int, default=1_000_000, metavar="N", help="vertices of the largest terrain")
    parser.add_argument("--folder", type=Path, default=MODELS, metavar="FOLDER", help="where downloaded models are")
    options = parser.parse_args(arguments)
    for folder in (options.docs, options.json and options.json.absolute().parent):
        if folder is not None and not folder.is_dir():
            parser.error(f"there is no folder '{folder}'")
    benchmark(options.models, options.json, options.docs, options.largest, options.folder, options.only)
    return 0


if __name__ == "__main__":
    sys.exit(main())
