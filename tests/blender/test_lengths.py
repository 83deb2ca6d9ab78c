"""Lengths are shown in the scene's units, whatever their scale."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import pytest
from bl_ext.user_default.sparse_surface.operators.data.lengths import length_text
from bl_ext.user_default.sparse_surface.operators.data.report_text import one_line, table

sys.path.insert(0, str(Path(__file__).parent))
import scenes


@pytest.fixture(autouse=True)
def units():
    found = bpy.context.scene.unit_settings
    before = found.system, found.length_unit, found.scale_length
    yield found
    found.system, found.length_unit, found.scale_length = before


@pytest.mark.parametrize(
    ("system", "unit", "scale", "length", "text"),
    [
        ("METRIC", "METERS", 1.0, 0.00123456, "0.001235 m"),
        ("METRIC", "MILLIMETERS", 1.0, 0.00123456, "1.235 mm"),
        ("METRIC", "MILLIMETERS", 0.001, 1.5, "1.5 mm"),
        ("METRIC", "ADAPTIVE", 1.0, 0.00123456, "1.235 mm"),
        ("METRIC", "ADAPTIVE", 0.001, 0.00123456, "1.235 µm"),
        ("METRIC", "ADAPTIVE", 1.0, 2500.0, "2.5 km"),
        ("METRIC", "ADAPTIVE", 1.0, 0.0, "0 m"),
        ("IMPERIAL", "INCHES", 1.0, 0.0254, "1 in"),
        ("IMPERIAL", "ADAPTIVE", 1.0, 0.3048, "1 ft"),
        ("NONE", None, 1.0, 0.00123456, "0.001235"),
    ],
)
def test_text_of_a_length(units, system, unit, scale, length, text):
    units.system, units.scale_length = system, scale
    if unit is not None:
        units.length_unit = unit
    assert length_text(bpy.context.scene, length) == text


def test_message_and_statistics_have_units(units):
    scenes.creased_sheet(12)
    report = scenes.approximate()["sparse_surface"].to_dict()
    units.system, units.length_unit, units.scale_length = "METRIC", "MILLIMETERS", 0.5
    largest = f"{500 * report['surface_error']['max']:.4g} mm"

    def length(value: float) -> str:
        return length_text(bpy.context.scene, value)

    assert largest in one_line("Sheet", report, length)
    assert largest in table("Sheet", report, length)
    assert "mm" not in one_line("Sheet", report)  # a file has no units
