"""How far alignment leaves noisy copies and scans from their places, beside what is possible at all.

Noise moves every vertex at random, so no motion that is found from the moved vertices is exact.  For each noisy surface
the best motion is computed that knows what nobody does: of a copy which vertices belong together, of a scan, that has
other vertices than the model, the tangent plane that each point was taken from.  Both are unbiased and reach the bound
of Cramer and Rao for what they know; a scan cannot tell how far a point slid along its plane.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..solver.distance.alignment import align_steps
from ..solver.distance.surfaces import Surface
from ..solver.mesh.normals import face_normals
from ..solver.mesh.triangle_mesh import build_mesh
from ..solver.progress import run_to_end
from .cases import Case, generated
from .tables import Table

Floats = NDArray[np.float64]

NOISE = 2e-3
"""Standard deviation of each coordinate of each vertex, longest sides."""

POSES = {"copy": 100, "scan": 25}


@dataclass(frozen=True)
class Aligned:
    """How far the worst vertex of the model ends from its place, in longest sides, over all poses.

    Attributes
    ----------
    kind
        "copy": the model's vertices and triangles; "scan": as many points elsewhere on it.
    median, worst
        Ours.
    least_median, least_worst
        Of the best motion that knows what belongs together.
    failed
        Poses that ended at another place altogether, or said that there is a problem.
    """

    model: str
    kind: str
    poses: int
    median: float
    worst: float
    least_median: float
    least_worst: float
    failed: int


def run(
    cases: Sequence[Case], say: Callable[[str], None], poses: Mapping[str, int] | None = None
) -> tuple[dict[str, Table], Any]:
    """Measure, from `POSES` unless told; returns a table, and everything as plain values."""
    rows = []
    for case in cases:
        say(f"{case.model}, alignment")
        vertices, faces = case.arrays if case.arrays is not None else generated(case.model, case.size)
        mesh = build_mesh(vertices, faces)
        model = Surface.of(mesh.vertices / float(np.ptp(mesh.vertices, axis=0).max()), mesh.triangles)
        rows += [_measured(case.model, kind, model, count) for kind, count in (poses or POSES).items()]
    head = ["model", "kind", "poses", "median", "worst", "least median", "least worst", "failed"]
    return {"alignment": Table.of(head, (list(vars(row).values()) for row in rows))}, [asdict(row) for row in rows]


def _measured(name: str, kind: str, model: Surface, poses: int) -> Aligned:
    places, triangle = model.samples_and_triangles(len(model.vertices))
    normals = face_normals(model.vertices, model.triangles)[triangle]
    same = _symmetries(model)
    ours, least, failed = [], [], 0
    for seed in range(poses):
        rng = np.random.default_rng(seed)
        points = model.vertices if kind == "copy" else places
        noisy = points + NOISE * rng.normal(size=points.shape)
        away = np.eye(4)
        away[:3, :3], away[:3, 3] = Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3)
        triangles = model.triangles if kind == "copy" else None
        found = run_to_end(align_steps(Surface.of(noisy @ away[:3, :3].T + away[:3, 3], triangles), model))
        ours.append(_off(found.matrix @ away, model.vertices, same))
        known = knowing_pairs(noisy, points) if kind == "copy" else knowing_planes(noisy, points, normals)
        least.append(_off(known, model.vertices, same))
        failed += bool(found.problem) or ours[-1] > 10.0 * NOISE
    middles, ends = (tuple(float(f(each)) for each in (ours, least)) for f in (np.median, np.max))
    return Aligned(name, kind, poses, middles[0], ends[0], middles[1], ends[1], failed)


def _off(matrix: Floats, vertices: Floats, same: Sequence[Floats]) -> float:
    """Return how far a motion takes the worst vertex from its place, or from one that looks the same."""
    moved = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return float(min(np.linalg.norm(moved - other, axis=1).max() for other in same))


def _symmetries(model: Surface) -> list[Floats]:
    """Return the vertices in all places where the surface looks the same, of the 24 rotations of a cube."""
    middle = 0.5 * (model.vertices.min(axis=0) + model.vertices.max(axis=0))
    turned = [(model.vertices - middle) @ turn.T + middle for turn in Rotation.create_group("O").as_matrix()]
    return [each for each in turned if model.target.nearest(each).distance.max() < 1e-6]


def knowing_pairs(points: Floats, partners: Floats) -> Floats:
    """Return the rotation and shift, (4, 4), that bring points (N, 3) closest to their partners (W. Kabsch, 1976)."""
    middle, goal = points.mean(axis=0), partners.mean(axis=0)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.align_vectors(partners - goal, points - middle)[0].as_matrix()
    matrix[:3, 3] = goal - matrix[:3, :3] @ middle
    return matrix


def knowing_planes(points: Floats, feet: Floats, normals: Floats) -> Floats:
    """Return the motion, (4, 4), that brings points (N, 3) closest to the planes through feet with these normals."""
    matrix = np.eye(4)
    for _ in range(5):
        moved = points @ matrix[:3, :3].T + matrix[:3, 3]
        system = np.concatenate([np.cross(moved, normals), normals], axis=1)
        turn, shift = np.split(np.linalg.lstsq(system, ((feet - moved) * normals).sum(axis=1), rcond=None)[0], 2)
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), shift
        matrix = step @ matrix
    return matrix
