"""Writing: a representation as head and blocks, exact or compact."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...arrays import Array, Booleans, Indices
from ...fitting.dictionary import Dictionary
from ...mesh.edges import connected_parts
from ...mesh.pieces import Pieces
from .balancing import BalancedWriting, Leverage
from .blocks import BlockWriter
from .canonical import Canonical, Fields, Quality
from .connectivity import write_faces, write_triangles
from .content import Sizes
from .cover import ring_members, weights_of
from .domains import Functions, Shapes, code_domains, shares_of
from .entropy import NumberWriter, TooLargeError, whole_numbers
from .functions import coefficient_steps, degrees_of, domain_inputs, domain_steps, mean_positions, position_steps
from .growth import Writing
from .positions import code_positions
from .recognition import levels_of, renumbered, rings_of

INSIDE = np.array([[2, 2, 2], [3, 3, 0], [0, 3, 3], [3, 0, 3]]) / 6.0
"""Places in a triangle where the move is measured, besides its corners."""

ATTEMPTS, MOST_FINER = 20, 0.05
"""Roundings of functions that are tried, and the share of vertices that may get finer steps."""

DOMAIN_ATTEMPTS = 10
"""Roundings of domains that are tried with the same functions."""

SMALLER, LITTLE_SMALLER = 0.84, 0.94
"""By how much steps of functions, and of domains, differ from one attempt to the next, at first."""

FUNCTIONS_SHARES = (0.85, 0.6)
"""How much of the permitted move rounded functions may make alone, before the domains are rounded.

The second is for a surface that the first leaves too far away in some place, however finely its domains are rounded.
"""

SMALL_PIECE, SMALLEST_SHARE, FEWEST_TRIANGLES = 10.0, 1e-3, 12
"""Lengths are kept as exactly as a piece needs that is so many times smaller than the whole, but not more exactly than
for a whole that is a share of this one's size.  Pieces of fewer triangles than a cube has do not count."""

ENERGY_STEP = 2
"""Steps that rounded energies differ by, in hundredths of their logarithms."""


@dataclass(frozen=True)
class Written:
    """What a file holds: `sizes`, `blocks`, and how far the surface moved by rounding, in longest sides: `error`."""

    sizes: Sizes
    blocks: BlockWriter
    error: float


def write(surface: Any, quality: Quality) -> Written:
    """Write a representation with the given quality."""
    blocks, own = BlockWriter(quality.quick), Canonical.of(surface)
    cover = own.cover
    longest = float(np.ptp(surface.vertices, axis=0).max()) or 1.0
    side = _side(surface, longest)
    _write_mesh(blocks, surface, own, not quality.domains)
    centres = _write_cover(blocks, surface, own)
    weights = surface.weights[own.rows]
    _write_weights(blocks, surface, own, weights)
    positions = _write_positions(blocks, surface, quality, side)
    moved = SurfaceWriting(surface, own, positions, centres, side).write(blocks, quality)
    blocks_of_energy(blocks, surface.energy, bool(quality.functions))
    if not surface.initial:
        blocks.real("initial_domains", surface.initial_domains[:, own.rows].astype(np.float32))
    sizes = Sizes(
        vertices=len(surface.vertices),
        faces=len(surface.face_offsets) - 1,
        face_corners=len(surface.face_corners),
        triangles=len(surface.triangles),
        nodes=len(own.node_vertex),
        patches=len(centres),
        patch_vertices=len(cover.nodes),
        patch_triangles=len(cover.mesh_triangles),
        domains=len(surface.domains),
        functions=surface.support.shape[2],
        iterations=surface.energy.shape[1],
    )
    return Written(sizes, blocks, moved * side / longest)


def _side(surface: Fields, longest: float) -> float:
    """The length that the quality's shares are taken of: the longest side, or less where there are small pieces."""
    corners = surface.triangles
    count, piece = connected_parts(corners[:, :2].ravel(), corners[:, 1:].ravel(), len(surface.vertices))
    sizes = Pieces.of(surface.vertices, piece, count).sizes
    counted = np.bincount(piece[corners[:, 0]], minlength=count) >= FEWEST_TRIANGLES
    smallest = float(sizes[counted].min(initial=longest))
    return min(longest, max(SMALL_PIECE * smallest, SMALLEST_SHARE * longest))


