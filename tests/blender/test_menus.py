"""Everything can be found in Blender's own places: menus, Menu Search, importing, exporting, dropped files, help."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface import operators
from bl_ext.user_default.sparse_surface.operators.run import about
from bl_ext.user_default.sparse_surface.solver import Representation
from bl_ext.user_default.sparse_surface.ui import help_panel, menus
from bl_ext.user_default.sparse_surface.ui.jobs import ITEMS

sys.path.insert(0, str(Path(__file__).parent))
import scenes

ELSEWHERE = {"preset_add", "report_bug"}
"""In a preset menu; named by what it does."""


class Recorder:
    """Stands for a layout: notes the operators and menus that are drawn, and hands itself out for sub-layouts."""

    def __init__(self) -> None:
        self.operators: list[tuple[str, str]] = []
        self.menus: list[str] = []

    def operator(self, name: str, text: str = "", **_: Any) -> Any:
        self.operators.append((name, text))
        return type("Properties", (), {})()

    def menu(self, name: str, **_: Any) -> None:
        self.menus.append(name)

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: self


def drawn(draw: Any) -> Recorder:
    layout = Recorder()
    draw(type("Menu", (), {"layout": layout})(), bpy.context)
    return layout


def test_the_object_menu_holds_every_operator():
    """Menu Search (F3) finds what stands in a menu of the editor."""
    found = {name for name, _ in drawn(menus.SPARSE_SURFACE_MT_object.draw).operators}
    assert {f"sparse_surface.{name}" for name in set(operators.OPERATORS) - ELSEWHERE} <= found


@pytest.mark.parametrize("place", list(menus.PLACES))
def test_blenders_menus_are_extended_once(place: str):
    """Blender keeps the functions that it calls after a menu's own."""
    own = getattr(bpy.types, place)._dyn_ui_initialize()
    assert own.count(menus.PLACES[place]) == 1


def test_the_right_click_menu_offers_it_for_meshes_and_points_only():
    bpy.ops.object.light_add()
    assert not drawn(menus.PLACES["VIEW3D_MT_object_context_menu"]).menus
    scenes.creased_sheet(8)
    assert drawn(menus.PLACES["VIEW3D_MT_object_context_menu"]).menus == ["SPARSE_SURFACE_MT_object"]


def test_the_menu_removes_noise_whatever_the_scene_says():
    scenes.creased_sheet(16)
    scenes.hurry()
    assert bpy.context.scene.sparse_surface.denoise == "off"
    assert bpy.ops.sparse_surface.approximate(only_denoise=True) == {"FINISHED"}
    assert bpy.context.object["sparse_surface"]["patches"] == 0
    assert bpy.context.scene.sparse_surface.denoise == "off"


def test_points_are_read_and_can_be_reconstructed(tmp_path: Path):
    before = set(bpy.data.objects)
    (tmp_path / "scan.xyz").write_text("# a comment\n0 0 0\n1 0 0 255 0 0\n0 1 0\n")
    (tmp_path / "other.obj").write_text("v 1 2 3\nv 4 5 6\n")
    chosen = [{"name": "scan.xyz"}, {"name": "other.obj"}]
    assert bpy.ops.sparse_surface.import_points(directory=str(tmp_path), files=chosen) == {"FINISHED"}
    made = {o.name: o for o in bpy.data.objects if o not in before}
    assert set(made) == {"scan", "other"}
    assert scenes.positions(made["scan"].data).tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert set(bpy.context.selected_objects) == set(made.values())
    assert bpy.ops.sparse_surface.reconstruct.poll()


@pytest.mark.parametrize(
    ("content", "message"), [(None, "cannot be read: No such file"), ("a b c\n", "three numbers"), ("", "no points")]
)
def test_a_bad_point_file_is_refused_in_one_sentence(tmp_path: Path, content: str | None, message: str):
    path = tmp_path / "bad.xyz"
    if content is not None:
        path.write_text(content)
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.sparse_surface.import_points(filepath=str(path))
    assert not bpy.data.objects
    assert not bpy.data.meshes


