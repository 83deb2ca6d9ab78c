"""The add-on's preferences."""

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty
from bpy.types import AddonPreferences, Context, Scene

from ..operators.data.presets import preset_names, preset_title
from ..operators.run.about import note_version
from ..operators.run.preferences import ADD_ON, preferences
from ..operators.run.requirements import missing_packages, package_versions
from .inspect_properties import preset_number
from .properties import SOLVER_NAMES

_offered: list[tuple[str, str, str, int]] = []
"""Blender needs the words of an enumeration to stay alive."""


def _presets(own: AddonPreferences, context: Context | None) -> list[tuple[str, str, str, int]]:
    _offered[:] = [(name, preset_title(name), "", preset_number(name)) for name in preset_names()]
    return _offered


def _take_preset(own: AddonPreferences, context: Context) -> None:
    apply_default_preset()


class SparseSurfacePreferences(AddonPreferences):
    bl_idname = ADD_ON

    workers: IntProperty(
        name="Workers",
        description="Threads or processes that solve patches, where a scene names no number. 0: one a physical core",
        default=0,
        min=0,
        max=256,
        soft_max=32,
    )
    default_preset: EnumProperty(
        name="Default Preset",
        description="Settings of scenes in which no setting was ever changed",
        items=_presets,
        default=0,
        update=_take_preset,
    )

    seen_version: StringProperty(
        description="The version whose news the user knows: the panel points to those of another one",
        options={"HIDDEN"},
    )

    def draw(self, context: Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        column.prop(self, "workers")
        column.prop(self, "default_preset")
        column.separator()
        for name, version in package_versions().items():
            split = column.split(factor=0.4)
            split.alignment = "RIGHT"
            split.label(text=name)
            split.label(text=version, translate=False)
        from ..solver.native.library import reason_against as kernel_missing  # NumPy-heavy: only this page needs it

        reason = kernel_missing()
        if reason is not None:
            column.label(text=reason, icon="INFO")
        elif not missing_packages():
            column.label(text="Everything was found, also the compiled kernel", icon="CHECKMARK")
        column.operator("sparse_surface.whats_new", icon="INFO")
        if missing_packages():
            column.label(text="Install the add-on's zip for your platform: it includes what is missing", icon="ERROR")


@bpy.app.handlers.persistent
def apply_default_preset(*_: object) -> None:
    """Give the preferred preset to every scene in which no setting was ever changed."""
    own = preferences(bpy.context)
    if own is None or own.default_preset in {"default", ""}:  # empty: the user removed that preset
        return
    for scene in bpy.data.scenes:
        if is_untouched(scene):
            scene.sparse_surface.apply_preset(own.default_preset)


def is_untouched(scene: Scene) -> bool:
    """Whether no setting of a scene was ever changed."""
    return not any(scene.sparse_surface.is_property_set(name) for name in SOLVER_NAMES)


def register() -> None:
    """Register the preferences, and apply the default preset to every file that is loaded."""
    bpy.utils.register_class(SparseSurfacePreferences)
    own = preferences(bpy.context)
    if own is not None and not own.seen_version:  # installed for the first time: all of it is new
        note_version(bpy.context)
    bpy.app.handlers.load_post.append(apply_default_preset)


def unregister() -> None:
    """Undo `register`."""
    bpy.app.handlers.load_post.remove(apply_default_preset)
    bpy.utils.unregister_class(SparseSurfacePreferences)
