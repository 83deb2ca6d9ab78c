"""Sparse Surface: meshes as overlapping patches of sparse polynomials over optimised domains.

As a library it needs no Blender: ``from sparse_surface.solver import Settings, approximate``.  In Blender
it is an extension; `register` is where Blender begins.
"""

from __future__ import annotations

# Both import inside of functions what needs Blender.


def register() -> None:
    """Register the extension in Blender."""
    from . import operators, ui

    operators.register()
    ui.register()


def unregister() -> None:
    """Remove the extension from Blender."""
    from . import operators, ui

    ui.unregister()
    operators.unregister()
