"""The result object while its surface is being solved: it appears early, and every preview moves its vertices.

It is removed for the result itself, outside of Object Mode and before saving.  Also removed are strays that undo, or a
file saved in a crash, brings back.  NumPy-heavy modules are imported inside functions: the handlers are there from the
start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.types import Context, Object

from ...solver.errors import InputError
from ..data.objects import create_object, marked_objects, remove_marked
from ..data.result_keys import EARLY, result_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..data.colours import ColourScale
    from ..data.meshes import Source

_wanted = False
"""Whether a preview is under way; without one these objects are strays."""


def begin() -> None:
    """Keep these objects from now on, until `end`."""
    global _wanted
    _wanted = True


def end() -> None:
    """Remove these objects, and those that undo brings back later."""
    global _wanted
    _wanted = False
    remove_all()


def show(
    source: Source, positions: NDArray[np.float64], error: NDArray[np.float64], scale: ColourScale, context: Context
) -> None:
    """Move the object's vertices to positions (V, 3) in the frame of `source.arrays`, and store their errors.

    The object is created if need be, unless the source was removed or edited.
    """
    from ..data.meshes import set_positions
    from ..data.results import write_error

    early = find(source.session_uid) or _create(source, context)
    if early is not None and len(early.data.vertices) == len(positions):
        set_positions(early.data, source.lengths.to_local(positions))
        write_error(early, error, scale)


def _create(source: Source, context: Context) -> Object | None:
    from ..data.results import copy_source

    try:
        made_from, mesh = copy_source(source, context)
    except InputError:
        return None  # reported when its result is due
    early = create_object(result_name(made_from.name), mesh, made_from, context)
    early[EARLY] = source.session_uid
    early.hide_select = early.hide_render = True  # it belongs to the solver until that is done
    early.show_in_front = True  # the source lies in the same place
    early.display_type = made_from.display_type
    return early


def find(session_uid: int) -> Object | None:
    """Return the object that shows the surface of the source with this session number, if there is one."""
    return next((early for early in marked_objects(EARLY) if early[EARLY] == session_uid), None)


def remove_all() -> None:
    """Remove these objects and their meshes."""
    remove_marked(EARLY)


@bpy.app.handlers.persistent
def _remove_before_saving(*_: object) -> None:
    remove_all()  # during a run the next preview creates it again


@bpy.app.handlers.persistent
def _remove_strays(*_: object) -> None:
    if not _wanted:
        remove_all()


_HANDLERS = (
    (bpy.app.handlers.save_pre, _remove_before_saving),
    (bpy.app.handlers.load_post, _remove_strays),
    (bpy.app.handlers.undo_post, _remove_strays),
    (bpy.app.handlers.redo_post, _remove_strays),
)


def register() -> None:
    """Keep these objects out of saved files, and remove those that come back after their run."""
    for handlers, function in _HANDLERS:
        handlers.append(function)


def unregister() -> None:
    """Leave none of these objects behind."""
    end()
    for handlers, function in _HANDLERS:
        handlers.remove(function)
