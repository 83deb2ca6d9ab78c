"""Blender stays usable while the solver works: two redraw ticks, side by side with those of the idle window.

A tick is a modal timer that redraws sixty times a second.  While the bunny's number of vertices is being solved, its
95th percentile stays within 1.5 times the idle window's, and none takes more than 150 ms, whatever the idle window
does.  The window's own tick redraws the sidebar, from the press of the button to the middle of the run.  The viewport's
draws the whole 3D viewport again, as for a user who turns the view; the source is drawn as a box in it, since how fast
Blender draws a large mesh by software is not what is measured, and the surface being solved is drawn as it always is.

The first picture is one redraw of the whole viewport, which may take 1.5 times as long as in the idle window.

Nor does the window wait for a large result to arrive: Blender's own thread only takes what another one has made.

With `--shared-machine`, as in CI, one round of three has to pass, and the viewport's longest tick may be 1.5 times as
long as the idle window's.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver
import large_result

SECONDS = 12.0
FROM_THE_BUTTON = 30.0
"""Seconds until patches are solved and shown, at the idle priority of the solver's processes beside a busy window."""

ARRIVING = 8.0
"""Seconds in which a result is made and arrives."""

SIZE = 320
"""Vertices along a side of the sheet: 100,000 in all, so that the run outlasts what is measured."""

FACTOR = 1.5
LARGEST = 150.0
"""Milliseconds."""

BUNNY = 190
"""Vertices along a side of a sheet as large as the bunny."""

ROUNDS = 3 if driver.SHARED_MACHINE else 1

ticks: list[float] = []


class TEST_OT_tick(bpy.types.Operator):
    """Redraws regions of the viewport's area sixty times a second, or none, and notes when."""

    bl_idname = "test.tick"
    bl_label = "Tick"

    kind: bpy.props.StringProperty()
    seconds: bpy.props.FloatProperty()

    end = 0.0
    rung = -1.0

    def invoke(self, context, event):
        ticks.clear()
        TEST_OT_tick.end = time.monotonic() + self.seconds
        TEST_OT_tick.rung = -1.0
        self.timer = context.window_manager.event_timer_add(1 / 60, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        # The solver's operator has a timer too, and events do not say whose they are.
        if event.type != "TIMER" or self.timer.time_duration == TEST_OT_tick.rung:
            return {"PASS_THROUGH"}
        TEST_OT_tick.rung = self.timer.time_duration
        now = time.monotonic()
        ticks.append(now)
        if self.kind:
            driver.region(self.kind).tag_redraw()
        if now < TEST_OT_tick.end:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self.timer)
        return {"FINISHED"}


@dataclass
class Figures:
    """Milliseconds between redraws."""

    median: float
    high: float
    largest: float

    def __str__(self) -> str:
        return f"{self.median:.0f} / {self.high:.0f} / {self.largest:.0f} ms (p50 / p95 / max)"


def measure(kind: str, name: str, seconds: float = SECONDS, begin: Callable[[], object] = lambda: None) -> driver.Steps:
    """Return the `Figures` of the next seconds with a tick that redraws one kind of region; `begin` comes first."""
    import numpy as np

    with driver.in_viewport():
        bpy.ops.test.tick("INVOKE_DEFAULT", kind=kind, seconds=seconds)
    yield 0.3
    begin()
    yield seconds + 0.7
    between = 1000.0 * np.diff(ticks)
    figures = Figures(*(float(value) for value in (*np.percentile(between, [50, 95]), between.max())))
    print(f"redraw tick, {kind}, {name}: {figures}; load of the machine {os.getloadavg()[0]:.1f}", flush=True)
    return figures


def meter_steps(spent: list[float]) -> None:
    """Note how much processor time each step of the operator takes of Blender's own thread."""
    solving = driver.module("operators.run.operator").SolverOperator
    plain = solving._step

    def metered(*arguments):
        before = time.thread_time()
        try:
            return plain(*arguments)
        finally:
            spent.append(1000.0 * (time.thread_time() - before))

    solving._step = metered


