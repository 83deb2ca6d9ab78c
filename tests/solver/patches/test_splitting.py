"""Squeezed patches, by areas measured here."""

from __future__ import annotations

import numpy as np
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.parameterisation import initial_domains
from sparse_surface.solver.patches.patches import Patches, build_patches
from sparse_surface.solver.patches.splitting import with_domains


def squeeze(mesh: TriangleMesh, patches: Patches, domains: np.ndarray) -> np.ndarray:
    """Second percentile of the area ratios of each patch's triangles over their median."""
    flat, solid = domains[patches.block_triangles], mesh.vertices[mesh.triangles[patches.mesh_triangles]]
    ratio = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    ratio = ratio / np.linalg.norm(np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0]), axis=1)
    own = [ratio[a:b] for a, b in zip(patches.triangle_offsets[:-1], patches.triangle_offsets[1:], strict=True)]
    return np.array([np.quantile(one, 0.02, method="lower") / np.median(one) for one in own])


def test_patches_with_a_finger_are_split_and_others_stay() -> None:
    mesh = build_mesh(*models.finger(5))
    whole = build_patches(mesh, build_cover(mesh, 7), 7)
    before = squeeze(mesh, whole, initial_domains(mesh, whole))
    assert before.min() < 1e-5
    patches, domains = with_domains(mesh, whole, Settings())
    assert len(domains) == len(patches.vertices)
    assert squeeze(mesh, patches, domains)[patches.rings > 2].min() > 0.09  # a median may lie between two triangles
    kept = patches.centres[patches.rings == 7]
    np.testing.assert_array_equal(kept, whole.centres[before >= 0.1])
    left, _ = with_domains(mesh, whole, Settings(adaptive=False))
    np.testing.assert_array_equal(left.centres, whole.centres)
