"""Functions, patches and regularisation under noise: no more than it allows."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_clouds import ball, head
from sparse_surface.solver import CloudSettings, reconstruct
from sparse_surface.solver.approximation.patched_surface import cover
from sparse_surface.solver.approximation.runner import ChunkRunner
from sparse_surface.solver.fitting.pursuit import least_squares_pursuit, matching_pursuit
from sparse_surface.solver.mesh.projection import project
from sparse_surface.solver.reconstruction.base import checked_base
from sparse_surface.solver.reconstruction.geometry import analyse
from sparse_surface.solver.reconstruction.noise import iterations_for_noise, ring_for_noise
from sparse_surface.solver.reconstruction.observations import ObservedCloud
from sparse_surface.solver.settings import Settings


def signals(noise: float, seed: int, count: int = 300, size: int = 40):
    """Dictionary, a combination of five of its functions with noise, and what a pursuit sees of them."""
    random = np.random.default_rng(seed)
    functions = random.normal(size=(size, count)) / np.sqrt(count)
    values = 3.0 * functions[:5].sum(axis=0) + noise * random.normal(size=count)
    return functions, values, (functions @ functions.T)[None], (functions @ values)[None, None]


def test_with_a_price_only_functions_that_explain_more_than_noise_are_taken() -> None:
    exact = 0
    for seed in range(20):
        _, _, gram, correlation = signals(0.2, seed)
        worth = np.array([2.0 * np.log(40) * 0.2**2])
        support = least_squares_pursuit(gram, correlation, 15, worth=worth)[0, 0]
        assert set(range(5)) <= set(support)
        exact += int((support >= 0).sum() == 5)
    assert exact >= 15
    without = least_squares_pursuit(gram, correlation, 15)[0, 0]
    assert (without >= 0).all()


@pytest.mark.parametrize("pursue", [least_squares_pursuit, matching_pursuit])
def test_the_number_of_functions_minimises_residual_plus_price(pursue) -> None:
    """Against all prefixes of the unpriced choice, each refitted by itself."""
    for seed in range(5):
        functions, values, gram, correlation = signals(0.5, seed)
        options = {"replacements": 0} if pursue is least_squares_pursuit else {}
        everything = pursue(gram, correlation, 15, **options)[0, 0]
        price = 0.3
        costs = []
        for count in range(1, 16):
            chosen = functions[everything[:count]].T
            residual = values - chosen @ np.linalg.lstsq(chosen, values, rcond=None)[0]
            costs.append(residual @ residual + price * count)
        support = pursue(gram, correlation, 15, worth=np.array([price]), **options)[0, 0]
        assert (support >= 0).sum() == np.argmin(costs) + 1
        np.testing.assert_array_equal(support[support >= 0], everything[: np.argmin(costs) + 1])


def test_no_price_changes_nothing() -> None:
    _, _, gram, correlation = signals(0.2, 0)
    np.testing.assert_array_equal(
        least_squares_pursuit(gram, correlation, 12, worth=np.zeros(1)), least_squares_pursuit(gram, correlation, 12)
    )


def test_regularisation_stops_where_the_noise_asks_for() -> None:
    """Over the iterations beta1 is 0.2, 0.052, 0.0135, 3.5e-3, 9.1e-4, 2.4e-4, 6.2e-5, 1.6e-5, and stays there."""
    settings = Settings(iterations=50, beta1=0.2)
    assert iterations_for_noise(settings, 0.0) == 50
    # the last iteration has the last beta1 that is not below the squared share of the noise in a shift of 0.1
    for noise, count in ((1e-6, 50), (1e-4, 50), (5e-4, 7), (1e-3, 6), (1.6e-3, 5), (1e-2, 3), (0.02, 2), (0.03, 1)):
        assert iterations_for_noise(settings, noise) == count
    assert iterations_for_noise(settings, 10.0) == 1
    assert iterations_for_noise(Settings(iterations=0), 10.0) == 0
    assert iterations_for_noise(Settings(method="paper"), 10.0) == 15


def chosen_ring(cloud) -> int:
    mesh, geometry = checked_base(cloud.base_vertices, cloud.base_faces), analyse(cloud.points)
    observed = ObservedCloud(cloud.points, project(cloud.points, mesh), np.ones(len(cloud.points)), geometry.noise)
    return ring_for_noise(mesh, observed, geometry, Settings().resolved(), ChunkRunner())


def test_patches_grow_with_the_noise() -> None:
    assert chosen_ring(ball(4000, 100)) == 1
    assert chosen_ring(ball(4000, 100, noise=0.005)) > 1
    assert chosen_ring(head(6000, 150)) == 1


def test_more_patches_of_the_same_radius_lie_over_each_place() -> None:
    cloud = ball(4000, 100)
    mesh = checked_base(cloud.base_vertices, cloud.base_faces)
    few, closer, more = (len(cover(mesh, ring, closer=by)) for ring, by in ((3, 0), (3, 1), (2, 0)))
    assert few < closer == more
    assert set(cover(mesh, 3, closer=1).rings) == {3}
    assert len(cover(mesh, 2, closer=5)) == len(mesh.vertices)


@pytest.mark.parametrize(("noise", "closer"), [(0.0, 0), (0.005, 1)])
def test_only_clouds_with_noise_get_more_patches(noise: float, closer: int) -> None:
    cloud = ball(2000, 60, noise=noise)
    settings = Settings(workers=1, iterations=1)
    result = reconstruct(cloud.points, cloud.base_vertices, cloud.base_faces, settings, CloudSettings(ring=2))
    mesh = checked_base(cloud.base_vertices, cloud.base_faces)
    assert result.report["patches"] == len(cover(mesh, 2, closer=closer))
    assert len(cover(mesh, 2)) < len(cover(mesh, 2, closer=1))
