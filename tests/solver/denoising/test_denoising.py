"""Denoising: how close it comes to the clean mesh, what it leaves alone, each step against something independent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from noisy import Array, Indices, diagonal, distance_from_clean, face_normals, halved, with_noise
from scipy.ndimage import gaussian_filter
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import FINISH, InputError, Progress, SettingsError, denoise, denoise_steps, run_to_end
from sparse_surface.solver.denoising import denoise as steps
from sparse_surface.solver.denoising import one_sided_patches
from sparse_surface.solver.denoising.noise_level import estimate_noise_level, mean_edge_length, smoothed_normals
from sparse_surface.solver.denoising.noise_spectrum import correlated_noise
from sparse_surface.solver.denoising.normal_filter import filter_normals
from sparse_surface.solver.denoising.one_sided_patches import (
    Fits,
    PatchFitter,
    PatchRule,
    kept_curvature,
    shrink_curvature,
)
from sparse_surface.solver.denoising.patch_average import PatchAverage
from sparse_surface.solver.denoising.patch_growth import Claims, GrowingPatches, agreeing_neighbours
from sparse_surface.solver.denoising.surface import build_surface
from sparse_surface.solver.denoising.triangle_repair import folded_share, repair_triangles
from sparse_surface.solver.denoising.vertex_update import (
    fill_in,
    has_wild_vertices,
    keep_shape,
    move_to_planes,
    settle,
)
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from threadpoolctl import threadpool_limits

CLEAN = (
    "cube",
    "cube98",
    "cubetorus",
    "cylinder",
    "finger",
    "flower",
    "klein_bottle",
    "l_solid",
    "lens",
    "moebius",
    "pole",
    "sphere",
    "tetrahedron",
    "thin_torus",
    "tube",
)


def bumpy_plane(side: int = 24, level: float = 0.0, seed: int = 0) -> tuple[Array, Indices]:
    """Return a square grid of triangles with jittered vertices and Gaussian noise of the given level across it."""
    rng = np.random.default_rng(seed)
    row, column = np.divmod(np.arange(side * side), side)
    inner = (row % (side - 1) > 0) & (column % (side - 1) > 0)
    at = np.column_stack([row, column]) + np.where(inner[:, None], rng.uniform(-0.2, 0.2, (side * side, 2)), 0.0)
    number = np.arange(side * side).reshape(side, side)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    return np.column_stack([at, level * rng.normal(size=side * side)]), halved(quads)


# ------------------------------------------------------------------------------------------------ how close it comes


@pytest.mark.parametrize("seed", [101, 102, 103])
def test_a_noisy_cube_gets_its_sides_and_edges_back(seed: int) -> None:
    vertices, faces = models.cube()
    denoised = denoise(with_noise(vertices, faces, 3e-3, seed), faces)
    rms, degrees = distance_from_clean(vertices, faces, denoised.vertices)
    assert rms <= 1.1e-3
    assert degrees <= 0.5


def test_a_noisy_sphere_is_round_again() -> None:
    vertices, faces = models.sphere()
    noisy = with_noise(vertices, faces, 2e-3, 5)
    denoised = denoise(noisy, faces)
    before, after = (np.linalg.norm(points, axis=1) - 1.0 for points in (noisy, denoised.vertices))
    assert np.std(after) < 0.35 * np.std(before)
    assert abs(after.mean()) < 0.1 * np.std(before)  # it has not shrunk


FANDISK = [
    (1e-3, False, 5.5e-4, 0.95),
    (3e-3, False, 1.3e-3, 1.9),
    (1e-2, False, 4.2e-3, 7.5),
    (3e-3, True, 3.6e-3, 1.6),
]
BUNNY = [(1e-3, 8e-4, 5.4), (3e-3, 1.65e-3, 7.2)]


def test_fandisk_keeps_its_creases(load_model) -> None:
    vertices, faces = load_model("fandisk.obj")
    denoised = denoise(with_noise(vertices, faces, 3e-3, 104), faces)
    rms, degrees = distance_from_clean(vertices, faces, denoised.vertices)
    assert rms <= 1.3e-3
    assert degrees <= 1.9
    assert denoised.noise_level == pytest.approx(3e-3 * diagonal(vertices), rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("seed", [201, 202])
@pytest.mark.parametrize(("share", "isotropic", "most", "most_degrees"), FANDISK)
def test_fandisk_at_every_level(load_model, share, isotropic, most, most_degrees, seed) -> None:
    vertices, faces = load_model("fandisk.obj")
    noisy = with_noise(vertices, faces, share, seed, isotropic=isotropic)
    rms, degrees = distance_from_clean(vertices, faces, denoise(noisy, faces).vertices)
    assert rms <= most
    assert degrees <= most_degrees


@pytest.mark.long
@pytest.mark.parametrize(("share", "most", "most_degrees"), BUNNY)
def test_bunny_keeps_its_fur(load_model, share, most, most_degrees) -> None:
    vertices, faces = load_model("stanford-bunny.ply")
    noisy = with_noise(vertices, faces, share, 203)
    rms, degrees = distance_from_clean(vertices, faces, denoise(noisy, faces).vertices)
    assert rms <= most
    assert degrees <= most_degrees


@pytest.mark.parametrize("seed", [31, 32])
def test_impulses_are_removed(seed: int) -> None:
    """Half of a sphere's vertices are off by noise of half an edge length: many by more than 3.5 noise levels."""
    vertices, faces = models.sphere()
    rng = np.random.default_rng(seed)
    edge = mean_edge_length(build_mesh(vertices, faces))
    off = np.where(rng.random(len(vertices)) < 0.5, rng.normal(0.0, 0.5 * edge, len(vertices)), 0.0)
    denoised = denoise(vertices * (1.0 + off)[:, None], faces)
    found = np.linalg.norm(denoised.vertices, axis=1) - 1.0
    assert np.sqrt(np.mean(found**2)) < 0.25 * np.sqrt(np.mean(off**2))
    assert denoised.displacement.max() > 3.5 * denoised.noise_level


def test_a_few_far_moves_are_not_wild_ones() -> None:
    """Of 10 000 Gaussian moves about five are longer than 3.5 deviations; a wild share shows in many more."""
    rng = np.random.default_rng(12)
    moves = rng.normal(size=(10_000, 1)) * [0.0, 0.0, 1.0]
    assert not has_wild_vertices(moves, 1.0)
    moves[::50] *= 8.0
    assert has_wild_vertices(moves, 1.0)
    assert not has_wild_vertices(moves[:50], 1.0)


