"""What operators that read files share: the file browser, several files at once, and files that are dropped."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy.props import CollectionProperty, StringProperty
from bpy.types import Context, Event, OperatorFileListElement

_ONCE = {"SKIP_SAVE", "HIDDEN"}


class FileReader:
    """Asks for files, unless they are given: by a script, or dropped into a window.

    A subclass names the endings in `filter_glob`, as `*.xyz;*.obj`.
    """

    if TYPE_CHECKING:
        execute: Any

    filepath: StringProperty(name="File", description="File to read", subtype="FILE_PATH", options={"SKIP_SAVE"})
    directory: StringProperty(name="Folder", subtype="DIR_PATH", options=_ONCE)
    files: CollectionProperty(name="Files", type=OperatorFileListElement, options=_ONCE)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Open the file browser, or read what was dropped."""
        if self.filepath or self.files:
            return set(self.execute(context))
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def paths(self) -> list[Path]:
        """Return the chosen files."""
        if self.files and self.directory:
            return [Path(self.directory, each.name) for each in self.files if each.name]
        return [Path(bpy.path.abspath(self.filepath))] if self.filepath else []
