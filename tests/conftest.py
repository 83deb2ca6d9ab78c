"""What all tests share: which tests may see bpy, where the downloaded models are, how Hypothesis searches."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
CHECKOUT = TESTS.parent
BLENDER_MODULES = ("bpy", "bmesh", "mathutils", "bpy_extras", "gpu", "blf", "addon_utils")


class BlenderOutOfReach:
    """An import hook under which a Python with bpy behaves like one without."""

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: object = None) -> ModuleSpec | None:
        if name.partition(".")[0] in BLENDER_MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}: the solver's tests run without Blender", name=name)
        return None


def chosen_paths(config: pytest.Config) -> list[Path]:
    """Return the files and folders named on the command line."""
    return [
        Path(os.path.abspath(config.invocation_params.dir / str(argument).partition("::")[0]))
        for argument in config.args
    ]


def lies_in(path: Path, folder: Path) -> bool:
    return folder == path or folder in path.parents


def pytest_configure(config: pytest.Config) -> None:
    if all(lies_in(path, TESTS / "solver") for path in chosen_paths(config)):
        assert "bpy" not in sys.modules
        sys.meta_path.insert(0, BlenderOutOfReach())
    _configure_hypothesis(long="long" in config.getoption("-m") and "not" not in config.getoption("-m"))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave tests/blender out unless it is named: importing bpy changes the process for all other tests."""
    blender = TESTS / "blender"
    if collection_path == blender and not any(lies_in(path, blender) for path in chosen_paths(config)):
        return True
    return None


def _configure_hypothesis(*, long: bool) -> None:
    try:
        from hypothesis import HealthCheck, settings
    except ImportError:  # an environment of `make test-matrix` that has only what the Blender tests need
        return
    calm = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow], "print_blob": True}
    settings.register_profile("short", derandomize=True, **calm)
    settings.register_profile("long", max_examples=2000, **calm)
    settings.load_profile("long" if long else "short")


@pytest.fixture(scope="session")
def shared_model() -> Callable[[str], Path]:
    """Return a function that finds a downloaded model by file name and skips the test if it is missing."""

    def find(name: str) -> Path:
        path = CHECKOUT.parent / "shared" / "models" / name
        if not path.exists():
            pytest.skip(f"the model {name} is not in ../shared/models")
        return path

    return find
