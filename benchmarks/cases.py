"""One approximation in a process of its own, measured."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..solver import Settings, approximate
from ..solver.processes.memory import peak_memory_mb
from ..solver.processes.pool import WorkerExecutor
from . import generated_models as models

T = TypeVar("T")

STAGES = ("creases", "cover", "domains", "solve", "sweeps", "refine", "blend", "measure", "total")


@dataclass(frozen=True)
class Case:
    """What to run.

    Attributes
    ----------
    model
        Name, for the tables.
    settings
        Those that differ from the defaults.
    arrays
        Vertices and faces; None for a generated model.
    size
        Number of vertices of a generated model that has a choice.
    constants
        Values to try for the solver's own constants, by "module.NAME"; only with one worker.
    """

    model: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    arrays: tuple[NDArray[Any], NDArray[Any]] | None = None
    size: int | None = None
    constants: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Measured:
    """The measurements of one case.

    Attributes
    ----------
    model
        Name.
    report
        The report of `approximate`.
    unit
        Seconds of one unit, the mean of before and after.
    base_memory_mb
        Peak memory of the process before the run: the interpreter, the libraries and the mesh.
    set_up
        Seconds until the process had been started and had loaded the solver; 0 where the case ran in this process.
    """

    model: str
    report: dict[str, Any]
    unit: float
    base_memory_mb: float
    set_up: float = 0.0

    def seconds(self, stage: str) -> float:
        """Time of a stage: processor time with one worker, time on the clock with more."""
        return float(self.report["seconds"][stage])

    def units(self, stage: str) -> float:
        """Time of a stage in units."""
        return self.seconds(stage) / self.unit

    @property
    def memory_mb(self) -> float:
        """Peak memory above that of the idle process, worker processes included."""
        return float(self.report["peak_memory_mb"]) - self.base_memory_mb

    def as_dict(self) -> dict[str, Any]:
        """Plain values for a JSON file."""
        units = {stage: self.units(stage) for stage in STAGES}
        return {
            "model": self.model,
            "unit_seconds": self.unit,
            "set_up": self.set_up,
            "units": units,
            "report": self.report,
        }


def unit_seconds(repeats: int = 9, clock: Callable[[], float] | None = None) -> float:
    """Seconds that one unit takes now, in this process: the median of a few."""
    clock = clock or time.perf_counter
    matrix = np.random.default_rng(0).random((1000, 1000))
    times = []
    for _ in range(repeats):
        start = clock()
        matrix @ matrix
        times.append(clock() - start)
    return float(np.median(times))


def measure(case: Case) -> Measured:
    """Run a case in a fresh process with one BLAS thread."""
    start = time.perf_counter()
    with WorkerExecutor(1, preload="approximation.approximate") as process:
        process.submit(int).result()  # answered once the solver is loaded
        set_up = time.perf_counter() - start
        # With more workers the clock counts.
        run = partial(_by_processor_time, run_case) if case.settings.get("workers") == 1 else run_case
        return replace(process.submit(run, case).result(), set_up=set_up)


def alone(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function in a process of its own, timed by the processor: other programs do not count."""
    with WorkerExecutor(1) as process:
        return process.submit(_by_processor_time, function, *arguments).result()


def _by_processor_time(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function in a process that ends with it and has no workers."""
    time.perf_counter = time.process_time
    return function(*arguments)


def run_case(case: Case) -> Measured:
    """Run a case in this process."""
    vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
    with_constants(case.constants)
    # the compiled kernel has constants of its own
    solver: dict[str, Any] = {"solver": "numpy"} if case.constants else {}
    settings = Settings(**solver, **case.settings)
    before, base = unit_seconds(), peak_memory_mb()
    result = approximate(vertices, faces, settings)
    return Measured(case.model, result.report, (before + unit_seconds()) / 2.0, base)


def generated(name: str, size: int | None) -> tuple[NDArray[Any], NDArray[Any]]:
    """A model of `generated_models`."""
    make = getattr(models, name)
    vertices, faces = make(size) if size is not None else make()
    return vertices, faces


def with_constants(constants: Mapping[str, Any]) -> None:
    """Change constants of the solver in this process."""
    package = Settings.__module__.rpartition(".")[0]
    for name, value in constants.items():
        module, _, constant = name.rpartition(".")
        home = import_module(f"{package}.{module}")
        if not hasattr(home, constant):
            raise AttributeError(f"There is no constant {name!r}.")
        setattr(home, constant, value)
