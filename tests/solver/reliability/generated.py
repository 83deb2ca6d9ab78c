"""Meshes that nobody would make on purpose, from a seed: shapes of every topology, then damaged in every way.

`case(seed)` is a pure function of its seed, so that a mesh on which something fails can be made again from one number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings

Floats = NDArray[np.floating[Any]]
Polygons = list[list[int]]
Random = np.random.Generator


@dataclass(frozen=True)
class Mesh:
    """A mesh and how it was made."""

    vertices: Floats
    faces: Polygons
    story: str


@dataclass(frozen=True)
class Case:
    """A mesh with the settings that it is approximated with."""

    seed: int
    mesh: Mesh
    settings: Settings


def case(seed: int) -> Case:
    """Return the generated mesh and settings of this number."""
    rng = np.random.default_rng([20260, seed])
    mesh = generated_mesh(rng)
    return Case(seed, mesh, generated_settings(rng, len(mesh.vertices)))


def generated_mesh(rng: Random) -> Mesh:
    """Return a random shape with up to four kinds of damage."""
    name, make = SHAPES[rng.integers(len(SHAPES))]
    mesh = Mesh(*make(rng), name)
    # a vertex that is not there comes last: nothing else could be done to such a mesh
    for number in sorted(
        rng.permutation(len(DAMAGES))[: rng.choice([0, 1, 1, 2, 3, 4])], key=lambda number: number == LAST
    ):
        mesh = damaged(mesh, number, rng)
    return mesh


def damaged(mesh: Mesh, number: int, rng: Random) -> Mesh:
    """Return the mesh with the damage of this number done to a copy of it."""
    name, harm = DAMAGES[number]
    with np.errstate(all="ignore"):  # harm comes upon harm: infinity may be flattened, too
        vertices, faces = harm(mesh.vertices.copy(), [list(face) for face in mesh.faces], rng)
    return Mesh(vertices, faces, f"{mesh.story}, {name}")


# ------------------------------------------------------------------------------------------------------------- shapes


def _listed(model: tuple[Floats, Any]) -> tuple[Floats, Polygons]:
    vertices, faces = model
    return np.asarray(vertices, dtype=np.float64), [[int(corner) for corner in face] for face in faces]


def _triangle_soup(rng: Random) -> tuple[Floats, Polygons]:
    count = int(rng.integers(3, 40))
    return rng.normal(size=(count, 3)), rng.integers(0, count, (int(rng.integers(1, 80)), 3)).tolist()


def _polygon_soup(rng: Random) -> tuple[Floats, Polygons]:
    count = int(rng.integers(4, 30))
    faces = [rng.integers(0, count, int(rng.integers(3, 9))).tolist() for _ in range(int(rng.integers(1, 30)))]
    return rng.normal(size=(count, 3)), faces


def _quads(rows: int, columns: int, around: bool = False, along: bool = False) -> Polygons:
    i, j = (part.ravel() for part in np.mgrid[: rows - (not along), : columns - (not around)])
    below, right = (i + 1) % rows, (j + 1) % columns
    pairs = ((i, j), (below, j), (below, right), (i, right))
    return np.stack([a * columns + b for a, b in pairs], axis=1).tolist()


def _sheet(rng: Random) -> tuple[Floats, Polygons]:
    rows, columns = rng.integers(2, 13, 2)
    u, v = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    height = [u * 0, np.abs(u + 0.4 * v - 0.7), np.sin(9 * u * v), u**2 - v**2, np.floor(3 * u) / 3][rng.integers(5)]
    return np.stack([u, v, height], axis=-1).reshape(-1, 3), _quads(int(rows), int(columns))


def _torus(rng: Random) -> tuple[Floats, Polygons]:
    along, around = int(rng.integers(3, 24)), int(rng.integers(3, 9))
    u, v = np.meshgrid(np.arange(along) * 2 * np.pi / along, np.arange(around) * 2 * np.pi / around, indexing="ij")
    radius = 1 + rng.choice([0.01, 0.1, 0.5]) * np.cos(v)
    points = np.stack([radius * np.cos(u), radius * np.sin(u), 0.3 * np.sin(v)], axis=-1).reshape(-1, 3)
    return points, _quads(along, around, around=True, along=True)


def _tube(rng: Random) -> tuple[Floats, Polygons]:
    along, around = int(rng.integers(2, 30)), int(rng.integers(3, 8))
    u, v = np.meshgrid(np.arange(along), np.arange(around) * 2 * np.pi / around, indexing="ij")
    points = np.stack([np.cos(v), np.sin(v), u + 0.3 * np.sin(u)], axis=-1).reshape(-1, 3)
    return points, _quads(along, around, around=True)


def _hull(rng: Random) -> tuple[Floats, Polygons]:
    points = rng.normal(size=(int(rng.integers(4, 90)), 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, ConvexHull(points).simplices.tolist()


def _scattered_terrain(rng: Random) -> tuple[Floats, Polygons]:
    """Needles all along its border."""
    plane = rng.random((int(rng.integers(4, 70)), 2)) ** rng.choice([1.0, 3.0])
    height = 0.3 * np.abs(plane @ [1.0, 2.0] - 1.0)
    return np.column_stack([plane, height]), Delaunay(plane, qhull_options="QJ").simplices.tolist()


def _fan(rng: Random) -> tuple[Floats, Polygons]:
    """A pole; now and then of two thousand triangles."""
    valence = int(rng.choice([3, 5, 20, 100, 2000], p=[0.3, 0.3, 0.25, 0.145, 0.005]))
    angle = np.arange(valence) * 2 * np.pi / valence
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0.1 * np.cos(5 * angle)])
    return np.vstack([[0.0, 0.0, rng.normal()], rim]), [[0, 1 + k, 1 + (k + 1) % valence] for k in range(valence)]


def _prism_of_large_polygons(rng: Random) -> tuple[Floats, Polygons]:
    """Two lids with up to 400 corners each, often not convex, and a wall of quads."""
    corners = int(rng.integers(3, 400 if rng.random() < 0.05 else 50))
    angle = np.arange(corners) * 2 * np.pi / corners
    radius = 1 + rng.choice([0.0, 0.4]) * rng.random(corners)
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    vertices = np.vstack([np.column_stack([ring, np.full(corners, z)]) for z in (0.0, 0.5)])
    number = np.arange(corners)
    after = (number + 1) % corners
    walls = np.stack([number, after, after + corners, number + corners], axis=1).tolist()
    return vertices, [number[::-1].tolist(), (number + corners).tolist(), *walls]


def _polygon_with_hole(rng: Random) -> tuple[Floats, Polygons]:
    """One polygon that goes around a hole and comes back over the bridge it went on, as Blender's holes are made."""
    outer, inner = (int(n) for n in rng.integers(3, 40, 2))

    def circle(count: int, radius: float) -> Floats:
        angle = np.arange(count) * 2 * np.pi / count
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.05 * np.sin(2 * angle)])

    vertices = np.vstack([circle(outer, 1.0), circle(inner, 0.4)])
    hole = [outer + (inner - k) % inner for k in range(inner)]
    return vertices, [[*range(outer), 0, *hole, outer]]


