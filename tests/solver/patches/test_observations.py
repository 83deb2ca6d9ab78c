"""Where the patches of a mesh are observed, and with which weights."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube, cylinder, sphere
from sparse_surface.solver.approximation.patched_surface import cover
from sparse_surface.solver.mesh.potential_creases import beside_sharp_edges, dihedrals
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh, cut_along
from sparse_surface.solver.patches.blending import blending_weights
from sparse_surface.solver.patches.observations import MeshObservations
from sparse_surface.solver.patches.patches import Patches

RING = 7


def observed(mesh: TriangleMesh, inside: bool = True) -> tuple[Patches, MeshObservations]:
    patches = cover(mesh, RING)
    weights = blending_weights(mesh, patches, "partition")
    return patches, MeshObservations(mesh, patches, weights, "partition", None, inside)


def cut(mesh: TriangleMesh) -> TriangleMesh:
    return cut_along(mesh, dihedrals(mesh) > 45.0)


def large(patches: Patches) -> list[int]:
    return [int(k) for k in np.flatnonzero(np.diff(patches.vertex_offsets) >= 100)]


def test_triangles_beside_creases_are_observed_at_six_points() -> None:
    whole = build_mesh(*cylinder())
    mesh = cut(whole)
    rim = np.unique(whole.edges[dihedrals(whole) > 45.0])
    patches, observations = observed(mesh)
    at_creases = 0
    for patch in large(patches):
        own = observations.of_patch(patch)
        faces = patches.mesh_triangles[slice(*patches.triangle_offsets[patch : patch + 2])]
        beside = np.isin(mesh.triangles[faces], rim).any(axis=1)
        count = patches.vertex_offsets[patch + 1] - patches.vertex_offsets[patch]
        assert len(own.number) == count + len(faces) + 5 * beside.sum()
        assert len(np.unique(own.number)) == len(own.number)
        # smooth: all that is inside a triangle weighs as much as a vertex
        assert own.weights[count:].sum() == pytest.approx(len(faces))
        names = patches.vertices[slice(*patches.vertex_offsets[patch : patch + 2])]
        np.testing.assert_array_equal(own.weights[:count] < 1.0, np.isin(names, rim))
        places = np.einsum("nk,nkd->nd", own.shares, mesh.vertices[names[own.corners]])
        np.testing.assert_allclose(observations.points[own.number], places, atol=1e-13)
        at_creases += bool(beside.any())
    assert at_creases > 10


def test_vertices_alone_are_all_alike() -> None:
    patches, observations = observed(cut(build_mesh(*cylinder())), inside=False)
    for patch in range(len(patches)):
        own = observations.of_patch(patch)
        assert (own.weights == 1.0).all()
        assert len(own.number) == patches.vertex_offsets[patch + 1] - patches.vertex_offsets[patch]


def test_centroids_weigh_less_where_a_crease_is_not_cut() -> None:
    mesh = build_mesh(*cube(24))
    beside = beside_sharp_edges(mesh, 60.0)
    assert 0 < beside.sum() < len(beside)
    np.testing.assert_array_equal(beside, np.isin(np.arange(len(beside)), mesh.edge_triangles[dihedrals(mesh) > 60.0]))
    patches, observations = observed(mesh)
    kinds = set()
    for patch in large(patches):
        faces = patches.mesh_triangles[slice(*patches.triangle_offsets[patch : patch + 2])]
        inside = observations.of_patch(patch).weights[-len(faces) :]
        kinds.add(bool(beside[faces].any()))
        np.testing.assert_array_equal(inside, 0.5 if beside[faces].any() else 1.0)
    assert kinds == {False, True}


def test_observing_more_densely_keeps_numbers() -> None:
    patches, observations = observed(cut(build_mesh(*cylinder())))
    more = np.zeros(len(patches), dtype=bool)
    more[large(patches)[0]] = True
    denser = observations.with_dense(more)
    for patch in large(patches)[1:]:
        one, other = observations.of_patch(patch), denser.of_patch(patch)
        np.testing.assert_array_equal(one.number, other.number)
        np.testing.assert_array_equal(observations.points[one.number], denser.points[other.number])
    own = denser.of_patch(large(patches)[0])
    faces = np.diff(patches.triangle_offsets)[large(patches)[0]]
    assert (own.shares[-6 * faces :] > 0.0).all()


def test_a_fair_surface_is_observed_less_densely() -> None:
    """Five rings on a sphere have about 90 vertices; a surface that is fair says more of what lies between."""
    mesh = build_mesh(*sphere(12))
    patches = cover(mesh, 5)
    size, faces = np.diff(patches.vertex_offsets), np.diff(patches.triangle_offsets)
    assert ((size > 75) & (size < 100)).sum() > 5
    weights = blending_weights(mesh, patches, "partition")
    for curved, enough in ((False, 100), (True, 75)):
        observations = MeshObservations(mesh, patches, weights, "partition", curved=curved)
        inside = np.array([len(observations.of_patch(k).number) for k in range(len(patches))]) - size
        np.testing.assert_array_equal(inside, np.where(size < enough, 6, 1) * faces)
