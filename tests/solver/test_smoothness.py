"""By how much the surface bends at edges, against finite differences in a loop, and against the input's creases."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import cube, moebius, sphere
from sparse_surface.benchmarks.smoothness import Bends, bends
from sparse_surface.solver import Representation, Settings, approximate

QUICK = Settings(ring=2, degree=8, sparsity=8, iterations=3, sweeps=0, workers=1)
MODELS = {"cube": lambda: cube(4), "moebius": lambda: moebius(18, 4)}


@cache
def representation(name: str) -> Representation:
    return approximate(*MODELS[name](), QUICK).representation


def by_hand(surface: Representation) -> dict[tuple[int, int], tuple[float, float, bool]]:
    """Return for each edge, by its vertices: the surface's angle, the mesh's angle, and whether it is on a rim."""
    step = 1e-6
    covers = [set() for _ in surface.triangles]
    for row, triangle in enumerate(surface.mesh_triangles):
        covers[triangle].add(int(surface.patch_of_triangle[row]))
    sides: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    for number, triangle in enumerate(surface.triangles.tolist()):
        for k in range(3):
            a, b = triangle[k], triangle[(k + 1) % 3]
            sides.setdefault((min(a, b), max(a, b)), []).append(
                (number, triangle.index(min(a, b)), triangle.index(max(a, b)))
            )
    found = {}
    for edge, both in sides.items():
        if len(both) != 2:
            continue
        angles = []
        for share in (0.2, 0.5, 0.8):
            normals = []
            for number, first, second in both:
                third = 3 - first - second
                at = np.zeros(3)
                at[first], at[second] = 1.0 - share, share
                along, inwards = at.copy(), at.copy()
                along[[first, second]] += [-step, step]
                inwards[[first, third]] += [-step, step]
                point, one, other = surface.evaluate(np.full(3, number), np.stack([at, along, inwards]))
                normals.append(np.cross(one - point, other - point))
            # Edge first, inwards second: on a flat sheet the two look in opposite directions.
            cosine = -normals[0] @ normals[1] / np.linalg.norm(normals[0]) / np.linalg.norm(normals[1])
            angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
        flat = []
        for number, first, second in both:
            a, b, c = surface.vertices[surface.triangles[number][[first, second, 3 - first - second]]]
            flat.append(np.cross(b - a, c - a))
        cosine = -flat[0] @ flat[1] / np.linalg.norm(flat[0]) / np.linalg.norm(flat[1])
        rim = covers[both[0][0]] != covers[both[1][0]]
        found[edge] = float(np.mean(angles)), float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))), rim
    return found


@pytest.mark.parametrize("name", MODELS)
def test_angles_and_rims_are_those_found_by_hand(name: str) -> None:
    surface = representation(name)
    expected, found = list(by_hand(surface).values()), bends(surface)
    assert len(found.surface) == len(expected)
    assert found.on_rim.sum() == sum(rim for _, _, rim in expected)
    for rim in (False, True):
        hand = np.array([angles[:2] for *angles, on_rim in expected if on_rim == rim])
        ours = np.stack([found.surface, found.mesh], axis=1)[found.on_rim == rim]
        for column in range(2):
            np.testing.assert_allclose(np.sort(ours[:, column]), np.sort(hand[:, column]), atol=0.01)


def test_a_sphere_hardly_bends_anywhere() -> None:
    """Far less than its mesh: 2 degrees at most edges."""
    found = bends(approximate(*sphere(), Settings(workers=1, iterations=4, sweeps=0)).representation)
    assert found.mesh.min() > 1.0
    assert found.surface.max() < 0.5
    quantiles = found.quantiles()
    assert quantiles["creases, rims"] == {"surface": [], "mesh": []}
    assert quantiles["smooth, rims"]["surface"][2] < 0.2


def test_rims_bend_less_than_creases() -> None:
    found = bends(approximate(*cube(), Settings(workers=1, creases="off")).representation)
    quantiles = found.quantiles()
    for share in range(3):
        at_rims = quantiles["smooth, rims"]["surface"][share]
        assert at_rims < 0.1 * quantiles["creases, elsewhere"]["mesh"][share]
        assert at_rims < quantiles["creases, elsewhere"]["surface"][share]


def test_quantiles_are_those_of_the_groups() -> None:
    given = Bends(np.arange(8.0), np.array([0.0, 0, 0, 0, 90, 90, 90, 90]), np.array([True, False] * 4))
    found = given.quantiles((0.0, 0.5, 1.0))
    assert found["smooth, rims"] == {"surface": [0.0, 1.0, 2.0], "mesh": [0.0, 0.0, 0.0]}
    assert found["smooth, elsewhere"]["surface"] == [1.0, 2.0, 3.0]
    assert found["creases, rims"] == {"surface": [4.0, 5.0, 6.0], "mesh": [90.0, 90.0, 90.0]}
    assert found["creases, elsewhere"]["surface"] == [5.0, 6.0, 7.0]
