"""Errors that are meant to be read by the person who caused them.

Every message is one clear sentence; callers show it as it is (operator report, one line on stderr).
"""

from __future__ import annotations


class SparseSurfaceError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(SparseSurfaceError, ValueError):
    """The given mesh, point cloud or array cannot be worked on."""


class SettingsError(SparseSurfaceError, ValueError):
    """A setting lies outside of its range."""


class FileFormatError(SparseSurfaceError, ValueError):
    """A file is cut, foreign, newer than this version, or not what its name says."""


class WorkerError(SparseSurfaceError, RuntimeError):
    """Worker processes died more often than the work could be handed out anew."""


class Cancelled(SparseSurfaceError):
    """The work was stopped on request; nothing of it is left behind."""
