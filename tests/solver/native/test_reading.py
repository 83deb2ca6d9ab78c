"""Values that the kernel reads round after round, beside those that NumPy reads; and the same refusals."""

from __future__ import annotations

from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Representation, Settings, approximate
from sparse_surface.solver.native.library import reason_against
from sparse_surface.solver.surface.closing import Fans
from sparse_surface.solver.surface.container import Refusal
from sparse_surface.solver.surface.format import connectivity, cover, domains, entropy, growth, listing, positions, walk
from sparse_surface.solver.surface.format.blocks import BlockReader, BlockWriter
from sparse_surface.solver.surface.format.cover import Cover, Incidence, ring_members
from sparse_surface.solver.surface.format.entropy import CONTEXTS, NumberReader, NumberWriter
from sparse_surface.solver.surface.format.growth import Reading, Writing
from sparse_surface.solver.surface.format.positions import code_positions
from sparse_surface.solver.surface.format.recognition import renumbered

QUICK = {"ring": 4, "degree": 8, "sparsity": 8, "iterations": 3, "sweeps": 0}
NEAR = {"rtol": 1e-10, "atol": 1e-12}

pytestmark = pytest.mark.skipif(reason_against() is not None, reason="there is no kernel to compare with")


def without_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (connectivity, cover, domains, entropy, growth, listing, positions, walk):
        if hasattr(module, "reason_against"):
            monkeypatch.setattr(module, "reason_against", lambda: "Not here.")


@cache
def file(kind: str, quality: str) -> bytes:
    made = {
        "one domain": lambda: approximate(*models.creased_terrain(14), Settings(**QUICK)),
        "three domains": lambda: approximate(*models.sphere(5), Settings(**QUICK, domains="separate")),
        "uniform": lambda: approximate(*models.cylinder(), Settings(**QUICK, blending="uniform")),
    }[kind]()
    return made.representation.compact if quality == "compact" else made.representation.stored


@pytest.mark.parametrize("quality", ["exact", "compact"])
@pytest.mark.parametrize("kind", ["one domain", "three domains", "uniform"])
def test_files_are_read_as_by_numpy(kind: str, quality: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = Representation.from_bytes(file(kind, quality))
    without_kernel(monkeypatch)
    numpys = Representation.from_bytes(file(kind, quality))
    for name in (field.name for field in fields(Representation) if field.name in vars(ours)):
        one, other = getattr(ours, name), getattr(numpys, name)
        if isinstance(one, np.ndarray) and one.dtype.kind == "f":
            np.testing.assert_allclose(one, other, err_msg=name, **NEAR)
        else:
            assert np.array_equal(one, other), name


def written(vertices: NDArray[np.float64], faces: NDArray[np.int64], step: float) -> BlockReader:
    writing, blocks = Writing(vertices), BlockWriter()
    code_positions(faces, np.full(len(vertices), step), writing)
    writing.numbers.finish(blocks, "some")
    return BlockReader(blocks.content())


def read(blocks: BlockReader, faces: NDArray[np.int64], count: int, step: float, largest: float):
    code = Reading(NumberReader(blocks, "some", 3 * count), (count, 3), largest)
    return code_positions(faces, np.full(count, step), code), code.sizes


@pytest.fixture(params=["kernel", "numpy"])
def _kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "numpy":
        without_kernel(monkeypatch)


both = pytest.mark.usefixtures("_kind")


@both
@pytest.mark.parametrize("step", [1e-5, 0.3])
def test_positions_come_back_to_half_a_step(step: float) -> None:
    vertices, faces = models.sphere(7)
    vertices, faces = np.add(vertices, [1.0, 2.0, 3.0]), np.asarray(faces)
    found, sizes = read(written(vertices, faces, step), faces, len(vertices), step, 10.0)
    assert np.abs(found - vertices).max() <= 0.5001 * step
    whole = sizes / step
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-6)


