"""Surfaces from point clouds: accuracy on known surfaces, robustness, refusals."""

from __future__ import annotations

import itertools
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_clouds import Cloud, airplane, ball, box, head, hill, l_solid
from sparse_surface.solver import (
    CloudSettings,
    InputError,
    Representation,
    Settings,
    SettingsError,
    reconstruct,
    reconstruct_steps,
)
from sparse_surface.solver.mesh.closest_points import closest_points
from sparse_surface.solver.mesh.sampling import triangle_grid
from sparse_surface.solver.progress import FINISH, run_to_end
from sparse_surface.solver.reconstruction.reconstruct import refuse_flat

ALONE = Settings(workers=1)
QUICK = Settings(workers=1, iterations=4)
NO_ROUNDS = CloudSettings(corrections=0)


def fitted(cloud: Cloud, settings: Settings = ALONE, **options):
    return reconstruct(cloud.points, cloud.base_vertices, cloud.base_faces, settings, CloudSettings(**options))


def evaluated(result, splits: int = 6):
    """Points of the surface on a grid in every triangle, (n, 3), and triangles between them."""
    grid = triangle_grid(splits)
    count = len(result.representation.triangles)
    points = result.representation.evaluate(np.repeat(np.arange(count), len(grid)), np.tile(grid, (count, 1)))
    key = np.round(grid * splits).astype(int)
    number = {tuple(k[1:]): n for n, k in enumerate(key)}
    small = [[number[i, j], number[i + 1, j], number[i, j + 1]] for i in range(splits) for j in range(splits - i)] + [
        [number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]]
        for i in range(splits - 1)
        for j in range(splits - 1 - i)
    ]
    triangles = (np.array(small)[None] + len(grid) * np.arange(count)[:, None, None]).reshape(-1, 3)
    return points, triangles


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.fixture(scope="module")
def clean_ball():
    """A clean sphere with its reconstruction."""
    cloud = ball()
    return cloud, fitted(cloud)


@pytest.fixture(scope="module")
def noisy_ball():
    """A noisy sphere with its reconstruction."""
    cloud = ball(noise=0.005)
    return cloud, fitted(cloud)


def test_noisy_sphere_over_24_vertices(noisy_ball) -> None:
    """Screened Poisson reconstruction reaches 2.3e-3 here."""
    cloud, result = noisy_ball
    assert rms(cloud.distance(evaluated(result)[0])) < 2.0e-3
    assert result.report["flipped_triangles"] == 0
    assert result.report["input"]["noise"] == pytest.approx(0.005, rel=0.1)


def test_noisy_sphere_over_154_vertices() -> None:
    cloud = ball(9730, 154, noise=0.005)
    result = fitted(cloud)
    assert rms(cloud.distance(evaluated(result)[0])) < 8e-4
    assert result.report["flipped_triangles"] == 0


@pytest.mark.long
def test_box_over_a_base_that_ignores_its_edges() -> None:
    cloud = box()
    result = fitted(cloud)
    off = cloud.distance(evaluated(result)[0])
    assert rms(off) < 1.5e-3
    assert off.max() < 1.5e-2
    assert rms(result.error) < 1.5e-3
    assert result.error.max() < 2.5e-2
    assert result.report["flipped_triangles"] == 0


def test_small_box_over_a_base_that_ignores_its_edges() -> None:
    cloud = box(2000, 3)
    result = fitted(cloud)
    points, triangles = evaluated(result)
    off = cloud.distance(points)
    assert rms(off) < 3e-3
    assert off.max() < 2.5e-2
    feet = closest_points(cloud.creases, points, triangles)
    assert np.linalg.norm(feet.on(points, triangles) - cloud.creases, axis=1).mean() < 1.2e-2
    assert result.report["flipped_triangles"] == 0


@pytest.mark.long
def test_edges_of_a_solid_are_kept() -> None:
    cloud = l_solid()
    result = fitted(cloud)
    points, triangles = evaluated(result)
    assert rms(cloud.distance(points)) < 1.5e-3
    feet = closest_points(cloud.creases, points, triangles)
    assert np.linalg.norm(feet.on(points, triangles) - cloud.creases, axis=1).mean() < 3.5e-3


@pytest.mark.parametrize(
    ("make", "vertices", "most"),
    [
        (ball, 24, 5e-4),
        pytest.param(airplane, 154, 1.5e-3, marks=pytest.mark.long),
        pytest.param(head, 428, 1e-4, marks=pytest.mark.long),
    ],
    ids=["ball", "airplane", "head"],
)
def test_cases_of_the_paper(make, vertices: int, most: float) -> None:
    """The paper's fitting error is "much lower than 0.01"."""
    cloud = make()
    assert len(cloud.base_vertices) == vertices
    result = fitted(cloud)
    assert result.report["relative"]["surface_rms"] < most
    assert rms(cloud.distance(evaluated(result, 4)[0])) < most
    assert result.report["flipped_triangles"] == 0


