"""The command line with large meshes: in blocks, resumed, on a cluster."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.command_line.main import main
from sparse_surface.operators.files.large import LargeFile, read_large, write_large
from sparse_surface.operators.files.plain import read_plain
from sparse_surface.solver import BlockSurface, Settings, approximate_blocks

QUICK = ("--ring", "4", "--degree", "7", "--sparsity", "8", "--iterations", "2", "--sweeps", "0", "--workers", "1")
SETTINGS = Settings(ring=4, degree=7, sparsity=8, iterations=2, sweeps=0, workers=1)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A terrain as a binary .ply."""
    vertices, faces = models.creased_terrain(1500)
    write_large(tmp_path / "model.ply", LargeFile(vertices, faces), vertices.astype("f4"), {})
    return tmp_path / "model.ply"


def test_a_binary_ply_is_mapped_and_written_as_others_read_it(model: Path, tmp_path: Path) -> None:
    vertices, faces = models.creased_terrain(1500)
    found = read_large(model)
    assert isinstance(found.vertices.base, np.memmap)
    assert (found.vertices == vertices.astype("f4")).all()
    assert (found.faces == faces).all()
    plain = read_plain(model)
    assert (plain.vertices.astype("f4") == found.vertices).all()
    assert (plain.corners.reshape(-1, 3) == faces).all()
    error = np.arange(len(vertices), dtype="f4")
    write_large(tmp_path / "again.ply", found, found.vertices, {"error": error, "patch": error.astype("i4")})
    assert (read_plain(tmp_path / "again.ply").values["error"] == error).all()


@pytest.mark.parametrize("ending", [".ply", ".obj", ".npz"])
def test_other_files_are_loaded(tmp_path: Path, ending: str) -> None:
    pytest.importorskip("meshio")
    vertices, quads = models.cube(2)
    mixed = [*quads[1:].tolist(), quads[0, :3].tolist(), quads[0, [0, 2, 3]].tolist()]
    write_large(tmp_path / f"m{ending}", LargeFile(vertices, mixed), vertices, {})
    found = read_large(tmp_path / f"m{ending}")
    assert np.allclose(found.vertices, vertices)
    assert sorted(len(face) for face in found.faces) == sorted(map(len, mixed))


def test_a_job_in_blocks_writes_everything_and_goes_on(model: Path, tmp_path: Path) -> None:
    words = ["approximate", str(model), "--block-size", "600", "--resume", str(tmp_path / "job"), *QUICK]
    first = [*words, "-o", str(tmp_path / "one.ply"), "--report", str(tmp_path / "report.json")]
    assert main([*first, "--representation", str(tmp_path / "surface")]) == 0
    blocks = sorted((tmp_path / "job" / "blocks").iterdir())
    (tmp_path / "job" / "report.json").unlink()
    blocks[1].unlink()
    times = [block.stat().st_mtime_ns for block in (blocks[0], blocks[2])]
    assert main([*words, "-o", str(tmp_path / "two.ply")]) == 0
    assert (tmp_path / "one.ply").read_bytes() == (tmp_path / "two.ply").read_bytes()
    assert times == [block.stat().st_mtime_ns for block in (blocks[0], blocks[2])]
    found = read_large(model)
    expected = approximate_blocks(found.vertices, found.faces, SETTINGS, block_size=600)
    assert (read_large(tmp_path / "one.ply").vertices == expected.vertices).all()
    assert (BlockSurface.load(tmp_path / "surface").at_vertices() == expected.vertices).all()
    assert json.loads((tmp_path / "report.json").read_text())["input"]["blocks"] == 3


def test_the_folder_of_a_job_is_evaluated(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["approximate", str(model), "--block-size", "600", *QUICK]
    job = [*words, "--representation", str(tmp_path / "surface")]
    assert main([*job, "--resample", "2", "-o", str(tmp_path / "one.ply")]) == 0
    assert main(["evaluate", str(tmp_path / "surface"), "--resample", "2", "-o", str(tmp_path / "two.ply")]) == 0
    assert (tmp_path / "one.ply").read_bytes() == (tmp_path / "two.ply").read_bytes()
    fine, coarse = read_large(tmp_path / "two.ply"), read_large(model)
    assert len(fine.faces) == 4 * len(coarse.faces)
    surface = BlockSurface.load(tmp_path / "surface")
    assert (fine.vertices[: len(coarse.vertices)] == surface.at_vertices()).all()
    middles = surface.evaluate(np.arange(len(coarse.faces)), np.tile([0.5, 0.5, 0.0], (len(coarse.faces), 1)))
    nearest = cKDTree(fine.vertices).query(middles)[0]
    assert nearest.max() < 1e-6 * np.ptp(coarse.vertices)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.ply", "one.ply", "surface", "two.ply"]
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path), "-o", str(tmp_path / "none.ply")]) == 1
    assert "it holds no finished job" in capsys.readouterr().err


def test_what_cannot_be_is_one_sentence(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["approximate", str(model), "--block-size", "600", *QUICK]
    assert main([*words, "--heatmap", str(tmp_path / "map.png")]) == 2
    assert "--heatmap needs the mesh in one piece" in capsys.readouterr().err
    assert main([*words, "--quality", "compact"]) == 2
    assert "--quality needs the mesh in one piece" in capsys.readouterr().err
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    assert main([*words, "--resume", str(tmp_path / "full")]) == 1
    assert "holds something else than a job" in capsys.readouterr().err


def test_a_cluster_solves_the_blocks(model: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    words = ["approximate", str(model), "--block-size", "600", *QUICK]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        done = [sys.executable, "-m", "sparse_surface", *words, "--cluster", cluster.scheduler_address]
        subprocess.run([*done, "-o", str(tmp_path / "far.ply")], check=True, timeout=300)
    assert main([*words, "-o", str(tmp_path / "near.ply")]) == 0
    assert (tmp_path / "far.ply").read_bytes() == (tmp_path / "near.ply").read_bytes()