def _write_mesh(blocks: BlockWriter, surface: Fields, own: Canonical, plain: bool) -> None:
    triangles = surface.triangles
    own_faces = (
        len(surface.face_corners) == triangles.size
        and (np.diff(surface.face_offsets) == 3).all()
        and np.array_equal(surface.face_corners, triangles.ravel())
        and np.array_equal(surface.polygon, np.arange(len(triangles)))
    )
    if own_faces:
        write_triangles(blocks, triangles, plain)
    else:
        write_faces(blocks, surface.face_offsets, surface.face_corners, triangles, surface.polygon)
    if len(surface.creases):
        _write_set(blocks, "creases", np.unique(surface.fans.sides.min(axis=1)))
    found = len(surface.creases) > 0 and np.array_equal(
        own.nodes, renumbered(surface.fans.corners, triangles, len(surface.vertices))
    )
    if plain or not found:
        cut = np.flatnonzero(own.nodes.ravel() != triangles.ravel())
        _write_set(blocks, "cut_corners", cut)
        blocks.whole("cut_nodes", own.nodes.ravel()[cut] - len(surface.vertices))


def _write_set(blocks: BlockWriter, name: str, ascending: Indices) -> None:
    blocks.whole(name, np.diff(ascending, prepend=0))


def _write_cover(blocks: BlockWriter, surface: Fields, own: Canonical) -> Indices:
    cover, incidence = own.cover, own.incidence
    centres, rings = rings_of(cover, incidence)
    blocks.whole("centres", np.diff(centres, prepend=0))
    blocks.whole("rings", rings)
    members = ring_members(incidence, centres, rings, len(cover.mesh_triangles))
    count = np.int64(len(surface.triangles))
    keys = np.repeat(np.arange(len(centres)), np.diff(members.indptr)) * count + members.indices
    patch = np.repeat(np.arange(len(centres)), np.diff(cover.triangle_offsets))
    more = ~np.isin(patch * count + cover.mesh_triangles, keys)
    blocks.whole("more_sizes", np.bincount(patch[more], minlength=len(centres)))
    _write_set(blocks, "more_triangles", cover.mesh_triangles[more])
    # which triangles a patch has the other way round than the mesh
    order = own.triangle_rows
    first = np.repeat(surface.vertex_offsets[:-1], np.diff(surface.triangle_offsets))
    given = (surface.patch_triangles + first[:, None])[order]
    mesh_order = surface.corners[order]
    at = (given == mesh_order[:, :1]).argmax(axis=1)
    following = np.take_along_axis(given, ((at + 1) % 3)[:, None], axis=1)[:, 0]
    turned = following != mesh_order[:, 1]
    in_mesh = np.zeros(len(surface.triangles), dtype=bool)
    in_mesh[cover.mesh_triangles[turned]] = True
    _write_set(blocks, "turned", np.flatnonzero(in_mesh))
    _write_set(blocks, "turned_back", np.flatnonzero(turned != in_mesh[cover.mesh_triangles]))
    return centres


def _write_weights(blocks: BlockWriter, surface: Fields, own: Canonical, weights: Array) -> None:
    cover = own.cover
    vertices = own.node_vertex[cover.nodes]
    depth = cover.rim_distances(own.incidence)
    total = np.bincount(vertices, weights=weights, minlength=len(surface.vertices))
    deepest = np.zeros(len(surface.vertices), dtype=np.int64)
    np.maximum.at(deepest, vertices, depth)
    passed = (total == 0.0) & (deepest > 0)
    levels = levels_of(cover, cover.nodes, depth, weights) if surface.blending == "partition" else None
    levels = np.zeros(len(cover.vertex_offsets) - 1, dtype=np.int64) if levels is None else levels
    found = weights_of(cover, vertices, depth, levels, passed, surface.blending)
    if not np.allclose(found, weights, rtol=1e-9, atol=1e-12):
        blocks.real("weights", weights)
        return
    _write_set(blocks, "passed_through", np.flatnonzero(passed))
    blocks.whole("levels", levels)


def _write_positions(blocks: BlockWriter, surface: Fields, quality: Quality, side: float) -> Array:
    with contextlib.suppress(TooLargeError):
        if quality.vertices:
            return _rounded_positions(blocks, surface, quality, side)
    blocks.real("exact_vertices", surface.vertices.T)
    return surface.vertices


def _rounded_positions(blocks: BlockWriter, surface: Fields, quality: Quality, side: float) -> Array:
    low = surface.vertices.min(axis=0)
    total: Array = np.bincount(surface.patch_vertices, surface.weights, len(surface.vertices)).astype(np.float64)
    steps = position_steps(surface.triangles, total, quality.vertices * side, quality.shown * side)
    writing = Writing(surface.vertices - low)
    positions = code_positions(surface.triangles, steps, writing) + low
    blocks.real("lowest", low)
    blocks.real("vertex_steps", np.array([quality.vertices, quality.shown]) * side)
    writing.numbers.finish(blocks, "vertices")
    return positions


