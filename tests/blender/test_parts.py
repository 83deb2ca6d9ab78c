"""Selected objects that share a border are one surface: it stays closed, and each object gets its own part."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ext.user_default.sparse_surface.operators.heat_map.scale import create_coloured
from bl_ext.user_default.sparse_surface.operators.preview import controller
from bl_ext.user_default.sparse_surface.operators.preview import object as early_object
from bl_ext.user_default.sparse_surface.operators.run.control import Run
from bl_ext.user_default.sparse_surface.operators.run.operator import read_sources
from bl_ext.user_default.sparse_surface.solver.settings import Settings
from mathutils import Matrix

sys.path.insert(0, str(Path(__file__).parent))
import scenes

QUICK = Settings(iterations=3, sweeps=0, workers=1)


def cube_in_six(size: int = 6) -> list[Any]:
    """Return a cube as a person cuts it: subdivided, its sides separated; then bent, and all selected."""
    bpy.ops.mesh.primitive_cube_add(size=2.0, location=(3.0, 1.0, 0.5), rotation=(0.3, 0.2, 0.1))
    cube = bpy.context.object
    before = set(bpy.data.objects) - {cube}
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=size)
    bpy.ops.object.mode_set(mode="OBJECT")
    for axis, side in [(axis, side) for axis in range(3) for side in (-1.0, 1.0)][:-1]:
        separate(cube, [abs(face.center[axis] - side) < 1e-4 for face in cube.data.polygons])
    parts = sorted((each for each in bpy.data.objects if each not in before), key=lambda each: each.name)
    assert [len(each.data.polygons) for each in parts] == 6 * [(size + 1) ** 2]
    for each in parts:
        flat = scenes.positions(each.data)
        each.data.vertices.foreach_set("co", (flat + 0.2 * np.sin(3.0 * flat[:, [1, 2, 0]])).ravel())
        each.data.update()
    scenes.select(*parts)
    return parts


def separate(cut: Any, faces: list[bool]) -> None:
    """Make an object of its own of some faces of the active object."""
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    cut.data.polygons.foreach_set("select", faces)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.separate(type="SELECTED")
    bpy.ops.object.mode_set(mode="OBJECT")


def open_edges(objects: list[Any]) -> int:
    """Number of edges that have other than two faces, counted by where they are in the world."""
    count: Counter[tuple[bytes, ...]] = Counter()
    for each in objects:
        # to 1e-5: the objects' positions in the world are rounded one by one
        places = [place.tobytes() for place in np.round(scenes.world_positions(each), 5) + 0.0]
        for face in each.data.polygons:
            count.update(tuple(sorted((places[a], places[b]))) for a, b in face.edge_keys)
    return sum(times != 2 for times in count.values())


def local_open_edges(objects: list[Any]) -> int:
    """The same by their local positions, to the last bit: all stand in one frame."""
    count: Counter[tuple[bytes, ...]] = Counter()
    for each in objects:
        places = [place.tobytes() for place in scenes.positions(each.data) + 0.0]
        for face in each.data.polygons:
            count.update(tuple(sorted((places[a], places[b]))) for a, b in face.edge_keys)
    return sum(times != 2 for times in count.values())


def results() -> list[Any]:
    return sorted((each for each in bpy.data.objects if "sparse_surface" in each), key=lambda each: each.name)


def test_a_cube_in_six_objects_stays_closed() -> None:
    parts = cube_in_six()
    assert local_open_edges(parts) == 0
    scenes.approximate(sweeps=1, iterations=10)
    made = results()
    assert [each.name for each in made] == [f"{each.name} Sparse Surface" for each in parts]
    assert sorted(each.name for each in bpy.context.selected_objects) == [each.name for each in made]
    assert local_open_edges(made) == 0
    for part, each in zip(parts, made, strict=True):
        assert len(each.data.vertices) == len(part.data.vertices)
        assert not part.visible_get()
        assert each.visible_get()
        report = each["sparse_surface"].to_dict()
        assert report["input"]["parts"] == [other.name for other in parts]
        assert report["input"]["faces"] == 6 * len(part.data.polygons)
        away = np.linalg.norm(scenes.world_positions(each) - scenes.world_positions(part), axis=1)
        assert scenes.values(each.data, "error") == pytest.approx(away, abs=2e-6)
    assert len({tuple(each["error_color_range"]) for each in made}) == 1


def test_functions_are_those_of_the_whole_and_no_parts() -> None:
    cube_in_six()
    made = scenes.approximate()
    assert "sparse_surface_representation" not in made
    with pytest.raises(RuntimeError, match="Join its sources"):
        bpy.ops.sparse_surface.inspect_patch()
    with pytest.raises(RuntimeError, match="Join its sources"):
        bpy.ops.sparse_surface.separate_patches()


def resampled() -> list[Any]:
    found = [each for each in bpy.data.objects if each.get("sparse_surface_role") == "resampled"]
    return sorted(found, key=lambda each: each.name)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 0.5, 1.0)])
def test_one_part_is_resampled_with_the_others_and_stays_closed(scale: tuple[float, ...]) -> None:
    parts = cube_in_six()
    for part in parts:
        part.scale = scale
    scenes.approximate(sweeps=1, iterations=10)
    made = results()
    scenes.select(made[2])
    assert bpy.ops.sparse_surface.resample(splits=3) == {"FINISHED"}
    fine = resampled()
    assert bpy.context.object["sparse_surface_source"] == made[2]["sparse_surface_id"]
    assert [len(each.data.polygons) for each in fine] == [9 * len(each.data.polygons) for each in made]
    assert local_open_edges(fine) == 0
    assert all(each.visible_get() for each in fine)
    assert not any(each.visible_get() for each in made)
    for each, coarse in zip(fine, made, strict=True):  # the vertices that both have are where they were
        count = len(coarse.data.vertices)
        assert scenes.positions(each.data)[:count] == pytest.approx(scenes.positions(coarse.data), abs=1e-5)
        assert np.array(each.matrix_world) == pytest.approx(np.array(coarse.matrix_world), abs=1e-6)
    # what was resampled is resampled again, with all others, in place of what there was
    scenes.select(fine[4])
    bpy.context.scene.sparse_surface.replace_result = True
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    assert resampled() == fine
    assert [len(each.data.polygons) for each in fine] == [4 * len(each.data.polygons) for each in made]
    assert local_open_edges(fine) == 0


def test_parts_that_were_moved_together_stay_closed_when_resampled() -> None:
    halves_of_a_ball()
    scenes.approximate()
    made = results()
    for each in made:
        each.matrix_world = Matrix.Translation((3.0, 1.0, -2.0)) @ Matrix.Rotation(0.7, 4, "Y") @ each.matrix_world
        each.scale = (1.5, 1.5, 1.5)
    scenes.select(*made)
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    before = [scenes.positions(each.data) for each in made]
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    assert local_open_edges(resampled()) == 0
    for each, coarse in zip(resampled(), before, strict=True):
        assert scenes.positions(each.data)[: len(coarse)] == pytest.approx(coarse, abs=2e-5)


def test_a_part_is_resampled_beside_others_that_are_gone_hidden_or_edited(capfd: pytest.CaptureFixture[str]) -> None:
    cube_in_six()
    scenes.approximate()
    made = results()
    bpy.data.objects.remove(made[0])
    made[1].hide_set(True)
    bpy.ops.object.select_all(action="DESELECT")
    made[2].data.vertices[5].co.x += 1.0
    made[3].location.x += 5.0
    scenes.select(made[4])
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    assert [each["sparse_surface_source"] for each in resampled()] == [made[n]["sparse_surface_id"] for n in (4, 5)]
    assert "1 other parts of the surface were edited" in capfd.readouterr().out
    assert made[2].visible_get()
    scenes.select(made[2])
    with pytest.raises(RuntimeError, match="was edited"):
        bpy.ops.sparse_surface.resample(splits=2)
    scenes.select(made[3])
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    assert len(resampled()) == 3


def test_functions_of_parts_are_kept_once_saved_and_forgotten(tmp_path: Path) -> None:
    cube_in_six()
    scenes.approximate(replace_result=True)
    made = results()
    (holder,) = {each["sparse_surface_shared"] for each in made}
    assert holder.users == 6
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "parts.blend"))
    assert "sparse_surface_draft" not in holder
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "parts.blend"))
    made = results()
    scenes.select(made[0])
    assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    assert local_open_edges(resampled()) == 0
    for each in made:
        each.hide_set(False)
    scenes.select(*made)
    scenes.approximate(merge_vertices=False, replace_result=True)
    assert not any("sparse_surface_shared" in each or "sparse_surface_part" in each for each in made)
    assert not [each for each in bpy.data.meshes if "sparse_surface_representation" in each]


def test_what_is_stored_with_a_part_may_be_anything() -> None:
    cube_in_six()
    scenes.approximate()
    made = results()
    for forged in (7, "x", [1e30, 0.0], [-1.0, 0.0], [0.0, 99.0], [float("nan"), 0.0], [200.0, 0.0]):
        made[1]["sparse_surface_part"] = forged
        scenes.select(made[1])
        with pytest.raises(RuntimeError, match="was edited"):
            bpy.ops.sparse_surface.resample(splits=2)
    made[1]["sparse_surface_shared"] = "no mesh"
    with pytest.raises(RuntimeError, match="Join its sources"):
        bpy.ops.sparse_surface.resample(splits=2)


def joined_again(active: Any, others: list[Any], merge: bool) -> Any:
    """Join objects as Ctrl J does, after showing them, and weld them if asked."""
    for each in (active, *others):
        each.hide_set(False)
    scenes.select(*others, active)
    bpy.ops.object.join()
    if merge:
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.mesh.remove_doubles()
        bpy.ops.object.mode_set(mode="OBJECT")
    return active


@pytest.mark.parametrize("merge", [False, True])
@pytest.mark.parametrize("settings", [{}, {"merge_vertices": False}, {"source_shown": "BESIDE"}])
def test_results_of_joined_sources_lie_in_no_new_one(merge: bool, settings: dict[str, Any]) -> None:
    """The one whose source is gone stayed visible inside the new one."""
    sources = halves_of_a_ball()
    scenes.approximate(replace_result=True, **settings)
    before = results()
    scenes.select(before[1])
    if not settings:
        assert bpy.ops.sparse_surface.resample(splits=2) == {"FINISHED"}
    scenes.select(joined_again(sources[0], sources[1:], merge))
    made = scenes.approximate()
    assert made == before[0]
    shown = [each for each in bpy.data.objects if each.type == "MESH" and each.visible_get() and each not in sources]
    assert shown == [made]
    assert before[1].hide_render


def test_results_of_sources_joined_into_another_object_are_hidden() -> None:
    sources = halves_of_a_ball()
    scenes.approximate()
    before = results()
    scenes.mesh_object("Bag", [(9.0, 9.0, 9.0), (9.0, 9.5, 9.0), (9.5, 9.0, 9.0)], [(0, 1, 2)])
    bag = bpy.context.object
    bag.matrix_world = Matrix.Translation((1.0, 2.0, 3.0)) @ Matrix.Rotation(0.4, 4, "X")
    scenes.select(joined_again(bag, sources, False))
    made = scenes.approximate()
    assert [each.visible_get() for each in (*before, made)] == [False, False, True]


def test_results_of_sources_that_are_gone_stay_where_nothing_lies_over_them() -> None:
    halves_of_a_ball()
    scenes.approximate()
    before = results()
    for each in (bpy.data.objects[name] for name in before[0]["sparse_surface"]["input"]["parts"]):
        bpy.data.objects.remove(each)
    scenes.creased_sheet()
    scenes.approximate()
    assert all(each.visible_get() for each in before)
    # a smaller ball inside, and a larger one around
    for radius in (0.9, 1.1):
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4, radius=radius)
        scenes.approximate()
        assert all(each.visible_get() for each in before)


def test_they_stay_where_all_is_to_be_seen() -> None:
    sources = halves_of_a_ball()
    scenes.approximate(source_shown="SHOWN")
    before = results()
    scenes.select(joined_again(sources[0], sources[1:], True))
    scenes.approximate()
    assert all(each.visible_get() for each in before)


def test_each_is_a_surface_of_its_own_where_vertices_are_not_merged() -> None:
    cube_in_six()
    scenes.approximate(merge_vertices=False)
    assert len({each["sparse_surface"]["patches"] for each in results()}) == 1
    assert all("sparse_surface_representation" in each for each in results())
    assert all("parts" not in each["sparse_surface"]["input"] for each in results())


def test_results_are_solved_again_together_and_replaced() -> None:
    parts = cube_in_six()
    scenes.approximate(merge_vertices=False, replace_result=True)
    before = results()
    assert local_open_edges(before) > 0
    scenes.select(*before)
    scenes.approximate(merge_vertices=True, replace_result=True)
    assert results() == before
    assert local_open_edges(before) == 0
    assert not any("sparse_surface_representation" in each for each in before)
    assert not any(part.visible_get() for part in parts)


def halves_of_a_ball() -> list[Any]:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4, radius=1.0)
    ball = bpy.context.object
    separate(ball, [face.center.z > 0.0 for face in ball.data.polygons])
    return sorted(bpy.context.selected_objects, key=lambda each: each.name)


def test_one_part_runs_again_with_the_others() -> None:
    """Run by itself its border came apart from theirs, and nothing said so."""
    halves_of_a_ball()
    scenes.approximate(replace_result=True)
    made = results()
    scenes.select(made[1])
    bpy.context.scene.sparse_surface.degree = 6
    assert bpy.ops.sparse_surface.run_again() == {"FINISHED"}
    assert results() == made
    assert local_open_edges(made) == 0
    assert all(len(each["sparse_surface"]["input"]["parts"]) == 2 for each in made)


def test_one_part_whose_others_are_hidden_says_so(capfd: pytest.CaptureFixture[str]) -> None:
    halves_of_a_ball()
    scenes.approximate(replace_result=True)
    made = results()
    made[0].hide_set(True)
    scenes.select(made[1])
    assert bpy.ops.sparse_surface.run_again() == {"FINISHED"}
    assert "1 other parts of the surface are hidden" in capfd.readouterr().out
    assert "parts" in made[0]["sparse_surface"]["input"]
    assert "parts" not in made[1]["sparse_surface"]["input"]


@pytest.mark.parametrize("chosen", ["one", "both", "with their sources"])
@pytest.mark.parametrize("gesture", ["inspect_patch", "separate_patches", "domains_to_uv"])
def test_gestures_that_need_functions_say_what_to_do(chosen: str, gesture: str) -> None:
    sources = halves_of_a_ball()
    scenes.approximate()
    made = results()
    scenes.select(*{"one": made[:1], "both": made, "with their sources": [*sources, *made]}[chosen])
    bpy.context.view_layer.objects.active = made[0]
    with pytest.raises(RuntimeError, match="Join its sources"):
        getattr(bpy.ops.sparse_surface, gesture)()


def test_joined_sources_keep_functions() -> None:
    """What the refusal says leads to a surface that can be resampled, inspected and taken apart."""
    sources = halves_of_a_ball()
    scenes.approximate()
    for each in sources:
        each.hide_set(False)
    scenes.select(*sources)
    bpy.context.view_layer.objects.active = sources[0]
    bpy.ops.object.join()
    made = scenes.approximate()
    assert made["sparse_surface"]["input"]["merged_vertices"] > 0
    for gesture in ("inspect_patch", "separate_patches", "resample"):
        scenes.select(made)
        assert getattr(bpy.ops.sparse_surface, gesture)() == {"FINISHED"}
    assert local_open_edges([bpy.context.object]) == 0


def test_halves_of_a_ball_are_one_and_a_ball_elsewhere_is_another() -> None:
    halves = halves_of_a_ball()
    assert len(halves) == 2
    assert all(len(half.data.polygons) for half in halves)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, location=(5.0, 0.0, 0.0))
    other = bpy.context.object
    scenes.select(other, *halves)
    scenes.approximate()
    assert len(results()) == 3
    alone = [each for each in results() if "parts" not in each["sparse_surface"]["input"]]
    assert [each.name for each in alone] == [f"{other.name} Sparse Surface"]
    assert "sparse_surface_representation" in alone[0]
    assert local_open_edges([each for each in results() if each not in alone]) == 0


def test_parts_stand_beside_their_sources_together() -> None:
    parts = cube_in_six()
    scenes.approximate(source_shown="BESIDE")
    moved = [
        np.array(each.matrix_world.translation) - np.array(part.matrix_world.translation)
        for part, each in zip(parts, results(), strict=True)
    ]
    assert np.ptp(moved, axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert moved[0][0] > 2.0
    assert open_edges(results()) == 0
    assert all(each.visible_get() for each in [*parts, *results()])


def test_one_part_that_cannot_be_solved_does_not_stop_the_others() -> None:
    parts = cube_in_six()
    parts[2].data.vertices[0].co.x = float("nan")
    scenes.approximate()
    made = results()
    assert [each.name for each in made] == [f"{each.name} Sparse Surface" for each in parts if each != parts[2]]
    assert all(len(each["sparse_surface"]["input"]["parts"]) == 5 for each in made)


def test_undo_takes_all_parts_away_in_one_step(run_bpy: Any) -> None:
    done = run_bpy(
        f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import scenes
scenes.enable_extension()
import bpy
from test_parts import cube_in_six, results
bpy.context.preferences.edit.use_global_undo = True
names = [part.name for part in cube_in_six()]
bpy.ops.ed.undo_push(message="before")
scenes.hurry()
bpy.ops.sparse_surface.approximate("EXEC_DEFAULT", True)
print("made", len(results()))
bpy.ops.ed.undo()
print("left", len(results()), all(bpy.data.objects[name].visible_get() for name in names), flush=True)
import os
os._exit(0)
"""
    )
    found = [line for line in done.stdout.splitlines() if line.startswith(("made", "left"))]
    assert found == ["made 6", "left 0 True"], done.stdout + done.stderr


