"""What pip builds the package with: setuptools, after the compiled kernel where there is a C compiler.

The kernel is a plain shared library, so its wheel fits every Python on its platform; without it the wheel fits all.
"""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import build_editable as build_editable_checkout
from setuptools.build_meta import build_sdist, get_requires_for_build_wheel, prepare_metadata_for_build_wheel

sys.path.insert(0, str(Path(__file__).parent))

from build_native import NativeBuildError, build_here

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_wheel",
]


def build_wheel(directory: str, config: dict[str, Any] | None = None, metadata: str | None = None) -> str:
    """Build the wheel; see PEP 517."""
    if _has_kernel():
        chosen = dict(config or {})
        chosen["--build-option"] = [f"--plat-name={sysconfig.get_platform()}"]
        return str(build_meta.build_wheel(directory, chosen, metadata))
    return str(build_meta.build_wheel(directory, config, metadata))


def build_editable(directory: str, config: dict[str, Any] | None = None, metadata: str | None = None) -> str:
    """Install the checkout itself; see PEP 660."""
    _has_kernel()
    return str(build_editable_checkout(directory, config, metadata))


def _has_kernel() -> bool:
    try:
        return build_here() is not None
    except NativeBuildError as error:
        print(f"The compiled kernel is left out: {error}", file=sys.stderr)
        return False
