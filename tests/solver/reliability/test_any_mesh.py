"""Whatever the mesh: a sound result or one clear sentence."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import generated
import many_meshes
import numpy as np
import pytest
import soundness
from generated import DAMAGES, SHAPES, Mesh
from hypothesis import given, settings
from hypothesis import strategies as st
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, approximate

QUICK = Settings(workers=1, iterations=2, sweeps=0, degree=8)
CHECKOUT = Path(__file__).resolve().parents[3]


def result_of(vertices: Any, faces: Any, settings: Settings = QUICK) -> Any:
    kind, result = soundness.approximated(vertices, faces, settings)
    assert kind == soundness.RESULT, result
    return result


def grid(rows: int, columns: int) -> tuple[Any, list[list[int]]]:
    u, v = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    vertices = np.stack([u, v, 0.2 * np.abs(u + 0.3 * v - 0.6)], axis=-1).reshape(-1, 3)
    return vertices, generated._quads(rows, columns)


# ---------------------------------------------------------------------------------------------------- generated meshes


@given(
    st.sampled_from(range(len(SHAPES))),
    st.lists(st.sampled_from(range(len(DAMAGES))), max_size=4, unique=True).map(sorted),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=25)
def test_any_shape_with_any_damage(shape: int, damages: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    name, make = SHAPES[shape]
    mesh = Mesh(*make(rng), name)
    for number in damages:
        mesh = generated.damaged(mesh, number, rng)
    chosen = generated.generated_settings(rng, len(mesh.vertices))
    soundness.approximated(mesh.vertices, mesh.faces, chosen)


@pytest.mark.parametrize("number", range(len(DAMAGES)), ids=[name for name, _ in DAMAGES])
def test_every_damage_to_a_sheet(number: int) -> None:
    vertices, faces = grid(7, 6)
    mesh = generated.damaged(Mesh(vertices, faces, "sheet"), number, np.random.default_rng(number))
    soundness.approximated(mesh.vertices, mesh.faces, QUICK)


@pytest.mark.parametrize("number", range(len(SHAPES)), ids=[name for name, _ in SHAPES])
def test_every_shape(number: int) -> None:
    result_of(*SHAPES[number][1](np.random.default_rng(number)))


def test_a_generated_mesh_is_known_by_its_number() -> None:
    one, other = generated.case(7), generated.case(7)
    assert one.settings == other.settings
    assert one.mesh.story == other.mesh.story
    np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)
    assert len({generated.case(seed).mesh.story for seed in range(40)}) > 20


@pytest.mark.long
def test_more_than_ten_thousand_meshes() -> None:
    """The outcome in one line goes to out/reliability.txt; docs/reliability.md quotes it."""
    outcomes, line = many_meshes.run(0, int(os.environ.get("MESHES", "12000")), 2)
    folder = CHECKOUT / "out"
    folder.mkdir(exist_ok=True)
    (folder / "reliability.txt").write_text(line + "\n", encoding="utf-8")
    print(line)
    assert not [outcome for outcome in outcomes if outcome.kind == many_meshes.FAILURE]


# ------------------------------------------------------------------------------------------------------- named meshes


def test_a_tetrahedron_passes_or_is_fitted() -> None:
    result = result_of(*models.tetrahedron())
    assert result.report["relative"]["vertex_max"] < 0.2


def test_one_triangle() -> None:
    result_of(np.eye(3), [[0, 1, 2]])


def test_the_cube_of_98_vertices() -> None:
    report = result_of(*models.cube98(), Settings(workers=1)).report
    assert report["relative"]["surface_max"] < 0.1
    assert report["flipped_triangles"] == 0


@pytest.mark.parametrize("ring", [1, 7, 50])
def test_a_tube_thinner_than_a_ring(ring: int) -> None:
    report = result_of(*models.tube(6, 40), Settings(workers=1, iterations=2, sweeps=0, ring=ring)).report
    assert report["relative"]["surface_max"] < 0.05


@pytest.mark.parametrize("ring", [2, 7, 50])
def test_a_torus_whose_patches_are_no_disks(ring: int) -> None:
    report = result_of(*models.thin_torus(6, 40), Settings(workers=1, iterations=2, sweeps=0, ring=ring)).report
    assert report["relative"]["surface_max"] < 0.05


@pytest.mark.parametrize("model", [models.moebius(30, 5), models.klein_bottle(24, 10)], ids=["moebius", "klein bottle"])
def test_surfaces_with_one_side(model: Any) -> None:
    report = result_of(*model).report
    assert report["relative"]["surface_max"] < 0.05
    assert report["passed_through_vertices"] < 0.2 * len(model[0])


def test_a_pole_of_two_thousand_triangles() -> None:
    result_of(*models.pole(2000, 2), Settings(workers=1, iterations=1, sweeps=0, degree=5))


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_coordinates_of_any_size(scale: float) -> None:
    vertices, faces = grid(12, 12)
    one = result_of(vertices, faces).report["relative"]
    other = result_of(vertices * scale, faces).report["relative"]
    assert other["surface_rms"] == pytest.approx(one["surface_rms"], rel=0.05, abs=1e-9)


def test_a_mesh_far_from_the_origin_in_single_precision() -> None:
    vertices, faces = grid(12, 12)
    result_of((vertices + np.array([1e6, -1e6, 1e3])).astype(np.float32), faces)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_coordinate_that_is_no_number(value: float) -> None:
    vertices, faces = grid(4, 4)
    vertices[5, 1] = value
    kind, text = soundness.approximated(vertices, faces, QUICK)
    assert (kind, "Vertex 5" in str(text)) == (soundness.REFUSAL, True)


def test_a_polygon_of_two_thousand_corners() -> None:
    angle = np.arange(2000) * 2 * np.pi / 2000
    vertices = np.column_stack([np.cos(angle), np.sin(angle) * (1 + 0.3 * np.cos(9 * angle)), 0 * angle])
    result_of(vertices, [list(range(2000))])


def test_holes_in_polygons_stay_open() -> None:
    """A square with a square hole, as one polygon that walks over a bridge: the surface's area is that of the frame."""
    outer = np.array([[0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0]], dtype=float)
    inner = np.array([[1, 1, 0], [1, 2, 0], [2, 2, 0], [2, 1, 0]], dtype=float)
    result = result_of(np.vstack([outer, inner]), [[0, 1, 2, 3, 0, 4, 5, 6, 7, 4]])
    used = result.representation.vertices[result.representation.triangles]
    area = 0.5 * np.linalg.norm(np.cross(used[:, 1] - used[:, 0], used[:, 2] - used[:, 0]), axis=1).sum()
    assert area == pytest.approx(8.0)