def _rounded_functions(blocks: BlockWriter, surface: Fields, mean: Array, step: float) -> dict[str, Any]:
    number = whole_numbers((surface.origins - mean) / step)
    # powers of two take little room; coefficients follow them
    scales = np.ldexp(1.0, np.rint(np.log2(surface.scales)).astype(np.int64))
    width = surface.support.shape[2]
    order = np.argsort(np.where(surface.support < 0, np.iinfo(np.int64).max, surface.support), axis=2, kind="stable")
    support = np.take_along_axis(surface.support, order, axis=2)
    scaled = surface.coefficients * (scales / surface.scales)[:, :, None]
    given = np.where(support < 0, 0.0, np.take_along_axis(scaled, order, axis=2))
    steps = coefficient_steps(scales, step, support)
    coefficients = whole_numbers(given / steps)
    blocks.real("function_step", np.array([step]))
    blocks.whole("origins", number.T)
    blocks.real("scales", scales)
    blocks.whole("used", (support >= 0).sum(axis=2))
    filled = np.where(support < 0, np.maximum.accumulate(support, axis=2), support)
    blocks.whole("support", np.diff(filled, axis=2, prepend=-1).transpose(2, 1, 0) if width else filled)
    writer = NumberWriter()
    writer.add(coefficients[support >= 0], degrees_of(support[support >= 0]))
    writer.finish(blocks, "coefficients")
    return {
        "origins": mean + number * step,
        "scales": scales,
        "support": support,
        "coefficients": coefficients * steps,
    }


