"""The pictures of docs/representation.md and docs/denoising.md."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray
from paper_figures.models import SHARED, read_mesh
from paper_figures.shots import BUFF, Shown, View, error_colours, shoot
from sparse_surface.benchmarks.denoising import closeness, with_noise
from sparse_surface.operators.data.colours import ColourScale, linear_to_srgb, srgb_to_linear
from sparse_surface.solver import Settings, approximate
from sparse_surface.solver.mesh.sampling import triangle_grid
from sparse_surface.solver.surface.inspection import patch_energy, patch_sheet, patch_terms
from sparse_surface.solver.surface.resampling import resample

Array = NDArray[np.float64]

FANDISK = View(azimuth=205.0, elevation=28.0, up="Y")
BUNNY = View(azimuth=15.0, elevation=12.0, up="Y")
CAMERA = View(azimuth=200.0, elevation=15.0, up="Y")
SIZE = (520, 440)
PATCH = 20
DOTS = 100
REFLECTED_SPLITS = 6
STRIPES = 14.0


def denoise(path: Path) -> None:
    """Clean, with noise, denoised: fandisk at three levels of noise, the bunny at one."""
    rows = (
        ("fandisk.obj", 0.003, FANDISK),
        ("fandisk.obj", 0.01, FANDISK),
        ("stanford-bunny.ply", 0.003, BUNNY),
    )
    figure, axes = plt.subplots(len(rows), 3, figsize=(13.0, 12.0), layout="constrained")
    for row, (name, share, view) in zip(axes, rows, strict=True):
        vertices, triangles = read_mesh(SHARED / name)
        noisy = with_noise(vertices, triangles, share, 1001, isotropic=False)
        denoised = approximate(noisy, triangles, Settings(denoise="only")).vertices
        for axis, points, title in zip(
            row, (vertices, noisy, denoised), ("clean", f"noise {share:.1%}", "denoised"), strict=True
        ):
            found = closeness(vertices, triangles, points)
            text = title if points is vertices else f"{title}: rms {found.rms:.2e}, normals {found.degrees:.1f}°"
            picture = shoot([Shown(points, triangles, BUFF)], view, size=SIZE, frame=vertices)
            _show(axis, picture, text)
    _save(figure, path)


def denoise_camera(path: Path) -> None:
    """A pyramid of plaster as a depth camera sees it, denoised, and measured by a laser scanner."""
    folder = SHARED.parent / "bench" / "denoising"
    truth, triangles = read_mesh(folder / "kinect-pyramid-truth.ply")
    scanned, _ = read_mesh(folder / "kinect-pyramid-noisy.ply")
    denoised = approximate(scanned, triangles, Settings(denoise="only")).vertices
    figure, axes = plt.subplots(1, 3, figsize=(13.0, 4.4), layout="constrained")
    for axis, points, title in zip(axes, (scanned, denoised, truth), ("scanned", "denoised", "truth"), strict=True):
        found = closeness(truth, triangles, points)
        text = title if points is truth else f"{title}: rms {found.rms:.2e}, normals {found.degrees:.1f}°"
        _show(axis, shoot([Shown(points, triangles, BUFF)], CAMERA, size=SIZE, frame=truth), text)
    _save(figure, path)


def inspect(path: Path) -> None:
    """One patch of fandisk over its creases, as in the paper: both domains, its functions, coefficients, energy."""
    vertices, triangles = read_mesh(SHARED / "fandisk.obj")
    result = approximate(vertices, triangles, Settings(creases="off"))
    surface = result.representation
    sheet, fine = patch_sheet(surface, PATCH), patch_sheet(surface, PATCH, 4)
    rows = slice(*surface.triangle_offsets[PATCH : PATCH + 2])
    own = np.zeros(len(triangles), dtype=bool)
    own[surface.mesh_triangles[rows]] = True
    facing = _facing(vertices[triangles[surface.mesh_triangles[rows]]])
    figure = plt.figure(figsize=(13.0, 11.5), layout="constrained")
    mosaic = [["where"] * 2 + ["initial"] * 2 + ["optimised"] * 2, ["functions"] * 6, ["amounts"] * 3 + ["energy"] * 3]
    axes = figure.subplot_mosaic(mosaic, height_ratios=[1.25, 0.8, 1.0])
    corner_colours = srgb_to_linear(np.repeat(facing[fine.source], 3, axis=0))
    shown = [Shown(vertices, triangles[~own], (0.8, 0.8, 0.8)), _by_corner(fine.values, fine.triangles, corner_colours)]
    picture = shoot(shown, FANDISK, size=SIZE, frame=vertices)
    _show(axes["where"], picture, f"patch {PATCH} of {surface.patches} on the surface")
    for name, domain in (("initial", sheet.initial_domains[0]), ("optimised", sheet.domains[0])):
        drawn = PolyCollection(domain[sheet.triangles], facecolors=facing, edgecolors="black", linewidths=0.4)
        axes[name].add_collection(drawn)
        axes[name].set_title(f"{name} domain")
        axes[name].autoscale()
        axes[name].set_aspect("equal")
        axes[name].axis("off")
    shown = [
        _by_corner(
            np.column_stack([fine.domains[0] + [2.6 * d, 0.0], 0.8 * fine.heights[:, d]]),
            fine.triangles,
            corner_colours,
        )
        for d in range(3)
    ]
    picture = shoot(shown, View(azimuth=-15.0, elevation=32.0), size=(1240, 330))
    _show(axes["functions"], picture, "x(u, v), y(u, v) and z(u, v) over the optimised domain")
    _coefficients(axes["amounts"], surface, PATCH)
    energy = patch_energy(surface, PATCH)
    axes["energy"].plot(range(1, len(energy) + 1), energy, "o-", color="black")
    axes["energy"].set(title="energy, relative to the first iteration", xlabel="iteration", ylim=(0.0, 1.05))
    _save(figure, path)


def compare(path: Path) -> None:
    """The traditional sparse fit and the default on one colour scale."""
    vertices, triangles = read_mesh(SHARED / "fandisk.obj")
    results = {
        "traditional": approximate(vertices, triangles, Settings(method="traditional")),
        "default": approximate(vertices, triangles),
    }
    size = float(np.ptp(vertices, axis=0).max())
    largest = float(max(np.percentile(result.error, 99) for result in results.values()))
    figure, axes = plt.subplots(1, 2, figsize=(13.0, 5.4), layout="constrained")
    for axis, (title, result) in zip(axes, results.items(), strict=True):
        shown = Shown(result.vertices.astype(float), triangles, error_colours(result.error, largest))
        rms = result.report["relative"]["surface_rms"]
        _show(axis, shoot([shown], FANDISK, size=(640, 540)), f"{title}: surface rms {rms:.2e}")
    ramp = linear_to_srgb(ColourScale(0.0, 1.0).colours(np.linspace(0.0, 1.0, 256))[:, :3])
    bar = matplotlib.cm.ScalarMappable(
        matplotlib.colors.Normalize(0.0, largest / size), matplotlib.colors.ListedColormap(ramp)
    )
    figure.colorbar(bar, ax=axes, shrink=0.7, label="error at the vertices, in longest sides")
    _save(figure, path)


def resampled(path: Path) -> None:
    """A part of fandisk, and its surface evaluated on a mesh four times as fine."""
    vertices, triangles = read_mesh(SHARED / "fandisk.obj")
    fine = resample(approximate(vertices, triangles).representation, 4)
    middle = vertices[np.argmin(np.linalg.norm(vertices - np.quantile(vertices, 0.5, axis=0), axis=1))]
    near = vertices[np.linalg.norm(vertices - middle, axis=1) < 0.22 * np.ptp(vertices, axis=0).max()]
    figure, axes = plt.subplots(1, 2, figsize=(13.0, 5.4), layout="constrained")
    for axis, points, faces, title in (
        (axes[0], vertices, triangles, "a part of the mesh"),
        (axes[1], fine.vertices, fine.polygons(), "the surface there, every edge split in four"),
    ):
        _show(axis, shoot([Shown(points, faces, BUFF)], FANDISK, size=(640, 540), frame=near), title)
    _save(figure, path)


def creases(path: Path) -> None:
    """Stripes that a part of fandisk reflects: its mesh, and its surface without and with cuts along creases."""
    vertices, triangles = read_mesh(SHARED / "fandisk.obj")
    middle, radius = np.quantile(vertices, 0.5, axis=0), 0.22 * np.ptp(vertices, axis=0).max()
    middle = vertices[np.argmin(np.linalg.norm(vertices - middle, axis=1))]
    distance = np.linalg.norm(vertices - middle, axis=1)
    face = np.flatnonzero(distance[triangles].min(axis=1) < 2.0 * radius)
    grid = triangle_grid(REFLECTED_SPLITS)
    inside, each = np.tile(grid, (len(face), 1)), np.repeat(face, len(grid))
    faces = (_face_grid(REFLECTED_SPLITS)[None] + len(grid) * np.arange(len(face))[:, None, None]).reshape(-1, 3)
    figure, axes = plt.subplots(1, 2, figsize=(13.0, 5.4), layout="constrained")
    titles = "patches over the creases", "cut along the creases"
    for axis, mode, title in zip(axes, ("off", "auto"), titles, strict=True):
        surface = approximate(vertices, triangles, Settings(creases=mode)).representation
        shown = Shown(surface.evaluate(each, inside), faces, _stripes(surface.normals(each, inside), FANDISK))
        picture = shoot([shown], FANDISK, size=(640, 540), frame=vertices[distance < radius])
        _show(axis, picture, title)
    _save(figure, path)


def _face_grid(splits: int) -> NDArray[np.int64]:
    """Triangles between the points of `triangle_grid`, (splits^2, 3)."""
    grid = np.rint(splits * triangle_grid(splits)[:, 1:]).astype(np.int64)
    number = {(int(i), int(j)): n for n, (i, j) in enumerate(grid)}
    found = []
    for i, j in number:
        if i + j < splits:
            found.append([number[i, j], number[i + 1, j], number[i, j + 1]])
        if i + j < splits - 1:
            found.append([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]])
    return np.array(found)


def _stripes(normals: Array, view: View) -> Array:
    """Colours of what mirrors with these normals, (N, 3), show of black and white rings around the upright axis."""
    right, up, out = (np.array(axis) for axis in view.axes())
    if view.up == "Y":  # as `shoot` turns the meshes
        normals = normals @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    mirrored = 2.0 * (normals @ out)[:, None] * normals - out
    light = 0.5 + 0.5 * np.clip(6.0 * np.sin(STRIPES * (mirrored @ up) + 3.0 * (mirrored @ right)), -1.0, 1.0)
    return np.repeat((0.08 + 0.82 * light)[:, None], 3, axis=1)


def _by_corner(points: Array, triangles: NDArray[np.int64], colours: Array) -> Shown:
    """Take triangles apart, so that each has a colour of its own; `colours` of the corners, (3 T, 3) linear."""
    return Shown(points[triangles.ravel()], np.arange(triangles.size).reshape(-1, 3), colours)


def _coefficients(axis: Axes, surface: Any, patch: int) -> None:
    terms = [term for term in patch_terms(surface, patch) if term.name != "1"][:12][::-1]
    places = np.arange(len(terms))
    for d, (name, colour) in enumerate(zip("xyz", ("tab:red", "tab:green", "tab:blue"), strict=True)):
        axis.barh(places + 0.27 * (1 - d), [term.amounts[d] for term in terms], 0.25, color=colour, label=name)
    axis.set_yticks(places, [term.name for term in terms], fontsize=8)
    axis.set_title("its largest coefficients")
    axis.legend(loc="lower left")


def _facing(corners: Array) -> Array:
    """Colour of triangles, (T, 3, 3), by the direction that they face, sRGB (T, 3)."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return np.asarray(0.5 + 0.45 * normal)


def _show(axis: Axes, picture: Array, title: str) -> None:
    axis.imshow(picture)
    axis.set_title(title)
    axis.axis("off")


def _save(figure: Any, path: Path) -> None:
    figure.savefig(path, dpi=DOTS, metadata={"Software": None})
    plt.close(figure)


REPRESENTATION_FIGURES: dict[str, Callable[[Path], None]] = {
    "denoise": denoise,
    "denoise_camera": denoise_camera,
    "inspect_patch": inspect,
    "compare_methods": compare,
    "resample": resampled,
    "creases": creases,
}
"""Name of a picture in docs/pictures -> what makes it, from the models of ../shared."""
