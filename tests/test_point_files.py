"""Point files as programs write them, read without Blender."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.operators.files.point_files import read_point_file
from sparse_surface.solver.errors import FileFormatError, InputError

POINTS = np.array([[500000.1234, 5600000.5678, 210.25], [500001.5, 5600002.25, 211.0], [500003.0, 5600004.0, -1.5e-3]])
BYTES = np.array([[255, 0, 0], [0, 128, 255], [1, 2, 3]])


def written(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def rows(separator: str, colours: bool = False, number: str = "{!r}") -> str:
    lines = []
    for point, colour in zip(POINTS.tolist(), BYTES.tolist(), strict=True):
        cells = [number.format(value) for value in point] + ([str(value) for value in colour] if colours else [])
        lines.append(separator.join(cells))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xyz", rows(" ")),
        ("a.asc", "# made by a scanner\n// and a comment\n\n" + rows("\t")),
        ("a.csv", rows(",")),
        ("a.csv", "\ufeffX,Y,Z\n" + rows(", ")),
        ("a.txt", '"Easting";"Northing";"Elevation"\n' + rows(";").replace(".", ",")),
        ("a.pts", "3\n" + rows(" ")),
        ("a.txt", rows("  ").replace("\n", "\r\n")),
    ],
    ids=["blanks", "comments", "commas", "header", "decimal commas", "count", "windows"],
)
def test_text_is_read_in_double_precision(tmp_path: Path, name: str, text: str) -> None:
    found = read_point_file(written(tmp_path, name, text))
    np.testing.assert_array_equal(found.points, POINTS)
    assert found.colours is None


def test_columns_may_come_in_any_order(tmp_path: Path) -> None:
    lines = "".join(
        f"{c[0]},{p[2]!r},{c[1]},{p[0]!r},{c[2]},{p[1]!r}\n" for p, c in zip(POINTS.tolist(), BYTES, strict=True)
    )
    found = read_point_file(written(tmp_path, "a.csv", "red,z,green,x,blue,y\n" + lines))
    np.testing.assert_array_equal(found.points, POINTS)
    np.testing.assert_allclose(found.colours, BYTES / 255.0)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xyz", rows(" ", colours=True)),
        (
            "a.pts",
            "3\n"
            + "".join(
                f"{p[0]!r} {p[1]!r} {p[2]!r} -120 {c[0]} {c[1]} {c[2]}\n"
                for p, c in zip(POINTS.tolist(), BYTES, strict=True)
            ),
        ),
    ],
    ids=["xyzrgb", "pts"],
)
def test_colours_behind_the_coordinates(tmp_path: Path, name: str, text: str) -> None:
    np.testing.assert_allclose(read_point_file(written(tmp_path, name, text)).colours, BYTES / 255.0)


def test_normals_are_no_colours(tmp_path: Path) -> None:
    text = "0 0 0 0 0.6 -0.8\n1 0 0 0 0 1\n0 1 0 1 0 0\n"
    assert read_point_file(written(tmp_path, "a.xyz", text)).colours is None


def test_normals_are_read(tmp_path: Path) -> None:
    normals = np.array([[0.0, 0.6, 0.8], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    lines = [[*point, *normal] for point, normal in zip(POINTS.tolist(), normals.tolist(), strict=True)]
    text = "".join(" ".join(map(repr, line)) + "\n" for line in lines)
    np.testing.assert_array_equal(read_point_file(written(tmp_path, "a.xyz", text)).normals, normals)
    named = "x y z nx ny nz\n" + text.replace("0.6", "0.06")
    found = read_point_file(written(tmp_path, "b.xyz", named))
    np.testing.assert_array_equal(found.normals[0], [0.0, 0.06, 0.8])
    assert read_point_file(written(tmp_path, "c.xyz", text.replace("0.6", "0.06"))).normals is None, "no lengths of one"
    header = "FIELDS x y z normal_x normal_y normal_z\nSIZE 8 8 8 4 4 4\nTYPE F F F F F F\nPOINTS 3\nDATA ascii\n"
    found = read_point_file(written(tmp_path, "a.pcd", header + text))
    np.testing.assert_allclose(found.normals, normals, rtol=1e-7)
    np.testing.assert_array_equal(found.points, POINTS)


def test_rows_that_are_no_numbers_are_left_to_the_clean_look(tmp_path: Path) -> None:
    found = read_point_file(written(tmp_path, "a.xyz", "0 0 0\nnan 1 2\n1 inf 3\n"))
    assert np.isfinite(found.points).all(axis=1).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0 0 0\n1 2\n", "line 2, '1 2', does not have three numbers"),
        ("# a\nx y z\n0 0 0\n\n1 two 3\n", "line 5, '1 two 3', does not have three numbers"),
        ("0 0 0\n" + "a" * 80 + "\n", "line 2, '" + "a" * 37 + "...', does not"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileFormatError, match=words.replace("...", r"\.\.\.")):
        read_point_file(written(tmp_path, "a.xyz", text))


def test_empty_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no points"):
        read_point_file(written(tmp_path, "a.csv", "x,y,z\n"))


# ----------------------------------------------------------------------------------------------------------------- PCD


def pcd_header(kind: str, letters: str = "F F F U") -> bytes:
    lines = ["# .PCD v0.7", "VERSION 0.7", "FIELDS x y z rgb", "SIZE 8 8 8 4", f"TYPE {letters}", "COUNT 1 1 1 1"]
    return "\n".join([*lines, "WIDTH 3", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", "POINTS 3", f"DATA {kind}\n"]).encode()


def packed() -> list[int]:
    return [int(red) << 16 | int(green) << 8 | int(blue) for red, green, blue in BYTES]


def lzf_literals(data: bytes) -> bytes:
    """What LibLZF writes for data that does not repeat: runs of up to 32 bytes behind their length less one."""
    return b"".join(bytes([len(run) - 1]) + run for run in (data[k : k + 32] for k in range(0, len(data), 32)))


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_pcd(tmp_path: Path, kind: str) -> None:
    columns = [*POINTS.T.tolist(), packed()]
    if kind == "ascii":
        body = "".join(f"{x!r} {y!r} {z!r} {c}\n" for x, y, z, c in zip(*columns, strict=True)).encode()
    elif kind == "binary":
        body = b"".join(struct.pack("<dddI", *row) for row in zip(*columns, strict=True))
    else:
        whole = b"".join(struct.pack(f"<3{letter}", *column) for letter, column in zip("dddI", columns, strict=True))
        body = lzf_literals(whole)
        body = struct.pack("<II", len(body), len(whole)) + body
    found = read_point_file(written(tmp_path, "a.pcd", pcd_header(kind) + body))
    np.testing.assert_array_equal(found.points, POINTS)
    np.testing.assert_allclose(found.colours, BYTES / 255.0)


def test_repeated_bytes_of_a_compressed_pcd(tmp_path: Path) -> None:
    whole = struct.pack("<9d", *([1.0] * 9)) + struct.pack("<3I", *([7] * 3))
    # 8 bytes, then 64 more from 8 bytes back: a reference copies length + 2, its length above 7 in a byte of its own
    body = bytes([7]) + whole[:8] + bytes([7 << 5, 64 - 2 - 7, 7]) + lzf_literals(whole[72:])
    header = pcd_header("binary_compressed")
    path = written(tmp_path, "a.pcd", header + struct.pack("<II", len(body), len(whole)) + body)
    np.testing.assert_array_equal(read_point_file(path).points, np.ones((3, 3)))


def test_a_torn_pcd_is_refused(tmp_path: Path) -> None:
    for name, content in (("a.pcd", pcd_header("binary") + b"1234"), ("b.pcd", pcd_header("ascii") + b"1 2\n")):
        with pytest.raises(FileFormatError, match="its header and its data do not agree"):
            read_point_file(written(tmp_path, name, content))


@pytest.mark.parametrize(("name", "package"), [("a.las", "laspy"), ("a.laz", "laspy"), ("a.e57", "pye57")])
def test_a_missing_package_is_named(tmp_path: Path, monkeypatch, name: str, package: str) -> None:
    monkeypatch.setitem(__import__("sys").modules, package, None)  # as if it were not installed
    with pytest.raises(FileFormatError, match=f"'{name}' needs the Python package {package}: pip install"):
        read_point_file(written(tmp_path, name, b"x"))


# ----------------------------------------------------------------------------------------------------------------- E57


def e57_with_normals(path: Path, points: np.ndarray, normals: np.ndarray, valid: np.ndarray) -> None:
    """Write a scan as scanners do: turned by a quarter about z and moved, points that were not measured marked."""
    package = pytest.importorskip("pye57", reason="an optional extra")
    library, file = package.libe57, package.E57(str(path), mode="w")
    image, fields = file.image_file, [f"cartesian{axis}" for axis in "XYZ"] + [f"nor:normal{axis}" for axis in "XYZ"]
    image.extensionsAdd("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt")
    scan, prototype, pose = (library.StructureNode(image) for _ in range(3))
    columns = [np.ascontiguousarray(column) for column in np.hstack([points, normals]).T]
    for name in fields:
        prototype.set(name, library.FloatNode(image, 0.0, library.E57_DOUBLE, -10.0, 10.0))
    prototype.set("cartesianInvalidState", library.IntegerNode(image, 0, 0, 1))
    turn, move = {"w": 0.5**0.5, "x": 0.0, "y": 0.0, "z": 0.5**0.5}, {"x": 100.0, "y": 0.0, "z": 0.0}
    for part, values in (("rotation", turn), ("translation", move)):
        node = library.StructureNode(image)
        for name, value in values.items():
            node.set(name, library.FloatNode(image, value))
        pose.set(part, node)
    scan.set("pose", pose)
    stored = library.CompressedVectorNode(image, prototype, library.VectorNode(image, True))
    scan.set("points", stored)
    file.data3d.append(scan)
    buffers = library.VectorSourceDestBuffer()
    for name, column in zip([*fields, "cartesianInvalidState"], [*columns, 1.0 - valid], strict=True):
        buffers.append(library.SourceDestBuffer(image, name, column, len(points), True, True))
    writer = stored.writer(buffers)
    writer.write(len(points))
    writer.close()
    file.close()


def test_normals_of_an_e57_scan_are_turned_with_it(tmp_path: Path) -> None:
    points = np.array([[1.0, 2.0, 3.0], [9.0, 9.0, 9.0], [-1.0, 0.5, 0.25]])
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]])
    e57_with_normals(tmp_path / "a.e57", points, normals, np.array([1.0, 0.0, 1.0]))
    found = read_point_file(tmp_path / "a.e57")
    np.testing.assert_allclose(found.points, [[98.0, 1.0, 3.0], [99.5, -1.0, 0.25]], atol=1e-12)
    np.testing.assert_allclose(found.normals, [[0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]], atol=1e-12)


def test_an_e57_file_without_normals(tmp_path: Path) -> None:
    package = pytest.importorskip("pye57", reason="an optional extra")
    columns = {f"cartesian{axis}": np.array([0.0, 1.0, 2.5]) for axis in "XYZ"}
    columns |= {f"color{name}": np.array([0, 255, 51]) for name in ("Red", "Green", "Blue")}
    with package.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(columns)
    found = read_point_file(tmp_path / "a.e57")
    np.testing.assert_array_equal(found.points, np.repeat([[0.0], [1.0], [2.5]], 3, axis=1))
    np.testing.assert_allclose(found.colours, np.repeat([[0.0], [1.0], [0.2]], 3, axis=1))
    assert found.normals is None
