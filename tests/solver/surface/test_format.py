"""Format 2: how small files are, how far their surfaces move, and what is found again rather than stored."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import (
    creased_terrain,
    cube,
    cylinder,
    flower,
    moebius,
    quads_of,
    tetrahedron,
)
from sparse_surface.solver import InputError, Representation, Settings, approximate
from sparse_surface.solver.surface import files
from sparse_surface.solver.surface.format import writing

QUICK = {"ring": 4, "degree": 8, "sparsity": 8, "iterations": 3, "sweeps": 1}
BOW_TIE = ([[0, 0, 0], [1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0.2]], [[0, 1, 2], [0, 3, 4]])


@cache
def whole_flower() -> Representation:
    return approximate(*flower(), Settings(creases="off")).representation


def places(surface: Representation, count: int = 20_000) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    rng = np.random.default_rng(11)
    return rng.integers(0, len(surface.triangles), count), rng.dirichlet([1.0, 1.0, 1.0], count)


def moved(one: Representation, other: Representation) -> float:
    """Largest distance between two surfaces at the same places, in longest sides."""
    at = places(one)
    distance = np.linalg.norm(one.evaluate(*at) - other.evaluate(*at), axis=1)
    return float(distance.max() / np.ptp(one.vertices, axis=0).max())


def test_files_are_small_and_their_surfaces_stay() -> None:
    surface = whole_flower()
    exact, compact = (Representation.from_bytes(data) for data in (surface.stored, surface.compact))
    assert len(surface.stored) <= 783_830 / 3  # a third of format 1
    assert len(surface.compact) <= 66_000
    assert moved(surface, exact) <= 5e-7
    assert moved(surface, compact) <= 1e-5
    side = np.ptp(surface.vertices, axis=0).max()
    np.testing.assert_array_equal(exact.vertices, surface.vertices)
    np.testing.assert_array_equal(compact.triangles, surface.triangles)
    assert np.abs(compact.vertices - surface.vertices).max() <= 2.6e-5 * side


def test_a_draft_is_the_same_to_the_last_bit_and_becomes_compact() -> None:
    surface = whole_flower()
    draft = Representation.from_bytes(surface.draft)
    for name in ("vertices", "domains", "coefficients", "origins", "scales", "weights"):
        ours, read = getattr(surface, name), getattr(draft, name)
        assert np.array_equal(np.sort(ours, axis=None), np.sort(read, axis=None)), name
    at = places(surface)
    np.testing.assert_array_equal(draft.evaluate(*at), surface.evaluate(*at))
    assert draft.compact == surface.compact


def test_functions_are_rounded_less_where_domains_cannot_make_up_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A surface whose rounded functions alone moved it too far kept all domains as they were: five times the bytes."""
    surface = whole_flower()
    usual = len(surface.compact)
    monkeypatch.setattr(writing, "FUNCTIONS_SHARES", (20.0, 0.6))
    data = files.to_bytes(surface, "compact")
    assert moved(surface, Representation.from_bytes(data)) <= 1e-5
    assert len(data) <= 1.3 * usual
    monkeypatch.setattr(writing, "FUNCTIONS_SHARES", (20.0,))
    assert len(files.to_bytes(surface, "compact")) > 1.5 * usual, "the first share was enough: this tests nothing"


