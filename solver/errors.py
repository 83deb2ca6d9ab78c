"""Errors addressed to the user.

Every message is one clear sentence; callers show it unchanged (operator report, one line on stderr).
"""

from __future__ import annotations


class SparseSurfaceError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(SparseSurfaceError, ValueError):
    """The given mesh, point cloud or array is not usable."""


class SettingsError(SparseSurfaceError, ValueError):
    """A setting is out of range."""


class FileFormatError(SparseSurfaceError, ValueError):
    """A file is cut, foreign, newer than this version, or not what its name says."""


class WorkerError(SparseSurfaceError, RuntimeError):
    """Worker processes crashed too often to repeat their work."""


class Cancelled(SparseSurfaceError):
    """The work was stopped on request and left nothing behind."""
