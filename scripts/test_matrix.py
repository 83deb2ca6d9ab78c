"""Run the Blender tests on every supported Blender and the solver tests on every supported NumPy.

    python scripts/test_matrix.py                    all rows
    python scripts/test_matrix.py 4.2 5.2            the rows of these Blenders
    python scripts/test_matrix.py numpy-1.24         a row of the solver tests
    python scripts/test_matrix.py 4.2 5.2 --prepare  only make the environments of these rows

Each row has an environment of its own in .venv-matrix/.  The Blender rows hold bpy, the NumPy that this Blender bundles
and pytest, nothing else: SciPy and scikit-learn come from the wheels in the installed zip, and, where the system allows
it, there is no network.  A Python that is not found makes its row, and the run, fail (but see --allow-missing-python).
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from build_extension import CHECKOUT, BuildError, WheelError, build, this_platform

ENVIRONMENTS = CHECKOUT / ".venv-matrix"
LOGS = CHECKOUT / "out" / "matrix"
REQUIREMENTS = CHECKOUT / "requirements"


@dataclass(frozen=True)
class Row:
    """One line of the matrix: what is tested, on which Python, with which pins."""

    name: str
    python: str
    numpy: str
    requirements: tuple[str, ...]
    tests: str
    constraint: str = ""


@dataclass(frozen=True)
class Outcome:
    row: Row
    passed: bool
    closing_line: str
    seconds: float


def pinned(text: str, name: str) -> str:
    return re.search(rf"^{name}==([\w.]+)", text, re.MULTILINE)[1]  # type: ignore[index]


def all_rows() -> dict[str, Row]:
    """Return the rows by name, made from the pins in requirements/."""
    rows, numpy_rows = {}, {}
    for path in sorted(REQUIREMENTS.glob("blender-*.txt")):
        text = path.read_text(encoding="utf-8")
        python = re.search(r'python_version == "([\d.]+)"', text)[1]  # type: ignore[index]
        version, numpy = path.stem.removeprefix("blender-"), pinned(text, "numpy")
        rows[version] = Row(f"bpy {pinned(text, 'bpy')}", python, numpy, ("test", path.stem), "tests/blender")
        short = "numpy-" + ".".join(numpy.split(".")[:2])
        numpy_rows.setdefault(short, Row("solver", python, numpy, ("test", "solver"), "tests/solver", path.stem))
    return {**rows, **numpy_rows}


def environment(name: str, row: Row) -> Path:
    """Make or refresh the environment of a row and return its Python.

    Raises
    ------
    LookupError
        When this machine has no such Python.
    """
    environ = {key: value for key, value in os.environ.items() if key != "PYTHON"}
    find = [str(CHECKOUT / "scripts" / "find_python.sh"), row.python]
    found = subprocess.run(find, capture_output=True, text=True, env=environ)
    if found.returncode != 0:
        raise LookupError(f"Python {row.python} not found")
    folder = ENVIRONMENTS / name
    command = [found.stdout.strip(), str(CHECKOUT / "scripts" / "environment.py"), str(folder), *row.requirements]
    if row.tests == "tests/solver":
        command += ["--constraint", row.constraint, "--editable"]
    subprocess.run(command, check=True)
    return folder / "bin" / "python"


def prepare(name: str, row: Row) -> None:
    """Make the environment of a row, or say why it cannot be made."""
    try:
        environment(name, row)
    except (LookupError, subprocess.CalledProcessError) as error:
        print(f"{name}: {error}", file=sys.stderr)


def without_network() -> list[str]:
    """Return the prefix of a command that shall run without network, empty where the system has no such means."""
    prefix = ["unshare", "--map-root-user", "--net"]
    try:
        allowed = subprocess.run([*prefix, "true"], capture_output=True).returncode == 0
    except OSError:
        allowed = False
    return prefix if allowed else []


def run_row(name: str, row: Row, zip_path: Path | None, more: list[str]) -> Outcome:
    """Run the tests of a row in one process of its own; its whole output goes to out/matrix/NAME.txt."""
    start = time.perf_counter()
    try:
        python = environment(name, row)
    except (LookupError, subprocess.CalledProcessError) as error:
        return Outcome(row, False, str(error), time.perf_counter() - start)
    environ = {**os.environ, "PYTHONNOUSERSITE": "1"}
    command = [str(python), "-m", "pytest", "-m", "not long", row.tests, *more]
    if row.tests == "tests/blender":
        environ["SPARSE_SURFACE_ZIP"] = str(zip_path)
        command = [*without_network(), *command]
    log = LOGS / f"{name}.txt"
    with log.open("w", encoding="utf-8") as file:
        code = subprocess.run(command, cwd=CHECKOUT, env=environ, stdout=file, stderr=subprocess.STDOUT).returncode
    lines = [line for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.startswith("=")]
    closing = next((line for line in reversed(lines) if re.search(r"\d+ (passed|failed|error)", line)), "")
    if code != 0:
        print(log.read_text(encoding="utf-8", errors="replace")[-6000:], flush=True)
    return Outcome(row, code == 0, closing.strip("= ") or f"ended with exit code {code}", time.perf_counter() - start)


def print_table(outcomes: list[Outcome]) -> None:
    print(f"\n{'':12} {'Python':8} {'NumPy':8} {'':6} result")
    for outcome in outcomes:
        row = outcome.row
        verdict = "ok" if outcome.passed else "FAILED"
        print(f"{row.name:12} {row.python:8} {row.numpy:8} {verdict:6} {outcome.closing_line}")


def main(arguments: list[str] | None = None) -> int:
    rows = all_rows()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", choices=[[], *rows], metavar="ROW", help=", ".join(rows))
    parser.add_argument("--zip", type=Path, help="test this zip instead of building one")
    parser.add_argument("--allow-missing-python", action="store_true", help="do not fail where a Python is not found")
    parser.add_argument("--pytest", action="append", default=[], metavar="ARGUMENT", help="hand this to pytest")
    parser.add_argument("--prepare", action="store_true", help="make the environments and test nothing")
    options = parser.parse_args(arguments)
    LOGS.mkdir(parents=True, exist_ok=True)
    chosen = options.rows or list(rows)
    if options.prepare:
        for name in chosen:
            prepare(name, rows[name])
        return 0
    zip_path = options.zip
    if zip_path is None and any(rows[name].tests == "tests/blender" for name in chosen):
        try:
            zip_path = build(this_platform(), LOGS)
        except (BuildError, WheelError) as error:
            print(error, file=sys.stderr)
            return 1
    outcomes = []
    for name in chosen:
        outcomes.append(run_row(name, rows[name], zip_path, options.pytest))
        print(f"{name}: {outcomes[-1].closing_line} ({outcomes[-1].seconds:.0f} s with set-up)", flush=True)
    print_table(outcomes)
    missing = [outcome for outcome in outcomes if outcome.closing_line.endswith("not found")]
    failed = [outcome for outcome in outcomes if not outcome.passed and outcome not in missing]
    return 1 if failed or (missing and not options.allow_missing_python) else 0


if __name__ == "__main__":
    sys.exit(main())
