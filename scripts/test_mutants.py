"""Change the core modules in one small way at a time and see whether their tests notice.

    python scripts/test_mutants.py                              a sample of each module in TESTS
    python scripts/test_mutants.py solver/fitting/pursuit.py --count 100

Cosmic Ray makes the changes in a copy of the checkout, in build/mutants/.  Each runs the tests named for its module in
TESTS.  A change that every test passes is printed: either it changes nothing that matters, or a test is missing.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

from cosmic_ray.config import serialize_config
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkItem, WorkResult

CHECKOUT = Path(__file__).resolve().parent.parent
COPY = CHECKOUT / "build" / "mutants" / "sparse_surface"
PYTHON = CHECKOUT / ".venv" / "bin" / "python"

TESTS = {
    "solver/approximation/oscillation.py": (
        "approximation/test_oscillation.py reliability/test_uneven.py native/test_surface.py"
    ),
    "solver/approximation/sweeps.py": "approximation/test_sweeps.py",
    "solver/approximation/tolerance.py": "approximation/test_tolerance.py",
    "solver/denoising/patch_average.py": "denoising",
    "solver/denoising/patch_growth.py": "denoising",
    "solver/distance/alignment.py": "distance/test_alignment.py",
    "solver/distance/certified.py": "distance/test_certified.py",
    "solver/distance/winding.py": "distance/test_winding.py",
    "solver/fitting/cross_validation.py": "fitting/test_cross_validation.py",
    "solver/fitting/dictionary.py": "fitting/test_dictionary.py native/test_dictionary.py",
    "solver/fitting/domain_energy.py": "fitting/test_domain_energy.py native/test_domain_energy.py",
    "solver/fitting/pursuit.py": "fitting/test_pursuit.py native/test_pursuit.py",
    "solver/fitting/sparse_fit.py": "fitting/test_sparse_fit.py fitting/methods",
    "solver/fitting/methods/augmented_lagrangian.py": "fitting/methods/test_augmented_lagrangian.py",
    "solver/fitting/methods/gauss_newton.py": "fitting/methods/test_gauss_newton.py",
    "solver/fitting/methods/variable_projection.py": "fitting/methods",
    "solver/patches/blending.py": "patches/test_blending.py",
    "solver/patches/cover.py": "patches/test_cover.py native/test_patches.py",
    "solver/patches/disks.py": "patches native/test_disks.py",
    "solver/patches/parameterisation.py": "patches/test_parameterisation.py native/test_patches.py",
    "solver/reconstruction/geometry.py": "reconstruction/test_geometry.py",
    "solver/surface/bounds.py": "surface/test_bounds.py native/test_surface.py",
    "solver/surface/metrics.py": "surface/test_metrics.py native/test_surface.py",
    "solver/surface/representation.py": "surface/test_representation.py native/test_surface.py",
    "solver/surface/taylor.py": "surface/test_bounds.py native/test_surface.py",
}
"""The tests, in tests/solver, that have to notice a change of a module.

Those in `native` compare the compiled kernel with what is in NumPy, which runs nowhere else where there is a kernel.
"""

CHANGES = re.compile(
    r"core/(ReplaceBinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul|Pow_Mul)"
    r"|ReplaceComparisonOperator_(Lt_LtE|LtE_Lt|Gt_GtE|GtE_Gt|Lt_Gt|Gt_Lt|LtE_GtE|GtE_LtE|Eq_NotEq|NotEq_Eq)"
    r"|ReplaceUnaryOperator_(USub_UAdd|Delete_.*)|AddNot|ReplaceAndWithOr|ReplaceOrWithAnd|ReplaceTrueWithFalse"
    r"|ReplaceFalseWithTrue|NumberReplacer|ReplaceBreakWithContinue|ReplaceContinueWithBreak)"
)
"""Changes that a person could make by mistake; Cosmic Ray knows more, such as shifts of floats."""

SECONDS = 120.0
"""A run of the tests that takes longer has noticed the change: it does not end."""


def copied_checkout() -> None:
    """Copy what git tracks, with the compiled kernel, to where modules may be changed."""
    shutil.rmtree(COPY.parent, ignore_errors=True)
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, check=True, capture_output=True).stdout
    for name in tracked.decode().split("\0"):
        if name and (CHECKOUT / name).is_file():
            (COPY / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(CHECKOUT / name, COPY / name)
    shutil.copytree(CHECKOUT / "solver" / "native" / "built", COPY / "solver" / "native" / "built")


def survivors(module: str, count: int) -> tuple[Counter[str], list[str]]:
    """Try `count` changes of a module; returns how they ended, and those that no test noticed as differences."""
    session, config = COPY.parent / "session.sqlite", COPY.parent / "session.toml"
    session.unlink(missing_ok=True)
    tests = " ".join(f"tests/solver/{path}" for path in TESTS[module].split())
    command = f"{PYTHON} -m pytest -x -q -p no:cacheprovider -m 'not long' {tests}"
    config.write_text(
        serialize_config(
            {
                "module-path": [module],
                "timeout": SECONDS,
                "excluded-modules": [],
                "test-command": command,
                "distributor": {"name": "local"},
            }
        ),
        encoding="utf-8",
    )
    _cosmic_ray("baseline", str(config))
    _cosmic_ray("init", str(config), str(session))
    with use_db(session, WorkDB.Mode.open) as work:
        leave_out(work, count)
    _cosmic_ray("exec", str(config), str(session))
    with use_db(session, WorkDB.Mode.open) as work:
        return outcomes(work)


def leave_out(work: WorkDB, count: int) -> None:
    """Skip all changes but `count` of the kinds in CHANGES, evenly spread over the module."""
    items = sorted(work.pending_work_items, key=_place)
    wanted = [item for item in items if all(CHANGES.fullmatch(change.operator_name) for change in item.mutations)]
    step = max(len(wanted) / count, 1.0)
    kept = {wanted[int(number * step)].job_id for number in range(min(count, len(wanted)))}
    for item in items:
        if item.job_id not in kept:
            work.set_result(item.job_id, WorkResult(worker_outcome=WorkerOutcome.SKIPPED))


def _place(item: WorkItem) -> tuple[tuple[int, int], str, int]:
    change = item.mutations[0]
    return change.start_pos, change.operator_name, change.occurrence


def outcomes(work: WorkDB) -> tuple[Counter[str], list[str]]:
    """Count how the changes ended, and return those that survived."""
    ended: Counter[str] = Counter()
    alive = []
    for _, result in work.results:
        if result.worker_outcome == WorkerOutcome.SKIPPED:
            continue
        survived = result.test_outcome == TestOutcome.SURVIVED
        ended["survived" if survived else "noticed"] += 1
        if survived:
            alive.append(result.diff)
    return ended, alive


def _cosmic_ray(*arguments: str) -> None:
    environment = {**os.environ, "PYTHONPATH": str(COPY.parent)}
    command = [sys.executable, "-m", "cosmic_ray.cli", *arguments]
    subprocess.run(command, cwd=COPY, env=environment, check=True)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", choices=[*TESTS, []], metavar="MODULE", help="files; all where none")
    parser.add_argument("--count", type=int, default=20, help="changes of each module")
    options = parser.parse_args(arguments)
    copied_checkout()
    total: Counter[str] = Counter()
    for module in options.modules or TESTS:
        ended, alive = survivors(module, options.count)
        total += ended
        print(f"{module}: {ended['noticed']} of {ended.total()} changes noticed", flush=True)
        for difference in alive:
            print(difference, flush=True)
    print(f"{total['noticed']} of {total.total()} changes noticed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
