"""A picture of a result's errors: the source beside the result in its heat-map colours, with a scale.

Cycles renders it on the CPU, so it works without a window, in Blender and under the bpy module alike.  The picture
is taken in a scene of its own, which is removed again together with everything that was made for it.
"""

from __future__ import annotations

import os
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.types import Material, Mesh, Object, Scene
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ...solver.atomic_files import atomic_output
from ...solver.errors import InputError
from ..data.colours import INSIDE, OUTSIDE, ColourScale, ramp, srgb_to_linear
from ..data.result_keys import ERROR_COLOUR, SCALE, has_heat_map, read_report

Colour = tuple[float, float, float]

# The picture is 16 units wide and 9 high, (0, 0) in its middle; an object fills a cell of these measures.
WIDTH, HEIGHT = 16.0, 9.0
CELL = (7.0, 6.0)
CELL_HEIGHT = 0.35
LEGEND_LENGTH, LEGEND_THICKNESS, LEGEND_Y = 6.4, 0.2, -3.75
# How far before the objects captions and legend stand: nearer than any ground, so nothing hides them.
LETTERING_DISTANCE = 30.0

INK = (0.02, 0.02, 0.02)
CLAY = (0.32, 0.32, 0.33)
GROUND = (0.92, 0.92, 0.93)
# Share of a heat-map colour that shines by itself, so that shadows do not change its meaning.
SHINE = 0.35
SAMPLES = 12
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


def render_heatmap(
    result: Object,
    picture: Path,
    *,
    source: Object | None = None,
    up: str = "Z",
    width: int = 1200,
    title: str = "",
    caption: str = "Sparse Surface",
) -> None:
    """Render a result's heat map to a PNG file, 16 by 9.

    Parameters
    ----------
    result
        Object with the attributes `error` and `error_color`.
    picture
        The file; it is written beside and renamed into place.
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

    Raises
    ------
    InputError
        When the result has no heat map.
    """
    if not has_heat_map(result):
        raise InputError(f"'{result.name}' has no heat map to show.")
    with _temporary_scene() as scene:
        view = View.three_quarter()
        _set_up_rendering(scene, view, width)
        _light(scene, view)
        shown = [(result, _dull("Heat map", CLAY, attribute=ERROR_COLOUR, shine=SHINE))]
        if source is not None:
            shown.insert(0, (source, _dull("Clay", CLAY)))
        fit = _fit([found for found, _ in shown], view, up)
        for (found, material), x in zip(shown, _cell_centres(len(shown)), strict=True):
            _place(scene, found, material, fit, view.matrix(x, CELL_HEIGHT).translation)
        _add_ground(scene, fit.ground + (view.up * CELL_HEIGHT).z)
        letter = _Lettering(scene, view)
        if source is not None:
            letter.write(title or source.name, _cell_centres(2)[0], 3.95, 0.36)
        letter.write(caption, _cell_centres(len(shown))[-1], 3.95, 0.36)
        _add_legend(letter, ColourScale(*result[SCALE]))
        letter.write(_summary(read_report(result)), 0.0, -2.95, 0.26)
        _render(scene, picture)


def _cell_centres(count: int) -> list[float]:
    return [0.0] if count == 1 else [-WIDTH / 4, WIDTH / 4]


def _summary(report: dict[str, Any] | None) -> str:
    """Say in one line how well the surface is approximated."""
    if report is None:
        return ""
    relative = report["relative"]
    if "denoise" in report and not report["patches"]:
        size, level = report["input"]["bounding_box_longest_side"], report["denoise"]["noise_level"]
        return f"denoised: noise of {level / size:.2g}, largest move {relative['vertex_max']:.2g} of the longest side"
    return (
        f"surface error: rms {relative['surface_rms']:.2g}, largest {relative['surface_max']:.2g} of the longest side"
        f"     {report['patches']} patches"
    )


# The scene


@contextmanager
def _temporary_scene() -> Iterator[Scene]:
    """Make a scene and remove it afterwards with every data-block that was made meanwhile."""
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


