"""Robust weights against the losses that they stand for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import huber
from scipy.stats import norm
from sparse_surface.solver.reconstruction.robust_weights import TUNING, robust_weights, spread


def tukey_loss(residual: np.ndarray, limit: float) -> np.ndarray:
    inside = np.minimum(np.abs(residual) / limit, 1.0)
    return limit**2 / 6.0 * (1.0 - (1.0 - inside**2) ** 3)


LOSSES = {"huber": lambda r, limit: huber(limit, np.abs(r)), "tukey": tukey_loss}


@pytest.mark.parametrize("kind", ["huber", "tukey"])
def test_weights_are_the_slope_of_the_loss_over_the_residual(kind: str) -> None:
    scale = 0.3
    residual = np.linspace(0.01, 3.0, 57)
    step = 1e-6
    loss = LOSSES[kind]
    slope = (loss(residual + step, TUNING[kind] * scale) - loss(residual - step, TUNING[kind] * scale)) / (2 * step)
    np.testing.assert_allclose(robust_weights(residual, kind, scale), slope / residual, atol=1e-6)


@pytest.mark.parametrize("kind", ["huber", "tukey"])
def test_weighted_means_end_at_the_minimum_of_the_loss(kind: str) -> None:
    random = np.random.default_rng(1)
    values = np.concatenate([random.normal(2.0, 0.1, size=200), random.uniform(5, 9, size=40)])
    centre = float(np.median(values))
    for _ in range(200):
        weights = robust_weights(np.abs(values - centre), kind, 0.1)
        centre = float((weights * values).sum() / weights.sum())
    limit = TUNING[kind] * 0.1
    best = minimize_scalar(lambda x: LOSSES[kind](values - x, limit).sum(), bounds=(1.5, 2.5), method="bounded")
    assert centre == pytest.approx(best.x, abs=1e-4)


@pytest.mark.parametrize("kind", ["huber", "tukey"])
def test_on_normal_errors_95_percent_of_the_efficiency_is_left(kind: str) -> None:
    """(E psi')^2 / E psi^2 for psi(r) = r w(r) and standard normal r, by quadrature."""
    residual, step = np.linspace(-12.0, 12.0, 480_001, retstep=True)
    density = norm.pdf(residual) * step
    influence = residual * robust_weights(np.abs(residual), kind, 1.0)
    efficiency = (np.gradient(influence, step) @ density) ** 2 / (influence**2 @ density)
    assert efficiency == pytest.approx(0.95, abs=1e-3)


def test_spread_of_distances_does_not_see_outliers() -> None:
    random = np.random.default_rng(2)
    distance = np.abs(random.normal(0, 0.5, size=4000))
    assert spread(distance) == pytest.approx(0.5, rel=0.05)
    assert spread(np.concatenate([distance, np.full(200, 1e3)])) == pytest.approx(0.5, rel=0.1)


def test_without_scale_or_kind_all_points_count() -> None:
    distance = np.array([0.0, 1.0, 100.0])
    np.testing.assert_array_equal(robust_weights(distance, "none", 1.0), 1.0)
    np.testing.assert_array_equal(robust_weights(distance, "tukey", 0.0), 1.0)
