"""Files with several meshes: what is done is written, what is not is said, and a shared mesh is solved once."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="the command line needs bpy")

SCENE = """
import bpy, sys, math
bpy.ops.wm.read_homefile(use_empty=True)
def sheet(name, bad=False):
    n = 10
    points = [(i / n, j / n, 0.2 * math.sin(4 * i / n)) for i in range(n) for j in range(n)]
    if bad:
        points[3] = (float("nan"), 0.0, 0.0)
    first = [i * n + j for i in range(n - 1) for j in range(n - 1)]
    faces = [(k, k + n, k + n + 1, k + 1) for k in first]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made
for name in sys.argv[2:]:
    made = sheet(name, name.startswith("bad"))
    if name == "twin":
        for number in range(2):
            other = bpy.data.objects.new(f"twin copy {number}", made.data)
            other.location.x = 3.0 * (number + 1)
            bpy.context.scene.collection.objects.link(other)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


def scene(path: Path, *names: str) -> Path:
    subprocess.run([sys.executable, "-c", SCENE, path, *names], check=True, capture_output=True, timeout=120)
    return path


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sparse_surface", "approximate", *map(str, arguments)]
    options = ["--iterations", "2", "--sweeps", "0", "--workers", "1"]
    return subprocess.run([*command, *options], capture_output=True, text=True, timeout=300)


def test_a_bad_mesh_does_not_stop_the_others(tmp_path: Path) -> None:
    path = scene(tmp_path / "scene.blend", "a", "bad", "c")
    report = tmp_path / "report.json"
    done = run(path, "-o", tmp_path / "out.ply", "--report", report, "--representation", tmp_path / "r.npz")
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert line == "sparse_surface: bad: Vertex 3 has a coordinate that is not a finite number."
    assert set(json.loads(report.read_text())) == {"a", "c"}
    assert sorted(p.name for p in tmp_path.glob("r*.npz")) == ["r_a.npz", "r_c.npz"]
    strict = run(path, "-o", tmp_path / "strict.ply", "--strict")
    assert strict.returncode == 1
    assert (tmp_path / "strict.ply").exists()
    only = run(scene(tmp_path / "bad.blend", "bad", "bad too"), "-o", tmp_path / "none.ply")
    assert only.returncode == 1
    assert len(only.stderr.splitlines()) == 3
    assert not (tmp_path / "none.ply").exists()


def test_objects_that_share_a_mesh_are_solved_once(tmp_path: Path) -> None:
    out = tmp_path / "out.obj"
    done = run(scene(tmp_path / "scene.blend", "twin", "other"), "-o", out)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Reading the mesh") == 2
    assert sum(" surface error " in line for line in done.stdout.splitlines()) == 4
    vertices = [line for line in out.read_text().splitlines() if line.startswith("v ")]
    assert len(vertices) == 400
    assert max(float(line.split()[1]) for line in vertices) > 6.0


def test_long_names_and_names_alike_get_files_of_their_own(tmp_path: Path) -> None:
    path = scene(tmp_path / "scene.blend", 50 * "n" + "one", 50 * "n" + "two", "a/b", "a_b")
    done = run(path, "--representation", tmp_path / "r.npz", "-o", tmp_path / "out.obj")
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("r*.npz"))) == 4
    assert sum(line.startswith("o ") for line in (tmp_path / "out.obj").read_text().splitlines()) == 4


def test_objects_that_share_a_border_close_as_before(tmp_path: Path) -> None:
    n = 13
    angles = [2.0 * math.pi * i / 24 for i in range(24)]
    rings = [(math.sin(math.pi * j / (n - 1)), math.cos(math.pi * j / (n - 1))) for j in range(1, n - 1)]
    points = [(r * math.cos(a), r * math.sin(a) * (1.0 + 0.2 * z), z) for r, z in rings for a in angles]
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in [*points, (0, 0, 1), (0, 0, -1)]]
    lines += [f"vt {i / 24:.4f} {j / n:.4f}" for j in range(n - 2) for i in range(24)] + ["vt 0 0", "vt 1 1"]
    top, bottom = len(points) + 1, len(points) + 2
    objects = {"north": [(top, i + 1, (i + 1) % 24 + 1) for i in range(24)], "middle": [], "south": []}
    for j in range(n - 3):
        name = "north" if j < 3 else "middle" if j < 7 else "south"
        for i in range(24):
            a, b = 24 * j + i + 1, 24 * j + (i + 1) % 24 + 1
            objects[name].append((a, a + 24, b + 24, b))
    last = 24 * (n - 3)
    objects["south"] += [(bottom, last + (i + 1) % 24 + 1, last + i + 1) for i in range(24)]
    for name, faces in objects.items():
        lines += [f"o {name}", *("f " + " ".join(f"{c}/{c}" for c in face) for face in faces)]
    path, out, fine, report = (tmp_path / name for name in ("parts.obj", "out.obj", "fine.obj", "report.json"))
    path.write_text("\n".join(lines) + "\n")
    assert open_edges(path)[:2] == (0, 3)
    done = run(path, "-o", out, "--report", report, "--representation", tmp_path / "all.npz")
    assert done.returncode == 0, done.stderr
    last_line = done.stdout.splitlines()[-1]
    assert last_line.startswith("middle + north + south: ")
    assert open_edges(out) == (0, 3, sum(map(len, objects.values())))
    reports = json.loads(report.read_text())
    assert set(reports) == {"north", "middle", "south"}
    assert reports["north"]["input"]["parts"] == ["middle", "north", "south"]
    assert [file.name for file in tmp_path.glob("*.npz")] == ["all.npz"]
    assert run(path, "-o", fine, "--resample", "2").returncode == 0
    assert open_edges(fine)[:2] == (0, 3)
    assert fine.read_text().count("\nvt ") > 3 * path.read_text().count("\nvt ")
    assert run(path, "-o", fine, "--merge-distance", "off").returncode == 0
    assert open_edges(fine)[0] > 0


