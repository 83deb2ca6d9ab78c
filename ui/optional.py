"""Settings whose zero means "off" or "automatic" to the solver, shown as a checkbox with a value beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from bpy.props import BoolProperty
from bpy.types import PropertyGroup, UILayout


def optional_properties(
    name: str, title: str, description: str, kind: Callable[..., Any], start: float, **options: Any
) -> dict[str, Any]:
    """Return the properties that show the setting `name`, a property of the same group, without its zero.

    `use_<name>` says whether there is a value, `<name>_given` is that value, and `<name>_kept` remembers it while there
    is none.

    Parameters
    ----------
    description
        Of the setting; what follows "0:" in it is what happens without a value.
    kind
        `IntProperty` or `FloatProperty`, with its `options`.
    start
        First value; 0 for a length of a thousandth of the active object.
    """
    meaning, _, otherwise = description.partition(" 0: ")
    kept = f"{name}_kept"

    def given(self: PropertyGroup) -> Any:
        return getattr(self, name) or getattr(self, kept) or _small_length()

    def give(self: PropertyGroup, value: Any) -> None:
        setattr(self, kept, value)
        if getattr(self, name):
            setattr(self, name, value)

    def is_used(self: PropertyGroup) -> bool:
        return bool(getattr(self, name))

    def use(self: PropertyGroup, on: bool) -> None:
        value = given(self)
        setattr(self, kept, value)
        setattr(self, name, value if on else type(value)(0))

    off = otherwise.partition(";")[0].strip()
    return {
        f"use_{name}": BoolProperty(
            name=f"Use {title}",
            description=f"{meaning} Unchecked: {off or 'automatic'}",
            get=is_used,
            set=use,
        ),
        f"{name}_given": kind(name=title, description=meaning.rstrip("."), get=given, set=give, **options),
        kept: kind(name=title, default=start, options={"HIDDEN"}, **{**options, "min": 0}),
    }


def draw_optional(layout: UILayout, settings: PropertyGroup, name: str) -> None:
    """Show a setting as a checkbox with a value."""
    row = layout.row(align=True, heading=settings.bl_rna.properties[f"{name}_given"].name)
    row.prop(settings, f"use_{name}", text="")
    value = row.row()
    value.active = bool(getattr(settings, f"use_{name}"))
    value.prop(settings, f"{name}_given", text="")


def _small_length() -> float:
    """Return a thousandth of the active object's size, rounded to one digit."""
    active = getattr(bpy.context, "active_object", None)
    size = max(active.dimensions) if active is not None else 0.0
    return float(f"{(size or 1.0) * 1e-3:.1g}")
