"""Blending weights, consistency and measures on small covers."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube, cylinder
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.patches.blending import blending_weights, fitting_weights
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.patches import build_patches, overlay_patches


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


def test_uniform_blending_jumps_at_rims_and_partition_does_not():
    vertices, faces = cube()
    jumps = {
        kind: approximate(vertices, faces, Settings(workers=1, iterations=3, sweeps=0, blending=kind)).report[
            "seam_max"
        ]
        for kind in ("partition", "uniform")
    }
    assert jumps["partition"] < 1e-12 < 1e-4 < jumps["uniform"]
