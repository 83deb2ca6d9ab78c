"""Orders of faces and vertices: what is written comes back, in few bytes among neighbours; forged ones do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.native import library
from sparse_surface.solver.surface.container import Refusal
from sparse_surface.solver.surface.format import listing
from sparse_surface.solver.surface.format.blocks import BlockReader, BlockWriter
from sparse_surface.solver.surface.format.capping import opposite_sides
from sparse_surface.solver.surface.format.connectivity import read_triangles, write_triangles
from sparse_surface.solver.surface.format.listing import Listing, listing_of_faces, listing_of_vertices

Numbers = NDArray[np.int64]


@pytest.fixture(params=["kernel", "numpy"])
def _reader(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "numpy":
        monkeypatch.setattr(listing, "reason_against", lambda: "Not here.")
    elif library.reason_against() is not None:
        pytest.skip(str(library.reason_against()))


both_readers = pytest.mark.usefixtures("_reader")


def torn(seed: int, share: float = 0.8) -> Numbers:
    """Return a part of a torus of triangles, in an order of its own."""
    quads = np.asarray(models.cubetorus()[1])
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int64)
    return triangles[np.random.default_rng(seed).random(len(triangles)) < share]


def grid(rows: int, columns: int) -> Numbers:
    """Return a grid listed column after column, each square as two triangles that begin at opposite corners."""
    corner = (np.arange(rows - 1)[None, :] * columns + np.arange(columns - 1)[:, None]).ravel()
    halves = [corner, corner + 1, corner + columns + 1], [corner + columns + 1, corner + columns, corner]
    return np.stack([np.stack(half, axis=1) for half in halves], axis=1).reshape(-1, 3)


def written(found: Listing) -> BlockReader:
    blocks = BlockWriter()
    found.write(blocks, "face")
    return BlockReader(blocks.content())


def faces_of(triangles: Numbers, seed: int, swaps: int) -> Numbers:
    """Return places at which triangles begin, some of which changed their places in the list and their beginnings."""
    random = np.random.default_rng(seed)
    order = np.arange(len(triangles))
    for one, other in random.integers(0, len(order), (swaps, 2)):
        order[[one, other]] = order[[other, one]]
    return 3 * order + np.where(random.random(len(order)) < 0.1, random.integers(0, 3, len(order)), 0)


@both_readers
@pytest.mark.parametrize("reach", [0, 1, 2, 3])
@pytest.mark.parametrize("swaps", [0, 30, 2000])
def test_orders_of_faces_come_back(reach: int, swaps: int) -> None:
    triangles = torn(swaps)
    sides, wanted = opposite_sides(triangles), faces_of(triangles, 1, swaps)
    found = Listing.read(written(listing_of_faces(sides, wanted, reach)), "face", len(triangles))
    each = 3 * np.arange(len(triangles))
    np.testing.assert_array_equal(found.places(sides, np.repeat(each // 3, 3), each), wanted)
    if reach == 0:
        assert not found.moves.any()


@both_readers
@pytest.mark.parametrize("reach", [0, 1, 3])
@pytest.mark.parametrize("seed", range(4))
def test_orders_of_vertices_come_back(reach: int, seed: int) -> None:
    triangles = torn(seed, 0.5)
    items, number = np.unique(triangles, return_inverse=True)
    first = np.full(len(items), -1)
    first[number.ravel()[::-1]] = np.arange(triangles.size)[::-1]
    order = np.arange(len(items)) if seed < 2 else np.random.default_rng(seed).permutation(len(items))
    sides = opposite_sides(triangles)
    found = listing_of_vertices(sides, number.ravel(), first, order, reach)
    np.testing.assert_array_equal(number.ravel()[found.places(sides, number.ravel(), first)], order)


def test_a_move_leads_where_it_says() -> None:
    """Two triangles beside each other: over side 0, then on to the corner that is not on it."""
    sides = opposite_sides(np.array([[0, 1, 2], [1, 0, 3]]))
    np.testing.assert_array_equal(sides, [3, -1, -1, 0, -1, -1])
    found = Listing(np.array([0, 1 + 3 * 1 + 2]), np.array([0]), np.array([0]), np.array([0]))
    np.testing.assert_array_equal(found.places(sides, np.repeat([0, 1], 3), np.array([0, 3])), [0, 5])


def test_neighbours_take_a_small_part_of_the_bytes() -> None:
    """A walk goes round a grid that lists its squares in columns and its vertices in rows: 20 bits and more a face."""
    triangles = grid(60, 80)
    blocks = BlockWriter()
    write_triangles(blocks, triangles, False)
    reader = BlockReader(blocks.content())
    np.testing.assert_array_equal(read_triangles(reader, len(triangles), 60 * 80), triangles)
    assert blocks.size < len(triangles) / 8


@both_readers
def test_forged_orders_are_refused() -> None:
    """Every changed number is refused, or leads to another order of all faces; never to another error."""
    triangles = torn(5)
    sides, wanted = opposite_sides(triangles), faces_of(triangles, 2, 40)
    own, refused = listing_of_faces(sides, wanted, 3), 0
    each, random = 3 * np.arange(len(triangles)), np.random.default_rng(0)
    for name in ("moves", "returns", "jumps", "turns"):
        numbers = getattr(own, name)
        for place in random.integers(0, len(numbers), 12):
            for change in (-(10**6), -1, 1, 4, 60, 10**6):
                changed = numbers.copy()
                changed[place] += change
                try:
                    found = Listing.read(written(replace(own, **{name: changed})), "face", len(triangles))
                    places = found.places(sides, np.repeat(each // 3, 3), each)
                except Refusal:
                    refused += 1
                else:
                    assert sorted((places // 3).tolist()) == list(range(len(triangles)))
    assert refused > 100


@pytest.mark.skipif(library.reason_against() is not None, reason="there is no kernel to compare with")
def test_the_kernel_refuses_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    triangles = torn(7)
    sides, wanted = opposite_sides(triangles), faces_of(triangles, 3, 60)
    own, random = listing_of_faces(sides, wanted, 3), np.random.default_rng(1)
    each = 3 * np.arange(len(triangles))

    def outcomes() -> list[bytes | None]:
        found: list[bytes | None] = []
        for given in forged:
            try:
                found.append(given.places(sides, np.repeat(each // 3, 3), each).tobytes())
            except Refusal:
                found.append(None)
        return found

    forged = [own]
    for name, end in (("moves", listing.MOVES), ("returns", listing.MOVES), ("jumps", len(triangles)), ("turns", 3)):
        for place in random.integers(0, len(getattr(own, name)), 40):
            changed = getattr(own, name).copy()
            changed[place] = random.integers(0, end)
            forged.append(replace(own, **{name: changed}))
    natively = outcomes()
    monkeypatch.setattr(listing, "reason_against", lambda: "Not here.")
    assert outcomes() == natively
    assert natively.count(None) > 20
