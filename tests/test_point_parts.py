"""Point files read in parts: the same rows for any size of the parts, and a file's faults are named as before."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.operators.files.point_files import PointParts, count_of, in_parts, read_point_file
from sparse_surface.operators.files.point_rows import Meaning
from sparse_surface.solver.errors import FileFormatError

COUNT = 23
ORIGIN = np.array([500_000.0, 5_600_000.0, 200.0])
POINTS = ORIGIN + np.round(np.random.default_rng(4).uniform(-9.0, 9.0, (COUNT, 3)), 3)
BYTES = np.random.default_rng(5).integers(0, 256, (COUNT, 3))
NORMALS = np.tile([[0.0, 0.6, 0.8], [-1.0, 0.0, 0.0]], (COUNT, 1))[:COUNT]


def text(path: Path, columns: list[np.ndarray], head: str = "") -> Path:
    lines = [" ".join(repr(value.item()) for row in rows for value in row) for rows in zip(*columns, strict=True)]
    path.write_text(head + "\n".join(lines) + "\n")
    return path


def binary_ply(path: Path, order: str = "<", before: bytes = b"", head: str = "") -> Path:
    names = {"<": "binary_little_endian", ">": "binary_big_endian"}
    lines = ["ply", f"format {names[order]} 1.0", *head.splitlines(), f"element vertex {COUNT}"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue")]
    lines += ["property float confidence", *(f"property float n{axis}" for axis in "xyz")]
    lines += ["element face 2", "property list uchar int vertex_indices", "end_header\n"]
    rows = [
        struct.pack(order + "3d3B4f", *point, *colour, 1.0, *normal)
        for point, colour, normal in zip(POINTS.tolist(), BYTES.tolist(), NORMALS.tolist(), strict=True)
    ]
    faces = struct.pack(order + "B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3)  # of different lengths: behind the points
    path.write_bytes("\n".join(lines).encode() + before + b"".join(rows) + faces)
    return path


def las(path: Path, kind: int = 2, version: int = 2) -> Path:
    """Write a .las as its specification has it: coordinates in whole thousandths, colours in words."""
    head_size, at = (375, 30) if version == 4 else (227, 20)
    length = {2: 26, 7: 36, 1: 28}[kind]
    offset = np.array([500_000.0, 5_600_000.0, 0.0])
    stored = np.round((POINTS - offset) / 0.001).astype("<i4")
    head = bytearray(head_size)
    head[:4], head[24:26] = b"LASF", bytes([1, version])
    struct.pack_into("<HI", head, 94, head_size, head_size)
    struct.pack_into("<BHI", head, 104, kind, length, 0 if version == 4 else COUNT)
    struct.pack_into("<6d", head, 131, *[0.001] * 3, *offset)
    if version == 4:
        struct.pack_into("<Q", head, 247, COUNT)
    records = bytearray()
    for place, colour in zip(stored.tolist(), BYTES.tolist(), strict=True):
        record = bytearray(length)
        struct.pack_into("<3i", record, 0, *place)
        if kind != 1:
            struct.pack_into("<3H", record, at, *(257 * value for value in colour))
        records += record
    path.write_bytes(bytes(head) + bytes(records))
    return path


def pcd(path: Path, how: str) -> Path:
    lines = ["FIELDS x y z rgb", "SIZE 8 8 8 4", "TYPE F F F U", "COUNT 1 1 1 1", f"WIDTH {COUNT}", "HEIGHT 1"]
    packed = [red << 16 | green << 8 | blue for red, green, blue in BYTES.tolist()]
    if how == "ascii":
        rows = zip(POINTS.tolist(), packed, strict=True)
        body = "".join(f"{x!r} {y!r} {z!r} {colour}\n" for (x, y, z), colour in rows).encode()
    else:
        body = b"".join(struct.pack("<3dI", *row, colour) for row, colour in zip(POINTS.tolist(), packed, strict=True))
    path.write_bytes("\n".join([*lines, f"DATA {how}\n"]).encode() + body)
    return path


ASCII_PLY = "\n".join(
    [
        *("ply", "format ascii 1.0", "comment by a scanner", f"element vertex {COUNT}"),
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        *(f"property float n{axis}" for axis in "xyz"),
        "end_header\n",
    ]
)


def obj(path: Path) -> Path:
    path.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in POINTS.tolist()))
    return path


def behind_others(path: Path) -> Path:
    return binary_ply(path, before=bytes(12), head="element camera 3\nproperty float range")


FILES: dict[str, tuple[Callable[[Path], Path], str, bool, bool]] = {
    "table": (lambda path: text(path, [POINTS]), "a.xyz", False, False),
    "colours": (lambda path: text(path, [POINTS, BYTES]), "a.txt", True, False),
    "normals": (lambda path: text(path, [POINTS, NORMALS]), "a.asc", False, True),
    "both": (lambda path: text(path, [POINTS, BYTES, NORMALS]), "a.xyz", True, True),
    "named": (lambda path: text(path, [POINTS, BYTES], "x y z r g b\n"), "a.csv", True, False),
    "obj": (obj, "a.obj", False, False),
    "little ply": (binary_ply, "a.ply", True, True),
    "big ply": (lambda path: binary_ply(path, ">"), "a.ply", True, True),
    "ply behind others": (behind_others, "a.ply", True, True),
    "text ply": (lambda path: text(path, [POINTS, BYTES, NORMALS], ASCII_PLY), "a.ply", True, True),
    "las": (las, "a.las", True, False),
    "las 1.4": (lambda path: las(path, 7, 4), "a.las", True, False),
    "las without colours": (lambda path: las(path, 1), "a.las", False, False),
    "text pcd": (lambda path: pcd(path, "ascii"), "a.pcd", True, False),
    "binary pcd": (lambda path: pcd(path, "binary"), "a.pcd", True, False),
}


@pytest.mark.parametrize("at_once", [1, 7, COUNT, 1000])
@pytest.mark.parametrize("kind", FILES)
def test_parts_of_any_size_are_the_file(tmp_path: Path, kind: str, at_once: int) -> None:
    write, name, coloured, directed = FILES[kind]
    path = write(tmp_path / name)
    assert in_parts(path)
    source = PointParts(path, at_once)
    parts, meaning = list(source), source.meaning
    assert [len(rows.points) for rows in parts] == [min(at_once, COUNT - k) for k in range(0, COUNT, at_once)]
    np.testing.assert_allclose(np.concatenate([rows.points for rows in parts]), POINTS, rtol=0.0, atol=1e-9)
    assert (meaning.top is not None, meaning.normals) == (coloured, directed)
    if coloured:
        found = np.concatenate([rows.colours for rows in parts]) / meaning.top
        np.testing.assert_allclose(found, BYTES / 255.0, atol=1e-12)
    if directed:
        np.testing.assert_allclose(np.concatenate([rows.normals for rows in parts]), NORMALS, rtol=1e-7)


@pytest.mark.parametrize("kind", [kind for kind in FILES if "table" not in kind and kind not in ("colours", "obj")])
def test_the_head_says_how_many_there_are(tmp_path: Path, kind: str) -> None:
    write, name, _, _ = FILES[kind]
    count = count_of(write(tmp_path / name))
    assert abs(count - COUNT) <= (3 if name[-3:] in ("asc", "csv", "xyz") else 0)


def test_lines_of_long_texts_are_estimated(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    path.write_text("".join(f"{k} 0.5 -1.25\n" for k in range(100_000, 150_000)))
    assert count_of(path) == pytest.approx(50_000, rel=0.01)


def test_a_las_needs_no_package_and_reads_as_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = las(tmp_path / "a.las")
    monkeypatch.setitem(__import__("sys").modules, "laspy", None)
    found = read_point_file(path)
    np.testing.assert_allclose(found.points, POINTS, rtol=0.0, atol=1e-9)
    assert found.colours is not None
    np.testing.assert_allclose(found.colours, BYTES / 255.0)


@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_files_that_laspy_writes(tmp_path: Path, ending: str) -> None:
    laspy = pytest.importorskip("laspy", reason="an optional extra")
    if ending == ".laz":
        pytest.importorskip("lazrs", reason="an optional extra")
    head = laspy.LasHeader(point_format=7, version="1.4")
    head.offsets, head.scales = POINTS.min(axis=0), [0.001] * 3
    made = laspy.LasData(head)
    made.x, made.y, made.z = POINTS.T
    made.red, made.green, made.blue = (BYTES * 257).T
    path = tmp_path / f"a{ending}"
    made.write(str(path))
    for at_once in (5, 100):
        parts = list(PointParts(path, at_once))
        assert max(len(rows.points) for rows in parts) <= at_once
        np.testing.assert_allclose(np.concatenate([r.points for r in parts]), POINTS, rtol=0.0, atol=6e-4)
        np.testing.assert_array_equal(np.concatenate([r.colours for r in parts]), BYTES * 257)
    assert count_of(path) == COUNT


def test_an_e57_in_parts(tmp_path: Path) -> None:
    package = pytest.importorskip("pye57", reason="an optional extra")
    with package.E57(str(tmp_path / "a.e57"), mode="w") as file:
        for k in range(2):
            file.write_scan_raw({f"cartesian{axis}": POINTS[k::2, n] for n, axis in enumerate("XYZ")})
    parts = list(PointParts(tmp_path / "a.e57", 5))
    assert max(len(rows.points) for rows in parts) == 5
    np.testing.assert_allclose(np.concatenate([r.points for r in parts]), np.concatenate([POINTS[::2], POINTS[1::2]]))
    assert count_of(tmp_path / "a.e57") == COUNT


def meaning_of(path: Path) -> Meaning:
    parts = PointParts(path, 4)
    assert list(parts)
    return parts.meaning


def test_one_late_row_decides_what_columns_are(tmp_path: Path) -> None:
    """Columns without names are colours or normals only if the last row of the file agrees."""
    for late, coloured in ((255, True), (256, False), (-1, False), (3.5, False)):
        values = BYTES.astype(object)
        values[-1, 0] = late
        lines = [[*point, *colour] for point, colour in zip(POINTS.tolist(), values.tolist(), strict=True)]
        (tmp_path / "a.xyz").write_text("".join(" ".join(map(repr, line)) + "\n" for line in lines))
        assert (meaning_of(tmp_path / "a.xyz").top == 255.0) is coloured
    directions = NORMALS.copy()
    directions[-1] *= 1.5
    assert not meaning_of(text(tmp_path / "b.xyz", [POINTS, directions])).normals


def test_short_rows_lose_colours_but_no_points(tmp_path: Path) -> None:
    path = text(tmp_path / "a.xyz", [POINTS, BYTES])
    path.write_text(path.read_text() + "1 2 3\n")
    found = read_point_file(path)
    assert (len(found.points), found.colours) == (COUNT + 1, None)


def test_what_is_wrong_in_a_late_part_is_named(tmp_path: Path) -> None:
    path = text(tmp_path / "a.xyz", [POINTS])
    path.write_text(path.read_text() + "\n# the end\n4 five 6\n")
    with pytest.raises(FileFormatError, match=f"line {COUNT + 3}, '4 five 6', does not have three numbers"):
        list(PointParts(path, 4))


@pytest.mark.parametrize("kind", ["little ply", "las", "text ply", "binary pcd", "text pcd"])
def test_torn_files_are_refused(tmp_path: Path, kind: str) -> None:
    write, name, _, _ = FILES[kind]
    path = write(tmp_path / name)
    path.write_bytes(path.read_bytes()[: -len(path.read_bytes()) // 3])
    words = "its header and its data do not agree" if name == "a.pcd" else "ends before its last point|is no row of its"
    with pytest.raises(FileFormatError, match=f"'{name}' cannot be read: .*({words})"):
        list(PointParts(path, 4))


def test_a_ply_with_a_bad_row_names_it(tmp_path: Path) -> None:
    path = text(tmp_path / "a.ply", [POINTS, BYTES, NORMALS], ASCII_PLY)
    lines = path.read_text().splitlines()
    lines[-1] = "1 2 three 4 5 6 7 8 9"
    path.write_text("\n".join(lines))
    with pytest.raises(FileFormatError, match="'1 2 three 4 5 6 7 8 9' is no row of its points"):
        list(PointParts(path, 4))


def test_a_ply_whose_points_come_behind_lists_is_left_to_blender(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    head = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 3\n"
    head += "".join(f"property float {a}\n" for a in "xyz") + "end_header\n"
    path.write_text(head + "3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n")
    assert not in_parts(path)
    assert not in_parts(tmp_path / "a.blend")
