"""Blending weights, consistency and measures on small covers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube, cylinder
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.approximation.sweeps import colour_patches
from sparse_surface.solver.mesh.sampling import SURFACE_SAMPLES
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.blending import blending_weights, fitting_weights
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.patches import build_patches, overlay_patches
from sparse_surface.solver.surface.metrics import normal_error, seam, statistics, surface_error


@pytest.fixture(scope="module")
def cover():
    mesh = build_mesh(*cylinder())
    return mesh, build_patches(mesh, build_cover(mesh, 5), 5)


@pytest.mark.parametrize("kind", ["partition", "uniform"])
def test_weights_add_up_to_one(cover, kind):
    mesh, patches = cover
    weights = blending_weights(mesh, patches, kind)
    np.testing.assert_allclose(np.bincount(patches.vertices, weights=weights), 1.0)
    assert (weights >= 0.0).all()


def test_partition_weights_vanish_on_rims_and_uniform_ones_count_patches(cover):
    mesh, patches = cover
    partition = blending_weights(mesh, patches, "partition")
    assert (partition[patches.rim_distance == 0] == 0.0).all()
    assert (partition[patches.rim_distance > 0] > 0.0).all()
    uniform = blending_weights(mesh, patches, "uniform")
    np.testing.assert_allclose(uniform, 1.0 / np.bincount(patches.vertices)[patches.vertices])


def test_finer_patches_hide_what_lies_below_but_not_at_their_rims(cover):
    mesh, patches = cover
    wanted = np.zeros(len(mesh.vertices), dtype=bool)
    wanted[:20] = True
    finer = overlay_patches(mesh, patches, wanted, 2, 1)
    weights = blending_weights(mesh, finer, "partition")
    new = finer.levels[finer.vertex_patch] == 1
    share = np.bincount(finer.vertices[new], weights=weights[new], minlength=len(mesh.vertices))
    assert share[wanted].min() > 0.9
    np.testing.assert_allclose(np.bincount(finer.vertices, weights=weights), 1.0)
    assert (weights[new & (finer.rim_distance == 0)] == 0.0).all()


def test_a_patch_is_fitted_with_the_weight_that_it_has():
    blending, own = np.array([0.0, 0.5, 1.0]), np.array([1.0, 1.0, 0.5])
    fitted = fitting_weights(blending, own, "partition")
    assert fitted.sum() == pytest.approx(own.sum())
    np.testing.assert_allclose(fitted / fitted[0], own * (blending**2 + 0.05) / 0.05)
    np.testing.assert_array_equal(fitting_weights(blending, own, "uniform"), own)


def test_patches_of_one_colour_share_no_vertex(cover):
    _, patches = cover
    colours = colour_patches(patches)
    assert sorted(np.concatenate(colours)) == list(range(len(patches)))
    for colour in colours:
        vertices = patches.select(colour).vertices
        assert len(np.unique(vertices)) == len(vertices)


def test_a_sweep_brings_the_blend_nearer_and_the_patches_together():
    vertices, faces = cube()
    alone, swept = (approximate(vertices, faces, Settings(workers=1, sweeps=count)) for count in (0, 1))
    assert swept.report["vertex_error"]["rms"] < alone.report["vertex_error"]["rms"]
    assert swept.report["surface_error"]["rms"] < alone.report["surface_error"]["rms"]


def test_uniform_blending_jumps_at_rims_and_partition_does_not():
    vertices, faces = cube()
    jumps = {
        kind: approximate(vertices, faces, Settings(workers=1, iterations=3, sweeps=0, blending=kind)).report[
            "seam_max"
        ]
        for kind in ("partition", "uniform")
    }
    assert jumps["partition"] < 1e-12 < 1e-4 < jumps["uniform"]


def test_measures_see_a_shift_as_what_it_is():
    vertices, faces = cube(6)
    representation = approximate(vertices, faces, Settings(workers=1, iterations=1, sweeps=0)).representation
    true = representation.evaluate(
        np.repeat(np.arange(len(representation.triangles)), 6),
        np.tile(SURFACE_SAMPLES, (len(representation.triangles), 1)),
    )
    flat = np.einsum("qk,tkd->tqd", SURFACE_SAMPLES, vertices[representation.triangles]).reshape(-1, 3)
    np.testing.assert_allclose(surface_error(representation).ravel(), np.linalg.norm(true - flat, axis=1))
    shifted = replace(representation, origins=representation.origins + np.array([0.0, 0.0, 0.25]))
    moved = shifted.at_vertices() - representation.at_vertices()
    np.testing.assert_allclose(moved, np.tile([0.0, 0.0, 0.25], (len(vertices), 1)), atol=1e-12)
    assert seam(shifted) < 1e-12


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
