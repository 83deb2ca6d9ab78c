"""Triangles as a walk over them: what is written comes back, whatever the mesh, and forged walks are refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver.surface.container import Refusal
from sparse_surface.solver.surface.format.blocks import BlockReader, BlockWriter
from sparse_surface.solver.surface.format.capping import Capped
from sparse_surface.solver.surface.format.connectivity import read_triangles, write_triangles
from sparse_surface.solver.surface.format.walk import Walk, Walking

Triangles = NDArray[np.int64]


def triangles_of(faces: NDArray[np.int64]) -> Triangles:
    return np.concatenate([faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)]).astype(np.int64)


def torn(seed: int) -> Triangles:
    """Return a part of a torus: holes, islands, and vertices at which two parts touch."""
    faces = triangles_of(np.asarray(models.cubetorus()[1]))
    random = np.random.default_rng(seed)
    return faces[random.random(len(faces)) < random.uniform(0.2, 0.95)]


def wild(seed: int) -> Triangles:
    """Return triangles between few vertices: crowded edges, doubles, collapsed ones, any orientation."""
    random = np.random.default_rng(seed)
    return random.integers(0, random.integers(3, 30), (random.integers(1, 40), 3))


MESHES = {
    **{
        name: triangles_of(np.asarray(getattr(models, name)()[1]))
        for name in ("cube", "cubetorus", "tetrahedron", "tube", "moebius", "klein_bottle", "pole")
    },
    **{f"torn {seed}": torn(seed) for seed in range(12)},
    **{f"wild {seed}": wild(seed) for seed in range(60)},
}


def restored(triangles: Triangles, plain: bool = False) -> tuple[Triangles, BlockReader]:
    blocks, count = BlockWriter(), int(triangles.max()) + 1
    write_triangles(blocks, triangles, plain)
    reader = BlockReader(blocks.content())
    return read_triangles(reader, len(triangles), count), reader


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("shuffle", [False, True])
def test_triangles_come_back(mesh: str, shuffle: bool) -> None:
    triangles = MESHES[mesh]
    if shuffle:
        random = np.random.default_rng(4)
        triangles = random.permutation(int(triangles.max()) + 1)[random.permutation(triangles)]
    np.testing.assert_array_equal(restored(triangles)[0], triangles)
    np.testing.assert_array_equal(restored(triangles, plain=True)[0], triangles)


@pytest.mark.parametrize("mesh", [name for name in MESHES if not name.startswith("wild")])
def test_a_walk_leads_to_the_mesh(mesh: str) -> None:
    """The walk's triangles, in its own numbers, are those of the mesh; and valences are what they are called."""
    closed = Capped.of(MESHES[mesh])
    walking = Walking(closed.triangles, closed.opposite)
    found = walking.walk().triangles(len(closed.triangles))
    met = np.array(walking.met)
    given = closed.triangles.ravel()[walking.corners].reshape(-1, 3)
    np.testing.assert_array_equal(met[found], given)
    assert sorted(map(sorted, given.tolist())) == sorted(map(sorted, closed.triangles.tolist()))
    counts = np.bincount(closed.triangles.ravel())
    np.testing.assert_array_equal(walking.walk().valences, counts[met])


def test_a_walk_is_small_where_the_order_is_random() -> None:
    """Less than three bits a vertex for the mesh, and for its order about log2(V!) + log2(F!) + F log2(3) bits."""
    triangles = MESHES["cubetorus"]
    random = np.random.default_rng(1)
    count = int(triangles.max()) + 1
    triangles = random.permutation(count)[random.permutation(triangles)]
    triangles = np.array([np.roll(row, random.integers(3)) for row in triangles])
    _, reader = restored(triangles)
    sizes = {name: entry[4] - entry[3] for name, entry in reader.names.items()}
    mesh = sum(sizes[name] for name in ("valences", "forks", "gaps", "chords", "caps"))
    assert mesh < 3 * count / 8
    order = sum(np.log2(np.arange(1, n + 1)).sum() for n in (count, len(triangles))) + len(triangles) * np.log2(3)
    assert sum(sizes.values()) - mesh < 1.35 * order / 8


def test_forged_walks_are_refused() -> None:
    """Numbers of a walk changed in turn: refused, or a mesh of at most the stated size; never another error."""
    closed = Capped.of(torn(3))
    walk = Walking(closed.triangles, closed.opposite).walk()
    parts = {name: getattr(walk, name) for name in ("valences", "forks", "gaps", "targets")}
    random, refused = np.random.default_rng(0), 0
    for name, numbers in parts.items():
        for place in random.integers(0, max(len(numbers), 1), 80 if len(numbers) else 0):
            for change in (-3, -1, 1, 2, 10**6):
                forged = numbers.copy()
                forged[place] += change
                try:
                    found = Walk(**{**parts, name: forged}).triangles(len(closed.triangles))
                except Refusal:
                    refused += 1
                else:
                    assert len(found) <= len(closed.triangles)
                    assert found.max() < len(walk.valences)
                    assert found.min() >= 0
    assert refused > 400
    with pytest.raises(Refusal):
        Walk(walk.valences[:-4], walk.forks, walk.gaps, walk.targets).triangles(len(closed.triangles))
