"""No two surfaces in one place: hides what lies where a result is, and shows it again.  Needs no NumPy.

An object is hidden in the viewport and left out of renders, where two surfaces in one place flicker just the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from bpy.types import Context, Object
from mathutils import Matrix, Vector

from .origins import ACCOMPANYING, ROLE, family, made_from, source_of

HIDDEN = "sparse_surface_hidden"
"""Custom property of an object that was hidden for a result: whether it was left out of renders before."""

BESIDE = "sparse_surface_beside"
"""Custom property of an object that stands beside its source: how far it was moved along the world's x axis."""

SPACE = 0.15
"""Space between objects that stand side by side, as a share of their width."""


def settle(made: Sequence[Object], context: Context, others: Iterable[Object] = ()) -> None:
    """Show what was just made of objects as the scene's settings ask: instead of them, beside them or in their place.

    Parameters
    ----------
    others
        What else is to be hidden together with the sources, such as the base of a reconstruction.
    """
    wanted = context.scene.sparse_surface.source_shown
    sources = [each for each in dict.fromkeys(map(source_of, made)) if each is not None]
    accompanying = [each for source in sources for each in made_from(source) if each.get(ROLE) in ACCOMPANYING]
    for each in made:
        show(each, context)
    if wanted == "SHOWN":
        return
    if wanted == "BESIDE" and sources:
        stand_beside([*made, *(each for each in accompanying if each not in made)], context)
        hide_in_place_of(sources, context)
        for source in sources:
            show(source, context)
    hide_in_place_of(made, context)
    if wanted == "HIDDEN":
        for other in (*sources, *others, *accompanying):
            if other is not None and other not in made:
                hide(other, context)


def hide_in_place_of(kept: Sequence[Object], context: Context) -> None:
    """Hide the relatives of objects that lie in their place."""
    context.view_layer.update()
    for one in kept:
        for other in family(one):
            if other not in kept and other.get(ROLE) not in ACCOMPANYING and in_one_place(one, other):
                hide(other, context)


def in_one_place(one: Object, other: Object) -> bool:
    """Whether two objects stand in the same place, to a millionth of their size."""
    near = 1e-6 * max(1e-6, *one.dimensions, *other.dimensions)
    pairs = zip(one.matrix_world.translation, other.matrix_world.translation, strict=True)
    return all(abs(here - there) <= near for here, there in pairs)


def hide(hidden: Object, context: Context) -> None:
    """Hide an object in the viewport and leave it out of renders."""
    if not in_view_layer(hidden, context):
        return
    hidden.hide_set(True)
    if hidden.is_editable and HIDDEN not in hidden:
        hidden[HIDDEN] = hidden.hide_render
        hidden.hide_render = True


def show(shown: Object, context: Context) -> None:
    """Undo `hide`."""
    if in_view_layer(shown, context):
        shown.hide_set(False)
    if HIDDEN in shown:
        shown.hide_render = bool(shown[HIDDEN])
        del shown[HIDDEN]


def in_view_layer(candidate: Object, context: Context) -> bool:
    """Whether an object belongs to the view layer; only such an object can be hidden in it."""
    return context.view_layer.objects.get(candidate.name) == candidate


def stand_beside(made: Sequence[Object], context: Context, place: int = 1) -> None:
    """Move objects from their source's place to the right, along the world's x axis, by their width and some space."""
    context.view_layer.update()
    distance = place * (1.0 + SPACE) * _width(made)
    for each in made:
        if BESIDE not in each:
            each[BESIDE] = distance
            _shift(each, distance)


def stand_in_place(made: Object, context: Context) -> None:
    """Undo `stand_beside`."""
    if BESIDE in made:
        context.view_layer.update()
        _shift(made, -made.pop(BESIDE))


def _shift(placed: Object, distance: float) -> None:
    placed.matrix_world = Matrix.Translation((distance, 0.0, 0.0)) @ placed.matrix_world


def _width(placed: Iterable[Object]) -> float:
    along = [(each.matrix_world @ Vector(corner)).x for each in placed for corner in each.bound_box]
    return max(along) - min(along)


@contextmanager
def readable(objects: Iterable[Object], context: Context) -> Iterator[None]:
    """Let objects be evaluated: Blender does not apply the modifiers of hidden ones."""
    hidden = [each for each in objects if in_view_layer(each, context) and each.hide_get()]
    for each in hidden:
        each.hide_set(False)
    if hidden:
        context.view_layer.update()
    try:
        yield
    finally:
        for each in hidden:
            each.hide_set(True)