@pytest.mark.long
def test_a_hundred_thousand_points_take_less_than_a_minute() -> None:
    cloud = head(100_000, 1000)
    start = time.process_time()
    result = fitted(cloud)
    assert time.process_time() - start < 60.0
    assert result.report["relative"]["surface_rms"] < 1e-4


# ------------------------------------------------------------------------------------------------------------- report


def test_error_is_the_distance_from_the_evaluated_surface(noisy_ball) -> None:
    cloud, result = noisy_ball
    on_surface = result.representation.evaluate(result.triangle, result.barycentric)
    np.testing.assert_allclose(np.linalg.norm(on_surface - cloud.points, axis=1), result.error, atol=1e-12)
    points, triangles = evaluated(result, 12)
    feet = closest_points(cloud.points, points, triangles)
    independent = np.linalg.norm(feet.on(points, triangles) - cloud.points, axis=1)
    # the grid's flat triangles are not the surface: 1e-4 is their height here
    assert np.abs(independent - result.error).max() < 1e-3
    report = result.report
    assert report["surface_error"]["rms"] == pytest.approx(rms(result.error))
    assert report["surface_error"]["max"] == pytest.approx(result.error.max())
    assert report["surface_error"]["rms"] <= report["vertex_error"]["rms"]
    assert report["input"]["points"] == 1410
    assert report["input"]["vertices"] == 24
    assert report["patches"] == result.representation.patches
    assert report["seam_max"] < 1e-12


def test_heat_map_of_the_surface_takes_the_errors_of_points_nearby(clean_ball) -> None:
    cloud, result = clean_ball
    np.testing.assert_allclose(result.error_near(cloud.points, cloud.points), result.error, atol=1e-6)
    for place in 0.6 * np.random.default_rng(3).normal(size=(5, 3)):
        distance = np.linalg.norm(cloud.points - place, axis=1)
        near = np.argsort(distance)[:4]
        expected = np.average(result.error[near], weights=1.0 / distance[near])
        assert result.error_near(cloud.points, place[None])[0] == pytest.approx(expected, rel=1e-6)


def test_the_representation_can_be_saved_and_evaluated_anywhere(clean_ball, tmp_path) -> None:
    _, result = clean_ball
    result.representation.save(tmp_path / "ball.npz")
    loaded = Representation.load(tmp_path / "ball.npz")
    where = np.arange(len(loaded.triangles)), np.full((len(loaded.triangles), 3), 1 / 3)
    np.testing.assert_allclose(loaded.evaluate(*where), result.representation.evaluate(*where), atol=1e-6)


def test_the_same_input_gives_the_same_bytes_from_any_process() -> None:
    cloud = ball(600, noise=0.003)
    one, two = fitted(cloud, QUICK), fitted(cloud, QUICK)
    with ThreadPoolExecutor(2) as executor:
        three = reconstruct(cloud.points, cloud.base_vertices, cloud.base_faces, QUICK, executor=executor)
    for other in (two, three):
        assert one.error.tobytes() == other.error.tobytes()
        assert one.representation.coefficients.tobytes() == other.representation.coefficients.tobytes()


# -------------------------------------------------------------------------------------------------------------- robust


@pytest.mark.parametrize("kind", ["huber", "tukey"])
def test_outliers_do_not_count(kind: str) -> None:
    cloud = ball(1500, 30, noise=0.002)
    stray = np.random.default_rng(5).uniform(-0.6, 0.6, size=(75, 3))
    dirty = replace(cloud, points=np.concatenate([cloud.points, stray]))
    plain, robust = (fitted(dirty, QUICK, robust=each, strays="keep") for each in ("none", kind))
    assert rms(cloud.distance(evaluated(robust)[0])) < 1.5e-3
    assert rms(cloud.distance(evaluated(plain)[0])) > 5e-3
    assert robust.weights[:1500].mean() > 0.9
    assert robust.weights[1500:].mean() < 0.15
    assert robust.report["input"]["outliers"] > 50


