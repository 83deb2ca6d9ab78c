"""The scripts of examples/ do what they say, on the installed extension."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import scenes

EXAMPLES = Path(__file__).resolve().parent.parent.parent / "examples"


@pytest.fixture
def example(user_folder, tmp_path):
    """Return a function that runs an example in a process of its own."""

    def run(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, str(EXAMPLES / name), *arguments],
            capture_output=True,
            text=True,
            timeout=300,
            cwd=tmp_path,
            env={**os.environ, "BLENDER_USER_RESOURCES": str(user_folder)},
        )

    return run


def test_a_scene(example, tmp_path):
    scenes.creased_sheet(9)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    done = example("approximate_scene.py", "scene.blend", "--output", "made.blend", "--ring", "3")
    assert done.returncode == 0, done.stderr
    assert "largest surface error" in done.stdout
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "made.blend"))
    made = bpy.data.objects["Sheet Sparse Surface"]
    assert made["sparse_surface"]["settings"]["ring"] == 3


def test_a_folder_and_what_is_refused_in_it(example, tmp_path):
    scenes.creased_sheet(9)
    models = tmp_path / "models"
    models.mkdir()
    bpy.ops.wm.obj_export(filepath=str(models / "sheet.obj"), export_materials=False)
    (models / "broken.ply").write_text("no mesh")
    done = example("approximate_folder.py", "models", "results", "--ring", "3", "--iterations", "2", "--workers", "1")
    assert done.returncode == 1, done.stderr
    assert "1 approximated, refused: broken.ply" in done.stdout
    assert json.loads((tmp_path / "results" / "sheet.json").read_text())["settings"]["ring"] == 3
    assert (tmp_path / "results" / "sheet.png").stat().st_size > 0
    assert sorted(file.suffix for file in (tmp_path / "results").iterdir()) == [".json", ".ply", ".png"]


def test_colours_by_error(example, tmp_path):
    done = example("error_colours.py", "colours.blend")
    assert done.returncode == 0, done.stderr
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "colours.blend"))
    assert bpy.data.node_groups["Colour by Error"].asset_data is not None
    shown = bpy.data.objects["Example"].evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    colours = np.empty(4 * len(shown.vertices), dtype=np.float32)
    shown.attributes["error ramp"].data.foreach_get("color", colours)
    height = np.array([vertex.co.z for vertex in shown.vertices])
    red = colours.reshape(-1, 4)[:, 0]
    assert red[height.argmax()] == pytest.approx(0.93, abs=1e-3)
    assert red[np.abs(height + 1.0).argmin()] == pytest.approx(0.05, abs=1e-3)
    assert shown.materials[0].name == "Error Colours"
