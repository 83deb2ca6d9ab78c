"""What there is to see of a representation: single patches, their domains and functions, domains as texture charts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Indices
from ..errors import InputError
from .representation import Representation
from .resampling import face_corners_of_triangles, resample

CHART_MARGIN = 0.04
"""Space around each chart of an atlas, as a share of its tile."""


@dataclass(frozen=True)
class Term:
    """One function of the dictionary that a patch uses.

    Attributes
    ----------
    name
        Such as "P2(u) P1(v)".
    amounts
        Its coefficients in x, y and z, scene units; 0 where a coordinate does not use it.
    """

    name: str
    amounts: tuple[float, float, float]


def patch_terms(representation: Representation, patch: int) -> list[Term]:
    """Return the functions that a patch uses, the largest amounts first, equals in the dictionary's order."""
    _check_patch(representation, patch)
    amounts = np.zeros((representation.dictionary.size, 3))
    used = np.zeros(len(amounts), dtype=bool)
    channels = np.broadcast_to(representation.scales[patch], (3,))
    for d in range(3):
        support = representation.support[patch, d]
        chosen = support >= 0
        np.add.at(amounts[:, d], support[chosen], representation.coefficients[patch, d][chosen] / channels[d])
        used[support[chosen]] = True
    names = representation.dictionary.names()
    order = np.argsort(-np.abs(amounts).max(axis=1), kind="stable")
    return [Term(names[n], (x, y, z)) for n in order if used[n] for x, y, z in [map(float, amounts[n])]]


def patch_energy(representation: Representation, patch: int) -> list[float]:
    """Return a patch's objective after each iteration, relative to the first one."""
    _check_patch(representation, patch)
    energy = representation.energy[patch]
    energy = energy[~np.isnan(energy)]
    return [float(value) for value in energy / energy[0]] if len(energy) and energy[0] > 0.0 else [0.0] * len(energy)


@dataclass(frozen=True)
class PatchSheet:
    """A patch by itself, finely triangulated: P points, F triangles.

    Attributes
    ----------
    triangles
        (F, 3).
    source
        Patch triangle that each lies in, (F,).
    initial_domains, domains
        Where its points lie in the domains, (C, P, 2).
    values
        The patch's own surface, not blended with others, (P, 3), scene units.
    heights
        The patch's functions in its frame, on the scale of the domains, (P, 3).
    """

    triangles: Indices
    source: Indices
    initial_domains: Array
    domains: Array
    values: Array
    heights: Array


def patch_sheet(representation: Representation, patch: int, splits: int = 1) -> PatchSheet:
    """Take a patch out of a representation, every edge of its triangles split into `splits`.

    Raises
    ------
    InputError
        When there is no such patch.
    """
    alone = single_patch(representation, patch)
    mesh = resample(alone, splits)
    at = mesh.at_vertices
    channels = np.broadcast_to(representation.scales[patch], (3,))
    return PatchSheet(
        mesh.corners.reshape(-1, 3),
        mesh.source_face,
        np.stack([at.linear(domain) for domain in alone.initial_domains]),
        np.stack([at.linear(domain) for domain in alone.domains]),
        mesh.vertices,
        (mesh.vertices - representation.origins[patch]) * channels,
    )


def single_patch(representation: Representation, patch: int) -> Representation:
    """Return a representation of one patch, over a mesh of its own triangles."""
    _check_patch(representation, patch)
    vertices = slice(*representation.vertex_offsets[patch : patch + 2])
    rows = slice(*representation.triangle_offsets[patch : patch + 2])
    triangles = representation.patch_triangles[rows]
    count, size = len(triangles), vertices.stop - vertices.start
    own = slice(patch, patch + 1)
    return replace(
        representation,
        vertices=representation.vertices[representation.patch_vertices[vertices]],
        triangles=triangles,
        polygon=np.arange(count),
        face_offsets=3 * np.arange(count + 1),
        face_corners=triangles.ravel(),
        vertex_offsets=np.array([0, size]),
        patch_vertices=np.arange(size),
        triangle_offsets=np.array([0, count]),
        patch_triangles=triangles,
        mesh_triangles=np.arange(count),
        domains=representation.domains[:, vertices],
        initial_domains=representation.initial_domains[:, vertices],
        weights=np.ones(size),
        blending="partition",
        origins=representation.origins[own],
        scales=representation.scales[own],
        support=representation.support[own],
        coefficients=representation.coefficients[own],
        energy=representation.energy[own],
        creases=np.zeros((0, 2), dtype=np.int64),
    )


def face_patches(representation: Representation) -> Indices:
    """Patch that counts most on each input face and holds all of it, (F,); -1 where there is none."""
    count = len(representation.face_offsets) - 1
    faces = representation.polygon[representation.mesh_triangles]
    key, which = np.unique(faces * representation.patches + representation.patch_of_triangle, return_inverse=True)
    score = np.bincount(which, weights=representation.corner_weights().sum(axis=1))
    held = np.bincount(which)
    face, patch = np.divmod(key, max(representation.patches, 1))
    whole = (held == np.bincount(representation.polygon, minlength=count)[face]) & (score > 0.0)
    face, patch, score = face[whole], patch[whole], score[whole]
    order = np.lexsort((-patch, score))  # the largest score comes last and stays
    best = np.full(count, -1)
    best[face[order]] = patch[order]
    return best


def domain_atlas(representation: Representation, domains: Array) -> Array:
    """Lay one domain of every patch out as a texture chart, in tiles of the unit square.

    Each face appears once, in the chart of the patch that counts most on it.

    Parameters
    ----------
    domains
        One of the representation's `domains` or `initial_domains`, (M, 2).

    Returns
    -------
    ndarray
        Texture coordinates of the face corners, (L, 2); zero on faces that no patch holds.
    """
    places = _tile_places(representation, domains)
    best = face_patches(representation)
    patch = representation.patch_of_triangle
    shown = np.flatnonzero(best[representation.polygon[representation.mesh_triangles]] == patch)
    corners = face_corners_of_triangles(representation)[representation.mesh_triangles[shown]]
    coordinates = np.zeros((len(representation.face_corners), 2))
    coordinates[corners] = places[representation.corners[shown]]
    return coordinates


def _tile_places(representation: Representation, domains: Array) -> Array:
    """Move each patch's domain into a tile of its own, (M, 2), all by the same scale in u and v."""
    count = representation.patches
    if not count:
        return np.zeros((0, 2))
    low = np.minimum.reduceat(domains, representation.vertex_offsets[:-1])
    high = np.maximum.reduceat(domains, representation.vertex_offsets[:-1])
    across = int(np.ceil(np.sqrt(count)))
    tile = 1.0 / across
    sizes = np.diff(representation.vertex_offsets)
    reach = np.repeat((high - low).max(axis=1), sizes)
    centre = np.repeat((high + low) / 2.0, sizes, axis=0)
    row, column = np.divmod(np.repeat(np.arange(count), sizes), across)
    middle = (np.stack([column, row], axis=1) + 0.5) * tile
    places: Array = middle + (domains - centre) / np.maximum(reach, 1e-300)[:, None] * tile * (1.0 - 2.0 * CHART_MARGIN)
    return places


def _check_patch(representation: Representation, patch: int) -> None:
    if not 0 <= patch < representation.patches:
        raise InputError(f"There is no patch {patch}; the patches are numbered from 0 to {representation.patches - 1}.")
