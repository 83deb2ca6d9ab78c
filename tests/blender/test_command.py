"""`blender --command sparse_surface ...` is the command line."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
from bl_ext.user_default.sparse_surface.ui import command

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def test_command_does_the_same_as_the_command_line(tmp_path, capfd):
    scenes.creased_sheet(12)
    source, report = tmp_path / "sheet.ply", tmp_path / "report.json"
    bpy.ops.wm.ply_export(filepath=str(source), export_selected_objects=True, forward_axis="Y", up_axis="Z")
    quick = ["--iterations", "2", "--sweeps", "0", "--workers", "1"]
    assert command.run(["approximate", str(source), "--report", str(report), *quick]) == 0
    assert json.loads(report.read_text())["input"]["vertices"] == 144
    assert command.run(["approximate", str(tmp_path / "absent.ply")]) == 1
    assert command.run(["approximate"]) == 2
    assert capfd.readouterr().err.count("There is no file") == 1
