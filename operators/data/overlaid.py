"""Results whose sources are gone: what a new one lies over is hidden, as what its own source had before is.

Two objects were approximated, joined, and approximated again: the result of the one that went would stay inside the new
one.  No id tells that, since joining keeps those of one object only; where the surfaces lie does.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from bpy.types import Context, Object
from numpy.typing import NDArray

from .attributes import read
from .meshes import read_positions
from .origins import RESULT, ROLE, family, source_of, was_made
from .result_keys import ERROR, has_heat_map
from .visibility import BESIDE, hide, in_one_place

PROBES = 200
"""Vertices of an earlier result that are looked for in a new one."""

NEAR = 1e-3
"""Share of an earlier result's size by which merging vertices may have moved them since."""


def hide_overlaid(made: Sequence[Object], context: Context) -> None:
    """Hide the results of sources that are gone where those that were just made lie over all of them."""
    if not made or context.scene.sparse_surface.source_shown == "SHOWN":
        return
    left = [each for each in bpy.data.objects if each.get(ROLE) == RESULT and _is_left(each) and each not in made]
    context.view_layer.update()
    whole: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    for each in left:
        shown = [one for one in family(each) if one.visible_get() and in_one_place(one, each)]
        if not shown:
            continue
        if whole is None:
            whole = np.concatenate([_in_world(new) for new in made]), np.concatenate([_errors(new) for new in made])
        if _lies_in(each, *whole):
            for one in shown:
                hide(one, context)


def _is_left(candidate: Object) -> bool:
    return was_made(candidate) and source_of(candidate) is None and has_heat_map(candidate)


def _lies_in(earlier: Object, vertices: NDArray[np.float64], errors: NDArray[np.float64]) -> bool:
    """Whether each vertex of an earlier result was approximated again: some vertex is no farther than both errors."""
    points, own = _in_world(earlier), _errors(earlier)
    near = NEAR * float(np.ptp(points, axis=0).max(initial=0.0))
    chosen = np.unique(np.linspace(0, len(points) - 1, PROBES).astype(np.int64)) if len(points) else ()
    return len(chosen) > 0 and all(
        (np.linalg.norm(vertices - points[number], axis=1) - errors).min(initial=np.inf) <= own[number] + near
        for number in chosen
    )


def _in_world(placed: Object) -> NDArray[np.float64]:
    """Positions in the world, in the source's place, (V, 3)."""
    matrix = np.array(placed.matrix_world, dtype=np.float64)
    points = read_positions(placed.data) @ matrix[:3, :3].T + matrix[:3, 3]
    points[:, 0] -= placed.get(BESIDE, 0.0)
    return points


def _errors(placed: Object) -> NDArray[np.float64]:
    return read(placed.data, ERROR).astype(np.float64)
