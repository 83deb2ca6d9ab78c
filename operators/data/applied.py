"""Moves a source's own vertices to where its result has them; everything else about the source stays as it is."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt_
from bpy.types import Context, Mesh, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from .attributes import fetch, put
from .meshes import read_polygons, read_positions
from .noise_key import noise_key
from .origins import source_of
from .result_keys import WITH_MODIFIERS
from .visibility import readable

Points = NDArray[np.float64]

ROUNDS = 8
"""Corrections at most; one is enough where modifiers move each vertex linearly, as an armature does."""

CLOSE = 1e-6
"""Distance, as a share of the source's size, that ends the corrections."""

PROBE = 1e-2
"""How far vertices are moved to see what the modifiers make of it, as a share of the source's size."""


def apply_to_source(made: Object, context: Context) -> float:
    """Move the vertices of a result's source so that the source, with its modifiers and shape keys, is the result.

    All shape keys are moved by the same amounts, so each still adds to the others what it did.

    Returns
    -------
    float
        The largest distance of a vertex from the result, in local units.

    Raises
    ------
    InputError
        When the two meshes differ, or the modifiers undo what is done to the vertices.  The source is as before then.
    """
    source = source_of(made)
    assert source is not None
    _check(source, made)
    target = _seen_positions(made).astype(np.float64)
    before = _all_positions(source)
    shaped = bool(source.modifiers or source.data.shape_keys)
    if not (shaped and made.get(WITH_MODIFIERS, True)):
        _move(source, before, target - before[0])
        return 0.0
    with readable([source], context):
        left = _solve(source, before, target, context)
        if left is None:
            _move(source, before, np.zeros_like(target))
            raise InputError(rpt_("The modifiers of '{}' do not let its vertices go there.").format(source.name))
    return left


def _seen_positions(made: Object) -> NDArray[np.float32]:
    """Return where the vertices of a result are seen, (V, 3): a denoised one with the noise that was blended in."""
    if noise_key(made) is None:
        return read_positions(made.data)
    active = made.active_shape_key_index
    mixed = made.shape_key_add(name="Mixed", from_mix=True)
    seen = fetch(mixed.data, "co", np.float32, 3)
    made.shape_key_remove(mixed)
    made.active_shape_key_index = active
    return seen


def _check(source: Object, made: Object) -> None:
    if source.type != "MESH":
        raise InputError(rpt_("'{}' is not a mesh, so it has no surface to be changed.").format(source.name))
    if not source.data.is_editable:
        raise InputError(rpt_("The mesh of '{}' is linked from another file.").format(source.name))
    own, new = source.data, made.data
    if len(own.vertices) != len(new.vertices) and made.get(WITH_MODIFIERS, True) and source.modifiers:
        text = rpt_(
            "The modifiers of '{}' change its vertices: {} of its own became {}. "
            "Apply them, or approximate it without With Modifiers."
        )
        raise InputError(text.format(source.name, len(own.vertices), len(new.vertices)))
    if len(own.vertices) != len(new.vertices):
        text = rpt_("'{}' has {} vertices and the result {}: they have to be the same.")
        raise InputError(text.format(source.name, len(own.vertices), len(new.vertices)))
    if not _same_polygons(own, new):
        text = rpt_("'{}' was edited since: its polygons differ from those of the result.")
        raise InputError(text.format(source.name))


def _same_polygons(one: Mesh, other: Mesh) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(read_polygons(one), read_polygons(other), strict=True))


def _solve(source: Object, before: list[Points], target: Points, context: Context) -> float | None:
    """Move the source's vertices until its evaluated mesh is the target; return what is left, or None if nothing helps.

    What the modifiers make of a small move along each axis gives a 3 x 3 matrix for each vertex.
    """
    here = _evaluated(source, context)
    if len(here) != len(target):
        raise InputError(rpt_("The modifiers of '{}' were changed since; approximate it again.").format(source.name))
    size = float(np.ptp(target, axis=0).max()) or 1.0
    inverse = _inverse_moves(source, before, here, PROBE * size, context)
    offset, best = np.zeros_like(target), np.zeros_like(target)
    first = left = _largest(target - here)
    for _ in range(ROUNDS):
        if left <= CLOSE * size:
            break
        offset = offset + np.einsum("vij,vj->vi", inverse, target - here)
        _move(source, before, offset)
        here = _evaluated(source, context)
        now = _largest(target - here)
        if now < left:
            best, left = offset, now
    _move(source, before, best)
    return left if left <= CLOSE * size or left < first else None


def _inverse_moves(source: Object, before: list[Points], here: Points, length: float, context: Context) -> Points:
    """Return for each vertex the matrix from a wanted move to the one that its own position needs, (V, 3, 3)."""
    columns = []
    for axis in range(3):
        _move(source, before, length * np.eye(3)[axis])
        columns.append((_evaluated(source, context) - here) / length)
    return np.linalg.pinv(np.stack(columns, axis=2), rcond=1e-3)


def _evaluated(source: Object, context: Context) -> Points:
    context.view_layer.update()
    return read_positions(source.evaluated_get(context.evaluated_depsgraph_get()).data).astype(np.float64)


def _stores(source: Object) -> list[Any]:
    """Return what holds positions: the mesh's vertices, and every shape key."""
    keys = source.data.shape_keys
    return [source.data.vertices, *(key.data for key in (keys.key_blocks if keys is not None else ()))]


def _all_positions(source: Object) -> list[Points]:
    return [fetch(store, "co", np.float32, 3).astype(np.float64) for store in _stores(source)]


def _move(source: Object, before: list[Points], offset: Points) -> None:
    for store, positions in zip(_stores(source), before, strict=True):
        put(store, "co", positions + offset)
    source.data.update()
    source.update_tag(refresh={"DATA"})


def _largest(differences: Points) -> float:
    return float(np.linalg.norm(differences, axis=1).max(initial=0.0))


def sharing(source: Object) -> list[str]:
    """Return the names of the other objects that have the mesh of this one."""
    return [each.name for each in bpy.data.objects if each.data == source.data and each != source]
