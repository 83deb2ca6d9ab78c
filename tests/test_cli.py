"""The command line as a process: what it writes, what it says, and its exit codes."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.operators.files import formats
from sparse_surface.solver import Settings, approximate, load
from sparse_surface.solver.surface.format.canonical import QUALITIES

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="the command line needs bpy")

# Errors in a line about a result: "rms 0.012 (6.0e-03 of the size), max 0.03 (1.5e-02)".
NUMBERS = re.compile(r"rms (\S+) \((\S+) of the size\), max (\S+) \((\S+)\)")
QUICK = ("--iterations", "2", "--sweeps", "0", "--workers", "1")


def run(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sparse_surface", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=cwd)


def sheet(size: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices, turned so that no axis is special, and quads of a folded sheet."""
    axis = np.linspace(-1.0, 1.0, size)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    z = 0.2 * np.abs(np.mod(2.0 * (0.8 * x + 0.6 * y), 2.0) - 1.0)
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    quads = np.stack([corner, corner + size, corner + size + 1, corner + 1], axis=1)
    return np.round(np.stack([x, 2.0 + y, z - 3.0], axis=1), 6), quads


def write_obj(path: Path, vertices: np.ndarray, faces: Sequence[Sequence[int]]) -> Path:
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*point) for point in vertices]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def read_obj(path: Path) -> tuple[np.ndarray, list[list[int]]]:
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([[float(word) for word in row[1:4]] for row in rows if row[:1] == ["v"]])
    faces = [[int(word.split("/")[0]) - 1 for word in row[1:]] for row in rows if row[:1] == ["f"]]
    return vertices, faces


def read_ply_header(path: Path) -> list[str]:
    return path.read_bytes().split(b"end_header")[0].decode().splitlines()


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write_obj(tmp_path / "model.obj", *sheet())


def test_approximate_writes_result_and_report(model: Path, tmp_path: Path) -> None:
    out, report_file = tmp_path / "out.obj", tmp_path / "report.json"
    done = run("approximate", model, "-o", out, "--report", report_file, *QUICK)
    assert done.returncode == 0, done.stderr
    report = json.loads(report_file.read_text())
    before, faces = sheet()
    after, written_faces = read_obj(out)
    assert written_faces == faces.tolist()
    distance = np.linalg.norm(after - before, axis=1)
    assert distance.max() == pytest.approx(report["vertex_error"]["max"], abs=3e-6)  # the file has six decimals
    assert np.sqrt((distance**2).mean()) == pytest.approx(report["vertex_error"]["rms"], rel=1e-3)
    assert 0.0 < report["relative"]["vertex_max"] < 0.05
    assert report["settings"]["iterations"] == 2
    said = next(line for line in done.stdout.splitlines() if NUMBERS.search(line))
    rms, rms_share, largest, largest_share = map(float, NUMBERS.search(said).groups())  # type: ignore[union-attr]
    assert (rms, largest) == pytest.approx([report["surface_error"][name] for name in ("rms", "max")], rel=5e-3)
    size = np.ptp(before, axis=0).max()
    assert (rms_share, largest_share) == pytest.approx((rms / size, largest / size), rel=1e-2)
    assert f"{len(before)} vertices" in said
    assert f"{report['patches']} patches" in said
    assert "100%" in done.stdout or "Solving patches" in done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.obj", "out.mtl", "out.obj", "report.json"]


@pytest.mark.parametrize("ending", [".obj", ".ply", ".stl", ".blend", ".glb", ".gltf", ".fbx", ".usdc", ".abc"])
def test_an_unmoved_vertex_comes_out_where_it_went_in(model: Path, tmp_path: Path, ending: str) -> None:
    """A whole round: file to file to .obj, with a sheet that the solver passes through (its only triangle pair)."""
    plane = np.array([[0, 2, -3], [1, 2, -3], [1, 3, -3.5], [0, 3, -3.5]])
    first = write_obj(tmp_path / "flat.obj", plane, [[0, 1, 2], [0, 2, 3]])
    middle, last = tmp_path / f"middle{ending}", tmp_path / "last.obj"
    assert run("approximate", first, "-o", middle, *QUICK).returncode == 0
    done = run("approximate", middle, "-o", last, *QUICK, *(["--object", "flat"] if ending == ".blend" else []))
    assert done.returncode == 0, done.stderr
    after, _ = read_obj(last)
    if ending in (".glb", ".gltf"):  # a format whose own axes are others: only the round trip can be compared
        assert sorted(map(tuple, np.round(after, 4))) == sorted(map(tuple, np.round(plane, 4)))
    else:
        assert np.allclose(after, plane, atol=1e-5)


