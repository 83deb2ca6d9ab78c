"""What operators that read files share: the file browser, several files at once, and files that are dropped."""

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import CollectionProperty, StringProperty
from bpy.types import Context, Event, Object, OperatorFileListElement

from ...solver.errors import SparseSurfaceError
from ..data.objects import select_only

_ONCE = {"SKIP_SAVE", "HIDDEN"}


class FileReader:
    """Asks for files, unless they are given: by a script, or dropped into a window.

    A subclass names the endings in `filter_glob`, as `*.xyz;*.obj`.
    """

    if TYPE_CHECKING:
        report: Any

    filepath: StringProperty(name="File", description="File to read", subtype="FILE_PATH", options={"SKIP_SAVE"})
    directory: StringProperty(name="Folder", subtype="DIR_PATH", options=_ONCE)
    files: CollectionProperty(name="Files", type=OperatorFileListElement, options=_ONCE)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Open the file browser, or read what was dropped."""
        if self.filepath or self.files:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @abstractmethod
    def read(self, path: Path, context: Context) -> Object:
        """Make an object of a file; an OSError or SparseSurfaceError says why that cannot be done."""

    def execute(self, context: Context) -> set[str]:
        """Read the files, and select what was made of them."""
        made, refusals = [], []
        for path in self.paths():
            try:
                made.append(self.read(path, context))
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

    def paths(self) -> list[Path]:
        """Return the chosen files."""
        if self.files and self.directory:
            return [Path(self.directory, each.name) for each in self.files if each.name]
        return [Path(bpy.path.abspath(self.filepath))] if self.filepath else []
