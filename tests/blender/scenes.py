"""Objects that the tests in this folder work on."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

EXTENSION = "bl_ext.user_default.sparse_surface"


def enable_extension() -> None:
    """Enable the installed extension in a process that has not loaded the user's preferences."""
    import addon_utils

    assert addon_utils.enable(EXTENSION) is not None


def creased_sheet(size: int = 24, name: str = "Sheet", steps: float = 2.0) -> Any:
    """Return a selected sheet of size x size vertices with sharp folds, made of quads; more `steps`, more folds."""
    axis = np.linspace(-1.0, 1.0, size)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    z = 0.2 * np.abs(np.mod(steps * (0.8 * x + 0.6 * y), 2.0) - 1.0) + 0.05 * np.sin(4.0 * x * y)
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = np.stack([corner, corner + size, corner + size + 1, corner + 1], axis=1)
    return mesh_object(name, np.stack([x, y, z], axis=1), faces.tolist())


def mesh_object(name: str, vertices: Any, faces: Any) -> Any:
    """Return a new selected object."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(vertices, dtype=float).reshape(-1, 3).tolist(), [], faces)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    select(made)
    return made


def select(*objects: Any) -> None:
    """Select these objects only; the last becomes active."""
    layer = bpy.context.view_layer
    layer.update()
    for other in layer.objects:
        other.select_set(other in objects)
    layer.objects.active = objects[-1] if objects else None


def positions(mesh: Any) -> Any:
    """Return a mesh's local positions, (V, 3)."""
    flat = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def world_positions(placed: Any, evaluated: bool = False) -> Any:
    """Return an object's positions in the world, (V, 3) float64."""
    bpy.context.view_layer.update()
    of = placed.evaluated_get(bpy.context.evaluated_depsgraph_get()) if evaluated else placed
    matrix = np.array(placed.matrix_world, dtype=float)
    return positions(of.data).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]


def values(mesh: Any, name: str, kind: str = "value", width: int = 1) -> Any:
    """Return an attribute's values."""
    layer = mesh.attributes[name]
    flat = np.empty(width * len(layer.data), dtype=np.int32 if layer.data_type == "INT" else np.float32)
    layer.data.foreach_get(kind, flat)
    return flat.reshape(-1, width) if width > 1 else flat


def hurry(**settings: Any) -> Any:
    """Set the scene to a quick solve in this process, changed by `settings`; return the settings."""
    scene = bpy.context.scene.sparse_surface
    for name, value in {"iterations": 3, "sweeps": 0, "workers": 1, **settings}.items():
        setattr(scene, name, value)
    return scene


def approximate(**settings: Any) -> Any:
    """Run the operator on the selection and return the active result."""
    hurry(**settings)
    assert bpy.ops.sparse_surface.approximate() == {"FINISHED"}
    return bpy.context.view_layer.objects.active
