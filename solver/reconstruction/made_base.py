"""A coarse base mesh made from the points of a cloud.

Around a closed cloud, balls at the points become a shell whose outer side is taken.  An open cloud, one with a border,
gets the sheet where the signed distance from its points' oriented planes is zero (Hoppe et al. 1992), cut off where the
points end.  Either is decimated to the wanted number of vertices and drawn to the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from ..arrays import Array, Indices
from ..errors import InputError
from ..mesh.decimation import decimated
from ..processes.threads import on_one_thread
from ..progress import Progress, Steps, run_to_end
from .base import (
    BORDER_SPACINGS,
    OUTSIDE_LEVELS,
    OUTSIDE_SPACINGS,
    border_near_points,
    border_out_to_points,
    checked_base,
    drawn_to_points,
    without_folds,
)
from .border_folds import split_over_folds
from .cleaning import clean
from .geometry import CloudGeometry, analyse, on_planes
from .holes import across_holes, faired, narrow_holes
from .level_set import Grid, level_set
from .reconstruct import refuse_flat
from .shell import has_cavity, is_open, neighbours_in_noise, outer_parts, parts, sheet, unpinched, without_slivers
from .two_sides import faces_outward

REACHES = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Radii of the balls that are tried, in spacings of the cloud.  The smallest counts whose shell has the topology of the
next larger one: in noise small balls leave handles."""

OPEN_REACHES = (2.0, 2.5, 3.0)
"""Those for a cloud that seems to have a border: larger balls close a bin without a lid."""

LARGEST_RADIUS = 0.5
"""Largest radius of a ball, in longest sides of the cloud."""

NOISIEST = 0.5
"""With noise above this share of the spacing the shell is laid around dense places, not around points."""

DENSITY_SHARE, DENSITY_NEIGHBOURS, KERNEL_REACH = 0.8, 128, 1.5
"""Share of the points' median density at which that shell lies, the nearest points that count, and how far from a point
the density is sought, in radii."""

CALMING_ROUNDS, CALM = 2, 0.15
"""How often points of such a cloud are moved to planes first, and the share of the spacing below which noise is gone:
of closed and open clouds with noise of 0.6 to 1.6 spacings 0.01 to 0.07 are left, of thin parts 0.3."""

STEPS_A_RADIUS = 1.5
"""Steps of the grid to a ball's radius."""

EXACT_POINTS_A_VERTEX, NOISY_POINTS_A_VERTEX = 24, 36
"""Points for each vertex of the base in clouds without noise, and in noisy ones, whose patches are larger."""

NOISY = 0.1
"""A cloud is noisy when its noise is above this share of the spacing; below, the numbers of points go over evenly."""

FAIRINGS = 4
"""How often the base is smoothed where no point is, each time as far as it does not fold."""

FEWEST, MOST = 12, 20_000
"""Vertices of a base whose size the user has not chosen."""

HALFWAY = 1.5
"""Slivers are left out first when this many times the wanted vertices are left."""


@dataclass(frozen=True)
class Base:
    """A base mesh: positions (V, 3), triangles (T, 3), whether it is closed, and how many holes were filled."""

    vertices: Array
    triangles: Indices
    closed: bool
    holes_closed: int = 0


def make_base(points: ArrayLike, count: int = 0, close_holes: float = 0.0) -> Base:
    """Make a base from points.

    Parameters
    ----------
    points
        (P, 3), scene units.
    count
        Wanted number of vertices; 0: one for every 24 points, in noisy clouds for every 36.
    close_holes
        Width up to which holes of the cloud are closed, scene units.

    Raises
    ------
    InputError
        When the points span no volume, or no manifold could be made around them.
    """
    return run_to_end(make_base_steps(clean(points).points, count, close_holes))


