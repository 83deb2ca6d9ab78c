"""A small object beside a large one is treated as it would be beside one of its own size."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import sphere
from sparse_surface.solver import Approximation, Settings, approximate
from sparse_surface.solver.mesh.sampling import triangle_grid
from sparse_surface.solver.surface.representation import Representation

ROWS, COLUMNS = 41, 5
TRIANGLES = 2 * (ROWS - 1) * (COLUMNS - 1)
LARGER = (1.0, 1000.0)


def strip(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A rough strip of quads whose lengths differ a thousandfold: patches swing out between such observations."""
    random = np.random.default_rng(seed)
    x = np.cumsum(np.concatenate([[0.0], 10.0 ** random.uniform(-3.0, 0.0, ROWS - 1)]))
    x, y = (part.ravel() for part in np.meshgrid(x / x[-1], [0.0, 0.02, 0.5, 0.52, 1.0], indexing="ij"))
    z = 0.15 * np.sin(9.0 * x) * np.cos(5.0 * y) + 0.02 * random.normal(size=len(x))
    i = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    return np.stack([x, y, z], axis=1), np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(
        -1, 4
    )


def beside_a_ball(vertices: np.ndarray, faces: np.ndarray, larger: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """The object first, so that its vertices have the same numbers beside any ball."""
    ball, triangles = sphere(10)
    ball = larger * (0.5 * ball + np.array([1.5, 0.0, 0.0]))
    return np.concatenate([vertices, ball]), [*faces, *(np.asarray(triangles) + len(vertices))]


def surface_of(representation: Representation) -> np.ndarray:
    inside = triangle_grid(8)
    triangles = np.repeat(np.arange(TRIANGLES), len(inside))
    return representation.evaluate(triangles, np.tile(inside, (TRIANGLES, 1)))


@cache
def made(seed: int, larger: float, domains: str) -> Approximation:
    return approximate(*beside_a_ball(*strip(seed), larger), Settings(workers=1, domains=domains))


@pytest.mark.parametrize("seed", [4, 7])
def test_the_same_surface_whatever_is_beside_it(seed: int) -> None:
    """Shares of the scene's size let spikes of 0.66 stand where alone nothing exceeds 0.16."""
    expected, found = (made(seed, larger, "common") for larger in LARGER)
    size = len(strip(seed)[0])
    assert np.abs(surface_of(found.representation) - surface_of(expected.representation)).max() <= 1e-9
    assert (found.patch[:size] == expected.patch[:size]).all()
    assert ((found.error[:size] == 0.0) == (expected.error[:size] == 0.0)).all()


def test_precise_patches_follow_the_same_fair_surface() -> None:
    """The equations of the fair surface ended early for a small object, by the residual of the large one."""
    expected, found = (made(10, larger, "separate").representation for larger in LARGER)
    assert np.abs(surface_of(found) - surface_of(expected)).max() <= 1e-9


def test_a_slit_stays_open_and_copies_are_held_together() -> None:
    """A ten-thousandth of the object is less than a millionth of the scene."""
    vertices, faces = strip(3)
    other = vertices * np.array([-1.0, 1.0, 1.0]) + np.array([2.0 * vertices[:, 0].max(), 0.0, 0.0])
    for gap, merged in ((1e-4, 0), (1e-8, COLUMNS)):
        both = np.concatenate([vertices, other + np.array([gap, 0.0, 0.0])])
        quads = np.concatenate([faces, faces[:, ::-1] + len(vertices)])
        for larger in LARGER:
            scene = beside_a_ball(both, quads, larger)
            report = approximate(*scene, Settings(workers=1, iterations=1, sweeps=0, creases="off")).report
            assert report["input"].get("merged_vertices", 0) == merged


@pytest.mark.parametrize(("quality", "allowed"), [("exact", 5e-6), ("compact", 1e-4)])
def test_files_keep_the_small_object(quality: str, allowed: float, tmp_path) -> None:
    """Beside a ball a thousand times its size a compact file moved it by 2 % of its own."""
    vertices, faces = strip(0)
    vertices[:, 0] = np.repeat(np.linspace(0.0, 1.0, ROWS), COLUMNS)
    vertices[:, 2] = 0.1 * np.sin(4.0 * vertices[:, 0]) * np.cos(3.0 * vertices[:, 1])
    representation = approximate(*beside_a_ball(vertices, faces, 1000.0), Settings(workers=1)).representation
    representation.save(tmp_path / "scene.npz", quality)
    read = Representation.load(tmp_path / "scene.npz")
    assert np.linalg.norm(surface_of(read) - surface_of(representation), axis=1).max() <= allowed
