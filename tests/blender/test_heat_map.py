"""Colours of errors, their scale, the legend's layout, and heat maps of any two meshes."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.data import colours as colour_ramp
from bl_ext.user_default.sparse_surface.operators.data.colours import ColourScale, linear_to_srgb, ramp, srgb_to_linear
from bl_ext.user_default.sparse_surface.ui.legend import build_legend, share_text, surrounding_box, tick_values

sys.path.insert(0, str(Path(__file__).parent))
import scenes


def cielab(linear):
    """CIE 1976 L*a*b* of linear sRGB under D65; independent of the space in which the map was designed."""
    to_xyz = np.array(
        [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    )
    xyz = linear @ to_xyz.T / np.array([0.95047, 1.0, 1.08883])
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


# H. Brettel, F. Vienot, J. Mollon: simplified by Vienot (1999), on linear RGB.
BLIND = {
    "none": np.eye(3),
    "protanopia": np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]),
    "deuteranopia": np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]),
    "grey": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}


@pytest.mark.parametrize("eyes", BLIND)
def test_ramp_rises_in_lightness_for_every_kind_of_eye(eyes):
    lightness = cielab(np.clip(ramp() @ BLIND[eyes].T, 0.0, 1.0))[:, 0]
    assert np.all(np.diff(lightness) > 0.0)
    assert lightness[-1] - lightness[0] > 60.0


def test_ramp_is_even_to_the_eye():
    steps = np.linalg.norm(np.diff(cielab(ramp().astype(float)), axis=0), axis=1)
    assert steps.max() < 3.0 * steps.min()


def test_ramp_is_the_published_viridis():
    published = {0: "440154", 64: "3b528b", 128: "21918c", 192: "5ec962", 255: "fde725"}
    ours = np.rint(255.0 * linear_to_srgb(ramp())).astype(int)
    assert {k: "".join(f"{c:02x}" for c in ours[k]) for k in published} == published
    colours = pytest.importorskip("matplotlib").colormaps["viridis"].colors
    assert np.allclose(linear_to_srgb(ramp()), colours, atol=2e-5)


@pytest.mark.parametrize("eyes", ["none", "protanopia", "deuteranopia"])
def test_inside_and_outside_differ_for_every_eye(eyes):
    two = srgb_to_linear(np.array([colour_ramp.INSIDE, colour_ramp.OUTSIDE]))
    lab = cielab(np.clip(two @ BLIND[eyes].T, 0.0, 1.0))
    assert np.linalg.norm(lab[0] - lab[1]) > 30.0


def test_transfer_curve():
    grey = np.linspace(0.0, 1.0, 101)
    assert np.allclose(linear_to_srgb(srgb_to_linear(grey)), grey, atol=1e-9)
    assert linear_to_srgb(np.array([0.2140411])) == pytest.approx(0.5, abs=1e-5)


def test_scale_clamps_and_splits():
    scale = ColourScale(0.0, 2.0)
    rgba = scale.colours(np.array([-1.0, 0.0, 1.0, 2.0, 9.0]))
    assert np.array_equal(rgba[0], rgba[1])
    assert np.array_equal(rgba[3], rgba[4])
    assert np.allclose(rgba[1, :3], ramp()[0])
    assert np.allclose(rgba[3, :3], ramp()[-1])
    assert np.all(rgba[:, 3] == 1.0)
    two = ColourScale(0.0, 2.0, tolerance=1.0).colours(np.array([0.5, 1.0, 1.01]))
    assert np.array_equal(two[0], two[1])
    assert not np.array_equal(two[1], two[2])
    assert np.all(np.isfinite(ColourScale(0.0, 0.0).colours(np.zeros(3))))


def shown_range():
    return list(bpy.context.object["error_color_range"])


def test_range_follows_the_display_settings_at_once():
    scenes.creased_sheet()
    made = scenes.approximate()
    error = scenes.values(made.data, "error")
    display = bpy.context.scene.sparse_surface.display
    assert shown_range() == pytest.approx([0.0, error.max(), 0.0])
    colours = lambda: scenes.values(made.data, "error_color", "color", 4)  # noqa: E731
    assert np.allclose(colours(), ColourScale(0.0, error.max()).colours(error), atol=1e-6)
    display.range_mode = "PERCENTILE"
    display.range_percentile = 50.0
    assert shown_range()[1] == pytest.approx(np.percentile(error, 50.0), rel=1e-5)
    assert np.allclose(colours(), ColourScale(0.0, shown_range()[1]).colours(error), atol=1e-6)
    display.range_mode = "FIXED"
    display.range_maximum = 0.25
    assert shown_range()[1] == pytest.approx(0.25)
    display.inside_outside = True
    display.tolerance = float(np.median(error))
    assert len(np.unique(colours(), axis=0)) == 2
    inside = np.all(np.isclose(colours(), colours()[np.argmin(error)]), axis=1)
    assert np.array_equal(inside, error <= np.float32(display.tolerance))


def test_the_settings_tolerance_divides_inside_from_outside_where_there_is_one():
    scenes.creased_sheet()
    made = scenes.approximate()
    settings = bpy.context.scene.sparse_surface
    settings.display.tolerance, settings.tolerance = 0.25, 0.125
    assert shown_range()[2] == 0.0
    settings.display.inside_outside = True
    assert shown_range()[2] == 0.125
    settings.tolerance = 0.0
    settings.display.tolerance = 0.0625
    assert shown_range()[2] == 0.0625
    outside = scenes.values(made.data, "error") > 0.0625
    two = np.where(outside[:, None], colour_ramp.OUTSIDE, colour_ramp.INSIDE)
    assert np.allclose(scenes.values(made.data, "error_color", "color", 4)[:, :3], srgb_to_linear(two), atol=1e-6)


def test_any_two_meshes_can_be_compared():
    one = scenes.creased_sheet(12)
    other = one.copy()
    other.data = one.data.copy()
    bpy.context.scene.collection.objects.link(other)
    other.location.x = 2.0
    for vertex in other.data.vertices:
        vertex.co.z += 0.1 * vertex.co.x
    scenes.select(other, one)
    assert bpy.ops.sparse_surface.compare() == {"FINISHED"}
    expected = np.linalg.norm(scenes.world_positions(one) - scenes.world_positions(other), axis=1)
    assert np.allclose(scenes.values(one.data, "error"), expected, atol=1e-6)
    assert "error" not in other.data.attributes
    assert shown_range()[1] == pytest.approx(expected.max(), rel=1e-5)


def test_meshes_that_differ_in_polygons_are_refused():
    one, other = scenes.creased_sheet(12, "One"), scenes.creased_sheet(13, "Other")
    scenes.select(other, one)
    with pytest.raises(RuntimeError, match="do not have the same polygons"):
        bpy.ops.sparse_surface.compare()
    assert "error" not in one.data.attributes


@pytest.mark.parametrize("scale", [1.0, 2.0])
@pytest.mark.parametrize("height", [120, 300, 1080])
def test_legend_lies_in_the_viewport_and_its_ticks_at_their_values(scale, height):
    legend = build_legend(0.0, 0.08, 0.0, "Error [m]", height, right=1000.0, scale=scale)
    bottom, top = legend.bands[0].bottom, legend.bands[-1].top
    assert bottom > 0
    assert all(one.top == pytest.approx(two.bottom) for one, two in zip(legend.bands, legend.bands[1:], strict=False))
    left, low, right, high = surrounding_box(legend, scale)
    assert 1000.0 - 220.0 * scale < left < legend.bands[0].left < right < 1000.0 - 44 * scale  # left of the buttons
    assert low > 0
    assert height < 300 * scale or high < height - 130 * scale  # below the gizmo
    assert all(upper - lower > 12 * scale for lower, upper in zip(legend.ticks, legend.ticks[1:], strict=False))
    title, *words = legend.texts
    assert title.text == "Error [m]"
    assert title.y > top
    if height >= 300:
        assert title.y + 12 * scale < height
    for y, word in zip(legend.ticks, words, strict=True):
        assert float(word.text) == pytest.approx(0.08 * (y - bottom) / (top - bottom), abs=1e-3)
    shares = [band.share for band in legend.bands]
    assert shares == sorted(shares)


def test_legend_of_a_tolerance():
    legend = build_legend(0.0, 0.08, 0.01, "Error [mm]", 600, right=500.0)
    assert len(legend.bands) == 2
    assert {"inside", "outside", "0.01"} <= {word.text for word in legend.texts}


def test_the_legend_says_the_share_of_each_band_and_none_only_of_none():
    legend = build_legend(0.0, 0.08, 0.01, "Error [mm]", 600, right=500.0, shares=(0.9998, 0.0002))
    assert {"inside  >99.9%", "outside  <0.1%"} <= {word.text for word in legend.texts}
    assert [share_text(share) for share in (0.0, 0.25, 1.0)] == ["0.0%", "25.0%", "100.0%"]


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_the_histogram_stands_at_the_left_of_the_colours_and_long_words_have_room(scale):
    shares = (0.5, 0.0, 0.25, 0.25)
    legend = build_legend(
        0.0,
        0.08,
        0.0,
        "A long title",
        600,
        right=1000.0,
        scale=scale,
        shares=shares,
        text_width=lambda word: 20.0 * len(word),
    )
    assert len(legend.bars) == 3  # none for the empty part
    lengths = [bar.right - bar.left for bar in legend.bars]
    assert lengths[0] == pytest.approx(2.0 * lengths[1]) == pytest.approx(2.0 * lengths[2])
    assert all(bar.right < legend.bands[0].left for bar in legend.bars)
    assert legend.bars[0].bottom == pytest.approx(legend.bands[0].bottom)
    assert legend.bars[-1].top == pytest.approx(legend.bands[-1].top)
    left, _, right, _ = surrounding_box(legend, scale)
    assert left < min(bar.left for bar in legend.bars)
    assert all(word.x + 20.0 * len(word.text) <= right for word in legend.texts)
    assert right < 1000.0 - 44 * scale  # left of the buttons


def test_legend_of_no_error():
    assert tick_values(0.0, 0.0, 5) == [0.0]
    assert len(build_legend(0.0, 0.0, 0.0, "Error", 600, right=500.0).ticks) == 1


def test_statistics_text_has_the_figures():
    from bl_ext.user_default.sparse_surface.operators.data.report_text import table

    scenes.creased_sheet(12)
    made = scenes.approximate()
    report = made["sparse_surface"].to_dict()
    text = table(made.name, report)
    assert text.splitlines()[0] == made.name
    assert f"{report['surface_error']['max']:.6g}" in text
