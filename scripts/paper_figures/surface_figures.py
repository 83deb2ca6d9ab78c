"""Figures 9 to 12: whole surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from measurements import METHODS, PRINTED, Notebook, measured, rounded
from models import PAPER_MODELS, PaperModel
from numpy.typing import NDArray
from page import Page
from patch_figures import patch_parts
from shots import BLUE, CYAN, PURPLE, RED, Shown, View, error_colours, shoot
from sparse_surface.solver import Approximation, Representation, Settings, approximate
from sparse_surface.solver.metrics import statistics
from sparse_surface.solver.overlaps import overlap_gaps

Array = NDArray[np.float64]

CUBE, CYLINDER = PAPER_MODELS[0], PAPER_MODELS[2]

VIEWS = {
    "fandisk": View(azimuth=-60.0, elevation=30.0, up="Y"),
    "flower": View(azimuth=-20.0, elevation=42.0),
    "cubetorus": View(azimuth=-30.0, elevation=40.0),
    "bunny": View(azimuth=0.0, elevation=12.0, up="Y"),
    "bird": View(azimuth=-25.0, elevation=20.0),
}


def heat(result: Approximation, faces: NDArray[np.int64], largest: float) -> Shown:
    """Show a result in the colours of its errors."""
    return Shown(np.asarray(result.vertices, dtype=np.float64), faces, error_colours(result.error, largest))


def overlapping_pair(surface: Representation) -> tuple[int, int]:
    """Return the two patches that share a middling number of vertices and differ most there."""
    points = surface.at_patch_vertices()
    best, pair = -1.0, (0, 1)
    for first in range(surface.patches):
        one = slice(*surface.vertex_offsets[first : first + 2])
        for second in range(first + 1, surface.patches):
            other = slice(*surface.vertex_offsets[second : second + 2])
            common, at_one, at_other = np.intersect1d(
                surface.patch_vertices[one], surface.patch_vertices[other], return_indices=True
            )
            share = len(common) / (one.stop - one.start)
            if 0.2 < share < 0.5:
                gap = np.linalg.norm(points[one][at_one] - points[other][at_other], axis=1).mean()
                if gap > best:
                    best, pair = float(gap), (first, second)
    return pair


def figure_9(notebook: Notebook) -> None:
    """Patches by themselves leave gaps; averaged, and after one and two sweeps."""
    vertices, faces = CYLINDER.load()
    methods = {"paper as printed": PRINTED, "default": Settings()}
    page = Page(len(methods), 6)
    view = VIEWS.get(CYLINDER.key, View())
    for row, (name, settings) in enumerate(methods.items()):
        results = [approximate(vertices, faces, replace(settings, sweeps=sweeps)) for sweeps in (0, 1, 2)]
        surface = results[0].representation
        pair = overlapping_pair(surface)
        values = surface.at_patch_vertices()
        parts = [patch_parts(surface, patch) for patch in pair]
        close = np.concatenate([points for _, points, _ in parts])
        near = View(azimuth=_azimuth(close), elevation=35.0)
        overlap = [
            Shown(points, triangles, colour)
            for (_, points, triangles), colour in zip(parts, (RED, PURPLE), strict=True)
        ]
        page.picture(row, 0, shoot(overlap, near, frame=close), f"{name}: two patches of the input")
        own = [
            Shown(values[part], triangles, colour)
            for (part, _, triangles), colour in zip(parts, (RED, PURPLE), strict=True)
        ]
        page.picture(row, 1, shoot(own, near, frame=close), "each fitted by itself")
        seen = [Shown(*_patch(surface, values, k), _hue(k)) for k in range(surface.patches)]
        page.picture(row, 2, shoot(seen, view, frame=vertices), f"all {surface.patches} patches, not blended")
        if row == 0:
            largest = float(np.percentile(results[0].error, 99))
        for sweeps, result in enumerate(results):
            relative = result.report["relative"]
            gaps = overlap_gaps(result.representation)
            entry = {
                "gap_rms": rounded(statistics(gaps[gaps > 0])["rms"]),
                "gap_max": rounded(float(gaps.max())),
                "vertex_rms": rounded(relative["vertex_rms"]),
                "surface_rms": rounded(relative["surface_rms"]),
                "seam": rounded(result.report["seam_max"]),
            }
            notebook.write("figure 9", {f"{name} {sweeps}": entry})
            title = f"blended, {sweeps} sweep{'' if sweeps == 1 else 's'}: rms {relative['vertex_rms']:.1e}"
            page.picture(row, 3 + sweeps, shoot([heat(result, faces, largest)], view, frame=vertices), title)
    page.colour_bar(0, slice(3, 6), largest)
    page.save("figure_09")


def _patch(surface: Representation, values: Array, patch: int) -> tuple[Array, NDArray[np.int64]]:
    part, _, triangles = patch_parts(surface, patch)
    return values[part], triangles


def _hue(number: int) -> tuple[float, float, float]:
    import colorsys

    return colorsys.hsv_to_rgb(number * 0.618034 % 1.0, 0.45, 0.9)


def _azimuth(points: Array) -> float:
    out = points.mean(axis=0) - 0.5 * (points.min(axis=0) + points.max(axis=0)).mean()
    return float(np.degrees(np.arctan2(-out[0], -out[1]))) + 20.0


def figure_10(notebook: Notebook) -> None:
    """Patches of 5, 7 and 10 rings."""
    vertices, faces = CUBE.load()
    rings = (5, 7, 10)
    page = Page(3, len(rings) + 1)
    page.picture(0, 0, shoot([Shown(vertices, faces, BLUE)]), "input")
    for column, ring in enumerate(rings, start=1):
        for row, (name, settings) in enumerate({"printed": PRINTED, "default": Settings()}.items(), start=1):
            result = approximate(vertices, faces, replace(settings, ring=ring))
            relative = result.report["relative"]
            entry = {
                "patches": result.report["patches"],
                "surface_rms": rounded(relative["surface_rms"]),
                "vertex_rms": rounded(relative["vertex_rms"]),
                "seconds": rounded(result.report["seconds"]["total"]),
            }
            notebook.write("figure 10", {f"{name} {ring}": entry})
            if row == 1:
                page.picture(
                    0, column, shoot([Shown(result.vertices, faces, CYAN)], frame=vertices),
                    f"k = {ring}: {result.report['patches']} patches",
                )  # fmt: skip
            page.picture(
                row, column, shoot([heat(result, faces, 0.03)], frame=vertices),
                f"{'paper as printed' if row == 1 else 'default'}: rms {relative['vertex_rms']:.1e}",
            )  # fmt: skip
    page.colour_bar(1, slice(1, 4), 0.03)
    page.colour_bar(2, slice(1, 4), 0.03)
    page.save("figure_10")


def gallery(name: str, models: list[PaperModel], notebook: Notebook, only: tuple[str, ...]) -> None:
    """Input, the paper's method, the default method, and the colours of their errors, for several models."""
    page = Page(len(models), 5)
    for row, model in enumerate(models):
        vertices, faces = model.load()
        results = {method: measured(model, method, notebook) for method in only}
        printed, own = results["printed"], results["default"]
        largest = float(np.percentile(printed.error, 99))
        view, used = VIEWS.get(model.key, View()), vertices[np.unique(faces)]
        page.picture(row, 0, shoot([Shown(vertices, faces, BLUE)], view, frame=used), f"{model.name}: input")
        for column, (result, label) in enumerate(((printed, "paper"), (own, "default"))):
            rms = result.report["relative"]["vertex_rms"]
            shown = Shown(np.asarray(result.vertices, dtype=float), faces, CYAN)
            page.picture(row, 1 + 2 * column, shoot([shown], view, frame=used), label)
            coloured = shoot([heat(result, faces, largest)], view, frame=used)
            page.picture(row, 2 + 2 * column, coloured, f"{label}: rms {rms:.1e}")
        page.colour_bar(row, 4, largest)
    page.save(name)


def figure_11(notebook: Notebook) -> None:
    """Models with creases."""
    gallery("figure_11", [m for m in PAPER_MODELS if m.creased and m.available], notebook, tuple(METHODS))


def figure_12(notebook: Notebook) -> None:
    """Models with details."""
    models = [model for model in PAPER_MODELS if not model.creased and model.available]
    gallery("figure_12", models, notebook, ("traditional", "printed", "default"))
