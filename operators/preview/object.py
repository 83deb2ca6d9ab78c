"""The result object while its surface is being solved: it appears early, and every preview moves its vertices.

It gives way to the result itself, to whatever is done outside of Object Mode and to saving.  What undo or a file that
was left by a crash bring back of it is removed.  Needs no NumPy until an object is made: it is there from the start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.types import Context, Object

from ..data.result_keys import marked_objects, remove_marked, result_name
from ..run import control as running

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..data.colours import ColourScale
    from ..data.meshes import Source

EARLY = "sparse_surface_early"
"""Custom property of such an object: the session number of its source."""


def show(
    source: Source, positions: NDArray[np.float64], error: NDArray[np.float64], scale: ColourScale, context: Context
) -> None:
    """Move the object's vertices to positions (V, 3) in the frame of `source.arrays`, and store how far they are off.

    The object is made where it is not there, unless the source was removed or edited.
    """
    from ..data import meshes as mesh_data

    early = find(source.session_uid) or _create(source, context)
    if early is not None and len(early.data.vertices) == len(positions):
        mesh_data.set_positions(early.data, source.lengths.to_local(positions))
        mesh_data.write_error(early, error, scale)


def _create(source: Source, context: Context) -> Object | None:
    from ...solver.errors import InputError
    from ..data import meshes as mesh_data

    try:
        made_from, mesh = mesh_data.copy_source(source, context)
    except InputError:
        return None  # said when its result is due
    early = bpy.data.objects.new(result_name(made_from.name), mesh)
    early[EARLY] = source.session_uid
    early.hide_select = early.hide_render = True  # it is the solver's until it is done
    early.show_in_front = True  # the source lies in the same place
    early.display_type = made_from.display_type
    mesh_data.link_beside(early, made_from, context)
    mesh_data.place_like(early, made_from)
    return early


def find(session_uid: int) -> Object | None:
    """Return the object that shows the surface of the source with this session number, if there is one."""
    return next((early for early in marked_objects(EARLY) if early[EARLY] == session_uid), None)


def remove_all() -> None:
    """Remove these objects and their meshes."""
    remove_marked(EARLY)


@bpy.app.handlers.persistent
def _remove_before_saving(*_: object) -> None:
    remove_all()  # while a run goes on the next preview makes it anew


@bpy.app.handlers.persistent
def _remove_strays(*_: object) -> None:
    if running.current is None:
        remove_all()


_HANDLERS = (
    (bpy.app.handlers.save_pre, _remove_before_saving),
    (bpy.app.handlers.load_post, _remove_strays),
    (bpy.app.handlers.undo_post, _remove_strays),
    (bpy.app.handlers.redo_post, _remove_strays),
)


def register() -> None:
    """Keep these objects out of saved files, and from coming back when their run has ended."""
    for handlers, function in _HANDLERS:
        handlers.append(function)


def unregister() -> None:
    """Leave none of these objects behind."""
    remove_all()
    for handlers, function in _HANDLERS:
        handlers.remove(function)
