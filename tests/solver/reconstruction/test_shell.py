"""Sides of a shell around a cloud, borders of clouds, and a reconstruction in a process of its own."""

from __future__ import annotations

import time

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_clouds import ball, box, head, hill, l_solid
from sparse_surface.benchmarks.generated_models import sphere
from sparse_surface.solver import CloudSettings, Settings, reconstruct, run_to_end
from sparse_surface.solver.interchange import CloudArrays
from sparse_surface.solver.job import Job
from sparse_surface.solver.reconstruction.evaluated import automatic_splits, reconstruct_arrays
from sparse_surface.solver.reconstruction.geometry import analyse
from sparse_surface.solver.reconstruction.shell import (
    has_cavity,
    is_open,
    oriented_normals,
    outer_parts,
    parts,
    sheet,
    signed_volumes,
    smoothed,
    unpinched,
    without_slivers,
)

QUICK = Settings(workers=1, iterations=3)


def nested_spheres(inner: float) -> tuple[np.ndarray, np.ndarray]:
    """A sphere wound outwards and a smaller one wound inwards."""
    vertices, triangles = sphere(8)
    count = len(vertices)
    return np.concatenate([vertices, inner * vertices]), np.concatenate([triangles, triangles[:, ::-1] + count])


def test_outer_side_of_a_shell() -> None:
    vertices, triangles = nested_spheres(0.5)
    part = parts(triangles, len(vertices))
    assert part.max() == 1
    volumes = signed_volumes(vertices, triangles, part)
    assert volumes[1] == pytest.approx(-volumes[0] / 8)
    moved = vertices + np.array([30.0, 0.0, 0.0])
    outside, faces = outer_parts(moved, triangles)
    np.testing.assert_array_equal(outside, moved[: len(vertices) // 2])
    assert len(faces) == len(triangles) // 2


def test_a_cavity_is_larger_than_a_bubble() -> None:
    radius = float(np.linalg.norm(sphere(8)[0][0]))
    assert has_cavity(*nested_spheres(0.5), radius=0.3 * radius)
    assert not has_cavity(*nested_spheres(0.1), radius=0.3 * radius)
    assert not has_cavity(*sphere(8), radius=0.3 * radius)


def opens(points: np.ndarray) -> bool:
    """Whether a cloud is open, by the spacing and the noise that it shows."""
    geometry = analyse(points)
    return is_open(points, geometry.spacing, geometry.noise)


@pytest.mark.parametrize("cloud", [ball(100), ball(3000, noise=0.005), box(3000), l_solid(2000), head(3000, 50)])
def test_closed_clouds_are_not_open(cloud) -> None:
    assert not opens(cloud.points)


@pytest.mark.parametrize("cloud", [ball(6000), box(6000), l_solid(6000)])
def test_noise_wider_than_the_spacing_opens_no_closed_cloud(cloud) -> None:
    random = np.random.default_rng(0)
    assert not opens(cloud.points + 2.0 * analyse(cloud.points).spacing * random.normal(size=cloud.points.shape))


def test_noise_wider_than_the_spacing_closes_no_open_cloud() -> None:
    random = np.random.default_rng(0)
    points = hill(6000).points
    assert opens(points + 2.0 * analyse(points).spacing * random.normal(size=points.shape))


def test_open_clouds_are_open() -> None:
    assert opens(hill(2000).points)
    assert opens(hill(2000, noise=0.005).points)
    half = ball(3000).points
    assert opens(half[half[:, 2] > 0.0])


def test_normals_of_a_sphere_all_point_to_one_side() -> None:
    points = ball(2000).points
    random = np.random.default_rng(1)
    mixed = points / np.linalg.norm(points, axis=1, keepdims=True) * random.choice([-1.0, 1.0], size=(2000, 1))
    along = (oriented_normals(points, mixed) * points).sum(axis=1)
    assert (along > 0.0).all() or (along < 0.0).all()


def sheet_shell(points: np.ndarray, thickness: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """A slab around a sheet over the unit square, wound outwards, reaching beyond its border."""
    axis = np.linspace(-0.6, 0.6, 40)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    from scipy.spatial import cKDTree

    z = points[cKDTree(points[:, :2]).query(np.column_stack([x, y]), k=8)[1], 2].mean(axis=1)
    corner = (np.arange(39)[:, None] * 40 + np.arange(39)).ravel()
    up = np.concatenate(
        [np.stack([corner, corner + 40, corner + 41], 1), np.stack([corner, corner + 41, corner + 1], 1)]
    )
    top, bottom = np.column_stack([x, y, z + thickness]), np.column_stack([x, y, z - thickness])
    return np.concatenate([top, bottom]), np.concatenate([up, up[:, ::-1] + 1600])


def test_a_sheet_lies_on_the_points_and_ends_with_them() -> None:
    cloud = hill(4000)
    geometry = analyse(cloud.points)
    vertices, triangles = sheet(cloud.points, geometry.spacing, geometry.noise)
    inner = np.abs(vertices[:, :2]).max(axis=1) < 0.45
    # smoothing lowers the top of the hill
    assert cloud.distance(vertices[inner]).max() < 0.04
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    up = np.cross(b - a, c - a)[:, 2]
    assert max((up > 0.0).mean(), (up < 0.0).mean()) > 0.99, "one side, not both"
    assert 0.9 < np.abs(up).sum() / 2 < 1.1
    assert np.abs(vertices[:, :2]).max() < 0.54


def test_slivers_at_the_border_are_left_out() -> None:
    """A square of two triangles, with a thin ear at one side and a thin triangle between two others at the next."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, -0.02, 0]])
    kept, triangles = without_slivers(vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1]]))
    np.testing.assert_array_equal(kept, vertices[:4])
    np.testing.assert_array_equal(triangles, [[0, 1, 2], [0, 2, 3]])
    inside = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.02, 0]])
    fan = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    kept, triangles = without_slivers(inside, fan)
    np.testing.assert_array_equal(kept, inside)
    np.testing.assert_array_equal(triangles, fan[1:])


def test_smoothing_keeps_a_straight_border_straight() -> None:
    vertices, triangles = sheet_shell(hill(500).points * [1, 1, 0])
    vertices, triangles = vertices[:1600], triangles[: len(triangles) // 2]
    noisy = vertices + np.random.default_rng(0).normal(size=vertices.shape) * [0, 0, 0.01]
    smooth = smoothed(noisy, triangles)
    assert smooth[:, 2].std() < 0.3 * noisy[:, 2].std()
    assert np.abs(smooth[:, 0]).max() == pytest.approx(0.6, abs=1e-3)


def test_parts_that_meet_at_a_vertex_come_apart() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    apart, triangles = unpinched(vertices, np.array([[0, 1, 2], [0, 3, 4]]))
    assert len(apart) == 6
    assert len(np.unique(triangles)) == 6


def test_surface_has_about_as_many_vertices_as_there_are_points() -> None:
    for points, triangles in ((1410, 44), (9730, 304), (26909, 852), (10, 100)):
        splits = automatic_splits(points, triangles)
        assert splits == 1 or 0.7 < 0.5 * triangles * splits**2 / points < 1.4


def small_cloud() -> tuple[CloudArrays, object]:
    cloud = ball(400, noise=0.002)
    corners = cloud.base_faces.astype(np.int32).ravel()
    sizes = np.full(len(cloud.base_faces), 3, dtype=np.int32)
    points, vertices = cloud.points.astype(np.float32), cloud.base_vertices.astype(np.float32)
    return CloudArrays(points, vertices, corners, sizes, CloudSettings(corrections=1), 4), cloud


def test_arrays_are_reconstructed_as_the_library_does() -> None:
    arrays, cloud = small_cloud()
    outcome = run_to_end(reconstruct_arrays(arrays, QUICK))
    alone = reconstruct(arrays.points, arrays.base_vertices, cloud.base_faces, QUICK, arrays.cloud)
    np.testing.assert_array_equal(outcome.point_error, alone.error)
    np.testing.assert_allclose(outcome.vertices[: len(alone.vertices)], alone.vertices, atol=1e-6)
    assert len(outcome.sizes) == 16 * len(cloud.base_faces) == len(outcome.domain_stretch)
    assert len(outcome.vertices) == len(outcome.error) == len(outcome.patch)


def test_a_process_of_its_own_gives_the_same_bytes() -> None:
    arrays, _ = small_cloud()
    job = Job()
    job.start(arrays, QUICK)
    end = time.monotonic() + 60.0
    stages = []
    while job.running and time.monotonic() < end:
        said = job.poll()
        if said is not None:
            stages.append(said.fraction)
        time.sleep(0.02)
    outcome, failure = job.outcome, job.failure
    job.stop()
    assert not failure
    here = run_to_end(reconstruct_arrays(arrays, QUICK))
    for name in ("vertices", "corners", "sizes", "error", "patch", "point_error", "point_weight", "domain_stretch"):
        assert getattr(outcome, name).tobytes() == getattr(here, name).tobytes(), name
    assert outcome.splits == here.splits == 4
    assert outcome.report["input"] == here.report["input"]
    assert stages == sorted(stages)
