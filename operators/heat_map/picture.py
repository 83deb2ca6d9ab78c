"""A picture of a result's errors: the source beside the result in its heat-map colours, with a scale.

Cycles renders it on the CPU, so it works without a window, in Blender and under the bpy module alike.  The picture
is taken in a scene of its own, which is removed again together with everything that was made for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Material, Object, Scene
from mathutils import Matrix, Vector

from ...solver.errors import InputError
from ..data.attributes import put
from ..data.colours import ColourScale
from ..data.meshes import to_world
from ..data.points import local_points
from ..data.report_text import quality
from ..data.result_keys import ERROR_COLOUR, SCALE, has_heat_map, read_report
from .lettering import Lettering, add_legend
from .png import render_png
from .scene import WIDTH, View, add_ground, add_light, add_object, dull_material, set_up_rendering, temporary_scene

CELL = (7.0, 6.0)
"""Width and height of the space for an object, in the units of the picture."""

CELL_HEIGHT = 0.35
CLAY = (0.32, 0.32, 0.33)

SHINE = 0.35
"""Share of a heat-map colour that does not depend on the light, so that shadows do not change its meaning."""


def render_heatmap(
    result: Object,
    picture: Path,
    *,
    source: Object | None = None,
    up: str = "Z",
    width: int = 1200,
    title: str = "",
    caption: str = "Sparse Surface",
    view: View | None = None,
) -> None:
    """Render a result's heat map to a PNG file, 16 by 9.

    Parameters
    ----------
    result
        Object with the attributes `error` and `error_color`.
    picture
        The file; it appears when it is complete.
    source
        Object to show beside it in plain clay.
    up
        "Z" or "Y": the axis that points up in the picture.
    width
        In pixels.
    title
        Caption of the source; its name where empty.
    caption
        Caption of the result.
    view
        From where; from the front right and above where None.

    Raises
    ------
    InputError
        When the result has no heat map.
    """
    if not has_heat_map(result):
        raise InputError(f"'{result.name}' has no heat map to show.")
    with temporary_scene() as scene:
        view = view or View.three_quarter()
        set_up_rendering(scene, view, width)
        add_light(scene, view)
        shown = [(result, dull_material("Heat map", CLAY, attribute=ERROR_COLOUR, shine=SHINE))]
        if source is not None:
            shown.insert(0, (source, dull_material("Clay", CLAY)))
        fit = _fit([found for found, _ in shown], view, up)
        for (found, material), x in zip(shown, _cell_centres(len(shown)), strict=True):
            _place(scene, found, material, fit, view.matrix(x, CELL_HEIGHT).translation)
        add_ground(scene, fit.ground + (view.up * CELL_HEIGHT).z)
        letter = Lettering()
        if source is not None:
            letter.write(title or source.name, _cell_centres(2)[0], 3.95, 0.36)
        letter.write(caption, _cell_centres(len(shown))[-1], 3.95, 0.36)
        add_legend(letter, ColourScale(*result[SCALE]))
        report = read_report(result)
        letter.write(quality(report) if report is not None else "", 0.0, -2.95, 0.26)
        render_png(scene, picture, letter.shapes)


def _cell_centres(count: int) -> list[float]:
    return [0.0] if count == 1 else [-WIDTH / 4, WIDTH / 4]


@dataclass(frozen=True)
class Fit:
    """How objects fit into a cell: turned upright, moved by `-middle`, scaled.

    Attributes
    ----------
    ground
        Height of the lowest point afterwards.
    """

    turn: Matrix
    middle: Vector
    scale: float
    ground: float


def _fit(shown: list[Object], view: View, up: str) -> Fit:
    """Find the largest scale at which all objects, seen the same way, stay within a cell."""
    turn = Matrix.Rotation(np.pi / 2, 4, "X") if up == "Y" else Matrix.Identity(4)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    points = np.concatenate([to_world(found, local_points(found, depsgraph)) for found in shown])
    points = points @ np.array(turn)[:3, :3].T
    seen = points @ np.array([view.right, view.up, view.out]).T
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = view.right * (low + high)[0] / 2 + view.up * (low + high)[1] / 2 + view.out * (low + high)[2] / 2
    scale = float(min(np.array(CELL) / np.maximum((high - low)[:2], 1e-30)))
    return Fit(turn, middle, scale, scale * (float(points[:, 2].min()) - middle.z))


def _place(scene: Scene, shown: Object, material: Material, fit: Fit, cell: Vector) -> None:
    """Put a copy of an object, as it is evaluated, into a cell."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(
        shown.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
    )
    mesh.materials.clear()
    mesh.materials.append(material)
    put(mesh.polygons, "material_index", np.zeros(len(mesh.polygons)), np.int32)
    centred = Matrix.Translation(-fit.middle) @ fit.turn @ shown.matrix_world
    add_object(scene, shown.name, mesh, Matrix.Translation(cell) @ Matrix.Scale(fit.scale, 4) @ centred)
