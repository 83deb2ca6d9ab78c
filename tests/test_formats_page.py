"""The measured table of docs/formats.md: a sample of its rows is measured again."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from sparse_surface.operators.files.formats import WRITABLE

CHECKOUT = Path(__file__).resolve().parent.parent
PAGE = (CHECKOUT / "docs" / "formats.md").read_text(encoding="utf-8")
MEASURED = PAGE.partition("<!-- measured by scripts/measure_formats.py -->")[2].partition("<!-- end -->")[0]
bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0


def test_every_format_that_is_written_has_a_row() -> None:
    rows = [line.split(" | ")[0].removeprefix("| ") for line in MEASURED.strip().splitlines()[2:]]
    assert rows == list(WRITABLE)


@pytest.mark.skipif(bpy_missing, reason="runs the commands under bpy")
def test_rows_are_what_the_commands_do_today() -> None:
    sample = [".ply", ".obj", ".glb", ".usda", ".npz"]
    script = CHECKOUT / "scripts" / "measure_formats.py"
    done = subprocess.run([sys.executable, script, *sample], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if line.startswith("| .")]
    assert len(rows) == len(sample)
    for found in rows:
        assert found in MEASURED
