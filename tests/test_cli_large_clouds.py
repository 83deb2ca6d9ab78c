"""`reconstruct` from the command line with clouds that are read in parts."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="reads and writes files by Blender")

QUICK = ("--iterations", "2", "--sweeps", "1", "--workers", "1")
MIDDLE, RADIUS = np.array([500_000.0, 5_600_000.0, 200.0]), 50.0


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sparse_surface", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def ball(count: int) -> np.ndarray:
    points = np.random.default_rng(2).normal(size=(count, 3))
    return MIDDLE + RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True)


def las(path: Path, points: np.ndarray) -> Path:
    """Write a coloured .las, red above the middle and blue below it."""
    head = bytearray(227)
    head[:4], head[24:26] = b"LASF", bytes([1, 2])
    struct.pack_into("<HI", head, 94, 227, 227)
    struct.pack_into("<BHI", head, 104, 2, 26, len(points))
    struct.pack_into("<6d", head, 131, *[0.001] * 3, *np.floor(MIDDLE))
    layout = {"names": ["p", "c"], "formats": ["(3,)<i4", "(3,)<u2"], "offsets": [0, 20], "itemsize": 26}
    rows = np.zeros(len(points), np.dtype(layout))
    rows["p"] = np.round((points - np.floor(MIDDLE)) / 0.001)
    upper = points[:, 2] > MIDDLE[2]
    rows["c"][upper, 0], rows["c"][~upper, 2] = 65535, 65535
    path.write_bytes(bytes(head) + rows.tobytes())
    return path


def xyz(path: Path, points: np.ndarray) -> Path:
    np.savetxt(path, points, fmt="%.6f")
    return path


def vertices_of(path: Path) -> np.ndarray:
    return np.array([line.split()[1:4] for line in path.read_text().splitlines() if line.startswith("v ")], float)


@pytest.mark.parametrize("write", [las, xyz])
def test_a_cloud_in_parts_lands_where_it_was(tmp_path: Path, write) -> None:
    path = write(tmp_path / f"scan.{write.__name__}", ball(30_000))
    out, report = tmp_path / "out.obj", tmp_path / "report.json"
    done = run("reconstruct", path, "--most-points", "2000", "-o", out, "--report", report, *QUICK)
    assert done.returncode == 0, done.stderr
    assert "scan: 30000 points became " in done.stdout
    assert "merged in cells" in done.stdout
    given = json.loads(report.read_text())["input"]
    assert given["points"] == 30_000
    assert 1000 < given["used"] <= 2000
    assert given["used"] + given["merged"] + given["duplicates"] + given["strays"] == 30_000
    off = np.abs(np.linalg.norm(vertices_of(out) - MIDDLE, axis=1) - RADIUS)
    assert off.max() < 0.02 * RADIUS


def test_many_points_are_merged_unasked_and_colours_are_carried(tmp_path: Path) -> None:
    path, out = las(tmp_path / "scan.las", ball(8000)), tmp_path / "out.obj"
    few = (
        "import sys, sparse_surface.command_line.in_parts as large\n"
        "from sparse_surface.command_line.main import main\n"
        "large.MOST_POINTS = int(sys.argv[1])\n"
        "sys.exit(main(sys.argv[2:]))"
    )
    words = ["reconstruct", path, "-o", out, "--error-colors", "keep", *QUICK]
    for most, merged in ((8000, False), (3000, True)):
        command = [sys.executable, "-c", few, str(most), *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        assert ("scan: 8000 points became " in done.stdout) is merged
    rows = np.array([line.split()[1:] for line in out.read_text().splitlines() if line.startswith("v ")], float)
    high = rows[:, 2] > MIDDLE[2] + 0.2 * RADIUS
    assert high.sum() > 100
    assert rows[high, 3].min() > 0.9 > 0.1 > rows[high, 5].max()


def test_few_points_are_read_in_one_piece(tmp_path: Path) -> None:
    done = run("reconstruct", las(tmp_path / "scan.las", ball(600)), "-o", tmp_path / "out.ply", *QUICK)
    assert done.returncode == 0, done.stderr
    assert "became" not in done.stdout
    assert "scan: 600 points over" in done.stdout


@pytest.mark.parametrize(
    ("content", "options", "code", "words"),
    [
        ("0 0 0\none two three\n", (), 1, "line 2, 'one two three', does not have three numbers."),
        ("# nothing\n", (), 1, "'scan.xyz' holds no points."),
        ("0 0 0\n1 0 0\nnan 1 0\n1 1 1\n", (), 1, "A surface needs at least 4 points; of 4 only 3 can be used."),
        ("0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 1 0\n", (), 1, "All the points lie in one plane: choose a base mesh for them."),
        ("0 0 0\n1 0 0\n", ("--object", "scan"), 2, "--most-points reads whole files of"),
    ],
    ids=["words", "empty", "nan", "plane", "object"],
)
def test_bad_input_gets_the_sentences_of_a_cloud_in_one_piece(
    tmp_path: Path, content: str, options: tuple[str, ...], code: int, words: str
) -> None:
    path = tmp_path / "scan.xyz"
    path.write_text(content)
    done = run("reconstruct", path, "--most-points", "100", "-o", tmp_path / "out.ply", *options)
    assert (done.returncode, words in done.stderr) == (code, True), done.stderr
    assert "Traceback" not in done.stderr
    assert [each.name for each in tmp_path.iterdir()] == ["scan.xyz"]


@pytest.mark.skipif(os.name != "posix", reason="signals of other systems")
def test_a_killed_run_leaves_nothing(tmp_path: Path) -> None:
    """Nothing stands beside the output, or in the folder for temporary files, that the run began."""
    path, spare = las(tmp_path / "scan.las", ball(60_000)), tmp_path / "spare"
    spare.mkdir()
    command = [sys.executable, "-m", "sparse_surface", "reconstruct", str(path), "--most-points", "8000"]
    command += ["-o", str(tmp_path / "out.ply"), "--report", str(tmp_path / "report.json")]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(spare)}, start_new_session=True
    )
    assert process.stdout is not None
    for line in process.stdout:
        if "Looking at the points" in line:
            break
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    time.sleep(0.5)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["scan.las", "spare"]