def test_a_representation_goes_to_a_file_and_back(tmp_path: Path):
    scenes.creased_sheet(16)
    made = scenes.approximate(ring=4)
    path = tmp_path / "sheet"
    assert bpy.ops.sparse_surface.export_representation(filepath=str(path)) == {"FINISHED"}
    written = tmp_path / "sheet.npz"
    assert [each.name for each in tmp_path.iterdir()] == ["sheet.npz"]
    saved = Representation.load(written)
    assert bpy.ops.sparse_surface.import_representation(filepath=str(written)) == {"FINISHED"}
    opened = bpy.context.object
    assert opened.name == "sheet"
    # Files keep the surface to a hundred-thousandth of its size.
    assert np.allclose(scenes.positions(opened.data), scenes.positions(made.data), atol=2e-5)
    assert len(opened.data.polygons) == len(made.data.polygons)
    expected = np.linalg.norm(saved.at_vertices() - saved.vertices, axis=1)
    assert np.allclose(scenes.values(opened.data, "error"), expected, atol=1e-7)
    assert np.array_equal(scenes.values(opened.data, "patch"), scenes.values(made.data, "patch"))
    assert bpy.ops.sparse_surface.resample(splits=3) == {"FINISHED"}
    assert len(bpy.context.object.data.vertices) == 46**2


def test_a_damaged_representation_is_refused_and_leaves_nothing(tmp_path: Path):
    path = tmp_path / "damaged.npz"
    path.write_bytes(b"PK\x03\x04 not an archive")
    with pytest.raises(RuntimeError, match=r"damaged\.npz"):
        bpy.ops.sparse_surface.import_representation(filepath=str(path))
    assert not bpy.data.objects
    assert not bpy.data.meshes


def test_a_file_that_cannot_be_written_is_refused(tmp_path: Path):
    scenes.creased_sheet(12)
    scenes.approximate(ring=4)
    with pytest.raises(RuntimeError, match="cannot be written"):
        bpy.ops.sparse_surface.export_representation(filepath=str(tmp_path / "missing" / "x.npz"))


def test_dropped_files_reach_the_importers():
    for handler in (menus.SPARSE_SURFACE_FH_points, menus.SPARSE_SURFACE_FH_representation):
        assert issubclass(handler, bpy.types.FileHandler)
        assert handler.is_registered
        group, _, name = handler.bl_import_operator.partition(".")
        importer = getattr(getattr(bpy.ops, group), name).get_rna_type()
        assert {"filepath", "directory", "files"} <= set(importer.properties.keys())
    assert {".xyz", ".las", ".pcd"} <= set(menus.SPARSE_SURFACE_FH_points.bl_file_extensions.split(";"))


def test_help_leads_to_the_website_of_the_manifest(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    manifest = tmp_path / "blender_manifest.toml"
    monkeypatch.setattr(about, "MANIFEST", manifest)
    about.website.cache_clear()
    try:
        assert (about.website(), about.bug_page()) == ("", "")
        manifest.write_text('website = "https://example.org/sparse/"\n')
        about.website.cache_clear()
        assert about.website() == "https://example.org/sparse"
        assert about.bug_page() == "https://example.org/sparse/issues"
        shown = [name for name, _ in drawn(menus.SPARSE_SURFACE_MT_help.draw).operators]
        assert shown == ["wm.url_open", "sparse_surface.whats_new", "sparse_surface.report_bug"]
    finally:
        monkeypatch.undo()
        about.website.cache_clear()


def test_a_bug_report_gets_the_versions():
    text = about.system_text()
    for part in (bpy.app.version_string, sys.version.split()[0], "SciPy: 1.", "Compiled kernel: "):
        assert part in text
    assert bpy.ops.sparse_surface.report_bug() == {"FINISHED"}


def test_every_job_has_help():
    assert set(help_panel.STEPS) == {job for job, *_ in ITEMS}
