"""Figures 9 to 12 and Table 1: whole surfaces."""

from __future__ import annotations

import colorsys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sparse_surface.solver import Approximation, Representation, approximate
from sparse_surface.solver.surface.metrics import statistics
from sparse_surface.solver.surface.overlaps import overlap_gaps

from .measurements import CREASED, DEFAULT, PRINTED, Notebook, measured, rounded
from .models import PAPER_MODELS, PaperModel
from .page import Page
from .patch_figures import facing, patch_parts
from .shots import BLUE, CYAN, GREY, PURPLE, RED, Colour, Shown, View, error_colours, shoot

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CUBE, CYLINDER = PAPER_MODELS[0], PAPER_MODELS[2]
COMPARED = {"paper as printed": PRINTED, "default": DEFAULT}
WITH_CREASES = {**COMPARED, "with creases": CREASED}

VIEWS = {
    "fandisk": View(azimuth=-60.0, elevation=30.0, up="Y"),
    "flower": View(azimuth=-20.0, elevation=42.0),
    "cubetorus": View(azimuth=-30.0, elevation=40.0),
    "bunny": View(azimuth=0.0, elevation=12.0, up="Y"),
    "bird": View(azimuth=-25.0, elevation=20.0),
}


def heat(result: Approximation, faces: Indices, largest: float) -> Shown:
    """Show a result in the colours of its errors."""
    return Shown(np.asarray(result.vertices, dtype=np.float64), faces, error_colours(result.error, largest))


# ------------------------------------------------------------------------------------------------------------- Fig. 9


def overlapping_pair(surface: Representation) -> tuple[int, int]:
    """Return the two patches that share a middling number of vertices and differ most there."""
    points = surface.at_patch_vertices
    best, pair = -1.0, (0, 1)
    for first in range(surface.patches):
        one = slice(*surface.vertex_offsets[first : first + 2])
        for second in range(first + 1, surface.patches):
            other = slice(*surface.vertex_offsets[second : second + 2])
            common, at_one, at_other = np.intersect1d(
                surface.patch_vertices[one], surface.patch_vertices[other], return_indices=True
            )
            if 0.2 < len(common) / (one.stop - one.start) < 0.5:
                gap = np.linalg.norm(points[one][at_one] - points[other][at_other], axis=1).mean()
                if gap > best:
                    best, pair = float(gap), (first, second)
    return pair


def pair_on_the_input(surface: Representation, pair: tuple[int, int]) -> list[Shown]:
    """Show where two patches lie: one red, one purple, what both hold grey."""
    used = [surface.patch_vertices[slice(*surface.vertex_offsets[k : k + 2])] for k in pair]
    sets = [
        {tuple(row) for row in np.sort(one[patch_parts(surface, k)[2]], axis=1).tolist()}
        for k, one in zip(pair, used, strict=True)
    ]
    parts = ((sets[0] - sets[1], RED), (sets[1] - sets[0], PURPLE), (sets[0] & sets[1], GREY))
    by_corners = {tuple(sorted(row)): row for k, one in zip(pair, used, strict=True)
                  for row in one[patch_parts(surface, k)[2]].tolist()}  # fmt: skip
    return [shown_part(surface.vertices, [by_corners[key] for key in sorted(part)], hue) for part, hue in parts if part]


def shown_part(vertices: Array, triangles: list[list[int]], colour: Colour) -> Shown:
    """Show some triangles of a mesh without the vertices that they do not use."""
    used, corners = np.unique(np.array(triangles), return_inverse=True)
    return Shown(vertices[used], corners.reshape(-1, 3), colour)


def figure_9(notebook: Notebook) -> Path:
    """Patches by themselves leave gaps; averaged, and after one and two sweeps."""
    vertices, faces = CYLINDER.load()
    page = Page(len(COMPARED), 6)
    pair, largest = None, 0.0
    for row, (name, settings) in enumerate(COMPARED.items()):
        results = [approximate(vertices, faces, replace(settings, sweeps=sweeps)) for sweeps in (0, 1, 2)]
        surface = results[0].representation
        pair = pair or overlapping_pair(surface)
        largest = largest or float(np.percentile(results[0].error, 99))
        draw_separate(page, row, name, surface, pair)
        for sweeps, result in enumerate(results):
            relative = result.report["relative"]
            gaps = overlap_gaps(result.representation)
            entry = {
                "gap_rms": rounded(statistics(gaps[gaps > 0])["rms"]),
                "gap_max": rounded(float(gaps.max())),
                "vertex_rms": relative["vertex_rms"],
                "surface_rms": relative["surface_rms"],
                "seam": result.report["seam_max"],
            }
            notebook.write("figure 9", {f"{name} {sweeps}": {key: rounded(value) for key, value in entry.items()}})
            title = f"blended, {sweeps} sweep{'' if sweeps == 1 else 's'}:\nrms {relative['vertex_rms']:.1e}"
            page.picture(row, 3 + sweeps, shoot([heat(result, faces, largest)], frame=vertices), title)
        page.colour_bar(row, slice(3, 6), largest)
    return page.save("figure_09")


