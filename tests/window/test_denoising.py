"""A slider in the sidebar of a denoised result brings its noise back at once."""

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


def add_noisy_sheet(size: int) -> Any:
    """Add and select a sheet with noise, with the job Denoise in the panel."""
    driver.clear_scene()
    sheet = driver.add_creased_grid(size)
    noisy = driver.scenes.positions(sheet.data)
    noisy[:, 2] += np.random.default_rng(3).normal(0.0, NOISE, len(noisy))
    sheet.data.vertices.foreach_set("co", noisy.ravel())
    sheet.data.update()
    settings = bpy.context.scene.sparse_surface
    settings.job = "DENOISE"
    assert settings.denoise == "only"
    return sheet


def seen(shown: Any) -> np.ndarray:
    """Return the local positions in which an object is drawn."""
    return driver.scenes.positions(shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def test_the_slider_of_a_result_brings_the_noise_back_while_it_is_dragged():
    sheet = add_noisy_sheet(60)
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