@pytest.mark.parametrize("seed", [41, 42, 43])
def test_triangles_that_noise_has_folded_over_are_turned_back(seed: int) -> None:
    """Noise of 0.28 edge lengths in each direction folds triangles of a flat sheet; its border stays."""
    vertices, faces = bumpy_plane(40)
    noisy = vertices + np.random.default_rng(seed).normal(0.0, 0.28, vertices.shape)
    denoised = denoise(noisy, faces)
    clean = face_normals(vertices, faces)
    before, after = (np.mean((face_normals(v, faces) * clean).sum(axis=1) < 0) for v in (noisy, denoised.vertices))
    assert before > 0.01
    assert after < 0.2 * before


def camera_scan(kind: str, level: float, length: float, step: float, seed: int) -> tuple[Array, Array, Indices]:
    """Return a depth camera's view of a shape, clean and with errors along its rays, and the triangles.

    Neighbouring errors are alike, over `length` pixels; depths are rounded to whole steps.
    """
    wide, high, far = 90, 80, 200.0
    rng = np.random.default_rng(seed)
    y, x = np.divmod(np.arange(wide * high), wide)
    u, v = x - wide / 2, y - high / 2
    shape = {
        "roof": -0.6 * np.abs(u),
        "dome": 0.5 * np.sqrt(np.maximum(36.0**2 - u**2 - v**2, 0.0)),
        "waves": 5 * np.sin(u / 12) * np.cos(v / 15),
    }[kind]
    errors = gaussian_filter(rng.normal(size=(high + 20, wide + 20)), length)[10:-10, 10:-10].ravel()
    depth = far - shape + level * errors / errors.std()
    depth = np.round(depth / step) * step if step else depth
    rays = np.column_stack([u / far, v / far, np.ones(len(u))])
    number = np.arange(wide * high).reshape(high, wide)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    return rays * (far - shape)[:, None], rays * depth[:, None], halved(quads)


CAMERAS = [
    ("roof", 0.5, 0.85, 0.0, 2.5),
    ("roof", 0.4, 0.8, 0.5, 2.5),
    ("dome", 0.5, 0.85, 0.6, 5.0),
    ("waves", 0.5, 0.85, 0.0, 3.0),
]


@pytest.mark.parametrize(("kind", "level", "length", "step", "most_degrees"), CAMERAS)
def test_a_depth_cameras_errors_are_noise(
    kind: str, level: float, length: float, step: float, most_degrees: float
) -> None:
    clean, noisy, triangles = camera_scan(kind, level, length, step, 51)
    before = distance_from_clean(clean, triangles, noisy)
    denoised = denoise(noisy, triangles)
    rms, degrees = distance_from_clean(clean, triangles, denoised.vertices)
    assert before[1] > 15.0
    assert degrees <= most_degrees
    assert rms < 0.75 * before[0]


@pytest.mark.parametrize("length", [0.7, 0.85, 1.0])
def test_the_correlation_of_noise_is_told_from_the_mesh(length: float) -> None:
    """On a plane of equilateral triangles: the level that was put on, and how much a mean over many vertices shows."""
    side, level = 90, 0.4
    vertices, triangles = bumpy_plane(side)
    row, column = np.round(vertices[:, :2]).T
    vertices[:, 0], vertices[:, 1] = row - 0.5 * column, np.sqrt(0.75) * column
    across = np.minimum(column, side - column) * np.where(2 * column > side, -1, 1)
    down = np.minimum(row, side - row) * np.where(2 * row > side, -1, 1)
    kernel = np.exp(-((down - 0.5 * across) ** 2 + 0.75 * across**2) / (2 * length**2)).reshape(side, side)
    levels, inflations = [], []
    for seed in range(61, 67):
        white = np.random.default_rng(seed).normal(size=(side, side))
        errors = np.fft.ifft2(np.fft.fft2(white) * np.fft.fft2(kernel)).real.ravel()
        vertices[:, 2] = level * errors / errors.std()
        mesh = build_mesh(vertices, triangles)
        found = correlated_noise(mesh, np.tile([0.0, 0.0, 1.0], (mesh.node_count, 1)))
        assert found is not None
        levels.append(found.level)
        inflations.append(found.inflation)
    assert np.mean(levels) == pytest.approx(level, rel=0.1)
    spread = np.sqrt(4 * np.pi / np.sqrt(0.75)) * length  # of exp(-d^2 / (4 length^2)), the sum by its integral
    # The lower quartile of small disks lies lower for correlated noise than for independent: up to a quarter too much.
    assert spread <= np.mean(inflations) <= 1.25 * spread


@pytest.mark.parametrize("name", ["sphere", "flower", "cube", "l_solid"])
def test_independent_noise_is_not_taken_for_correlated(name: str) -> None:
    vertices, faces = getattr(models, name)()
    for share in (0.0, 2e-3, 4e-3):
        mesh = build_mesh(with_noise(vertices, faces, share, 71), faces)
        assert correlated_noise(mesh, smoothed_normals(mesh)) is None


# -------------------------------------------------------------------------------------------------- what is left alone


@pytest.mark.parametrize(("name", "kind"), [(name, np.float64) for name in CLEAN] + [("sphere", np.float32)])
def test_a_clean_mesh_comes_back_bit_for_bit(name: str, kind: type) -> None:
    vertices, faces = getattr(models, name)()
    given_vertices = np.asarray(vertices, dtype=kind)
    denoised = denoise(given_vertices, faces)
    assert denoised.vertices.dtype == kind
    assert denoised.vertices.tobytes() == given_vertices.tobytes()
    assert denoised.noise_level == denoised.relative_noise == 0.0
    assert not denoised.displacement.any()


@pytest.mark.parametrize("name", ["fandisk.obj", "rocker-arm.obj", "teapot.obj", "beetle.obj"])
def test_real_models_come_back_bit_for_bit(load_model, name: str) -> None:
    vertices, faces = load_model(name)
    np.testing.assert_array_equal(denoise(vertices, faces).vertices, vertices)


@pytest.mark.long
def test_the_bunny_comes_back_bit_for_bit(load_model) -> None:
    vertices, faces = load_model("stanford-bunny.ply")
    np.testing.assert_array_equal(denoise(vertices, faces).vertices, vertices)


