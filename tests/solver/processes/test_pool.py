"""Worker processes: answers, failures, deaths, cancelling, and that nothing is left of them."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.solver.errors import Cancelled, InputError, WorkerError
from sparse_surface.solver.processes.child import THREAD_COUNTS
from sparse_surface.solver.processes.child_main import PACKAGE
from sparse_surface.solver.processes.pool import ATTEMPTS, WorkerExecutor, _Worker, physical_cores
from sparse_surface.solver.progress import Progress
from sparse_surface.solver.settings import Settings

on_linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes through /proc")


@pytest.fixture(scope="module")
def executor() -> Iterator[WorkerExecutor]:
    with WorkerExecutor(2) as workers:
        yield workers


def eventually(condition: Callable[[], bool], seconds: float = 20.0) -> bool:
    end = time.monotonic() + seconds
    while not (held := condition()) and time.monotonic() < end:
        time.sleep(0.02)
    return held


def test_functions_of_any_module_run_in_order(executor: WorkerExecutor) -> None:
    assert list(executor.map(math.sqrt, range(40))) == [math.sqrt(x) for x in range(40)]


def test_work_is_done_in_other_processes(executor: WorkerExecutor) -> None:
    numbers = {executor.submit(os.getpid).result() for _ in range(20)}
    assert numbers
    assert os.getpid() not in numbers


def test_classes_of_the_package_keep_their_identity(executor: WorkerExecutor) -> None:
    """The package has another name in the child; what comes back is ours again."""
    answer = executor.submit(Settings, ring=5).result()
    assert type(answer) is Settings
    assert answer == Settings(ring=5)


@pytest.mark.parametrize("length", [0, 1, 1_000_000])
def test_arrays_of_any_size_pass(executor: WorkerExecutor, length: int) -> None:
    array = np.random.default_rng(0).normal(size=length)
    assert executor.submit(np.flip, array).result().tobytes() == array[::-1].tobytes()


def test_blas_has_one_thread_there(executor: WorkerExecutor) -> None:
    assert [executor.submit(os.getenv, name).result() for name in THREAD_COUNTS] == ["1"] * len(THREAD_COUNTS)


def test_what_a_child_prints_does_not_disturb_the_answers(executor: WorkerExecutor) -> None:
    assert executor.submit(print, "hello").result() is None
    assert executor.submit(os.write, 1, b"hello").result() == 5
    assert executor.submit(math.sqrt, 4.0).result() == 2.0


def test_exceptions_come_back_with_their_traceback(executor: WorkerExecutor) -> None:
    error = executor.submit(math.sqrt, -1.0).exception()
    assert isinstance(error, ValueError)
    assert "Traceback" in error.__notes__[0]
    refused = executor.submit(Settings, ring=-1).exception()
    assert refused is not None
    assert type(refused).__name__ == "SettingsError"
    assert isinstance(refused, ValueError)


def test_an_unknown_function_is_refused(executor: WorkerExecutor) -> None:
    with pytest.raises((AttributeError, TypeError), match=r"pickle|lambda|local"):
        executor.submit(lambda: 1)


def test_an_answer_that_cannot_travel_is_an_error(executor: WorkerExecutor) -> None:
    error = executor.submit(open, os.devnull).exception()
    assert isinstance(error, TypeError)
    assert executor.submit(math.sqrt, 9.0).result() == 3.0


def importable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str) -> str:
    """Write a module that children find too; returns its name."""
    name = f"worker_functions_{abs(hash(tmp_path))}"
    (tmp_path / f"{name}.py").write_text(textwrap.dedent(source))
    monkeypatch.syspath_prepend(str(tmp_path))
    return name


def test_a_dead_worker_is_replaced_and_its_task_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = importable(
        tmp_path,
        monkeypatch,
        """
        import os, pathlib
        def die_once(folder):
            marker = pathlib.Path(folder) / "died"
            if not marker.exists():
                marker.touch()
                os._exit(9)
            return os.getpid()
        """,
    )
    function = __import__(name).die_once
    with WorkerExecutor(1) as workers:
        first = workers.submit(os.getpid).result()
        assert workers.submit(function, str(tmp_path)).result() != first
        assert (tmp_path / "died").exists()


@on_linux
def test_a_worker_killed_from_outside_loses_no_task() -> None:
    with WorkerExecutor(2) as workers:
        number = workers.submit(os.getpid).result()
        futures = [workers.submit(time.sleep, 0.2) for _ in range(6)]
        os.kill(number, signal.SIGKILL)
        assert [future.result(timeout=60) for future in futures] == [None] * 6


def test_a_task_that_kills_every_worker_is_given_up(executor: WorkerExecutor) -> None:
    error = executor.submit(os._exit, 3).exception()
    assert isinstance(error, WorkerError)
    assert str(ATTEMPTS) in str(error)
    assert executor.submit(math.sqrt, 16.0).result() == 4.0


def test_a_python_that_is_not_there_is_said() -> None:
    with WorkerExecutor(1, python=("/no/such/python",)) as workers:
        error = workers.submit(math.sqrt, 1.0).exception()
    assert isinstance(error, WorkerError)
    assert "started" in str(error)


def test_the_last_words_of_a_child_that_cannot_load_are_told() -> None:
    with WorkerExecutor(1, preload="no_such_module") as workers:
        error = workers.submit(math.sqrt, 1.0).exception()
    assert isinstance(error, WorkerError)
    assert "no_such_module" in str(error)


def test_cancelling_kills_what_runs_and_drops_what_waits() -> None:
    workers = WorkerExecutor(1)
    workers.submit(math.sqrt, 1.0).result()
    running, *waiting = [workers.submit(time.sleep, 60) for _ in range(4)]
    assert eventually(running.running)
    start = time.monotonic()
    workers.shutdown(cancel_futures=True)
    assert time.monotonic() - start < 5.0
    assert isinstance(running.exception(timeout=0), Cancelled)
    assert all(future.cancelled() for future in waiting)
    with pytest.raises(RuntimeError):
        workers.submit(math.sqrt, 1.0)
    workers.shutdown(cancel_futures=True)


def test_steps_that_run_are_cancelled_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their worker was killed: that is not its death at the task."""
    name = importable(
        tmp_path,
        monkeypatch,
        """
        import time
        def slow():
            time.sleep(60)
            yield
        """,
    )
    workers = WorkerExecutor(1)
    workers.submit(math.sqrt, 1.0).result()
    running = workers.submit_steps(__import__(name).slow, report=lambda step: None)
    assert eventually(running.running)
    workers.shutdown(cancel_futures=True)
    assert type(running.exception(timeout=0)) is Cancelled


