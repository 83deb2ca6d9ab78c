"""Every command of the documents, run as it is printed, in a folder that holds the files that it names."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.solver import Settings, approximate_blocks

CHECKOUT = Path(__file__).resolve().parent.parent
bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="the command line needs bpy")

PAGES = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
# In a block of code, or in code within a line; not with a placeholder such as `...`.
PRINTED = re.compile(r"(?:^|`)(?:python -m|blender --command) (sparse_surface (?:(?!\.\.\.)[^`\n])+)", re.MULTILINE)
SCHEDULER = "tcp://scheduler:8786"
COMMANDS = sorted({words.strip() for page in PAGES for words in PRINTED.findall(page.read_text(encoding="utf-8"))})


def sheet(size: int = 14) -> tuple[np.ndarray, np.ndarray]:
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, size)], indexing="ij"))
    i = np.arange(size * size).reshape(size, size)
    one = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:]], axis=2).reshape(-1, 3)
    two = np.stack([i[:-1, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 3)
    return np.stack([x, y, 0.2 * np.sin(4.0 * x)], axis=1), np.concatenate([one, two])


def write_obj(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*point) for point in points]
    path.write_text("\n".join([*lines, *("f {} {} {}".format(*(t + 1)) for t in triangles)]) + "\n")


def write_ply(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    header = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property float {a}" for a in "xyz")]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    rows = ["{:.6f} {:.6f} {:.6f}".format(*point) for point in points] + ["3 {} {} {}".format(*t) for t in triangles]
    path.write_text("\n".join(header + rows) + "\n")


def write_stl(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    rows = ["solid part"]
    for corners in points[triangles]:
        vertices = ["vertex {:.6f} {:.6f} {:.6f}".format(*corner) for corner in corners]
        rows += ["facet normal 0 0 0", "outer loop", *vertices, "endloop", "endfacet"]
    path.write_text("\n".join([*rows, "endsolid part"]) + "\n")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    points, triangles = sheet()
    none = np.zeros((0, 3), dtype=int)
    write_obj(tmp_path / "model.obj", points, triangles)
    write_obj(tmp_path / "coarse.obj", *sheet(4))
    write_ply(tmp_path / "scan.ply", points + 1e-3 * np.random.default_rng(1).normal(size=points.shape), triangles)
    write_stl(tmp_path / "part.stl", points, triangles)
    write_ply(tmp_path / "points.ply", sheet(30)[0], none)
    settings = Settings(ring=3, degree=4, sparsity=5, iterations=1, workers=1)
    approximate_blocks(points, triangles, settings, block_size=100, folder=tmp_path / "surface")
    (tmp_path / "points.xyz").write_text("\n".join("{} {} {}".format(*point) for point in sheet(30)[0]) + "\n")
    return tmp_path


def test_the_documents_have_commands() -> None:
    assert len(COMMANDS) >= 6
    assert any("--heatmap" in command for command in COMMANDS)


@contextmanager
def cluster(command: str) -> Iterator[str]:
    """The command with the address of a cluster that exists, if it names one."""
    if SCHEDULER not in command:
        yield command
        return
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as local:
        yield command.replace(SCHEDULER, local.scheduler_address)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_does_what_it_says(files: Path, command: str) -> None:
    with cluster(command) as reachable:
        run(files, shlex.split(reachable))


def run(files: Path, words: list[str]) -> None:
    before = {path.name for path in files.iterdir()}
    done = subprocess.run(
        [sys.executable, "-m", *words], cwd=files, capture_output=True, text=True, timeout=300
    )  # its exit counts too
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    named = {word for word in words[2:] if re.fullmatch(r"[\w.-]+\.\w+", word) and not re.fullmatch(r"[\d.]+", word)}
    made = {path.name for path in files.iterdir()} - before
    assert named - before <= made
    assert made
