"""The scene of a picture: camera, light, ground, materials.

The picture is 16 units wide and 9 high, with (0, 0) in its middle.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import _cycles
import bpy
import numpy as np
from bpy.types import Material, Object, Scene
from mathutils import Matrix, Vector

Colour = tuple[float, float, float]

WIDTH, HEIGHT = 16.0, 9.0

GROUND = (0.92, 0.92, 0.93)
SAMPLES = 2
SAMPLES_WITHOUT_DENOISER = 64


@dataclass(frozen=True)
class View:
    """The camera's orientation; it looks along `-out`, without perspective."""

    right: Vector
    up: Vector
    out: Vector

    @classmethod
    def three_quarter(cls, azimuth: float = -35.0, elevation: float = 24.0) -> View:
        """Look from the front right and above (angles in degrees; z is up)."""
        a, e = np.radians(azimuth), np.radians(elevation)
        out = Vector((-np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)))
        right = Vector((np.cos(a), -np.sin(a), 0.0))
        return cls(right, out.cross(right), out)

    def matrix(self, x: float, y: float, nearer: float = 0.0) -> Matrix:
        """Return the placement of something that faces the camera at (x, y) of the picture."""
        place = self.right * x + self.up * y + self.out * nearer
        turn = Matrix((self.right, self.up, self.out)).transposed().to_4x4()
        return Matrix.Translation(place) @ turn


@contextmanager
def temporary_scene() -> Iterator[Scene]:
    """Make a scene, and remove it afterwards with every data-block that was made meanwhile."""
    kinds = (
        bpy.data.scenes, bpy.data.objects, bpy.data.meshes, bpy.data.curves, bpy.data.materials, bpy.data.lights,
        bpy.data.cameras, bpy.data.worlds, bpy.data.images, bpy.data.fonts,
    )  # fmt: skip
    before = [{block.name for block in kind} for kind in kinds]
    scene = bpy.data.scenes.new("Heat map")
    try:
        yield scene
    finally:
        for kind, names in zip(kinds, before, strict=True):
            for block in [block for block in kind if block.name not in names]:
                kind.remove(block)


def set_up_rendering(scene: Scene, view: View, width: int) -> None:
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, round(width * HEIGHT / WIDTH), 100
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGB"
    for stamp in (name for name in dir(render) if name.startswith("use_stamp")):
        setattr(render, stamp, False)  # dates and times; the same input gives the same file
    scene.view_settings.view_transform = "Standard"
    cycles = scene.cycles
    cycles.device, cycles.seed = "CPU", 0
    cycles.use_denoising = _has_denoiser()
    cycles.samples = SAMPLES if cycles.use_denoising else SAMPLES_WITHOUT_DENOISER
    if hasattr(cycles, "denoising_quality"):
        cycles.denoising_quality = "FAST"  # a third of the time, and no difference is seen
    cycles.denoising_input_passes = "RGB"  # the other passes are noisy at few samples and make edges ragged
    cycles.max_bounces, cycles.use_light_tree = 1, False
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", WIDTH
    camera.clip_end = 200.0
    scene.camera = add_object(scene, "Camera", camera, view.matrix(0.0, 0.0, 60.0))


def _has_denoiser() -> bool:
    """Whether Cycles can denoise: some builds cannot, and then fail when asked to."""
    return bool(getattr(_cycles, "with_openimagedenoise", False))


def add_light(scene: Scene, view: View) -> None:
    """Add white surroundings, which draw the shadow under an object, and a sun, which shows its form."""
    world = bpy.data.worlds.new("White")
    _use_nodes(world)
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = 0.75
    world.cycles.sampling_method = "NONE"  # every ray that leaves the scene meets the same white
    scene.world = world
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = 1.7, np.radians(25.0)
    towards = view.out + view.up * 1.0 - view.right * 0.9
    add_object(scene, "Sun", sun, towards.to_track_quat("Z", "Y").to_matrix().to_4x4())


def add_ground(scene: Scene, height: float) -> None:
    mesh = bpy.data.meshes.new("Ground")
    far = 400.0
    mesh.from_pydata([(-far, -far, 0), (far, -far, 0), (far, far, 0), (-far, far, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(dull_material("Ground", GROUND))
    add_object(scene, "Ground", mesh, Matrix.Translation((0.0, 0.0, height)))


def add_object(scene: Scene, name: str, data: Any, matrix: Matrix) -> Object:
    made = bpy.data.objects.new(name, data)
    scene.collection.objects.link(made)
    made.matrix_world = matrix
    return made


def _use_nodes(block: Any) -> None:
    if bpy.app.version < (5, 0, 0):  # always on from there, and the property is deprecated
        block.use_nodes = True


def dull_material(name: str, colour: Colour, *, attribute: str = "", shine: float = 0.0) -> Material:
    """Make a material without gloss; a share `shine` of its colour does not depend on the light."""
    material = bpy.data.materials.new(name)
    _use_nodes(material)
    material.cycles.emission_sampling = "NONE"  # lighting other objects would cost most of the time
    tree = material.node_tree
    tree.nodes.clear()
    mix, lit, shining = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("MixShader", "BsdfDiffuse", "Emission"))
    for shader in (lit, shining):
        shader.inputs["Color"].default_value = (*colour, 1.0)
    if attribute:
        layer = tree.nodes.new("ShaderNodeAttribute")
        layer.attribute_name = attribute
        for shader in (lit, shining):
            tree.links.new(layer.outputs["Color"], shader.inputs["Color"])
    mix.inputs["Fac"].default_value = shine
    tree.links.new(lit.outputs["BSDF"], mix.inputs[1])
    tree.links.new(shining.outputs["Emission"], mix.inputs[2])
    tree.links.new(mix.outputs["Shader"], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material
