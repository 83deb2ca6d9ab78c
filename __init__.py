"""Sparse Surface: meshes as overlapping patches of sparse polynomials over optimised domains.

As a library it needs no Blender: ``from sparse_surface.solver import Settings, approximate``.  In Blender
it is an extension; `register` is where Blender begins.
"""

from __future__ import annotations

from types import ModuleType


def register() -> None:
    """Register the extension in Blender."""
    for part in _parts():
        part.register()


def unregister() -> None:
    """Remove the extension from Blender."""
    for part in reversed(_parts()):
        part.unregister()


def _parts() -> tuple[ModuleType, ...]:
    """What is registered, in order.  It is imported here because it needs Blender."""
    from . import operators, ui

    return operators, ui
