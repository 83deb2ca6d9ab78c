"""The operator that measures the distances between the active object and another selected one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty
from bpy.types import Context, Object, Operator

from ..solver.distance.settings import DistanceSettings
from ..solver.errors import SparseSurfaceError
from .data.lengths import length_text
from .data.objects import find_object
from .data.result_keys import DISTANCES
from .run.operator import Solved, SolverOperator, Task, refusal
from .run.poll import needs, no_run, object_mode, packages


def two_surfaces(context: Context) -> str:
    """Two meshes or point clouds are selected, one of them active."""
    chosen = [each for each in context.selected_objects if each.type in {"MESH", "POINTCLOUD"}]
    if len(chosen) == 2 and context.active_object in chosen:
        return ""
    return rpt_("Select two meshes or point clouds; distances are those of the active one from the other")


class SPARSE_SURFACE_OT_distance(SolverOperator, Operator):
    bl_idname = "sparse_surface.distance"
    bl_label = "Measure Distance"
    bl_description = (
        "Measure the distances between the active mesh or point cloud and the other selected one, both ways. "
        "The result is a new object with the distances as its colours"
    )
    bl_options = {"UNDO"}
    has_preview = False

    signed: BoolProperty(
        name="Signed", description="Make distances inside the other object, which must be a mesh, negative"
    )
    align: EnumProperty(
        name="Align",
        description="How to move the active object onto the other one before measuring",
        items=[
            ("none", "Off", "Measure where the objects are"),
            ("rigid", "Move", "Move and rotate the active object onto the other one"),
            ("scaled", "Move and Scale", "Move, rotate and scale the active object onto the other one"),
        ],
    )
    move: BoolProperty(
        name="Move the Object", description="Move the active object itself, too, to where it was aligned"
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Distance that counts as within tolerance: colours then show what is below, within and above. "
        "0: colours show all distances",
        min=0.0,
        subtype="DISTANCE",
        precision=4,
    )
    samples: IntProperty(
        name="Samples",
        description="Number of places on each mesh over which the statistics are taken",
        default=200_000,
        min=100,
        max=100_000_000,
    )

    poll = needs(packages, no_run, object_mode, two_surfaces)

    def tasks(self, context: Context) -> tuple[list[Task], list[str]]:
        """The two objects with the operator's settings."""
        from .measure.reading import read_pair  # loads SciPy; enabling the add-on must not

        active = context.active_object
        other = next(each for each in context.selected_objects if each != active)
        try:
            settings = DistanceSettings(self.signed, self.align, self.tolerance, self.samples)
            return [(read_pair(active, other, context.evaluated_depsgraph_get()), settings)], []
        except (SparseSurfaceError, MemoryError) as error:
            return [], [refusal(active.name, error, 1)]

    def make_objects(self, context: Context, done: Sequence[Solved], refusals: list[str]) -> list[Object]:
        """An object with the distances for the pair that was measured."""
        from mathutils import Matrix

        from .measure.showing import create_measured, summary

        made = []
        length = partial(length_text, context.scene)
        for source, measured in done:
            result = create_measured(source.measured, measured, visible_points=True)
            result[DISTANCES] = json.dumps(measured.report)
            original = find_object(source.session_uid)
            if original is not None and self.move and measured.alignment is not None:
                original.matrix_world = Matrix(measured.alignment.matrix.tolist()) @ original.matrix_world
            if original is not None:
                original.hide_set(True)
            self.report({"INFO"}, summary(source.name, source.other_name, measured.report, length))
            made.append(result)
        return made
