"""Blocks on Dask: workers and schedulers that die, and on from there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from sparse_surface.solver import Settings, WorkerError, approximate_blocks
from sparse_surface.solver.blocks import engines
from sparse_surface.solver.progress import Progress

dask = pytest.importorskip("dask", reason="Dask is not installed")
distributed = pytest.importorskip("distributed", reason="Dask is not installed")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")

FAST = Settings(ring=4, degree=7, sparsity=8, iterations=3, workers=2)


@pytest.fixture(scope="module")
def expected(terrain):
    return approximate_blocks(*terrain, Settings(**{**FAST.as_dict(), "workers": 1}), block_size=500).vertices.tobytes()


def test_a_killed_worker_is_replaced(terrain, expected) -> None:
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        victim = next(iter(client.run(os.getpid).values()))
        killed: list[int] = []

        def kill_one(step: Progress) -> None:
            if step.detail.startswith("1 of") and not killed:
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

        found = approximate_blocks(*terrain, FAST, block_size=500, executor=client, report=kill_one)
        assert killed
        assert found.vertices.tobytes() == expected
        assert any("solve_block" in key for key in map(str, client.run_on_scheduler(history)))


def test_blocks_of_a_machine_that_is_stuck_are_solved_elsewhere(terrain, expected, monkeypatch) -> None:
    """A stopped process answers nothing and closes nothing, as a machine that swaps or hangs."""
    monkeypatch.setattr(engines, "SECONDS_BEFORE_A_COPY", 1.0)
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "host": "127.0.0.1"}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        victim = next(iter(client.run(os.getpid).values()))
        stopped: list[int] = []

        def stop_one(step: Progress) -> None:
            if step.detail.startswith("1 of") and not stopped:
                os.kill(victim, signal.SIGSTOP)
                stopped.append(victim)

        try:
            found = approximate_blocks(*terrain, FAST, block_size=500, executor=client, report=stop_one)
        finally:
            os.kill(victim, signal.SIGCONT)
        assert stopped
        assert found.vertices.tobytes() == expected


@pytest.mark.filterwarnings("error:Sending large graph")
def test_dask_gives_no_advice_about_large_graphs(terrain, expected, dask_warns_early: None) -> None:
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None, "host": "127.0.0.1"}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        assert approximate_blocks(*terrain, FAST, block_size=500, executor=client).vertices.tobytes() == expected


@pytest.fixture
def dask_warns_early() -> Iterator[None]:
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1kiB"}):
        yield


def history(dask_scheduler) -> list[str]:
    """Names of the stages that the dashboard shows."""
    return list(dask_scheduler.task_prefixes)


def start(kind: str, file: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start Dask's own scheduler or worker, which find each other by a file."""
    words = [sys.executable, "-m", f"distributed.cli.dask_{kind}", "--scheduler-file", str(file), "--no-dashboard"]
    return subprocess.Popen([*words, *options], stderr=subprocess.DEVNULL)


def test_a_lost_scheduler_is_one_sentence_and_the_job_goes_on(terrain, expected, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(engines, "BEATS_BETWEEN_LOOKS", 1)
    call = {"block_size": 500, "folder": tmp_path / "job"}
    file = tmp_path / "scheduler.json"
    process = start("scheduler", file, "--host", "127.0.0.1", "--port", "0")
    workers = [start("worker", file, "--nthreads", "1", "--no-nanny") for _ in range(2)]
    try:
        with distributed.Client(scheduler_file=str(file), timeout=60) as client:
            client.wait_for_workers(2, timeout=60)
            killed = threading.Event()

            def kill_scheduler(step: Progress) -> None:
                if step.detail.startswith("1 of") and not killed.is_set():
                    process.kill()
                    killed.set()

            began = time.monotonic()
            with pytest.raises(WorkerError, match="the same call with the same folder goes on"):
                approximate_blocks(*terrain, FAST, executor=client, report=kill_scheduler, **call)
            assert time.monotonic() - began < 120
            assert killed.is_set()
    finally:
        for each in [process, *workers]:
            each.kill()
            each.wait()
    done = {path: path.stat().st_mtime_ns for path in (tmp_path / "job" / "blocks").iterdir()}
    assert done
    assert approximate_blocks(*terrain, FAST, **call).vertices.tobytes() == expected
    assert all(path.stat().st_mtime_ns == when for path, when in done.items())
