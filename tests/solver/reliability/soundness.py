"""What must hold of every input: a result that is right by itself, or one clear sentence."""

from __future__ import annotations

import json
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay
from sparse_surface.solver import Approximation, InputError, Representation, Settings, approximate

Faces = ArrayLike | list[list[int]]

RESULT, REFUSAL = "result", "refusal"

STEPS = 12
"""Parts of an edge in the lattice: 91 points a triangle."""

LATTICE = np.array([[i, j, STEPS - i - j] for i in range(STEPS + 1) for j in range(STEPS + 1 - i)]) / STEPS
LATTICE_TRIANGLES = Delaunay(LATTICE[:, :2]).simplices


def approximated(vertices: ArrayLike, faces: Faces, settings: Settings) -> tuple[str, Approximation | str]:
    """Approximate and check: (`RESULT`, the result) or (`REFUSAL`, the sentence).

    Raises
    ------
    AssertionError
        When the result is not sound, the refusal is not a clear sentence, or good input is refused.
    """
    before = np.array(vertices, copy=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found: Approximation | str = approximate(vertices, faces, settings)
        except InputError as refused:
            found = str(refused)
    assert np.array_equal(before, np.asarray(vertices), equal_nan=True), "the input was changed"
    if isinstance(found, str):
        check_sentence(found)
        assert not is_usable(before, faces), f"good input is refused: {found}"
        return REFUSAL, found
    check_result(before, faces, settings, found)
    return RESULT, found


def check_sentence(text: str) -> None:
    """One line, that ends as a sentence does, and is free of programmers' jargon."""
    assert text.strip() == text
    assert text.endswith(".")
    assert "\n" not in text
    assert 10 < len(text) < 250
    for word in ("Traceback", "ndarray", "None", "object at", "array("):
        assert word not in text, text


def is_usable(vertices: NDArray[Any], faces: Faces) -> bool:
    """Whether input is beyond doubt good: finite, of existing vertices, and with an area worth the name."""
    polygons = [np.asarray(face, dtype=np.int64) for face in faces]  # type: ignore[union-attr]
    if not len(vertices) or not polygons or not np.isfinite(vertices).all() or np.abs(vertices).max() > 1e50:
        return False
    if any(len(face) < 3 or face.min() < 0 or face.max() >= len(vertices) for face in polygons):
        return False
    used = vertices[np.unique(np.concatenate(polygons))].astype(np.float64)
    size = np.ptp(used, axis=0).max()
    if size < 1e-40:
        return False
    points = (vertices.astype(np.float64) - used[0]) / size
    area = 0.0
    for face in polygons:
        corners = points[face]
        area += np.linalg.norm(np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0))
    return bool(area > 1e-9)


def check_result(vertices: NDArray[Any], faces: Faces, settings: Settings, result: Approximation) -> None:
    """Everything is finite, and the report says what anyone can measure on the result."""
    count, report = len(vertices), result.report
    given = vertices.astype(np.float64)
    assert result.vertices.shape == (count, 3)
    assert result.vertices.dtype == (vertices.dtype if vertices.dtype.kind == "f" else np.float64)
    for array in (result.vertices, result.error, result.domain_stretch):
        assert np.isfinite(array).all()
    json.dumps(report, allow_nan=False)
    # distances of huge coordinates may not be squared as they are
    size = max(report["input"]["bounding_box_longest_side"], 1e-300)
    moved = size * np.linalg.norm((result.vertices.astype(np.float64) - given) / size, axis=1)
    np.testing.assert_allclose(result.error, moved, rtol=1e-6, atol=1e-12 * size)
    assert (result.patch >= -1).all()
    assert result.patch.max(initial=-1) < report["patches"]
    assert (result.domain_stretch >= 1.0).all()
    assert len(result.domain_stretch) == len(faces) == report["input"]["faces"]  # type: ignore[arg-type]
    assert report["input"]["vertices"] == count
    if settings.denoise == "off":
        held = result.patch < 0
        np.testing.assert_array_equal(result.vertices[held], vertices[held])
        assert report["passed_through_vertices"] == int(held.sum())
    np.testing.assert_allclose(report["vertex_error"]["max"], result.error.max(), rtol=1e-9, atol=1e-300)
    for kind in ("vertex_error", "surface_error"):
        own = report[kind]
        assert 0.0 <= own["mean"] <= own["rms"] * (1 + 1e-9)
        assert own["rms"] <= own["max"] * (1 + 1e-9)
    assert report["relative"]["vertex_max"] == report["vertex_error"]["max"] / size or size <= 1e-300
    assert report["seam_max"] >= 0.0
    assert min(report["seconds"].values()) >= 0.0
    if settings.tolerance and settings.denoise == "off" and settings.resolved().blending == "partition":
        rounding = 1e-6 * size if vertices.dtype == np.float32 else 1e-9 * np.abs(given).max()
        assert report["tolerance"]["achieved"] <= settings.tolerance + rounding
    check_representation(result)
    check_largest_error(given, result, rounding_of(vertices, size))


