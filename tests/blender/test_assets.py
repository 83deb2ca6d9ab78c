"""The asset library: a file that Blender finds, and assets that show errors without any script."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data.colours import STEPS, ramp
from bl_ext.user_default.sparse_surface.operators.heat_map import asset_library

sys.path.insert(0, str(Path(__file__).parent))
import scenes


@pytest.fixture(scope="module")
def library() -> Path:
    file = asset_library.offer()
    assert file is not None
    return file


def appended(library: Path, kind: str, name: str) -> Any:
    with bpy.data.libraries.load(str(library), assets_only=True) as (found, wanted):
        assert getattr(found, kind) == [name]
        setattr(wanted, kind, [name])
    return getattr(bpy.data, kind)[name]


def test_the_preferences_list_the_library_once(library: Path, user_folder: Path):
    assert user_folder.resolve() in library.resolve().parents
    assert asset_library.offer() == library
    listed = [each for each in bpy.context.preferences.filepaths.asset_libraries if each.name == "Sparse Surface"]
    assert [Path(each.path) for each in listed] == [library.parent]
    assert "Sparse Surface" in (library.parent / "blender_assets.cats.txt").read_text()
    asset_library.unregister()
    assert "Sparse Surface" not in [each.name for each in bpy.context.preferences.filepaths.asset_libraries]
    asset_library.offer()


def test_writing_it_leaves_the_open_file_as_it_was(library: Path):
    own = bpy.data.materials.new("Heat Map")
    library.unlink()
    try:
        asset_library.offer()
    finally:
        assert library.exists()
    assert [each.name for each in bpy.data.materials] == ["Heat Map"]
    assert bpy.data.materials["Heat Map"] == own
    assert not bpy.data.node_groups
    assert appended(library, "node_groups", "Error Colours").name == "Error Colours"


def test_assets_have_words_and_pictures(library: Path):
    for kind, name in (("materials", "Heat Map"), ("node_groups", "Error Colours")):
        asset = appended(library, kind, name)
        assert asset.asset_data.catalog_id == asset_library.CATALOGUE
        assert len(asset.asset_data.description) > 40
        pixels = np.array(asset.preview.image_pixels_float[:]).reshape(-1, 4)
        assert np.ptp(pixels[:, 1]) > 0.3
        assert pixels[:, 3].min() == 0.0


def test_the_node_group_gives_the_colours_of_the_legend(library: Path):
    """The exact map at 256 values; the ramp has 32 of its colours and straight lines between them."""
    values = np.linspace(-0.1, 1.1, 300)
    grid = [(float(x), y, 0.0) for y in (0.0, 1.0) for x in values]
    faces = [(k, k + 1, 301 + k, 300 + k) for k in range(299)]
    sheet = scenes.mesh_object("Sheet", grid, faces)
    layer = sheet.data.attributes.new("error", "FLOAT", "POINT")
    layer.data.foreach_set("value", np.tile(values, 2).astype(np.float32))
    group = appended(library, "node_groups", "Error Colours")
    limits = {item.name: item for item in group.interface.items_tree if item.in_out == "INPUT"}
    limits["Minimum"].default_value, limits["Maximum"].default_value = 0.0, 1.0  # which a new modifier takes
    sheet.modifiers.new("Colours", "NODES").node_group = group
    bpy.context.view_layer.update()
    shaped = sheet.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    shown = scenes.values(shaped, "error_color", "color", 4)[:300, :3]
    expected = ramp()[np.rint(np.clip(values, 0.0, 1.0) * (STEPS - 1)).astype(int)]
    assert np.abs(shown - expected).max() < 0.02
    assert [each.name for each in shaped.materials] == ["Heat Map"]


def rendered(engine: str, path: Path) -> Any:
    """Return the pixels of a small picture of the active object from above, (64, 64, 4)."""
    scene = bpy.context.scene
    scene.render.engine = engine
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Raw"
    if engine == "CYCLES":
        scene.cycles.samples, scene.cycles.use_denoising = 4, False
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 2.2, (0.0, 0.0, 5.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.filepath = str(path)
    scene.render.image_settings.file_format = "PNG"
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    return np.array(image.pixels[:]).reshape(64, 64, 4)


def test_the_material_renders_errors_of_a_result(tmp_path: Path):
    """In the dark only the part that does not depend on the light is seen: half of each vertex's colour.

    The result is made flat, so that no face lights another, and its colours change slowly from pixel to pixel.
    """
    scenes.creased_sheet(24)
    made = scenes.approximate(ring=4)
    assert bpy.ops.sparse_surface.use_heat_map_material() == {"FINISHED"}
    assert [each.name for each in made.data.materials] == ["Heat Map"]
    bpy.ops.sparse_surface.use_heat_map_material()
    assert len(bpy.data.materials) == 1
    flat = scenes.positions(made.data) * (1.0, 1.0, 0.0)
    made.data.vertices.foreach_set("co", flat.ravel())
    red, green = 0.5 + 0.5 * flat[:, 0], 0.5 - 0.5 * flat[:, 1]
    colours = np.stack([red, green, np.full_like(red, 0.3), np.ones_like(red)], axis=1).clip(0.0, 1.0)
    made.data.attributes["error_color"].data.foreach_set("color", colours.astype(np.float32).ravel())
    made.data.update()
    seen = rendered("CYCLES", tmp_path / "picture.png")
    column, row = (np.floor((flat[:, axis] / 2.2 + 0.5) * 64).astype(int) for axis in (0, 1))
    inside = np.abs(flat[:, :2]).max(axis=1) < 0.95
    shown = seen[row, column, :3][inside]
    assert np.abs(shown - 0.5 * colours[inside, :3]).max() < 0.03
