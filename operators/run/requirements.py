"""The packages that the solver needs and Blender does not include."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

PACKAGES = {"SciPy": "scipy", "threadpoolctl": "threadpoolctl"}


@cache
def missing_packages() -> tuple[str, ...]:
    """Return the names of packages that are not installed; looked up once, without importing any."""
    return tuple(name for name, module in PACKAGES.items() if find_spec(module) is None)


def package_versions() -> dict[str, str]:
    """Return the versions of the packages in use."""
    return {name: _version(name) for name in ("NumPy", "SciPy", "scikit-learn")}


@cache
def _version(name: str) -> str:
    try:
        return version(name.lower())
    except PackageNotFoundError:
        return "not installed"