def measure_solving(kind: str) -> driver.Steps:
    """Return the figures while the solver works: from the button on, or with the surface drawn in every picture."""
    if kind == "WINDOW":  # idle processes come to nothing while pictures are drawn by software on all cores
        driver.approximate()
        yield from driver.wait_for(driver.drawn_objects, 200.0, "preview")
        figures = yield from measure(kind, "solving")
    else:
        figures = yield from measure(kind, "solving", FROM_THE_BUTTON, driver.approximate)
        if driver.SHARED_MACHINE:  # what others leave of the machine decides when the first patches are solved
            yield from driver.wait_for(driver.drawn_objects, 200.0, "preview")
    assert driver.drawn_objects(), "no preview came"
    assert driver.running() is not None, "the job was over before the measurement"
    print(f"solved until then: {driver.running().progress.fraction:.0%}")
    assert driver.children()
    if hasattr(os, "SCHED_IDLE"):
        assert {os.sched_getscheduler(child) for child in driver.children()} == {os.SCHED_IDLE}
    driver.shot(f"responsiveness_{kind.lower()}")
    # No key is pressed here: a Blender that takes simulated keys never sleeps, and an idle window has to be idle.
    with driver.in_viewport():
        bpy.ops.sparse_surface.cancel()
    yield 1.0
    return figures


@dataclass
class Round:
    """The idle window before and after, and the window while the solver works."""

    before: Figures
    solving: Figures
    after: Figures

    def passes(self, whatever_idle_does: bool) -> bool:
        """Whether the solver holds the window up for no longer than it may."""
        idle = max(self.before.largest, self.after.largest)
        largest = LARGEST if whatever_idle_does else max(LARGEST, FACTOR * idle)
        high = FACTOR * max(self.before.high, self.after.high)
        return self.solving.high <= high and self.solving.largest <= largest


def measure_round(kind: str) -> driver.Steps:
    """Return a `Round`."""
    before = yield from measure(kind, "idle")
    solving = yield from measure_solving(kind)
    after = yield from measure(kind, "idle")
    return Round(before, solving, after)


def check_tick(kind: str, *, whatever_idle_does: bool) -> driver.Steps:
    """Hold the tick to its bounds, and the operator's own steps to theirs."""
    driver.clear_scene()
    bpy.context.scene.sparse_surface.iterations = 30
    sheet = driver.add_creased_grid(SIZE)
    if kind == "WINDOW":
        sheet.display_type = "BOUNDS"
    yield from driver.open_sidebar()
    spent: list[float] = []
    meter_steps(spent)
    yield 4.0  # until Blender has drawn all samples of the new object
    for _ in range(ROUNDS):
        measured = yield from measure_round(kind)
        if measured.passes(whatever_idle_does):
            break
    print(f"the operator's own steps: {len(spent)}, at most {max(spent):.0f} ms of processor time")
    assert max(spent) < 50.0
    assert measured.passes(whatever_idle_does), measured


def test_the_button_waits_for_no_module():
    """What a run needs is loaded while the panel is looked at; the first test, since it needs a new Blender."""

    def loaded() -> set[str]:
        return {name for name in sys.modules if name.startswith(driver.add_on())}

    driver.clear_scene()
    driver.add_creased_grid(60)
    assert f"{driver.add_on()}.operators.data.meshes" not in loaded()
    yield from driver.open_sidebar()
    yield 1.0
    before = loaded()
    driver.approximate()
    yield from driver.wait_for(lambda: driver.running() is None or driver.drawn_objects(), 60.0, "preview or result")
    # What makes the result of it is loaded at the end.
    assert driver.running() is not None, "no preview came"
    assert loaded() == before
    with driver.in_viewport():
        bpy.ops.sparse_surface.cancel()
    yield 0.5


def test_the_window_goes_on_while_the_solver_works():
    yield from check_tick("UI", whatever_idle_does=True)


def test_the_viewport_is_drawn_while_the_solver_works():
    yield from check_tick("WINDOW", whatever_idle_does=not driver.SHARED_MACHINE)


