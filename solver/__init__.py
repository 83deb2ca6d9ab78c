"""Sparse Surface without Blender: meshes and point clouds to sparse patches over optimised domains.

>>> from sparse_surface.solver import Settings, approximate
>>> result = approximate(vertices, faces, Settings(ring=7))            # doctest: +SKIP
>>> result.representation.evaluate(face_index, barycentric)            # doctest: +SKIP

Names are imported when they are first used: loading the add-on must not wait for SciPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .approximation.approximate import approximate, approximate_steps
    from .approximation.report import Report
    from .approximation.result import Approximation
    from .cloud_settings import CloudSettings
    from .errors import Cancelled, FileFormatError, InputError, SettingsError, SparseSurfaceError, WorkerError
    from .progress import FINISH, Progress, run_to_end
    from .reconstruction.reconstruct import reconstruct, reconstruct_steps
    from .reconstruction.result import Reconstruction
    from .settings import PRESETS, Settings
    from .surface.representation import Representation

_HOME = {
    "Approximation": "approximation.result",
    "Cancelled": "errors",
    "CloudSettings": "cloud_settings",
    "FINISH": "progress",
    "FileFormatError": "errors",
    "InputError": "errors",
    "PRESETS": "settings",
    "Progress": "progress",
    "Reconstruction": "reconstruction.result",
    "Report": "approximation.report",
    "Representation": "surface.representation",
    "Settings": "settings",
    "SettingsError": "errors",
    "SparseSurfaceError": "errors",
    "WorkerError": "errors",
    "approximate": "approximation.approximate",
    "approximate_steps": "approximation.approximate",
    "reconstruct": "reconstruction.reconstruct",
    "reconstruct_steps": "reconstruction.reconstruct",
    "run_to_end": "progress",
}

__all__ = [
    "FINISH",
    "PRESETS",
    "Approximation",
    "Cancelled",
    "CloudSettings",
    "FileFormatError",
    "InputError",
    "Progress",
    "Reconstruction",
    "Report",
    "Representation",
    "Settings",
    "SettingsError",
    "SparseSurfaceError",
    "WorkerError",
    "approximate",
    "approximate_steps",
    "reconstruct",
    "reconstruct_steps",
    "run_to_end",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)
