"""Clouds read in parts: what thinning leaves, and the surface measured against every point."""

from __future__ import annotations

import tracemalloc
from collections import defaultdict
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from sparse_surface.solver import CloudSettings, Reconstruction, Settings, reconstruct_parts, run_to_end
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.reconstruction.batches import as_parts, batches
from sparse_surface.solver.reconstruction.thinning import ThinCloud, thin_steps

FEW = Settings(iterations=2, sweeps=1, workers=1)
NOISE = 0.01

CUBE = (
    np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 3**0.5,
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]],
)


class Cut:
    """A cloud in parts of one size."""

    def __init__(self, points: np.ndarray, size: int) -> None:
        self.points, self.size, self.readings = points, size, 0

    def __iter__(self) -> Iterator[np.ndarray]:
        self.readings += 1
        return (self.points[k : k + self.size] for k in range(0, len(self.points), self.size))


def sphere(count: int, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    return points * ((1.0 + noise * rng.normal(size=count)) / np.linalg.norm(points, axis=1))[:, None]


def thin(points: object, most: int, **options: bool) -> ThinCloud:
    return run_to_end(thin_steps(as_parts(points), most, **options))


# ------------------------------------------------------------------------------------------------------------ batches


@pytest.mark.parametrize("size", [1, 3, 10, 64, 1000])
def test_batches_do_not_depend_on_the_parts(size: int) -> None:
    points = sphere(101)
    found = [batch.points for batch in batches(Cut(points, size), 32)]
    assert [len(part) for part in found] == [32, 32, 32, 5]
    np.testing.assert_array_equal(np.concatenate(found), points)


def test_a_column_that_a_part_lacks_is_missing_from_its_batch_only() -> None:
    points = sphere(8)
    full = SimpleNamespace(points=points, colours=points + 1.0, normals=points)
    found = list(batches([full, SimpleNamespace(points=points, colours=None, normals=points)], 8))
    np.testing.assert_array_equal(found[0].colours, points + 1.0)
    assert found[1].colours is None
    np.testing.assert_array_equal(found[1].normals, points)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (iter([np.zeros((4, 3))]), "read several times: give something that can be"),
        (np.zeros((4, 2)), r"three numbers each, not of shape \(4, 2\)"),
        ([[0.0, 1.0], [2.0, 3.0]], r"three numbers each, not of shape \(2, 2\)"),
        ([np.zeros((4, 3)), np.zeros((4, 5))], r"three numbers each, not of shape \(4, 5\)"),
        (Cut(np.full((9, 3), np.nan), 4), "at least 4 points; of 9 only 0 can be used"),
        (Cut(np.ones((9, 3)), 4), "All the points are at one place"),
    ],
)
def test_what_is_no_cloud_is_refused(points: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        thin(points, 100)


# ----------------------------------------------------------------------------------------------------------- thinning


def grouped(points: NDArray[np.float64], found: ThinCloud) -> dict[tuple[int, ...], list[int]]:
    """Rows of each cell, those of thin cells with those of their fullest neighbours."""
    rows = defaultdict(list)
    for row, cell in enumerate(np.floor((points - found.grid.corner) / found.grid.cell).astype(int)):
        rows[tuple(cell.tolist())].append(row)
    owner = {}
    for cell in rows:
        around = [tuple(np.add(cell, step).tolist()) for step in product((-1, 0, 1), repeat=3)]
        fullest = max((near for near in around if near in rows), key=lambda near: len(rows[near]))
        owner[cell] = fullest if len(rows[cell]) < len(rows[fullest]) / 4 else cell
    groups = defaultdict(list)
    for cell, own in rows.items():
        while owner[cell] != cell:
            cell = owner[cell]
        groups[cell] += own
    return dict(sorted(groups.items()))


@pytest.mark.parametrize("most", [60, 500, 4000])
def test_points_that_are_left_are_the_means_of_cells(most: int) -> None:
    points, found = sphere(6000, 0.05), thin(sphere(6000, 0.05), most)
    groups = list(grouped(points, found).values())
    np.testing.assert_allclose(found.points, [points[rows].mean(axis=0) for rows in groups], rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(found.counts, [len(rows) for rows in groups])
    number = np.empty(len(points), int)
    for group, rows in enumerate(groups):
        number[rows] = group
    np.testing.assert_array_equal(found.find(points), number)
    assert most // 3 <= len(found.points) <= most


def test_more_points_of_a_noisy_cloud_leave_less_noise() -> None:
    rng = np.random.default_rng(5)
    noise = []
    for count in (2_000, 64_000):
        xy = rng.uniform(-1.0, 1.0, (count, 2))
        kept = thin(np.column_stack([xy, xy @ [0.13, 0.21] + 0.02 * rng.normal(size=count)]), 400).points
        noise.append(kept[:, 2] - kept[:, :2] @ [0.13, 0.21])
    few, many = (float(np.sqrt((away**2).mean())) for away in noise)
    assert many < 0.8 * few < 0.01
    assert np.abs(noise[1]).max() < np.abs(noise[0]).max()


def test_the_next_finer_grid_would_leave_too_many() -> None:
    points, most = sphere(6000), 500
    found = thin(points, most)
    cells = np.floor((points - found.grid.corner) / (0.5 * found.grid.cell))
    assert len(np.unique(cells, axis=0)) > most


def test_neither_parts_nor_order_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sparse_surface.solver.reconstruction.batches.batches.__defaults__", (256,))
    points = sphere(5000, 0.02)
    first = thin(points, 700)
    for size in (1, 255, 256, 257, 9999):
        again = thin(Cut(points, size), 700)
        assert (again.points.tobytes(), again.counts.tobytes()) == (first.points.tobytes(), first.counts.tobytes())
    order = np.random.default_rng(3).permutation(len(points))
    shuffled = thin(points[order], 700)
    np.testing.assert_array_equal(shuffled.counts, first.counts)
    np.testing.assert_allclose(shuffled.points, first.points, rtol=0.0, atol=1e-14)


def test_what_points_have_is_averaged_with_them() -> None:
    points = sphere(3000)
    colours = 100.0 * points + 120.0
    parts = [SimpleNamespace(points=points[k::3], colours=colours[k::3], normals=-points[k::3]) for k in range(3)]
    found = thin(parts, 200)
    np.testing.assert_allclose(found.colours, 100.0 * found.points + 120.0, atol=1e-9)
    np.testing.assert_allclose(found.normals, -found.points, atol=1e-12)


def test_a_far_outlier_and_a_far_origin_cost_nothing() -> None:
    away = np.array([5e5, 5.6e6, 300.0])
    points = np.concatenate([100.0 * sphere(4000) + away, [[0.0, 0.0, 0.0]]])
    found = thin(points, 1000)
    assert len(found.points) > 400
    near = thin(points[:-1], 1000, shift=True)
    np.testing.assert_allclose(near.origin, away, atol=5.0)
    assert np.abs(near.points).max() < 110.0
    assert np.abs(np.linalg.norm(near.points + near.origin - away, axis=1) - 100.0).max() < near.grid.cell


def test_rows_that_are_not_finite_are_counted() -> None:
    points = sphere(1000)
    points[::10, 1] = np.nan
    found = thin(Cut(points, 77), 200)
    assert (found.extent.rows, found.extent.finite, int(found.counts.sum())) == (1000, 900, 900)


def test_a_cloud_that_changes_is_refused() -> None:
    class Growing(Cut):
        def __iter__(self) -> Iterator[np.ndarray]:
            self.points = np.concatenate([self.points, self.points[:1]])
            return super().__iter__()

    with pytest.raises(InputError, match="The points changed while they were read"):
        thin(Growing(sphere(500), 100), 50)


def test_memory_does_not_grow_with_the_cloud() -> None:
    """Sixteen times the points, made while they are asked for, take as much memory as once."""

    class Made:
        def __init__(self, parts: int) -> None:
            self.parts = parts

        def __iter__(self) -> Iterator[np.ndarray]:
            return (sphere(1 << 16, seed=k) for k in range(self.parts))

    peaks = []
    for parts in (4, 64):
        tracemalloc.start()
        found = thin(Made(parts), 20_000)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert int(found.counts.sum()) == parts << 16
    assert peaks[1] < 1.3 * peaks[0]
    assert peaks[1] < 24 * (64 << 16), "less than the positions alone"


# ----------------------------------------------------------------------------------------------------------- surfaces


@pytest.fixture(scope="module")
def noisy() -> np.ndarray:
    return sphere(20_000, NOISE)


def test_the_surface_is_as_close_to_the_truth_as_that_of_all_points(noisy: np.ndarray) -> None:
    """The true sphere is what nothing was fitted to: each mean has less noise than its points."""
    result = reconstruct_parts(Cut(noisy, 3000), settings=FEW, most_points=2000)
    assert 1000 < len(result.points) <= 2000
    count = len(result.representation.triangles)
    inside = np.tile(0.4 * np.eye(3) + 0.2, (count, 1))
    surface = result.representation.evaluate(np.repeat(np.arange(count), 3), inside)
    off = np.abs(np.linalg.norm(surface, axis=1) - 1.0)
    assert np.sqrt(np.mean(off**2)) < 0.3 * NOISE
    given = result.report["input"]
    assert given["points"] == len(noisy)
    left_out = given["merged"] + given["duplicates"] + given["strays"] + given["not_finite"]
    assert given["used"] + left_out == len(noisy)
    assert isinstance(result, Reconstruction)


def test_all_points_are_measured(noisy: np.ndarray) -> None:
    """The report against distances from a dense sample of the surface, which knows nothing of cells."""
    result = reconstruct_parts(noisy, settings=FEW, most_points=2000)
    steps = np.linspace(0.0, 1.0, 150)
    grid = np.array([(1.0 - a - b, a, b) for a in steps for b in steps if a + b <= 1.0])
    count = len(result.representation.triangles)
    places = result.representation.evaluate(np.repeat(np.arange(count), len(grid)), np.tile(grid, (count, 1)))
    away = cKDTree(places).query(noisy)[0]
    measured = result.report["points_to_surface"]
    assert result.report["input"]["strays"] == 0
    assert measured["rms"] == pytest.approx(np.sqrt(np.mean(away**2)), rel=0.02)
    assert measured["max"] == pytest.approx(away.max(), rel=0.02)
    # the sample is 0.003 wide: too coarse for points nearer than that
    assert result.report["surface_error"]["mean"] == pytest.approx(away.mean(), rel=0.05)
    assert measured["rms"] > 1.1 * result.report["vertex_error"]["rms"], "the means lie closer to it than the points"
    whole = (result.error * result.counts).sum() / len(noisy)
    assert whole == pytest.approx(result.report["surface_error"]["mean"], rel=1e-9)


def test_the_same_surface_for_any_parts_workers_and_files(tmp_path: Path, noisy: np.ndarray) -> None:
    np.save(tmp_path / "points.npy", noisy)
    mapped = np.load(tmp_path / "points.npy", mmap_mode="r")
    kept = None
    for points, workers in ((noisy, 1), (Cut(noisy, 999), 3), (mapped, 2), (noisy.tolist(), 1)):
        settings = Settings(iterations=2, sweeps=1, workers=workers)
        result = reconstruct_parts(points, *CUBE, settings, most_points=900)
        found = result.vertices.tobytes(), result.error.tobytes(), result.report["points_to_surface"]
        kept = kept or found
        assert found == kept


def test_a_base_may_be_given_and_strays_are_counted_by_rows() -> None:
    points = np.concatenate([sphere(8000), sphere(2, seed=8).repeat(3, axis=0) * 3.0])
    result = reconstruct_parts(points, *CUBE, FEW, CloudSettings(), most_points=1500)
    assert len(result.vertices) == 8
    assert result.report["input"]["strays"] == 6
    assert result.report["points_to_surface"]["max"] < 0.3
    assert result.error[~result.used].min() > 1.5