@dataclass
class Held:
    """Milliseconds: the longest time, and the longest of those in which the viewport was not drawn."""

    longest: float
    otherwise: float
    drawings: int


def measure_one_redraw(name: str, seconds: float, begin: Callable[[], object]) -> driver.Steps:
    """Return how long the window is `Held` up while something redraws the viewport."""
    with driver.noted_drawings() as drawings:
        yield from measure("", name, seconds, begin)
    steps = list(pairwise(ticks))
    plain = [after - before for before, after in steps if not any(before < drawn < after for drawn in drawings)]
    drawn = sum(ticks[0] < each < ticks[-1] for each in drawings)
    return Held(1000.0 * max(after - before for before, after in steps), 1000.0 * max(plain), drawn)


def test_the_first_picture_costs_one_redraw_of_the_viewport():
    driver.clear_scene()
    bpy.context.scene.sparse_surface.iterations = 30
    driver.add_creased_grid(BUNNY)
    yield from driver.open_sidebar()
    yield 5.0  # until Blender has drawn all samples of the new object
    for _ in range(ROUNDS):
        idle = yield from measure_one_redraw("idle", 3.0, driver.region("WINDOW").tag_redraw)
        solving = yield from measure_one_redraw("first picture", 6.0, driver.approximate)
        assert driver.running() is not None, "the job was over before the measurement"
        assert driver.drawn_objects(), "no picture came"
        with driver.in_viewport():
            bpy.ops.sparse_surface.cancel()
        yield 3.0
        print(f"idle: {idle}, solving: {solving}", flush=True)
        assert idle.drawings >= 1
        assert solving.drawings == 1
        if passed := solving.otherwise <= LARGEST and solving.longest <= max(LARGEST, FACTOR * idle.longest):
            break
    assert passed, (idle, solving)


class Arrival:
    """A job that is polled as a run polls it, and what its polls took of Blender's own thread."""

    def __init__(self, count: int) -> None:
        self.spent: list[float] = []
        self.job = driver.module("solver.job").Job((sys.executable, *bpy.app.python_args))
        self._count = count

    def begin(self) -> None:
        self.job.start(driver.module("solver.processes.child_main").PACKAGE, self._count)
        bpy.app.timers.register(self._poll)

    def _poll(self) -> float | None:
        before = time.thread_time()
        self.job.poll()
        self.spent.append(1000.0 * (time.thread_time() - before))
        return 0.1 if self.job.running else None


def test_a_large_result_does_not_hold_the_window_up(monkeypatch):
    """When polling read the result from files, it took 14 to 23 ms of 250,000 vertices and 38 to 70 ms of a million."""
    monkeypatch(driver.module("solver.job"), "solve_and_store", large_result.solve)
    driver.clear_scene()
    driver.add_creased_grid(60)
    yield from driver.open_sidebar()
    yield 2.0
    for count in (250_000, 1_000_000):
        for _ in range(ROUNDS):
            before = yield from measure("UI", "idle", ARRIVING)
            arrival = Arrival(count)
            solving = yield from measure("UI", f"{count} vertices arrive", ARRIVING, arrival.begin)
            yield from driver.wait_for(lambda job=arrival.job: not job.running, 60.0, "result")
            after = yield from measure("UI", "idle", ARRIVING)
            assert len(arrival.job.outcome.vertices) == count, arrival.job.failure
            arrival.job.stop()
            measured = Round(before, solving, after)
            if measured.passes(not driver.SHARED_MACHINE):
                break
        print(f"polling took at most {max(arrival.spent):.1f} ms of processor time")
        assert max(arrival.spent) < 5.0
        assert measured.passes(not driver.SHARED_MACHINE), measured


if __name__ == "__main__":
    bpy.utils.register_class(TEST_OT_tick)
    driver.run(
        test_the_button_waits_for_no_module,
        test_the_window_goes_on_while_the_solver_works,
        test_the_viewport_is_drawn_while_the_solver_works,
        test_the_first_picture_costs_one_redraw_of_the_viewport,
        test_a_large_result_does_not_hold_the_window_up,
    )
