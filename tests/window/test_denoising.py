"""A mesh is seen losing its noise, and a slider in the sidebar of the result brings it back at once."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import driver

NOISE = 0.002

STRENGTH = (0.62, 426)
"""In the sidebar of a result: share of its width, pixels below its top."""


STAGES = ("Fitting one-sided patches", "Moving vertices")
"""Of denoising that show something."""


def add_noisy_sheet(size: int) -> tuple[Any, np.ndarray]:
    """Add and select a sheet with noise, with the job Denoise in the panel; also return the clean positions, (V, 3)."""
    driver.clear_scene()
    sheet = driver.add_creased_grid(size)
    clean = driver.scenes.positions(sheet.data)
    noisy = clean.copy()
    noisy[:, 2] += np.random.default_rng(3).normal(0.0, NOISE, len(noisy))
    sheet.data.vertices.foreach_set("co", noisy.ravel())
    sheet.data.update()
    settings = bpy.context.scene.sparse_surface
    settings.job = "DENOISE"
    assert settings.denoise == "only"
    return sheet, clean


def seen(shown: Any) -> np.ndarray:
    """Return the local positions in which an object is drawn."""
    return driver.scenes.positions(shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def root_mean_square(distances: np.ndarray) -> float:
    return float(np.sqrt(np.mean(distances**2)))


def test_a_mesh_is_seen_losing_its_noise(monkeypatch):
    """As an early object, while patches are being fitted: what stands in the scene is noted after each preview."""
    preview = driver.module("operators.preview.controller").LivePreview
    update, noted = preview.update, []

    def noted_update(self, context):
        shown = update(self, context)
        early = [each for each in bpy.data.objects if "sparse_surface_early" in each]
        if shown and early and driver.running():
            off = root_mean_square(driver.scenes.positions(early[0].data) - clean)
            noted.append((driver.running().progress.stage, off))
        return shown

    monkeypatch(preview, "update", noted_update)
    sheet, clean = add_noisy_sheet(150)
    before = root_mean_square(driver.scenes.positions(sheet.data) - clean)
    bpy.context.scene.sparse_surface.preview_kind = "OBJECT"
    yield 0.3
    assert driver.approximate() == {"RUNNING_MODAL"}

    def seen_without() -> bool:
        return any(stage in STAGES and off < 0.8 * before for stage, off in noted)

    yield from driver.wait_for(lambda: seen_without() or driver.running() is None, 300.0, "mesh with less noise")
    print("before:", before, "previews:", noted, flush=True)
    assert seen_without(), "the run was over before the mesh was seen with less noise"
    driver.shot("denoising_early_object")
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})


def test_a_drawing_shows_it_too():
    add_noisy_sheet(150)
    bpy.context.scene.sparse_surface.preview_kind = "DRAWN"
    yield 0.3
    assert driver.approximate() == {"RUNNING_MODAL"}
    yield from driver.wait_for(lambda: driver.drawn_objects() or driver.running() is None, 300.0, "drawing")
    assert driver.drawn_objects(), "the run was over before anything was drawn"
    assert driver.running()
    assert driver.running().progress.stage in STAGES
    view = driver.viewport().spaces.active.region_3d
    view.view_distance, far = 5.0, view.view_distance
    yield 0.5
    drawn = driver.coloured_pixels("denoising_drawn")
    view.view_distance = far
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})
    gone = driver.coloured_pixels("denoising_gone")
    assert drawn > 5000, drawn
    assert gone < 0.1 * drawn, (gone, drawn)


def test_the_slider_of_a_result_brings_the_noise_back_while_it_is_dragged():
    sheet, _ = add_noisy_sheet(60)
    made = driver.scenes.approximate(denoise="only")  # in this process: what is tested here is what comes after
    bpy.ops.ed.undo_push(message="Denoise")
    yield from driver.open_sidebar()
    yield 1.0
    assert made.name == driver.RESULT
    noisy, denoised = driver.scenes.positions(sheet.data), seen(made)
    inspection = bpy.context.scene.sparse_surface.inspection
    driver.shot("denoised")
    over, window = driver.region("UI"), driver.window()
    x, y = over.x + int(over.width * STRENGTH[0]), over.y + over.height - STRENGTH[1]
    window.event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=y)
    yield 0.3
    window.event_simulate(type="LEFTMOUSE", value="PRESS", x=x, y=y)
    strengths = []
    for step in range(1, 9):
        yield 0.1
        window.event_simulate(type="MOUSEMOVE", value="NOTHING", x=x - 5 * step, y=y)
        yield 0.1
        strengths.append(inspection.strength)
        np.testing.assert_allclose(seen(made), noisy + strengths[-1] * (denoised - noisy), atol=1e-6)
    driver.shot("denoised_in_part")
    window.event_simulate(type="LEFTMOUSE", value="RELEASE", x=x - 40, y=y)
    yield 0.5
    print("strengths:", strengths, flush=True)
    assert len(set(strengths)) > 3
    assert 0.0 <= strengths[-1] < 0.95
    assert strengths == sorted(strengths, reverse=True)
    assert driver.running() is None
    with driver.in_viewport():
        bpy.ops.ed.undo()
    yield 0.5
    np.testing.assert_array_equal(seen(bpy.data.objects[driver.RESULT]), denoised)


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))
