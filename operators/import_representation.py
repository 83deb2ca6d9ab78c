"""The operator that makes objects of saved representations."""

from __future__ import annotations

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import StringProperty
from bpy.types import Context, Operator

from ..solver.errors import SparseSurfaceError
from .data.objects import select_only
from .files.chosen import FileReader
from .run.poll import needs, no_run, object_mode, packages


class SPARSE_SURFACE_OT_import_representation(FileReader, Operator):
    """Read sparse surfaces from .npz files. The objects can be resampled and inspected, and show their errors"""

    bl_idname = "sparse_surface.import_representation"
    bl_label = "Import Sparse Surface"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    poll = needs(packages, object_mode, no_run)

    def execute(self, context: Context) -> set[str]:
        from .representation.opened import open_representation  # loads SciPy; enabling the add-on must not

        made, refusals = [], []
        for path in self.paths():
            try:
                made.append(open_representation(path, context))
            except OSError as error:
                refusals.append(rpt_("'{}' cannot be read: {}.").format(path.name, error.strerror))
            except SparseSurfaceError as error:
                refusals.append(str(error))
        for sentence in refusals or ([] if made else [rpt_("Choose a file")]):
            self.report({"WARNING"} if made else {"ERROR"}, sentence)
        if not made:
            return {"CANCELLED"}
        select_only(context, made)
        return {"FINISHED"}
