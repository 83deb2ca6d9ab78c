"""The notebooks of the documents run, and show what their texts say."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

NOTEBOOKS = Path(__file__).resolve().parent.parent / "docs" / "notebooks"
pytest.importorskip("matplotlib", reason="the notebooks draw")

# What each notebook shows, as expressions of its own variables.
SHOWN = {
    "denoise-a-scan": ("after < before / 4", "turned_after < turned_before / 5", "turned_before > 10"),
    "measure-a-part": (
        "0.9 * DENT < one_way['max'] < 1.01 * DENT",
        "one_way['max'] <= one_way['max_bound'] < 1.001 * one_way['max']",
        "0.97 < measured.report['inside_tolerance'] < 1.0",
    ),
    "explain-a-patch": (
        "np.median(ratio[from_fold < 0.06]) > 0.2 > np.median(ratio[from_fold > 0.2])",
        "all(later <= earlier for earlier, later in zip(energy, energy[1:]))",
        "np.abs(sheet.values[:, 2] - 0.6 * np.abs(along)).max() < 0.05",
        "surface.support.shape[2] == 15 and surface.dictionary.size == 120",
    ),
}


def cells(name: str, kind: str) -> list[str]:
    found: list[dict[str, Any]] = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == kind]


def test_every_notebook_is_tested() -> None:
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == set(SHOWN)


@pytest.mark.parametrize("name", SHOWN)
def test_a_notebook_shows_what_it_says(name: str, tmp_path: Path) -> None:
    checks = [f"assert {shown}, {shown!r}" for shown in SHOWN[name]]
    program = "\n".join(["import matplotlib", "matplotlib.use('agg')", *cells(name, "code"), *checks])
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", SHOWN)
def test_a_notebook_is_stored_without_results(name: str) -> None:
    stored = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in stored["cells"] if "outputs" in cell)
    assert cells(name, "markdown")[0].startswith("# ")
