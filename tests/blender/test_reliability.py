"""Long sessions: many runs, the extension switched off and on, and off in the middle of a run."""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
from pathlib import Path

import addon_utils
import bpy
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import scenes

PACKAGE = scenes.EXTENSION


def data_blocks() -> dict[str, int]:
    """Return how many data-blocks of each kind the file holds."""
    kinds = (name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection))
    return {name: len(getattr(bpy.data, name)) for name in kinds}


def process_footprint() -> tuple[int, int]:
    gc.collect()
    files = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    return threading.active_count(), files


@pytest.mark.parametrize("runs", [6, pytest.param(200, marks=pytest.mark.long)])
def test_many_runs_in_one_session_add_nothing(runs: int) -> None:
    sheet = scenes.creased_sheet(8)
    bpy.context.scene.sparse_surface.replace_result = True

    def one(number: int) -> None:
        scenes.select(sheet)
        scenes.approximate(iterations=1, degree=4 + number % 3, method=("DEFAULT", "TRADITIONAL")[number % 2].lower())

    for number in range(2):
        one(number)
    blocks, process = data_blocks(), process_footprint()
    for number in range(runs):
        one(number)
    assert data_blocks() == blocks
    assert process_footprint() == process


def test_suzanne() -> None:
    bpy.ops.mesh.primitive_monkey_add()
    suzanne = bpy.context.object
    before = scenes.positions(suzanne.data)
    result = scenes.approximate(ring=4)
    after = scenes.positions(result.data)
    assert np.isfinite(after).all()
    assert np.abs(after - before).max() < 0.2
    assert result["sparse_surface"]["input"]["components"] == 3


@pytest.mark.parametrize("times", [1, pytest.param(50, marks=pytest.mark.long)])
def test_switching_off_and_on_again_and_again(times: int) -> None:
    def state() -> tuple[set[str], list[int], tuple[int, int]]:
        names = {name for name in dir(bpy.types) if "sparse_surface" in name.lower()}
        handlers = [
            len(getattr(bpy.app.handlers, name)) for name in ("load_pre", "load_post", "undo_post", "redo_post")
        ]
        return names, handlers, process_footprint()

    before = state()
    for _ in range(times):
        addon_utils.disable(PACKAGE, default_set=True)
        assert not hasattr(bpy.types.Scene, "sparse_surface")
        addon_utils.enable(PACKAGE, default_set=True)
    after = state()
    assert after[:2] == before[:2]
    assert after[2] == before[2]
    scenes.creased_sheet(8)
    assert "error" in scenes.approximate(iterations=1).data.attributes


def test_switching_off_during_a_run_ends_it() -> None:
    from bl_ext.user_default.sparse_surface.operators.run.control import Run
    from bl_ext.user_default.sparse_surface.operators.run.operator import read_sources
    from bl_ext.user_default.sparse_surface.operators.run.session import session
    from bl_ext.user_default.sparse_surface.solver.settings import Settings

    sheet = scenes.creased_sheet(60)
    sources, refusals = read_sources(bpy.context, [sheet])
    assert not refusals
    blocks, process = data_blocks(), process_footprint()
    run = Run([(sources[0], Settings(iterations=200, workers=1))])
    session.start(run)
    end = time.monotonic() + 60.0
    while run.progress is None or run.progress.fraction == 0.0:
        assert time.monotonic() < end
        run.advance()
        time.sleep(0.01)
    job = run._job
    assert job is not None
    child = job._executor._crew[0]._process
    assert child.poll() is None
    try:
        addon_utils.disable(PACKAGE, default_set=True)
        assert session.current is None
        assert child.wait(30.0) != 0  # killed, though it may take a moment to go
    finally:
        addon_utils.enable(PACKAGE, default_set=True)
    assert data_blocks() == blocks
    del run, job, child
    assert process_footprint() == process
