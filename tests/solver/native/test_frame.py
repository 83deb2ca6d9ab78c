"""The kernel's frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sparse_surface.solver.arrays import Array
from sparse_surface.solver.fitting.batch import Problem, frame_of
from sparse_surface.solver.fitting.native_chunks import Prepared
from sparse_surface.solver.native.library import function
from sparse_surface.solver.settings import Settings
from synthetic import crease, hill, problem


def native_frame(given: Problem, instructions: str) -> Array:
    prepared = Prepared.of([given], Settings().resolved())
    function("frame_of", instructions)(prepared.address)
    return prepared.solved[0].frame


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("height", [crease, hill])
def test_frames_are_those_of_numpy(instructions: str, seed: int, height: object) -> None:
    given = problem(height, seed=seed, scale=3.0)  # type: ignore[arg-type]
    frame = frame_of(given)
    expected = np.concatenate([frame.centre, frame.turn.ravel(), frame.origin, [frame.scale]])
    np.testing.assert_allclose(native_frame(given, instructions), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2, 2.0, 3.0])
def test_the_first_axis_is_the_direction_in_which_the_surface_bends(instructions: str, angle: float) -> None:
    direction = np.array([np.cos(angle), np.sin(angle)])
    given = problem()
    across = given.domain @ direction
    signals = np.column_stack([given.domain, across**2])
    turn = native_frame(replace(given, signals=signals), instructions)[2:6].reshape(2, 2)
    assert abs(turn[:, 0] @ direction) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(turn.T @ turn, np.eye(2), atol=1e-14)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_the_domain_just_fits_into_the_square(instructions: str) -> None:
    given = problem(hill, scale=40.0)
    frame = native_frame(given, instructions)
    inside = (given.domain - frame[:2]) @ frame[2:6].reshape(2, 2) * frame[9]
    assert np.abs(inside).max() == pytest.approx(1.0)
    np.testing.assert_allclose(inside.max(axis=0), -inside.min(axis=0), atol=1e-12)


def test_a_domain_that_is_a_point_has_a_frame(instructions: str) -> None:
    given = problem()
    frame = native_frame(replace(given, domain=np.zeros_like(given.domain)), instructions)
    np.testing.assert_array_equal(frame[:6], [0.0, 0.0, 1.0, 0.0, 0.0, 1.0])
    assert frame[9] == 1.0
