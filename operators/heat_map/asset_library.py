"""The asset library of the add-on: a file in the user's folder for this Blender, listed in the preferences.

It is written by the Blender that reads it, so that it suits its version; the add-on's own folder stays as installed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from ...solver.atomic_files import atomic_output
from ...solver.version import VERSION
from .material import MATERIAL, make_material

NAME = "Sparse Surface"
CATALOGUE = "9f0cbe0c-5a51-4f6e-a3a4-4d8b4c1f3c3a"
FIRST_AFTER, BETWEEN = 2.0, 1.0
"""Seconds after which the library is offered, and after which it is tried again while something else is going on."""

_ADD_ON = __package__.partition(".operators")[0]

_DESCRIPTIONS = (
    "Shows the errors of a result in the colours of the legend, in Eevee, Cycles and Material Preview",
    "Colours a mesh by its errors, or another number of each vertex, in a range of your own",
)


def folder() -> Path | None:
    """Return the folder of the library; None where the add-on was not installed as an extension."""
    try:
        return Path(bpy.utils.extension_path_user(_ADD_ON, path="assets"))
    except ValueError:
        return None


def offer() -> Path | None:
    """Write the library where this version has not yet, and list it in the preferences; return its file."""
    place = folder()
    if place is None:
        return None
    file = place / f"sparse_surface-{VERSION}.blend"
    if not file.exists():
        place.mkdir(parents=True, exist_ok=True)
        earlier = list(place.glob("sparse_surface-*.blend"))
        _write(file)
        for each in earlier:
            each.unlink()
    if _listed(place) is None:
        bpy.context.preferences.filepaths.asset_libraries.new(name=NAME, directory=str(place))
    return file


def _write(file: Path) -> None:
    from .assets import GROUP, make_group, mark  # NumPy-heavy: this module is a watcher

    text = f"VERSION 1\n\n{CATALOGUE}:{NAME}:{NAME.replace(' ', '-')}\n"
    (file.parent / "blender_assets.cats.txt").write_text(text, encoding="utf-8")
    with _names_free((bpy.data.materials, MATERIAL), (bpy.data.node_groups, GROUP)):
        material = make_material()
        group = make_group(material)
        try:
            for block, description in zip((material, group), _DESCRIPTIONS, strict=True):
                mark(block, description, CATALOGUE)
            with atomic_output(file) as draft:
                bpy.data.libraries.write(str(draft), {material, group}, fake_user=True, compress=True)
        finally:
            bpy.data.node_groups.remove(group)
            bpy.data.materials.remove(material)


@contextmanager
def _names_free(*names: tuple[Any, str]) -> Iterator[None]:
    """Take names from the user's own data-blocks for a moment."""
    taken = [(kind[name], name) for kind, name in names if name in kind]
    for block, name in taken:
        block.name = f"{name} of the user"
    try:
        yield
    finally:
        for block, name in taken:
            block.name = name


def _listed(place: Path) -> object | None:
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return next((each for each in libraries if each.path and Path(each.path) == place), None)


def _offer_soon() -> float | None:
    if bpy.context.mode != "OBJECT":
        return BETWEEN
    offer()
    return None


def register() -> None:
    """Offer the library as soon as Blender is idle; without a window there is nobody to look for assets."""
    if not bpy.app.background:
        bpy.app.timers.register(_offer_soon, first_interval=FIRST_AFTER, persistent=True)


def unregister() -> None:
    """Take the library from the preferences; its file stays for the next time."""
    if bpy.app.timers.is_registered(_offer_soon):
        bpy.app.timers.unregister(_offer_soon)
    place = folder()
    found = _listed(place) if place is not None else None
    if found is not None:
        bpy.context.preferences.filepaths.asset_libraries.remove(found)
