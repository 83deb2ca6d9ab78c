"""The operator that reads point files whose points Blender's own importers drop or do not know."""

from pathlib import Path

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import StringProperty
from bpy.types import Context, Object, Operator

from .files.chosen import FileReader
from .run.poll import needs, no_run, object_mode


class SPARSE_SURFACE_OT_import_points(FileReader, Operator):
    """Read the points of .xyz, .txt, .csv, .asc, .pts, .pcd, .las, .laz, .e57 and .obj files, for Reconstruct"""

    bl_idname = "sparse_surface.import_points"
    bl_label = "Import Points"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(
        default="*.xyz;*.txt;*.csv;*.asc;*.pts;*.pcd;*.las;*.laz;*.e57;*.obj", options={"HIDDEN"}
    )

    poll = needs(object_mode, no_run)

    def read(self, path: Path, context: Context) -> Object:
        """Make a mesh of nothing but vertices."""
        from .files.points import import_points  # NumPy-heavy: enabling the add-on loads this module

        made = import_points(path, shift=True)
        self.report({"INFO"}, rpt_("'{}': {} points").format(made.name, len(made.data.vertices)))
        return made
