"""The add-on's preferences."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, IntProperty
from bpy.types import AddonPreferences, Context, Scene

from ..operators.run.preferences import ADD_ON, preferences
from ..operators.run.requirements import missing_packages, package_versions
from ..solver.native.library import reason_against as kernel_missing
from ..solver.settings import PRESETS


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
        items=[(name, name.title(), "") for name in PRESETS],
        default="default",
        update=_take_preset,
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
        reason = kernel_missing()
        if reason is not None:
            column.label(text=reason, icon="INFO")
        if missing_packages():
            column.label(text="Install the add-on's zip for your platform: it includes what is missing", icon="ERROR")


@bpy.app.handlers.persistent
def apply_default_preset(*_: object) -> None:
    """Give the preferred preset to every scene in which no setting was ever changed."""
    own = preferences(bpy.context)
    if own is None or own.default_preset == "default":
        return
    for scene in bpy.data.scenes:
        if is_untouched(scene):
            scene.sparse_surface.apply_preset(own.default_preset)


def is_untouched(scene: Scene) -> bool:
    """Whether no setting of a scene was ever changed."""
    settings = scene.sparse_surface
    names = [each.identifier for each in settings.bl_rna.properties if each.identifier != "rna_type"]
    return not any(settings.is_property_set(name) for name in names)


def register() -> None:
    """Register the preferences, and apply the default preset to every file that is loaded."""
    bpy.utils.register_class(SparseSurfacePreferences)
    bpy.app.handlers.load_post.append(apply_default_preset)


def unregister() -> None:
    """Undo `register`."""
    bpy.app.handlers.load_post.remove(apply_default_preset)
    bpy.utils.unregister_class(SparseSurfacePreferences)
