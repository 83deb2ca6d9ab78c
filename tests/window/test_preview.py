"""The surface is seen while it is solved: drawn over its source, or as an early object of the result."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import driver


def test_the_surface_is_drawn_while_it_is_solved():
    """In colours, which nothing else in the viewport has this many of, and without an object."""
    sheet = yield from driver.start_job(200, iterations=60, preview_kind="DRAWN")
    yield from driver.wait_for(driver.drawn_objects, 120.0, "preview")
    assert driver.drawn_objects() == {sheet.session_uid}
    view = driver.viewport().spaces.active.region_3d
    view.view_distance, far = 5.0, view.view_distance
    yield 0.5
    drawn = driver.coloured_pixels("job_preview")
    assert {each.name for each in bpy.data.objects} == {"Creased"}
    sheet.location.z = 50.0
    yield 0.5
    moved_away = driver.coloured_pixels("job_preview_moved_away")
    sheet.location.z = 0.0
    with driver.in_viewport():
        bpy.ops.object.mode_set(mode="SCULPT")
    yield 0.5
    worked_on = driver.coloured_pixels("job_preview_worked_on")
    with driver.in_viewport():
        bpy.ops.object.mode_set(mode="OBJECT")
    sheet.hide_set(True)
    yield 0.5
    hidden = driver.coloured_pixels("job_preview_hidden")
    sheet.hide_set(False)
    driver.select(sheet)
    with driver.in_viewport():
        bpy.ops.view3d.localview(frame_selected=False)
    yield 0.5
    alone = driver.coloured_pixels("job_preview_local_view")
    with driver.in_viewport():
        bpy.ops.view3d.localview(frame_selected=False)
    view.view_distance = far
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})
    gone = driver.coloured_pixels("job_preview_gone")
    assert drawn > 5000, drawn
    assert moved_away < 0.1 * drawn, (moved_away, drawn)
    assert worked_on < 0.1 * drawn, (worked_on, drawn)
    assert gone < 0.1 * drawn, (gone, drawn)
    assert hidden < 0.1 * drawn, (hidden, drawn)
    assert alone > 0.5 * drawn, (alone, drawn)


def test_a_large_surface_is_drawn_with_fewer_triangles(monkeypatch):
    """And looks like the whole of it."""
    preview, drawn = driver.module("operators.preview.controller"), driver.module("operators.preview.overlay")
    show, counts, coloured = drawn.show, [], []

    def counting_show(source, positions, colours, triangles):
        assert len(positions) == len(colours)
        counts.append(len(triangles))
        show(source, positions, colours, triangles)

    monkeypatch(drawn, "show", counting_show)
    monkeypatch(preview, "draws_by_software", lambda: True)
    view = driver.viewport().spaces.active.region_3d
    view.view_distance, far = 5.0, view.view_distance
    for most in (1_000_000, 10_000):
        monkeypatch(preview, "MOST_BY_SOFTWARE", most)
        yield from driver.start_job(200, iterations=60)
        yield from driver.wait_for(driver.drawn_objects, 120.0, "preview")
        view.view_distance += 0.001
        yield 0.5
        coloured.append(driver.coloured_pixels(f"job_preview_of_at_most_{most}"))
        driver.press("ESC")
        yield from driver.assert_nothing_left({"Creased"})
    view.view_distance = far
    assert counts[0] == 2 * 199 * 199
    assert 3_000 < counts[-1] <= 10_000
    assert abs(coloured[1] - coloured[0]) < 0.05 * coloured[0], coloured


def test_previews_of_a_large_mesh_cost_little(monkeypatch):
    """Of Blender's own thread; a quarter of a million vertices took 0.07 s."""
    preview = driver.module("operators.preview.controller").LivePreview
    update, spent = preview.update, []

    def timed_update(self, context):
        before = time.thread_time()
        shown = update(self, context)
        if shown:
            spent.append(time.thread_time() - before)
        return shown

    monkeypatch(preview, "update", timed_update)
    yield from driver.start_job(500, preview_kind="DRAWN")
    yield from driver.wait_for(lambda: len(spent) > 1, 200.0, "two previews")
    print(f"previews took {', '.join(f'{1000 * each:.0f}' for each in spent)} ms of processor time", flush=True)
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})
    assert max(spent) < 0.03, spent