@both
def test_numbers_that_are_wrong_or_not_there_are_refused() -> None:
    vertices, faces = models.sphere(7)
    blocks = written(np.asarray(vertices), np.asarray(faces), 1e-4)
    with pytest.raises(Refusal, match="too large"):
        read(blocks, np.asarray(faces), len(vertices), 1e-4, 0.5)
    larger, more = models.sphere(30)
    with pytest.raises(Refusal, match="is cut"):
        read(blocks, np.asarray(more), len(larger), 1e-4, 1e60)
    writer, blocks = NumberWriter(), BlockWriter()
    writer.add(np.zeros(9, dtype=np.int64), np.full(9, CONTEXTS - 1))  # of the first triangle
    writer.finish(blocks, "some")
    with pytest.raises(Refusal, match="wrong table"):
        read(BlockReader(blocks.content()), np.asarray(faces), len(vertices), 1e-4, 1e60)


def crossed(seed: int) -> NDArray[np.int64]:
    """Triangles between any of a few nodes, some of which name a node twice."""
    return np.random.default_rng(seed).integers(0, 40, (90, 3))


@both
@pytest.mark.parametrize("seed", range(20))
def test_patches_of_any_triangles_are_numbered_and_measured(seed: int) -> None:
    nodes, random = crossed(seed), np.random.default_rng(seed)
    incidence = Incidence.of(nodes, 40)
    proper = [t for t, row in enumerate(nodes.tolist()) if len(set(row)) == 3]
    for node in range(40):
        expected = [t for t in proper if node in nodes[t]]
        assert incidence.triangles[incidence.offsets[node] : incidence.offsets[node + 1]].tolist() == expected
    sets = [np.flatnonzero(random.random(90) < share) for share in (0.0, 0.05, 0.1, 0.3)]
    offsets = np.cumsum([0, *map(len, sets)])
    found = Cover.of(nodes, 40, offsets, np.concatenate(sets))
    depth = found.rim_distances(incidence)
    for k, own in enumerate(sets):
        names = np.unique(nodes[own])
        first, end = found.vertex_offsets[k : k + 2]
        np.testing.assert_array_equal(found.nodes[first:end], names)
        np.testing.assert_array_equal(found.nodes[found.corners[offsets[k] : offsets[k + 1]]], nodes[own])
        np.testing.assert_array_equal(depth[first:end], distances(nodes, own, names))


def distances(nodes: NDArray[np.int64], own: NDArray[np.int64], names: NDArray[np.int64]) -> list[int]:
    """Walk from the nodes with a triangle outside of the patch; corners of triangles that name one twice count."""
    proper = (nodes != np.roll(nodes, -1, axis=1)).all(axis=1)
    inside = [(nodes[own] == name).sum() >= (nodes[proper] == name).sum() for name in names]
    found = {int(name): 0 for name, whole in zip(names, inside, strict=True) if not whole}
    step = 0
    while True:
        step += 1
        near = {n for row in nodes[own].tolist() if any(found.get(m, step) < step for m in row) for n in row}
        fresh = near - set(found)
        if not fresh:
            return [found.get(int(name), 1) for name in names]
        found |= dict.fromkeys(fresh, step)


@both
def test_a_ring_at_a_time_fits_or_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    _, faces = models.sphere(6)
    faces = np.asarray(faces)
    incidence = Incidence.of(faces, int(faces.max()) + 1)
    centres, rings = np.arange(30), np.arange(30) % 5
    whole = ring_members(incidence, centres, rings, 10**7)
    monkeypatch.setattr(cover, "AT_ONCE", 1)
    parts = ring_members(incidence, centres, rings, whole.nnz)
    np.testing.assert_array_equal(parts.indptr, whole.indptr)
    np.testing.assert_array_equal(parts.indices, whole.indices)
    with pytest.raises(Refusal, match="larger than it says"):
        ring_members(incidence, centres, rings, whole.nnz - 1)


@both
@pytest.mark.parametrize("seed", range(20))
def test_nodes_between_creases_need_no_other_numbers(seed: int) -> None:
    """Of a vertex's nodes the one whose corner comes first has its number; also where triangles name one twice."""
    nodes, random = crossed(seed), np.random.default_rng(seed)
    sides = np.sort(np.concatenate([nodes[:, [0, 1]], nodes[:, [1, 2]], nodes[:, [2, 0]]]), axis=1)
    creases = np.unique(sides[(random.random(len(sides)) < 0.3) & (sides[:, 0] != sides[:, 1])], axis=0)
    fans = Fans.of(nodes, creases, 40)
    assert len(fans.vertex) > 40
    np.testing.assert_array_equal(renumbered(fans.corners, nodes, 40), fans.corners)
    np.testing.assert_array_equal(fans.vertex[fans.corners], nodes)
