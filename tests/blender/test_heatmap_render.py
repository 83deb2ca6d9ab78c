"""The picture of a heat map: what is on it, and that nothing of its making stays behind."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data.colours import (
    INSIDE,
    OUTSIDE,
    ColourScale,
    linear_to_srgb,
    ramp,
    srgb_to_linear,
)
from bl_ext.user_default.sparse_surface.operators.data.meshes import read_positions, set_positions
from bl_ext.user_default.sparse_surface.operators.data.results import write_error
from bl_ext.user_default.sparse_surface.operators.heat_map import png
from bl_ext.user_default.sparse_surface.operators.heat_map.coverage import nearest_triangles
from bl_ext.user_default.sparse_surface.operators.heat_map.lettering import LEGEND_LENGTH, LEGEND_Y
from bl_ext.user_default.sparse_surface.operators.heat_map.picture import render_heatmap
from bl_ext.user_default.sparse_surface.operators.heat_map.raster import Shape, draw
from bl_ext.user_default.sparse_surface.operators.heat_map.scene import View, read_body
from bl_ext.user_default.sparse_surface.operators.heat_map.shading import SHADOW, draw_bodies
from bl_ext.user_default.sparse_surface.solver.errors import InputError

WIDTH = 320
KINDS = ("scenes", "objects", "meshes", "curves", "materials", "lights", "cameras", "worlds", "images", "fonts")


def coloured_box(size=(2.0, 2.0, 2.0), tolerance=0.0):
    """Return a box whose error rises with x, at a place of its own."""
    bpy.ops.mesh.primitive_cube_add(location=(5.0, -3.0, 2.0))
    box = bpy.context.object
    positions = read_positions(box.data) * np.array(size, dtype=np.float32) / 2
    set_positions(box.data, positions)
    errors = (positions[:, 0] - positions[:, 0].min()).astype(np.float32)
    scale = ColourScale(0.0, float(errors.max()), tolerance)
    write_error(box, errors, scale)
    return box


def pixels(path):
    """Return a picture's sRGB values, (height, width, 3), top row first."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.array(image.pixels[:]).reshape(height, width, -1)[::-1, :, :3]
    bpy.data.images.remove(image)
    return values


def at(picture, x, y):
    """Return the colour at a place in the picture's own units (16 wide, 9 high, (0, 0) in the middle)."""
    height, width, _ = picture.shape
    return picture[round((0.5 - y / 9) * height), round((0.5 + x / 16) * width)]


def extent(picture):
    """Return width and height of what has a colour of its own, above captions and legend."""
    part = picture[: int(0.72 * len(picture))]
    rows, columns = np.nonzero(np.ptp(part, axis=2) > 0.15)
    return np.ptp(columns), np.ptp(rows)