def brick_wall(length: int, height: int, joint: float, depth: float) -> tuple[Array, Indices]:
    """Return a wall of bricks of the given size in steps of its grid, with joints of a width and a depth."""
    vertices, triangles = bumpy_plane(90)
    x, y = np.round(vertices[:, :2]).T
    along = (x + y // height % 2 * length / 2) % length
    in_joint = (along < joint) | (y % height < joint)
    return np.column_stack([vertices[:, :2], np.where(in_joint, 0.0, depth)]), triangles


def knurled_cylinder(around: int, along: int, depth: float, pitch: int) -> tuple[Array, Indices]:
    """Return a cylinder with two crossing threads; edges have length 1."""
    angle, height = np.meshgrid(np.arange(around), np.arange(along))
    threads = sum(np.abs(2 * ((angle + turn * height) / pitch % 1.0) - 1.0) for turn in (1, -1))
    radius = around / (2 * np.pi) + depth * threads
    turned = 2 * np.pi / around * angle
    vertices = np.stack([radius * np.cos(turned), radius * np.sin(turned), height], axis=-1).reshape(-1, 3)
    number = np.arange(around * along).reshape(along, around)
    after = np.roll(number, -1, axis=1)
    quads = np.stack([number[:-1], after[:-1], after[1:], number[1:]], axis=-1).reshape(-1, 4)
    return vertices, halved(quads)


def woven(period: float) -> tuple[Array, Indices]:
    vertices, triangles = bumpy_plane(90)
    phase = 2 * np.pi / period * vertices[:, :2]
    return np.column_stack([vertices[:, :2], 0.3 * np.sin(phase[:, 0]) * np.sin(phase[:, 1])]), triangles


PATTERNS = {
    "bricks": lambda: brick_wall(18, 9, 1.5, 0.6),
    "small bricks": lambda: brick_wall(8, 4, 1.2, 0.4),
    "wide joints": lambda: brick_wall(16, 8, 3.0, 1.0),
    "knurling": lambda: knurled_cylinder(120, 60, 0.35, 6),
    "coarse knurling": lambda: knurled_cylinder(180, 90, 0.8, 12),
    "odd knurling": lambda: knurled_cylinder(126, 60, 0.5, 7),
    "fabric": lambda: woven(7.0),
    "fine fabric": lambda: woven(4.5),
}


@pytest.mark.parametrize("name", PATTERNS)
def test_fine_regular_relief_comes_back_bit_for_bit(name: str) -> None:
    vertices, triangles = PATTERNS[name]()
    denoised = denoise(vertices, triangles)
    assert denoised.vertices.tobytes() == vertices.tobytes()
    assert denoised.noise_level == 0.0


def test_a_pattern_under_strong_noise_does_not_keep_the_noise() -> None:
    vertices, triangles = woven(7.0)
    vertices = vertices * [1.0, 1.0, 0.3]
    noisy = vertices + np.random.default_rng(8).normal(0.0, 0.25, len(vertices))[:, None] * [0.0, 0.0, 1.0]
    denoised = denoise(noisy, triangles).vertices
    before, after = (distance_from_clean(vertices, triangles, points)[0] for points in (noisy, denoised))
    assert after < 0.5 * before


def test_the_given_arrays_are_not_changed() -> None:
    vertices, faces = models.cube()
    noisy = with_noise(vertices, faces, 3e-3, 1)
    before = noisy.copy()
    denoise(noisy, faces)
    np.testing.assert_array_equal(noisy, before)
    clean = denoise(vertices, faces).vertices
    assert clean is not vertices
    assert not np.shares_memory(clean, vertices)


# ---------------------------------------------------------------------------------------------------- the noise level


@pytest.mark.parametrize("name", ["cube", "sphere", "flower", "l_solid"])
@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_the_noise_level_is_told_from_the_mesh(name: str, share: float) -> None:
    """In shares of the mean edge length, against the level that was put on."""
    vertices, faces = getattr(models, name)()
    mesh = build_mesh(vertices, faces)
    level = share * mean_edge_length(mesh)
    mesh = build_mesh(with_noise(vertices, faces, level / diagonal(vertices), 11), faces)
    assert estimate_noise_level(mesh, build_surface(mesh)).level == pytest.approx(level, rel=0.15)


def test_noise_on_a_plane_is_measured_exactly_in_the_mean() -> None:
    """Any function that the Laplacians leave is noise there: the estimate is a standard deviation."""
    levels = []
    for seed in range(8):
        mesh = build_mesh(*bumpy_plane(level=0.1, seed=seed))
        levels.append(estimate_noise_level(mesh, build_surface(mesh)).level)
    assert np.mean(levels) == pytest.approx(0.1, rel=0.05)


def test_the_mean_edge_length_counts_each_edge_once() -> None:
    vertices, faces = models.tetrahedron()
    pairs = [vertices[i] - vertices[j] for i in range(4) for j in range(i)]
    assert mean_edge_length(build_mesh(vertices, faces)) == pytest.approx(np.linalg.norm(pairs, axis=1).mean())


# --------------------------------------------------------------------------------------------- settings and behaviour


def noisy_cube(seed: int = 7) -> tuple[Array, Indices]:
    vertices, faces = models.cube()
    return with_noise(vertices, faces, 3e-3, seed), faces


def test_nothing_moves_at_strength_zero_and_more_at_more_strength() -> None:
    noisy, faces = noisy_cube()
    np.testing.assert_array_equal(denoise(noisy, faces, strength=0.0).vertices, noisy)
    moved = [np.sqrt(np.mean(denoise(noisy, faces, strength=s).displacement ** 2)) for s in (0.3, 0.6, 1.0)]
    assert 0.0 < moved[0] < moved[1] < moved[2]


def test_a_level_of_ones_own_is_used() -> None:
    noisy, faces = noisy_cube()
    own = denoise(noisy, faces, noise_level=0.004)
    assert own.noise_level == 0.004
    assert own.estimated_noise_level == denoise(noisy, faces).estimated_noise_level
    edge = mean_edge_length(build_mesh(noisy, faces))
    assert own.relative_noise == pytest.approx(0.004 / edge)
    twice = denoise(noisy, faces, noise_level=0.002, strength=2.0)
    np.testing.assert_array_equal(twice.vertices, own.vertices)


def test_a_level_can_be_given_for_a_mesh_too_small_to_tell() -> None:
    vertices, faces = models.cube(4)
    noisy = with_noise(vertices, faces, 1e-2, 3)
    assert denoise(noisy, faces).noise_level == 0.0
    given_level = denoise(noisy, faces, noise_level=1e-2 * diagonal(vertices))
    assert given_level.displacement.max() > 0.0
    assert (
        distance_from_clean(vertices, faces, given_level.vertices)[0] < distance_from_clean(vertices, faces, noisy)[0]
    )


def test_the_displacement_is_what_moved_and_is_limited() -> None:
    noisy, faces = noisy_cube()
    denoised = denoise(noisy, faces)
    np.testing.assert_allclose(denoised.displacement, np.linalg.norm(denoised.vertices - noisy, axis=1), atol=1e-15)
    assert denoised.displacement.max() <= 3.5 * denoised.noise_level * (1 + 1e-9)


def test_same_input_same_bytes() -> None:
    noisy, faces = noisy_cube()
    assert denoise(noisy, faces).vertices.tobytes() == denoise(noisy, faces).vertices.tobytes()


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_neither_threads_nor_memory_change_a_bit(threads: int) -> None:
    vertices, faces = noisy_cube()
    rng = np.random.default_rng(threads)
    expected = None
    for _ in range(3):
        scattered = [np.empty(int(size), np.uint8) for size in rng.integers(1, 200_000, 200)]
        del scattered[::3]
        with threadpool_limits(threads, user_api="blas"):
            moved = denoise(vertices, faces).vertices.tobytes()
        with threadpool_limits(1, user_api="blas"):
            expected = expected or denoise(vertices, faces).vertices.tobytes()
        assert moved == expected


def test_place_scale_and_turn_do_not_matter() -> None:
    noisy, faces = noisy_cube()
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    here = denoise(noisy, faces)
    there = denoise(1e3 * noisy @ turn + 50.0, faces)
    np.testing.assert_allclose(there.noise_level, 1e3 * here.noise_level, rtol=1e-6)
    np.testing.assert_allclose((there.vertices - 50.0) @ turn.T / 1e3, here.vertices, atol=1e-6)


def test_turned_triangles_do_not_matter() -> None:
    noisy, faces = noisy_cube()
    triangles = halved(faces)
    mixed = triangles.copy()
    turned = np.random.default_rng(4).random(len(mixed)) < 0.5
    mixed[turned] = mixed[turned, ::-1]
    np.testing.assert_allclose(denoise(noisy, mixed).vertices, denoise(noisy, triangles).vertices, atol=1e-9)


def test_open_borders_loose_vertices_and_folds_are_no_problem() -> None:
    vertices, triangles = bumpy_plane(20, 0.1, 1)
    extra = np.array([[30.0, 3.0, 2.0], [5.0, 5.0, 4.0]])
    fin = [[5 * 20 + 5, 5 * 20 + 6, len(vertices) + 1]]  # a third triangle at an edge
    everything = np.concatenate([vertices, extra])
    denoised = denoise(everything, np.concatenate([triangles, fin]))
    assert np.isfinite(denoised.vertices).all()
    np.testing.assert_array_equal(denoised.vertices[-2], extra[0])
    assert np.std(denoised.vertices[:-2, 2]) < 0.5 * np.std(vertices[:, 2])


def test_quads_are_denoised_like_their_triangles() -> None:
    noisy, faces = noisy_cube()
    assert faces.shape[1] == 4
    corners = halved(faces)
    known = (corners, np.tile(np.arange(len(faces)), 2))
    np.testing.assert_array_equal(denoise(noisy, faces, triangles=known).vertices, denoise(noisy, corners).vertices)


@pytest.mark.parametrize(
    "wrong",
    [
        {"noise_level": -1.0},
        {"noise_level": float("nan")},
        {"noise_level": float("inf")},
        {"noise_level": True},
        {"strength": -0.1},
        {"strength": 11.0},
        {"strength": "much"},
    ],
    ids=str,
)
def test_wrong_settings_are_refused(wrong) -> None:
    noisy, faces = models.cube(4)
    with pytest.raises(SettingsError, match=r"^The (noise level|strength) must be [^\n]*\.$"):
        denoise(noisy, faces, **wrong)


def test_what_is_no_mesh_is_refused() -> None:
    vertices, faces = models.cube(4)
    with pytest.raises(InputError):
        denoise(vertices * np.nan, faces)
    with pytest.raises(InputError):
        denoise(vertices, faces + len(vertices))


def test_progress_ascends_and_work_can_be_stopped() -> None:
    noisy, faces = noisy_cube()
    told: list[Progress] = []
    denoise(noisy, faces, report=lambda step: told.append(step))
    fractions = [step.fraction for step in told]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] < fractions[-1] <= 1.0
    steps = denoise_steps(noisy, faces)
    next(steps)
    next(steps)
    steps.close()