def rounding_of(vertices: NDArray[Any], size: float) -> float:
    """Length below which differences mean nothing, of coordinates (V, 3) whose longest side is `size`."""
    largest = np.abs(vertices.astype(np.float64)).max(initial=0.0)
    return 1e-6 * max(size, 0.1 * largest) if vertices.dtype == np.float32 else 1e-9 * max(size, largest)


def check_largest_error(given: NDArray[np.float64], result: Approximation, rounding: float) -> None:
    """No point of a dense lattice shows more than the reported error, and none more than its bound.

    Nearest distances, by libigl where it is installed, keep the bound in both directions.
    """
    stored, reported = result.representation, result.report["surface_error"]
    if len(stored.vertices) != len(given):  # vertices that were held together are one there
        given = stored.vertices
    triangles = np.asarray(stored.triangles)
    if not len(triangles):
        return
    size = max(result.report["input"]["bounding_box_longest_side"], 1e-300)
    face = np.repeat(np.arange(len(triangles)), len(LATTICE))
    flat = np.einsum("sk,tkd->tsd", LATTICE, given[triangles]).reshape(-1, 3)
    surface = stored.evaluate(face, np.tile(LATTICE, (len(triangles), 1)))
    largest = size * float(np.linalg.norm((surface - flat) / size, axis=1).max())
    assert largest <= 1.02 * reported["max"] + rounding, f"{largest} where {reported['max']} is reported"
    assert largest <= reported["bound"] * (1 + 1e-9) + rounding, f"{largest} beyond the bound {reported['bound']}"
    check_nearest(surface, flat, triangles, reported["bound"], rounding)


def check_nearest(
    surface: NDArray[np.float64],
    flat: NDArray[np.float64],
    triangles: NDArray[Any],
    bound: float,
    rounding: float,
) -> None:
    """The lattice's points on the surface and on the input lie within `bound` of the other one's triangles."""
    try:
        import igl
    except ImportError:
        return
    middle, size = flat.mean(axis=0), np.ptp(flat, axis=0).max()
    if not 1e-100 < size < 1e100:
        return
    one, other = (surface - middle) / size, (flat - middle) / size
    cells = np.concatenate([LATTICE_TRIANGLES + len(LATTICE) * k for k in range(len(triangles))])
    for points, target in ((one, other), (other, one)):
        squared = igl.point_mesh_squared_distance(points, target, cells)[0]
        assert np.sqrt(squared.max()) * size <= bound * (1 + 1e-9) + 2.0 * rounding


def check_representation(result: Approximation) -> None:
    """It can be stored, read and evaluated, and passes through the result's vertices."""
    stored = result.representation
    read = Representation.from_bytes(stored.stored)
    assert read.patches == stored.patches == result.report["patches"]
    size = np.ptp(stored.vertices, axis=0).max()
    used = np.unique(stored.triangles)
    difference = np.abs(read.at_vertices() - stored.at_vertices())[used]
    assert difference.max(initial=0.0) <= 1e-6 * size + 1e-7 * np.abs(stored.vertices).max()
    middle = np.full((len(stored.triangles), 3), 1.0 / 3.0)
    assert np.isfinite(stored.evaluate(np.arange(len(stored.triangles)), middle)).all()
