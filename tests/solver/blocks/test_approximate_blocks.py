"""Meshes in blocks: the same bytes anywhere, as close as in one piece, and on after any death."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import (
    FINISH,
    BlockSurface,
    FileFormatError,
    InputError,
    Settings,
    SettingsError,
    WorkerError,
    approximate,
    approximate_blocks,
    approximate_blocks_steps,
)
from sparse_surface.solver.blocks import engines
from sparse_surface.solver.blocks.content import SolvedBlock
from sparse_surface.solver.mesh.normals import face_normals

FAST = {"ring": 4, "degree": 7, "sparsity": 8, "iterations": 3, "workers": 1}
INSIDE = np.array([0.2, 0.3, 0.5])


@pytest.fixture(scope="module")
def cut(terrain):
    """A terrain in four blocks."""
    return approximate_blocks(*terrain, Settings(**FAST), block_size=800)


def same(one, other) -> bool:
    """Whether two results have the same bytes, the blocks' functions too."""
    arrays = all(
        np.asarray(getattr(one, name)).tobytes() == np.asarray(getattr(other, name)).tobytes()
        for name in ("vertices", "error", "patch")
    )
    blocks = sorted(path.name for path in (one.folder / "blocks").iterdir())
    assert blocks == sorted(path.name for path in (other.folder / "blocks").iterdir())
    solved = [
        [SolvedBlock.from_bytes((each.folder / "blocks" / name).read_bytes(), name).surface for each in (one, other)]
        for name in blocks
    ]
    return arrays and all(
        a.coefficients.tobytes() == b.coefficients.tobytes() and a.domains.tobytes() == b.domains.tobytes()
        for a, b in solved
    )


def places(faces):
    return np.arange(len(faces)), np.tile(INSIDE, (len(faces), 1))


def test_one_block_gives_the_bytes_of_approximate() -> None:
    vertices, faces = models.cube(8)
    whole, block = approximate(vertices, faces, Settings(**FAST)), approximate_blocks(vertices, faces, Settings(**FAST))
    for name in ("vertices", "error", "patch"):
        assert np.asarray(getattr(block, name)).tobytes() == getattr(whole, name).tobytes()
    assert block.report["surface_error"] == whole.report["surface_error"]
    triangles = np.arange(2 * len(faces))
    inside = np.tile(INSIDE, (len(triangles), 1))
    assert (block.representation.evaluate(triangles, inside) == whole.representation.evaluate(triangles, inside)).all()


def test_blocks_are_as_close_as_one_piece(terrain, cut) -> None:
    whole = approximate(*terrain, Settings(**FAST))
    for measure in ("vertex_error", "surface_error"):
        assert cut.report[measure]["rms"] < 1.1 * whole.report[measure]["rms"]
    assert cut.report["input"]["blocks"] == 4
    assert cut.report["input"]["components"] == 1
    assert cut.report["passed_through_vertices"] == 0
    before, after = (face_normals(mesh.astype(np.float64), terrain[1]) for mesh in (terrain[0], cut.vertices))
    angles = np.degrees(np.arccos(np.clip((before * after).sum(axis=1), -1.0, 1.0)))
    assert cut.report["normal_error_degrees"] == pytest.approx(angles.mean(), rel=1e-3)
    assert cut.report["faces_turned"] == (angles > 90.0).sum()


def test_the_report_tells_the_errors_that_evaluation_finds(terrain, cut) -> None:
    vertices, faces = terrain[0].astype(np.float64), terrain[1]
    inside = np.random.default_rng(0).dirichlet(np.ones(3), (20, len(faces)))
    errors = np.concatenate(
        [
            np.linalg.norm(
                cut.representation.evaluate(np.arange(len(faces)), b) - np.einsum("nk,nkd->nd", b, vertices[faces]),
                axis=1,
            )
            for b in inside
        ]
    )
    said = cut.report["surface_error"]
    assert said["rms"] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.02)
    assert said["p95"] == pytest.approx(np.percentile(errors, 95), rel=0.05)
    assert errors.max() <= said["bound"]
    away = np.linalg.norm(cut.vertices.astype(np.float64) - vertices, axis=1)
    assert cut.report["vertex_error"]["max"] == pytest.approx(away.max())
    assert np.allclose(cut.error, away)


def test_the_surface_passes_through_the_vertices_and_has_no_gaps(terrain, cut) -> None:
    faces = terrain[1]
    for corner in np.eye(3):
        points = cut.representation.evaluate(np.arange(len(faces)), np.tile(corner, (len(faces), 1)))
        assert np.abs(points - cut.vertices[faces @ corner.astype(int)]).max() < 1e-5
    # the same edge seen from both of its triangles
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    _, edge, count = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    both = np.array([pair for pair in np.split(order, np.cumsum(count)[:-1]) if len(pair) == 2])
    seen = []
    for side in both.T:
        triangle, corner = np.divmod(side, 3)
        rows, forwards = np.arange(len(side)), sides[side, 0] < sides[side, 1]
        inside = np.zeros((len(side), 3))
        inside[rows, corner] = np.where(forwards, 0.3, 0.7)
        inside[rows, (corner + 1) % 3] = np.where(forwards, 0.7, 0.3)
        seen.append(cut.representation.evaluate(triangle, inside))
    assert np.abs(seen[0] - seen[1]).max() < 1e-10