@pytest.mark.parametrize("kind", ["creased", "strong"])
def test_steps_show_the_mesh_losing_its_noise(kind: str) -> None:
    """Ever closer to the clean mesh, and to look changes no bit."""
    vertices, faces = models.cube() if kind == "creased" else models.sphere()
    noisy = with_noise(vertices, faces, 3e-3 if kind == "creased" else 2e-2, 21)
    shown: list[Array] = []
    denoised = denoise(noisy, faces, report=lambda step: shown.extend([] if step.surface is None else [step.vertices]))
    before, first, *_, last, end = (
        distance_from_clean(vertices, faces, each)[0] for each in (noisy, *shown, denoised.vertices)
    )
    assert before > 1.2 * first > 1.2 * last
    assert last < 1.1 * end
    assert all(np.isfinite(each).all() for each in shown)
    assert denoise(noisy, faces).vertices.tobytes() == denoised.vertices.tobytes()


def test_asked_to_finish_it_makes_do_with_less() -> None:
    vertices, faces = models.sphere()
    noisy = with_noise(vertices, faces, 2e-3, 5)
    told, hurriedly = [], []
    denoised = denoise(noisy, faces, report=lambda step: told.append(step.fraction))
    hurried = denoise(noisy, faces, report=lambda step: hurriedly.append(step.fraction) or FINISH)
    assert len(hurriedly) < 0.7 * len(told)
    before, after, best = (
        distance_from_clean(vertices, faces, v)[0] for v in (noisy, hurried.vertices, denoised.vertices)
    )
    assert best <= after < 0.6 * before


@settings(max_examples=15)
@given(
    level=st.floats(0.0, 0.6),
    seed=st.integers(0, 2**31),
    scale=st.sampled_from([1e-6, 1.0, 1e6]),
    strength=st.floats(0.0, 10.0),
)
def test_whatever_the_noise_moves_are_finite_and_limited(
    level: float, seed: int, scale: float, strength: float
) -> None:
    vertices, faces = bumpy_plane(18, level, seed)
    denoised = denoise(vertices * scale, faces, strength=strength)
    assert np.isfinite(denoised.vertices).all()
    assert (denoised.displacement <= 3.5 * denoised.noise_level * (1 + 1e-6) + 1e-12 * scale).all()


# ------------------------------------------------------------------------------------------------------ single steps


