"""Which colours a mesh has in a file: the input's own stay as they are unless others are asked for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

import bpy
import numpy as np
from bpy.types import Mesh, Object

from ..data import attributes
from ..data.attributes import own_colours, show_colours
from ..data.colours import linear_to_srgb, srgb_to_linear
from ..data.result_keys import ERROR_COLOUR, PATCH_COLOUR
from .formats import Format

FRACTION = 0.25
"""Of a byte: too little to be rounded up."""


@contextlib.contextmanager
def colours_chosen(objects: Sequence[Object], choice: str, kind: Format) -> Iterator[None]:
    """Let objects have these colours, one of `formats.ERROR_COLOURS`, until they are written to a kind of file."""
    objects = [each for each in objects if isinstance(each.data, Mesh)]  # a patch is labelled by text objects
    originals = [] if kind.keeps_all else [_without_others(each, choice) for each in objects]
    for each in objects:
        if choice == "replace":
            show_colours(each.data, ERROR_COLOUR)
        if kind.byte_colours:
            _put_on_bytes(each.data)
    try:
        yield
    finally:
        for each, mesh in zip(objects, originals, strict=False):
            _give_back(each, mesh)


def _without_others(shown: Object, choice: str) -> Mesh:
    """Give an object a copy of its mesh with the chosen colours only; returns the mesh that it had."""
    mesh, name = shown.data, shown.data.name
    own = own_colours(mesh) if ERROR_COLOUR in mesh.color_attributes else []
    left_out = {"keep": [ERROR_COLOUR, PATCH_COLOUR], "add": [], "replace": [PATCH_COLOUR, *own]}[choice]
    shown.data = mesh.copy()
    mesh.name = "kept"
    shown.data.name = name
    for layer in left_out:
        if layer in shown.data.attributes:
            shown.data.attributes.remove(shown.data.attributes[layer])
    return mesh


def _put_on_bytes(mesh: Mesh) -> None:
    """Let the active colours be whole bytes in sRGB, with a fraction to spare for what is cut off."""
    active = mesh.color_attributes.active_color
    if active is None:
        return
    name, domain, values = active.name, active.domain, attributes.read(mesh, active.name)
    stored = 255.0 * np.concatenate([linear_to_srgb(values[:, :3].astype(np.float64)), values[:, 3:]], axis=1)
    share = (np.clip(np.rint(stored), 0.0, 255.0) + FRACTION) / 255.0
    kept = np.concatenate([srgb_to_linear(share[:, :3]), share[:, 3:]], axis=1)
    if active.data_type != "FLOAT_COLOR":
        mesh.attributes.remove(active)
    attributes.write(mesh, {name: kept}, {name: ("FLOAT_COLOR", domain)})
    show_colours(mesh, name)


def _give_back(shown: Object, mesh: Mesh) -> None:
    copy, name = shown.data, shown.data.name
    shown.data = mesh
    bpy.data.meshes.remove(copy)
    mesh.name = name
