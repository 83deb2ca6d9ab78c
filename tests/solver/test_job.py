"""A job in a process of its own: results, early results, and every way to end it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube
from sparse_surface.solver import FINISH, FileFormatError, Settings, approximate
from sparse_surface.solver import job as module
from sparse_surface.solver.interchange import MeshArrays
from sparse_surface.solver.job import Job, approximate_arrays, begin_compacting, dismiss_prepared, prepare
from sparse_surface.solver.processes.child import start_child
from sparse_surface.solver.progress import Progress, run_to_end

QUICK = Settings(iterations=2, sweeps=0, workers=1)


def creased_grid(size: int) -> MeshArrays:
    axis = np.linspace(-1.0, 1.0, size)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    z = 0.2 * np.abs(np.mod(2.0 * (0.8 * x + 0.6 * y), 2.0) - 1.0)
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    quads = np.stack([corner, corner + size, corner + size + 1, corner + 1], axis=1).astype(np.int32)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return MeshArrays(
        vertices=np.stack([x, y, z], axis=1).astype(np.float32),
        corners=quads.ravel(),
        sizes=np.full(len(quads), 4, dtype=np.int32),
        triangulation=(triangles, np.tile(np.arange(len(quads), dtype=np.int32), 2)),
    )


@pytest.fixture
def job() -> Iterator[Job]:
    made = Job()
    yield made
    made.stop()


def wait(job: Job, seen: Callable[[Progress], None] = lambda step: None, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while job.running:
        assert time.monotonic() < end
        step = job.poll()
        if step is not None:
            seen(step)
        time.sleep(0.01)


def wait_for_progress(job: Job) -> None:
    steps: list[Progress] = []
    end = time.monotonic() + 60.0
    while not steps:
        assert job.running
        assert time.monotonic() < end
        step = job.poll()
        if step is not None and step.fraction > 0.0:
            steps.append(step)
        time.sleep(0.005)


def is_alive(process: int) -> bool:
    """Whether a process runs; one that has ended and is not yet collected does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_result_is_that_of_a_plain_call(job: Job) -> None:
    arrays = creased_grid(24)
    job.start(arrays, QUICK)
    wait(job)
    assert job.failure == ""
    assert job.outcome is not None
    known = arrays.triangles.astype(np.int64), arrays.triangle_polygons.astype(np.int64)
    expected = approximate(arrays.vertices, arrays.polygons(), QUICK, triangles=known)
    for name in ("vertices", "error", "patch", "domain_stretch"):
        assert np.array_equal(getattr(job.outcome, name), getattr(expected, name)), name
    assert job.outcome.report["surface_error"] == expected.report["surface_error"]
    assert job.outcome.report["settings"] == QUICK.resolved().as_dict()


def test_the_representation_is_opened_when_it_is_used(job: Job) -> None:
    arrays = creased_grid(24)
    job.start(arrays, QUICK)
    wait(job)
    assert job.outcome is not None, job.failure
    known = arrays.triangles.astype(np.int64), arrays.triangle_polygons.astype(np.int64)
    here = approximate(arrays.vertices, arrays.polygons(), QUICK, triangles=known).representation
    brought = job.outcome.representation
    assert brought.draft[:2] == b"PK"
    assert "_opened" not in vars(brought)
    points = np.zeros(20, dtype=np.int64), np.random.default_rng(1).dirichlet([1.0, 1.0, 1.0], 20)
    np.testing.assert_array_equal(brought.evaluate(*points), here.evaluate(*points))


def test_a_child_makes_drafts_compact_and_ends() -> None:
    arrays = creased_grid(24)
    here = approximate(arrays.vertices, arrays.polygons(), QUICK).representation
    child, futures = begin_compacting([here.draft, b"damaged"])
    assert futures[0].result(120.0) == here.compact
    assert isinstance(futures[1].exception(120.0), FileFormatError)
    with pytest.raises(RuntimeError, match="shut down"):
        child.submit(int)


