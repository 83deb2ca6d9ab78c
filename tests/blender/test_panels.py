"""What the panels show in each state, drawn into a layout that notes everything."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from bl_ext.user_default.sparse_surface.operators.run import estimate
from bl_ext.user_default.sparse_surface.operators.run.control import Run
from bl_ext.user_default.sparse_surface.operators.run.session import session
from bl_ext.user_default.sparse_surface.solver.progress import Progress
from bl_ext.user_default.sparse_surface.ui import (
    advanced_panel,
    inspect_panel,
    jobs,
    panels,
    preferences,
    result_panel,
    sidebar,
)

sys.path.insert(0, str(Path(__file__).parent))
import scenes


class Recorder:
    """Stands for a UILayout and its parts; checks that what is shown exists."""

    def __init__(self, seen: list[tuple[str, Any]]) -> None:
        self.__dict__["seen"] = seen

    def part(self, *_: object, **__: object) -> Recorder:
        return Recorder(self.seen)

    row = column = split = box = grid_flow = part

    def prop(self, of: Any, name: str, **_: object) -> None:
        assert name in of.bl_rna.properties, name
        self.seen.append(("prop", name))

    def prop_enum(self, of: Any, name: str, value: str, **_: object) -> None:
        assert value in {each.identifier for each in of.bl_rna.properties[name].enum_items}, value
        self.seen.append(("choice", value))

    def prop_search(self, of: Any, name: str, where: Any, collection: str) -> None:
        assert hasattr(where, collection)
        self.prop(of, name)

    def operator(self, name: str, **_: object) -> Any:
        space, _, operator = name.partition(".")
        assert operator in dir(getattr(bpy.ops, space)), name
        self.seen.append(("operator", name))
        return SimpleNamespace()

    def label(self, text: str = "", **_: object) -> None:
        self.seen.append(("label", text))

    def progress(self, factor: float, text: str) -> None:
        self.seen.append(("progress", factor))

    def separator(self, **_: object) -> None:
        pass

    def popover(self, panel: str, **_: object) -> None:
        assert hasattr(bpy.types, panel)


def drawn(panel: Any) -> list[tuple[str, Any]]:
    """Draw a panel and return what it showed."""
    seen: list[tuple[str, Any]] = []
    stand_in = SimpleNamespace(layout=Recorder(seen))
    stand_in.column = lambda context: sidebar.SidebarPanel.column(stand_in, context)
    panel.draw(stand_in, bpy.context)
    return seen


def words(seen: list[tuple[str, Any]]) -> str:
    return "\n".join(str(what) for kind, what in seen if kind == "label")


PANELS = (*panels.CLASSES, *advanced_panel.CLASSES, *result_panel.CLASSES, *inspect_panel.CLASSES[1:])


def shown(panel: Any) -> bool:
    """Whether Blender shows a panel in the present state."""
    return not hasattr(panel, "poll") or panel.poll(bpy.context)


@pytest.mark.parametrize("job", [name for name, *_ in jobs.ITEMS])
@pytest.mark.parametrize("panel", PANELS, ids=lambda panel: panel.__name__)
@pytest.mark.parametrize("state", ["empty", "mesh", "result"])
def test_every_panel_draws(panel, state, job):
    if state != "empty":
        scenes.creased_sheet(12)
    if state == "result":
        scenes.approximate(tolerance=0.001)
        bpy.context.scene.sparse_surface.display.inside_outside = True
    bpy.context.scene.sparse_surface.job = job
    if shown(panel):
        assert drawn(panel)


def test_all_but_the_job_and_the_result_is_closed_at_first():
    top = [panel for panel in PANELS if not hasattr(panel, "bl_parent_id")]
    assert {panel.__name__ for panel in top} == {"SPARSE_SURFACE_PT_main", "SPARSE_SURFACE_PT_result"}
    for panel in set(PANELS) - set(top):
        assert panel.bl_parent_id in {each.__name__ for each in PANELS}
        assert panel.bl_options == {"DEFAULT_CLOSED"}


def test_four_jobs_are_seen_and_each_shows_its_button_and_no_more_than_it_needs():
    scenes.creased_sheet(12)
    settings = bpy.context.scene.sparse_surface
    buttons = {"APPROXIMATE": "approximate", "DENOISE": "approximate"}
    buttons |= {"RECONSTRUCT": "reconstruct", "MEASURE": "compare"}
    for job, button in buttons.items():
        settings.job = job
        seen = drawn(panels.SPARSE_SURFACE_PT_main)
        assert {name for kind, name in seen if kind == "choice"} >= set(buttons)
        assert ("operator", f"sparse_surface.{button}") in seen
        assert len([name for kind, name in seen if kind == "prop"]) < 14
        assert not {"ring", "degree", "sparsity", "domains", "rho"} & {name for kind, name in seen if kind == "prop"}
    assert not shown(advanced_panel.SPARSE_SURFACE_PT_advanced)


def test_the_job_follows_the_settings_and_the_settings_the_job():
    settings = bpy.context.scene.sparse_surface
    assert settings.job == "APPROXIMATE"
    settings.apply_preset("denoise")
    assert settings.job == "DENOISE"
    settings.job = "APPROXIMATE"
    assert settings.denoise == "off"
    settings.job = "DENOISE"
    assert settings.denoise == "only"
    settings.denoise = "first"
    settings.job = "MEASURE"
    assert settings.job == "MEASURE"
    settings.job = "DENOISE"
    assert settings.denoise == "first"


def test_selecting_points_chooses_reconstruct_until_another_job_is_chosen_for_them():
    settings = bpy.context.scene.sparse_surface
    sheet = scenes.creased_sheet(8)
    points = bpy.data.objects.new("Points", bpy.data.meshes.new("Points"))
    points.data.from_pydata([(0, 0, 0), (1, 0, 0)], [], [])
    bpy.context.scene.collection.objects.link(points)
    assert settings.job == "APPROXIMATE"
    scenes.select(points)
    assert settings.job == "RECONSTRUCT"
    scenes.select(sheet)
    assert settings.job == "APPROXIMATE"
    scenes.select(points)
    settings.job = "MEASURE"
    assert settings.job == "MEASURE"


def test_the_result_is_seen_only_while_one_is_selected():
    sheet = scenes.creased_sheet(12)
    assert not shown(result_panel.SPARSE_SURFACE_PT_result)
    made = scenes.approximate()
    assert shown(result_panel.SPARSE_SURFACE_PT_result)
    largest = made["sparse_surface"]["vertex_error"]["max"]
    bpy.context.scene.unit_settings.length_unit = "MILLIMETERS"
    text = words(drawn(result_panel.SPARSE_SURFACE_PT_result))
    assert f"{1000 * largest:.4g} mm" in text
    assert any(word in text for word in ("Very close", "Close", "Coarse", "Far off"))
    assert max(made["error_color_range"]) == pytest.approx(largest, rel=1e-6)
    bpy.context.scene.unit_settings.length_unit = "METERS"
    scenes.select(sheet)
    assert not shown(result_panel.SPARSE_SURFACE_PT_result)


@pytest.mark.parametrize("name", ["tolerance", "noise_level", "workers"])
def test_a_setting_that_can_be_off_is_a_checkbox_with_a_value(name):
    settings = bpy.context.scene.sparse_surface
    assert getattr(settings, name) == 0
    assert not getattr(settings, f"use_{name}")
    offered = getattr(settings, f"{name}_given")
    assert offered > 0
    setattr(settings, f"use_{name}", True)
    assert getattr(settings, name) == offered
    setattr(settings, f"{name}_given", 3)
    assert getattr(settings, name) == 3
    setattr(settings, f"use_{name}", False)
    assert getattr(settings, name) == 0
    setattr(settings, f"use_{name}", True)
    assert getattr(settings, name) == 3
    setattr(settings, name, 0)
    assert not getattr(settings, f"use_{name}")


def test_estimate_and_warning_of_large_meshes(monkeypatch):
    scenes.creased_sheet(40)
    text = words(drawn(panels.SPARSE_SURFACE_PT_main))
    settings = bpy.context.scene.sparse_surface.to_settings()
    assert f"About {estimate.estimate(1600, settings, closed=False).patches} patches" in text
    assert "Large mesh" not in text
    monkeypatch.setattr(panels, "LARGE_MESH", 1000)
    assert "Large mesh: about" in words(drawn(panels.SPARSE_SURFACE_PT_main))


def test_a_mesh_that_is_too_coarse_is_told_before_the_run():
    bpy.ops.mesh.primitive_cube_add()
    assert "8 vertices: too coarse" in words(drawn(panels.SPARSE_SURFACE_PT_main))


def test_estimate_counts_what_modifiers_make():
    sheet = scenes.creased_sheet(20)
    sheet.modifiers.new("Subdivision", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    settings = bpy.context.scene.sparse_surface
    subdivided = 39 * 39
    assert f"About {estimate.estimate(subdivided, settings.to_settings(), closed=False).patches} patches" in words(
        drawn(panels.SPARSE_SURFACE_PT_main)
    )
    settings.use_modifiers = False
    assert f"About {estimate.estimate(400, settings.to_settings(), closed=False).patches} patches" in words(
        drawn(panels.SPARSE_SURFACE_PT_main)
    )


def test_button_counts_the_meshes():
    sheets = [scenes.creased_sheet(8, name) for name in ("One", "Two", "Three")]
    scenes.select(*sheets)
    assert len(panels.selected_meshes(bpy.context)) == 3
    assert ("operator", "sparse_surface.approximate") in drawn(panels.SPARSE_SURFACE_PT_main)


def test_progress_takes_the_place_of_the_button(monkeypatch):
    scenes.creased_sheet(8)
    run = Run([])
    run.progress = Progress("Solving patches", 0.25, "5 of 20 patches")
    run.started -= 30.0
    monkeypatch.setattr(session, "current", run)
    seen = drawn(panels.SPARSE_SURFACE_PT_main)
    assert ("progress", 0.25) in seen
    assert "Solving patches" in words(seen)
    assert "5 of 20 patches" in words(seen)
    assert "2 min left" in words(seen)
    assert {"sparse_surface.finish", "sparse_surface.cancel"} <= {what for kind, what in seen if kind == "operator"}
    assert "sparse_surface.approximate" not in {what for kind, what in seen if kind == "operator"}
    with pytest.raises(RuntimeError, match="An approximation is running"):
        bpy.ops.sparse_surface.approximate()


def test_statistics_say_whether_the_tolerance_is_kept():
    scenes.creased_sheet(12)
    scenes.approximate(tolerance=0.5)
    assert "Within the tolerance (0.5 m)" in words(drawn(result_panel.SPARSE_SURFACE_PT_result))
    report = bpy.context.object["sparse_surface"]
    report["settings"]["tolerance"] = 1e-9
    assert "Exceeds the tolerance" in words(drawn(result_panel.SPARSE_SURFACE_PT_result))
    text = words(drawn(result_panel.SPARSE_SURFACE_PT_statistics))
    for word in ("Patches", "Flipped triangles", "Vertex error, rms", "Surface error, max", "Seconds"):
        assert word in text


def test_preferences_show_the_versions_in_use():
    import numpy
    import scipy

    seen: list[tuple[str, Any]] = []
    own = bpy.context.preferences.addons[scenes.EXTENSION].preferences
    preferences.SparseSurfacePreferences.draw(
        SimpleNamespace(layout=Recorder(seen), bl_rna=own.bl_rna, workers=0, default_preset="default"), bpy.context
    )
    assert numpy.__version__ in words(seen)
    assert scipy.__version__ in words(seen)
    assert ("prop", "workers") in seen
    assert ("prop", "default_preset") in seen


def test_preferences_say_whether_everything_was_found(monkeypatch: pytest.MonkeyPatch):
    def shown() -> str:
        seen: list[tuple[str, Any]] = []
        own = bpy.context.preferences.addons[scenes.EXTENSION].preferences
        preferences.SparseSurfacePreferences.draw(
            SimpleNamespace(layout=Recorder(seen), bl_rna=own.bl_rna, workers=0, default_preset="default"), bpy.context
        )
        return words(seen)

    library = importlib.import_module(f"{scenes.EXTENSION}.solver.native.library")
    monkeypatch.setattr(library, "reason_against", lambda: None)
    assert "Everything was found, also the compiled kernel" in shown()
    monkeypatch.setattr(preferences, "missing_packages", lambda: ("SciPy",))
    assert "Everything was found" not in shown()
    assert "it includes what is missing" in shown()
    monkeypatch.setattr(preferences, "missing_packages", lambda: ())
    monkeypatch.setattr(library, "reason_against", lambda: "There is no kernel.")
    assert "Everything was found" not in shown()
    assert "There is no kernel." in shown()


def test_registering_and_drawing_loads_neither_numpy_nor_scipy(run_bpy):
    """Blender starts with the extension enabled: that must not cost what only a run needs."""
    done = run_bpy(
        f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import bpy
before = set(sys.modules)
import addon_utils
assert addon_utils.enable("{scenes.EXTENSION}") is not None
bpy.ops.sparse_surface.approximate.poll()
new = {{name.partition(".")[0] for name in set(sys.modules) - before}}
own = [name.partition("sparse_surface.")[2] for name in sys.modules if "sparse_surface." in name]
heavy = [name for name in own if name.startswith("solver.") and name.count(".") > 1 or name == "solver.job"]
light = {{"solver.native.library", "solver.distance.settings"}}  # they take neither NumPy nor the compiled kernel
heavy = [name for name in heavy if name not in light]
heavy += [name for name in own if hasattr(sys.modules["{scenes.EXTENSION}." + name], "np")]
print("loaded", sorted(new & {{"scipy", "sklearn", "joblib", "threadpoolctl"}}), sorted(heavy))
"""
    )
    assert "loaded [] []" in done.stdout, done.stdout + done.stderr
