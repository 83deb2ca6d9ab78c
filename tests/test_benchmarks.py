"""The benchmark measures what it says; how fast anything is, it does not test."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from sparse_surface.benchmarks import accuracy, alignment, denoising, distances, evaluation, file_sizes, published_noise
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.benchmarks.bilateral import filtered
from sparse_surface.benchmarks.cases import STAGES, Case, Measured, measure
from sparse_surface.benchmarks.measured import growth_exponent
from sparse_surface.benchmarks.natural_alternative import compare
from sparse_surface.benchmarks.tables import Table
from sparse_surface.solver import Settings

QUICK = {"workers": 1, "ring": 4, "degree": 6, "sparsity": 6, "iterations": 2, "sweeps": 0}


def run_of(vertices: int, seconds: float) -> Measured:
    report = {"input": {"vertices": vertices}, "seconds": {"total": seconds}}
    return Measured("model", report, unit=0.5, base_memory_mb=0.0)


@pytest.mark.parametrize("exponent", [0.9, 1.0, 1.5])
def test_the_growth_exponent_of_a_power_is_its_own(exponent: float) -> None:
    sizes = [1_500.0, 20_000.0, 1_000_000.0]
    assert math.isclose(growth_exponent(sizes, [3.0 * n**exponent for n in sizes]), exponent, rel_tol=1e-9)


def test_times_are_divided_by_the_unit() -> None:
    assert run_of(10, 3.0).units("total") == 6.0


def test_a_case_is_measured_in_a_process_of_its_own() -> None:
    plain = measure(Case("cube", QUICK))
    assert plain.report["input"]["vertices"] == 1538
    assert plain.unit > 0.0
    assert plain.set_up > 0.0
    assert plain.memory_mb >= 0.0
    assert plain.as_dict()["units"].keys() == set(STAGES)
    # Without annealing two iterations end elsewhere, and the next case does not see the changed constant.
    held = measure(Case("cube", QUICK, constants={"fitting.methods.variable_projection.PROXIMITY_DECAY": 1.0}))
    assert held.report["energy"] != plain.report["energy"]
    assert measure(Case("cube", QUICK)).report["energy"] == plain.report["energy"]


def test_an_unknown_constant_is_an_error() -> None:
    with pytest.raises(AttributeError, match="constant"):
        measure(Case("cube", QUICK, constants={"fitting.batch.NO_SUCH": 1.0}))


@pytest.mark.parametrize(("name", "settings", "constants"), accuracy.INGREDIENTS)
def test_what_the_ablation_changes_exists(name: str, settings: dict[str, Any], constants: dict[str, Any]) -> None:
    assert bool(settings) or bool(constants) or name == "the default"
    resolved = Settings(**settings).resolved()
    assert all(getattr(resolved, field) == value for field, value in settings.items())
    for constant in constants:
        module, _, attribute = constant.rpartition(".")
        assert hasattr(import_module(f"sparse_surface.solver.{module}"), attribute)


def test_both_solvers_fit_the_same_patches() -> None:
    found = compare(Case("cube", {"degree": 6, "sparsity": 6, "iterations": 4}), patches=2)
    assert found.patches == 2
    for rms in (found.vertex_rms, found.inside_rms, found.alternative_vertex_rms, found.alternative_inside_rms):
        assert 0.0 < rms < 0.1
    assert min(found.units, found.alternative_units) > 0.0


def test_the_bilateral_filter_is_a_fair_peer() -> None:
    """With some of its settings it takes most of a cube's noise off."""
    vertices, quads = models.cube(10)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    noisy = denoising.with_noise(vertices, triangles, 0.003, 1, isotropic=False)
    before = denoising.closeness(vertices, triangles, noisy)
    after = [denoising.closeness(vertices, triangles, each) for each in filtered(noisy, triangles)]
    assert min(each.rms for each in after) < 0.3 * before.rms
    assert min(each.degrees for each in after) < 0.1 * before.degrees


