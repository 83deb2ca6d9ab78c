"""Faults from outside: killed workers, no memory, full and read-only disks, cancelling anywhere, very many runs."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.approximation.approximate import approximate_steps
from sparse_surface.solver.fitting import chunks as patch_fit
from sparse_surface.solver.settings import PRESETS

HERE = Settings(solver="numpy", workers=1, iterations=2, sweeps=1, degree=8)
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")


# ------------------------------------------------------------------------------------------------------------- workers


@LINUX
def test_workers_killed_in_mid_solve_make_no_difference(living_children: Callable[[], set[int]]) -> None:
    vertices, faces = models.l_solid(8)
    expected = approximate(vertices, faces, HERE)
    before, killed = living_children(), []
    steps = approximate_steps(vertices, faces, Settings(**{**HERE.as_dict(), "workers": 2}))
    try:
        while True:
            step = next(steps)
            workers = sorted(living_children() - before)
            if workers and len(killed) < 2 and step.stage in ("Solving patches", "Blending patches"):
                os.kill(workers[0], signal.SIGKILL)
                killed.append(workers[0])
    except StopIteration as end:
        result = end.value
    assert len(killed) == 2
    assert result.vertices.tobytes() == expected.vertices.tobytes()
    assert living_children() == before


def test_two_processes_at_once_give_what_one_gives(tmp_path: Path) -> None:
    script = textwrap.dedent(
        """
        import sys
        sys.path[:] = eval(sys.argv[1])
        from sparse_surface.benchmarks import generated_models as models
        from sparse_surface.solver import Settings, approximate
        result = approximate(*models.cube(5), Settings(workers=2, iterations=2, sweeps=0))
        result.representation.save(sys.argv[2])
        """
    )
    command = [sys.executable, "-c", script, repr(sys.path), str(tmp_path / "same.npz")]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE) for _ in range(2)]
    for process in both:
        complaints = process.communicate(timeout=120)[1]
        assert process.returncode == 0, complaints.decode()
    alone = approximate(*models.cube(5), Settings(workers=1, iterations=2, sweeps=0))
    assert (tmp_path / "same.npz").read_bytes() == alone.representation.stored
    assert [path.name for path in tmp_path.iterdir()] == ["same.npz"]


# -------------------------------------------------------------------------------------------------------------- memory


@pytest.mark.parametrize("enough_for", [0, 2])
def test_memory_that_runs_out_is_said_in_one_sentence_and_changes_no_result(
    monkeypatch: pytest.MonkeyPatch, enough_for: int
) -> None:
    """Smaller chunks would round otherwise: the same input would not give the same bytes."""
    fit_batch = patch_fit._fit_batch

    def poor(task: patch_fit.ChunkTask) -> list[patch_fit.PatchFit]:
        if len(task.patches) > enough_for:
            raise MemoryError
        return fit_batch(task)

    monkeypatch.setattr(patch_fit, "_fit_batch", poor)
    with pytest.raises(MemoryError, match=r"^There is not enough memory for \d+ patches of up to \d+ vertices; .*\.$"):
        approximate(*models.l_solid(8), HERE)


# ---------------------------------------------------------------------------------------------------------- cancelling


@LINUX
@pytest.mark.parametrize("workers", [1, 2])
def test_cancelling_in_any_stage_leaves_nothing(workers: int, living_children: Callable[[], set[int]]) -> None:
    settings = Settings(workers=workers, iterations=1, sweeps=1, degree=5, tolerance=1e-3, denoise="first")
    vertices, faces = models.cube(3)
    stages = []
    for step in approximate_steps(vertices, faces, settings):
        stages.append(step.stage)
    assert len(set(stages)) >= 6
    before, threads = living_children(), threading.active_count()
    in_each_stage = sorted({stages.index(stage) + 1 for stage in stages})
    for count in in_each_stage if workers == 1 else in_each_stage[2:5]:
        steps = approximate_steps(vertices, faces, settings)
        for _ in range(count):
            next(steps, None)
        steps.close()
        assert living_children() == before
    assert threading.active_count() == threads


# ----------------------------------------------------------------------------------------------------------- many runs


def footprint() -> dict[str, int]:
    gc.collect()
    return {
        "threads": threading.active_count(),
        "files": len(os.listdir("/proc/self/fd")),
        "objects": len(gc.get_objects()),
    }


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@LINUX
@pytest.mark.parametrize("runs", [5, pytest.param(200, marks=pytest.mark.long)])
def test_many_runs_leave_nothing_behind(runs: int, living_children: Callable[[], set[int]]) -> None:
    model = models.cube(3)
    children = living_children()

    def one(number: int) -> None:
        preset = list(PRESETS.values())[number % len(PRESETS)]
        workers = 2 if number % 10 == 9 else 1
        approximate(*model, Settings(**{**preset, "iterations": 1, "degree": 6, "workers": workers}))

    for number in range(10):
        one(number)
    before, memory = footprint(), resident_mb()
    for number in range(runs):
        one(number)
    after = footprint()
    assert after["threads"] == before["threads"]
    assert after["files"] == before["files"]
    assert after["objects"] < before["objects"] + 200
    assert living_children() == children
    assert resident_mb() < memory + 25.0


# --------------------------------------------------------------------------------------------------------------- disks


def in_own_mount(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Python code where `folder` is a disk of 64 kB that nobody else sees, or skip where that is not allowed."""
    unshare = shutil.which("unshare")
    prefix = [unshare or "unshare", "--map-root-user", "--mount"]
    if unshare is None or subprocess.run([*prefix, "true"], capture_output=True).returncode != 0:
        pytest.skip("small disks need `unshare`")
    mount = f"mount -t tmpfs -o size=64k none {folder} && exec {sys.executable} -c '{script}' \"$@\""
    command = [*prefix, "sh", "-c", mount, "sh", str(folder), repr(sys.path)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


BEGINNING = """
import sys, subprocess, os
from pathlib import Path
folder = Path(sys.argv[1])
sys.path[:] = eval(sys.argv[2])
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.surface.representation import Representation
result = approximate(*models.cube(4), Settings(workers=1, iterations=1, sweeps=0))
target = folder / "old.npz"
result.representation.save(target)
before = target.read_bytes()
"""


@LINUX
def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    done = in_own_mount(
        BEGINNING
        + """
(folder / "filler").write_bytes(bytes(64 * 1024 - len(before) - 12 * 1024 - 4096))
try:
    approximate(*models.cube(16), Settings(workers=1, iterations=1, sweeps=0)).representation.save(target)
except OSError as error:
    print("said:", error.strerror)
assert target.read_bytes() == before
assert sorted(os.listdir(folder)) == ["filler", "old.npz"], os.listdir(folder)
Representation.load(target)
""",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "said: No space left on device" in done.stdout


@LINUX
def test_a_read_only_folder_is_said_and_nothing_changes(tmp_path: Path) -> None:
    done = in_own_mount(
        BEGINNING
        + """
subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
try:
    result.representation.save(target)
except OSError as error:
    print("said:", error.strerror)
assert target.read_bytes() == before
assert os.listdir(folder) == ["old.npz"]
""",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "said: Read-only file system" in done.stdout


@LINUX
def test_a_process_killed_while_it_writes_leaves_the_old_file_whole(tmp_path: Path) -> None:
    result = approximate(*models.cube(4), HERE)
    target = tmp_path / "old.npz"
    result.representation.save(target)
    before = target.read_bytes()
    script = textwrap.dedent(
        """
        import os, signal, sys
        sys.path[:] = eval(sys.argv[2])
        from pathlib import Path
        from sparse_surface.solver.surface.representation import Representation
        surface = Representation.load(sys.argv[1])
        whole = surface.stored
        def half(path, data):
            with open(path, "wb") as file:
                file.write(whole[: len(whole) // 2])
                file.flush()
                os.kill(os.getpid(), signal.SIGKILL)
        Path.write_bytes = half
        surface.save(sys.argv[1])
        """
    )
    command = [sys.executable, "-c", script, str(target), repr(sys.path)]
    assert subprocess.run(command, timeout=60).returncode == -signal.SIGKILL
    assert target.read_bytes() == before


@LINUX
def test_a_job_needs_no_room_on_a_disk(tmp_path: Path) -> None:
    done = in_own_mount(
        """
import sys, time, os
from pathlib import Path
import numpy as np
folder = Path(sys.argv[1])
sys.path[:] = eval(sys.argv[2])
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings
from sparse_surface.solver.interchange import MeshArrays
from sparse_surface.solver.job import Job
import tempfile
tempfile.tempdir = str(folder)
(folder / "filler").write_bytes(bytes(64 * 1024))
vertices, faces = models.cube(9)
quads = np.asarray(faces, dtype=np.int32)
triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
of = np.tile(np.arange(len(quads), dtype=np.int32), 2)
arrays = MeshArrays(vertices.astype(np.float32), quads.ravel(), np.full(len(quads), 4, np.int32), (triangles, of))
job = Job()
job.start(arrays, Settings(workers=1, iterations=1, sweeps=0))
while job.running:
    job.poll()
    time.sleep(0.01)
assert job.outcome is not None, job.failure
job.stop()
assert os.listdir(folder) == ["filler"]
""",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
