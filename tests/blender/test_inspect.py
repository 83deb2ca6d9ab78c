"""Looking at single patches: what is laid out, what the panel lists, colours and UV maps of the cover."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.representation.stored import read_representation
from bl_ext.user_default.sparse_surface.solver.surface.inspection import domain_atlas, patch_terms
from bl_ext.user_default.sparse_surface.ui import inspect_panel, result_panel
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).parent))
import scenes


@pytest.fixture
def result() -> Any:
    scenes.creased_sheet(14)
    return scenes.approximate(ring=4, degree=8, sparsity=8)


def inspection() -> Any:
    return bpy.context.scene.sparse_surface.inspection


def shown() -> dict[str, Any]:
    """What is laid out, but for the words below."""
    return {o.name: o for o in bpy.data.objects if "sparse_surface_inspected" in o and o.type == "MESH"}


def show(**arguments: Any) -> None:
    assert bpy.ops.sparse_surface.inspect_patch(**arguments) == {"FINISHED"}


def test_domains_and_functions_are_those_of_the_representation(result):
    inspection().patch = 2
    show()
    surface = read_representation(result)
    made = shown()
    assert set(made) == {
        "Patch 2", "Patch 2 Initial Domain", "Patch 2 Optimised Domain",
        "Patch 2 x(u, v)", "Patch 2 y(u, v)", "Patch 2 z(u, v)",
    }  # fmt: skip
    own = slice(*surface.vertex_offsets[2:4])
    size = own.stop - own.start
    for name, domain in (("Initial", surface.initial_domains[0]), ("Optimised", surface.domains[0])):
        placed = scenes.positions(made[f"Patch 2 {name} Domain"].data)
        assert np.allclose(placed[:, :2], domain[own], atol=1e-6)
        assert not placed[:, 2].any()
    values = surface.at_patch_vertices[own]
    for d, axis in enumerate("xyz"):
        placed = scenes.positions(made[f"Patch 2 {axis}(u, v)"].data)[:size]
        assert np.allclose(placed[:, :2], surface.domains[0, own], atol=1e-6)
        height = placed[:, 2] / surface.scales[2, 0] + surface.origins[2, d]
        assert np.allclose(height, values[:, d], atol=1e-5)
    assert np.allclose(scenes.positions(made["Patch 2"].data)[:size], values, atol=1e-5)


def test_it_lies_flat_beside_the_result_and_the_result_stays_active(result):
    result.location = (5.0, -3.0, 2.0)
    show()
    bpy.context.view_layer.update()
    right = max((result.matrix_world @ Vector(corner)).x for corner in result.bound_box)
    boxes = []
    for name, made in shown().items():
        points = scenes.world_positions(made)
        if name == "Patch 0":
            assert made.matrix_world == result.matrix_world
            continue
        assert points[:, 0].min() > right
        boxes.append((points[:, :2].min(axis=0), points[:, :2].max(axis=0)))
        if "Domain" in name:
            assert np.ptp(points[:, 2]) < 1e-6
    for k, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:k]:
            assert (low > other_high).any() or (other_low > high).any()
    assert bpy.context.view_layer.objects.active == result
    assert bpy.context.selected_objects == [result]


def test_stepping_replaces_what_was_shown(result):
    surface = read_representation(result)
    counts = []
    for expected in (0, 1, 2):
        show(which="CHOSEN" if expected == 0 else "NEXT")
        assert inspection().patch == expected
        assert f"Patch {expected}" in shown()
        counts.append((len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.collections)))
    assert len(set(counts)) == 1
    inspection().patch = 0
    show(which="PREVIOUS")
    assert inspection().patch == surface.patches - 1
    show(which="NEXT")
    assert inspection().patch == 0
    inspection().patch = 10_000
    show()
    assert inspection().patch == surface.patches - 1


def test_clearing_leaves_nothing_behind(result):
    before = {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "collections")}
    show()
    assert bpy.ops.sparse_surface.clear_inspection() == {"FINISHED"}
    assert {name: len(getattr(bpy.data, name)) for name in before} == before
    assert inspection().holder == ""
    assert not len(inspection().terms)
    assert not bpy.ops.sparse_surface.clear_inspection.poll()


def test_the_result_may_go_away(result):
    """Nothing that is shown holds on to it."""
    users = result.users
    show()
    assert result.users == users
    bpy.data.objects.remove(result)
    assert bpy.ops.sparse_surface.clear_inspection() == {"FINISHED"}
    assert not shown()


def test_the_panel_lists_functions_and_energy(result):
    inspection().patch = 1
    show()
    terms = patch_terms(read_representation(result), 1)
    listed = inspection().terms
    assert [entry.name for entry in listed] == [term.name for term in terms]
    assert np.allclose([list(entry.amounts) for entry in listed], [term.amounts for term in terms], rtol=1e-6)
    assert len(inspection().energy) == 3
    assert inspection().energy[0].value == 1.0
    seen = drawn(inspect_panel.SPARSE_SURFACE_PT_inspect)
    assert "SPARSE_SURFACE_UL_terms" in seen
    assert sum(1 for entry in seen if entry.startswith("energy")) == 3


def test_each_panel_draws_with_and_without_a_result(result):
    for _ in range(2):
        for panel in (
            result_panel.SPARSE_SURFACE_PT_representation,
            inspect_panel.SPARSE_SURFACE_PT_inspect,
            inspect_panel.SPARSE_SURFACE_PT_compare,
        ):
            assert panel.poll(bpy.context) or panel is inspect_panel.SPARSE_SURFACE_PT_compare
            assert drawn(panel)
        bpy.context.scene.sparse_surface.job = "MEASURE"
        assert inspect_panel.SPARSE_SURFACE_PT_compare.poll(bpy.context)


def test_the_lists_rows_draw(result):
    show()
    seen: list[str] = []
    inspect_panel.SPARSE_SURFACE_UL_terms.draw_item(
        None, bpy.context, Layout(seen), None, inspection().terms[0], 0, None, "", 0
    )
    assert inspection().terms[0].name in seen
    assert len(seen) == 4


class Layout:
    """Stands for a UILayout; notes what is shown and checks that it exists."""

    def __init__(self, seen: list[str]) -> None:
        self.__dict__["seen"] = seen

    def __setattr__(self, name: str, value: object) -> None:
        assert name in bpy.types.UILayout.bl_rna.properties

    def column(self, **_: object) -> Layout:
        return self

    row = split = column

    def prop(self, of: Any, name: str, **_: object) -> None:
        assert name in of.bl_rna.properties
        self.seen.append(name)

    def operator(self, name: str, **options: Any) -> Any:
        space, _, operator = name.partition(".")
        assert operator in dir(getattr(bpy.ops, space))
        icons = bpy.types.UILayout.bl_rna.functions["prop"].parameters["icon"].enum_items
        assert options.get("icon", "NONE") in icons
        self.seen.append(name)
        return SimpleNamespace()

    def label(self, text: str = "", **_: object) -> None:
        self.seen.append(text)

    def progress(self, factor: float, text: str) -> None:
        assert 0.0 <= factor <= 1.0
        self.seen.append(f"energy {text}")

    def template_list(self, kind: str, _: str, of: Any, name: str, active: Any, index: str, **__: object) -> None:
        assert hasattr(bpy.types, kind)
        assert name in of.bl_rna.properties
        assert index in active.bl_rna.properties
        self.seen.append(kind)

    def separator(self, **_: object) -> None:
        pass


def drawn(panel: Any) -> list[str]:
    seen: list[str] = []
    holder = SimpleNamespace(layout=Layout(seen))
    holder.column = lambda context: panel.column(holder, context)
    panel.draw(holder, bpy.context)
    return seen


def test_separate_domains_are_shown_for_each_coordinate():
    scenes.creased_sheet(12)
    result = scenes.approximate(ring=4, domains="separate")
    show()
    names = set(shown())
    for axis in "xyz":
        assert {f"Patch 0 Initial Domain {axis}", f"Patch 0 Optimised Domain {axis}", f"Patch 0 {axis}(u, v)"} <= names
    surface = read_representation(result)
    own = slice(*surface.vertex_offsets[:2])
    placed = scenes.positions(shown()["Patch 0 Optimised Domain y"].data)
    assert np.allclose(placed[:, :2], surface.domains[1, own], atol=1e-6)
    assert bpy.ops.sparse_surface.domains_to_uv() == {"FINISHED"}
    assert {"Optimised Domain X", "Initial Domain Z"} <= set(result.data.uv_layers.keys())


def test_the_patch_at_the_selection(result):
    patches = scenes.values(result.data, "patch")
    vertices = np.flatnonzero(patches == patches.max())[:3]
    result.data.vertices.foreach_set("select", np.isin(np.arange(len(patches)), vertices))
    show(which="SELECTED")
    assert inspection().patch == patches.max()
    result.data.vertices.foreach_set("select", np.zeros(len(patches), dtype=bool))
    with pytest.raises(RuntimeError, match="Select vertices"):
        bpy.ops.sparse_surface.inspect_patch(which="SELECTED")


def test_patches_have_colours_and_errors_come_back(result):
    assert bpy.ops.sparse_surface.show_patches() == {"FINISHED"}
    mesh = result.data
    assert mesh.color_attributes.active_color.name == "patch_color"
    patches, colours = scenes.values(mesh, "patch"), scenes.values(mesh, "patch_color", "color", 4)
    by_patch = {int(patch): np.unique(colours[patches == patch], axis=0) for patch in np.unique(patches)}
    assert all(len(rows) == 1 for rows in by_patch.values())
    assert len({tuple(rows[0]) for rows in by_patch.values()}) == len(by_patch)
    assert bpy.ops.sparse_surface.show_patches() == {"FINISHED"}
    assert mesh.color_attributes.active_color.name == "error_color"
    bpy.ops.sparse_surface.show_patches()
    assert [layer.name for layer in mesh.attributes if layer.name.startswith("patch_color")] == ["patch_color"]


def test_domains_become_uv_maps(result):
    mesh = result.data
    mesh.uv_layers.new(name="Mine")
    for _ in range(2):
        assert bpy.ops.sparse_surface.domains_to_uv() == {"FINISHED"}
        assert list(mesh.uv_layers.keys()) == ["Mine", "Initial Domain", "Optimised Domain"]
    assert mesh.uv_layers.active.name == "Optimised Domain"
    surface = read_representation(result)
    expected = domain_atlas(surface, surface.domains[0])
    assert np.allclose(scenes.values(mesh, "Optimised Domain", "vector", 2), expected, atol=1e-6)


def test_too_many_uv_maps_are_refused(result):
    for number in range(7):
        result.data.uv_layers.new(name=f"Map {number}")
    with pytest.raises(RuntimeError, match="no space"):
        bpy.ops.sparse_surface.domains_to_uv()
    assert len(result.data.uv_layers) == 7


def test_a_result_without_patches_is_refused():
    sheet = scenes.creased_sheet(8)
    sheet.vertex_groups.new(name="Nothing")
    scenes.approximate(ring=3, vertex_group="Nothing")
    assert bpy.context.object["sparse_surface"]["passed_through_vertices"] == 64
    if read_representation(bpy.context.object).patches == 0:
        with pytest.raises(RuntimeError, match="no patches"):
            bpy.ops.sparse_surface.inspect_patch()


@pytest.mark.parametrize("name", ["inspect_patch", "domains_to_uv", "show_patches"])
def test_only_results_can_be_looked_at(name):
    scenes.creased_sheet(8)
    operator = getattr(bpy.ops.sparse_surface, name)
    assert not operator.poll()
    scenes.approximate(ring=3)
    assert operator.poll()
    bpy.ops.object.mode_set(mode="EDIT")
    assert not operator.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
