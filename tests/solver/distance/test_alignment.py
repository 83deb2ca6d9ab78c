"""Alignment of moved copies: known motions are undone, and failures are said."""

from __future__ import annotations

import numpy as np
import pytest
from distance_shapes import Floats, Shape, ball, box, soup
from scipy.spatial.transform import Rotation
from sparse_surface.solver.distance.alignment import Alignment, align_steps
from sparse_surface.solver.distance.surfaces import Surface
from sparse_surface.solver.errors import InputError
from sparse_surface.solver.progress import run_to_end


def align(a: Shape | Floats, b: Shape | Floats, **options: bool) -> Alignment:
    one, other = (Surface.of(*each) if isinstance(each, tuple) else Surface.of(each) for each in (a, b))
    return run_to_end(align_steps(one, other, **options))


def wedge() -> Shape:
    """Return a body without any symmetry."""
    vertices, triangles = box((1.0, 0.6, 0.4))
    vertices[7] *= [0.5, 0.8, 0.3]
    vertices[1] *= [1.0, 0.4, 1.0]
    return vertices, triangles


def moved(vertices: Floats, seed: int, scale: float = 1.0) -> Floats:
    rng = np.random.default_rng(seed)
    return scale * vertices @ Rotation.random(random_state=seed).as_matrix().T + rng.normal(size=3)


def back(found: Alignment, vertices: Floats) -> Floats:
    return vertices @ found.matrix[:3, :3].T + found.matrix[:3, 3]


@pytest.mark.parametrize("seed", range(8))
def test_a_moved_copy_comes_back(seed: int) -> None:
    vertices, triangles = wedge()
    away = moved(vertices, seed)
    found = align((away, triangles), (vertices, triangles))
    assert back(found, away) == pytest.approx(vertices, abs=1e-9)
    assert found.residual < 1e-9
    assert found.overlap > 0.99
    assert found.equally_good == 1
    assert not found.problem


def test_a_copy_of_another_size_comes_back() -> None:
    vertices, triangles = wedge()
    away = moved(vertices, 3, 2.54)
    found = align((away, triangles), (vertices, triangles), scaled=True)
    assert back(found, away) == pytest.approx(vertices, abs=1e-7)


def test_a_scan_comes_back() -> None:
    vertices, triangles = wedge()
    cloud = moved(Surface.of(vertices, triangles).samples(3000), 5)
    found = align(cloud, (vertices, triangles))
    assert found.residual < 1e-8


def test_a_symmetric_body_has_several_equally_good_ends() -> None:
    vertices, triangles = box((1.0, 0.6, 0.4))
    away = moved(vertices, 1)
    found = align((away, triangles), (vertices, triangles))
    assert found.equally_good > 1
    assert found.residual < 1e-9


def test_what_does_not_fit_is_said() -> None:
    assert align(soup(50, 2), ball(300)).problem


def test_three_points_are_refused() -> None:
    with pytest.raises(InputError, match="four points"):
        align(np.eye(3), ball(100))
