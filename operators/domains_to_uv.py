"""The operator that writes the patches' domains as UV maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from ..solver.errors import InputError, SparseSurfaceError
from .data.result_keys import SPLITS
from .resample import reason_against

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MOST_MAPS = 8
"""Blender keeps no more UV maps on a mesh."""


class SPARSE_SURFACE_OT_domains_to_uv(Operator):
    """Write the initial and the optimised domains as UV maps, each face in the chart of the patch that counts most"""

    bl_idname = "sparse_surface.domains_to_uv"
    bl_label = "Domains as UV Maps"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        reason = reason_against(context)
        if reason:
            cls.poll_message_set(reason)
        elif not context.active_object.data.is_editable:
            cls.poll_message_set("The active mesh is linked from another file and cannot be changed")
        else:
            return True
        return False

    def execute(self, context: Context) -> set[str]:
        try:
            names = write_domain_maps(context.active_object)
        except SparseSurfaceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("UV maps: {}").format(", ".join(names)))
        return {"FINISHED"}


def write_domain_maps(holder: Object) -> list[str]:
    """Write the domains of a result as UV maps of its mesh and return the maps' names; the last becomes active.

    Raises
    ------
    SparseSurfaceError
        When the object holds no representation, its mesh was edited, or there is no place for more UV maps.
    """
    from ..solver.surface.inspection import domain_atlas
    from .data import representation as stored_representation

    representation = stored_representation.read(holder)
    stored_representation.placement(holder, representation)
    if SPLITS in holder and holder[SPLITS][0] != 1:
        text = rpt_("The mesh of '{}' is finer than its domains; reconstruct it with resolution 1 for their UV maps.")
        raise InputError(text.format(holder.name))
    channels = ("",) if len(representation.domains) == 1 else (" X", " Y", " Z")
    maps = [
        (f"{kind} Domain{channel}", domains[c])
        for kind, domains in (("Initial", representation.initial_domains), ("Optimised", representation.domains))
        for c, channel in enumerate(channels)
    ]
    layers = holder.data.uv_layers
    if len(layers) + sum(name not in layers for name, _ in maps) > MOST_MAPS:
        raise InputError(
            rpt_("'{}' has no place for {} more UV maps; remove some first.").format(holder.name, len(maps))
        )
    for name, domains in maps:
        _write_map(holder, name, domain_atlas(representation, domains))
    layers.active = layers[maps[-1][0]]
    return [name for name, _ in maps]


def _write_map(holder: Object, name: str, coordinates: NDArray[np.float64]) -> None:
    import numpy as np

    layers = holder.data.uv_layers
    if name not in layers:
        layers.new(name=name, do_init=False)
    layers[name].data.foreach_set("uv", np.ascontiguousarray(coordinates, dtype=np.float32).ravel())


CLASSES = (SPARSE_SURFACE_OT_domains_to_uv,)
