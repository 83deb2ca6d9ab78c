"""Accuracy and speed of reconstruction on clouds whose true surface is known."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..solver import Reconstruction, reconstruct
from ..solver.mesh.closest_points import closest_points
from ..solver.mesh.sampling import triangle_grid
from ..solver.reconstruction.made_base import make_base
from ..solver.settings import Settings
from .cases import unit_seconds
from .generated_clouds import Cloud, airplane, ball, box, head, l_solid
from .tables import Table

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SPLITS = 8


@dataclass(frozen=True)
class CloudCase:
    """A cloud with the figures that are asked of it, relative to the longest side."""

    title: str
    make: Callable[[], Cloud]
    asked: str
    made_base: bool = False


CASES = {
    "noisy_ball": CloudCase(
        "Sphere, radial noise 0.005", lambda: ball(noise=0.005), "rms <= 2.8e-3 (screened Poisson: 2.3e-3)"
    ),
    "noisy_ball_154": CloudCase("Sphere, radial noise 0.005", lambda: ball(9730, 154, noise=0.005), "rms <= 8e-4"),
    "box": CloudCase("Box, base across its edges", box, "rms <= 2.5e-3, max <= 2.5e-2"),
    "l_solid": CloudCase(
        "L-shaped solid, no base given",
        l_solid,
        "rms <= 1.5e-3, edges <= 4e-3 (screened Poisson: 1.4e-3, 8.7e-3; ball pivoting: 7e-4, 5.1e-3)",
        made_base=True,
    ),
    "ball": CloudCase("Paper: ball", ball, "fit much lower than 0.01"),
    "airplane": CloudCase("Paper: airplane", airplane, "fit much lower than 0.01"),
    "head": CloudCase("Paper: head", head, "fit much lower than 0.01"),
    "large": CloudCase("Head, 100,000 points", lambda: head(100_000, 1000), "60 s on one core"),
}


@dataclass(frozen=True)
class MeasuredCloud:
    """What came out; lengths relative to the longest side.

    Attributes
    ----------
    surface
        Distance of the surface, sampled evenly by area, from the true one: rms and largest.
    edges
        Mean distance of the true edges from the surface; None if the surface has no edges.
    fit
        Distance of the points from the surface: rms and largest.
    """

    title: str
    asked: str
    points: int
    base: int
    surface: tuple[float, float]
    edges: float | None
    fit: tuple[float, float]
    flips: int
    seconds: float
    unit: float

    def row(self) -> list[object]:
        """The cells of the table."""
        edges = "" if self.edges is None else f"{self.edges:.1e}"
        lengths = [f"{one:.1e} / {largest:.1e}" for one, largest in (self.surface, self.fit)]
        size = f"{self.points:,} / {self.base:,}"
        speed = f"{self.seconds / self.unit:.0f} ({self.seconds:.0f} s)"
        return [self.title, size, lengths[0], edges, lengths[1], self.flips, speed, self.asked]


HEAD = (
    "cloud",
    "points / base vertices",
    "surface rms / max",
    "edges",
    "fit rms / max",
    "flips",
    "units (processor time)",
    "asked",
)


def measure(case: CloudCase) -> MeasuredCloud:
    """Reconstruct a cloud on one core and compare the surface with the true one."""
    cloud = case.make()
    vertices, faces = cloud.base_vertices, cloud.base_faces
    if case.made_base:
        made = make_base(cloud.points)
        vertices, faces = made.vertices, made.triangles
    unit = unit_seconds(5, time.process_time)
    start = time.process_time()
    result = reconstruct(cloud.points, vertices, faces, Settings(workers=1))
    seconds = time.process_time() - start
    points, triangles = evaluated(result)
    off, area = cloud.distance(points), _areas(points, triangles)
    rms = float(np.sqrt((area * (off[triangles] ** 2).mean(axis=1)).sum() / area.sum()))
    relative = result.report["relative"]
    return MeasuredCloud(
        title=case.title,
        asked=case.asked,
        points=len(cloud.points),
        base=len(vertices),
        surface=(rms, float(off.max())),
        edges=_edges(cloud, points, triangles),
        fit=(relative["surface_rms"], relative["surface_max"]),
        flips=result.report["flipped_triangles"],
        seconds=seconds,
        unit=0.5 * (unit + unit_seconds(5, time.process_time)),
    )


def evaluated(result: Reconstruction, splits: int = SPLITS) -> tuple[Array, Indices]:
    """The surface on a grid in every triangle: points (N, 3), and the triangles between them (T, 3)."""
    grid = triangle_grid(splits)
    count = len(result.representation.triangles)
    points = result.representation.evaluate(np.repeat(np.arange(count), len(grid)), np.tile(grid, (count, 1)))
    place = np.full((splits + 2, splits + 2), -1)
    i, j = np.round(grid[:, 1:] * splits).astype(int).T
    place[i, j] = np.arange(len(grid))
    upright = np.stack([place[:-1, :-1], place[1:, :-1], place[:-1, 1:]], axis=-1).reshape(-1, 3)
    turned = np.stack([place[1:, :-1], place[1:, 1:], place[:-1, 1:]], axis=-1).reshape(-1, 3)
    small = np.concatenate([upright, turned])
    small = small[(small >= 0).all(axis=1)]
    return points, (small[None] + len(grid) * np.arange(count)[:, None, None]).reshape(-1, 3)


def _areas(points: Array, triangles: Indices) -> Array:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def _edges(cloud: Cloud, points: Array, triangles: Indices) -> float | None:
    if not len(cloud.creases):
        return None
    feet = closest_points(cloud.creases, points, triangles)
    return float(np.linalg.norm(feet.on(points, triangles) - cloud.creases, axis=1).mean())


def run(names: Sequence[str], say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Measure these clouds; returns a table, and everything as plain values."""
    found = []
    for name in names:
        say(CASES[name].title)
        found.append(measure(CASES[name]))
    return {"clouds": Table.of(HEAD, [each.row() for each in found])}, [asdict(each) for each in found]
