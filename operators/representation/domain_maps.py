"""The patches' domains as UV maps of a result's mesh."""

from __future__ import annotations

import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Object

from ...solver.errors import InputError
from ...solver.surface.inspection import domain_atlas
from ..data.attributes import put
from ..data.result_keys import SPLITS, stored_numbers
from .stored import placement, read_representation

MOST_MAPS = 8
"""Blender keeps no more UV maps on a mesh."""


def write_domain_maps(holder: Object) -> list[str]:
    """Write the domains of a result as UV maps of its mesh and return the maps' names; the last becomes active.

    Raises
    ------
    SparseSurfaceError
        When the object holds no representation, its mesh was edited, or there is no space for more UV maps.
    """
    representation = read_representation(holder)
    placement(holder, representation)
    if SPLITS in holder and (stored_numbers(holder, SPLITS, 3) or [0.0])[0] != 1.0:
        text = rpt_("The mesh of '{}' is finer than its domains; reconstruct it with resolution 1 for their UV maps.")
        raise InputError(text.format(holder.name))
    channels = ("",) if len(representation.domains) == 1 else (" X", " Y", " Z")
    maps = {
        f"{kind} Domain{channel}": domains[c]
        for kind, domains in (("Initial", representation.initial_domains), ("Optimised", representation.domains))
        for c, channel in enumerate(channels)
    }
    layers = holder.data.uv_layers
    if len(layers) + sum(name not in layers for name in maps) > MOST_MAPS:
        text = rpt_("'{}' has no space for {} more UV maps; remove some first.")
        raise InputError(text.format(holder.name, len(maps)))
    for name, domains in maps.items():
        if name not in layers:
            layers.new(name=name, do_init=False)
        put(layers[name].data, "uv", domain_atlas(representation, domains), np.float32)
    layers.active = layers[name]
    return list(maps)
