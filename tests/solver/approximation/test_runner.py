"""Whoever fits the chunks, the result is the same to the last bit."""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Approximation, Settings, approximate, approximate_steps
from sparse_surface.solver.approximation import runner
from sparse_surface.solver.approximation.runner import TASKS_AHEAD, ChunkRunner, chunk_runner
from sparse_surface.solver.errors import WorkerError
from sparse_surface.solver.fitting.chunks import ChunkTask, PatchFit
from sparse_surface.solver.fitting.native_chunks import fit_chunk
from sparse_surface.solver.native import library
from sparse_surface.solver.processes.pool import WorkerExecutor, physical_cores
from sparse_surface.solver.progress import FINISH, run_to_end

SETTINGS: dict[str, Any] = {"ring": 4, "degree": 7, "sparsity": 8, "iterations": 4}
BY_NUMPY = {**SETTINGS, "solver": "numpy"}
SOLVERS = [
    "numpy",
    pytest.param(
        "native",
        marks=pytest.mark.skipif(library.reason_against() is not None, reason=str(library.reason_against())),
    ),
]


def mesh() -> tuple[np.ndarray, np.ndarray]:
    return models.cube()


def content(result: Approximation) -> dict[str, Any]:
    """Everything that may not depend on who did the work."""
    arrays = {
        name: value.tobytes() for name, value in vars(result.representation).items() if isinstance(value, np.ndarray)
    }
    keep = {k: v for k, v in result.report.items() if k not in ("seconds", "peak_memory_mb", "workers", "settings")}
    return {"vertices": result.vertices.tobytes(), "error": result.error.tobytes(), "report": keep, **arrays}


@pytest.fixture(scope="module", params=SOLVERS)
def solver(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def alone(solver: str) -> dict[str, Any]:
    return content(approximate(*mesh(), Settings(**SETTINGS, solver=solver, workers=1)))


@pytest.mark.parametrize("workers", [2, 3])
def test_more_workers_give_the_same_bytes(alone: dict[str, Any], solver: str, workers: int) -> None:
    result = approximate(*mesh(), Settings(**SETTINGS, solver=solver, workers=workers))
    assert result.report["workers"] == workers
    assert content(result) == alone


@pytest.mark.parametrize("kind", ["threads", "processes", "own"])
def test_any_executor_gives_the_same_bytes(alone: dict[str, Any], solver: str, kind: str) -> None:
    with executor_of(kind) as executor:
        assert content(approximate(*mesh(), Settings(**SETTINGS, solver=solver), executor=executor)) == alone
        assert executor.submit(abs, -1).result() == 1, "the caller's executor lives on"


def executor_of(kind: str) -> Executor:
    if kind == "threads":
        return ThreadPoolExecutor(2)
    if kind == "processes":
        return ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))
    return WorkerExecutor(3)


def test_separate_domains_give_the_same_bytes(solver: str) -> None:
    settings = {**SETTINGS, "solver": solver, "domains": "separate", "iterations": 2}
    one, two = (approximate(*mesh(), Settings(**settings, workers=n)) for n in (1, 2))
    assert content(one) == content(two)


def test_finished_work_leaves_nothing(living_children: Callable[[], set[int]]) -> None:
    before = living_children()
    result = run_to_end(approximate_steps(*mesh(), Settings(**BY_NUMPY, workers=2)))
    assert living_children() <= before
    assert np.isfinite(result.vertices).all()


def test_work_finished_early_leaves_nothing(living_children: Callable[[], set[int]]) -> None:
    before = living_children()
    result = run_to_end(approximate_steps(*mesh(), Settings(**BY_NUMPY, workers=2)), lambda _: FINISH)
    assert living_children() <= before
    assert np.isfinite(result.vertices).all()


def test_cancelled_work_leaves_nothing(living_children: Callable[[], set[int]]) -> None:
    before = living_children()
    with closing(approximate_steps(*mesh(), Settings(**BY_NUMPY, workers=2))) as steps:
        assert any(step.stage == "Solving patches" for step in steps)
        assert len(living_children() - before) == 2
    assert living_children() <= before


