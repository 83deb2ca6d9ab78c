"""What a line says of a cloud beside its errors."""

from __future__ import annotations

import numpy as np
from sparse_surface.operators.data.report_text import warnings
from sparse_surface.solver import Settings, reconstruct, run_to_end
from sparse_surface.solver.interchange import CloudArrays, CloudSettings
from sparse_surface.solver.reconstruction.evaluated import reconstruct_arrays


def said(points: np.ndarray, tolerance: float = 0.0, close_holes: float = 0.0) -> list[str]:
    arrays = CloudArrays.of_points(points, CloudSettings(close_holes=close_holes))
    return warnings(
        run_to_end(reconstruct_arrays(arrays, Settings(workers=1, iterations=2, tolerance=tolerance))).report
    )


def test_two_layers_that_became_one_sheet_are_named() -> None:
    random = np.random.default_rng(0)
    sheet = np.column_stack([random.uniform(0.0, 1.0, (3000, 2)), np.zeros(3000)])
    sheet[:, 2] = 0.1 * sheet[:, 0] ** 2
    text = "the points lie in two layers: what is thinner than they are apart became one sheet"
    assert text not in said(sheet)
    assert text in said(sheet + [0.0, 0.0, 0.015] * random.integers(0, 2, (3000, 1)))


def test_a_tolerance_that_was_missed_is_named() -> None:
    u = np.random.default_rng(0).uniform(0.0, 1.0, (1500, 2))
    points = np.column_stack([u, 0.3 * np.abs(u[:, 0] - 0.5)])
    assert not [sentence for sentence in said(points, 0.5) if "farther from the surface" in sentence]
    assert [sentence for sentence in said(points, 1e-7) if sentence.endswith("farther from the surface than 1e-07")]


def test_closed_holes_are_counted_where_they_were_asked_for() -> None:
    u = np.random.default_rng(1).uniform(-1.0, 1.0, (3000, 2))
    u = u[np.linalg.norm(u - [0.4, 0.3], axis=1) > 0.3]
    points = np.column_stack([u, 0.2 * np.sin(2.0 * u[:, 0])])
    assert not [sentence for sentence in said(points) if "hole" in sentence]
    assert "holes closed: 1" in said(points, close_holes=0.8)
    assert "no open hole up to 0.4 wide was found" in said(points, close_holes=0.4)


def test_a_base_that_was_given_keeps_its_holes_and_the_line_says_so() -> None:
    u = np.random.default_rng(1).uniform(0.0, 1.0, (200, 2))
    points, corners = np.column_stack([u, 0.1 * u[:, 0]]), [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    cloud = CloudSettings(close_holes=0.5)
    result = reconstruct(points, corners, [[0, 1, 2], [0, 2, 3]], Settings(workers=1, iterations=2), cloud)
    assert "holes of the base stay open: they are closed only where the base is made" in warnings(result.report)