def test_picture_and_scale(tmp_path):
    path = tmp_path / "picture.png"
    render_heatmap(coloured_box(), path, width=WIDTH)
    picture = pixels(path)
    assert picture.shape == (WIDTH * 9 // 16, WIDTH, 3)
    half = LEGEND_LENGTH / 2
    for place, colour in ((-0.9 * half, ramp()[13]), (0.0, ramp()[128]), (0.9 * half, ramp()[242])):
        assert np.abs(at(picture, place, LEGEND_Y) - linear_to_srgb(colour)).max() < 0.08
    assert picture[0, 0].min() > 0.9
    assert extent(picture)[1] > 0.4 * len(picture)


def test_source_stands_beside_the_result_in_grey(tmp_path):
    box = coloured_box()
    render_heatmap(box, tmp_path / "both.png", source=box, width=WIDTH)
    picture = pixels(tmp_path / "both.png")
    left, right = picture[: len(picture) * 2 // 3, : WIDTH // 2], picture[: len(picture) * 2 // 3, WIDTH // 2 :]
    assert np.ptp(left, axis=2).max() < 0.1
    assert left.min() < 0.8
    assert np.ptp(right, axis=2).max() > 0.4


def test_tolerance_has_two_colours(tmp_path):
    render_heatmap(coloured_box(tolerance=0.5), tmp_path / "two.png", width=WIDTH)
    picture = pixels(tmp_path / "two.png")
    for place, colour in ((-1.5, INSIDE), (1.5, OUTSIDE)):
        assert np.abs(at(picture, place, LEGEND_Y) - np.array(colour)).max() < 0.08


def test_up_axis(tmp_path):
    pole = coloured_box((1.0, 6.0, 1.0))
    render_heatmap(pole, tmp_path / "y.png", width=WIDTH, up="Y")
    render_heatmap(pole, tmp_path / "z.png", width=WIDTH, up="Z")
    wide, high = extent(pixels(tmp_path / "y.png"))
    assert high > 2 * wide
    wide, high = extent(pixels(tmp_path / "z.png"))
    assert high < wide


def test_same_bytes_and_nothing_left_behind(tmp_path):
    box = coloured_box()
    before = {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in KINDS}
    scene = bpy.context.scene
    for name in ("a.png", "b.png"):
        render_heatmap(box, tmp_path / name, source=box, width=WIDTH)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]
    assert {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in KINDS} == before
    assert bpy.context.scene == scene


def test_a_broken_run_keeps_the_old_picture(tmp_path, monkeypatch):
    old = tmp_path / "picture.png"
    old.write_bytes(b"old")

    def fail(values):
        raise OSError("No space left on device")

    monkeypatch.setattr(png, "encoded", fail)
    before = len(bpy.data.scenes)
    with pytest.raises(OSError, match="No space left"):
        render_heatmap(coloured_box(), old, width=WIDTH)
    assert old.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    assert len(bpy.data.scenes) == before


def test_object_without_heat_map_is_refused(tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(InputError, match="no heat map"):
        render_heatmap(bpy.context.object, tmp_path / "none.png")
    assert list(tmp_path.iterdir()) == []


def test_shapes_cover_their_share_of_each_pixel():
    """Against areas: of a triangle over many pixels, and of rectangles that cut pixels in parts."""
    picture = np.ones((90, 160, 4))
    corners = np.array([[-3.3, -2.1], [4.9, -1.2], [0.7, 3.4]])
    draw(picture, [Shape(corners[None], np.zeros(3))])
    drawn = (1.0 - picture[..., :3]).mean(axis=2).sum() / 100.0  # a unit is ten pixels wide
    (x, y), (u, v) = corners[1] - corners[0], corners[2] - corners[0]
    assert drawn == pytest.approx(abs(x * v - y * u) / 2, rel=2e-3)
    assert picture[..., 3].min() == 1.0
    flipped = np.ones((90, 160, 4))
    draw(flipped, [Shape(corners[None, ::-1], np.zeros(3))])
    assert np.array_equal(flipped, picture)
    square = np.array([[0.0, 0.0], [0.15, 0.0], [0.15, 0.1], [0.0, 0.1]])[[[0, 1, 2], [0, 2, 3]]]
    picture = np.ones((90, 160, 4))
    draw(picture, [Shape(square, np.array([1.0, 0.5, 0.0]))])
    assert picture[45, 80, :3] == pytest.approx([1.0, 0.5, 0.0])
    assert picture[45, 81, :3] == pytest.approx([1.0, 0.75, 0.5])
    assert picture[45, 82, :3] == pytest.approx(1.0)
    draw(picture, [Shape(square + 100.0, np.zeros(3)), Shape(np.zeros((0, 3, 2)), np.zeros(3))])  # nothing to see
    assert picture[45, 80, :3] == pytest.approx([1.0, 0.5, 0.0])


def test_colours_of_the_picture_are_those_of_the_legend(tmp_path):
    """Light makes a colour darker, and may not make it another one."""
    box = coloured_box()
    for value in (0.0, 0.5, 1.0):
        write_error(box, np.full(8, value, dtype=np.float32), ColourScale(0.0, 1.0))
        render_heatmap(box, tmp_path / "one.png", width=WIDTH)
        picture, legend = pixels(tmp_path / "one.png"), srgb_to_linear(linear_to_srgb(ramp())[round(255 * value)])
        for place in ((-1.0, 0.0), (0.0, 2.3), (1.8, 0.0)):  # on each of the three faces that are seen
            seen = srgb_to_linear(at(picture, *place))
            assert 0.4 < seen.sum() / legend.sum() < 1.15
            assert np.abs(linear_to_srgb(seen * legend.sum() / seen.sum()) - linear_to_srgb(legend)).max() < 0.05


def test_the_nearest_triangle_is_found_at_each_point():
    """Against every triangle tried at every point."""
    random, places = np.random.default_rng(5), np.array([0.5, 0.2, 0.9])
    corners = random.uniform([-5.0, -5.0, 0.0], [25.0, 17.0, 1.0], (60, 3, 3))
    corners[0, :, 1], corners[1] = 6.5, corners[1, :1]  # on a line, and a point
    nearest, depth = nearest_triangles(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3), 20, 12, places)
    y, x = np.mgrid[:12, :20]
    points = np.stack([x + places[y % 3], y + 0.5], axis=-1)
    found = np.full((60, 12, 20), -np.inf)
    for triangle, (a, b, c) in enumerate(corners[2:], 2):
        sides = np.linalg.solve(np.stack([b - a, c - a], axis=1)[:2], (points - a[:2]).reshape(-1, 2).T)
        inside = (sides.min(axis=0) >= 0.0) & (sides.sum(axis=0) <= 1.0)
        found[triangle].flat[inside] = (a[2] + sides[0] * (b - a)[2] + sides[1] * (c - a)[2])[inside]
    seen = found.max(axis=0)
    assert np.array_equal(nearest, np.where(np.isfinite(seen), found.argmax(axis=0), -1))
    assert np.abs(depth - seen)[nearest >= 0].max() < 1e-4


def test_triangles_beside_each_other_share_no_point():
    """A fan whose middle and sides lie on points of the grid."""
    ends = np.array([[0.5, 0.5], [6.5, 0.5], [12.5, 0.5], [12.5, 12.5], [3.5, 12.5], [0.5, 12.5]])
    points = np.column_stack([np.vstack([ends, [6.5, 6.5]]), np.zeros(7)])
    fan = np.array([[k, (k + 1) % 6, 6] for k in range(6)])
    times = sum((nearest_triangles(points, fan[[k]], 14, 14)[0] >= 0).astype(int) for k in range(6))
    assert np.array_equal(times, nearest_triangles(points, fan, 14, 14)[0] >= 0)
    assert times[1:12, 1:12].min() == 1 == times.max()


def test_a_wall_hides_its_share_of_the_sky_from_the_ground():
    """Seen from above, at a distance d from a long, thick wall of height h: (1 - d / sqrt(d^2 + h^2)) / 2."""
    bpy.ops.mesh.primitive_cube_add(location=(-4.0, 0.0, 0.25), scale=(4.0, 8.0, 0.25))
    bpy.context.view_layer.update()
    view = View.three_quarter(0.0, 90.0)
    canvas = np.ones((450, 800, 3))
    draw_bodies(canvas, [read_body(bpy.context.object, heat_map=False).turned(view.axes)], view, 0.0)
    for distance in (0.3, 0.6, 1.0, 2.0):
        expected = 1.0 - SHADOW * (1.0 - distance / np.hypot(distance, 0.5)) / 2
        assert canvas[225, round((8.0 + distance) * 50 - 0.5)] == pytest.approx(expected, abs=0.015)


def test_a_file_holds_what_was_drawn(tmp_path):
    colours = np.random.default_rng(1).uniform(size=(31, 47, 3))
    png.write_png(tmp_path / "noise.png", colours)
    assert np.abs(pixels(tmp_path / "noise.png")[::-1] - colours).max() < 0.51 / 255


def test_what_has_no_extent_in_the_picture_is_drawn_in_little_memory(tmp_path):
    """A rod that points at the viewer, a hundred thousand times as long as thick, and a single place."""
    out, up = View.three_quarter().axes[[2, 1]]
    for long in (1e5, 0.0):
        bpy.ops.mesh.primitive_cube_add()
        rod = bpy.context.object
        corners = read_positions(rod.data).astype(np.float64)
        thick = np.outer(corners[:, 1], up) if long else 0.0 * corners
        set_positions(rod.data, (long * np.outer(corners[:, 0], out) + thick).astype(np.float32))
        write_error(rod, np.zeros(8, dtype=np.float32), ColourScale(0.0, 1.0))
        with np.errstate(all="raise", under="ignore"):
            render_heatmap(rod, tmp_path / "rod.png", width=WIDTH)
        assert pixels(tmp_path / "rod.png").shape == (WIDTH * 9 // 16, WIDTH, 3)