def test_workers_and_executors_do_not_change_a_byte(terrain, cut) -> None:
    assert same(cut, approximate_blocks(*terrain, Settings(**{**FAST, "workers": 2}), block_size=800))
    with ThreadPoolExecutor(3) as executor:
        assert same(cut, approximate_blocks(*terrain, Settings(**FAST), block_size=800, executor=executor))


def test_quads_and_loose_parts_work() -> None:
    vertices, faces = models.cube(10)
    beside = vertices + np.array([3.0, 0.0, 0.0])
    vertices = np.concatenate([vertices, beside, [[9.0, 9, 9], [9.0, 9, 8]]])
    faces = np.concatenate([faces, faces + len(vertices) // 2 - 1])
    found = approximate_blocks(vertices, faces, Settings(**FAST), block_size=500)
    assert found.report["input"]["triangles"] == 2 * len(faces)
    assert found.report["input"]["components"] == 4  # loose vertices count, as in `approximate`
    assert found.report["relative"]["surface_max"] < 0.02
    assert (found.vertices[-2:] == vertices[-2:]).all()
    points = found.representation.evaluate(np.arange(2 * len(faces)), np.tile([1.0, 0, 0], (2 * len(faces), 1)))
    assert np.abs(points[:, None] - found.vertices[None, :]).sum(axis=2).min(axis=1).max() < 1e-9


def test_copies_of_a_vertex_in_different_blocks_stay_together() -> None:
    vertices, faces = models.creased_terrain(900)
    soup = approximate_blocks(
        vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), Settings(**FAST), block_size=300
    )
    first = np.zeros(len(vertices), dtype=int)
    first[faces.ravel()] = np.arange(3 * len(faces))
    assert (soup.vertices == soup.vertices[first[faces.ravel()]]).all()
    assert soup.report["input"]["components"] == 1


def test_a_tolerance_is_kept(terrain) -> None:
    vertices, faces = terrain
    found = approximate_blocks(vertices, faces, Settings(**FAST, tolerance=0.2), block_size=800)
    assert found.report["tolerance"]["achieved"] <= 0.2
    assert found.error.max() <= 0.2
    errors = np.linalg.norm(
        found.representation.evaluate(*places(faces)) - np.einsum("k,nkd->nd", INSIDE, vertices[faces]), axis=1
    )
    assert errors.max() <= 0.2


def test_mapped_files_are_input_enough(terrain, cut, tmp_path) -> None:
    for name, array in zip(("vertices", "faces"), terrain, strict=True):
        np.save(tmp_path / f"{name}.npy", array)
    mapped = (np.load(tmp_path / f"{name}.npy", mmap_mode="r") for name in ("vertices", "faces"))
    assert same(cut, approximate_blocks(*mapped, Settings(**FAST), block_size=800))


def test_a_folder_holds_the_whole_result(terrain, tmp_path) -> None:
    found = approximate_blocks(*terrain, Settings(**FAST), block_size=800, folder=tmp_path / "job")
    found.representation.save(tmp_path / "copy")
    again = BlockSurface.load(tmp_path / "copy")
    assert (again.evaluate(*places(terrain[1])) == found.representation.evaluate(*places(terrain[1]))).all()
    assert (again.at_vertices() == found.vertices).all()
    with pytest.raises(InputError, match="is there already"):
        found.representation.save(tmp_path / "copy")
    with pytest.raises(FileFormatError, match="it holds no finished job"):
        BlockSurface.load(tmp_path)


def test_temporary_results_vanish_with_their_result(terrain) -> None:
    found = approximate_blocks(*terrain, Settings(**FAST), block_size=5000)
    folder = found.folder
    assert folder.is_dir()
    del found
    assert not folder.exists()


class Counting(Executor):
    """Runs tasks at once and counts them; gives up after some."""

    def __init__(self, most: int = 99) -> None:
        self.numbers: list[int] = []
        self.most = most

    def submit(self, function, /, task):
        future = Future()
        if len(self.numbers) == self.most:
            future.set_exception(ConnectionError("gone"))
        else:
            self.numbers.append(task.number)
            future.set_result(function(task))
        return future


def test_a_lost_engine_is_one_sentence_and_no_block_is_solved_twice(terrain, cut, tmp_path) -> None:
    lost, rest = Counting(2), Counting()
    call = {"block_size": 800, "folder": tmp_path / "job"}
    with pytest.raises(WorkerError, match=r"lost \(ConnectionError\).*same folder goes on"):
        approximate_blocks(*terrain, Settings(**FAST), executor=lost, **call)
    found = approximate_blocks(*terrain, Settings(**FAST), executor=rest, **call)
    assert sorted(lost.numbers + rest.numbers) == [0, 1, 2, 3]
    assert same(cut, found)


class Stuck(Executor):
    """Never answers the first task that it gets."""

    def __init__(self) -> None:
        self.numbers: list[int] = []

    def submit(self, function, /, task):
        future = Future()
        if self.numbers:
            future.set_result(function(task))
        self.numbers.append(task.number)
        return future


def test_a_block_that_is_stuck_is_sent_once_more(terrain, cut, monkeypatch) -> None:
    monkeypatch.setattr(engines, "SECONDS_BEFORE_A_COPY", 0.1)
    engine = Stuck()
    assert same(cut, approximate_blocks(*terrain, Settings(**FAST), executor=engine, block_size=800))
    assert engine.numbers == [0, 1, 2, 3, 0]


@pytest.mark.parametrize("workers", [1, 2])
def test_finishing_now_gives_the_whole_surface_and_the_next_call_what_is_missing(
    terrain, cut, tmp_path, workers
) -> None:
    settings = Settings(**{**FAST, "workers": workers})
    call = {"block_size": 800, "folder": tmp_path / "job"}

    def finish(step) -> str | None:
        return FINISH if step.stage == "Solving blocks" and step.detail.startswith("1 of 4") else None

    early = approximate_blocks(*terrain, settings, report=finish, **call)
    assert early.report["ended_early"]
    assert "bound" not in early.report["surface_error"]
    assert early.report["passed_through_vertices"] == 0
    # over initial domains, without sweeps: not as close, but a surface everywhere
    assert cut.report["surface_error"]["rms"] < early.report["surface_error"]["rms"]
    assert early.report["surface_error"]["rms"] < 3.0 * cut.report["surface_error"]["rms"]
    points = early.representation.evaluate(*places(terrain[1]))
    assert np.isfinite(points).all()
    blocks = tmp_path / "job" / "blocks"
    done = {path: path.stat().st_mtime_ns for path in blocks.iterdir() if "hurried" not in path.name}
    assert 1 <= len(done) < 4
    assert len(list(blocks.iterdir())) == 4
    again = approximate_blocks(*terrain, settings, **call)
    assert "ended_early" not in again.report
    assert same(cut, again)
    assert all(path.stat().st_mtime_ns == when for path, when in done.items())


def test_finishing_now_ends_a_mesh_of_one_block_as_in_one_piece(terrain) -> None:
    def finish(step) -> str:
        return FINISH

    block = approximate_blocks(*terrain, Settings(**FAST), report=finish)
    whole = approximate(*terrain, Settings(**FAST), report=finish)
    assert whole.report["ended_early"]
    assert block.report["ended_early"]
    assert block.vertices.tobytes() == whole.vertices.tobytes()


def test_another_job_is_refused_and_left_as_it_is(terrain, tmp_path) -> None:
    call = {"block_size": 800, "folder": tmp_path / "job"}
    steps = approximate_blocks_steps(*terrain, Settings(**FAST), **call)
    next(steps)
    next(steps)
    steps.close()
    before = {path: path.read_bytes() for path in (tmp_path / "job").rglob("*") if path.is_file()}
    vertices, faces = terrain
    with pytest.raises(InputError, match="a job with other settings"):
        approximate_blocks(vertices, faces, Settings(**{**FAST, "ring": 5}), **call)
    with pytest.raises(InputError, match="a job with other mesh"):
        approximate_blocks(vertices + 1, faces, Settings(**FAST), **call)
    assert before == {path: path.read_bytes() for path in (tmp_path / "job").rglob("*") if path.is_file()}
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    with pytest.raises(InputError, match="something else than a job"):
        approximate_blocks(vertices, faces, Settings(**FAST), block_size=800, folder=tmp_path / "other")


@pytest.mark.parametrize("change", [{"keep_iterations": True}])
def test_what_concerns_the_whole_is_refused(terrain, change) -> None:
    with pytest.raises(SettingsError):
        approximate_blocks(*terrain, Settings(**FAST, **change), block_size=800)


CALLER = """
import sys
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate_blocks
vertices, faces = models.creased_terrain(3000)
approximate_blocks(vertices.astype("f4"), faces, Settings(**{settings}), block_size=800, folder=sys.argv[1])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_killed_caller_goes_on_where_it_was(cut, tmp_path) -> None:
    job = tmp_path / "job"
    words = [sys.executable, "-c", CALLER.replace("{settings}", repr({**FAST, "workers": 2})), str(job)]
    process = subprocess.Popen(words)
    while process.poll() is None and not list(Path(job / "blocks").glob("*.npz")):
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = {path: path.stat().st_mtime_ns for path in (job / "blocks").glob("*.npz")}
    assert 1 <= len(done) < 4
    subprocess.run(words, check=True)
    assert all(path.stat().st_mtime_ns == when for path, when in done.items())
    vertices, faces = models.creased_terrain(3000)
    again = approximate_blocks(vertices.astype("f4"), faces, Settings(**FAST), block_size=800, folder=job)
    assert same(cut, again)
