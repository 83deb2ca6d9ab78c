"""The settings of a scene: the solver's, made from its own list, and those that only Blender needs."""

import dataclasses
from functools import lru_cache
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty
from bpy.types import Context, Object, PropertyGroup

from ..operators.data.presets import plain_value, preset_values
from ..operators.heat_map.shown import isolate_everywhere
from ..solver.settings import MOST_SPLITS, CloudSettings, Settings
from . import inspect_properties, jobs
from .optional import optional_properties

NAMES = {
    "beta1": "Stay at Start",
    "beta2": "Keep Rigid",
    "rho": "Penalty",
    "tau": "Multiplier Step",
    "adaptive": "Adaptive Rings",
    "denoise_strength": "Strength",
    "robust": "Outliers",
    "strays": "Strays",
    "noise": "Noise Level",
    "creases": "Find Creases",
    "fit_base": "Fit the Base",
}
"""Names of settings where they differ from the identifier in title case."""

CHOICE_NAMES = {
    "auto": "Automatic",
    "lscm": "LSCM",
    "ols": "OLS",
    "omp": "OMP",
    "sklearn": "OMP by scikit-learn",
    "common": "Common Domain",
    "separate": "Domain per Coordinate",
    "partition": "Partition of Unity",
    "data": "Data",
    "only": "Denoise Only",
    "first": "Denoise, then Approximate",
    "drop": "Leave Out",
    "keep": "Keep",
    "vertex": "Per Vertex",
    "printed": "As Printed",
    "native": "Compiled Kernel",
    "numpy": "NumPy",
}

LENGTHS = {"tolerance", "noise_level", "noise", "merge_distance", "close_holes", "trim_distance"}
"""Settings in scene units."""

OPTIONAL = {"tolerance": 0.0, "noise_level": 0.0, "merge_distance": 0.0, "workers": 2}
OPTIONAL_CLOUD = {"noise": 0.0, "ring": 1, "close_holes": 0.1, "trim_distance": 0.1, "trim_density": 0.1}
"""Settings of which zero means none or automatic, each with the value that it starts with (see `optional`)."""

COUNTS = (
    (
        "base_vertices", 500, 200_000, 2000, "Base Vertices",
        "Approximate number of vertices of a base made from the points. 0: one for every 24 to 60 points",
    ),
    (
        "splits", 4, MOST_SPLITS, 16, "Resolution",
        "Number of parts of every edge of the base where the surface is evaluated. "
        "0: about as many vertices as there are points",
    ),
)  # fmt: skip
"""Of a reconstruction, zero meaning automatic: name, first value, largest, largest of the slider, title, text."""

AS_LENGTH: dict[str, Any] = {"subtype": "DISTANCE", "unit": "LENGTH", "precision": 5}


def setting_name(name: str) -> str:
    """Return the name of a setting as the panel shows it."""
    return NAMES.get(name, name.replace("_", " ").title())


def solver_property(item: dataclasses.Field) -> Any:
    """Make the Blender property of one field of `Settings`, with its default, range and text."""
    common = {"name": setting_name(item.name), "description": item.metadata["text"], "default": item.default}
    if "choices" in item.metadata:
        items = [(key, CHOICE_NAMES.get(key, key.title()), text) for key, text in item.metadata["choices"].items()]
        return EnumProperty(items=items, **common)
    if isinstance(item.default, bool):
        return BoolProperty(**common)
    low, high = item.metadata["low"], item.metadata["high"]
    soft_low, soft_high = item.metadata["soft"]
    ranges = {"min": low, "max": high, "soft_min": soft_low, "soft_max": soft_high}
    if isinstance(item.default, int):
        return IntProperty(**ranges, **common)
    if item.name in LENGTHS:
        return FloatProperty(**ranges, **common, **AS_LENGTH)
    return FloatProperty(**ranges, **common, precision=3)


def _recolour(display: PropertyGroup, context: Context) -> None:
    from ..operators.heat_map.scale import recolour_scene  # NumPy-heavy: enabling the add-on loads this module

    recolour_scene(context.scene)


