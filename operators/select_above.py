"""The operator that selects the vertices whose errors exceed the tolerance."""

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import FloatProperty
from bpy.types import Context, Event, Operator

from .data.lengths import length_text
from .data.result_keys import has_heat_map
from .run.poll import needs, no_run


def heat_map(context: Context) -> str:
    """The active object has a heat map that can be selected on."""
    active = context.active_object
    found = active is not None and has_heat_map(active) and active.data.is_editable
    return "" if found and context.mode in {"OBJECT", "EDIT_MESH"} else rpt_("Select an object with a heat map")


class SPARSE_SURFACE_OT_select_above(Operator):
    """Select the vertices of the active object whose error or distance exceeds a tolerance, in Edit Mode"""

    bl_idname = "sparse_surface.select_above"
    bl_label = "Select Above Tolerance"
    bl_options = {"REGISTER", "UNDO"}

    tolerance: FloatProperty(
        name="Tolerance",
        description="Vertices with a larger error are selected; with a sign it does not count",
        min=0.0,
        soft_max=10.0,
        subtype="DISTANCE",
        precision=5,
    )

    poll = needs(no_run, heat_map)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Begin with the tolerance of the scene."""
        settings = context.scene.sparse_surface
        if not self.properties.is_property_set("tolerance"):
            self.tolerance = settings.tolerance or settings.display.tolerance
        return self.execute(context)

    def execute(self, context: Context) -> set[str]:
        from .heat_map.above import select_above  # NumPy-heavy: enabling the add-on loads this module

        chosen = context.active_object
        count = select_above(chosen, self.tolerance)
        text = rpt_("{} of {} vertices of '{}' exceed {}")
        limit = length_text(context.scene, self.tolerance)
        self.report({"INFO"}, text.format(count, len(chosen.data.vertices), chosen.name, limit))
        return {"FINISHED"}
