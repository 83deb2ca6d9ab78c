"""A disk that is full while the command line writes: one sentence, exit code 1, and the old files as they were."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="the command line needs bpy")

SCRIPT = """
import os, sys
from pathlib import Path
import bpy
from sparse_surface.command_line.main import main
from sparse_surface.benchmarks import generated_models as models
folder, model = Path(sys.argv[1]), Path(sys.argv[2])
vertices, faces = models.cube(14)
lines = ["v {} {} {}".format(*point) for point in vertices]
lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
model.write_text(chr(10).join(lines))
for option, name in zip(sys.argv[3::2], sys.argv[4::2]):
    target = folder / name
    target.write_text("old")
    quick = ["--iterations", "1", "--sweeps", "0", "--workers", "1", "--degree", "5"]
    code = main(["approximate", str(model), option, str(target), *quick])
    print("RESULT", name, code, target.read_text() == "old", os.listdir(folder) == [name], flush=True)
    target.unlink()
"""


def run(tmp_path: Path, size: str, *outputs: str) -> subprocess.CompletedProcess[str]:
    unshare = shutil.which("unshare")
    prefix = [unshare or "unshare", "--map-root-user", "--mount"]
    if unshare is None or subprocess.run([*prefix, "true"], capture_output=True).returncode != 0:
        pytest.skip("small disks need `unshare`")
    disk = tmp_path / "disk"
    disk.mkdir()
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    mount = f'mount -t tmpfs -o size={size} none {disk} && exec {sys.executable} {script} {disk} "$@"'
    command = [*prefix, "sh", "-c", mount, "sh", str(tmp_path / "model.obj"), *outputs]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def check(done: subprocess.CompletedProcess[str], names: list[str]) -> None:
    results = re.findall(r"RESULT [\w. ]+", done.stdout)  # one exporter does not end its own line
    assert results == [f"RESULT {name} 1 True True" for name in names], done.stdout + done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("sparse_surface: ")]
    assert len(said) == len(names)
    assert not any("Traceback" in line for line in said)


def test_a_mesh_that_the_exporter_cut_short_without_a_word(tmp_path: Path) -> None:
    check(run(tmp_path, "40k", "-o", "old.obj"), ["old.obj"])


@pytest.mark.long
def test_every_kind_of_output(tmp_path: Path) -> None:
    """All but Alembic, at which Blender itself ends the process when a disk is full."""
    names = ["old.ply", "old.stl", "old.blend", "old.glb", "old.fbx", "old.usdc"]
    check(run(tmp_path, "40k", *(part for name in names for part in ("-o", name))), names)


@pytest.mark.long
def test_representation_and_report(tmp_path: Path) -> None:
    check(run(tmp_path, "12k", "--representation", "old.npz"), ["old.npz"])
    shutil.rmtree(tmp_path / "disk")
    check(run(tmp_path, "4k", "--report", "old.json"), ["old.json"])
