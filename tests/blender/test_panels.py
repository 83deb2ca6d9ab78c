"""What the panels show in each state, drawn into a layout that notes everything."""

from __future__ import annotations

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
from bl_ext.user_default.sparse_surface.ui import panels, preferences

sys.path.insert(0, str(Path(__file__).parent))
import scenes


class Recorder:
    """Stands for a UILayout and its parts; checks that what is shown exists."""

    def __init__(self, seen: list[tuple[str, Any]]) -> None:
        self.__dict__["seen"] = seen

    def part(self, *_: object, **__: object) -> Recorder:
        return Recorder(self.seen)

    row = column = split = box = part

    def prop(self, of: Any, name: str, **_: object) -> None:
        assert name in of.bl_rna.properties, name
        self.seen.append(("prop", name))

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
    stand_in.column = lambda context: panels.SidebarPanel.column(stand_in, context)
    panel.draw(stand_in, bpy.context)
    return seen


def words(seen: list[tuple[str, Any]]) -> str:
    return "\n".join(str(what) for kind, what in seen if kind == "label")


@pytest.mark.parametrize("panel", panels.CLASSES, ids=lambda panel: panel.__name__)
@pytest.mark.parametrize("state", ["empty", "mesh", "result"])
def test_every_panel_draws(panel, state):
    if state != "empty":
        scenes.creased_sheet(12)
    if state == "result":
        scenes.approximate(tolerance=0.001)
        bpy.context.scene.sparse_surface.display.inside_outside = True
    assert drawn(panel)


def test_sub_panels_are_closed_at_first_and_all_under_the_main_one():
    main, *others = panels.CLASSES
    assert main.bl_category == "Sparse Surface"
    for panel in others:
        assert panel.bl_parent_id == main.__name__
        assert panel.bl_options == {"DEFAULT_CLOSED"}


def test_estimate_and_warning_of_large_meshes(monkeypatch):
    scenes.creased_sheet(40)
    text = words(drawn(panels.SPARSE_SURFACE_PT_main))
    assert f"About {estimate.estimate(1600, bpy.context.scene.sparse_surface.to_settings()).patches} patches" in text
    assert "Large mesh" not in text
    monkeypatch.setattr(panels, "LARGE_MESH", 1000)
    assert "Large mesh: about" in words(drawn(panels.SPARSE_SURFACE_PT_main))


def test_estimate_counts_what_modifiers_make():
    sheet = scenes.creased_sheet(20)
    sheet.modifiers.new("Subdivision", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    settings = bpy.context.scene.sparse_surface
    subdivided = 39 * 39
    assert f"About {estimate.estimate(subdivided, settings.to_settings()).patches} patches" in words(
        drawn(panels.SPARSE_SURFACE_PT_main)
    )
    settings.use_modifiers = False
    assert f"About {estimate.estimate(400, settings.to_settings()).patches} patches" in words(
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
    assert "Within the tolerance (0.5)" in words(drawn(panels.SPARSE_SURFACE_PT_statistics))
    report = bpy.context.object["sparse_surface"]
    report["settings"]["tolerance"] = 1e-9
    assert "Exceeds the tolerance" in words(drawn(panels.SPARSE_SURFACE_PT_statistics))
    text = words(drawn(panels.SPARSE_SURFACE_PT_statistics))
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
heavy.remove("solver.native.library")  # whether there is a compiled kernel: it takes neither NumPy nor the kernel
heavy += [name for name in own if hasattr(sys.modules["{scenes.EXTENSION}." + name], "np")]
print("loaded", sorted(new & {{"scipy", "sklearn", "joblib", "threadpoolctl"}}), sorted(heavy))
"""
    )
    assert "loaded [] []" in done.stdout, done.stdout + done.stderr