def draw_separate(page: Page, row: int, name: str, surface: Representation, pair: tuple[int, int]) -> None:
    """Draw two overlapping patches, their fits, and all the patches' fits over one another."""
    values = surface.at_patch_vertices
    parts = [patch_parts(surface, patch) for patch in pair]
    close = np.concatenate([points for _, points, _ in parts])
    near = facing(close, surface.vertices)
    page.picture(row, 0, shoot(pair_on_the_input(surface, pair), near, frame=close), f"{name}:\ntwo patches, the input")
    fits = [Shown(values[own], triangles, hue) for (own, _, triangles), hue in zip(parts, (RED, PURPLE), strict=True)]
    page.picture(row, 1, shoot(fits, near, frame=close), "each fitted by itself")
    every = [(patch_parts(surface, patch), _hue(patch)) for patch in range(surface.patches)]
    seen = [Shown(values[own], triangles, hue) for (own, _, triangles), hue in every]
    page.picture(row, 2, shoot(seen, frame=surface.vertices), f"all {surface.patches} patches, not blended")


def _hue(number: int) -> Colour:
    return colorsys.hsv_to_rgb(number * 0.618034 % 1.0, 0.45, 0.9)


# ------------------------------------------------------------------------------------------------------------ Fig. 10


def figure_10(notebook: Notebook) -> Path:
    """Patches of 5, 7 and 10 rings."""
    vertices, faces = CUBE.load()
    rings = (5, 7, 10)
    page = Page(len(WITH_CREASES), 2 * len(rings) + 1, width=1.8, height=1.7)
    page.picture(0, 0, shoot([Shown(vertices, faces, BLUE)]), "input")
    for row, (name, settings) in enumerate(WITH_CREASES.items()):
        for place, ring in enumerate(rings):
            result = approximate(vertices, faces, replace(settings, ring=ring))
            relative, patches = result.report["relative"], result.report["patches"]
            entry = {"patches": patches, **{key: rounded(value) for key, value in relative.items()}}
            notebook.write("figure 10", {f"{name} {ring}": entry})
            shape = Shown(np.asarray(result.vertices, dtype=np.float64), faces, CYAN)
            title = f"{name},\nk = {ring}: {patches} patches"
            page.picture(row, 1 + 2 * place, shoot([shape], frame=vertices), title)
            coloured = shoot([heat(result, faces, 0.03)], frame=vertices)
            page.picture(row, 2 + 2 * place, coloured, f"rms {relative['vertex_rms']:.1e}")
        page.colour_bar(row, 2 * len(rings), 0.03)
    return page.save("figure_10")


# ---------------------------------------------------------------------------------------- Fig. 11, Fig. 12 and Table 1

LABELS = {"printed": "paper", "freer": "paper, freer", "default": "default", "creased": "with creases"}
LAST = 1 + 2 * len(LABELS)
"""The last column of a gallery, which has the scale beside it."""


def gallery(number: int, chosen: list[PaperModel], notebook: Notebook) -> Path:
    """Draw inputs, what the methods make of them and the colours of their errors; note what Table 1 tells."""
    models = [model for model in chosen if model.available]
    left_out = [model.name for model in chosen if not model.available]
    notebook.clear("left out", f"figure {number}")
    if left_out:
        notebook.write("left out", {f"figure {number}": left_out})
    for model in chosen:
        notebook.clear("models", f"{model.key} ")
    page = Page(max(len(models), 1), LAST + 1, width=1.75, height=1.55)
    for row, model in enumerate(models):
        draw_model(page, row, model, notebook)
    return page.save(f"figure_{number}")


def draw_model(page: Page, row: int, model: PaperModel, notebook: Notebook) -> None:
    """Draw a row of a gallery: the input, the traditional fit's errors, the other methods' shapes and errors."""
    mesh = vertices, faces = model.load()
    view, used = VIEWS.get(model.key, View()), vertices[np.unique(faces)]
    results = {method: measured(model, mesh, method, notebook) for method in model.methods}
    largest = float(np.percentile(results["printed"].error, 99))

    def draw(column: int, shown: Shown, title: str) -> None:
        page.picture(row, column, shoot([shown], view, frame=used), title)

    def rms(method: str) -> str:
        return f"rms {results[method].report['relative']['vertex_rms']:.1e}"

    draw(0, Shown(vertices, faces, BLUE), f"{model.name}: input")
    draw(1, heat(results["traditional"], faces, largest), f"traditional: {rms('traditional')}")
    for column, (method, label) in enumerate(LABELS.items()):
        if method in results:
            shape = np.asarray(results[method].vertices, dtype=np.float64)
            draw(2 + 2 * column, Shown(shape, faces, CYAN), label)
            draw(3 + 2 * column, heat(results[method], faces, largest), rms(method))
    page.colour_bar(row, LAST, largest)


def figure_11(notebook: Notebook) -> Path:
    """Models with creases."""
    return gallery(11, [model for model in PAPER_MODELS if model.creased], notebook)


def figure_12(notebook: Notebook) -> Path:
    """Models with details."""
    return gallery(12, [model for model in PAPER_MODELS if not model.creased], notebook)