def _crumbs(rng: Random) -> tuple[Floats, Polygons]:
    """Many components of one triangle, two triangles or a tetrahedron."""
    vertices, faces = [], []
    for _ in range(int(rng.integers(1, 12))):
        points = rng.normal(size=(4, 3)) + 5 * rng.normal(size=3)
        kind = rng.integers(3)
        own = [[[0, 1, 2]], [[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]]][kind]
        faces += [[corner + 4 * len(vertices) for corner in face] for face in own]
        vertices.append(points)
    return np.vstack(vertices), faces


def _book(rng: Random) -> tuple[Floats, Polygons]:
    """Pages that share a spine: one edge with many sheets at it."""
    pages, rows = int(rng.integers(3, 12)), int(rng.integers(2, 7))
    vertices = [np.column_stack([np.zeros(rows), np.zeros(rows), np.arange(rows)])]
    faces = []
    for page in range(pages):
        angle = 2 * np.pi * page / pages
        for step in (1, 2):
            out = step * np.array([np.cos(angle), np.sin(angle), 0.0])
            vertices.append(vertices[0] + out)
            first = 0 if step == 1 else rows * (len(vertices) - 2)
            last = rows * (len(vertices) - 1)
            faces += [[first + k, first + k + 1, last + k + 1, last + k] for k in range(rows - 1)]
    return np.vstack(vertices), faces


