"""`python -m sparse_surface.benchmarks`, and `python -m sparse_surface benchmark`: measure speed and accuracy."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..solver.errors import InputError
from .command import OTHER_PARTS, PARTS, benchmark

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
    parser.add_argument("--keep", action="store_true", help="keep the tables in docs/measured.json, for the pages")
    parts = [*PARTS, *OTHER_PARTS]
    parser.add_argument("--only", nargs="+", choices=parts, default=parts, metavar="PART", help="measure only these")
    parser.add_argument("--largest", type=int, default=1_000_000, metavar="N", help="vertices of the largest terrain")
    parser.add_argument("--folder", type=Path, default=MODELS, metavar="FOLDER", help="where downloaded models are")
    options = parser.parse_args(arguments)
    if options.json is not None and not options.json.absolute().parent.is_dir():
        parser.error(f"there is no folder '{options.json.parent}'")
    if options.keep and options.models:
        parser.error("tables of some models are not kept")
    try:
        benchmark(options.models, options.json, options.largest, options.folder, options.only, keep=options.keep)
    except InputError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
