"""How close denoising comes on published cases, beside MeshLab and MeshLib where their packages are installed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..solver import denoise
from .cases import alone, unit_seconds
from .denoising import closeness
from .tables import Table

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Read = Callable[[Path], tuple[NDArray[Any], NDArray[Any]]]

CASES = {
    "fandisk-gauss-0.3": "guided normal filter 2.5, bilateral 3.4",
    "block-gauss-0.4": "guided normal filter 3.7",
    "twelve-impulsive-0.5": "guided normal filter 2.9",
    "trim-star-gauss-n3": "GCN-Denoiser 5.3",
    "block-all-directions": "total generalised variation 2.9, guided normal filter 4.3",
    "kinect-pyramid": "total generalised variation 6.2, guided normal filter 7.5",
}
"""Published cases, with the mean angles in degrees of published results or of parameters chosen on the clean mesh."""

PACKAGES = {"MeshLab": "pymeshlab", "MeshLib": "meshlib"}


def run(folder: Path, read: Read, say: Callable[[str], None]) -> tuple[dict[str, Table], Any]:
    """Denoise each case that is there; returns a table, and everything as plain values."""
    for name, package in PACKAGES.items():
        if find_spec(package) is None:
            say(f"{name} is left out: its package {package} is not installed")
    values = {}
    for name in CASES:
        paths = [folder / f"{name}-{kind}.ply" for kind in ("noisy", "truth")]
        if not all(path.is_file() for path in paths):
            say(f"{name} is not in {folder} and is left out")
            continue
        say(name)
        (noisy, triangles), (clean, _) = map(read, paths)
        values[name] = alone(measure, noisy, clean, triangles)
    if not values:
        return {}, values
    kinds = ["noisy", "denoised", *(f"{name}{kind}" for name in PACKAGES for kind in ("", ", best"))]
    rows = [
        [name, *(f"{found[kind]:.2f}" if kind in found else "" for kind in kinds), CASES[name], found["units"]]
        for name, found in values.items()
    ]
    return {"published noise": Table.of(["case", *kinds, "published", "units"], rows)}, values


def measure(noisy: Array, clean: Array, triangles: Indices) -> dict[str, float]:
    """Return mean angles between face normals, degrees, and the units of denoising; in a process of its own."""
    unit, start = unit_seconds(5), time.perf_counter()
    denoised = denoise(noisy, triangles).vertices
    units = (time.perf_counter() - start) / (0.5 * (unit + unit_seconds(5)))
    found = {"noisy": noisy, "denoised": denoised}
    angles = {kind: closeness(clean, triangles, vertices).degrees for kind, vertices in found.items()}
    for name, filtered in (("MeshLab", by_meshlab), ("MeshLib", by_meshlib)):
        if find_spec(PACKAGES[name]) is not None:
            peers = [closeness(clean, triangles, each).degrees for each in filtered(noisy, triangles)]
            angles |= {name: peers[0], f"{name}, best": min(peers)}
    return {**angles, "units": units}


def by_meshlab(vertices: Array, triangles: Indices) -> Iterator[Array]:
    """Yield the vertices after MeshLab's two-step smoothing: with its defaults, then with other settings."""
    pymeshlab: Any = import_module("pymeshlab")
    others = [
        {"normalthr": angle, "stepsmoothnum": rounds, "stepnormalnum": inner}
        for angle, rounds, inner in product((30.0, 45.0, 60.0), (3, 10), (5, 20))
    ]
    for settings in [{}, *others]:
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(vertices, triangles))
        meshes.apply_coord_two_steps_smoothing(**settings)
        yield np.array(meshes.current_mesh().vertex_matrix())


def by_meshlib(vertices: Array, triangles: Indices) -> Iterator[Array]:
    """Yield the vertices after MeshLib's denoising via normals: with its defaults, then with other settings."""
    meshes: Any = import_module("meshlib.mrmeshpy")
    arrays: Any = import_module("meshlib.mrmeshnumpy")
    for choice in [None, *product((5.0, 20.0, 80.0), (0.003, 0.009, 0.03))]:
        settings = meshes.DenoiseViaNormalsSettings()
        if choice is not None:
            settings.gamma, settings.beta = choice
        mesh = arrays.meshFromFacesVerts(triangles.astype(np.int32), vertices)
        meshes.meshDenoiseViaNormals(mesh, settings)
        yield np.array(arrays.getNumpyVerts(mesh))
