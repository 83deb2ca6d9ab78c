"""The zip as it arrives: installed, enabled, and with everything it brings."""

from __future__ import annotations

import importlib.metadata
import sys
import tomllib
from pathlib import Path

import addon_utils
import bpy
import numpy as np
import pytest
from packaging.requirements import Requirement
from scipy.sparse import csc_matrix

PACKAGE = "bl_ext.user_default.sparse_surface"


def test_what_is_registered(extension):
    assert hasattr(bpy.context.scene, "sparse_surface")
    assert "approximate" in dir(bpy.ops.sparse_surface)
    assert bpy.context.preferences.addons[PACKAGE].preferences is not None


def test_installed_files_are_those_of_the_package(extension):
    folder = Path(extension.__file__).parent
    manifest = tomllib.loads((folder / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["id"] == "sparse_surface"
    top = {path.name for path in folder.iterdir()} - {"__pycache__", "wheels"}
    assert {
        "__init__.py",
        "__main__.py",
        "CHANGELOG.md",
        "LICENSE",
        "blender_manifest.toml",
        "command_line",
        "operators",
        "solver",
        "ui",
    } <= top
    assert not top & {"tests", "scripts", "docs", "requirements", "Makefile", "pyproject.toml", ".ci"}


def test_wheels_are_unpacked_where_blender_looks(extension, user_folder):
    manifest = tomllib.loads((Path(extension.__file__).parent / "blender_manifest.toml").read_text(encoding="utf-8"))
    if "wheels" not in manifest:
        pytest.skip("this zip has no wheels")
    unpacked = user_folder / "extensions" / ".local" / "lib"
    for name in ("scipy", "sklearn", "joblib", "threadpoolctl"):
        assert list(unpacked.glob(f"python*/site-packages/{name}")) or list(
            unpacked.glob(f"python*/site-packages/{name}.py")
        )
    assert not list(unpacked.glob("python*/site-packages/numpy"))
    wrong = "cp313" if sys.version_info < (3, 13) else "cp311"
    assert not list(unpacked.glob(f"python*/site-packages/scipy/**/*{wrong.removeprefix('cp')}*.so"))


def test_wheels_need_nothing_that_is_not_there(extension, user_folder):
    """A wheel's newer release may ask for one package more, which no user has."""
    folders = list((user_folder / "extensions" / ".local" / "lib").glob("python*/site-packages"))
    if not folders:
        pytest.skip("this zip has no wheels")
    brought = {
        found.name: found for found in importlib.metadata.distributions(path=[str(folder) for folder in folders])
    }
    assert set(brought) == {"scipy", "scikit-learn", "joblib", "threadpoolctl"}
    for found in brought.values():
        for line in found.requires or []:
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                assert requirement.name in {*brought, "numpy"}, f"{found.name} needs {requirement.name}"
                version = np.__version__ if requirement.name == "numpy" else brought[requirement.name].version
                assert version in requirement.specifier, (found.name, line)


def test_what_the_wheels_bring_can_be_used():
    from scipy.sparse.linalg import spsolve
    from sklearn.linear_model import orthogonal_mp

    assert spsolve(csc_matrix(np.diag([2.0, 4.0])), np.array([2.0, 8.0])).tolist() == [1.0, 2.0]
    assert np.argmax(np.abs(orthogonal_mp(np.eye(3), np.array([0.0, 5.0, 1.0]), n_nonzero_coefs=1))) == 1


def test_the_installed_solver_solves():
    bpy.ops.mesh.primitive_torus_add(major_segments=48, minor_segments=16)
    source = bpy.context.object
    before = np.array([vertex.co for vertex in source.data.vertices])
    bpy.context.scene.sparse_surface.workers = 1
    assert bpy.ops.sparse_surface.approximate() == {"FINISHED"}
    result = bpy.context.object
    assert result.name == "Torus Sparse Surface"
    after = np.array([vertex.co for vertex in result.data.vertices])
    assert 0.0 < np.abs(after - before).max() < 0.02
    assert np.array_equal(before, [vertex.co for vertex in source.data.vertices])


def test_disabling_and_enabling_leaves_nothing_behind():
    classes = {name for name in dir(bpy.types) if "sparse_surface" in name.lower()}
    assert classes
    addon_utils.disable(PACKAGE, default_set=True)
    try:
        assert not hasattr(bpy.types.Scene, "sparse_surface")
        assert {name for name in dir(bpy.types) if "sparse_surface" in name.lower()} == set()
    finally:
        addon_utils.enable(PACKAGE, default_set=True)
    assert {name for name in dir(bpy.types) if "sparse_surface" in name.lower()} == classes


def test_the_zip_of_a_platform_brings_the_compiled_kernel(extension):
    library = sys.modules[f"{PACKAGE}.solver.native.library"]
    if not list((Path(extension.__file__).parent / "wheels").glob("*.whl")):
        pytest.skip("this zip is for every platform")
    assert library.reason_against() is None