@pytest.mark.parametrize("held_together", [True, False])
def test_a_mesh_that_is_not_welded_stays_as_it_is_at_its_seams(held_together: bool) -> None:
    """Each face has vertices of its own, as STL files have them: nothing moves apart, and the report counts them."""
    vertices, faces = grid(8, 8)
    corners = np.concatenate(faces)
    settings = Settings(workers=1) if held_together else Settings(workers=1, merge_vertices=False)
    result = result_of(vertices[corners], np.arange(len(corners)).reshape(-1, 4), settings)
    assert result.report["input"]["components"] == (1 if held_together else len(faces))
    for vertex in range(len(vertices)):
        copies = result.vertices[corners == vertex]
        assert np.ptp(copies, axis=0).max() < (1e-12 if held_together else 1e-2)


def test_refusals_change_nothing_and_name_what_is_wrong() -> None:
    vertices, faces = grid(4, 4)
    for wrong, words in (([[0, 1]], "fewer than three"), ([], "no faces"), ([[0, 1, 99]], "vertex 99")):
        kind, text = soundness.approximated(vertices, wrong, QUICK)
        assert kind == soundness.REFUSAL
        assert words in str(text)
    kind, text = soundness.approximated(vertices * [1, 0, 0], faces, QUICK)
    assert kind == soundness.REFUSAL
    assert "area" in str(text)


@pytest.mark.parametrize("name", ["teapot.obj", "beetle.obj"])
@pytest.mark.long
def test_downloaded_models(load_model: Callable[[str], Any], name: str) -> None:
    vertices, faces = load_model(name)
    result_of(vertices, faces, Settings(workers=2, iterations=4))


@pytest.mark.long
def test_two_hundred_thousand_vertices() -> None:
    vertices, faces = models.creased_terrain(200_000)
    result = approximate(vertices, faces, Settings(workers=2, iterations=4, sweeps=0))
    assert np.isfinite(result.vertices).all()
    assert result.report["relative"]["surface_max"] < 0.02
