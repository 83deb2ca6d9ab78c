"""Resampling: the surface of a representation as a mesh of any density.

`subdivision` splits the input's faces; here the new vertices are evaluated.  What the input carries beside its
positions can be interpolated to the new mesh: each new vertex and corner knows where in which triangle it lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import index
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Booleans, Indices
from ..errors import InputError
from ..mesh.edges import edge_keys
from ..processes.threads import on_one_thread
from ..progress import Progress, Steps, run_to_end
from .representation import Representation
from .subdivision import Grid, subdivided

MOST_CORNERS = 2**31 - 1
"""The most corners that Blender and most file formats, with 32-bit indices, can hold."""

POINTS_AT_ONCE = 200_000


@dataclass(frozen=True)
class Interpolation:
    """n elements of a new mesh as weighted means of three elements of the source each.

    Attributes
    ----------
    sources, weights
        (m, 3) each, for m <= n different places.
    place
        Place of each element, (n,).
    """

    sources: Indices
    weights: Array
    place: Indices

    def linear(self, values: NDArray[Any]) -> Array:
        """Interpolate values (source elements, ...) to (n, ...)."""
        weights = self.weights.reshape(*self.weights.shape, *(1,) * (values.ndim - 1))
        # summed one by one: the gathered (m, 3, ...) would be the largest array of all
        mixed = sum(values[self.sources[:, k]] * weights[:, k] for k in range(3))
        result: Array = np.asarray(mixed)[self.place]
        return result

    def nearest(self, values: NDArray[Any]) -> NDArray[Any]:
        """Take each value from the source element of the largest weight: for what has no value in between."""
        heaviest = self.weights.argmax(axis=1)
        result: NDArray[Any] = values[self.sources[np.arange(len(heaviest)), heaviest]][self.place]
        return result

    def part(self, elements: Indices | slice, number: Indices) -> Interpolation:
        """Some elements only; `number` is what the source's elements are called from now on, -1 for those that go."""
        place = self.place[elements]
        sources = number[self.sources[place]]
        # A vertex on an edge may be placed in the triangle behind it, whose third corner weighs nothing.
        weights = np.where(sources < 0, 0.0, self.weights[place])
        return Interpolation(np.maximum(sources, 0), weights, np.arange(len(place)))


@dataclass(frozen=True)
class Resampled:
    """A resampled surface: P vertices, the V of the source first; F faces; L corners.

    Attributes
    ----------
    vertices
        (P, 3), scene units.
    corners, sizes
        Vertices of the faces, one face after the other, (L,), and the number of each face's corners (F,).
    source_face
        Input face that each face lies in, (F,), ascending.
    edges, chains
        Edges of the input's faces as pairs of vertices (E, 2), and the vertices on each of them in order, (E, N + 1).
    creases
        New edges along which the surface has a crease, as pairs of vertices, (C, 2).
    at_vertices, at_corners
        How layers of the source's vertices and face corners get there.
    """

    vertices: Array
    corners: Indices
    sizes: Indices
    source_face: Indices
    edges: Indices
    chains: Indices
    creases: Indices
    at_vertices: Interpolation
    at_corners: Interpolation

    def polygons(self) -> list[Indices]:
        """Faces as a list of vertex numbers."""
        return np.split(self.corners, np.cumsum(self.sizes)[:-1]) if len(self.sizes) else []

    def part(self, faces: slice, corners: slice, vertices: Indices) -> tuple[Resampled, Indices]:
        """Return what lies in some of the source's faces, as if these were the source, and which vertices it has.

        Parameters
        ----------
        faces, corners
            Those faces, and their corners.
        vertices
            The vertices that belong to them, some of them several times; they come first, in this order.
        """
        own = vertices[np.sort(np.unique(vertices, return_index=True)[1])]
        chosen = (self.source_face >= faces.start) & (self.source_face < faces.stop)
        positions = np.flatnonzero(np.repeat(chosen, self.sizes))
        taken, sizes = self.corners[positions], self.sizes[chosen]
        kept = np.concatenate([own, np.setdiff1d(taken, own)])
        number = np.full(len(self.vertices), -1)
        number[kept] = np.arange(len(kept))
        source_number = np.full(len(self.vertices), -1)
        source_number[own] = np.arange(len(own))
        mine = number[taken]
        sides = np.sort(np.stack([mine, mine[_following(sizes)]], axis=1), axis=1) @ np.array([len(kept), 1])
        whole, cut = (_among(number[pairs], sides, len(kept)) for pairs in (self.chains[:, :2], self.creases))
        corner_number = np.full(int(self.at_corners.sources.max(initial=-1)) + 1, -1)
        corner_number[corners] = np.arange(len(corner_number[corners]))
        part = Resampled(
            vertices=self.vertices[kept],
            corners=mine,
            sizes=sizes,
            source_face=self.source_face[chosen] - faces.start,
            edges=number[self.edges[whole]],
            chains=number[self.chains[whole]],
            creases=number[self.creases[cut]],
            at_vertices=self.at_vertices.part(kept, source_number),
            at_corners=self.at_corners.part(positions, corner_number),
        )
        return part, kept


def _following(sizes: Indices) -> Indices:
    """The corner that comes after each in its face, (L,)."""
    end = np.cumsum(sizes)
    following = np.arange(1, int(end[-1]) + 1 if len(end) else 1)
    following[end - 1] = end - sizes
    return following


