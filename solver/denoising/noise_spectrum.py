"""How large noise is at several scales: what tells a depth camera's errors from independent ones.

The errors of neighbouring points of a depth camera are alike.  Looked at closely they are small; over a wider patch
they are not.  Quadratics are fitted to disks of growing radius, and the lower quartile of what they leave is compared
with what noise of known correlation lengths would leave on a regular lattice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy  # loads `optimize` on first use
from scipy.sparse import csr_array

from ..arrays import Array, Indices, slices_of
from ..mesh.normals import unit
from ..mesh.quadrics import quadric_terms
from ..mesh.triangle_mesh import TriangleMesh
from .seeds import scattered

RINGS = (2, 3, 4, 5, 6, 8)
"""Radii of the disks, in edges."""

LENGTHS = (0.0, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0)
"""Correlation lengths, in edges: errors at a distance d correlate at exp(-d^2 / (4 length^2))."""

_DISKS = 400
_FEWEST_DISKS = 50
_DISKS_AT_ONCE = 50  # so that what is computed of them stays in the second cache
_TERMS = 6
_UNLIKE_WHITE = 0.25  # relative misfit of independent noise and shape to the spectrum; up to 0.2 by chance
_EXPLAINED = 0.15  # of that misfit may remain with correlated noise
_SHAPE_SHARE = 0.2  # of the largest disks' squared residuals may be shape


@dataclass(frozen=True)
class CorrelatedNoise:
    """Noise whose neighbouring errors are alike.

    Attributes
    ----------
    level
        Standard deviation along the normals.
    inflation
        How many times as large independent noise would be that averages over many vertices show as much of; found up
        to a quarter too large, as the quartiles are compared as if residuals were independent.
    length
        Correlation length in edges, the root mean square over the noise.
    """

    level: float
    inflation: float
    length: float


def correlated_noise(mesh: TriangleMesh, normals: Array, has_lines: bool = False) -> CorrelatedNoise | None:
    """Return the noise of a mesh if it is correlated, None if it is not, or if shape may explain what is found.

    The squared residuals of the disks are fitted, with relative errors and weights of 0 or more, as a sum of noise of
    each correlation length and of a cubic shape, which grows with the sixth power of the radius.  Where it is known
    that each line of a scan has an error of its own, independent noise, such lines and shape are fitted.

    Parameters
    ----------
    mesh
        The noisy mesh.
    normals
        Smoothed unit normals of its nodes, (N, 3).
    has_lines
        Whether errors are alike along lines of one direction (see `scan_structure`).
    """
    found = measured_spectrum(mesh, normals)
    if found is None or not found.all():
        return None
    shape = (np.array(RINGS) / RINGS[-1])[:, None] ** 6.0
    noise, inflation = _lattice_spectra()
    if has_lines:
        return _noise_with_lines(np.hstack([noise[:, :1], _spectrum_of_lines()[0], shape]) / found[:, None])
    ones = np.ones(len(RINGS))
    _, white = scipy.optimize.nnls(np.hstack([noise[:, :1], shape]) / found[:, None], ones)
    parts, rest = scipy.optimize.nnls(np.hstack([noise, shape]) / found[:, None], ones)
    total = float(parts[:-1].sum())
    if white < _UNLIKE_WHITE or rest > _EXPLAINED * white or parts[-1] > _SHAPE_SHARE * found[-1] or total == 0:
        return None
    length = float(np.sqrt(parts[:-1] @ np.square(LENGTHS) / total))
    return CorrelatedNoise(float(np.sqrt(total)), float(np.sqrt(parts[:-1] @ inflation / total)), length)


def _noise_with_lines(spectra: Array) -> CorrelatedNoise | None:
    parts, _ = scipy.optimize.nnls(spectra, np.ones(len(spectra)))
    independent, lines, _ = parts
    total = float(independent + lines)
    if total == 0:
        return None
    inflation = float(np.sqrt((independent + lines * _spectrum_of_lines()[1]) / total))
    return CorrelatedNoise(float(np.sqrt(total)), inflation, 0.0)


def measured_spectrum(mesh: TriangleMesh, normals: Array) -> Array | None:
    """Return the disks' mean squared residuals, (R,), or None if too few disks miss the border.

    Where only part of the disks holds shape, the lower quartile does not: it is taken, over what it is for noise of
    variance 1.
    """
    outside = mesh.border | ~mesh.used
    seeds = scattered(np.flatnonzero(~outside))[:_DISKS]
    if len(seeds) < _FEWEST_DISKS:
        return None
    rows = np.arange(len(seeds))
    disks = csr_array((np.ones(len(seeds), dtype=bool), (rows, seeds)), shape=(len(seeds), mesh.node_count))
    positions = mesh.vertices[mesh.node_vertex]
    quartiles = []
    for ring in range(1, RINGS[-1] + 1):
        disks = csr_array(disks @ mesh.reach)
        if ring in RINGS:
            whole = (disks @ outside.astype(np.float64)) == 0
            if whole.sum() < _FEWEST_DISKS:
                return None
            residuals = _residuals(csr_array(disks[whole]), seeds[whole], positions, normals)
            freedom = max(float(np.median(np.diff(disks.indptr)[whole])) - _TERMS, 1.0)
            quartiles.append(np.quantile(residuals, 0.25) / _lower_quartile(freedom))
    return np.array(quartiles)


def _residuals(disks: csr_array, seeds: Indices, positions: Array, normals: Array) -> Array:
    """Return the mean squared distances of the disks' vertices from quadratics, by degree of freedom, (P,)."""
    residuals = np.empty(len(seeds))
    for part in slices_of(len(seeds), _DISKS_AT_ONCE):
        offsets = disks.indptr[part.start : min(part.stop, len(seeds)) + 1]
        counts, members = np.diff(offsets), positions[disks.indices[offsets[0] : offsets[-1]]]
        residuals[part] = _residuals_of(members, counts, positions[seeds[part]], normals[seeds[part]])
    return residuals