def test_a_result_is_taken_in_without_scipy() -> None:
    """In Blender's process, which would wait for it."""
    script = f"""
import sys, time
sys.path[:] = {sys.path!r}
import numpy as np
from sparse_surface.solver.interchange import MeshArrays
from sparse_surface.solver.job import Job
from sparse_surface.solver.settings import Settings
x, y = np.divmod(np.arange(64), 8)
first = (np.arange(7)[:, None] * 8 + np.arange(7)).ravel()
triangles = np.concatenate([np.stack([first, first + 8, first + 9], 1), np.stack([first, first + 9, first + 1], 1)])
of = np.arange(98, dtype=np.int32)
vertices = np.stack([x, y, np.abs(x - 3.5)], 1).astype(np.float32)
corners = triangles.astype(np.int32)
job = Job()
job.start(MeshArrays(vertices, corners.ravel(), np.full(98, 3, np.int32), (corners, of)), Settings(workers=1))
while job.running:
    job.poll()
    time.sleep(0.01)
print(job.failure, len(job.outcome.vertices), len(job.outcome.representation.draft) > 0, "scipy" in sys.modules)
job.stop()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["64", "True", "False"]


def test_what_a_busy_owner_misses_does_not_pile_up(job: Job) -> None:
    """The newest progress is left, with the newest surface."""
    arrays = creased_grid(60)
    job.start(arrays, Settings(iterations=12, sweeps=0, workers=1), previews=True)
    end = time.monotonic() + 120.0
    while not job._future.done():
        assert time.monotonic() < end
        time.sleep(0.05)
    newest = job.poll()
    assert newest is not None
    assert newest.vertices is not None
    assert newest.vertices.shape == arrays.vertices.shape
    assert newest.fraction > 0.9
    assert job.outcome is not None
    assert job.poll() is None


def test_polygons_of_different_sizes_arrive() -> None:
    arrays = creased_grid(3)
    mixed = MeshArrays(
        arrays.vertices,
        np.array([0, 3, 4, 0, 4, 1, 3, 6, 7, 8, 5, 4], dtype=np.int32),
        np.array([3, 3, 6], dtype=np.int32),
        arrays.triangulation,
    )
    assert [polygon.tolist() for polygon in mixed.polygons()] == [[0, 3, 4], [0, 4, 1], [3, 6, 7, 8, 5, 4]]
    assert np.asarray(arrays.polygons()).shape == (4, 4)


def test_progress_rises_and_previews_come_nearer(job: Job) -> None:
    arrays = creased_grid(60)
    steps: list[Progress] = []
    # By NumPy: the compiled kernel is done before a second preview is due.
    job.start(arrays, Settings(iterations=12, sweeps=0, solver="numpy", workers=1), previews=True)
    wait(job, steps.append)
    fractions = [step.fraction for step in steps]
    assert fractions == sorted(fractions)
    assert len(fractions) > 3
    previews = [step.vertices for step in steps if step.vertices is not None]
    assert len(previews) > 1
    for preview in previews:
        assert preview.shape == arrays.vertices.shape
        assert np.abs(preview - arrays.vertices).max() < 0.2
    off = [float(np.linalg.norm(preview - arrays.vertices)) for preview in previews]
    assert off[-1] < off[0]


def test_no_previews_unless_asked_for(job: Job) -> None:
    steps: list[Progress] = []
    job.start(creased_grid(24), QUICK)
    wait(job, steps.append)
    assert all(step.vertices is None for step in steps)


def test_what_was_asked_for_besides_comes_along(job: Job) -> None:
    vertices, faces = cube(6)
    count = len(faces)
    arrays = MeshArrays(
        vertices=vertices.astype(np.float32),
        corners=faces.ravel().astype(np.int32),
        sizes=np.full(count, 4, dtype=np.int32),
    )
    settings = Settings(iterations=6, sweeps=0, workers=1, ring=4, mark_creases=True, keep_iterations=True)
    job.start(arrays, settings)
    wait(job)
    assert job.outcome is not None, job.failure
    here = run_to_end(approximate_arrays(arrays, settings))
    assert here.creases is not None
    assert here.history is not None
    assert len(here.creases) > 20
    assert np.array_equal(job.outcome.creases, here.creases)
    assert np.array_equal(job.outcome.history, here.history)


def test_refusal_is_one_sentence(job: Job) -> None:
    arrays = creased_grid(4)
    arrays.vertices[3, 2] = np.nan
    job.start(arrays, QUICK)
    wait(job)
    assert job.outcome is None
    assert "not a finite number" in job.failure
    assert "\n" not in job.failure


def child_of(job: Job) -> int:
    assert job._executor is not None
    process = job._executor._crew[0]._process
    assert process is not None
    return process.pid


def test_stopping_ends_the_process(job: Job) -> None:
    job.start(creased_grid(100), Settings(solver="numpy", workers=2))
    wait_for_progress(job)
    process = child_of(job)
    before = time.monotonic()
    job.stop()
    assert time.monotonic() - before < 0.1  # the owner, a window, does not wait
    while is_alive(process):
        assert time.monotonic() - before < 30.0
        time.sleep(0.01)
    job.stop()
    assert not job.running
    assert job.poll() is None


def test_finishing_early_keeps_what_is_there(job: Job) -> None:
    arrays = creased_grid(60)
    job.start(arrays, Settings(iterations=40, workers=1))
    wait_for_progress(job)
    job.finish()
    wait(job, seconds=60.0)
    assert job.outcome is not None, job.failure
    assert np.abs(job.outcome.vertices - arrays.vertices).max() < 0.2


def test_a_killed_process_is_told(job: Job) -> None:
    job.start(creased_grid(100), Settings(workers=1))
    wait_for_progress(job)
    os.kill(child_of(job), signal.SIGKILL)
    wait(job, seconds=5.0)
    assert "ended before its work was done" in job.failure


def test_a_message_that_a_dying_child_cut_is_no_crash(tmp_path: Path) -> None:
    (tmp_path / "dying.py").write_text(
        """
