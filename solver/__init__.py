"""Sparse Surface without Blender: meshes and point clouds to sparse patches over optimised domains.

>>> from sparse_surface.solver import Settings, approximate
>>> result = approximate(vertices, faces, Settings(ring=4, degree=8))  # (V, 3), and (F, n) or a list of polygons
>>> result.representation.evaluate([0, 5], [[1, 0, 0], [0.2, 0.3, 0.5]]).shape  # triangles, barycentric coordinates
(2, 3)

These names are the public interface, described in docs/api.md; everything else may change.  They are imported when
they are first used: loading the add-on must not wait for SciPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .approximation.approximate import approximate, approximate_steps
    from .approximation.denoised import denoise, denoise_steps
    from .approximation.report import Report
    from .approximation.result import Approximation
    from .blocks.approximate_blocks import BlockApproximation, approximate_blocks, approximate_blocks_steps
    from .blocks.surface import BlockSurface
    from .errors import Cancelled, FileFormatError, InputError, SettingsError, SparseSurfaceError, WorkerError
    from .progress import FINISH, Progress, run_to_end
    from .reconstruction.in_parts import ThinReconstruction, reconstruct_parts, reconstruct_parts_steps
    from .reconstruction.reconstruct import reconstruct, reconstruct_steps
    from .reconstruction.result import Reconstruction
    from .settings import PRESETS, CloudSettings, Settings
    from .surface.representation import Representation, load, save
    from .surface.resampling import resample, resample_steps

_NAMES = {
    "approximation.approximate": ("approximate", "approximate_steps"),
    "approximation.denoised": ("denoise", "denoise_steps"),
    "approximation.report": ("Report",),
    "approximation.result": ("Approximation",),
    "blocks.approximate_blocks": ("BlockApproximation", "approximate_blocks", "approximate_blocks_steps"),
    "blocks.surface": ("BlockSurface",),
    "errors": ("Cancelled", "FileFormatError", "InputError", "SettingsError", "SparseSurfaceError", "WorkerError"),
    "progress": ("FINISH", "Progress", "run_to_end"),
    "reconstruction.in_parts": ("ThinReconstruction", "reconstruct_parts", "reconstruct_parts_steps"),
    "reconstruction.reconstruct": ("reconstruct", "reconstruct_steps"),
    "reconstruction.result": ("Reconstruction",),
    "settings": ("PRESETS", "CloudSettings", "Settings"),
    "surface.representation": ("Representation", "load", "save"),
    "surface.resampling": ("resample", "resample_steps"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "FINISH",
    "PRESETS",
    "Approximation",
    "BlockApproximation",
    "BlockSurface",
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
    "ThinReconstruction",
    "WorkerError",
    "approximate",
    "approximate_blocks",
    "approximate_blocks_steps",
    "approximate_steps",
    "denoise",
    "denoise_steps",
    "load",
    "reconstruct",
    "reconstruct_parts",
    "reconstruct_parts_steps",
    "reconstruct_steps",
    "resample",
    "resample_steps",
    "run_to_end",
    "save",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)
