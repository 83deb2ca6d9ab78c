"""Growing one-sided patches: the compiled kernel takes the same triangles in the same order as NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import denoise
from sparse_surface.solver.denoising import patch_growth
from sparse_surface.solver.denoising.patch_growth import PlainGrowth, agreeing_neighbours, growth_on, most_rings
from sparse_surface.solver.denoising.surface import build_surface
from sparse_surface.solver.mesh.normals import normals_and_areas, unit
from sparse_surface.solver.mesh.triangle_mesh import build_mesh
from sparse_surface.solver.native.library import reason_against
from sparse_surface.solver.native.patch_growth import NativeGrowth

pytestmark = pytest.mark.skipif(reason_against() is not None, reason=str(reason_against()))


def halved(faces: np.ndarray) -> np.ndarray:
    return np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]]) if faces.shape[1] == 4 else faces


def strip(length: int) -> tuple[np.ndarray, np.ndarray]:
    """A narrow one, so that patches have many rings."""
    at = np.arange(2 * length).reshape(length, 2)
    quads = np.stack([at[:-1, 0], at[1:, 0], at[1:, 1], at[:-1, 1]], axis=1)
    return np.stack([np.repeat(np.arange(length), 2), np.tile([0.0, 1.0], length), np.zeros(2 * length)], axis=1), quads


def broken(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A sphere from which triangles were taken: holes, pinched vertices, loose pieces."""
    vertices, faces = models.sphere(24)
    faces = halved(np.asarray(faces))
    chosen = np.random.default_rng(seed).permutation(len(faces))[len(faces) // 4 :]
    return vertices, faces[chosen]


MESHES = {"cube": lambda: models.cube(12), "strip": lambda: strip(300), "broken": lambda: broken(3)}


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("name", MESHES)
def test_patches_grow_as_in_numpy(name: str, roughness: float) -> None:
    vertices, faces = MESHES[name]()
    faces = halved(np.asarray(faces))
    surface = build_surface(build_mesh(vertices, faces))
    count, rng = len(surface.triangles), np.random.default_rng(11)
    normals = normals_and_areas(np.asarray(vertices, dtype=np.float64), surface.triangles)[0]
    normals = unit(normals + roughness * rng.normal(size=normals.shape))
    mesh = surface.triangles, len(vertices), agreeing_neighbours(surface.neighbours, normals, 0.6), normals, 0.7
    limits = (7, 20, 20, 90, 400)
    plain, native = PlainGrowth(*mesh, 40), NativeGrowth(*mesh, limits[-1], most_rings)
    for patches in (1, 40, 17):  # batch after batch by the same
        seeds = rng.choice(count, patches, replace=False)
        wanted = np.ones(patches, dtype=bool)
        for each in (plain, native):
            each.begin(seeds)
        for limit in limits:
            for each in (plain, native):
                each.grow(limit, wanted)
            np.testing.assert_array_equal(native.sizes, plain.sizes)
            for one, other in zip(native.listed(wanted), plain.listed(wanted), strict=True):
                np.testing.assert_array_equal(one, other)
            wanted &= rng.random(patches) < 0.8
    assert plain.sizes.max() > 90 or roughness > 0.0


def test_what_is_listed_are_the_triangles_and_their_corners() -> None:
    vertices, faces = models.cube(6)
    surface = build_surface(build_mesh(vertices, halved(np.asarray(faces))))
    normals = normals_and_areas(np.asarray(vertices, dtype=np.float64), surface.triangles)[0]
    growth = NativeGrowth(surface.triangles, len(vertices), surface.neighbours, normals, 0.7, 500, most_rings)
    growth.begin(np.array([5, 50, 100]))
    growth.grow(500, np.array([True, False, True]))
    triangles, listed, places = growth.listed(np.array([True, True, False]))
    assert growth.sizes.tolist() == [2 * 6**2, 1, 2 * 6**2]
    assert (triangles.shape, listed.shape) == ((2, 2 * 6**2), (2, 7**2))
    assert (triangles[1, 1:] == -1).all()
    assert (listed[1, 3:] == -1).all()
    np.testing.assert_array_equal(listed.ravel()[places], surface.triangles[triangles[triangles >= 0]].ravel())
    assert len(set(listed[0])) == 7**2


def test_a_mesh_loses_the_same_noise_without_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = models.cube(10)
    noisy = vertices + np.random.default_rng(5).normal(0.0, 0.02, vertices.shape)
    nothing = np.zeros((1, 3), int), 1, np.full((1, 3), -1), np.ones((1, 3)), 0.5, 1, 1
    kinds = [type(growth_on(*nothing))]
    by_kernel = denoise(noisy, faces, noise_level=0.02).vertices
    monkeypatch.setattr(patch_growth, "reason_against", lambda: "not here")
    kinds.append(type(growth_on(*nothing)))
    assert kinds == [NativeGrowth, PlainGrowth]
    assert (by_kernel != noisy).any()
    assert denoise(noisy, faces, noise_level=0.02).vertices.tobytes() == by_kernel.tobytes()
