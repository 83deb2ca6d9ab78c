"""Approximate thousands of generated meshes and tell what came of them.

    python tests/solver/reliability/many_meshes.py --count 12000 --first 0

Every mesh is made from its number alone (see `generated.case`), so a failure can be looked at again with
``--first N --count 1``.  The meshes are shared out to processes; each has a limit of time.
"""

from __future__ import annotations

import argparse
import collections
import os
import signal
import sys
import time
import traceback
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

sys.path.insert(0, str(Path(__file__).resolve().parent))
import generated
import numpy
import soundness

SECONDS = 300
"""Processor time that no mesh of the generated sizes may take."""


FAILURE = "failure"


@dataclass(frozen=True)
class Outcome:
    """What came of one mesh: `kind` is that of `soundness` or `FAILURE`."""

    seed: int
    kind: str
    text: str
    seconds: float


def outcome_of(seed: int) -> Outcome:
    """Approximate one mesh and check the result."""
    start = time.perf_counter()
    story = "not made"
    _limit(SECONDS)
    try:
        case = generated.case(seed)
        story = case.mesh.story
        kind, found = soundness.approximated(case.mesh.vertices, case.mesh.faces, case.settings)
        text = story if kind == soundness.RESULT else str(found)
    except Exception:
        kind, text = FAILURE, f"{story}\n{traceback.format_exc()}"
    finally:
        _limit(0)
    return Outcome(seed, kind, text, time.perf_counter() - start)


def _limit(seconds: int) -> None:
    if not hasattr(signal, "SIGPROF"):
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"more than {seconds} seconds of a processor")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)


def run(first: int, count: int, processes: int) -> tuple[list[Outcome], str]:
    """Do meshes `first` to `first + count`; returns the outcomes and one line about them."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    start = time.perf_counter()
    with ProcessPoolExecutor(processes) as pool:
        outcomes = []
        for outcome in pool.map(outcome_of, range(first, first + count), chunksize=8):
            outcomes.append(outcome)
            if outcome.kind == FAILURE:
                print(f"--- seed {outcome.seed}: {outcome.text}", flush=True)
            if len(outcomes) % 1000 == 0:
                print(summary(outcomes, processes, time.perf_counter() - start), flush=True)
    return outcomes, summary(outcomes, processes, time.perf_counter() - start)


def summary(outcomes: list[Outcome], processes: int, seconds: float) -> str:
    """Say in one line what came of the meshes."""
    kinds = collections.Counter(outcome.kind for outcome in outcomes)
    slowest = max(outcomes, key=lambda outcome: outcome.seconds)
    return (
        f"{len(outcomes)} meshes (seeds {outcomes[0].seed} to {outcomes[-1].seed}, NumPy {numpy.__version__}): "
        f"{kinds[soundness.RESULT]} results, {kinds[soundness.REFUSAL]} refusals, {kinds[FAILURE]} failures; "
        f"slowest {slowest.seconds:.1f} s (seed {slowest.seed}), {seconds:.0f} s in all, "
        f"{processes} processes"
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=12_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    outcomes, line = run(options.first, options.count, options.processes)
    print(line)
    return 1 if any(outcome.kind == FAILURE for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