def test_ply_keeps_vertices_without_faces_and_gets_the_error(tmp_path: Path) -> None:
    vertices, faces = sheet()
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices) + 2}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", "9 9 9"]
    lines += ["{:.6f} {:.6f} {:.6f}".format(*point) for point in vertices] + ["8 8 8"]
    lines += ["4 " + " ".join(str(corner + 1) for corner in face) for face in faces]
    source = tmp_path / "scan.ply"
    source.write_text("\n".join(lines) + "\n")
    out = tmp_path / "out.ply"
    done = run("approximate", source, "-o", out, *QUICK)
    assert done.returncode == 0, done.stderr
    header = read_ply_header(out)
    assert f"element vertex {len(vertices) + 2}" in header
    assert "property float error" in header
    assert "property uchar red" not in header
    assert run("approximate", source, "-o", out, "--error-colors", "add", *QUICK).returncode == 0
    assert "property uchar red" in read_ply_header(out)


def test_modifiers_of_a_blend_file_are_evaluated_and_the_result_joins_it(tmp_path: Path) -> None:
    made = tmp_path / "made.blend"
    script = (
        "import bpy, sys\n"
        "bpy.ops.wm.read_homefile(use_empty=True)\n"
        "bpy.ops.mesh.primitive_monkey_add()\n"
        "bpy.context.object.modifiers.new('S', 'SUBSURF').levels = 1\n"
        "bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])\n"
    )
    subprocess.run([sys.executable, "-c", script, str(made)], check=True, capture_output=True)
    out, report = tmp_path / "out.blend", tmp_path / "report.json"
    done = run("approximate", made, "-o", out, "--report", report, *QUICK)
    assert done.returncode == 0, done.stderr
    assert json.loads(report.read_text())["input"]["vertices"] > 1900
    look = (
        "import bpy, sys\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
        "made = bpy.data.objects['Suzanne Sparse Surface']\n"
        "print(sorted(o.name for o in bpy.data.objects), made['sparse_surface']['patches'])\n"
    )
    seen = subprocess.run([sys.executable, "-c", look, str(out)], check=True, capture_output=True, text=True)
    assert "['Suzanne', 'Suzanne Sparse Surface']" in seen.stdout


def test_marked_edges_of_a_blend_file_are_the_creases(tmp_path: Path) -> None:
    made, report = tmp_path / "made.blend", tmp_path / "report.json"
    script = (
        "import bpy, sys\n"
        "bpy.ops.wm.read_homefile(use_empty=True)\n"
        "bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=24)\n"
        "points = [v.co.z for v in bpy.context.object.data.vertices]\n"
        "for edge in bpy.context.object.data.edges:\n"
        "    edge.use_edge_sharp = all(abs(points[k]) < 1e-4 for k in edge.vertices)\n"
        "bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])\n"
    )
    subprocess.run([sys.executable, "-c", script, str(made)], check=True, capture_output=True)
    done = run("approximate", made, "--creases", "marked", "--report", report, *QUICK)
    assert done.returncode == 0, done.stderr
    assert json.loads(report.read_text())["creases"]["edges"] == 32
    plain = run("approximate", write_obj(tmp_path / "none.obj", *sheet()), "--creases", "marked", *QUICK)
    assert "no edge inside the mesh is marked as sharp" in plain.stdout


