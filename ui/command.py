"""`blender --command sparse_surface ...`: the command line inside Blender."""

from __future__ import annotations

import bpy

NAME = "sparse_surface"

_handle: object | None = None


def run(arguments: list[str]) -> int:
    """Run the command line and return its exit code."""
    from ..command_line.main import main  # only who runs a command needs it

    return main(arguments)


def register() -> None:
    """Make the command known to Blender."""
    global _handle
    _handle = bpy.utils.register_cli_command(NAME, run)


def unregister() -> None:
    """Remove the command."""
    global _handle
    if _handle is not None:
        bpy.utils.unregister_cli_command(_handle)
        _handle = None