@dataclass
class SurfaceWriting:
    """The functions and domains of a representation, rounded in such a way that its surface hardly moves."""

    surface: Any
    own: Canonical
    positions: Array
    centres: Indices
    side: float
    functions: dict[str, Any] = field(default_factory=dict)

    def write(self, blocks: BlockWriter, quality: Quality) -> float:
        """Add frames, functions and domains; return how far the surface will have moved."""
        shares = FUNCTIONS_SHARES if quality.functions and quality.domains else FUNCTIONS_SHARES[:1]
        for share in shares:
            draft = BlockWriter(quality.quick)
            self.functions = self._write_functions(draft, quality, share)
            with contextlib.suppress(TooLargeError):
                moved = self._stepped(draft, quality) if quality.domains else None
                if moved is not None:
                    break
        else:
            moved = self._plain(draft, quality.error)
        blocks.take(draft)
        return moved

    def _write_functions(self, blocks: BlockWriter, quality: Quality, share: float) -> dict[str, Any]:
        """Add frames and functions; return them as they will be read.

        Steps are made smaller until rounding alone moves the surface by less than is permitted.  Most of that is made
        up for when the domains are rounded.
        """
        step, cover = quality.functions * self.side, self.own.cover
        mean = mean_positions(cover, self.positions[self.own.node_vertex[cover.nodes]])
        with contextlib.suppress(TooLargeError):
            for attempt in range(ATTEMPTS if step else 0):
                draft = BlockWriter()
                found = _rounded_functions(draft, self.surface, mean, step)
                if self._moved(replace(self.surface, **found)).max(initial=0.0) <= share * quality.error:
                    blocks.take(draft)
                    return found
                step *= SMALLER if attempt < ATTEMPTS // 4 else SMALLER**4
        names = ("origins", "scales", "support", "coefficients")
        for name in names:
            add = blocks.whole if name == "support" else blocks.real
            add(f"exact_{name}", getattr(self.surface, name))
        return {name: getattr(self.surface, name) for name in names}

    def _stepped(self, blocks: BlockWriter, quality: Quality) -> float | None:
        """Add rounded domains; return how far the surface will have moved, or None where it moves too far.

        Vertices that would move too far get finer steps; where these are many, all do.
        """
        step, finer = quality.domains * self.side, np.zeros(len(self.surface.vertices), dtype=bool)
        for attempt in range(DOMAIN_ATTEMPTS):
            domains, writers = self._rounded((step, quality.share), finer, bool(quality.functions))
            moved = self._moved(self._surface_with(domains))
            far = self._vertices_at(moved > quality.error)
            if not far.any():
                break
            if np.count_nonzero(far & ~finer) > MOST_FINER * len(finer) or (far & finer).any():
                smaller = LITTLE_SMALLER if attempt < DOMAIN_ATTEMPTS // 2 else SMALLER**2
                step, finer = smaller * step, np.zeros_like(finer)
            else:
                finer |= far
        else:
            return None
        blocks.real("domain_step", np.array([step, quality.share]))
        _write_set(blocks, "finer", np.flatnonzero(finer))
        for channel, writer in enumerate(writers):
            writer.finish(blocks, f"domains_{channel}")
        return float(moved.max(initial=0.0))

    def _plain(self, blocks: BlockWriter, error: float) -> float:
        """Add the domains as they are, in single precision where that moves the surface little enough."""
        domains = self.surface.domains[:, self.own.rows]
        single, moved = domains.astype(np.float32).astype(np.float64), 0.0
        if error > 0.0:
            moved = float(self._moved(self._surface_with(single)).max(initial=0.0))
            domains, moved = (single, moved) if moved <= error else (domains, 0.0)
        blocks.real("exact_domains", domains)
        return moved

    def _rounded(self, step: tuple[float, float], finer: Booleans, balanced: bool) -> tuple[Array, list[NumberWriter]]:
        cover, vertices = self.own.cover, self.own.node_vertex[self.own.cover.nodes]
        given, at = self.surface.domains[:, self.own.rows], self.positions[vertices]
        weights, shapes = self.surface.weights[self.own.rows], Shapes.of(self.positions, self.surface.triangles)
        domains, writers = np.empty_like(given), []
        dictionary = Dictionary(self.surface.degree, self.surface.basis)
        moved = self._surface_with(given).at_vertices() - self.surface.at_vertices()
        for channel, part, target in domain_inputs(cover, self.functions, at, dictionary):
            scales = self.functions["scales"][:, channel]
            steps = domain_steps(cover, weights, scales, step, finer[vertices])
            writing = Writing(given[channel])
            if balanced:
                leverage = self._leverage(vertices, part, given[channel], scales, shares_of(cover, weights, step[1]))
                axes = slice(None) if len(given) == 1 else slice(channel, channel + 1)
                writing = BalancedWriting(given[channel], leverage, moved[:, axes])
            domains[channel] = code_domains(cover, self.centres, shapes, target, part, steps, writing)
            writers.append(writing.numbers)
        return domains, writers

    def _leverage(
        self, vertices: Indices, functions: Functions, domain: Array, scales: Array, shares: Array
    ) -> Leverage:
        patch = self.own.cover.patch_of_vertex
        derivative = np.stack(functions(patch, domain)[1:], axis=2).transpose(1, 0, 2) / scales[patch, None, None]
        return Leverage.of(vertices, derivative, self.surface.weights[self.own.rows], shares)

    def _surface_with(self, domains: Array) -> Any:
        back = np.empty_like(self.own.rows)
        back[self.own.rows] = np.arange(len(back))
        return replace(self.surface, **self.functions, domains=domains[:, back])

    def _moved(self, surface: Any) -> Array:
        """How far a surface lies from the given one, in sides: at the vertices and in every triangle."""
        moved: Array = np.linalg.norm(self._points(surface) - self._before, axis=1) / self.side
        return moved

    @cached_property
    def _before(self) -> Array:
        return self._points(self.surface)

    def _points(self, surface: Any) -> Array:
        triangles = len(self.surface.triangles)
        inside = surface.evaluate(np.repeat(np.arange(triangles), len(INSIDE)), np.tile(INSIDE, (triangles, 1)))
        return np.concatenate([surface.at_vertices(), inside])

    def _vertices_at(self, far: Booleans) -> Booleans:
        """Tell which vertices, (V,), have moved too far or are corners of triangles that have in some place."""
        triangles = self.surface.triangles
        at_vertex, inside = far[: -len(INSIDE) * len(triangles)].copy(), far[-len(INSIDE) * len(triangles) :]
        at_vertex[triangles[inside.reshape(len(triangles), -1).any(axis=1)]] = True
        return at_vertex


def blocks_of_energy(blocks: BlockWriter, energy: Array, rounded: bool) -> None:
    """Add the energies, (K, I): to 1 % of themselves if `rounded`, else in single precision."""
    finite = np.isfinite(energy)
    counts = finite.sum(axis=1)
    leading = (finite == (np.arange(energy.shape[1]) < counts[:, None])).all()
    if not (rounded and leading and (energy[finite] > 0.0).all()):
        blocks.real("exact_energy", energy.astype(np.float32))
        return
    steps = np.zeros(energy.shape)
    steps[finite] = ENERGY_STEP * np.rint(np.log(energy[finite]) * 100.0 / ENERGY_STEP)
    change = np.where(finite, np.diff(steps, axis=1, prepend=0.0), 0.0)
    blocks.whole("energy_counts", counts)
    blocks.whole("energy", change.T)
