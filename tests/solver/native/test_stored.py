"""Reading number after number, with and without the kernel: what was written, plain loops, and the same refusals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.native import library
from sparse_surface.solver.surface.container import Refusal
from sparse_surface.solver.surface.format import entropy, growth, listing, walk
from sparse_surface.solver.surface.format.blocks import BlockReader, BlockWriter
from sparse_surface.solver.surface.format.capping import Capped
from sparse_surface.solver.surface.format.entropy import CONTEXTS, NumberReader, NumberWriter
from sparse_surface.solver.surface.format.growth import rounds
from sparse_surface.solver.surface.format.walk import Walk, Walking

Numbers = NDArray[np.int64]


@pytest.fixture(params=["kernel", "numpy"])
def _reader(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "numpy":
        without_kernel(monkeypatch)
    elif library.reason_against() is not None:
        pytest.skip(str(library.reason_against()))


both_readers = pytest.mark.usefixtures("_reader")


def without_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (entropy, growth, listing, walk):
        monkeypatch.setattr(module, "reason_against", lambda: "Not here.")


def numbers_of_all_sizes(count: int, seed: int) -> tuple[Numbers, Numbers]:
    """Return numbers of up to 46 bits and a sign, and a table for each that is used for sizes like its own."""
    random = np.random.default_rng(seed)
    sizes = np.concatenate([[46, 46, 0], random.integers(0, 47, count)])[:count]
    found = np.rint(random.uniform(-1.0, 1.0, count) * 2.0 ** sizes.astype(float)).astype(np.int64)
    found[:2] = [2**46 - 2, 2 - 2**46][: len(found)]
    return found, np.minimum(sizes // 2, CONTEXTS - 2)


def stored(found: Numbers, contexts: Numbers) -> NumberReader:
    writer, blocks = NumberWriter(), BlockWriter()
    writer.add(found, contexts)
    writer.finish(blocks, "some")
    return NumberReader(BlockReader(blocks.content()), "some", len(found))


@both_readers
@pytest.mark.parametrize("count", [0, 1, 3, 399, 1201, 120_000])
def test_numbers_come_back(count: int) -> None:
    found, contexts = numbers_of_all_sizes(count, count)
    reader, at, random = stored(found, contexts), 0, np.random.default_rng(1)
    while at < count:
        end = min(at + int(random.integers(1, 3000)), count)
        np.testing.assert_array_equal(reader.take(contexts[at:end]), found[at:end])
        at = end
    assert len(reader.take(contexts[:0])) == 0


@both_readers
def test_asking_for_more_than_there_is_is_refused() -> None:
    found, contexts = numbers_of_all_sizes(5000, 2)
    reader = stored(found, contexts)
    np.testing.assert_array_equal(reader.take(contexts), found)
    with pytest.raises(Refusal, match="is cut"):
        reader.take(np.resize(contexts, 10**5))
    with pytest.raises(Refusal, match="wrong table"):
        stored(found, contexts).take(np.array([CONTEXTS - 1]))


def grown(targets: Numbers, sources: Numbers, known: set[int]) -> Iterator[tuple[list[int], list[int], list[int]]]:
    """Look at every link in every round."""
    while True:
        links = [q for q, own in enumerate(sources.tolist()) if known.issuperset(own) and int(targets[q]) not in known]
        places = sorted({int(targets[q]) for q in links})
        if not links:
            return
        yield places, links, [places.index(int(targets[q])) for q in links]
        known |= set(places)


@both_readers
@pytest.mark.parametrize("seed", range(30))
def test_growth_is_that_of_plain_loops(seed: int) -> None:
    random = np.random.default_rng(seed)
    count, width = int(random.integers(1, 60)), int(random.integers(1, 4))
    links = int(random.integers(0, 8 * count))
    targets, sources = random.integers(0, count, links), random.integers(0, count, (links, width))
    known = random.random(count) < random.uniform(0.0, 0.6)
    expected = list(grown(targets, sources, set(np.flatnonzero(known).tolist())))
    found = list(rounds(targets, sources, known))
    assert [tuple(part.tolist() for part in one) for one in found] == expected
    reached = {place for places, _, _ in expected for place in places}
    assert known.sum() >= len(reached)
    assert known[sorted(reached)].all()


@both_readers
def test_growth_through_many_places_at_once() -> None:
    """Of 200,000 links half wait for each other in vain, and the others lead to all their places in one round."""
    count = 100_000
    along = np.arange(count)
    targets = np.concatenate([along[2:], along[2:]])
    sources = np.concatenate([np.stack([along[:-2], along[1:-1]], axis=1), np.full((count - 2, 2), count - 1)])
    known = np.zeros(count, dtype=bool)
    known[count - 1] = True
    (places, links, owner), *others = rounds(targets, sources, known)
    assert not others
    np.testing.assert_array_equal(places, along[2:-1])
    np.testing.assert_array_equal(links, np.arange(count - 2, 2 * count - 5))
    np.testing.assert_array_equal(owner, np.arange(count - 3))


def forged(found: Walk, seed: int) -> Iterator[Walk]:
    """Yield the walk, and walks with one number changed."""
    yield found
    parts = {name: getattr(found, name) for name in ("valences", "forks", "gaps", "targets")}
    random = np.random.default_rng(seed)
    for name, numbers in parts.items():
        for place in random.integers(0, max(len(numbers), 1), 8 if len(numbers) else 0):
            for change in (-(10**6), -3, -1, 1, 2, 10**6):
                changed = numbers.copy()
                changed[place] += change
                yield Walk(**{**parts, name: changed})
    yield Walk(found.valences[:-4], found.forks, found.gaps, found.targets)
    yield Walk(found.valences, found.forks, found.gaps[:-1], found.targets)
    yield Walk(found.valences, found.forks, found.gaps, found.targets[:-1])


def outcome(given: Walk, most: int) -> bytes | None:
    try:
        return given.triangles(most).tobytes()
    except Refusal:
        return None


@pytest.mark.parametrize("share", [0.8, 0.4])
@pytest.mark.skipif(library.reason_against() is not None, reason="there is no kernel to compare with")
def test_walks_lead_to_the_same_triangles_and_refusals(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    quads = np.asarray(models.cubetorus()[1])
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int64)
    closed = Capped.of(triangles[np.random.default_rng(5).random(len(triangles)) < share])
    found = Walking(closed.triangles, closed.opposite).walk()
    most = len(closed.triangles)
    own = [outcome(each, most) for each in forged(found, 3)]
    without_kernel(monkeypatch)
    plain = [outcome(each, most) for each in forged(found, 3)]
    assert own == plain
    assert own[0] is not None
    assert own.count(None) > 40