def _residuals_of(members: Array, counts: Indices, centres: Array, upright: Array) -> Array:
    """Return `_residuals` of disks whose vertices, `counts` of each, stand one after the other, (N, 3)."""
    first = unit(np.cross(upright, np.eye(3)[np.abs(upright).argmin(axis=1)]))
    frames = np.stack((first, np.cross(upright, first), upright), axis=2)
    inside = np.arange(int(counts.max())) < counts[:, None]
    local = np.zeros((*inside.shape, 3))
    local[inside] = members - np.repeat(centres, counts, axis=0)
    u, v, height = np.ascontiguousarray((local @ frames).transpose(2, 0, 1))
    scale = np.sqrt((u**2 + v**2).sum(axis=1) / counts)
    scale = np.where(scale > 0, scale, 1.0)[:, None]
    columns = np.empty((len(counts), _TERMS + 1, inside.shape[1]))
    columns[:, :_TERMS] = quadric_terms(u / scale, v / scale, axis=1)
    columns[:, 0], columns[:, _TERMS] = inside, height / scale
    sums = columns @ columns.transpose(0, 2, 1)
    gram = sums[:, :_TERMS, :_TERMS] + 1e-9 * counts[:, None, None] * np.eye(_TERMS)
    targets = sums[:, :_TERMS, _TERMS]
    coefficients = np.linalg.solve(gram, targets[..., None])[..., 0]
    squared = np.maximum(sums[:, _TERMS, _TERMS] - (coefficients * targets).sum(axis=1), 0.0)
    slope = 1 + coefficients[:, 1] ** 2 + coefficients[:, 2] ** 2
    residuals: Array = squared * scale[:, 0] ** 2 / (np.maximum(counts - _TERMS, 1) * slope)
    return residuals


def _lower_quartile(freedom: float) -> float:
    """Return the lower quartile of chi-squared over its degrees of freedom (Wilson and Hilferty 1931)."""
    part = 2 / (9 * freedom)
    return float((1 - part - 0.6745 * np.sqrt(part)) ** 3)


def _lattice() -> tuple[Array, Indices, Indices]:
    """Return a disk of a triangular lattice: positions, (N, 2), rings and rows, (N,) both."""
    side = np.arange(-RINGS[-1], RINGS[-1] + 1)
    i, j = (part.ravel() for part in np.meshgrid(side, side))
    ring = np.maximum(np.maximum(np.abs(i), np.abs(j)), np.abs(i + j))
    inside = ring <= RINGS[-1]
    return np.column_stack([i + 0.5 * j, np.sqrt(0.75) * j])[inside], ring[inside], j[inside]


@lru_cache(maxsize=1)
def _lattice_spectra() -> tuple[Array, Array]:
    """What noise of variance 1 and of each length leaves on a triangular lattice.

    Returns
    -------
    Mean squared residuals by degree of freedom, (R, L), and the sum of the correlations with one vertex, (L,).
    """
    at, ring, _ = _lattice()
    squared = ((at[:, None] - at) ** 2).sum(axis=2)
    spectra = np.empty((len(RINGS), len(LENGTHS)))
    inflation = np.empty(len(LENGTHS))
    for column, length in enumerate(LENGTHS):
        kernel = np.exp(-squared / (4 * length**2)) if length else np.eye(len(at))
        inflation[column] = kernel[ring == 0].sum()
        for row, radius in enumerate(RINGS):
            disk = ring <= radius
            basis, _ = np.linalg.qr(np.asarray(quadric_terms(at[disk, 0], at[disk, 1], axis=1)))
            own = kernel[np.ix_(disk, disk)]
            left = np.trace(own) - np.einsum("ik,ij,jk->", basis, own, basis, optimize=True)
            spectra[row, column] = left / (disk.sum() - _TERMS)
    return spectra, inflation


@lru_cache(maxsize=1)
def _spectrum_of_lines() -> tuple[Array, float]:
    """What an error of variance 1 for each row of a triangular lattice leaves.

    Returns
    -------
    As much as the quartiles of independent noise would have to have, (R, 1): few rows scatter more than many vertices
    (Satterthwaite 1946).  And how much more of it the mean over one of the smallest disks shows than of independent
    noise, variance for variance.
    """
    at, ring, row = _lattice()
    spectrum = np.empty((len(RINGS), 1))
    for place, radius in enumerate(RINGS):
        disk = ring <= radius
        basis, _ = np.linalg.qr(np.asarray(quadric_terms(at[disk, 0], at[disk, 1], axis=1)))
        rows = (row[disk][:, None] == row[disk]).astype(np.float64)
        left = rows - basis @ (basis.T @ rows)
        left -= (left @ basis) @ basis.T
        freedom, count = np.trace(left) ** 2 / (left**2).sum(), disk.sum() - _TERMS
        spectrum[place] = np.trace(left) / count * _lower_quartile(freedom) / _lower_quartile(count)
    smallest = row[ring <= RINGS[0]]
    return spectrum, float((smallest[:, None] == smallest).sum() / len(smallest))
