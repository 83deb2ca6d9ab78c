"""What links suggest, with and without the kernel, against plain loops; and rings that it grows for a file."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.native.library import reason_against
from sparse_surface.solver.surface.container import Refusal
from sparse_surface.solver.surface.format import cover as covers
from sparse_surface.solver.surface.format import domains, positions
from sparse_surface.solver.surface.format.cover import Cover, Incidence, ring_members
from sparse_surface.solver.surface.format.domains import Shapes

Numbers = NDArray[np.int64]


@pytest.fixture(params=["kernel", "numpy"])
def _kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "numpy":
        for module in (covers, domains, positions):
            monkeypatch.setattr(module, "reason_against", lambda: "Not here.")
    elif reason_against() is not None:
        pytest.skip(str(reason_against()))


both = pytest.mark.usefixtures("_kind")


class Steady:
    """A coder that adds an own number to each prediction, and keeps what it was asked."""

    def __init__(self, count: int, dimensions: int) -> None:
        random = np.random.default_rng(count)
        self.sizes, self._own = np.zeros((count, dimensions)), random.normal(scale=0.01, size=(count, dimensions))
        self.asked: list[tuple[Numbers, NDArray[np.float64], NDArray[np.float64]]] = []

    def __call__(self, places, predicted, steps, expected):
        self.asked.append((places, predicted.copy(), np.array(expected)))
        self.sizes[places] = np.abs(self._own[places])
        return predicted + self._own[places]


@both
def test_positions_are_means_of_parallelograms() -> None:
    vertices, faces = models.sphere(4)
    faces = np.asarray(faces)
    coder = Steady(len(vertices), 3)
    found = positions.code_positions(faces, np.ones(len(vertices)), coder)
    sides = {(int(f[k]), int(f[(k + 1) % 3])): int(f[(k + 2) % 3]) for f in faces for k in range(3)}
    known, sizes = set(coder.asked[0][0].tolist()), coder.sizes
    for places, predicted, expected in coder.asked[1:]:
        for n, place in enumerate(places.tolist()):
            links = [
                (a, b, sides[b, a]) for (a, b), far in sides.items() if far == place and {a, b, sides[b, a]} <= known
            ]
            assert links
            suggested = [found[a] + found[b] - found[c] for a, b, c in links]
            off = [(sizes[a] + sizes[b] + sizes[c]) / 3.0 for a, b, c in links]
            np.testing.assert_allclose(predicted[n], np.mean(suggested, axis=0), atol=1e-12)
            np.testing.assert_allclose(expected[n], np.mean(off, axis=0), atol=1e-12)
        known |= set(places.tolist())
    assert known == set(range(len(vertices)))


class Waiting(domains.Functions):
    """Functions towards which there is nothing to go."""

    def nearer(self, patch, domain, target):
        return domain.copy(), np.ones_like(domain)


@both
def test_domains_are_means_of_unfolded_triangles() -> None:
    vertices, faces = models.sphere(4)
    faces = np.asarray(faces)
    incidence = Incidence.of(faces, len(vertices))
    members = ring_members(incidence, np.array([0, 50]), np.array([3, 2]), 10**6)
    cover = Cover.of(faces, len(vertices), members.indptr.astype(np.int64), members.indices.astype(np.int64))
    coder, shapes = Steady(len(cover.nodes), 2), Shapes.of(vertices, faces)
    nothing = Waiting(None, np.zeros((3, 1, 2), int), np.zeros((3, 1, 2)), None)  # type: ignore[arg-type]
    steps = np.ones(len(cover.nodes))
    domain = domains.code_domains(cover, np.array([0, 50]), shapes, np.zeros((len(steps), 3)), nothing, steps, coder)
    at = np.asarray(vertices)[cover.nodes]
    known, off = set(coder.asked[0][0].tolist()), np.zeros_like(domain)
    off[list(known)] = domain[list(known)]
    for places, predicted, expected in coder.asked[1:]:
        for n, place in enumerate(places.tolist()):
            suggested, moved, size = [], [], []
            for row in cover.corners.tolist():
                if place not in row or not set(row) - {place} <= known:
                    continue
                k = row.index(place)
                a, b = row[(k + 1) % 3], row[(k + 2) % 3]
                edge, third = at[b] - at[a], at[place] - at[a]
                share = edge @ third / (edge @ edge)
                height = np.linalg.norm(third - share * edge) / np.linalg.norm(edge)
                along = domain[b] - domain[a]
                suggested.append(domain[a] + share * along + height * np.array([-along[1], along[0]]))
                moved.append((off[a] + off[b]) / 2.0)
                size.append((coder.sizes[a] + coder.sizes[b]).mean() / 2.0)
            start, shift = np.mean(suggested, axis=0), np.mean(moved, axis=0)
            np.testing.assert_allclose(predicted[n], start + shift / 2.0, atol=1e-12)
            np.testing.assert_allclose(expected[n], np.mean(size), atol=1e-12)
            off[place] = domain[place] - start
        known |= set(places.tolist())
    assert known == set(range(len(steps)))


@both
def test_rings_are_those_of_shortest_paths() -> None:
    vertices, faces = models.sphere(8)
    faces = np.asarray(faces)
    incidence = Incidence.of(faces, len(vertices))
    random = np.random.default_rng(1)
    centres, rings = random.permutation(len(vertices))[:300], random.integers(0, 6, 300)
    members = ring_members(incidence, centres, rings, 10**7)
    joined = np.zeros((len(vertices), len(vertices)))
    joined[faces, np.roll(faces, 1, axis=1)] = joined[np.roll(faces, 1, axis=1), faces] = 1.0
    hops = dijkstra(joined, indices=centres, unweighted=True)
    for k, (own, ring) in enumerate(zip(hops, rings, strict=True)):
        expected = np.flatnonzero((own[faces] <= ring - 1).any(axis=1))
        np.testing.assert_array_equal(members.indices[members.indptr[k] : members.indptr[k + 1]], expected)
    with pytest.raises(Refusal, match="larger than it says"):
        ring_members(incidence, centres, rings, members.nnz - 1)
