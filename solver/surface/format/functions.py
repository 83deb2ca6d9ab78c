"""Frames, coefficients and steps, as writing and reading both find them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...arrays import Array, Booleans, Indices
from ...fitting.dictionary import Dictionary
from .cover import Cover
from .domains import FINER, Functions, shares_of
from .entropy import CONTEXTS


def position_steps(triangles: Indices, total: Array, covered: float, shown: float) -> Array:
    """Step of each vertex, (V,): a fine one at triangles where patches leave something to the input."""
    shows = total < 1.0 - 1e-9
    shows[triangles[shows[triangles].any(axis=1)]] = True
    return np.where(shows, shown, covered)


def mean_positions(cover: Cover, positions: Array) -> Array:
    """Mean of each patch's vertices, (K, 3), of positions (M, 3)."""
    patches = len(cover.vertex_offsets) - 1
    sizes = np.maximum(np.diff(cover.vertex_offsets), 1)
    columns = [np.bincount(cover.patch_of_vertex, weights=column, minlength=patches) for column in positions.T]
    return np.stack(columns, axis=1) / sizes[:, None]


def degrees_of(support: Indices) -> Indices:
    """Total degree of functions, the table of their coefficients."""
    degrees = (np.sqrt(8.0 * support + 1.0).astype(np.int64) - 1) // 2
    return np.minimum(degrees, CONTEXTS - 1)


def coefficient_steps(scales: Array, step: float, support: Indices) -> Array:
    """Steps of the coefficients, (K, 3, s): wider for functions of higher degree, which are large in few places."""
    return step * scales[:, :, None] * np.sqrt(1.0 + degrees_of(np.maximum(support, 0)))


def domain_steps(cover: Cover, weights: Array, scales: Array, steps: tuple[float, float], finer: Booleans) -> Array:
    """Steps of the patch vertices, (M,), in their frames.

    Parameters
    ----------
    steps
        The step of a vertex that only one patch holds, scene units, and the least share of one that weighs less.
    """
    step, least = steps
    each: Array = step * scales[cover.patch_of_vertex] / shares_of(cover, weights, least)
    return np.where(finer, FINER * each, each)


def domain_inputs(
    cover: Cover, functions: Mapping[str, Any], positions: Array, dictionary: Dictionary
) -> Iterator[tuple[int, Functions, Array]]:
    """Yield channel, its functions, and the patch vertices (M, r) in its frames."""
    channels = functions["scales"].shape[1]
    patch = cover.patch_of_vertex
    for channel in range(channels):
        part = slice(None) if channels == 1 else slice(channel, channel + 1)
        inside = positions[:, part] - functions["origins"][patch][:, part]
        target = inside * functions["scales"][patch, channel][:, None]
        of = Functions.of(dictionary, functions["support"][:, part], functions["coefficients"][:, part])
        yield channel, of, target
