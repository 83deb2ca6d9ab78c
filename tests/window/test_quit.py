"""Quitting Blender in mid-job: nothing stays behind."""

from __future__ import annotations

import atexit
import os
import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver


def check_at_exit() -> None:
    """Runs last of all, when Blender is about to end."""
    end = time.monotonic() + (20.0 if driver.SHARED_MACHINE else 1.0)
    while driver.children(waiting=True) and time.monotonic() < end:
        time.sleep(0.01)
    left = driver.children(waiting=True)
    print("processes left at the end:", left, flush=True)
    if left:
        os._exit(1)


def test_quitting_in_mid_job():
    session = driver.module("operators.run.session")
    atexit.unregister(session._kill_at_exit)
    atexit.register(check_at_exit)  # the first registered is the last called
    atexit.register(session._kill_at_exit)
    driver.clear_scene()
    driver.add_creased_grid(80)
    yield from driver.open_sidebar()
    yield from driver.wait_for(driver.waiting_children, 30.0, "child for the next run")
    driver.approximate()
    yield from driver.wait_for(lambda: driver.running().progress, 60.0, "first word of the solver")
    assert driver.children()
    driver.module("solver.job").prepare(driver.module("operators.run.preloading").python_command())
    yield from driver.wait_for(driver.waiting_children, 30.0, "child for the run after it")
    assert bpy.context.mode == "OBJECT"


if __name__ == "__main__":
    driver.run(test_quitting_in_mid_job)