def crushed() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A cylinder pressed flat with a third of its vertices at one place: many triangles have no area."""
    vertices, faces = cylinder()
    flat = vertices * [1.0, 1.0, 0.0]
    flat[::3] = flat[0]
    return flat, faces


def test_a_surface_that_is_cut_takes_no_more() -> None:
    surface = approximate(*flower()).representation
    assert len(surface.creases) > 0
    assert len(surface.compact) <= 55_000


MODELS = {
    "crushed": (crushed, {"creases": "off"}),
    "open": (lambda: creased_terrain(20), {}),
    "quads": (lambda: (creased_terrain(16)[0], quads_of(creased_terrain(16)[1])), {}),
    "closed": (cylinder, {"creases": "off"}),
    "one-sided": (lambda: moebius(40, 6), {}),
    "cut": (lambda: BOW_TIE, {}),
    "tiny": (tetrahedron, {}),
    "finer patches": (lambda: creased_terrain(24), {"tolerance": 0.01, "sweeps": 0}),
    "creases": (lambda: flower(), {}),
    "flat sides": (lambda: cube(7), {}),
    "uniform": (lambda: creased_terrain(20), {"blending": "uniform", "basis": "monomial"}),
    "separate": (lambda: creased_terrain(20), {"domains": "separate"}),
}

CREASED = {"creases", "flat sides"}
"""Those that are cut: what closes their creases is left to our own reader."""


@cache
def model(name: str) -> Representation:
    make, settings = MODELS[name]
    return approximate(*make(), Settings(**{**QUICK, **settings})).representation


@pytest.mark.parametrize("name", MODELS)
def test_all_kinds_of_meshes_keep_their_surfaces(name: str) -> None:
    surface = model(name)
    for data, limit in ((surface.stored, 5e-7), (surface.compact, 1e-5)):
        loaded = Representation.from_bytes(data)
        assert moved(surface, loaded) <= limit
        np.testing.assert_array_equal(loaded.face_corners, surface.face_corners)
        np.testing.assert_array_equal(loaded.polygon, surface.polygon)
        assert Representation.from_bytes(loaded.stored).stored == Representation.from_bytes(loaded.stored).stored


@pytest.mark.parametrize("name", ["open", "finer patches", "uniform"])
def test_weights_are_found_again(name: str) -> None:
    surface = model(name)
    loaded = Representation.from_bytes(surface.compact)
    np.testing.assert_array_equal(loaded.patch_vertices, surface.patch_vertices)
    np.testing.assert_allclose(loaded.weights, surface.weights, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("name", ["open", "creases", "flat sides", "separate"])
def test_initial_domains_are_found_again(name: str) -> None:
    surface = model(name)
    loaded = Representation.from_bytes(surface.stored)
    assert "initial_domains" not in vars(loaded)
    np.testing.assert_allclose(loaded.initial_domains, surface.initial_domains, atol=1e-6)


def test_other_qualities_are_refused() -> None:
    with pytest.raises(InputError, match="exact, compact, plain, draft, but not as 'best'"):
        model("open").save("nowhere.npz", quality="best")


EXAMPLE = Path(__file__).parents[3] / "examples" / "read_representation.py"


@cache
def reader() -> ModuleType:
    """The example that reads files with NumPy alone."""
    spec = importlib.util.spec_from_file_location("read_representation", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", [name for name in MODELS if name not in CREASED])
def test_another_reader_finds_the_same_surface(name: str, tmp_path: Path) -> None:
    """It shares no line with ours, and is written after docs/format.md."""
    surface, path = model(name), tmp_path / "plain.npz"
    surface.save(path, quality="plain")
    loaded, read = Representation.load(path), reader().read(path)
    at = places(surface, 400)
    points = reader().evaluate(read, *at)
    np.testing.assert_allclose(points, loaded.evaluate(*at), rtol=0.0, atol=1e-12)
    assert np.abs(points - surface.evaluate(*at)).max() <= 5e-7 * np.ptp(surface.vertices, axis=0).max()


def test_the_reader_is_short_needs_numpy_alone_and_writes_the_surface(tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 150
    path = tmp_path / "plain.npz"
    model("open").save(path, quality="plain")
    script = (
        f"import runpy, sys; sys.argv[1:] = [{str(path)!r}]; runpy.run_path({str(EXAMPLE)!r}, run_name='__main__');"
    )
    script += "print(sorted({'scipy', 'sparse_surface', 'sklearn'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    lines = path.with_suffix(".obj").read_text(encoding="ascii").splitlines()
    points = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    np.testing.assert_allclose(points, model("open").at_vertices(), atol=1e-6)
    model("open").save(path)
    done = subprocess.run([sys.executable, EXAMPLE, path], capture_output=True, text=True)
    assert done.returncode == 1
    assert "save it with quality='plain'" in done.stderr
