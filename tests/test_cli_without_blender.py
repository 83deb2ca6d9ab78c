"""The command line where bpy is not installed: what works, and one sentence for what does not."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.operators.files.formats import PLAIN
from sparse_surface.solver import load

HIDE = (
    "import sys, importlib.util as u; plain = u.find_spec\n"
    "u.find_spec = lambda name, *rest: None if name in {hidden!r} else plain(name, *rest)\n"
    "from sparse_surface.command_line.main import main; sys.exit(main(sys.argv[1:]))"
)
PLACES = (0.0, 3.0, 7.0)
QUICK = ("--iterations", "2", "--sweeps", "0", "--workers", "1")


def run(*arguments: str | Path, hidden: tuple[str, ...] = ("bpy",)) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", HIDE.format(hidden=hidden), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def sheet(size: int = 10) -> tuple[np.ndarray, np.ndarray]:
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, size)], indexing="ij"))
    i = np.arange(size * size).reshape(size, size)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    return np.stack([x, y, 0.2 * np.sin(4.0 * x)], axis=1), quads


@pytest.fixture
def model(tmp_path: Path) -> Path:
    vertices, faces = sheet()
    np.savez(tmp_path / "model.npz", vertices=vertices, faces=faces)
    return tmp_path / "model.npz"


def test_arrays_need_nothing_else(model: Path, tmp_path: Path) -> None:
    out, report, rep = (tmp_path / name for name in ("out.npz", "report.json", "rep.npz"))
    done = run(
        *("approximate", model, "-o", out, "--report", report, "--representation", rep, *QUICK),
        hidden=("bpy", "meshio"),
    )
    assert done.returncode == 0, done.stderr
    with np.load(out) as stored:
        assert np.array_equal(stored["corners"].reshape(-1, 4), sheet()[1])
        away = np.linalg.norm(stored["vertices"] - sheet()[0].astype(np.float32), axis=1)
        assert np.allclose(stored["error"], away, atol=1e-6)
    assert json.loads(report.read_text())["vertex_error"]["max"] == pytest.approx(away.max(), abs=1e-6)
    fine = tmp_path / "fine.npz"
    assert run("evaluate", rep, "--resample", "2", "-o", fine, hidden=("bpy", "meshio")).returncode == 0
    with np.load(fine) as stored:
        assert len(stored["sizes"]) == 4 * 81
    listed = run("inspect", rep, hidden=("bpy", "meshio"))
    assert len(listed.stdout.splitlines()) == load(rep).patches


@pytest.mark.parametrize(
    ("ending", "library"),
    [
        *((ending, "meshio") for ending in (".ply", ".obj", ".stl", ".off", ".vtk", ".vtu")),
        (".dae", "collada"),
        (".3mf", "networkx"),
        (".vtp", "pyvista"),
    ],
)
def test_files_of_other_programs(model: Path, tmp_path: Path, ending: str, library: str) -> None:
    pytest.importorskip(library)
    first, second = tmp_path / f"first{ending}", tmp_path / f"second{ending}"
    done = run("approximate", model, "-o", first, *QUICK)
    assert done.returncode == 0, done.stderr
    done = run("approximate", first, "-o", second, *QUICK)
    assert done.returncode == 0, done.stderr
    assert "100 vertices" in done.stdout
    again = tmp_path / "again.npz"
    assert run("approximate", second, "-o", again, *QUICK).returncode == 0
    with np.load(again) as stored:
        assert len(stored["vertices"]) == 100
        assert len(stored["sizes"]) == (162 if ending in (".stl", ".off", ".dae", ".3mf") else 81)
        low, high = stored["vertices"].min(axis=0), stored["vertices"].max(axis=0)
    assert np.allclose([low, high], [sheet()[0].min(axis=0), sheet()[0].max(axis=0)], atol=2e-2)


@pytest.mark.parametrize(("ending", "library"), [("dae", "collada"), ("3mf", "networkx")])
def test_all_meshes_of_a_scene_are_read_where_they_stand(tmp_path: Path, ending: str, library: str) -> None:
    pytest.importorskip(library)
    trimesh = pytest.importorskip("trimesh")
    vertices, quads = sheet(6)
    own = trimesh.Trimesh(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), process=False)
    path, out = tmp_path / f"scene.{ending}", tmp_path / "out.npz"
    if ending == "3mf":
        scene = trimesh.Scene()
        for place in PLACES:
            scene.add_geometry(own, transform=trimesh.transformations.translation_matrix([0.0, 0.0, place]))
        path.write_bytes(scene.export(file_type=ending))
    else:  # trimesh writes one mesh only
        head, begin, rest = own.export(file_type=ending).decode().partition("<node ")
        node, end, tail = rest.partition("</node>")
        attributes, _, inside = node.partition(">")
        moved = [f"{begin}{attributes}><translate>0 0 {place}</translate>{inside}{end}" for place in PLACES]
        path.write_text(head + "".join(moved) + tail)
    done = run("approximate", path, "-o", out, *QUICK)
    assert done.returncode == 0, done.stderr
    with np.load(out) as stored:
        assert len(stored["sizes"]) == 3 * 50
        heights = stored["vertices"][:, 2]
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    for place in PLACES:
        level = heights[np.abs(heights - place - (low + high) / 2.0) < 1.0]
        assert len(level) == 36
        assert level.min() == pytest.approx(place + low, abs=0.05)
        assert level.max() == pytest.approx(place + high, abs=0.05)


def test_values_of_a_vtk_polydata_file_stay(model: Path, tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    vertices, faces = sheet()
    mesh = pyvista.PolyData(vertices, np.insert(faces, 0, 4, axis=1).ravel())
    mesh.point_data["heat"] = np.arange(100.0)
    mesh.save(tmp_path / "field.vtp")
    assert run("approximate", tmp_path / "field.vtp", "-o", tmp_path / "out.vtp", *QUICK).returncode == 0
    found = pyvista.read(tmp_path / "out.vtp")
    assert np.array_equal(found.point_data["heat"], np.arange(100.0))
    assert np.allclose(found.point_data["error"], np.linalg.norm(found.points - vertices, axis=1), atol=1e-6)


def test_colours_of_a_ply_file_stay(model: Path, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    vertices, faces = sheet()
    red = np.arange(100, dtype=np.uint8)
    meshio.Mesh(vertices, [("quad", faces)], point_data={"red": red}).write(tmp_path / "scan.ply")
    out = tmp_path / "out.ply"
    assert run("approximate", tmp_path / "scan.ply", "-o", out, *QUICK).returncode == 0
    assert np.array_equal(meshio.read(out).point_data["red"], red)


@pytest.mark.parametrize(
    ("arguments", "hidden", "said"),
    [
        (("approximate", "scan.ply", "-o", "out.npz"), ("bpy", "meshio"), "pip install meshio"),
        (("approximate", "scan.3mf", "-o", "out.npz"), ("bpy", "lxml"), "trimesh and networkx and lxml; lxml is not"),
        (("approximate", "scan.dae", "-o", "out.npz"), ("trimesh", "collada"), "(pip install trimesh pycollada)."),
        (("approximate", "{model}", "-o", "{folder}/out.vtp"), ("bpy", "pyvista"), "pyvista is not installed"),
        (("approximate", "{folder}/text.xyz", "-o", "out.npz"), ("bpy",), ", ".join(PLAIN)),
        (
            ("approximate", "{model}", "-o", "{folder}/out.npz", "--heatmap", "{folder}/p.png"),
            ("bpy",),
            "needs Blender",
        ),
        (("approximate", "{folder}/none.npz", "-o", "{folder}/out.npz"), ("bpy",), "There is no file"),
        (("approximate", "{folder}/text.off", "-o", "{folder}/out.npz"), ("bpy",), "cannot be read"),
        (("approximate", "{folder}/text.npz", "-o", "{folder}/out.npz"), ("bpy",), "cannot be read"),
        (("compare", "{model}"), ("bpy",), "Blender"),
    ],
)
def test_refusals(model: Path, tmp_path: Path, arguments: tuple[str, ...], hidden: tuple[str, ...], said: str) -> None:
    for name in ("scan.ply", "scan.3mf", "scan.dae"):
        (tmp_path / name).write_text("ply\n")
    for name in ("text.off", "text.npz", "text.xyz"):
        (tmp_path / name).write_text("nothing of that kind\n")
    given = [word.format(model=model, folder=tmp_path) for word in arguments]
    given = [str(tmp_path / word) if word.startswith(("scan.", "out.")) else word for word in given]
    done = run(*given, hidden=hidden)
    assert done.returncode in (1, 2)
    (line,) = done.stderr.splitlines()
    assert said in line
    assert not (tmp_path / "out.npz").exists()


def test_what_a_library_complains_of_is_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    (tmp_path / "noise.vtp").write_bytes(bytes(range(256)))
    command = [
        sys.executable,
        "-m",
        "sparse_surface",
        "approximate",
        tmp_path / "noise.vtp",
        "-o",
        tmp_path / "out.npz",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "noise.vtp" in line