def test_noise_is_as_strong_as_it_says() -> None:
    vertices, triangles = models.sphere()
    diagonal = np.linalg.norm(np.ptp(vertices, axis=0))
    for isotropic in (False, True):
        moved = denoising.with_noise(vertices, triangles, 0.01, 3, isotropic) - vertices
        assert math.isclose(np.sqrt((moved**2).sum(axis=1).mean()), 0.01 * diagonal, rel_tol=0.05)
    assert denoising.closeness(vertices, triangles, vertices) == denoising.Closeness(0.0, 0.0)
    assert math.isclose(
        denoising.closeness(vertices, triangles, vertices + np.array([0.0, 0.2, 0.0])).rms, 0.1, rel_tol=0.01
    )


def test_a_noisy_case_is_measured_and_written() -> None:
    found = denoising.measure_noisy(denoising.NoisyCase(Case("sphere", QUICK, size=10), 0.005, seeds=(5,)))
    assert found.denoised.rms < 0.6 * found.noisy.rms
    assert found.worst == found.denoised  # of one seed
    assert found.fitted.rms < found.noisy.rms
    assert 0.8 < found.level < 1.2
    assert found.units > 0.0
    assert denoising.measure_clean(Case("sphere"))[0]
    tables = denoising.tables([found], {"sphere": (True, 1.0)})
    shown = f"{found.denoised.rms:.2e} / {found.denoised.degrees:.2f}"
    assert tables["denoising"].cell("sphere", "denoised") == shown
    assert "| sphere | unchanged |" in tables["denoising, clean"].markdown()


def test_peers_of_denoising_are_measured_where_they_are_installed(tmp_path) -> None:
    """And named where they are not; cases that are not there are left out."""
    vertices, triangles = models.sphere(10)
    noisy = denoising.with_noise(vertices, triangles, 0.005, 5, isotropic=False)
    there = {name for name, package in published_noise.PACKAGES.items() if find_spec(package) is not None}
    found = published_noise.measure(noisy, vertices, triangles)
    assert found.keys() == {"noisy", "denoised", "units", *there, *(f"{name}, best" for name in there)}
    before = denoising.closeness(vertices, triangles, noisy).degrees
    assert found["noisy"] == before
    assert all(found[kind] < 0.8 * before for kind in found if "best" in kind or kind == "denoised")
    said: list[str] = []
    assert published_noise.run(tmp_path, lambda path: (vertices, triangles), said.append) == ({}, {})
    missing = published_noise.PACKAGES.keys() - there
    assert len(said) == len(published_noise.CASES) + len(missing)
    assert all(any(name in sentence for sentence in said) for name in missing)


def test_a_representation_is_measured_and_written() -> None:
    found = evaluation.evaluate(Case("cube", QUICK, size=8), points=1000)
    assert found.change < 1e-6
    assert found.file_bytes > 5_000
    assert min(found.point_units, found.normal_units) > 0.0
    tables = evaluation.tables([found])
    assert "| cube | smooth, rims |" in tables["bends"].markdown()
    assert tables["representation"].cell("cube", "patches") == str(found.patches)


def test_files_are_measured() -> None:
    found = file_sizes.measure_files(Case("cube", QUICK, size=8), points=1000)
    assert found.exact > 2 * found.compact > 2_000
    assert found.exact > 2 * found.any_order > 2_000
    assert 0.0 < found.moved < 1e-5
    assert min(found.exact_load, found.compact_load) > 0.0
    row = file_sizes.table([found])
    assert row.cell("cube", "compact, kB") == f"{found.compact / 1000:.1f}"


def test_tables_are_markdown() -> None:
    assert Table.of(["a", "b"], [["x", 1234], ["y", 0.001]]).markdown().splitlines() == [
        "| a | b |",
        "| --- | ---: |",
        "| x | 1,234 |",
        "| y | 1.00e-03 |",
    ]


