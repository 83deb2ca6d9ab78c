"""Whole surfaces of the compiled kernel against those of NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_clouds as clouds
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate, reconstruct
from sparse_surface.solver.native import library

pytestmark = pytest.mark.skipif(library.reason_against() is not None, reason=str(library.reason_against()))

NO_ERROR = 1e-7
"""Errors below this share of a model's size are rounding."""

VARIANTS: dict[str, dict[str, Any]] = {
    "separate domains": {"domains": "separate", "iterations": 6},
    "small patches": {"ring": 2},
    "high degree": {"degree": 18, "sparsity": 24, "iterations": 6},
    "fast": {"iterations": 6, "sweeps": 0},
    "three sweeps": {"sweeps": 3},
    "uniform weights, monomials": {"blending": "uniform", "basis": "monomial"},
    # From then on each patch ends by itself here; in NumPy's batches a settled one goes on while most others do, which
    # shows where observations hardly outnumber coefficients.
    "vertices alone": {"blending": "uniform", "observations": "vertices", "iterations": 8},
}


def assert_alike(one: dict[str, Any], other: dict[str, Any]) -> None:
    size = one["input"]["bounding_box_longest_side"]
    assert "numpy_reason" not in one
    assert "numpy_reason" in other
    assert one["patches"] == other["patches"]
    assert one["flipped_triangles"] == other["flipped_triangles"]
    for kind in ("vertex_error", "surface_error"):
        assert one[kind]["rms"] == pytest.approx(other[kind]["rms"], rel=5e-3, abs=NO_ERROR * size), kind


def compare(model: models.Model, **settings: Any) -> None:
    reports = [approximate(*model, Settings(**settings, solver=solver)).report for solver in ("native", "numpy")]
    assert_alike(*reports)


@pytest.mark.parametrize("name", ["cube", "cylinder", "lens", "l_solid", "sphere", "moebius"])
def test_models(name: str) -> None:
    compare(models.MODELS[name]() if name in models.MODELS else getattr(models, name)())


@pytest.mark.long
@pytest.mark.parametrize("name", models.MODELS)
def test_all_models(name: str) -> None:
    compare(models.MODELS[name]())


@pytest.mark.parametrize("name", VARIANTS)
def test_settings(name: str) -> None:
    compare(models.lens(16), **VARIANTS[name])


def test_weights_and_pinned_borders() -> None:
    vertices, faces = models.moebius()
    weights = 0.2 + 0.8 * (vertices[:, 0] > 0.0)
    reports = [
        approximate(vertices, faces, Settings(pin_boundary=True, solver=solver), weights=weights).report
        for solver in ("native", "numpy")
    ]
    assert_alike(*reports)


def test_a_tolerance_is_met_by_either() -> None:
    for solver in ("native", "numpy"):
        report = approximate(*models.cube(10), Settings(tolerance=2e-3, solver=solver)).report
        assert report["tolerance"]["achieved"] <= 2e-3


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_clouds(noise: float) -> None:
    cloud = clouds.ball(noise=noise)
    native, numpy = (
        reconstruct(cloud.points, cloud.base_vertices, cloud.base_faces, Settings(solver=solver)).report
        for solver in ("native", "numpy")
    )
    assert native["surface_error"]["rms"] == pytest.approx(numpy["surface_error"]["rms"], rel=2e-2)
    assert native["patches"] == numpy["patches"]


def test_iterations_are_kept() -> None:
    kept = [approximate(*models.cube(8), Settings(keep_iterations=True, solver=s)).history for s in ("native", "numpy")]
    assert kept[0] is not None
    assert kept[1] is not None
    assert kept[0].shape == kept[1].shape
    assert abs(kept[0] - kept[1]).max() < 5e-3


@pytest.mark.parametrize("domains", ["common", "separate"])
@pytest.mark.parametrize("name", ["cube", "flower", "sphere"])
def test_instruction_sets_differ_less_than_the_error(
    monkeypatch: pytest.MonkeyPatch, name: str, domains: str, instructions: str
) -> None:
    """What another type of processor computes; docs/reliability.md tells by how much it may differ."""
    vertices, faces = getattr(models, name)()
    settings = Settings(domains=domains, workers=1)
    own = approximate(vertices, faces, settings)
    monkeypatch.setattr(library, "INSTRUCTION_SETS", (instructions,) * 3)
    other = approximate(vertices, faces, settings)
    size = float(np.ptp(vertices, axis=0).max())
    assert np.linalg.norm(own.vertices - other.vertices, axis=1).max() <= 2e-4 * size
    for measure in ("rms", "max"):
        expected = pytest.approx(own.report["surface_error"][measure], rel=5e-3, abs=1e-12 * size)
        assert other.report["surface_error"][measure] == expected