@pytest.fixture
def run() -> Iterator[Run]:
    """A run on the parts of a cube, as the button starts it."""
    sources, refusals = read_sources(bpy.context, cube_in_six(12), together=QUICK)
    assert len(sources) == 1
    assert not refusals
    run = Run([(sources[0], Settings(iterations=200, workers=1, solver="numpy"))])
    yield run
    run.stop()


def begun(run: Run) -> None:
    end = time.monotonic() + 60.0
    while run.progress is None or run.progress.fraction == 0.0:
        assert time.monotonic() < end
        run.advance()
        time.sleep(0.01)


def test_a_part_that_is_deleted_ends_the_run_for_all(run: Run) -> None:
    begun(run)
    parts = [part.name for part in run.tasks[0][0].parts]
    bpy.data.objects.remove(bpy.data.objects[parts[1]])
    run.advance()
    assert run.done
    assert not run.results
    assert f"'{parts[1]}' was deleted" in run.dropped[0]
    assert run.dropped[1].endswith(": " + ", ".join(parts[:1] + parts[2:]))


def test_what_is_solved_together_can_be_cancelled(run: Run) -> None:
    begun(run)
    assert run.current_source is run.tasks[0][0]
    run.stop()
    assert run.done
    assert not run.results
    assert not run.dropped


