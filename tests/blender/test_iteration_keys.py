"""Iterations kept as shape keys: they change nothing until one scrubs through them."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def seen_at(made, time):
    made.data.shape_keys.eval_time = time
    return scenes.world_positions(made, evaluated=True)


def test_each_iteration_is_a_key_that_evaluation_time_scrubs_to():
    sheet = scenes.creased_sheet(16)
    plain = scenes.approximate(iterations=4)
    expected = scenes.positions(plain.data).copy()
    scenes.select(sheet)
    made = scenes.approximate(iterations=4, keep_iterations=True)
    keys = made.data.shape_keys
    assert [key.name for key in keys.key_blocks] == ["Result", *(f"Iteration {k}" for k in range(1, 5))]
    np.testing.assert_array_equal(scenes.positions(made.data), expected)
    np.testing.assert_array_equal(
        scenes.positions(made.evaluated_get(bpy.context.evaluated_depsgraph_get()).data), expected
    )
    source = scenes.world_positions(sheet)
    errors = [np.linalg.norm(seen_at(made, 10 * k) - source, axis=1).mean() for k in range(5)]
    assert errors[4] < errors[1]
    assert len({round(error, 9) for error in errors[1:]}) == 4


def test_without_the_setting_there_are_no_keys():
    scenes.creased_sheet(16)
    assert scenes.approximate().data.shape_keys is None


def test_a_new_result_without_keys_replaces_one_that_had_them():
    sheet = scenes.creased_sheet(16)
    made = scenes.approximate(keep_iterations=True)
    scenes.select(sheet)
    again = scenes.approximate(keep_iterations=False)
    assert again == made
    assert again.data.shape_keys is None
    assert len(bpy.data.shape_keys) == 0


def test_keys_stand_in_the_local_space_of_a_scaled_source():
    sheet = scenes.creased_sheet(16)
    sheet.scale = (2.0, 0.5, 3.0)
    bpy.context.view_layer.update()
    made = scenes.approximate(iterations=2, sweeps=0, keep_iterations=True)
    result = seen_at(made, 0.0)
    np.testing.assert_allclose(seen_at(made, 20.0), result, atol=0.2)
