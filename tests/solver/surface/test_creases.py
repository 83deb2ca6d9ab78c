"""Creases that the optimisation found, against the input's own dihedral angles, which it never sees."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube, sphere
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.surface.creases import edge_stretch


def sharp_edges(mesh, degrees=30.0):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sides = mesh.edge_triangles
    cosine = (normal[sides[:, 0]] * normal[sides[:, 1]]).sum(axis=1)
    return {tuple(sorted(edge)) for edge in mesh.edges[np.degrees(np.arccos(np.clip(cosine, -1, 1))) > degrees]}


@pytest.fixture(scope="module")
def marked_cube():
    return approximate(*cube(), Settings(workers=1, mark_creases=True, creases="off"))


def test_the_edges_of_a_cube_are_found(marked_cube):
    true = sharp_edges(build_mesh(*cube()))
    found = set(map(tuple, marked_cube.creases))
    assert len(true) == 192
    assert len(found & true) > 0.85 * len(true)
    assert len(found - true) < 0.1 * len(true)


def test_the_domain_is_stretched_across_them(marked_cube):
    mesh = build_mesh(*cube())
    stretch = edge_stretch(marked_cube.representation, mesh)
    true = sharp_edges(mesh)
    sharp = np.array([tuple(sorted(edge)) in true for edge in mesh.edges])
    assert np.median(stretch[sharp]) > 1.3 * np.median(stretch[~sharp])


def test_a_sphere_has_none():
    assert len(approximate(*sphere(12), Settings(workers=1, mark_creases=True, sweeps=0)).creases) == 0


def test_nothing_is_marked_unasked(marked_cube):
    assert approximate(*sphere(5), Settings(workers=1, iterations=2)).creases is None
