"""Find Sparse Surface, whether it is an extension of this Blender or a package of this Python."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import sys
from types import ModuleType

import bpy


def package() -> ModuleType:
    """Return the package with its operators registered: the installed extension, or what pip has installed.

    Raises
    ------
    SystemExit
        When there is neither.
    """
    import addon_utils

    for repository in bpy.context.preferences.extensions.repos:
        name = f"bl_ext.{repository.module}.sparse_surface"
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
            addon_utils.enable(name)
            return sys.modules[name]
    with contextlib.suppress(ImportError):
        sparse_surface = importlib.import_module("sparse_surface")
        sparse_surface.register()
        # Blender as a Python module does not end well with classes still registered.
        atexit.register(sparse_surface.unregister)
        return sparse_surface
    raise SystemExit("Sparse Surface is neither installed in this Blender nor in this Python.")


def arguments() -> list[str]:
    """Return what stands after "--" under Blender, or after the script's name under Python."""
    return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
