"""Domains against closed forms, dense solutions of the defining equations, and on meshes that break maps."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.mesh.normals import triangle_areas
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh
from sparse_surface.solver.patches import linear_systems
from sparse_surface.solver.patches import parameterisation as module
from sparse_surface.solver.patches.cover import build_cover
from sparse_surface.solver.patches.loops import boundary_loops
from sparse_surface.solver.patches.parameterisation import (
    METHODS,
    domain_quality,
    initial_domains,
    solve_initial_domains,
)
from sparse_surface.solver.patches.patches import Patches, build_patches
from sparse_surface.solver.patches.splitting import with_domains
from sparse_surface.solver.settings import Settings


def patches_of(mesh: TriangleMesh, ring: int = 7) -> Patches:
    return build_patches(mesh, build_cover(mesh, ring), ring)


def one_patch(vertices: np.ndarray, faces: np.ndarray) -> tuple[TriangleMesh, Patches]:
    """Return a mesh that is one patch as a whole, with local numbers equal to the mesh's."""
    mesh = build_mesh(vertices, faces)
    patches = patches_of(mesh, 50)
    assert len(patches) == 1
    np.testing.assert_array_equal(patches.vertices, np.arange(len(vertices)))
    return mesh, patches


def squeeze(mesh: TriangleMesh, patches: Patches, points: np.ndarray) -> np.ndarray:
    return domain_quality(mesh, patches, points).squeeze