import os, sys
sys.stdin.buffer.read(8)
os.write(1, (1).to_bytes(8, "little") + (100).to_bytes(8, "little") + b"half")
sys.exit("The disk is on fire")
"""
    )
    job = Job((sys.executable, str(tmp_path / "dying.py")))
    job.start(creased_grid(4), QUICK)
    wait(job, seconds=20.0)
    assert job.failure == "The solver's process ended before its work was done: The disk is on fire."
    job.stop()


def test_a_forgotten_job_takes_its_child_with_it() -> None:
    job = Job()
    job.start(creased_grid(100), Settings(workers=1))
    wait_for_progress(job)
    process = child_of(job)
    del job
    end = time.monotonic() + 10.0
    while is_alive(process):
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="another system's means are tested below")
def test_every_process_gives_way(job: Job) -> None:
    """The window draws with threads that wake up all the time; each time it must get its processor at once."""
    job.start(creased_grid(100), Settings(solver="numpy", workers=2))
    wait_for_progress(job)
    family = [child_of(job), *descendants(child_of(job))]
    assert len(family) == 3
    assert {os.sched_getscheduler(member) for member in family} == {os.SCHED_IDLE}
    assert os.sched_getscheduler(0) != os.SCHED_IDLE


@pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="another system's means are tested below")
def test_every_process_gives_way_once_there_is_a_picture(job: Job) -> None:
    """Until then the child takes turns beside a window that may be busy with drawing."""
    job.start(creased_grid(100), Settings(solver="numpy", workers=2), previews=True)
    end = time.monotonic() + 60.0
    while (step := job.poll()) is None or step.surface is None or step.fraction == 0.0:
        assert time.monotonic() < end
        time.sleep(0.005)
    family = [child_of(job), *descendants(child_of(job))]
    assert len(family) == 3
    assert {os.sched_getscheduler(member) for member in family} == {os.SCHED_IDLE}
    assert {os.getpriority(os.PRIO_PROCESS, member) for member in family} == {os.getpriority(os.PRIO_PROCESS, 0) + 10}


def turns(script: str) -> list[str]:
    """Return what `priority(of)` returns each time that a fresh process which gives way calls it."""
    script = f"""
