"""The operator that makes objects of saved representations."""

from pathlib import Path

from bpy.props import StringProperty
from bpy.types import Context, Object, Operator

from .files.chosen import FileReader
from .run.poll import needs, no_run, object_mode, packages


class SPARSE_SURFACE_OT_import_representation(FileReader, Operator):
    """Read sparse surfaces from .npz files. The objects can be resampled and inspected, and show their errors"""

    bl_idname = "sparse_surface.import_representation"
    bl_label = "Import Sparse Surface"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.npz", options={"HIDDEN"})

    poll = needs(packages, object_mode, no_run)

    def read(self, path: Path, context: Context) -> Object:
        """Make a result object without a report."""
        from .representation.opened import open_representation  # loads SciPy; enabling the add-on must not

        return open_representation(path, context)
