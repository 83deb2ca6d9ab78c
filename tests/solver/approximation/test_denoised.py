"""Denoising as a part of `approximate`: the preset, what is fitted, what is reported against what."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from noisy import distance_from_clean, face_normals, with_noise
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import FINISH, PRESETS, Progress, Representation, Settings, approximate, denoise
from sparse_surface.solver.approximation.approximate import approximate_steps

ONLY = Settings(workers=1, **PRESETS["denoise"])
FIRST = Settings(workers=1, denoise="first", ring=4, degree=8, sparsity=8, iterations=3, sweeps=0)


@pytest.fixture(scope="module")
def cube():
    vertices, faces = models.cube()
    return vertices, faces, with_noise(vertices, faces, 3e-3, 21).astype(np.float32)


@pytest.fixture(scope="module")
def denoised(cube):
    return approximate(cube[2], cube[1], ONLY)


@pytest.fixture(scope="module")
def fitted(cube):
    return approximate(cube[2], cube[1], FIRST)


def test_the_preset_takes_the_noise_off(cube, denoised) -> None:
    clean, faces, noisy = cube
    expected = denoise(noisy, faces)
    assert denoised.vertices.dtype == np.float32
    np.testing.assert_array_equal(denoised.vertices, expected.vertices)
    rms, degrees = distance_from_clean(clean, faces, denoised.vertices.astype(float))
    assert rms <= 1.1e-3
    assert degrees <= 0.5


def test_steps_show_vertices_going_the_share_of_their_way_that_their_weights_give(cube) -> None:
    _, faces, noisy = cube
    weights = np.linspace(0.0, 1.0, len(noisy))
    shown: list[list[np.ndarray]] = []
    for given in (None, weights):
        shown.append([])
        approximate(
            *(noisy, faces, ONLY),
            weights=given,
            report=lambda step: shown[-1].extend([step.vertices] if "patches" in step.stage and step.surface else []),
        )
    assert len(shown[0]) == len(shown[1]) > 3
    for whole, held in zip(*shown, strict=True):
        np.testing.assert_allclose(held, noisy + weights[:, None] * (whole - noisy), atol=1e-12)
        assert np.abs(whole - noisy).max() > 0


def test_the_representation_is_the_denoised_mesh(denoised, tmp_path) -> None:
    surface = denoised.representation
    assert surface.patches == denoised.report["patches"] == 0
    np.testing.assert_array_equal(surface.at_vertices().astype(np.float32), denoised.vertices)
    rng = np.random.default_rng(1)
    face, inside = rng.integers(0, len(surface.triangles), 200), rng.dirichlet([1.0, 1.0, 1.0], 200)
    flat = np.einsum("nk,nkd->nd", inside, denoised.vertices[surface.triangles[face]].astype(float))
    np.testing.assert_allclose(surface.evaluate(face, inside), flat, atol=1e-12)
    surface.save(tmp_path / "denoised.npz")
    loaded = Representation.load(tmp_path / "denoised.npz")
    np.testing.assert_array_equal(loaded.evaluate(face, inside), surface.evaluate(face, inside))
    assert (denoised.patch == -1).all()


@pytest.mark.parametrize("kind", ["denoised", "fitted"])
def test_errors_are_measured_against_the_input(kind, cube, request) -> None:
    _, _, noisy = cube
    result = request.getfixturevalue(kind)
    noisy = noisy.astype(float)
    error = np.linalg.norm(result.vertices.astype(float) - noisy, axis=1)
    np.testing.assert_allclose(result.error, error, atol=1e-12)
    report, size = result.report, np.ptp(noisy, axis=0).max()
    assert report["input"]["bounding_box_longest_side"] == pytest.approx(size)
    assert report["vertex_error"]["rms"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert report["vertex_error"]["max"] == pytest.approx(error.max())
    surface = result.representation
    rng = np.random.default_rng(2)
    face, inside = rng.integers(0, len(surface.triangles), 20_000), rng.dirichlet([1.0, 1.0, 1.0], 20_000)
    flat = np.einsum("nk,nkd->nd", inside, noisy[surface.triangles[face]])
    distance = np.linalg.norm(surface.evaluate(face, inside) - flat, axis=1)
    # Other points of the same triangles; they count each triangle once, large or small.
    assert report["surface_error"]["rms"] == pytest.approx(np.sqrt(np.mean(distance**2)), rel=0.1)
    for kind_of_error in ("vertex", "surface"):
        for measure in ("rms", "max"):
            relative = report[f"{kind_of_error}_error"][measure] / size
            assert report["relative"][f"{kind_of_error}_{measure}"] == pytest.approx(relative)


def test_the_report_says_what_was_done(cube, denoised) -> None:
    report, taken = denoised.report, denoise(cube[2], cube[1])
    noise = report["denoise"]
    assert json.loads(json.dumps(report)) == report
    assert noise["noise_level"] == taken.noise_level == noise["estimated_noise_level"] > 0.0
    assert noise["relative_noise"] == taken.relative_noise
    assert noise["displacement"]["max"] == pytest.approx(taken.displacement.max())
    assert noise["fit"]["vertex_error"]["max"] == 0.0
    assert noise["fit"]["normal_error_degrees"] < 1e-3
    assert report["settings"]["denoise"] == "only"
    assert 0.0 < report["seconds"]["denoise"] < report["seconds"]["total"]
    assert report["passed_through_vertices"] == int((denoised.error == 0.0).sum())


def test_the_fit_on_request_is_to_the_denoised_mesh(cube, fitted, denoised) -> None:
    report = fitted.report
    assert report["patches"] > 0
    assert (fitted.patch >= 0).all()
    distance = np.linalg.norm(fitted.vertices.astype(float) - denoised.vertices, axis=1)
    assert report["denoise"]["fit"]["vertex_error"]["max"] == pytest.approx(distance.max(), rel=1e-6)
    np.testing.assert_array_equal(fitted.representation.vertices, denoised.vertices.astype(float))
    plain = approximate(denoised.vertices, cube[1], Settings(**{**FIRST.as_dict(), "denoise": "off"}))
    np.testing.assert_array_equal(plain.vertices, fitted.vertices)
    assert report["denoise"]["fit"]["surface_error"] == plain.report["surface_error"]


def test_strength_and_level_are_those_of_the_settings(cube) -> None:
    _, faces, noisy = cube
    weak = approximate(noisy, faces, Settings(workers=1, denoise="only", denoise_strength=0.5))
    np.testing.assert_array_equal(weak.vertices, denoise(noisy, faces, strength=0.5).vertices)
    own = approximate(noisy, faces, Settings(workers=1, denoise="only", noise_level=0.003))
    np.testing.assert_array_equal(own.vertices, denoise(noisy, faces, noise_level=0.003).vertices)
    assert own.report["denoise"]["noise_level"] == 0.003
    none = approximate(noisy, faces, Settings(workers=1, denoise="only", denoise_strength=0.0))
    np.testing.assert_array_equal(none.vertices, noisy)
    assert none.report["passed_through_vertices"] == len(noisy)


@pytest.mark.parametrize("name", ["cube", "sphere", "flower"])
def test_clean_meshes_come_back_unchanged(name) -> None:
    vertices, faces = getattr(models, name)()
    result = approximate(vertices, faces, ONLY)
    assert result.vertices.tobytes() == vertices.tobytes()
    assert not result.error.any()
    assert result.report["denoise"]["noise_level"] == 0.0


def test_the_clean_fandisk_comes_back_unchanged(load_model) -> None:
    vertices, faces = load_model("fandisk.obj")
    np.testing.assert_array_equal(approximate(vertices, faces, ONLY).vertices, vertices)


@pytest.mark.parametrize("settings", [ONLY, FIRST], ids=["only", "first"])
def test_vertices_without_weight_stay(cube, settings) -> None:
    _, faces, noisy = cube
    weights = np.ones(len(noisy))
    weights[::5] = 0.0
    result = approximate(noisy, faces, settings, weights=weights)
    np.testing.assert_array_equal(result.vertices[::5], noisy[::5])
    assert (result.error[::5] == 0.0).all()
    assert result.error.max() > 0.0


def test_denoising_off_changes_nothing(cube) -> None:
    _, faces, noisy = cube
    settings = {**FIRST.as_dict(), "denoise": "off"}
    plain = approximate(noisy, faces, Settings(**settings))
    other = approximate(noisy, faces, Settings(**{**settings, "denoise_strength": 3.0, "noise_level": 0.1}))
    np.testing.assert_array_equal(plain.vertices, other.vertices)
    assert "denoise" not in plain.report


def test_progress_ascends_through_both_parts(cube) -> None:
    told: list[Progress] = []
    approximate(cube[2], cube[1], FIRST, report=lambda step: told.append(step))
    fractions = [step.fraction for step in told]
    assert fractions == sorted(fractions)
    assert {"Estimating the noise", "Fitting one-sided patches", "Solving patches"} <= {step.stage for step in told}


def test_asked_to_finish_while_denoising_it_does_not_fit(cube) -> None:
    _, faces, noisy = cube
    result = approximate(noisy, faces, FIRST, report=lambda step: FINISH if step.fraction < 0.3 else None)
    assert result.report["patches"] == 0
    assert result.error.max() > 0.0


def test_it_can_be_cancelled_at_any_step(cube) -> None:
    steps = approximate_steps(cube[2], cube[1], FIRST)
    for _ in range(3):
        next(steps)
    steps.close()
    with pytest.raises(StopIteration):
        next(steps)


def test_a_vertex_goes_the_share_of_its_way_that_its_weight_says(cube, denoised) -> None:
    vertices, faces, noisy = cube
    share = np.random.default_rng(3).choice([0.0, 0.25, 1.0], len(vertices))
    found = approximate(noisy, faces, ONLY, weights=share)
    moved, whole = found.vertices - noisy.astype(float), denoised.vertices - noisy.astype(float)
    np.testing.assert_array_equal(found.vertices[share == 0.0], noisy[share == 0.0])
    np.testing.assert_array_equal(found.vertices[share == 1.0], denoised.vertices[share == 1.0])
    np.testing.assert_allclose(moved, share[:, None] * whole, atol=1e-6)
    largest = np.linalg.norm(moved, axis=1).max()
    assert found.report["denoise"]["displacement"]["max"] == pytest.approx(largest, rel=1e-4)


def roof(degrees: float, noise: float, seed: int):
    """A ridge between two planes: clean and noisy vertices, triangles, and the ridge's edges."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-18.0, 18.0), np.arange(36.0), indexing="ij"))
    number = np.arange(36 * 36).reshape(36, 36)
    halves = [(number[:-1, :-1], number[1:, :-1], number[1:, 1:]), (number[:-1, :-1], number[1:, 1:], number[:-1, 1:])]
    triangles = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    clean = np.column_stack([x, y, -np.tan(np.radians(degrees / 2.0)) * np.abs(x)])
    noisy = clean + [0.0, 0.0, 1.0] * np.random.default_rng(seed).normal(0.0, noise, (len(clean), 1))
    return clean, noisy, triangles, np.column_stack([number[18, :-1], number[18, 1:]])


@pytest.mark.parametrize("degrees", [10.0, 25.0])
def test_marked_edges_stay_sharp(degrees: float) -> None:
    """Noise hides a shallow ridge; the user knows where it is."""
    clean, noisy, triangles, ridge = roof(degrees, 0.25, 5)
    near = np.abs(clean[triangles][..., 0]).max(axis=1) <= 2.0
    marked = replace(ONLY, creases="marked")
    angles = []
    for settings, edges in ((ONLY, None), (ONLY, ridge), (marked, ridge)):
        found = approximate(noisy, triangles, settings, sharp_edges=edges).vertices
        cosine = (face_normals(found, triangles) * face_normals(clean, triangles)).sum(axis=1)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))[near].mean())
    assert angles[1] == angles[0]
    assert angles[2] < 0.6 * angles[0]