def test_the_result_of_a_child_comes_back_part_by_part() -> None:
    parts = cube_in_six()
    (source,), _ = read_sources(bpy.context, parts, together=QUICK)
    run = Run([(source, QUICK)])
    end = time.monotonic() + 60.0
    while not run.done:
        assert time.monotonic() < end
        run.advance()
        time.sleep(0.01)
    refusals: list[str] = []
    (solved,) = run.results
    made = create_coloured(bpy.context, *solved, refusals, replace=False)
    assert not refusals
    assert not run.refusals
    assert [each.name for each in made] == [f"{part.name} Sparse Surface" for part in parts]
    assert local_open_edges(made) == 0
    bpy.data.objects.remove(parts[0])
    assert create_coloured(bpy.context, *solved, refusals, replace=True) == made[1:]
    assert len(refusals) == 1
    assert "was deleted" in refusals[0]


def test_parts_are_solved_one_by_one_where_together_they_fail(run: Run) -> None:
    begun(run)
    run.stop()

    class Failed:
        outcome, failure = None, "There is not enough memory for this mesh."

    run._take_result(Failed())
    assert [source.name for source, _ in run.tasks[1:]] == [part.name for part in run.tasks[0][0].parts]
    assert not run.refusals
    assert not run.done


def test_each_part_has_its_preview(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(controller, "draws_by_software", lambda: False)
    parts = cube_in_six()
    (source,), _ = read_sources(bpy.context, parts, together=QUICK)
    preview = controller.LivePreview("OBJECT")
    try:
        preview.take(source, source.arrays.vertices.astype(float) * 1.5)
        assert preview.update(bpy.context)
        for part in parts:
            early = early_object.find(part.session_uid)
            assert scenes.positions(early.data) == pytest.approx(1.5 * scenes.positions(part.data), abs=1e-6)
    finally:
        preview.clear()
    assert not any(early_object.find(part.session_uid) for part in parts)