def test_the_filter_is_the_sum_over_all_neighbours() -> None:
    """One triangle at a time, with every neighbour's weight written out."""
    vertices, faces = bumpy_plane(6, 0.1, 3)
    mesh = build_mesh(vertices, faces)
    surface = build_surface(mesh)
    level = 0.1
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals, area = face_normals(vertices, faces), 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    around = [np.flatnonzero([len(set(f) & set(g)) > 0 and f is not g for g in faces]) for f in faces]
    around = [others[others != n] for n, others in enumerate(around)]
    centre = vertices[faces].mean(axis=1)
    spread = [np.linalg.norm(centre[others] - centre[n], axis=1).mean() for n, others in enumerate(around)]
    sides = ((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2).sum(axis=1)
    turn = 0.5 * np.log(sides / (2 * area) ** 2)
    turn = level * np.exp([np.mean(turn[[n, *others]]) for n, others in enumerate(around)])
    size = np.sqrt(area / area.mean())
    for iteration in range(3):
        result = np.empty_like(normals)
        for n, others in enumerate(around):
            total = size[n] * normals[n]
            for m in others:
                width = np.clip(1.2 * np.hypot(turn[n], turn[m]), 0.1, 0.9) * 0.85**iteration
                near = np.exp(-np.sum((centre[n] - centre[m]) ** 2) / (2 * spread[n] * spread[m]))
                alike = np.exp(-np.sum((normals[n] - normals[m]) ** 2) / (2 * width**2))
                total = total + near * alike * size[m] * normals[m]
            result[n] = total / np.linalg.norm(total)
        normals = result
    np.testing.assert_allclose(filter_normals(surface, vertices, level), normals, atol=1e-10)


def test_no_patch_crosses_a_crease() -> None:
    """On a cube every patch stays on the side of its seed, and is connected."""
    vertices, faces = models.cube(8)
    mesh = build_mesh(vertices, halved(faces))
    surface = build_surface(mesh)
    normals = face_normals(vertices, surface.triangles)
    seeds = np.arange(0, len(normals), 29)
    neighbours = agreeing_neighbours(surface.neighbours, normals, 0.8)
    growing = GrowingPatches(neighbours, normals, seeds, 0.7, Claims(len(seeds), len(normals)))
    everyone = np.ones(len(seeds), dtype=bool)
    for limit in (14, 40, 1000):
        growing.grow(limit, everyone)
        rows, triangles = growing.members(everyone)
        np.testing.assert_array_equal(np.bincount(rows), growing.sizes)
        assert (growing.sizes <= limit).all()
        for row, seed in enumerate(seeds):
            members = triangles[rows == row]
            assert len(set(members)) == len(members)
            assert np.einsum("nc,c->n", normals[members], normals[seed]).min() > 0.99
            reached, front = {seed}, {seed}
            while front:
                front = (set(neighbours[list(front)].ravel()) & set(members)) - reached
                reached |= front
            assert reached == set(members)
    side = np.bincount(np.abs(normals).argmax(axis=1) * 2 + (normals.sum(axis=1) > 0))
    assert (growing.sizes == side[0]).all()  # all of its side, in the end


def test_a_patch_is_the_weighted_least_squares_quadratic() -> None:
    """Against numpy's least squares with the weights that the patch itself gives."""
    vertices, faces = bumpy_plane(24, 0.0, 2)
    rng = np.random.default_rng(1)
    vertices[:, 2] = 2e-2 * (vertices[:, 0] - 11) ** 2 - 1e-2 * vertices[:, 0] * vertices[:, 1] / 2
    vertices[:, 2] += rng.normal(0.0, 0.01, len(vertices))
    surface = build_surface(build_mesh(vertices, faces))
    rule = PatchRule((60,), normal_width=0.3, largest_change=4.0, caution=1.0, misfit_power=1.0)
    guide = filter_normals(surface, vertices, 0.01)
    (fits,) = list(PatchFitter(surface, vertices, guide, 0.01, rule).fits(np.array([300, 500])))
    u, v = fits.at_vertex[:, 0], fits.at_vertex[:, 1]
    terms = np.stack([u**0, u, v, u**2, u * v, v**2], axis=1)
    for patch in range(len(fits)):
        present = fits.vertices[patch] >= 0
        root = np.sqrt(fits.vertex_weights[patch, present])
        heights = fits.residuals[patch, present] + terms[patch][:, present].T @ fits.coefficients[patch]
        design = terms[patch][:, present].T * root[:, None]
        expected = np.linalg.lstsq(design, root * heights, rcond=None)[0]
        np.testing.assert_allclose(fits.coefficients[patch], expected, rtol=2e-2, atol=5e-4)
        np.testing.assert_allclose(fits.gram[patch], design.T @ design, rtol=1e-9, atol=1e-12)
        local = (
            vertices[fits.vertices[patch, present]] - vertices[faces[[300, 500][patch]]].mean(axis=0)
        ) @ fits.frames[patch]
        np.testing.assert_allclose(heights, local[:, 2], atol=1e-12)
        np.testing.assert_allclose(fits.lengths[patch] * fits.at_vertex[patch][:, present].T, local[:, :2], atol=1e-12)


def fits_of_a_bent_sheet(outlier: float = 0.0) -> tuple[Fits, int]:
    """Patches of a slightly noisy paraboloid, and the number of a vertex that is off by `outlier` noise levels."""
    vertices, faces = bumpy_plane(16, 0.0, 2)
    vertices[:, 2] = 0.02 * (vertices[:, 0] - 7.5) ** 2 + np.random.default_rng(4).normal(0.0, 0.01, len(vertices))
    chosen = 7 * 16 + 8
    surface = build_surface(build_mesh(vertices, faces))
    guide = filter_normals(surface, vertices, 0.01)
    vertices[chosen, 2] += 0.01 * outlier
    rule = PatchRule((60,), normal_width=0.3, largest_change=4.0, caution=1.0, misfit_power=1.0)
    (fits,) = list(PatchFitter(surface, vertices, guide, 0.01, rule).fits(np.array([112, 97, 113])))
    return fits, chosen


def test_a_vertex_far_off_has_no_weight() -> None:
    """Welsch's weight of a residual r is exp(-r^2 / (2 (2 noise levels)^2)): at eight levels 3e-4 of that at none."""
    (near, chosen), (far, _) = (fits_of_a_bent_sheet(outlier) for outlier in (0.0, 8.0))
    there = near.vertices == chosen
    assert there.any(axis=1).all()
    assert (near.vertex_weights[there] > 0.1).all()
    assert (far.vertex_weights[there] < 0.01 * near.vertex_weights[there]).all()
    assert (far.vertex_weights[there] > 0.0).all()


def test_curvature_shrinks_by_what_noise_explains_of_it() -> None:
    """James and Stein: the second-order terms keep max(0, 1 - 1.5 / z) with z = c^T C^-1 c; the others are refitted."""
    rng = np.random.default_rng(6)
    design, root = rng.normal(size=(2, 9, 20, 6))
    gram, covariance = (np.einsum("pni,pnj->pij", part, part) for part in (design, root))
    coefficients = rng.normal(size=(9, 6)) * np.geomspace(0.3, 30.0, 9)[:, None]
    found = shrink_curvature(coefficients, gram, kept_curvature(coefficients, covariance))
    kept = []
    for patch in range(9):
        curvature = coefficients[patch, 3:]
        z = curvature @ np.linalg.inv(covariance[patch, 3:, 3:]) @ curvature
        kept.append(max(0.0, 1.0 - 1.5 / z))
        np.testing.assert_allclose(found[patch, 3:], kept[-1] * curvature, rtol=1e-9, atol=1e-12)
        heights = design[patch] @ coefficients[patch] - design[patch][:, 3:] @ found[patch, 3:]
        expected = np.linalg.lstsq(design[patch][:, :3], heights, rcond=None)[0]
        np.testing.assert_allclose(found[patch, :3], expected, rtol=1e-9, atol=1e-9)
    assert min(kept) == 0.0 < 0.9 < max(kept)


def test_patches_are_averaged_by_how_well_they_know() -> None:
    """Sums over patches, triangles and vertices one by one, with weights and planes written out."""
    fits, _ = fits_of_a_bent_sheet()
    fits = replace(fits, misfit=np.array([0.5, 2.0, 3.0]), sound=np.array([True, True, False]))
    average = PatchAverage(450, 256, misfit_power=1.5)
    average.add(fits)
    normals, matrices, targets = np.zeros((450, 3)), np.zeros((256, 3, 3)), np.zeros((256, 3))
    total, coverage = np.zeros(256), np.zeros(450, dtype=np.int64)
    responses = np.zeros(256)
    weights, squares = np.zeros(450), np.zeros(256)

    def height(patch: int, uv: Array) -> float:
        u, v = uv
        return float(fits.coefficients[patch] @ np.array([1.0, u, v, u * u, u * v, v * v]))

    def through_corners(patch: int, place: int) -> Array:
        """Unit normal in space of the plane through three points of the quadratic."""
        corners = fits.at_triangle[patch, :, place, None] + fits.corners[patch, :, :, place]
        a, b, c = (np.append(fits.lengths[patch] * corner, height(patch, corner)) for corner in corners.T)
        normal = np.cross(b - a, c - a)
        return fits.frames[patch] @ normal * np.sign(normal[2]) / np.linalg.norm(normal)

    def at(patch: int, uv: Array) -> tuple[Array, float]:
        """Unit normal of a patch in space, and one over the variance of its height."""
        u, v = uv
        c = fits.coefficients[patch] / fits.lengths[patch]
        slope = [c[1] + 2 * c[3] * u + c[4] * v, c[2] + c[4] * u + 2 * c[5] * v]
        normal = fits.frames[patch] @ [-slope[0], -slope[1], 1.0] / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
        terms = np.array([1.0, u, v, u * u, u * v, v * v])
        return normal, 1.0 / (terms @ fits.variance[patch] @ terms)

    for patch, trust in ((0, 1.0), (1, 2.0**-1.5)):
        for place, triangle in enumerate(fits.triangles[patch]):
            weight = fits.triangle_weights[patch, place]
            if weight > 0.0:
                _, precision = at(patch, fits.at_triangle[patch, :, place])
                normals[triangle] += weight * trust * precision * through_corners(patch, place)
                weights[triangle] += weight * trust * precision
                coverage[triangle] += weight > 0.5
        for place, vertex in enumerate(fits.vertices[patch]):
            weight = fits.vertex_weights[patch, place]
            if weight > 0.0:
                normal, precision = at(patch, fits.at_vertex[patch, :, place])
                # the vertex lies `residual` above the quadratic along the frame's normal: on the tangent plane below it
                offset = -fits.residuals[patch, place] * (normal @ fits.frames[patch][:, 2])
                matrices[vertex] += weight * trust * precision * np.outer(normal, normal)
                targets[vertex] += weight * trust * precision * offset * normal
                total[vertex] += weight * trust * precision
                responses[vertex] += weight * trust * precision * fits.responses[patch, place]
                squares[vertex] += weight * trust * precision * offset**2
    length = np.linalg.norm(normals, axis=1)
    guide = np.tile([0.0, 0.0, 1.0], (450, 1))
    expected = np.where(length[:, None] > 0.0, normals / np.maximum(length, 1e-300)[:, None], guide)
    np.testing.assert_allclose(average.normals(guide), expected, atol=1e-12)
    np.testing.assert_array_equal(average.coverage, coverage)
    found = average.planes()
    some = np.maximum(total, 1e-300)
    np.testing.assert_allclose(found[0], matrices / some[:, None, None], atol=1e-12)
    np.testing.assert_allclose(found[1], targets / some[:, None], atol=1e-12)
    np.testing.assert_allclose(found[2], total, rtol=1e-12)
    np.testing.assert_allclose(average.responses(), responses / some, atol=1e-12)
    agreeing = length / np.where(weights > 0.0, weights, 1.0)
    np.testing.assert_allclose(average.normal_variances(), (1.0 - agreeing**2) / 2.0, atol=1e-12)
    moves = np.random.default_rng(3).normal(0.0, 0.01, (256, 3))
    directions = np.tile([0.0, 0.6, 0.8], (256, 1))
    # mean of (n . x - d)^2, multiplied out
    variance = squares / some + np.array(
        [x @ a @ x - 2.0 * x @ b for x, a, b in zip(moves, found[0], found[1], strict=True)]
    )
    stiffness = np.array([d @ a @ d for d, a in zip(directions, found[0], strict=True)]) / np.maximum(variance, 1e-9)
    assert (variance[total > 0.0] > 1e-9).any()
    np.testing.assert_allclose(
        average.stiffness(moves, directions, 1e-9), np.where(total > 0.0, stiffness, np.inf), rtol=1e-6
    )


def test_a_patch_ends_where_a_slow_bend_leads_too_far() -> None:
    """Neighbours differ by two degrees, less than any limit between them; the patch ends 30 degrees from its seed."""
    angle, height = np.meshgrid(np.radians(2.0) * np.arange(60), np.arange(4.0), indexing="ij")
    vertices = np.stack([np.cos(angle), np.sin(angle), np.radians(2.0) * height], axis=-1).reshape(-1, 3)
    number = np.arange(240).reshape(60, 4)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    surface = build_surface(build_mesh(vertices, halved(quads)))
    normals = face_normals(vertices, surface.triangles)
    neighbours = agreeing_neighbours(surface.neighbours, normals, np.cos(0.2))
    seed, count = 3 * 29 + 1, len(normals)  # in the middle of the first halves of the quads
    growing = GrowingPatches(neighbours, normals, np.array([seed]), np.cos(np.radians(31.0)), Claims(1, count))
    growing.grow(count, np.ones(1, dtype=bool))
    _, members = growing.members(np.ones(1, dtype=bool))
    turn = np.degrees(np.arccos(np.clip(normals @ normals[seed], -1.0, 1.0)))
    np.testing.assert_array_equal(np.sort(members), np.flatnonzero(turn < 31.0))
    assert len(members) == 2 * 3 * 31


@pytest.mark.parametrize(("asked", "used"), [(0.8, 0.2), (0.4, 0.2), (0.25, 0.25), (8.0, 1.0)])
def test_a_level_that_moves_more_than_the_noise_is_halved(
    asked: float, used: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where every vertex moves by its whole level, the level comes down to the known noise, or by three halvings."""
    vertices, faces = bumpy_plane(12)
    mesh = build_mesh(vertices, faces)
    up = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))

    def by_the_level(_: object, noisy: Array, noise: steps._Noise, __: object) -> Iterator[Progress]:
        yield Progress("moving", 0.5)
        assert noise.edge * np.ptp(vertices, axis=0).max() == pytest.approx(mean_edge_length(mesh))
        return noisy + noise.level * up, up

    monkeypatch.setattr(steps, "_pass", by_the_level)
    noise = steps._Noise(asked, 0.3, mean_edge_length(mesh), sideways=False)
    moved, level = run_to_end(steps._without_noise(mesh, build_surface(mesh), noise))
    assert level == used
    np.testing.assert_allclose(moved, vertices + used * up, atol=1e-12)


def test_the_spread_of_a_fit_is_that_of_many() -> None:
    """The variance that a patch states is what its heights vary by, from noise to noise."""
    flat, faces = bumpy_plane(16, 0.0, 2)
    surface = build_surface(build_mesh(flat, faces))
    guide = np.tile([0.0, 0.0, 1.0], (len(faces), 1)) * np.sign(face_normals(flat, surface.triangles)[:, 2:])
    rule = PatchRule((60,), normal_width=5.0, largest_change=4.0, caution=1.0, misfit_power=1.0)
    rng = np.random.default_rng(9)
    heights, stated = [], []
    for _ in range(200):
        vertices = flat.copy()
        # Bent, so that nothing of the curvature is shrunk; the noise small, so that no weight falls.
        vertices[:, 2] = 0.1 * (flat[:, 0] - 7.5) ** 2 + rng.normal(0.0, 1e-3, len(flat))
        fitter = PatchFitter(surface, vertices, guide, 1e-3 * 30, rule)
        (fits,) = list(fitter.fits(np.array([200])))
        at = np.zeros((1, 2, 1))
        seed_height = vertices[surface.triangles[200]].mean(axis=0)[2]
        heights.append(seed_height * np.sign(guide[200, 2]) + fits.coefficients[0, 0])
        stated.append(fits.spread(at)[0, 0])
    assert np.std(heights) == pytest.approx(1e-3 * np.sqrt(np.mean(stated)), rel=0.25)


def test_vertices_move_to_where_their_planes_meet() -> None:
    """A corner's three planes, an edge's two and a side's one, each a little off."""
    planes = {0: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], 1: [[1, 0, 0], [0, 1, 0]], 2: [[0, 0, 1]]}
    offsets = np.array([0.01, -0.02, 0.015])
    matrices, targets = np.zeros((4, 3, 3)), np.zeros((4, 3))
    directions = np.zeros((4, 3))
    for vertex, normals in planes.items():
        n = np.array(normals, dtype=float)
        d = n @ offsets
        matrices[vertex], targets[vertex] = n.T @ n / len(n), n.T @ d / len(n)
        directions[vertex] = n.sum(axis=0) / np.linalg.norm(n.sum(axis=0))
    directions[3] = [0.0, 0.0, 1.0]
    moved = move_to_planes(np.zeros((4, 3)), (matrices, targets, np.array([1.0, 1, 1, 0])), directions, 1.0)
    for vertex in planes:
        across = np.eye(3) - np.outer(directions[vertex], directions[vertex])
        resistance = 0.15 * across + 1e-3 * np.eye(3)
        # the minimum of the quadratic, by its gradient
        gradient = matrices[vertex] @ moved[vertex] - targets[vertex] + resistance @ moved[vertex]
        np.testing.assert_allclose(gradient, 0.0, atol=1e-15)
    np.testing.assert_allclose(moved[2], [0.0, 0.0, 0.015], rtol=2e-3)
    np.testing.assert_array_equal(moved[3], 0.0)
    limited = move_to_planes(np.zeros((4, 3)), (matrices, 100 * targets, np.array([1.0, 1, 1, 0])), directions, 0.01)
    assert np.linalg.norm(limited, axis=1).max() == pytest.approx(0.035)


def test_no_patch_begins_where_a_crowd_lies_by_then() -> None:
    """Seeds come in order, a few at a time; what is covered in between is left out; someone in a hurry needs one."""
    fits, _ = fits_of_a_bent_sheet()
    fits = replace(fits, sound=np.array([True, False, False]))
    covered = np.unique(fits.triangles[0][fits.triangle_weights[0] > 0.5])
    seeds = np.random.default_rng(2).permutation(450)
    average = PatchAverage(450, 256, misfit_power=1.0)
    first, *_ = average.uncrowded(seeds, 2, 100)
    assert first[0] == 0.0
    np.testing.assert_array_equal(first[1], seeds[:100])
    taken = []
    for number, (share, some) in enumerate(average.uncrowded(seeds, 2, 100)):
        assert len(some) <= 100
        assert 0.0 <= share < 1.0
        taken.append(some)
        if number < 2:
            average.add(fits)
    after = np.concatenate(taken[2:])
    np.testing.assert_array_equal(np.concatenate(taken[:2]), seeds[:200])
    np.testing.assert_array_equal(after, seeds[200:][~np.isin(seeds[200:], covered)])
    assert 0 < len(after) < 250
    average.hurried = True
    assert not list(average.uncrowded(covered, 3, 100))


def test_vertices_settle_where_heights_and_slopes_together_are_likeliest() -> None:
    """Against the normal equations of the least squares, written row by row; vertices that are held stay."""
    vertices, faces = bumpy_plane(7, 0.05, 5)
    surface = build_surface(build_mesh(vertices, faces))
    rng = np.random.default_rng(8)
    count, triangles = len(vertices), surface.triangles
    directions = np.tile([0.0, 0.0, 1.0], (count, 1)) + rng.normal(0.0, 0.05, (count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = face_normals(vertices, triangles) + rng.normal(0.0, 0.02, triangles.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    variances = rng.uniform(1e-4, 1e-3, len(triangles))
    stiffness = rng.uniform(2e3, 2e4, count)
    stiffness[24] = np.inf
    found = settle(vertices, vertices, directions, stiffness, surface, (normals, variances), 1.0)
    np.testing.assert_array_equal(found[24], vertices[24])
    rows, targets = [np.diag(np.sqrt(np.minimum(stiffness, 1e12)))], [np.zeros(count)]
    actual = face_normals(vertices, triangles)
    for corners, normal, facing, variance in zip(triangles, normals, actual, variances, strict=True):
        ways = vertices[corners] - vertices[corners].mean(axis=0)
        trust = np.exp(-((facing - normal) ** 2).sum() / (2 * 0.16**2)) / (variance * (ways**2).sum() / 3)
        along = np.zeros((3, count))
        along[range(3), corners] = directions[corners] @ normal
        rows.append(np.sqrt(trust / 6.0) * (along - along.mean(axis=0)))
        targets.append(-np.sqrt(trust / 6.0) * (ways @ normal))
    change = np.linalg.lstsq(np.concatenate(rows), np.concatenate(targets), rcond=None)[0]
    np.testing.assert_allclose(found - vertices, change[:, None] * directions, atol=1e-2 * np.abs(change).max())


def test_what_patches_level_out_over_several_triangles_is_kept() -> None:
    """Against loops over the triangles around each corner; what is the same all around is kept, what changes is not."""
    vertices, faces = bumpy_plane(9, 0.05, 6)
    surface = build_surface(build_mesh(vertices, faces))
    triangles, actual = surface.triangles, face_normals(vertices, surface.triangles)
    rng = np.random.default_rng(3)
    normals = actual + rng.normal(0.0, 0.05, triangles.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    variances = rng.uniform(1e-4, 1e-3, len(triangles))
    found, larger = keep_shape(vertices, surface, (normals, variances))
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    weights = areas * np.exp(-((actual - normals) ** 2).sum(axis=1) / (2 * 0.16**2))
    kept = actual - normals
    for _ in range(2):
        around = [np.flatnonzero((triangles == vertex).any(axis=1)) for vertex in range(len(vertices))]
        at = np.array([np.average(kept[own], axis=0, weights=weights[own]) for own in around])
        kept = np.array([at[corners].mean(axis=0) for corners in triangles])
    expected = normals + kept
    np.testing.assert_allclose(found, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-12)
    np.testing.assert_allclose(larger, variances + (kept**2).sum(axis=1) / 2, atol=1e-15)
    tilted = actual + np.array([0.06, 0.0, 0.0])
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    alike, _ = keep_shape(vertices, surface, (tilted, variances))
    assert np.abs(alike - actual).max() < 0.1 * np.abs(tilted - actual).max()


def test_repair_keeps_vertices_on_their_edge_and_borders_in_place() -> None:
    """A roof: the ridge's vertices may slide along it, those of a slope within it; a folded one comes free."""
    vertices, faces = bumpy_plane(12)
    vertices[:, :2] = np.round(vertices[:, :2])
    vertices[:, 2] = -np.abs(vertices[:, 0] - 5.0)
    surface = build_surface(build_mesh(vertices, faces))
    normals = face_normals(vertices, surface.triangles)
    slopes = np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]) / np.sqrt(2.0)
    products = slopes[:, :, None] * slopes[:, None, :]
    on = [products.mean(axis=0) if x == 5 else products[int(x > 5)] for x in vertices[:, 0]]
    folded = vertices.copy()
    ridge, slope, border = 5 * 12 + 6, 8 * 12 + 5, 11 * 12 + 5
    folded[ridge, 1] += 1.6
    folded[slope, 1] -= 1.6
    folded[border, 1] += 1.6
    known = np.ones(len(vertices), dtype=bool)
    repaired = repair_triangles(folded, folded, np.array(on), known, surface, normals, 5.0)
    assert folded_share(folded, surface, normals) > 2 * folded_share(repaired, surface, normals)
    np.testing.assert_array_equal(repaired[border], folded[border])
    np.testing.assert_allclose(repaired[:, 2], -np.abs(repaired[:, 0] - 5.0), atol=0.02)
    assert abs(repaired[ridge, 0] - 5.0) < 0.02
    unchanged = repair_triangles(vertices, vertices, np.array(on), known, surface, normals, 5.0)
    np.testing.assert_array_equal(unchanged, vertices)


def test_vertices_that_no_patch_reached_follow_their_neighbours() -> None:
    vertices, faces = bumpy_plane(8, 0.0, 2)
    bumpy = vertices.copy()
    middle = 3 * 8 + 4
    bumpy[middle, 2] = 0.2
    surface = build_surface(build_mesh(bumpy, faces))
    known = np.arange(len(vertices)) != middle
    normals = np.tile([0.0, 0.0, 1.0], (len(faces), 1))
    filled = fill_in(bumpy, bumpy, known, surface, normals, 1.0)
    np.testing.assert_array_equal(filled[known], bumpy[known])
    assert abs(filled[middle, 2]) < 0.01
    np.testing.assert_allclose(filled[middle, :2], bumpy[middle, :2], atol=1e-12)
    held = fill_in(bumpy, bumpy, known, surface, normals, 0.05)
    assert held[middle, 2] == pytest.approx(0.15)


def test_a_vertex_counts_less_the_farther_it_is_from_the_seed():
    """1 at the seed, 0.3 at the rim, falling with the square of the distance in the plane; absent vertices do not."""
    at = np.zeros((1, 3, 5))
    at[0, 0, :4] = [0.0, 1.0, 0.0, 2.0]
    at[0, 1, 2] = -1.0
    at[0, 2] = 9.0  # heights are what is fitted
    present = np.array([[True, True, True, True, False]])
    taper, _ = one_sided_patches._taper_and_ridge(at, present)
    np.testing.assert_allclose(taper, [[1.0, 0.825, 0.825, 0.3, 0.0]], rtol=1e-12)