def test_presets_are_those_of_the_panel(model: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    done = run("approximate", model, "--preset", "fast", "--ring", "5", "--workers", "1", "--report", report)
    assert done.returncode == 0, done.stderr
    settings = json.loads(report.read_text())["settings"]
    assert (settings["iterations"], settings["sweeps"], settings["ring"]) == (6, 0, 5)


def noisy_sheet() -> tuple[np.ndarray, np.ndarray]:
    vertices, quads = sheet(40)
    return vertices + np.random.default_rng(8).normal(0.0, 0.008, vertices.shape), quads


def test_denoising_by_preset_strength_and_level(tmp_path: Path) -> None:
    source = write_obj(tmp_path / "scan.obj", *noisy_sheet())
    out, report_file = tmp_path / "out.obj", tmp_path / "report.json"
    files = ("-o", out, "--report", report_file, "--workers", "1")
    done = run("approximate", source, "--preset", "denoise", *files)
    assert done.returncode == 0, done.stderr
    report = json.loads(report_file.read_text())
    assert report["denoise"]["noise_level"] == pytest.approx(0.008, rel=0.15)
    assert "noise of 0.0" in done.stdout
    assert "patches" not in done.stdout.splitlines()[-1]
    clean, quads = sheet(40)
    (before, _), (after, faces) = noisy_sheet(), read_obj(out)
    assert faces == quads.tolist()
    off_plane = [np.std(points[:, 2] - clean[:, 2]) for points in (before, after)]
    assert off_plane[1] < 0.6 * off_plane[0]
    done = run("approximate", source, "--preset", "denoise", "--denoise-strength", "0.5", *files)
    assert json.loads(report_file.read_text())["denoise"]["noise_level"] == pytest.approx(
        0.5 * report["denoise"]["noise_level"]
    )
    done = run(
        "approximate", source, "--preset", "denoise", "--denoise", "first", "--noise-level", "0.01", *files, *QUICK
    )
    assert done.returncode == 0, done.stderr
    fitted = json.loads(report_file.read_text())
    assert fitted["denoise"]["noise_level"] == 0.01
    assert fitted["patches"] > 0
    assert f"fitted with {fitted['patches']} patches" in done.stdout


@pytest.mark.parametrize(
    ("content", "name", "words"),
    [
        (None, "absent.obj", "There is no file"),
        ("hello", "text.txt", "not a kind of file that can be read"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "points.obj", "no "),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "line.obj", "no area"),
        ("", "empty.obj", "no mesh"),
        ("ply\nformat ascii 1.0\nelement vertex 3\n", "cut.ply", "."),
        ("not a blend file", "broken.blend", "cannot be read"),
    ],
)
def test_refused_input(tmp_path: Path, content: str | None, name: str, words: str) -> None:
    source, out = tmp_path / name, tmp_path / "out.ply"
    if content is not None:
        source.write_text(content)
    done = run("approximate", source, "-o", out)
    assert done.returncode == 1, done.stdout + done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("sparse_surface: ")]
    assert len(said) == 1
    assert words in said[0]
    assert "Traceback" not in done.stderr
    assert not out.exists()


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("unknown",),
        ("approximate",),
        ("approximate", "{model}", "--ring", "many"),
        ("approximate", "{model}", "--ring", "0"),
        ("approximate", "{model}", "--method", "magic"),
        ("approximate", "{model}", "-o", "out.unknown"),
        ("approximate", "{model}", "-o", "no/such/folder/out.ply"),
        ("approximate", "{model}", "--heatmap", "out.txt"),
        ("approximate", "{model}", "-o", "{folder}"),
        ("approximate", "{model}", "--report", "{folder}"),
        ("approximate", "{model}", "--resample", "0"),
        ("approximate", "{model}", "--resample", "1.5"),
        ("evaluate", "{model}", "--resample", "0", "-o", "out.ply"),
        ("inspect", "{model}", "-o", "out.ply"),
        ("compare", "{model}", "--first", "fast", "--second", "fast"),
    ],
)
def test_wrong_usage(model: Path, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    done = run(*(argument.format(model=model, folder=tmp_path) for argument in arguments), cwd=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("sparse_surface")
    assert [path.name for path in tmp_path.iterdir()] == ["model.obj"]


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
def test_cancelled(tmp_path: Path) -> None:
    model = write_obj(tmp_path / "model.obj", *sheet(120))
    command = [sys.executable, "-m", "sparse_surface", "approximate", str(model), "-o", str(tmp_path / "out.ply")]
    # What a shell runs in the background ignores interrupts, and so would what it starts.
    heard = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, heard)
    assert process.stdout is not None
    for line in process.stdout:
        if "Solving patches" in line:
            break
    process.send_signal(signal.SIGINT)
    before = time.monotonic()
    _, complaints = process.communicate(timeout=30)
    assert process.returncode == 130, complaints
    assert time.monotonic() - before < 10.0
    assert "cancelled" in complaints
    assert [path.name for path in tmp_path.iterdir()] == ["model.obj"]


def test_an_older_output_is_kept_when_writing_fails(model: Path, tmp_path: Path) -> None:
    from sparse_surface.solver.atomic_files import atomic_output

    target = tmp_path / "old.json"
    target.write_text("old")

    def fail_in_the_middle() -> None:
        with atomic_output(target) as draft:
            draft.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk"):
        fail_in_the_middle()
    assert target.read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.obj", "old.json"]


def test_help_names_every_setting(tmp_path: Path) -> None:
    from sparse_surface.solver import Settings

    done = run("approximate", "--help")
    assert done.returncode == 0
    for name in Settings().as_dict():
        assert "--" + name.replace("_", "-") in done.stdout


def test_resampling_and_evaluating_a_saved_representation(model: Path, tmp_path: Path) -> None:
    rep, fine, again = tmp_path / "rep.npz", tmp_path / "fine.obj", tmp_path / "again.obj"
    done = run("approximate", model, "--representation", rep, "--resample", "3", "-o", fine, *QUICK)
    assert done.returncode == 0, done.stderr
    done = run("evaluate", rep, "--resample", "3", "-o", again)
    assert done.returncode == 0, done.stderr
    vertices, faces = read_obj(fine)
    assert len(faces) == 9 * 15 * 15
    assert {len(face) for face in faces} == {4}
    evaluated, same_faces = read_obj(again)
    assert same_faces == faces
    # results in a scene carry the compact form, in which the surface may move by 1e-5 of the longest side
    assert np.allclose(evaluated, vertices, atol=1e-5 * np.ptp(vertices, axis=0).max())


def test_a_saved_representation_is_as_exact_as_was_asked_for(tmp_path: Path) -> None:
    vertices, quads = sheet(12)
    faces = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    model, exact, compact = write_obj(tmp_path / "m.obj", vertices, faces), tmp_path / "e.npz", tmp_path / "c.npz"
    assert run("approximate", model, "--representation", exact, *QUICK).returncode == 0
    done = run("approximate", model, "--representation", compact, "--quality", "compact", *QUICK)
    assert done.returncode == 0, done.stderr
    settings = Settings(iterations=2, sweeps=0, workers=1)
    made = approximate(vertices.astype(np.float32), faces, settings).representation
    assert np.array_equal(load(exact).coefficients, made.coefficients)
    assert not np.array_equal(load(compact).coefficients, made.coefficients)
    moved = np.abs(load(compact).at_vertices() - made.at_vertices()).max()
    assert moved <= 1e-5 * np.ptp(vertices, axis=0).max()
    assert compact.stat().st_size < 0.75 * exact.stat().st_size
    assert set(QUALITIES) == set(formats.QUALITIES)
    assert run("approximate", model, "--quality", "fine").returncode == 2


def test_a_patch_can_be_looked_at(model: Path, tmp_path: Path) -> None:
    rep, listed, out = tmp_path / "rep.npz", tmp_path / "patch.json", tmp_path / "patch.blend"
    maps = tmp_path / "maps.obj"
    done = run("approximate", model, "--representation", rep, "--ring", "4", "--domain-maps", "-o", maps, *QUICK)
    assert done.returncode == 0, done.stderr
    assert sum(line.startswith("vt ") for line in maps.read_text().splitlines()) > 100
    count = len(run("inspect", rep).stdout.splitlines())
    done = run("inspect", rep, "--patch", "1", "--report", listed, "-o", out)
    assert done.returncode == 0, done.stderr
    patch = json.loads(listed.read_text())
    assert 0 < len(patch["functions"]) <= 45
    assert patch["energy"][0] == 1.0 > patch["energy"][-1]
    said, fell = done.stdout.splitlines()[0].split(", energy ")
    assert said == f"patch 1: {patch['vertices']} vertices, {len(patch['functions'])} functions"
    first, *_, last = load(rep).energy[1]
    assert float(fell.removesuffix(" of the first iteration's")) == pytest.approx(last / first, rel=6e-3)
    assert last < 0.98 * first
    for function in patch["functions"]:
        assert function["name"] in done.stdout
    look = (
        "import bpy, sys\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
        "print(sorted(o.name for o in bpy.data.objects if o.name.startswith('Patch')))\n"
    )
    seen = subprocess.run([sys.executable, "-c", look, str(out)], check=True, capture_output=True, text=True)
    for what in ("Initial Domain", "Optimised Domain", "x(u, v)", "y(u, v)", "z(u, v)"):
        assert f"'Patch 1 {what}'" in seen.stdout
    assert run("inspect", rep, "-o", out).returncode == 2
    refused = run("inspect", rep, "--patch", str(count))
    assert refused.returncode == 1
    assert f"from 0 to {count - 1}" in refused.stderr


def test_two_presets_are_compared_on_one_scale(model: Path, tmp_path: Path) -> None:
    out, report = tmp_path / "both.blend", tmp_path / "both.json"
    done = run(
        "compare", model, "--second", "paper", "--ring", "4", *QUICK, "--sparsity", "6", "-o", out, "--report", report
    )
    assert done.returncode == 0, done.stderr
    reports = json.loads(report.read_text())
    assert {name: each["settings"]["ring"] for name, each in reports.items()} == {"default": 4, "paper": 4}
    look = (
        "import bpy, sys\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
        "made = [o for o in bpy.data.objects if 'sparse_surface' in o]\n"
        "print(sorted(o.name for o in made))\n"
        "for o in made: print(*o['error_color_range'])\n"
    )
    seen = subprocess.run([sys.executable, "-c", look, str(out)], check=True, capture_output=True, text=True)
    names, one, other = seen.stdout.splitlines()[-3:]
    assert names == "['model Sparse Surface 1 Default', 'model Sparse Surface 2 Paper']"
    least, largest = sorted(each["vertex_error"]["max"] for each in reports.values())
    assert least < 0.99 * largest
    assert one == other
    assert list(map(float, one.split())) == pytest.approx([0.0, largest, 0.0], rel=1e-5)


def test_colours_end_at_the_largest_error(model: Path, tmp_path: Path) -> None:
    out, report = tmp_path / "out.blend", tmp_path / "report.json"
    assert run("approximate", model, "-o", out, "--report", report, *QUICK).returncode == 0
    look = (
        "import bpy, sys\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
        "print(*bpy.data.objects['model Sparse Surface']['error_color_range'])\n"
    )
    seen = subprocess.run([sys.executable, "-c", look, str(out)], check=True, capture_output=True, text=True)
    low, high, tolerance = map(float, seen.stdout.splitlines()[-1].split())
    assert (low, tolerance) == (0.0, 0.0)
    assert high == pytest.approx(json.loads(report.read_text())["vertex_error"]["max"], rel=1e-5)


def two_sheets(path: Path) -> Path:
    """Write a file with two objects."""
    vertices, faces = sheet(8)
    lines = []
    for number, name in enumerate(("left", "right")):
        lines += [f"o {name}", *("v {:.6f} {:.6f} {:.6f}".format(*point) for point in vertices + 5.0 * number)]
        lines += ["f " + " ".join(str(corner + 1 + number * len(vertices)) for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_several_meshes_of_a_file(tmp_path: Path) -> None:
    source, out = two_sheets(tmp_path / "two.obj"), tmp_path / "out.obj"
    files = ("-o", out, "--report", tmp_path / "r.json", "--representation", tmp_path / "rep.npz")
    assert run("approximate", source, *files, *QUICK).returncode == 0
    assert sorted(json.loads((tmp_path / "r.json").read_text())) == ["left", "right"]
    assert len(read_obj(out)[0]) == 2 * 64
    assert {path.name for path in tmp_path.glob("*.npz")} == {"rep_left.npz", "rep_right.npz"}
    done = run("compare", source, "-o", tmp_path / "both.obj")
    assert done.returncode == 1
    assert "The file has 2 meshes; name one of them with --object." in done.stderr
    done = run("approximate", source, "--object", "left", "--report", tmp_path / "one.json", *QUICK)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "one.json").read_text())["input"]["vertices"] == 64
    assert run("approximate", source, "--object", "middle").returncode == 1
    assert not (tmp_path / "both.obj").exists()


NEW_OUTPUT = """
import sys
from sparse_surface.command_line import outputs
def write(path, made):
    path.write_text("".join(f"{each.source.name},{each.report['patches']}\\n" for each in made))
outputs.OUTPUTS += (outputs.Output(("--counts",), "FILE.csv", "numbers of patches", write, (".csv",)),)
from sparse_surface.command_line.main import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_new_kind_of_output_is_a_row(model: Path, tmp_path: Path) -> None:
    def run_with_row(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", NEW_OUTPUT, "approximate", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300)

    assert "--counts FILE.csv" in run_with_row("--help").stdout
    refused = run_with_row(model, "--counts", tmp_path / "counts.txt")
    assert refused.returncode == 2
    assert "the file's ending must be .csv, not '.txt'" in refused.stderr
    report = tmp_path / "report.json"
    assert run_with_row(model, "--counts", tmp_path / "counts.csv", "--report", report, *QUICK).returncode == 0
    assert (tmp_path / "counts.csv").read_text() == f"model,{json.loads(report.read_text())['patches']}\n"


def test_the_benchmark_is_missed_in_a_sentence() -> None:
    """The extension's zip does not hold it."""
    code = (
        "import sys, importlib.util as u; plain = u.find_spec\n"
        "u.find_spec = lambda name, *rest: None if name.endswith('benchmarks') else plain(name, *rest)\n"
        "from sparse_surface.command_line.main import main; sys.exit(main(['benchmark', '--models', 'cube']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr == "sparse_surface: The benchmark comes with the source code, not with the extension.\n"


def test_help_lists_what_blender_reads_and_writes() -> None:
    shown = " ".join(run("approximate", "--help").stdout.split())
    assert "mesh file: .obj .ply .stl .blend .glb .gltf .fbx .usd .usda .usdc .usdz .abc" in shown
    assert "mesh file: .obj .ply .stl .blend .glb .gltf .fbx .usd .usda .usdc .abc" in shown


def test_representations_that_are_none_are_refused(tmp_path: Path) -> None:
    has_mounts = sys.platform != "linux" or Path("/etc/mtab").exists()
    for name, content in (("cut.npz", b"PK\x03\x04"), ("text.npz", b"hello")):
        (tmp_path / name).write_bytes(content)
        done = run("evaluate", tmp_path / name, "-o", tmp_path / "out.ply")
        assert done.returncode == 1
        # Blender has a complaint of its own on a system without /etc/mtab.
        ours = [line for line in done.stderr.strip().splitlines() if has_mounts or "mounted file-systems" not in line]
        assert len(ours) == 1
    assert run("evaluate", tmp_path / "absent.npz", "-o", tmp_path / "out.ply").returncode == 1
    assert run("evaluate", tmp_path / "cut.npz").returncode == 2
    assert not (tmp_path / "out.ply").exists()


# --------------------------------------------------------------------------------------------------------- point clouds


def sphere_points(count: int = 500) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return np.round(points / np.linalg.norm(points, axis=1, keepdims=True) + [5.0, 0.0, 0.0], 6)


def write_xyz(path: Path, points: np.ndarray) -> Path:
    np.savetxt(path, points, fmt="%.6f")
    return path


def write_ply(path: Path, points: np.ndarray) -> Path:
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_text(header + "\n".join("{:.6f} {:.6f} {:.6f}".format(*point) for point in points) + "\n")
    return path


def octahedron(path: Path, size: float = 1.2) -> Path:
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * size + [5.0, 0.0, 0.0]
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return write_obj(path, corners, faces)


def off_sphere(points: np.ndarray) -> np.ndarray:
    return np.abs(np.linalg.norm(points - [5.0, 0.0, 0.0], axis=1) - 1.0)


@pytest.mark.parametrize("kind", ["ply", "obj", "xyz"])
def test_reconstruct_over_a_base(tmp_path: Path, kind: str) -> None:
    """Points of each kind of file, loose ones of an .obj included, become a surface in the file's own axes."""
    points = sphere_points()
    path = tmp_path / f"scan.{kind}"
    {"ply": write_ply, "xyz": write_xyz, "obj": lambda path, points: write_obj(path, points, [])}[kind](path, points)
    out, report_file = tmp_path / "out.obj", tmp_path / "report.json"
    base = octahedron(tmp_path / "base.obj")
    done = run("reconstruct", path, "--base", base, "-o", out, "--report", report_file, "--resample", "7", *QUICK)
    assert done.returncode == 0, done.stderr
    assert "scan: 500 points over 6 vertices, 6 patches" in done.stdout
    vertices, faces = read_obj(out)
    assert len(faces) == 49 * 8
    assert off_sphere(vertices).max() < 0.05
    report = json.loads(report_file.read_text())
    assert report["input"]["points"] == 500
    assert report["surface_error"]["rms"] < 0.02


@pytest.mark.long
def test_reconstruct_draws_a_heat_map(tmp_path: Path) -> None:
    path, picture = write_xyz(tmp_path / "scan.xyz", sphere_points()), tmp_path / "heat.png"
    done = run("reconstruct", path, "--base", octahedron(tmp_path / "base.obj"), "--heatmap", picture, *QUICK)
    assert done.returncode == 0, done.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_reconstruct_without_a_base_writes_everything(tmp_path: Path) -> None:
    path = write_xyz(tmp_path / "scan.xyz", sphere_points(800))
    out, rep = tmp_path / "out.ply", tmp_path / "rep.npz"
    options = ("--base-vertices", "30", "--corrections", "1", "--robust", "huber", "--ring", "2", "--sparsity", "9")
    done = run("reconstruct", path, "-o", out, "--representation", rep, *options, *QUICK)
    assert done.returncode == 0, done.stderr
    again = tmp_path / "again.obj"
    done = run("evaluate", rep, "--resample", "5", "-o", again)
    assert done.returncode == 0, done.stderr
    assert off_sphere(read_obj(again)[0]).max() < 0.06
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "again.mtl",
        "again.obj",
        "out.ply",
        "rep.npz",
        "scan.xyz",
    ]


@pytest.mark.parametrize(
    ("content", "options", "code", "words"),
    [
        ("0 0 0\n1 0 0\n0 1 0\n", (), 1, "A surface needs at least 4 points; there are 3."),
        ("0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 1 0\n", (), 1, "All the points lie in one plane: choose a base mesh for them."),
        ("# nothing\n", (), 1, "'scan.xyz' holds no points."),
        ("0 0 0\none two three\n", (), 1, "line 2, 'one two three', does not have three numbers."),
        ("0 0 0\n1 0 0\nnan 1 0\n1 1 1\n", (), 1, "A surface needs at least 4 points; of 4 only 3 can be used."),
        ("0 0 0\n1 0 0\n", ("--base", "there is none.obj"), 1, "There is no file"),
        ("0 0 0\n1 0 0\n", ("--base", "base.obj", "--base-vertices", "9"), 2, "not allowed with argument"),
        ("0 0 0\n1 0 0\n", ("--corrections", "-3"), 2, "corrections must be a whole number from 0 to 20, not -3."),
    ],
    ids=["three", "plane", "empty", "words", "nan", "no base", "both", "range"],
)
def test_reconstruct_refuses(tmp_path: Path, content: str, options: tuple[str, ...], code: int, words: str) -> None:
    path = tmp_path / "scan.xyz"
    path.write_text(content)
    done = run("reconstruct", path, "-o", tmp_path / "out.ply", *options)
    assert done.returncode == code, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert [each.name for each in tmp_path.iterdir()] == ["scan.xyz"]


WITHOUT_BLENDER = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name == "bpy":
            raise ModuleNotFoundError(name=name)
sys.meta_path.insert(0, Refuse())
from sparse_surface.command_line.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(("approximate", "--help"), 0), (("reconstruct", "a.ply", "--ring", "-1"), 2), (("compare", "a", "-o", "b.x"), 2)],
)
def test_help_and_usage_need_no_blender(tmp_path: Path, arguments: tuple[str, ...], code: int) -> None:
    command = [sys.executable, "-c", WITHOUT_BLENDER, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert done.returncode == code, done.stderr


def test_reconstruct_says_when_blender_is_missing(tmp_path: Path) -> None:
    path = write_xyz(tmp_path / "scan.xyz", sphere_points(10))
    code = (
        "import sys, importlib.util as u; plain = u.find_spec\n"
        "u.find_spec = lambda name, *rest: None if name == 'bpy' else plain(name, *rest)\n"
        f"from sparse_surface.command_line.main import main; sys.exit(main(['reconstruct', {str(path)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    expected = "Files are read with Blender: install its Python module (pip install bpy) or run in Blender."
    assert done.stderr == f"sparse_surface: {expected}\n"


def test_a_seam_of_doubled_vertices_stays_closed(tmp_path: Path) -> None:
    vertices, faces = sheet()
    right = vertices[faces].mean(axis=1)[:, 0] > 0.0
    shared = np.intersect1d(faces[right], faces[~right])
    own = np.arange(len(vertices))
    own[shared] = len(vertices) + np.arange(len(shared))
    split = np.concatenate([vertices, vertices[shared] + [1e-6, 0.0, 0.0]])
    model = write_obj(tmp_path / "split.obj", split, np.where(right[:, None], own[faces], faces))
    out, report = tmp_path / "out.obj", tmp_path / "report.json"
    done = run("approximate", model, "-o", out, "--report", report, *QUICK)
    assert f"{len(shared)} vertices held together with others at their place" in done.stdout
    after, _ = read_obj(out)
    assert len(after) == len(split)
    assert np.array_equal(after[shared], after[own[shared]])
    assert json.loads(report.read_text())["input"]["merged_vertices"] == len(shared)
    for distance in ("off", "1e-9"):
        done = run("approximate", model, "-o", out, "--merge-distance", distance, *QUICK)
        assert "held together with others" not in done.stdout
        assert not np.array_equal(read_obj(out)[0][shared], read_obj(out)[0][own[shared]])
    assert run("approximate", model, "-o", out, "--merge-distance", "near").returncode == 2


def test_large_coordinates_keep_their_decimals(tmp_path: Path) -> None:
    place = np.array([500_000.0, 5_600_000.0, 200.0])
    random = np.random.default_rng(0).uniform(size=(1500, 2))
    hill = 40.0 * np.column_stack([random, 0.1 * np.sin(5.0 * random[:, 0]) * np.cos(4.0 * random[:, 1])])
    local, far = tmp_path / "local.xyz", tmp_path / "far.csv"
    np.savetxt(local, hill, fmt="%.4f")
    np.savetxt(far, hill + place, fmt="%.4f", delimiter=",", header="x,y,z", comments="")
    for path in (local, far):
        done = run("reconstruct", path, "-o", path.with_suffix(".obj"), "--report", path.with_suffix(".json"), *QUICK)
        assert done.returncode == 0, done.stderr
    near, moved = (read_obj(path.with_suffix(".obj"))[0] for path in (local, far))
    assert json.loads(far.with_suffix(".json").read_text())["input"]["shift"] == pytest.approx(place, abs=25.0)
    height = 4.0 * np.sin(near[:, 0] / 8.0) * np.cos(near[:, 1] / 10.0) - near[:, 2]
    back = moved - place
    again = 4.0 * np.sin(back[:, 0] / 8.0) * np.cos(back[:, 1] / 10.0) - back[:, 2]
    assert np.sqrt((again**2).mean()) < 1.05 * np.sqrt((height**2).mean())
    assert len(np.unique(moved[:, 1])) > 0.9 * len(moved)
