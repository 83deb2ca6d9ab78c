"""The command `distance` as a process: what it measures, writes, says and refuses."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="the command line needs bpy")

QUADS = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sparse_surface", "distance", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def box(path: Path, sides: tuple[float, float, float], away: float = 0.0) -> Path:
    """Write a box around (away, 0, 0)."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * sides
    lines = [f"v {x + away} {y} {z}" for x, y, z in corners] + ["f {} {} {} {}".format(*quad) for quad in QUADS]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_two_boxes_are_measured_both_ways(tmp_path: Path) -> None:
    """The corners of a box 2 long are sqrt(2 (0.5)^2 + 0.5^2) from those of a cube; the cube is 0.5 below its faces."""
    large, small = box(tmp_path / "large.obj", (2.0, 2.0, 2.0)), box(tmp_path / "small.obj", (1.0, 1.0, 1.0))
    report, csv, out, page = (tmp_path / name for name in ("r.json", "d.csv", "out.ply", "page.html"))
    done = run(large, small, "--signed", "--tolerance", "0.6", "--report", report, "--csv", csv, "-o", out)
    assert done.returncode == 0, done.stderr
    values = json.loads(report.read_text())
    assert values["a_to_b"]["max"] == pytest.approx(np.sqrt(0.75), abs=1e-4)
    assert values["b_to_a"]["max"] == pytest.approx(0.5, abs=1e-4)
    assert values["b_to_a"]["signed_mean"] == pytest.approx(-0.5, abs=1e-5)
    assert values["hausdorff"] == values["a_to_b"]["max"]
    assert 0.0 < values["inside_tolerance"] < 1.0
    rows = np.loadtxt(csv, delimiter=",", skiprows=1)
    assert rows[:, 1] == pytest.approx(np.full(8, np.sqrt(0.75)))
    assert np.abs(rows[:, 2:]) == pytest.approx(np.full((8, 3), 0.5))
    assert b"error" in out.read_bytes().split(b"end_header")[0]
    assert not page.exists()


def test_pictures_and_page_are_written(tmp_path: Path) -> None:
    one, other = box(tmp_path / "one.obj", (1.0, 0.7, 0.4), 5.0), box(tmp_path / "other.obj", (1.0, 0.7, 0.42))
    page, heat_map, bars = (tmp_path / name for name in ("page.html", "heat.png", "bars.png"))
    done = run(one, other, "--align", "rigid", "--signed", "--page", page, "--heatmap", heat_map, "--histogram", bars)
    assert done.returncode == 0, done.stderr
    assert "aligned" in done.stdout
    text = page.read_text()
    assert text.count("data:image/png;base64,") == 3
    assert text.count("<rect") == 64
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", text)  # the letters of a picture may spell anything
    assert all(picture.read_bytes()[:4] == b"\x89PNG" for picture in (heat_map, bars))


def test_a_file_of_points_is_measured(tmp_path: Path) -> None:
    cloud = tmp_path / "scan.xyz"
    cloud.write_text("0 0 2\n0.2 0.1 0.75\n3 0 0\n")
    report = tmp_path / "r.json"
    done = run(cloud, box(tmp_path / "box.obj", (1.0, 1.0, 1.0)), "--report", report)
    assert done.returncode == 0, done.stderr
    assert json.loads(report.read_text())["a_to_b"]["max"] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("words", "code"), [(("a.obj", "b.obj"), 1), (("a.obj",), 2), (("a", "b", "--csv", "x.txt"), 2)]
)
def test_refusals(words: tuple[str, ...], code: int) -> None:
    done = run(*words)
    assert done.returncode == code
    assert len(done.stderr.strip().splitlines()) == 1
