"""Files with several meshes: what is done is written, what is not is said, and a shared mesh is solved once."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="the command line needs bpy")

SCENE = """
import bpy, sys, math
bpy.ops.wm.read_homefile(use_empty=True)
def sheet(name, bad=False):
    n = 10
    points = [(i / n, j / n, 0.2 * math.sin(4 * i / n)) for i in range(n) for j in range(n)]
    if bad:
        points[3] = (float("nan"), 0.0, 0.0)
    first = [i * n + j for i in range(n - 1) for j in range(n - 1)]
    faces = [(k, k + n, k + n + 1, k + 1) for k in first]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made
for name in sys.argv[2:]:
    made = sheet(name, name.startswith("bad"))
    if name == "twin":
        for number in range(2):
            other = bpy.data.objects.new(f"twin copy {number}", made.data)
            other.location.x = 3.0 * (number + 1)
            bpy.context.scene.collection.objects.link(other)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


def scene(path: Path, *names: str) -> Path:
    subprocess.run([sys.executable, "-c", SCENE, path, *names], check=True, capture_output=True, timeout=120)
    return path


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sparse_surface", "approximate", *map(str, arguments)]
    options = ["--iterations", "2", "--sweeps", "0", "--workers", "1"]
    return subprocess.run([*command, *options], capture_output=True, text=True, timeout=300)


def test_a_bad_mesh_does_not_stop_the_others(tmp_path: Path) -> None:
    path = scene(tmp_path / "scene.blend", "a", "bad", "c")
    report = tmp_path / "report.json"
    done = run(path, "-o", tmp_path / "out.ply", "--report", report, "--representation", tmp_path / "r.npz")
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert line == "sparse_surface: bad: Vertex 3 has a coordinate that is not a finite number."
    assert set(json.loads(report.read_text())) == {"a", "c"}
    assert sorted(p.name for p in tmp_path.glob("r*.npz")) == ["r_a.npz", "r_c.npz"]
    strict = run(path, "-o", tmp_path / "strict.ply", "--strict")
    assert strict.returncode == 1
    assert (tmp_path / "strict.ply").exists()
    only = run(scene(tmp_path / "bad.blend", "bad", "bad too"), "-o", tmp_path / "none.ply")
    assert only.returncode == 1
    assert len(only.stderr.splitlines()) == 3
    assert not (tmp_path / "none.ply").exists()


def test_objects_that_share_a_mesh_are_solved_once(tmp_path: Path) -> None:
    out = tmp_path / "out.obj"
    done = run(scene(tmp_path / "scene.blend", "twin", "other"), "-o", out)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Reading the mesh") == 2
    assert sum(" surface error " in line for line in done.stdout.splitlines()) == 4
    vertices = [line for line in out.read_text().splitlines() if line.startswith("v ")]
    assert len(vertices) == 400
    assert max(float(line.split()[1]) for line in vertices) > 6.0


def test_long_names_and_names_alike_get_files_of_their_own(tmp_path: Path) -> None:
    path = scene(tmp_path / "scene.blend", 50 * "n" + "one", 50 * "n" + "two", "a/b", "a_b")
    done = run(path, "--representation", tmp_path / "r.npz", "-o", tmp_path / "out.obj")
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("r*.npz"))) == 4
    assert sum(line.startswith("o ") for line in (tmp_path / "out.obj").read_text().splitlines()) == 4
