"""The command line leaves the colours of its input alone: those of a scan are what they were, to the byte."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = pytest.mark.skipif(bpy_missing, reason="the command line needs bpy")

SIZE = 16
QUICK = ("--iterations", "2", "--sweeps", "0", "--workers", "1")


def run(*arguments: str | Path) -> None:
    command = [sys.executable, "-m", "sparse_surface", "approximate", *map(str, arguments), *QUICK]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def colours() -> np.ndarray:
    """Return 256 colours in which every byte comes once in each channel, (256, 3)."""
    ramp = np.arange(256)
    return np.stack([ramp, (ramp * 91 + 17) % 256, (ramp * 163 + 5) % 256], axis=1).astype(np.uint8)


def positions() -> np.ndarray:
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, SIZE)], indexing="ij"))
    return np.stack([x, y, 0.2 * np.sin(4.0 * x) * np.cos(3.0 * y)], axis=1)


def triangles() -> np.ndarray:
    i = np.arange(SIZE * SIZE).reshape(SIZE, SIZE)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def scan(path: Path, coloured: bool = True) -> Path:
    """Write the sheet as scanners do: PLY, with uchar red green blue."""
    properties = [f"property float {axis}" for axis in "xyz"]
    properties += [f"property uchar {name}" for name in ("red", "green", "blue")] if coloured else []
    faces = triangles()
    lines = ["ply", "format ascii 1.0", f"element vertex {SIZE * SIZE}", *properties, f"element face {len(faces)}"]
    lines += ["property list uchar int vertex_indices", "end_header"]
    for point, colour in zip(positions(), colours(), strict=True):
        lines.append(" ".join([*(f"{value:.6f}" for value in point), *(map(str, colour) if coloured else ())]))
    path.write_text("\n".join([*lines, *(f"3 {a} {b} {c}" for a, b, c in faces)]) + "\n")
    return path


def read_vertices(path: Path) -> tuple[list[str], np.ndarray]:
    """Return the names of a binary PLY file's vertex properties, and its vertices as an array of these."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    rows = [line.split() for line in header.decode().splitlines()]
    start = next(k for k, row in enumerate(rows) if row[:2] == ["element", "vertex"])
    end = next(k for k, row in enumerate(rows) if row[:2] == ["element", "face"])
    kinds = {"float": "<f4", "uchar": "u1"}
    layout = [(row[2], kinds[row[1]]) for row in rows[start + 1 : end]]
    return [name for name, _ in layout], np.frombuffer(body, dtype=layout, count=int(rows[start][2]))


@pytest.mark.parametrize("options", [(), ("--preset", "denoise"), ("--resample", "2"), ("--error-colors", "add")])
def test_colours_of_a_ply_file_stay_to_the_byte(tmp_path: Path, options: tuple[str, ...]) -> None:
    out = tmp_path / "out.ply"
    run(scan(tmp_path / "scan.ply"), "-o", out, *options)
    names, vertices = read_vertices(out)
    assert names[:6] == ["x", "y", "z", "red", "green", "blue"]
    stored = np.stack([vertices[name] for name in ("red", "green", "blue")], axis=1)[: SIZE * SIZE]
    assert np.array_equal(stored, colours())
    others = [name for name in names if "ol_" in name or "olor" in name]
    assert others == ([f"error_color_{c}" for c in "rgba"] if "add" in options else [])


def test_error_colours_take_their_place_on_request(tmp_path: Path) -> None:
    out = tmp_path / "out.ply"
    run(scan(tmp_path / "scan.ply"), "-o", out, "--error-colors", "replace")
    names, vertices = read_vertices(out)
    assert not [name for name in names if name.startswith("Col")]
    stored = np.stack([vertices[name] for name in ("red", "green", "blue")], axis=1)
    assert (stored != colours()).any(axis=1).mean() > 0.9
    worst = vertices["error"].argmax()  # the ramp is darkest at no error
    assert int(stored[worst].sum()) > int(stored[vertices["error"].argmin()].sum())