def open_edges(path: Path) -> tuple[int, int, int]:
    """Edges that do not belong to two faces where vertices at one place are one, objects, and faces of a file."""
    words = [line.split() for line in path.read_text().splitlines()]
    places: dict[tuple[str, ...], int] = {}
    number = [places.setdefault(tuple(w[1:4]), len(places)) for w in words if w[:1] == ["v"]]
    faces = [[number[int(corner.split("/")[0]) - 1] for corner in w[1:]] for w in words if w[:1] == ["f"]]
    count = Counter(frozenset(pair) for face in faces for pair in zip(face, [*face[1:], face[0]], strict=True))
    return sum(times != 2 for times in count.values()), sum(w[:1] == ["o"] for w in words), len(faces)


HIERARCHY = """
import bpy, os, sys
bpy.ops.wm.read_homefile(use_empty=True)
def linked(name, data, parent, place):
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    made.parent, made.location = parent, place
    return made
def sheet(name, picture):
    points = [(i / 8, j / 8, 0.1 * (i % 3)) for i in range(9) for j in range(9)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], [(k, k + 9, k + 10, k + 1) for i in range(8) for k in range(9 * i, 9 * i + 8)])
    mesh.uv_layers.new()
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = picture
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(texture.outputs[0], shader.inputs[0])
    mesh.materials.append(material)
    return mesh
folder = sys.argv[1]
picture = bpy.data.images.new("wood", 4, 4)
picture.filepath_raw, picture.file_format = os.path.join(folder, "wood.png"), "PNG"
picture.save()
root = linked("root", None, None, (1.0, 2.0, 3.0))
turned = linked("turned", None, root, (0.0, 0.0, 1.0))
turned.rotation_euler.x = 1.0
body = linked("body", sheet("body", picture), root, (1.0, 0.0, 0.0))
linked("lid", sheet("lid", picture), body, (0.0, 0.0, 1.0))
linked("wheel", sheet("wheel", picture), turned, (0.0, 3.0, 0.0))
bpy.ops.wm.save_as_mainfile(filepath=os.path.join(folder, "scene.blend"))
bpy.ops.file.make_paths_relative()
bpy.ops.wm.save_as_mainfile(filepath=os.path.join(folder, "scene.blend"))
os._exit(0)
"""

TREE = """
import bpy, json, os, sys
path = sys.argv[1]
bpy.ops.wm.read_homefile(use_empty=True)
if path.endswith(".blend"):
    bpy.ops.wm.open_mainfile(filepath=path)
elif ".gl" in path:
    bpy.ops.import_scene.gltf(filepath=path)
elif ".usd" in path:
    bpy.ops.wm.usd_import(filepath=path)
else:
    bpy.ops.import_scene.fbx(filepath=path)
bpy.context.view_layer.update()
meshes = [each for each in bpy.context.scene.objects if each.type == "MESH"]
def line(each):
    above = []
    while each is not None:
        above.append(each.name)
        each = each.parent
    return above[::-1]
found = {each.name: [line(each), [round(x, 3) for x in each.matrix_world.translation]] for each in meshes}
there = [os.path.isfile(bpy.path.abspath(each.filepath)) for each in bpy.data.images if each.source == "FILE"]
packed = [each.packed_file is not None for each in bpy.data.images if each.source == "FILE"]
open(sys.argv[2], "w").write(json.dumps([found, [a or b for a, b in zip(there, packed)]]))
os._exit(0)
"""


def test_materials_beside_an_obj_find_their_pictures(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", HIERARCHY, tmp_path], check=True, capture_output=True, timeout=120)
    (tmp_path / "made").mkdir()
    assert run(tmp_path / "scene.blend", "-o", tmp_path / "made" / "out.obj").returncode == 0
    lines = (tmp_path / "made" / "out.mtl").read_text().splitlines()
    pictures = [line.removeprefix("map_Kd ") for line in lines if line.startswith("map_Kd ")]
    assert pictures
    assert all((tmp_path / "made" / picture).is_file() for picture in pictures)


@pytest.mark.parametrize("ending", ["glb", "gltf", "fbx", "usdc", "blend"])
def test_hierarchy_names_and_pictures_stay(tmp_path: Path, ending: str) -> None:
    subprocess.run([sys.executable, "-c", HIERARCHY, tmp_path], check=True, capture_output=True, timeout=120)
    (tmp_path / "made").mkdir()
    out = tmp_path / "made" / f"out.{ending}"
    for _ in range(2):  # the second time the file and its pictures are there
        done = run(tmp_path / "scene.blend", "-o", out)
        assert done.returncode == 0, done.stderr
    assert not [path.name for path in out.parent.iterdir() if path.name.startswith(".")]
    tree = tmp_path / "tree.json"
    subprocess.run([sys.executable, "-c", TREE, out, tree], check=True, capture_output=True, timeout=120)
    found, pictures = json.loads(tree.read_text())
    assert pictures
    assert all(pictures)
    wanted = {"body": ("root", [2.0, 2.0, 3.0]), "lid": ("body", [2.0, 2.0, 4.0]), "wheel": ("turned", None)}
    for name, (parent, place) in wanted.items():
        # A USD reader may make a mesh the child of an object with its name.
        line, where = next(found[n] for n in found if n == (name if ending != "usdc" or n == name else f"{name}_mesh"))
        assert parent in [each.partition(".")[0] for each in line]
        assert "root" in line
        assert place is None or where == pytest.approx(place, abs=1e-3)
        assert not any("source" in each for each in line)
