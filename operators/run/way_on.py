"""What to do where a button is grey: a sentence, and the button that leads on."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from bpy.app.translations import pgettext_iface as iface_
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, UILayout

from ..data.objects import chosen_objects, has_faces, source_to_solve
from .session import session

CONVERTIBLE = {"CURVE", "CURVES", "SURFACE", "FONT", "META"}
"""Kinds of objects that Blender converts to meshes."""


class WayOn(NamedTuple):
    """A sentence about what is selected, and the operator that leads on, with its properties."""

    text: str
    operator: str
    label: str
    icon: str
    properties: Mapping[str, str] = MappingProxyType({})


def way_on(context: Context) -> WayOn | None:
    """Return what leads on where nothing that is selected can be approximated as it is."""
    chosen = chosen_objects(context)
    active = context.view_layer.objects.active
    if session.current is not None:
        return None
    if context.mode != "OBJECT":
        text = rpt_("Approximating starts in Object Mode.")
        return WayOn(text, "object.mode_set", "Object Mode", "OBJECT_DATAMODE", {"mode": "OBJECT"})
    if not chosen:
        if active is None or active.visible_get():
            return None
        text = rpt_("'{}' is hidden.").format(active.name)
        return WayOn(text, "object.hide_view_clear", "Show Hidden Objects", "HIDE_OFF")
    if any(has_faces(each) and source_to_solve(each) is not None for each in chosen):
        return None
    return _way_of(active if active in chosen else chosen[0])


def _way_of(chosen: Object) -> WayOn | None:
    if chosen.type in CONVERTIBLE:
        text = rpt_("'{}' is not a mesh.").format(chosen.name)
        return WayOn(text, "object.convert", "Convert to Mesh", "MESH_DATA", {"target": "MESH"})
    if has_faces(chosen):
        text = rpt_("What '{}' was made from is gone.").format(chosen.name)
        return WayOn(text, "sparse_surface.use_as_source", "Use as Source", "FILE_REFRESH")
    if chosen.type == "POINTCLOUD" or (chosen.type == "MESH" and chosen.data.vertices):
        text = rpt_("'{}' has points and no faces.").format(chosen.name)
        return WayOn(text, "sparse_surface.reconstruct", "Reconstruct", "POINTCLOUD_DATA")
    return None


def draw_way_on(layout: UILayout, context: Context) -> None:
    """Show the sentence and the button, if there is a way on."""
    way = way_on(context)
    if way is None:
        return
    column = layout.column(align=True)
    column.label(text=way.text, icon="INFO", translate=False)
    button = column.operator(way.operator, text=iface_(way.label), icon=way.icon, translate=False)
    for name, value in way.properties.items():
        setattr(button, name, value)
