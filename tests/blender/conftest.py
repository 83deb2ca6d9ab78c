"""Tests in this folder drive the extension as a user has it: the built zip, installed into an empty user folder.

It is installed before the tests are collected, so they may import from `bl_ext.user_default.sparse_surface` at their
top.  `SPARSE_SURFACE_ZIP` names a zip to test; without it the one for this platform is built.
"""

from __future__ import annotations

import atexit
import importlib
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent.parent
PACKAGE = "bl_ext.user_default.sparse_surface"

# Blender reads this while bpy is imported.
USER_FOLDER = Path(tempfile.mkdtemp(prefix="sparse_surface_user_"))
atexit.register(shutil.rmtree, USER_FOLDER, ignore_errors=True)
os.environ["BLENDER_USER_RESOURCES"] = str(USER_FOLDER)
import bpy  # noqa: E402


def pytest_configure(config: pytest.Config) -> None:
    if not config.option.collectonly:
        install(built_zip())
        add_benchmarks()


def built_zip() -> Path:
    """Return the zip to test, freshly built from the checkout unless one is named."""
    named = os.environ.get("SPARSE_SURFACE_ZIP")
    if named:
        return Path(named)
    sys.path.insert(0, str(CHECKOUT / "scripts"))
    try:
        building = importlib.import_module("build_extension")
    finally:
        sys.path.pop(0)
    return building.build(building.this_platform(), USER_FOLDER / "zip")


def install(path: Path) -> None:
    """Install and enable a zip, as the preferences' "Install from Disk" does."""
    import addon_utils

    addon_utils.enable("bl_pkg", default_set=True)
    outcome = bpy.ops.extensions.package_install_files(
        filepath=str(path), repo="user_default", enable_on_install=True, overwrite=True
    )
    if outcome != {"FINISHED"} or PACKAGE not in bpy.context.preferences.addons:
        raise pytest.UsageError(f"Blender {bpy.app.version_string} did not install {path}: {outcome}")
    folder = Path(sys.modules[PACKAGE].__file__ or "").parent
    if USER_FOLDER.resolve() not in folder.resolve().parents:
        raise pytest.UsageError(f"the tests would run on {folder}, not on the installed zip")


def add_benchmarks() -> None:
    """Let the tests import the checkout's generated models beside the extension, whose zip does not hold them."""
    folder, name = CHECKOUT / "benchmarks", f"{PACKAGE}.benchmarks"
    spec = importlib.util.spec_from_file_location(
        name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None
    assert spec.loader is not None
    sys.modules[name] = package = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(package)


def pytest_report_header() -> list[str]:
    """Say on what the tests run: a result means little without it."""
    import numpy

    lines = [f"Blender {bpy.app.version_string}, NumPy {numpy.__version__}"]
    for name in ("scipy", "sklearn"):
        try:
            module = importlib.import_module(name)
        except ImportError:
            lines[0] += f", no {name}"
        else:
            place = "the zip" if str(USER_FOLDER) in str(module.__file__) else "site-packages"
            lines[0] += f", {name} {module.__version__} from {place}"
    return lines


@pytest.fixture(autouse=True)
def fresh_scene() -> Iterator[None]:
    """Begin each test with an empty file; unlike factory settings, that keeps the extension enabled."""
    bpy.ops.wm.read_homefile(use_empty=True)
    yield
    assert PACKAGE in bpy.context.preferences.addons, "a test has disabled the extension and left it so"


@pytest.fixture(scope="session")
def extension() -> ModuleType:
    """Return the installed extension's package."""
    return sys.modules[PACKAGE]


@pytest.fixture(scope="session")
def user_folder() -> Path:
    """Return the throw-away folder that stands for the user's Blender settings."""
    return USER_FOLDER


@pytest.fixture
def run_bpy(tmp_path: Path) -> Any:
    """Return a function that runs Python code in another process with bpy and the same user folder."""

    def run(code: str, *arguments: str, timeout: float = 300.0) -> subprocess.CompletedProcess[str]:
        script = tmp_path / "script.py"
        script.write_text(code, encoding="utf-8")
        return subprocess.run(
            [sys.executable, str(script), *arguments],
            capture_output=True,
            text=True,
            timeout=timeout,
            cwd=tmp_path,
            env={**os.environ, "BLENDER_USER_RESOURCES": str(USER_FOLDER)},
        )

    return run
