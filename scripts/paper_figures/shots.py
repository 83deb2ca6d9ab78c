"""Pictures of meshes, rendered with Cycles on the CPU under the bpy module, as arrays for a page of Matplotlib."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import matplotlib.pyplot as plt
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray
from sparse_surface.operators.data.colours import ColourScale, srgb_to_linear

Array = NDArray[np.float64]
Colour = tuple[float, float, float]

# The paper's own colours.
BLUE, CYAN, YELLOW, BUFF = (0.42, 0.55, 0.86), (0.36, 0.76, 0.80), (0.95, 0.84, 0.36), (0.93, 0.80, 0.62)
GREEN, RED, PURPLE, GREY = (0.50, 0.74, 0.47), (0.88, 0.47, 0.45), (0.64, 0.50, 0.80), (0.68, 0.68, 0.69)

SAMPLES = 24
"""Enough for pictures of this size; the denoiser would take four times as long."""


@dataclass(frozen=True)
class Shown:
    """One mesh in a picture.

    Attributes
    ----------
    vertices, faces
        (V, 3) and a list or array of polygons.
    colour
        Of the whole mesh, sRGB; or a colour for every vertex, (V, 3) sRGB.
    """

    vertices: Array
    faces: Any
    colour: Colour | Array = GREY


@dataclass(frozen=True)
class View:
    """Where the camera looks from: degrees around the upright axis and above the horizon; y or z points up."""

    azimuth: float = -35.0
    elevation: float = 24.0
    up: str = "Z"

    def axes(self) -> tuple[Vector, Vector, Vector]:
        """Return right, up and out of the picture."""
        a, e = np.radians(self.azimuth), np.radians(self.elevation)
        out = Vector((-np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)))
        right = Vector((np.cos(a), -np.sin(a), 0.0))
        return right, out.cross(right), out


def error_colours(error: Array, largest: float) -> Array:
    """Return the heat map's colours (V, 3), linear, of errors from 0 to `largest`."""
    colours: Array = ColourScale(0.0, largest).colours(error)[:, :3].astype(np.float64)
    return colours


def shoot(
    shown: list[Shown], view: View = View(), *, size: tuple[int, int] = (420, 360), frame: Array | None = None
) -> Array:
    """Render meshes together.

    Parameters
    ----------
    shown
        The meshes.
    view
        Where to look from.
    size
        Width and height in pixels.
    frame
        Points (N, 3) that just fit into the picture; all vertices shown where None.

    Returns
    -------
    ndarray
        RGBA, (height, width, 4) from 0 to 1, transparent where nothing was drawn.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    upright = Matrix.Rotation(np.pi / 2, 4, "X") if view.up == "Y" else Matrix.Identity(4)
    points = np.concatenate([one.vertices for one in shown]) if frame is None else frame
    _set_up(scene, size)
    _aim(scene, view, points @ np.array(upright)[:3, :3].T, size)
    _light(scene, view)
    for one in shown:
        scene.collection.objects.link(_object(one, upright))
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "shot.png")
        with _quiet():
            bpy.ops.render.render(write_still=True)
        picture: Array = plt.imread(scene.render.filepath).astype(np.float64)
    return picture


def _set_up(scene: Any, size: tuple[int, int]) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGBA"
    render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    cycles.device, cycles.seed, cycles.max_bounces = "CPU", 0, 1
    cycles.samples, cycles.use_denoising, cycles.use_light_tree = SAMPLES, False, False


def _aim(scene: Any, view: View, points: Array, size: tuple[int, int]) -> None:
    right, up, out = view.axes()
    seen = points @ np.array([right, up, out]).T
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = sum((axis * value for axis, value in zip((right, up), (low + high)[:2] / 2, strict=True)), Vector())
    width, height = (high - low)[:2]
    distance = float(high[2] + np.ptp(seen) + 1.0)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.clip_end = "ORTHO", 4 * distance + 10
    # the scale of an orthographic camera is the longer side of the picture
    camera.ortho_scale = 1.03 * max(width, height * size[0] / size[1]) * max(1.0, size[1] / size[0])
    made = bpy.data.objects.new("Camera", camera)
    made.matrix_world = Matrix.Translation(middle + out * distance) @ Matrix((right, up, out)).transposed().to_4x4()
    scene.collection.objects.link(made)
    scene.camera = made


def _light(scene: Any, view: View) -> None:
    right, up, out = view.axes()
    world = bpy.data.worlds.new("White")
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = 0.45
    scene.world = world
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = 2.2, np.radians(15.0)
    made = bpy.data.objects.new("Sun", sun)
    made.matrix_world = (out + up * 1.1 - right * 1.0).to_track_quat("Z", "Y").to_matrix().to_4x4()
    scene.collection.objects.link(made)


def _object(one: Shown, upright: Matrix) -> Any:
    mesh = bpy.data.meshes.new("Shown")
    mesh.from_pydata(np.asarray(one.vertices).tolist(), [], [list(map(int, face)) for face in one.faces])
    linear = np.asarray(one.colour, dtype=np.float64)
    heat = linear.ndim == 2
    rgba = np.ones((len(mesh.vertices), 4), dtype=np.float32)
    rgba[:, :3] = linear if heat else srgb_to_linear(linear)
    mesh.color_attributes.new("colour", "FLOAT_COLOR", "POINT").data.foreach_set("color", rgba.ravel())
    mesh.materials.append(_material(0.4 if heat else 0.0))
    made = bpy.data.objects.new("Shown", mesh)
    made.matrix_world = upright
    return made


def _material(shine: float) -> Any:
    """A dull material of the colour attribute; a share of it shines by itself, so that shadows keep its meaning."""
    material = bpy.data.materials.new("Colour")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    material.cycles.emission_sampling = "NONE"  # it need not light anything else
    tree = material.node_tree
    tree.nodes.clear()
    layer, lit, shining, mix, end = (
        tree.nodes.new(f"ShaderNode{kind}")
        for kind in ("Attribute", "BsdfDiffuse", "Emission", "MixShader", "OutputMaterial")
    )
    layer.attribute_name = "colour"
    for shader in (lit, shining):
        tree.links.new(layer.outputs["Color"], shader.inputs["Color"])
    mix.inputs["Fac"].default_value = shine
    tree.links.new(lit.outputs["BSDF"], mix.inputs[1])
    tree.links.new(shining.outputs["Emission"], mix.inputs[2])
    tree.links.new(mix.outputs["Shader"], end.inputs["Surface"])
    return material


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Blender's own lines about the rendering off the terminal."""
    sys.stdout.flush()
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)