def test_a_machine_that_draws_slowly_gets_a_drawing(monkeypatch):
    """Where every redraw of the window takes longer than `QUICK`, by whatever it may be."""

    def slow_draw():
        time.sleep(2.0 * driver.module("operators.preview.controller").QUICK)

    handle = bpy.types.SpaceView3D.draw_handler_add(slow_draw, (), "WINDOW", "POST_PIXEL")
    try:
        monkeypatch(driver.module("operators.preview.controller"), "REST", 0.0)
        monkeypatch(driver.module("operators.preview.controller"), "draws_by_software", lambda: False)
        yield from driver.start_job(60, iterations=60)
        yield from driver.wait_for(driver.drawn_objects, 120.0, "drawing")
        while driver.running() is not None:
            assert early_error() is None
            yield 0.02
    finally:
        bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")


def noted_previews(monkeypatch) -> list[float]:
    """Note when a preview is ready to be drawn."""
    drawn = driver.module("operators.preview.overlay")
    show, previews = drawn.show, []

    def noted_show(*arguments):
        previews.append(time.monotonic())
        show(*arguments)

    monkeypatch(drawn, "show", noted_show)
    return previews


def test_blender_is_asked_to_draw_only_once_by_software(monkeypatch):
    """After the first picture, what is solved is seen when the viewport is drawn for another reason."""
    monkeypatch(driver.module("operators.preview.controller"), "draws_by_software", lambda: True)
    previews = noted_previews(monkeypatch)
    with driver.noted_drawings() as drawings:
        yield from driver.start_job(300, iterations=60)
        yield from driver.wait_for(driver.drawn_objects, 120.0, "preview")
        yield 0.5
        assert drawings[-1] > previews[0]
        drawings.clear()
        previews.clear()
        yield 3.0
        assert driver.running() is not None
        assert not drawings
        assert len(previews) > 1
        view = driver.viewport().spaces.active.region_3d
        view.view_distance, far = 5.0, view.view_distance
        yield 0.5
        assert drawings
    seen = driver.coloured_pixels("job_preview_not_asked_for")
    view.view_distance = far
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})
    assert seen > 5000, seen


def test_blender_is_asked_to_draw_no_more_where_it_turned_out_to_be_slow(monkeypatch):
    preview = driver.module("operators.preview.controller")
    for name, value in (("REST", 0.0), ("QUICK", 0.0), ("draws_by_software", lambda: False)):
        monkeypatch(preview, name, value)
    previews = noted_previews(monkeypatch)
    for slow, in_a_row, asked in ((1000.0, 2, True), (0.0, 2, False), (0.0, 1000, True)):
        monkeypatch(preview, "SLOW", slow)
        monkeypatch(preview, "SLOW_IN_A_ROW", in_a_row)
        with driver.noted_drawings() as drawings:
            yield from driver.start_job(300, iterations=60)
            previews.clear()
            yield from driver.wait_for(lambda: len(previews) > 2, 120.0, "three previews")
            yield 0.5
            drawings.clear()
            previews.clear()
            yield 3.0
            assert driver.running() is not None
            assert len(previews) > 1
            assert bool(drawings) == asked
            driver.press("ESC")
            yield from driver.assert_nothing_left({"Creased"})


def test_what_a_run_shows_costs_little():
    """Slow previews are seldom, and progress is drawn no more often than it can be read."""
    preview, status = driver.module("operators.preview.overlay"), driver.module("operators.run.status")
    draw, show = preview.show, status.show_status
    updates: list[float] = []
    lines: list[str] = []

    def slow_draw(*arguments):
        updates.append(time.monotonic())
        draw(*arguments)
        time.sleep(0.3)

    def noted_show(context, run):
        lines.append(status.status_text(run) if run is not None else "")
        show(context, run)

    yield from driver.start_job(300, iterations=60, preview_kind="DRAWN")
    preview.show, status.show_status = slow_draw, noted_show
    try:
        yield from driver.wait_for(lambda: updates, 120.0, "preview")
        lines.clear()
        began = time.monotonic()
        yield 4.0
        passed = time.monotonic() - began
        assert len(updates) == 1
        assert 1 <= len(lines) <= 1 + passed / status.SECONDS_BETWEEN_LOOKS
        assert len(set(lines)) == len(lines)
        assert driver.running() is not None
    finally:
        preview.show, status.show_status = draw, show
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})


