"""Measures against what they are by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sparse_surface.benchmarks.generated_models import cube
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.mesh.sampling import MEASURED_SAMPLES
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.surface.metrics import (
    domain_changes,
    faces_turned,
    normal_error,
    seam,
    statistics,
    strongest_patch,
    surface_error,
)


@pytest.fixture(scope="module")
def representation():
    return approximate(*cube(6), Settings(workers=1, iterations=1, sweeps=0)).representation


def test_measures_see_a_shift_as_what_it_is():
    vertices, faces = cube(6)
    representation = approximate(vertices, faces, Settings(workers=1, iterations=1, sweeps=0)).representation
    true = representation.evaluate(
        np.repeat(np.arange(len(representation.triangles)), 6),
        np.tile(MEASURED_SAMPLES, (len(representation.triangles), 1)),
    )
    flat = np.einsum("qk,tkd->tqd", MEASURED_SAMPLES, vertices[representation.triangles]).reshape(-1, 3)
    np.testing.assert_allclose(surface_error(representation).ravel(), np.linalg.norm(true - flat, axis=1))
    shifted = replace(representation, origins=representation.origins + np.array([0.0, 0.0, 0.25]))
    moved = shifted.at_vertices() - representation.at_vertices()
    np.testing.assert_allclose(moved, np.tile([0.0, 0.0, 0.25], (len(vertices), 1)), atol=1e-12)
    assert seam(shifted) < 1e-12


def test_polygons_that_turn_by_more_than_a_right_angle_are_counted():
    """Triangles, quads and pentagons far from the origin, each turned about its first edge by an angle of its own."""
    angles = np.radians([10.0, 95.0, 80.0, 120.0, 180.0, 60.0, 89.0, 91.0])
    sizes = np.array([3, 4, 5, 4, 3, 5, 4, 3])
    before, after = [], []
    for size, angle in zip(sizes, angles, strict=True):
        around = 2.0 * np.pi * np.arange(size) / size
        flat = np.stack([np.cos(around), np.sin(around), np.zeros(size)], axis=1)
        axis = flat[1] - flat[0]
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        before.append(flat + 1e4)
        after.append(turn.apply(flat - flat[0]) + flat[0] + 1e4)
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    one, other = np.concatenate(before), np.concatenate(after)
    assert faces_turned(one, other, offsets, np.arange(len(one))) == (np.degrees(angles) > 90.0).sum() == 4
    assert faces_turned(one, one, offsets, np.arange(len(one))) == 0


def test_triangles_without_area_have_no_normal_error():
    """One of two is flat in the first mesh; the other one turns by 30 degrees."""
    before = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0]])
    after = Rotation.from_euler("x", 30.0, degrees=True).apply(before)
    after[3, 2] += 1.0
    triangles = np.array([[0, 1, 2], [0, 1, 3]])
    assert normal_error(before, after, triangles) == pytest.approx(30.0)
    assert normal_error(after, before, triangles) == pytest.approx(30.0)


def test_normals_of_a_turned_mesh_are_off_by_the_angle():
    vertices, faces = cube(4)
    angle = np.radians(7.0)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    triangles = build_mesh(vertices, faces).triangles
    # two sides of the cube lie across the axis and keep their normals
    assert normal_error(vertices, vertices @ turn.T, triangles) == pytest.approx(7.0 * 4 / 6)


def test_statistics_of_a_known_sample():
    found = statistics(np.array([0.0, 3.0, 4.0]))
    assert found == {
        "rms": pytest.approx(np.sqrt(25 / 3)),
        "mean": pytest.approx(7 / 3),
        "p95": pytest.approx(3.9),
        "max": 4.0,
    }
    assert statistics(np.zeros(0)) == {"rms": 0.0, "mean": 0.0, "p95": 0.0, "max": 0.0}


def test_stretch_is_the_ratio_of_each_patch_weighted_by_its_blending(representation):
    """Every patch's domain is stretched along u by a factor of its own, so the ratio is known on each triangle."""
    factors = 1.0 + np.arange(representation.patches)
    of_vertices = np.repeat(factors, np.diff(representation.vertex_offsets))
    stretched = representation.initial_domains * np.stack([of_vertices, np.ones_like(of_vertices)], axis=1)
    known = replace(representation, domains=stretched)
    total, weight = np.zeros((2, len(known.triangles)))
    for patch, factor in enumerate(factors):
        vertices = slice(*known.vertex_offsets[patch : patch + 2])
        faces = slice(*known.triangle_offsets[patch : patch + 2])
        for corners, triangle in zip(known.patch_triangles[faces], known.mesh_triangles[faces], strict=True):
            own = known.weights[vertices][corners].mean()
            total[triangle] += own * factor
            weight[triangle] += own
    assert np.ptp(total / weight) > 1.0, "patches overlap with unlike weights"
    expected = [(total / weight)[known.polygon == face].mean() for face in range(known.polygon.max() + 1)]
    found, _ = domain_changes(known, len(expected))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_mirrored_domain_is_flipped(representation):
    mirrored = replace(representation, domains=representation.initial_domains * [-1.0, 1.0])
    _, flipped = domain_changes(mirrored, len(representation.face_offsets) - 1)
    assert flipped == len(representation.mesh_triangles)


def test_the_strongest_patch_has_the_largest_weight_and_the_lowest_number(representation):
    patch_of = np.repeat(np.arange(representation.patches), np.diff(representation.vertex_offsets))
    for vertex, found in enumerate(strongest_patch(representation)):
        here = representation.patch_vertices == vertex
        weights, patches = representation.weights[here], patch_of[here]
        assert found == patches[weights == weights.max()].min()
    none = replace(representation, weights=np.zeros_like(representation.weights))
    assert (strongest_patch(none) == -1).all()
