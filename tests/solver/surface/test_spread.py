"""Statistics that are put together from those of parts."""

from __future__ import annotations

import json

import numpy as np
from sparse_surface.solver.surface.spread import Spread


def test_parts_give_what_the_whole_gives() -> None:
    distances = np.random.default_rng(3).lognormal(-6.0, 2.0, 5000)
    found = sum((Spread.of(part) for part in np.array_split(distances, 7)), Spread()).statistics()
    assert np.isclose(found["rms"], np.sqrt(np.mean(distances**2)), rtol=1e-12)
    assert np.isclose(found["mean"], np.mean(distances), rtol=1e-12)
    assert found["max"] == distances.max()
    exact = np.percentile(distances, 95)
    assert exact * 0.985 < found["p95"] < exact * 1.015


def test_nothing_and_zeros_are_zero() -> None:
    for spread in (Spread(), Spread.of(np.zeros(10))):
        assert set(spread.statistics().values()) == {0.0}


def test_a_file_keeps_it() -> None:
    spread = Spread.of(np.array([0.0, 1e-9, 0.5, 3.0]))
    again = Spread.from_list(json.loads(json.dumps(spread.as_list())))
    assert again.statistics() == spread.statistics()
    assert (again.histogram == spread.histogram).all()
