"""What the add-on shows in Blender: properties, panels, presets, the heat map's legend, preferences."""

from __future__ import annotations

from importlib import import_module

MODULES = (
    "properties", "preferences", "presets", "panels", "result_panel", "inspect_panel",
    "advanced_panel", "menus", "help_panel", "legend", "readings", "command", "translations",
)  # fmt: skip
"""The modules that register something, in this order; each has `register` and `unregister`."""


def register() -> None:
    """Register every class, property, handler, preset, translation and command."""
    for name in MODULES:
        import_module(f".{name}", __package__).register()


def unregister() -> None:
    """Undo `register`, in reverse."""
    for name in reversed(MODULES):
        import_module(f".{name}", __package__).unregister()
