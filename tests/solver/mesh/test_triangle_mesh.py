"""Triangulation and topology against brute force over Python sets."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.mesh.normals import triangle_areas
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh
from sparse_surface.solver.mesh.triangulation import clip_ears, triangulate

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def shoelace(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def flat_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def one_polygon(points: np.ndarray, corners: list[int] | None = None) -> np.ndarray:
    corners = list(range(len(points))) if corners is None else corners
    flat = np.column_stack((points, np.zeros(len(points)))) if points.shape[1] == 2 else points
    return triangulate(flat, np.array(corners), np.array([0, len(corners)]))[0]


def assert_manifold(mesh: TriangleMesh) -> None:
    """Each edge has at most two triangles, each node one fan, neighbours agree with a plain list of triangles."""
    at_edge, neighbours, fans = defaultdict(list), defaultdict(set), defaultdict(list)
    for t, (corners, edges) in enumerate(zip(mesh.nodes.tolist(), mesh.triangle_edges.tolist(), strict=True)):
        if mesh.collapsed[t]:
            assert edges == [-1, -1, -1]
            continue
        for i in range(3):
            a, b = corners[i], corners[(i + 1) % 3]
            assert set(mesh.edges[edges[i]].tolist()) == {a, b}
            at_edge[edges[i]].append(t)
            neighbours[a].add(b)
            neighbours[b].add(a)
            fans[a].append(t)
    assert len(at_edge) == len(mesh.edges)
    for edge, triangles in at_edge.items():
        expected = [*triangles, -1] if len(triangles) == 1 else triangles
        assert sorted(mesh.edge_triangles[edge].tolist()) == sorted(expected)
    for node in range(mesh.node_count):
        row = mesh.adjacency.indices[mesh.adjacency.indptr[node] : mesh.adjacency.indptr[node + 1]]
        assert set(row.tolist()) == neighbours[node]
        fan = mesh.fan_triangles[mesh.fan_offsets[node] : mesh.fan_offsets[node + 1]].tolist()
        assert sorted(fan) == sorted(fans[node])
        assert len(pieces_of_fan(mesh, node, fan)) <= 1
        assert mesh.border[node] == any(
            node in mesh.edges[e] and mesh.edge_triangles[e, 1] < 0 for t in fan for e in mesh.triangle_edges[t]
        )


def pieces_of_fan(mesh: TriangleMesh, node: int, fan: list[int]) -> list[set[int]]:
    """Group the triangles of a node by the edges at that node which they share."""
    pieces: list[set[int]] = []
    for t in fan:
        edges = {e for e in mesh.triangle_edges[t].tolist() if node in mesh.edges[e]}
        touching = [piece for piece in pieces if any(edges & set(mesh.triangle_edges[o].tolist()) for o in piece)]
        pieces = [piece for piece in pieces if piece not in touching] + [{t}.union(*touching)]
    return pieces


# ------------------------------------------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (np.zeros((0, 3)), [[0, 1, 2]], "no vertices"),
        (SQUARE, [], "no faces"),
        (SQUARE, np.zeros((0, 3), dtype=int), "no faces"),
        (SQUARE, np.zeros(0, dtype=int), "no faces"),
        ([[0, 0, 0], [1, 0, np.nan], [0, 1, 0]], [[0, 1, 2]], "Vertex 1"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], "Vertex 2"),
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]], "no area"),
        (np.zeros((3, 3)), [[0, 1, 2]], "no area"),
        (SQUARE, [[0, 1, 1]], "no area"),
        (SQUARE, [[0, 1, 4]], "vertex 4"),
        (SQUARE, [[0, 1, -1]], "vertex -1"),
        (SQUARE, [[0, 1]], "fewer than three"),
        (SQUARE, [[0, 1, 2], []], "Face 1"),
        (SQUARE[:, :2], [[0, 1, 2]], "three numbers"),
        ("vertices", [[0, 1, 2]], "three numbers"),
        (SQUARE, [[0.0, 1.0, 2.0]], "whole numbers"),
        (SQUARE, np.array([[0.0, 1.0, 2.0]]), "whole numbers"),
        (SQUARE, 7, "list of polygons"),
        (SQUARE, [1, 2, 3], "list of polygons"),
        (SQUARE, np.array([0, 1, 2]), "list of polygons"),
        (SQUARE * 1e-61, [[0, 1, 2]], "no area"),
        ([[-1.7e308, 0, 0], [1.7e308, 0, 0], [0, 1.7e308, 0]], [[0, 1, 2]], "too large"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(vertices, faces, said):
    with pytest.raises(InputError) as caught:
        build_mesh(vertices, faces)
    message = str(caught.value)
    assert said in message
    assert message.endswith(".")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("triangles", "said"),
    [
        (([[0, 1, 2]], [0, 0]), "face of each"),
        (([[0, 1]], [0]), "three vertices"),
        (([[0, 1, 9]], [0]), "vertex 9"),
        (([[0, 1, 2]], [1]), "does not exist"),
        (([[0, 1, 2]], [-1]), "does not exist"),
        ((np.zeros((0, 3), dtype=int), np.zeros(0, dtype=int)), "no faces"),
    ],
)
def test_a_triangulation_that_does_not_fit_is_refused(triangles, said):
    with pytest.raises(InputError, match=said):
        build_mesh(SQUARE, [[0, 1, 2, 3]], triangles)


@pytest.mark.parametrize("scale", [1e-59, 1e-9, 1.0, 1e9, 1e59])
def test_any_other_size_will_do(scale):
    mesh = build_mesh(SQUARE * scale, [[3, 2, 1], [0, 1, 3]])
    assert np.isfinite(triangle_areas(mesh.vertices, mesh.triangles)).all()
    assert (mesh.winding == mesh.winding[0] * [1, -1]).all()


def test_the_input_is_not_touched():
    vertices, faces = SQUARE.astype(np.float32), np.array([[0, 1, 2, 3]])
    mesh = build_mesh(vertices, faces)
    mesh.vertices[:] = 7.0
    mesh.triangles[:] = 0
    np.testing.assert_array_equal(vertices, SQUARE)
    np.testing.assert_array_equal(faces, [[0, 1, 2, 3]])


# -------------------------------------------------------------------------------------------------- triangulation


def test_a_handed_over_triangulation_is_kept_in_order():
    corners, polygon = [[2, 3, 0], [0, 1, 2]], [0, 0]
    mesh = build_mesh(SQUARE, [[0, 1, 2, 3]], (corners, polygon))
    np.testing.assert_array_equal(mesh.triangles, corners)
    np.testing.assert_array_equal(mesh.polygon, polygon)
    assert mesh.polygon_count == 1


def test_lists_and_arrays_of_polygons_give_the_same():
    vertices, faces = models.cube(4)
    one, two, three = (build_mesh(vertices, f) for f in (faces, faces.tolist(), list(faces)))
    np.testing.assert_array_equal(one.triangles, two.triangles)
    np.testing.assert_array_equal(one.triangles, three.triangles)
    np.testing.assert_array_equal(one.polygon, np.repeat(np.arange(len(faces)), 2))


@pytest.mark.parametrize("start", range(4))
def test_a_concave_quad_is_split_through_its_concave_corner(start):
    points = np.roll([[0.0, 0], [2, 0], [0.5, 0.5], [0, 2]], start, axis=0)
    triangles = one_polygon(points)
    areas = flat_areas(points, triangles)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(shoelace(points))


@given(st.integers(5, 40), st.integers(0, 2**32 - 1), st.booleans())
def test_star_shaped_polygons_are_filled_exactly(size, seed, tilted):
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(size) + rng.uniform(0.1, 0.9, size)) / size
    points = (rng.uniform(0.3, 1.0, size) * np.stack((np.cos(angle), np.sin(angle)))).T
    space = np.column_stack((points, np.zeros(size)))
    if tilted:
        space = space @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + 5.0
    triangles = one_polygon(space)
    areas = flat_areas(points, triangles)
    assert len(triangles) == size - 2
    assert areas.min() > -1e-12
    assert areas.sum() == pytest.approx(shoelace(points))


def test_a_hole_joined_by_a_bridge_stays_open():
    outer = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    inner = np.array([[1.0, 1], [1, 3], [3, 3], [3, 1]])  # clockwise
    points = np.concatenate((outer, inner))
    corners = [0, 1, 2, 3, 0, 4, 5, 6, 7, 4]
    triangles = one_polygon(points, corners)
    areas = flat_areas(points, triangles)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(12.0)
    mesh = build_mesh(np.column_stack((points, np.zeros(8))), [corners])
    assert mesh.border.sum() == 8  # the bridge is inside the surface


def test_a_comb_of_a_thousand_corners():
    teeth = 250
    x = np.repeat(np.arange(teeth, dtype=float), 2) + np.tile([0.0, 0.5], teeth)
    top = np.column_stack((x, np.tile([10.0, 1.0], teeth)))[::-1]
    bottom = np.column_stack((x, np.full(2 * teeth, 0.0)))
    points = np.concatenate((bottom, top))
    areas = flat_areas(points, clip_ears(points))
    assert areas.min() >= -1e-9
    assert areas.sum() == pytest.approx(shoelace(points))


def test_a_spiral_corridor():
    turn = np.linspace(0, 12 * np.pi, 500)
    inner = (1 + turn) * np.stack((np.cos(turn), np.sin(turn)))
    outer = (3 + turn) * np.stack((np.cos(turn), np.sin(turn)))
    points = np.concatenate((outer.T, inner.T[::-1]))
    triangles = clip_ears(points)
    areas = flat_areas(points, triangles)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(shoelace(points))


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((7, 2)),  # all at one place
        np.column_stack((np.arange(7.0), np.zeros(7))),  # on a line
        np.array([[0.0, 0], [1, 1], [1, 0], [0, 1], [2, 0.5], [0.5, 2]]),  # crossing itself
    ],
)
def test_hopeless_polygons_still_have_all_their_triangles(points):
    triangles = one_polygon(points)
    assert triangles.shape == (len(points) - 2, 3)
    assert set(np.unique(triangles)) == set(range(len(points)))


def test_repeated_corners_are_skipped():
    faces = [[0, 1, 1, 2], [0, 2, 3, 3, 0], [1, 1, 1, 2], [2, 2, 2]]
    mesh = build_mesh(SQUARE, faces)
    np.testing.assert_array_equal(mesh.polygon, [0, 1])
    assert mesh.polygon_count == 4
    assert triangle_areas(mesh.vertices, mesh.triangles).sum() == pytest.approx(1.0)
    assert not mesh.collapsed.any()


# ------------------------------------------------------------------------------------------------------- topology

EULER = {
    models.cube: 2,
    models.cubetorus: 0,
    models.cylinder: 2,
    models.lens: 2,
    models.l_solid: 2,
    models.tetrahedron: 2,
    models.tube: 0,
    models.thin_torus: 0,
    models.moebius: 0,
    models.klein_bottle: 0,
}


@pytest.mark.parametrize("model", EULER, ids=lambda model: model.__name__)
def test_manifold_models_are_not_cut(model):
    mesh = build_mesh(*model())
    assert mesh.node_count == len(mesh.vertices)
    assert not mesh.passed_through.any()
    assert mesh.component_count == 1
    assert mesh.node_count - len(mesh.edges) + len(mesh.triangles) == EULER[model]
    assert_manifold(mesh)


def test_the_border_of_a_strip_is_its_border():
    mesh = build_mesh(*models.moebius(30, 5))
    across = np.arange(len(mesh.vertices)) % 5
    np.testing.assert_array_equal(mesh.border, (across == 0) | (across == 4))
    loop, sides = mesh.border_loops
    assert sides.tolist() == [60]  # one border, twice around
    np.testing.assert_array_equal(loop >= 0, mesh.edge_triangles[:, 1] < 0)


def test_a_fin_is_cut_off_and_the_wall_stays_whole():
    wall, quads = models.creased_terrain(100)
    row = np.arange(40, 50)  # one row of vertices in the middle
    fin = wall[row] + [0.0, 0.0, 30.0]
    number = np.arange(100, 110)
    strip = np.column_stack((row[:-1], row[1:], number[1:]))
    strip = np.concatenate((strip, np.column_stack((row[:-1], number[1:], number[:-1]))))
    mesh = build_mesh(np.concatenate((wall, fin)), np.concatenate((quads, strip)))
    assert_manifold(mesh)
    assert mesh.component_count == 2
    of_wall = mesh.component[mesh.nodes[: len(quads)]]
    assert (of_wall == of_wall[0, 0]).all()
    np.testing.assert_array_equal(np.flatnonzero(mesh.passed_through), row)
    assert mesh.node_count == 110 + len(row)
    np.testing.assert_array_equal(np.sort(mesh.node_vertex[110:]), row)


def test_a_bow_tie_is_taken_apart():
    vertices, faces = models.tetrahedron()
    both = np.concatenate((vertices, vertices[1:] + 2 * (vertices[0] - vertices[1:])))
    other = np.where(faces == 0, 0, faces + 3)
    mesh = build_mesh(both, np.concatenate((faces, other[:, ::-1])))
    assert_manifold(mesh)
    assert mesh.component_count == 2
    assert np.flatnonzero(mesh.passed_through).tolist() == [0]
    assert mesh.node_vertex[len(both) :].tolist() == [0]


def test_a_book_of_many_pages_is_cut_at_its_spine():
    pages = 12
    angle = 2 * np.pi * np.arange(pages) / pages
    vertices = np.concatenate(([[0.0, 0, 0], [0, 0, 1]], np.column_stack((np.cos(angle), np.sin(angle), 0 * angle))))
    mesh = build_mesh(vertices, [[0, 1, 2 + page] for page in range(pages)])
    assert_manifold(mesh)
    assert (mesh.edge_triangles[:, 1] < 0).all()
    assert np.flatnonzero(mesh.passed_through).tolist() == [0, 1]


def test_triangles_on_top_of_each_other_are_cut_apart():
    vertices, faces = models.tetrahedron()
    mesh = build_mesh(vertices, np.concatenate((faces, faces[:1])))
    assert_manifold(mesh)
    assert np.flatnonzero(mesh.passed_through).tolist() == [0, 1, 2]


def test_collapsed_triangles_take_no_part():
    vertices, faces = models.tetrahedron()
    corners = np.concatenate((faces, [[0, 0, 1]]))
    mesh = build_mesh(np.concatenate((vertices, [[9.0, 9, 9]])), faces, (corners, np.zeros(5, dtype=int)))
    assert mesh.collapsed.tolist() == [False] * 4 + [True]
    assert mesh.passed_through.tolist() == [True, True, False, False, True]  # the last belongs to no face
    assert_manifold(mesh)


def test_loose_vertices_stay_alone():
    vertices, faces = models.tetrahedron()
    mesh = build_mesh(np.concatenate(([[9.0, 9, 9]], vertices)), faces + 1)
    assert mesh.used.tolist() == [False, True, True, True, True]
    assert mesh.passed_through.tolist() == [True, False, False, False, False]
    assert mesh.component_count == 2


@given(st.integers(0, 2**32 - 1))
def test_scrambled_windings_are_put_right(seed):
    vertices, faces = models.sphere(4)
    flipped = np.random.default_rng(seed).random(len(faces)) < 0.4
    mixed = np.where(flipped[:, None], faces[:, ::-1], faces)
    mesh = build_mesh(vertices, mixed)
    oriented = np.where((mesh.winding > 0)[:, None], mixed, mixed[:, ::-1])
    a, b, c = (vertices[oriented[:, i]] for i in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    expected = 4 / 3 * np.pi * (1 if triangle_areas(vertices, faces)[flipped].sum() < 2 * np.pi else -1)
    assert volume == pytest.approx(expected, rel=0.1)


def test_one_sided_surfaces_have_no_winding():
    vertices, faces = models.moebius(30, 5)
    sphere, sphere_faces = models.sphere(3)
    mesh = build_mesh(
        np.concatenate((vertices, sphere + 9)), [*faces.tolist(), *(sphere_faces + len(vertices)).tolist()]
    )
    one_sided = mesh.polygon < len(faces)
    assert (mesh.winding[one_sided] == 0).all()
    assert (mesh.winding[~one_sided] == 1).all()


@given(
    arrays(np.int64, st.tuples(st.integers(1, 30), st.integers(3, 5)), elements=st.integers(0, 11)),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
def test_any_soup_of_polygons_becomes_a_manifold(faces, seed, flat):
    points = np.random.default_rng(seed).normal(size=(12, 3)).round(0 if flat else 9)
    try:
        mesh = build_mesh(points, faces)
    except InputError:
        return
    assert_manifold(mesh)
    np.testing.assert_array_equal(mesh.node_vertex[mesh.nodes], mesh.triangles)
    assert mesh.passed_through[mesh.node_vertex[12:]].all()