def areas_of(points: np.ndarray, patches: Patches) -> np.ndarray:
    a, b, c = (points[patches.block_triangles[:, i]] for i in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def flat_sheet() -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = models.creased_terrain(150)
    return vertices * [1.0, 1.0, 0.0], faces


def curved() -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = models.creased_terrain(196)
    x, y = 0.4 * vertices[:, 0], 0.4 * vertices[:, 1]
    return np.column_stack((x, y, np.sin(x) + 0.5 * np.cos(1.3 * y))), faces


def similar(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Move, turn and scale `two` onto `one` (no mirror), and return what is left."""
    z, w = (points @ [1, 1j] for points in (one, two))
    design = np.column_stack((w, np.ones(len(w))))
    return design @ np.linalg.lstsq(design, z, rcond=None)[0] - z


# ------------------------------------------------------------------------------------------------------- closed forms


def test_conformal_map_of_a_flat_sheet_is_the_sheet():
    vertices, faces = flat_sheet()
    mesh, patches = one_patch(vertices, faces)
    points = initial_domains(mesh, patches)
    assert np.abs(similar(vertices[:, :2], points)).max() < 1e-9
    assert np.abs(np.linalg.norm(points[0] - points[50]) - np.linalg.norm(vertices[0] - vertices[50])) < 1e-9


def test_conformal_map_unrolls_what_can_be_unrolled():
    across, along = np.divmod(np.arange(12 * 9), 9)
    angle = 0.4 * across
    rolled = np.column_stack((np.cos(angle) / (2 * np.sin(0.2)), np.sin(angle) / (2 * np.sin(0.2)), along))
    number = np.arange(12 * 9).reshape(12, 9)
    quads = np.stack((number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]), axis=-1).reshape(-1, 4)
    mesh, patches = one_patch(rolled, quads)
    found = solve_initial_domains(mesh, patches)
    assert np.abs(similar(np.column_stack((across, along)), found.points)).max() < 1e-9
    assert squeeze(mesh, patches, found.points) == pytest.approx(1.0)


def test_tutte_puts_each_vertex_in_the_middle_of_its_neighbours():
    mesh, patches = one_patch(*curved())
    points = initial_domains(mesh, patches, "tutte")
    inner = ~mesh.border
    average = (mesh.adjacency @ points) / mesh.adjacency.sum(axis=1)[:, None]
    np.testing.assert_allclose(points[inner], average[inner], atol=1e-10)


@pytest.mark.parametrize("method", ["harmonic", "tutte"])
def test_the_border_is_a_circle_by_arc_length(method):
    vertices, faces = curved()
    mesh, patches = one_patch(vertices, faces)
    points = initial_domains(mesh, patches, method)
    outer, _ = boundary_loops(patches)
    loop = points[outer.vertices]
    # The centre of the circle, which centring has moved away from 0.
    design = np.column_stack((2 * loop, np.ones(len(loop))))
    x, y, _ = np.linalg.lstsq(design, (loop**2).sum(axis=1), rcond=None)[0]
    spokes = (loop - [x, y]) @ [1, 1j]
    np.testing.assert_allclose(np.abs(spokes), np.abs(spokes[0]))
    steps = np.angle(np.roll(spokes, -1) / spokes)
    lengths = np.linalg.norm(vertices[outer.following] - vertices[outer.vertices], axis=1)
    np.testing.assert_allclose(steps, 2 * np.pi * lengths / lengths.sum())


# ------------------------------------------------------------------------------------------------------ dense equations


def test_conformal_map_agrees_with_the_printed_least_squares():
    """Levy et al. 2002, eq. 4: one complex row a triangle, two vertices held."""
    vertices, faces = curved()
    mesh, patches = one_patch(vertices, faces)
    points = initial_domains(mesh, patches)
    corners = vertices[mesh.triangles]
    along = corners[:, 1] - corners[:, 0]
    length = np.linalg.norm(along, axis=1)
    x = ((corners[:, 2] - corners[:, 0]) * along).sum(axis=1) / length
    double_area = np.linalg.norm(np.cross(along, corners[:, 2] - corners[:, 0]), axis=1)
    local = np.column_stack((np.zeros(len(x)), length, x + 1j * double_area / length))
    rows = np.zeros((len(mesh.triangles), len(vertices)), dtype=complex)
    for i in range(3):
        weight = (local[:, (i + 2) % 3] - local[:, (i + 1) % 3]) / np.sqrt(double_area)
        rows[np.arange(len(rows)), mesh.triangles[:, i]] = weight
    outer, _ = boundary_loops(patches)
    held = np.array([part[0] for part in module._far_apart(outer, vertices)])
    z = points @ [1, 1j]
    free = np.setdiff1d(np.arange(len(vertices)), held)
    expected = np.linalg.lstsq(rows[:, free], -rows[:, held] @ z[held], rcond=None)[0]
    np.testing.assert_allclose(z[free], expected, atol=1e-8)


def test_harmonic_map_agrees_with_a_dense_laplacian_of_angles():
    vertices, faces = curved()
    mesh, patches = one_patch(vertices, faces)
    points = initial_domains(mesh, patches, "harmonic")
    laplacian = np.zeros((len(vertices),) * 2)
    for triangle in mesh.triangles:
        for i in range(3):
            apex, one, two = triangle[[i, (i + 1) % 3, (i + 2) % 3]]
            p, q = vertices[one] - vertices[apex], vertices[two] - vertices[apex]
            weight = 0.5 / np.tan(np.arccos(p @ q / np.linalg.norm(p) / np.linalg.norm(q)))
            laplacian[[one, two], [two, one]] -= weight
            laplacian[[one, two], [one, two]] += weight
    inner, border = ~mesh.border, mesh.border
    expected = np.linalg.solve(laplacian[np.ix_(inner, inner)], -laplacian[np.ix_(inner, border)] @ points[border])
    np.testing.assert_allclose(points[inner], expected, atol=1e-9)


# ---------------------------------------------------------------------------------------------- many patches, hard ones


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "model",
    [models.cube, models.cubetorus, models.lens, models.tetrahedron, models.cube98, models.tube, models.thin_torus,
     models.moebius, models.klein_bottle, lambda: models.pole(300, 4)],
)  # fmt: skip
def test_domains_are_upright_centred_and_of_the_surfaces_area(model, method):
    mesh = build_mesh(*model())
    patches = patches_of(mesh)
    assert_good(mesh, patches, initial_domains(mesh, patches, method))


@pytest.mark.parametrize("name", ["fandisk.obj", "rocker-arm.obj", "teapot.obj", "beetle.obj"])
@pytest.mark.parametrize("method", METHODS)
def test_domains_of_real_models(load_model, name, method):
    mesh = build_mesh(*load_model(name))
    patches = patches_of(mesh)
    assert_good(mesh, patches, initial_domains(mesh, patches, method))


def assert_good(mesh: TriangleMesh, patches: Patches, points: np.ndarray) -> None:
    areas = areas_of(points, patches)
    assert np.isfinite(points).all()
    assert areas.min() > 0
    total, surface = (
        np.bincount(patches.triangle_patch, weights=a)
        for a in (areas, triangle_areas(mesh.vertices, mesh.triangles)[patches.mesh_triangles])
    )
    np.testing.assert_allclose(total, surface, rtol=2e-2)  # needles are given a little more area than they have
    centre = np.add.reduceat(points, patches.vertex_offsets[:-1]) / np.diff(patches.vertex_offsets)[:, None]
    assert np.abs(centre).max() < 1e-9 * np.abs(points).max()


def test_a_finger_is_squeezed_and_that_is_told():
    vertices, faces = models.finger(5)
    mesh = build_mesh(vertices, faces)
    foot = np.array([7 * 16 + 7])
    patches = build_patches(mesh, foot, 7)
    assert len(vertices) - 1 in patches.vertices[: patches.vertex_offsets[1]]
    squeezed = squeeze(mesh, patches, initial_domains(mesh, patches))
    assert squeezed[0] < 0.1
    flat_mesh, flat_patches = one_patch(*flat_sheet())
    assert squeeze(flat_mesh, flat_patches, initial_domains(flat_mesh, flat_patches))[0] == pytest.approx(1.0)


def test_squeeze_is_what_a_loop_over_patches_says():
    mesh = build_mesh(*models.lens())
    patches = patches_of(mesh)
    points = initial_domains(mesh, patches, "tutte")
    ratio = areas_of(points, patches) / triangle_areas(mesh.vertices, mesh.triangles)[patches.mesh_triangles]
    for k, value in enumerate(squeeze(mesh, patches, points)):
        ranked = np.sort(ratio[patches.triangle_offsets[k] : patches.triangle_offsets[k + 1]])
        last = len(ranked) - 1
        assert value == pytest.approx(ranked[int(0.02 * last)] / ranked[last // 2])


@pytest.mark.parametrize("method", METHODS)
def test_a_finger_that_no_domain_can_hold_is_split(method):
    mesh = build_mesh(*models.finger(30, 41))
    patches = patches_of(mesh, 30)
    domains = initial_domains(mesh, patches, method)
    assert domain_quality(mesh, patches, domains).unusable.any()
    settings = Settings(ring=30, initial_domain=method, adaptive=False)
    split, domains = with_domains(mesh, patches, settings)
    assert not domain_quality(mesh, split, domains).unusable.any()
    assert not split.passed_through.any()
    assert areas_of(domains, split).min() > 0
    assert split.rings.max() == 30  # the others stay


def test_what_a_method_turns_over_or_flattens_gets_the_next_one(monkeypatch):
    """The first two methods are made to fail; the third still has to give a map without flips."""
    mesh = build_mesh(*models.lens())
    patches = patches_of(mesh)
    monkeypatch.setitem(module._SOLVERS, "lscm", lambda part, geometry: geometry.positions[:, :2] * [1.0, 0.0])
    found = solve_initial_domains(mesh, patches)
    assert (found.method == METHODS.index("harmonic")).all()
    mirrored = module._SOLVERS["harmonic"]
    monkeypatch.setitem(module._SOLVERS, "harmonic", lambda *given: mirrored(*given) * [1.0, -1.0])
    found = solve_initial_domains(mesh, patches)
    assert (found.method == METHODS.index("tutte")).all()
    assert areas_of(found.points, patches).min() > 0


def test_of_maps_that_all_fail_the_least_bad_stays(monkeypatch):
    """The first and the last map turn triangles over; the second one squeezes them flat, which is less bad."""
    mesh = build_mesh(*models.lens())
    patches = patches_of(mesh)
    turned, flat = (initial_domains(mesh, patches) * scale for scale in ([1.0, -1.0], [1.0, 0.0]))
    for method, points in (("lscm", turned), ("harmonic", flat), ("tutte", turned)):
        monkeypatch.setitem(module._SOLVERS, method, lambda part, _, points=points: points[: len(part.vertices)])
    found = solve_initial_domains(mesh, patches)
    assert (found.method == METHODS.index("harmonic")).all()
    assert np.abs(areas_of(found.points, patches)).max() < 1e-12


def test_only_the_patches_that_failed_are_solved_again(monkeypatch):
    mesh = build_mesh(*models.cube())
    patches = patches_of(mesh)
    good = initial_domains(mesh, patches)
    chosen = patches.vertex_patch == 5
    monkeypatch.setitem(
        module._SOLVERS, "lscm", lambda part, geometry: np.where(chosen[:, None], good * [1.0, -1.0], good)
    )
    found = solve_initial_domains(mesh, patches)
    np.testing.assert_array_equal(found.method, np.where(np.arange(len(patches)) == 5, METHODS.index("harmonic"), 0))
    np.testing.assert_allclose(found.points[~chosen], good[~chosen], atol=1e-12)
    harmonic = initial_domains(mesh, patches, "harmonic")
    np.testing.assert_allclose(found.points[chosen], harmonic[chosen], atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damage", ["needles", "same place", "flat triangles"])
def test_degenerate_triangles_have_an_area_in_the_domain(method, damage):
    vertices, faces = models.cube(8)
    rng = np.random.default_rng(3)
    mesh = build_mesh(vertices, faces)
    moved = rng.choice(len(mesh.edges), 12, replace=False)
    one, two = mesh.edges[moved].T
    share = {"needles": 1e-7, "same place": 0.0, "flat triangles": 0.5}[damage]
    if damage == "flat triangles":
        opposite = mesh.nodes[mesh.edge_triangles[moved, 0]].sum(axis=1) - one - two
        vertices[opposite] = share * vertices[one] + (1 - share) * vertices[two]
    else:
        vertices[one] = vertices[two] + share * (vertices[one] - vertices[two])
    mesh = build_mesh(vertices, faces)
    patches = patches_of(mesh, 4)
    points = initial_domains(mesh, patches, method)
    assert np.isfinite(points).all()
    assert areas_of(points, patches).min() > 0
    assert np.isfinite(squeeze(mesh, patches, points)).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("missing", [1, 6])
def test_small_holes_stay_holes(method, missing):
    vertices, faces = models.creased_terrain(900)
    star = np.flatnonzero((faces == 15 * 30 + 15).any(axis=1))
    mesh = build_mesh(vertices, np.delete(faces, star if missing == 6 else star[:1], axis=0))
    patches = patches_of(mesh)
    _, holes = boundary_loops(patches)
    points = initial_domains(mesh, patches, method)
    assert areas_of(points, patches).min() > 0
    for i in range(len(holes.patch)):
        x, y = points[holes.vertices[holes.offsets[i] : holes.offsets[i + 1]]].T
        assert np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)) < 0  # run around the other way: it is open


@pytest.mark.parametrize("method", METHODS[1:])
@pytest.mark.parametrize("shear", [0.0, 2.0, 5.0])
def test_a_skewed_slit_keeps_its_triangles_open(method, shear):
    """Without a vertex that spans it, the sides of a slit of 13 edges fall onto each other."""
    vertices, faces = models.creased_terrain(900)
    step = np.abs(np.diff(vertices[:30, :2], axis=0)).max()
    away = np.abs(vertices[faces].mean(axis=1) - vertices[15 * 30 + 15]) / step
    faces = faces[(away[:, 0] >= 2.5) | (away[:, 1] >= 0.5)]
    mesh = build_mesh(
        np.column_stack([vertices[:, 0] + shear * vertices[:, 1], vertices[:, 1], 0 * vertices[:, 0]]), faces
    )
    patches = patches_of(mesh)
    _, holes = boundary_loops(patches)
    assert np.diff(holes.offsets).tolist() == [13]
    found = solve_initial_domains(mesh, patches, method)
    assert (found.method == METHODS.index(method)).all()
    assert areas_of(found.points, patches).min() > 1e-3 * triangle_areas(mesh.vertices, mesh.triangles).max()


def test_size_and_position_make_no_difference():
    vertices, faces = models.lens(10)
    mesh = build_mesh(vertices, faces)
    patches = patches_of(mesh)
    points = initial_domains(mesh, patches)
    for scale in (1e-6, 1e6):
        other = initial_domains(build_mesh(vertices * scale + scale, faces), patches)
        np.testing.assert_allclose(other / scale, points, atol=1e-7)


@pytest.mark.parametrize(("where", "name", "value"), [(module, "_CHUNK", 300), (linear_systems, "_WIDEST_BAND", 0)])
def test_chunks_and_factorisations_agree(monkeypatch, where, name, value):
    mesh = build_mesh(*models.cubetorus())
    patches = patches_of(mesh)
    expected = {method: solve_initial_domains(mesh, patches, method) for method in METHODS}
    monkeypatch.setattr(where, name, value)
    for method in METHODS:
        found = solve_initial_domains(mesh, patches, method)
        np.testing.assert_allclose(found.points, expected[method].points, atol=1e-10)
        np.testing.assert_array_equal(found.method, expected[method].method)
    np.testing.assert_allclose(squeeze(mesh, patches, found.points), squeeze(mesh, patches, expected["tutte"].points))


def test_no_patches_have_no_domains():
    mesh = build_mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]])
    patches = patches_of(mesh)
    assert initial_domains(mesh, patches).shape == (0, 2)
    assert squeeze(mesh, patches, np.zeros((0, 2))).shape == (0,)
