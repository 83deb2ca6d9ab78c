"""Meshes of other libraries: taken as they are, given back as they came."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import creased_terrain, quads_of
from sparse_surface.solver import InputError, Settings, approximate, denoise
from sparse_surface.solver.distance.distance import distance
from sparse_surface.solver.distance.settings import DistanceSettings
from sparse_surface.solver.mesh.objects import given_mesh

QUICK = Settings(ring=4, degree=6, sparsity=6, iterations=2, sweeps=0)
VERTICES, FACES = creased_terrain(8)


def made(library: str) -> Any:
    """Return the mesh as an object of a library."""
    module = pytest.importorskip(library)
    if library == "trimesh":
        return module.Trimesh(VERTICES, FACES, process=False)
    if library == "meshio":
        return module.Mesh(VERTICES, [("triangle", FACES)])
    if library == "pyvista":
        return module.PolyData(VERTICES, np.concatenate([np.full((len(FACES), 1), 3), FACES], axis=1).ravel())
    vector = module.utility
    return module.geometry.TriangleMesh(vector.Vector3dVector(VERTICES), vector.Vector3iVector(FACES))


def arrays_of(library: str, mesh: Any) -> tuple[Any, Any]:
    """Return what the library itself says of an object of it."""
    if library == "trimesh":
        return mesh.vertices, mesh.faces
    if library == "meshio":
        return mesh.points, mesh.cells_dict["triangle"]
    if library == "pyvista":
        return mesh.points, mesh.faces.reshape(-1, 4)[:, 1:]
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


@pytest.mark.parametrize("library", ["trimesh", "meshio", "pyvista", "open3d"])
def test_a_library_gets_its_kind_of_mesh_back(library: str) -> None:
    given = made(library)
    expected = approximate(VERTICES, FACES, QUICK)
    result = approximate(given, settings=QUICK)
    vertices, faces = arrays_of(library, result.as_())
    assert type(result.as_()) is type(given)
    np.testing.assert_allclose(vertices, expected.vertices, atol=1e-5 if library == "pyvista" else 1e-12)
    np.testing.assert_array_equal(faces, FACES)
    np.testing.assert_allclose(arrays_of(library, given)[0], VERTICES, atol=1e-6)  # what was given stays


def test_pairs_are_given_back_as_pairs_and_quads_stay() -> None:
    quads = quads_of(FACES)
    result = approximate((VERTICES, quads), settings=QUICK)
    vertices, faces = result.as_()
    assert faces is quads
    np.testing.assert_array_equal(vertices, result.vertices)
    np.testing.assert_array_equal(denoise((VERTICES, quads), noise_level=1e-3).as_()[1], quads)


def test_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "terrain.ply"
    made("trimesh").export(path)
    given = given_mesh(str(path))
    np.testing.assert_allclose(given.vertices, VERTICES, atol=1e-6)
    np.testing.assert_array_equal(given.faces, FACES)
    (tmp_path / "broken.ply").write_text("ply\nnonsense")
    for name, words in (("nowhere.ply", "There is no file"), ("broken.ply", "'broken.ply' cannot be read")):
        with pytest.raises(InputError, match=words):
            approximate(tmp_path / name)


def test_distances_are_measured_between_anything() -> None:
    settings = DistanceSettings()
    moved = VERTICES + np.array([0.0, 0.0, 0.25])
    found = distance((VERTICES, FACES), (moved, FACES.tolist()), settings)
    assert 0.0 < found.a_to_b.largest.found <= 0.25 + 1e-9
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    assert distance((square, [[0, 1, 2, 3]]), square + np.array([0, 0, 0.5]), settings).b_to_a.largest.found == 0.5
    assert distance(VERTICES, (VERTICES, FACES), settings).a_to_b.largest.found <= 1e-9


def test_what_is_no_mesh_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for thing in (VERTICES, 7, None, [1, 2, 3]):
        with pytest.raises(InputError, match="Faces are missing"):
            approximate(thing)
    with pytest.raises(InputError, match="but not as 'obj'"):
        approximate(VERTICES, FACES, QUICK).as_("obj")
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(InputError, match="open3d is not installed"):
        approximate(VERTICES, FACES, QUICK).as_("open3d")


def test_a_result_is_drawn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from sparse_surface.solver.mesh import plotting

    def without_pyvista(name: str) -> ModuleType | None:
        return None if name == "pyvista" else plotting

    monkeypatch.setattr(plotting, "find_spec", without_pyvista)
    result = approximate(VERTICES, FACES, QUICK)
    figure = result.plot()
    figure.savefig(tmp_path / "result.png", dpi=60)
    drawn = figure.axes[0].collections[0].get_array()
    np.testing.assert_allclose(drawn, result.error[FACES].mean(axis=1))
    monkeypatch.setattr(plotting, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="takes PyVista or Matplotlib"):
        result.plot()