def _set_up_rendering(scene: Scene, view: View, width: int) -> None:
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, round(width * HEIGHT / WIDTH), 100
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGB"
    for stamp in (name for name in dir(render) if name.startswith("use_stamp")):
        setattr(render, stamp, False)  # dates and times: the same input gives the same file
    scene.view_settings.view_transform = "Standard"
    cycles = scene.cycles
    cycles.device, cycles.seed = "CPU", 0
    cycles.use_denoising = _has_denoiser()
    cycles.samples = SAMPLES if cycles.use_denoising else SAMPLES_WITHOUT_DENOISER
    cycles.denoising_input_passes = "RGB"  # the other passes are noisy at few samples and make edges ragged
    cycles.max_bounces, cycles.use_light_tree = 1, False
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", WIDTH
    camera.clip_end = 200.0
    scene.camera = _add(scene, "Camera", camera, view.matrix(0.0, 0.0, 60.0))


def _has_denoiser() -> bool:
    """Some builds come without one, and Cycles then fails when it is asked for."""
    import _cycles

    return bool(getattr(_cycles, "with_openimagedenoise", False))


def _light(scene: Scene, view: View) -> None:
    """Light white surroundings, which draw the shadow where an object stands, and a sun for its form."""
    world = bpy.data.worlds.new("White")
    _use_nodes(world)
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = 0.75
    scene.world = world
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = 1.7, np.radians(25.0)
    towards = view.out + view.up * 1.0 - view.right * 0.9
    _add(scene, "Sun", sun, towards.to_track_quat("Z", "Y").to_matrix().to_4x4())