def _among(pairs: Indices, sides: Indices, count: int) -> Booleans:
    """Which pairs of vertices are sides, given as keys of the smaller and the larger number."""
    found: Booleans = (pairs >= 0).all(axis=1) & np.isin(np.sort(pairs, axis=1) @ np.array([count, 1]), sides)
    return found


def resample(representation: Representation, splits: int) -> Resampled:
    """Evaluate a representation on a mesh with every edge split into N: S(x) = sum_k phi_k(x) h_k(Phi_k(x)).

    Triangles become N^2 triangles and quads N^2 quads (section 4.2).

    Parameters
    ----------
    representation
        The surface.
    splits
        N, the number of parts of every edge.  With 1 the input's faces stay as they are.

    Returns
    -------
    Resampled
        `vertices` (P, 3), `corners` (L,), `sizes` (F,), and how the input's layers get there.

    Raises
    ------
    InputError
        When `splits` is not positive, or the mesh would have more corners than 32 bits can count.

    Examples
    --------
    >>> from sparse_surface.solver import approximate, resample
    >>> finer = resample(approximate(vertices, faces).representation, 2)
    >>> len(finer.sizes) == 4 * len(faces)
    True
    """
    return run_to_end(resample_steps(representation, splits))


@on_one_thread
def resample_steps(representation: Representation, splits: int) -> Steps[Resampled]:
    """`resample` as a generator of `Progress`; closing it cancels."""
    splits = checked_splits(splits, len(representation.face_corners))
    yield Progress("Splitting edges", 0.0)
    grid, edges, chains, count = subdivided(representation, splits)
    sample = vertex_samples(grid, count)
    points = yield from _points(representation, grid, sample)
    return Resampled(
        vertices=points,
        corners=grid.vertex[grid.corners],
        sizes=grid.sizes,
        source_face=grid.face,
        edges=edges,
        chains=chains,
        creases=_on_creases(representation, edges, chains),
        at_vertices=_between_vertices(representation, grid, sample),
        at_corners=Interpolation(face_corners_of_triangles(representation)[grid.triangle], grid.inside, grid.corners),
    )


def _on_creases(source: Representation, edges: Indices, chains: Indices) -> Indices:
    """Parts of the edges that are creases of the source, as pairs of vertices."""
    count = len(source.vertices)
    keys = [edge_keys(ends[:, 0], ends[:, 1], count) for ends in (edges, source.creases)]
    along = chains[np.isin(keys[0], keys[1])]
    return np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2)


def checked_splits(splits: int, corners: int) -> int:
    """Return the number of parts that the edges of a mesh with this many face corners can be split into.

    Raises
    ------
    InputError
        When it is not positive, or the mesh would have more corners than 32 bits can count.
    """
    try:
        splits = index(splits)
    except TypeError:
        raise InputError(f"Edges are split into a whole number of parts, not {splits!r}.") from None
    if splits < 1:
        raise InputError("Edges can be split into 1 part or more, not fewer.")
    count = corners * splits**2
    if count > MOST_CORNERS:
        raise InputError(
            f"The resampled mesh would have about {count:.2g} face corners; split the edges into fewer parts."
        )
    return splits


def vertex_samples(grid: Grid, count: int) -> Indices:
    """First sample of each vertex, (P,); -1 at vertices without faces."""
    first = np.full(count, -1)
    first[grid.vertex[::-1]] = np.arange(len(grid.vertex))[::-1]
    return first


def _points(source: Representation, grid: Grid, sample: Indices) -> Steps[Array]:
    """Evaluate the new vertices, (P, 3)."""
    points = np.empty((len(sample), 3))
    vertices = len(source.vertices)
    points[:vertices] = source.at_vertices()
    # neighbours together: a portion then meets few patches
    new = vertices + np.argsort(grid.triangle[sample[vertices:]], kind="stable")
    for start in range(0, len(new), POINTS_AT_ONCE):
        yield Progress("Evaluating", start / len(new), f"{start} of {len(new)} vertices")
        part = new[start : start + POINTS_AT_ONCE]
        points[part] = source.evaluate(grid.triangle[sample[part]], grid.inside[sample[part]])
    return points


def _between_vertices(source: Representation, grid: Grid, sample: Indices) -> Interpolation:
    """How values at the source's vertices get to the new ones; its own keep theirs."""
    vertices = len(source.vertices)
    own = np.repeat(np.arange(vertices)[:, None], 3, axis=1)
    new = sample[vertices:]
    return Interpolation(
        np.concatenate([own, source.triangles[grid.triangle[new]]]),
        np.concatenate([np.tile([1.0, 0.0, 0.0], (vertices, 1)), grid.inside[new]]),
        np.arange(len(sample)),
    )


def face_corners_of_triangles(source: Representation) -> Indices:
    """Face corner that each triangle corner is, (T, 3)."""
    face = np.repeat(np.arange(len(source.face_offsets) - 1), np.diff(source.face_offsets))
    key = face * len(source.vertices) + source.face_corners
    order = np.argsort(key, kind="stable")
    corner: Indices = order[
        np.searchsorted(key[order], source.polygon[:, None] * len(source.vertices) + source.triangles)
    ]
    return corner
