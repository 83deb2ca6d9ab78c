"""The operator that gives results the material that renders their colours."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Object, Operator

from .data.result_keys import has_heat_map
from .heat_map.material import heat_map_material
from .run.poll import needs, no_run, object_mode


def coloured(context: Context) -> list[Object]:
    """Return the selected objects with a heat map."""
    return [each for each in context.selected_objects if has_heat_map(each) and each.data.is_editable]


def something_coloured(context: Context) -> str:
    """An object with a heat map is selected."""
    return "" if coloured(context) else rpt_("Select an object with a heat map")


class SPARSE_SURFACE_OT_use_heat_map_material(Operator):
    """Replace the materials of the selected results by one that shows their errors, in renders and Material Preview"""

    bl_idname = "sparse_surface.use_heat_map_material"
    bl_label = "Use Heat Map Material"
    bl_options = {"REGISTER", "UNDO"}

    poll = needs(object_mode, no_run, something_coloured)

    def execute(self, context: Context) -> set[str]:
        material = heat_map_material()
        for each in coloured(context):
            each.data.materials.clear()
            each.data.materials.append(material)
        return {"FINISHED"}