def test_a_worker_that_was_killed_starts_no_child(living_children: Callable[[], set[int]]) -> None:
    """However late its thread gets to it."""
    before = living_children()
    worker = _Worker("errors", (), False)
    worker.kill()
    with pytest.raises(Cancelled):
        worker._start()
    assert living_children() <= before


def test_steps_tell_their_progress_and_hear_the_wish_to_finish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = importable(
        tmp_path,
        monkeypatch,
        """
        import sys, time
        def count(package):
            progress = sys.modules[f"{package}.progress"]
            for number in range(3000):
                heard = yield progress.Progress(f"Step {number}", number / 3000)
                if heard == progress.FINISH:
                    return number
                time.sleep(0.02)
        """,
    )
    steps: list[Progress] = []
    with WorkerExecutor(1) as workers:
        counted = workers.submit_steps(__import__(name).count, PACKAGE, report=steps.append)
        assert eventually(lambda: len(steps) > 3)
        workers.finish()
        assert 3 < counted.result(timeout=30) < 3000
    assert [step.stage for step in steps[:3]] == ["Step 0", "Step 1", "Step 2"]
    assert {type(step) for step in steps} == {Progress}
    assert all(step.surface is None for step in steps)


@pytest.mark.parametrize("cancel", [False, True])
def test_no_process_is_left(cancel: bool, living_children: Callable[[], set[int]]) -> None:
    before = living_children()
    workers = WorkerExecutor(2)
    futures = [workers.submit(time.sleep, 0.1) for _ in range(3)]
    wait(futures[:1])
    assert len(living_children() - before) == 2
    workers.shutdown(cancel_futures=cancel)
    assert living_children() <= before
    if not cancel:
        assert all(future.result() is None for future in futures)


def test_a_forgotten_executor_takes_its_children_with_it(living_children: Callable[[], set[int]]) -> None:
    before = living_children()
    workers = WorkerExecutor(1)
    workers.submit(math.sqrt, 1.0).result()
    del workers
    assert eventually(lambda: living_children() <= before)


OWNER = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs begin with it ignored
from sparse_surface.solver.processes.pool import WorkerExecutor
import os
workers = WorkerExecutor(2)
numbers = set()
while len(numbers) < 2:
    numbers |= {f.result() for f in [workers.submit(os.getpid) for _ in range(4)]}
busy = [workers.submit(time.sleep, 120) for _ in range(4)]
print(*numbers, flush=True)
time.sleep(120)
"""


@on_linux
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_the_children_of_a_killed_owner_end(how: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", OWNER], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as owner:
        assert owner.stdout is not None
        numbers = [int(word) for word in owner.stdout.readline().split()]
        assert len(numbers) == 2
        owner.send_signal(how)
        owner.wait(30)
    assert eventually(lambda: not any(is_alive(number) for number in numbers))


def is_alive(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_memory_of_the_children_is_known(executor: WorkerExecutor) -> None:
    executor.submit(np.ones, 10_000_000).result()
    assert executor.peak_memory_mb > 80.0


def test_cores_are_counted() -> None:
    assert 1 <= physical_cores() <= (os.cpu_count() or 1)


def test_errors_of_the_package_keep_their_class(executor: WorkerExecutor) -> None:
    assert type(executor.submit(InputError, "no").result()) is InputError


def test_a_small_child_of_a_large_process_is_small() -> None:
    held = np.ones(60_000_000)
    with WorkerExecutor(1) as workers:
        workers.submit(math.sqrt, 1.0).result()
        assert workers.peak_memory_mb < 300.0
    assert len(held) == 60_000_000