@pytest.mark.parametrize("ending", [".ply", ".obj", ".glb"])
def test_a_mesh_without_colours_gets_none(tmp_path: Path, ending: str) -> None:
    out = tmp_path / f"out{ending}"
    run(scan(tmp_path / "scan.ply", coloured=False), "-o", out)
    if ending == ".ply":
        assert not {"red", "error_color_r"} & set(read_vertices(out)[0])
    elif ending == ".obj":
        assert {len(line.split()) for line in out.read_text().splitlines() if line.startswith("v ")} == {4}
    else:
        assert list(glb_colours(out)) == []


def glb_colours(path: Path) -> dict[str, np.ndarray]:
    """Return the distinct colours of each colour layer of a .glb file's first mesh, linear RGB from 0 to 1."""
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    content, body = json.loads(data[20 : 20 + length]), data[28 + length :]
    found = {}
    for name, index in content["meshes"][0]["primitives"][0]["attributes"].items():
        if name.startswith("COLOR"):
            accessor = content["accessors"][index]
            view = content["bufferViews"][accessor["bufferView"]]
            kind, most = {5121: ("u1", 255.0), 5123: ("<u2", 65535.0), 5126: ("<f4", 1.0)}[accessor["componentType"]]
            width = {"VEC3": 3, "VEC4": 4}[accessor["type"]]
            flat = np.frombuffer(body, kind, accessor["count"] * width, view.get("byteOffset", 0))
            found[name] = np.unique(flat.reshape(-1, width)[:, :3] / most, axis=0)
    return found


def linear(stored: np.ndarray) -> np.ndarray:
    """Decode sRGB bytes (IEC 61966-2-1)."""
    share = stored / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def test_the_first_colours_of_a_glb_file_are_the_scans(tmp_path: Path) -> None:
    out = tmp_path / "out.glb"
    for choice, layers in (("keep", 1), ("add", 2)):
        run(scan(tmp_path / "scan.ply"), "-o", out, "--error-colors", choice)
        found = glb_colours(out)
        assert len(found) == layers
        wanted = linear(colours())
        away = np.abs(found["COLOR_0"][:, None] - wanted[None]).max(axis=2).min(axis=0)
        assert away.max() < 1e-4


def test_colours_of_an_obj_file_stay(tmp_path: Path) -> None:
    middle, out = tmp_path / "middle.obj", tmp_path / "out.obj"
    run(scan(tmp_path / "scan.ply"), "-o", middle)
    run(middle, "-o", out)
    rows = [line.split()[1:] for line in out.read_text().splitlines() if line.startswith("v ")]
    stored = np.array(rows, dtype=float)[:, 3:]
    assert np.allclose(stored * 255.0, colours(), atol=0.1)


@pytest.mark.parametrize("blender", [True, False])
def test_header_and_triangle_colours_of_a_binary_stl_stay(tmp_path: Path, blender: bool) -> None:
    size = 12
    x, y = np.meshgrid(*2 * [np.linspace(0.0, 30.0, size)], indexing="ij")
    points = np.stack([x, y, 4.0 * np.sin(x / 7.0)], axis=-1).reshape(-1, 3)
    i = np.arange(size * size).reshape(size, size)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    triangles = points[quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)].astype("<f4")
    row = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    content = np.zeros(len(triangles), row)
    content["corners"], content["colour"] = triangles, 0x8000 | np.arange(len(triangles))
    header = b"COLOR=\xff\x40\x00\xff units=mm".ljust(80)
    path, out = tmp_path / "part.stl", tmp_path / "out.stl"
    path.write_bytes(header + np.uint32(len(content)).tobytes() + content.tobytes())
    hide = "" if blender else "u.find_spec = lambda name, *rest: None if name == 'bpy' else plain(name, *rest)\n"
    code = (
        f"import sys, os, importlib.util as u; plain = u.find_spec\n{hide}"
        "from sparse_surface.command_line.main import main\ncode = main(sys.argv[1:])\n"
        "sys.stdout.flush(); os._exit(code)"
    )
    words = ["approximate", path, "-o", out, "--iterations", "2", "--workers", "1"]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    written = out.read_bytes()
    assert written[:80] == header
    found = np.frombuffer(written, row, offset=84)
    assert np.array_equal(found["colour"], content["colour"])
    away = np.linalg.norm(found["corners"] - triangles, axis=2)
    assert 0.0 < away.max() < 1.0