def test_refused_input_leaves_nothing(living_children: Callable[[], set[int]]) -> None:
    before = living_children()
    with pytest.raises(ValueError, match=r"finite|number|NaN"):
        approximate(np.full((5000, 3), np.nan), np.array([[0, 1, 2]]), Settings(**BY_NUMPY, workers=2))
    assert living_children() <= before


def test_with_one_worker_no_process_is_started(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr("subprocess.Popen", refuse)
    approximate(*mesh(), Settings(**BY_NUMPY, workers=1))


@pytest.mark.skipif(library.reason_against() is not None, reason=str(library.reason_against()))
@pytest.mark.parametrize("ending", ["complete", "finished early", "cancelled"])
def test_the_kernel_runs_in_threads_that_end_with_it(monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    def fit_slowly(task: ChunkTask) -> list[PatchFit]:
        time.sleep(0.1)  # an executor starts its second thread only while the first is busy
        return fit_chunk(task)

    monkeypatch.setattr("subprocess.Popen", refuse)
    monkeypatch.setattr(runner, "fit_chunk", fit_slowly)
    before = set(threading.enumerate())
    with closing(approximate_steps(*mesh(), Settings(**SETTINGS, solver="native", workers=2))) as steps:
        if ending == "cancelled":
            assert any(step.stage == "Solving patches" and step.fraction > 0.1 for step in steps)
            assert len(set(threading.enumerate()) - before) == 2
        else:
            answer = FINISH if ending == "finished early" else None
            assert np.isfinite(run_to_end(steps, lambda _: answer).vertices).all()
    assert set(threading.enumerate()) <= before


def test_what_fitted_the_patches_is_reported() -> None:
    reason = approximate(*mesh(), Settings(**BY_NUMPY)).report["numpy_reason"]
    assert reason == "The settings ask for NumPy."
    report = approximate(*mesh(), Settings(**SETTINGS)).report
    assert report.get("numpy_reason") == library.reason_against()


def test_numpy_does_what_the_kernel_does_not() -> None:
    report = approximate(*mesh(), Settings(**SETTINGS, method="traditional")).report
    assert "method 'traditional'" in report["numpy_reason"]


def test_without_the_library_numpy_fits_the_patches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "_loaded", lambda: (None, "The compiled kernel is missing."))
    assert approximate(*mesh(), Settings(**SETTINGS)).report["numpy_reason"] == "The compiled kernel is missing."


@pytest.mark.parametrize(
    ("asked", "vertices", "expected"),
    [(1, 10**6, 1), (0, 100, 1), (0, 10**6, physical_cores()), (3, 100, 3)],
)
def test_the_number_of_workers(asked: int, vertices: int, expected: int, solver: str) -> None:
    with chunk_runner(Settings(solver=solver, workers=asked).resolved(), vertices) as chosen:
        assert chosen.workers == expected
        assert (chosen.executor is None) == (expected == 1)


class Slow(Executor):
    """Runs nothing by itself; counts what is handed in."""

    def __init__(self) -> None:
        self.handed: list[Future[Any]] = []

    def submit(self, function: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.handed.append(future)
        return future


def test_only_a_few_tasks_wait_and_leaving_cancels_them() -> None:
    slow, made = Slow(), []

    def tasks() -> Iterator[Any]:
        for number in range(100):
            made.append(number)
            yield number

    results = ChunkRunner(slow, 3).run(tasks())
    threading.Timer(0.2, lambda: slow.handed[0].set_result([])).start()
    assert next(results) == (0, [])
    assert len(made) == 3 * TASKS_AHEAD
    results.close()
    assert all(future.cancelled() for future in slow.handed[1:])


def test_results_come_in_the_order_of_the_tasks() -> None:
    slow = Slow()

    def finish() -> None:
        for number, future in reversed(list(enumerate(slow.handed))):
            future.set_result([number])

    threading.Timer(0.2, finish).start()
    assert list(ChunkRunner(slow, 4).run(range(5))) == [(n, [n]) for n in range(5)]


def test_a_failure_in_a_worker_reaches_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sparse_surface.solver.processes.child.sys.executable", "/no/such/python")
    with pytest.raises(WorkerError, match="started"):
        approximate(*mesh(), Settings(**BY_NUMPY, workers=2))
