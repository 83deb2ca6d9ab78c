"""The report: its keys for meshes, clouds and denoised meshes, and what its figures are measured against."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from noisy import with_noise
from sparse_surface.benchmarks.generated_clouds import ball
from sparse_surface.benchmarks.generated_models import cube
from sparse_surface.solver import FINISH, Report, Settings, approximate, reconstruct

QUICK = {"workers": 1, "iterations": 1, "sweeps": 0, "ring": 4, "degree": 6, "sparsity": 8}
COUNTS = {"input", "patches", "flipped_triangles", "passed_through_vertices", "workers"}
COPIES = {"vertices_reproduced", "faces_turned"}
CLOUD = {"cloud", "points_to_surface", "surface_to_points", "pieces", "euler"}
ERRORS = {"vertex_error", "surface_error", "relative", "seam_max", "normal_error_degrees", "energy", "iterations"}
ALWAYS = {"creases", "version", "method", "settings", "seconds", "peak_memory_mb", *COUNTS, *COPIES, *ERRORS}


def noisy_cube():
    vertices, faces = cube(6)
    return with_noise(vertices, faces, 3e-3, 21), faces


@pytest.fixture(scope="module")
def denoised():
    return approximate(*noisy_cube(), Settings(**QUICK, denoise="first", tolerance=0.01))


def test_a_report_has_only_what_applies(denoised) -> None:
    mesh = approximate(*cube(6), Settings(**QUICK))
    made = ball(300)
    cloud = reconstruct(made.points, made.base_vertices, made.base_faces, Settings(**QUICK))
    assert set(mesh.report) == ALWAYS
    assert set(cloud.report) == {*ALWAYS, *CLOUD} - {"creases"}
    assert set(denoised.report) == {*ALWAYS, "tolerance", "denoise"}
    for result in (mesh, cloud, denoised):
        assert isinstance(result.measures, Report)
        assert result.report is result.report, "made once"
        assert json.loads(json.dumps(result.report)) == result.report
        assert result.measures.vertex_error == result.report["vertex_error"]


def test_a_report_cannot_be_changed(denoised) -> None:
    with pytest.raises(FrozenInstanceError):
        denoised.measures.patches = 0


def test_the_tolerance_is_that_of_the_fit_and_errors_are_those_from_the_input(denoised) -> None:
    fit, achieved = denoised.report["denoise"]["fit"], denoised.report["tolerance"]["achieved"]
    assert max(fit["vertex_error"]["max"], fit["surface_error"]["max"]) <= achieved <= 0.01
    assert set(fit) == {"vertex_error", "surface_error", "normal_error_degrees"}
    error = np.linalg.norm(denoised.vertices - noisy_cube()[0], axis=1)
    assert denoised.report["vertex_error"]["max"] == pytest.approx(error.max())


def test_seconds_are_those_of_the_stages_that_ran(denoised) -> None:
    seconds = dict(denoised.report["seconds"])
    total = seconds.pop("total")
    assert set(seconds) == {"cover", "domains", "solve", "sweeps", "refine", "blend", "measure", "denoise", "creases"}
    assert seconds.pop("sweeps") == 0.0
    assert min(seconds.values()) > 0.0
    assert sum(seconds.values()) <= total


def test_a_run_that_was_ended_early_says_so() -> None:
    def ended(stage: str) -> bool | None:
        asked = []

        def finish(step) -> str | None:
            asked.append(step.stage)
            return FINISH if step.stage == stage else None

        report = approximate(*cube(6), Settings(**{**QUICK, "sweeps": 1}), report=finish).report
        assert stage in asked
        return report.get("ended_early")

    assert ended("Solving patches") is True
    assert ended("Measuring") is None
    made = ball(300)
    cloud = reconstruct(made.points, made.base_vertices, made.base_faces, Settings(**QUICK), report=lambda step: FINISH)
    assert cloud.report["ended_early"] is True


def test_a_run_that_is_ended_early_neither_searches_nor_bounds_any_further() -> None:
    """Whatever its stage: what is left takes as long as fitting each patch once over its initial domain."""
    vertices, faces = cube(8)
    whole = approximate(vertices, faces, Settings(**{**QUICK, "sweeps": 1}))
    assert "bound" in whole.report["surface_error"]
    for number in range(3):
        asked: list[str] = []

        def finish(step, number=number, asked=asked) -> str | None:
            asked.append(step.stage)
            return FINISH if len(asked) == number + 1 else None

        settings = Settings(**{**QUICK, "sweeps": 1, "tolerance": 1e-3})
        report = approximate(vertices, faces, settings, report=finish).report
        assert "Blending patches" not in asked, asked
        assert "Keeping the tolerance" not in asked, asked
        assert report["ended_early"] is True
        assert report["surface_error"].keys() == {"rms", "mean", "p95", "max"}
        assert "tolerance" not in report
        assert report["seconds"]["sweeps"] == report["seconds"]["refine"] == 0.0
