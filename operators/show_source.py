"""The operator that shows the sources of results again, or hides them."""

from __future__ import annotations

from collections.abc import Iterator

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import BoolProperty
from bpy.types import Context, Object, Operator

from .data.objects import select_only
from .data.origins import source_of, was_made
from .data.visibility import hide, show, stand_beside, stand_in_place
from .run.poll import needs, object_mode


def chosen_results(context: Context) -> Iterator[tuple[Object, Object]]:
    """Iterate over the selected objects that were made from another which still exists, with that one."""
    active = context.active_object
    for made in dict.fromkeys([*([active] if active is not None else []), *context.selected_objects]):
        if was_made(made) and (source := source_of(made)) is not None:
            yield made, source


def made_object(context: Context) -> str:
    """An object is chosen that was made from another."""
    found = next(chosen_results(context), None)
    return "" if found is not None else rpt_("Select a result whose source still exists")


class SPARSE_SURFACE_OT_show_source(Operator):
    """Show what the selected results were made from, in the viewport and in renders. Press again to hide it"""

    bl_idname = "sparse_surface.show_source"
    bl_label = "Show Source"
    bl_options = {"REGISTER", "UNDO"}

    beside: BoolProperty(
        name="Side by Side",
        description="Put the result at the right of its source while both are shown; otherwise they lie in one place",
        default=False,
    )

    poll = needs(object_mode, made_object)

    def execute(self, context: Context) -> set[str]:
        pairs = list(chosen_results(context))
        showing = not all(source.visible_get() for _, source in pairs)
        for made, source in pairs:
            if showing:
                show(source, context)
                if self.beside:
                    stand_beside([made], context)
            else:
                stand_in_place(made, context)
                hide(source, context)
        select_only(context, [made for made, _ in pairs])
        return {"FINISHED"}