def test_what_does_not_count_is_left_out_and_counted() -> None:
    cloud = ball(1500, 30, noise=0.002)
    random = np.random.default_rng(5)
    stray = random.uniform(-0.6, 0.6, size=(75, 3))
    stray = stray[np.abs(np.linalg.norm(stray, axis=1) - 0.5) > 0.2]
    rows = np.concatenate([cloud.points, stray, cloud.points[:200] + 1e-9, [[np.nan, 0, 0], [0, np.inf, 0]]])
    result = fitted(replace(cloud, points=rows), QUICK)
    counts = {name: result.report["input"][name] for name in ("points", "used", "strays", "duplicates", "not_finite")}
    assert counts == {"points": len(rows), "used": 1500, "strays": len(stray), "duplicates": 200, "not_finite": 2}
    assert rms(cloud.distance(evaluated(result)[0])) < 1.5e-3
    clean = fitted(cloud, QUICK)
    np.testing.assert_allclose(result.error[:1500], clean.error, atol=5e-4)
    np.testing.assert_allclose(result.error[len(rows) - 202 : -2], clean.error[:200], atol=5e-4)
    np.testing.assert_allclose(
        result.error[1500 : 1500 + len(stray)], np.abs(np.linalg.norm(stray, axis=1) - 0.5), atol=0.01
    )
    assert result.used.sum() == 1700
    assert not result.used[1500 : 1500 + len(stray)].any()
    assert not result.weights[~result.used].any()
    assert (result.error[-2:] == 0.0).all()


def test_a_hole_in_the_cloud_is_bridged() -> None:
    cloud = ball(1500, 40)
    hole = np.linalg.norm(cloud.points - [0.0, 0.0, 0.5], axis=1) < 0.2
    result = fitted(replace(cloud, points=cloud.points[~hole]), QUICK)
    assert hole.sum() > 50
    assert cloud.distance(evaluated(result)[0]).max() < 5e-3


def test_uneven_density_is_no_obstacle() -> None:
    cloud = ball(3000, 40)
    random = np.random.default_rng(5)
    kept = random.uniform(size=3000) < np.where(cloud.points[:, 0] > 0.0, 1.0, 0.05)
    result = fitted(replace(cloud, points=cloud.points[kept]), QUICK)
    off = cloud.distance(evaluated(result)[0])
    assert rms(off) < 5e-3
    assert off.max() < 0.05


def test_an_open_sheet_stays_open_and_is_fitted_to_its_border() -> None:
    cloud = hill(2000)
    result = fitted(cloud)
    points, _ = evaluated(result)
    assert rms(cloud.distance(points)) < 2e-4
    assert np.abs(points[:, :2]).max() < 0.52


def test_four_points_over_a_base_are_enough() -> None:
    cloud = ball(60, 24)
    result = fitted(replace(cloud, points=cloud.points[:4]))
    points, _ = evaluated(result)
    assert np.isfinite(points).all()
    assert np.linalg.norm(points, axis=1).max() < 1.0


def test_a_tetrahedron_is_base_enough() -> None:
    cloud = ball(500, 24)
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(12)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    result = reconstruct(cloud.points, corners, faces, ALONE)
    assert rms(result.error) < 0.02


def test_polygons_of_the_base_may_be_of_any_size_and_winding() -> None:
    cloud = l_solid(1500)
    faces = [list(face) for face in cloud.base_faces]
    faces[3], faces[10] = faces[3][::-1], faces[10][::-1]
    result = reconstruct(cloud.points, cloud.base_vertices, faces, Settings(workers=1, iterations=0), NO_ROUNDS)
    assert rms(result.error) < 3e-3
    triangles = result.representation.triangles
    a, b, c = (result.representation.vertices[triangles[:, k]] for k in range(3))
    assert np.einsum("nk,nk->n", a, np.cross(b, c)).sum() > 0.0
    # outwards everywhere: a closed surface has every edge once in each direction
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    assert len(np.unique(sides, axis=0)) == len(sides)


@pytest.mark.parametrize(
    "settings",
    [
        Settings(workers=1, method="paper", iterations=4),
        Settings(workers=1, method="traditional"),
        Settings(workers=1, domains="separate", iterations=4),
        Settings(workers=1, blending="uniform", iterations=4),
        Settings(workers=1, initial_domain="tutte", basis="monomial", pursuit="omp", iterations=4),
        Settings(workers=1, sweeps=0, iterations=0),
    ],
    ids=["paper", "traditional", "separate", "uniform", "tutte", "neither"],
)
def test_all_methods_work(settings: Settings) -> None:
    cloud = ball(900)
    result = fitted(cloud, settings)
    assert rms(result.error) < 1e-3
    assert rms(cloud.distance(evaluated(result)[0])) < 5e-3
    assert result.report["method"] == settings.method
    assert result.report["flipped_triangles"] == 0


@pytest.mark.parametrize("ring", [1, 2, 3])
def test_patch_radius_can_be_chosen(ring: int) -> None:
    result = fitted(ball(1500, 60), Settings(workers=1, iterations=2), ring=ring)
    assert result.report["settings"]["ring"] == ring
    assert rms(result.error) < 1e-3


