"""The operator that evaluates a result's surface on a finer mesh."""

from math import isclose

from bpy.app.translations import pgettext_rpt as rpt_
from bpy.props import IntProperty
from bpy.types import Context, Object, Operator

from ..solver.errors import SparseSurfaceError
from ..solver.settings import MOST_SPLITS
from .data.objects import last_source, select_only
from .data.origins import made_from
from .data.result_keys import PART, has_functions, has_representation, shared_surface, stored_numbers
from .data.visibility import settle
from .run.poll import needs, no_run, object_mode, without_functions


def surface(context: Context) -> str:
    """The active object holds a representation or shares one, or was made from one that does."""
    return "" if _holder(context) is not None else without_functions(context.active_object)


def _holder(context: Context) -> Object | None:
    active = context.active_object
    return active if active is None or has_functions(active) else last_source(active, has_functions)


def _parts_shown(part: Object, context: Context) -> list[Object]:
    """Return the parts of a surface in one frame, this one last: those that are seen, or what was made from them."""
    surface, found = shared_surface(part), {_number(part): part}
    for each in context.view_layer.objects:
        belongs = shared_surface(each) == surface and _in_one_frame(each, part)
        if belongs and any(one.visible_get() for one in (each, *made_from(each))):
            found.setdefault(_number(each), each)
    return [*(each for each in found.values() if each != part), part]


def _number(part: Object) -> tuple[float, ...]:
    return tuple(stored_numbers(part, PART, 2) or ())


def _in_one_frame(one: Object, other: Object) -> bool:
    """Whether two objects stand in the same place, turned and scaled alike, up to rounding."""
    rows = zip(one.matrix_world, other.matrix_world, strict=True)
    pairs = (pair for two in rows for pair in zip(*two, strict=True))
    return all(isclose(here, there, rel_tol=1e-5, abs_tol=1e-5) for here, there in pairs)


class SPARSE_SURFACE_OT_resample(Operator):
    """Show a finer mesh instead of the active result: every edge is split, quads stay quads, layers are kept"""

    bl_idname = "sparse_surface.resample"
    bl_label = "Resample"
    bl_options = {"REGISTER", "UNDO"}

    splits: IntProperty(
        name="Splits",
        description="Number of parts of every edge. The number of faces grows with its square",
        default=2,
        min=1,
        max=MOST_SPLITS,
        soft_max=8,
    )

    poll = needs(no_run, object_mode, surface)

    def execute(self, context: Context) -> set[str]:
        from .representation.resampled import resample_object, resample_shared  # SciPy; enabling must not load it

        holder, replace, left_out = _holder(context), context.scene.sparse_surface.replace_result, 0
        try:
            if has_representation(holder):
                made = [resample_object(context, holder, self.splits, replace=replace)]
            else:
                parts = _parts_shown(holder, context)
                made, left_out = resample_shared(context, parts, self.splits, replace=replace)
        except (SparseSurfaceError, MemoryError) as error:
            self.report({"ERROR"}, str(error) or rpt_("There is not enough memory for this number of faces."))
            return {"CANCELLED"}
        settle(made, context)
        select_only(context, made)
        if left_out:
            text = rpt_("{} other parts of the surface were edited; they stay as they are, and borders come apart")
            self.report({"WARNING"}, text.format(left_out))
        for each in made:
            text = rpt_("'{}': {} vertices, {} faces")
            self.report({"INFO"}, text.format(each.name, len(each.data.vertices), len(each.data.polygons)))
        return {"FINISHED"}
