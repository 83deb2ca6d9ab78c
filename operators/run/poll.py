"""When a button can be pressed: named conditions, each with the sentence that says why the button is grey."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, SpaceView3D

from ..data.objects import chosen_objects, chosen_results, has_faces, selected_meshes, selected_points, source_to_solve
from ..data.result_keys import has_heat_map, has_patches, has_representation, read_report
from ..heat_map.shown import shows_heat_map
from .requirements import missing_packages
from .session import session

Condition = Callable[[Context], str]
"""Returns why a button cannot be pressed, or nothing."""


def needs(*conditions: Condition) -> Any:
    """Return the `poll` of an operator that can be pressed when all conditions hold."""

    def poll(cls: Any, context: Context) -> bool:
        reason = reason_against(context, *conditions)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    return classmethod(poll)


def reason_against(context: Context, *conditions: Condition) -> str:
    """Return why the first condition that fails does so, or nothing."""
    return next(filter(None, (condition(context) for condition in conditions)), "")


def packages(context: Context) -> str:
    """The packages that the solver needs are installed."""
    if not missing_packages():
        return ""
    text = rpt_("{} is missing: install the add-on's zip for your platform, which includes it")
    return text.format(" and ".join(missing_packages()))


def no_run(context: Context) -> str:
    """No run is going on."""
    return rpt_("An approximation is running; wait for it or cancel it") if session.current is not None else ""


def object_mode(context: Context) -> str:
    """Blender is in Object Mode."""
    return rpt_("Switch to Object Mode first") if context.mode != "OBJECT" else ""


def meshes(context: Context) -> str:
    """At least one mesh with faces is selected."""
    if not chosen_objects(context):
        active = context.view_layer.objects.active
        if active is not None and not active.visible_get():  # Blender deselects what it hides
            return rpt_("'{}' is hidden: show it first").format(active.name)
        return rpt_("Select a mesh")
    chosen = selected_meshes(context)
    if any(each.type == "POINTCLOUD" for each in chosen_objects(context)) and not chosen:
        return rpt_("Points are selected: use Reconstruct")
    if not chosen:
        return rpt_("The selected object is not a mesh; convert it first (Object > Convert > Mesh)")
    if not any(has_faces(each) for each in chosen):
        if any(each.data.vertices for each in chosen):
            return rpt_("The mesh has points and no faces: use Reconstruct")
        return rpt_("The mesh has no faces")
    if all(source_to_solve(each) is None for each in chosen):
        return rpt_("What the result was made from is gone: press Use as Source to approximate it as it is")
    return ""


def one_mesh(context: Context) -> str:
    """Not more than one mesh is selected."""
    return rpt_("Select one mesh") if len(selected_meshes(context)) != 1 else ""


def points(context: Context) -> str:
    """An object with points is selected that is not the base."""
    return rpt_("Select a mesh or a point cloud other than the base") if selected_points(context) is None else ""


def result(context: Context) -> str:
    """The active object carries a report."""
    return rpt_("The active object is not a result") if read_report(context.active_object) is None else ""


def made_object(context: Context) -> str:
    """An object is chosen that was made from another."""
    found = next(chosen_results(context), None)
    return "" if found is not None else rpt_("Select a result whose source still exists")


def representation(context: Context) -> str:
    """The active object holds a representation."""
    return "" if has_representation(context.active_object) else without_functions(context.active_object)


def without_functions(candidate: Object | None) -> str:
    """Return why an object has no representation."""
    report: Any = read_report(candidate)
    if report is not None and "parts" in report["input"]:
        return rpt_("This is a part of a surface. Join its sources (Ctrl J) and approximate that to keep functions")
    return rpt_("Select a result: an object that Approximate has made")


def patches(context: Context) -> str:
    """The active object says which patch counts most at each vertex."""
    found = has_patches(context.active_object)
    return "" if found else rpt_("Select a result: an object that Approximate has made")


def editable(context: Context) -> str:
    """The active object's mesh can be written."""
    found = context.active_object.data.is_editable
    return "" if found else rpt_("The active mesh is linked from another file and cannot be changed")


def in_viewport(context: Context) -> str:
    """The mouse is in a 3D viewport."""
    return "" if isinstance(context.space_data, SpaceView3D) else rpt_("Only in a 3D viewport")


def heat_map(context: Context) -> str:
    """The viewport shows a heat map, or the active object has one."""
    if shows_heat_map(context.space_data) or has_heat_map(context.active_object):
        return ""
    return rpt_("The active object has no heat map; approximate a mesh or compare two meshes first")


MESHES_TO_SOLVE = (packages, no_run, object_mode, meshes)
"""What approximating needs."""

SURFACE = (no_run, object_mode, representation)
"""What working with a representation needs."""