def _blocks(rng: Random) -> tuple[Floats, Polygons]:
    """The outside of random voxels: edges with four faces and vertices where corners touch."""
    solid = rng.random((3, 3, 3)) < 0.4
    solid[1, 1, 1] = True
    padded = np.pad(solid, 1)
    quads = []
    for axis in range(3):
        for side in (0, 1):
            outside = np.roll(padded, -1 if side else 1, axis=axis)
            for cell in np.argwhere(padded & ~outside):
                base = cell.copy()
                base[axis] += side
                one, two = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
                loop = [base, base + one, base + one + two, base + two]
                quads.append(loop if side else loop[::-1])
    corners, number = np.unique(np.array(quads).reshape(-1, 3), axis=0, return_inverse=True)
    return corners.astype(np.float64), number.reshape(-1, 4).tolist()


SHAPES: tuple[tuple[str, Callable[[Random], tuple[Floats, Polygons]]], ...] = (
    ("soup of triangles", _triangle_soup),
    ("soup of polygons", _polygon_soup),
    ("sheet", _sheet),
    ("torus", _torus),
    ("tube", _tube),
    ("hull of random points", _hull),
    ("terrain over scattered points", _scattered_terrain),
    ("fan", _fan),
    ("prism with large polygons", _prism_of_large_polygons),
    ("polygon with a hole", _polygon_with_hole),
    ("crumbs", _crumbs),
    ("book", _book),
    ("blocks", _blocks),
    ("tetrahedron", lambda rng: _listed(models.tetrahedron())),
    ("cube", lambda rng: _listed(models.cube(int(rng.integers(1, 5))))),
    ("moebius strip", lambda rng: _listed(models.moebius(int(rng.integers(6, 20)), int(rng.integers(2, 5))))),
    ("klein bottle", lambda rng: _listed(models.klein_bottle(int(rng.integers(6, 16)), int(rng.integers(4, 9))))),
    ("finger", lambda rng: _listed(models.finger(int(rng.integers(2, 7)), int(rng.integers(5, 8))))),
)


# ------------------------------------------------------------------------------------------------------------ damages


Damage = Callable[[Floats, Polygons, Random], tuple[Floats, Polygons]]


def _some(items: Sequence[Any], rng: Random, share: float = 0.2) -> list[int]:
    return rng.permutation(len(items))[: max(1, int(share * len(items)))].tolist()


