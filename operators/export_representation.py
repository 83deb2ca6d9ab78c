"""The operator that saves the representation of a result."""

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import BoolProperty, StringProperty
from bpy.types import Context, Event, Object, Operator

from ..solver.atomic_files import atomic_output
from .data.result_keys import REPRESENTATION
from .representation.compacting import compact_drafts
from .run.poll import needs, representation


class SPARSE_SURFACE_OT_export_representation(Operator):
    """Save the functions of the active result to a .npz file, for Python, the command line and Import Sparse Surface"""

    bl_idname = "sparse_surface.export_representation"
    bl_label = "Export Sparse Surface"

    filepath: StringProperty(name="File", description="File to write", subtype="FILE_PATH")
    check_existing: BoolProperty(default=True, options={"HIDDEN"})
    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    poll = needs(representation)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Ask for the file."""
        self.filepath = bpy.path.ensure_ext(bpy.path.clean_name(context.active_object.name), ".npz")
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, context: Context) -> bool:
        """Keep the ending while the user types."""
        before, self.filepath = self.filepath, bpy.path.ensure_ext(self.filepath, ".npz")
        return before != self.filepath

    def execute(self, context: Context) -> set[str]:
        if not self.filepath:
            self.report({"ERROR"}, rpt_("Choose a file"))
            return {"CANCELLED"}
        path = Path(bpy.path.abspath(bpy.path.ensure_ext(self.filepath, ".npz")))
        try:
            with atomic_output(path) as draft:
                draft.write_bytes(_compact(context.active_object))
        except OSError as error:
            self.report({"ERROR"}, rpt_("'{}' cannot be written: {}.").format(path, error.strerror or error))
            return {"CANCELLED"}
        self.report({"INFO"}, rpt_("Saved '{}'").format(path.name))
        return {"FINISHED"}


def _compact(holder: Object) -> bytes:
    compact_drafts([holder])
    return bytes(holder[REPRESENTATION])