def _isolate(display: PropertyGroup, context: Context) -> None:
    isolate_everywhere(context)


class SparseSurfaceDisplay(PropertyGroup):
    """How errors are coloured."""

    range_mode: EnumProperty(
        name="Range",
        description="Which error gets the brightest colour",
        items=[
            ("AUTOMATIC", "Automatic", "The largest error of all objects whose heat maps are visible"),
            ("FIXED", "Fixed", "A value of your choice, the same for all objects, so that they can be compared"),
            ("PERCENTILE", "Percentile", "A percentile of each object's errors: a few outliers do not hide the rest"),
        ],
        default="AUTOMATIC",
        update=_recolour,
    )
    range_maximum: FloatProperty(
        name="Maximum",
        description="Error with the brightest colour; larger ones look the same",
        default=0.01,
        min=1e-12,
        soft_max=10.0,
        update=_recolour,
        **AS_LENGTH,
    )
    range_percentile: FloatProperty(
        name="Percentile",
        description="Share of the vertices whose error lies within the range",
        default=95.0,
        min=1.0,
        max=100.0,
        subtype="PERCENTAGE",
        update=_recolour,
    )
    inside_outside: BoolProperty(
        name="Inside / Outside",
        description="Two colours only: within the tolerance and beyond it",
        default=False,
        update=_recolour,
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Largest error that counts as inside, if the settings name no tolerance of their own",
        default=0.001,
        min=1e-12,
        soft_max=10.0,
        update=_recolour,
        **AS_LENGTH,
    )
    isolate: BoolProperty(
        name="Hide the Rest",
        description="Show only objects with a heat map in this viewport (local view): originals do not hide them",
        default=True,
        update=_isolate,
    )


def _can_be_base(settings: PropertyGroup, candidate: Object) -> bool:
    return candidate.type == "MESH"


class SparseSurfaceReconstruction(PropertyGroup):
    """How points become a surface (`scene.sparse_surface.reconstruction`); the solver's settings are added below."""

    base: PointerProperty(
        type=Object,
        name="Base",
        description="Coarse mesh near the points that carries the patches; without one it is made from the points",
        poll=_can_be_base,
    )
    point_errors: BoolProperty(
        name="Points with Errors",
        description="Make an object of the points with the error of each, beside the surface",
        default=True,
    )
    keep_base: BoolProperty(
        name="Keep the Base", description="Keep the base that was made from the points as an object", default=False
    )

    def to_cloud_settings(self) -> CloudSettings:
        """Return the solver's settings."""
        return CloudSettings(**{name: plain_value(getattr(self, name)) for name in CLOUD_NAMES})


