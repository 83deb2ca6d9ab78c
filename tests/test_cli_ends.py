"""Every command ends soon after the last thing that it writes, whatever files it read and wrote."""

from __future__ import annotations

import os
import selectors
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="reads and writes files by Blender")

COMMAND = [sys.executable, "-m", "sparse_surface"]
QUICK = ["--iterations", "2", "--sweeps", "0", "--workers", "2"]
NEEDED = {".vtp": ["pyvista"], ".dae": ["trimesh", "collada"], ".3mf": ["trimesh", "networkx", "lxml"]}
ENDINGS = (
    *(".obj", ".ply", ".stl", ".blend", ".glb", ".gltf", ".fbx", ".usd", ".usda", ".usdc", ".abc"),
    *(".off", ".vtk", ".vtu", ".vtp", ".dae", ".3mf", ".npz"),
)
SECONDS, SECONDS_OF_A_RUN = 2.0, 120.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wavy sheet as a mesh and as points, and its representation."""
    folder = tmp_path_factory.mktemp("ends")
    size = 16
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, size)], indexing="ij"))
    rows = [f"{a:.6f} {b:.6f} {0.2 * np.sin(4.0 * a):.6f}" for a, b in zip(x, y, strict=True)]
    i = np.arange(size * size).reshape(size, size)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4) + 1
    faces = [" ".join(map(str, face)) for face in quads.tolist()]
    (folder / "model.obj").write_text("".join(f"v {row}\n" for row in rows) + "".join(f"f {face}\n" for face in faces))
    (folder / "points.xyz").write_text("\n".join(rows) + "\n")
    ran(["approximate", folder / "model.obj", "--representation", folder / "functions.npz", *QUICK], [])
    return folder


def ran(words: list[str | Path], outputs: list[Path]) -> float:
    """Run a command; return the seconds from the last that it wrote, on a stream or in a file, to its end."""
    process = subprocess.Popen([*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    said, last = b"", time.time()
    assert process.stdout is not None
    assert process.stderr is not None
    with selectors.DefaultSelector() as selector:
        for stream in (process.stdout, process.stderr):
            selector.register(stream, selectors.EVENT_READ)
        end = time.time() + SECONDS_OF_A_RUN
        while selector.get_map() and time.time() < end:
            for key, _ in selector.select(timeout=1.0):
                if data := os.read(key.fd, 65536):
                    said, last = said + data, time.time()
                else:
                    selector.unregister(key.fileobj)
    try:
        code = process.wait(timeout=max(end - time.time(), 1.0))
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise
    ended = time.time()
    process.stdout.close()
    process.stderr.close()
    assert code == 0, said.decode()
    assert all(path.exists() for path in outputs), said.decode()
    return ended - max([last, *(path.stat().st_mtime for path in outputs)])


def written(folder: Path, words: list[str | Path], name: str) -> float:
    path = folder / name
    after = ran([*words, "-o", path, "--report", folder / f"{name}.json"], [path, folder / f"{name}.json"])
    assert after < SECONDS
    return after


@pytest.mark.parametrize(
    "ending",
    [ending if ending in (".blend", ".usdc") else pytest.param(ending, marks=pytest.mark.long) for ending in ENDINGS],
)
def test_reading_and_writing_files(folder: Path, ending: str) -> None:
    for package in NEEDED.get(ending, ()):
        pytest.importorskip(package)
    written(folder, ["approximate", folder / "model.obj", *QUICK], f"first{ending}")
    first = folder / f"first{ending}"
    for job, words in {
        "approximate": ["approximate", first, *QUICK],
        "denoise": ["approximate", first, "--denoise", "only", *QUICK],
        "resample": ["approximate", first, "--resample", "2", *QUICK],
        "reconstruct": ["reconstruct", first, *QUICK],
    }.items():
        print(f"{ending} {job}: ended {written(folder, words, job + ending):.2f} s after its last output")


def test_other_commands(folder: Path) -> None:
    model, functions = folder / "model.obj", folder / "functions.npz"
    for words, outputs in (
        (["reconstruct", folder / "points.xyz", *QUICK, "-o", folder / "made.ply"], [folder / "made.ply"]),
        (["evaluate", functions, "-o", folder / "fine.ply", "--resample", "2"], [folder / "fine.ply"]),
        (["inspect", functions, "--patch", "0"], []),
        (["distance", model, folder / "points.xyz"], []),
        (["compare", model, *QUICK, "-o", folder / "compared.blend"], [folder / "compared.blend"]),
        (["approximate", model, *QUICK, "--heatmap", folder / "heat.png"], [folder / "heat.png"]),
    ):
        assert ran(words, outputs) < SECONDS