def _add_ground(scene: Scene, height: float) -> None:
    mesh = bpy.data.meshes.new("Ground")
    far = 400.0
    mesh.from_pydata([(-far, -far, 0), (far, -far, 0), (far, far, 0), (-far, far, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(_dull("Ground", GROUND))
    _add(scene, "Ground", mesh, Matrix.Translation((0.0, 0.0, height)))


def _add(scene: Scene, name: str, data: Any, matrix: Matrix) -> Object:
    made = bpy.data.objects.new(name, data)
    scene.collection.objects.link(made)
    made.matrix_world = matrix
    return made


# Materials


def _use_nodes(block: Any) -> None:
    if bpy.app.version < (5, 0, 0):  # from there on always so, and the switch is about to go
        block.use_nodes = True


def _dull(name: str, colour: Colour, *, attribute: str = "", shine: float = 0.0) -> Material:
    """Make a material without gloss; a share `shine` of its colour shows whatever the light."""
    material = bpy.data.materials.new(name)
    _use_nodes(material)
    material.cycles.emission_sampling = "NONE"  # it need not light anything else, which costs most of the time
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


# The objects


@dataclass(frozen=True)
class Fit:
    """How objects get into a cell: turned upright, moved by `-middle`, scaled.

    Attributes
    ----------
    ground
        Height of the lowest point afterwards.
    """

    turn: Matrix
    middle: Vector
    scale: float
    ground: float


def _world_points(shown: Object) -> NDArray[np.float64]:
    """Return the world positions (V, 3) of an object's mesh as it is evaluated."""
    evaluated = shown.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    matrix = np.array(shown.matrix_world)
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def _fit(shown: list[Object], view: View, up: str) -> Fit:
    """Find the largest scale at which all objects, seen the same way, stay within a cell."""
    turn = Matrix.Rotation(np.pi / 2, 4, "X") if up == "Y" else Matrix.Identity(4)
    points = np.concatenate([_world_points(found) for found in shown]) @ np.array(turn)[:3, :3].T
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
    _paint(mesh, material)
    centred = Matrix.Translation(-fit.middle) @ fit.turn @ shown.matrix_world
    _add(scene, shown.name, mesh, Matrix.Translation(cell) @ Matrix.Scale(fit.scale, 4) @ centred)


def _paint(mesh: Mesh, material: Material) -> None:
    mesh.materials.clear()
    mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", np.zeros(len(mesh.polygons), dtype=np.int32))


# Captions and legend


@dataclass(frozen=True)
class _Lettering:
    """Whatever stands flat before the objects."""

    scene: Scene
    view: View

    def write(self, text: str, x: float, y: float, size: float, align: str = "CENTER") -> None:
        curve = bpy.data.curves.new("Text", "FONT")
        curve.body, curve.size, curve.align_x = text, size, align
        curve.materials.append(_dull("Ink", INK, shine=1.0))
        self._hide_from_light(_add(self.scene, "Text", curve, self.view.matrix(x, y, LETTERING_DISTANCE)))

    def strip(self, colours: NDArray[np.floating[Any]], length: float, thickness: float, y: float) -> None:
        """Lay equal fields of the linear colours (n, 3) side by side."""
        count = len(colours)
        x = np.linspace(-length / 2, length / 2, count + 1)
        corners = [(at, side, 0.0) for at in x for side in (-thickness / 2, thickness / 2)]
        mesh = bpy.data.meshes.new("Scale")
        mesh.from_pydata(corners, [], [(2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1) for k in range(count)])
        rgba = np.ones((count, 4, 4), dtype=np.float32)
        rgba[..., :3] = np.asarray(colours)[:, None, :]
        mesh.color_attributes.new("colour", "FLOAT_COLOR", "CORNER").data.foreach_set("color", rgba.ravel())
        mesh.materials.append(_dull("Scale", INK, attribute="colour", shine=1.0))
        self._hide_from_light(_add(self.scene, "Scale", mesh, self.view.matrix(0.0, y, LETTERING_DISTANCE)))

    @staticmethod
    def _hide_from_light(made: Object) -> None:
        made.visible_shadow = made.visible_diffuse = made.visible_glossy = False


def _add_legend(letter: _Lettering, scale: ColourScale) -> None:
    """Draw the colour scale with its values in scene units."""
    below = LEGEND_Y - LEGEND_THICKNESS / 2 - 0.3
    if scale.tolerance > 0.0:
        letter.strip(srgb_to_linear(np.array([INSIDE, OUTSIDE])), LEGEND_LENGTH, LEGEND_THICKNESS, LEGEND_Y)
        ticks = [(-0.25, f"within {scale.tolerance:.3g}"), (0.25, "above")]
    else:
        letter.strip(ramp(), LEGEND_LENGTH, LEGEND_THICKNESS, LEGEND_Y)
        values = np.linspace(scale.low, scale.high, 3)
        ticks = [(share, f"{value:.3g}") for share, value in zip((-0.5, 0.0, 0.5), values, strict=True)]
    for share, text in ticks:
        letter.write(text, share * LEGEND_LENGTH, below, 0.24)
    letter.write("error at the vertices, in scene units", 0.0, LEGEND_Y + 0.2, 0.24)


# The file


def _render(scene: Scene, picture: Path) -> None:
    with atomic_output(picture) as draft:
        scene.render.filepath = str(draft)
        scene.render.use_file_extension = False
        with _quiet():
            bpy.ops.render.render(write_still=True, scene=scene.name)
        draft.write_bytes(_without_texts(draft.read_bytes()))


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the renderer's own log, a line for each sample, off the terminal."""
    try:
        sys.stdout.flush()
        terminal = os.dup(1)
    except (OSError, AttributeError):  # a program without a terminal
        yield
        return
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)
        yield
    finally:
        os.dup2(terminal, 1)
        os.close(terminal)


def _without_texts(png: bytes) -> bytes:
    """Drop a PNG's text chunks: Cycles notes there how long it took, and the same picture should be the same file."""
    kept, at = [png[:8]], 8
    while at < len(png):
        (length,) = struct.unpack(">I", png[at : at + 4])
        if png[at + 4 : at + 8] not in (b"tEXt", b"zTXt", b"iTXt", b"tIME", b"eXIf"):
            kept.append(png[at : at + 12 + length])
        at += 12 + length
    return b"".join(kept)