def early_error() -> float | None:
    """Return how far the early result object is off by root mean square, None where there is no such object."""
    early = [each for each in bpy.data.objects if "sparse_surface_early" in each]
    assert len(early) <= 1
    if not early:
        return None
    assert early[0].name == driver.RESULT
    return float(np.sqrt(np.mean(driver.module("operators.data.attributes").read(early[0].data, "error") ** 2)))


def test_the_result_object_appears_early_and_improves():
    yield from driver.start_job(240, iterations=60, preview_kind="OBJECT")
    yield from driver.wait_for(early_error, 120.0, "early object")
    assert driver.running().progress.fraction < 0.5
    view = driver.viewport().spaces.active.region_3d
    view.view_distance, far = 5.0, view.view_distance
    yield 0.5
    errors = []

    def improved() -> bool:
        errors.append(early_error())
        return errors[-1] < 0.6 * errors[0]

    driver.shot("job_early_object")
    yield from driver.wait_for(improved, 120.0, "a better surface")
    driver.shot("job_early_object_improved")
    view.view_distance = far
    assert not driver.drawn_objects()
    assert driver.running() is not None
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})


def test_the_early_object_gives_way_to_saving_and_to_other_modes(monkeypatch):
    monkeypatch(driver.module("operators.preview.controller"), "REST", 0.0)  # by software a preview takes long
    yield from driver.start_job(240, iterations=60, preview_kind="OBJECT")
    yield from driver.wait_for(early_error, 120.0, "early object")
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "saved.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
        with bpy.data.libraries.load(path) as (saved, _):
            assert list(saved.objects) == ["Creased"]
            assert len(saved.meshes) == 1
    yield from driver.wait_for(early_error, 60.0, "early object after saving")
    with driver.in_viewport():
        bpy.ops.object.mode_set(mode="SCULPT")
    yield from driver.wait_for(lambda: early_error() is None, 1.0, "end of the early object in Sculpt Mode")
    with driver.in_viewport():
        bpy.ops.object.mode_set(mode="OBJECT")
    yield from driver.wait_for(early_error, 60.0, "early object back in Object Mode")
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})


def test_the_early_object_becomes_the_result_in_one_undo_step():
    """Also where undo steps of the user's were made while it was there."""
    sheet = yield from driver.start_job(60, iterations=8, preview_kind="OBJECT")
    yield from driver.wait_for(early_error, 120.0, "early object")
    with driver.in_viewport():
        sheet.location.x = 1.0
        bpy.ops.ed.undo_push(message="moved")
    yield from driver.wait_for(lambda: driver.running() is None, 240.0, "result")
    yield 0.3
    assert early_error() is None
    assert {each.name for each in bpy.data.objects} == {"Creased", driver.RESULT}
    assert bpy.data.objects[driver.RESULT].matrix_world.translation.x == 1.0
    for undo, left in ((bpy.ops.ed.undo, {"Creased"}), (bpy.ops.ed.redo, {"Creased", driver.RESULT})):
        with driver.in_viewport():
            undo()
        yield 0.3
        assert {each.name for each in bpy.data.objects} == left
        assert len(bpy.data.meshes) == len(left)
        assert early_error() is None
        assert bpy.data.objects["Creased"].location.x == 1.0
    assert bpy.data.objects[driver.RESULT]["sparse_surface"]["patches"] > 20


def test_an_object_is_shown_where_blender_draws_quickly(monkeypatch):
    """And no longer where it turns out to be slow."""
    preview = driver.module("operators.preview.controller")
    for name, value in (("REST", 0.0), ("QUICK", 1000.0), ("SLOW", 1000.0), ("draws_by_software", lambda: False)):
        monkeypatch(preview, name, value)
    yield from driver.start_job(240, iterations=60)
    yield from driver.wait_for(driver.drawn_objects, 120.0, "drawing")
    yield from driver.wait_for(early_error, 60.0, "early object")
    assert not driver.drawn_objects()
    preview.QUICK = preview.SLOW = 0.0
    yield from driver.wait_for(lambda: early_error() is None, 60.0, "end of the early object")
    yield from driver.wait_for(driver.drawn_objects, 60.0, "drawing again")
    driver.press("ESC")
    yield from driver.assert_nothing_left({"Creased"})


if __name__ == "__main__":
    driver.run(*(value for name, value in list(globals().items()) if name.startswith("test_")))