import sys
sys.path[:] = {sys.path!r}
import os, subprocess, threading, time
from sparse_surface.solver.processes import service
from sparse_surface.solver.processes.child_main import give_way
priority = lambda of=0: print("idle" if os.sched_getscheduler(of) == os.SCHED_IDLE else "turns", flush=True)
finish = threading.Event()
turns = service._Turns(True, finish)
give_way()
{script}
"""
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="priorities of Linux")
def test_a_watched_task_takes_turns_until_its_picture_and_not_for_long() -> None:
    started = "started = subprocess.Popen(['sleep', '60'])"
    shown = f"turns.begin(True); {started}; priority(); turns.end(); priority(); priority(started.pid); started.kill()"
    assert turns(shown) == ["turns", "idle", "idle"]
    late = "turns.begin(True); priority(); turns._timer.join(); priority()"
    assert turns(late) == ["turns", "idle"]
    assert turns("turns.begin(False); priority()") == ["idle"]
    assert turns("turns.begin(True); finish.set(); turns.end(); priority()") == ["turns"]


def test_a_child_gives_way_on_windows_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """There its owner decides that, when it starts it."""
    started: list[int] = []
    monkeypatch.setattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0x4000, raising=False)
    monkeypatch.setattr(subprocess, "Popen", lambda *args, creationflags, **kwargs: started.append(creationflags))
    with tempfile.TemporaryFile() as log:
        start_child("errors", stderr=log, gives_way=True)
        start_child("errors", stderr=log)
    assert [flags & 0x4000 for flags in started] == [0x4000, 0]


def test_a_python_that_cannot_start_is_told(tmp_path: Path) -> None:
    job = Job((str(tmp_path / "no python"),))
    job.start(creased_grid(4), QUICK)
    wait(job, seconds=5.0)
    assert "could not be started" in job.failure
    assert "no python" in job.failure
    job.stop()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks at /proc")
def test_nothing_outlives_a_killed_owner(tmp_path: Path) -> None:
    """The owner is killed the hard way; its child and the child's workers go."""
    script = f"""
import sys, time
sys.path[:] = {sys.path!r}
import numpy as np
from pathlib import Path
from sparse_surface.solver.interchange import MeshArrays
from sparse_surface.solver.job import Job
from sparse_surface.solver import Settings
names = "vertices", "corners", "sizes"
arrays = {{name: np.load(Path({str(tmp_path)!r}) / f"{{name}}.npy") for name in names}}
job = Job()
job.start(MeshArrays(**arrays), Settings(solver="numpy", workers=2))
while True:
    step = job.poll()
    if step is not None and step.fraction > 0.05:
        print(job._executor._crew[0]._process.pid, flush=True)
        time.sleep(60)
"""
    for name in ("vertices", "corners", "sizes"):
        np.save(tmp_path / f"{name}.npy", getattr(creased_grid(80), name))
    owner = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert owner.stdout is not None
    child = int(owner.stdout.readline())
    family = [child, *descendants(child)]
    assert len(family) == 3
    owner.kill()
    owner.wait()
    owner.stdout.close()
    end = time.monotonic() + 10.0
    while any(is_alive(member) for member in family):
        assert time.monotonic() < end, family
        time.sleep(0.02)


def descendants(ancestor: int) -> list[int]:
    parents = {}
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(status.parent.name)] = int(status.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    found, new = [], [ancestor]
    while new:
        new = [process for process, parent in parents.items() if parent in new]
        found += new
    return found


def test_requests_pass_into_the_work() -> None:
    """`report` asks for the end; the work hears it at its next step."""
    heard: list[str | None] = []

    def work():  # type: ignore[no-untyped-def]
        for number in range(5):
            heard.append((yield Progress("Counting", number / 5)))
            if heard[-1] == FINISH:
                return number
        return -1

    assert run_to_end(work(), lambda step: FINISH if step.fraction > 0.3 else None) == 2
    assert heard == [None, None, FINISH]


def test_arrays_are_handed_over_whole() -> None:
    arrays = creased_grid(16)
    weights = np.ones(len(arrays.vertices), dtype=np.float32)
    weights[:40] = 0.0
    held = replace(arrays, weights=weights)
    result = run_to_end(approximate_arrays(held, QUICK))
    assert np.array_equal(result.vertices[:40], arrays.vertices[:40])


@pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="priorities of Linux")
@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="needs the right to set priorities")
def test_what_ends_does_not_wait_for_others_work():
    """A process that gave way, and each of its threads, takes its turn again."""
    script = f"""
import sys
sys.path[:] = {sys.path!r}
import os, threading
from sparse_surface.solver.processes.child_main import give_way_entirely, stop_giving_way
give_way_entirely()
threading.Thread(target=threading.Event().wait, daemon=True).start()
policies = lambda: sorted(os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task"))
before = policies()
stop_giving_way()
print(set(before) == {{os.SCHED_IDLE}}, len(before), set(policies()) == {{os.SCHED_OTHER}}, flush=True)
os._exit(0)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    idle, threads, turned = done.stdout.split()
    assert idle == turned == "True"
    assert int(threads) >= 2


def test_a_prepared_child_does_the_next_job_and_waits_for_no_other(job) -> None:
    """The job takes the child that waits; without a job, dismissing ends it."""
    prepare()
    prepare()  # there is one already
    (waiting,) = module._prepared.values()
    job.start(creased_grid(8), QUICK)
    assert job._executor is waiting
    assert not module._prepared
    wait(job)
    assert job.outcome is not None, job.failure
    prepare()
    (waiting,) = module._prepared.values()
    dismiss_prepared()
    assert not module._prepared
    with pytest.raises(RuntimeError, match="shut down"):
        waiting.submit(abs, 1)