class SparseSurfaceSettings(PropertyGroup):
    """The settings of a scene (`scene.sparse_surface`); the solver's are added below."""

    use_modifiers: BoolProperty(
        name="With Modifiers",
        description="Approximate the mesh as modifiers and shape keys leave it; otherwise the base mesh",
        default=True,
    )
    vertex_group: StringProperty(
        name="Weights",
        description="Vertex group whose weights say how much each vertex counts, and how far denoising moves it; "
        "vertices of weight 0 stay",
        default="",
    )
    replace_result: BoolProperty(
        name="Replace Earlier Result",
        description="Put the new surface into the object that holds this source's earlier result, if there is one",
        default=True,
    )
    source_shown: EnumProperty(
        name="Source",
        description="What happens to the source once its result exists",
        items=(
            (
                "HIDDEN",
                "Hide",
                "Hide it in the viewport and leave it out of renders: two surfaces in one place flicker. "
                "Show Source brings it back",
            ),
            ("BESIDE", "Side by Side", "Keep it and put the result at its right"),
            ("SHOWN", "Keep Visible", "Keep it as it is, with the result in the same place"),
        ),
        default="HIDDEN",
    )
    show_preview: BoolProperty(
        name="Live Preview",
        description="Show the surface while it is being solved. Costs a little time on large meshes",
        default=True,
    )
    preview_kind: EnumProperty(
        name="Shown As",
        description="How the surface is shown while it is being solved",
        items=(
            (
                "AUTOMATIC",
                "Automatic",
                "As the result object where Blender draws quickly here, else as a drawing. "
                "Without a graphics card it changes only when the viewport is drawn anyway",
            ),
            ("OBJECT", "Object", "As the result object, from early on. Without a graphics card it makes Blender slow"),
            ("DRAWN", "Drawing", "Drawn over the source in the colours of its distance; the object comes at the end"),
        ),
        default="AUTOMATIC",
    )
    display: PointerProperty(type=SparseSurfaceDisplay)
    reconstruction: PointerProperty(type=SparseSurfaceReconstruction)
    inspection: PointerProperty(type=inspect_properties.SparseSurfaceInspection)
    comparison: PointerProperty(type=inspect_properties.SparseSurfaceComparison)
    measurement: PointerProperty(type=inspect_properties.SparseSurfaceMeasurement)

    def to_settings(self) -> Settings:
        """Return the solver's settings."""
        return _settings_of(*(plain_value(getattr(self, name)) for name in SOLVER_NAMES))

    def take_settings(self, settings: Settings) -> None:
        """Set every property of the solver's to that of `settings`."""
        for name, value in settings.as_dict().items():
            setattr(self, name, value)

    def apply_preset(self, name: str) -> None:
        """Set the solver's properties to a preset.

        Raises
        ------
        KeyError
            When there is no such preset.
        """
        self.take_settings(Settings.from_dict(preset_values(name)))


@lru_cache(maxsize=16)
def _settings_of(*values: Any) -> Settings:
    """Return the settings with these values; they are checked once, though the panel asks at every redraw."""
    return Settings(**dict(zip(SOLVER_NAMES, values, strict=True)))


def shown_as_optional(group: type[PropertyGroup], item: dataclasses.Field, start: float) -> None:
    """Add what shows a field of the solver's settings without its zero."""
    whole = isinstance(item.default, int)
    options = {"min": 1 if whole else 1e-9, "max": item.metadata["high"], "soft_max": item.metadata["soft"][1]}
    kind = IntProperty if whole else FloatProperty
    unit = AS_LENGTH if item.name in LENGTHS else {}
    made = optional_properties(
        item.name, setting_name(item.name), item.metadata["text"], kind, start, **options, **unit
    )
    group.__annotations__.update(made)


SOLVER_NAMES = tuple(item.name for item in dataclasses.fields(Settings))
SparseSurfaceSettings.__annotations__.update(jobs.PROPERTIES)
for _item in dataclasses.fields(Settings):
    SparseSurfaceSettings.__annotations__[_item.name] = solver_property(_item)
    if _item.name in OPTIONAL:
        shown_as_optional(SparseSurfaceSettings, _item, OPTIONAL[_item.name])

CLOUD_NAMES = tuple(item.name for item in dataclasses.fields(CloudSettings))
for _item in dataclasses.fields(CloudSettings):
    SparseSurfaceReconstruction.__annotations__[_item.name] = solver_property(_item)
    if _item.name in OPTIONAL_CLOUD:
        shown_as_optional(SparseSurfaceReconstruction, _item, OPTIONAL_CLOUD[_item.name])
for _name, _start, _most, _soft, _title, _text in COUNTS:
    _common = {"max": _most, "soft_max": _soft}
    SparseSurfaceReconstruction.__annotations__[_name] = IntProperty(name=_title, description=_text, min=0, **_common)
    SparseSurfaceReconstruction.__annotations__.update(
        optional_properties(_name, _title, _text, IntProperty, _start, min=1, **_common)
    )

_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (SparseSurfaceDisplay, SparseSurfaceReconstruction, *inspect_properties.CLASSES, SparseSurfaceSettings)
)


def register() -> None:
    """Give every scene its settings."""
    _register_classes()
    bpy.types.Scene.sparse_surface = PointerProperty(type=SparseSurfaceSettings, name="Sparse Surface")


def unregister() -> None:
    """Remove the settings from scenes."""
    del bpy.types.Scene.sparse_surface
    _unregister_classes()