@pytest.mark.parametrize("words", [["sparse_surface.benchmarks"], ["sparse_surface", "benchmark"]], ids=str)
def test_the_benchmark_runs_as_a_command(tmp_path: Path, words: list[str]) -> None:
    file = tmp_path / "figures.json"
    command = [sys.executable, "-m", *words, "--models", "tetrahedron", "--only", "stages", "--json", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "| tetrahedron | 4 |" in done.stdout
    runs = json.loads(file.read_text())["stages"]
    assert [run["report"]["input"]["vertices"] for run in runs] == [4, 4]


def test_what_cannot_be_measured_is_refused(tmp_path: Path) -> None:
    for words, said in (
        (["--models", "unicorn"], "There is no model 'unicorn'"),
        (["--json", str(tmp_path / "no" / "file.json")], "there is no folder"),
        (["--models", "cube", "--keep"], "tables of some models are not kept"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "sparse_surface", "benchmark", *words], capture_output=True, text=True, timeout=60
        )
        assert done.returncode in (1, 2)
        assert said in done.stderr
        assert "Traceback" not in done.stderr


class MeshLabByHand:
    """Stands in for the package pymeshlab: distances from places of a fine lattice, to places of another."""

    class Mesh:
        def __init__(self, vertices, triangles) -> None:
            self.corners = vertices[triangles]

    class PercentageValue:
        def __init__(self, value: float) -> None:
            assert 0.0 <= value <= 100.0

    class MeshSet:
        def __init__(self) -> None:
            self.meshes: list[Any] = []

        def add_mesh(self, mesh) -> None:
            self.meshes.append(mesh)

        def get_hausdorff_distance(self, sampledmesh: int, targetmesh: int, **_) -> dict[str, float]:
            steps = np.array([(a, b, 6 - a - b) for a in range(7) for b in range(7 - a)]) / 6.0
            one, other = ((steps @ self.meshes[k].corners).reshape(-1, 3) for k in (sampledmesh, targetmesh))
            found = cKDTree(other).query(one)[0]
            return {"max": float(found.max()), "RMS": float(np.sqrt((found**2).mean()))}


def test_distances_stand_beside_those_of_another_program(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pymeshlab", MeshLabByHand)
    tables, values = distances.run([Case("lens", size=12)], lambda _: None)
    assert [(each["change"], each["direction"]) for each in values] == [
        (change, direction) for change in ("noise", "approximated", "turned") for direction in ("there", "back")
    ]
    lattice = 0.05  # the lattice's own width, in scene units
    for each in values:
        assert abs(each["lab_max"] - each["max"]) < lattice
        assert each["max"] <= each["bound"]
        assert each["rms"] <= each["lab_rms"] + 1e-3 < each["rms"] + lattice
    assert tables["distances"].column("direction") == ["there", "back"] * 3


def test_motions_that_know_everything_are_the_best_there_are() -> None:
    """Without noise they undo a motion; with it, their squared error is that of the bound of Cramer and Rao."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(200, 3))
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    turn = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix()
    away = points @ turn.T + [0.01, 0.02, -0.03]
    for matrix in (alignment.knowing_pairs(away, points), alignment.knowing_planes(away, points, normals)):
        assert away @ matrix[:3, :3].T + matrix[:3, 3] == pytest.approx(points, abs=1e-12)
    noise = 1e-3
    shifts = [[], []]
    for _ in range(300):
        noisy = points + noise * rng.normal(size=points.shape)
        shifts[0].append(alignment.knowing_pairs(noisy, points)[:3, 3])
        shifts[1].append(alignment.knowing_planes(noisy, points, normals)[:3, 3])
    rows = [
        np.concatenate([np.concatenate([np.cross(points, each), each], axis=1) for each in directions])
        for directions in (np.tile(np.eye(3)[:, None], (1, len(points), 1)), normals[None])
    ]
    for found, system in zip(shifts, rows, strict=True):
        bound = noise**2 * np.linalg.inv(system.T @ system)[3:, 3:]
        assert np.var(found, axis=0) == pytest.approx(np.diag(bound), rel=0.3)


def test_alignment_stands_beside_what_is_possible() -> None:
    tables, values = alignment.run([Case("l_solid")], lambda _: None, {"copy": 2, "scan": 1})
    assert [each["kind"] for each in values] == ["copy", "scan"] == tables["alignment"].column("kind")
    for each in values:
        assert each["failed"] == 0
        assert each["median"] < 2.0 * each["least_median"] < 0.01


def test_without_the_other_program_there_is_nothing_to_compare(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    said: list[str] = []
    assert distances.run([Case("lens", size=12)], said.append) == ({}, None)
    assert "pymeshlab" in said[0]
