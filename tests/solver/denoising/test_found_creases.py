"""Creases that are found between the two passes of denoising."""

from __future__ import annotations

import numpy as np
import pytest
from noisy import Array, Indices, distance_from_clean, halved, with_noise
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import FINISH, Progress, Settings, approximate, denoise, denoise_steps, run_to_end
from sparse_surface.solver.arrays import Booleans
from sparse_surface.solver.denoising.creases import cut_between, no_creases
from sparse_surface.solver.denoising.denoise import denoise_with
from sparse_surface.solver.denoising.patch_average import PatchAverage
from sparse_surface.solver.denoising.surface import build_surface
from sparse_surface.solver.mesh.triangle_mesh import TriangleMesh, build_mesh
from sparse_surface.solver.progress import Steps

FINDING = "Finding creases"


def noisy_model(name: str, share: float, seed: int) -> tuple[Array, Array, Indices]:
    """Return the vertices without and with noise, and the triangles."""
    clean, faces = getattr(models, name)()
    return clean, with_noise(clean, faces, share, seed), halved(np.asarray(faces))


@pytest.mark.parametrize(("name", "share", "least"), [("flower", 0.01, 0.03), ("cubetorus", 0.01, 0.03)])
def test_creases_that_are_found_bring_the_result_closer(name: str, share: float, least: float) -> None:
    """Strong noise hides from filtered normals where sides meet; the mesh after a first pass shows it."""
    clean, noisy, triangles = noisy_model(name, share, 31)
    without = run_to_end(denoise_with(no_creases, noisy, triangles)).vertices
    distance, angle = distance_from_clean(clean, triangles, denoise(noisy, triangles).vertices)
    other_distance, other_angle = distance_from_clean(clean, triangles, without)
    assert angle < (1 - least) * other_angle
    assert distance < other_distance


@pytest.mark.parametrize(("name", "share"), [("sphere", 0.01), ("finger", 0.003)])
def test_without_creases_between_wide_sides_nothing_changes(name: str, share: float) -> None:
    _, noisy, triangles = noisy_model(name, share, 31)
    without = run_to_end(denoise_with(no_creases, noisy, triangles)).vertices
    assert denoise(noisy, triangles).vertices.tobytes() == without.tobytes()


def test_settings_say_whether_creases_are_looked_for() -> None:
    """`creases="off"` and "marked" look for none; by default denoising by itself and as a part agree to the byte."""
    _, noisy, triangles = noisy_model("cube", 0.01, 5)
    without = run_to_end(denoise_with(no_creases, noisy, triangles)).vertices
    found = denoise(noisy, triangles).vertices
    assert found.tobytes() != without.tobytes()
    for creases, expected in (("auto", found), ("marked", without), ("off", without)):
        result = approximate(noisy, triangles, Settings(denoise="only", creases=creases, workers=1))
        assert result.vertices.tobytes() == expected.tobytes(), creases


def test_sides_are_not_neighbours_across_what_was_found() -> None:
    """Only edges between wide triangles are cut, and only there are triangles no neighbours any more."""
    clean, faces = models.cube(8)
    mesh = build_mesh(clean, halved(np.asarray(faces)))
    surface, wide = build_surface(mesh), np.ones(len(mesh.triangles), dtype=bool)
    sides = run_to_end(cut_between(surface, wide, _edges_of_a_box, lambda: clean))
    assert sides.found
    assert not sides.hurry
    apart = (surface.neighbours >= 0) & (sides.surface.neighbours < 0)
    assert apart.sum() == 2 * 12 * 8  # the two triangles of each of eight edges along each of the box's twelve
    normals = np.cross(*(clean[mesh.triangles[:, corner]] - clean[mesh.triangles[:, 0]] for corner in (1, 2)))
    side = np.abs(normals).argmax(axis=1) * 2 + (normals.sum(axis=1) > 0)
    one, other = sides.surface.around.nonzero()
    assert (side[one] == side[other]).all()
    touched = (np.isclose(np.abs(clean - clean.mean(axis=0)), np.ptp(clean, axis=0) / 2).sum(axis=1) >= 2)[
        mesh.triangles
    ].any(axis=1)
    np.testing.assert_array_equal(sides.triangles, touched)
    np.testing.assert_array_equal(np.flatnonzero(sides.vertices), np.unique(mesh.triangles[touched]))


def _edges_of_a_box(mesh: TriangleMesh, _: Booleans) -> Steps[tuple[Booleans, bool]]:
    yield Progress("Looking", 0.5)
    middle, half = mesh.vertices.mean(axis=0), np.ptp(mesh.vertices, axis=0) / 2
    outside = np.isclose(np.abs(mesh.vertices - middle), half)
    return (outside[mesh.edges[:, 0]] & outside[mesh.edges[:, 1]]).sum(axis=1) >= 2, False


def test_what_comes_first_fades_where_a_crease_was_found() -> None:
    rng = np.random.default_rng(3)
    average = PatchAverage(4, 5, 1.0)
    for sums, columns in ((average._normals, 4), (average._planes, 12)):
        count = len(sums.total())
        sums.add(np.arange(count), rng.random((columns, count)))
    normals, planes = average._normals.total().copy(), average._planes.total().copy()
    triangles, vertices = np.array([True, False, False, True]), np.array([False, True, False, False, False])
    average.fade(triangles, vertices, 0.25)
    np.testing.assert_array_equal(average._normals.total(), normals * np.where(triangles, 0.25, 1.0)[:, None])
    np.testing.assert_array_equal(average._planes.total(), planes * np.where(vertices, 0.25, 1.0)[:, None])


def test_the_search_is_shown_and_can_be_ended() -> None:
    """It has a name and a surface; after `FINISH` no second pass follows, and fractions never fall."""
    _, noisy, triangles = noisy_model("cubetorus", 0.01, 31)
    seen: list[Progress] = []

    def note(step: Progress) -> str | None:
        seen.append(step)
        if step.stage == FINDING:
            assert step.vertices is not None
            assert np.isfinite(step.vertices).all()
            return FINISH
        return None

    ended = run_to_end(denoise_steps(noisy, triangles), note)
    stages = [step.stage for step in seen]
    assert FINDING in stages
    assert "Fitting one-sided patches" not in stages[stages.index(FINDING) :]
    fractions = [step.fraction for step in seen]
    assert fractions == sorted(fractions)
    assert ended.noise_level > 0
