"""Rims of few sides: coarse CAD tessellations of tubes, nuts and holes keep them sharp."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.mesh.potential_creases import dihedrals, potential_creases
from sparse_surface.solver.mesh.triangle_mesh import build_mesh

Faces = list[list[int]]


def ring(sides: int, radius: float, z: float) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(sides, z)])


def nut(sides: int, rows: int) -> tuple[np.ndarray, Faces]:
    """A ring with flat walls, inside and outside, each `rows` quads high."""
    heights = np.linspace(0.0, 1.0, rows + 1)
    vertices = np.concatenate([ring(sides, radius, z) for radius in (1.0, 0.5) for z in heights])
    own = np.arange(sides)
    following, inner = (own + 1) % sides, (rows + 1) * sides
    quads = []
    for low in sides * np.arange(rows):
        quads.append(low + np.column_stack([own, following, sides + following, sides + own]))
        quads.append(inner + low + np.column_stack([following, own, sides + own, sides + following]))
    top = rows * sides
    quads.append(np.column_stack([top + own, top + following, inner + top + following, inner + top + own]))
    quads.append(np.column_stack([following, own, inner + own, inner + following]))
    return vertices, np.concatenate(quads).tolist()


def plate(sides: int) -> tuple[np.ndarray, Faces]:
    """A square plate of thickness 0.2 with a hole of some sides; each face is fanned between hole and outline."""
    outline = 3.0 * np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]], dtype=float)
    flat = np.concatenate([ring(sides, 1.0, 0.0)[:, :2], outline])
    angle = np.arctan2(flat[:, 1], flat[:, 0]) % (2.0 * np.pi)
    triangles, hole, far = [], 0, 0
    while hole < sides or far < 8:
        last = angle[sides + (far + 1) % 8] + 2.0 * np.pi * (far + 1 >= 8)
        if far < 8 and (hole == sides or last <= 2.0 * np.pi * (hole + 1) / sides):
            triangles.append([hole % sides, sides + far, sides + (far + 1) % 8])
            far += 1
        else:
            triangles.append([hole % sides, sides + far % 8, (hole + 1) % sides])
            hole += 1
    count = len(flat)
    walls = [[a, b, b + count, a + count] for a, b in zip(range(sides), np.roll(range(sides), -1), strict=True)]
    rim = range(sides, count)
    walls += [[b, a, a + count, b + count] for a, b in zip(rim, np.roll(rim, -1), strict=True)]
    vertices = np.concatenate([np.column_stack([flat, np.full(count, z)]) for z in (0.2, 0.0)])
    below = [[c + count, b + count, a + count] for a, b, c in triangles]
    return vertices, triangles + below + [[int(v) for v in wall] for wall in walls]


def cut(vertices: np.ndarray, faces: Faces) -> tuple[set[tuple[int, int]], float]:
    """Edges that were cut, and the largest error."""
    result = approximate(vertices, faces, Settings(workers=1))
    edges = {(int(a), int(b)) for a, b in np.sort(result.representation.creases, axis=1)}
    return edges, result.report["surface_error"]["max"]


def bent(vertices: np.ndarray, faces: Faces, degrees: float) -> set[tuple[int, int]]:
    mesh = build_mesh(vertices, faces)
    sharp = dihedrals(mesh) > degrees
    return {(int(a), int(b)) for a, b in np.sort(mesh.node_vertex[mesh.edges[sharp]], axis=1)}


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [nut(6, 1), nut(8, 1), plate(6), plate(8), plate(4)],
    ids=["hexagonal tube", "octagonal nut", "hexagonal hole", "octagonal hole", "square hole"],
)
def test_coarse_parts_are_exact(vertices: np.ndarray, faces: Faces) -> None:
    edges, largest = cut(vertices, faces)
    assert edges == bent(vertices, faces, 40.0)
    assert largest < 1e-5 * np.ptp(vertices)


@pytest.mark.parametrize(("sides", "rows"), [(5, 3), (6, 4), (8, 2)])
def test_rims_are_sharp_whatever_the_walls_may_mean(sides: int, rows: int) -> None:
    edges, _ = cut(*nut(sides, rows))
    assert edges == bent(*nut(sides, rows), 80.0)
    assert len(edges) == 4 * sides


def test_a_rim_that_is_not_steep_all_along_or_has_no_flat_face_is_none() -> None:
    vertices, faces = nut(6, 4)
    vertices[4 * 6] += [0.0, 0.0, -0.2]  # the rim is no longer flat at one corner
    found = potential_creases(build_mesh(vertices, faces)).edges
    assert found.sum() == 12  # both rims at the other end
    random = np.random.default_rng(1)
    uneven = nut(6, 4)[0] + 0.02 * random.normal(size=vertices.shape)
    assert not potential_creases(build_mesh(uneven, faces)).edges.any()
