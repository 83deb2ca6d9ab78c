"""Saved representations: the same surface, the same bytes, and refusal of everything else in one sentence."""

from __future__ import annotations

import io
import json
import re
import tracemalloc
import zipfile
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sparse_surface.benchmarks.generated_models import cube, tetrahedron
from sparse_surface.solver import FileFormatError, Representation, Settings, approximate
from sparse_surface.solver.surface.files import FORMAT, FORMAT_1, LAYERS

QUICK = {"ring": 4, "degree": 8, "sparsity": 8, "iterations": 3, "sweeps": 0}
KINDS: dict[str, dict[str, object]] = {
    "default": {},
    "separate": {"domains": "separate"},
    "paper": {"basis": "monomial", "blending": "uniform"},
}


@cache
def representation(kind: str = "default") -> Representation:
    return approximate(*cube(6), Settings(**{**QUICK, **KINDS[kind]})).representation


@cache
def saved(kind: str = "default") -> bytes:
    return representation(kind).stored


@cache
def saved_before(kind: str = "default") -> bytes:
    """The same in format 1, as earlier versions wrote it."""
    surface = representation(kind)
    arrays = {name: getattr(surface, name) for name in LAYERS}
    for name, array in arrays.items():
        if array.dtype.kind == "i":
            arrays[name] = array.astype("<i2" if name == "support" else "<u2")
    for name in ("initial_domains", "energy", "domains", "vertices"):
        arrays[name] = arrays[name].astype("<f4")
    head = {"format": FORMAT.name, "version": 1, **{key: getattr(surface, key) for key in sorted(FORMAT_1.keys)}}
    return archive_of({"head": np.frombuffer(json.dumps(head).encode(), dtype=np.uint8), **arrays})


def points_of(surface: Representation) -> NDArray[np.float64]:
    rng = np.random.default_rng(3)
    count = 500
    return surface.evaluate(rng.integers(0, len(surface.triangles), count), rng.dirichlet([1.0, 1.0, 1.0], count))


