"""The operator that measures distances: of the active object from another selected one, or of parts from one truth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import FloatProperty
from bpy.types import Context, Event, Object, Operator
from mathutils import Matrix

from ..solver.distance.settings import DistanceSettings
from ..solver.errors import SparseSurfaceError
from .data.lengths import length_text
from .data.objects import find_object, remove_objects
from .data.origins import DISTANCE, ROLE, identity, made_from, note_origin, owner_of, source_of
from .data.result_keys import DISTANCES
from .data.visibility import hide, readable
from .heat_map.point_bodies import give_bodies
from .heat_map.shown import show_here, shown_tolerance
from .measure.options import how_to_measure
from .run.operator import Solved, SolverOperator, Task, refusal
from .run.poll import needs, no_run, object_mode, packages

if TYPE_CHECKING:
    from ..solver.distance.distance import Distances
    from .measure.reading import PairSource


def parts_and_truth(context: Context) -> tuple[list[Object], Object | None]:
    """Return what is to be measured, and against what.

    Against the scene's reference all that is selected; without one the active of two selected objects, against the
    other.  Distances that were measured before stand for what they were measured of, and alone also for what they were
    measured from.
    """
    selected = [each for each in context.selected_objects if each.type in {"MESH", "POINTCLOUD"}]
    chosen = list(dict.fromkeys((DISTANCES in each and source_of(each)) or each for each in selected))
    reference = context.scene.sparse_surface.measurement.reference
    if reference is not None and reference.users_scene:
        return [each for each in chosen if each != reference], reference
    active = context.active_object
    first = (active is not None and DISTANCES in active and source_of(active)) or active
    if len(selected) == 1 and first in chosen and first != active:
        before = owner_of(str(active.get(ROLE, "")).removeprefix(DISTANCE))
        return ([first], before) if before is not None else ([], None)
    if len(chosen) != 2 or first not in chosen:
        return [], None
    return [first], next(each for each in chosen if each != first)


def parts(context: Context) -> str:
    """There is something to be measured, and something to measure it against."""
    found, truth = parts_and_truth(context)
    if found:
        return ""
    if truth is not None:
        return rpt_("Select what is to be measured against '{}'").format(truth.name)
    return rpt_("Select two meshes or point clouds, the active one is measured; or choose a reference for several")


class SPARSE_SURFACE_OT_distance(SolverOperator, Operator):
    bl_idname = "sparse_surface.distance"
    bl_label = "Measure Distance"
    bl_description = (
        "Measure the distances between the active mesh or point cloud and the other selected one, both ways; "
        "with a reference, of all that are selected from it. "
        "Each becomes a new object with the distances as its colours"
    )
    bl_options = {"UNDO"}
    has_preview = False

    tolerance: FloatProperty(
        name="Tolerance",
        description="Distance that counts as within tolerance: colours then show what is below, within and above. "
        "0: colours show all distances",
        min=0.0,
        subtype="DISTANCE",
        precision=4,
    )
    poll = needs(packages, no_run, object_mode, parts)

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Measure as the panel says, but for what the caller has set."""
        panel = context.scene.sparse_surface.measurement
        wanted = {name: getattr(panel, name) for name in how_to_measure()}
        for name, value in {**wanted, "tolerance": shown_tolerance(context.scene)}.items():
            if not self.properties.is_property_set(name):
                setattr(self, name, value)
        return super().invoke(context, event)

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """Each pair of objects with the operator's settings."""
        from .measure.reading import read_pair  # loads SciPy; enabling the add-on must not

        found, truth = parts_and_truth(context)
        tasks: list[Task] = []
        refusals = []
        with readable([*found, truth], context):
            depsgraph = context.evaluated_depsgraph_get()
            for part in found:
                try:
                    settings = DistanceSettings(self.signed, self.align, self.tolerance, self.samples)
                    tasks.append((read_pair(part, truth, depsgraph), settings))
                except (SparseSurfaceError, MemoryError) as error:
                    refusals.append(refusal(part.name, error, len(found)))
        return tasks, refusals

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """An object with the distances for each pair that was measured."""
        made = [self._make(context, source, measured) for source, measured in done]
        if made:
            show_here(context)
        return made

    def _make(self, context: Context, source: PairSource, measured: Distances) -> Object:
        from .measure.showing import create_measured, summary

        result = create_measured(source.measured, measured)
        result[DISTANCES] = json.dumps(measured.report)
        if not len(result.data.polygons):
            give_bodies(result)
        original = find_object(source.session_uid)
        if original is not None:
            if self.move and measured.alignment is not None:
                original.matrix_world = Matrix(measured.alignment.matrix.tolist()) @ original.matrix_world
            self._put_in_place(context, result, original, source)
        length = partial(length_text, context.scene)
        self.report({"INFO"}, summary(source.name, source.other_name, measured.report, length))
        return result

    @staticmethod
    def _put_in_place(context: Context, result: Object, original: Object, source: PairSource) -> None:
        """Show the distances in the place of what was measured; earlier ones from the same object are replaced."""
        truth = find_object(source.other_uid)
        role = DISTANCE + (identity(truth) if truth is not None else "")
        before = [each for each in made_from(original) if DISTANCES in each]
        replaced = [each for each in before if each.get(ROLE) == role]
        for other in (original, *(each for each in before if each not in replaced)):
            hide(other, context)
        if replaced:
            remove_objects(replaced)
            result.name = source.measured.name  # which the earlier one had
        note_origin(result, original, role)


SPARSE_SURFACE_OT_distance.__annotations__.update(how_to_measure())