@on_one_thread
def make_base_steps(
    points: Array, count: int = 0, close_holes: float = 0.0, outward: Array | None = None
) -> Steps[Base]:
    """`make_base` as a generator of `Progress`, from points (P, 3) that were cleaned before, and their `outward`."""
    yield Progress("Making the base", 0.0)
    refuse_flat(points)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = float(np.ptp(points, axis=0).max())
    places = (points - middle) / size
    geometry = analyse(places, outward)
    calm, theirs = _calm(places, geometry)
    closed, vertices, triangles = _fine(calm, theirs, outward)
    widest = 0.0 if closed else close_holes / size
    holes = len(narrow_holes(vertices, triangles, widest)) if widest else 0
    if holes:
        closed, vertices, triangles = _without_holes(calm, theirs, vertices, triangles, widest)
        holes -= len(narrow_holes(vertices, triangles, widest))
    yield Progress("Making the base", 0.3)
    count = count or int(np.clip(len(places) // _points_a_vertex(geometry), FEWEST, MOST))
    try:
        for more in (HALFWAY, 1.0):
            vertices, triangles = without_slivers(*decimated(vertices, triangles, int(more * count)))
        mesh = checked_base(*unpinched(vertices, triangles))
    except InputError:
        raise InputError("No base could be made from the points: choose a base mesh for them.") from None
    yield Progress("Making the base", 0.9)
    near = drawn_to_points(mesh, places, np.ones(len(places)))
    if closed:
        for _ in range(FAIRINGS):
            near = without_folds(near, faired(near.vertices, near.triangles, places, geometry.spacing))
    else:
        near = border_near_points(near, places, BORDER_SPACINGS * geometry.spacing)
        outside = OUTSIDE_SPACINGS * geometry.spacing + OUTSIDE_LEVELS * geometry.noise
        near = split_over_folds(border_out_to_points(near, places, outside), places, geometry)
    return Base(near.vertices * size + middle, near.triangles, closed, max(holes, 0))


def _points_a_vertex(geometry: CloudGeometry) -> int:
    """Number of points for each vertex of the base, where the user has not chosen its size."""
    noisy = min(geometry.noise / (NOISY * geometry.spacing), 1.0)
    return round(EXACT_POINTS_A_VERTEX + noisy * (NOISY_POINTS_A_VERTEX - EXACT_POINTS_A_VERTEX))


def _calm(points: Array, geometry: CloudGeometry) -> tuple[Array, CloudGeometry]:
    """Points (P, 3) for the base of a very noisy cloud, on planes through their neighbours, and their geometry.

    Planes that reach beyond the noise average most of it away (Levin 1998).  Where they do not, parts are as thin as
    the noise is wide, and planes would mix their sides: the points stay as they are, as in clouds with less noise.
    """
    if geometry.noise <= NOISIEST * geometry.spacing:
        return points, geometry
    calm, count = points, min(neighbours_in_noise(geometry.spacing, geometry.noise), len(points))
    for _ in range(CALMING_ROUNDS):
        calm = on_planes(calm, count)
    theirs = analyse(calm)
    return (calm, theirs) if theirs.noise < CALM * theirs.spacing else (points, geometry)


def _fine(points: Array, geometry: CloudGeometry, outward: Array | None = None) -> tuple[bool, Array, Indices]:
    """Whether a cloud is closed, and a fine mesh along it: vertices and triangles.

    A shell without a cavity is a sheet, or a thin part seen from both sides if normals say so.
    """
    tree, border = cKDTree(points), is_open(points, geometry.spacing, geometry.noise)
    noisy = geometry.noise > NOISIEST * geometry.spacing
    shells = [_Shell.around(points, tree, radius, noisy) for radius in _radii(geometry.spacing, border)]
    lasting = [shell for shell, larger in pairwise(shells) if shell.topology == larger.topology]
    closed = _with_cavities(shells, lasting, noisy and not border)
    if border and not closed and outward is not None:
        closed = [shell for shell in (lasting or shells) if faces_outward(*shell.mesh, points, outward)]
    if border and not closed:
        return False, *sheet(points, geometry.spacing, geometry.noise)
    chosen = (closed or lasting or shells[-1:])[0]
    return True, chosen.vertices, chosen.triangles


def _with_cavities(shells: list[_Shell], lasting: list[_Shell], foams: bool) -> list[_Shell]:
    """The shells that show a closed cloud, those first whose topology lasts.

    Where noise is as wide as parts are thick, small balls leave a foam: its cavities and handles count for nothing if
    larger ones show what lasts.
    """
    return [shell for shell in (lasting if foams and lasting else lasting + shells) if shell.closed]


def _without_holes(
    points: Array, geometry: CloudGeometry, vertices: Array, triangles: Indices, widest: float
) -> tuple[bool, Array, Indices]:
    """Close the holes of a fine mesh that are at most `widest` wide; returns what `_fine` does."""
    across = across_holes(vertices, triangles, widest, geometry.spacing)
    closed, vertices, triangles = _fine(np.concatenate([points, across]), geometry)
    return closed, faired(vertices, triangles, points, geometry.spacing, across), triangles


def _radii(spacing: float, border: bool) -> list[float]:
    """Radii of the balls that are tried, none twice."""
    reaches = OPEN_REACHES if border else REACHES
    return sorted({min(reach * spacing, LARGEST_RADIUS) for reach in reaches})


@dataclass(frozen=True)
class _Shell:
    """The outer side of a shell around balls: vertices (V, 3), triangles (T, 3), and whether it has a cavity."""

    vertices: Array
    triangles: Indices
    closed: bool

    @classmethod
    def around(cls, points: Array, tree: cKDTree, radius: float, noisy: bool) -> _Shell:
        shell = (_around_density if noisy else _around_balls)(points, tree, radius)
        return cls(*outer_parts(*shell), has_cavity(*shell, radius))

    @property
    def mesh(self) -> tuple[Array, Indices]:
        """Vertices and triangles."""
        return self.vertices, self.triangles

    @property
    def topology(self) -> tuple[int, int]:
        """Connected parts and Euler's characteristic.  What lasts when the balls grow is the cloud's own topology."""
        count = len(self.vertices)
        return int(parts(self.triangles, count).max(initial=-1)) + 1, count - len(self.triangles) // 2


def _around_balls(points: Array, tree: cKDTree, radius: float) -> tuple[Array, Indices]:
    """Mesh around balls of this radius at points (P, 3), wound outwards."""
    grid = Grid.around(points, radius, radius / STEPS_A_RADIUS)
    away = tree.query(grid.positions, distance_upper_bound=radius + 2.0 * grid.step)[0]
    return level_set(grid, away - radius)


def _around_density(points: Array, tree: cKDTree, radius: float) -> tuple[Array, Indices]:
    """Mesh around where points (P, 3) are dense, by Gaussian kernels of this radius, wound outwards.

    In noise as wide as the points are apart it is closer to the surface than balls at the outermost points.
    """

    def density(places: Array) -> Array:
        away = tree.query(places, k=min(DENSITY_NEIGHBOURS, len(points)))[0]
        return np.asarray(np.exp(-((away / radius) ** 2)).sum(axis=1))

    grid = Grid.around(points, KERNEL_REACH * radius, radius / STEPS_A_RADIUS)
    return level_set(grid, DENSITY_SHARE * float(np.median(density(points))) - density(grid.positions))
