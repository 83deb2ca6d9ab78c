"""Blender stays usable while the solver works: the redraw tick, side by side with that of the idle window.

The bounds are the issue's: while the bunny's number of vertices is being solved, the 95th percentile of the tick stays
within 1.5 times that of the idle window, and no tick takes 150 ms.  What is measured is what the solver takes from the
window, not how fast Blender draws, which on a machine without a graphics card (CI) is slow: the source and so its
preview are boxes, and the viewport's anti-aliasing is off, in the idle window too.  With it, Blender draws the eight
pictures after any change of any object up to 1.7 times as long (165 ms on two free cores without a solver).

Noise only ever adds to a tick, so of up to three rounds (idle, solving, idle) one that keeps the bounds is enough.
Where other work leaves the idle window below 150 ms neither before nor after, that bound can show nothing; the largest
tick is then held to 1.5 times the idle window's.  What does not depend on the machine's other work is asserted in every
round: the processor time of the operator's steps, and that the solver's processes give way.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver

SECONDS = 12.0
ROUNDS = 3
SIZE = 187
"""Vertices along a side of the sheet: as many vertices as the bunny has."""

FACTOR = 1.5
LARGEST = 150.0
"""Milliseconds."""

ticks: list[float] = []


class TEST_OT_tick(bpy.types.Operator):
    """Redraws the viewport sixty times a second and notes when."""

    bl_idname = "test.tick"
    bl_label = "Tick"

    end = 0.0
    rung = -1.0

    def invoke(self, context, event):
        ticks.clear()
        TEST_OT_tick.end = time.perf_counter() + SECONDS
        TEST_OT_tick.rung = -1.0
        self.timer = context.window_manager.event_timer_add(1 / 60, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        # The solver's operator has a timer too, and events do not say whose they are.
        if event.type != "TIMER" or self.timer.time_duration == TEST_OT_tick.rung:
            return {"PASS_THROUGH"}
        TEST_OT_tick.rung = self.timer.time_duration
        now = time.perf_counter()
        ticks.append(now)
        driver.region("WINDOW").tag_redraw()
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


def measure(name: str) -> driver.Steps:
    """Return the `Figures` of the next seconds."""
    import numpy as np

    with driver.in_viewport():
        bpy.ops.test.tick("INVOKE_DEFAULT")
    yield SECONDS + 1.0
    between = 1000.0 * np.diff(ticks)
    figures = Figures(*(float(value) for value in (*np.percentile(between, [50, 95]), between.max())))
    print(f"redraw tick, {name}: {figures}; load of the machine {os.getloadavg()[0]:.1f}", flush=True)
    return figures


def meter_steps(spent: list[float]) -> None:
    """Note how much processor time each step of the operator takes of Blender's own thread."""
    solving = driver.module("operators.solving").Solving
    plain = solving._step

    def metered(*arguments):
        before = time.thread_time()
        try:
            return plain(*arguments)
        finally:
            spent.append(1000.0 * (time.thread_time() - before))

    solving._step = metered


def measure_solving() -> driver.Steps:
    """Return the figures while the solver works."""
    driver.approximate()
    yield from driver.wait_for(lambda: "Sparse Surface Preview" in bpy.data.objects, 200.0, "preview")
    figures = yield from measure("solving")
    assert driver.running() is not None, "the job was over before the measurement"
    assert driver.children()
    if hasattr(os, "SCHED_IDLE"):
        assert {os.sched_getscheduler(child) for child in driver.children()} == {os.SCHED_IDLE}
    driver.shot("responsiveness")
    # No key is pressed here: a Blender that takes simulated keys never sleeps, and an idle window has to be idle.
    with driver.in_viewport():
        bpy.ops.sparse_surface.cancel()
    yield 1.0
    return figures


def test_redraws_go_on_while_the_solver_works():
    bpy.utils.register_class(TEST_OT_tick)
    bpy.context.preferences.system.viewport_aa = "OFF"
    driver.clear_scene()
    bpy.context.scene.sparse_surface.iterations = 30
    driver.add_creased_grid(SIZE).display_type = "BOUNDS"
    yield from driver.open_sidebar()
    spent: list[float] = []
    meter_steps(spent)
    yield 1.0
    before = yield from measure("idle")
    for _ in range(ROUNDS):
        solving = yield from measure_solving()
        after = yield from measure("idle")
        missed = beyond_bounds(before, solving, after)
        if not missed:
            break
        print(missed, flush=True)
        before = after
    print(f"the operator's own steps: {len(spent)}, at most {max(spent):.0f} ms of processor time")
    assert max(spent) < 50.0
    assert not missed, f"in each of {ROUNDS} rounds; in the last {missed}"


def beyond_bounds(before: Figures, solving: Figures, after: Figures) -> str:
    """Return which bound a round does not keep, or nothing."""
    idle = max(before.high, after.high)
    if solving.high > FACTOR * idle:
        return f"p95 of {solving.high:.0f} ms exceeds {FACTOR} times the idle window's {idle:.0f}"
    largest = min(before.largest, after.largest)
    bound = LARGEST if largest <= LARGEST else FACTOR * largest
    if solving.largest > bound:
        return f"the largest tick of {solving.largest:.0f} ms exceeds {bound:.0f}"
    return ""


if __name__ == "__main__":
    driver.run(test_redraws_go_on_while_the_solver_works)