def _remove_faces(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    gone = set(_some(faces, rng)) if len(faces) > 1 else set()
    return vertices, [face for number, face in enumerate(faces) if number not in gone]


def _duplicate_faces(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return vertices, faces + [list(faces[number])[:: rng.choice([1, -1])] for number in _some(faces, rng)]


def _turn_faces(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    for number in _some(faces, rng, 0.4):
        faces[number] = faces[number][::-1]
    return vertices, faces


def _stray_faces(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return vertices, faces + rng.integers(0, len(vertices), (int(rng.integers(1, 5)), 3)).tolist()


def _loose_vertices(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return np.vstack([vertices, 10 * rng.normal(size=(int(rng.integers(1, 6)), 3))]), faces


def _merge_vertices(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    """Topology only: bow ties, repeated corners, handles."""
    number = np.arange(len(vertices))
    for _ in range(int(rng.integers(1, 4))):
        number[rng.integers(len(vertices))] = rng.integers(len(vertices))
    return vertices, [[int(number[corner]) for corner in face] for face in faces]


def _same_places(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    """Edges without length."""
    which = _some(vertices, rng, 0.3)
    vertices[which] = vertices[rng.permutation(which)[: max(1, len(which) // 4)]][
        rng.integers(0, max(1, len(which) // 4), len(which))
    ]
    return vertices, faces


def _snap(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return np.round(vertices, int(rng.integers(0, 2))), faces


def _flatten(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    vertices[:, rng.integers(3)] *= rng.choice([0.0, 1e-12, 1e-6, 1e-3])
    return vertices, faces


def _squash_to_line(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return np.outer(vertices[:, 0], rng.normal(size=3)), faces


def _one_point(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return np.tile(vertices[:1], (len(vertices), 1)), faces


def _rescale(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return vertices * rng.choice([1e-9, 1e-3, 1e3, 1e9, 1e-150, 1e150]), faces


def _move_far(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return vertices + rng.normal(size=3) * rng.choice([1e3, 1e6, 1e9]), faces


def _not_a_number(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    vertices[rng.integers(len(vertices)), rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf])
    return vertices, faces


def _tear_apart(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    """Every face with vertices of its own, as STL files have them."""
    corners = np.concatenate([np.asarray(face) for face in faces])
    ends = np.cumsum([0] + [len(face) for face in faces])
    return vertices[corners], [list(range(a, b)) for a, b in pairwise(ends)]


def _repeat_corners(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    for number in _some(faces, rng, 0.1):
        at = int(rng.integers(len(faces[number])))
        faces[number].insert(at, faces[number][at])
    return vertices, faces


def _noise(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    size = np.ptp(vertices[np.isfinite(vertices).all(axis=1)], axis=0).max()
    return vertices + rng.choice([1e-6, 1e-2, 0.3]) * size * rng.normal(size=vertices.shape), faces


def _shuffle(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    order = rng.permutation(len(vertices))
    number = np.argsort(order)
    return vertices[order], [[int(number[corner]) for corner in face] for face in faces]


def _single_precision(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    return vertices.astype(np.float32), faces


def _wrong_number(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    faces[int(rng.integers(len(faces)))][0] = int(rng.choice([-1, len(vertices), 2**40]))
    return vertices, faces


def _one_far_away(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    vertices[rng.integers(len(vertices))] *= rng.choice([1e3, 1e6, 1e12])
    return vertices, faces


def _second_copy(vertices: Floats, faces: Polygons, rng: Random) -> tuple[Floats, Polygons]:
    """The same surface twice, in the same place or a hair beside it."""
    moved = vertices + rng.choice([0.0, 1e-9, 1e-3, 3.0])
    return np.vstack([vertices, moved]), faces + [[corner + len(vertices) for corner in face] for face in faces]


DAMAGES: tuple[tuple[str, Damage], ...] = (
    ("faces removed", _remove_faces),
    ("faces doubled", _duplicate_faces),
    ("faces turned over", _turn_faces),
    ("stray faces", _stray_faces),
    ("loose vertices", _loose_vertices),
    ("vertices merged", _merge_vertices),
    ("vertices at the same places", _same_places),
    ("snapped to a grid", _snap),
    ("flattened", _flatten),
    ("squashed to a line", _squash_to_line),
    ("squashed to a point", _one_point),
    ("scaled", _rescale),
    ("moved far away", _move_far),
    ("a coordinate that is not a number", _not_a_number),
    ("torn apart", _tear_apart),
    ("corners repeated", _repeat_corners),
    ("noise", _noise),
    ("shuffled", _shuffle),
    ("single precision", _single_precision),
    ("a vertex far away", _one_far_away),
    ("twice", _second_copy),
    ("a vertex that is not there", _wrong_number),
)
LAST = len(DAMAGES) - 1


# ----------------------------------------------------------------------------------------------------------- settings


def generated_settings(rng: Random, vertices: int) -> Settings:
    """Return quick settings in most cases, any others on small meshes now and then."""
    chosen: dict[str, Any] = {
        "workers": 1,
        "ring": int(rng.choice([1, 2, 3, 4, 7, 7, 12, 50])),
        "degree": int(rng.choice([0, 1, 2, 5, 8, 14])),
        "sparsity": int(rng.choice([1, 3, 8, 15])),
        "iterations": int(rng.choice([0, 1, 2, 4])),
        "sweeps": int(rng.choice([0, 0, 1])),
    }
    if rng.random() < 0.35:
        chosen |= {
            "method": str(rng.choice(["default", "default", "default", "paper", "traditional"])),
            "domains": str(rng.choice(["common", "separate"])),
            "initial_domain": str(rng.choice(["lscm", "harmonic", "tutte"])),
            "blending": str(rng.choice(["auto", "partition", "uniform"])),
            "basis": str(rng.choice(["auto", "legendre", "monomial"])),
            "pursuit": str(rng.choice(["auto", "ols", "omp"])),
            "observations": str(rng.choice(["auto", "centroids", "vertices"])),
            "adaptive": bool(rng.random() < 0.5),
            "pin_boundary": bool(rng.random() < 0.2),
            "automatic_sparsity": bool(rng.random() < 0.1),
            "keep_iterations": bool(rng.random() < 0.2),
            "mark_creases": bool(rng.random() < 0.2),
            "tolerance": float(rng.choice([0.0, 0.0, 0.0, 1e-2, 1e-6])),
            "denoise": str(rng.choice(["off", "off", "off", "only", "first"])),
        }
    if rng.random() < 0.015 and vertices < 100:
        chosen |= {
            "degree": int(rng.choice([20, 30])),
            "sparsity": int(rng.choice([60, 496])),
            "beta1": float(rng.choice([0.0, 1e6])),
            "beta2": float(rng.choice([0.0, 1e6])),
        }
    return Settings(**chosen)
