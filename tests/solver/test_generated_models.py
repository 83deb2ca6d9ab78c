"""Generated models: counts, closedness, and that no vertex leaves its surface."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.mesh.normals import triangle_areas
from sparse_surface.solver.mesh.triangle_mesh import build_mesh

CLOSED = {
    models.cube: 1.0,
    models.cubetorus: (24 * 24 - 8 * 8) * 13 / 24**3,
    models.cylinder: 0.25**2 * np.pi,
    models.flower: None,
    models.sphere: 4 / 3 * np.pi,
    models.lens: None,
    models.l_solid: 0.375,
    models.tetrahedron: 8 / 3,
    models.cube98: 1.0,
    models.thin_torus: None,
}


@pytest.mark.parametrize("model", CLOSED, ids=lambda model: model.__name__)
def test_closed_models_are_closed_and_wound_outwards(model):
    vertices, faces = model()
    mesh = build_mesh(vertices, faces)
    assert not mesh.border.any()
    assert (mesh.winding == 1).all()
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    assert volume > 0
    if CLOSED[model] is not None:
        assert volume == pytest.approx(CLOSED[model], rel=2e-2)


@pytest.mark.parametrize(
    ("name", "vertices"),
    [("cube", 1538), ("cubetorus", 2686), ("cylinder", 2732), ("flower", 7919), ("detailed", 55955)],
)
def test_the_papers_models_have_about_as_many_vertices(name, vertices):
    points, faces = models.MODELS[name]()
    assert len(points) == pytest.approx(vertices, rel=0.01)
    mesh = build_mesh(points, faces)
    assert mesh.used.all()
    assert mesh.component_count == 1
    assert not mesh.border.any()
    areas = triangle_areas(mesh.vertices, mesh.triangles)
    assert areas.min() > 0.05 * np.median(areas)


def test_the_cube_is_the_papers():
    vertices, faces = models.cube()
    assert len(vertices) == 1538
    assert faces.shape == (1536, 4)
    assert np.ptp(vertices, axis=0).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("model", [models.cubetorus, models.l_solid], ids=lambda model: model.__name__)
def test_jitter_stays_in_the_faces(model):
    mesh = build_mesh(*model())
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(np.sort(np.abs(normals), axis=1), [[0.0, 0.0, 1.0]] * len(normals), atol=1e-9)


def test_the_cylinder_is_round_and_its_ends_are_flat():
    vertices, _ = models.cylinder()
    radius = np.hypot(vertices[:, 0], vertices[:, 1])
    on_end = np.isclose(np.abs(vertices[:, 2]), 0.5)
    np.testing.assert_allclose(radius[~on_end], 0.25)
    assert radius[on_end].max() == pytest.approx(0.25)
    assert on_end.sum() == 2 * 16 * 16


def test_the_lens_consists_of_two_spheres():
    vertices, _ = models.lens()
    distance = np.linalg.norm(vertices + [0.0, 0.0, 0.9] * np.sign(vertices[:, 2:]), axis=1)
    off_crease = vertices[:, 2] != 0
    np.testing.assert_allclose(distance[off_crease], np.hypot(1, 0.9))
    np.testing.assert_allclose(np.linalg.norm(vertices[~off_crease], axis=1), 1.0)


def test_the_sphere_is_round():
    vertices, faces = models.sphere(5)
    assert len(vertices) == 252
    assert len(faces) == 500
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0)


@pytest.mark.parametrize("count", [4, 1000, 40_000])
def test_the_terrain_has_the_size_asked_for_and_sharp_crests(count):
    vertices, faces = models.creased_terrain(count)
    assert len(vertices) == pytest.approx(count, rel=0.05)
    mesh = build_mesh(vertices, faces)
    assert (mesh.winding == 1).all()
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()  # no triangle is folded over by the jitter
    if count > 1000:
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        inner = mesh.edge_triangles[mesh.edge_triangles[:, 1] >= 0]
        bend = np.degrees(np.arccos(np.clip((normals[inner[:, 0]] * normals[inner[:, 1]]).sum(axis=1), -1, 1)))
        assert (bend > 60).mean() > 0.005


def test_the_one_sided_models_are_one_sided():
    for model, border in ((models.moebius, True), (models.klein_bottle, False)):
        mesh = build_mesh(*model())
        assert (mesh.winding == 0).all()
        assert mesh.border.any() == border


def test_the_finger_stands_up_in_one_piece():
    mesh = build_mesh(*models.finger(4, 5))
    assert mesh.component_count == 1
    assert mesh.node_count - len(mesh.edges) + len(mesh.triangles) == 1
    assert (mesh.winding == 1).all()
    assert not mesh.passed_through.any()
    assert mesh.vertices[:, 2].max() == 4.0


def test_the_pole_has_its_valence():
    mesh = build_mesh(*models.pole(500, 3))
    assert np.diff(mesh.fan_offsets).max() == 500
    assert len(mesh.vertices) == 1501


@pytest.mark.parametrize("model", [*models.MODELS.values(), models.moebius, models.lens], ids=lambda m: m.__name__)
def test_models_come_out_the_same_every_time(model):
    one, two = model(), model()
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])