def arrays_of(data: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def archive_of(arrays: dict[str, NDArray[Any]]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def head_of(arrays: dict[str, NDArray[Any]], **changes: object) -> NDArray[np.uint8]:
    head = {**json.loads(arrays["head"].tobytes()), **changes}
    return np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)


@pytest.mark.parametrize("kind", list(KINDS))
def test_it_is_the_same_surface(kind: str, tmp_path: Path) -> None:
    surface = representation(kind)
    path = tmp_path / "surface.npz"
    surface.save(path)
    loaded = Representation.load(path)
    np.testing.assert_allclose(points_of(loaded), points_of(surface), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(loaded.at_vertices(), surface.at_vertices(), rtol=0.0, atol=1e-6)
    for item in fields(Representation):
        before, after = getattr(surface, item.name), getattr(loaded, item.name)
        if isinstance(before, np.ndarray):
            assert (before.dtype, before.shape) == (after.dtype, after.shape), item.name
            np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-6, err_msg=item.name)
        else:
            assert before == after
    assert sorted(tmp_path.iterdir()) == [path]


def test_indices_and_coefficients_are_kept_to_the_last_bit() -> None:
    surface, loaded = representation(), Representation.from_bytes(saved())
    for name in ("triangles", "face_corners", "patch_triangles", "support", "coefficients", "weights", "vertices"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(surface, name))


def test_far_from_the_origin_it_is_as_exact(tmp_path: Path) -> None:
    vertices, faces = cube(6)
    surface = approximate(vertices * 1e-3 + 5.0, faces, Settings(**QUICK)).representation
    loaded = Representation.from_bytes(surface.stored)
    np.testing.assert_allclose(points_of(loaded), points_of(surface), rtol=0.0, atol=1e-9)


def test_steep_functions_keep_the_surface_as_it_is() -> None:
    """A function of steep slope would move if its domain was rounded as those of others."""
    surface = representation()
    steep = replace(surface, coefficients=surface.coefficients * 1e5)
    loaded = Representation.from_bytes(steep.stored)
    np.testing.assert_allclose(loaded.at_vertices(), steep.at_vertices(), rtol=0.0, atol=1e-6)


def test_same_representation_same_bytes(tmp_path: Path) -> None:
    surface = representation()
    again = approximate(*cube(6), Settings(**QUICK)).representation
    assert surface.stored == again.stored
    loaded = Representation.from_bytes(saved())
    assert loaded.stored == Representation.from_bytes(loaded.stored).stored
    surface.save(tmp_path / "a.npz")
    surface.save(str(tmp_path / "b.npz"))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes() == saved() == surface.stored


def test_a_mesh_without_patches_can_be_saved() -> None:
    vertices, faces = tetrahedron()
    surface = approximate(vertices, faces, weights=np.zeros(len(vertices))).representation
    loaded = Representation.from_bytes(surface.stored)
    np.testing.assert_array_equal(points_of(loaded), points_of(surface))


def test_numpy_reads_it_without_pickle() -> None:
    arrays = arrays_of(saved())
    assert sorted(arrays) == ["data", "head"]
    assert json.loads(arrays["head"].tobytes())["version"] == FORMAT.version


def test_earlier_files_are_read() -> None:
    """What this version makes in format 1, and a file that an earlier version wrote."""
    surface, loaded = representation(), Representation.from_bytes(saved_before())
    np.testing.assert_allclose(points_of(loaded), points_of(surface), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(loaded.initial_domains, surface.initial_domains, atol=1e-6)
    earlier = Representation.load(Path(__file__).parent / "data" / "cube_format_1.representation")
    corners = np.abs(earlier.at_vertices()).max(axis=0)
    assert (earlier.patches, len(earlier.triangles)) == (10, 192)
    np.testing.assert_allclose(earlier.vertices, cube(4)[0], atol=1e-7)
    assert (np.abs(corners - np.abs(cube(4)[0]).max(axis=0)) < 0.1).all()
    again = Representation.from_bytes(earlier.stored)
    np.testing.assert_allclose(points_of(again), points_of(earlier), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(again.initial_domains, earlier.initial_domains, atol=1e-6)


def test_files_of_format_2_are_read() -> None:
    """A compact file of a cube with creases, from before walks and before nodes were left out."""
    path = Path(__file__).parent / "data" / "cube_format_2.representation"
    assert json.loads(arrays_of(path.read_bytes())["head"].tobytes())["version"] == 2
    earlier = Representation.load(path)
    assert (earlier.patches, len(earlier.triangles), len(earlier.creases)) == (12, 192, 48)
    np.testing.assert_array_equal(earlier.face_corners, np.ravel(cube(4)[1]))
    assert np.abs(earlier.at_vertices() - cube(4)[0]).max() < 1e-5
    again = Representation.from_bytes(earlier.compact)
    np.testing.assert_allclose(points_of(again), points_of(earlier), rtol=0.0, atol=2e-5)


def test_an_existing_file_is_replaced_and_survives_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "surface.npz"
    path.write_bytes(b"before")
    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
        with pytest.raises(OSError, match="disk full"):
            representation().save(path)
    assert path.read_bytes() == b"before"
    assert sorted(tmp_path.iterdir()) == [path]
    representation().save(path)
    assert path.read_bytes() == saved()
    with pytest.raises(FileNotFoundError):
        representation().save(tmp_path / "nowhere" / "surface.npz")
    with pytest.raises(FileNotFoundError):
        Representation.load(tmp_path / "nowhere.npz")


def refusal(data: bytes) -> str:
    with pytest.raises(FileFormatError) as caught:
        Representation.from_bytes(data, "'a.npz'")
    sentence = str(caught.value)
    assert re.fullmatch(r"'a\.npz' [^\n]*\.", sentence), sentence
    return sentence


def test_foreign_files_are_refused() -> None:
    pickled = io.BytesIO()
    np.save(pickled, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    plain = io.BytesIO()
    np.savez(plain, vertices=np.zeros((3, 3)))
    other = io.BytesIO()
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("head.npy", "no array")
    for data in (b"", b"PK", b"solid cube", pickled.getvalue(), plain.getvalue()):
        assert "is not a saved representation" in refusal(data)
    refusal(other.getvalue())
    head = arrays_of(saved())
    assert "is not a saved representation" in refusal(archive_of({"head": head_of(head, format="mesh")}))
    assert "is not a saved representation" in refusal(archive_of({"head": np.zeros(5000, dtype=np.uint8)}))
    assert "is not a saved representation" in refusal(archive_of({"head": np.zeros(5)}))


def test_newer_files_are_refused_by_their_version() -> None:
    arrays = arrays_of(saved_before())
    newer = {"head": head_of(arrays, version=FORMAT.version + 1, more=True), "other": np.zeros(3)}
    assert "newer version" in refusal(archive_of(newer))
    for version in (0, "1", None, 1.5, [1]):
        refusal(archive_of({**arrays, "head": head_of(arrays, version=version)}))


def test_cut_files_are_refused() -> None:
    data = saved()
    for end in {*range(0, len(data), 997), len(data) - 1, len(data) - 22, len(data) - 23}:
        assert re.search("cut or damaged|not a saved representation|is damaged", refusal(data[:end]))
    assert "cut or damaged" in refusal(data[: len(data) // 2])


FORGERIES: dict[str, tuple[str, Any]] = {
    "offsets that descend": ("vertex_offsets", lambda a: a[::-1].copy()),
    "offsets beyond the end": ("triangle_offsets", lambda a: a + 1),
    "offsets that do not ascend": ("face_offsets", lambda a: np.r_[a[:1], a[2:3], a[1:2], a[3:]]),
    "a vertex that is not there": ("triangles", lambda a: a + 1),
    "a face corner that is not there": ("face_corners", lambda a: a + 200),
    "a polygon that is not there": ("polygon", lambda a: a + 1),
    "a mesh triangle that is not there": ("mesh_triangles", lambda a: np.full_like(a, 65535)),
    "negative indices": ("patch_vertices", lambda a: a.astype(np.int32) - 1),
    "a local vertex that is not there": ("patch_triangles", lambda a: a + 60),
    "triangles that are not the mesh's": ("patch_triangles", lambda a: np.roll(a, 1, axis=0)),
    "a function that is not there": ("support", lambda a: a + 200),
    "the function after the last": ("support", lambda a: np.where(a == a.max(), 45, a)),  # 9 * 10 / 2 of degree 8
    "negative functions": ("support", lambda a: a - 3),
    "values that are not finite": ("coefficients", lambda a: a * np.nan),
    "infinite domains": ("domains", lambda a: a + np.float32(np.inf)),
    "enormous domains": ("domains", lambda a: a + np.float32(1e30)),
    "enormous vertices": ("vertices", lambda a: a.astype(np.float64) * 1e300),
    "negative weights": ("weights", lambda a: a - 1.0),
    "vanishing scales": ("scales", lambda a: a * 0.0),
    "infinite energy": ("energy", lambda a: a + np.float32(np.inf)),
    "another type": ("weights", lambda a: a.astype(np.float16)),
    "complex numbers": ("weights", lambda a: a.astype(np.complex128)),
    "the other byte order": ("weights", lambda a: a.astype(">f8")),
    "the other memory order": ("domains", np.asfortranarray),
    "text": ("origins", lambda a: a.astype("S8")),
    "a dimension less": ("domains", lambda a: a[0]),
    "a dimension more": ("weights", lambda a: a[None]),
    "other sizes": ("weights", lambda a: a[:-1]),
    "two domains": ("scales", lambda a: np.repeat(a, 2, axis=1)),
    "no offsets": ("vertex_offsets", lambda a: a[:0]),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_forged_contents_are_refused(name: str) -> None:
    arrays = arrays_of(saved_before())
    layer, change = FORGERIES[name]
    with np.errstate(all="ignore"):
        arrays[layer] = change(arrays[layer])
    assert "is damaged" in refusal(archive_of(arrays))


@pytest.mark.parametrize(
    "changes",
    [
        {"degree": 99},
        {"degree": -1},
        {"degree": True},
        {"degree": 8.0},
        {"basis": "fourier"},
        {"blending": 3},
        {"more": 1},
    ],
    ids=str,
)
def test_forged_heads_are_refused(changes: dict[str, object]) -> None:
    arrays = arrays_of(saved_before())
    refusal(archive_of({**arrays, "head": head_of(arrays, **changes)}))


def test_missing_foreign_and_double_arrays_are_refused() -> None:
    arrays = arrays_of(saved_before())
    for name in set(arrays) - {"head"}:
        assert f"it lacks {name}" in refusal(archive_of({key: arrays[key] for key in arrays if key != name}))
    assert "does not belong" in refusal(archive_of({**arrays, "extra": np.zeros(2)}))
    double = io.BytesIO(saved_before())
    with zipfile.ZipFile(double, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("weights.npy", b"")
    assert "twice" in refusal(double.getvalue())


def test_two_domains_are_refused() -> None:
    """A coordinate has a domain of its own, or all share one: two would leave a coordinate without."""
    arrays = arrays_of(saved_before())
    for name, axis in (("domains", 0), ("initial_domains", 0), ("scales", 1)):
        arrays[name] = np.repeat(arrays[name], 2, axis=axis)
    assert "it has 2 domains" in refusal(archive_of(arrays))


def test_a_triangle_twice_in_a_patch_is_refused() -> None:
    arrays = arrays_of(saved_before())
    for name in ("patch_triangles", "mesh_triangles"):
        arrays[name][1] = arrays[name][0]
    assert "twice" in refusal(archive_of(arrays))


def test_sizes_are_compared_before_anything_is_allocated() -> None:
    """A header that promises gigabytes, alone and with the archive's directory forged to agree."""
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (100000000, 3), }"
    header += b" " * (117 - len(header)) + b"\n"
    array = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(saved_before())) as source, zipfile.ZipFile(file, "w") as archive:
        for entry in source.infolist():
            archive.writestr(entry, array if entry.filename == "vertices.npy" else source.read(entry))
    claimed = len(array) + 8 * 3 * 10**8
    data = bytearray(file.getvalue())
    place = next(m.start() for m in re.finditer(b"PK\x01\x02.{42}vertices.npy", data, re.DOTALL))
    data[place + 24 : place + 28] = claimed.to_bytes(4, "little")
    tracemalloc.start()
    try:
        assert "wrong size" in refusal(file.getvalue())
        assert "forged" in refusal(bytes(data))
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


def test_repetitions_do_not_fill_the_memory() -> None:
    """Arrays that are all there, of sizes that agree, but made of nothing: 480 MB in a file of half of one."""
    arrays = arrays_of(saved_before())
    count = 20_000_000
    file = io.BytesIO(archive_of({name: array for name, array in arrays.items() if name != "vertices"}))
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%d, 3), }" % count
    header += b" " * (117 - len(header)) + b"\n"
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as archive, archive.open("vertices.npy", "w") as stream:
        stream.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
        for _ in range(24):
            stream.write(bytes(count))
    tracemalloc.start()
    try:
        assert "repetitions" in refusal(file.getvalue())
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


def test_what_evaluation_would_take_is_counted_before() -> None:
    """Empty patches are small in a file, and each takes a table of its functions: 124 kB led to 4 GB."""
    arrays, count = arrays_of(saved_before()), 60_000
    for name in ("vertex_offsets", "triangle_offsets"):
        arrays[name] = np.zeros(count + 1, dtype="<u2")
    for name in ("patch_vertices", "patch_triangles", "mesh_triangles", "weights"):
        arrays[name] = arrays[name][:0]
    for name in ("domains", "initial_domains"):
        arrays[name] = arrays[name][:, :0]
    arrays |= {"origins": np.zeros((count, 3)), "scales": np.ones((count, 1)), "energy": np.zeros((count, 0), "<f4")}
    arrays |= {"support": np.zeros((count, 3, 1), "<i2"), "coefficients": np.zeros((count, 3, 1))}
    assert "fill the memory" in refusal(archive_of(arrays))


@pytest.mark.parametrize(
    "changes",
    [{"coefficients": 1e60}, {"coefficients": -1e60}, {"origins": 1e59}],
    ids=str,
)
def test_functions_that_reach_out_of_all_bounds_are_refused(changes: dict[str, float]) -> None:
    arrays = arrays_of(saved_before())
    for name, value in changes.items():
        arrays[name] = np.full_like(arrays[name], value)
    assert "is damaged" in refusal(archive_of(arrays))


def loads_as_before_or_refuses(data: bytes) -> None:
    try:
        loaded = Representation.from_bytes(data, "'a.npz'")
    except FileFormatError:
        refusal(data)
    else:
        np.testing.assert_array_equal(points_of(loaded), points_of(Representation.from_bytes(saved())))


@given(st.data())
def test_damaged_bytes_are_refused_or_harmless(data: st.DataObject) -> None:
    """Single bytes changed, pieces cut out, repeated or overwritten, anywhere or near the archive's directory."""
    content = bytearray(saved())
    for _ in range(data.draw(st.integers(1, 3))):
        first = max(len(content) - 1500, 0) if data.draw(st.booleans()) else 0
        place = data.draw(st.integers(first, max(len(content) - 1, 0)))
        piece = data.draw(st.binary(min_size=1, max_size=8))
        kind = data.draw(st.sampled_from(("overwrite", "insert", "remove")))
        end = place + (0 if kind == "insert" else len(piece))
        content[place:end] = b"" if kind == "remove" else piece
    loads_as_before_or_refuses(bytes(content))


@given(st.data())
def test_forged_values_are_refused_or_can_be_evaluated(data: st.DataObject) -> None:
    """Valid archives with some numbers changed: what loads must evaluate without an error or a warning."""
    arrays = arrays_of(saved_before(data.draw(st.sampled_from(list(KINDS)))))
    name = data.draw(st.sampled_from(sorted(set(arrays) - {"head"})))
    array = arrays[name].reshape(-1).copy()
    if array.dtype.kind == "f":
        value: Any = data.draw(st.floats(width=8 * array.itemsize))
    else:
        limits = np.iinfo(array.dtype)
        value = data.draw(st.integers(int(limits.min), int(limits.max)) | st.integers(0, 300))
    array[data.draw(st.integers(0, len(array) - 1))] = value
    arrays[name] = array.reshape(arrays[name].shape)
    try:
        loaded = Representation.from_bytes(archive_of(arrays))
    except FileFormatError:
        return
    assert np.isfinite(points_of(loaded)).all()
    assert np.isfinite(loaded.at_vertices()).all()


@given(
    layer=st.sampled_from(["vertices", "weights", "domains", "support", "face_offsets", "head"]),
    kind=st.sampled_from(["<f8", "<f4", "<i4", "|O", "|S9", "<c16", "|u1", "[('a','<f8')]"]),
    shape=st.lists(st.integers(0, 10**12), max_size=4),
    fortran=st.booleans(),
    claimed=st.none() | st.integers(0, 2**32 - 2),
)
def test_forged_headers_are_refused_without_allocating(
    layer: str, kind: str, shape: list[int], fortran: bool, claimed: int | None
) -> None:
    """An array's own header that promises anything, with or without a directory that agrees."""
    header = f"{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': {tuple(shape)}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    array = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + b"\0" * 40
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(saved_before())) as source, zipfile.ZipFile(file, "w") as archive:
        for entry in source.infolist():
            archive.writestr(entry, array if entry.filename == f"{layer}.npy" else source.read(entry))
    data = bytearray(file.getvalue())
    if claimed is not None:
        place = next(m.start() for m in re.finditer(b"PK\x01\x02.{42}" + layer.encode() + b".npy", data, re.DOTALL))
        data[place + 24 : place + 28] = claimed.to_bytes(4, "little")
    tracemalloc.start()
    try:
        refusal(bytes(data))
        assert tracemalloc.get_traced_memory()[1] < 2e6
    finally:
        tracemalloc.stop()


@given(place=st.integers(0, 2**40), bit=st.integers(0, 7))
def test_a_flipped_bit_is_noticed_or_harmless(place: int, bit: int) -> None:
    content = bytearray(saved())
    content[place % len(content)] ^= 1 << bit
    loads_as_before_or_refuses(bytes(content))


@given(st.binary(max_size=200) | st.binary(max_size=200).map(lambda tail: b"PK\x03\x04" + tail))
def test_noise_is_refused(data: bytes) -> None:
    refusal(data)
