"""The operator that reads point files whose points Blender's own importers drop or do not know."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import StringProperty
from bpy.types import Context, Operator

from ..solver.errors import SparseSurfaceError
from .data.objects import select_only
from .files.chosen import FileReader
from .run.poll import needs, no_run, object_mode


class SPARSE_SURFACE_OT_import_points(FileReader, Operator):
    """Read the points of .xyz files (three numbers a line) and of .obj files, for Reconstruct"""

    bl_idname = "sparse_surface.import_points"
    bl_label = "Import Points"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.xyz;*.obj", options={"HIDDEN"})

    poll = needs(object_mode, no_run)

    def execute(self, context: Context) -> set[str]:
        from .files.points import new_object, points_of_text  # NumPy-heavy: enabling the add-on loads this module

        made, refusals = [], []
        for path in self.paths():
            try:
                made.append(new_object(path.stem, points_of_text(path)))
            except OSError as error:
                refusals.append(rpt_("'{}' cannot be read: {}.").format(path.name, error.strerror))
            except SparseSurfaceError as error:
                refusals.append(str(error))
            else:
                count = len(made[-1].data.vertices)
                self.report({"INFO"}, rpt_("'{}': {} points").format(made[-1].name, count))
        for sentence in refusals or ([] if made else [rpt_("Choose a file")]):
            self.report({"WARNING"} if made else {"ERROR"}, sentence)
        if not made:
            return {"CANCELLED"}
        select_only(context, made)
        return {"FINISHED"}