@pytest.mark.long
def test_every_correction_and_every_crease_point_helps() -> None:
    cloud = l_solid(5000)
    quick = Settings(workers=1, iterations=6)

    def edges(**options) -> float:
        points, triangles = evaluated(fitted(cloud, quick, **options))
        feet = closest_points(cloud.creases, points, triangles)
        return float(np.linalg.norm(feet.on(points, triangles) - cloud.creases, axis=1).mean())

    plain = edges(corrections=0, creases=False)
    assert edges(corrections=2, creases=False) < 0.97 * plain
    assert edges(corrections=0, creases=True) < 0.8 * plain


# ------------------------------------------------------------------------------------------------- progress, refusals


def test_progress_rises_to_the_end() -> None:
    cloud = ball(600)
    seen = []
    result = reconstruct(
        cloud.points,
        cloud.base_vertices,
        cloud.base_faces,
        ALONE,
        CloudSettings(robust="tukey"),
        report=lambda step: seen.append(step.fraction),
    )
    assert result.report["seconds"]["total"] > 0.0
    assert seen == sorted(seen)
    assert seen[0] == 0.0
    assert 0.9 < seen[-1] <= 1.0


def test_it_can_be_finished_early_at_any_step() -> None:
    cloud = ball(600)
    for stop in (3, 6, 9):
        steps = reconstruct_steps(cloud.points, cloud.base_vertices, cloud.base_faces, ALONE)
        taken = itertools.count(1)
        result = run_to_end(steps, lambda _, taken=taken, stop=stop: FINISH if next(taken) >= stop else None)
        assert rms(result.error) < 1e-3


def test_closing_cancels() -> None:
    cloud = ball()
    steps = reconstruct_steps(cloud.points, cloud.base_vertices, cloud.base_faces, ALONE)
    for _ in range(4):
        next(steps)
    steps.close()
    with pytest.raises(StopIteration):
        next(steps)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), r"^A surface needs at least 4 points; there are 0\.$"),
        (np.eye(3), r"^A surface needs at least 4 points; there are 3\.$"),
        (np.zeros((5, 2)), r"^The points must be an array of three numbers each, not of shape \(5, 2\)\.$"),
        ("points", r"^The points must be an array of three numbers each\.$"),
        (np.ones((7, 3)), r"^All the points are at one place\.$"),
        (
            np.array([[0, 0, 0], [1, 0, 0], [0, np.nan, 0], [0, 0, 1.0]]),
            r"^A surface needs at least 4 points; of 4 only 3 can be used\.$",
        ),
        (
            np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, np.inf], [0, 1, 0]]),
            r"^A surface needs at least 4 points; of 5 only 3 can be used\.$",
        ),
    ],
    ids=["none", "three", "plane", "text", "same", "nan", "inf"],
)
def test_points_that_are_refused(points, message: str) -> None:
    base = ball()
    with pytest.raises(InputError, match=message):
        reconstruct(points, base.base_vertices, base.base_faces)


def test_bases_that_are_refused() -> None:
    cloud = ball()
    with pytest.raises(InputError, match=r"^The base is far from the points"):
        reconstruct(cloud.points, cloud.base_vertices + 5.0, cloud.base_faces)
    with pytest.raises(InputError, match=r"^The base is not manifold"):
        reconstruct(
            cloud.points,
            cloud.base_vertices,
            np.concatenate([cloud.base_faces, cloud.base_faces[:1, [0, 1, 2]], [[0, 1, 2], [0, 1, 3]]]),
        )
    with pytest.raises(InputError):
        reconstruct(cloud.points, cloud.base_vertices, np.zeros((0, 3), dtype=int))


def test_flat_clouds_make_no_base() -> None:
    random = np.random.default_rng(0)
    plane = random.normal(size=(50, 2)) @ random.normal(size=(2, 3)) + 7.0
    line = random.normal(size=(50, 1)) @ random.normal(size=(1, 3)) - 3.0
    with pytest.raises(InputError, match=r"^All the points lie in one plane: choose a base mesh for them\.$"):
        refuse_flat(plane)
    with pytest.raises(InputError, match=r"^All the points lie on one line: choose a base mesh for them\.$"):
        refuse_flat(line)
    refuse_flat(ball().points)


def test_a_flat_cloud_over_a_flat_base_is_fitted() -> None:
    cloud = hill(1000)
    flat = [1.0, 1.0, 0.0]
    result = reconstruct(
        cloud.points * flat, cloud.base_vertices * flat, cloud.base_faces, Settings(workers=1, iterations=1)
    )
    assert result.error.max() < 1e-6


def test_settings_have_ranges() -> None:
    with pytest.raises(SettingsError, match=r"^robust must be one of none, huber, tukey, not 'l1'\.$"):
        CloudSettings(robust="l1")
    with pytest.raises(SettingsError, match=r"^corrections must be a whole number from 0 to 20, not -1\.$"):
        CloudSettings(corrections=-1)
